"""What the lines above a table say of its columns: titles and units, and what they mean; metadata."""

import csv
import re
from dataclasses import replace
from typing import Any

from acquisition import units
from acquisition.files.layout import Layout
from acquisition.files.scales import bare_title, is_unit, without_accents
from ema.errors import InputError

TITLES = {
    "time": ("t", "time", "zeit", "temps", "tempo", "tiempo", "x_value", "timestamp"),
    "frequency": ("f", "freq", "frequency", "frequenz", "frequence", "frequenza", "frecuencia"),
    "real": ("re", "real", "real part", "realteil", "partie reelle", "parte reale", "parte real"),
    "imaginary": (
        "im",
        "imag",
        "imaginary",
        "imaginary part",
        "imaginarteil",
        "partie imaginaire",
        "parte immaginaria",
        "parte imaginaria",
    ),
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
        "module",
        "modulo",
        "ampiezza",
        "amplitud",
        "log mag",
        "log magnitude",
        "logmag",
    ),
    "phase": ("phase", "phase angle", "phs", "ph", "angle", "argument", "arg", "phasenwinkel", "winkel", "fase"),
    "coherence": ("coherence", "koharenz", "coerenza", "coherencia", "coh"),
    "node": ("node", "point", "nr", "id", "knoten", "nodo", "noeud", "nœud"),
    "x": ("x",),
    "y": ("y",),
    "z": ("z",),
}
"""What a column may be by its title in English, German, French, Italian or Spanish, without accents."""
_OTHER_DELIMITERS = (";", "\t", ",", r"\s+/\s+", r"\s{2,}")
"""What parts the titles of a table whose rows are parted by something else."""
_REMARK = "#%! "
"""Marks of a remark in front of the titles."""
_SINGLE_CAPITAL = re.compile(r"[A-Z]")
"""A letter behind a word, which may be a unit or a name: ``Level A``."""


def roles(title: str) -> list[str]:
    """What the column of a title may be."""
    plain = without_accents(re.sub(r" #\d+$", "", title))
    return [role for role, words in TITLES.items() if plain.lower() in words or bare_title(plain) in words]


def name_and_unit(title: str) -> tuple[str, str]:
    """Name and unit of a title: ``force [N]``, ``a / g``; ``Freq. Hz`` too, where the name says what the column is."""
    name, unit = units.bracketed(title)
    words = title.split(maxsplit=1)
    if unit or len(words) < 2 or not roles(words[0]) or _SINGLE_CAPITAL.fullmatch(words[1]):
        return name, unit
    return (words[0], words[1]) if units.known(words[1]) is not None else (name, unit)


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
            return tuple(cell.lstrip(_REMARK) or f"column {place}" for place, cell in enumerate(cells))
    for line in reversed(header[-6:]):
        for mark in _OTHER_DELIMITERS:
            cells = [cell.strip() for cell in re.split(mark, line.strip(_REMARK))]
            if len(cells) == columns > 1 and all(roles(name_and_unit(cell)[0]) for cell in cells):
                return tuple(cells)
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


def by_titles(names: list[str], layout: Layout, where: str, labels: dict[str, str]) -> Layout:
    """The layout that the titles state: time and signals, frequency and FRF, or coordinates.

    Parameters
    ----------
    labels : what stands where the unit of a column belongs; beside both parts of an FRF, Hz marks the frequency.

    Raises
    ------
    InputError : two columns could be the same part of an FRF.
    """
    places: dict[str, str] = {}
    twice: dict[str, list[str]] = {}
    fitting = {name: roles(name) for name in names}
    for role in TITLES:
        there = [name for name in names if role in fitting[name]]
        if there:
            places[role] = there[0]
        if len(there) > 1:
            twice[role] = there
    has_parts = {"real", "imaginary"} <= places.keys() or {"amplitude", "phase"} <= places.keys()
    in_hertz = [name for name in names if not fitting[name] and labels.get(name, "").lower() in ("hz", "khz")]
    if has_parts and not {"time", "frequency"} & places.keys() and len(in_hertz) == 1:
        places["frequency"] = in_hertz[0]
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
    if "frequency" in places and has_parts:
        parts = ("real", "imaginary") if {"real", "imaginary"} <= places.keys() else ("amplitude", "phase")
        for role in ("frequency", *parts):
            if role in twice:
                raise InputError(
                    f"several columns could be the {role}",
                    where=where,
                    got=", ".join(twice[role]),
                    advice=f"say {role}='column 1' or the like, and so the other parts of the FRF",
                )
        return _with(layout, places, "frequency", "coherence", *parts)
    if {"x", "y", "z"} <= places.keys():
        return _with(layout, places, "x", "y", "z", "node")
    return layout


def _with(layout: Layout, places: dict[str, str], *wanted: str) -> Layout:
    chosen: dict[str, Any] = {role: places[role] for role in wanted if role in places}
    return replace(layout, **chosen)


def metadata(header: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Header lines of the form ``name: text``, ``name = text`` or ``name<tab>text``."""
    found = []
    for line in header:
        match = re.match(r"^\W*([\w .()/-]{2,40}?)\s*[:=\t]\s*(\S.*?)\s*$", line)
        if match:
            found.append((match[1], match[2]))
    return tuple(found[:50])
