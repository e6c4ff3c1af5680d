"""Sensor set-ups whose modes do not agree: poles of each set-up, their shifts, and FRFs moved to common poles.

Between the set-ups of a test the temperature changes, and roving sensors load the structure elsewhere. One fit of all
FRFs then sees several resonances where there is one. Here each set-up is fitted by itself, the modes are matched, and
what the difference of the poles does to the FRFs is taken off:

    H'(s) = H(s) + sum_r [R'_r / (s - p'_r) - R_r / (s - p_r) + the same of the conjugates],  R'_r = R_r w_r / w'_r

with the poles p and residues R of the set-up, and p' the mean of the poles over the set-ups (shapes of unit modal mass
stay as they are when the stiffness changes, residues go with 1 / w). The noise of H stays, so that one fit of the
aligned FRFs has the optimum and the intervals of a joint fit in which each set-up has poles of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
import scipy.stats
from jaxtyping import Bool, Complex, Float, Int

from ema.data import (
    FrfSet,
    damping_ratios,
    natural_frequencies,
    poles_from,
)
from ema.shapes import mac
from ema.synthesis import pole_basis
from ema.units import DERIVATIVE_ORDER

WIDEST = 0.03
"""Largest relative shift between two set-ups within which modes are matched: a change of 20 K moves steel by 0.4 %, and
sensors of 1 % of a modal mass a mode by 0.5 %."""
ALIKE = 0.01
"""Relative shift that weighs as much in the matching as participation vectors that have nothing in common: a third of
the reach, so that a mode farther away is preferred only where the near one has another vector."""
CHANCE = 1e-3
"""Probability that noise alone makes the frequencies of set-ups look different, for all modes and set-ups of a test
together. Above it the set-ups are fitted as one."""
SAME = 0.9
"""MAC of the participation of a mode in one set-up with that in all of them, from which on it is the same mode: below
it, as in a group whose members can be chosen in many ways, the residues stay as they are."""
AGREEMENT = 0.002
"""Relative difference (one width of a Gaussian weight) within which modes agree on a common shift of two set-ups; modes
of the aligned FRFs within it take over the scatter between the set-ups."""


@dataclass(frozen=True)
class PartFit:
    """Poles of one set-up as its FRFs show them (rad/s, windows included), with what it takes to compare and move them.

    ``residues`` (pole, out, in) on the outputs ``rows`` and the inputs ``columns`` of the test; ``vectors`` (pole, in
    or out) on the side that all set-ups share; ``accepted`` (pole,) are its modes; standard deviations of frequency
    [Hz] and damping ratio.
    """

    poles: Complex[np.ndarray, "pole"]
    residues: Complex[np.ndarray, "pole out in"]
    rows: Int[np.ndarray, "out"]
    columns: Int[np.ndarray, "in"]
    vectors: Complex[np.ndarray, "pole common"]
    accepted: Bool[np.ndarray, "pole"]
    frequency_std: Float[np.ndarray, "pole"]
    damping_std: Float[np.ndarray, "pole"]


@dataclass(frozen=True)
class Comparison:
    """Modes that several set-ups show: ``rows`` (mode, set-up) are their poles in the set-ups, -1 where there is none.

    ``frequency``, ``damping`` (mode,) are means over the set-ups, ``spread`` (mode, 2) the variance of natural
    frequency and damping ratio between the set-ups beyond their noise; ``logs``, ``std`` (mode, set-up) natural
    logarithms of the frequencies and their standard deviations, NaN where a set-up does not show the mode; ``common``
    (set-up,) shifts of all modes together and ``common_std``; ``chance`` is the probability of such differences by
    noise.
    """

    rows: Int[np.ndarray, "mode set_up"]
    frequency: Float[np.ndarray, "mode"]
    damping: Float[np.ndarray, "mode"]
    spread: Float[np.ndarray, "mode 2"]
    logs: Float[np.ndarray, "mode set_up"]
    std: Float[np.ndarray, "mode set_up"]
    common: Float[np.ndarray, "set_up"]
    common_std: Float[np.ndarray, "set_up"]
    chance: float

    @property
    def differ(self) -> bool:
        """Whether noise does not explain the differences of the set-ups."""
        return self.chance < CHANCE


def split(frfs: FrfSet) -> tuple[tuple[list[int], list[int]], ...]:
    """Outputs and inputs of each set-up; none of a single set-up, or where they share no side."""
    if frfs.set_ups is None:
        return ()
    number = frfs.set_ups.number
    present = np.unique(number)
    if len(present) < 2:
        return ()
    outputs, inputs = list(range(len(frfs.outputs))), list(range(len(frfs.inputs)))
    by_rows, by_columns = np.all(number == number[:, :1]), np.all(number == number[:1])
    if by_rows:
        return tuple((np.flatnonzero(number[:, 0] == one).tolist(), inputs) for one in present)
    if by_columns:
        return tuple((outputs, np.flatnonzero(number[0] == one).tolist()) for one in present)
    return ()


def compare(parts: Sequence[PartFit]) -> Comparison | None:
    """Match the modes of set-ups and test whether they agree.

    The test is chi-squared on the natural logarithms of the frequencies, weighted with their standard deviations; a
    mode that a set-up does not show is taken to have moved there as the others did.

    Parameters
    ----------
    parts : fit of each set-up, at least two.

    Returns
    -------
    Means, spread and shifts of the modes that at least two set-ups show, by frequency; ``None`` where there is none.
    """
    rows = _matched(parts)
    rows = rows[np.count_nonzero(rows >= 0, axis=1) > 1]
    if not len(rows):
        return None
    first = [next(parts[k].poles[pole] for k, pole in enumerate(row) if pole >= 0) for row in rows.tolist()]
    rows = rows[np.argsort(np.abs(first))]
    shape = rows.shape
    logs, std, damping, damping_std = (np.full(shape, np.nan) for _ in range(4))
    for k, part in enumerate(parts):
        seen = np.flatnonzero(rows[:, k] >= 0)
        own = rows[seen, k]
        frequency = natural_frequencies(part.poles[own])
        logs[seen, k], std[seen, k] = np.log(frequency), part.frequency_std[own] / frequency
        damping[seen, k], damping_std[seen, k] = damping_ratios(part.poles[own]), part.damping_std[own]
    weight = np.nan_to_num(1 / std**2)
    mean = np.nansum(weight * np.nan_to_num(logs), axis=1) / np.sum(weight, axis=1)
    energy = float(np.nansum(((logs - mean[:, None]) / std) ** 2))
    freedom = int(np.count_nonzero(rows >= 0) - len(rows))
    common, common_std, _ = common_shift(logs, std)
    # A mode that a set-up does not show is taken to have moved there as the others did.
    filled = np.where(np.isnan(logs), np.nanmean(logs - common, axis=1)[:, None] + common, logs)
    average = np.mean(np.exp(filled), axis=1)
    common = common - np.log(np.mean(np.exp(common)))
    of_damping = np.nan_to_num(1 / damping_std**2)
    typical = np.nansum(of_damping * np.nan_to_num(damping), axis=1) / np.sum(of_damping, axis=1)
    spread = np.stack(
        [
            average**2 * _beyond(logs, std, logs.mean(axis=1, where=~np.isnan(logs))),
            _beyond(damping, damping_std, typical),
        ],
        axis=1,
    )
    chance = float(scipy.stats.chi2.sf(energy, freedom))
    return Comparison(rows, average, typical, spread, logs, std, common, common_std, chance)


def aligned(frfs: FrfSet, parts: Sequence[PartFit], comparison: Comparison) -> FrfSet:
    """The FRFs of all set-ups with their modes moved to the means over the set-ups; other poles by the common shift."""
    values = np.array(frfs.values)
    derivative = (2j * np.pi * frfs.frequencies) ** DERIVATIVE_ORDER[frfs.quantity]
    residues = _of_common_vectors(parts, comparison)
    for k, part in enumerate(parts):
        target = poles_from(
            natural_frequencies(part.poles) * np.exp(-comparison.common[k]),
            np.minimum(damping_ratios(part.poles), 0.999),
        )
        seen = np.flatnonzero(comparison.rows[:, k] >= 0)
        target[comparison.rows[seen, k]] = poles_from(comparison.frequency[seen], comparison.damping[seen])
        scale = np.abs(part.poles) / np.abs(target)
        moving = part.poles.imag > 0
        before, after = part.residues[moving], (scale[:, None, None] * residues[k])[moving]
        change = _response(frfs.frequencies, target[moving], after) - _response(
            frfs.frequencies, part.poles[moving], before
        )
        values[:, part.rows[:, None], part.columns] += derivative[:, None, None] * change
    return replace(frfs, values=values)


def _of_common_vectors(parts: Sequence[PartFit], comparison: Comparison) -> list[Complex[np.ndarray, "pole out in"]]:
    """Residues of each set-up with one participation of each mode on the side that the set-ups share.

    Sensors that load the structure mix its modes, so that participation changes with the set-up. The common one is the
    strongest singular vector of all residues of a mode. Where it is another mode's, as in a group whose members can be
    chosen in many ways, the residues stay.
    """
    residues = [np.array(part.residues) for part in parts]
    across = len({tuple(part.columns.tolist()) for part in parts}) > 1
    for row in comparison.rows:
        seen = [(k, pole) for k, pole in enumerate(row.tolist()) if pole >= 0]
        matrices = [residues[k][pole].T if across else residues[k][pole] for k, pole in seen]
        vector = np.linalg.svd(np.concatenate(matrices), full_matrices=False)[2][0]
        for (k, pole), matrix in zip(seen, matrices, strict=True):
            projected = np.outer(matrix @ vector.conj(), vector)
            if np.linalg.norm(projected) ** 2 > SAME * np.linalg.norm(matrix) ** 2:
                residues[k][pole] = projected.T if across else projected
    return residues


def _response(
    frequencies: Float[np.ndarray, "freq"],
    poles: Complex[np.ndarray, "pole"],
    residues: Complex[np.ndarray, "pole out in"],
) -> Complex[np.ndarray, "freq out in"]:
    """Receptance of modes."""
    direct, mirrored = pole_basis(frequencies, poles)
    return np.tensordot(direct, residues, 1) + np.tensordot(mirrored, residues.conj(), 1)


def _beyond(
    values: Float[np.ndarray, "mode set_up"], std: Float[np.ndarray, "mode set_up"], mean: Float[np.ndarray, "mode"]
) -> Float[np.ndarray, "mode"]:
    """Variance between set-ups beyond what noise makes of it."""
    freedom = np.maximum(np.count_nonzero(~np.isnan(values), axis=1) - 1, 1)
    seen = np.nansum((values - mean[:, None]) ** 2, axis=1) / freedom
    return np.asarray(np.maximum(seen - np.nanmean(std**2, axis=1), 0))


def means(values: Float[np.ndarray, "mode set_up"], std: Float[np.ndarray, "mode set_up"]) -> Float[np.ndarray, "mode"]:
    """Means over the set-ups, weighted by the inverse of the variances; NaN counts for nothing."""
    weight = np.nan_to_num(1 / std**2)
    result: np.ndarray = np.sum(weight * np.nan_to_num(values), axis=1) / np.sum(weight, axis=1)
    return result


def common_shift(
    logs: Float[np.ndarray, "mode set_up"], std: Float[np.ndarray, "mode set_up"]
) -> tuple[Float[np.ndarray, "set_up"], Float[np.ndarray, "set_up"], float]:
    """Shift of each set-up (their sum is zero) by weighted least squares, its standard deviation, and what is left.

    ln f of mode r in set-up k is a_r + d_k. Where more is left than noise explains, the deviations grow by its root.
    """
    modes, count = logs.shape
    mode, number = np.nonzero(~np.isnan(logs))
    weight = 1 / std[mode, number]
    design = np.zeros((len(mode) + 1, modes + count))
    design[np.arange(len(mode)), mode] = weight
    design[np.arange(len(mode)), modes + number] = weight
    # The sum of the shifts is zero; of set-ups without a mode nothing is known.
    design[-1, modes:] = weight.max()
    right = np.append(weight * logs[mode, number], 0.0)
    spread = np.linalg.pinv(design, rcond=1e-12)
    solution = spread @ right
    left = float(np.sum((right - design @ solution) ** 2))
    free = max(len(mode) - modes - count + 1, 1)
    own = np.sqrt(np.sum(spread[modes:, :-1] ** 2, axis=1) * max(left / free, 1.0))
    seen = np.any(~np.isnan(logs), axis=0)
    return np.where(seen, solution[modes:], 0.0), np.where(seen, own, np.inf), left


def _matched(parts: Sequence[PartFit]) -> Int[np.ndarray, "mode set_up"]:
    """Poles of each set-up that are one mode, a row for each mode that any set-up shows."""
    first = np.flatnonzero(parts[0].accepted)
    rows = np.full((len(first), len(parts)), -1)
    rows[:, 0] = first
    logs = np.log(natural_frequencies(parts[0].poles[first]))
    vectors = parts[0].vectors[first]
    for k, part in enumerate(parts[1:], 1):
        own = np.flatnonzero(part.accepted)
        theirs = np.log(natural_frequencies(part.poles[own]))
        shift, pairs = _pairs(logs, vectors, theirs, part.vectors[own])
        for mode, other in pairs:
            rows[mode, k] = own[other]
        rest = np.setdiff1d(np.arange(len(own)), [other for _, other in pairs])
        more = np.full((len(rest), len(parts)), -1)
        more[:, k] = own[rest]
        rows = np.concatenate([rows, more])
        logs, vectors = np.append(logs, theirs[rest] - shift), np.concatenate([vectors, part.vectors[own[rest]]])
    return rows


def _pairs(
    logs: Float[np.ndarray, "mode"],
    vectors: Complex[np.ndarray, "mode common"],
    theirs: Float[np.ndarray, "other"],
    their_vectors: Complex[np.ndarray, "other common"],
) -> tuple[float, list[tuple[int, int]]]:
    """Common shift of two lists of modes, and which are the same: alike in frequency and in participation."""
    if not len(logs) or not len(theirs):
        return 0.0, []
    unlike = 1 - np.nan_to_num(mac(vectors.T, their_vectors.T))
    apart = theirs - logs[:, None]
    near = np.append(apart[np.abs(apart) <= WIDEST], 0.0)
    agreement = [np.sum((1 - unlike) * np.exp(-0.5 * ((apart - shift) / AGREEMENT) ** 2)) for shift in near]
    shift = float(near[int(np.argmax(agreement))])
    cost = np.abs(apart - shift) / WIDEST + unlike * ALIKE / WIDEST
    # A pair beyond the reach costs as much as two modes without partners.
    one, other = scipy.optimize.linear_sum_assignment(np.minimum(cost, 1.0))
    return shift, [(int(a), int(b)) for a, b in zip(one, other, strict=True) if cost[a, b] < 1]
