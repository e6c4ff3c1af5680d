"""How complex the mode shapes are: every DOF as a line from the origin of the complex plane."""

from collections.abc import Sequence

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ema.data import ModalModel
from ema.messages import text
from ema.shapes import quality
from ema.show.selection import chosen_modes
from ema.show.style import BLUE, FAINT, VERMILION, empty_note, new_figure, styled

PER_FIGURE = 12
"""Shapes in one figure, in rows of six."""


@styled
def complexity(model: ModalModel, modes: Sequence[int] | None = None) -> Figure:
    """Draw mode shapes in the complex plane, scaled to their largest entry, with MPC and MPD.

    Real modes lie on one line.

    The dots mark the mean phase.

    Parameters
    ----------
    model : ModalModel
        Modes.
    modes : sequence of int, optional
        Positions from 0; by default the first twelve.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    InputError
        If the model has no mode at a position.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> figure = complexity(modal_model(), modes=[0])
    >>> len(figure.axes) > 0
    True
    """
    chosen = chosen_modes(model, modes, PER_FIGURE)
    columns = 6
    rows = max(1, -(-len(chosen) // columns))
    figure = new_figure(1.95 * rows)
    if not len(chosen):
        empty_note(figure.subplots(), text("no mode, no shape"))
        return figure
    measures = quality(model.shapes)
    panels = figure.subplots(rows, columns, squeeze=False)
    for panel, axes in enumerate(panels.flat):
        axes.set_axis_off()
        if panel >= len(chosen):
            continue
        mode = chosen[panel]
        shape = model.shapes[:, mode]
        tips = shape / (np.max(np.abs(shape), initial=0.0) or 1.0)
        axes.add_patch(Circle((0, 0), 1, fill=False, ec=FAINT, lw=0.8))
        axes.plot([-1, 1, np.nan, 0, 0], [0, 0, np.nan, -1, 1], color=FAINT, lw=0.6)
        spokes = np.zeros((len(tips), 2, 2))
        spokes[:, 1] = np.column_stack([tips.real, tips.imag])
        axes.add_collection(LineCollection(list(spokes), colors=BLUE, linewidths=0.7, alpha=0.8))
        mean = np.exp(1j * np.radians(measures.mean_phase[mode]))
        axes.plot([mean.real, -mean.real], [mean.imag, -mean.imag], ls="none", marker="o", ms=3, color=VERMILION)
        axes.set(xlim=(-1.08, 1.08), ylim=(-1.08, 1.08), aspect="equal")
        axes.set_title(
            f"{mode + 1}: {model.natural_frequencies[mode]:.5g} Hz\nMPC {measures.modal_phase_collinearity[mode]:.3f}, "
            f"MPD {measures.mean_phase_deviation[mode]:.1f}°",
            fontsize=7.5,
            loc="center",
        )
    panels[0, 0].text(1.04, 0, "Re", fontsize=6.5, va="bottom", ha="right")
    panels[0, 0].text(0.04, 1.0, "Im", fontsize=6.5, va="top")
    return figure
