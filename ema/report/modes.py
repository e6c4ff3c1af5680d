"""The table of modes of a run, and its condition in words."""

from functools import reduce

import numpy as np

from ema.data import ModalModel, RunResult
from ema.data.modal import COVERAGE_FACTOR
from ema.messages import mark, plural, text, word
from ema.messages.lists import listed
from ema.report.blocks import Block, Book, Cell, Text
from ema.report.numbers import MISSING, Value, fixed, plain, short, with_uncertainty
from ema.shapes import quality

_WORDS = (
    mark("coherence of the FRFs, scaled to the residuals"),
    mark("variance of the FRFs, scaled to the residuals"),
    mark("scatter of the residuals over the lines"),
    mark("scatter of the residuals over the lines, which is beyond the coherence of the FRFs"),
    mark("scatter of the residuals over the lines, which is beyond the variance of the FRFs"),
    mark("scatter of the residuals over the lines, for the coherence of the FRFs contains tones"),
    mark("scatter of the residuals over the lines, for the variance of the FRFs contains tones"),
    mark("with a single average the coherence is 1 and says nothing"),
    mark("with the scatter between the set-ups"),
    mark("with what the shape of the residual amounts to"),
    mark("with what the correction of broadened peaks leaves open"),
    mark("noise that the FRFs share"),
    mark("scatter between the FRFs"),
    mark("scatter between the averages"),
)
"""What intervals rest on, as data say it."""


def standard_deviations(modes: ModalModel) -> tuple[list[float | None], list[float | None]]:
    """Of natural frequency in Hz and of damping in percent; ``None`` where unknown."""
    if modes.covariance is None:
        nothing: list[float | None] = [None] * len(modes.poles)
        return nothing, nothing
    frequency, damping = (np.sqrt(np.maximum(modes.covariance[:, k, k], 0)) for k in (0, 1))
    return [float(x) for x in frequency], [100 * float(x) for x in damping]


def interval(value: float, deviation: float | None, digits: int) -> Value:
    """The value with its 95 % interval."""
    return with_uncertainty(value, None if deviation is None else COVERAGE_FACTOR * deviation, digits)


def joint_force(mean: float, std: float) -> Value:
    """Normal force in N, rounded by its scatter over the run."""
    value = with_uncertainty(mean, std, 4)
    return Value(value.value, text("unknown")) if value.text == MISSING else value


def condition_text(run: RunResult) -> str:
    """The normal force of a run in words."""
    joints = run.run.condition.joints
    if not joints:
        return text("no friction beam")
    known = [joint.mean for joint in joints if joint.known]
    if len(known) < len(joints):
        return plural(
            "normal force unknown in {unknown} of {count} joint",
            "normal force unknown in {unknown} of {count} joints",
            len(joints),
            unknown=len(joints) - len(known),
        )
    return plural(
        "mean normal force {force} N over {count} joint",
        "mean normal force {force} N over {count} joints",
        len(joints),
        force=plain(float(np.mean(known)), 3),
    )


def run_sentence(run: RunResult) -> str:
    """One line: how many modes, where, under which condition, how damped."""
    frequencies, damping = run.modes.natural_frequencies, 100 * run.modes.damping_ratios
    if len(frequencies):
        low, high = str(plain(damping.min(), 2)), str(plain(damping.max(), 2))
        identified = plural(
            "{count} mode at {f_low} Hz, damping {damping} %",
            "{count} modes from {f_low} to {f_high} Hz, damping {damping} %",
            len(frequencies),
            f_low=short(frequencies.min()),
            f_high=short(frequencies.max()),
            damping=low if low == high else text("{low} to {high}", low=low, high=high),
        )
    else:
        identified = plural("{count} mode", "{count} modes", 0)
    return text(
        "Run {run} ({condition}): {identified}{level}.",
        run=run.run.id,
        condition=condition_text(run),
        identified=identified,
        level=_level_text(run),
    )


