"""Text tables: CSV, TXT, TSV, with decimal point or comma, several header lines and several segments."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files import sniff
from acquisition.files.arrange import arrange
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout
from ema.data import Finding
from ema.errors import InputError

_MOST = 4096
"""Lines that are read at once."""

_TITLES = {
    "time": ("t", "time", "zeit", "x_value", "timestamp"),
    "frequency": ("f", "freq", "frequency", "frequenz"),
    "real": ("re", "real", "real part", "realteil"),
    "imaginary": ("im", "imag", "imaginary", "imaginary part", "imaginärteil"),
    "amplitude": ("amplitude", "magnitude", "mag", "betrag"),
    "phase": ("phase", "angle"),
    "coherence": ("coherence", "kohärenz", "coh"),
    "node": ("node", "point", "nr", "id", "knoten"),
    "x": ("x",),
    "y": ("y",),
    "z": ("z",),
}


@dataclass(frozen=True)
class Segment:
    """A block of rows with equally many columns, and the lines of text above it."""

    header: tuple[str, ...]
    values: Any
    titles: tuple[str, ...]
    labels: tuple[str, ...] = ()
    """Names of the rows, where every row begins with one."""


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
    place, many = 0, _MOST
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
            segments.append(_segment(header, rows, labels, delimiter))
            header, rows, labels, many = [], [], [], _MOST
        if cells is not None:
            rows.append(np.array([cells]))
            labels += [label] if label else []
        else:
            header.append(line)
        place += 1
    if rows:
        segments.append(_segment(header, rows, labels, delimiter))
    longest = max((len(segment.values) for segment in segments), default=0)
    segments = [segment for segment in segments if len(segment.values) > 1 or longest == 1]
    if not segments:
        raise InputError("no table of numbers in the file", where=where, got=repr(text[:40]))
    return segments


def _block(lines: list[str], delimiter: str, decimal: str, columns: int) -> Any:
    """Lines of ``columns`` plain numbers each, all at once; ``None`` where one of them is anything else."""
    if delimiter == " ":
        alike = all(len(line.split()) == columns for line in lines)
    else:
        alike = all(line.count(delimiter) == columns - 1 for line in lines)
    text = delimiter.join(lines)
    if not alike or (decimal == "," and "." in text):
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
    if not full.all() and not labels:
        values, titles = values[:, full], tuple(t for t, keep in zip(titles, full, strict=True) if keep)
    return Segment(tuple(header), values, titles, tuple(labels))


def _number(cell: str) -> complex:
    """A real or complex number; an empty cell is NaN."""
    try:
        return float(cell)
    except ValueError:
        cell = cell.strip().strip('"')
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
            if all(units.known(cell.strip("[]() ")) for cell in cells if cell) and len(header) > 1:
                continue  # a line of units; the names are above it
            return tuple(cell.lstrip("# ") or f"column {place}" for place, cell in enumerate(cells))
    return tuple(f"column {place}" for place in range(columns))


def _unit_row(header: tuple[str, ...], columns: int, delimiters: str = "\t;,") -> list[str]:
    """Units from a header line that holds nothing but units."""
    for line in reversed(header[-4:]):
        for delimiter in delimiters:
            cells = [cell.strip().strip('"[]() ') for cell in line.split(delimiter)]
            if len(cells) >= columns > 1 and all(cell and units.known(cell) for cell in cells[:columns]):
                return cells[:columns]
    return []


def arranged(segment: Segment, layout: Layout, where: str) -> Contents:
    """One segment arranged by the user's layout, or by its titles where these leave no doubt."""
    if segment.labels:
        named = {label: row[np.isfinite(row)] for label, row in zip(segment.labels, segment.values, strict=True)}
        return arrange(Arrays(where, named), layout)
    pairs = [units.bracketed(title) for title in segment.titles]
    row = _unit_row(segment.header, len(pairs))
    texts = row or [unit for _, unit in pairs]
    names = [name for name, _ in pairs]
    known = {n: text for n, text in zip(names, texts, strict=True) if text and units.known(text) is not None}
    unknown = {name: text for name, text in zip(names, texts, strict=True) if text and name not in known}
    arrays = {"": segment.values}
    for place, name in enumerate(names):
        arrays.setdefault(name, segment.values[:, place])
        arrays.setdefault(segment.titles[place], segment.values[:, place])
        if name in known:
            known.setdefault(segment.titles[place], known[name])
    pool = Arrays(where, arrays, "", known, names, _metadata(segment.header))
    contents = arrange(pool, replace(layout, axis="columns") if layout.kind else _by_titles(names, layout))
    stated = layout.units is not None or layout.unit is not None
    notes = () if stated else tuple(_unknown_unit(where, name, text) for name, text in unknown.items())
    return replace(contents, findings=contents.findings + notes)


def _unknown_unit(where: str, name: str, text: str) -> Finding:
    return Finding(
        "warning", "unknown-unit", f"{where}, {name}", f"{text!r} is not a unit; the numbers are taken without one.",
        advice="Say the unit in the channel table.",
    )  # fmt: skip


def _by_titles(names: list[str], layout: Layout) -> Layout:
    """The layout that the titles tell: time and signals, frequency and FRF, or coordinates."""
    places = {role: n for role, words in _TITLES.items() for n in names if n.lower() in words}
    if "time" in places:
        others = [name for name in names if name != places["time"]]
        return replace(layout, time=places["time"], signals=others)
    if "frequency" in places and ({"real", "imaginary"} <= places.keys() or {"amplitude", "phase"} <= places.keys()):
        roles = ("real", "imaginary") if "real" in places else ("amplitude", "phase")
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
