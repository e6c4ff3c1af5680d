"""What numbers and sentences say of a friction joint: intervals before and after, statements, readings of a hammer."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema.data import Band
from ema.data.modal import COVERAGE_FACTOR
from ema.errors import InputError
from ema.messages import text
from ema.show import joint_words
from ema.show.joint_result import JointResult, JointStatement
from ema.show.style import BLACK, BLUE, GREY, VERMILION, empty_note, new_figure, styled

_PRIOR = "#d9d9d9"
_SPAN = (-0.3, 1.3)
"""How far beyond the ends of a prior, 0 and 1, a posterior is drawn; what goes on gets an arrow."""
_BEYOND = 3.2
"""Half widths of a predicted interval from its middle that are drawn; what lies further off gets an arrow."""
_EDGE = _BEYOND - 0.1
"""Where the arrows stand."""


@styled
def joint_parameters(result: JointResult) -> Figure:
    """Draw the 95 % interval of every parameter and combination within its prior range.

    Each row has an axis of its own from end to end of the prior range, logarithmic where the prior is even in the
    logarithm; the numbers stand beside it. Determined parameters are filled, the others are open.

    Parameters
    ----------
    result : JointResult
        What statements say of a joint.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.show.joint_result import example
    >>> len(joint_parameters(example()).axes)
    1
    """
    rows = sorted(result.parameters, key=lambda parameter: parameter.combination)
    columns = (
        (1.35, "left", text("prior (95 %)")),
        (1.96, "left", text("posterior (95 %)")),
        (2.9, "right", text("width / prior")),
    )
    figure = new_figure(0.9 + 0.31 * len(rows))
    axes = figure.subplots()
    for row, parameter in enumerate(rows):
        shown = joint_words.parameter(parameter.name)
        scale = np.log if parameter.logarithmic else np.asarray
        before, after = (
            scale(np.maximum(ends, 1e-300) if parameter.logarithmic else np.array(ends))
            for ends in (parameter.prior, parameter.interval)
        )
        low, high = (after - before[0]) / (before[1] - before[0])
        ends = np.clip([low, high], *_SPAN)
        colour = BLUE if parameter.determined else "white"
        axes.barh(row, 1, height=0.62, color=_PRIOR, lw=0)
        axes.barh(row, np.ptp(ends), left=ends[0], height=0.34, facecolor=colour, edgecolor=BLUE, lw=1.3)
        for end, arrow in ((low, "<"), (high, ">")):
            if not _SPAN[0] <= end <= _SPAN[1]:
                axes.plot(np.clip(end, *_SPAN), row, arrow, color=BLUE, ms=5)
        cells = (shown.interval(parameter.prior), shown.interval(parameter.interval), f"{parameter.narrowing:.2f}")
        for (place, side, _), cell in zip(columns, cells, strict=True):
            axes.text(place, row, cell, ha=side, va="center", fontsize=8)
    axes.set_yticks(range(len(rows)), [joint_words.parameter(parameter.name).name for parameter in rows])
    first_combination = sum(not parameter.combination for parameter in rows)
    if 0 < first_combination < len(rows):
        axes.axhline(first_combination - 0.5, color=GREY, lw=0.6, ls=":")
    for place, side, head in columns:
        axes.text(place, -0.85, head, ha=side, va="bottom", fontsize=7.5, color=BLACK)
    axes.set_xlim(_SPAN[0] - 0.02, columns[-1][0] + 0.02)
    axes.set_ylim(len(rows) - 0.4, -0.9)
    _bare(axes)
    return figure


@styled
def joint_statements(result: JointResult) -> Figure:
    """Draw every statement against what all others predict in its place.

    The unit of each row is half the predicted 95 % interval, in logarithms for forces, so that the interval lies
    between -1 and 1. A number is a dot with 95 % of its standard deviation, limits are a line between ticks, with an
    arrow where it goes on. Where too few draws tell the prediction, the row is empty.

    Parameters
    ----------
    result : JointResult
        What statements say of a joint.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.show.joint_result import example
    >>> len(joint_statements(example()).axes)
    1
    """
    rows = result.statements
    figure = new_figure(1.0 + 0.36 * max(1, len(rows)))
    axes = figure.subplots()
    if not rows:
        empty_note(axes, text("no statement"))
        return figure
    for row, statement in enumerate(rows):
        axes.axhline(row, color=_PRIOR, lw=0.6, zorder=0)
        if np.isnan(statement.probability):
            axes.text(0, row, text("too few draws tell it"), ha="center", va="center", fontsize=7.5, color=GREY)
            continue
        axes.barh(row, 2, left=-1, height=0.62, color=BLUE, alpha=0.25, lw=0)
        _statement(axes, row, statement)
        axes.text(
            _BEYOND + 0.15, row, joint_words.probability(statement.probability), ha="left", va="center", fontsize=8
        )
    axes.text(_BEYOND + 0.15, -0.75, text("probability"), ha="left", va="bottom", fontsize=7.5)
    names = [joint_words.quantity(one.quantity).name.replace(": ", ":\n", 1) for one in rows]
    labels = [f"{number}  {name}" for number, name in enumerate(names, 1)]
    axes.set_yticks(range(len(rows)), labels, fontsize=7)
    axes.set_xlim(-_BEYOND, _BEYOND + 0.9)
    axes.set_ylim(len(rows) - 0.4, -0.75)
    axes.set_xticks([-3, -2, -1, 0, 1, 2, 3])
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(text("Distance from the middle of the prediction over half its 95 % interval [-]"))
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    return figure


def _statement(axes: Axes, row: int, statement: JointStatement) -> None:
    """What is stated, in half widths of the predicted interval."""
    colour = VERMILION if statement.contradicts else BLACK
    scale = np.log if statement.relative else np.asarray
    low, high = scale(np.array(statement.predicted))
    middle, half = (low + high) / 2, (high - low) / 2

    def place(value: float) -> float:
        return float((value - middle) / half)

    if statement.is_number:
        at, reach = place(float(scale(statement.value))), COVERAGE_FACTOR * statement.std / half
        if abs(at) > _EDGE:
            axes.plot(np.sign(at) * _EDGE, row, ">" if at > 0 else "<", color=colour, ms=6)
            return
        axes.errorbar(at, row, xerr=reach, fmt="o", ms=4.5, color=colour, capsize=2.5, lw=1.1)
        return
    ends = []
    for limit, sign in zip(statement.limits, (-1, 1), strict=True):
        known = np.isfinite(limit) and not (statement.relative and limit <= 0)
        ends.append(place(float(scale(limit))) if known else sign * np.inf)
    first, last = np.clip(ends, -_EDGE, _EDGE)
    if first == last:  # all that is stated lies beyond the axis
        axes.plot(first, row, ">" if first > 0 else "<", color=colour, ms=6)
        return
    axes.plot([first, last], [row, row], "-", color=colour, lw=1.8, solid_capstyle="butt")
    for end, arrow in ((first, "<"), (last, ">")):
        axes.plot(
            end, row, arrow if abs(end) == _EDGE else "|", color=colour, ms=5 if abs(end) == _EDGE else 10, mew=1.6
        )


@styled
def hammer_readings(result: JointResult) -> Figure:
    """Draw the frequency and the damping ratio that hammer tests read over the normal force, and the stated ones.

    Parameters
    ----------
    result : JointResult
        What statements say of a joint, with a hammer test among them.

    Returns
    -------
    Figure
        The figure: medians and 95 % bands of the posterior of one joint, stated numbers with 95 % bars, and the mode
        without the beam (dotted).

    Raises
    ------
    InputError
        If there is no hammer test.

    Examples
    --------
    >>> from ema.show.joint_result import example
    >>> len(hammer_readings(example()).axes)
    2
    """
    predicted = result.hammer
    if predicted is None:
        raise InputError("the statements hold no hammer test", where=result.title, advice="add [[hammer]] to the file")
    figure = new_figure(3.1)
    left, right = figure.subplots(1, 2)
    for axes, band, stated, bare, factor in (
        (left, predicted.frequency, predicted.stated_frequency, result.bare[0], 1.0),
        (right, predicted.damping, predicted.stated_damping, result.bare[1], 100.0),
    ):
        _curve(axes, predicted.normal_forces, band, factor)
        axes.axhline(factor * bare, color=BLACK, ls=":", lw=0.9, label=text("without the beam"))
        axes.errorbar(
            predicted.stated_forces,
            factor * stated[:, 0],
            factor * COVERAGE_FACTOR * stated[:, 1],
            fmt="o",
            ms=4.5,
            color=BLACK,
            capsize=3,
            lw=1.1,
            label=text("stated"),
        )
        axes.set_xscale("log")
        axes.set_xlabel(text("Normal force F_N [N]"))
    left.set_ylabel(text("Natural frequency [Hz]"))
    right.set_ylabel(text("Damping ratio [%]"))
    right.set_ylim(bottom=0)
    left.legend(loc="best")
    return figure


def _curve(axes: Axes, forces: np.ndarray, band: Band, factor: float) -> None:
    axes.fill_between(forces, factor * band.low, factor * band.high, color=BLUE, alpha=0.25, lw=0, label="95 %")
    axes.plot(forces, factor * band.value, color=BLUE, label=text("median"))


def _bare(axes: Axes) -> None:
    """No frame, no ticks across: every row has its own numbers."""
    axes.grid(visible=False)
    axes.set_xticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.tick_params(axis="y", length=0)
