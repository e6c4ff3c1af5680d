"""Maps of a mode over excitation and normal force, and statements of a publication beside them."""

from collections.abc import Sequence
from functools import partial
from itertools import groupby
from typing import get_args

import numpy as np

from ema import show
from ema.data import MapResult, Statement, StudyResult
from ema.data.results import Verdict
from ema.messages import mark, plural, text, word
from ema.report.blocks import Block, Book, Cell, Section, Text
from ema.report.numbers import MISSING, fixed, plain, rounded, short


def statements(result: StudyResult, book: Book) -> list[Section]:
    """Sentences of the publication, and apart from them our readings: quantity, bounds, value, interval and verdict."""
    sections = []
    quoted = [one for one in result.statements if one.quoted]
    readings = [one for one in result.statements if not one.quoted]
    throughout = _assumed_throughout(result.statements)
    said = [Text(text("Assumed throughout: {assumed}", assumed=throughout))] if throughout else []
    judged = (
        text("Quantity"),
        text("Holds for"),
        text("Measured"),
        text("95 % interval"),
        text("Verdict"),
        text("Reason"),
    )
    if quoted:
        caption = text(
            "Sentences of the publication, and whether these measurements bear them out. "
            "Intervals hold noise and what the grid of a map leaves open, and of a phase of a "
            "decay what its halves read; not what was assumed."
        )
        sentences = [
            (f"“{one.sentence}” ({one.source})", one.text, *_judged(one, throughout), one.reason) for one in quoted
        ]
        columns = (text("Sentence"), text("Judged as"), *judged, text("Reason in full"))
        block = book.table("statements", caption, columns, sentences, len(columns) - 1)
        sections.append(Section(text("The publication's statements"), "statements", [*said, block]))
    if readings:
        caption = text("Readings of ours: limits that the publication does not print.")
        own = [(one.source, one.text, *_judged(one, throughout), one.reason) for one in readings]
        columns = (text("Source"), text("Reading"), *judged, text("Reason in full"))
        block = book.table("readings", caption, columns, own, len(columns) - 1)
        sections.append(Section(text("Our readings"), "readings", [block] if quoted else [*said, block]))
    return sections


_OFTEN = 3
"""Statements that rest on one and the same assumption from which on it is said once, above them; below, beside each."""


def _assumed_throughout(judged: Sequence[Statement]) -> str:
    """The assumption that most matches rest on, as their reasons say it."""
    reasons = [one.reason for one in judged if one.verdict == "matched with an assumed parameter"]
    counts = {reason: sum(other.startswith(reason) for other in reasons) for reason in reasons if reason}
    most = max(counts, key=lambda reason: counts[reason], default="")
    return most if most and counts[most] >= _OFTEN else ""


_WORDS = (
    mark("matched"),
    mark("matched with an assumed parameter"),
    mark("matched with an implausible parameter"),
    mark("undecided"),
    mark("not matched"),
    mark("not testable here"),
    mark("damping"),
    mark("frequency"),
    mark("highest damping"),
    mark("ridge"),
    mark("peak level"),
    mark("rise of ridge"),
    mark("rise of damping"),
    mark("fall of damping"),
    mark("peak of damping"),
    mark("dip of frequency"),
    mark("ridge over that of map"),
    mark("spread over levels"),
    mark("ridge over sticking"),
    mark("damping over ridge"),
    mark("release deflection"),
    mark("release deflection over run"),
    mark("sliding frequency"),
    mark("sticking frequency"),
    mark("sticking damping"),
    mark("missing damping"),
    mark("difference of envelopes"),
    mark("difference of frequencies"),
    mark("largest slip"),
    mark("slip of first over last contact"),
    mark("dissipation of first over last contact"),
    mark("loop areas over energy lost"),
    mark("energy integral over release"),
    mark("run frequency"),
    mark("run damping"),
    mark("run misfit"),
    mark("run damping over run"),
    mark("run level effect"),
)
"""Verdicts and quantities of statements, as data say them."""
LEAST_SHOWN = 1e-3
"""Part of a value, the second digit of which is the last that a table of statements shows: publications print three
digits. An interval that is narrower is shown to the second digit of its half width, as in the table of modes."""


