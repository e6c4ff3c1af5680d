"""Read a text table: its blocks arranged by the layout, or by their titles where these leave no doubt."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files import sniff
from acquisition.files.array_contents import contents_of
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.files.signals import same_rate
from acquisition.files.table import announced
from acquisition.files.table.blocks import parse
from acquisition.files.table.segment import Segment
from acquisition.files.table.time_stamps import in_seconds
from acquisition.files.table.titles import by_titles, distinct, metadata, name_and_unit
from ema.data import Finding
from ema.errors import InputError


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

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        Which column is what where the titles do not say; ``delimiter`` and ``decimal`` of the numbers; ``salvage``:
        read an interrupted table up to its end.

    Returns
    -------
    Contents
        Everything that the segments hold, in SI where units are stated.

    Raises
    ------
    InputError
        There are no numbers in it, or neither titles nor layout say which column is what.
    """
    text = decode(sniff.whole(path))
    if text.count(":") >= text.count("\n"):  # a time of day has two, and most rows have one
        text = "\n".join(in_seconds(text.splitlines(), path.name))
    segments = parse(text, layout, path.name)
    parts = [
        segment_contents(segment, layout, _name(path, number, len(segments))) for number, segment in enumerate(segments)
    ]
    return merge(parts)


def _name(path: Path, number: int, count: int) -> str:
    return path.name if count == 1 else f"{path.name}, segment {number + 1}"


def merge(parts: list[Contents]) -> Contents:
    """Join the contents of several segments.

    Parameters
    ----------
    parts : list of Contents
        Contents in the order of the file.

    Returns
    -------
    Contents
        All recordings, FRFs, modes and findings in this order; the first geometry; metadata and units without repeats.

    Examples
    --------
    >>> from ema.examples import frf_set, recording
    >>> both = merge([Contents(frfs=(frf_set(),)), Contents(recordings=(recording(),))])
    >>> len(both.frfs), len(both.recordings)
    (1, 1)
    """
    return Contents(
        recordings=tuple(r for part in parts for r in part.recordings),
        frfs=tuple(f for part in parts for f in part.frfs),
        modes=tuple(m for part in parts for m in part.modes),
        geometry=next((part.geometry for part in parts if part.geometry is not None), None),
        findings=tuple(f for part in parts for f in part.findings),
        metadata=tuple(dict.fromkeys(m for part in parts for m in part.metadata)),
        units=tuple(dict.fromkeys(u for part in parts for u in part.units)),
        frf_units=tuple(dict.fromkeys(u for part in parts for u in part.frf_units)),
    )


def segment_contents(segment: Segment, layout: Layout, where: str) -> Contents:
    """One segment arranged by the user's layout, or by its titles where these leave no doubt."""
    if segment.labels:
        named = {label: row[np.isfinite(row)] for label, row in zip(segment.labels, segment.values, strict=True)}
        contents = contents_of(Arrays(where, named), layout)
        return replace(contents, findings=(*segment.notes, *contents.findings))
    pairs = [name_and_unit(title) for title in segment.titles]
    texts = segment.units or [unit for _, unit in pairs]
    names = distinct([name for name, _ in pairs])
    unknown = {n: text for n, text in zip(names, texts, strict=True) if text and units.known(text) is None}
    arrays = {"": segment.values}
    known: dict[str, str] = {}
    labels: dict[str, str] = {}
    headings: dict[str, str] = {}
    for place, (name, text) in enumerate(zip(names, texts, strict=True)):
        column = segment.values[:, place]
        real = np.iscomplexobj(column) and not np.any(column.imag)  # beside a column of complex numbers
        if np.iscomplexobj(column) and not real:
            _check_complex(column, segment.titles[place], where)
        for key in (name, segment.titles[place], f"column {place}"):
            if real or key == name or key == segment.titles[place]:
                arrays.setdefault(key, column.real if real else column)
            labels.setdefault(key, text)
            headings.setdefault(key, f"{segment.titles[place]} {text if segment.units else ''}".strip())
            if text and text not in unknown.values():
                known.setdefault(key, text)
    pool = Arrays(
        where, arrays, units=known, titles=names, metadata=metadata(segment.header), labels=labels, headings=headings
    )
    open_question = not layout.kind or (layout.kind == "signals" and layout.signals is None and layout.time is None)
    stated_by_titles = (
        by_titles(names, layout, where, dict(zip(names, texts, strict=True))) if open_question else layout
    )
    chosen = replace(stated_by_titles, axis="columns")
    clock = announced.rate(segment.header, segment.decimal)
    if clock is not None and chosen.sampling_rate is None and chosen.kind in ("", "signals"):
        rounded = clock.rounding > 0 and chosen.time is not None  # then the time axis knows better
        chosen = replace(chosen, sampling_rate=None if rounded else clock.rate)
    if chosen.kind == "signals" and layout.signals is None:
        of_time = (chosen.time, name_and_unit(chosen.time or "")[0])
        listed = [
            name
            for place, name in enumerate(names)
            if name not in of_time and segment.titles[place] not in of_time and chosen.time != f"column {place}"
        ]
        chosen = replace(chosen, signals=[name for name in listed if not _counts(name, pool)] or listed)
    contents = contents_of(pool, chosen)
    contents = replace(
        contents, findings=(*contents.findings, *_reconciled(segment, contents, layout, where, chosen.time is not None))
    )
    stated = layout.units is not None or layout.unit is not None
    polar = (chosen.amplitude, chosen.phase)
    notes = [] if stated else [_unknown_unit(where, n, text) for n, text in unknown.items() if n not in polar]
    return replace(contents, findings=(*segment.notes, *contents.findings, *notes))


