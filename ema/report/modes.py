"""The table of modes of a run, and its condition in words."""

import numpy as np

from ema.data import ModalModel, RunResult
from ema.report.blocks import Block, Book, Cell, Text
from ema.report.numbers import MISSING, Value, count, fixed, listed, plain, short, with_uncertainty
from ema.shapes import quality

COVERAGE = 2.0
"""Intervals are given as plus or minus this many standard deviations (95 % of a normal distribution)."""


def standard_deviations(modes: ModalModel) -> tuple[list[float | None], list[float | None]]:
    """Of natural frequency in Hz and of damping in percent; ``None`` where unknown."""
    if modes.covariance is None:
        nothing: list[float | None] = [None] * len(modes.poles)
        return nothing, nothing
    frequency, damping = (np.sqrt(np.maximum(modes.covariance[:, k, k], 0)) for k in (0, 1))
    return [float(x) for x in frequency], [100 * float(x) for x in damping]


def interval(value: float, deviation: float | None, digits: int) -> Value:
    """The value with its interval of two standard deviations."""
    return with_uncertainty(value, None if deviation is None else COVERAGE * deviation, digits)


def joint_force(mean: float, std: float) -> Value:
    """Normal force in N, rounded by its scatter over the run."""
    value = with_uncertainty(mean, std, 4)
    return Value(value.value, "unknown") if value.text == MISSING else value


def condition_text(run: RunResult) -> str:
    """The normal force of a run in words."""
    joints = run.run.condition.joints
    if not joints:
        return "no friction beam"
    known = [joint.mean for joint in joints if joint.known]
    if len(known) < len(joints):
        return f"normal force unknown in {len(joints) - len(known)} of {count(len(joints), 'joint')}"
    return f"mean normal force {plain(float(np.mean(known)), 3)} N over {count(len(joints), 'joint')}"


def run_sentence(run: RunResult) -> str:
    """One line: how many modes, where, under which condition, how damped."""
    frequencies, damping = run.modes.natural_frequencies, 100 * run.modes.damping_ratios
    identified = count(len(frequencies), "mode")
    if len(frequencies) == 1:
        identified += f" at {short(frequencies[0])} Hz, damping {plain(damping[0], 2)} %"
    elif len(frequencies):
        low, high = str(plain(damping.min(), 2)), str(plain(damping.max(), 2))
        identified += f" from {short(frequencies.min())} to {short(frequencies.max())} Hz, damping "
        identified += f"{low} %" if low == high else f"{low} to {high} %"
    return f"Run {run.run.id} ({condition_text(run)}): {identified}{_level_text(run)}."


def _level_text(run: RunResult) -> str:
    """What the test says about linearity, as the end of a sentence; empty where it was not asked."""
    codes = {finding.code for finding in run.findings}
    if "slip-then-ring" in codes:
        kept = "those of the decay after the joint sticks again" if len(run.modes.poles) else "withheld"
        return f"; the structure is not linear at this level of impacts, the modes are {kept}{_equivalent_text(run)}"
    if codes & {"nonlinear-distortion", "amplitude-dependence", "not-homogeneous"}:
        return "; the structure is not linear at this level"
    if "leaning-peak" in codes:
        return "; a peak leans, as where a mode follows its amplitude: repeat at half the level"
    if "linearity-not-testable" in codes:
        return "; whether it is linear is not testable: repeat at half the level"
    return "; no sign of a nonlinear structure at its levels" if "level-tested" in codes else ""


def _equivalent_text(run: RunResult) -> str:
    """What a linear fit reads at the level of the test, in the first sentence about a run that is not linear."""
    if not run.equivalent:
        return ""
    values = [f"{one.natural_frequency:.1f} Hz with {plain(100 * one.damping_ratio, 2)} %" for one in run.equivalent]
    return f". One linear mode fitted to the FRFs about each of them reads {listed(values)}{_impacts_text(run)}"


def _impacts_text(run: RunResult) -> str:
    effect = run.level_effect
    return (
        "" if effect is None else f" at impacts of {short(round(effect.weakest))} to {short(round(effect.strongest))} N"
    )


