"""Whether a channel of a stepped sine changed its gain between two frequencies.

Over a few neighbouring lines FRFs are rational functions of the frequency with one denominator: with N_k and D of
second degree, N_k(x) - H_k(x) D(x) = 0, whatever resonance or antiresonance lies there (Levy 1959). A range that was
switched multiplies some lines by a real factor, which no such function follows. A change at a single line is not looked
for: a resonance narrower than the lines explains any.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats
from jaxtyping import Bool, Complex, Float

from ema.data import Finding

SIDE = 5
"""Lines on either side of a change that are looked at: ten values of each FRF for its three unknowns."""

EXPLAINED = 0.95
"""Share of the misfit that a gain has to explain: what is left is noise, no second resonance or joint that slips."""

BETTER = 0.5
"""Largest misfit of one resonance with a gain over that of two resonances without one, each by degrees of freedom: of
noise alone the ratio is about 1."""

CHANGE = 0.1
"""Relative change of a gain from which on it is named; half of it is the repeatability of a range."""

CHANCE = 1e-6
"""Probability that noise alone gives a change, over all lines and channels of a run."""

GAINS = np.concatenate([sign * np.geomspace(0.02, 50, 161) for sign in (1, -1)])
"""Factors that are tried for the force, whose denominator is not known from other channels: 5 % apart."""

NEAR = np.linspace(0.95, 1.05, 41)
"""Factors that are tried about the best of them."""

COARSE = 0.6
"""Change of the FRFs from line to line, relative, above which lines are too far apart to tell a gain from a resonance.

