"""Where the blows of a hammer test are, found from the force signal itself."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

QUIET_RATIO = 10.0
"""A blow stands out of the noise by at least this factor; Gaussian noise alone never does."""

WEAKEST = 0.1
"""Weakest blow of a record relative to its strongest; anything weaker is a bounce of another blow."""

FOOT = 0.02
"""Level, relative to the peak, at which contact begins and ends."""

_STATISTICS = 4096
"""Samples that are enough for offset and noise."""


@dataclass(frozen=True)
class Blow:
    """One pulse: first and last sample of contact, sample of the peak, and its signed height above the offset."""

    start: int
    top: int
    stop: int
    peak: float


def offset_and_noise(force: Float[np.ndarray, "sample"]) -> tuple[float, float]:
    """Median, and standard deviation from the median absolute deviation: a few pulses do not disturb either."""
    some = force[:: max(len(force) // _STATISTICS, 1)]
    offset = float(np.median(some))
    return offset, 1.4826 * float(np.median(np.abs(some - offset)))


def find_blows(
    force: Float[np.ndarray, "sample"], sampling_rate: float, trigger: float | None = None
) -> tuple[list[Blow], float, float]:
    """All pulses of a record, its offset and its noise; an empty list where the force never triggers.

    Parameters
    ----------
    force : N, shape (sample,).
    sampling_rate : Hz.
    trigger : level above the offset in N; by default ten times the noise or a tenth of the strongest pulse.
    """
    offset, noise = offset_and_noise(force)
    high, low = float(force.max()) - offset, offset - float(force.min())
    sign = -1.0 if low > 1.5 * high else 1.0
    strongest = max(high, low)
    if not strongest > QUIET_RATIO * noise or strongest <= 1e-9 * abs(offset):
        return [], offset, noise
    level = max(WEAKEST * strongest, QUIET_RATIO * noise) if trigger is None else trigger
    above = np.flatnonzero(force > offset + level if sign > 0 else force < offset - level)
    if len(above) == 0:
        return [], offset, noise
    # Samples above the level belong to one blow until the force has stayed below it for 10 ms: bounces, ringing.
    breaks = np.flatnonzero(np.diff(above) > max(0.01 * sampling_rate, 4)) + 1
    found = []
    for first, last in zip(above[np.r_[0, breaks]], above[np.r_[breaks - 1, len(above) - 1]]):
        top = int(first) + int(np.argmax(sign * force[first : last + 1]))
        found.append(_foot_to_foot(force, int(top), offset, noise, sign))
    return found, offset, noise


def _foot_to_foot(force: Float[np.ndarray, "sample"], top: int, offset: float, noise: float, sign: float) -> Blow:
    """The contact around a peak: from foot to foot."""
    peak = sign * (float(force[top]) - offset)
    foot = max(FOOT * peak, 4 * noise)
    reach = 64
    while True:
        before = sign * (force[max(top - reach, 0) : top + 1] - offset) <= foot
        after = sign * (force[top : top + reach + 1] - offset) <= foot
        if (before.any() or top <= reach) and (after.any() or top + reach >= len(force) - 1):
            break
        reach *= 4
    start = top - int(np.argmax(before[::-1])) if before.any() else 0
    stop = top + int(np.argmax(after)) if after.any() else len(force) - 1
    return Blow(start, top, stop, sign * peak)
