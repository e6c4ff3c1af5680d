"""Scatter of the poles between FRFs that were measured one after the other, and between the blows that they average."""

from dataclasses import replace

import numpy as np
import scipy.special
import scipy.stats
from jaxtyping import Complex, Float, Int

from ema.fit import weighted
from ema.fit.weighted import Linearisation, State, Weighted

_CHANCE = 5e-3
"""Probability that noise alone passes for scatter."""
_LARGEST_SHARE = 0.8
"""Share in the information of a pole that counts at most: the other outputs have to tell something to compare with."""
_GROUPS = 16
"""Groups of lines, each over the whole band."""
_LEVELS = 60
"""Levels of scatter that are tried, from a tenth of the smallest noise to all that is seen."""
_PRIOR = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 64.0])
"""Degrees of freedom tried for how alike the modes scatter: 1 hardly, 64 all the same."""


def between_outputs(
    data: Weighted, state: State, normal: Linearisation, variance: Float[np.ndarray, "mode"]
) -> Float[np.ndarray, "2 mode"]:
    """Factor on the variance of the real and of the imaginary part of each pole for what changes between the outputs.

    Where a hammer roves, its points are hit at different times, in different ways, with the sensor loading another
    place: each FRF is clean and has a pole of its own. Leaving out one output after the other shows that (one step of
    the jackknife, Wu 1986; sandwich variance over groups, Liang and Zeger 1986).

    Parameters
    ----------
    variance : of each pole over what the weights say.
    """
    modes = len(state.poles)
    if len(data.signals) < 3 or not modes:
        return np.ones((2, modes))
    share = np.minimum(_shares(data, state), _LARGEST_SHARE)
    freedom = np.maximum(1 / np.sum(share**2, axis=0) - 1, 1)
    usual = np.sum(share / (1 - share), axis=0)
    covariance = normal.covariance()
    change = weighted.scores(data, state, normal) @ covariance
    seen = np.array([np.sum((part / (1 - share)) ** 2, axis=0) / usual for part in _of_poles(change, modes)])
    return _factors(seen, np.array([freedom, freedom]), state, covariance, variance, 0.5 * (freedom + 1))


def between_lines(
    data: Weighted, state: State, normal: Linearisation, variance: Float[np.ndarray, "mode"]
) -> Float[np.ndarray, "2 mode"]:
    """Factor on the variance of the real and of the imaginary part of each pole for noise that the FRFs share.

    The force of a blow is a part of all FRFs of that blow: its noise moves them together, and many FRFs tell no more
    than one. What the residuals of all FRFs on a line do to a pole shows that (sandwich variance over groups of lines,
    Liang and Zeger 1986).

    Parameters
    ----------
    variance : of each pole over what the weights say.
    """
    modes, count = len(state.poles), len(data.s)
    if data.signals[..., 0].size < 2 or not modes or count < 4 * _GROUPS:
        return np.ones((2, modes))
    residual = data.signals - np.concatenate([weighted.model(data, state, rows) for rows in data.blocks()])
    pull = np.empty((_GROUPS, len(normal.gradient)))
    for group in range(_GROUPS):
        lines = slice(group, None, _GROUPS)
        some = replace(data, s=data.s[lines], signals=data.signals[..., lines], weights=data.weights[..., lines])
        pull[group] = np.sum(weighted.scores(some, state, normal, residual[..., lines]), axis=0)
    covariance = normal.covariance()
    seen, freedom = [], []
    for part in _of_poles(pull @ covariance, modes):
        left = (part - np.mean(part, axis=0)) ** 2
        seen.append(np.sum(left, axis=0) * _GROUPS / (_GROUPS - 1))
        freedom.append(np.full(modes, _GROUPS - 1.0))
    return _factors(np.array(seen), np.array(freedom), state, covariance, variance)


