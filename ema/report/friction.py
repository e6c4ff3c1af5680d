"""Friction measured directly: ring-downs with their phases, and hysteresis loops."""

from collections.abc import Sequence
from functools import partial
from math import isfinite

import numpy as np

from ema import show
from ema.data import Decay, JointForce, Loop, Run
from ema.estimate import Phase, phases
from ema.messages import mark, plural, text, word
from ema.messages.recognition import in_words
from ema.report.blocks import Block, Book, Cell
from ema.report.modes import joint_force
from ema.report.numbers import MISSING, fixed, plain, short, with_uncertainty

_PHASES = (mark("one mode"), mark("sliding"), mark("sticking"))
"""Kinds of phases, as data say them."""
_TOGETHER = 6
"""Series that one picture can tell apart."""
_MOST_SENTENCES = 4
"""Ring-downs that the front page describes; the others are counted and stand in the table."""


def ring_down_sentences(decays: Sequence[Decay]) -> list[str]:
    """The answer of the first ring-downs: frequency and damping of each phase, and where the joint begins to stick."""
    sentences = [_sentence(decay, number) for number, decay in enumerate(decays[:_MOST_SENTENCES], 1)]
    more = len(decays) - len(sentences)
    if not more:
        return sentences
    rest = plural(
        "{count} more ring-down in the table of phases.", "{count} more ring-downs in the table of phases.", more
    )
    return [*sentences, rest]


def _named(decay: Decay, number: int) -> str:
    return decay.name or text("ring-down {number}", number=number)


def _sentence(decay: Decay, number: int) -> str:
    parts = [
        text(
            "{phase} {frequency} Hz with {damping} % damping",
            phase=word(phase.kind),
            frequency=short(float(f"{phase.frequency:.5g}")),
            damping=plain(100 * phase.damping, 3),
        )
        for phase in phases(decay)
    ]
    doubts = "".join(
        " " + text("Not one mode: {message}", message=in_words(finding).message)
        for finding in decay.findings
        if finding.severity != "info"
    )
    said = {"name": _named(decay, number), "phases": ", ".join(parts) or text("no phase of two cycles")}
    if not isfinite(decay.knee):
        return text("Ring-down of {name}: {phases}.", **said) + doubts
    knee = plain(decay.knee, 3)
    return text("Ring-down of {name}: {phases}; the joint begins to stick at {knee} s.", **said, knee=knee) + doubts


def ring_downs(decays: Sequence[Decay], book: Book, runs: Sequence[Run] = ()) -> list[Block]:
    """Report frequency and damping of ring-downs over the amplitude, with a table of the phases.

    Parameters
    ----------
    decays : sequence of Decay
        Ring-downs; a picture shows at most six.
    book : Book
        Numbers the pictures and tables.
    runs : sequence of Run, optional
        Runs of the campaign, whose normal forces stand beside their ring-downs.

    Returns
    -------
    list of Block
        Pictures, the table of phases, and the table of the curves.
    """
    blocks: list[Block] = []
    for start in range(0, len(decays), _TOGETHER):
        shown = decays[start : start + _TOGETHER]
        names = [_named(decay, number) for number, decay in enumerate(shown, start + 1)]
        blocks.append(
            book.picture(
                partial(show.ring_down, shown, names),
                text(
                    "Ring-down of {names}: amplitude over time, frequency and damping over amplitude.",
                    names=", ".join(names),
                ),
                text(
                    "Amplitude over time, and frequency and damping over the amplitude; what lies within "
                    "a period of the knee is left out."
                ),
            )
        )
    return [*blocks, _phase_table(decays, book, runs), _curve_table(decays, book)]


def _phase_table(decays: Sequence[Decay], book: Book, runs: Sequence[Run]) -> Block:
    """One row for each phase of each ring-down, with the normal forces of its run."""
    pressed = [_joints(decay, runs) for decay in decays]
    joints = list(dict.fromkeys(name for forces in pressed for name in forces))
    rows: list[tuple[Cell, ...]] = []
    for number, (decay, forces) in enumerate(zip(decays, pressed, strict=True), 1):
        for phase in phases(decay):
            reach_f, reach_zeta = _reaches(decay, phase)
            rows.append(
                (
                    _named(decay, number),
                    word(phase.kind),
                    *(joint_force(forces[name].mean, forces[name].std) if name in forces else "" for name in joints),
                    fixed(phase.start, 3),
                    fixed(phase.stop, 3),
                    plain(phase.cycles, 3),
                    fixed(phase.frequency, 2) if reach_f is None else with_uncertainty(phase.frequency, reach_f),
                    fixed(100 * phase.damping, 3)
                    if reach_zeta is None
                    else with_uncertainty(100 * phase.damping, 100 * reach_zeta),
                    fixed(phase.misfit_ratio, 2),
                    fixed(decay.knee, 3) if isfinite(decay.knee) else MISSING,
                    plain(reach_f, 2),
                    plain(None if reach_zeta is None else 100 * reach_zeta, 2),
                )
            )
    columns = (
        text("Ring-down"),
        text("Phase"),
        *(f"F_N {name} [N]" for name in joints),
        text("From [s]"),
        text("To [s]"),
        text("Cycles"),
        "f [Hz]",
        "ζ [%]",
        text("Exponential over straight"),
        text("Knee [s]"),
    )
    known = any(decay.frequency_reach is not None for decay in decays)
    return book.table(
        "ring_downs",
        text(
            "Phases of the ring-downs, medians over each; the misfit of an exponential envelope "
            "over that of a straight line is above 1 where friction makes the decay, below 1 "
            "where viscous damping does."
        )
        + (" " + text("± is half the 95 % interval of f and ζ at one amplitude, as a median too.") if known else ""),
        (*columns, *(("± f [Hz]", "± ζ [%]") if known else ())),
        rows if known else [row[:-2] for row in rows],
        len(columns),
    )


