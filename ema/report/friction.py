"""Friction measured directly: ring-downs with their phases, and hysteresis loops."""

from collections.abc import Sequence
from functools import partial
from math import isfinite

import numpy as np

from ema import show
from ema.data import Decay, Loop
from ema.estimate import phases
from ema.messages import mark, plural, text, word
from ema.report.blocks import Block, Book, Cell
from ema.report.numbers import MISSING, fixed, plain, short

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
        " " + text("Not one mode: {message}", message=finding.in_words().message)
        for finding in decay.findings
        if finding.severity != "info"
    )
    said = {"name": _named(decay, number), "phases": ", ".join(parts) or text("no phase of two cycles")}
    if not isfinite(decay.knee):
        return text("Ring-down of {name}: {phases}.", **said) + doubts
    knee = plain(decay.knee, 3)
    return text("Ring-down of {name}: {phases}; the joint begins to stick at {knee} s.", **said, knee=knee) + doubts


def ring_downs(decays: Sequence[Decay], book: Book) -> list[Block]:
    """Report frequency and damping of ring-downs over the amplitude, with a table of the phases.

    Parameters
    ----------
    decays : sequence of Decay
        Ring-downs; a picture shows at most six.
    book : Book
        Numbers the pictures and tables.

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
    return [*blocks, _phase_table(decays, book), _curve_table(decays, book)]


def _phase_table(decays: Sequence[Decay], book: Book) -> Block:
    """One row for each phase of each ring-down."""
    rows: list[tuple[Cell, ...]] = [
        (
            _named(decay, number),
            word(phase.kind),
            fixed(phase.start, 3),
            fixed(phase.stop, 3),
            plain(phase.cycles, 3),
            fixed(phase.frequency, 2),
            fixed(100 * phase.damping, 3),
            fixed(phase.misfit_ratio, 2),
            fixed(decay.knee, 3) if isfinite(decay.knee) else MISSING,
        )
        for number, decay in enumerate(decays, 1)
        for phase in phases(decay)
    ]
    columns = (
        text("Ring-down"),
        text("Phase"),
        text("From [s]"),
        text("To [s]"),
        text("Cycles"),
        "f [Hz]",
        "ζ [%]",
        text("Exponential over straight"),
        text("Knee [s]"),
    )
    return book.table(
        "ring_downs",
        text(
            "Phases of the ring-downs, medians over each; the misfit of an exponential envelope "
            "over that of a straight line is above 1 where friction makes the decay, below 1 "
            "where viscous damping does."
        ),
        columns,
        rows,
    )


def _curve_table(decays: Sequence[Decay], book: Book) -> Block:
    """Frequency and damping over the amplitude, point by point; only a file, not shown in the report."""
    curves: list[tuple[Cell, ...]] = [
        (_named(decay, number), *(plain(float(value), 6) for value in point))
        for number, decay in enumerate(decays, 1)
        for point in _curve(decay)
    ]
    return book.table(
        "ring_down_curves",
        text("Frequency and damping over the amplitude, in the unit of the signal."),
        (text("Ring-down"), text("Time [s]"), text("Amplitude"), "f [Hz]", "ζ [%]"),
        curves,
        0,
    )


def _curve(decay: Decay, most: int = 500) -> np.ndarray:
    step = -(-len(decay.times) // most)
    values = (decay.times, decay.amplitudes, decay.frequencies, 100 * decay.damping_ratios)
    return np.column_stack([value[::step] for value in values])


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
