"""Averages over neighbouring frequency lines, recognised by the noise that they leave in FRFs.

An average with weights w makes the noise of lines correlate as w correlates with itself. Differences of the order p
between lines take away what is smooth over a few of them, the FRF, and leave noise that correlates as the convolution
of w with the binomial coefficients does: an average over n lines has a spike at lag n, for its own differences are
those between lines that are n apart. Polarities are correlated (arcsine law, Van Vleck and Middleton 1966), so that the
few lines on which a narrow peak is left do not count for more than others.

What this shows of the noise does not hold of the resonances for certain: a local polynomial over lines (Savitzky and
Golay 1964) leaves noise with the same sharp edges, and resonances as they are.
"""

from dataclasses import replace
from itertools import chain

import numpy as np
import scipy.ndimage
import scipy.special
from jaxtyping import Complex, Float

from ema.data import FrfSet
from ema.fit import noise
from ema.fit.compression import SAMPLE

_ORDER = 6
"""Order of the differences: of peaks five lines wide, 40 dB above the noise, nothing is left three lines away."""
_WIDEST = 25
"""Lines of the widest average that is looked for: peaks of separate modes are narrower in any FRF that shows them."""
_LAGS = 60
"""Lags of the correlation that are compared: twice as many as the widest average and its differences have."""
_FEWEST = 2000
"""Real and imaginary parts from which on the correlation is taken: each lag scatters by 0.035 then."""
_DEVIATION = 0.15
"""Largest deviation of a correlation from that of an average that is taken for one. In FRFs averaged over 3 to 15 lines
it was 0.04 to 0.13 (801 lines, 6 responses, 3 to 20 lines across a peak); Hann blocks, windows, zero padding and FRFs
of no average deviate from all of these by 0.2 or more, or are closer to independent lines, but for the flat-top window
(0.05 to 0.09 from an average of three), which second differences tell from it. Local models over lines whose edges are
as sharp are not distinguished from an average by their noise."""
_CLEARLY = 0.75
"""Deviation from an average over that from the next best one up to which it is the one: 0.24 to 0.68 in those FRFs."""


def _binomial() -> Float[np.ndarray, "coefficient"]:
    return np.asarray(scipy.special.binom(_ORDER, np.arange(_ORDER + 1)) * (-1.0) ** np.arange(_ORDER + 1))


def _averages() -> dict[tuple[float, ...], Float[np.ndarray, "lag"]]:
    """Symmetric averages, and how the differences of what they leave of noise correlate: none, equal weights, and equal
    weights twice, of which the narrowest is 1/4, 1/2, 1/4.
    """
    equal = {lines: np.full(lines, 1 / lines) for lines in range(1, _WIDEST + 1)}
    twice = (np.convolve(equal[lines], equal[lines]) for lines in range(2, (_WIDEST + 1) // 2 + 1))
    result = {}
    for weights in chain((equal[lines] for lines in range(1, _WIDEST + 1, 2)), twice):
        left = np.convolve(weights, _binomial())
        correlation = np.correlate(left, left, "full")[len(left) - 1 :]
        padded = np.zeros(_LAGS + 1)
        padded[: len(correlation)] = correlation / correlation[0]
        result[tuple(weights.tolist())] = padded
    return result


_AVERAGES = _averages()


def weights(frfs: FrfSet) -> tuple[float, ...] | None:
    """Weights of the average over lines that FRFs are, of sum 1; ``None`` where the noise shows none.

    FRFs of which it is known how their lines came about are not looked at.
    """
    step = np.diff(frfs.frequencies)
    even = len(step) > _LAGS and np.ptp(step) < 1e-3 * step.mean()
    if frfs.window or frfs.lines_correlate or frfs.added_decay or frfs.in_file or not even:
        return None
    rows = frfs.values.reshape(len(frfs.frequencies), -1).T
    rows = rows[:: max(1, rows.size // SAMPLE)]
    rows = rows[np.all(np.isfinite(rows), axis=1) & np.any(rows != 0, axis=1)]
    if 2 * rows.size < _FEWEST:
        return None
    found = _polarity_correlation(np.diff(rows, _ORDER, axis=1))
    deviations = {one: float(np.max(np.abs(found - expected[: len(found)]))) for one, expected in _AVERAGES.items()}
    best, second = sorted(deviations, key=lambda key: deviations[key])[:2]
    clear = deviations[best] < min(_DEVIATION, _CLEARLY * deviations[second])
    if not clear or len(best) == 1:
        return None
    # High orders see only the middle of the record. Under a window most noise is there, under an average least of it:
    # its second differences correlate less than those of a window. What is left of the FRF adds to the correlation.
    left = np.convolve(best, [1.0, -2.0, 1.0])
    expected = float(left[1:] @ left[:-1]) / float(left @ left)
    return best if _polarity_correlation(np.diff(rows, 2, axis=1))[1].real > expected - _DEVIATION else None


def _polarity_correlation(rows: Complex[np.ndarray, "row line"]) -> Complex[np.ndarray, "lag"]:
    """Autocorrelation of normal noise from the signs of its real and imaginary parts."""
    count = rows.shape[1]
    lags = min(_LAGS, count // 4)
    signs = np.sign(rows.real) + 1j * np.sign(rows.imag)
    power = np.abs(np.fft.fft(signs, 2 * count, axis=1)) ** 2
    sums = np.fft.ifft(power.sum(axis=0))[: lags + 1]
    mean = sums / (2 * len(rows) * (count - np.arange(lags + 1)))
    return np.asarray(np.sin(np.pi / 2 * mean.real) + 1j * np.sin(np.pi / 2 * mean.imag))


def marked(frfs: FrfSet, weights: tuple[float, ...]) -> FrfSet:
    """FRFs that say that their lines were averaged, with the variance of their noise where they have none."""
    w = np.array(weights)
    lines = np.full(len(frfs.frequencies), 1 / float(w @ w))
    if frfs.variance is not None or frfs.coherence is not None:
        return replace(frfs, effective_lines=lines)
    left = np.convolve(w, _binomial())
    values = np.asarray(frfs.values).transpose(1, 2, 0)
    differences = np.abs(np.diff(values, _ORDER, axis=-1)) ** 2 * float(w @ w) / float(left @ left)
    power = np.pad(differences, ((0, 0), (0, 0), (_ORDER // 2, _ORDER - _ORDER // 2)), mode="edge")
    # A profile over the lines alone would miss noise that grows with the FRF at the peaks, where it counts.
    size = scipy.ndimage.uniform_filter1d(np.abs(values) ** 2, _ORDER + 1, axis=-1, mode="nearest")
    variance = noise.structure(power, size).variance(power, size)
    return replace(frfs, effective_lines=lines, variance=variance.transpose(2, 0, 1))
