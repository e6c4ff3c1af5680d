"""A simulated damping map against a measured one."""

import numpy as np
from jaxtyping import Float

from ema.data import ModalMap
from ema.data.comparison import MapComparison, Verdict
from ema.data.modal import COVERAGE_FACTOR
from ema.errors import InputError

DAMPING = 0.15
"""What is granted to the damping ratio of a model besides the bounds of the measurement, relative."""
FREQUENCY = 0.005
"""What is granted to the natural frequency of a model besides the bounds of the measurement, relative."""
ENOUGH = 0.9
"""Share of the points of a map that have to agree: a 95 % band leaves out one in twenty, and a map has few points."""
RIDGE = 1.6
"""Ratio of measured and simulated optimum normal force up to which they count as one (a step of the grid)."""


def maps(measured: ModalMap, simulated: ModalMap) -> MapComparison:
    """Compare a simulated map with a measured one, point by point and along the ridge of most damping.

    The simulated map is read at the measured forces (linear in the logarithms of level and normal force). Measured
    points that it does not reach do not count; the verdict says how many. Where it has a hole (NaN: the model has no
    resonance) it misses the measured point.

    Parameters
    ----------
    measured : ModalMap
        Measured map, two force levels or more.
    simulated : ModalMap
        Simulated map.

    Returns
    -------
    MapComparison
        Errors on the points of the measured map, the ridges, and whether the model agrees.

    Raises
    ------
    InputError
        If a map has one level or no point in common, or the normal forces differ by a factor of a thousand.

    Examples
    --------
    >>> from ema.examples import modal_map
    >>> maps(modal_map(), modal_map()).verdict.agrees
    True
    """
    if len(measured.force_levels) < 2:
        raise InputError(
            "a map with one level",
            where=measured.name or "measured map",
            got=f"{measured.force_levels} N",
            expected="two or more force levels",
            advice="measure another level: one tells no trend",
        )
    _units(measured, simulated)
    levels, forces = _conditions(measured)
    frequency = _read(simulated, simulated.frequency, levels, forces)
    damping = _read(simulated, simulated.damping, levels, forces)
    frequency_error, ratio = frequency / measured.frequency - 1, damping / measured.damping
    if not np.isfinite(ratio).any():
        raise InputError(
            "the maps have no point in common",
            where=measured.name or "measured map",
            got=f"{simulated.force_levels} N over {simulated.normal_forces} N",
            expected=f"{measured.force_levels} N over {measured.normal_forces} N",
        )
    bounds = [
        np.zeros(ratio.shape) if std is None else COVERAGE_FACTOR * np.nan_to_num(std)
        for std in (measured.frequency_std, measured.damping_std)
    ]
    good = np.abs(frequency - measured.frequency) <= bounds[0] + FREQUENCY * measured.frequency
    good &= np.abs(damping - measured.damping) <= bounds[1] + DAMPING * measured.damping
    known = np.isfinite(measured.damping) & np.isfinite(measured.frequency)
    reached = known & np.isfinite(_read(simulated, np.ones(simulated.damping.shape), levels, forces))
    inside = float(good[reached].mean())
    said = [
        f"{inside:.0%} of {int(reached.sum())} points lie within the bounds.",
        *_left_out(int(np.sum(reached & ~np.isfinite(ratio))), int(np.sum(known & ~reached))),
    ]
    ridge = np.stack([_ridge(measured.damping, forces), _ridge(damping, forces)], axis=1)
    return MapComparison(
        measured,
        simulated,
        frequency_error,
        ratio,
        ridge,
        inside,
        _verdict(measured, frequency_error, ratio, ridge, _given_away(measured, damping), inside, said),
    )


def _left_out(holes: int, beyond: int) -> list[str]:
    """Sentences on measured points without a simulated one: at holes of the simulated map, and beyond its range."""
    said = []
    if holes:
        said.append(f"Of these, the model has no resonance at {holes}.")
    if beyond:
        said.append(f"Measured points beyond the simulated map, which do not count: {beyond}.")
    return said


def _units(measured: ModalMap, simulated: ModalMap) -> None:
    middle = [float(np.exp(np.mean(np.log(np.maximum(chart.normal_forces, 1e-9))))) for chart in (measured, simulated)]
    if abs(np.log10(middle[0] / middle[1])) > 2.5:
        raise InputError(
            "normal forces of another size",
            where=measured.name or "measured map",
            got=f"about {middle[0]:.3g} N and {middle[1]:.3g} N",
            expected="the same range in both",
            advice="a factor of about 1000: check kN against N",
        )


