"""Text tables: CSV, TXT, TSV, with decimal point or comma, several header lines and several segments."""

import re
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files import sniff
from acquisition.files.arrange import arrange
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.files.scales import bare_title, is_unit
from ema.data import Finding
from ema.errors import InputError

_MOST = 4096
"""Lines that are read at once."""

_TITLES = {
    "time": ("t", "time", "zeit", "x_value", "timestamp"),
    "frequency": ("f", "freq", "frequency", "frequenz"),
    "real": ("re", "real", "real part", "realteil"),
    "imaginary": ("im", "imag", "imaginary", "imaginary part", "imaginärteil"),
    "amplitude": ("amplitude", "magnitude", "mag", "modulus", "abs", "level", "gain", "betrag", "pegel"),
    "phase": ("phase", "angle", "argument", "arg", "phasenwinkel"),
    "coherence": ("coherence", "kohärenz", "coh"),
    "node": ("node", "point", "nr", "id", "knoten"),
    "x": ("x",),
    "y": ("y",),
    "z": ("z",),
}


_ODD = re.compile(r"[\0-\x08\x0e-\x1f\xa0]|\d_\d")
"""What a conversion to numbers skips and no number holds: control characters, and lines between digits."""


@dataclass(frozen=True)
class Segment:
    """A block of rows with equally many columns, and the lines of text above it."""

    header: tuple[str, ...]
    values: Any
    titles: tuple[str, ...]
    labels: tuple[str, ...] = ()
    """Names of the rows, where every row begins with one."""
    units: tuple[str, ...] = ()
    """What a line of units above the columns says of each; empty where there is no such line."""
    line: int = 0
    """Number of the first row in the file, counted from 1."""
    source: tuple[str, ...] = ()
    """The rows as text, where every row begins with a name."""
    notes: tuple[Finding, ...] = ()


def decode(data: bytes) -> str:
    """Text in UTF-8, UTF-16 or, failing these, Latin-1."""
    for mark, code in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig")):
        if data.startswith(mark):
            return data.decode(code, errors="replace")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def read(path: Path, layout: Layout) -> Contents:
    """Read a text table; every segment of signals becomes a recording.

    Raises
    ------
    InputError : no numbers in it, or the table does not say which column is what.
    """
    text = decode(sniff.whole(path))
    segments = parse(text, layout, path.name)
    parts = [arranged(segment, layout, _name(path, number, len(segments))) for number, segment in enumerate(segments)]
    return merge(parts)


def _name(path: Path, number: int, count: int) -> str:
    return path.name if count == 1 else f"{path.name}, segment {number + 1}"


def merge(parts: list[Contents]) -> Contents:
    """The contents of several segments in one."""
    return Contents(
        recordings=tuple(r for part in parts for r in part.recordings),
        frfs=tuple(f for part in parts for f in part.frfs),
        modes=tuple(m for part in parts for m in part.modes),
        geometry=next((part.geometry for part in parts if part.geometry is not None), None),
        findings=tuple(f for part in parts for f in part.findings),
        metadata=tuple(dict.fromkeys(m for part in parts for m in part.metadata)),
    )


