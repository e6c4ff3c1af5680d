"""Channels that are late, or that a high-pass filter turns: what is real between the resonances shows its phase.

The receptance and the accelerance of a lightly damped structure are real but for the lines near its resonances, with
both signs. A channel that is late by t turns all lines by w t, and a high-pass filter (an AC-coupled input, a charge
amplifier) turns those near its corner forward. The square of each value over its magnitude does not know the sign:
the mean of these squares is near 1 where an FRF is real at most lines, and falls where the phase turns over the band.
A delay is that turn by which the mean is largest (as phases are tested for a common direction: Mardia and Jupp 2000,
Directional Statistics, section 2.3, with w t taken off).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data import Finding, FrfSet
from ema.messages import mark

REAL = 0.6
"""Mean of the squared directions of an FRF, 1 where all lines are real and 0 where they have any phase, from which on
its phase tells of a channel. Overlapping modes have less: nothing is said of them."""

GAIN = 0.1
"""Rise of that mean by taking a delay off, above which the channel is late: about half a radian at the highest line.

Of 276 clean hammer, random and sweep tests (1 to 7 modes, damping ratios of 0.2 to 8 %, noise of 0.1 to 5 %) no channel
was named, of 160 on structures that slip one. Clean channels with damping ratios below 2 % rose by 0.015 at most, those
late by one sample by 0.59 or more. Halved, a delay of 0.7 as much is named; doubled, of 1.4 as much.
"""

GAIN_BELOW = 0.08
"""The same for a high-pass filter, where lines count by the inverse of their frequency: each octave as much.

