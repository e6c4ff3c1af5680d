"""Predictions at forces in a report: of a map with an updated model, and of a friction beam at a named location."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ema import show
from ema.data import Forecast, MapPrediction, ModalMap, ModalModel, ModelUpdate, Provenance
from ema.messages import mark, text, word
from ema.messages.recognition import recognised
from ema.report.blocks import Block, Book, Cell, Section, Text
from ema.report.forecast import budget_blocks
from ema.report.numbers import plain
from ema.report.prediction_tables import FORECAST_COLUMNS, Bounds, conditions, forecast_rows, without_beam
from ema.report.prediction_words import against, banded, first_ones, stated

_CONTAINS = (mark("noise of the map, parameters, form of the law, frequency of the host"),)
"""What is in the bands, as data say it."""
_READINGS = {
    "measured": mark("f and damping are what a one-mode fit of a stepped sine about the resonance reads."),
    "frozen": mark("f and damping are those of the steady state at resonance, by quadrature and power."),
}
"""What the values of each method are."""


@dataclass(frozen=True)
class FromMap:
    """A prediction of a map, with the map and the update of the model where they were stored."""

    predicted: MapPrediction
    chart: ModalMap | None
    update: ModelUpdate | None


def map_parts(of: FromMap, book: Book) -> tuple[list[str], list[Section], Provenance]:
    """Report what was predicted at other forces: sentences, sections and where the map came from."""
    one, chart = of.predicted, of.chart
    sentences, basis = _of_map(of, book)
    lines, blocks = _map_conditions(of, book)
    sentences += first_ones(lines)
    if chart is None and one.statement:
        sentences.append(recognised(one.statement))
    contained = [text("The bands contain: {contains}.", contains=word(one.contains))] if one.contains else []
    contained.append(text("Not in the bands: what differs between assemblies and between days."))
    contained.append(
        text(
            "The bands were calibrated up to a factor of two outside the map in F_E and F_N; beyond, a finding says "
            "so. A condition without a resonance in the band is empty and has a finding."
        )
    )
    contained.append(
        text("Confirmed: by a map that is measured there; no condition of the prediction was compared with one.")
    )
    sections = [
        *([Section(text("What was predicted from what"), "basis", basis)] if basis else []),
        Section(text("At other forces"), "conditions", blocks),
        Section(text("What the bands contain"), "bands", [Text(line) for line in contained]),
    ]
    return sentences, sections, Provenance() if chart is None else chart.provenance


def _of_map(of: FromMap, book: Book) -> tuple[list[str], list[Block]]:
    """The map and the parameters of the model that was updated by it."""
    if of.chart is None:
        return [text("A map is continued by a model that was updated by it, with 95 % bands.")], []
    levels, forces = _measured(of.chart)
    ends = [(stated(float(axis.min())), stated(float(axis.max()))) for axis in (levels, forces)]
    sentences = [
        text(
            "{name}, measured at F_E {low} to {high} N and F_N {least} to {most} N, is continued by a model that was "
            "updated by it, with 95 % bands.",
            name=of.predicted.name or of.chart.name or text("map"),
            low=ends[0][0],
            high=ends[0][1],
            least=ends[1][0],
            most=ends[1][1],
        )
    ]
    rows: list[tuple[Cell, ...]] = [("F_E [N]", *ends[0]), ("F_N [N]", *ends[1])]
    columns = (text("Axis"), text("Lowest measured"), text("Highest measured"))
    blocks: list[Block] = [book.table("map_range", text("Range of the map that was continued."), columns, rows)]
    if of.update is not None:
        said, table = _parameters(of.update, book)
        sentences.append(said)
        blocks += table
    return sentences, blocks


def _measured(chart: ModalMap) -> tuple[np.ndarray, np.ndarray]:
    """Force levels and normal forces with a measured value."""
    known = np.isfinite(chart.damping) & np.isfinite(chart.frequency)
    return np.asarray(chart.force_levels)[known.any(axis=1)], np.asarray(chart.normal_forces)[known.any(axis=0)]


def _parameters(update: ModelUpdate, book: Book) -> tuple[str, list[Block]]:
    """The updated parameters of the joint, and which of them the map identifies."""
    rows: list[tuple[Cell, ...]] = []
    named = []
    every = zip(update.names, update.values.tolist(), update.intervals.tolist(), update.identifiable, strict=True)
    for name, value, (low, high), known in every:
        cells = banded(low, value, high)
        named.append(f"{name} {cells[0]} ({cells[1]})")
        numbers = (plain(x, 6) for x in (low, value, high))
        rows.append((name, *cells, text("yes") if known else text("no"), *numbers))
    columns = (
        text("Parameter"),
        text("Value"),
        text("95 % interval"),
        text("Identifiable"),
        *("low_SI", "value_SI", "high_SI"),
    )
    caption = text("Parameters of the joint that fit the measured map, with 95 % intervals.")
    blocks: list[Block] = [book.table("parameters", caption, columns, rows, 4)]
    blocks.append(
        Text(
            text(
                "Identifiable: the map bounds the parameter within its range. That an identifiable parameter predicts "
                "does not follow."
            )
        )
    )
    return text("Parameters of the joint by the map: {values}.", values="; ".join(named)), blocks


def _map_conditions(of: FromMap, book: Book) -> tuple[list[str], list[Block]]:
    """A sentence and a row for each condition."""
    one, chart = of.predicted, of.chart
    axes = None if chart is None else _measured(chart)
    lines: list[str] = []
    rows: list[list[Cell]] = []
    for at in np.ndindex(one.damping.shape):
        drive, normal = float(one.force_levels[at[0]]), float(one.normal_forces[at[1]])
        f, z = (_bounds(one, what, at) for what in ("frequency", "damping"))
        cells: list[Cell] = [stated(drive), stated(normal)]
        where = []
        if axes is not None:
            where = [
                against(value, float(axis.min()), float(axis.max()))
                for value, axis in zip((drive, normal), axes, strict=True)
            ]
        known = bool(np.isfinite([*f, *z]).all())
        values = _values(f, z, known=known)
        rows.append([*cells, *where, *values, *(plain(x, 6) for x in (drive, normal, *f, *z))])
        lines.append(_condition(cells, where, values, known=known))
    outside = [] if axes is None else [text("F_E against the data"), text("F_N against the data")]
    columns = ["F_E [N]", "F_N [N]", *outside, "f [Hz]", text("95 % band"), "ζ [%]", text("95 % band")]
    si = FORECAST_COLUMNS[5:13]
    caption = text("Predicted natural frequency f and damping ratio ζ at each condition, with their 95 % bands.")
    figure = book.picture(
        partial(show.map_prediction, one, chart),
        text("Damping and frequency of {name} over the normal force, predicted.", name=one.name or text("map")),
        text(
            "Damping ratio and frequency over the normal force: points with 95 % bars are measured, dashed lines with "
            "bands, or diamonds with bars, are predicted."
        ),
    )
    return lines, [figure, book.table("predicted", caption, [*columns, *si], rows, len(columns))]


def _bounds(one: MapPrediction, what: str, at: tuple[int, ...]) -> Bounds:
    """Low, value and high at a condition."""
    low, value, high = (float(getattr(one, f"{what}{end}")[at]) for end in ("_low", "", "_high"))
    return low, value, high


def _values(f: Bounds, z: Bounds, *, known: bool) -> list[Cell]:
    """Frequency and damping with their bands, or that there is no resonance."""
    return [*banded(*f), *banded(*z, 100)] if known else ["", text("no resonance"), "", text("no resonance")]


def _condition(cells: Sequence[Cell], where: Sequence[str], values: Sequence[Cell], *, known: bool) -> str:
    """What is predicted at one condition."""
    drive, normal = (f"{cell} N" for cell in cells)
    if where:
        drive, normal = f"{drive} ({where[0]})", f"{normal} ({where[1]})"
    if not known:
        return text("F_E {drive}, F_N {normal}: no resonance in the band.", drive=drive, normal=normal)
    return text(
        "F_E {drive}, F_N {normal}: {f} Hz ({f_band}), damping {zeta} % ({zeta_band}).",
        drive=drive,
        normal=normal,
        **dict(zip(("f", "f_band", "zeta", "zeta_band"), values, strict=True)),
    )


def location_parts(
    forecasts: Sequence[Forecast], bare: ModalModel | None, book: Book
) -> tuple[list[str], list[Section], Provenance]:
    """Report what beams do at named locations: sentences, sections and where the forecasts came from."""
    names = [_location(one) for one in forecasts]
    sentences = [
        text("Predicted from the modes without a beam and the joint that the placement recipe states, with 95 % bands.")
    ]
    lines: list[str] = []
    rows: list[list[Cell]] = []
    for name, forecast in zip(names, forecasts, strict=True):
        for row, mode in enumerate(forecast.modes):
            without = without_beam(forecast, bare, row)
            before: list[Cell] = [*banded(*without[0]), *banded(*without[1], 100)]
            for drive, normal, f, z in conditions(forecast, row):
                cells: list[Cell] = [name, str(mode), stated(drive), stated(normal)]
                known = bool(np.isfinite(f[1]))
                values = _values(f, z, known=known)
                rows.append([*cells, *values])
                lines.append(_at_location(cells, values, before, known=known))
    far = any(finding.code == "outside-recipe" for one in forecasts for finding in one.findings)
    lines = [*first_ones(lines)]
    if any(np.isnan(one.centre[0]) for one in forecasts):
        lines.append(text("Beams that are listed together act at the same time; F_N is that of the beam pressed most."))
    lines.append(
        text("F_E or F_N lie outside the ranges of the recipe; the findings say by how much.")
        if far
        else text("F_E and F_N lie within the ranges of the recipe.")
    )
    sections = [
        Section(text("Beams at named locations"), "locations", _location_blocks(forecasts, bare, book, rows)),
        Section(text("What the bands contain"), "bands", _location_bands(forecasts, book)),
    ]
    return [*sentences, *lines], sections, forecasts[0].provenance


def _location(forecast: Forecast) -> str:
    """Beam, centre and angle; of several beams together what lists them, for they have no common centre."""
    x, y = forecast.centre
    if np.isnan(x):
        return forecast.beam
    return text(
        "{beam} at ({x}, {y}) m, {angle}°",
        beam=forecast.beam or text("beam"),
        x=f"{x:.3f}",
        y=f"{y:.3f}",
        angle=f"{np.degrees(forecast.angle):.4g}",
    )


def _at_location(cells: Sequence[Cell], values: Sequence[Cell], before: Sequence[Cell], *, known: bool) -> str:
    """What a beam does at one condition, beside the mode without it."""
    names = dict(zip(("location", "mode", "drive", "normal"), cells, strict=True))
    if not known:
        return text(
            "{location}, mode {mode}, F_E {drive} N, F_N {normal} N: no single resonance belongs to the mode.", **names
        )
    return text(
        "{location}, mode {mode}, F_E {drive} N, F_N {normal} N: {f} Hz ({f_band}), damping {zeta} % ({zeta_band}); "
        "without the beam {f_bare} Hz, {zeta_bare} %.",
        **names,
        **dict(zip(("f", "f_band", "zeta", "zeta_band"), values, strict=True)),
        f_bare=before[0],
        zeta_bare=before[2],
    )


def _location_blocks(
    forecasts: Sequence[Forecast], bare: ModalModel | None, book: Book, rows: Sequence[Sequence[Cell]]
) -> list[Block]:
    """A picture of each forecast, all conditions, and the modes without a beam."""
    blocks: list[Block] = []
    for forecast in forecasts:
        where = _location(forecast)
        blocks.append(
            book.picture(
                partial(show.forecast_bands, forecast),
                text("Predicted frequency and damping with {where}, with 95 % bands.", where=where),
                text("Predicted frequency and damping with {where}, with 95 % bands.", where=where),
            )
        )
    full = [
        (*row, *(cell if isinstance(cell, str | int) else plain(cell, 6) for cell in numbers))
        for row, numbers in zip(rows, forecast_rows(forecasts, bare), strict=True)
    ]
    columns = (
        text("Beam and location"),
        text("Mode"),
        "F_E [N]",
        "F_N [N]",
        "f [Hz]",
        text("95 % band"),
        "ζ [%]",
        text("95 % band"),
        *FORECAST_COLUMNS,
    )
    caption = text("Predicted values with their 95 % bands.")
    blocks.append(book.table("predicted", caption, columns, full, 8))
    modes = {
        mode: (str(mode), *banded(*without[0]), *banded(*without[1], 100))
        for forecast in forecasts
        for row, mode in enumerate(forecast.modes)
        for without in [without_beam(forecast, bare, row)]
    }
    heads: tuple[str, ...] = (text("Mode"), "f [Hz]", text("95 % interval"), "ζ [%]", text("95 % interval"))
    values: list[tuple[Cell, ...]] = list(modes.values())
    if bare is None or bare.covariance is None:
        heads, values = (heads[0], *heads[1::2]), [(row[0], *row[1::2]) for row in values]
    blocks.append(book.table("without_beam", text("Target modes without the beam."), heads, values))
    return blocks


def _location_bands(forecasts: Sequence[Forecast], book: Book) -> list[Block]:
    """What is in the bands, what is not, and what the values are."""
    methods = dict.fromkeys(one.method for one in forecasts)
    blocks: list[Block] = [Text(word(_READINGS[method])) for method in methods if method in _READINGS]
    blocks.append(
        Text(
            text(
                "The bands contain the uncertainties that the recipe states, by draws of shapes, friction and contact "
                "stiffness."
            )
        )
    )
    blocks.append(
        Text(
            text(
                "Not in the bands: what the recipe does not state, such as another joint, another assembly of the "
                "structure, and what tests have shown since."
            )
        )
    )
    blocks.append(
        Text(text("Confirmed: by a measurement with the beam mounted there; none was compared with the prediction."))
    )
    return [*blocks, *(block for one in forecasts for block in budget_blocks(one, book))]
