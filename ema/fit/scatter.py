"""Scatter of the poles between FRFs that were measured one after the other, and between the impacts they average."""

from dataclasses import dataclass

import numpy as np
import scipy.special
import scipy.stats
from jaxtyping import Bool, Complex, Float, Int

from ema.fit import estimator
from ema.fit.estimator import Fit, Observations

_CHANCE = 5e-3
"""Probability that noise alone passes for scatter, for each kind of it: once in 200 tests intervals grow without
need."""
_LARGEST_SHARE = 0.8
"""Share in the information of a pole that counts at most: the other outputs have to tell something to compare with. It
is a safeguard where one output tells nearly all: its own pull is divided by what the others leave."""
_GROUPS = 16
"""Groups of lines, each over the whole band. Their scatter has as many degrees of freedom: with 8 stated standard
deviations of 14 random systems change by up to 82 %, with 32 by up to 20 %, at the same values."""
_LEVELS = 60
"""Levels of scatter that are tried, from a tenth of the smallest noise to all that is seen. Over six decades they are a
factor of 1.26 apart, 12 % in standard deviation."""
_PRIOR = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 64.0])
"""Degrees of freedom tried for how alike the modes scatter: 1 hardly, 64 all the same."""


@dataclass(frozen=True)
class Changes:
    """What turns a pull on the shared unknowns into changes of the poles of a fit, and their variance by noise.

    ``by_pull`` (unknown, 2 mode) are the columns of the covariance that belong to the real parts of the poles, then to
    their imaginary parts, for noise as the weights say; ``noise`` (2, mode) the variance of these parts. ``still``
    (mode,) marks the poles of which nothing that is seen says how they change.
    """

    by_pull: Float[np.ndarray, "unknown change"]
    noise: Float[np.ndarray, "2 mode"]
    still: Bool[np.ndarray, "mode"]

    @classmethod
    def of(cls, data: Observations, fit: Fit, level: float, variance: Float[np.ndarray, "mode"]) -> "Changes":
        """For the ``variance`` of each pole over what the weights say, of noise of a ``level`` over what they say.

        A pole that stands still is known by its prior alone, and one without damping is of no vibration that could
        change between FRFs or impacts.
        """
        modes, half = len(fit.poles), len(fit.gradient) // 2
        level = max(level, np.finfo(float).tiny)
        by_cause = estimator.root(fit, level)
        rows = np.concatenate([np.arange(modes), half + np.arange(modes)])
        covariance = by_cause @ by_cause[rows].T / level
        own = np.diagonal(covariance[rows]).reshape(2, modes)
        return cls(covariance, own * variance, (fit.share < estimator.ROUNDING) | estimator.undamped(data, fit.poles))

    def parts(self, pull: Float[np.ndarray, "part unknown"]) -> Float[np.ndarray, "2 part mode"]:
        """Changes of the real, and of the imaginary parts of the poles by each pull."""
        return np.asarray((pull @ self.by_pull).reshape(len(pull), 2, -1).transpose(1, 0, 2))


def between_outputs(data: Observations, fit: Fit, changes: Changes) -> Float[np.ndarray, "2 mode"]:
    """Factor on the variance of the real and of the imaginary part of each pole for what changes between the outputs.

    Where a hammer roves, its points are hit at different times, in different ways, with the sensor loading another
    place: each FRF is clean and has a pole of its own. Leaving out one output after the other shows that (one step of
    the jackknife, Wu 1986; sandwich variance over groups, Liang and Zeger 1986).
    """
    if data.outputs < 3 or not len(fit.poles):
        return np.ones((2, len(fit.poles)))
    told = np.concatenate([told_by_outputs(data, fit, rows) for rows in _blocks(data)])
    pull = np.concatenate(
        [estimator.pulls(data, fit, estimator.residual(data, fit, rows), rows)[:, 0] for rows in _blocks(data)]
    )
    return of_outputs(fit, changes, told, pull)


def of_outputs(
    fit: Fit, changes: Changes, told: Float[np.ndarray, "out mode"], pull: Float[np.ndarray, "out unknown"]
) -> Float[np.ndarray, "2 mode"]:
    """`between_outputs` from what each output tells of each pole, and from its pull on the shared unknowns."""
    share = np.minimum(told / np.maximum(np.sum(told, axis=0), np.finfo(float).tiny), _LARGEST_SHARE)
    freedom = np.maximum(1 / np.sum(share**2, axis=0) - 1, 1)
    usual = np.sum(share / (1 - share), axis=0)
    seen = np.sum((changes.parts(pull) / (1 - share)) ** 2, axis=1) / usual
    return _factors(seen, np.array([freedom, freedom]), fit, changes, 0.5 * (freedom + 1))


