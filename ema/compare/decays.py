"""A simulated free decay against a measured one: in time, in the spectrum, and what damping the model lacks."""

import numpy as np
import scipy.fft
import scipy.signal
from jaxtyping import Float

from ema.data import Recording
from ema.data.comparison import SignalComparison, Verdict
from ema.errors import InputError
from ema.estimate.integrate import to_quantity
from ema.units import Quantity

GOOD = 0.15
"""Envelope error up to which a simulated decay agrees."""
SAME_PEAK = 0.01
"""Relative difference of the frequencies of two decays up to which they agree."""


HIGH_PASS = 15.0
"""Part of the lower end of the band that is the corner of the high-pass of the integration: a fifteenth of the lowest
frequency of interest leaves an error of 2 to 5 % rms in the first second of a release (`integrated`)."""
REST = 0.95
"""Part of the rest before a release whose mean is the offset, so that the anti-alias filter does not reach into it."""


def releases(
    measured: Recording, simulated: Recording, band: tuple[float, float], start: float = 0.0
) -> SignalComparison:
    """Compare the velocities of two records of one release; accelerations are integrated.

    Parameters
    ----------
    measured, simulated : Recording
        One response each, velocity or acceleration, or both displacement.
    band : tuple of (float, float)
        Ends of a band that holds the mode in all its phases [Hz].
    start : float, default 0.0
        Rest before the release [s], in both.

    Returns
    -------
    SignalComparison
        Differences of signals, envelopes, frequencies and damping, and whether the model agrees.

    Raises
    ------
    InputError
        If there are several responses, other sampling rates, no quantity in common, and as :func:`signals`.

    Examples
    --------
    >>> import numpy as np
    >>> from ema.data import Channel, Recording
    >>> t = np.arange(32768) / 4096
    >>> ringing = [np.exp(-rate * t) * np.cos(2 * np.pi * 40 * t) for rate in (1.0, 0.5)]
    >>> tip = (Channel("tip", quantity="velocity", unit="m/s"),)
    >>> one, two = (Recording(x[None], 4096.0, tip) for x in ringing)
    >>> round(100 * releases(one, two, (20.0, 80.0)).missing_damping, 3)  # 0.5 / (2 pi 40) in percent
    0.199
    """
    rows = [record.with_role("response") for record in (measured, simulated)]
    if any(len(found) != 1 for found in rows) or measured.sampling_rate != simulated.sampling_rate:
        raise InputError(
            "not two records of one motion",
            where=f"{measured.name} and {simulated.name}",
            got=f"{len(rows[0])} and {len(rows[1])} responses, {measured.sampling_rate:g} and "
            f"{simulated.sampling_rate:g} Hz",
            expected="one response each, the same sampling rate",
        )
    both = (measured, simulated)
    quantities = {record.channels[row[0]].quantity for record, row in zip(both, rows)}
    common: Quantity = "displacement" if "displacement" in quantities else "velocity"
    rest = max(int(REST * start * measured.sampling_rate), 1)
    alike = [to_quantity(record, common, band[0] / HIGH_PASS, rest) for record in both]
    first, last = round(start * measured.sampling_rate), min(record.signals.shape[1] for record in alike)
    moved = [np.asarray(record.signals[row[0], first:last], dtype=np.float64) for record, row in zip(alike, rows)]
    return signals(moved[0], moved[1], measured.sampling_rate, band)


