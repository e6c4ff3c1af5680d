"""FRFs of swept-sine takes."""

from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float, Int

from ema.data import Finding, FrfSet, Provenance, Run
from ema.dof import Dof
from ema.errors import InputError
from ema.estimate import (
    breaks,
    channels,
    clipping,
    equal_channels,
    hammer_findings,
    repeated_sweeps,
    single_input,
    stated_excitation,
)
from ema.estimate.detection_lines import NonlinearDistortion, distortion_finding, excited_lines, nonlinear_distortion
from ema.estimate.drift import Drift
from ema.estimate.record_agreement import SingleBlocks, about_levels, about_records
from ema.estimate.repeated_sweeps import SpectraSums
from ema.estimate.single_input import Sums
from ema.estimate.spectra import Estimator
from ema.progress import Progress, advance, silent

REPEATED = 0.5
"""Rms of the difference of the force from period to period, over its rms, above which the period is another one.

The forces of unequal parts of a sweep differ by 1.4; where the force settles or drops out, by a few percent.
"""

EXCITED = 0.01
"""Part of the median force power in the swept band below which a line was not excited (-20 dB)."""


@dataclass
class _Sweeps:
    """Sums over the sweeps under each force DOF: powers and cross spectra, and the spectra themselves; and what is kept
    of single records to compare them.
    """

    sums: dict[Dof, Sums] = field(default_factory=dict)
    spectra: dict[Dof, SpectraSums] = field(default_factory=dict)
    single: dict[Dof, SingleBlocks] = field(default_factory=dict)

    def add(self, force: Dof, lines: Complex[np.ndarray, "channel freq"], record: str) -> None:
        """One sweep: its spectra, the force first."""
        part, whole = single_input.summed(lines[0], lines[1:]), SpectraSums(lines[0], lines[1:])
        self.sums[force] = self.sums[force] + part if force in self.sums else part
        self.spectra[force] = self.spectra[force] + whole if force in self.spectra else whole
        weight = np.broadcast_to(part.force, part.cross.shape)
        frfs = part.cross * single_input.reciprocal(part.force)
        self.single.setdefault(force, SingleBlocks()).keep(record, frfs.T[:, :, None], weight.T[:, :, None])


def sweep(
    run: Run,
    estimator: Estimator = "H1",
    band: tuple[float, float] | None = None,
    block: int | None = None,
    progress: Progress = silent,
) -> FrfSet:
    """Estimate FRFs from swept-sine takes: one whole sweep per block, averaged over the takes.

    No window: a sweep that begins and ends at rest within its record has no leakage; a slow drift of a channel is taken
    off (finding ``drift``). Of a periodic sweep, whose
    ``period`` the condition states, the first is dropped while the structure settles, and the others are averaged. Any
    other periodic force will do: lines that a multisine leaves out are left out of the FRFs, and say whether the
    structure is linear (findings ``nonlinear-distortion``, ``level-tested``, ``linearity-not-testable``).

    Parameters
    ----------
    run : Run
        Each record holds one sweep: one force (reference) and one or more responses.
    estimator : {"H1", "H2", "Hv"}, default "H1"
        ``H1`` (noise on the responses; of sweeps that repeat, noise of the force has no bias either, finding
        ``force-noise``), ``H2`` (noise on the force) or ``Hv``.
    band : tuple of (float, float), optional
        Lines to return [Hz]; by default those that the sweep excited (force power within 20 dB of its median in the
        band that holds 98 % of it).
    block : int, optional
        Samples of each record to use; by default all of the shortest one.
    progress : Progress, optional
        Called after each record.

    Returns
    -------
    FrfSet
        FRFs on the excited lines.

    Raises
    ------
    InputError
        If a record cannot be used, the records differ in rate or responses, the force is zero, or a periodic record
        does not hold two periods.

    Examples
    --------
    >>> from ema.data import Condition, Excitation
    >>> from ema.examples import recording
    >>> t = np.arange(8192) / 1024.0
    >>> force = np.append(5.0 * np.sin(2 * np.pi * (20.0 * t + 2.5 * t**2)), np.zeros(4096))  # 20 to 60 Hz, then rest
    >>> frfs = sweep(Run("sweep", Condition(Excitation("sweep")), (recording(force),)))
    >>> peak = frfs.frequencies[np.argmax(np.abs(frfs.values[:, 0, 0]))]
    >>> bool(abs(peak - 40.0) < 0.2)
    True
    """
    records = channels.recordings_of(run)
    stated_excitation.refuse_single_frequencies(run)
    length = block or min(record.signals.shape[1] for record in records)
    period = run.condition.excitation.period
    periodic = bool(np.isfinite(period))
    if periodic:
        length = _period(run, period)
    sweeps = _Sweeps()
    first, layout = None, None
    drift, left = Drift(), 0.0
    for place, record in enumerate(records):
        where = channels.describe(run, record)
        this = channels.layout(record, where)
        channels.finite(record, this, where)
        if first is None or layout is None:
            first, layout = record, this
        _check(first.sampling_rate, record.sampling_rate, layout, this, record.signals.shape[1], length, where)
        record = drift.off(record, this)
        if periodic:
            _repeating(record.signals[this.references[0]], length, record.sampling_rate, where)
        begins = range(length, record.signals.shape[1] - length + 1, length) if periodic else (0,)
        for begin in begins:
            signals = record.signals[[*this.references, *this.responses], begin : begin + length]
            signals = signals - signals.mean(axis=1, keepdims=True)
            left = max(left, 0.0 if periodic else _left_over(signals[1:]))
            sweeps.add(this.inputs[0], scipy.fft.rfft(signals, axis=1), record.name)
        advance(progress, "transforming sweeps", place + 1, len(records))
    assert first is not None
    assert layout is not None
    frequencies = scipy.fft.rfftfreq(length, 1 / first.sampling_rate)
    total = reduce(add, sweeps.sums.values())
    keep = _lines(frequencies, total, band, channels.describe(run))
    frfs = _frfs(run, sweeps.sums, layout.outputs, frequencies[keep], keep, estimator, left)
    if estimator == "H1":
        frfs = _without_force_noise(run, frfs, sweeps, keep)
    where = channels.describe(run)
    differing = [
        finding
        for blocks in sweeps.single.values()
        for finding in about_records(blocks, [first.channels[row].name for row in layout.responses], where)
    ]
    other = () if periodic else stated_excitation.about_repeats(run, *frequencies[keep][[0, -1]])
    of_records = (
        *other,
        *stated_excitation.about_kind(run),
        *drift.findings(first.channels, where),
        *differing,
        *clipping.about_records(run),
        *breaks.about_breaks(run),
        *equal_channels.about_channels(run),
        *about_levels(run),
    )
    frfs = replace(frfs, findings=(*of_records, *frfs.findings))
    return _excited(run, frfs, np.arange(len(frequencies))[keep], total) if periodic else frfs


