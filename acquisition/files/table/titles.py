"""What the lines above a table say of its columns: titles and units, and what they mean; metadata."""

import csv
import re
from dataclasses import replace
from typing import Any

from acquisition.files.layout import Layout
from acquisition.files.scales import bare_title, is_unit
from ema.errors import InputError

TITLES = {
    "time": ("t", "time", "zeit", "x_value", "timestamp"),
    "frequency": ("f", "freq", "frequency", "frequenz"),
    "real": ("re", "real", "real part", "realteil"),
    "imaginary": ("im", "imag", "imaginary", "imaginary part", "imaginärteil"),
    "amplitude": (
        "amplitude",
        "magnitude",
        "mag",
        "modulus",
        "abs",
        "level",
        "gain",
        "betrag",
        "pegel",
        "log mag",
        "log magnitude",
        "logmag",
    ),
    "phase": ("phase", "phase angle", "angle", "argument", "arg", "phasenwinkel", "winkel"),
    "coherence": ("coherence", "kohärenz", "coh"),
    "node": ("node", "point", "nr", "id", "knoten"),
    "x": ("x",),
    "y": ("y",),
    "z": ("z",),
}


def titles(header: list[str], delimiter: str, columns: int) -> tuple[str, ...]:
    """Titles of the columns: the nearest line above that has one for each."""
    for line in reversed(header[-6:]):
        if not line.strip() or re.match(r"^\s*\*\*\*", line):
            continue
        cells = _texts(line, delimiter)
        while len(cells) > columns and not cells[-1]:
            cells.pop()
        if len(cells) == columns and sum(bool(cell) for cell in cells) >= max(1, columns - 1):
            if all(map(is_unit, cells)) and len(header) > 1:
                continue  # a line of units; the names are above it
            return tuple(cell.lstrip("# ") or f"column {place}" for place, cell in enumerate(cells))
    return tuple(f"column {place}" for place in range(columns))


def unit_row(header: list[str], columns: int, delimiter: str) -> list[str]:
    """Units from a header line that holds nothing but units."""
    for line in reversed(header[-4:]):
        cells = [_unbracketed(cell) for cell in _texts(line, delimiter)]
        if len(cells) >= columns > 1 and all(cell and is_unit(cell) for cell in cells[:columns]):
            return cells[:columns]
    return []


def _texts(line: str, delimiter: str) -> list[str]:
    """The cells of a line of texts; within quotation marks the delimiter is a character like any other."""
    if delimiter == " ":
        return [cell.strip('"') for cell in line.split()]
    cells = line.split(delimiter)
    if any(cell.count('"') % 2 for cell in cells):
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return [cell.strip().strip('"') for cell in cells]


def _unbracketed(cell: str) -> str:
    return cell[1:-1].strip() if cell[:1] + cell[-1:] in ("[]", "()") else cell


def distinct(names: list[str]) -> list[str]:
    """The names, a second column of one name called ``name #2``."""
    seen: dict[str, int] = {}
    distinct = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        distinct.append(name if seen[name] == 1 else f"{name} #{seen[name]}")
    return distinct


def by_titles(names: list[str], layout: Layout, where: str) -> Layout:
    """The layout that the titles state: time and signals, frequency and FRF, or coordinates.

    Raises
    ------
    InputError : two columns could be the same part of an FRF.
    """
    places: dict[str, str] = {}
    twice: dict[str, list[str]] = {}
    for role, words in TITLES.items():
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


def metadata(header: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Header lines of the form ``name: text``, ``name = text`` or ``name<tab>text``."""
    found = []
    for line in header:
        match = re.match(r"^\W*([\w .()/-]{2,40}?)\s*[:=\t]\s*(\S.*?)\s*$", line)
        if match:
            found.append((match[1], match[2]))
    return tuple(found[:50])
