"""Nonlinear distortion under a periodic excitation: what a structure answers at lines that nobody excites.

A linear structure in steady state answers a periodic force at the lines of that force alone. A multisine whose lines
are odd multiples of its fundamental, with some of them left out at random, shows at the odd lines left out what odd
nonlinearities (friction, cubic springs) do, and at even lines what even ones do (gaps, preloads).
"""

from dataclasses import dataclass

import numpy as np
import scipy.interpolate
from jaxtyping import Complex, Float, Int

from ema.data import Finding, Recording, Run
from ema.errors import InputError
from ema.estimate import channels
from ema.estimate.drift import Drift

EXCITED = 0.1
"""Force of a line over the largest within `_NEAR` lines, from which on it is excited. A shaker that drives a moving
structure puts a few percent of distortion into its own force; a resonance lowers an excited line to a third."""
_NEAR = 16
"""Lines to either side among which the largest force is looked for."""
DISTORTED = 0.005
"""Distortion at the lines left out, over the response, from which on a structure counts as not linear.

Set on the 200 tables of `python -m tests.bench.detection_lines` with seed 1: 55 of 55 tables whose FRFs change by 5 %
or more from half the level to this one have more, 1 of 135 that change by less than 2.5 %. Doubled, 51 of the 55 have;
halved, 4 of the 135.
"""
CLEAR = 3.0
"""Distortion over what noise shows of it, from which on it is beyond noise."""


@dataclass(frozen=True)
class NonlinearDistortion:
    """What a structure answers at lines without force, over what it answers at excited lines (rms of one line).

    Parameters
    ----------
    odd, even : float
        At odd and even multiples of the fundamental, noise taken off; NaN where no such line was left out.
    odd_noise, even_noise : float
        What noise alone shows of them.

    Examples
    --------
    >>> NonlinearDistortion(odd=0.05, even=0.0, odd_noise=0.001, even_noise=0.001).verdict
    'not linear'
    """

    odd: float
    even: float
    odd_noise: float
    even_noise: float

    @property
    def verdict(self) -> str:
        """``not linear``, ``linear`` at this level, or ``not testable`` where noise hides what counts.

        Examples
        --------
        >>> NonlinearDistortion(odd=0.0, even=0.0, odd_noise=0.05, even_noise=0.05).verdict
        'not testable'
        """
        known = [pair for pair in ((self.odd, self.odd_noise), (self.even, self.even_noise)) if np.isfinite(pair[0])]
        if any(size >= max(DISTORTED, CLEAR * noise) for size, noise in known):
            return "not linear"
        # even lines alone are blind to friction
        tested = np.isfinite(self.odd) and all(size < DISTORTED and CLEAR * noise < DISTORTED for size, noise in known)
        return "linear" if tested else "not testable"


def nonlinear_distortion(run: Run, discard: float = 0.0) -> NonlinearDistortion:
    """Compare the response at lines without force with that at excited lines, all records and responses together.

    What force there is at these lines (the shaker answers the structure) is taken off with the FRF between the excited
    lines beside them; that takes lines closer than a quarter of the half-power bandwidth, else a third of it may stay.
    Noise is read from the differences between periods.

    Parameters
    ----------
    run : Run
        Records with one force, periodic with the ``period`` of the excitation, three periods or more each.
    discard : float, default 0.0
        Time [s] at the start of every record that is left out, while the structure settles.

    Returns
    -------
    NonlinearDistortion
        Odd and even distortion.

    Raises
    ------
    InputError
        If no period is stated, it is no whole number of samples, a record has fewer than three of them or several
        forces, or no line was left out.

    References
    ----------
    .. [1] Vanhoenacker, Dobrowiecki and Schoukens (2001), IEEE Transactions on Instrumentation and Measurement 50,
       1097-1102; Pintelon and Schoukens (2012), System Identification, chapter 4.

    Examples
    --------
    >>> from ema.data import Condition, Excitation
    >>> from ema.examples import recording
    >>> t = np.arange(32768) / 1024.0
    >>> force = sum(np.sin(2 * np.pi * line * t + line**2) for line in (1, 3, 7, 9, 11, 15))
    >>> run = Run("multisine", Condition(Excitation("random", period=1.0)), (recording(force),))
    >>> nonlinear_distortion(run, discard=24.0).verdict
    'linear'
    """
    period, where = run.condition.excitation.period, channels.describe(run)
    if not np.isfinite(period):
        raise InputError("no period of the excitation is stated", where=where, expected="a period, of a multisine")
    parts = [_lines(record, period, discard, channels.describe(run, record)) for record in channels.recordings_of(run)]
    sizes = []
    for parity in (1, 0):
        read = [part for part in (_at(*lines, parity) for lines in parts) if part is not None]
        if not read:
            sizes.append((float("nan"), float("nan")))
            continue
        raw, noise, count = np.mean(read, axis=0) * (1, 1, len(read))
        sizes.append((float(np.sqrt(max(raw - noise, 0.0))), float(np.sqrt(noise / np.sqrt(count)))))
    (odd, odd_noise), (even, even_noise) = sizes
    if np.isnan(odd) and np.isnan(even):
        raise InputError(
            "no line of the excitation was left out",
            where=where,
            expected="a multisine of odd lines, some of them left out",
            advice="without detection lines only two levels tell whether a structure is linear",
        )
    return NonlinearDistortion(odd, even, odd_noise, even_noise)