def equivalent_table(run: RunResult, book: Book) -> Block | None:
    """What one linear mode fitted to the FRFs about every mode reads; ``None`` where the structure is linear."""
    if not run.equivalent:
        return None
    rows: list[list[Cell]] = [
        [
            interval(one.natural_frequency, one.natural_frequency_std, 6),
            interval(100 * one.damping_ratio, 100 * one.damping_ratio_std, 3),
            fixed(one.residual, 3),
            f"{short(one.band[0])} to {short(one.band[1])}",
        ]
        for one in run.equivalent
    ]
    caption = (
        f"One linear mode fitted to the FRFs of run {run.run.id} about every mode{_impacts_text(run)}: values at this "
        "level, not those of a linear structure. Misfit is what the mode leaves unexplained."
    )
    return book.table(f"equivalent_{run.run.id}", caption, ["f [Hz]", "ζ [%]", "Misfit [-]", "Lines [Hz]"], rows)


def mode_table(run: RunResult, book: Book) -> Block:
    """The modes of a run: f, zeta, MPC, MPD, confidence and normal forces."""
    modes, joints, name = run.modes, run.run.condition.joints, run.run.id
    if not len(modes.poles):
        return Text(f"Run {name}: no mode was found, so there are no modal parameters to show.", missing=True)
    measures = quality(modes.shapes) if run.quality is None else run.quality
    std_f, std_zeta = standard_deviations(modes)
    sure = modes.confidence
    columns = ["Mode", "f [Hz]", "ζ [%]", "MPC [-]", "MPD [°]"] + ([] if sure is None else ["Confidence [-]"])
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
    note = "no uncertainty was estimated"
    if modes.covariance is not None:
        basis = modes.uncertainty.basis if modes.uncertainty is not None else ""
        note = f"± is two standard deviations within this run, from {basis or 'noise only'}"
    if any(finding.code == "slip-then-ring" for finding in run.findings):
        note = (
            "of the decay after sticking, for small amplitudes; ± is two standard deviations, from noise and from when "
        )
        note += (
            "the decay begins. MPC and MPD belong to the decay over the force of the impact, whose phase the slip "
            "before it shifts from point to point: low values are no sign of a complex mode"
        )
    caption = f"Modes of run {name} ({note})."
    return book.table(f"modes_{name}", caption, [*columns, "std f [Hz]", "std ζ [%]"], rows, shown)


def set_up_table(run: RunResult, book: Book) -> Block | None:
    """Natural frequencies of the set-ups of a run against their mean; ``None`` where there was one set-up."""
    set_ups = run.modes.set_ups
    if set_ups is None:
        return None
    loaded = set_ups.cause == "mass loading"
    columns = ["Mode", "Mean f [Hz]", *(f"Set-up {name} [%]" for name in set_ups.names)]
    columns += ["f without sensors [Hz]"] if loaded else []
    rows: list[list[Cell]] = []
    for mode, frequency in enumerate(set_ups.frequencies):
        row: list[Cell] = [mode + 1, fixed(float(frequency), 3)]
        row += [
            _percent(float(one), float(std))
            for one, std in zip(set_ups.shifts[:, mode], set_ups.std[:, mode], strict=True)
        ]
        row += [interval(float(set_ups.unloaded[mode]), float(set_ups.unloaded_std[mode]), 6)] if loaded else []
        rows.append(row)
    everything: list[Cell] = ["all", ""]
    everything += [
        _percent(float(one), float(std)) for one, std in zip(set_ups.common, set_ups.common_std, strict=True)
    ]
    rows.append([*everything, *([""] if loaded else [])])
    causes = {
        "none": "noise explains the differences",
        "common shift": "one shift for all modes of a set-up explains the differences",
        "mass loading": f"sensors of {interval(1e3 * set_ups.mass, 1e3 * set_ups.mass_std, 4).text} g each explain the "
        "differences",
        "unknown": "neither a common shift nor the mass of the sensors explains the differences",
    }
    caption = (
        f"Natural frequencies of the set-ups of run {run.run.id}, relative to their mean (± is two standard "
        f"deviations; {causes[set_ups.cause]})."
    )
    return book.table(f"set_ups_{run.run.id}", caption, columns, rows, len(columns))


def _percent(value: float, std: float) -> Cell:
    """A relative shift in percent with its sign and interval; empty where the set-up does not show the mode."""
    if np.isnan(value):
        return ""
    cell = interval(100 * value, 100 * std, 4)
    return Value(cell.value, "+" + cell.text if value > 0 else cell.text)
