"""Predictions from stepped levels in a report: at other amplitudes, and under forces."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ema import show
from ema.data import Band, Provenance
from ema.messages import mark, text, word
from ema.report.amplitude import level_table
from ema.report.blocks import Block, Book, Cell, Section, Text
from ema.report.numbers import plain
from ema.report.prediction_forces import under_forces
from ema.report.prediction_laws import law_blocks, law_sentences
from ema.report.prediction_source import FromLevels, in_si, points
from ema.report.prediction_words import banded, first_ones, stated

_CONTAINS = (
    mark("noise of the levels, parameters and form of the law"),
    mark("noise of the levels, parameters and form of the law and the modal mass"),
)
"""What is in the bands, as data say it."""


def level_parts(of: FromLevels, book: Book) -> tuple[list[str], list[Section], Provenance]:
    """Report what was predicted of one mode: sentences, sections and where its levels came from."""
    basis = _basis(of, book)
    sentences = [_from_what(of)]
    sections = [Section(text("What was predicted from what"), "basis", basis)]
    if of.at or of.draws is not None:
        lines, blocks = _at_amplitudes(of, book)
        sentences += first_ones(lines)
        sections.append(Section(text("At other amplitudes"), "amplitudes", blocks))
    if of.resonances or of.responses or of.surfaces:
        lines, blocks = under_forces(of, book)
        sentences += first_ones(lines)
        sections.append(Section(text("Under forces"), "forces", blocks))
    sentences += [*law_sentences(of), *_confirmed(of)]
    if laws := law_blocks(of, book):
        sections.append(Section(text("Joint laws"), "laws", laws))
    sections.append(Section(text("What the bands contain"), "bands", _contained(of)))
    return sentences, sections, Provenance() if of.fitted is None else of.fitted.provenance


def _from_what(of: FromLevels) -> str:
    """What the prediction rests on."""
    if len(of.levels) < 2:
        return text(
            "Prediction of {mode} from measured levels up to {high} {unit}, with 95 % bands.",
            mode=of.name,
            high=stated(float(of.levels[-1])),
            unit=of.unit,
        )
    return text(
        "Prediction of {mode} from {levels} measured levels, {low} to {high} {unit}, with 95 % bands.",
        mode=of.name,
        levels=len(of.levels),
        low=stated(float(of.levels[0])),
        high=stated(float(of.levels[-1])),
        unit=of.unit,
    )


def _basis(of: FromLevels, book: Book) -> list[Block]:
    """What the prediction rests on, in numbers, and the levels themselves."""
    rows: list[tuple[Cell, ...]] = []
    if len(of.levels) > 1:
        rows.append((text("Levels fitted"), len(of.levels), ""))
        rows.append((text("Lowest level fitted"), stated(float(of.levels[0])), of.unit))
    rows.append((text("Highest level fitted"), stated(float(of.levels[-1])), of.unit))
    if of.draws is not None:
        rows.append((text("Draws kept"), len(of.draws.frequency), ""))
        if of.draws.modal_mass is not None:
            mass = float(np.median(of.draws.modal_mass))
            rows.append((text("Modal mass for a shape of 1 at the response"), stated(mass), "kg"))
    inside, held_out = of.tested
    if held_out:
        rows.append((text("Held-out levels compared"), held_out, ""))
        rows.append((text("Of these inside the bands"), inside, ""))
    columns = (text("Quantity"), text("Value"), text("Unit"))
    blocks: list[Block] = [book.table("basis", text("What the prediction rests on."), columns, rows)]
    if of.modes:
        caption = text("Measured levels, those held out included.") if held_out else text("Measured levels.")
        blocks.append(level_table(of.modes[-1:], book, "measured_levels", caption))
    return blocks


def _at_amplitudes(of: FromLevels, book: Book) -> tuple[list[str], list[Block]]:
    """Frequency and damping at the amplitudes asked for; without any, over those of the draws."""
    if not of.at:
        assert of.draws is not None
        caption = text(
            "Frequency and damping over the amplitude: medians and 95 % bands of the draws; dotted: the highest level "
            "fitted."
        )
        return [], [book.picture(partial(show.amplitude_draws, of.draws), caption, caption)]
    lines: list[str] = []
    rows: list[tuple[Cell, ...]] = []
    for one in of.at:
        forces = points(one.force) if one.force is not None else [(np.nan,) * 3] * len(one.amplitude)
        values = zip(one.amplitude.tolist(), points(one.frequency), points(one.damping), forces, strict=True)
        for amplitude, f, z, force in values:
            at = (stated(amplitude), of.against(amplitude), *banded(*f), *banded(*z, 100), *banded(*force))
            lines.append(
                text(
                    "At {amplitude} {unit} ({where}): {f} Hz ({f_band}), damping {zeta} % ({zeta_band}).",
                    **dict(zip(("amplitude", "where", "f", "f_band", "zeta", "zeta_band"), at[:6], strict=True)),
                    unit=of.unit,
                )
            )
            rows.append((*at, *(plain(x, 6) for x in (amplitude, *f, *z, *force))))
    force_known = any(one.force is not None for one in of.at)
    si = ("amplitude", *in_si("frequency_Hz"), *in_si("damping"), *in_si("force_N"))
    columns = (
        text("Amplitude [{unit}]", unit=of.unit),
        text("Against the data"),
        "f [Hz]",
        text("95 % band"),
        "ζ [%]",
        text("95 % band"),
        text("Force [N]"),
        text("95 % band"),
        *si,
    )
    caption = text(
        "Predicted natural frequency f and damping ratio ζ: medians with their 95 % bands, and the force at phase "
        "resonance that keeps up the amplitude, where the modal mass is known."
    )
    table = _without_columns(6, 8, force_known, columns, rows)
    figure = book.picture(
        partial(show.amplitude_modes, of.modes[-1:], of.at),
        text("Frequency and damping over the amplitude: {names}.", names=of.name),
        text(
            "Frequency and damping over the amplitude: measured levels with 95 % intervals, and predicted medians with "
            "95 % bands."
        ),
    )
    return lines, [figure, book.table("predicted", caption, *table)]


def _without_columns(
    first: int, last: int, known: bool, columns: Sequence[str], rows: Sequence[Sequence[Cell]]
) -> tuple[Sequence[str], Sequence[Sequence[Cell]], int]:
    """Columns, rows and the number of columns shown, without those of a quantity that is nowhere known."""
    shown = last
    if known:
        return columns, rows, shown
    return (
        [*columns[:first], *columns[last:]],
        [[*row[:first], *row[last:]] for row in rows],
        first,
    )


def _confirmed(of: FromLevels) -> list[str]:
    """Whether held-out levels confirm the prediction."""
    inside, held_out = of.tested
    if held_out:
        return [
            text(
                "Held-out levels, which were not fitted: {inside} of {levels} lie inside the bands of frequency and "
                "damping.",
                inside=inside,
                levels=held_out,
            )
        ]
    return [text("No held-out level has an amplitude of the prediction: nothing confirms it.")]


def _contained(of: FromLevels) -> list[Block]:
    """What is in the bands, what is not, and what confirms them."""
    bands: list[Band] = [one.damping for one in of.at]
    bands += [one.damping for one in of.resonances] + [one.up for one in of.responses]
    contains = next((band.contains for band in bands if band.contains), "") or (of.draws.contains if of.draws else "")
    lines = [text("The bands contain: {contains}.", contains=word(contains))] if contains else []
    lines.append(
        text("Not in the bands: what differs between assemblies, between days, and between ring-down and stepped sine.")
    )
    if of.resonances or of.responses:
        lines.append(
            text(
                "Not in the bands under forces: other modes, also their share of the response on the skirts; the "
                "uncertainty of the modal mass, unless it was stated; a loss that changes with the frequency at one "
                "amplitude."
            )
        )
    lines.append(
        text(
            "The bands were calibrated up to twice the highest level and down to half the lowest; beyond, a finding "
            "says so."
        )
    )
    lines.append(
        text(
            "Confirmed: only by levels above those fitted, at an amplitude of the prediction, whose frequency and "
            "damping both lie inside the bands. Levels within those fitted are no test."
        )
    )
    return [Text(line) for line in lines]
