"""Windows of impact and random testing (ISO 18431-2)."""

import numpy as np
from jaxtyping import Float


def exponential_window(samples: int, start: int, sampling_rate: float, decay: float) -> Float[np.ndarray, "sample"]:
    """``exp(-decay (t - t0))`` from sample ``start`` on, 1 before it.

    On force **and** response it turns H(jw) into H(jw + decay): every pole moves by ``-decay`` rad/s, exactly, and
    nothing else changes (Fladung and Rost 1997).

    Parameters
    ----------
    samples, start : length of the block and sample of the trigger.
    sampling_rate : Hz.
    decay : 1/s.
    """
    return np.exp(-decay / sampling_rate * np.maximum(np.arange(samples) - start, 0))


def force_window(samples: int, start: int, stop: int, taper: int) -> Float[np.ndarray, "sample"]:
    """1 from ``start`` to ``stop``, half a cosine of ``taper`` samples outside both ends, 0 elsewhere."""
    sample = np.arange(samples, dtype=np.float64)
    outside = np.maximum(np.maximum(start - sample, sample - (stop - 1)), 0.0)
    return np.where(outside < taper + 1, np.cos(0.5 * np.pi * np.minimum(outside / (taper + 1), 1.0)) ** 2, 0.0)


def hann_window(samples: int) -> Float[np.ndarray, "sample"]:
    """Periodic Hann window, scaled to unit mean square."""
    return np.asarray(np.sqrt(8 / 3) * 0.5 * (1 - np.cos(2 * np.pi * np.arange(samples) / samples)))
