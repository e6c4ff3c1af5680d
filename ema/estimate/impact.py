"""FRFs of a hammer test."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, Hit, HitGallery, Provenance, Recording, Run
from ema.dof import Dof
from ema.errors import InputError
from ema.estimate import channels, single_input
from ema.estimate.blows import Blow
from ema.estimate.judge import Judged, judge_record
from ema.estimate.single_input import Sums
from ema.estimate.spectra import Estimator
from ema.estimate.windows import exponential_window, force_window
from ema.progress import Progress, advance, silent

KEPT_IN_MEMORY = 256 * 2**20
"""Bytes of records that are kept between the two passes; larger runs are read twice."""


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
    takes = _Takes(channels.recordings_of(run))
    judged, findings = _scan(run, takes, options, progress)
    length, before = _block(run, judged, options)
    judged = [_within_block(one, length, before, options) for one in judged]
    if not any(one.accepted for one in judged):
        raise InputError(
            "no blow is left", where=channels.describe(run),
            got="; ".join(sorted({one.reasons[0] for one in judged})[:3]), advice="measure again, or relax the limits",
        )  # fmt: skip
    added = 0.0 if decay is None else decay
    sums = {}
    for key, part in _transformed(run, takes, judged, length, before, added, options, progress):
        sums[key] = sums[key] + part if key in sums else part
    first = takes[0]
    frfs = _assemble(run, first, sums, length, added, options, findings)
    return frfs, _gallery(run, judged, sums, length, first.sampling_rate)


def _scan(run: Run, takes: _Takes, options: Options, progress: Progress) -> tuple[list[Judged], list[Finding]]:
    """Every blow of the run, judged by itself."""
    judged: list[Judged] = []
    findings: list[Finding] = []
    rate = None
    for place in range(len(takes.records)):
        record = takes[place]
        where = channels.describe(run, record)
        layout = channels.layout(record, where)
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
        blows, problems = judge_record(record, layout, place, where, options.trigger)
        judged += blows
        findings += problems
        advance(progress, "finding blows", place + 1, len(takes.records))
    if not judged:
        raise InputError(
            "the force channel never triggers", where=channels.describe(run),
            got=f"no blow in {len(takes.records)} records", advice="check the hammer's channel, or lower the trigger",
        )  # fmt: skip
    return judged, findings


def _block(run: Run, judged: list[Judged], options: Options) -> tuple[int, int]:
    """Samples per block and samples before the trigger that belong to it."""
    usable = [one for one in judged if one.accepted] or judged
    before = int(np.median([one.before for one in usable]))
    if options.block is not None:
        if options.block < 16:
            raise InputError("the block is too short", got=f"{options.block} samples", expected="at least 16")
        return options.block, min(before, options.block // 20)
    # Nine of ten blows fit into the block; the rest was followed by another blow too early.
    room = int(np.quantile([one.before + one.after for one in usable], 0.1, method="lower"))
    length = room if room < 64 else _fast_length(room)
    return length, min(before, length // 20)


def _fast_length(samples: int) -> int:
    """Longest even length up to ``samples`` whose Fourier transform is fast."""
    length = samples - samples % 2
    while scipy.fft.next_fast_len(length, real=True) != length:
        length -= 2
    return length


def _within_block(one: Judged, length: int, before: int, options: Options) -> Judged:
    """The verdict on a blow now that the block is known."""
    reasons = list(one.reasons)
    if min(one.before, before) + one.after < length:
        reasons.append(f"the next blow or the end of the record comes after {one.after_time:.3g} s")
    if options.level is not None and not options.level[0] <= abs(one.blow.peak) <= options.level[1]:
        reasons.append(f"peak {abs(one.blow.peak):.3g} outside {options.level[0]:g} ... {options.level[1]:g}")
    return replace(one, reasons=tuple(reasons))


def _transformed(
    run: Run, takes: _Takes, judged: list[Judged], length: int, before: int, decay: float, options: Options,
    progress: Progress,
) -> Iterator[tuple[tuple[Dof, tuple[Dof, ...]], Sums]]:  # fmt: skip
    """Sums of spectra of each record, under (force DOF, response DOFs)."""
    for place in range(len(takes.records)):
        accepted = [one for one in judged if one.place == place and one.accepted]
        if accepted:
            record = takes[place]
            layout = channels.layout(record, channels.describe(run, record))
            force, response = _spectra(record, layout, accepted, length, before, decay, options)
            yield (layout.inputs[0], layout.outputs), single_input.summed(force, response)
        advance(progress, "transforming blows", place + 1, len(takes.records))


def _spectra(
    record: Recording, layout: channels.Layout, accepted: list[Judged], length: int, before: int, decay: float,
    options: Options,
) -> tuple[Complex[np.ndarray, "avg freq"], Complex[np.ndarray, "avg out freq"]]:  # fmt: skip
    """Fourier transforms of force and responses of the accepted blows of a record."""
    lines = length // 2 + 1
    kind = np.result_type(record.signals.dtype, np.complex64)
    force = np.empty((len(accepted), lines), kind)
    response = np.empty((len(accepted), len(layout.responses), lines), kind)
    rows = list(layout.responses)
    for number, one in enumerate(accepted):
        trigger = one.blow.start
        start = trigger - min(one.before, before)
        pulse = _pulse(record.signals[layout.references[0]], one, start, length, options.window_force)
        block = record.signals[rows, start : start + length]
        if decay > 0:
            window = exponential_window(length, trigger - start, record.sampling_rate, decay).astype(block.dtype)
            pulse = pulse * window[: len(pulse)]
            block = (block - one.rest.astype(block.dtype)[:, None]) * window
            response[number] = scipy.fft.rfft(block, axis=1)
        else:
            response[number] = scipy.fft.rfft(block, axis=1)
            response[number, :, 0] -= length * one.rest  # without a window the offset lives in this line only
        force[number] = scipy.fft.rfft(pulse, length)
    return force, response


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
    run: Run, first: Recording, sums: dict[tuple[Dof, tuple[Dof, ...]], Sums], length: int, decay: float,
    options: Options, findings: list[Finding],
) -> FrfSet:  # fmt: skip
    """The FRF set of all sums."""
    inputs = tuple(dict.fromkeys(force for force, _ in sums))
    outputs = tuple(dict.fromkeys(dof for _, dofs in sums for dof in dofs))
    lines = length // 2 + 1
    shape = (len(inputs), len(outputs), lines)
    values, coherence, variance = np.full(shape, np.nan, complex), np.full(shape, np.nan), np.full(shape, np.nan)
    averages = np.zeros((len(outputs), len(inputs)))
    for (force, dofs), part in sums.items():
        column, rows = inputs.index(force), [outputs.index(dof) for dof in dofs]
        values[column, rows], coherence[column, rows], variance[column, rows] = single_input.estimate(
            part, options.estimator
        )
        averages[rows, column] = part.averages
    where = channels.describe(run, first)
    layout = channels.layout(first, where)
    quantity, unit = channels.frf_quantity(
        [first.channels[row] for row in layout.responses], [first.channels[row] for row in layout.references], where
    )
    return FrfSet(
        frequencies=scipy.fft.rfftfreq(length, 1 / first.sampling_rate), values=values.transpose(2, 1, 0),
        outputs=outputs, inputs=inputs, quantity=quantity, unit=unit, coherence=coherence.transpose(2, 1, 0),
        variance=variance.transpose(2, 1, 0), estimator=options.estimator, averages=averages, added_decay=decay,
        condition=run.condition, name=run.id, findings=tuple(findings),
        provenance=Provenance(
            steps=("estimate.hammer",), options=tuple((name, str(value)) for name, value in vars(options).items())
        ),
    )  # fmt: skip


def _gallery(
    run: Run, judged: list[Judged], sums: dict[tuple[Dof, tuple[Dof, ...]], Sums], length: int, rate: float
) -> HitGallery:
    """The blows and the mean energy spectrum of the accepted ones."""
    total = np.sum([part.force for part in sums.values()], axis=0, dtype=np.float64)
    spectrum = total / sum(part.averages for part in sums.values()) / rate**2
    frequencies = scipy.fft.rfftfreq(length, 1 / rate)
    hits = tuple(
        Hit(
            recording=one.record, index=one.index, dof=one.dof, time=one.blow.start / rate, peak=one.blow.peak,
            impulse=one.impulse, contact_time=(one.blow.stop - one.blow.start) / rate, accepted=one.accepted,
            reason="; ".join(one.reasons), pulse=one.pulse, sampling_rate=rate,
        )
        for one in judged
    )  # fmt: skip
    return HitGallery(hits, frequencies, spectrum, usable_band(frequencies, spectrum))


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
