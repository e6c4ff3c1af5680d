"""Forces over time as test benches make them: blows, sweeps, steps of sine."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from ema.errors import InputError


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
    """Half a sine of height ``peak`` N from ``start`` to ``start + contact_time`` s, else zero.

    Raises
    ------
    InputError : the contact time is not positive.
    """
    _positive("contact_time", contact_time)
    phase = np.clip((times - start) / contact_time, 0.0, 1.0)
    return np.asarray(peak * np.sin(np.pi * phase))


def swept_sine(
    times: Float[np.ndarray, "sample"], level: float, band: tuple[float, float], sweep_time: float, sweeps: int = 1
) -> Float[np.ndarray, "sample"]:
    """Sine of amplitude ``level`` N whose frequency runs linearly through ``band`` Hz in ``sweep_time`` s.

    It is repeated ``sweeps`` times without a pause (a periodic chirp), and zero afterwards; a downward sweep has the
    higher frequency first.

    Raises
    ------
    InputError : a time or a frequency is not positive.
    """
    _positive("sweep_time", sweep_time)
    _positive("frequencies", min(band))
    low, high = band
    t = np.mod(times, sweep_time)
    phase = 2 * np.pi * (low * t + (high - low) / (2 * sweep_time) * t**2)
    return np.asarray(np.where((times >= 0) & (times < sweeps * sweep_time), level * np.sin(phase), 0.0))


def stepped_sine(
    times: Float[np.ndarray, "sample"], level: float, frequencies: Sequence[float] | Float[np.ndarray, "step"],
    dwell: float,
) -> Float[np.ndarray, "sample"]:  # fmt: skip
    """Sine of amplitude ``level`` N that stays at each of ``frequencies`` Hz for ``dwell`` s, without a jump of phase.

    Raises
    ------
    InputError : the dwell or a frequency is not positive.
    """
    _positive("dwell", dwell)
    steps = np.asarray(frequencies, dtype=np.float64)
    _positive("frequencies", float(steps.min(initial=np.inf)))
    number = np.floor(times / dwell).astype(int)
    inside = (times >= 0) & (number < len(steps))
    place = np.where(inside, number, 0)
    begun = np.concatenate([[0.0], np.cumsum(steps * dwell)])
    cycles = begun[place] + steps[place] * (times - place * dwell)
    return np.asarray(np.where(inside, level * np.sin(2 * np.pi * cycles), 0.0))


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise InputError("not a positive number", where="excitation", got=f"{name} = {value}", expected="above 0")