FEW_COMPLEX = 0.1
"""Share of the numbers other than 0 of a column below which complex ones are damage: writers of complex numbers write
all of them so, and those of an FRF have an imaginary part."""


def _check_complex(column: np.ndarray, title: str, where: str) -> None:
    """Refuse a few complex numbers in a column of real ones.

    Raises
    ------
    InputError : there are some.
    """
    there, odd = np.count_nonzero(np.abs(column) > 0), np.flatnonzero(column.imag)
    if len(odd) < FEW_COMPLEX * there:
        raise InputError(
            "complex numbers in a column of real ones",
            where=f"{where}, {title}",
            got=f"{len(odd)} of {there}, the first in row {odd[0] + 1}: {column[odd[0]]:.6g}",
            advice="they are damaged; export the file again",
        )


def _reconciled(segment: Segment, contents: Contents, layout: Layout, where: str, timed: bool) -> tuple[Finding, ...]:
    """Compare the rows, rate and interval that a header announces with those of a record, ``timed`` by a time axis.

    Raises
    ------
    InputError : they differ; of rows, where salvage was not asked for.
    """
    if not contents.recordings:
        return ()
    (record,), samples = contents.recordings, len(segment.values)
    stated = announced.contradiction(segment.header, record.sampling_rate, segment.decimal)
    notes: tuple[Finding, ...] = ()
    if stated is not None and timed:
        same_rate(record.sampling_rate, stated, samples, where)
    elif stated is not None:
        message = f"the header says {stated:g} Hz, the layout {record.sampling_rate:g} Hz; the layout is taken."
        advice = "Make sure that the one that is taken is right."
        notes = (Finding("warning", "rate-overruled", where, message, advice=advice),)
    count = announced.rows(segment.header)
    # a length may be one in seconds
    if count is None or count == samples or abs(count * record.sampling_rate / samples - 1) < 0.01:
        return notes
    lost = differs(
        "another number of rows than the header announces",
        where=where,
        layout=layout,
        got=samples,
        expected=count,
        recovered=f"the {samples} rows are read",
    )
    return (*notes, *lost)


_COUNTERS = ("sample", "samples", "no", "no.", "nr", "nr.", "index", "#", "count", "scan", "record", "number")


def _counts(name: str, pool: Arrays) -> bool:
    """Whether a column only numbers its rows."""
    values = np.asarray(pool[name])
    return name.lower() in _COUNTERS and values.dtype.kind == "f" and bool((np.diff(values) == 1).all())


def _unknown_unit(where: str, name: str, text: str) -> Finding:
    return Finding(
        "warning",
        "unknown-unit",
        f"{where}, {name}",
        f"{text!r} is not a unit; the numbers are taken without one.",
        advice="Say the unit in the channel table.",
    )