def _level_text(run: RunResult) -> str:
    """What the test says about linearity, as the end of a sentence; empty where it was not asked."""
    codes = {finding.code for finding in run.findings}
    if "slip-then-ring" in codes:
        if len(run.modes.poles):
            statement = text(
                "the structure is not linear at this level of impacts, the modes are those of the decay after the "
                "joint sticks again"
            )
        else:
            statement = text("the structure is not linear at this level of impacts, the modes are withheld")
        return f"; {statement}{_equivalent_text(run)}"
    if codes & {"nonlinear-distortion", "amplitude-dependence", "not-homogeneous"}:
        return "; " + text("the structure is not linear at this level")
    if "leaning-peak" in codes:
        return "; " + text(
            "a resonance peak leans, as where frequency or damping depends on the amplitude: repeat at half the level"
        )
    if "linearity-doubtful" in codes:
        return "; " + text("it is probably not linear at this level of impacts: repeat at half the level")
    if "linearity-not-testable" in codes:
        return "; " + text("whether it is linear is not testable: repeat at half the level")
    if "level-tested" not in codes:
        return ""
    if run.run.kind == "hammer":
        return "; " + text("no sign of a nonlinear structure between its impacts")
    return "; " + text("no sign of a nonlinear structure at its levels")


def _equivalent_text(run: RunResult) -> str:
    """What a linear fit reads at the level of the test, in the first sentence about a run that is not linear."""
    if not run.equivalent:
        return ""
    values = [
        text(
            "{frequency} Hz with {damping} %",
            frequency=f"{one.natural_frequency:.1f}",
            damping=plain(100 * one.damping_ratio, 2),
        )
        for one in run.equivalent
    ]
    return ". " + text(
        "One linear mode fitted to the FRFs about each of them reads {values}{impacts}",
        values=listed(values),
        impacts=_impacts_text(run),
    )


def _impacts_text(run: RunResult) -> str:
    effect = run.level_effect
    if effect is None:
        return ""
    ends = {"low": short(round(effect.weakest)), "high": short(round(effect.strongest))}
    return " " + text("at impacts of {low} to {high} N", **ends)


def equivalent_table(run: RunResult, book: Book) -> Block | None:
    """What one linear mode fitted to the FRFs about every mode reads; ``None`` where the structure is linear."""
    if not run.equivalent:
        return None
    rows: list[list[Cell]] = [
        [
            interval(one.natural_frequency, one.natural_frequency_std, 6),
            interval(100 * one.damping_ratio, 100 * one.damping_ratio_std, 3),
            fixed(one.residual, 3),
            text("{low} to {high}", low=short(one.band[0]), high=short(one.band[1])),
        ]
        for one in run.equivalent
    ]
    caption = text(
        "One linear mode fitted to the FRFs of run {run} about every mode{impacts}: values "
        "at this level, not those of a linear structure. Misfit is what the mode leaves "
        "unexplained.",
        run=run.run.id,
        impacts=_impacts_text(run),
    )
    return book.table(
        f"equivalent_{run.run.id}", caption, ["f [Hz]", "ζ [%]", text("Misfit [-]"), text("Lines [Hz]")], rows
    )


