"""FRFs of a hammer test."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import add
from typing import NamedTuple

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, Hit, HitGallery, Provenance, Recording, Run
from ema.data.stored_signals import StoredSignals
from ema.deprecation import fields_as_arguments
from ema.dof import Dof
from ema.errors import InputError
from ema.estimate import (
    applied_window,
    breaks,
    channels,
    clipping,
    equal_channels,
    equal_impacts,
    hammer_findings,
    impact_choice,
    impact_noise,
    single_input,
)
from ema.estimate.block_end import RingDown, ring_down
from ema.estimate.channel_swap import probably_swapped
from ema.estimate.force_noise import LESS_NOISE, AtRest
from ema.estimate.judge import Judged, judge_record
from ema.estimate.levels import LevelEffect, level_bins, level_effect
from ema.estimate.record_agreement import SingleBlocks, about_impacts
from ema.estimate.single_impacts import SingleImpacts
from ema.estimate.single_input import Sums
from ema.estimate.spectra import Estimator
from ema.estimate.windows import exponential_window, force_window
from ema.progress import Progress, advance, silent

KEPT_IN_MEMORY = 256 * 2**20
"""Bytes of records that are kept between the two passes; larger runs are read twice."""

LONGEST_PADDED = 4
"""Blocks are filled up with zeros to a length asked for, up to so many times the room of the longest impact.

