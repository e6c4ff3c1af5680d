"""A text as blocks of rows with equally many columns."""

from dataclasses import replace
from typing import Any

import numpy as np

from acquisition.files.layout import Layout
from acquisition.files.table import damage
from acquisition.files.table.numbers import block as block_of
from acquisition.files.table.numbers import cells_of, dialect, is_closed, labelled
from acquisition.files.table.segment import Segment
from acquisition.files.table.titles import titles as titles_of
from acquisition.files.table.titles import unit_row
from ema.data import Finding
from ema.errors import InputError

_MOST = 4096
"""Lines that are read at once."""


def parse(text: str, layout: Layout, where: str) -> list[Segment]:
    """The numeric blocks of a text table.

    Raises
    ------
    InputError : there are no numbers.
    """
    lines = text.splitlines()
    delimiter, decimal = dialect(lines, layout)
    segments: list[Segment] = []
    header: list[str] = []
    rows: list[Any] = []  # blocks of one or many lines
    labels: list[str] = []
    place, many, begin, closed = 0, _MOST, 0, False

    def close() -> None:
        """End the block of rows."""
        source = lines[begin:place] if labels else ()
        made = _segment(header, rows, labels, delimiter=delimiter, where=where)
        segments.append(replace(made, line=begin + 1, source=tuple(source), closed=closed, decimal=decimal))

    while place < len(lines):
        columns = rows[0].shape[1] if rows else 0
        if rows and not labels:
            block = block_of(lines[place : place + many], delimiter, decimal, columns=columns, closed=closed)
            if block is not None:
                rows.append(block)
                place, many = place + len(block), min(4 * many, _MOST)
                continue
            many = max(many // 4, 4)
            if many > 4:
                continue
        line = lines[place]
        closes = is_closed(line, delimiter) and (closed if rows else not _announced(header, line, delimiter))
        cells, label = cells_of(line, delimiter, decimal, closes), ""
        if cells is None:
            label, cells = labelled(line, delimiter, decimal)
        if rows and (cells is None or len(cells) != columns or closes != closed or bool(label) != bool(labels)):
            close()
            header, rows, labels, many = [], [], [], _MOST
        closed = closed if rows else closes
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
    segments = damage.whole([*_with_metadata(segments), behind], layout, where, delimiter, decimal)[:-1]
    longest = max((len(segment.values) for segment in segments), default=0)
    segments = damage.without_single_rows(segments, layout, where) if longest > 1 else segments
    if not segments:
        raise InputError(
            "no table of numbers in the file",
            where=where,
            got=repr(text[:40]),
            advice="export it as a table of numbers, or say delimiter='...' and decimal='...'",
        )
    return segments


def _announced(header: list[str], row: str, delimiter: str) -> bool:
    """Whether the line above a row has a title for the empty cell at its end."""
    above = header[-1] if header else ""
    return above.count(delimiter) == row.count(delimiter) and not is_closed(above, delimiter)


def _segment(header: list[str], rows: list[Any], labels: list[str], *, delimiter: str, where: str) -> Segment:
    values = np.concatenate(rows)
    full = ~np.isnan(values).all(axis=0)
    titles = titles_of(header, delimiter, values.shape[1])
    row = tuple(unit_row(header, values.shape[1], delimiter))
    empty = [] if labels else [t for n, t in enumerate(titles) if not full[n] and t != f"column {n}"]
    notes = tuple(Finding("warning", "not-read", f"{where}, {t}", "the column holds nothing.") for t in empty)
    if not full.all() and not labels and len(values) > 1:
        values, titles = values[:, full], tuple(t for t, keep in zip(titles, full, strict=True) if keep)
        row = tuple(text for text, keep in zip(row, full, strict=False) if keep)
    return Segment(tuple(header), values, titles, tuple(labels), row, notes=notes)


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
