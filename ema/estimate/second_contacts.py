"""Second contacts around an impact, distinguished from filter ringing, sensor undershoot and noise."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.estimate.pulses import Pulse

SMALLEST = 0.012
"""Height of a second pulse relative to the main one that is reported where noise and ringing allow it."""

CLEAR_OF_NOISE = 7.0
"""Height of a second pulse in units of the noise that is left after smoothing."""

CELLS_PER_PULSE = 4.0
"""Resolution of the search: cells per width of the main pulse at half its height."""

NOT_A_VALLEY = 0.9
"""Part of the main pulse above which a local minimum is noise on its top."""

RINGING_CELLS = 5
"""Cells behind the top of a pulse of a few samples in which the filter's first lobes look like pulses."""

_BINOMIAL = (1 / 16, 4 / 16, 6 / 16)


@dataclass(frozen=True)
class SecondContact:
    """A further contact: sample of its peak, height relative to the main pulse, and samples ``first`` to ``last``."""

    sample: int
    ratio: float
    first: int
    last: int


def width_at_half(force: Float[np.ndarray, "sample"], pulse: Pulse, offset: float) -> int:
    """Samples around the peak that exceed half of it; ringing and undershoot do not reach there."""
    sign = np.sign(pulse.peak)
    around = sign * (force[pulse.start : pulse.stop + 1] - offset) > 0.5 * abs(pulse.peak)
    return int(np.count_nonzero(around))


def smoothed(force: Float[np.ndarray, "sample"], offset: float, cell: int) -> Float[np.ndarray, "cell"]:
    """Means over cells, then a binomial kernel: it has no side lobes and no gain near half the sampling rate.

    Ringing of an anti-alias filter lies there and cancels; a second contact is as wide as the first and stays.
    """
    count = len(force) // cell
    z = force[: count * cell : cell] - force.dtype.type(offset)
    for shift in range(1, cell):
        z += force[shift : count * cell : cell]
    z -= force.dtype.type((cell - 1) * offset)
    z = np.concatenate([z[:1], z[:1], z, z[-1:], z[-1:]]).astype(np.float32)
    far, near, centre = (np.float32(weight / cell) for weight in _BINOMIAL)
    return np.asarray(far * (z[:-4] + z[4:]) + near * (z[1:-3] + z[3:-1]) + centre * z[2:-2])


def second_contacts(
    force: Float[np.ndarray, "sample"], pulses: list[Pulse], rooms: list[tuple[int, int]], offset: float, noise: float
) -> list[tuple[SecondContact, ...]]:
    """The second contacts around each main pulse, within ``(samples before, samples after)`` its start.

    The smoothed force minus its morphological opening (the baseline that no pulse narrower than the opening can lift)
    is the height of a pulse; a monotonic baseline such as the undershoot of a sensor gives zero, whatever its slope.
    """
    width = float(np.median([width_at_half(force, pulse, offset) for pulse in pulses]))
    cell = max(int(width / CELLS_PER_PULSE), 1)
    doublings = 4 if 3 * width <= 16 * cell else 5
    z = smoothed(force, offset, cell)
    clear = CLEAR_OF_NOISE * noise * np.sqrt(0.273 / cell)
    of_pulses: list[tuple[SecondContact, ...]] = []
    for pulse, (before, after) in zip(pulses, rooms):
        sign = np.float32(np.sign(pulse.peak))
        first = max(pulse.top // cell - 2, 0)
        top = first + int(np.argmax(sign * z[first : first + 5]))
        height = float(sign * z[top])
        limit = max(SMALLEST * height, clear)
        behind = sign * z[top : max((pulse.start + after) // cell, top)]
        ahead = sign * z[max((pulse.start - before) // cell, 0) : top + 1][::-1]
        contacts: list[SecondContact] = []
        for part, direction in ((behind, 1), (ahead, -1)):
            start, rise = _rise(part, height, doublings, RINGING_CELLS if cell == 1 else 2)
            cells = np.flatnonzero(rise > limit)
            # flanks of one contact and of the next overlap up to here: together they are one
            for own in np.split(cells, np.flatnonzero(np.diff(cells) > 2 + 2 * width / cell) + 1):
                if len(own):
                    best = own[np.argmax(rise[own])]
                    middle, *ends = ((top + direction * (start + int(one))) * cell for one in (best, own[0], own[-1]))
                    first, last = max(min(ends) - int(width), 0), max(ends) + cell + int(width)
                    contacts.append(SecondContact(middle, float(rise[best]) / height, first, last))
        of_pulses.append(tuple(sorted(contacts, key=lambda contact: contact.sample)))
    return of_pulses


def _rise(
    part: Float[np.ndarray, "cell"], height: float, doublings: int, least: int
) -> tuple[int, Float[np.ndarray, "some"]]:
    """Heights of the pulses behind the top of the main pulse, with which ``part`` begins, and their first cell."""
    for end in (256, len(part)):
        some = part[:end]
        valley = (some[1:-1] <= some[2:]) & (some[1:-1] < NOT_A_VALLEY * height)
        if valley.any():
            break
    else:
        return 0, part[:0]
    start = max(int(np.argmax(valley)) + 1, least)
    tail = part[start:]
    if len(tail) < 3:
        return 0, part[:0]
    return start, tail - opening(tail, doublings)


def opening(values: Float[np.ndarray, "cell"], doublings: int) -> Float[np.ndarray, "cell"]:
    """Morphological opening with a span of ``2 ** doublings`` cells: running minimum, then running maximum."""
    reach = 2**doublings - 1
    ends = np.full(reach, values[0]), np.full(reach, values[-1])
    result = np.concatenate([ends[0], values, ends[1]])
    for extreme in (np.minimum, np.maximum):
        for step in range(doublings):
            shift = 2**step
            result = extreme(result[:-shift], result[shift:])
    return result
