"""The ``[geometry]`` of a proposed campaign: which file holds the positions, in which unit, and what looks wrong."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.columns import column, numbers, read_columns
from acquisition.quantities import measure
from ema.data import Finding, Geometry
from ema.errors import EmaError, InputError
from ema.proposal import positions
from ema.proposal.examination import FileFacts
from ema.proposal.questions import Answers, Question
from ema.proposal.units import quantity_of
from ema.units import UNSTATED

_TABLES = (".csv", ".txt", ".tsv")


@dataclass(frozen=True)
class Chosen:
    """The file with the positions, and the columns where it is a table that does not describe itself."""

    facts: FileFacts
    columns: tuple[str, str, str] | None = None


def count(facts: Sequence[FileFacts]) -> int:
    """How many files hold positions."""
    return sum(one.geometry is not None or one.kind == "positions" for one in facts)


def candidate(facts: Sequence[FileFacts]) -> Chosen | None:
    """The one file with positions; none where several files have some."""
    if count(facts) != 1:
        return None
    file = next(each for each in facts if each.geometry is not None or each.kind == "positions")
    # of several triples of columns the first is that of the points, as in xHammer ... xAccel
    return Chosen(file) if file.geometry is not None else Chosen(file, next(iter(file.positions.values())))


@dataclass(frozen=True)
class Points:
    """What the positions say: the nodes (``None`` without positions), and the node of a sensor that stayed."""

    nodes: frozenset[int] | None = None
    sensor: int | None = None


def points_of(chosen: Chosen | None, folder: Path) -> Points:
    """The nodes of a geometry, and the point at which a table has its only other position."""
    if chosen is None:
        return Points()
    path = folder / chosen.facts.path
    geometry = chosen.facts.geometry
    if chosen.columns is not None:
        geometry = _read(path, chosen.columns, _names_in(path, chosen.columns))
    if geometry is None:
        return Points()
    nodes = frozenset(geometry.nodes.tolist())
    if chosen.columns is None or len(chosen.facts.positions) < 2:
        return Points(nodes)
    names = list(chosen.facts.positions.values())[1]
    sensors = _read(path, names, _names_in(path, names))
    if sensors is None or len(sensors.nodes) != 1:
        return Points(nodes)
    away = np.linalg.norm(geometry.xyz - sensors.xyz[0], axis=1)
    near = away.min() <= 1e-3 * np.ptp(geometry.xyz)
    return Points(nodes, int(geometry.nodes[np.argmin(away)]) if near else None)


def table_of(
    chosen: Chosen | None, folder: Path, answers: Answers, findings: list[Finding]
) -> tuple[dict[str, Any], dict[str, str], Geometry | None]:
    """The table, its comments, and the geometry in m; a comment alone where the unit is not known."""
    if chosen is None:
        return {}, {}, None
    path = chosen.facts.path
    geometry = chosen.facts.geometry
    table: dict[str, Any] = {"file": path}
    if chosen.columns is not None:
        rows = _names_in(folder / path, chosen.columns)
        table |= {"names_in": rows} if rows == "first column" else {}
        table |= dict(zip(("x", "y", "z"), chosen.columns, strict=True))
        geometry = _read(folder / path, chosen.columns, rows)
    if geometry is None:
        return {}, {}, None
    unit, comments = chosen.facts.length_unit, {}
    is_table = Path(path).suffix.lower() in _TABLES
    if chosen.facts.length_unit == UNSTATED:
        extent = float(np.ptp(geometry.xyz, axis=0).max()) if len(geometry.nodes) else 0.0
        likely = "m" if extent <= positions.LARGEST else "mm"
        unit = answers.ask(
            Question(
                "coordinates",
                f"In which unit are the coordinates in {path}? They extend over {extent:.4g}.",
                likely,
                evidence="structures that are struck with a hammer are between 5 mm and 30 m",
            )
        )
        if quantity_of(unit) != "displacement":
            raise InputError("not a unit of length", where="coordinates", got=unit, expected="m, mm, in")
        if not answers.known("coordinates"):
            comments["unit" if is_table or chosen.columns else "reader"] = "TODO: nobody stated it"
        if is_table or chosen.columns:
            table["unit"] = unit
        else:
            table["reader"] = {**chosen.facts.reader, "unit": unit}
    if chosen.facts.kind == "named points":
        by_number = {str(node): row for node, row in zip(geometry.nodes, geometry.xyz.tolist(), strict=True)}
        table = {"unit": unit, "nodes": by_number}
        comments["nodes"] = f"by the numbers in the names of {path}"
    factor = measure(f"1 {unit}")[0]
    geometry = Geometry(geometry.nodes, factor * geometry.xyz, geometry.lines, geometry.faces, geometry.axes)
    findings += positions.findings(geometry, path, unit)
    return table, comments, geometry


def _names_in(path: Path, names: tuple[str, str, str]) -> str:
    """Whether the columns or the rows of a table have the names."""
    try:
        return "first row" if set(names) <= read_columns(path).keys() else "first column"
    except EmaError:
        return "first column"


def _read(path: Path, names: tuple[str, str, str], names_in: str) -> Geometry | None:
    """The positions as numbers; nodes 1, 2, ... in the order of the file."""
    try:
        columns: Mapping[str, list[str]] = read_columns(path, names_in)
        xyz = np.column_stack([numbers(column(dict(columns), name, str(path)), str(path)) for name in names])
    except EmaError:
        return None
    kept = np.isfinite(xyz).all(axis=1)
    return Geometry(np.arange(1, len(xyz) + 1)[kept], xyz[kept])