def _judged(one: Statement, throughout: str = "") -> tuple[Cell, ...]:
    """Quantity, bounds, value, interval, verdict and reason; of that not what is assumed ``throughout``."""
    reaches = [abs(bound - one.value) for bound in (one.lower, one.upper) if np.isfinite(bound)]
    width = one.upper - one.lower
    least = min(LEAST_SHOWN * abs(one.value), width / 2 if width > 0 else np.inf)
    half = max(min(reaches), least) if reaches else None
    ends = [str(rounded(bound, half, 4)) if np.isfinite(bound) else text("open") for bound in (one.lower, one.upper)]
    interval = MISSING if np.isnan(one.lower) else text("{low} to {high}", low=ends[0], high=ends[1])
    reason = one.reason
    if throughout and reason.startswith(throughout):
        reason = f"{text('As assumed throughout.')} {reason.removeprefix(throughout)}".strip()
    cells = (_bounds(one.low, one.high), rounded(one.value, half, 4), interval, word(one.verdict), reason or MISSING)
    return (_looked_at(one), *cells)


def _looked_at(one: Statement) -> str:
    """What was measured for a statement, where anything was."""
    kind, comma, where = one.quantity.partition(", ")
    return f"{word(kind)}{comma}{where}" or MISSING


def statement_lines(result: StudyResult) -> list[str]:
    """How many sentences of the publication, and how many readings of ours, got which verdict."""
    lines = []
    for quoted in (True, False):
        chosen = [one for one in result.statements if one.quoted is quoted]
        counts = {verdict: sum(one.verdict == verdict for one in chosen) for verdict in get_args(Verdict)}
        verdicts = ", ".join(f"{number} {word(verdict)}" for verdict, number in counts.items() if number)
        if chosen and quoted:
            lines.append(
                plural(
                    "{count} statement of the publication: {verdicts}.",
                    "{count} statements of the publication: {verdicts}.",
                    len(chosen),
                    verdicts=verdicts,
                )
            )
        elif chosen:
            lines.append(
                plural(
                    "{count} reading of ours: {verdicts}.",
                    "{count} readings of ours: {verdicts}.",
                    len(chosen),
                    verdicts=verdicts,
                )
            )
    return lines


def map_sections(result: StudyResult, book: Book) -> list[Section]:
    """Every map with its pictures, the homogeneity of its levels, and its table."""
    return [
        Section(text("Map of {name}", name=one.name), f"map-{number}", map_blocks(one, book))
        for number, one in enumerate(result.maps, 1)
    ]


def map_lines(result: StudyResult) -> list[str]:
    """The answer of every map in a sentence."""
    return [line for one in result.maps if (line := map_sentence(one))]


def map_sentence(one: MapResult) -> str:
    """The most damping of a map, and the best normal force over the excitation."""
    damping = np.asarray(one.chart.damping)
    if not np.isfinite(damping).any():
        return text("{name}: no mode was found in any condition.", name=one.name)
    row, column = np.unravel_index(int(np.nanargmax(damping)), damping.shape)
    known = np.isfinite(damping).any(axis=1)
    levels = [float(level) for level in np.asarray(one.chart.force_levels)[known]]
    forces = [float(one.chart.normal_forces[int(np.nanargmax(line))]) for line in damping[known]]
    best = []
    for force, group in groupby(zip(forces, levels, strict=True), key=lambda pair: pair[0]):
        own = [level for _, level in group]
        ends = {"force": short(force), "low": short(own[0]), "high": short(own[-1])}
        best.append(
            text("{force} N at {low} to {high} N", **ends) if len(own) > 1 else text("{force} N at {low} N", **ends)
        )
    return text(
        "{name}: most damping {damping} % at F_E {level} N and F_N {force} N; best normal "
        "force over the excitation: {best}.",
        name=one.name,
        damping=plain(100 * float(damping[row, column]), 3),
        level=short(one.chart.force_levels[row]),
        force=short(one.chart.normal_forces[column]),
        best=", ".join(best),
    )


