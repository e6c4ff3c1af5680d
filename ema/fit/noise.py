"""Noise of FRFs as far as it shapes the weights: one factor per line, per output and per reference."""

from dataclasses import dataclass

import numpy as np
import scipy.ndimage
from jaxtyping import Bool, Complex, Float, Int

from ema.data import FrfSet

CONSTANT = 0.01
"""Scatter of ``1 - coherence`` over the lines, relative to its mean, below which it is no estimate.

Estimates from n averages scatter by 1 / sqrt(n) and more: ten thousand averages have this limit.
"""

_STANDS_OUT = 20.0
"""Power over the geometric mean of the lines around from which on a line stands out by itself, as one with a tone does:
a single value of noise has as much once in 70,000 (its geometric mean is 0.56 of its mean), any estimate from several
less often."""
_FLOOR = 1e-9
"""Smallest noise, relative to the rms of an FRF, that the weights distinguish: about a hundredth of the last digit of
24 bits, so that FRFs from any converter have more and computed ones do not divide by zero. Modes of random systems do
not depend on it."""


@dataclass(frozen=True)
class NoiseLevel:
    """Separable standard deviation of the real (or imaginary) part: ``lines * outputs * references``."""

    lines: Float[np.ndarray, "freq"]
    outputs: Float[np.ndarray, "out"]
    references: Float[np.ndarray, "in"]


def from_variance(variance: Float[np.ndarray, "freq out in"]) -> NoiseLevel:
    """Separable level closest to known complex variances E|n|^2."""
    overall = np.sqrt(0.5 * np.median(variance, axis=0))
    return _separable(np.sqrt(0.5 * variance), overall)


def from_coherence(
    values: Complex[np.ndarray, "freq out in"], coherence: Float[np.ndarray, "freq out in"]
) -> NoiseLevel | None:
    """Level proportional to ``|H| sqrt((1 - c) / c)`` (Bendat and Piersol), each factor pooled over nine lines.

    ``None`` where the coherence says nothing (see ``estimated``).
    """
    known = estimated(coherence)
    if known is None:
        return None
    pooled = scipy.ndimage.uniform_filter1d(known, 9, axis=0, mode="nearest")
    power = scipy.ndimage.uniform_filter1d(np.abs(values) ** 2, 9, axis=0, mode="nearest")
    return from_variance(power * (1 - pooled) / pooled + np.finfo(float).tiny)


