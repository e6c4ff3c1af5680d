"""Tables that are interrupted: rows of another length, blank lines, damaged rows and rows that stand alone."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np

from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.files.table.numbers import numbers as numbers_of
from acquisition.files.table.segment import Segment
from ema.data import Finding


def whole(segments: list[Segment], layout: Layout, where: str, delimiter: str, decimal: str) -> list[Segment]:
    """The tables of a file, none of them interrupted by a row of another length, a blank line or a damaged one.

    The last segment holds the lines behind the last table.

    Raises
    ------
    InputError : one is, and salvage was not asked for.
    """
    for place, (before, after) in enumerate(pairwise(segments)):
        what, gap = "", after.header
        columns, expected = after.values.shape[1], before.values.shape[1]
        if before.labels:
            continue
        ends_otherwise = not gap and not after.labels and columns == expected and after.closed != before.closed
        if len(before.values) < 2 and not (ends_otherwise or _resumed(segments[place : place + 3])):
            continue
        if after.labels:
            if any(_broken(line, delimiter, decimal) for line in gap):
                what = "a row that holds no numbers"
            elif not gap and len(after.labels) == 1 and columns == expected - 1 and _titled(before):
                what = "a row that begins with no number"
            elif not gap and re.match(r"\s*[-+]?\.?\d", after.labels[0]):  # the mark behind a number became a letter
                what = "a row that begins with a damaged number"
        elif after is segments[-1]:
            if any(_broken(line, delimiter, decimal, expected) for line in gap):
                what = "a row that holds no numbers"
            elif any(map(str.strip, gap)):
                message = f"text behind the last table, not read: {next(filter(str.strip, gap)).strip()[:40]!r}."
                note = Finding("info", "not-read", where, message)
                return [*segments[:place], replace(before, notes=(*before.notes, note)), after]
        elif ends_otherwise:
            what = "a row that ends otherwise than those above it (a delimiter behind its last number, or none)"
        elif not gap and len(after.values) == 1 and columns != expected:
            what = f"a row of {columns} cells in a table of {expected} columns"
        elif _titled(before) and not _titled(after) and columns == expected and _is_damage(gap):
            blank = "a blank line inside the table" if gap else "rows of another number of cells inside the table"
            what = "a row that holds no numbers" if any(map(str.strip, gap)) else blank
        if what:
            notes = differs(
                what,
                where=f"{where}, line {after.line - len(gap)}",
                layout=layout,
                recovered=f"the {len(before.values)} rows in front of it are read" if len(before.values) > 1 else "",
            )
            return [*segments[:place], replace(before, notes=(*before.notes, *notes)), segments[-1]]
    for segment in segments[:-1]:
        last = segment.header[-1] if segment.header and not segment.labels else ""
        # the first row, which lost the mark between two numbers, or its end: it begins as a number does
        begun = _titled(segment) and bool(re.match(r"\s*[-+]?\d", last))
        columns = len(last.split() if delimiter == " " else last.split(delimiter)) if begun else 0
        bare = begun and all(re.fullmatch(r"[-+]?\d*\.?\d+", number) for number in re.split(r"[\s;,]+", last.strip()))
        near = begun and _begins_one_step_before(last, decimal, segment)
        if last and (bare or near or _broken(last, delimiter, decimal, columns)):
            differs(
                "a row that holds no numbers",
                where=f"{where}, line {segment.line - 1}",
                layout=layout,
                got=repr(last[:40]),
            )
    return segments


def _resumed(segments: list[Segment]) -> bool:
    """Whether a table goes on directly behind a single row of another length."""
    if len(segments) < 3:
        return False
    before, row, behind = segments
    near = not (row.header or behind.header or row.labels or behind.labels)
    return near and len(row.values) == 1 < len(behind.values) and behind.values.shape[1] == before.values.shape[1]


def _broken(line: str, delimiter: str, decimal: str, columns: int = 0) -> bool:
    """Whether a text was a row of numbers: half of its cells are, and the first is one or they fill the columns."""
    cells = line.split() if delimiter == " " else line.split(delimiter)
    cells = [cell.replace(",", ".") if decimal == "," else cell for cell in cells]
    numbers = [numbers_of([cell]) is not None for cell in cells]
    return len(cells) > 1 and 2 * sum(numbers) >= len(cells) and (numbers[0] or len(cells) == columns)


def without_single_rows(segments: list[Segment], layout: Layout, where: str) -> list[Segment]:
    """The tables without the rows that stand alone; one that has the columns of the table behind it is named.

    Raises
    ------
    InputError : one continues the table, and salvage was not asked for.
    """
    kept: list[Segment] = []
    alone: list[Segment] = []
    for segment in segments:
        if len(segment.values) == 1:
            alone.append(segment)
            continue
        notes: list[Finding] = []
        for row in alone:
            same = not row.labels and row.values.shape[1] == segment.values.shape[1] > 1
            if same and _continues(row.values[0, 0], row.line, segment):
                what = "a row of the table stands in front of its titles"
                place = f"{where}, line {row.line}"
                notes += differs(what, where=place, layout=layout, recovered="the rows behind them are read")
            elif same:
                notes.append(_beside(row, where, "in front of"))
        kept.append(replace(segment, notes=(*notes, *segment.notes)))
        alone = []
    for row in alone if kept else ():
        last = kept[-1]
        same = not row.labels and row.values.shape[1] == last.values.shape[1] > 1
        notes = [_beside(row, where, "behind")]
        if same and _continues(row.values[0, 0], row.line, last):
            what, recovered = "a row of the table stands behind its end", "the rows in front of it are read"
            notes = list(differs(what, where=f"{where}, line {row.line}", layout=layout, recovered=recovered))
        kept[-1] = replace(last, notes=(*last.notes, *notes))
    return kept


def _beside(row: Segment, where: str, side: str) -> Finding:
    """The finding of a row that belongs to no table."""
    name = f" {row.labels[0].strip()!r}" if row.labels else ""
    return Finding(
        "info", "not-read", f"{where}, line {row.line}", f"a row of numbers{name} {side} the table, not read."
    )


def _begins_one_step_before(text: str, decimal: str, table: Segment) -> bool:
    """Whether the line above a table begins with the number that its even axis would have there."""
    found = re.match(r"\s*([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)", text.replace(decimal, "."))
    return found is not None and _continues(float(found[1]), table.line - 1, table)


def _continues(number: complex, line: int, table: Segment) -> bool:
    """Whether a row goes on an even axis, in front of it or behind, as far as the lines between have room for.

    A line that lost its end holds two rows.
    """
    axis = table.values[:, 0]
    steps = np.diff(axis)
    if (
        len(steps) < 2
        or not np.isfinite(axis).all()
        or not steps.mean()
        or np.ptp(steps.real) > 0.5 * abs(steps.mean())
    ):
        return False
    between = max(table.line - line - 1, line - table.line - len(axis), 0)
    beyond = ((axis[0] - number) / steps.mean(), (number - axis[-1]) / steps.mean())
    return any(abs(far - min(max(round(far.real), 1), 2 * between + 1)) < 0.25 for far in beyond)


def _titled(segment: Segment) -> bool:
    """Whether the columns have titles, which are no decimal numbers as in a damaged row."""
    if any(re.fullmatch(r"[-+]?\d*[.,]\d+([eE][-+]?\d+)?", title) for title in segment.titles):
        return False
    return not all(re.fullmatch(r"column \d+", title) for title in segment.titles)


def _is_damage(gap: tuple[str, ...]) -> bool:
    """Whether the lines between two tables are blank, or were rows of numbers."""
    number = re.compile(r"(^|[\s;,])[-+]?\d+([.,]\d+)?([eE][-+]?\d+)?($|[\s;,])")
    return all(number.search(line) for line in gap if line.strip())
