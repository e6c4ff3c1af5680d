"""LabVIEW measurement text (LVM): several segments, decimal comma or point, none, one or many time columns."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files import sniff, table
from acquisition.files.arrays import not_finite
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.files.sampled import TOGETHER
from acquisition.files.signals import before_si, labelled_units, make_recording, nice_rate, rate_of, same_rate
from acquisition.files.table.numbers import NO_NUMBER
from acquisition.files.table.titles import distinct, roles
from ema.data import Finding
from ema.errors import InputError

_END = "***End_of_Header***"


def read(path: Path, layout: Layout) -> Contents:
    """Read every segment as a recording.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        ``units`` of the channels where the header states none; ``salvage``: read an interrupted segment up to its end.

    Returns
    -------
    Contents
        One recording per segment, with signals (channel, sample) in SI where units are stated.

    Raises
    ------
    InputError
        There is no segment, or one whose rows are not those that its header announces.
    """
    lines = table.decode(sniff.whole(path)).splitlines()
    separator, decimal = _dialect(lines)
    segments = list(_segments(lines, separator))
    if not segments:
        raise InputError("no measurement in the file", where=path.name, expected=f"a line {_END} and rows behind it")
    general, parts = segments[0][0], []
    for number, (header, rows) in enumerate(segments[1:] or segments):
        name = path.name if len(segments) <= 2 else f"{path.name}, segment {number + 1}"
        parts.append(_recording(_Segment(name, general | header, rows, separator, decimal), layout))
    return table.merge(parts)


def _dialect(lines: list[str]) -> tuple[str, str]:
    """Separator and decimal mark, as the header names them."""
    words = {"Tab": "\t", "Comma": ",", "Semicolon": ";"}
    separator, decimal = "\t", "."
    for line in lines[:40]:
        key, _, value = line.partition("\t") if "\t" in line else line.partition(",")
        if key == "Separator":
            separator = words.get(value.strip("\t, "), "\t")
        if key == "Decimal_Separator":
            decimal = "," if value.startswith(",") else "."
    return separator, decimal


def _segments(lines: list[str], separator: str) -> Iterator[tuple[dict[str, list[str]], list[str]]]:
    """Header and rows of every part that a line of stars closes; the first header is that of the file.

    Blank lines stay among the rows: between rows they are damage, at the end of a segment they are not.
    """
    header: dict[str, list[str]] = {}
    rows: list[str] | None = None  # none yet: still in the header
    for line in lines:
        cells = [cell.strip() for cell in line.split(separator)]
        if cells[0] == _END:
            rows = []
        elif rows is None:
            header[cells[0]] = cells[1:]
        elif cells[0] == "Channels":
            yield header, rows
            header, rows = {cells[0]: cells[1:]}, None
        elif line.strip() or rows:
            rows.append(line)
    if rows is not None:
        yield header, rows


@dataclass(frozen=True)
class _Segment:
    """One segment as text."""

    name: str
    header: dict[str, list[str]]
    rows: list[str]
    separator: str
    decimal: str


def _recording(segment: _Segment, layout: Layout) -> Contents:
    name, header, separator, decimal = segment.name, segment.header, segment.separator, segment.decimal
    rows = segment.rows
    while rows and not rows[-1].strip():
        rows = rows[:-1]
    if len(rows) < 2:
        raise InputError(
            "a segment without samples",
            where=name,
            got=f"{len(rows)} rows",
            expected="a row of titles and rows of numbers",
            advice="export the file again",
        )
    titles = [cell.strip() for cell in rows[0].split(separator)]
    while len(titles) > 1 and not titles[-1] and titles[-2] == "Comment":
        titles.pop()  # a separator at the end of the line
    commented = titles[-1] == "Comment"
    columns = len(titles) - commented
    rows, notes = _sound_rows(segment, rows[1:], columns, commented, layout)
    values = _values(rows, separator, decimal, columns, name)
    times = _time_columns(segment, titles[:columns])
    full = np.isfinite(values).any(axis=0)
    signals = [place for place in range(columns) if titles[place] != "X_Value" and full[place]]
    if not signals:
        raise InputError(
            "a segment without signals",
            where=name,
            got=", ".join(titles),
            expected="a column of numbers other than X_Value",
            advice="export the file again",
        )
    notes += _announced(segment, values[:, signals], layout)
    notes += [
        Finding("warning", "not-read", f"{name}, {titles[place] or f'column {place}'}", "the column holds nothing.")
        for place in range(columns)
        if titles[place] != "X_Value" and not full[place]
    ]
    timeless = np.isnan(values[:, times]).all(axis=1) & np.isfinite(values[:, signals]).any(axis=1)
    if timeless.any() and not timeless.all():
        raise InputError(
            "a row without its time",
            where=f"{name}, row {int(np.argmax(timeless)) + 1}",
            got="an empty cell",
            expected="a number, as in the other rows",
            advice="a row that is shifted by a cell begins so",
        )
    for place in times[1:]:
        same_rate(rate_of(values[:, place], name), rate_of(values[:, times[0]], name), len(values), name)
    rate = _rate(header, values[:, times[0]] if times else None, decimal, name) / _second(header, name)
    _check_starts(header, [float(values[0, place]) for place in times], rate, name)
    names = distinct([titles[place] or f"column {place}" for place in signals])
    notes += [
        Finding("warning", "no-title", f"{name}, column {place}", "the column has no title.")
        for place in signals
        if not titles[place]
    ]
    labels = header.get("Y_Unit_Label", [])[: len(signals)]
    labels += [""] * (len(signals) - len(labels))
    found, about_units = labelled_units(layout, names, labels, name)
    notes += about_units
    record = make_recording(np.ascontiguousarray(values[:, signals].T), names, found, rate, name)
    metadata = tuple(
        (key, header[key][0]) for key in ("Operator", "Project", "Description", "Date", "Time") if header.get(key)
    )
    findings = (*notes, *not_finite(record.signals, name))
    return Contents(recordings=(record,), findings=findings, metadata=metadata, units=before_si(names, found))


def _second(header: dict[str, list[str]], name: str) -> float:
    """The unit of the axis of a segment in s.

    Raises
    ------
    InputError : the axis is none of time, as of a spectrum.
    """
    dimensions = {cell.strip() for cell in header.get("X_Dimension", []) if cell.strip()}
    labels = {cell.strip() for cell in header.get("X_Unit_Label", []) if cell.strip()}
    unit = units.known(next(iter(labels), "s"))
    timed = all("time" in roles(text) for text in dimensions)
    if not timed or len(labels) > 1 or unit is None or unit.quantity != "time":
        raise InputError(
            "the axis of a segment is none of time",
            where=name,
            got=", ".join(sorted(dimensions | labels)),
            expected="Time in s, ms or the like",
            advice="export the time signals",
        )
    return unit.factor


def _time_columns(segment: _Segment, titles: list[str]) -> list[int]:
    """The columns of times, as many as the header announces.

    Raises
    ------
    InputError : there are more or fewer.
    """
    announced = (segment.header.get("X_Columns") or ["One"])[0]
    found = [place for place, title in enumerate(titles) if title == "X_Value"]
    fits = {"No": not found or found == [0], "One": found == [0]}.get(announced, True)
    if not fits:
        raise InputError(
            "other time columns than the header announces",
            where=segment.name,
            got=", ".join(titles),
            expected=f"X_Columns {announced}",
            advice="export the file again",
        )
    return [] if announced == "No" else found


def _sound_rows(
    segment: _Segment, rows: list[str], columns: int, commented: bool, layout: Layout
) -> tuple[list[str], list[Finding]]:
    """The rows up to the first that is blank or holds fewer or more cells than there are titles.

    Behind the columns a comment may stand where there is a title for it, and blanks where there is none.

    Raises
    ------
    InputError : there is one, and salvage was not asked for.
    """
    for place, row in enumerate(rows):
        cells = row.split(segment.separator)
        many = len(cells) > columns + commented and any(cell.strip() for cell in cells[columns + commented :])
        if not row.strip() or len(cells) < columns or many:
            what = "a row with too many cells" if many else "a row with too few cells"
            what = what if row.strip() else "a blank line between the rows"
            notes = differs(
                what,
                where=f"{segment.name}, row {place + 1}",
                layout=layout,
                got=None if not row.strip() else len(cells),
                expected=None if not row.strip() else columns,
                recovered=f"the {place} rows in front of it are read" if place > 1 else "",
            )
            return rows[:place], list(notes)
    return rows, []


def _announced(segment: _Segment, values: Any, layout: Layout) -> list[Finding]:
    """Compare the header's numbers of channels and samples with the columns.

    Raises
    ------
    InputError : they differ, and salvage was not asked for.
    """
    notes: list[Finding] = []
    channels = _integers(segment.header.get("Channels", []))
    if channels and channels[0] != values.shape[1]:
        notes += differs(
            "another number of channels than the header announces",
            where=segment.name,
            layout=layout,
            got=values.shape[1],
            expected=channels[0],
            recovered="the columns that are there are read",
        )
    samples = _integers(segment.header.get("Samples", []))
    for place, expected in enumerate(samples[: values.shape[1]]):
        there = int(np.count_nonzero(~np.isnan(values[:, place])))
        if there != expected:
            notes += differs(
                "another number of samples than the header announces",
                where=f"{segment.name}, channel {place + 1}",
                layout=layout,
                got=there,
                expected=expected,
                recovered="the samples that are there are read",
            )
            break
    return notes


def _integers(cells: list[str]) -> list[int]:
    return [int(cell) for cell in cells if cell.strip().isdigit()]


def _values(rows: list[str], separator: str, decimal: str, columns: int, name: str) -> Any:
    """Numbers of the rows; an empty cell is NaN, a comment behind the last column is dropped."""
    try:
        if decimal == ",":
            rows = [row.replace(",", ".") for row in rows]
        cells = [row.split(separator)[:columns] for row in rows]
        odd = next((cell for row in cells for cell in row if NO_NUMBER.search(cell)), None)
        if odd is not None:
            raise ValueError(f"could not convert string to float: {odd!r}")
        table_ = [[float(cell) if cell.strip() else np.nan for cell in row] for row in cells]
        return np.array([row + [np.nan] * (columns - len(row)) for row in table_])
    except ValueError as error:
        raise InputError(
            f"a row is no numbers: {error}",
            where=name,
            expected=f"numbers with the decimal mark {decimal!r}",
            advice="export the file again",
        ) from error


def _check_starts(header: dict[str, list[str]], begins: list[float], rate: float, name: str) -> None:
    """Refuse channels that begin at different times, by their first times or by the header.

    Raises
    ------
    InputError : two of them are further apart than :data:`~acquisition.files.sampled.TOGETHER` of a sample.
    """
    stated = [float(cell.replace(",", ".")) for cell in header.get("X0", []) if cell]
    for starts in (begins, stated):
        if starts and (max(starts) - min(starts)) * rate > TOGETHER:
            raise InputError(
                "the channels begin at different times",
                where=name,
                got=", ".join(f"{start:g} s" for start in starts[:4]),
                expected="one start for all of a segment",
                advice="export the channels that were started together",
            )


def _rate(header: dict[str, list[str]], times: Any, decimal: str, name: str) -> float:
    """Sampling rate: from the step in the header, else from the time column."""
    steps = [cell.replace(",", ".") for cell in header.get("Delta_X", []) if cell]
    if steps:
        step = float(steps[0])
        if step > 0 and len({float(other) for other in steps}) == 1:
            rate = nice_rate(step, 1e-6)
            if times is not None and np.isfinite(times).all():
                same_rate(rate_of(times, name), rate, len(times), name)
            return rate
        raise InputError(
            "the channels differ in their time step" if len(set(steps)) > 1 else "the time step is not above 0",
            where=name,
            got=", ".join(steps[:4]),
            expected="one Delta_X above 0 for all of a segment",
            advice="export the channels of each sampling rate apart"
            if len(set(steps)) > 1
            else "export the file again",
        )
    if times is None:
        raise InputError(
            "no time step in the header and no time column",
            where=name,
            expected="Delta_X in the header or a column X_Value",
            advice="export the file with one of them",
        )
    return rate_of(times, name)
