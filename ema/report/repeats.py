"""Scatter that is not noise: the repeats of each condition, and which changes they make significant."""

import numpy as np

from ema import compare
from ema.compare.components import least_half_of_difference
from ema.compare.scatter import difference_sentences
from ema.data import ConditionDifference, RepeatGroup, RunResult, VarianceComponents
from ema.data.repeats import NOISE_ONLY
from ema.messages import mark, plural, text, word
from ema.report.blocks import Block, Book, Cell, Text
from ema.report.numbers import MISSING, Value, fixed, plain, rounded, with_uncertainty

_SEPARATED = mark(
    "Noise is what the fit of one run states; takes is the standard deviation between runs of one assembly; between is "
    "that from one assembly to the next, without noise, with its 95 % interval. ± of a mean is half its 95 % interval "
    "over the assemblies."
)
_WORDS = (mark("noise only; assembly scatter unknown"), mark("significant"), mark("not significant"))
"""What is known of a change, as data say it."""


def scatter(runs: list[RunResult], book: Book) -> tuple[list[str], list[Block]]:
    """What the repeats say, as sentences and as tables; nothing where a study has one condition."""
    groups, differences = compare.conditions(runs)
    lines = difference_sentences(differences)
    repeated = [group for group in groups if len(group.runs) > 1]
    if not repeated:
        sentence = text(
            "Intervals: {basis}, because no condition was repeated. No difference is called significant here.",
            basis=word(NOISE_ONLY),
        )
        return lines, [Text(sentence)] if differences else []
    blocks: list[Block] = [Text(text(_SEPARATED)), *(_group(group, book) for group in repeated)]
    return lines, [*blocks, *(_difference(one, groups, book) for one in differences if one.pairs)]


def _group(group: RepeatGroup, book: Book) -> Block:
    columns = [text("Mode"), text("Repeats")]
    for name, unit in (("f", "Hz"), ("ζ", "%")):
        columns += [
            f"{name} [{unit}]",
            text("noise {name} [{unit}]", name=name, unit=unit),
            text("takes {name} [{unit}]", name=name, unit=unit),
            text("between {name} [{unit}]", name=name, unit=unit),
        ]
    rows: list[list[Cell]] = []
    for mode in range(len(group.frequency.mean)):
        parts = [*_cells(group.frequency, mode, 1.0, 6), *_cells(group.damping, mode, 100.0, 3)]
        rows.append([mode + 1, int(group.frequency.assemblies[mode]), *parts])
    caption = text(
        "Repeats of {label} ({runs}): {basis}.", label=group.label, runs=", ".join(group.runs), basis=_basis(group)
    )
    return book.table(f"repeats_{group.label}", caption, columns, rows)


def _cells(one: VarianceComponents, mode: int, scale: float, digits: int) -> list[Cell]:
    """Mean with its interval, noise, takes, between with its interval."""
    half = scale * float(one.half[mode])
    between, (low, high) = scale * float(one.between[mode]), scale * one.between_interval[mode]
    between_text = plain(between, 2)
    if np.isfinite(between):
        ends = text("{low} to {high}", low=plain(float(low), 2), high=plain(float(high), 2))
        between_text = Value(between, f"{between_text} ({ends})")
    return [
        with_uncertainty(scale * float(one.mean[mode]), half, digits),
        plain(scale * float(one.noise[mode]), 2),
        plain(scale * float(one.takes[mode]), 2),
        between_text,
    ]


def _difference(found: ConditionDifference, groups: tuple[RepeatGroup, ...], book: Book) -> Block:
    basis = {group.label: group for group in groups}
    columns = [text("Mode"), text("Mode in {run}", run=found.second)]
    for name, unit in (("f", "Hz"), ("ζ", "%")):
        columns += [
            f"{name} [{unit}]",
            text("{name} in {run} [{unit}]", name=name, run=found.second, unit=unit),
            text("Change of {name} [{unit}]", name=name, unit=unit),
            text("Verdict on {name}", name=name),
        ]
    columns += ["MAC [-]"]
    rows: list[list[Cell]] = []
    first, second = basis[found.first], basis[found.second]
    least = (
        least_half_of_difference(first.frequency, second.frequency, found.pairs),
        least_half_of_difference(first.damping, second.damping, found.pairs),
    )
    quantities = (
        (1.0, 6, found.frequency, found.frequency_half, least[0], found.words("frequency")),
        (100.0, 3, found.damping, found.damping_half, least[1], found.words("damping")),
    )
    for pair, (i, j) in enumerate(found.pairs):
        row: list[Cell] = [i + 1, j + 1]
        for scale, digits, values, half, at_least, words in quantities:
            bound = half[pair] if np.isfinite(half[pair]) else at_least[pair]
            row += [_mean(scale * values[pair, k], scale * bound, digits) for k in (0, 1)]
            row += [_change(scale * (values[pair, 1] - values[pair, 0]), scale * bound), word(words[pair])]
        rows.append([*row, fixed(float(found.mac[pair]), 3)])
    change = text(
        "Change from {first} ({first_basis}) to {second} ({second_basis})",
        first=found.first,
        first_basis=_basis(first),
        second=found.second,
        second_basis=_basis(second),
    )
    if min(first.count, second.count) > 1:
        caption = text("{change}; ± is half the 95 % interval of the change.", change=change)
    else:
        caption = text(
            "{change}; ± is half the 95 % interval of the change without the scatter of what was not repeated.",
            change=change,
        )
    return book.table(f"change_{found.first}_{found.second}", caption, columns, rows)


def _basis(group: RepeatGroup) -> str:
    """How many repeats there are, or that there are none."""
    return plural("{count} repeat", "{count} repeats", group.count) if group.count > 1 else word(NOISE_ONLY)


def _mean(value: float, by: float, digits: int) -> Value:
    return rounded(float(value), float(by), digits)


def _change(value: float, half: float) -> Value:
    shown = with_uncertainty(float(value), float(half), 2)
    if shown.text == MISSING or value <= 0:
        return shown
    return Value(shown.value, f"+{shown.text}")
