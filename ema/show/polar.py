"""How complex the mode shapes are: every DOF as a line from the origin of the complex plane."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from ema.data import ModalModel
from ema.shapes import quality
from ema.show.style import BLUE, VERMILION, empty_note, new_figure, styled

PER_FIGURE = 12


@styled
def complexity(model: ModalModel, modes: "range | list[int] | None" = None) -> Figure:
    """Polar plots of mode shapes, scaled to their largest entry, with MPC and mean phase; real modes lie on one line.

    Parameters
    ----------
    modes : positions from 0, by default the first twelve.
    """
    chosen = list(range(min(PER_FIGURE, len(model.poles))) if modes is None else modes)
    columns = 6
    rows = max(1, -(-len(chosen) // columns))
    figure = new_figure(1.95 * rows)
    if not chosen:
        empty_note(figure.subplots(), "no mode, no shape")
        return figure
    measures = quality(model.shapes)
    for place, mode in enumerate(chosen):
        axes = figure.add_subplot(rows, columns, place + 1, projection="polar")
        assert isinstance(axes, PolarAxes)
        shape = model.shapes[:, mode]
        peak = np.max(np.abs(shape), initial=0.0) or 1.0
        spokes = np.zeros((len(shape), 2))
        spokes[:, 1] = np.abs(shape) / peak
        angles = np.repeat(np.angle(shape)[:, None], 2, axis=1)
        axes.plot(angles.T, spokes.T, color=BLUE, lw=0.6, alpha=0.8)
        mean = np.radians(measures.mean_phase[mode])
        axes.plot([mean + np.pi, mean], [1, 1], color=VERMILION, ls="none", marker="o", ms=3)
        axes.set_ylim(0, 1.05)
        axes.set_yticks([])
        axes.set_xticks(np.radians([0, 90, 180, 270]), ["0°", "90°", "180°", "270°"], fontsize=6)
        axes.tick_params(axis="x", pad=-3)
        axes.set_title(
            f"{mode + 1}: {model.natural_frequencies[mode]:.5g} Hz\nMPC {measures.modal_phase_collinearity[mode]:.3f}",
            fontsize=7.5, loc="center",
        )  # fmt: skip
    return figure
