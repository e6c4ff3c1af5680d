"""FRFs of a random shaker test with one or several shakers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, Provenance, Recording, Run
from ema.errors import InputError
from ema.estimate import channels, spectra, windows
from ema.estimate.spectra import Estimator, Spectra
from ema.progress import Progress, advance, silent

CORRELATED = 0.5
"""Median coherence between two inputs above which a finding says so."""


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
    block: int | None = None,
    overlap: float = 0.75,
    progress: Progress = silent,
) -> FrfSet:
    """FRFs from random excitation by one or several shakers (Welch's method with a Hann window).

    Parameters
    ----------
    run : its recordings hold all shaker forces as references; several recordings are averaged.
    estimator : ``H1`` (noise on the responses), ``H2`` (one force only) or ``Hv``.
    block : samples per block; by default the longest power of two that leaves enough independent averages.
    overlap : fraction by which blocks overlap.

    Raises
    ------
    InputError : a record cannot be used, the records differ in channels or rate, or the inputs are dependent.
    """
    records = channels.recordings_of(run)
    first = records[0]
    where = channels.describe(run, first)
    layout = channels.layout(first, where)
    quantity, unit = channels.frf_quantity(
        [first.channels[row] for row in layout.responses], [first.channels[row] for row in layout.references], where
    )
    if block is None:
        block = automatic_block(first.signals.shape[1], len(layout.references))
    cut = Blocks(block, overlap)
    found = welch(run, records, cut, progress)
    values = spectra.frf(found, estimator)
    multiple = spectra.multiple_coherence(found)
    shape = values.shape[1:]
    return FrfSet(
        frequencies=scipy.fft.rfftfreq(block, 1 / first.sampling_rate), values=values, outputs=layout.outputs,
        inputs=layout.inputs, quantity=quantity, unit=unit, estimator=estimator,
        coherence=np.repeat(multiple[:, :, None], shape[1], axis=2), variance=spectra.variance(found, multiple),
        averages=np.full(shape, found.averages), condition=run.condition, name=run.id,
        findings=input_findings(found, layout.inputs, channels.describe(run)),
        provenance=Provenance(
            steps=("estimate.shaker",),
            options=(("estimator", estimator), ("block", str(block)), ("overlap", f"{overlap:g}"), ("window", "Hann")),
        ),
    )  # fmt: skip


def automatic_block(samples: int, inputs: int) -> int:
    """Longest power of two with at least ``8 + 4 inputs`` half-overlapping blocks."""
    wanted = 8 + 4 * inputs
    length = 16
    while 2 * length * (wanted + 1) / 2 <= samples:
        length *= 2
    return length


def welch(run: Run, records: Sequence[Recording], cut: Blocks, progress: Progress = silent) -> Spectra:
    """Averaged spectra of all records, Hann window, overlapping blocks."""
    first = records[0]
    layout = channels.layout(first, channels.describe(run, first))
    sums: list[np.ndarray] | None = None
    count, independent = 0, 0.0
    for place, record in enumerate(records):
        where = channels.describe(run, record)
        this = channels.layout(record, where)
        channels.finite(record, this, where)
        same_test(first.sampling_rate, layout, record.sampling_rate, this, where)
        u, y = (transformed(record.signals[list(rows)], cut, where) for rows in (this.references, this.responses))
        part = spectra.averaged(u, y, 1.0)
        blocks = u.shape[0]
        terms = [blocks * part.inputs, blocks * part.cross, blocks * part.outputs]
        sums = terms if sums is None else [a + b for a, b in zip(sums, terms)]
        count += blocks
        independent += independent_averages(blocks, cut)
        advance(progress, "averaging records", place + 1, len(records))
    assert sums is not None
    return Spectra(sums[0] / count, sums[1] / count, sums[2] / count, independent)


def transformed(
    signals: Float[np.ndarray, "channel sample"], cut: Blocks, where: str
) -> Complex[np.ndarray, "avg channel freq"]:
    """Spectra of overlapping, windowed blocks of signals without their mean.

    Raises
    ------
    InputError : the record is shorter than a block.
    """
    if signals.shape[1] < cut.length:
        raise InputError(
            "the record is shorter than a block", where=where, got=f"{signals.shape[1]} samples",
            expected=f"at least {cut.length}", advice="choose a shorter block",
        )  # fmt: skip
    rest = signals - signals.mean(axis=1, keepdims=True)
    blocks = np.lib.stride_tricks.sliding_window_view(rest, cut.length, axis=1)[:, :: cut.step].transpose(1, 0, 2)
    return scipy.fft.rfft(blocks * windows.hann_window(cut.length), axis=2)


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


def same_test(rate: float, layout: channels.Layout, other_rate: float, other: channels.Layout, where: str) -> None:
    """Refuse a record that differs from the first one of its run.

    Raises
    ------
    InputError : another sampling rate, or other forces or responses.
    """
    if other_rate != rate:
        raise InputError(
            "the records of the run differ in sampling rate", where=where, got=f"{other_rate:g} Hz",
            expected=f"{rate:g} Hz",
        )  # fmt: skip
    if (other.inputs, other.outputs) != (layout.inputs, layout.outputs):
        raise InputError(
            "the records of the run differ in their channels", where=where,
            got=", ".join(map(str, (*other.inputs, *other.outputs))),
            expected=", ".join(map(str, (*layout.inputs, *layout.outputs))),
        )  # fmt: skip


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
                Finding(
                    "warning" if high else "info", "input-correlation", where,
                    f"the median coherence between the forces at {inputs[b]} and {inputs[a]} is {median:.2f} "
                    f"(independent forces give {bias:.2f}).", median, CORRELATED,
                    "Drive the shakers with independent signals: the FRFs scatter more than they have to."
                    if high else "",
                )
            )  # fmt: skip
    return tuple(findings)
