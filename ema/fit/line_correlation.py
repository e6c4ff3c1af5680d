"""Errors that are not independent from line to line: windows, local models and zero padding make them so."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ema.fit import estimator
from ema.fit.compression import SAMPLE
from ema.fit.estimator import Fit, Observations

_LONGEST = 60
"""Lines over which errors of FRFs are followed: local models and windows correlate a few tens of them. It ends earlier
where the correlation falls below chance, and correlation beyond it counts as none."""
_CHANCE = 2.5
"""Autocorrelation times the root of the number of values up to which a residual is taken for white: 3.5 standard
deviations (Bartlett 1946, of real parts), once in 4000."""
_PARTS = 8
"""Parts of the band of which the median counts: with modes missing in three of them it lies among the other five."""
_LINES_OF_PART = 50
"""Lines of such a part at least: the autocorrelation of one FRF scatters by a tenth there (Bartlett 1946)."""


@dataclass(frozen=True)
class LineCorrelation:
    """How the residual of a fit correlates over lines.

    ``rho`` (lag,) is its autocorrelation, 1 at lag 0, up to where it is lost in chance: of length 1 where the lines are
    independent. ``whole`` (lag,) is the complex one, of which ``rho`` is the real part: where zeros were appended, it
    is imaginary at lag 1. ``s`` (line,) and ``weight`` (line,) are the lines and the root mean square of their weights.
    """

    rho: Float[np.ndarray, "lag"]
    whole: Complex[np.ndarray, "complex_lag"]
    s: Complex[np.ndarray, "line"]
    weight: Float[np.ndarray, "line"]

    @classmethod
    def of(cls, data: Observations, fit: Fit) -> "LineCorrelation":
        """That of a residual, from as many rows of the observations as stand for all."""
        residual, weight = _weighted(data, fit)
        chance = _CHANCE / np.sqrt(residual.size)
        whole = _complex(residual, chance)
        return cls(_before_chance(autocorrelation(residual, chance), chance), whole, data.s, weight)

    @classmethod
    def of_noise(cls, data: Observations, fit: Fit) -> "LineCorrelation":
        """That of the noise in a residual: the median over parts of the band, for a mode that the fit has not makes
        the residual correlate as well, but only where it is.
        """
        residual, weight = _weighted(data, fit)
        chance = _CHANCE / np.sqrt(residual.size)
        parts = np.array_split(residual, min(_PARTS, max(1, residual.shape[1] // _LINES_OF_PART)), axis=1)
        found = [autocorrelation(part) for part in parts]
        lags = min(len(rho) for rho in found)
        rho = _before_chance(np.median([rho[:lags] for rho in found], axis=0), chance)
        return cls(rho, rho.astype(complex), data.s, weight)

    def factor(self, poles: Complex[np.ndarray, "pole"], power: int = 1) -> Float[np.ndarray, "pole"]:
        """Energy that noise has along ``1 / (s - p)^power`` over that of noise independent from line to line.

        It is ``sum_l rho(l) c(l)`` with the autocorrelations of the noise and of the function, each 1 at lag 0: the
        variance of a residue (``power`` 1) or of a pole (2) over that for independent lines, and what noise takes off
        the cost of a fit when a mode there is fitted to it.
        """
        lags = len(self.rho)
        if lags < 2 or not len(poles):
            return np.ones(len(poles))
        functions = self.weight / (self.s - poles[:, None]) ** power
        reach = np.stack([autocorrelation(row[None])[1:lags] for row in functions])
        return np.asarray(np.maximum(1, 1 + 2 * reach @ self.rho[1 : 1 + reach.shape[1]]))

    def of_shared(self, poles: Complex[np.ndarray, "pole"]) -> Float[np.ndarray, "pole"]:
        """`factor` of the poles (``power`` 2) for noise that all FRFs share, with the imaginary part of its
        autocorrelation: what errors of lines one after the other do to a pole.
        """
        lags = len(self.whole)
        if lags < 2 or not len(poles):
            return np.ones(len(poles))
        functions = self.weight / (self.s - poles[:, None]) ** 2
        reach = np.stack([_complex(row[None], length=lags) for row in functions])
        return np.asarray(np.maximum(1, 1 + 2 * (reach.conj() @ self.whole[: reach.shape[1]] - 1).real))


def _weighted(data: Observations, fit: Fit) -> tuple[Complex[np.ndarray, "row line"], Float[np.ndarray, "line"]]:
    """Residuals of the rows that stand for all, over their noise, and the root mean square of the weights."""
    some = sample(data)
    weights = data.weights[some]
    residual = np.sqrt(weights[:, None]) * estimator.residual(data, fit, some)
    return residual.reshape(-1, len(data.s)), np.sqrt(np.mean(weights, axis=(0, 1)))


def _before_chance(rho: Float[np.ndarray, "lag"], chance: float) -> Float[np.ndarray, "kept"]:
    """The lags before the first that white noise explains."""
    return rho[: max(1, int(np.argmax(np.append(rho, 0.0) < chance)))]


def sample(data: Observations) -> slice:
    """Rows that stand for all."""
    return slice(None, None, max(1, data.signals.size // SAMPLE))


def _complex(
    signals: Complex[np.ndarray, "row line"], least: float = 0.0, length: int = _LONGEST
) -> Complex[np.ndarray, "lag"]:
    """The autocorrelation of rows, pooled: the mean of a value times the conjugate of the one before, from lag 0 to
    where its magnitude falls below ``least`` twice. Appended zeros make it 0 at single lags.
    """
    count = signals.shape[1]
    energy = max(float(np.vdot(signals, signals).real), np.finfo(float).tiny)
    found, below = [1.0 + 0j], 0
    while len(found) < min(length, count // 4) and below < 2:
        lag = len(found)
        found.append(complex(np.vdot(signals[:, : count - lag], signals[:, lag:])) / energy)
        below = below + 1 if abs(found[-1]) < least else 0
    return np.array(found[: len(found) - below])


def autocorrelation(signals: Complex[np.ndarray, "row line"], least: float = -np.inf) -> Float[np.ndarray, "lag"]:
    """Real part of the autocorrelation of rows, pooled, from lag 0 to where it falls below ``least``."""
    count = signals.shape[1]
    energy = max(float(np.vdot(signals, signals).real), np.finfo(float).tiny)
    found = [1.0]
    while len(found) < min(_LONGEST, count // 4) and found[-1] >= least:
        lag = len(found)
        found.append(float(np.vdot(signals[:, : count - lag], signals[:, lag:]).real) / energy)
    return np.array(found)