def signals(
    measured: Float[np.ndarray, "sample"],
    simulated: Float[np.ndarray, "simulated_sample"],
    sampling_rate: float,
    band: tuple[float, float],
) -> SignalComparison:
    """Compare two signals of one release or impact, aligned at their first sample, in a band that holds one mode.

    The missing damping is the slope of the logarithm of the ratio of the envelopes, over the part in which both stand
    above a fiftieth of their start: the exponential decay by material and air that a model with friction alone lacks.

    Parameters
    ----------
    measured : array of shape (sample,)
        Velocity, or any one quantity in both signals.
    simulated : array of shape (simulated_sample,)
        The same of the model, as many samples.
    sampling_rate : float
        Sampling rate [Hz].
    band : tuple of (float, float)
        Ends of the band [Hz].

    Returns
    -------
    SignalComparison
        Differences of signals, envelopes, frequencies and damping, and whether the model agrees.

    Raises
    ------
    InputError
        If the lengths differ, a value is not finite, a signal is zero, the band is outside 0 ... half the sampling
        rate, or the record is shorter than ten periods.

    Examples
    --------
    >>> t = np.arange(4096) / 1024.0
    >>> omega = 2 * np.pi * 40.0
    >>> measured, simulated = (np.exp(-zeta * omega * t) * np.cos(omega * t) for zeta in (0.01, 0.008))
    >>> round(signals(measured, simulated, 1024.0, band=(30.0, 50.0)).missing_damping, 4)
    0.002
    """
    if measured.shape != simulated.shape:
        raise InputError(
            "signals of different lengths",
            where="comparison",
            got=f"{len(measured)} and {len(simulated)}",
            expected="the same times in both",
            advice="resample the simulation",
        )
    if not (np.all(np.isfinite(measured)) and np.all(np.isfinite(simulated))):
        raise InputError(
            "a signal holds NaN or infinite values",
            where="comparison",
            got=f"{np.sum(~np.isfinite(measured))} measured and {np.sum(~np.isfinite(simulated))} simulated ones",
            advice="repair the channel or the simulation that they come from",
        )
    if not 0 < band[0] < band[1] < 0.5 * sampling_rate:
        raise InputError("not a band", where="comparison", got=f"{band} Hz", expected="0 < low < high < half the rate")
    if len(measured) * band[0] < 10 * sampling_rate:
        raise InputError(
            "the record is too short",
            where="comparison",
            got=f"{len(measured) / sampling_rate:.3g} s",
            expected=f"ten periods, {10 / band[0]:.3g} s",
        )
    if not (np.any(measured) and np.any(simulated)):
        raise InputError("a signal is zero throughout", where="comparison", advice="check the channel")
    sos = scipy.signal.butter(4, band, "bandpass", fs=sampling_rate, output="sos")
    parts = [scipy.signal.sosfiltfilt(sos, part - part[-1]) for part in (measured, simulated)]
    edge = int(2 * sampling_rate / band[0])
    envelopes = [np.abs(scipy.signal.hilbert(part))[edge:-edge] for part in parts]
    error = float(np.linalg.norm(parts[1] - parts[0]) / np.linalg.norm(parts[0]))
    envelope_error = float(np.linalg.norm(envelopes[1] - envelopes[0]) / np.linalg.norm(envelopes[0]))
    peaks = (_peak(parts[0], sampling_rate), _peak(parts[1], sampling_rate))
    missing, std = _missing(envelopes, sampling_rate, peaks[0])
    return SignalComparison(error, peaks, envelope_error, missing, std, _verdict(peaks, envelope_error, missing, std))


def _peak(part: np.ndarray, rate: float) -> float:
    """Frequency of the highest line, refined by a parabola through the logarithms beside it."""
    size = scipy.fft.next_fast_len(4 * len(part), real=True)
    power = np.abs(scipy.fft.rfft(part, size))
    top = int(np.clip(power.argmax(), 1, len(power) - 2))
    a, b, c = np.log(power[top - 1 : top + 2])
    return float((top + 0.5 * (a - c) / (a - 2 * b + c)) * rate / size)


def _missing(envelopes: list[np.ndarray], rate: float, frequency: float) -> tuple[float, float]:
    usable = np.ones(len(envelopes[0]), bool)
    for envelope in envelopes:
        usable &= envelope > 0.02 * envelope[: max(len(envelope) // 20, 1)].max()
    stop = int(np.argmin(usable)) if not usable.all() else len(usable)
    if stop < 4 * rate / frequency:
        return float("nan"), float("nan")
    period = max(int(rate / frequency), 1)
    ratio = np.log(envelopes[0][:stop:period] / envelopes[1][:stop:period])
    times = np.arange(len(ratio)) * period / rate
    (slope, _), covariance = np.polyfit(times, ratio, 1, cov="unscaled")
    rest = ratio - np.polyval(np.polyfit(times, ratio, 1), times)
    scale = float(rest @ rest) / max(len(ratio) - 2, 1)
    turn = 2 * np.pi * frequency
    return float(-slope / turn), float(np.sqrt(covariance[0, 0] * scale) / turn)


def _verdict(peaks: tuple[float, float], envelope_error: float, missing: float, std: float) -> Verdict:
    shift = peaks[1] / peaks[0] - 1
    said = [
        f"The spectra peak at {peaks[0]:.4g} and {peaks[1]:.4g} Hz ({100 * shift:+.2f} %).",
        f"The envelopes differ by {envelope_error:.0%}.",
    ]
    if missing > 2 * std:
        said.append(f"The model lacks an exponential decay with a damping ratio of {100 * missing:.3f} %.")
    return Verdict(abs(shift) < SAME_PEAK and envelope_error < GOOD, tuple(said))