def between_lines(
    data: Observations, fit: Fit, changes: Changes, shared: Float[np.ndarray, "mode"]
) -> Float[np.ndarray, "2 mode"]:
    """Factor on the variance of the real and of the imaginary part of each pole for noise that the FRFs share.

    The force of an impact is a part of all FRFs of that impact: its noise moves them together, and many FRFs tell no
    more than one. What the residuals of all FRFs on a line do to a pole shows that (sandwich variance over groups of
    lines, Liang and Zeger 1986). Groups tell nothing of how errors of neighbouring lines go together: ``shared`` is
    what this makes of the variance (`LineCorrelation.of_shared`).
    """
    if data.outputs * data.references < 2:
        return np.ones((2, len(fit.poles)))
    pull = np.zeros((_GROUPS, len(fit.gradient)))
    if len(fit.poles) and len(data.s) >= 4 * _GROUPS:
        for rows in _blocks(data):
            pull += pulls_of_lines(data, fit, rows).sum(axis=1)
    return of_lines(fit, changes, pull, lines=len(data.s), shared=shared)


def pulls_of_lines(data: Observations, fit: Fit, rows: slice) -> Float[np.ndarray, "group out unknown"]:
    """Pulls of the residuals of some outputs on the shared unknowns, for each group of lines."""
    residual = estimator.residual(data, fit, rows)
    groups = [slice(group, None, _GROUPS) for group in range(_GROUPS)]
    return np.stack([estimator.pulls(data.lines(own), fit, residual[..., own], rows)[:, 0] for own in groups])


def of_lines(
    fit: Fit,
    changes: Changes,
    pull: Float[np.ndarray, "group unknown"],
    *,
    lines: int,
    shared: Float[np.ndarray, "mode"],
) -> Float[np.ndarray, "2 mode"]:
    """`between_lines` from the pulls of all outputs together, for each group of lines."""
    modes = len(fit.poles)
    if not modes or lines < 4 * _GROUPS:
        return np.ones((2, modes))
    parts = changes.parts(pull)
    left = (parts - np.mean(parts, axis=1, keepdims=True)) ** 2
    seen = shared * np.sum(left, axis=1) * _GROUPS / (_GROUPS - 1)
    return _factors(seen, np.full((2, modes), _GROUPS - 1.0), fit, changes)


def between_impacts(
    data: Observations,
    fit: Fit,
    changes: Changes,
    deviations: Complex[np.ndarray, "impact out in freq"],
    impacts: Int[np.ndarray, "impact out in"],
) -> Float[np.ndarray, "2 mode"]:
    """Factor on the variance of the real and of the imaginary part of each pole for what changes between the impacts.

    Impacts differ in strength, place and direction, and a joint answers to that: the averaged FRF is clean, and its
    pole is that of these few impacts. What each impact does to a pole follows from its deviation from the average (one
    step of the jackknife). One impact shifts all FRFs that it was measured in at once, so its noise may be common to
    them too.

    Parameters
    ----------
    deviations : of the FRFs, like the signals; ``impacts`` says which impact each belongs to, -1 to none.
    """
    modes, count = len(fit.poles), int(impacts.max(initial=-1)) + 1
    if not modes or not count:
        return np.ones((2, modes))
    pull = np.zeros((count, len(fit.gradient)))
    for change, numbers in zip(deviations, impacts, strict=True):
        together = bool(np.all(numbers == numbers[:, :1]))
        for column in range(1 if together else numbers.shape[1]):
            own = change if together else np.where(np.arange(numbers.shape[1])[:, None] == column, change, 0)
            some = numbers[:, column] >= 0
            np.add.at(pull, numbers[some, column], estimator.pulls(data, fit, own[:, None])[some, 0])
    average = _averages(impacts, count)
    seen, freedom = zip(*(_pooled(part, average) for part in changes.parts(pull)))
    each = count / len(np.unique(average))
    return _factors(np.array(seen), np.array(freedom), fit, changes, each)


def _blocks(data: Observations) -> list[slice]:
    return data.row_blocks(data.signals[0].size, 400_000)


def _averages(impacts: Int[np.ndarray, "impact out in"], count: int) -> Int[np.ndarray, "count"]:
    """Number of the average that each impact is part of."""
    flat = impacts.reshape(len(impacts), -1)
    found = np.zeros(count, int)
    first = np.min(np.where(flat >= 0, flat, count), axis=0)
    held = flat >= 0
    found[flat[held]] = np.broadcast_to(first, flat.shape)[held]
    return found