def estimated(coherence: Float[np.ndarray, "freq out in"]) -> Float[np.ndarray, "freq out in"] | None:
    """The coherence where it is an estimate, bounded by what it resolves; ``None`` where it says nothing of the noise.

    It says nothing where it is NaN, outside 0 ... 1, 1 everywhere as after a single average, or the same at all lines.
    One that was rounded to two decimals does not tell 0.996 from 1.
    """
    if not np.all(np.isfinite(coherence)) or coherence.max() > 1 + 1e-6 or coherence.min() < 0:
        return None
    if np.median(1 - coherence) < 1e-9 or constant(coherence).any():
        return None
    steps = np.diff(np.unique(coherence[:: max(1, len(coherence) // 400)]))
    resolved = max(0.5 * float(steps.min(initial=1.0)), 1e-9)
    return np.asarray(np.clip(coherence, 1e-3, 1 - resolved))


def constant(coherence: Float[np.ndarray, "freq out in"]) -> Bool[np.ndarray, "out in"]:
    """Where a coherence below 1 is the same at all lines, which none is that was estimated."""
    incoherent = 1 - coherence
    mean = np.mean(incoherent, axis=0)
    return np.asarray((mean > 1e-9) & (np.std(incoherent, axis=0) < CONSTANT * mean)) & (len(coherence) >= 16)


def from_differences(values: Complex[np.ndarray, "freq out in"]) -> NoiseLevel:
    """Level seen in the third differences over neighbouring lines, where a well resolved FRF is smooth.

    Peaks that are narrower than a few lines look like noise; the running median over a fiftieth of the band passes over
    them.
    """
    lines = len(values)
    every = max(1, lines // 400)
    rms = np.sqrt(np.mean(np.abs(values[::every]) ** 2, axis=0))
    if lines < 16:
        return NoiseLevel(np.ones(lines), rms.mean(axis=1), np.ones(rms.shape[1]))
    # Binomial coefficients 1 -3 3 -1: variance 20 times that of the noise. A few hundred places are enough.
    a, b, c, d = (values[k : lines - 3 + k : every] for k in range(4))
    difference = np.abs(d - a - 3 * (c - b)) / np.sqrt(40)
    overall = np.median(difference, axis=0) / 0.83 + _FLOOR * rms
    profile = np.sqrt(np.mean((difference / np.maximum(overall, np.finfo(float).tiny)) ** 2, axis=(1, 2)))
    smooth = scipy.ndimage.median_filter(profile, max(9, len(profile) // 50) | 1, mode="nearest")
    smooth = np.interp(np.arange(lines), 1.5 + every * np.arange(len(profile)), smooth)
    return _separable(np.clip(smooth, 0.05, 20)[:, None, None] * overall, overall)


def _separable(std: Float[np.ndarray, "freq out in"], overall: Float[np.ndarray, "out in"]) -> NoiseLevel:
    """Factors of a standard deviation by ratios to its typical value for each FRF."""
    overall = np.maximum(overall, np.finfo(float).tiny)
    lines = np.sqrt(np.mean((std / overall) ** 2, axis=(1, 2)))
    references = np.exp(np.mean(np.log(overall), axis=0))
    references = references / references.mean()
    outputs = np.exp(np.mean(np.log(overall / references), axis=1))
    return NoiseLevel(np.maximum(lines, 1e-3), outputs, references)


@dataclass(frozen=True)
class Structure:
    """Variance as a function of the size of the FRF (``table``) times a profile over the lines (``lines``), both common
    to all FRFs; each FRF has a level of its own.

    Additive noise has a constant function, noise of the excitation one that grows with the square of the FRF. Thousands
    of values tell it, where the few of one line and one FRF would make bad weights.
    """

    table: Float[np.ndarray, "cell"]
    lines: Float[np.ndarray, "freq"]

    def relative(self, model: Float[np.ndarray, "out in freq"]) -> Float[np.ndarray, "out in freq"]:
        """Variance of FRFs but for their level; ``model`` are the FRFs squared, in any unit."""
        return np.asarray(self.table[_cells(model)] * self.lines)

    def variance(
        self, power: Float[np.ndarray, "out in freq"], model: Float[np.ndarray, "out in freq"]
    ) -> Float[np.ndarray, "out in freq"]:
        """Variance of FRFs with their level from squared residuals ``power``; ``model`` are the FRFs squared."""
        relative = self.relative(model)
        level = np.mean(power / relative, axis=-1, keepdims=True)
        floor = _FLOOR**2 * np.mean(model, axis=-1, keepdims=True) + np.finfo(float).tiny
        return np.asarray(relative * np.maximum(level, floor))


def structure(
    power: Float[np.ndarray, "out in freq"],
    model: Float[np.ndarray, "out in freq"],
    left: Float[np.ndarray, "in freq"] | float = 1.0,
    plain: bool = False,
) -> Structure:
    """Structure behind squared moduli of noise.

    Parameters
    ----------
    power : squared modulus of residuals, or variances from a few averages.
    model : squared modulus of the fitted FRFs.
    left : share of the noise of each line that a residual still holds; the fit has followed the other part.
    plain : no function of the size and a profile within a factor of two: what is fitted badly looks like noise there.
    """
    cells, freedom = _cells(model), np.broadcast_to(left, power.shape)
    table, profile = np.ones(_CELLS), np.ones(power.shape[-1])
    for _ in range(1 if plain else 3):
        # Each is found anew beside the other: what was spared as chance would be taken bit by bit otherwise.
        if not plain:
            ratio = power / Structure(table, profile).variance(power, model)
            table = _by_size(cells, ratio * table[cells], freedom)
        ratio = power / Structure(table, profile).variance(power, model) * profile
        of_lines = np.mean(ratio, axis=(0, 1)) / np.mean(freedom, axis=(0, 1))
        profile = _by_line(of_lines, power[..., 0].size)
    if plain:
        profile = np.clip(profile, np.median(profile) / 4, np.median(profile) * 4)
    return Structure(table, profile)


_CELLS = 120
"""Cells of the size of an FRF over its mean, a quarter of an octave of power (0.75 dB) each, from 20 octaves below to
10 above it; what lies beyond counts for the last cell."""


def _cells(model: Float[np.ndarray, "out in freq"]) -> Int[np.ndarray, "out in freq"]:
    """Size of an FRF over its rms, in steps of 0.75 dB from -60 dB on."""
    size = model / np.maximum(np.mean(model, axis=-1, keepdims=True), np.finfo(float).tiny)
    return np.asarray(np.clip(4 * np.log2(np.maximum(size, 2.0**-20)) + 80, 0, _CELLS - 1).astype(np.intp))


def pooled(
    variance: Float[np.ndarray, "out in freq"], found: Structure, model: Float[np.ndarray, "out in freq"]
) -> Float[np.ndarray, "out in freq"]:
    """Measured variances made fit for weights: what they have beside their structure, pooled over 25 lines.

    A variance from a few averages scatters so much that its inverse would make the weights, not the noise.
    """
    usual = found.variance(variance, model)
    return np.asarray(usual * np.maximum(_smooth(variance / usual, _POOLED), 0.01))


_POOLED = 25
"""Lines over which measured variances are pooled: one from n averages has 2 (n - 1) degrees of freedom, so that of
three averages 25 lines give the variance to 14 %."""


def measured(frfs: FrfSet) -> Float[np.ndarray, "freq out in"] | None:
    """Variance that came with the FRFs, or that their coherence tells; ``None`` where neither says anything.

    A variance that is not positive and finite in single lines takes the median of its FRF. From the coherence it is
    ``|H|^2 (1 - c) / (2 n c)`` (Bendat and Piersol 2010, eq. 9.90 of random data), n averages.
    """
    variance = frfs.variance
    if variance is None and frfs.coherence is not None:
        clipped = estimated(np.asarray(frfs.coherence))
        if clipped is None:
            return None
        averages = 1.0 if frfs.averages is None else np.maximum(frfs.averages, 1)
        # The size of the FRF over a few lines: the coherence of a line scatters together with its FRF.
        power = scipy.ndimage.uniform_filter1d(np.abs(frfs.values) ** 2, 5, axis=0, mode="nearest")
        variance = power * (1 - clipped) / clipped / (2 * averages)
    if variance is None:
        return None
    sound = np.isfinite(variance) & (variance > 0)
    if np.any(np.mean(sound, axis=0) < 0.5):
        return None
    typical = np.nanmedian(np.where(sound, variance, np.nan), axis=0)
    return np.where(sound, variance, typical)


def _by_size(
    cell: Int[np.ndarray, "out in freq"],
    ratio: Float[np.ndarray, "out in freq"],
    freedom: Float[np.ndarray, "out in freq"],
) -> Float[np.ndarray, "cell"]:
    """Mean ratio as a smooth function of the size of the FRF, as far as the ratios tell it from a constant.

    The ratios are exponentially distributed. The logarithm of their mean is a constant, a straight line or a curve over
    the logarithm of the size; each is fitted, and each counts by its evidence (Laplace; MacKay 1992). The lines at the
    peaks hold few ratios, mostly followed by the fit: without evidence they take the noise of all other lines, where an
    extrapolated slope would be off by a multiple.
    """
    number = np.bincount(cell.reshape(-1), freedom.reshape(-1), _CELLS)
    total = np.bincount(cell.reshape(-1), ratio.reshape(-1), _CELLS)
    tried = [_explained(number, total, _CURVES[:, :columns]) for columns in (1, 2, _CELLS)]
    evidence = np.array([found for _, found in tried])
    shares = np.exp(evidence - evidence.max())
    result: np.ndarray = np.exp(np.average([level for level, _ in tried], axis=0, weights=shares))
    return result


def _explained(
    number: Float[np.ndarray, "cell"], total: Float[np.ndarray, "cell"], curves: Float[np.ndarray, "cell coefficient"]
) -> tuple[Float[np.ndarray, "cell"], float]:
    """Most likely logarithm of the mean, and the logarithm of the evidence for such a function.

    The coefficients are standard normal, but for the first, the constant, which is free.
    """
    prior = np.diag(np.append(0.0, np.ones(curves.shape[1] - 1)))
    found = np.zeros(curves.shape[1])
    found[0] = np.log(max(float(total.sum() / number.sum()), np.finfo(float).tiny))
    for _ in range(20):
        observed = total * np.exp(-(curves @ found))
        # Steps by the larger of observed and expected information go towards the optimum from both sides.
        information = (curves.T * np.maximum(observed, number)) @ curves + prior
        step = np.linalg.solve(information, curves.T @ (observed - number) - prior @ found)
        found = found + step
        if np.max(np.abs(curves @ step)) < 1e-3:
            break
    level = curves @ found
    observed = total * np.exp(-level)
    _, size = np.linalg.slogdet((curves.T * observed) @ curves + prior)
    return level, float(-number @ level - observed.sum() - 0.5 * (found @ prior @ found + size))


_SLOPE = 0.25 * np.log(2)
"""Expected slope of the logarithm of a variance, per cell: noise in proportion to the FRF has this one."""
_BEND = 0.01
"""Expected second difference of the logarithm of a variance between cells; from constant to proportional to the square
of the FRF within 20 dB takes 0.007.
"""
_STEPS = np.arange(_CELLS, dtype=float)
_CURVES = np.column_stack(
    [np.ones(_CELLS), _SLOPE * (_STEPS - _STEPS.mean()), _BEND * np.maximum(_STEPS[:, None] - _STEPS[1:-1], 0)]
)
"""Functions of the cell, scaled by what is expected of them: a constant, a straight line, a bend at each inner cell."""


def _by_line(ratio: Float[np.ndarray, "freq"], count: int) -> Float[np.ndarray, "freq"]:
    """Smoothed mean ratio of each line, drawn towards 1 as far as chance explains its scatter."""
    lines = len(ratio)
    window = int(np.clip(400 // count, 1, max(1, lines // 8))) | 1
    smooth = _smooth(ratio, window)
    smooth /= max(smooth.mean(), np.finfo(float).tiny)
    chance = 1 / (count * window)
    share = max(0.0, 1 - 1.5 * chance / max(float(np.var(smooth)), chance))
    return np.asarray(1 + share * (smooth - 1))


def _smooth(ratio: Float[np.ndarray, "*frf freq"], window: int) -> Float[np.ndarray, "*frf freq"]:
    """Mean over a window of lines; a line that stands out by itself stays, and tells nothing of the lines beside it."""
    around = max(window, _POOLED)
    typical = np.exp(_mean(np.log(np.maximum(ratio, np.finfo(float).tiny)), around))
    single = ratio > _STANDS_OUT * typical
    return np.where(single, ratio, _mean(np.where(single, typical, ratio), window))


def _mean(values: Float[np.ndarray, "*frf freq"], window: int) -> Float[np.ndarray, "*frf freq"]:
    return np.asarray(scipy.ndimage.uniform_filter1d(values, window, axis=-1, mode="nearest"))