Zeros make lines denser, not better resolved: more than a few times as many is a mistake, and may fill the memory.
"""

SHORT = 0.8
"""Room behind an impact, relative to the median, below which it is given up rather than all blocks shortened."""

SAMPLED_IMPACTS = 40
"""Impacts that are enough to see how far the response decays."""

_Key = tuple[Dof, tuple[Dof, ...]]


@dataclass(frozen=True)
class HammerSettings:
    """How the FRFs of a hammer test are estimated.

    Parameters
    ----------
    estimator : {"H1", "H2", "Hv"}, default "H1"
        ``H1`` (noise on the responses), ``H2`` (noise on the force) or ``Hv``.
    block : int, optional
        Samples per block; by default from impact to impact, or to the end of the record.
    trigger : float, optional
        Force [N] above its offset that counts as an impact; by default from the noise and the strongest impact.
    level : tuple of (float, float), optional
        Peak forces [N] to use, ``(lowest, highest)``; by default all.
    decay : float, optional
        Decay rate [1/s] of an exponential window; by default none unless the response still rings at the end of the
        block. It is applied to force and response, and passed on in ``FrfSet.added_decay``.
    window_force : bool, default True
        Replace the force outside its contacts by zero.
    less_noise : bool, default True
        Take noise of the force channel off H1 where it matters, as the samples before the impacts show it
        (:mod:`ema.estimate.impact_noise`).
    keep : sequence of str, optional
        Impacts to use whatever is wrong with them, by ``"all"``, by fault (``"double-hit"``, ``"overload"``,
        ``"pre-trigger"``, ``"next-impact"``, ``"early-impact"``), by record or point (``"12:+Z"``), or by their number
        from 0 in one of these (``"12:+Z#3"``). What ``reject``, ``level`` and the campaign leave out stays out.
    reject : sequence of str, optional
        Impacts not to use, named in the same way.

    Examples
    --------
    >>> HammerSettings(decay=2.0).estimator
    'H1'
    """

    estimator: Estimator = "H1"
    block: int | None = None
    trigger: float | None = None
    level: tuple[float, float] | None = None
    decay: float | None = None
    window_force: bool = True
    less_noise: bool = True
    keep: Sequence[str] = ()
    reject: Sequence[str] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "keep", tuple(self.keep))
        object.__setattr__(self, "reject", tuple(self.reject))


DEFAULTS = HammerSettings()


class _Blocks(NamedTuple):
    """How blocks are cut from the records: samples of a block, how many of them lie before the impact at most, and the
    decay rate [1/s] of the exponential window (0 for none).
    """

    length: int
    before: int
    decay: float


@dataclass
class _Averaged:
    """Sums over the impacts, the impacts themselves while they are small, and the mean energy of the noise of the force
    at each of its DOFs that is to be taken off H1."""

    sums: dict[_Key, Sums] = field(default_factory=dict)
    single: SingleImpacts = field(default_factory=SingleImpacts)
    noise: Mapping[Dof, AtRest] = field(default_factory=dict)


@dataclass
class _Takes:
    """The records of a run, kept while they are small."""

    records: Sequence[Recording]
    kept: dict[int, Recording] = field(default_factory=dict)
    size: int = 0

    def __getitem__(self, place: int) -> Recording:
        if place in self.kept:
            return self.kept[place]
        record = self.records[place]
        size = 0 if isinstance(record.signals, StoredSignals) else record.signals.nbytes
        if isinstance(self.records, tuple | list) or self.size + size <= KEPT_IN_MEMORY:
            self.kept[place] = record
            self.size += size
        return record


@fields_as_arguments("settings", HammerSettings)
def hammer(
    run: Run,
    settings: HammerSettings = DEFAULTS,
    progress: Progress = silent,
) -> FrfSet:
    """Estimate the FRFs of a hammer test.

    Parameters
    ----------
    run : Run
        A hammer test.
    settings : HammerSettings, optional
        Estimator, blocks, windows and choice of impacts.
    progress : Progress, optional
        Called as the records are read.

    Returns
    -------
    FrfSet
        The FRFs, without the impacts.

    Raises
    ------
    InputError
        As :func:`hammer_test`.

    Examples
    --------
    >>> from ema.examples import campaign
    >>> hammer(campaign()["bare"]).quantity
    'accelerance'
    """
    return hammer_test(run, settings, progress)[0]


@fields_as_arguments("settings", HammerSettings)
def hammer_test(
    run: Run,
    settings: HammerSettings = DEFAULTS,
    progress: Progress = silent,
) -> tuple[FrfSet, HitGallery]:
    """Estimate the FRFs of a hammer test, with all its impacts.

    An impact is left out by the error that it causes in the processed FRF (see :mod:`ema.estimate.impact_choice`); a
    point whose impacts all have faults gets the best estimate they allow, with a finding ``best-effort``.

    Parameters
    ----------
    run : Run
        Every record has one reference channel (the hammer), whose DOF says where it struck, one or more responses, and
        one impact or many. Impacts on the same DOF are averaged, over records too.
    settings : HammerSettings, optional
        Estimator, blocks, windows and choice of impacts.
    progress : Progress, optional
        Called as the records are read.

    Returns
    -------
    tuple of (FrfSet, HitGallery)
        The FRFs, and every impact with what became of it.

    Raises
    ------
    InputError
        If a record cannot be used (no force, no response, not a number, too short), the force never triggers, or every
        impact is excluded by the settings or the campaign.

    Examples
    --------
    >>> from ema.examples import campaign
    >>> frfs, gallery = hammer_test(campaign()["bare"])
    >>> len(gallery.accepted), frfs.unit
    (1, '(m/s^2)/N')
    """
    where = channels.describe(run)
    takes = _Takes(channels.recordings_of(run))
    scanned, findings = _scan(run, takes, settings, progress)
    rate = takes[0].sampling_rate
    length, before = _block(scanned, settings)
    judged = impact_choice.with_room(scanned, length, before, rate, settings.level)
    ring = _ring_down(takes, judged, length, rate)
    added = ring.needed if settings.decay is None else settings.decay
    judged = impact_choice.with_errors(judged, length, before, rate, ring, added)
    judged = impact_choice.chosen(judged, settings.keep, settings.reject)
    if not any(one.used for one in judged):
        raise InputError(
            "no impact is left",
            where=where,
            got="; ".join(sorted({one.reasons[0].text for one in judged})[:3]),
            advice="all of them are excluded by the settings or the campaign",
        )
    averaged, effects = _Averaged(), list[LevelEffect]()
    sums, single = averaged.sums, averaged.single
    blocks = _Blocks(length, before, added)
    names = dict[_Key, list[str]]()
    for key, used, parts, effect in _transformed(run, takes, judged, blocks, settings, progress):
        sums[key] = reduce(add, parts, sums[key]) if key in sums else reduce(add, parts)
        single.keep(key, parts)
        names.setdefault(key, []).extend(f"{one.record}, impact {one.index}" for one in used)
        effects += [effect] if effect is not None else []
    gallery = _gallery(takes, judged, sums, length, rate)
    if settings.estimator == "H1" and settings.less_noise:
        averaged.noise, about = _force_noise(
            takes, judged, sums, blocks=blocks, gallery=gallery, windowed=settings.window_force, where=where
        )
        findings += about
    findings += [
        *clipping.about_normal_forces(run),
        *breaks.about_breaks(run),
        *equal_channels.about_channels(run),
        *hammer_findings.about_force(judged, where),
        *hammer_findings.about_impacts(judged, where),
        *hammer_findings.about_points(judged, where),
        *hammer_findings.about_selection(judged, (*settings.keep, *settings.reject), where),
        *hammer_findings.about_window(ring, added, settings.decay is not None, where),
        *applied_window.about_applied_window(_noise_decays(takes, judged, rate), where),
        *hammer_findings.about_levels(effects, level_bins(gallery), where),
        *_about_points(single, names, where),
        *hammer_findings.about_band(gallery.usable_band, float(gallery.frequencies[-1]), where),
    ]
    return _assemble(run, takes[0], averaged, blocks, settings, findings), gallery


def _scan(run: Run, takes: _Takes, settings: HammerSettings, progress: Progress) -> tuple[list[Judged], list[Finding]]:
    """Every impact of the run, judged by itself."""
    judged: dict[int, list[Judged]] = {}
    layouts: list[channels.Layout] = []
    swapped: list[tuple[str, str]] = []
    for place in range(len(takes.records)):
        record = takes[place]
        layout = _checked(run, record, takes[0].sampling_rate)
        judged[place] = judge_record(record, layout, place, settings.trigger)
        layouts.append(layout)
        if (response := probably_swapped(record, layout)) is not None:
            swapped.append((record.channels[layout.references[0]].name, response))
        advance(progress, "finding impacts", place + 1, len(takes.records))
    counts = np.array([len(own) for own in judged.values()])
    if len(counts) > 1 and np.mean(counts == 1) > 0.5:  # one impact per record: all pulses of a record are contacts
        for number in np.flatnonzero(counts > 1).tolist():
            judged[number] = judge_record(takes[number], layouts[number], number, settings.trigger, alone=True)
    findings = hammer_findings.about_swap(swapped, len(counts), channels.describe(run))
    silence = [channels.describe(run, takes[place]) for place, own in judged.items() if not own]
    if len(silence) == len(counts):
        raise InputError(
            "the force channel never triggers",
            where=channels.describe(run),
            got=f"no impact in {len(counts)} record{'s' if len(counts) > 1 else ''}",
            advice=findings[0].message if findings else "check the hammer's channel, or lower the trigger",
        )
    findings += [
        Finding(
            "error",
            "no-trigger",
            where,
            "the force channel never triggers: the record is not used.",
            None,
            None,
            "Check the hammer's channel, or give the trigger level.",
        )
        for where in silence
    ]
    impacts = [one for own in judged.values() for one in own]
    findings += equal_impacts.about_copies(impacts, channels.describe(run))
    return equal_impacts.with_saturation(impacts), findings


def _checked(run: Run, record: Recording, rate: float) -> channels.Layout:
    """The layout of a record that can be used."""
    where = channels.describe(run, record)
    layout = channels.layout(record, where)
    channels.finite(record, layout, where)
    if len(layout.references) > 1:
        raise InputError(
            "a record of a hammer test has one force channel",
            where=where,
            got=f"{len(layout.references)}",
            advice="give the other channels another role",
        )
    if record.sampling_rate != rate:
        raise InputError(
            "the records of the run differ in sampling rate",
            where=where,
            got=f"{record.sampling_rate:g} Hz",
            expected=f"{rate:g} Hz",
        )
    return layout


def _block(judged: list[Judged], settings: HammerSettings) -> tuple[int, int]:
    """Samples per block and samples before the trigger that belong to it, half a contact at most.

    A response that the block cuts off is a sum of poles on its lines only where the block begins with it: a thousandth
    that is left turns with the lines otherwise, which looks like a part of the peaks that is not causal.
    """
    usable = _best_of_points(judged)
    before = int(min(np.median([one.before for one in usable]), np.median([one.after for one in usable]) // 20))
    before = min(before, _half_contact(judged))
    if settings.block is not None:
        if settings.block < 16:
            raise InputError("the block is too short", got=f"{settings.block} samples", expected="at least 16")
        longest = max(one.before + one.after for one in judged)
        if settings.block > LONGEST_PADDED * longest:
            raise InputError(
                "the block is longer than the records",
                where=judged[0].record,
                got=f"{settings.block} samples",
                expected=f"at most {LONGEST_PADDED * longest}, {LONGEST_PADDED} times the room of the longest impact",
                advice="leave block out: it is then what the impacts have room for",
            )
        return settings.block, min(before, settings.block // 20)
    rooms = np.array([min(one.before, before) + one.after for one in usable])
    # A few impacts that were followed by another one too early do not shorten the blocks of all, unless their point
    # has no better ones.
    long = rooms >= SHORT * np.median(rooms)
    room = rooms[long].min() if np.mean(long) >= 2 / 3 else np.quantile(rooms, 0.1, method="lower")
    best = {one.dof: 0 for one in usable}
    for one, own in zip(usable, rooms):
        best[one.dof] = max(best[one.dof], int(own))
    room = min(int(room), *best.values())
    return room if room < 64 else _fast_length(room), before


def _half_contact(judged: list[Judged]) -> int:
    """Half the usual contact in samples: what the filters of the front end put before an impact is shorter."""
    return int(np.median([one.pulse.stop - one.pulse.start for one in judged])) // 2


def _best_of_points(judged: list[Judged]) -> list[Judged]:
    """The impacts that the block has to hold: of each point those without fault, or all that nobody excludes."""
    usable = [one for one in judged if one.clean]
    points = {one.dof for one in usable}
    usable += [one for one in judged if one.dof not in points and not one.asked]
    return usable or judged


def _fast_length(samples: int) -> int:
    """Longest even length up to ``samples`` whose Fourier transform is fast."""
    length = samples - samples % 2
    while scipy.fft.next_fast_len(length, real=True) != length:
        length -= 2
    return length


def _ring_down(takes: _Takes, judged: list[Judged], length: int, rate: float) -> RingDown:
    """How far the response has decayed at the end of the blocks, from a sample of them."""
    usable = [one for one in judged if one.clean] or [one for one in judged if not one.asked] or judged
    samples = min(length, min(one.after for one in usable))
    blocks = []
    for one in usable[:: max(len(usable) // SAMPLED_IMPACTS, 1)]:
        record = takes[one.place]
        rows = list(record.with_role("response"))
        blocks.append((record.signals[rows, one.start : one.start + samples], one.rest, one.quiet))
    return ring_down(blocks, rate)


def _noise_decays(takes: _Takes, judged: list[Judged], rate: float) -> Iterator[tuple[float, float]]:
    """How the noise of the responses falls in a sample of the records that hold one impact."""
    counts = Counter(one.place for one in judged)
    single = [one for one in judged if counts[one.place] == 1]
    for one in single[:: max(len(single) // SAMPLED_IMPACTS, 1)]:
        yield from applied_window.noise_decay(takes[one.place], one.start - 2, rate)


def _transformed(
    run: Run, takes: _Takes, judged: list[Judged], blocks: _Blocks, settings: HammerSettings, progress: Progress
) -> Iterator[tuple[_Key, list[Judged], list[Sums], LevelEffect | None]]:
    """The impacts used of each record and the sums of their spectra, under (force DOF, response DOFs)."""
    for place in range(len(takes.records)):
        accepted = [one for one in judged if one.place == place and one.used]
        if accepted:
            record = takes[place]
            layout = channels.layout(record, channels.describe(run, record))
            spectra = [_spectra(record, layout, one, blocks, settings.window_force) for one in accepted]
            peaks = np.array([abs(one.pulse.peak) for one in accepted])
            effect = level_effect(spectra, peaks)
            parts = [single_input.summed(force, response) for force, response in spectra]
            yield (layout.inputs[0], layout.outputs), accepted, parts, effect
        advance(progress, "transforming impacts", place + 1, len(takes.records))


def _about_points(single: SingleImpacts, names: Mapping[_Key, Sequence[str]], where: str) -> Iterator[Finding]:
    """Channels that an impact gives FRFs of another level or sign than the others at its point."""
    for key, parts in single.sums.items():
        blocks = SingleBlocks()
        for name, part in zip(names[key], parts, strict=True):
            frfs = part.cross * single_input.reciprocal(part.force)
            weight = np.broadcast_to(part.force, frfs.shape)
            blocks.keep(name, frfs.T[:, :, None], weight.T[:, :, None])
        yield from about_impacts(blocks, [str(dof) for dof in key[1]], f"{where}, point {key[0]}")


def _spectra(
    record: Recording, layout: channels.Layout, one: Judged, blocks: _Blocks, windowed: bool
) -> tuple[Complex[np.ndarray, "freq"], Complex[np.ndarray, "out freq"]]:
    """Fourier transforms of force and responses of an impact; zeros follow where its room is shorter than the block."""
    length, before, decay = blocks
    start, window = _force_window(one, blocks, record.sampling_rate, windowed)
    room = min(length, impact_choice.room_of(one, before))
    force = record.signals[layout.references[0]]
    pulse = (force[start : start + len(window)] - one.offset) * window.astype(force.dtype)
    rows = list(layout.responses)
    block = record.signals[rows[0] : rows[-1] + 1, start : start + room]
    if rows != list(range(rows[0], rows[-1] + 1)):
        block = record.signals[rows, start : start + room]
    if decay > 0:
        window = exponential_window(room, one.start - start, record.sampling_rate, decay).astype(block.dtype)
        block = (block - one.rest.astype(block.dtype)[:, None]) * window
    elif room < length:
        block = block - one.rest.astype(block.dtype)[:, None]
    response = scipy.fft.rfft(block, length, axis=1)
    if decay == 0 and room == length:
        response[:, 0] -= length * one.rest  # without a window the offset lives in this line only
    return scipy.fft.rfft(pulse, length), response


def _force_window(one: Judged, blocks: _Blocks, rate: float, windowed: bool) -> tuple[int, Float[np.ndarray, "some"]]:
    """First sample of a block, and the window over its force: with a taper over its contacts, the main one up to twice,
    or over all of it, times the exponential window."""
    start = one.start - min(one.before, blocks.before)
    length = min(blocks.length, impact_choice.room_of(one, blocks.before))
    window = _contacts(one, start, length) if windowed else np.ones(length)
    if blocks.decay > 0:
        window = window * exponential_window(len(window), one.start - start, rate, blocks.decay)
    return start, window


def _contacts(one: Judged, start: int, length: int) -> Float[np.ndarray, "some"]:
    """Window over the contacts of an impact up to the end of the last one."""
    contact = max(one.pulse.stop - one.pulse.start, 4)
    main = one.pulse.start
    spans = [(max(main - contact // 20, start), main + 2 * contact + 8)]
    spans += [(max(contact.first, start), contact.last) for contact in one.contacts]
    end = min(max(last for _, last in spans) + contact - start, length)
    taper = contact // 2
    window = np.zeros(end)
    for first, last in spans:
        low, high = max(first - start - taper - 1, 0), min(last - start + taper + 1, end)
        if low < high:
            some = force_window(high - low, first - start - low, min(last - start, end) - low, taper)
            window[low:high] = np.maximum(window[low:high], some)
    return window


def _force_noise(
    takes: _Takes,
    judged: list[Judged],
    sums: Mapping[_Key, Sums],
    *,
    blocks: _Blocks,
    gallery: HitGallery,
    windowed: bool,
    where: str,
) -> tuple[dict[Dof, AtRest], list[Finding]]:
    """Mean energy of the noise inside the windows of each force where it matters and is known, with findings."""
    quiet = _quiet(takes, judged)
    frequencies = np.asarray(gallery.frequencies)
    band = (frequencies > 0) & (frequencies <= gallery.usable_band[1])
    bias, lost, noise = np.zeros(len(frequencies)), np.zeros(len(frequencies), bool), dict[Dof, AtRest]()
    for (dof, _), part in sums.items():
        if dof not in noise:
            own = [one for one in judged if one.used and one.dof == dof]
            used = [_force_window(one, blocks, takes[0].sampling_rate, windowed)[1] for one in own]
            noise[dof] = impact_noise.noise_energy(quiet, used, blocks.length)
        less = impact_noise.less_noise(part, noise[dof])
        bias, lost = np.maximum(bias, less.bias), lost | (less.weak >= 1)
    few = min(one.averages for one in noise.values()) < impact_noise.ENOUGH
    reason = quiet.reason or (impact_noise.SHORT if few else "")
    findings = impact_noise.about_noise(bias, lost, frequencies, band, reason=reason, where=where)
    return noise if findings and not reason else {}, findings


def _quiet(takes: _Takes, judged: list[Judged]) -> impact_noise.Quiet:
    """Noise of the force before a sample of the impacts that are used."""
    numbers = [number for number, one in enumerate(judged) if one.used]
    parts = []
    for number in numbers[:: max(len(numbers) // SAMPLED_IMPACTS, 1)]:
        one, earlier = judged[number], judged[number - 1] if number else None
        force = takes[one.place].signals[takes[one.place].with_role("reference")[0]]
        same = earlier is not None and earlier.place == one.place
        parts.append(impact_noise.quiet_part(force, one, earlier if same else None))
    known = [part for part in parts if part is not None]
    return impact_noise.quiet(known) if known else impact_noise.level_alone(force)


def _assemble(
    run: Run,
    first: Recording,
    averaged: _Averaged,
    blocks: _Blocks,
    settings: HammerSettings,
    findings: list[Finding],
) -> FrfSet:
    """The FRF set of all sums."""
    length, _, decay = blocks
    sums = _without_overlap(averaged.sums)
    inputs = tuple(dict.fromkeys(force for force, _ in sums))
    outputs = tuple(dict.fromkeys(dof for _, dofs in sums for dof in dofs))
    lines = length // 2 + 1
    shape = (len(inputs), len(outputs), lines)
    values, coherence, variance = np.empty(shape, complex), np.empty(shape), np.empty(shape)
    if sum(len(dofs) for _, dofs in sums) < len(inputs) * len(outputs):
        for array in (values, coherence, variance):
            array[:] = np.nan  # pairs that nobody measured
    averages = np.zeros((len(outputs), len(inputs)))
    for (force, dofs), part in sums.items():
        column, rows = inputs.index(force), [outputs.index(dof) for dof in dofs]
        values[column, rows], coherence[column, rows], variance[column, rows] = single_input.estimate(
            part, settings.estimator
        )
        averages[rows, column] = part.averages
    factor = single_input.over_h1(coherence, settings.estimator)
    if averaged.noise:
        factor = np.ones(shape)
        for (force, dofs), part in sums.items():
            column, rows = inputs.index(force), [outputs.index(dof) for dof in dofs]
            less = impact_noise.less_noise(part, averaged.noise[force])
            factor[column, rows] = less.factor
            values[column, rows] *= less.factor
            variance[column, rows] = less.variance(values[column, rows], variance[column, rows])
    where = channels.describe(run, first)
    layout = channels.layout(first, where)
    quantity, unit = channels.frf_quantity(
        [first.channels[row] for row in layout.responses], [first.channels[row] for row in layout.references], where
    )
    findings += hammer_findings.about_units(unit, channels.describe(run))
    return FrfSet(
        frequencies=scipy.fft.rfftfreq(length, 1 / first.sampling_rate),
        values=values.transpose(2, 1, 0),
        outputs=outputs,
        inputs=inputs,
        quantity=quantity,
        unit=unit,
        coherence=coherence.transpose(2, 1, 0),
        variance=variance.transpose(2, 1, 0),
        estimator=LESS_NOISE if averaged.noise else settings.estimator,
        averages=averages,
        added_decay=decay,
        record_length=length / first.sampling_rate,
        window="exponential" if decay > 0 else "rectangular",
        condition=run.condition,
        name=run.id,
        findings=tuple(findings),
        provenance=Provenance(
            steps=("estimate.hammer",), options=tuple((name, str(value)) for name, value in vars(settings).items())
        ),
        deviations=averaged.single.deviations(values, sums, outputs, inputs, factor),
    )


def _without_overlap(sums: dict[_Key, Sums]) -> dict[_Key, Sums]:
    """The same sums, one response at a time where a pair was measured in several set-ups of the accelerometers."""
    pairs = [(force, dof) for force, dofs in sums for dof in dofs]
    if len(set(pairs)) == len(pairs):
        return sums
    single: dict[_Key, Sums] = {}
    for (force, dofs), part in sums.items():
        for row, dof in enumerate(dofs):
            own = Sums(part.force, part.cross[row : row + 1], part.response[row : row + 1], part.averages)
            key = (force, (dof,))
            single[key] = single[key] + own if key in single else own
    return single


def _gallery(takes: _Takes, judged: list[Judged], sums: dict[_Key, Sums], length: int, rate: float) -> HitGallery:
    """The impacts and the mean energy spectrum of those used."""
    total = np.zeros(length // 2 + 1)
    for part in sums.values():
        total += part.force
    spectrum = total / sum(part.averages for part in sums.values()) / rate**2
    frequencies = scipy.fft.rfftfreq(length, 1 / rate)
    return HitGallery(
        tuple(_hit(one, takes[one.place]) for one in judged), frequencies, spectrum, usable_band(frequencies, spectrum)
    )


def _hit(one: Judged, record: Recording) -> Hit:
    """An impact as the gallery holds it; with a second contact its pulse reaches as far."""
    rate, pulse = record.sampling_rate, one.pulse
    force = record.signals[record.with_role("reference")[0]]
    contact = pulse.stop - pulse.start + 1
    first, last = max(pulse.start - contact, 0), pulse.stop + 4 * contact
    if one.second is not None:
        first, last = max(min(first, one.second.sample - 2 * contact), 0), max(last, one.second.sample + 2 * contact)
    return Hit(
        recording=one.record,
        index=one.index,
        dof=one.dof,
        time=one.start / rate,
        peak=pulse.peak,
        impulse=float((force[pulse.start : pulse.stop + 1] - one.offset).sum() / rate),
        contact_time=(pulse.stop - pulse.start) / rate,
        accepted=one.used,
        reason="; ".join(reason.text for reason in one.reasons),
        pulse=force[first:last] - one.offset,
        sampling_rate=rate,
    )


def usable_band(frequencies: Float[np.ndarray, "freq"], spectrum: Float[np.ndarray, "freq"]) -> tuple[float, float]:
    """Frequencies in Hz at which the force spectrum has fallen by 10 and by 20 dB below its low-frequency level."""
    smooth = single_input.pooled(spectrum[None, :])[0]
    level = smooth[: max(len(smooth) // 2, 1)].max()
    edges = []
    for fall in (0.1, 0.01):
        below = np.flatnonzero(smooth < fall * level)
        below = below[below > np.argmax(smooth)]
        edges.append(float(frequencies[below[0]]) if len(below) else float(frequencies[-1]))
    return edges[0], edges[1]
