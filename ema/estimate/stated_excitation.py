"""Whether the force of a shaker test is the one that its kind of excitation states."""

import numpy as np
import scipy.fft
import scipy.ndimage
import scipy.signal
from jaxtyping import Float

from ema.data import Finding, Run
from ema.errors import InputError
from ema.estimate import channels
from ema.messages import mark

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

A_SINE = 0.9
"""Share of the power of a short stretch within two lines of its largest, under a Hann window, that makes it a sine.

The stretches hold 16 lines or more of the band of the force. Of 40 draws each (2048 to 131072 samples, noise to 10 %)
noise has 0.34 to 0.38, sweeps and steps 0.99 to 1. Halved it would name noise; 0.95 would miss nothing of them.
"""

NOISE = 0.7
"""The same share below which a force may be noise; between the two nothing is said."""

NO_SINE = 2.2
"""Fourth moment over the square of the second from which on a force is no sine: 1.5 for one, 3 for noise."""

STEADY = 0.3
"""Median over mean of the change of frequency from stretch to stretch below which a sine is stepped.

Linear sweeps have 0.87 to 1.0, logarithmic ones over a decade 0.8 and over two 0.46; sines of which each holds for
four stretches or more have 0.06 to 0.21, and most of three 0.26 to 0.35. Shorter stays cannot be distinguished from a
sweep.
"""

PULSES = 0.02
"""Share of the samples that hold 90 % of the power of a force, below which it is one of impacts.

Impacts have 0.005 and less, noise 0.44, sweeps 0.4 and more, bursts as many as their share of the record.
"""

_STRETCHES = 300
"""Stretches of a force of which the momentary frequency is followed; not shorter than 24 samples."""
_FEWEST_STRETCHES = 8
"""Stretches from which on a share of the power in one line is a median over them."""

_KINDS = {"sweep": mark("a sweep"), "random": mark("random"), "impacts": mark("impacts"), "steps": mark("steps")}
_ADVICE = {
    "impacts": mark('State kind = "hammer": impacts are then chosen and windowed.'),
    "steps": mark('State kind = "stepped sine": it is then read frequency by frequency, in steady vibration.'),
    "sweep": mark('State kind = "sweep": the record is then one block, without leakage.'),
    "random": mark('State kind = "random": one block of noise without window has leakage at every line.'),
}


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


def about_kind(run: Run) -> tuple[Finding, ...]:
    """A finding where the force of every record is of another kind than the one stated: noise, a sine that sweeps or
    steps, or impacts.

    A force whose stretches are neither a sine nor like noise says nothing; nor does one with a stated period.
    """
    stated = run.condition.excitation
    if stated.kind not in ("random", "sweep") or np.isfinite(stated.period):
        return ()
    forces = [
        record.signals[row]
        for record in run.recordings
        for row in channels.layout(record, channels.describe(run, record)).references
    ]
    kinds = {kind_of(force) for force in forces}
    found = kinds.pop() if len(kinds) == 1 else None
    if found is None or found == stated.kind:
        return ()
    # steps close to each other excite the lines between them, and a sweep is read as a whole
    usable = found == "sweep" or (found == "steps" and stated.kind == "sweep" and not any(map(_leaves_gaps, forces)))
    return (
        Finding.of(
            "warning" if usable else "error",
            "excitation-not-as-stated",
            channels.describe(run),
            "{stated} is stated as excitation, and the force of every record is {found}.",
            None,
            None,
            advice="{remedy}",
            remedy=_ADVICE[found],
            stated=_KINDS[stated.kind],
            found={"steps": mark("a sine that steps from frequency to frequency")}.get(found, _KINDS[found]),
        ),
    )


def kind_of(force: Float[np.ndarray, "sample"]) -> str | None:
    """``sweep``, ``steps``, ``random`` or ``impacts``; ``None`` where a force is none of them clearly.

    Parameters
    ----------
    force : shape (sample,), in any unit.

    Examples
    --------
    >>> time = np.arange(8192)
    >>> kind_of(np.sin(1e-4 * time**2)), kind_of(np.random.default_rng(1).standard_normal(8192))
    ('sweep', 'random')
    """
    signal = np.asarray(force, dtype=np.float64)
    power = np.sort((signal - np.median(signal)) ** 2)[::-1]
    if not power[0] > 0:
        return None
    if np.searchsorted(np.cumsum(power), 0.9 * power.sum()) + 1 < PULSES * len(signal):
        return "impacts"
    signal = signal - signal.mean()
    low, high = _band(signal)
    length = 2 ** int(np.ceil(np.log2(16 * len(signal) / max(high - low, 1))))
    shares = []
    while length * _FEWEST_STRETCHES <= len(signal):
        shares.append(_in_one_line(signal, length))
        length *= 2
    if not shares:
        return None
    if max(shares) > A_SINE:
        return "steps" if _steadiness(signal) < STEADY else "sweep"
    # a sum of sines with a period is not noise either
    single = _over_median(signal, 1.0, low / len(signal), high / len(signal)) > SINGLE_LINES
    gaussian = np.mean(signal**4) > NO_SINE * np.mean(signal**2) ** 2
    return "random" if 0 < max(shares) < NOISE and gaussian and not single else None


def _band(signal: Float[np.ndarray, "sample"]) -> tuple[int, int]:
    """First and last line of the band that holds 98 % of the power."""
    share = np.cumsum(np.abs(np.fft.rfft(signal)) ** 2)
    low, high = np.searchsorted(share, [0.01 * share[-1], 0.99 * share[-1]])
    return int(low), int(high)


def _leaves_gaps(force: Float[np.ndarray, "sample"]) -> bool:
    """Whether lines between the frequencies of steps are hardly excited: mean over median of the power is 1 where the
    distance of the steps is up to 1.5 over a stay, and that distance times the stay beyond.
    """
    signal = np.asarray(force, dtype=np.float64)
    low, high = _band(signal - signal.mean())
    power = np.abs(np.fft.rfft(signal - signal.mean()))[low : high + 1] ** 2
    return bool(power.mean() > SINGLE_LINES * np.median(power))


def _in_one_line(signal: Float[np.ndarray, "sample"], length: int) -> float:
    """Share of the power of stretches within two lines of the largest: the median over those with power."""
    parts = signal[: len(signal) // length * length].reshape(-1, length)
    power = np.abs(np.fft.rfft(parts * np.hanning(length), axis=1)) ** 2
    total = power.sum(axis=1)
    sums = np.cumsum(np.pad(power, ((0, 0), (3, 2))), axis=1)
    near = (sums[:, 5:] - sums[:, :-5]).max(axis=1)
    driven = total > 0.05 * total.mean()
    return float(np.median((near / np.maximum(total, 1e-300))[driven])) if driven.sum() >= _FEWEST_STRETCHES else 0.0


def _steadiness(signal: Float[np.ndarray, "sample"]) -> float:
    """Median over mean of the change of the momentary frequency from stretch to stretch."""
    analytic = scipy.signal.hilbert(signal, scipy.fft.next_fast_len(len(signal)))[: len(signal)]
    length = max(len(signal) // _STRETCHES, 24)
    turns = np.add.reduceat(analytic[1:] * analytic[:-1].conj(), np.arange(0, len(signal) - 1, length))
    driven = np.abs(turns) > 0.1 * np.median(np.abs(turns))
    change = np.abs(np.diff(np.angle(turns[driven])))
    return float(np.median(change) / max(float(change.mean()), 1e-300)) if len(change) else 1.0


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
