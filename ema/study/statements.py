"""Statements of a publication, held against maps and runs: what was found, and a verdict."""

from collections.abc import Mapping

import numpy as np

from ema.data import MapResult, RunResult, Statement
from ema.errors import InputError
from ema.study.recipe import StatementTable

_EXACT = 1e-9


def judge(
    tables: list[StatementTable], maps: tuple[MapResult, ...], runs: tuple[RunResult, ...]
) -> tuple[Statement, ...]:
    """A verdict on every statement: matched where the value lies within its bounds.

    Raises
    ------
    InputError : a statement is about a map, run or point that the study does not have.
    """
    charts, results = {one.name: one for one in maps}, {one.run.id: one for one in runs}
    judged = []
    for table in tables:
        found = _of_map(table, charts) if table.map else _of_run(table, results)
        inside = table.low <= found <= table.high
        matched = "matched with an implausible parameter" if table.implausible else "matched"
        reason = " ".join(part for part in (table.implausible if inside else "", table.reason) if part)
        judged.append(Statement(
            table.text, table.source, _quantity(table), table.low, table.high, found,
            matched if inside else "not matched", table.verdict, reason,  # type: ignore[arg-type]
        ))  # fmt: skip
    return tuple(judged)


def _of_map(table: StatementTable, charts: Mapping[str, MapResult]) -> float:
    chart = _named(charts, table.map, "map").chart
    damping, frequency = 100 * np.asarray(chart.damping), np.asarray(chart.frequency)
    forces, levels = np.asarray(chart.normal_forces), np.asarray(chart.force_levels)
    row = None if table.level is None else int(np.abs(levels - table.level).argmin())
    column = None if table.force is None else int(np.abs(forces - table.force).argmin())
    low, high = table.forces or (-np.inf, np.inf)
    chosen = (forces >= low - _EXACT) & (forces <= high + _EXACT)
    if not chosen.any():
        raise InputError("no normal force of the map in this range", where=f"[[statements]] {table.text}",
                         got=f"{low:g} to {high:g} N", expected=", ".join(f"{one:g}" for one in forces))  # fmt: skip
    rows = slice(None) if row is None else slice(row, row + 1)
    part = damping[rows][:, chosen]
    match table.quantity:
        case "damping" | "frequency":
            values = damping if table.quantity == "damping" else frequency
            return float(values[_point(row, table), _point(column, table)])
        case "highest damping":
            return float(np.nanmax(part))
        case "best normal force":
            return float(forces[chosen][int(np.nanargmax(np.nanmax(part, axis=0)))])
        case "best force level":
            return float(levels[int(np.nanargmax(damping[:, _point(column, table)]))])
        case "damping over the highest":
            over = damping[:, _point(column, table)]
            return float(over[_point(row, table)] / np.nanmax(over))
        case "fall of frequency":
            return float(np.nanmax([_fall(line) for line in frequency[rows][:, chosen]]))
        case "effect of the level":
            return float(np.nanmax(np.ptp(damping[:, chosen], axis=0) / np.nanmean(damping[:, chosen], axis=0)))
        case "ridge rises":
            ridge = [forces[chosen][int(np.nanargmax(line))] for line in damping[:, chosen]]
            return float(np.mean(np.diff(ridge) >= 0))
        case "normal force over that of map":
            other = _named(charts, table.other, "map").chart
            best = [
                float(one.normal_forces[int(np.nanargmax(np.nanmax(one.damping, axis=0)))]) for one in (chart, other)
            ]
            return best[0] / best[1]
    raise InputError("this quantity is about a run", where=f"[[statements]] {table.text}", got=table.quantity,
                     expected="a quantity of a map", advice="name a run instead of a map")  # fmt: skip


def _fall(values: np.ndarray) -> float:
    """The largest fall along the values: from any of them to a later one."""
    return float(np.nanmax(np.maximum.accumulate(values) - values))


def _point(place: int | None, table: StatementTable) -> int:
    if place is None:
        raise InputError("the statement does not say where", where=f"[[statements]] {table.text}",
                         got=table.quantity, expected="level and force in N")  # fmt: skip
    return place


def _of_run(table: StatementTable, results: Mapping[str, RunResult]) -> float:
    from ema.fit import local_fit

    assert table.near is not None
    found = local_fit(_named(results, table.run, "run").frfs, table.near)
    match table.quantity:
        case "run frequency":
            return found.natural_frequency
        case "run damping":
            return 100 * found.damping_ratio
        case "run misfit":
            return found.residual
        case "run damping over run":
            other = local_fit(_named(results, table.other, "run").frfs, table.near)
            return found.damping_ratio / other.damping_ratio
    raise InputError("this quantity is about a map", where=f"[[statements]] {table.text}", got=table.quantity,
                     expected="a quantity of a run", advice="name a map instead of a run")  # fmt: skip


def _named(known: Mapping[str, "MapResult"] | Mapping[str, "RunResult"], name: str, what: str):  # type: ignore[no-untyped-def]
    if name not in known:
        raise InputError(f"a statement is about a {what} that is not in the study", where="[[statements]]",
                         got=name or "none", expected="one of " + ", ".join(known))  # fmt: skip
    return known[name]


def _quantity(table: StatementTable) -> str:
    """What was looked at, in words."""
    parts: list[str] = [table.quantity]
    if table.run:
        parts.append(f"{table.run}, near {table.near:g} Hz")
    if table.map:
        parts.append(table.map)
    if table.other:
        parts.append(f"over {table.other}" if "over" in table.quantity else table.other)
    parts += [f"F_E {table.level:g} N"] if table.level is not None else []
    parts += [f"F_N {table.force:g} N"] if table.force is not None else []
    parts += [f"F_N {table.forces[0]:g} to {table.forces[1]:g} N"] if table.forces is not None else []
    return ", ".join(parts)
