"""Whether the force of a shaker test is the one that its kind of excitation states."""

import numpy as np
import scipy.ndimage
from jaxtyping import Float

from ema.data import Finding, Run
from ema.errors import InputError
from ema.estimate import channels

ONE_LINE = 0.95
"""Share of the power of a force within two lines of its largest, under a Hann window, that makes it a sine.

A steady sine has all but its noise there; a sweep over 20 lines has a fifth, one over 6 lines 0.9.
"""

SINGLE_LINES = 4.0
"""Mean over median of the force power of neighbouring lines above which the lines between are hardly excited.

Sweeps have 0.6 to 1.1, random noise 1.4 to 1.5 (40 draws each); where a sweep repeats within the record, lines between
those of its period have nothing.
"""

NEIGHBOURS = 41
"""Lines over which mean and median are taken."""


def refuse_single_frequencies(run: Run) -> None:
    """Refuse a sweep or random test each of whose records holds a sine of one frequency.

    Raises
    ------
    InputError : they do.
    """
    tops = []
    for record in run.recordings:
        layout = channels.layout(record, channels.describe(run, record))
        for row in layout.references:
            power = _power(record.signals[row])
            top = int(power.argmax())
            if not power[max(top - 2, 0) : top + 3].sum() > ONE_LINE * power.sum():
                return
            tops.append(top * record.sampling_rate / record.signals.shape[1])
    if tops:
        raise InputError(
            "the force of each record is a sine of one frequency",
            where=channels.describe(run),
            got=", ".join(f"{top:.4g} Hz" for top in tops[:3]) + (" ..." if len(tops) > 3 else ""),
            expected=f"a force over a band, as a {run.condition.excitation.kind} has",
            advice='such records are kind = "stepped sine"',
        )


def about_repeats(run: Run, low: float, high: float) -> tuple[Finding, ...]:
    """A finding where the sweep from ``low`` to ``high`` [Hz] repeats within its records, and nobody stated its period.

    Lines between those of its period get no force, but the vibration by which the structure settles.
    """
    ratios = []
    for record in run.recordings:
        layout = channels.layout(record, channels.describe(run, record))
        ratios.append(_over_median(record.signals[layout.references[0]], record.sampling_rate, low, high))
    if min(ratios) <= SINGLE_LINES:
        return ()
    return (
        Finding(
            "error",
            "excitation-not-as-stated",
            channels.describe(run),
            "the force is no single sweep: it repeats within a record, and most lines are not excited. FRFs and modes "
            "are not to be trusted.",
            min(ratios),
            SINGLE_LINES,
            "State the period of the force.",
        ),
    )


def _over_median(force: Float[np.ndarray, "sample"], rate: float, low: float, high: float) -> float:
    """Mean over median of the power of neighbouring lines: large where few of them are excited."""
    power, frequencies = np.abs(np.fft.rfft(force)) ** 2, np.fft.rfftfreq(len(force), 1 / rate)
    power = power[(frequencies >= low) & (frequencies <= high)]
    if len(power) < 2 * NEIGHBOURS:
        return 0.0
    mean = scipy.ndimage.uniform_filter1d(power, NEIGHBOURS)
    return float(np.median(mean / np.maximum(scipy.ndimage.median_filter(power, NEIGHBOURS), 1e-300)))


def _power(signal: Float[np.ndarray, "sample"]) -> Float[np.ndarray, "freq"]:
    """Power of a signal without its mean, by lines, under a Hann window."""
    rest = np.asarray(signal, dtype=np.float64)
    return np.asarray(np.abs(np.fft.rfft((rest - rest.mean()) * np.hanning(len(rest)))[1:]) ** 2)
