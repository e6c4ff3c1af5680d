"""What the parts of a test with random excitation add to its averaged FRFs."""

import dataclasses

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Deviations
from ema.estimate import spectra
from ema.estimate.spectra import Spectra

AVERAGES = 33.0
"""Averages, over all pooled lines, from which the variance of a line is computed: those of three impacts over
`ema.estimate.spectra.POOLED_LINES`. What the ends of blocks leave is as narrow as a peak."""


def pooled_lines(averages: float) -> int:
    """Odd number of lines over which the noise of so many averages is pooled."""
    half = int(np.ceil((AVERAGES / max(averages, 1.0) - 1) / 2))
    return min(2 * max(half, 0) + 1, spectra.POOLED_LINES)


def deviations(found: Spectra) -> Deviations | None:
    """Deviations of H1 by the parts of the spectra; ``None`` where there are none.

    The part with spectra U_i, C_i changes H1 = C / U by (C_i - H U_i) / U. Overlapping blocks of neighbouring parts are
    not independent, so that the variance of the mean is more than the sum of the squares: by what Welch's (1967) number
    of averages gives for white noise.
    """
    if len(found.parts) < 2:
        return None
    values = spectra.frf(found)
    power = np.maximum(spectra.input_power(found), np.finfo(float).tiny)
    changes = np.empty((len(found.parts), *values.shape), np.complex64)
    apart = 0.0
    for change, part in zip(changes, found.parts, strict=True):
        left = dataclasses.replace(found, cross=part.cross - values @ part.inputs)
        share = spectra.input_power(part) / power
        change[...] = spectra.frf(left) / np.sqrt(1 - np.minimum(share, 1 - 1e-9))[:, None, :]
        apart += float(np.mean(share)) ** 2 / part.averages
    changes *= np.sqrt(1 / (found.averages * apart))
    numbers = np.broadcast_to(np.arange(len(changes))[:, None, None], (len(changes), *values.shape[1:]))
    return Deviations(changes, numbers)


def output_correlation(values: Complex[np.ndarray, "freq out in"], changes: Deviations) -> Float[np.ndarray, "freq in"]:
    """Correlation of the errors of outputs along the FRFs of each input, by the deviations of the parts.

    The variance of the combination of the outputs that determines a pole, sum g* d / v, over that for independent
    errors, sum |g|^2 / v, is 1 + (n - 1) r for n outputs of one signal-to-noise ratio.
    """
    tiny = np.finfo(float).tiny
    variance = np.maximum(np.sum(np.abs(changes.values) ** 2, axis=0, dtype=float), tiny)
    weighted = values.conj() / variance
    together = np.sum([np.abs(np.sum(weighted * change, axis=1)) ** 2 for change in changes.values], axis=0)
    ratio = np.abs(values) ** 2 / variance
    independent = np.sum(ratio, axis=1)
    outputs = independent**2 / np.maximum(np.sum(ratio**2, axis=1), tiny)
    several = outputs > 1 + 1e-6
    excess = together / np.maximum(independent, tiny) - 1
    return np.where(several, excess / np.where(several, outputs - 1, 1.0), 0.0)