def distortion_finding(read: NonlinearDistortion, where: str) -> Finding:
    """Say what the lines without force show.

    Parameters
    ----------
    read : NonlinearDistortion
        Odd and even distortion.
    where : str
        What was measured.

    Returns
    -------
    Finding
        ``nonlinear-distortion``, ``level-tested`` or ``linearity-not-testable``.

    Examples
    --------
    >>> distortion_finding(NonlinearDistortion(0.05, 0.0, 0.001, 0.001), "run a").code
    'nonlinear-distortion'
    """
    pairs = (("odd", read.odd), ("even", read.even))
    sizes = " and ".join(f"{100 * size:.2g} % at {name} lines" for name, size in pairs if np.isfinite(size))
    text = f"where the excitation leaves lines out the structure answers with {sizes} of the response beside them"
    largest = max((size for _, size in pairs if np.isfinite(size)), default=0.0)
    if read.verdict == "not linear":
        return Finding(
            "warning",
            "nonlinear-distortion",
            where,
            f"{text}: it is not linear at this level.",
            largest,
            DISTORTED,
            "FRFs hold for this level only; repeat at half of it, and state modes with the level.",
        )
    if read.verdict == "linear":
        return Finding("info", "level-tested", where, f"{text}: no sign of a nonlinear structure.", largest, DISTORTED)
    reason = "noise is too large" if np.isfinite(read.odd) else "no odd line was left out of three periods or more"
    return Finding(
        "info",
        "linearity-not-testable",
        where,
        f"Whether the structure is linear is not testable: {reason}.",
        advice="Measure more periods of a multisine of odd lines with some left out, or repeat at half the level.",
    )


def _lines(
    record: Recording, period: float, discard: float, where: str
) -> tuple[Complex[np.ndarray, "line"], Complex[np.ndarray, "out line"], Float[np.ndarray, "out line"]]:
    """Force and responses at all lines, means over the periods, and the variance of the responses' means by noise."""
    layout = channels.layout(record, where)
    channels.finite(record, layout, where)
    record = Drift().off(record, layout)
    rate = record.sampling_rate
    samples, first = round(period * rate), round(discard * rate)
    count = (record.signals.shape[1] - first) // max(samples, 1)
    if len(layout.references) != 1 or abs(samples - period * rate) > 1e-6 * samples or count < 3:
        raise InputError(
            "not a record of a periodic force",
            where=where,
            got=f"{len(layout.references)} forces, {period * rate:g} samples a period, {count} periods",
            expected="one force, whole samples, three periods or more",
        )
    rows = [*layout.references, *layout.responses]
    blocks = record.signals[rows, first : first + count * samples].reshape(len(rows), count, samples)
    spectra = np.fft.rfft(blocks, axis=2) * 2 / samples
    mean = spectra.mean(axis=1)
    variance = np.var(spectra, axis=1, ddof=1)[1:] / count
    return mean[0], mean[1:], variance


def excited_lines(force: Float[np.ndarray, "line"]) -> Int[np.ndarray, "excited"]:
    """Lines of a periodic force at which the structure was driven, from its amplitude at all lines from 0 Hz.

    Parameters
    ----------
    force : array of shape (line,)
        Amplitudes of the force.

    Returns
    -------
    array of shape (excited,)
        Their numbers; lines that lie far below those beside them were left out.

    Examples
    --------
    >>> excited_lines(np.array([0.0, 1.0, 0.01, 0.9, 0.02, 0.03, 0.0, 1.1]))
    array([1, 3, 7])
    """
    size = np.array(force, dtype=float)
    size[0] = 0.0
    near = np.array([size[max(line - _NEAR, 0) : line + _NEAR + 1].max() for line in range(len(size))])
    # beyond the band noise is beside noise
    floor = EXCITED * np.median(size[size > EXCITED * size.max()]) if size.any() else 0.0
    return np.flatnonzero((size > EXCITED * near) & (size > floor))


def _at(
    force: Complex[np.ndarray, "line"],
    responses: Complex[np.ndarray, "out line"],
    variance: Float[np.ndarray, "out line"],
    parity: int,
) -> tuple[float, float, int] | None:
    """Power of the answer at lines left out over that at excited ones, its part by noise, and the number of values."""
    excited = excited_lines(np.abs(force))
    left_out = np.setdiff1d(np.arange(excited[0], excited[-1]), excited)
    left_out = left_out[left_out % 2 == parity]
    if len(left_out) == 0:
        return None
    around = scipy.interpolate.CubicSpline(excited, responses[:, excited] / force[excited], axis=1)(left_out)
    answer = responses[:, left_out] - around * force[left_out]
    # every response counts by its own size
    beside = np.mean(np.abs(responses[:, excited]) ** 2, axis=1)
    power = float(np.mean(np.mean(np.abs(answer) ** 2, axis=1) / beside))
    noise = float(np.mean(np.mean(variance[:, left_out], axis=1) / beside))
    return power, noise, answer.size
