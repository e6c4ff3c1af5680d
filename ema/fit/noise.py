"""Noise of FRFs as far as it shapes the weights: one factor per line, per output and per reference."""

from dataclasses import dataclass

import numpy as np
import scipy.ndimage
from jaxtyping import Complex, Float

_FLOOR = 1e-9
"""Smallest noise, relative to the rms of an FRF, that the weights distinguish."""


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

    ``None`` where the coherence says nothing: NaN, outside 0 ... 1, or 1 everywhere as after a single average.
    """
    if not np.all(np.isfinite(coherence)) or coherence.max() > 1 + 1e-6 or coherence.min() < 0:
        return None
    if np.median(1 - coherence) < 1e-9:
        return None
    pooled = scipy.ndimage.uniform_filter1d(np.clip(coherence, 1e-3, 1 - 1e-9), 9, axis=0, mode="nearest")
    power = scipy.ndimage.uniform_filter1d(np.abs(values) ** 2, 9, axis=0, mode="nearest")
    return from_variance(power * (1 - pooled) / pooled + np.finfo(float).tiny)


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