def _conditions(chart: ModalMap) -> tuple[Float[np.ndarray, "level force"], Float[np.ndarray, "level force"]]:
    """Measured level and normal force of every point, the nominal one where none was measured."""
    shape = chart.damping.shape
    levels = np.broadcast_to(chart.force_levels[:, None], shape)
    forces = np.broadcast_to(chart.normal_forces[None, :], shape)
    if chart.force_at_resonance is not None:
        levels = np.where(np.isfinite(chart.force_at_resonance), chart.force_at_resonance, levels)
    if chart.joint_forces is not None and chart.joint_forces.shape[2]:
        with np.errstate(invalid="ignore"):
            mean = chart.joint_forces.mean(axis=2)
        forces = np.where(np.isfinite(mean), mean, forces)
    return np.asarray(levels), np.asarray(forces)


def _read(
    chart: ModalMap, values: Float[np.ndarray, "level force"], levels: np.ndarray, forces: np.ndarray
) -> Float[np.ndarray, "level2 force2"]:
    """Values of a map at other levels and forces; NaN beyond its range (plus a hair) and at holes."""
    x, y = np.log(np.maximum(chart.force_levels, 1e-9)), np.log(np.maximum(chart.normal_forces, 1e-9))
    at_x, at_y = np.log(np.maximum(levels, 1e-9)), np.log(np.maximum(forces, 1e-9))
    result = np.full(levels.shape, np.nan)
    for index in np.ndindex(levels.shape):
        weights = [_weights(axis, value) for axis, value in ((x, at_x[index]), (y, at_y[index]))]
        if weights[0] is None or weights[1] is None:
            continue
        parts = [wa * wb * values[i, j] for i, wa in weights[0] for j, wb in weights[1] if wa * wb > 0]
        result[index] = float(np.sum(parts))
    return result


def _weights(axis: Float[np.ndarray, "n"], value: float) -> tuple[tuple[int, float], ...] | None:
    if not axis[0] - 0.1 <= value <= axis[-1] + 0.1:
        return None
    if len(axis) == 1:
        return ((0, 1.0),)
    cell = int(np.clip(np.searchsorted(axis, value) - 1, 0, len(axis) - 2))
    share = float(np.clip((value - axis[cell]) / (axis[cell + 1] - axis[cell]), 0, 1))
    return ((cell, 1 - share), (cell + 1, share))


def _ridge(damping: Float[np.ndarray, "level force"], forces: np.ndarray) -> Float[np.ndarray, "level"]:
    return np.array(
        [
            forces[row, np.nanargmax(values)] if np.isfinite(values).any() else np.nan
            for row, values in enumerate(damping)
        ]
    )


def _given_away(measured: ModalMap, simulated: Float[np.ndarray, "level force"]) -> Float[np.ndarray, "level"]:
    """Share of the most measured damping that is missing at the normal force where the simulation has its most."""
    lost = np.full(len(measured.damping), np.nan)
    for row, (seen, made) in enumerate(zip(measured.damping, simulated, strict=True)):
        both = np.isfinite(seen) & np.isfinite(made)
        if both.any():
            lost[row] = 1 - seen[np.argmax(np.where(both, made, -np.inf))] / np.nanmax(seen)
    return lost


def _verdict(
    measured: ModalMap,
    frequency_error: np.ndarray,
    ratio: np.ndarray,
    ridge: np.ndarray,
    lost: np.ndarray,
    inside: float,
    counts: list[str],
) -> Verdict:
    said = [
        *counts,
        f"Simulated over measured damping is {np.nanmedian(ratio):.2f} in the median, "
        f"{np.nanmin(ratio):.2f} to {np.nanmax(ratio):.2f}; frequencies differ by up to "
        f"{100 * np.nanmax(np.abs(frequency_error)):.2f} %.",
    ]
    off = ridge[:, 1] / ridge[:, 0]
    apart = np.isfinite(off) & ((off > RIDGE) | (off < 1 / RIDGE))
    wrong = apart & (lost > DAMPING)
    if wrong.any():
        row = int(np.argmax(np.where(wrong, np.abs(np.log(off)), -1)))
        said.append(
            f"At {measured.force_levels[row]:g} N the most damping is at {ridge[row, 0]:.3g} N, "
            f"simulated at {ridge[row, 1]:.3g} N."
        )
    elif apart.any():
        row = int(np.argmax(np.where(apart, np.abs(np.log(off)), -1)))
        said.append(
            f"The normal force of most damping agrees at every level, as far as the data show: at "
            f"{measured.force_levels[row]:g} N the damping measured at {ridge[row, 1]:.3g} N is within "
            f"{100 * DAMPING:.0f} % of that at {ridge[row, 0]:.3g} N."
        )
    else:
        said.append("The normal force of most damping agrees at every level.")
    return Verdict(inside >= ENOUGH and not wrong.any(), tuple(said))
