"""Predictions from stepped levels in a report: at other amplitudes, and under forces."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ema import show
from ema.compare import confirmed
from ema.data import (
    AmplitudeDependentMode,
    AmplitudeDraws,
    AmplitudePrediction,
    Band,
    ForcedResonances,
    ForcedResponse,
    ForceSurface,
    Provenance,
)
from ema.messages import mark, text, word
from ema.messages.lists import listed
from ema.report.amplitude import level_table
from ema.report.blocks import Block, Book, Cell, Section, Table, Text
from ema.report.numbers import Value, plain
from ema.report.prediction_tables import RESPONSE_COLUMNS, response_rows
from ema.report.prediction_words import against, banded, first_ones, stated
from ema.units import SI_UNIT

_LAWS = (
    mark("power law"),
    mark("masing"),
    mark("two masing springs"),
    mark("modified iwan"),
    mark("regularised masing"),
    mark("valanis"),
)
_PARAMETERS = {
    "chi": mark("exponent of the density of slip limits"),
    "last spring": mark("share of the stiffness that slips last"),
    "log exponent": mark("natural logarithm of the exponent of the law"),
    "kappa": mark("sharpness of the onset of slip; 0 is the law of Dahl"),
    "ln a_max/a_s": mark("natural logarithm of the highest level over the slip amplitude of the law"),
}
"""What the parameters of the laws are, by the names that data give them."""
_REASONS = (
    mark("its interval does not close within the prior"),
    mark("its standard deviation is above a third of the prior's"),
    mark("its estimates with levels left out disagree"),
    mark("too few draws describe it"),
)
"""Why levels do not identify a parameter, as data say it."""
_CONTAINS = (
    mark("noise of the levels, parameters and form of the law"),
    mark("noise of the levels, parameters and form of the law and the modal mass"),
)
"""What is in the bands, as data say it."""
_ALIKE = 1e-6
"""Relative distance from an equal weight that is rounding."""


@dataclass(frozen=True)
class FromLevels:
    """What was predicted of one mode: everything that was stored of it."""

    modes: tuple[AmplitudeDependentMode, ...]
    draws: AmplitudeDraws | None
    at: tuple[AmplitudePrediction, ...]
    resonances: tuple[ForcedResonances, ...]
    responses: tuple[ForcedResponse, ...]
    surfaces: tuple[ForceSurface, ...]

    @classmethod
    def of(cls, results: Sequence[Any]) -> "FromLevels":
        """Sort the results of one mode by their kind."""

        def every(kind: type) -> tuple[Any, ...]:
            return tuple(one for one in results if isinstance(one, kind))

        modes = tuple(sorted(every(AmplitudeDependentMode), key=lambda mode: len(mode.amplitude)))
        return cls(
            modes,
            next(iter(every(AmplitudeDraws)), None),
            every(AmplitudePrediction),
            every(ForcedResonances),
            every(ForcedResponse),
            every(ForceSurface),
        )

    @property
    def fitted(self) -> AmplitudeDependentMode | None:
        """The levels that were fitted: the fewest, where all measured ones were stored too."""
        return self.modes[0] if self.modes else None

    @property
    def name(self) -> str:
        """What the mode is called."""
        return next((one.name for one in self._every if one.name), "") or text("mode")

    @property
    def unit(self) -> str:
        """SI unit of the amplitudes."""
        return SI_UNIT[self._every[0].quantity].replace("^2", "²")

    @property
    def levels(self) -> np.ndarray:
        """Amplitudes of the levels that were fitted; the highest alone where only the predicted values are known."""
        if self.draws is not None or self.fitted is not None:
            return np.asarray(self.fitted.amplitude if self.draws is None else self.draws.levels)  # type: ignore[union-attr]
        tops = [float(one.amplitude[0] / one.beyond[0]) for one in self.at]
        tops += [float(one.amplitude.value[0] / one.beyond[0]) for one in self.resonances]
        tops += [one.highest_level for one in self.responses]
        tops += [float(one.amplitude[0] / one.beyond[0]) for one in self.surfaces]
        return np.array(tops[:1])

    def against(self, amplitude: float) -> str:
        """How far an amplitude lies outside the levels that were fitted."""
        levels = self.levels
        return against(amplitude, float(levels[0]) if len(levels) > 1 else 0.0, float(levels[-1]))

    @property
    def tested(self) -> tuple[int, int]:
        """Held-out levels inside the bands, and those compared."""
        counts = [confirmed(one, self.modes[-1]) for one in self.at] if len(self.modes) > 1 else []
        return sum(inside for inside, _ in counts), sum(every for _, every in counts)

    @property
    def laws(self) -> list[tuple[str, float]]:
        """Names of the joint laws and their weights, the largest first."""
        sources = [*self.at, *(() if self.draws is None else (self.draws,))]
        for one in sources:
            if one.laws and one.weights is not None and len(one.weights):
                return sorted(zip(one.laws, map(float, one.weights), strict=True), key=lambda pair: -pair[1])
        return []

    @property
    def _every(self) -> tuple[Any, ...]:
        draws = () if self.draws is None else (self.draws,)
        return (*self.at, *self.resonances, *self.responses, *self.surfaces, *draws, *self.modes)


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
        lines, blocks = _under_forces(of, book)
        sentences += first_ones(lines)
        sections.append(Section(text("Under forces"), "forces", blocks))
    sentences += [*_law_sentences(of), *_confirmed(of)]
    if laws := _laws(of, book):
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


def _points(band: Band) -> list[tuple[float, float, float]]:
    return list(zip(band.low.tolist(), band.value.tolist(), band.high.tolist(), strict=True))


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
        forces = _points(one.force) if one.force is not None else [(np.nan,) * 3] * len(one.amplitude)
        points = zip(one.amplitude.tolist(), _points(one.frequency), _points(one.damping), forces, strict=True)
        for amplitude, f, z, force in points:
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
    si = ("amplitude", *_si("frequency_Hz"), *_si("damping"), *_si("force_N"))
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


def _si(name: str) -> tuple[str, str, str]:
    return f"{name}_low", f"{name}_median", f"{name}_high"


def _under_forces(of: FromLevels, book: Book) -> tuple[list[str], list[Block]]:
    """Resonances, responses over the frequency, and the force surface."""
    lines: list[str] = []
    blocks: list[Block] = []
    if of.resonances:
        lines, table = _resonances(of, book)
        blocks.append(table)
    if of.responses:
        blocks.append(
            book.picture(
                partial(show.forced_responses, of.responses),
                text("Response of {mode} to the forces over the frequency, swept up and down.", mode=of.name),
                text(
                    "Response to the forces over the frequency, swept up and down: medians and 95 % bands; dashed "
                    "grey: the highest level fitted."
                ),
            )
        )
        peaks, table = _peaks(of, book)
        lines = lines or peaks
        blocks.append(table)
        blocks += [_response(one, book) for one in of.responses]
    for surface in of.surfaces:
        if min(surface.force.value.shape) < 2 or not np.isfinite(surface.force.value).any():
            blocks.append(Text(text("The force surface has too few amplitudes to be drawn."), missing=True))
            continue
        blocks.append(
            book.picture(
                partial(show.force_surface, surface),
                text("Force that keeps up an amplitude of {mode} at a frequency.", mode=of.name),
                text(
                    "Force surface: the force that keeps up an amplitude at a frequency (left; white lines: response "
                    "curves at constant force) and the half width of its 95 % band (right). Dashed: the highest level "
                    "fitted."
                ),
            )
        )
    return lines, blocks


def _resonances(of: FromLevels, book: Book) -> tuple[list[str], Table]:
    """Amplitude, frequency and damping at phase resonance under each force."""
    lines: list[str] = []
    rows: list[tuple[Cell, ...]] = []
    for one in of.resonances:
        amplitudes, frequencies, damping = (_points(each) for each in (one.amplitude, one.frequency, one.damping))
        shares = one.several.tolist()
        for force, several, a, f, z in zip(one.force.tolist(), shares, amplitudes, frequencies, damping, strict=True):
            cells: tuple[Cell, ...] = (
                stated(force),
                *banded(*a),
                of.against(a[1]),
                *banded(*f),
                *banded(*z, 100),
            )
            names = ("force", "amplitude", "a_band", "where", "f", "f_band", "zeta", "zeta_band")
            lines.append(
                text(
                    "Under {force} N: resonance with {amplitude} {unit} ({a_band}; {where}) at {f} Hz ({f_band}), "
                    "damping {zeta} % ({zeta_band}).",
                    **dict(zip(names, cells, strict=True)),
                    unit=of.unit,
                )
            )
            share = Value(100 * several, f"{100 * several:.0f}")
            rows.append((*cells, share, *(plain(x, 6) for x in (force, *a, *f, *z))))
    columns = (
        text("Force [N]"),
        text("Amplitude [{unit}]", unit=of.unit),
        text("95 % band"),
        text("Against the data"),
        "f [Hz]",
        text("95 % band"),
        "ζ [%]",
        text("95 % band"),
        text("Several resonances [%]"),
        *("force_N", *_si("amplitude"), *_si("frequency_Hz"), *_si("damping")),
    )
    caption = text(
        "At phase resonance under each force: amplitude, frequency f and damping ratio ζ, medians with their 95 % "
        "bands. “Open”: a draw ends below that bound. Last: the share of the draws with several resonances at the "
        "force, of which the lowest counts."
    )
    return lines, book.table("resonances", caption, columns, rows, 9)


def _peaks(of: FromLevels, book: Book) -> tuple[list[str], Table]:
    """The largest response to each force, swept up and down."""
    lines: list[str] = []
    rows: list[tuple[Cell, ...]] = []
    for one in of.responses:
        force = stated(float(one.force.max()))
        cells: list[Cell] = [force]
        for sweep in (one.up, one.down):
            known = np.where(np.isfinite(sweep.value), sweep.value, -np.inf)
            top = int(np.argmax(known))
            peak = banded(float(sweep.low[top]), float(sweep.value[top]), float(sweep.high[top]))
            cells += [*peak, plain(float(one.frequencies[top]), 5)]
        rows.append((*cells, Value(100 * one.folded, f"{100 * one.folded:.0f}")))
        lines.append(
            text(
                "Under {force} N, swept up: largest response {amplitude} {unit} ({band}) at {f} Hz.",
                **dict(zip(("force", "amplitude", "band", "f"), cells[:4], strict=True)),
                unit=of.unit,
            )
        )
    columns = (
        text("Force [N]"),
        text("Peak, swept up [{unit}]", unit=of.unit),
        text("95 % band"),
        text("at f [Hz]"),
        text("Peak, swept down [{unit}]", unit=of.unit),
        text("95 % band"),
        text("at f [Hz]"),
        text("Folded [%]"),
    )
    caption = text(
        "Largest median response to each force, with the band at its frequency, which is not that of the resonance. "
        "Last: the share of the draws with several stable responses at a frequency."
    )
    return lines, book.table("peaks", caption, columns, rows)


def _response(one: ForcedResponse, book: Book) -> Table:
    """A response over the frequency, for the file beside the report."""
    force = f"{float(one.force[0]):.4g}"
    rows = [tuple(cell if isinstance(cell, int) else plain(cell, 6) for cell in row) for row in response_rows(one)]
    caption = text("Response to {force} N over the frequency, in SI units.", force=force)
    return book.table(f"response_{force}_N", caption, RESPONSE_COLUMNS, rows, 0)


def _law_sentences(of: FromLevels) -> list[str]:
    """Which laws weigh most, and which of the parameters of the first are identifiable."""
    if not of.laws:
        return []
    equal = 1 / len(of.laws)
    named = [f"{word(name)} {_share(weight)} %" for name, weight in of.laws if weight > equal * (1 + _ALIKE)]
    lines = [
        text("Joint laws that weigh more than an equal share: {laws}.", laws=listed(named))
        if named
        else text("All joint laws weigh the same.")
    ]
    parameters = [one for each in of.at for one in each.parameters]
    if parameters:
        known = [f"{one.name} ({word(one.law)})" for one in parameters if one.identifiable]
        lines.append(
            text("Identifiable parameters: {names}.", names=listed(known))
            if known
            else text("No parameter of the law that weighs most is identifiable.")
        )
    return lines


def _share(weight: float) -> Value:
    """A weight in percent."""
    return Value(100 * weight, f"{100 * weight:.0f}")


def _laws(of: FromLevels, book: Book) -> list[Block]:
    """Weights of the laws, and the parameters of the one that weighs most."""
    if not of.laws:
        return []
    caption = text(
        "Joint laws whose mixture gives the bands, with their weights: by how well each predicts the highest levels "
        "from those below. With three levels or fewer all weigh the same. A weight is no probability that the law is "
        "true."
    )
    rows = [(word(name), _share(weight)) for name, weight in of.laws]
    blocks: list[Block] = [book.table("laws", caption, (text("Law"), text("Weight [%]")), rows)]
    parameters: list[tuple[Cell, ...]] = [
        (
            word(one.law),
            one.name,
            _meaning(one.name),
            *banded(one.low, one.value, one.high),
            text("yes") if one.identifiable else text("no"),
            "; ".join(word(reason) for reason in one.reason.split("; ")) if one.reason else "",
        )
        for each in of.at
        for one in each.parameters
    ]
    if parameters:
        columns = (
            text("Law"),
            text("Parameter"),
            text("Meaning"),
            text("Median"),
            text("95 % interval"),
            text("Identifiable"),
            text("Reason"),
        )
        caption = text("Parameters in which the law that weighs most is not linear.")
        blocks.append(book.table("law_parameters", caption, columns, parameters))
        blocks.append(
            Text(
                text(
                    "Identifiable: the 95 % interval, model-form discrepancy included, closes inside the prior, the "
                    "standard deviation is below a third of the prior's, and the estimates without the highest one and "
                    "two levels agree. That an identifiable parameter predicts does not follow."
                )
            )
        )
    return blocks


def _meaning(name: str) -> str:
    """What a parameter is; of a law with several springs, of which one."""
    bare, _, spring = name.partition(" of spring ")
    meaning = word(_PARAMETERS[bare]) if bare in _PARAMETERS else ""
    return text("{meaning}, spring {number}", meaning=meaning, number=spring) if spring else meaning


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
