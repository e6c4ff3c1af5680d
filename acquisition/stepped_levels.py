"""Stepped sine levels: tables of frequency, force, response and phase, one file for each level or one for all."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatch
from itertools import pairwise
from pathlib import Path
from typing import Literal, cast

import numpy as np
from jaxtyping import Float

from acquisition import units
from acquisition.files import matlab, table
from acquisition.files.layout import Layout
from acquisition.files.scales import phase_scale
from ema.data import SteppedLevel
from ema.data.amplitude import Control
from ema.dof import Dof
from ema.errors import InputError

_COLUMNS = ("frequency", "force", "response", "phase")
_EXAMPLES = {"frequency": "Hz", "force": "N", "response": "m/s^2", "phase": "deg"}
_SAME_LEVEL = 0.02
"""Relative difference of two response-controlled levels below which they repeat one level. Controllers hold amplitudes
within 1 %; twice that keeps levels apart that were meant to be (5 % is the least step in use)."""

Columns = Mapping[str, tuple[Float[np.ndarray, "line"], str]]
"""Values of each column by its title, with the unit that the file states."""


@dataclass(frozen=True)
class LevelLayout:
    """Which columns of a table of levels are what, and in which units where the file does not say it.

    ``frequency``, ``force``, ``response`` and ``phase`` are titles of columns, ``column 2`` (from 0), or in a MATLAB
    file names with ``*`` for the levels (``FRdata.ResponseControl.*.force``). ``harmonics`` are columns with the
    amplitudes of the response at 2, 3, ... times the frequency, in its unit. ``units`` by name of the four.

    Examples
    --------
    >>> LevelLayout(response="acceleration", units={"response": "g"}).response
    'acceleration'
    """

    frequency: str = "frequency"
    force: str = "force"
    response: str = "response"
    phase: str = "phase"
    harmonics: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    control: Control = "none"
    output: str = ""
    input: str = ""


def read_levels(path: str | Path, layout: LevelLayout = LevelLayout(), name: str = "") -> tuple[SteppedLevel, ...]:
    """Read the levels of a stepped sine from a text table (one level) or a MATLAB file (one or many).

    Parameters
    ----------
    name : what the level is called; the name of the file by default.

    Returns
    -------
    tuple of SteppedLevel
        In SI, in the order of the file.

    Raises
    ------
    InputError
        No such column, a unit that nobody states or that is none of the quantity, forces or responses that are not
        positive, frequencies that do not rise, fewer than three lines.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError("there is no such file", where=str(path), expected="a table with the lines of a level")
    title = name or path.name
    if path.suffix.lower() == ".mat":
        levels = list(_of_matlab(path, layout))
    else:
        levels = [("", _of_text(path))]
    return tuple(_level(columns, layout, f"{title}{part}") for part, columns in levels)


def in_order(levels: list[SteppedLevel], where: str) -> tuple[SteppedLevel, ...]:
    """Levels by rising amplitude of what was held.

    Raises
    ------
    InputError
        Two levels that are one, or levels of unlike quantities.
    """
    if len({level.quantity for level in levels}) > 1:
        raise InputError(
            "levels of unlike quantities in one run",
            where=where,
            got=", ".join(sorted({level.quantity for level in levels})),
            advice="put each quantity into a run of its own",
        )
    ordered = sorted(levels, key=height)
    for before, after in pairwise(ordered):
        if height(after) < (1 + _SAME_LEVEL) * height(before):
            raise InputError(
                "two levels of one amplitude in one run",
                where=where,
                got=f"{before.name} and {after.name}, both about {height(after):.4g}",
                advice="put repeated levels, or sweeps up and down, into runs of their own",
            )
    return tuple(ordered)


def height(level: SteppedLevel) -> float:
    """Median of what was held: the force of a force-controlled level, else the response, SI."""
    return float(np.median(level.force if level.control == "force" else np.abs(level.response)))


def _of_text(path: Path) -> Columns:
    from acquisition.files import sniff

    segments = table.parse(table.decode(sniff.whole(path)), Layout(), path.name)
    if len(segments) != 1:
        raise InputError("not one table in the file", where=str(path), got=f"{len(segments)} tables", expected="one")
    segment = segments[0]
    pairs = [units.bracketed(title) for title in segment.titles]
    columns: dict[str, tuple[np.ndarray, str]] = {}
    for index, (title, unit) in enumerate(pairs):
        values = segment.values[:, index], (segment.units[index] if segment.units else unit)
        columns.setdefault(title.strip(), values)
        columns.setdefault(f"column {index}", values)
    return columns