def mode_table(run: RunResult, book: Book) -> Block:
    """The modes of a run: f, zeta, MPC, MPD, confidence and normal forces."""
    modes, joints, name = run.modes, run.run.condition.joints, run.run.id
    if not len(modes.poles):
        return Text(
            text(
                "Run {run}: no mode was found, so there are no modal parameters to show.",
                run=name,
            ),
            missing=True,
        )
    measures = quality(modes.shapes) if run.quality is None else run.quality
    std_f, std_zeta = standard_deviations(modes)
    sure = modes.confidence
    columns = [text("Mode"), "f [Hz]", "ζ [%]", "MPC [-]", "MPD [°]"] + (
        [] if sure is None else [text("Confidence [-]")]
    )
    columns += [f"F_N {joint.joint} [N]" for joint in joints]
    shown = len(columns)
    rows: list[list[Cell]] = []
    for mode, (frequency, damping) in enumerate(zip(modes.natural_frequencies, 100 * modes.damping_ratios)):
        row: list[Cell] = [mode + 1, interval(frequency, std_f[mode], 6), interval(damping, std_zeta[mode], 3)]
        row.append(fixed(float(measures.modal_phase_collinearity[mode]), 3))
        row.append(fixed(float(measures.mean_phase_deviation[mode]), 1))
        row += [] if sure is None else [fixed(float(sure[mode]), 2)]
        row += [joint_force(joint.mean, joint.std) for joint in joints]
        row += [plain(std_f[mode], 2), plain(std_zeta[mode], 2)]
        rows.append(row)
    note = text("no uncertainty was estimated")
    if modes.covariance is not None:
        basis = modes.uncertainty.basis if modes.uncertainty is not None else ""
        note = text(
            "± is two standard deviations within this run, from {basis}",
            basis=_in_words(basis) if basis else text("noise only"),
        )
    if any(finding.code == "slip-then-ring" for finding in run.findings):
        note = text(
            "of the decay after sticking, for small amplitudes; ± is two standard deviations, from noise and from when "
            "the decay begins. MPC and MPD belong to the decay over the force of the impact, whose phase the slip "
            "before it shifts from point to point: low values are no sign of a complex mode"
        )
    caption = text("Modes of run {run} ({note}).", run=name, note=note)
    return book.table(f"modes_{name}", caption, [*columns, "std f [Hz]", "std ζ [%]"], rows, shown)


def _in_words(basis: str) -> str:
    """What intervals rest on, in the reader's language: parts between semicolons, of which one names causes."""
    parts = []
    for part in basis.split("; "):
        causes = part.removeprefix("of some poles, ").removesuffix(", which is beyond that")
        if len(causes) < len(part):
            names = reduce(lambda first, last: text("{first} and {last}", first=first, last=last), _causes(causes))
            parts.append(text("of some poles, {causes}, which is beyond that", causes=names))
        else:
            parts.append(word(part))
    return "; ".join(parts)


def _causes(joined: str) -> list[str]:
    return [word(cause) for cause in joined.split(" and ")]


def set_up_table(run: RunResult, book: Book) -> Block | None:
    """Natural frequencies of the set-ups of a run against their mean; ``None`` where there was one set-up."""
    set_ups = run.modes.set_ups
    if set_ups is None:
        return None
    loaded = set_ups.cause == "mass loading"
    columns = [text("Mode"), text("Mean f [Hz]"), *(text("Set-up {name} [%]", name=name) for name in set_ups.names)]
    columns += [text("f without sensors [Hz]")] if loaded else []
    rows: list[list[Cell]] = []
    for mode, frequency in enumerate(set_ups.frequencies):
        row: list[Cell] = [mode + 1, fixed(float(frequency), 3)]
        row += [
            _percent(float(one), float(std))
            for one, std in zip(set_ups.shifts[:, mode], set_ups.std[:, mode], strict=True)
        ]
        row += [interval(float(set_ups.unloaded[mode]), float(set_ups.unloaded_std[mode]), 6)] if loaded else []
        rows.append(row)
    everything: list[Cell] = [text("all"), ""]
    everything += [
        _percent(float(one), float(std)) for one, std in zip(set_ups.common, set_ups.common_std, strict=True)
    ]
    rows.append([*everything, *([""] if loaded else [])])
    causes = {
        "none": text("noise explains the differences"),
        "common shift": text("one shift for all modes of a set-up explains the differences"),
        "mass loading": text(
            "sensors of {mass} g each explain the differences",
            mass=interval(1000.0 * set_ups.mass, 1000.0 * set_ups.mass_std, 4).text,
        ),
        "unknown": text("neither a common shift nor the mass of the sensors explains the differences"),
    }
    caption = text(
        "Natural frequencies of the set-ups of run {run}, relative to their mean (± is two "
        "standard deviations; {cause}).",
        run=run.run.id,
        cause=causes[set_ups.cause],
    )
    return book.table(f"set_ups_{run.run.id}", caption, columns, rows, len(columns))


def _percent(value: float, std: float) -> Cell:
    """A relative shift in percent with its sign and interval; empty where the set-up does not show the mode."""
    if np.isnan(value):
        return ""
    cell = interval(100 * value, 100 * std, 4)
    return Value(cell.value, "+" + cell.text if value > 0 else cell.text)