def _without_force_noise(run: Run, frfs: FrfSet, sweeps: _Sweeps, keep: slice) -> FrfSet:
    """FRFs of sweeps that repeat, without the bias by noise of their force where it has one."""
    assert frfs.variance is not None
    values, variance, findings = frfs.values.copy(), frfs.variance.copy(), list(frfs.findings)
    for column, force in enumerate(frfs.inputs):
        repeated = repeated_sweeps.repeats(sweeps.sums[force], sweeps.spectra[force], keep)
        if repeated is None:
            continue
        values[:, :, column] = repeated.values[:, keep].T
        variance[:, :, column] = repeated.variance[:, keep].T
        frequency = float(frfs.frequencies[repeated.line - keep.start])
        findings.append(repeated_sweeps.finding(repeated, frequency, f"{channels.describe(run)}, force at {force}"))
    return replace(frfs, values=values, variance=variance, findings=tuple(findings))


def _excited(run: Run, frfs: FrfSet, lines: Int[np.ndarray, "freq"], total: Sums) -> FrfSet:
    """FRFs without the lines that a multisine leaves out, and what the structure answers at these."""
    excited, where = excited_lines(np.sqrt(total.force)), channels.describe(run)
    if len(excited) == excited[-1] - excited[0] + 1:
        return frfs
    try:
        read = nonlinear_distortion(run, discard=run.condition.excitation.period)
    except InputError:  # too few periods to tell noise from distortion
        read = NonlinearDistortion(*4 * (float("nan"),))
    return replace(frfs.lines(np.isin(lines, excited)), findings=(*frfs.findings, distortion_finding(read, where)))


def _period(run: Run, period: float) -> int:
    """Samples of a period.

    Raises
    ------
    InputError : it is no whole number of samples, or a record holds fewer than two.
    """
    for record in run.recordings:
        exact = period * record.sampling_rate
        where = channels.describe(run, record)
        if not exact >= 16 or abs(exact - round(exact)) > 1e-6 * exact:
            raise InputError(
                "not a period of a sweep",
                where=where,
                got=f"{period} s, {exact:g} samples",
                expected="a whole number of samples, 16 or more",
            )
        if record.signals.shape[1] < 2 * round(exact):
            raise InputError(
                "a periodic sweep needs two periods",
                where=where,
                got=f"{record.duration:g} s",
                expected=f"{2 * period:g} s or more: the first one is dropped",
            )
    return round(exact)


