"""Statements of a publication and readings of ours, judged by maps and runs: value, interval and verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ema.compare import map_features as features
from ema.compare.map_features import Line, Measure
from ema.data import Campaign, MapResult, ModalMap, RunResult, SingleMode, Statement
from ema.data.results import Verdict
from ema.errors import InputError
from ema.study import model_releases, releases
from ema.study.model_releases import ModelRelease
from ema.study.recipe import RELEASE_QUANTITIES, StatementTable

_STRICT = ("rise", "fall", "peak of", "dip", "ridge over", "damping over")
"""Quantities of which no change is not enough: what stays constant neither rises nor falls."""

NEAR = 0.05
"""Largest relative distance of a mode from the frequency near which a statement names it: as far as a fit of one mode
takes a peak (:func:`ema.fit.local_fit`)."""


def judge(
    tables: list[StatementTable],
    maps: tuple[MapResult, ...],
    runs: tuple[RunResult, ...],
    assumed: str = "",
    *,
    campaign: Campaign | None = None,
    released: Mapping[str, ModelRelease] | None = None,
) -> tuple[Statement, ...]:
    """A verdict on every statement, by the interval of its value and the bounds with which it holds.

    ``assumed`` is what the campaign assumes: statements that name nothing else are matched with that only. Statements
    about releases are judged by the records of ``campaign``, those about releases of a model by ``released``.

    Raises
    ------
    InputError : a statement is about a map or run that the study does not have, or does not say where.
    """
    charts, results = {one.name: one for one in maps}, {one.run.id: one for one in runs}
    fitted = any(_nonlinear(results[name]) for one in tables for name in (one.run, one.other) if name in results)
    judged = []
    for table in tables:
        accepted, strict = False, (table.quantity or "").startswith(_STRICT)
        if table.quantity is None:
            measures = [features.missing(table.missing)]
        elif table.release:
            measures = [model_releases.measured(table, released or {})]
        elif table.quantity in RELEASE_QUANTITIES and campaign is not None:
            measures = [releases.measured(table, campaign)]
        elif table.map:
            measures = _of_map(table, charts)
        else:
            measure, accepted = _of_run(table, results, fitted=fitted)
            measures = [measure]
        verdict: Verdict
        verdict, measure = features.decide(measures, table.low, table.high, strict)
        why = ""
        if verdict == "matched":
            verdict, why = _with(table, assumed)
        missing = f"It would take {measure.missing}." if measure.missing else ""
        parts = (why, table.reason, missing)
        judged.append(
            Statement(
                table.text,
                table.source,
                _quantity(table, accepted=accepted),
                table.low,
                table.high,
                measure.value,
                verdict,
                table.verdict,
                " ".join(part for part in parts if part),
                table.sentence,
                measure.lower,
                measure.upper,
            )
        )
    return tuple(judged)


def _with(table: StatementTable, assumed: str) -> tuple[Verdict, str]:
    """What a match rests on: nothing but the measurement, or a parameter that was assumed or that nobody believes."""
    if table.implausible:
        return "matched with an implausible parameter", table.implausible
    if table.assumed or assumed:
        return "matched with an assumed parameter", table.assumed or assumed
    return "matched", ""


@dataclass(frozen=True)
class _Lines:
    """Lines of a map in the ranges of a statement: damping in percent, frequency in Hz."""

    table: StatementTable
    map: ModalMap

    def rows(self, name: str) -> list[Line]:
        """Along the normal force, at the level of the statement or at every one."""
        low, high = self.table.forces or (0.0, np.inf)
        axis, levels = np.asarray(self.map.normal_forces), np.asarray(self.map.force_levels)
        values, std = self._values(name)
        nominal = self.table.level
        chosen = np.ones(len(levels), dtype=bool) if nominal is None else np.isclose(levels, nominal, rtol=1e-6)
        if self.table.levels is not None:
            chosen &= (levels >= self.table.levels[0] * (1 - 1e-9)) & (levels <= self.table.levels[1] * (1 + 1e-9))
        return [features.line(axis, values[row], std[row]).within(low, high) for row in np.flatnonzero(chosen)]

    def columns(self, name: str) -> list[Line]:
        """Along the force level, at the normal force of the statement or at every one in its range."""
        low, high = self.table.levels or (0.0, np.inf)
        axis, forces = np.asarray(self.map.force_levels), np.asarray(self.map.normal_forces)
        values, std = self._values(name)
        first, last = self.table.forces or (0.0, np.inf)
        nominal = self.table.force
        chosen = (forces >= first * (1 - 1e-9)) & (forces <= last * (1 + 1e-9))
        if nominal is not None:
            chosen &= np.isclose(forces, nominal, rtol=1e-6)
        return [features.line(axis, values[:, k], std[:, k]).within(low, high) for k in np.flatnonzero(chosen)]

    def damping_along(self) -> list[tuple[Line, tuple[float, float]]]:
        """The lines of a rise or a fall, and the places on the axis from which to which they are to go."""
        if self.table.force is None:
            lines, axis, part = self.rows("damping"), np.asarray(self.map.normal_forces), self.table.forces
        else:
            lines, axis, part = self.columns("damping"), np.asarray(self.map.force_levels), self.table.levels
        low, high = part or (0.0, np.inf)
        named = axis[(axis >= low * (1 - 1e-9)) & (axis <= high * (1 + 1e-9))]
        ends = (float(named.min()), float(named.max())) if len(named) else (low, high)
        return [(one, ends) for one in lines]

    def best_level(self) -> Measure:
        """The level at which the highest damping of all normal forces in the range lies."""
        rows, levels = self.rows("damping"), np.asarray(self.map.force_levels)
        if len(rows) < len(levels):
            low, high = self.table.levels or (-np.inf, np.inf)
            levels = levels[(levels >= low * (1 - 1e-9)) & (levels <= high * (1 + 1e-9))]
        return features.ridge_of(levels, rows)

    def _values(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        scale = 100.0 if name == "damping" else 1.0
        values = scale * np.asarray(getattr(self.map, name))
        std = getattr(self.map, f"{name}_std")
        return values, np.zeros_like(values) if std is None else scale * np.asarray(std)


def _of_map(table: StatementTable, charts: Mapping[str, MapResult]) -> list[Measure]:
    lines = _Lines(table, _named(charts, table.map, "map").chart)
    match table.quantity:
        case "damping" | "frequency":
            if table.level is None or table.force is None:
                raise InputError(
                    "the statement does not say where",
                    where=f"[[statements]] {table.text}",
                    got=table.quantity,
                    expected="level and force in N",
                )
            return [features.value(one, table.force) for one in lines.rows(table.quantity)]
        case "highest damping":
            return [features.highest(lines.rows("damping"))]
        case "ridge":
            return [features.ridge(one) for one in lines.rows("damping")]
        case "peak level":
            if table.force is None:
                return [lines.best_level()]
            return [features.ridge(one) for one in lines.columns("damping")]
        case "rise of ridge":
            return [features.rise([features.ridge(one) for one in lines.rows("damping")])]
        case "rise of damping" | "fall of damping":
            climb = features.rise if table.quantity.startswith("rise") else features.fall
            return [climb(one) if one.reaches(*ends) else _unmeasured(ends) for one, ends in lines.damping_along()]
        case "peak of damping":
            return [features.peak(one) for one in lines.rows("damping")]
        case "dip of frequency":
            pairs = zip(lines.rows("frequency"), lines.rows("damping"), strict=True)
            return [features.dip(frequency, damping) for frequency, damping in pairs]
        case "ridge over that of map":
            return _ridges_over(table, lines.map, _named(charts, table.other, "map").chart)
        case "spread over levels":
            return [features.spread(one) for one in lines.columns("damping")]
        case "damping over ridge":
            whole = _Lines(table.model_copy(update={"forces": None}), lines.map).rows("damping")
            parts = zip(lines.rows("damping"), whole, strict=True)
            return [features.ratio(features.highest([part]), features.highest([line])) for part, line in parts]
        case "ridge over sticking":
            return [features.ratio(features.ridge(one), features.settled(one)) for one in lines.rows("damping")]
    raise InputError(
        "this quantity is about a run",
        where=f"[[statements]] {table.text}",
        got=table.quantity,
        expected="a quantity of a map",
        advice="name a run instead of a map",
    )


def _unmeasured(ends: tuple[float, float]) -> Measure:
    return features.missing(f"measured points at {ends[0]:g} and {ends[1]:g} N")


def _ridges_over(table: StatementTable, over: ModalMap, under: ModalMap) -> list[Measure]:
    """The ridge of one map over that of another at every level that both have."""
    measures = []
    for level in np.asarray(over.force_levels):
        if table.level is None or np.isclose(level, table.level):
            there = table.model_copy(update={"level": float(level)})
            above, below = (_Lines(there, one).rows("damping") for one in (over, under))
            measures += [features.ratio(features.ridge(a), features.ridge(b)) for a, b in zip(above, below)]
    return measures


def _of_run(table: StatementTable, results: Mapping[str, RunResult], *, fitted: bool) -> tuple[Measure, bool]:
    """The quantity of a statement about a run, and whether it is that of an accepted mode; see :func:`_modes`."""
    result = _named(results, table.run, "run")
    if table.quantity == "run level effect":
        effect = result.level_effect
        if effect is None:
            return features.missing("impacts of different level on the same points"), False
        return Measure(100 * effect.value, 100 * effect.lower, 100 * effect.upper), False
    assert table.near is not None
    try:
        if table.quantity == "run misfit":
            return features.estimate(_linear_fit(result, table.near).residual, 0.0), False
        if table.quantity == "run damping over run":
            pair = (result, _named(results, table.other, "run"))
            mode, other = _modes(pair, table.near, fitted=fitted)
            both = mode.damping / other.damping
            relative = np.hypot(mode.damping_std / mode.damping, other.damping_std / other.damping)
            return features.estimate(both, both * float(relative)), mode.accepted
        (mode,) = _modes((result,), table.near, fitted=fitted)
        if table.quantity == "run frequency":
            return features.estimate(mode.frequency, mode.frequency_std), mode.accepted
        if table.quantity == "run damping":
            return features.estimate(100 * mode.damping, 100 * mode.damping_std), mode.accepted
    except _NoModeError as error:
        return features.missing(str(error)), False
    raise InputError(
        "this quantity is about a map",
        where=f"[[statements]] {table.text}",
        got=table.quantity,
        expected="a quantity of a run",
        advice="name a map instead of a run",
    )


class _NoModeError(Exception):
    """What it would take to read a mode, where there is none."""


class _Mode(NamedTuple):
    """Natural frequency in Hz and damping ratio with their standard deviations; ``accepted`` by the modal analysis, or
    of one linear mode fitted to the FRFs."""

    frequency: float
    frequency_std: float
    damping: float
    damping_std: float
    accepted: bool


def _modes(results: Sequence[RunResult], near: float, *, fitted: bool) -> list[_Mode]:
    """The modes of runs near a frequency in Hz, all read in one way.

    They are the accepted modes, which the report shows; or one linear mode fitted to the FRFs of each where one run has
    no accepted mode there, or where ``fitted`` says that a run beside which they are set is not linear.
    """
    rows = [None if fitted else _accepted(one, near) for one in results]
    read = []
    for result, row in zip(results, rows, strict=True):
        if row is None or None in rows:
            fit = _linear_fit(result, near)
            values = (fit.natural_frequency, fit.natural_frequency_std, fit.damping_ratio, fit.damping_ratio_std)
            read.append(_Mode(*values, accepted=False))
            continue
        modes = result.modes
        assert modes.covariance is not None
        std = np.sqrt(np.maximum(np.diagonal(modes.covariance[row]), 0))
        frequency, damping = float(modes.natural_frequencies[row]), float(modes.damping_ratios[row])
        read.append(_Mode(frequency, float(std[0]), damping, float(std[1]), accepted=True))
    return read


def _nonlinear(result: RunResult) -> bool:
    """Whether the structure was seen not to be linear: its modes are not those of the FRFs at the level of the test."""
    return any(finding.code == "slip-then-ring" for finding in result.findings)


def _accepted(result: RunResult, near: float) -> int | None:
    """The accepted mode nearest to a frequency in Hz, unless a peak outside its half-power band is nearer.

    ``None`` also where the structure is not linear.
    """
    from ema.fit import peak_picking

    modes = result.modes
    if _nonlinear(result) or not len(modes.poles) or modes.covariance is None:
        return None
    frequencies = modes.natural_frequencies
    row = int(np.argmin(np.abs(frequencies - near)))
    frequency, off = frequencies[row], abs(frequencies[row] - near)
    if off > NEAR * near or not np.isfinite(modes.covariance[row]).all():
        return None
    try:
        peak = peak_picking(result.frfs.in_memory(), [near])[0].natural_frequency
    except InputError:  # no peak but that of the mode, if any
        return row
    return row if off <= abs(peak - near) or abs(peak - frequency) <= modes.damping_ratios[row] * frequency else None


def _linear_fit(result: RunResult, near: float) -> SingleMode:
    """One linear mode fitted to the FRFs near a frequency in Hz: the one that the report shows, where it shows one."""
    from ema.fit import local_fit

    shown = [one for one in result.equivalent if abs(one.natural_frequency - near) <= NEAR * near]
    if shown:
        return min(shown, key=lambda one: abs(one.natural_frequency - near))
    try:
        return local_fit(result.frfs.in_memory(), near)
    except InputError as error:
        raise _NoModeError(f"a mode of {result.run.id} near {near:g} Hz ({error.what})") from error


def _named(known: Mapping[str, "MapResult"] | Mapping[str, "RunResult"], name: str, what: str):  # type: ignore[no-untyped-def]
    if name not in known:
        raise InputError(
            f"a statement is about a {what} that is not in the study",
            where="[[statements]]",
            got=name or "none",
            expected="one of " + ", ".join(known),
        )
    return known[name]


def _quantity(table: StatementTable, *, accepted: bool) -> str:
    """What was looked at, in words."""
    if table.quantity is None:
        return ""
    parts: list[str] = [table.quantity]
    if table.release:
        parts += [f"model released, {table.release}", *([f"over {table.other}"] if table.other else [])]
    elif table.quantity in RELEASE_QUANTITIES:
        parts += [table.run, f"against {table.other}"] if table.other else [table.run]
    elif table.quantity == "run level effect":
        parts.append(f"modal constants of the late decay, twice the force, {table.run}")
    elif table.run:
        what = f"accepted mode of {table.run}" if accepted else f"one linear mode fitted to the FRFs of {table.run}"
        parts.append(f"{what} near {table.near:g} Hz")
    if table.map:
        parts.append(table.map)
    if table.other and table.quantity not in RELEASE_QUANTITIES and not table.release:
        parts.append(f"over {table.other}" if "over" in table.quantity else table.other)
    parts += [f"F_E {table.level:g} N"] if table.level is not None else []
    parts += [f"F_N {table.force:g} N"] if table.force is not None else []
    parts += [f"F_E {table.levels[0]:g} to {table.levels[1]:g} N"] if table.levels is not None else []
    parts += [f"F_N {table.forces[0]:g} to {table.forces[1]:g} N"] if table.forces is not None else []
    return ", ".join(parts)
