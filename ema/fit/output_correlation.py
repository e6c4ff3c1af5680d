"""Errors that are not independent from output to output: what acts beside the measured forces moves all of them."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from ema.data import FrfSet
from ema.fit import estimator
from ema.fit.estimator import Fit, Observations
from ema.fit.line_correlation import LineCorrelation, sample
from ema.fit.policy import passes_for_mode
from ema.fit.prepare import Prepared

_LAGS = 20
"""Distances of lines over which products of residuals are averaged: over as many the shape that noise gives the outputs
stays much the same. Fewer make the average less sure, more mix shapes."""
_CHANCE = 5.0
"""Standard deviations of the mean square of the correlations up to which outputs err independently: chance exceeds them
once in 3 million (normal approximation). Beyond, noise counts as that of fewer outputs."""


def mean_square(data: Observations, fit: Fit) -> float:
    """Mean square of the correlations of the residuals of different outputs, 0 where chance explains it.

    Of lines that err independently, products ``|r_l^H r_m|^2`` of the residuals of all outputs have the mean
    ``tr(R^2)`` for outputs with correlations R, whatever shape they have there.
    """
    some = sample(data)
    residual = np.sqrt(data.weights[some, None]) * estimator.residual(data, fit, some)
    rows = residual.reshape(-1, *residual.shape[2:]).transpose(1, 2, 0)
    count, first = rows.shape[2], len(LineCorrelation.of_noise(data, fit).rho)
    lags = range(first, min(first + _LAGS, len(data.s) // 2))
    if count < 2 or not lags:
        return 0.0
    power = np.sum(np.abs(rows) ** 2, axis=2)
    crossed = sum(np.sum(np.abs(np.sum(rows[:, lag:].conj() * rows[:, :-lag], axis=2)) ** 2) for lag in lags)
    powers = sum(np.sum(power[:, lag:] * power[:, :-lag]) for lag in lags)
    excess = (float(crossed / max(float(powers), np.finfo(float).tiny)) - 1 / count) / (1 - 1 / count)
    return excess if excess > _CHANCE / (count * np.sqrt(power.size)) else 0.0


def limit(data: Observations, fit: Fit, passes: Callable[[float], float]) -> float:
    """Energy that a mode fitted to the noise of a residual exceeds with the probability of ``passes`` (of its degrees
    of freedom), over the variance factor.

    Where outputs correlate, noise is that of fewer outputs, each of which counts several times (Satterthwaite 1946).
    """
    fewer = data.outputs / (1 + (data.outputs - 1) * mean_square(data, fit))
    return passes(2 * (fewer + data.references)) * data.outputs / fewer


def limit_for_mode(data: Observations, fit: Fit) -> float:
    """Energy, over the variance factor, that noise passes for a mode with (`ema.fit.policy.passes_for_mode`)."""
    return limit(data, fit, lambda freedom: passes_for_mode(freedom, len(data.s)))


def factor(
    flat: Observations, fit: Fit, correlation: Float[np.ndarray, "in freq"] | None, outputs: int
) -> Float[np.ndarray, "mode"]:
    """Variance of each pole over that for outputs that err independently, at least 1.

    Near a resonance the structure answers to all that acts on it in the shape of the mode, and many outputs tell no
    more of its pole than one. A line and reference adds to the variance of a pole what it adds to its information,
    times ``1 + (n - 1) r`` (sandwich variance, Liang and Zeger 1986), where n is the number of outputs of one
    signal-to-noise ratio and r the correlation of their errors.

    Parameters
    ----------
    correlation : correlation of the errors of outputs (`of_references`); ``None`` where it is not known.
    outputs : number of all outputs, of which ``flat`` and ``fit`` may have some.
    """
    if correlation is None or not len(fit.poles):
        return np.ones(len(fit.poles))
    shapes = np.abs(fit.shapes[:, 0]) ** 2
    by_output = flat.weights[..., None] * shapes[:, None, None, :]
    information = np.sum(by_output, axis=0)
    number = information**2 / np.maximum(np.sum(by_output**2, axis=0), np.finfo(float).tiny) * outputs / flat.outputs
    information = information * np.abs(flat.s[:, None] - fit.poles) ** -4 * np.abs(fit.participation[:, None, :]) ** 2
    together = 1 + (number - 1) * correlation[:, :, None]
    return np.asarray(np.maximum(np.sum(information * together, axis=(0, 1)) / np.sum(information, axis=(0, 1)), 1))


def of_references(
    band: FrfSet, data: Prepared, flat: Observations, known: Float[np.ndarray, "out in freq"] | None
) -> Float[np.ndarray, "in freq"] | None:
    """Correlation of the errors of outputs, for the references of a fit on all outputs and the weights of ``flat``.

    Where these allow for more than the ``known`` variance, the rest is a misfit, which is the same in each measurement.
    """
    if band.output_correlation is None or data.swapped:
        return None
    correlation = band.output_correlation[-len(flat.s) :, data.columns].T
    if known is None:
        return correlation
    noise = known * flat.weights / (2 * np.abs(flat.s) ** (2 * data.derivative))
    return np.asarray(correlation * np.minimum(np.mean(noise, axis=0), 1))
