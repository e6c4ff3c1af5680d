"""Runs against each other: what the friction beam changes, and how far that can be trusted."""

import numpy as np

from ema.compare.scatter import doubt
from ema.data import RunResult
from ema.data.repeats import NOISE_ONLY
from ema.errors import InputError
from ema.messages import plural, text, word
from ema.messages.lists import listed
from ema.report.blocks import Block, Book, Cell, Text
from ema.report.modes import condition_text, interval, standard_deviations
from ema.report.numbers import MISSING, Value, fixed
from ema.report.repeats import scatter
from ema.shapes import Comparison, compare


def base_run(runs: list[RunResult]) -> RunResult:
    """The first run without a friction beam, or the first."""
    return next((run for run in runs if not run.run.condition.joints), runs[0])


def comparisons(runs: list[RunResult], book: Book) -> tuple[list[str], list[Block]]:
    """Every run against the base: one sentence each, and the tables."""
    runs = [run for run in runs if len(run.modes.poles)]
    if len(runs) < 2:
        return [], []
    base = base_run(runs)
    lines: list[str] = []
    judged, blocks = scatter(runs, book)
    labels = [run.run.repeat for run in runs if run.run.repeat]
    for other in runs:
        if other is base:
            continue
        try:
            comparison = compare(base.modes, other.modes)
        except InputError as error:
            blocks.append(
                Text(
                    text("{base} against {run}: {error}.", base=base.run.id, run=other.run.id, error=error),
                    missing=True,
                )
            )
            continue
        if labels.count(other.run.repeat) < 2:  # of repeats, the sentence on their condition says more
            lines.append(_sentence(base, other, comparison))
        blocks.append(_table(base, other, comparison, book))
    return [*lines, *judged], blocks


def _changes(base: RunResult, other: RunResult, comparison: Comparison) -> tuple[np.ndarray, np.ndarray]:
    """Ratios of natural frequencies and of damping ratios of the pairs that are certain, other over base."""
    certain = [pair for pair, rivals in zip(comparison.pairs, comparison.rivals, strict=True) if not rivals]
    left, right = ([pair[k] for pair in certain] for k in (0, 1))
    frequency = other.modes.natural_frequencies[right] / base.modes.natural_frequencies[left]
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = other.modes.damping_ratios[right] / base.modes.damping_ratios[left]
    return frequency, damping


def _sentence(base: RunResult, other: RunResult, comparison: Comparison) -> str:
    if not comparison.pairs:
        return text("{run} against {base}: no two modes have like shapes.", run=other.run.id, base=base.run.id)
    names = {"run": other.run.id, "base": base.run.id}
    head = text("{run} against {base}", **names)
    if base.equivalent or other.equivalent:
        head = text("{run} against {base} for small amplitudes", **names)
    doubts = "".join(
        " " + doubt(i, (j, *rivals), base.modes.natural_frequencies[i], other.run.id)
        for (i, j), rivals in zip(comparison.pairs, comparison.rivals, strict=True)
        if rivals
    )
    frequency, damping = _changes(base, other, comparison)
    if not len(frequency):
        return text("{head}: no certain pair of modes.", head=head) + doubts
    shifts = _each([_change(float(ratio)) for ratio in frequency])
    factors = _each([f"{ratio:.2f}" for ratio in damping])
    sentence = plural(
        "{head}, {count} pair of modes: frequency {shifts} %, damping times {factors}.",
        "{head}, {count} pairs of modes: frequency {shifts} %, damping times {factors}.",
        len(frequency),
        head=head,
        shifts=shifts,
        factors=factors,
    )
    return sentence + doubts


MOST_LISTED = 4
"""Values up to which a sentence lists them all; of more it says the lowest and the highest."""


def _change(ratio: float) -> str:
    """A change of frequency in percent, of which a hundredth is the least that a sentence shows."""
    percent = round(100 * (ratio - 1), 2)
    return f"{percent:+.2f}" if percent else "0.00"


def _each(texts: list[str]) -> str:
    """Values of modes in their order; one where they are equal, the ends of their range where they are many."""
    if len(set(texts)) == 1:
        return texts[0]
    if len(texts) <= MOST_LISTED:
        return listed(texts)
    ordered = sorted(texts, key=float)
    return text("{low} to {high}", low=ordered[0], high=ordered[-1])


def _table(base: RunResult, other: RunResult, comparison: Comparison, book: Book) -> Block:
    columns = [
        text("Mode"),
        text("Mode in {run}", run=other.run.id),
        "f [Hz]",
        text("f in {run} [Hz]", run=other.run.id),
        text("Change of f [%]"),
        "ζ [%]",
        text("ζ in {run} [%]", run=other.run.id),
        text("ζ ratio [-]"),
        "MAC [-]",
    ]
    partners = dict(comparison.pairs)
    rivals = dict(zip(partners, comparison.rivals, strict=True))
    deviations = [standard_deviations(run.modes) for run in (base, other)]
    rows: list[list[Cell]] = []
    for i in range(len(base.modes.poles)):
        f_i, z_i = float(base.modes.natural_frequencies[i]), 100 * float(base.modes.damping_ratios[i])
        left = interval(f_i, deviations[0][0][i], 6), interval(z_i, deviations[0][1][i], 3)
        j = partners.get(i)
        if j is None:
            best = float(np.nanmax(comparison.mac[i])) if np.isfinite(comparison.mac[i]).any() else float("nan")
            rows.append([i + 1, text("none"), left[0], MISSING, MISSING, left[1], MISSING, MISSING, fixed(best, 3)])
            continue
        f_j, z_j = float(other.modes.natural_frequencies[j]), 100 * float(other.modes.damping_ratios[j])
        doubtful = ", ".join(str(k + 1) for k in rivals[i])
        partner: Cell = text("{mode}, or {others}", mode=j + 1, others=doubtful) if doubtful else j + 1
        rows.append(
            [
                i + 1,
                partner,
                left[0],
                interval(f_j, deviations[1][0][j], 6),
                Value(change := 100 * (f_j / f_i - 1), f"{change:+z.2f}"),
                left[1],
                interval(z_j, deviations[1][1][j], 3),
                fixed(z_j / z_i if z_i else None, 2),
                fixed(float(comparison.mac[i, j]), 3),
            ]
        )
    alone = sorted(set(range(len(other.modes.poles))) - set(partners.values()))
    caption = text(
        "{base} ({base_condition}) against {run} ({condition}): modes paired by MAC over {number} common DOFs and by "
        "frequency; intervals: {basis}.",
        base=base.run.id,
        base_condition=condition_text(base),
        run=other.run.id,
        condition=condition_text(other),
        number=len(comparison.dofs),
        basis=word(NOISE_ONLY),
    )
    if alone:
        modes = ", ".join(str(j + 1) for j in alone)
        caption += " " + text("Modes of {run} without a partner: {modes}.", run=other.run.id, modes=modes)
    if any(comparison.rivals):
        caption += " " + text(
            "Where several partners are named, shapes do not tell which it is: the values are those of the first."
        )
    return book.table(f"comparison_{base.run.id}_{other.run.id}", caption, columns, rows)