def _pooled(
    change: Float[np.ndarray, "impact mode"], average: Int[np.ndarray, "impact"]
) -> tuple[Float[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """Variance by the impacts of all averages together, and its degrees of freedom (Satterthwaite 1946)."""
    labels, places, members = np.unique(average, return_inverse=True, return_counts=True)
    each = np.zeros((len(labels), change.shape[1]))
    np.add.at(each, places, change**2)
    seen = np.sum(each, axis=0)
    free = np.maximum(members - 1, 1)[:, None]
    tiny = np.finfo(float).tiny
    return seen, np.maximum(seen, tiny) ** 2 / np.maximum(np.sum(each**2 / free, axis=0), tiny)


def _factors(
    seen: Float[np.ndarray, "2 mode"],
    freedom: Float[np.ndarray, "2 mode"],
    fit: Fit,
    changes: Changes,
    broadened: float | Float[np.ndarray, "mode"] = 0.0,
) -> Float[np.ndarray, "2 mode"]:
    """Factors of real and imaginary parts: scatter is compared with the decay rate, and with the frequency.

    Resonances that lie side by side look like a broader one: their variance over the decay rate is what the decay rate
    of an average is too high by, and half of that for one pole in several FRFs. ``broadened`` is that share times the
    number of resonances; the error is added to the variance.
    """
    noise = changes.noise
    seen = np.where(changes.still, noise, seen)
    size = np.array([fit.poles.real**2, np.abs(fit.poles) ** 2])
    real, imaginary = (widened(*row) for row in zip(seen, noise, size, freedom, (False, True), strict=True))
    error = broadened * (imaginary - 1) * noise[1] / np.abs(fit.poles.real)
    return np.array([real + error**2 / np.maximum(noise[0], np.finfo(float).tiny), imaginary])


def widened(
    seen: Float[np.ndarray, "mode"],
    noise: Float[np.ndarray, "mode"],
    size: Float[np.ndarray, "mode"],
    freedom: Float[np.ndarray, "mode"],
    together: bool = False,
) -> Float[np.ndarray, "mode"]:
    """Factor on the variance by noise for scatter seen with few degrees of freedom; 1 where chance explains it.

    All modes tell how much there is: its variance is a level times ``size``, or times that by noise, alike in all modes
    to an extent that the modes tell too (scaled inverse chi-square around the level; the variance seen then follows an
    F distribution). Each mode adds what was seen of it (moderated variance, Smyth 2004). What exceeds the noise is
    widened by Student's t, so that 1.96 standard deviations hold 95 %. Each mode errs by itself, so that all of them
    add to the degrees of freedom, except where what is beyond the noise moves them ``together`` as a change of
    stiffness or mass does: then many modes tell no more of it than the best one.
    """
    tiny = np.finfo(float).tiny
    seen, noise = np.maximum(seen, tiny), np.maximum(noise, tiny)
    likely = float(np.sum(scipy.stats.chi2.logpdf(freedom * seen / noise, freedom) + np.log(freedom / noise)))
    least = likely + 0.5 * scipy.stats.chi2.isf(_CHANCE, 2)
    factor = np.ones(len(seen))
    for kind, apart in ((np.maximum(size, tiny), not together), (noise, True)):
        high = 2 * np.max(seen / kind)
        levels = np.geomspace(min(0.1 * np.min(noise / kind), high), high, _LEVELS)[:, None]
        prior = noise + levels * kind
        likely_by = np.sum(_log_density(seen / prior, freedom, _PRIOR[:, None, None]) - np.log(prior), axis=2)
        alike, level = np.unravel_index(np.argmax(likely_by), likely_by.shape)
        if likely_by[alike, level] > least:
            least = float(likely_by[alike, level])
            known = _PRIOR[alike] + freedom
            beyond = np.maximum((_PRIOR[alike] * prior[level] + freedom * seen) / known - noise, 0)
            few = (scipy.stats.t.isf(0.025, known if apart else np.max(freedom)) / scipy.stats.norm.isf(0.025)) ** 2
            factor = 1 + few * beyond / noise
    return factor


def _log_density(
    ratio: Float[np.ndarray, "level mode"], first: Float[np.ndarray, "mode"], second: Float[np.ndarray, "prior 1 1"]
) -> Float[np.ndarray, "prior level mode"]:
    """Logarithm of the density of the F distribution."""
    x = first * ratio / second
    found: np.ndarray = 0.5 * first * np.log(x) - 0.5 * (first + second) * np.log1p(x) - np.log(ratio)
    return np.asarray(found - scipy.special.betaln(first / 2, second / 2))


def told_by_outputs(data: Observations, fit: Fit, rows: slice) -> Float[np.ndarray, "out mode"]:
    """What some outputs tell of each pole, up to a factor common to all outputs."""
    near, size = np.abs(data.s - fit.poles[:, None]) ** -4, np.abs(fit.participation) ** 2
    found = np.einsum("oif,mf,im->om", data.weights[rows], near, size, optimize=True)
    return np.asarray(found * np.abs(fit.shapes[rows, 0]) ** 2)