def _repeating(force: Float[np.ndarray, "sample"], length: int, rate: float, where: str) -> None:
    """Refuse a force that is not the same from period to period.

    Raises
    ------
    InputError : it differs.
    """
    periods = np.asarray(force[: len(force) // length * length], dtype=np.float64).reshape(-1, length)
    periods = periods - periods.mean(axis=1, keepdims=True)
    rms = float(np.sqrt(np.mean(periods**2)))
    differing = float(np.sqrt(np.mean(np.diff(periods, axis=0) ** 2)))
    if differing > REPEATED * rms:
        raise InputError(
            "the force does not repeat with the period stated",
            where=where,
            got=f"{length / rate:g} s, and {100 * differing / rms:.0f} % of its rms change from one to the next",
            expected=f"up to {100 * REPEATED:.0f} %",
            advice="correct the period in campaign.toml; leave it out for sweeps with a pause",
        )


def _check(
    rate: float,
    other_rate: float,
    layout: channels.Layout,
    this: channels.Layout,
    samples: int,
    length: int,
    where: str,
) -> None:
    """Refuse a take that does not fit the others.

    Raises
    ------
    InputError : another rate, other responses, several forces, or fewer samples than a block.
    """
    if len(this.references) > 1:
        raise InputError(
            "a sweep has one force channel",
            where=where,
            got=f"{len(this.references)}",
            advice="sweep one shaker at a time, or give a channel of no shaker the role 'other'",
        )
    if other_rate != rate:
        raise InputError(
            "the records of the run differ in sampling rate",
            where=where,
            got=f"{other_rate:g} Hz",
            expected=f"{rate:g} Hz",
        )
    if this.outputs != layout.outputs:
        raise InputError(
            "the records of the run differ in their responses",
            where=where,
            got=", ".join(map(str, this.outputs)),
            expected=", ".join(map(str, layout.outputs)),
        )
    if samples < length:
        raise InputError("the record is shorter than a block", where=where, got=samples, expected=length)


def _left_over(signals: np.ndarray) -> float:
    """Largest rms of the last hundredth of a response relative to its rms."""
    last = signals[:, -max(signals.shape[1] // 100, 8) :]
    rms = np.sqrt(np.mean(signals**2, axis=1))
    return float(np.max(np.divide(np.sqrt(np.mean(last**2, axis=1)), rms, out=np.zeros_like(rms), where=rms > 0)))


def _lines(frequencies: np.ndarray, total: Sums, band: tuple[float, float] | None, where: str) -> slice:
    """The lines to return.

    Raises
    ------
    InputError : the force is zero, or no line lies in the band.
    """
    power = total.force
    if not power[1:].any():
        raise InputError("the force is zero or constant", where=where, advice="check the force channel")
    if band is not None:
        first, last = np.searchsorted(frequencies, [band[0] - 1e-9, band[1] + 1e-9])
    else:
        share = np.cumsum(power[1:]) / power[1:].sum()
        low, high = 1 + np.searchsorted(share, [0.01, 0.99])
        smooth = single_input.pooled(power[None, :])[0]
        inside = np.flatnonzero(smooth > EXCITED * np.median(power[low : high + 1]))
        inside = inside[(inside >= max(low // 2, 1)) & (inside <= 2 * high)]
        first, last = int(inside[0]), int(inside[-1]) + 1
    if last <= first:
        raise InputError(
            "no frequency line in the band",
            where=where,
            got=f"{band} Hz",
            expected=f"a band inside 0 to {frequencies[-1]:g} Hz, whose lines are {frequencies[1]:.3g} Hz apart",
        )
    return slice(int(first), int(last))


def _frfs(
    run: Run,
    sums: dict[Dof, Sums],
    outputs: tuple[Dof, ...],
    frequencies: np.ndarray,
    keep: slice,
    estimator: Estimator,
    left: float,
) -> FrfSet:
    """The FRF set of the sums of each force DOF."""
    where = channels.describe(run)
    first = run.recordings[0]
    quantity, unit = channels.frf_quantity(
        [first.channels[row] for row in first.with_role("response")],
        [first.channels[row] for row in first.with_role("reference")],
        where,
    )
    parts = [single_input.estimate(part, estimator) for part in sums.values()]
    values, coherence, variance = (np.stack(list(each))[:, :, keep].transpose(2, 1, 0) for each in zip(*parts))
    averages = [float(part.averages) for part in sums.values()]
    findings = [*hammer_findings.about_units(unit, where), *_about_sweeps(left, min(averages), where)]
    return FrfSet(
        frequencies=frequencies,
        values=values,
        outputs=outputs,
        inputs=tuple(sums),
        quantity=quantity,
        unit=unit,
        coherence=coherence,
        variance=variance,
        estimator=estimator,
        averages=np.tile(np.array(averages), (len(outputs), 1)),
        condition=run.condition,
        name=run.id,
        findings=tuple(findings),
        provenance=Provenance(steps=("estimate.sweep",), options=(("estimator", estimator),)),
    )


def _about_sweeps(left: float, averages: float, where: str) -> list[Finding]:
    """Findings on a response that had not died away (rms at the end over that of the record) and on a single sweep."""
    findings = []
    if left > hammer_findings.SWEEP_LEFT_OVER:
        findings.append(
            Finding.of(
                "warning",
                "leakage",
                where,
                "the response at the end of the record still has {left} % of its rms.",
                left,
                hammer_findings.SWEEP_LEFT_OVER,
                advice="Record on until the structure is at rest.",
                left=f"{100 * left:.0f}",
            )
        )
    if averages < 2:
        findings.append(
            Finding(
                "warning",
                "one-average",
                where,
                "one sweep only: the coherence is 1 by definition.",
                1.0,
                2.0,
                "Repeat the sweep.",
            )
        )
    return findings
