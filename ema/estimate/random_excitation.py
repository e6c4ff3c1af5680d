"""FRFs of a random shaker test with one or several shakers."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import scipy.fft
import scipy.ndimage
from jaxtyping import Bool, Complex, Float

from ema.data import Deviations, Finding, FrfSet, Provenance, Recording, Run
from ema.errors import InputError
from ema.estimate import (
    breaks,
    channels,
    clipping,
    equal_channels,
    force_flatness,
    force_noise,
    generator,
    hammer_findings,
    local_model,
    spectra,
    spectra_parts,
    stated_excitation,
    windows,
)
from ema.estimate.drift import Drift
from ema.estimate.force_noise import AtRest
from ema.estimate.record_agreement import SingleBlocks, about_levels, about_records
from ema.estimate.single_impacts import KEPT, MOST
from ema.estimate.spectra import Estimator, Spectra
from ema.progress import Progress, advance, silent

CORRELATED = 0.5
"""Median coherence between two inputs above which a finding says so."""


EXCITED = 1e-3
"""Part of the median power of a force in its band below which a line was not excited (-30 dB).

Beyond it FRFs are noise over noise, which the fit cannot tell from modes. A force that falls by 20 dB over the band is
kept; ten times as much cuts the skirts of a force that falls at the resonances.
"""

NARROW = 4
"""Lines on either side of a line over which the median of a force's power is taken: what is narrower is a tone."""

Method = Literal["local", "welch"]

LONGEST_BLOCK = 2**16
"""Samples beyond which the local model works on blocks of a record."""


_AT_ONCE = 2**21
"""Samples of all channels that are transformed at once: few enough for a record that is larger than memory."""

_TOGETHER = 2**26
"""Bytes of spectra that are modelled together; more of them share no denominators."""


@dataclass(frozen=True)
class Blocks:
    """How a long record is cut: length in samples and overlap as a fraction."""

    length: int
    overlap: float

    @property
    def step(self) -> int:
        """Samples from block to block."""
        return max(round(self.length * (1 - self.overlap)), 1)


