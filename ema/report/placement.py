"""Where the beam goes, in a report: the answer, the map, the ranking, FRFs before and after, a controlled force."""

from dataclasses import replace
from functools import partial

import numpy as np

from ema import show
from ema.data import ForecastCheck, FrfSet, ModalModel, poles_from
from ema.data.placement import Place, Placement
from ema.dof import Dof
from ema.messages import mark, text, word
from ema.messages.lists import listed
from ema.place.beams_choice import chosen_candidates
from ema.place.objective import IN_DECIBELS
from ema.report.blocks import Block, Book, Cell, Section, Text
from ema.report.forecast import forecast_blocks
from ema.report.least_damping import least_damping
from ema.report.numbers import fixed, plain, short
from ema.report.trials import proposal, trial_blocks
from ema.show.placement import score_unit
from ema.synthesis import frfs as synthesised
from ema.units import FRF_UNIT

_WORDS = (
    mark("law"),
    mark("constant"),
    mark("scheduled with the amplitude"),
    mark("released at turning points"),
    mark("damping, least over the force levels"),
    mark("damping, mean over the force levels"),
    mark("least damping, least over the force levels"),
    mark("least damping, mean over the force levels"),
    mark("geometric mean, least over the force levels"),
    mark("geometric mean, mean over the force levels"),
    mark("peak reduction, least over the force levels"),
    mark("peak reduction, mean over the force levels"),
    mark("chatter, least over the force levels"),
    mark("chatter, mean over the force levels"),
)
"""Heads and rows of the table of controlled forces, and objectives of all modes alike, as data say them."""
_NO_GAIN = {
    "damping": mark("No place raises the damping of {modes}:"),
    "mean damping": mark("No place raises the mean damping of {modes}:"),
    "least damping": mark("No place raises the least damping of {modes}:"),
    "geometric mean": mark("No place raises the geometric mean of the damping of {modes}:"),
    "peak reduction": mark("No place lowers the highest peak of {modes}:"),
    "chatter": mark("No place raises the most negative real part of {modes}:"),
}
"""What a placement says first whose best place is not better than the bare structure, by its aim."""
_LINES = 4000
"""Frequencies of a drawn FRF."""
_BESIDE = 0.12
"""How far the predicted FRFs reach beyond the modes, relative."""


def answers(placement: Placement) -> list[str]:
    """For the front page: how far to trust it, the place with its normal force, what a controlled one would add."""
    sentences = [placement.warning] if placement.warning else []
    sentences.append(answer(placement))
    of_beams = ("several-beams", "beams-forecast")
    sentences += [one.in_words().message for one in placement.findings if one.code in of_beams]
    if placement.trials is not None:
        sentences.append(proposal(placement.trials))
    return [*sentences, *([placement.control.verdict] if placement.control is not None else [])]


def place_blocks(placement: Placement, book: Book) -> list[Block]:
    """The recommended place on the geometry, the best places as a table, and the numbers of the answer."""
    ranking, best = placement.ranking, placement.ranking.best
    where = text(
        "at ({x}, {y}) m with F_N {force} N in every joint",
        x=f"{best.centre[0]:.3f}",
        y=f"{best.centre[1]:.3f}",
        force=f"{best.normal_force:.3g}",
    )
    together = chosen_candidates(placement)
    lettered = text(" Squares and letters: the beams that act together.") if together is not None else ""
    return [
        book.picture(
            partial(show.placement_map, placement, together=together),
            text(
                "Map of {number} places of the beam on the structure; the best is {where}.",
                number=len(ranking.scores),
                where=where,
            ),
            text(
                "{number} places by the one-mode predictor ({objective}); numbers: ranks with all "
                "modes together; hatched: kept free. Recommended: {where}.",
                number=len(ranking.scores),
                objective=word(ranking.objective),
                where=where,
            )
            + lettered,
        ),
        _table(placement, book),
        *_answered(placement, book),
    ]


