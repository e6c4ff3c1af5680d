"""Forces over time as test benches make them: impacts, sweeps, steps of sine."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from ema.errors import InputError
from ema.simulate.checks import finite, positive

_WHERE = "excitation"


def half_sine(
    frequencies: Float[np.ndarray, "freq"], contact_time: float, start: float = 0.0
) -> Complex[np.ndarray, "freq"]:
    """Fourier transform (in s) of half a sine of height 1 from ``start`` to ``start + contact_time`` s; Hz."""
    x = np.pi * frequencies * contact_time
    # cos(x) / ((pi/2)^2 - x^2) written with a sinc, which has no hole at x = pi/2
    even = (np.pi * contact_time / 2) * np.sinc(0.5 - x / np.pi) / (np.pi / 2 + x)
    return even * np.exp(-2j * np.pi * (start + contact_time / 2) * frequencies)


def hammer_pulse(
    times: Float[np.ndarray, "sample"], peak: float, contact_time: float, start: float = 0.0
) -> Float[np.ndarray, "sample"]:
    """Return half a sine.

    Parameters
    ----------
    times : array of shape (sample,)
        Times [s].
    peak : float
        Height [N].
    contact_time : float
        Length [s].
    start : float, default 0.0
        Beginning [s].

    Returns
    -------
    array of shape (sample,)
        Force [N], zero outside the pulse.

    Raises
    ------
    InputError
        If the contact time is not positive, or the peak or the start is no number.

    Examples
    --------
    >>> hammer_pulse(np.array([0.0, 0.001, 0.01]), peak=100.0, contact_time=0.002).round(9)
    array([  0., 100.,   0.])
    """
    positive(_WHERE, contact_time=contact_time)
    finite(_WHERE, peak=peak, start=start)
    phase = np.clip((times - start) / contact_time, 0.0, 1.0)
    return np.asarray(peak * np.sin(np.pi * phase))


def swept_sine(
    times: Float[np.ndarray, "sample"], level: float, band: tuple[float, float], sweep_time: float, sweeps: int = 1
) -> Float[np.ndarray, "sample"]:
    """Return a sine whose frequency runs linearly through a band.

    Parameters
    ----------
    times : array of shape (sample,)
        Times [s].
    level : float
        Amplitude [N].
    band : tuple of (float, float)
        First and last frequency [Hz]; a downward sweep has the higher one first.
    sweep_time : float
        Time of one sweep [s].
    sweeps : int, default 1
        Number of sweeps, without a pause (a periodic chirp).

    Returns
    -------
    array of shape (sample,)
        Force [N], zero after the last sweep.

    Raises
    ------
    InputError
        If a time, a frequency or the number of sweeps is not positive, or the level is no number.

    Examples
    --------
    >>> swept_sine(np.array([0.0, 9.0]), level=5.0, band=(20.0, 60.0), sweep_time=8.0)
    array([0., 0.])
    """
    low, high = band
    positive(_WHERE, sweep_time=sweep_time, start_frequency=low, end_frequency=high, sweeps=sweeps)
    finite(_WHERE, level=level)
    t = np.mod(times, sweep_time)
    phase = 2 * np.pi * (low * t + (high - low) / (2 * sweep_time) * t**2)
    return np.asarray(np.where((times >= 0) & (times < sweeps * sweep_time), level * np.sin(phase), 0.0))


def stepped_sine(
    times: Float[np.ndarray, "sample"],
    level: float,
    frequencies: Sequence[float] | Float[np.ndarray, "step"],
    dwell: float,
) -> Float[np.ndarray, "sample"]:
    """Return a sine that stays at each of some frequencies, without a jump of phase.

    Parameters
    ----------
    times : array of shape (sample,)
        Times [s].
    level : float
        Amplitude [N].
    frequencies : sequence of float or array of shape (step,)
        Frequencies [Hz].
    dwell : float
        Time at each frequency [s].

    Returns
    -------
    array of shape (sample,)
        Force [N], zero after the last frequency.

    Raises
    ------
    InputError
        If the dwell or a frequency is not positive, there is no frequency, or the level is no number.

    Examples
    --------
    >>> stepped_sine(np.array([0.0, 0.025, 5.0]), level=5.0, frequencies=[10.0], dwell=1.0).round(6)
    array([0., 5., 0.])
    """
    positive(_WHERE, dwell=dwell)
    finite(_WHERE, level=level)
    steps = np.asarray(frequencies, dtype=np.float64)
    if not len(steps):
        raise InputError("no frequency to stay at", where=_WHERE, got="0 frequencies", expected="one or more, in Hz")
    positive(_WHERE, frequencies=float(steps.min()))
    number = np.floor(times / dwell).astype(int)
    inside = (times >= 0) & (number < len(steps))
    place = np.where(inside, number, 0)
    begun = np.concatenate([[0.0], np.cumsum(steps * dwell)])
    cycles = begun[place] + steps[place] * (times - place * dwell)
    return np.asarray(np.where(inside, level * np.sin(2 * np.pi * cycles), 0.0))