def parse(text: str, layout: Layout, where: str) -> list[Segment]:
    """The numeric blocks of a text table.

    Raises
    ------
    InputError : there are no numbers.
    """
    lines = text.splitlines()
    delimiter, decimal = _dialect(lines, layout)
    segments: list[Segment] = []
    header: list[str] = []
    rows: list[Any] = []  # blocks of one or many lines
    labels: list[str] = []
    place, many, begin = 0, _MOST, 0

    def close() -> None:
        """End the block of rows."""
        source = lines[begin:place] if labels else ()
        segments.append(replace(_segment(header, rows, labels, delimiter), line=begin + 1, source=tuple(source)))

    while place < len(lines):
        columns = rows[0].shape[1] if rows else 0
        if rows and not labels:
            block = _block(lines[place : place + many], delimiter, decimal, columns)
            if block is not None:
                rows.append(block)
                place, many = place + len(block), min(4 * many, _MOST)
                continue
            many = max(many // 4, 4)
            if many > 4:
                continue
        line = lines[place]
        cells, label = _cells(line, delimiter, decimal, columns), ""
        if cells is None:
            label, cells = _labelled(line, delimiter, decimal)
        if rows and (cells is None or len(cells) != columns or bool(label) != bool(labels)):
            close()
            header, rows, labels, many = [], [], [], _MOST
        if cells is not None:
            begin = begin if rows else place
            rows.append(np.array([cells]))
            labels += [label] if label else []
        else:
            header.append(line)
        place += 1
    if rows:
        close()
        header = []
    behind = Segment(tuple(header), np.zeros((0, 0)), (), line=len(lines) + 1)
    segments = _whole([*_with_metadata(segments), behind], layout, where, delimiter, decimal)[:-1]
    longest = max((len(segment.values) for segment in segments), default=0)
    segments = _without_single_rows(segments, where) if longest > 1 else segments
    if not segments:
        raise InputError("no table of numbers in the file", where=where, got=repr(text[:40]))
    return segments


def _with_metadata(segments: list[Segment]) -> list[Segment]:
    """Rows of a name and a number in front of a longer table are the header of that table."""
    merged: list[Segment] = []
    for segment in segments:
        if merged and merged[-1].labels and not segment.labels and len(segment.values) > max(len(merged[-1].values), 1):
            before = merged.pop()
            header = (*before.header, *before.source, *segment.header)
            segment = replace(segment, header=header)
        merged.append(segment)
    return merged


def _whole(segments: list[Segment], layout: Layout, where: str, delimiter: str, decimal: str) -> list[Segment]:
    """The tables of a file, none of them interrupted by a row of another length, a blank line or a damaged one.

    The last segment holds the lines behind the last table.

    Raises
    ------
    InputError : one is, and salvage was not asked for.
    """
    for place, (before, after) in enumerate(pairwise(segments)):
        what, gap = "", after.header
        columns, expected = after.values.shape[1], before.values.shape[1]
        if len(before.values) < 2 or before.labels:
            continue
        if after.labels:
            if not gap and len(after.labels) == 1 and columns == expected - 1 and _titled(before):
                what = "a row that begins with no number"
        elif after is segments[-1]:
            if any(_broken(line, delimiter, decimal, expected) for line in gap):
                what = "a row that holds no numbers"
            elif any(map(str.strip, gap)):
                message = f"text behind the last table, not read: {next(filter(str.strip, gap)).strip()[:40]!r}."
                note = Finding("info", "not-read", where, message)
                return [*segments[:place], replace(before, notes=(*before.notes, note)), after]
        elif not gap and len(after.values) == 1 and columns != expected:
            what = f"a row of {columns} cells in a table of {expected} columns"
        elif _titled(before) and not _titled(after) and columns == expected and _is_damage(gap):
            what = "a blank line inside the table" if not any(map(str.strip, gap)) else "a row that holds no numbers"
        if what:
            notes = differs(
                what,
                where=f"{where}, line {after.line - len(gap)}",
                layout=layout,
                recovered=f"the {len(before.values)} rows in front of it are read",
            )
            return [*segments[:place], replace(before, notes=notes), segments[-1]]
    for segment in segments[:-1]:
        if segment.header and not segment.labels and _broken(segment.header[-1], delimiter, decimal):
            differs(
                "a row that holds no numbers",
                where=f"{where}, line {segment.line - 1}",
                layout=layout,
                got=repr(segment.header[-1][:40]),
            )
    return segments


def _broken(line: str, delimiter: str, decimal: str, columns: int = 0) -> bool:
    """Whether a text was a row of numbers: half of its cells are, and the first is one or they fill the columns."""
    cells = line.split() if delimiter == " " else line.split(delimiter)
    cells = [cell.replace(",", ".") if decimal == "," else cell for cell in cells]
    numbers = [_numbers([cell]) is not None for cell in cells]
    return len(cells) > 1 and 2 * sum(numbers) >= len(cells) and (numbers[0] or len(cells) == columns)


def _without_single_rows(segments: list[Segment], where: str) -> list[Segment]:
    """The tables without the rows that stand alone; one that has the columns of the table behind it is named."""
    kept: list[Segment] = []
    alone: list[Segment] = []
    for segment in segments:
        if len(segment.values) == 1:
            alone.append(segment)
            continue
        like = [row for row in alone if not row.labels and row.values.shape[1] == segment.values.shape[1] > 1]
        notes = [
            Finding(
                "info", "not-read", f"{where}, line {row.line}", "a row of numbers in front of the table, not read."
            )
            for row in like
        ]
        kept.append(replace(segment, notes=(*notes, *segment.notes)))
        alone = []
    return kept


def _titled(segment: Segment) -> bool:
    """Whether the columns have titles, which are no decimal numbers as in a damaged row."""
    if any(re.fullmatch(r"[-+]?\d*[.,]\d+([eE][-+]?\d+)?", title) for title in segment.titles):
        return False
    return any(title != f"column {place}" for place, title in enumerate(segment.titles))


def _is_damage(gap: tuple[str, ...]) -> bool:
    """Whether the lines between two tables are blank, or were rows of numbers."""
    number = re.compile(r"(^|[\s;,])[-+]?\d+([.,]\d+)?([eE][-+]?\d+)?($|[\s;,])")
    return all(number.search(line) for line in gap if line.strip())


def _block(lines: list[str], delimiter: str, decimal: str, columns: int) -> Any:
    """Lines of ``columns`` plain numbers each, all at once; ``None`` where one of them is anything else."""
    if delimiter == " ":
        alike = all(len(line.split()) == columns for line in lines)
    else:
        alike = all(line.count(delimiter) == columns - 1 for line in lines)
    text = delimiter.join(lines)
    if not alike or (decimal == "," and "." in text) or _ODD.search(text):
        return None
    if decimal == ",":
        text = text.replace(",", ".")
    try:
        numbers = list(map(float, text.split() if delimiter == " " else text.split(delimiter)))
    except ValueError:
        return None
    return np.array(numbers).reshape(len(lines), columns)


def _segment(header: list[str], rows: list[Any], labels: list[str], delimiter: str) -> Segment:
    values = np.concatenate(rows)
    full = ~np.isnan(values).all(axis=0)
    titles = _titles(header, delimiter, values.shape[1])
    row = tuple(_unit_row(header, values.shape[1], delimiter))
    if not full.all() and not labels:
        values, titles = values[:, full], tuple(t for t, keep in zip(titles, full, strict=True) if keep)
        row = tuple(text for text, keep in zip(row, full, strict=False) if keep)
    return Segment(tuple(header), values, titles, tuple(labels), row)


def _number(cell: str) -> complex:
    """A real or complex number; an empty cell is NaN."""
    try:
        return float(cell)
    except ValueError:
        cell = cell.strip()
        if cell[:1] == cell[-1:] == '"' and len(cell) > 1:
            cell = cell[1:-1].strip()
        if not cell:
            return float("nan")
        if cell[-1:] in "ij)" and cell[:1] in "+-.(0123456789":
            return complex(cell.replace("i", "j").replace(" ", ""))
        return float(cell.replace("D", "E").replace("d", "e"))


def _numbers(cells: list[str]) -> list[complex] | None:
    """The cells as numbers, or ``None`` where one is something else or all are empty."""
    try:
        numbers = [_number(cell) for cell in cells]
    except ValueError:
        return None
    return numbers if any(cell.strip() for cell in cells) else None


def _cells(line: str, delimiter: str, decimal: str, columns: int = 0) -> list[complex] | None:
    """The numbers of a line, or ``None`` where the line holds anything else.

    A delimiter at the end of the line closes it, unless the lines above have a column there.
    """
    cells = line.split() if delimiter == " " else line.split(delimiter)
    if _ODD.search(line):
        return None
    if decimal == ",":
        if "." in line:
            return None
        cells = [cell.replace(",", ".") for cell in cells]
    if delimiter != " " and len(cells) > 1 and len(cells) != columns and not cells[-1].strip():
        cells.pop()
    return _numbers(cells) if line[:1] != "_" else None


def _labelled(line: str, delimiter: str, decimal: str) -> tuple[str, list[complex] | None]:
    """Label and numbers of a row that begins with a name."""
    if delimiter == " ":
        return "", None
    label, found, rest = line.partition(delimiter)
    if not found or not any(c.isalpha() for c in label):
        return "", None
    cells = [cell.replace(",", ".") if decimal == "," else cell for cell in rest.split(delimiter)]
    return label.strip().strip('"'), _numbers(cells)


def _dialect(lines: list[str], layout: Layout) -> tuple[str, str]:
    """Delimiter and decimal mark: those that read the most lines of a sample as numbers."""
    middle = len(lines) // 2
    sample = [line for line in (*lines[:150], *lines[middle : middle + 50]) if line.strip()]
    best, choice = -1.0, (",", ".")
    for delimiter in [layout.delimiter] if layout.delimiter else ["\t", ";", ",", " "]:
        for decimal in [layout.decimal] if layout.decimal else [".", ","]:
            if delimiter == decimal:
                continue
            counts = []
            for line in sample:
                cells = _cells(line, delimiter, decimal)
                cells = cells if cells is not None else _labelled(line, delimiter, decimal)[1]
                counts.append(0 if cells is None else len(cells))
            score = sum(count > 0 for count in counts) + 0.001 * sum(counts) / max(len(counts), 1)
            if score > best:
                best, choice = score, (delimiter, decimal)
    return choice


def _titles(header: list[str], delimiter: str, columns: int) -> tuple[str, ...]:
    """Titles of the columns: the nearest line above that has one for each."""
    for line in reversed(header[-6:]):
        if not line.strip() or re.match(r"^\s*\*\*\*", line):
            continue
        cells = [cell.strip().strip('"') for cell in (line.split(delimiter) if delimiter != " " else line.split())]
        while len(cells) > columns and not cells[-1]:
            cells.pop()
        if len(cells) == columns and sum(bool(cell) for cell in cells) >= max(1, columns - 1):
            if all(map(is_unit, cells)) and len(header) > 1:
                continue  # a line of units; the names are above it
            return tuple(cell.lstrip("# ") or f"column {place}" for place, cell in enumerate(cells))
    return tuple(f"column {place}" for place in range(columns))


def _unit_row(header: list[str], columns: int, delimiter: str) -> list[str]:
    """Units from a header line that holds nothing but units."""
    for line in reversed(header[-4:]):
        cells = line.split() if delimiter == " " else line.split(delimiter)
        cells = [_unbracketed(cell.strip().strip('"')) for cell in cells]
        if len(cells) >= columns > 1 and all(cell and is_unit(cell) for cell in cells[:columns]):
            return cells[:columns]
    return []


def _unbracketed(cell: str) -> str:
    return cell[1:-1].strip() if cell[:1] + cell[-1:] in ("[]", "()") else cell


def arranged(segment: Segment, layout: Layout, where: str) -> Contents:
    """One segment arranged by the user's layout, or by its titles where these leave no doubt."""
    if segment.labels:
        named = {label: row[np.isfinite(row)] for label, row in zip(segment.labels, segment.values, strict=True)}
        contents = arrange(Arrays(where, named), layout)
        return replace(contents, findings=(*segment.notes, *contents.findings))
    pairs = [units.bracketed(title) for title in segment.titles]
    texts = segment.units or [unit for _, unit in pairs]
    names = _distinct([name for name, _ in pairs])
    unknown = {n: text for n, text in zip(names, texts, strict=True) if text and units.known(text) is None}
    arrays = {"": segment.values}
    known: dict[str, str] = {}
    labels: dict[str, str] = {}
    headings: dict[str, str] = {}
    for place, (name, text) in enumerate(zip(names, texts, strict=True)):
        for key in (name, segment.titles[place], f"column {place}"):
            if key == name or key == segment.titles[place]:
                arrays.setdefault(key, segment.values[:, place])
            labels.setdefault(key, text)
            headings.setdefault(key, f"{segment.titles[place]} {text if segment.units else ''}".strip())
            if text and text not in unknown.values():
                known.setdefault(key, text)
    pool = Arrays(
        where, arrays, units=known, titles=names, metadata=_metadata(segment.header), labels=labels, headings=headings
    )
    open_question = not layout.kind or (layout.kind == "signals" and layout.signals is None and layout.time is None)
    chosen = replace(_by_titles(names, layout, where) if open_question else layout, axis="columns")
    rate = _header_rate(segment.header)
    if rate is not None and chosen.sampling_rate is None and chosen.kind in ("", "signals"):
        signals = chosen.signals or [name for name in names if name != chosen.time]
        kept = [n for n in signals if not _counts(n, pool)] if isinstance(signals, list) else signals
        chosen = replace(chosen, sampling_rate=rate, signals=kept)
    contents = arrange(pool, chosen)
    stated = layout.units is not None or layout.unit is not None
    polar = (chosen.amplitude, chosen.phase)
    notes = [] if stated else [_unknown_unit(where, n, text) for n, text in unknown.items() if n not in polar]
    return replace(contents, findings=(*segment.notes, *contents.findings, *notes))


_RATE = re.compile(
    r"^\W*(?:sampl\w*[ _-]?(?:rate|freq\w*)|abtast\w*|fs)\s*[(\[]?\s*(?P<before>[kM]?Hz|[kM]?S/s)?\s*[)\]]?"
    r"[\s\"]*[:=,;\t]?[\s\"]*(?P<number>\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)\s*\"?[,;\s]*(?P<after>[kM]?Hz|[kM]?S/s)?[\s;,\"]*$",
    re.IGNORECASE,
)
_COUNTERS = ("sample", "samples", "no", "no.", "nr", "nr.", "index", "#", "count", "scan", "record", "number")


def _header_rate(header: tuple[str, ...]) -> float | None:
    """The sampling rate in Hz that a line such as ``Sampling Rate(Hz),50`` states with its unit."""
    for line in header:
        found = _RATE.match(line)
        unit = (found["before"] or found["after"]) if found else None
        if found and unit:
            prefix = (
                {"k": 1e3, "m": 1e6}.get(unit[0].lower(), 1.0) if len(unit) > 2 and unit[0].lower() in "km" else 1.0
            )
            return float(found["number"].replace(",", ".")) * prefix
    return None


def _counts(name: str, pool: Arrays) -> bool:
    """Whether a column only numbers its rows."""
    values = np.asarray(pool[name])
    return name.lower() in _COUNTERS and values.dtype.kind == "f" and bool((np.diff(values) == 1).all())


def _distinct(names: list[str]) -> list[str]:
    """The names, a second column of one name called ``name #2``."""
    seen: dict[str, int] = {}
    distinct = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        distinct.append(name if seen[name] == 1 else f"{name} #{seen[name]}")
    return distinct


def _unknown_unit(where: str, name: str, text: str) -> Finding:
    return Finding(
        "warning",
        "unknown-unit",
        f"{where}, {name}",
        f"{text!r} is not a unit; the numbers are taken without one.",
        advice="Say the unit in the channel table.",
    )


def _by_titles(names: list[str], layout: Layout, where: str) -> Layout:
    """The layout that the titles state: time and signals, frequency and FRF, or coordinates.

    Raises
    ------
    InputError : two columns could be the same part of an FRF.
    """
    places: dict[str, str] = {}
    twice: dict[str, list[str]] = {}
    for role, words in _TITLES.items():
        plain = {name: re.sub(r" #\d+$", "", name) for name in names}
        fitting = [name for name in names if plain[name].lower() in words or bare_title(plain[name]) in words]
        if fitting:
            places[role] = fitting[0]
        if len(fitting) > 1:
            twice[role] = fitting
    if "time" in places:
        others = [name for name in names if name != places["time"]]
        if "time" in twice:
            raise InputError(
                "several columns could be the time",
                where=where,
                got=", ".join(twice["time"]),
                advice="say time='...' and signals=[...]",
            )
        return replace(layout, time=places["time"], signals=others)
    if "frequency" in places and ({"real", "imaginary"} <= places.keys() or {"amplitude", "phase"} <= places.keys()):
        roles = ("real", "imaginary") if "real" in places else ("amplitude", "phase")
        for role in ("frequency", *roles):
            if role in twice:
                raise InputError(
                    f"several columns could be the {role}",
                    where=where,
                    got=", ".join(twice[role]),
                    advice=f"say {role}='column 1' or the like, and so the other parts of the FRF",
                )
        return _with(layout, places, "frequency", "coherence", *roles)
    if {"x", "y", "z"} <= places.keys():
        return _with(layout, places, "x", "y", "z", "node")
    return layout


def _with(layout: Layout, places: dict[str, str], *roles: str) -> Layout:
    chosen: dict[str, Any] = {role: places[role] for role in roles if role in places}
    return replace(layout, **chosen)


def _metadata(header: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Header lines of the form ``name: text``, ``name = text`` or ``name<tab>text``."""
    found = []
    for line in header:
        match = re.match(r"^\W*([\w .()/-]{2,40}?)\s*[:=\t]\s*(\S.*?)\s*$", line)
        if match:
            found.append((match[1], match[2]))
    return tuple(found[:50])