def map_blocks(one: MapResult, book: Book) -> list[Block]:
    """The pictures of a map, whether its levels are one linear structure, and its table."""
    chart, name = one.chart, one.name
    sentence = map_sentence(one)
    blocks: list[Block] = [
        Text(sentence),
        book.picture(
            partial(show.damping_map, chart),
            f"{text('Damping of {name} over F_E and F_N.', name=name)} {sentence}",
            text("Damping ratio of {name} from steady states of the model; the line joins the best F_N.", name=name)
            if one.chart.method == "frozen"
            else text(
                "Damping ratio of {name} by the linear fit of each condition; the line joins the best F_N.", name=name
            ),
        ),
        book.picture(
            partial(show.frequency_map, chart),
            text("Natural frequency of {name} over F_E and F_N.", name=name),
            text("Natural frequency of {name}.", name=name),
        ),
        book.picture(
            partial(show.damping_curves, chart),
            text("Damping of {name} over the excitation at every normal force.", name=name),
            text(
                "Damping of {name} at every normal force: over the force at resonance (left) and over the modal "
                "amplitude (right), where different drivers agree.",
                name=name,
            )
            if chart.method == "frozen"
            else text(
                "Damping of {name} at every normal force, with 95 % bars of the fit: over the force "
                "at resonance (left) and over the modal amplitude (right), where different drivers "
                "agree. Dashed: by the height of the peak.",
                name=name,
            ),
        ),
    ]
    if len(one.homogeneity):
        rows: list[tuple[Cell, ...]] = [
            (plain(force, 4), plain(low, 3), plain(high, 3), fixed(index, 3), fixed(ratio, 3), _side(index, ratio))
            for (force, low, high), index, ratio in zip(one.pairs, one.homogeneity, one.peak_ratio, strict=True)
        ]
        columns = ("F_N [N]", "F_E [N]", text("F_E higher [N]"), text("Homogeneity"), text("Peak ratio"), text("Side"))
        caption = text(
            "Whether FRFs of {name} depend on the level (0: linear; above 0.05 nonlinear, above 0.3 no linear fit).",
            name=name,
        )
        blocks.append(book.table(f"homogeneity_{name}", caption, columns, rows))
    return [*blocks, _table(one, book)]


def _table(one: MapResult, book: Book) -> Block:
    chart = one.chart
    columns = [
        "F_E [N]",
        "F_N [N]",
        "f [Hz]",
        text("ζ fit [%]"),
        text("ζ height [%]"),
        text("Misfit"),
        text("F at resonance [N]"),
        text("Drop-out"),
        text("Amplitude [µm √kg]"),
        "std f [Hz]",
        "std ζ [%]",
        *(f"F_N {joint} [N]" for joint in chart.joints),
    ]
    rows: list[list[Cell]] = []
    for i, level in enumerate(chart.force_levels):
        for j, force in enumerate(chart.normal_forces):
            rows.append(
                [
                    plain(float(level), 3),
                    plain(float(force), 4),
                    fixed(_at(chart.frequency, i, j), 2),
                    fixed(100 * _at(chart.damping, i, j), 3),
                    fixed(100 * _at(chart.quadrature_damping, i, j), 3),
                    fixed(_at(chart.misfit, i, j), 3),
                    fixed(_at(chart.force_at_resonance, i, j), 2),
                    fixed(_at(one.dropout, i, j), 2),
                    plain(1e6 * _at(chart.modal_amplitude, i, j), 3),
                    plain(_at(chart.frequency_std, i, j), 2),
                    plain(100 * _at(chart.damping_std, i, j), 2),
                    *(
                        plain(float(chart.joint_forces[i, j, k]), 4)
                        for k in range(len(chart.joints))
                        if chart.joint_forces is not None
                    ),
                ]
            )
    if chart.method == "frozen":
        # nothing was fitted
        of_model = [0, 1, 2, 3, 6, 8]
        columns = [text("ζ [%]") if place == 3 else columns[place] for place in of_model]
        rows = [[row[place] for place in of_model] for row in rows]
        caption = text("Every condition of {name}: frequency, damping from steady states of the model.", name=one.name)
        return book.table(f"map_{one.name}", caption, columns, rows)
    caption = text(
        "Every condition of {name}: frequency, damping by the fit and by the height of the peak.", name=one.name
    )
    return book.table(f"map_{one.name}", caption, columns, rows, 9)


def _at(values: "np.ndarray | None", i: int, j: int) -> float:
    return float("nan") if values is None else float(values[i, j])


def _side(index: float, ratio: float) -> str:
    if index <= 0.05:
        return text("linear")
    if abs(ratio - 1) < 0.02:
        return text("about the most damping")
    return text("slips: press more") if ratio > 1 else text("sticks: press less")


def _bounds(low: float, high: float) -> Cell:
    """With which values a statement holds."""
    if not np.isfinite(low) and not np.isfinite(high):
        return MISSING
    if not np.isfinite(low):
        return text("up to {high}", high=short(high))
    if not np.isfinite(high):
        return text("{low} or more", low=short(low))
    return short(low) if low == high else text("{low} to {high}", low=short(low), high=short(high))