At a resonance with two lines within its half-power bandwidth they change by 0.9, with four by 0.5.
"""

CLEAR = 3.0
"""Rms of an FRF on either side of a change over its standard deviation, from which on it is looked at: noise alone has
1, and an FRF that rises out of noise is no gain that was switched."""

ONE = np.ones(1)


def about_gains(
    frequencies: Float[np.ndarray, "freq"],
    values: Complex[np.ndarray, "freq out"],
    variance: Float[np.ndarray, "freq out"],
    *,
    names: Sequence[str],
    where: str,
) -> tuple[Finding, ...]:
    """A finding for the clearest change of each channel; ``names`` are those of the force and of the responses."""
    lines, outputs = values.shape
    clearest: dict[int, tuple[float, float, str]] = {}
    tests = lines * (outputs + 1)
    apart, later = _apart(values), np.arange(2 * SIDE) >= SIDE
    for start in range(lines - 2 * SIDE + 1):
        steps = np.delete(apart[start : start + 2 * SIDE - 1], SIDE - 1)
        if steps.max() > COARSE:
            continue
        part, said = slice(start, start + 2 * SIDE), f"from {frequencies[start + SIDE]:.5g} Hz on"
        clear = np.flatnonzero(_clear(values[part], variance[part]))
        for place, gain, chance in _changes(frequencies[part], values[part][:, clear], later) if len(clear) else ():
            row = int(clear[place - 1]) + 1 if place else 0
            if chance < CHANCE / tests and chance < clearest.get(row, (np.inf, 0.0, ""))[0]:
                clearest[row] = chance, gain, said
    if 0 in clearest:  # what changes all FRFs changes each, and the other way round
        by_force = clearest[0][0] <= min(chance for chance, _, _ in clearest.values())
        clearest = {row: one for row, one in clearest.items() if (row == 0) == by_force}
    return tuple(_finding(names[row], row == 0, *clearest[row][1:], where) for row in sorted(clearest))


def _clear(values: Complex[np.ndarray, "line out"], variance: Float[np.ndarray, "line out"]) -> Bool[np.ndarray, "out"]:
    """FRFs that stand out of their noise on both sides."""
    power, noise = (one.reshape(2, SIDE, -1).sum(axis=1) for one in (np.abs(values) ** 2, variance))
    return np.asarray(np.all(power >= CLEAR**2 * noise, axis=0))


def _apart(values: Complex[np.ndarray, "freq out"]) -> Float[np.ndarray, "step"]:
    """Change of the FRFs from line to line, over their mean size."""
    scaled = values / np.maximum(np.sqrt(np.mean(np.abs(values) ** 2, axis=0)), 1e-300)
    size = np.linalg.norm(scaled, axis=1)
    return np.asarray(2 * np.linalg.norm(np.diff(scaled, axis=0), axis=1) / np.maximum(size[1:] + size[:-1], 1e-300))


def _changes(
    frequencies: Float[np.ndarray, "line"], values: Complex[np.ndarray, "line out"], mask: Bool[np.ndarray, "line"]
) -> list[tuple[int, float, float]]:
    """Channel (0: the force), gain of the lines in ``mask`` over the others, and the probability that noise has it."""
    x = (frequencies - frequencies.mean()) / np.ptp(frequencies) * 2
    basis = np.stack([np.ones_like(x), x, x**2], axis=1)
    beside = np.eye(len(x)) - basis @ np.linalg.pinv(basis)
    scaled = values / np.maximum(np.sqrt(np.mean(np.abs(values) ** 2, axis=0)), 1e-300)
    products = scaled.T[:, :, None] * basis  # (out, line, order)
    others, changed = products * ~mask[:, None], products * mask[:, None]
    misfit, size = _Square.of(beside @ others, beside @ changed), _Square.of(others, changed)
    found = []
    freedom = 2 * (len(values[0]) * (len(x) - 3) - 2) - 1
    gains = GAINS
    for _ in range(2):  # the second time between the neighbours of the best one
        left = _least(misfit.sum(gains), size.sum(gains))[0]
        best = float(gains[left.argmin()])
        gains = best * NEAR
    plain, _ = _least(misfit.sum(ONE), size.sum(ONE))
    found += _judged(0, 1 / best, float(plain[0]), float(left.min()), freedom)
    if len(values[0]) == 1:
        return found
    # the other channels tell the denominator of each
    _, d = _least(misfit.of_others(), size.of_others())
    forms = (misfit.first, misfit.mixed, misfit.second)
    a, b, c = (np.einsum("op,opq,oq->o", d.conj(), form, d).real for form in forms)
    factor = np.divide(-0.5 * b, c, out=np.ones_like(c), where=c > 0)
    left = a + b * factor + c * factor**2
    for row in np.flatnonzero((factor != 0) & (left <= (1 - EXPLAINED) * (a + b + c))):
        change = 1 / float(factor[row])
        found += _judged(int(row) + 1, change, float((a + b + c)[row]), float(left[row]), 2 * (len(x) - 3) - 1)
    return [one for one in found if _better(x, scaled, mask, one[0], one[1])]


def _better(
    x: Float[np.ndarray, "line"],
    values: Complex[np.ndarray, "line out"],
    mask: Bool[np.ndarray, "line"],
    row: int,
    gain: float,
) -> bool:
    """Whether one resonance with the gain taken off misfits far less than two resonances without."""
    rows = slice(None) if row == 0 else row - 1
    corrected = values.copy()
    corrected[mask, rows] /= gain
    return _misfit(x, corrected, 2) < BETTER * _misfit(x, values, 4)


def _misfit(x: Float[np.ndarray, "line"], values: Complex[np.ndarray, "line out"], degree: int) -> float:
    """Squared misfit of rational functions with one denominator, for each degree of freedom.

    The weights 1/|D| of the step before make the errors of N - H D those of H (Sanathanan and Koerner 1963).
    """
    lines, outputs = values.shape
    basis = np.polynomial.legendre.legvander(x, degree)
    weight, least = np.ones(lines), np.inf
    for _ in range(8):
        weighted = basis * weight[:, None]
        beside = np.eye(lines) - weighted @ np.linalg.pinv(weighted)
        products = values.T[:, :, None] * weighted
        misfit, size = (np.einsum("olp,olq->pq", one.conj(), one)[None] for one in (beside @ products, products))
        denominator = basis @ _least(misfit, size)[1][0]
        weight = 1 / np.maximum(np.abs(denominator), 1e-6 * np.abs(denominator).max())
        weighted = basis * weight[:, None]
        beside = np.eye(lines) - weighted @ np.linalg.pinv(weighted)
        left = beside @ (values * (denominator * weight)[:, None])
        least = min(least, float(np.sum(np.abs(left) ** 2)))
    return float(least / (2 * (outputs * (lines - degree - 1) - degree)))


@dataclass(frozen=True)
class _Square:
    """Squared sums over lines of H_k D as forms of the coefficients of D, for a factor of some of the lines."""

    first: Complex[np.ndarray, "out order order"]
    mixed: Complex[np.ndarray, "out order order"]
    second: Complex[np.ndarray, "out order order"]

    @classmethod
    def of(cls, a: Complex[np.ndarray, "out line order"], b: Complex[np.ndarray, "out line order"]) -> "_Square":
        first, half, second = (np.einsum("olp,olq->opq", x.conj(), y) for x, y in ((a, a), (a, b), (b, b)))
        return cls(first, half + half.conj().transpose(0, 2, 1), second)

    def sum(self, factors: Float[np.ndarray, "gain"]) -> Complex[np.ndarray, "gain order order"]:
        """The forms of all outputs."""
        a, b, c = (one.sum(axis=0) for one in (self.first, self.mixed, self.second))
        return np.asarray(a + factors[:, None, None] * b + factors[:, None, None] ** 2 * c)

    def of_others(self) -> Complex[np.ndarray, "out order order"]:
        """For each output the forms of all others, with the factor 1."""
        each = self.first + self.mixed + self.second
        return np.asarray(each.sum(axis=0) - each)


def _least(
    misfit: Complex[np.ndarray, "gain order order"], size: Complex[np.ndarray, "gain order order"]
) -> tuple[Float[np.ndarray, "gain"], Complex[np.ndarray, "gain order"]]:
    """Least misfit over the size of the FRFs, and the denominator that has it."""
    trace = np.trace(size, axis1=1, axis2=2).real[:, None, None]
    inverse = np.linalg.inv(np.linalg.cholesky(size + 1e-12 * trace * np.eye(size.shape[-1])))
    values, vectors = np.linalg.eigh(inverse @ misfit @ inverse.conj().transpose(0, 2, 1))
    return values[:, 0], (inverse.conj().transpose(0, 2, 1) @ vectors[:, :, :1])[:, :, 0]


def _judged(row: int, gain: float, plain: float, left: float, freedom: int) -> list[tuple[int, float, float]]:
    """The change where the gain explains nearly all of the misfit."""
    left = max(left, 1e-24)
    if abs(gain - 1) < CHANGE or left > (1 - EXPLAINED) * plain:
        return []
    return [(row, gain, float(scipy.stats.f.sf((plain - left) / left * freedom, 1, freedom)))]


def _finding(name: str, force: bool, gain: float, said: str, where: str) -> Finding:
    """What is to be said of a change of a channel."""
    which = "all FRFs are" if force else f"the FRFs of channel {name} are"
    channel = f"the force, channel {name}, or all responses" if force else "the channel"
    return Finding(
        "warning",
        "records-disagree",
        f"{where}, channel {name}",
        f"{said} {which} {gain:.3g} times as large as a resonance makes them: {channel} changed the gain.",
        gain,
        CHANGE,
        "Look for a range that was switched; correct the records by a repair, or leave them out.",
    )
