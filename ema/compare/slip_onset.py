"""Limit of small amplitudes of a mode, and the amplitude at which a joint begins to slip."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data import Band
from ema.data.modal import COVERAGE_FACTOR

EXPONENTS = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
"""Powers of the distance from the onset with which damping and frequency may change: a Masing joint has 1 for the
damping and 3/2 for the frequency (Caughey 1960), distributed sliders have more."""
EXCLUDED = 3.84
"""Change of the misfit at which an onset is excluded, chi square with one degree of freedom, 95 %."""
SEEN = 13.3
"""The same for no slip at all, with four degrees of freedom, 99 %: two slopes and two exponents."""
_CLEAR = 3.0
"""Distance of the largest damping from the mean, over its standard deviation, from which on it is a maximum."""
_STEPS = 60
"""Amplitudes at which an onset is looked for, evenly spaced in the logarithm, and none."""
_FEWEST = 5
"""Levels from which on an onset is looked for."""


@dataclass(frozen=True)
class Onset:
    """Where a mode begins to depend on its amplitude.

    Parameters
    ----------
    frequency, damping : Band
        Natural frequency [Hz] and damping ratio in the limit of small amplitudes, without shape.
    amplitude : Band
        Amplitude at which slip begins, without shape, in the unit of the mode. The lower bound is 0 where a law that
        slips at every amplitude agrees with the data; where no slip is seen the value is NaN and the bounds are 0 and
        infinite.

    Examples
    --------
    >>> amplitude = np.geomspace(0.1, 2.0, 20)
    >>> over = np.maximum(amplitude - 1, 0)
    >>> found = slip_onset(amplitude, 100 - over**1.5, np.full(20, 0.01), 0.01 + 0.01 * over, np.full(20, 1e-4))
    >>> bool(found.amplitude.low < 1.0 < found.amplitude.high)
    True
    """

    frequency: Band
    damping: Band
    amplitude: Band

    @property
    def seen(self) -> bool:
        """Whether the mode depends on its amplitude."""
        return bool(np.isfinite(self.amplitude.value))


def slip_onset(
    amplitude: Float[np.ndarray, "level"],
    frequency: Float[np.ndarray, "level"],
    frequency_std: Float[np.ndarray, "level"],
    damping: Float[np.ndarray, "level"],
    damping_std: Float[np.ndarray, "level"],
) -> Onset:
    """Fit frequency and damping by constants that change from an onset on, with profiles of the misfit as intervals.

    Only levels up to the largest damping are used: beyond it a joint slides more than it begins to slip.

    Parameters
    ----------
    amplitude, frequency, frequency_std, damping, damping_std : array of shape (level,)
        Amplitudes, lowest first, with natural frequency [Hz], damping ratio and their standard deviations.

    Returns
    -------
    Onset
        Limits of small amplitudes, and the onset.

    Examples
    --------
    >>> level = np.geomspace(0.1, 2.0, 20)
    >>> ones = np.ones(20)
    >>> slip_onset(level, 100 * ones, 0.01 * ones, 0.01 * ones, 1e-4 * ones).seen
    False
    """
    sure = damping - _CLEAR * damping_std
    top = int(np.argmax(sure)) + 1
    if sure[top - 1] <= _line(np.zeros((len(damping), 0)), damping, damping_std)[1]:
        top = len(amplitude)
    rising = slice(0, max(top, min(_FEWEST, len(amplitude))))
    a = amplitude[rising]
    curves = ((frequency[rising], frequency_std[rising]), (damping[rising], damping_std[rising]))
    flat = [_line(np.zeros((len(y), 0)), y, std) for y, std in curves]
    grid = np.concatenate([[0.0], np.geomspace(a[0], a[-1], _STEPS)[:-1]])
    profile = np.array([[_best(a, onset, y, std) for y, std in curves] for onset in grid])
    misfit = profile[:, :, 0].sum(axis=1)
    inside = misfit <= misfit.min() + EXCLUDED
    best = int(np.argmin(misfit))
    limits = [_spread(profile[inside, row], profile[best, row]) for row in (0, 1)]
    if len(a) < _FEWEST or sum(one[0] for one in flat) - misfit.min() < SEEN:
        limits = [_spread(profile[inside, row], np.array(flat[row])) for row in (0, 1)]
        return Onset(limits[0], limits[1], Band(np.array(0.0), np.array(np.nan), np.array(np.inf)))
    first, last = np.flatnonzero(inside)[[0, -1]]
    ends = np.append(grid, a[-1])
    at = Band(np.array(ends[max(first - 1, 0)]), np.array(ends[best]), np.array(ends[last + 1]))
    return Onset(limits[0], limits[1], at)


def _best(
    a: Float[np.ndarray, "level"], onset: float, y: Float[np.ndarray, "level"], std: Float[np.ndarray, "level"]
) -> tuple[float, float, float]:
    """Least misfit over the exponents, with the constant below the onset and its standard deviation."""
    over = np.maximum(a - onset, 0.0) / a[-1]
    return min(_line(over[:, None] ** power, y, std) for power in EXPONENTS)


def _line(
    columns: Float[np.ndarray, "level column"], y: Float[np.ndarray, "level"], std: Float[np.ndarray, "level"]
) -> tuple[float, float, float]:
    """Misfit, constant and its standard deviation of weighted least squares on a constant and ``columns``."""
    x = np.column_stack([np.ones(len(y)), columns]) / std[:, None]
    inverse = np.linalg.pinv(x.T @ x)
    value = inverse @ (x.T @ (y / std))
    return float(np.sum((y / std - x @ value) ** 2)), float(value[0]), float(np.sqrt(max(inverse[0, 0], 0.0)))


def _spread(accepted: Float[np.ndarray, "onset 3"], best: Float[np.ndarray, "3"]) -> Band:
    """The constant with what the onsets that are not excluded say of it."""
    reach = COVERAGE_FACTOR * accepted[:, 2]
    low, high = np.min(accepted[:, 1] - reach), np.max(accepted[:, 1] + reach)
    return Band(np.array(min(low, best[1])), np.array(best[1]), np.array(max(high, best[1])))