def _of_matlab(path: Path, layout: LevelLayout) -> Iterator[tuple[str, Columns]]:
    """The levels of a MATLAB file by what stands for ``*`` in the names."""
    pool = matlab.variables(path)
    arrays = {name: np.atleast_1d(np.asarray(value)).ravel() for name, value in pool.arrays.items() if name}
    if "*" not in layout.force:
        yield "", {name: (value, pool.label(name)) for name, value in arrays.items()}
        return
    before, _, after = layout.force.partition("*")
    marks = [name[len(before) : len(name) - len(after)] for name in arrays if fnmatch(name, layout.force)]
    if not marks:
        raise InputError("no such arrays in the file", where=str(path), got=layout.force, expected=pool.listing())
    for mark in marks:
        columns = {}
        for column in (*_COLUMNS, *layout.harmonics):
            pattern = getattr(layout, column, column)
            real = pattern.replace("*", mark)
            if real in arrays:
                columns[pattern] = arrays[real], pool.label(real)
        yield f", level {mark}", columns


def _level(columns: Columns, layout: LevelLayout, where: str) -> SteppedLevel:
    got = {name: _column(columns, getattr(layout, name), where) for name in _COLUMNS}
    frequencies = _in_si("frequency", got["frequency"], layout, where)[0]
    force = _in_si("force", got["force"], layout, where)[0]
    amplitude, quantity = _in_si("response", got["response"], layout, where)
    phase = got["phase"][0] * _phase_factor(got["phase"], layout, where)
    harmonics = None
    if layout.harmonics:
        parts = [_column(columns, title, where)[0] for title in layout.harmonics]
        unit = layout.units.get("response") or got["response"][1]
        harmonics = np.stack([units.parse(unit).to_si(part) for part in parts])
    _check(frequencies, force, amplitude, phase, where)
    return SteppedLevel(
        frequencies=frequencies,
        force=force,
        response=amplitude * np.exp(1j * phase),
        quantity=cast(Literal["displacement", "velocity", "acceleration"], quantity),
        control=layout.control,
        output=Dof.parse(layout.output) if layout.output else None,
        input=Dof.parse(layout.input) if layout.input else None,
        harmonics=harmonics,
        name=where,
    )


def _column(columns: Columns, title: str, where: str) -> tuple[np.ndarray, str]:
    known = {name.lower(): name for name in columns}
    if title.lower() not in known:
        raise InputError(
            f"the table of the level has no column {title!r}",
            where=where,
            got=", ".join(name for name in columns if not name.startswith("column ")) or f"{len(columns)} columns",
            advice='say which columns are what: frequency = "...", force = "...", response = "...", phase = "..."',
        )
    return columns[known[title.lower()]]


def _factor(name: str, text: str) -> tuple[float, str] | None:
    """Factor and quantity of a unit; ``None`` where the text is none."""
    if name == "phase":
        scale = phase_scale(text)
        return None if scale is None else (scale.factor, "phase")
    unit = units.known(text)
    return None if unit is None or not unit.stated else (unit.factor, unit.quantity)


def _unit(name: str, stated: str, layout: LevelLayout, where: str) -> str:
    given = layout.units.get(name, "")
    if given and stated and _factor(name, given) != _factor(name, stated) and _factor(name, stated) is not None:
        raise InputError(
            f"the campaign and the table state different units of the {name}",
            where=where,
            got=f"{given} and {stated}",
            advice="take it out of units where the table is right, correct the title where it is wrong",
        )
    text = given or stated
    if not text or text == "unstated":
        raise InputError(
            f"the {name} of the level has no unit",
            where=where,
            advice=f'state it: units = {{ {name} = "{_EXAMPLES[name]}" }}, or in the title of the column',
        )
    return text


def _in_si(
    name: str, column: tuple[np.ndarray, str], layout: LevelLayout, where: str
) -> tuple[Float[np.ndarray, "line"], str]:
    """Values in SI and their quantity."""
    text = _unit(name, column[1], layout, where)
    unit = units.parse(text)
    allowed = {"response": ("displacement", "velocity", "acceleration")}.get(name, (name,))
    if unit.quantity not in allowed:
        raise InputError(
            f"{text!r} is no unit of a {name}",
            where=where,
            got=unit.quantity,
            expected=" or ".join(allowed),
            advice=f"state the right one, such as {_EXAMPLES[name]}",
        )
    return np.asarray(unit.to_si(np.real(column[0])), np.float64), unit.quantity


def _phase_factor(column: tuple[np.ndarray, str], layout: LevelLayout, where: str) -> float:
    text = _unit("phase", column[1], layout, where)
    scale = phase_scale(text)
    if scale is None:
        raise InputError(f"{text!r} is no unit of a phase", where=where, expected="deg or rad")
    return scale.factor


def _check(frequencies: np.ndarray, force: np.ndarray, amplitude: np.ndarray, phase: np.ndarray, where: str) -> None:
    if len(frequencies) < 3:
        raise InputError("too few lines in a level", where=where, got=len(frequencies), expected="3 or more")
    if not all(np.all(np.isfinite(values)) for values in (frequencies, force, amplitude, phase)):
        raise InputError("values that are no numbers", where=where, advice="remove the lines that were not measured")
    if np.any(np.diff(frequencies) <= 0):
        raise InputError(
            "frequencies that do not rise",
            where=where,
            advice="put sweeps up and down into files of their own, sorted by frequency",
        )
    if np.any(force <= 0) or np.any(amplitude <= 0):
        raise InputError("an amplitude that is not positive", where=where, expected="amplitudes above 0")