def shaker(
    run: Run,
    estimator: Estimator = "H1",
    method: Method = "local",
    block: int | None = None,
    overlap: float = 0.75,
    progress: Progress = silent,
) -> FrfSet:
    """Estimate FRFs from random (or any other) excitation by one or several shakers.

    ``local`` models system and leakage together on the few lines around each line (:mod:`ema.estimate.local_model`):
    resonances are not smeared, the damping is not biased, and the resolution is that of the whole record. ``welch`` is
    the classical average over overlapping Hann blocks, which reads light damping too high.

    Where channels have the role ``generator``, one for each force, their signals are the reference of forces and
    responses instead of the measured forces, ``H = S_yr / S_xr`` (:mod:`ema.estimate.generator`): noise of the force
    channels and disturbances that come back through the shaker then have no bias. The coherence is that of the
    responses with the generators. Where the run has records at rest, the noise of the force channel that they show is
    taken off H1 (:mod:`ema.estimate.force_noise`).

    Parameters
    ----------
    run : Run
        Its records hold all shaker forces as references; several records are averaged.
    estimator : {"H1", "H2", "Hv"}, default "H1"
        ``H1`` (noise on the responses; with generators ``Hc``); ``H2`` (one force only) and ``Hv`` for ``welch``.
    method : {"local", "welch"}, default "local"
        ``local`` or ``welch``.
    block : int, optional
        Samples per block; by default for ``local`` the longest power of two of which a record holds two, and for
        ``welch`` the longest power of two that leaves enough independent averages.
    overlap : float, default 0.75
        Fraction by which blocks of ``welch`` overlap.
    progress : Progress, optional
        Called as the records are read.

    Returns
    -------
    FrfSet
        FRFs with coherence and variance.

    Raises
    ------
    InputError
        If a record cannot be used, the records differ in channels or rate, or the inputs are dependent.

    Examples
    --------
    >>> from ema.data import Condition, Excitation
    >>> from ema.examples import recording
    >>> record = recording(np.random.default_rng(1).standard_normal(16384))
    >>> frfs = shaker(Run("random", Condition(Excitation("random")), (record,)))
    >>> peak = frfs.frequencies[np.argmax(np.abs(frfs.values[:, 0, 0]))]
    >>> bool(abs(peak - 40.0) < 0.3)
    True
    """
    if method not in ("local", "welch"):
        raise InputError("unknown method", got=repr(method), expected="local or welch")
    if not 0 <= overlap < 1:
        raise InputError("not an overlap", got=overlap, expected="0 ... 0.95")
    records = channels.recordings_of(run)
    first = records[0]
    stated_excitation.refuse_single_frequencies(run)
    where = channels.describe(run, first)
    layout = channels.layout(first, where)
    chosen = [first.channels[row] for row in layout.responses], [first.channels[row] for row in layout.references]
    quantity, unit = channels.frf_quantity(*chosen, where)
    cut = Blocks(automatic_block(first.signals.shape[1], len(layout.references)) if block is None else block, overlap)
    if cut.length < 16:
        raise InputError("the block is too short", got=f"{cut.length} samples", expected="at least 16")
    generator.check_layout(layout, where)
    where, drift = channels.describe(run), Drift()
    driven = bool(layout.generators) and estimator == "H1"
    rest = None if driven or estimator != "H1" else at_rest(run, layout, first.sampling_rate, cut)
    name = generator.NAME if driven else estimator if rest is None else force_noise.LESS_NOISE
    if method == "local":
        if estimator != "H1":
            raise InputError("the local model is an H1 estimate", got=estimator, advice="use method='welch'")
        # The correlation of the inputs, and whether they can be told apart, is a matter of averages.
        inputs = welch(run, records, cut, progress, drift, generators=driven)
        spectra.frf(_forces(inputs, driven))
        length = _length(run, records, block)
        frequencies = np.arange(1, length // 2) * first.sampling_rate / length
        kept, beyond = _excited(frequencies, excited_band(inputs, first.sampling_rate, cut.length), where)
        parts = local_frfs(run, records, length, kept, progress, rest=None if rest is None else rest.in_blocks(length))
        name = f"{name} (local model)"
    else:
        inputs = welch(run, records, cut, progress, drift, parts=MOST, generators=driven)
        frequencies = scipy.fft.rfftfreq(cut.length, 1 / first.sampling_rate)
        kept, beyond = _excited(frequencies, excited_band(inputs, first.sampling_rate, cut.length), where)
        if driven:
            parts = generator.welch_frfs(generator.Joint(inputs), kept)
        elif rest is not None:
            parts = force_noise.welch_frfs(inputs, rest, kept)
        else:
            parts = welch_frfs(inputs, estimator, kept)
        parts |= {"record_length": cut.length / first.sampling_rate, "window": "hann"}
        about = force_flatness.about_force(inputs, kept, frequencies[kept], inputs=layout.inputs, where=where)
        beyond = (*beyond, *about)
    if rest is not None:
        lines = scipy.fft.rfftfreq(cut.length, 1 / first.sampling_rate)
        within = (lines >= frequencies[kept][0]) & (lines <= frequencies[kept][-1])
        beyond = (*beyond, *force_noise.about_force(inputs, rest, lines, within, where))
    weak = parts.pop("weakness", None)
    findings = (
        *parts.pop("findings", ()),
        *(generator.about_generators(weak, frequencies[kept], layout.inputs, where) if driven else ()),
        *stated_excitation.about_kind(run),
        *drift.findings(first.channels, where),
        *beyond,
        *clipping.about_records(run),
        *breaks.about_breaks(run),
        *equal_channels.about_channels(run),
        *about_levels(run),
        *input_findings(_forces(inputs, driven), layout.inputs, where),
        *hammer_findings.about_units(unit, where),
    )
    options = {"estimator": estimator, "method": method, "block": block, "overlap": overlap}
    return FrfSet(
        **parts,
        frequencies=frequencies[kept],
        outputs=layout.outputs,
        inputs=layout.inputs,
        quantity=quantity,
        unit=unit,
        estimator=name,
        condition=run.condition,
        name=run.id,
        findings=findings,
        provenance=Provenance(steps=("estimate.shaker",), options=tuple((k, str(v)) for k, v in options.items())),
    )


def at_rest(run: Run, layout: channels.Layout, rate: float, cut: Blocks) -> AtRest | None:
    """Noise of the force channel by the records at rest, in blocks as those of the test; ``None`` without such records.

    Raises
    ------
    InputError : several forces, other channels or another rate than in the test, or records shorter than a block.
    """
    if not len(run.at_rest):
        return None
    where = f"{channels.describe(run)}, record at rest"
    if len(layout.references) > 1:
        raise InputError(
            "noise is taken off one force, not several",
            where=where,
            got=f"{len(layout.references)} forces",
            expected="1",
            advice="record the signals of the generators instead, or leave at_rest out",
        )
    total: Any = 0.0
    count, independent = 0, 0.0
    for record in run.at_rest:
        this = channels.layout(record, where)
        channels.finite(record, this, where)
        same_test(rate, layout, record.sampling_rate, this, where)
        blocks = max((record.signals.shape[1] - cut.length) // cut.step + 1, 0)
        independent += independent_averages(blocks, cut) if blocks else 0.0
        for lines in transformed(record, this.references, cut, where):
            total = total + np.sum(np.abs(lines[:, 0]) ** 2, axis=0)
            count += len(lines)
    return AtRest(total / count, independent)


def _forces(found: Spectra, driven: bool) -> Spectra:
    """The spectra without those of generators."""
    return generator.Joint(found).forces if driven else found


def excited_band(found: Spectra, rate: float, length: int) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] that every force excites."""
    power = spectra.input_power(found)
    low, high = 0.0, np.inf
    for one in power.T:
        # drift and tones, such as those of the mains, are no excitation of a band
        smooth = scipy.ndimage.median_filter(one[NARROW:], 2 * NARROW + 1, mode="nearest")
        share = np.cumsum(smooth) / max(float(smooth.sum()), 1e-300)
        first, last = np.searchsorted(share, [0.01, 0.99])
        excited = NARROW + np.flatnonzero(smooth > EXCITED * np.median(smooth[first : last + 1]))
        if excited.size:
            low, high = max(low, float(excited[0] - 1)), min(high, float(excited[-1] + 1))
    low = 0.0 if low < 2 * NARROW else low
    return low * rate / length, high * rate / length


def _excited(
    frequencies: Float[np.ndarray, "freq"], band: tuple[float, float], where: str
) -> tuple[Bool[np.ndarray, "freq"], tuple[Finding, ...]]:
    """Which lines were excited, and a finding where others are left out.

    Raises
    ------
    InputError : the forces have no line in common.
    """
    kept = (frequencies >= band[0]) & (frequencies <= band[1])
    if not kept.any():
        raise InputError(
            "no line is excited by all forces",
            where=where,
            got=f"from {band[0]:.4g} Hz by one, up to {band[1]:.4g} Hz by another",
            expected="forces over one band",
            advice="make a run of each shaker",
        )
    if kept.mean() > 0.99:
        return np.ones_like(kept), ()
    finding = Finding.of(
        "info",
        "excited-band",
        where,
        "the force excites {low} to {high} Hz; the lines beyond it are left out.",
        float(kept.mean()),
        low=f"{max(band[0], frequencies[0]):.4g}",
        high=f"{min(band[1], frequencies[-1]):.4g}",
    )
    return kept, (finding,)


def welch_frfs(found: Spectra, estimator: Estimator, kept: Bool[np.ndarray, "freq"]) -> dict[str, Any]:
    """FRFs, multiple coherence, variance and averages of Welch's method on the ``kept`` lines; how its parts differ."""
    values = spectra.frf(found, estimator)
    multiple = spectra.multiple_coherence(found)
    variance = spectra.variance(found, multiple, spectra_parts.pooled_lines(found.averages))
    frfs = {
        "values": values[kept],
        "coherence": np.repeat(multiple[kept, :, None], values.shape[2], axis=2),
        "variance": None if variance is None else variance[kept],
        "averages": np.full(values.shape[1:], found.averages),
    }
    changes = spectra_parts.deviations(found) if estimator == "H1" else None
    if changes is None:
        return frfs
    return frfs | {
        "deviations": replace(changes, values=np.asarray(changes.values)[:, kept]),
        "output_correlation": spectra_parts.output_correlation(values, changes)[kept],
    }


def local_frfs(
    run: Run,
    records: Sequence[Recording],
    length: int,
    kept: Bool[np.ndarray, "freq"],
    progress: Progress,
    *,
    rest: AtRest | None = None,
) -> dict[str, Any]:
    """FRFs, coherence, variance and averages of the local model on the ``kept`` lines, over records and their blocks of
    ``length`` samples.

    All blocks have the denominators in common, as far as they fit into memory together; beyond that their FRFs are
    averaged with the inverse of their variances as weights. The coherence is the part of the response power that forces
    and transient explain. Noise of the force on the lines of the blocks, by ``rest``, is taken off.
    """
    first = records[0]
    layout = channels.layout(first, channels.describe(run, first))
    weighted: Any = 0.0
    weights: Any = 0.0
    noise: Any = 0.0
    power: Any = 0.0
    effective: list[tuple[int, Any, Any]] = []
    single = SingleBlocks()
    weak: list[Any] = []
    uncertain: list[Any] = []
    for names, blocks in _together(run, records, length, progress):
        if rest is not None:
            acting = force_noise.predicted([force for force, _ in blocks], rest)
            blocks = [(force, answer) for force, (_, answer) in zip(acting.forces, blocks, strict=True)]
            uncertain.append((acting.uncertain[kept], acting.weak[kept]))
        estimate = local_model.local_model(blocks, kept, forces=len(layout.generators))
        for name, values, weight in zip(names, estimate.blocks, estimate.weights, strict=True):
            single.keep(name, values, weight)
        weight = np.where(np.isfinite(estimate.variance), 1 / np.maximum(estimate.variance, 1e-300), 0.0)
        weighted, weights = weighted + weight * estimate.values, weights + weight
        noise, power = noise + estimate.noise, power + estimate.power
        weak.append(estimate.weakness)
        effective.append((len(blocks), estimate.effective_lines, estimate.correlation))
    _driven(weights, layout.inputs, channels.describe(run))
    coherence = np.clip(1 - np.divide(noise, power, out=np.ones_like(noise), where=power > 0), 0, 1)
    values = weighted / weights
    counts = [count for count, _, _ in effective]
    variance = 1 / weights
    if uncertain:
        of_power, without = np.average(uncertain, axis=0, weights=counts) / len(counts)
        variance = force_noise.widened(values, variance + np.abs(values) ** 2 * of_power[:, None, None], without)
    return {
        "values": values,
        "coherence": np.repeat(coherence[:, :, None], values.shape[2], axis=2),
        "variance": variance,
        "averages": np.full(values.shape[1:], float(single.count)),
        "deviations": _deviations(values, single),
        "effective_lines": np.average([lines for _, lines, _ in effective], axis=0, weights=counts),
        "output_correlation": np.average([correlation for _, _, correlation in effective], axis=0, weights=counts),
        # Groups of blocks are averaged: the errors of each are larger than those of the mean.
        "weakness": np.average(weak, axis=0, weights=counts) / len(weak),
        "findings": about_records(
            single, [first.channels[row].name for row in layout.responses], channels.describe(run)
        ),
    }


def _length(run: Run, records: Sequence[Recording], block: int | None) -> int:
    """Samples of a block of the local model, as asked for or as the shortest record allows.

    Raises
    ------
    InputError : they are too few for the lines around a line.
    """
    shortest = min(record.signals.shape[1] for record in records)
    length = local_block(shortest, len(records)) if block is None else block // 2 * 2
    references = channels.layout(records[0], channels.describe(run, records[0])).references
    least = 2 * (local_model.width(len(references)) + 2)
    if length < least:
        raise InputError(
            "the record is too short for the local model",
            where=channels.describe(run),
            got=f"{length} samples",
            expected=f"at least {least}",
            advice="measure longer records",
        )
    return length


def _together(
    run: Run, records: Sequence[Recording], length: int, progress: Progress
) -> Iterator[tuple[list[str], list[local_model.Spectra]]]:
    """Names and spectra of blocks that are modelled together, as many as fit into memory.

    A burst leaves blocks without any force: what is left to see there is free vibration.
    """
    names: list[str] = []
    blocks: list[local_model.Spectra] = []
    size = 0
    for place, record in enumerate(records):
        this = channels.layout(record, channels.describe(run, record))
        record = Drift().off(record, this)
        rows = [*this.generators, *this.references, *this.responses]
        inputs = len(this.generators or this.references)
        for start in range(0, record.signals.shape[1] - length + 1, length):
            signals = record.signals[rows, start : start + length].astype(np.float64)
            acts = np.ptp(signals[:inputs], axis=1) > 0
            if not (acts.all() if this.generators else acts.any()):
                continue
            lines = scipy.fft.rfft(signals, axis=1)[:, 1:-1].T
            # A force that is constant does not act there.
            lines[:, :inputs][:, np.ptp(signals[:inputs], axis=1) == 0] = 0
            names, blocks, size = (
                [*names, _stretch(record, start, length)],
                [*blocks, (lines[:, :inputs], lines[:, inputs:])],
                size + lines.nbytes,
            )
            if size > _TOGETHER:
                yield names, blocks
                names, blocks, size = [], [], 0
        advance(progress, "modelling records", place + 1, len(records))
    if blocks:
        yield names, blocks


def _driven(weights: Any, inputs: Sequence[object], where: str) -> None:
    """Refuse forces that act in no block.

    Raises
    ------
    InputError : one does not.
    """
    for column, name in enumerate(inputs):
        if np.ndim(weights) == 0 or not np.any(weights[:, :, column]):
            raise InputError(
                "the force acts in no block of the records",
                where=f"{where}, force at {name}",
                got="a force that is constant in every block",
                expected="a force in one block or more",
                advice="choose shorter blocks, or check the force channel",
            )


def _stretch(record: Recording, start: int, length: int) -> str:
    """``take_07.h5`` or, of a part, ``take_07.h5 from 8 s to 16 s``."""
    if record.signals.shape[1] < 2 * length:
        return record.name
    rate = record.sampling_rate
    return f"{record.name} from {start / rate:.4g} s to {(start + length) / rate:.4g} s".strip()


def _deviations(values: Complex[np.ndarray, "freq out in"], single: SingleBlocks) -> Deviations | None:
    """Deviations of the mean by its blocks, at most ``MOST`` groups of neighbours."""
    blocks = single.blocks
    if len(blocks) < 2:
        return None
    groups = np.array_split(np.arange(len(blocks)), min(len(blocks), MOST))
    weights = np.maximum(sum(block.weight for block in blocks), np.finfo(float).tiny)
    changes = np.empty((len(groups), *values.shape), np.complex64)
    for place, group in enumerate(groups):
        share = sum(blocks[k].weight for k in group) / weights
        change = sum(blocks[k].weight * (blocks[k].values - values) for k in group) / weights
        changes[place] = change / np.sqrt(1 - np.minimum(share, 1 - 1e-9))
    numbers = np.broadcast_to(np.arange(len(groups))[:, None, None], (len(groups), *values.shape[1:]))
    return Deviations(changes, numbers)


def automatic_block(samples: int, inputs: int) -> int:
    """Longest power of two with at least ``8 + 4 inputs`` half-overlapping blocks."""
    wanted = 8 + 4 * inputs
    length = 16
    while 2 * length * (wanted + 1) / 2 <= samples:
        length *= 2
    return length


def local_block(samples: int, records: int = 1) -> int:
    """Longest power of two (at most ``LONGEST_BLOCK``) that fits in twice; all of a short record, or of one of several.

    Several records are averaged as they are: in a part of a burst there may be no force, and short parts do not resolve
    what the records do.
    """
    if records > 1 and samples <= LONGEST_BLOCK:
        return samples // 2 * 2
    length = 256
    if samples < 2 * length:
        return samples // 2 * 2
    while 4 * length <= samples and 2 * length <= LONGEST_BLOCK:
        length *= 2
    return length


def welch(
    run: Run,
    records: Sequence[Recording],
    cut: Blocks,
    progress: Progress = silent,
    drift: Drift | None = None,
    *,
    parts: int = 1,
    generators: bool = False,
) -> Spectra:
    """Averaged spectra of all records without their drift, Hann window, overlapping blocks, and what at most so many
    ``parts`` add to them; with ``generators`` their signals are inputs after the forces.
    """
    first = records[0]
    layout = channels.layout(first, channels.describe(run, first))
    counts = [max((record.signals.shape[1] - cut.length) // cut.step + 1, 0) for record in records]
    total, independent = sum(counts), sum(independent_averages(count, cut) for count in counts if count)
    count = len(layout.references) + (len(layout.generators) if generators else 0)
    size = 16 * (cut.length // 2 + 1) * count * (count + len(layout.responses))
    # Parts of less than two independent averages are too much alike.
    parts = int(max(min(parts, independent / 2, KEPT // size), 1))
    sums: list[list[np.ndarray]] = [[] for _ in range(parts)]
    before = 0
    for place, record in enumerate(records):
        where = channels.describe(run, record)
        this = channels.layout(record, where)
        channels.finite(record, this, where)
        alive(record, this, where)
        same_test(first.sampling_rate, layout, record.sampling_rate, this, where)
        record = (Drift() if drift is None else drift).off(record, this)
        rows = [*this.references, *(this.generators if generators else ()), *this.responses]
        for lines in transformed(record, rows, cut, where):
            numbers = (before + np.arange(len(lines))) * parts // total
            before += len(lines)
            for number in np.unique(numbers):
                own = lines[numbers == number]
                part = spectra.averaged(own[:, :count], own[:, count:], 1.0)
                terms = [len(own) / total * term for term in (part.inputs, part.cross, part.outputs)]
                known = sums[number]
                sums[number] = [a + b for a, b in zip(known, terms)] if known else terms
        advance(progress, "averaging records", place + 1, len(records))
    lengths = np.bincount(np.arange(total) * parts // total)
    added = [
        Spectra(inputs, cross, outputs, independent_averages(int(count), cut))
        for (inputs, cross, outputs), count in zip(sums, lengths, strict=True)
    ]
    inputs, cross, outputs = (np.sum(terms, axis=0) for terms in zip(*sums, strict=True))
    return Spectra(inputs, cross, outputs, independent, tuple(added) if parts > 1 else ())


def transformed(
    record: Recording, rows: Sequence[int], cut: Blocks, where: str
) -> Iterator[Complex[np.ndarray, "avg channel freq"]]:
    """Spectra of overlapping, windowed blocks of signals without their mean, some blocks at a time.

    Raises
    ------
    InputError : the record is shorter than a block.
    """
    samples = record.signals.shape[1]
    if samples < cut.length:
        raise InputError(
            "the record is shorter than a block",
            where=where,
            got=f"{samples} samples",
            expected=f"at least {cut.length}",
            advice="choose a shorter block",
        )
    means = np.array([[record.signals[row].mean()] for row in rows])
    window, count = windows.hann_window(cut.length), (samples - cut.length) // cut.step + 1
    few = max(_AT_ONCE // (len(rows) * cut.length), 1)
    for first in range(0, count, few):
        last = min(first + few, count)
        part = record.signals[list(rows), first * cut.step : (last - 1) * cut.step + cut.length] - means
        blocks = np.lib.stride_tricks.sliding_window_view(part, cut.length, axis=1)[:, :: cut.step].transpose(1, 0, 2)
        yield scipy.fft.rfft(blocks * window, axis=2)


def independent_averages(blocks: int, cut: Blocks) -> float:
    """Number of independent averages that overlapping Hann blocks are worth (Welch 1967)."""
    window = windows.hann_window(cut.length)
    total = 1.0
    for lag in range(1, blocks):
        shift = lag * cut.step
        if shift >= cut.length:
            break
        correlation = (window[shift:] @ window[:-shift] / cut.length) ** 2
        total += 2 * (1 - lag / blocks) * correlation
    return blocks / total


def alive(record: Recording, layout: channels.Layout, where: str) -> None:
    """Refuse a force that does nothing.

    Raises
    ------
    InputError : a force is zero or constant.
    """
    for row in (*layout.references, *layout.generators):
        if np.ptp(record.signals[row]) == 0:
            raise InputError(
                "the force is zero or constant" if row in layout.references else "the generator is zero or constant",
                where=f"{where}, channel {record.channels[row].name}",
                advice="check the force channel, or leave this shaker out",
            )


def same_test(rate: float, layout: channels.Layout, other_rate: float, other: channels.Layout, where: str) -> None:
    """Refuse a record that differs from the first one of its run.

    Raises
    ------
    InputError : another sampling rate, or other forces or responses.
    """
    if other_rate != rate:
        raise InputError(
            "the records of the run differ in sampling rate",
            where=where,
            got=f"{other_rate:g} Hz",
            expected=f"{rate:g} Hz",
        )
    if (other.inputs, other.outputs, len(other.generators)) != (
        layout.inputs,
        layout.outputs,
        len(layout.generators),
    ):
        raise InputError(
            "the records of the run differ in their channels",
            where=where,
            got=_channels(other),
            expected=_channels(layout),
        )


def _channels(layout: channels.Layout) -> str:
    """DOFs of forces and responses, and the number of generators where there are some."""
    generators = f", {len(layout.generators)} generators" if layout.generators else ""
    return ", ".join(map(str, (*layout.inputs, *layout.outputs))) + generators


def input_findings(found: Spectra, inputs: Sequence[object], where: str) -> tuple[Finding, ...]:
    """Correlation of the inputs."""
    findings = []
    between = spectra.input_coherence(found)
    bias = 1 / max(found.averages, 1.0)
    for a in range(len(inputs)):
        for b in range(a):
            median = float(np.median(between[1:, a, b]))
            high = median > CORRELATED
            findings.append(
                Finding.of(
                    "warning" if high else "info",
                    "input-correlation",
                    where,
                    "the median coherence between the forces at {one} and {other} is {median} "
                    "(independent forces give {bias}).",
                    median,
                    CORRELATED,
                    advice="Drive the shakers with independent signals: the FRFs scatter more than they have to."
                    if high
                    else "",
                    one=inputs[b],
                    other=inputs[a],
                    median=f"{median:.2f}",
                    bias=f"{bias:.2f}",
                )
            )
    return tuple(findings)
