"""Acceleration to velocity to displacement in the frequency domain."""

from dataclasses import replace

import numpy as np
import scipy.fft
from jaxtyping import Float

from ema.data import Channel, Recording
from ema.errors import InputError
from ema.units import SI_UNIT, UNSTATED, Quantity

_ORDER: dict[str, int] = {"displacement": 0, "velocity": 1, "acceleration": 2}


def integrated(
    signal: Float[np.ndarray, "*channel sample"],
    sampling_rate: float,
    times: int = 1,
    high_pass: float = 1.0,
    rest: int | None = None,
) -> Float[np.ndarray, "*channel sample"]:
    """Integrate a signal by division by (j w)^times above a high-pass without phase.

    The high-pass (f/fc)^4 / (1 + (f/fc)^4) keeps offset and drift out; the signal is padded by its own length so that
    nothing wraps round. Errors grow with fc: stay below a fifteenth of the lowest frequency of interest, and have 0.3 s
    of rest before the event.

    Parameters
    ----------
    signal : array of shape (..., sample)
        Signals, one per row.
    sampling_rate : float
        Sampling rate [Hz].
    times : int, default 1
        How often to integrate, 1 or more.
    high_pass : float, default 1.0
        Corner frequency fc [Hz].
    rest : int, optional
        Samples at rest at the beginning, whose mean is taken off; by default the mean of the whole signal is.

    Returns
    -------
    array of shape (..., sample)
        The integrals.

    Raises
    ------
    InputError
        If there are no samples, ``high_pass`` is not positive, ``times`` is below 1, or ``rest`` is out of the signal.

    Examples
    --------
    >>> t = np.arange(4096) / 1024.0
    >>> velocity = integrated(np.cos(2 * np.pi * 50.0 * t), 1024.0)
    >>> round(float(velocity[1024:3072].max() * 2 * np.pi * 50.0), 2)
    1.0
    """
    samples = signal.shape[-1] if signal.ndim else 0
    if not samples:
        raise InputError("no samples to integrate", got=f"an array of shape {signal.shape}", expected="(..., sample)")
    if not high_pass > 0:
        raise InputError("the high-pass frequency must be positive", got=high_pass, expected="more than 0 Hz")
    if times < 1:
        raise InputError("cannot integrate so often", got=times, expected="1 or 2")
    if rest is not None and not 1 <= rest <= samples:
        raise InputError("the rest is not in the signal", got=f"{rest} samples", expected=f"1 to {samples}")
    still = signal[..., : rest or samples].mean(axis=-1, keepdims=True)
    size = scipy.fft.next_fast_len(2 * samples, real=True)
    frequencies = scipy.fft.rfftfreq(size, 1 / sampling_rate)
    ratio = (frequencies / high_pass) ** 4
    factor = np.zeros(len(frequencies), complex)
    factor[1:] = (ratio[1:] / (1 + ratio[1:])) / (2j * np.pi * frequencies[1:]) ** times
    spectrum = scipy.fft.rfft((signal - still).astype(np.float64), size, axis=-1)
    return np.asarray(scipy.fft.irfft(spectrum * factor, size, axis=-1)[..., :samples])


def to_quantity(recording: Recording, quantity: Quantity, high_pass: float = 1.0, rest: int | None = None) -> Recording:
    """Convert all motion channels of a record to one quantity, integrated where necessary.

    Parameters
    ----------
    recording : Recording
        The record.
    quantity : Quantity
        ``displacement``, ``velocity`` or ``acceleration``.
    high_pass : float, default 1.0
        Corner frequency of the high-pass [Hz]; see :func:`integrated`.
    rest : int, optional
        Samples at rest at the beginning; see :func:`integrated`.

    Returns
    -------
    Recording
        The record with its motion channels in that quantity; sensitivity and range of integrated channels are dropped.

    Raises
    ------
    InputError
        If the quantity is no motion, or a channel would have to be differentiated.

    Examples
    --------
    >>> from ema.examples import recording
    >>> to_quantity(recording(), "velocity").channels[1].unit
    'm/s'
    """
    if quantity not in _ORDER:
        raise InputError("not a motion", got=quantity, expected=", ".join(_ORDER))
    signals = np.array(recording.signals, dtype=np.float64)
    channels: list[Channel] = []
    for row, channel in enumerate(recording.channels):
        times = _ORDER.get(channel.quantity, _ORDER[quantity]) - _ORDER[quantity]
        if times < 0:
            raise InputError(
                "the signal would have to be differentiated",
                where=f"{recording.name}, channel {channel.name}",
                got=channel.quantity,
                expected=quantity,
            )
        if times:
            signals[row] = integrated(signals[row], recording.sampling_rate, times, high_pass, rest)
            unit = SI_UNIT[quantity] if channel.scaled else UNSTATED
            channel = replace(channel, quantity=quantity, unit=unit, range=None, sensitivity=None)
        channels.append(channel)
    return replace(recording, signals=signals, channels=tuple(channels))
