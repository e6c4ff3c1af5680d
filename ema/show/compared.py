"""A model against a measurement, as pictures."""

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from ema.data.comparison import MapComparison
from ema.show.style import COLOUR_MAP, SERIES, new_figure, styled


@styled
def map_comparison(found: MapComparison) -> Figure:
    """Draw damping ratio and frequency over the normal force: markers with 95 % bars are measured, lines are the model.

    Parameters
    ----------
    found : MapComparison
        A simulated map, compared with a measured one.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.compare import maps
    >>> from ema.examples import modal_map
    >>> len(map_comparison(maps(modal_map(), modal_map())).axes)
    2
    """
    measured, simulated = found.measured, found.simulated
    figure = new_figure(3.9)
    panels = figure.subplots(1, 2)
    levels = len(measured.force_levels)
    colours = colormaps[COLOUR_MAP](np.linspace(0, 0.88, levels))
    parts = (
        (panels[0], 100.0, "damping", "Damping ratio [%]"),
        (panels[1], 1.0, "frequency", "Natural frequency [Hz]"),
    )
    for axes, unit, name, label in parts:
        std = getattr(measured, f"{name}_std")
        for row in range(levels):
            bars = None if std is None else 1.96 * unit * np.nan_to_num(std[row])
            axes.errorbar(
                measured.normal_forces,
                unit * getattr(measured, name)[row],
                bars,
                fmt=SERIES[row % len(SERIES)][2],
                ms=4.5,
                color=colours[row],
                elinewidth=0.8,
                capsize=2,
                label=f"{measured.force_levels[row]:.4g} N" if name == "damping" else None,
            )
            axes.plot(simulated.normal_forces, unit * getattr(simulated, name)[row], color=colours[row], lw=1.2)
        axes.set_xscale("log")
        axes.set_xlabel("Normal force F_N [N]")
        axes.set_ylabel(label)
    panels[0].set_ylim(bottom=0)
    figure.legend(
        loc="outside lower center", ncols=min(levels, 8), title="Excitation F_E: markers measured, lines the model"
    )
    return figure
