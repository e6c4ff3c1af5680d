"""FRFs of a hammer test."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import add

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, Hit, HitGallery, Provenance, Recording, Run
from ema.dof import Dof
from ema.errors import InputError
from ema.estimate import channels, hammer_findings, single_input
from ema.estimate.block_end import RingDown, ring_down
from ema.estimate.judge import Judged, judge_record
from ema.estimate.levels import LevelEffect, level_bins, level_effect
from ema.estimate.single_blows import SingleBlows
from ema.estimate.single_input import Sums
from ema.estimate.spectra import Estimator
from ema.estimate.windows import exponential_window, force_window
from ema.progress import Progress, advance, silent

KEPT_IN_MEMORY = 256 * 2**20
"""Bytes of records that are kept between the two passes; larger runs are read twice."""

SHORT = 0.8
"""Room behind a blow, relative to the median, below which the blow is given up rather than all blocks shortened."""

SAMPLED_BLOWS = 40
"""Blows that are enough to see how far the response decays."""

_Key = tuple[Dof, tuple[Dof, ...]]


@dataclass(frozen=True)
class Options:
    """Settings of a hammer test; see :func:`hammer_test`."""

    estimator: Estimator = "H1"
    block: int | None = None
    trigger: float | None = None
    level: tuple[float, float] | None = None
    decay: float | None = None
    window_force: bool = True


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
        if isinstance(self.records, tuple | list) or self.size + record.signals.nbytes <= KEPT_IN_MEMORY:
            self.kept[place] = record
            self.size += record.signals.nbytes
        return record


def hammer(
    run: Run,
    estimator: Estimator = "H1",
    block: int | None = None,
    trigger: float | None = None,
    level: tuple[float, float] | None = None,
    decay: float | None = None,
    window_force: bool = True,
    progress: Progress = silent,
) -> FrfSet:
    """FRFs of a hammer test; parameters and errors as in :func:`hammer_test`."""
    return hammer_test(run, estimator, block, trigger, level, decay, window_force, progress)[0]


def hammer_test(
    run: Run,
    estimator: Estimator = "H1",
    block: int | None = None,
    trigger: float | None = None,
    level: tuple[float, float] | None = None,
    decay: float | None = None,
    window_force: bool = True,
    progress: Progress = silent,
) -> tuple[FrfSet, HitGallery]:
    """FRFs of a hammer test, with all its blows.

    Parameters
    ----------
    run : every recording has one reference channel (the hammer), whose DOF says where it struck, one or more responses,
        and one blow or many. Blows on the same DOF are averaged, over recordings too.
    estimator : ``H1`` (noise on the responses), ``H2`` (noise on the force) or ``Hv``.
    block : samples per block; by default from blow to blow, or to the end of the record.
    trigger : force in N above its offset that counts as a blow; by default found from the noise and the strongest blow.
    level : peak forces in N to use, ``(lowest, highest)``; by default all.
    decay : decay rate in 1/s of an exponential window; by default none unless the response still rings at the end of
        the block. It is applied to force and response, and passed on in ``FrfSet.added_decay``.
    window_force : replace the force outside its contact by zero.

    Raises
    ------
    InputError : a record cannot be used (no force, no response, not a number, too short), the force never triggers, or
        no blow is left.
    """
    options = Options(estimator, block, trigger, level, decay, window_force)
    where = channels.describe(run)
    takes = _Takes(channels.recordings_of(run))
    judged, findings = _scan(run, takes, options, progress)
    length, before = _block(judged, options)
    judged = _within_blocks(judged, length, before, options)
    if not any(one.accepted for one in judged):
        raise InputError(
            "no blow is left", where=where, got="; ".join(sorted({one.reasons[0][1] for one in judged})[:3]),
            advice="measure again, or relax the limits",
        )  # fmt: skip
    rate = takes[0].sampling_rate
    ring = _ring_down(takes, judged, length, rate)
    added = ring.needed if decay is None else decay
    sums: dict[_Key, Sums] = {}
    blows, effects = SingleBlows(), list[LevelEffect]()
    for key, parts, effect in _transformed(run, takes, judged, length, before, added, options, progress):
        sums[key] = reduce(add, parts, sums[key]) if key in sums else reduce(add, parts)
        blows.keep(key, parts)
        effects += [effect] if effect is not None else []
    gallery = _gallery(takes, judged, sums, length, rate)
    findings += [
        *hammer_findings.about_force(judged, where),
        *hammer_findings.about_blows(judged, where),
        *hammer_findings.about_points(judged, where),
        *hammer_findings.about_window(ring, added, decay is not None, where),
        *hammer_findings.about_levels(effects, level_bins(gallery), where),
        *hammer_findings.about_band(gallery.usable_band, float(gallery.frequencies[-1]), where),
    ]
    return _assemble(run, takes[0], sums, blows, length, added, options, findings), gallery


def _scan(run: Run, takes: _Takes, options: Options, progress: Progress) -> tuple[list[Judged], list[Finding]]:
    """Every blow of the run, judged by itself."""
    judged: list[Judged] = []
    findings: list[Finding] = []
    rate = None
    for place in range(len(takes.records)):
        record = takes[place]
        where = channels.describe(run, record)
        layout = channels.layout(record, where)
        channels.finite(record, layout, where)
        if len(layout.references) > 1:
            raise InputError(
                "a record of a hammer test has one force channel", where=where, got=f"{len(layout.references)}",
                advice="give the other channels another role",
            )  # fmt: skip
        rate = record.sampling_rate if rate is None else rate
        if record.sampling_rate != rate:
            raise InputError(
                "the records of the run differ in sampling rate", where=where, got=f"{record.sampling_rate:g} Hz",
                expected=f"{rate:g} Hz",
            )  # fmt: skip
        found = judge_record(record, layout, place, options.trigger)
        if not found:
            findings.append(
                Finding(
                    "error", "no-trigger", where, "the force channel never triggers: the record is not used.", None,
                    None, "Check the hammer's channel, or give the trigger level.",
                )
            )  # fmt: skip
        judged += found
        advance(progress, "finding blows", place + 1, len(takes.records))
    if not judged:
        raise InputError(
            "the force channel never triggers", where=channels.describe(run),
            got=f"no blow in {len(takes.records)} record{'s' if len(takes.records) > 1 else ''}",
            advice="check the hammer's channel, or lower the trigger",
        )  # fmt: skip
    return judged, findings


def _block(judged: list[Judged], options: Options) -> tuple[int, int]:
    """Samples per block and samples before the trigger that belong to it."""
    usable = [one for one in judged if one.accepted] or judged
    before = int(min(np.median([one.before for one in usable]), np.median([one.after for one in usable]) // 20))
    if options.block is not None:
        if options.block < 16:
            raise InputError("the block is too short", got=f"{options.block} samples", expected="at least 16")
        return options.block, min(before, options.block // 20)
    rooms = np.array([min(one.before, before) + one.after for one in usable])
    # A few blows that were followed by another one too early do not shorten the blocks of all, unless their point has
    # no better ones.
    long = rooms >= SHORT * np.median(rooms)
    room = rooms[long].min() if np.mean(long) >= 2 / 3 else np.quantile(rooms, 0.1, method="lower")
    best = {one.dof: 0 for one in usable}
    for one, own in zip(usable, rooms):
        best[one.dof] = max(best[one.dof], int(own))
    room = min(int(room), *best.values())
    return room if room < 64 else _fast_length(room), before


def _fast_length(samples: int) -> int:
    """Longest even length up to ``samples`` whose Fourier transform is fast."""
    length = samples - samples % 2
    while scipy.fft.next_fast_len(length, real=True) != length:
        length -= 2
    return length


def _within_blocks(judged: list[Judged], length: int, before: int, options: Options) -> list[Judged]:
    """The verdicts now that the block is known: too little room, the ring-down of an earlier blow, another level."""
    verdicts: list[Judged] = []
    for number, one in enumerate(judged):
        earlier = judged[number - 1] if number and judged[number - 1].place == one.place else None
        if min(one.before, before) + one.after < length:
            one = one.because("next-blow", f"the next blow or the end of the record comes after {one.after} samples")
        if earlier is not None and one.blow.start - earlier.blow.start < 0.5 * length:
            gap = one.blow.start - earlier.blow.start
            one = one.because("next-blow", f"it follows the blow before within {gap} of {length} samples")
        if options.level is not None and not options.level[0] <= abs(one.blow.peak) <= options.level[1]:
            low, high = options.level
            one = one.because("level", f"its peak of {abs(one.blow.peak):.4g} is not in {low:g} ... {high:g}")
        verdicts.append(one)
    return verdicts


def _ring_down(takes: _Takes, judged: list[Judged], length: int, rate: float) -> RingDown:
    """How far the response has decayed at the end of the blocks, from a sample of them."""
    accepted = [one for one in judged if one.accepted]
    samples = min(length, min(one.after for one in accepted))
    blocks = []
    for one in accepted[:: max(len(accepted) // SAMPLED_BLOWS, 1)]:
        record = takes[one.place]
        rows = list(record.with_role("response"))
        start = one.blow.start
        blocks.append((record.signals[rows, start : start + samples], one.rest, one.quiet))
    return ring_down(blocks, rate)


def _transformed(
    run: Run, takes: _Takes, judged: list[Judged], length: int, before: int, decay: float, options: Options,
    progress: Progress,
) -> Iterator[tuple[_Key, list[Sums], LevelEffect | None]]:  # fmt: skip
    """Sums of spectra of the blows of each record, under (force DOF, response DOFs)."""
    for place in range(len(takes.records)):
        accepted = [one for one in judged if one.place == place and one.accepted]
        if accepted:
            record = takes[place]
            layout = channels.layout(record, channels.describe(run, record))
            spectra = [_spectra(record, layout, one, length, before, decay, options.window_force) for one in accepted]
            peaks = np.array([abs(one.blow.peak) for one in accepted])
            effect = level_effect(spectra, peaks)
            parts = [single_input.summed(force, response) for force, response in spectra]
            yield (layout.inputs[0], layout.outputs), parts, effect
        advance(progress, "transforming blows", place + 1, len(takes.records))


def _spectra(
    record: Recording, layout: channels.Layout, one: Judged, length: int, before: int, decay: float, windowed: bool
) -> tuple[Complex[np.ndarray, "freq"], Complex[np.ndarray, "out freq"]]:
    """Fourier transforms of force and responses of a blow."""
    trigger = one.blow.start
    start = trigger - min(one.before, before)
    pulse = _pulse(record.signals[layout.references[0]], one, start, length, windowed)
    rows = list(layout.responses)
    block = record.signals[rows[0] : rows[-1] + 1, start : start + length]
    if rows != list(range(rows[0], rows[-1] + 1)):
        block = record.signals[rows, start : start + length]
    if decay > 0:
        window = exponential_window(length, trigger - start, record.sampling_rate, decay).astype(block.dtype)
        pulse = pulse * window[: len(pulse)]
        block = (block - one.rest.astype(block.dtype)[:, None]) * window
    response = scipy.fft.rfft(block, axis=1)
    if decay == 0:
        response[:, 0] -= length * one.rest  # without a window the offset lives in this line only
    return scipy.fft.rfft(pulse, length), response


def _pulse(
    signal: Float[np.ndarray, "sample"], one: Judged, start: int, length: int, windowed: bool
) -> Float[np.ndarray, "some"]:
    """The force of a block without its offset; up to twice the contact, with a taper, when windowed."""
    if not windowed:
        return signal[start : start + length] - one.offset
    contact = max(one.blow.stop - one.blow.start, 4)
    first, last = one.blow.start - start, min(one.blow.start - start + 2 * contact + 8, length)
    end = min(last + contact, length)
    window = force_window(end, max(first - contact // 20, 0), last, contact // 2)
    return (signal[start : start + end] - one.offset) * window.astype(signal.dtype)


def _assemble(
    run: Run, first: Recording, sums: dict[_Key, Sums], blows: SingleBlows, length: int, decay: float,
    options: Options, findings: list[Finding],
) -> FrfSet:  # fmt: skip
    """The FRF set of all sums."""
    sums = _without_overlap(sums)
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
            part, options.estimator
        )
        averages[rows, column] = part.averages
    factor = single_input.over_h1(coherence, options.estimator)
    where = channels.describe(run, first)
    layout = channels.layout(first, where)
    quantity, unit = channels.frf_quantity(
        [first.channels[row] for row in layout.responses], [first.channels[row] for row in layout.references], where
    )
    findings += hammer_findings.about_units(unit, channels.describe(run))
    return FrfSet(
        frequencies=scipy.fft.rfftfreq(length, 1 / first.sampling_rate), values=values.transpose(2, 1, 0),
        outputs=outputs, inputs=inputs, quantity=quantity, unit=unit, coherence=coherence.transpose(2, 1, 0),
        variance=variance.transpose(2, 1, 0), estimator=options.estimator, averages=averages, added_decay=decay,
        condition=run.condition, name=run.id, findings=tuple(findings),
        provenance=Provenance(
            steps=("estimate.hammer",), options=tuple((name, str(value)) for name, value in vars(options).items())
        ),
        deviations=blows.deviations(values, sums, outputs, inputs, factor),
    )  # fmt: skip


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
    """The blows and the mean energy spectrum of the accepted ones."""
    total = np.zeros(length // 2 + 1)
    for part in sums.values():
        total += part.force
    spectrum = total / sum(part.averages for part in sums.values()) / rate**2
    frequencies = scipy.fft.rfftfreq(length, 1 / rate)
    return HitGallery(
        tuple(_hit(one, takes[one.place]) for one in judged), frequencies, spectrum, usable_band(frequencies, spectrum)
    )


def _hit(one: Judged, record: Recording) -> Hit:
    """A blow as a noun; with a second blow its pulse reaches as far."""
    rate, blow = record.sampling_rate, one.blow
    force = record.signals[record.with_role("reference")[0]]
    contact = blow.stop - blow.start + 1
    first, last = max(blow.start - contact, 0), blow.stop + 4 * contact
    if one.second is not None:
        first, last = max(min(first, one.second.sample - 2 * contact), 0), max(last, one.second.sample + 2 * contact)
    return Hit(
        recording=one.record, index=one.index, dof=one.dof, time=blow.start / rate, peak=blow.peak,
        impulse=float((force[blow.start : blow.stop + 1] - one.offset).sum() / rate),
        contact_time=(blow.stop - blow.start) / rate, accepted=one.accepted,
        reason="; ".join(text for _, text in one.reasons), pulse=force[first:last] - one.offset, sampling_rate=rate,
    )  # fmt: skip


def usable_band(frequencies: Float[np.ndarray, "freq"], spectrum: Float[np.ndarray, "freq"]) -> tuple[float, float]:
    """Frequencies in Hz at which the force spectrum has fallen by 10 and by 20 dB below its low-frequency level."""
    smooth = single_input.pooled(spectrum[None, :])[0]
    level = smooth[: max(len(smooth) // 2, 1)].max()
    found = []
    for fall in (0.1, 0.01):
        below = np.flatnonzero(smooth < fall * level)
        below = below[below > np.argmax(smooth)]
        found.append(float(frequencies[below[0]]) if len(below) else float(frequencies[-1]))
    return found[0], found[1]