def placement_sections(placement: Placement, book: Book, check: ForecastCheck | None = None) -> list[Section]:
    """Forecast, normal force, FRFs and control behind the answer; with ``check``, the comparison with measured maps."""
    sections = []
    # first of all, for pictures and tables are numbered as they come
    if placement.forecast is not None:
        blocks = forecast_blocks(placement.forecast if check is None else check, book)
        sections.append(Section(text("Forecast for the best place"), "forecast", blocks))
    if placement.trials is not None:
        sections.append(Section(text("The next best test"), "trials", trial_blocks(placement.trials, book)))
    sections += [
        Section(text("Recommended normal force"), "placement-force", _force(placement, book)),
        Section(text("FRF before and after, predicted"), "placement-frf", _predicted(placement, book)),
    ]
    if placement.control is not None:
        sections.append(Section(text("A controlled normal force"), "control", _control(placement, book)))
    return sections


def _force(placement: Placement, book: Book) -> list[Block]:
    best, prediction = placement.best, placement.ranking.prediction
    columns = ["F_E [N]", text("Best F_N [N]")]
    for mode in prediction.modes:
        columns += [
            f"f{mode + 1} [Hz]",
            f"ζ{mode + 1} [%]",
            text("ζ{mode} low [%]", mode=mode + 1),
            text("ζ{mode} high [%]", mode=mode + 1),
        ]
    rows: list[list[Cell]] = []
    for level in np.argsort(prediction.force_levels):
        row: list[Cell] = [plain(float(prediction.force_levels[level]), 3), plain(float(best.normal_forces[level]), 3)]
        for m in range(len(prediction.modes)):
            row.append(plain(float(best.frequency[m, level]), 5))
            row += [plain(100 * float(one[m, level]), 3) for one in (best.damping, best.damping_low, best.damping_high)]
        rows.append(row)
    return [
        book.picture(
            partial(show.recommended_force, placement),
            text("Recommended normal force over excitation force, and damping."),
            text("Recommended normal force of every joint at the best place, and the damping it brings."),
        ),
        book.table(
            "recommended_force",
            text(
                "The best place over the excitation: the normal force that is best at each level; "
                "frequency and damping with its 95 % interval under {force} N at all levels.",
                force=f"{best.normal_force:.3g}",
            ),
            columns,
            rows,
        ),
    ]


def _predicted(placement: Placement, book: Book) -> list[Block]:
    """FRFs of the target modes without the beam, and with it at the lowest and at the highest level."""
    best, prediction = placement.best, placement.ranking.prediction
    levels = np.asarray(prediction.force_levels)
    ends = list(dict.fromkeys([int(np.argmin(levels)), int(np.argmax(levels))]))
    states = [(text("bare"), np.asarray(prediction.bare_frequencies), np.asarray(prediction.bare_damping))]
    states += [
        (text("with beam, F_E {level} N", level=f"{levels[k]:g}"), best.frequency[:, k], best.damping[:, k])
        for k in ends
    ]
    states = [state for state in states if np.isfinite([*state[1], *state[2]]).all()]
    reached = np.concatenate([state[1] for state in states])
    lines = np.linspace((1 - _BESIDE) * reached.min(), (1 + _BESIDE) * reached.max(), _LINES)
    sets = [_of_modes(placement, state[1], state[2], lines) for state in states]
    names = [state[0] for state in states]
    return [
        book.picture(
            partial(show.frf_overlay, sets, [(0, 0)] * len(sets), names),
            text("Predicted FRF from the excited point to the observed one: {names}.", names=", ".join(names)),
            text(
                "FRF from the excited point to the observed one, of the target modes alone: {names}; "
                "F_N {force} N. Shapes are taken as those of the bare structure.",
                names=", ".join(names),
                force=f"{best.normal_force:.3g}",
            ),
        )
    ]


def _of_modes(placement: Placement, frequencies: np.ndarray, damping: np.ndarray, lines: np.ndarray) -> FrfSet:
    prediction = placement.ranking.prediction
    poles = poles_from(np.asarray(frequencies), np.asarray(damping))
    excited, observed = Dof(1, "+Z"), Dof(2, "+Z")
    shapes = np.stack([prediction.driver, prediction.output]).astype(complex)
    model = ModalModel(poles, shapes, (excited, observed), shapes[:1] / (2j * poles.imag), (excited,))
    frfs = synthesised(model, lines, "receptance", outputs=[observed], inputs=[excited])
    return replace(frfs, unit=FRF_UNIT["receptance"])


