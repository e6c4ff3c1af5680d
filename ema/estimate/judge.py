"""The impacts of a hammer test, each with what is known about it and what it does to the FRF."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from ema.data import Channel, Recording
from ema.dof import Dof
from ema.estimate.channels import Layout
from ema.estimate.pulses import Pulse, find_pulses, impacts_of
from ema.estimate.second_contacts import SecondContact, second_contacts

FULL_SCALE = 0.98
"""Part of a channel's range that counts as an overload."""

CLIPPED_WITHIN = 1024
"""Samples behind an extreme in which its equals are looked for."""

UNDER_RANGE = 0.1
"""Part of a channel's range that an impact should exceed."""

DC_SHIFT = 0.01
"""Change of a response's mean by an impact, relative to its peak, that betrays an overloaded or loose sensor."""

NOT_AT_REST = 0.05
"""Response before an impact relative to that behind it."""

PRE_TRIGGER = 0.05
"""Seconds before an impact that belong to it, where there are so many."""

FEW = 16
"""Samples below which statistics of the quiet before an impact say nothing."""


TOLERATED = 0.02
"""Error that an impact may cause in the processed FRF, relative to the FRF, before it counts as biased.

It is what a response that has not died away within the block may leave without a window (`block_end.LEFT_OVER`).
Halved, every impact at that limit is doubtful; doubled, a single impact may be worse than what a window is used for.
"""

ONE_LEVEL = 0.1
"""Height of a second contact relative to the main one up to which the impact counts as one of a single level.

A measured second contact within the block does not bias the FRF of a linear structure. A joint that slips answers to
the level, which a contact of 10 % changes by at most 10 %; peaks of impacts by hand scatter by more. It only matters
where a point has enough other impacts.
"""

ASKED = frozenset({"excluded-impact", "level"})
"""Reasons that somebody gave: they are never overruled."""


@dataclass(frozen=True)
class Remark:
    """Something about an impact that does not exclude it."""

    code: str
    channel: str
    value: float
    limit: float


@dataclass(frozen=True)
class Reason:
    """Something that counts against an impact, with the relative ``error`` that it causes in the processed FRF."""

    code: str
    text: str
    error: float


@dataclass(frozen=True)
class Judged:
    """An impact with all that is known about it.

    ``place`` is the record's place in the run; ``pulse`` is the main contact, ``start`` the first sample of the first
    one; ``before`` and ``after`` are the samples of the record that belong to this impact alone, seen from ``start``;
    ``rest`` and ``quiet`` (out,) are mean and rms of the responses before it, ``unrest`` the largest ratio of that rms
    to that behind it; ``contacts`` are its further ones. ``used`` is decided when all impacts of a point are known.
    ``force`` is the force sample that is farthest from 0, ``samples`` a fingerprint of all samples of the impact.
    """

    place: int
    record: str
    index: int
    dof: Dof
    pulse: Pulse
    start: int
    offset: float
    before: int
    after: int
    rest: Float[np.ndarray, "out"]
    quiet: Float[np.ndarray, "out"]
    contacts: tuple[SecondContact, ...] = ()
    unrest: float = 0.0
    reasons: tuple[Reason, ...] = ()
    remarks: tuple[Remark, ...] = ()
    used: bool = False
    force: float = 0.0
    samples: bytes = b""

    @property
    def second(self) -> SecondContact | None:
        """The strongest further contact."""
        return max(self.contacts, key=lambda contact: contact.ratio, default=None)

    @property
    def error(self) -> float:
        """Relative error that the impact causes in the processed FRF."""
        return max((reason.error for reason in self.reasons), default=0.0)

    @property
    def asked(self) -> bool:
        """Whether somebody excludes it."""
        return any(reason.code in ASKED for reason in self.reasons)

    @property
    def biased(self) -> bool:
        """Whether its error is larger than what is tolerated."""
        return self.error > TOLERATED

    @property
    def clean(self) -> bool:
        """Whether nothing counts against it but small further contacts, which are part of the measured force."""
        small = self.second is None or self.second.ratio <= ONE_LEVEL
        return not self.biased and all(reason.code == "double-hit" and small for reason in self.reasons)

    def because(self, code: str, text: str, error: float = np.inf) -> "Judged":
        """The impact with one more reason against it."""
        return replace(self, reasons=(*self.reasons, Reason(code, text, error)))


