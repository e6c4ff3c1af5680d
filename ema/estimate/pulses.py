"""Where the impacts of a hammer test are, found from the force signal itself."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

QUIET_RATIO = 10.0
"""A pulse stands out of the noise by at least this factor; Gaussian noise alone never does."""

WEAKEST = 0.1
"""Weakest impact of a record relative to its strongest; anything weaker is a further contact of another impact."""

FOOT = 0.02
"""Level, relative to the peak, at which contact begins and ends."""

FASTEST = 0.06
"""Seconds between two pulses below which they are contacts of one impact: nobody strikes twice as fast on purpose.

Rebounds of a hand-held hammer follow after 5 to 50 ms. Twice as much changes nothing below `HASTY`, half of it makes
impacts of their own of strong rebounds.
"""

HASTY = 0.6
"""Seconds within which the weaker of two pulses is a further contact of the other, unless the pulses come evenly.

Second contacts of 10 to 50 % are found to 0.5 s in records of one impact (:mod:`tests.bench.hammer_records`). Twice as
much would take soft impacts of a quick operator for contacts of their neighbours, half of it would miss late contacts
in a lone record.
"""

EARLY = 0.6
"""Part of the usual gap between the impacts of a record within which a weaker pulse is a contact of its neighbour.

The usual gap is the upper quartile, which further contacts shorten only where every impact has some. Of drawn records
of eight impacts with gaps that scatter by 12 %, peaks by 20 %, at most 0.4 % were grouped wrongly at gaps of 0.3 to
0.8 s, none above; half the value misses contacts that come late between quick impacts.
"""

WEAKER = 0.7
"""Peak relative to a neighbour's below which a pulse within `HASTY` of it is a further contact."""

EVEN = 1.6
"""Ratio of the longest to the shortest gap up to which pulses come evenly, as from an automatic hammer."""

_STATISTICS = 4096
"""Samples that are enough for offset and noise."""


@dataclass(frozen=True)
class Pulse:
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


def find_pulses(
    force: Float[np.ndarray, "sample"], sampling_rate: float, trigger: float | None = None
) -> tuple[list[Pulse], float, float]:
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
    # Samples above the level belong to one pulse until the force has stayed below it for 10 ms: rebounds, ringing.
    breaks = np.flatnonzero(np.diff(above) > max(0.01 * sampling_rate, 4)) + 1
    contacts = []
    for first, last in zip(above[np.r_[0, breaks]], above[np.r_[breaks - 1, len(above) - 1]]):
        top = int(first) + int(np.argmax(sign * force[first : last + 1]))
        contacts.append(_foot_to_foot(force, int(top), offset, noise, sign))
    return contacts, offset, noise


def _foot_to_foot(force: Float[np.ndarray, "sample"], top: int, offset: float, noise: float, sign: float) -> Pulse:
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
    return Pulse(start, top, stop, sign * peak)


def impacts_of(pulses: Sequence[Pulse], sampling_rate: float, alone: bool = False) -> list[tuple[Pulse, ...]]:
    """The pulses by impact, in order of time: those of one impact were not struck on purpose.

    Parameters
    ----------
    pulses : in order of time.
    sampling_rate : Hz.
    alone : the record is known to hold one impact, so that all its pulses belong to that.
    """
    if alone or len(pulses) < 2:
        return [tuple(pulses)] if pulses else []
    gaps = np.diff([pulse.start for pulse in pulses])
    least = max(FASTEST * sampling_rate, 0.3 * float(np.median(gaps)) if len(gaps) > 2 else 0.0)
    groups = [tuple(group) for group in np.split(np.array(pulses, object), np.flatnonzero(gaps >= least) + 1)]
    starts = np.array([group[0].start for group in groups])
    peaks = np.array([max(abs(pulse.peak) for pulse in group) for group in groups])
    gaps = np.diff(starts)
    if len(gaps) > 2 and gaps.max() < EVEN * gaps.min():
        return groups
    reach = HASTY * sampling_rate
    if len(gaps) > 3:
        reach = min(reach, EARLY * float(np.quantile(gaps, 0.75)))
    owner = np.arange(len(groups))
    for group in np.argsort(peaks):
        for neighbour in (group - 1, group + 1):
            near = 0 <= neighbour < len(groups) and abs(starts[neighbour] - starts[group]) < reach
            if near and peaks[group] < WEAKER * peaks[neighbour]:
                owner[group] = neighbour
                break
    for group in np.argsort(peaks):  # a contact of a contact belongs to the impact
        while owner[owner[group]] != owner[group]:
            owner[group] = owner[owner[group]]
    return [sum((groups[one] for one in np.flatnonzero(owner == main)), ()) for main in np.unique(owner)]