def _control(placement: Placement, book: Book) -> list[Block]:
    study = placement.control
    assert study is not None
    frame = study.table().reset_index()
    rows: list[list[Cell]] = [
        [word(str(row[0])), *(plain(float(value), 4) for value in row[1:])] for row in frame.itertuples(index=False)
    ]
    levels = [
        (plain(float(level), 3), plain(100 * float(one), 3), plain(100 * float(each), 3))
        for level, one, each in zip(study.force_levels, study.constant_damping, study.scheduled_damping, strict=True)
    ]
    return [
        Text(study.verdict),
        book.picture(
            partial(show.control_gain, study),
            text("Energy over time after a release under constant and controlled force."),
            text(
                "Left: release from {load} N at the excited point. Right: steady vibration over the "
                "excitation force, one normal force for all levels or one for each.",
                load=short(study.load),
            ),
        ),
        book.table(
            "control",
            text(
                "Ring-downs: J is the integral of the energy over that at the start; t to stay below "
                "5 % and 2 % of the amplitude."
            ),
            tuple(word(str(name)) for name in frame.columns),
            rows,
        ),
        book.table(
            "control_steady",
            text(
                "Steady vibration: least damping of the modes under one normal force for all levels, "
                "and under one for each."
            ),
            ("F_E [N]", text("ζ, one for all [%]"), text("ζ, one for each [%]")),
            levels,
        ),
    ]


def answer(placement: Placement) -> str:
    """The best place in words."""
    ranking, best = placement.ranking, placement.best
    joints = ranking.prediction.candidates.joints(best.candidate)
    spots = listed([f"({x:.3f}, {y:.3f}) m" for x, y in joints])
    force = f"{best.normal_force:.3g}"
    if any(finding.code == "no-gain" for finding in ranking.findings):
        first = text(
            "the best is {beam} at {spots} with {force} N in every joint.", beam=best.beam, spots=spots, force=force
        )
        sentences = [_no_gain(placement), first]
    else:
        sentences = [
            text(
                "Bolt {beam} at {spots} and press every joint with {force} N.", beam=best.beam, spots=spots, force=force
            )
        ]
    for m, mode in enumerate(ranking.prediction.modes):
        least = least_damping(best, m)
        bounds = f" [{100 * least.low:.2f}, {100 * least.high:.2f}] %" if np.isfinite(least.low) else " %"
        words = {
            "mode": mode + 1,
            "bare": f"{100 * ranking.prediction.bare_damping[m]:.2f}",
            "damping": f"{100 * least.value:.2f}",
            "bounds": bounds,
            "low": f"{ranking.prediction.force_levels.min():g}",
            "high": f"{ranking.prediction.force_levels.max():g}",
        }
        of_test = placement.forecast is not None and placement.forecast.method == "measured"
        if of_test and least.value != ranking.best.damping[m, least.level]:
            # what a linear fit of a friction peak reads is not the damping by power of the steady states
            gained = text(
                "Mode {mode}: {bare} -> at least {damping}{bounds} damping at {low} to {high} N as a linear fit of the "
                "test reads it ({steady} % by the power of steady states),",
                steady=f"{100 * np.nanmin(ranking.best.damping[m]):.2f}",
                **words,
            )
        else:
            gained = text("Mode {mode}: {bare} -> at least {damping}{bounds} damping at {low} to {high} N,", **words)
        sentences.append(gained + " " + _shifts(placement, m))
    return " ".join(sentences)


def _no_gain(placement: Placement) -> str:
    """That no place is better than the bare structure, up to a colon."""
    aim, modes = placement.ranking.objective.partition(", ")[0], placement.ranking.prediction.modes
    if aim not in IN_DECIBELS and len(modes) == 1:
        aim = "damping"
    elif aim == "damping":
        aim = "mean damping"
    return text(_NO_GAIN[aim], modes=listed([text("mode {mode}", mode=mode + 1) for mode in modes]))


def _parts(placement: Placement, m: int) -> list[float]:
    """Frequencies in Hz without and with the beam, and the parts of the shift by mass, by sticking joints and the rest,
    whose printed digits add up.

    The parts by mass and by sticking joints are of first order in the bare mode; the rest is what remains.
    """
    best, row = placement.best, least_damping(placement.best, m).level
    bare = float(placement.ranking.prediction.bare_frequencies[m])
    values = (bare, float(best.frequency[m, row]), float(best.mass_shift[m]), float(best.stiffness_shift[m]))
    before, after, by_mass, by_joints = (round(value, 1) for value in values)
    return [before, after, by_mass, by_joints, after - before - by_mass - by_joints]