def judge_record(
    record: Recording, layout: Layout, place: int, trigger: float | None, alone: bool = False
) -> list[Judged]:
    """All impacts of a record, each judged by itself; ``alone`` where the record is known to hold one."""
    force = record.signals[layout.references[0]]
    pulses, offset, noise = find_pulses(force, record.sampling_rate, trigger)
    impacts = impacts_of(pulses, record.sampling_rate, alone)
    if not impacts:
        return []
    mains = [max(impact, key=lambda pulse: abs(pulse.peak)) for impact in impacts]
    rooms = _rooms([impact[0].start for impact in impacts], len(force), record.sampling_rate)
    seen = [
        (before + main.start - impact[0].start, after - main.start + impact[0].start)
        for impact, main, (before, after) in zip(impacts, mains, rooms)
    ]
    further = second_contacts(force, mains, seen, offset, noise)
    judged = []
    for index, (impact, main, (before, after), contacts) in enumerate(zip(impacts, mains, rooms, further)):
        contacts += tuple(
            SecondContact(pulse.top, abs(pulse.peak / main.peak), pulse.start, pulse.stop + 1)
            for pulse in impact
            if pulse is not main
        )
        start = min([impact[0].start, *(contact.first for contact in contacts)])
        before, after = max(before + start - impact[0].start, 0), after - start + impact[0].start
        rest, quiet = _quiet(record, layout.responses, start, before)
        one = Judged(
            place, record.name, index, layout.inputs[0], main, start, offset, before, after, rest, quiet, contacts
        )
        judged.append(_judge(one, record, layout))
    judged = _reported_overloads(judged, record, layout)
    excluded = dict(record.excluded_hits)
    return [
        one.because("excluded-impact", f"excluded: {excluded[one.index]}") if one.index in excluded else one
        for one in judged
    ]


def with_contacts(one: Judged, contacts: tuple[SecondContact, ...], rate: float) -> Judged:
    """An impact with these further contacts and the reason that follows from the strongest of them."""
    others = tuple(reason for reason in one.reasons if reason.code != "double-hit")
    one = replace(one, contacts=contacts, reasons=others)
    if one.second is None:
        return one
    delay = 1e3 * (one.second.sample - one.pulse.top) / rate
    text = f"second contact of {100 * one.second.ratio:.2g} %, {delay:+.1f} ms from the peak"
    return one.because("double-hit", text, 0.0)


