"""Which blows of a hammer test can be used, and why the others cannot."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from ema.data import Channel, Recording
from ema.dof import Dof
from ema.estimate.blows import Blow, find_blows
from ema.estimate.channels import Layout
from ema.estimate.double_hits import SecondHit, second_hits

FULL_SCALE = 0.98
"""Part of a channel's range that counts as an overload."""

CLIPPED_WITHIN = 1024
"""Samples behind an extreme in which its equals are looked for."""

UNDER_RANGE = 0.1
"""Part of a channel's range that a blow should exceed."""

DC_SHIFT = 0.01
"""Change of a response's mean by a blow, relative to its peak, that betrays an overloaded or loose sensor."""

NOT_AT_REST = 0.05
"""Response before a blow relative to that behind it."""

FASTEST = 0.06
"""Seconds between two pulses below which nobody can have struck twice on purpose."""

PRE_TRIGGER = 0.05
"""Seconds before a blow that belong to it, where there are so many."""

FEW = 16
"""Samples below which statistics of the quiet before a blow say nothing."""


@dataclass(frozen=True)
class Remark:
    """Something about a blow that does not exclude it."""

    code: str
    channel: str
    value: float
    limit: float


@dataclass(frozen=True)
class Judged:
    """A blow with all that is known about it; ``reasons`` says why it is not used, empty where it is.

    ``place`` is the record's place in the run; ``before`` and ``after`` are the samples of the record that belong to
    this blow alone, seen from its trigger; ``rest`` and ``quiet`` (out,) are mean and rms of the responses before it.
    """

    place: int
    record: str
    index: int
    dof: Dof
    blow: Blow
    offset: float
    before: int
    after: int
    rest: Float[np.ndarray, "out"]
    quiet: Float[np.ndarray, "out"]
    second: SecondHit | None
    reasons: tuple[tuple[str, str], ...] = ()
    remarks: tuple[Remark, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether the blow is used."""
        return not self.reasons

    def because(self, code: str, text: str) -> "Judged":
        """The blow with one more reason against it."""
        return replace(self, reasons=(*self.reasons, (code, text)))


def judge_record(record: Recording, layout: Layout, place: int, trigger: float | None) -> list[Judged]:
    """All blows of a record, each judged by itself."""
    force = record.signals[layout.references[0]]
    blows, offset, noise = find_blows(force, record.sampling_rate, trigger)
    blows, bounces = _without_bounces(blows, record.sampling_rate)
    if not blows:
        return []
    room = _rooms(blows, len(force), record.sampling_rate)
    seconds = second_hits(force, blows, room, offset, noise)
    judged = []
    for index, (blow, (before, after), bounce, second) in enumerate(zip(blows, room, bounces, seconds)):
        rest, quiet = _quiet(record.signals, layout.responses, blow, before)
        one = Judged(
            place, record.name, index, layout.inputs[0], blow, offset, before, after, rest, quiet, bounce or second
        )
        judged.append(_judge(one, record, layout))
    judged = _reported_overloads(judged, record, layout)
    excluded = dict(record.excluded_hits)
    return [
        one.because("excluded-hit", f"excluded: {excluded[one.index]}") if one.index in excluded else one
        for one in judged
    ]


def _without_bounces(blows: list[Blow], rate: float) -> tuple[list[Blow], list[SecondHit | None]]:
    """Pulses that follow each other too fast for a hand are one blow that bounced; the strongest stands for it."""
    gaps = np.diff([blow.start for blow in blows])
    least = max(FASTEST * rate, 0.3 * float(np.median(gaps)) if len(gaps) > 2 else 0.0)
    kept: list[Blow] = []
    bounces: list[SecondHit | None] = []
    last = -np.inf
    for blow in blows:
        if blow.start - last < least:
            main, other = kept[-1], blow
            if abs(blow.peak) > abs(main.peak):
                main, other = blow, main
            kept[-1] = replace(main, start=kept[-1].start)
            bounces[-1] = SecondHit(other.top, abs(other.peak / main.peak))
        else:
            kept.append(blow)
            bounces.append(None)
        last = blow.start
    return kept, bounces


def _rooms(blows: list[Blow], samples: int, rate: float) -> list[tuple[int, int]]:
    """Samples before and after the trigger of each blow that are free of its neighbours."""
    margin = int(PRE_TRIGGER * rate)
    starts = [blow.start for blow in blows]
    before = [starts[0], *(min((b - a) // 2, margin) for a, b in pairwise(starts))]
    after = [b - quiet - a for a, b, quiet in zip(starts, starts[1:], before[1:])]
    return list(zip(before, [*after, samples - starts[-1]]))


def _quiet(
    signals: Float[np.ndarray, "channel sample"], rows: tuple[int, ...], blow: Blow, before: int
) -> tuple[Float[np.ndarray, "out"], Float[np.ndarray, "out"]]:
    """Mean and rms about it of the responses before a blow; of the whole record and 0 where there is too little."""
    part = signals[list(rows), max(blow.start - before, 0) : max(blow.start - 1, 0)]
    if part.shape[1] < FEW:
        return signals[list(rows)].mean(axis=1, dtype=np.float64), np.zeros(len(rows))
    part = part[:, -1024:]
    return part.mean(axis=1, dtype=np.float64), part.std(axis=1, dtype=np.float64)


def _judge(one: Judged, record: Recording, layout: Layout) -> Judged:
    """Reasons and remarks that need the signals of one blow."""
    blow = one.blow
    if blow.start == 0:
        one = one.because("pre-trigger", "the record begins in the middle of the blow")
    if one.second is not None:
        delay = 1e3 * (one.second.sample - blow.top) / record.sampling_rate
        one = one.because("double-hit", f"second blow of {100 * one.second.ratio:.0f} %, {delay:+.1f} ms from the peak")
    rows = [*layout.references, *layout.responses]
    # A view, not a copy, in the usual order of channels.
    signals = record.signals[: len(rows)] if rows == list(range(len(rows))) else record.signals[rows]
    part = signals[:, blow.start : blow.start + one.after]
    tops, bottoms = part.argmax(axis=1), part.argmin(axis=1)
    every = np.arange(len(rows))
    high, low = part[every, tops], part[every, bottoms]
    for number, row in enumerate(rows):
        clipped = overload(part[number], record.channels[row], (int(tops[number]), int(bottoms[number])))
        if clipped is not None:
            one = one.because("overload", f"channel {record.channels[row].name} is overloaded at {clipped:.4g}")
    rest = np.concatenate([[one.offset], one.rest])
    peaks = np.maximum(high - rest, rest - low)
    remarks = []
    for row, peak in zip(rows, peaks):
        channel = record.channels[row]
        if channel.range and peak < UNDER_RANGE * channel.range:
            remarks.append(Remark("under-range", channel.name, float(peak / channel.range), UNDER_RANGE))
    names = [record.channels[row].name for row in layout.responses]
    return replace(one, remarks=(*remarks, *_steadiness(part[1:], names, one, peaks[1:])))


def _steadiness(
    signals: Float[np.ndarray, "out sample"], names: list[str], one: Judged, peaks: Float[np.ndarray, "out"]
) -> list[Remark]:
    """Whether the responses were at rest before a blow and have the same mean long after it."""
    if not one.quiet.any():
        return []
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
    return remarks + [
        Remark("dc-shift", names[row], float(shift[row] / peaks[row]), DC_SHIFT) for row in np.flatnonzero(shifted)
    ]


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
    """An overload that the front end reports and no blow shows may be in any of them."""
    if record.overloads is None:
        return judged
    for row in (*layout.references, *layout.responses):
        name = record.channels[row].name
        if record.overloads[row] and not any(
            code == "overload" and f"channel {name} " in text for one in judged for code, text in one.reasons
        ):
            text = f"channel {name} was overloaded at some time in the record, says the front end"
            judged = [one.because("overload", text) for one in judged]
    return judged
