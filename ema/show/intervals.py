"""Numbers with their intervals: changes of modes, repeats, parameters, pressures of joints."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema.data import ConditionDifference, ContactPressure, ModelUpdate, RepeatGroup, SetUpShifts
from ema.data.comparison import ModeComparison
from ema.data.modal import COVERAGE_FACTOR
from ema.show.style import BLUE, GREY, SERIES, VERMILION, empty_note, new_figure, styled

_LOW = 0.1
"""Least factor of a parameter over its estimate that is drawn: an interval beyond a decade bounds little."""
_HIGH = 10.0
"""Largest such factor."""


@styled
def mode_changes(change: ConditionDifference | ModeComparison | RepeatGroup | SetUpShifts) -> Figure:
    """Draw how frequency and damping of each mode change, in percent.

    Parameters
    ----------
    change : ConditionDifference or ModeComparison or RepeatGroup or SetUpShifts
        From one condition to another with 95 % bars (of the noise alone, in grey, where there are no repeats); from a
        measurement to a model; half 95 % intervals of repeats; or the shifts of set-ups with 95 % bars.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no mode.

    Examples
    --------
    >>> from ema.compare import modes
    >>> from ema.examples import modal_model
    >>> len(mode_changes(modes(modal_model(), modal_model())).axes)
    2
    """
    if isinstance(change, SetUpShifts):
        return _shifts(change)
    if isinstance(change, RepeatGroup):
        return _repeats(change)
    figure = new_figure(3.2)
    if not change.pairs:
        empty_note(figure.subplots(), "no mode of one is paired with one of the other")
        return figure
    for axes, name in zip(figure.subplots(1, 2), ("frequency", "damping"), strict=True):
        values = getattr(change, name)
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = 100 * (values[:, 1] / values[:, 0] - 1)
        if isinstance(change, ConditionDifference):
            half, noise = (100 * getattr(change, f"{name}_{kind}") / values[:, 0] for kind in ("half", "noise"))
            known = np.isfinite(half)
            label = "95 % of the noise alone" if np.isfinite(noise).any() else "interval unknown"
            _bars(axes, relative[~known], noise[~known], np.flatnonzero(~known), GREY, label)
            _bars(axes, relative[known], half[known], np.flatnonzero(known), BLUE, "95 %")
        else:
            _bars(axes, relative, np.zeros(len(relative)), np.arange(len(relative)), BLUE, "")
        pairs = [f"{a + 1}" if a == b else f"{a + 1}/{b + 1}" for a, b in change.pairs]
        axes.set_xticks(range(len(pairs)), pairs, rotation=90 if len(pairs) > 12 else 0)
        axes.set_xlabel("Mode")
        axes.set_ylabel(f"Change of {'natural frequency' if name == 'frequency' else 'damping ratio'} [%]")
    return figure


def _bars(
    axes: Axes, values: Float[np.ndarray, "n"], half: Float[np.ndarray, "n"], at: np.ndarray, colour: str, label: str
) -> None:
    axes.axhline(0, color=GREY, lw=0.6)
    if len(values):
        bars = np.nan_to_num(half)
        axes.errorbar(at, values, bars, fmt="o", ms=4, color=colour, capsize=3, lw=0.9, label=label or None)
        if label:
            axes.legend(loc="best")


def _repeats(group: RepeatGroup) -> Figure:
    figure = new_figure(3.2)
    count = len(group.reference.poles)
    if not count:
        empty_note(figure.subplots(), "no mode in the repeats")
        return figure
    rows = ((group.frequency, "natural frequency"), (group.damping, "damping ratio"))
    if not any(np.isfinite([spread.half, spread.noise_half]).any() for spread, _ in rows):
        empty_note(figure.subplots(), "neither repeats nor noise tell an interval")
        return figure
    for axes, (spread, what) in zip(figure.subplots(1, 2), rows, strict=True):
        for values, label, look in ((spread.half, "repeats", SERIES[0]), (spread.noise_half, "noise alone", SERIES[1])):
            axes.semilogy(
                np.arange(1, count + 1), 100 * values / spread.mean, look[2], color=look[0], ms=5, label=label
            )
        axes.set_xlabel("Mode")
        axes.set_ylabel(f"Half 95 % interval of {what} [%]")
        axes.legend(loc="best")
    return figure


def _shifts(shifts: SetUpShifts) -> Figure:
    figure = new_figure(3.2)
    axes = figure.subplots()
    axes.axhline(0, color=GREY, lw=0.6)
    modes = np.arange(1, len(shifts.frequencies) + 1)
    for row, name in enumerate(shifts.names):
        colour, _, marker = SERIES[row % len(SERIES)]
        off = 0.5 * (row / max(1, len(shifts.names) - 1) - 0.5) if len(shifts.names) > 1 else 0.0
        bars = COVERAGE_FACTOR * 100 * np.nan_to_num(shifts.std[row])
        axes.errorbar(
            modes + off, 100 * shifts.shifts[row], bars, fmt=marker, ms=4, color=colour, capsize=2, label=name
        )
    axes.set_xlim(0.3, len(modes) + 0.7)
    axes.set_xticks(modes, [f"{frequency:.5g} Hz" for frequency in shifts.frequencies], rotation=45)
    axes.set_ylabel("Shift of natural frequency [%]")
    axes.set_title({"none": "no shift beyond the noise"}.get(shifts.cause, shifts.cause))
    axes.legend(loc="best", ncols=4)
    return figure


@styled
def parameters(update: ModelUpdate) -> Figure:
    """Draw the 95 % intervals of joint parameters over their estimates; those that the map does not bound are red.

    Parameters
    ----------
    update : ModelUpdate
        An updated model.

    Returns
    -------
    Figure
        The figure: from a tenth to ten times the estimate.

    Examples
    --------
    >>> from ema.data import ModelUpdate
    >>> from ema.examples import beam_model
    >>> update = ModelUpdate(beam_model(), ("mu",), [0.45], [[0.4, 0.5]], (True,), [[1.0]], 1.01, misfit=1.1)
    >>> len(parameters(update).axes)
    1
    """
    figure = new_figure(1.2 + 0.45 * len(update.names))
    axes = figure.subplots()
    axes.axvline(1, color=GREY, lw=0.7)
    for row, known in enumerate(update.identifiable):
        low, high = np.clip(update.intervals[row] / update.values[row], _LOW, _HIGH)
        colour = BLUE if known else VERMILION
        axes.plot([low, high], [row, row], "|-" if known else "-", color=colour, lw=2 if known else 1.2)
        axes.plot(1, row, "o", ms=5, color=colour)
    labels = [
        f"{name} = {value:.4g}" + ("" if known else " (not identifiable)")
        for name, value, known in zip(update.names, update.values, update.identifiable, strict=True)
    ]
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xscale("log")
    axes.set_xlim(0.9 * _LOW, 1.1 * _HIGH)
    axes.set_xticks([0.1, 0.5, 1, 2, 10], ["0.1", "0.5", "1", "2", "10"])
    axes.set_xlabel("95 % interval over the estimate [-]")
    return figure


@styled
def contact_forces(pressure: ContactPressure) -> Figure:
    """Draw the normal force of every node pair at rest, and its range while the structure moves.

    Parameters
    ----------
    pressure : ContactPressure
        Normal forces of the node pairs of all joints.

    Returns
    -------
    Figure
        The figure; pairs that open are red.

    Examples
    --------
    >>> from ema.data import ContactPressure
    >>> pressure = ContactPressure(
    ...     joints=("joint",), pairs=((1, 1),), forces=[100.0], preloads=[100.0], areas=[1e-4], least=[80.0],
    ...     greatest=[120.0], open_time=[0.0], first_opening=[np.nan], widest_gap=[0.0],
    ... )
    >>> len(contact_forces(pressure).axes)
    1
    """
    figure = new_figure(3.0)
    axes = figure.subplots()
    places = np.arange(len(pressure.forces))
    opens = pressure.open_time > 0
    axes.axhline(0, color=GREY, lw=0.6)
    axes.vlines(
        places,
        pressure.least,
        pressure.greatest,
        colors=[VERMILION if each else BLUE for each in opens],
        lw=3,
        alpha=0.5,
    )
    axes.plot(places, pressure.forces, "_", ms=9, color="black", label="at rest")
    names = [f"{joint} {a}/{b}" for joint, (a, b) in zip(pressure.joints, pressure.pairs, strict=True)]
    axes.set_xticks(places, names, rotation=90 if len(names) > 4 else 0, fontsize=7 if len(names) > 12 else 8)
    axes.set_ylabel("Normal force of a node pair [N]")
    axes.legend(loc="best")
    return figure