def _rooms(starts: Sequence[int], samples: int, rate: float) -> list[tuple[int, int]]:
    """Samples before and after the beginning of each impact that are free of its neighbours."""
    margin = int(PRE_TRIGGER * rate)
    before = [starts[0], *(min((b - a) // 2, margin) for a, b in pairwise(starts))]
    after = [b - quiet - a for a, b, quiet in zip(starts, starts[1:], before[1:])]
    return list(zip(before, [*after, samples - starts[-1]]))


def _quiet(
    record: Recording, rows: tuple[int, ...], start: int, before: int
) -> tuple[Float[np.ndarray, "out"], Float[np.ndarray, "out"]]:
    """Mean and rms about it of the responses before an impact; of the whole record and 0 where there is too little."""
    part = record.signals[list(rows), max(start - before, 0) : max(start - 1, 0)]
    if part.shape[1] < FEW:
        return np.array([record.signals[row].mean(dtype=np.float64) for row in rows]), np.zeros(len(rows))
    part = part[:, -1024:]
    return part.mean(axis=1, dtype=np.float64), part.std(axis=1, dtype=np.float64)


def _judge(impact: Judged, record: Recording, layout: Layout) -> Judged:
    """Reasons and remarks that need the signals of one impact."""
    if impact.start == 0:
        begun = min(abs(float(record.signals[layout.references[0], 0]) - impact.offset) / abs(impact.pulse.peak), 1.0)
        # a half sine that is cut off at this height has lost (1 - cos(arcsin(height))) / 2 of its impulse
        lost = 0.5 * (1 - np.sqrt(1 - begun**2))
        if lost > TOLERATED:
            text = f"the record begins in the middle of the impact, at {100 * begun:.0f} % of its peak"
            impact = impact.because("pre-trigger", text, float(lost))
    impact = with_contacts(impact, impact.contacts, record.sampling_rate)
    rows = [*layout.references, *layout.responses]
    # A view, not a copy, in the usual order of channels.
    usual = slice(len(rows)) if rows == list(range(len(rows))) else rows
    part = record.signals[usual, impact.start : impact.start + impact.after]
    tops, bottoms = part.argmax(axis=1), part.argmin(axis=1)
    every = np.arange(len(rows))
    high, low = part[every, tops], part[every, bottoms]
    for number, row in enumerate(rows):
        clipped = overload(part[number], record.channels[row], (int(tops[number]), int(bottoms[number])))
        if clipped is not None:
            share = float(np.mean(np.abs(part[number]) >= FULL_SCALE * abs(clipped)))
            text = f"channel {record.channels[row].name} is overloaded at {clipped:.4g}"
            # what is cut off is unknown: of several overloads the one that lasts shortest is the least
            impact = impact.because("overload", text, 1.0 + share)
    rest = np.concatenate([[impact.offset], impact.rest])
    peaks = np.maximum(high - rest, rest - low)
    remarks = []
    for row, peak in zip(rows, peaks):
        channel = record.channels[row]
        if channel.range and peak < UNDER_RANGE * channel.range:
            remarks.append(Remark("under-range", channel.name, float(peak / channel.range), UNDER_RANGE))
    names = [record.channels[row].name for row in layout.responses]
    steadiness, unrest = _steadiness(part[1:], names, impact, peaks[1:])
    farthest = float(high[0] if high[0] >= -low[0] else low[0])
    fingerprint = hashlib.blake2b(np.ascontiguousarray(part).tobytes(), digest_size=16).digest()
    return replace(impact, remarks=(*remarks, *steadiness), unrest=unrest, force=farthest, samples=fingerprint)


def _steadiness(
    signals: Float[np.ndarray, "out sample"], names: list[str], one: Judged, peaks: Float[np.ndarray, "out"]
) -> tuple[list[Remark], float]:
    """Whether the responses were at rest before an impact and have the same mean long after it; rms before over rms
    behind it."""
    if not one.quiet.any():
        return [], 0.0
    few = max(signals.shape[1] // 20, FEW)
    level = np.sqrt(np.mean((signals[:, :few] - one.rest[:, None]) ** 2, axis=1))
    late = signals[:, -4 * few :]
    shift = np.abs(late.mean(axis=1) - one.rest)
    shifted = shift > np.maximum(DC_SHIFT * peaks, 3 * one.quiet)
    if shifted.any():
        shifted &= shift > 0.5 * late.std(axis=1)
    restless = one.quiet > NOT_AT_REST * level
    remarks = [
        Remark("not-at-rest", names[row], float(one.quiet[row] / max(level[row], 1e-300)), NOT_AT_REST)
        for row in np.flatnonzero(restless)
    ]
    remarks += [
        Remark("dc-shift", names[row], float(shift[row] / peaks[row]), DC_SHIFT) for row in np.flatnonzero(shifted)
    ]
    return remarks, float(np.max(one.quiet / np.maximum(level, 1e-300)))


def overload(
    signal: Float[np.ndarray, "sample"], channel: Channel, extremes: tuple[int, int] | None = None
) -> float | None:
    """The value at which a signal is clipped; ``None`` where it is not.

    Clipped is what reaches 98 % of the full scale, or has at least three samples on its extreme although the slope
    beside them is steep (a rounded top that the converter resolves coarsely is flat, but not steep beside).
    """
    for place in extremes or (int(signal.argmax()), int(signal.argmin())):
        value = float(signal[place])
        if channel.range is not None and abs(value) >= FULL_SCALE * channel.range:
            return value
        equal = signal[place : place + CLIPPED_WITHIN] == value
        if np.count_nonzero(equal) >= 3 and _steep(signal, place, equal):
            return value
    return None


def _steep(signal: Float[np.ndarray, "sample"], place: int, equal: Bool[np.ndarray, "some"]) -> bool:
    """Whether a signal falls by more than a few steps of the converter beside its flat extreme.

    Extremes that are equal but apart count only where the converter resolves far better than that.
    """
    steps = np.abs(np.diff(signal[max(place - 32, 0) : place + 96]))
    steps = steps[steps > 0]
    if len(steps) == 0:
        return False
    step = float(steps.min())
    run = int(np.argmin(equal)) if not equal.all() else len(equal)
    if run < 3 and step > 1e-3 * abs(float(signal[place])):
        return False
    beside = [abs(float(signal[place] - signal[at])) for at in (place - 1, place + run) if 0 <= at < len(signal)]
    return max(beside) > 4 * step


def _reported_overloads(judged: list[Judged], record: Recording, layout: Layout) -> list[Judged]:
    """An overload that the front end reports and no impact shows may be in any of them."""
    if record.overloads is None:
        return judged
    for row in (*layout.references, *layout.responses):
        name = record.channels[row].name
        if record.overloads[row] and not any(
            reason.code == "overload" and f"channel {name} " in reason.text for one in judged for reason in one.reasons
        ):
            text = f"channel {name} was overloaded at some time in the record, says the front end"
            judged = [one.because("overload", text, 1.0) for one in judged]
    return judged