def _joints(decay: Decay, runs: Sequence[Run]) -> dict[str, JointForce]:
    """The normal forces of the run of a ring-down by the names of the joints."""
    return {
        joint.joint: joint
        for run in runs
        if decay.name == run.id or decay.name.startswith(f"{run.id}, record ")
        for joint in run.condition.joints
    }


def _reaches(decay: Decay, phase: Phase) -> tuple[float | None, float | None]:
    """Median half widths of the 95 % intervals of frequency in Hz and damping over a phase, where they are known."""
    inside = (decay.times >= phase.start) & (decay.times <= phase.stop)
    both = (decay.frequency_reach, decay.damping_reach)
    f, zeta = (None if reach is None else float(np.median(reach[inside])) for reach in both)
    return f, zeta


def _curve_table(decays: Sequence[Decay], book: Book) -> Block:
    """Frequency and damping over the amplitude, point by point; only a file, not shown in the report."""
    curves: list[tuple[Cell, ...]] = [
        (_named(decay, number), *(plain(float(value), 6) for value in point))
        for number, decay in enumerate(decays, 1)
        for point in _curve(decay)
    ]
    columns = (text("Ring-down"), text("Time [s]"), text("Amplitude"), "f [Hz]", "ζ [%]", "± f [Hz]", "± ζ [%]")
    known = any(decay.frequency_reach is not None for decay in decays)
    return book.table(
        "ring_down_curves",
        text("Frequency and damping over the amplitude, in the unit of the signal."),
        columns if known else columns[:-2],
        curves if known else [row[:-2] for row in curves],
        0,
    )


def _curve(decay: Decay, most: int = 500) -> np.ndarray:
    step = -(-len(decay.times) // most)
    unknown = np.full(len(decay.times), np.nan)
    reaches = [unknown if reach is None else reach for reach in (decay.frequency_reach, decay.damping_reach)]
    values = (decay.times, decay.amplitudes, decay.frequencies, 100 * decay.damping_ratios)
    return np.column_stack([value[::step] for value in (*values, reaches[0], 100 * reaches[1])])


def loops(measured: Sequence[Loop], book: Book) -> list[Block]:
    """Force over relative displacement, and the energy of a cycle."""
    names = [loop.name or text("loop {number}", number=number) for number, loop in enumerate(measured, 1)]
    blocks: list[Block] = []
    for start in range(0, len(measured), _TOGETHER):
        shown, labels = measured[start : start + _TOGETHER], names[start : start + _TOGETHER]
        blocks.append(
            book.picture(
                partial(show.hysteresis, shown, labels),
                text("Hysteresis loops of {names}: force over relative displacement.", names=", ".join(labels)),
                text(
                    "Force over relative displacement; the enclosed area is the energy that the joint "
                    "dissipates in a cycle."
                ),
            )
        )
    columns = (
        text("Loop"),
        "F_N [N]",
        text("Amplitude [µm]"),
        text("Largest force [N]"),
        text("Energy per cycle [mJ]"),
        text("Loss factor"),
        text("Cycles"),
    )
    rows: list[tuple[Cell, ...]] = [
        (
            name,
            plain(loop.normal_force, 4),
            plain(1e6 * loop.amplitude, 4),
            plain(top := _top(loop), 4),
            plain(1e3 * loop.area, 4),
            plain(loop.area / (np.pi * loop.amplitude * top) if loop.amplitude * top > 0 else None, 3),
            loop.cycles,
        )
        for name, loop in zip(names, measured, strict=True)
    ]
    caption = text(
        "Hysteresis loops; the loss factor is the energy per cycle over π times amplitude times largest force."
    )
    return [*blocks, book.table("loops", caption, columns, rows)]


def _top(loop: Loop) -> float:
    return float(np.max(np.abs(loop.forces)))
