"""A simulated free decay against a measured one: in time, in the spectrum, and what damping the model lacks."""

import numpy as np
import scipy.fft
import scipy.signal
from jaxtyping import Float

from ema.data.comparison import SignalComparison, Verdict
from ema.errors import InputError

GOOD = 0.15
"""Envelope error up to which a simulated decay agrees."""
SAME_PEAK = 0.01


def signals(
    measured: Float[np.ndarray, "sample"],
    simulated: Float[np.ndarray, "simulated_sample"],
    sampling_rate: float,
    band: tuple[float, float],
) -> SignalComparison:
    """Compare two signals of one release or blow, aligned at their first sample, in a band that holds one mode.

    The missing damping is the slope of the logarithm of the ratio of the envelopes, over the part in which both stand
    above a fiftieth of their start: the exponential decay by material and air that a model with friction alone lacks.

    Parameters
    ----------
    measured, simulated : velocity (or any one quantity in both), shape (sample,).
    band : Hz.

    Raises
    ------
    InputError : other lengths, NaN, a signal that is zero, a band outside 0 ... half the sampling rate, a record
        shorter than ten periods.
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
        raise InputError("a signal holds NaN or infinite values", where="comparison")
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