def _shifts(placement: Placement, m: int) -> str:
    """The shift of a mode and its parts, in words."""
    before, after, by_mass, by_joints, rest = _parts(placement, m)
    return text(
        "{before} -> {after} Hz (mass {by_mass} Hz, sticking joints {by_joints} Hz, sliding, "
        "other modes and higher order {rest} Hz).",
        before=f"{before:.1f}",
        after=f"{after:.1f}",
        by_mass=f"{by_mass:+.1f}",
        by_joints=f"{by_joints:+.1f}",
        rest=f"{rest:+.1f}",
    )


def _answered(placement: Placement, book: Book) -> list[Block]:
    """The numbers of the answer: where the joints are, and what each mode does."""
    ranking, best = placement.ranking, placement.best
    joints = ranking.prediction.candidates.joints(best.candidate)
    spots: list[list[Cell]] = [
        [number, fixed(float(x), 3), fixed(float(y), 3), plain(best.normal_force, 3)]
        for number, (x, y) in enumerate(joints, 1)
    ]
    rows: list[list[Cell]] = []
    for m, mode in enumerate(ranking.prediction.modes):
        least = least_damping(best, m)
        before, after, *parts = _parts(placement, m)
        damping = (float(ranking.prediction.bare_damping[m]), least.value, least.low, least.high)
        rows.append(
            [
                mode + 1,
                fixed(before, 1),
                *(fixed(part, 1) for part in parts),
                fixed(after, 1),
                *(fixed(100 * value, 2) for value in damping),
                fixed(100 * float(np.nanmin(ranking.best.damping[m])), 2),
            ]
        )
    columns = (
        text("Mode"),
        text("f bare [Hz]"),
        text("By mass [Hz]"),
        text("By sticking joints [Hz]"),
        text("Rest [Hz]"),
        text("f with the beam [Hz]"),
        text("ζ bare [%]"),
        text("Least ζ [%]"),
        text("low"),
        text("high"),
        text("Least ζ by power [%]"),
    )
    caption = text("The best place mode by mode: least damping over the levels, and the parts of the shift there.")
    return [
        book.table("joints", text("Joints of the best place."), (text("Joint"), "x [m]", "y [m]", "F_N [N]"), spots),
        book.table("answer", caption, columns, rows),
    ]


def _table(placement: Placement, book: Book) -> Block:
    scale, unit = score_unit(placement)
    rows = [_row(number, place, scale) for number, place in enumerate(placement.ranking.places, 1)]
    columns = [
        text("Rank"),
        "x [m]",
        "y [m]",
        text("Angle [deg]"),
        text("Beam"),
        text("Objective [{unit}]", unit=unit),
        "F_N [N]",
    ]
    for mode in placement.ranking.prediction.modes:
        columns += [f"ζ{mode + 1} [%]", text("95 % of ζ{mode} [%]", mode=mode + 1), f"f{mode + 1} [Hz]"]
    caption = text(
        "The best places: {objective}. Middle of the beam, normal force of every joint for "
        "all levels, least damping over the levels.",
        objective=word(placement.ranking.objective),
    )
    if placement.forecast is not None:
        caption += " " + text(
            "Values are those of the steady states by which places are compared; the forecast states what a test of "
            "the best one will read, with all stated uncertainties."
        )
    return book.table("places", caption, [*columns, text("Flags")], rows)


def _row(number: int, place: Place, scale: float) -> list[Cell]:
    cells: list[Cell] = [
        number,
        plain(place.centre[0], 3),
        plain(place.centre[1], 3),
        plain(float(np.degrees(place.angle)), 3),
        place.beam,
        plain(scale * place.score, 3),
        plain(place.normal_force, 3),
    ]
    for m in range(len(place.damping)):
        least = least_damping(place, m)
        cells += [
            plain(100 * least.value, 3),
            f"{100 * least.low:.2f} ... {100 * least.high:.2f}" if np.isfinite(least.low) else "–",
            plain(float(place.frequency[m, least.level]), 4),
        ]
    return [*cells, ", ".join(sorted({finding.code for finding in place.findings})) or text("none")]