With 0.06, and channels named alone or together, three of 180 clean tests had one; with this value, and fewer than half
of the responses, none of 66. A filter at a hundredth of the sampling rate is found in 13 of 66: it shows only where
lines near its corner are measured, below the lowest resonance.
"""

SAME = 0.005
"""Fall of the mean in half of the band that is none: a twentieth of ``GAIN``."""

KNOWN = 10.0
"""Power of a line over its variance below which its phase is not looked at."""

FEWEST = 64
"""Lines of known phase below which nothing is said."""

_FURTHEST = 4 * np.pi
_TURNS = 321
_CORNERS = 48


@dataclass(frozen=True)
class _Phases:
    """Squared directions of the values (freq, channel) of an FRF set, 0 where noise hides them, and the frequencies."""

    frequencies: Float[np.ndarray, "freq"]
    squares: Complex[np.ndarray, "freq channel"]

    def explained(
        self, angles: Float[np.ndarray, "curve freq"], weight: Float[np.ndarray, "freq"], rise: float
    ) -> Int[np.ndarray, "channel"]:
        """For each channel the curve of phases that it has; the first, of phase 0, where nothing speaks for another.

        With the curve taken off the mean exceeds ``REAL``, has risen by more than ``rise``, and falls in neither half
        of the weights: damping turns some of the lines, a channel turns all of them.
        """
        squares = self.squares * weight[:, None]
        total = weight.sum()  # lines that noise hides are not real
        half = int(np.searchsorted(np.cumsum(weight), 0.5 * weight.sum()))
        turned = np.exp(-2j * angles)
        lower = (turned[:, :half] @ squares[:half]).real / total
        upper = (turned[:, half:] @ squares[half:]).real / total
        best, every = (lower + upper).argmax(axis=0), np.arange(squares.shape[1])
        low, high = lower[best, every], upper[best, every]
        steady = (low >= lower[0] - SAME) & (high >= upper[0] - SAME)
        clear = steady & (low + high > REAL) & (low + high - lower[0] - upper[0] > rise)
        return np.where(clear, best, 0)


def about_phases(frfs: FrfSet) -> list[Finding]:
    """A finding for each channel that is late or early against the others, or that a high-pass filter turns.

    A delay of all responses to a force is one of that force. Of one response and one force nobody knows which.
    """
    phases = _phases(frfs)
    if phases is None:
        return []
    shape = frfs.values.shape[1:]
    turns = np.linspace(-_FURTHEST, _FURTHEST, _TURNS)
    turns = np.concatenate([[0.0], turns[np.argsort(np.abs(turns), kind="stable")][1:]])
    f, highest = phases.frequencies, phases.frequencies[-1]
    curves = -np.outer(turns, f / highest)
    shown = phases.explained(curves, np.ones(len(f)), GAIN)
    delay = turns[shown].reshape(shape) / (2 * np.pi * highest)
    findings = [_late(frfs, name, value, one) for name, value, one in _by_channel(frfs, delay)]
    if delay.any():
        return findings
    lowest = f[min(3, len(f) - 1)]
    corners = np.concatenate([[0.0], np.geomspace(lowest, max(0.25 * highest, 2 * lowest), _CORNERS)])
    shown = phases.explained(np.arctan(corners[:, None] / f), 1 / f, GAIN_BELOW)
    filtered = corners[shown].reshape(shape)
    found = [(name, value) for name, value, one in _by_channel(frfs, filtered) if one == "response"]
    # what all responses do may be the structure: one differs from the others
    return [_filtered(frfs, name, value) for name, value in found if 2 * len(found) < shape[0]]


def _phases(frfs: FrfSet) -> _Phases | None:
    """The squared directions of all FRFs, as of accelerances; ``None`` where too few lines are known."""
    inside = frfs.frequencies > 0
    f, values = frfs.frequencies[inside], frfs.values[inside].reshape(int(inside.sum()), -1)
    size = np.abs(values)
    known = np.isfinite(size) & (size > 0)
    if frfs.variance is not None:
        variance = frfs.variance[inside].reshape(size.shape)
        known &= ~(size**2 <= KNOWN * variance)  # a single average has no variance
    if len(f) < FEWEST or not np.any(known.sum(axis=0) >= FEWEST):
        return None
    known &= known.sum(axis=0) >= FEWEST
    direction = np.where(known, values, 0) / np.where(known, size, 1.0)
    return _Phases(f, direction**2 * (-1.0 if frfs.quantity == "mobility" else 1.0))


def _by_channel(frfs: FrfSet, values: Float[np.ndarray, "out in"]) -> list[tuple[str, float, str]]:
    """DOF, value against the others and kind of each channel whose FRFs have values that are not 0."""
    rest = values.copy()
    found = []
    for column, dof in enumerate(frfs.inputs):
        own = values[:, column]
        if len(own) > 1 and (np.all(own > 0) or np.all(own < 0)) and np.ptp(own) < 0.5 * np.abs(own).max():
            found.append((str(dof), -float(np.median(own)), "force"))
            rest[:, column] = 0.0
    for row, dof in enumerate(frfs.outputs):
        shown = rest[row][rest[row] != 0]
        if 2 * len(shown) > values.shape[1]:
            found.append((str(dof), float(np.median(shown)), "response"))
    return found


def _late(frfs: FrfSet, dof: str, delay: float, kind: str) -> Finding:
    against = mark("all responses to it") if kind == "force" else mark("the force")
    return Finding.of(
        "warning",
        "channel-delay",
        f"run {frfs.name}, {dof}" if frfs.name else dof,
        "between the resonances the phase tells that this channel is {delay} us {sense} relative to {against}.",
        delay,
        None,
        advice="Check the filters and the sampling of the channel; shapes and residues there are turned by it.",
        delay=f"{1e6 * abs(delay):.3g}",
        sense=mark("late") if delay > 0 else mark("early"),
        against=against,
    )


def _filtered(frfs: FrfSet, dof: str, corner: float) -> Finding:
    return Finding.of(
        "warning",
        "channel-high-pass",
        f"run {frfs.name}, {dof}" if frfs.name else dof,
        "the phase rises towards low frequencies as by a high-pass filter at {corner} Hz that the force does not have: "
        "shapes and residues are turned there.",
        corner,
        None,
        advice="Couple the channel directly, or give force and responses the same filter.",
        corner=f"{corner:.2g}",
    )