def between_blows(
    data: Weighted,
    state: State,
    normal: Linearisation,
    variance: Float[np.ndarray, "mode"],
    deviations: Complex[np.ndarray, "blow out in freq"],
    blows: Int[np.ndarray, "blow out in"],
) -> Float[np.ndarray, "2 mode"]:
    """Factor on the variance of the real and of the imaginary part of each pole for what changes between the blows.

    Blows differ in strength, place and direction, and a joint answers to that: the averaged FRF is clean, and its pole
    is that of these few blows. What each blow does to a pole follows from its deviation from the average (one step of
    the jackknife). One blow shifts all FRFs that it was measured in at once, so its noise may be common to them too.

    Parameters
    ----------
    variance : of each pole over what the weights say.
    deviations : of the FRFs, like the signals; ``blows`` says which blow each belongs to, -1 to none.
    """
    modes, count = len(state.poles), int(blows.max(initial=-1)) + 1
    if not modes or not count:
        return np.ones((2, modes))
    pull = np.zeros((count, len(normal.gradient)))
    for change, numbers in zip(deviations, blows, strict=True):
        together = bool(np.all(numbers == numbers[:, :1]))
        for column in range(1 if together else numbers.shape[1]):
            own = change if together else np.where(np.arange(numbers.shape[1])[:, None] == column, change, 0)
            some = numbers[:, column] >= 0
            np.add.at(pull, numbers[some, column], weighted.scores(data, state, normal, own)[some])
    covariance = normal.covariance()
    average = _averages(blows, count)
    seen, freedom = zip(*(_pooled(part, average) for part in _of_poles(pull @ covariance, modes)))
    each = count / len(np.unique(average))
    return _factors(np.array(seen), np.array(freedom), state, covariance, variance, each)


def _of_poles(change: Float[np.ndarray, "part unknown"], modes: int) -> list[Float[np.ndarray, "part mode"]]:
    """Changes of the real, and of the imaginary parts of the poles."""
    half = change.shape[1] // 2
    return [change[:, :modes], change[:, half : half + modes]]


def _averages(blows: Int[np.ndarray, "blow out in"], count: int) -> Int[np.ndarray, "count"]:
    """Number of the average that each blow is part of."""
    flat = blows.reshape(len(blows), -1)
    found = np.zeros(count, int)
    first = np.min(np.where(flat >= 0, flat, count), axis=0)
    held = flat >= 0
    found[flat[held]] = np.broadcast_to(first, flat.shape)[held]
    return found


def _pooled(
    change: Float[np.ndarray, "blow mode"], average: Int[np.ndarray, "blow"]
) -> tuple[Float[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """Variance by the blows of all averages together, and its degrees of freedom (Satterthwaite 1946)."""
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
    state: State,
    covariance: Float[np.ndarray, "unknown unknown"],
    variance: Float[np.ndarray, "mode"],
    broadened: float | Float[np.ndarray, "mode"] = 0.0,
) -> Float[np.ndarray, "2 mode"]:
    """Factors of real and imaginary parts: scatter is compared with the decay rate, and with the frequency.

    Resonances that lie side by side look like a broader one: their variance over the decay rate is what the decay rate
    of an average is too high by, and half of that for one pole in several FRFs. ``broadened`` is that share times the
    number of resonances; the error is added to the variance.
    """
    modes, half = len(state.poles), len(covariance) // 2
    own = np.diagonal(covariance)
    noise = np.array([own[:modes], own[half : half + modes]]) * variance
    size = np.array([state.poles.real**2, np.abs(state.poles) ** 2])
    real, imaginary = (widened(*row) for row in zip(seen, noise, size, freedom, (False, True), strict=True))
    error = broadened * (imaginary - 1) * noise[1] / np.abs(state.poles.real)
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
    return found - scipy.special.betaln(first / 2, second / 2)


def _shares(data: Weighted, state: State) -> Float[np.ndarray, "out mode"]:
    """Share of each output in what the data tell of each pole."""
    near = np.abs(data.s - state.poles[:, None]) ** -4
    share = np.empty(state.shapes.shape)
    for rows in data.blocks():
        found = np.einsum("oif,mf,im->om", data.weights[rows], near, np.abs(state.participation) ** 2, optimize=True)
        share[rows] = found * np.abs(state.shapes[rows]) ** 2
    result: np.ndarray = share / np.maximum(np.sum(share, axis=0), np.finfo(float).tiny)
    return result
