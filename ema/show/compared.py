"""A model against a measurement, as pictures."""

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema.data import ModalMap
from ema.data.comparison import MapComparison, MapPrediction
from ema.data.modal import COVERAGE_FACTOR
from ema.messages import text
from ema.show.style import COLOUR_MAP, SERIES, new_figure, styled

_APART = 0.09
"""Distance of ticks from which their labels do not touch, over the width of the axis."""


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
        (panels[0], 100.0, "damping", text("Damping ratio [%]")),
        (panels[1], 1.0, "frequency", text("Natural frequency [Hz]")),
    )
    for axes, unit, name, label in parts:
        std = getattr(measured, f"{name}_std")
        for row in range(levels):
            bars = None if std is None else COVERAGE_FACTOR * unit * np.nan_to_num(std[row])
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
        _over_normal_force(axes, measured.normal_forces)
        axes.set_ylabel(label)
    panels[0].set_ylim(bottom=0)
    figure.legend(
        loc="outside lower center",
        ncols=min(levels, 8),
        title=text("Excitation F_E: markers measured, lines the model"),
    )
    return figure


@styled
def map_prediction(predicted: MapPrediction, measured: ModalMap | None = None) -> Figure:
    """Draw damping ratio and frequency over the normal force: points with 95 % bars are measured, bands are predicted.

    Parameters
    ----------
    predicted : MapPrediction
        Predicted conditions; bands join the normal forces of a level, bars stand where there is one normal force.
    measured : ModalMap, optional
        The map that they were predicted from.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.data import MapPrediction
    >>> from ema.examples import modal_map
    >>> frequency, damping = ([[39.5]], [[39.0]], [[40.0]]), ([[0.02]], [[0.01]], [[0.03]])
    >>> len(map_prediction(MapPrediction([2.0], [500.0], *frequency, *damping), modal_map()).axes)
    2
    """
    figure = new_figure(3.9)
    panels = figure.subplots(1, 2)
    known = [] if measured is None else [measured]
    shown: tuple[ModalMap | MapPrediction, ...] = (*known, predicted)
    levels = np.unique(np.concatenate([each.force_levels for each in shown]))
    colours = colormaps[COLOUR_MAP](np.linspace(0, 0.88, len(levels)))
    parts = (
        (panels[0], 100.0, "damping", text("Damping ratio [%]")),
        (panels[1], 1.0, "frequency", text("Natural frequency [Hz]")),
    )
    for axes, unit, name, label in parts:
        bands = [unit * getattr(predicted, f"{name}{end}") for end in ("_low", "", "_high")]
        for chart in known:
            _measured_points(axes, chart, name, unit, colours[np.searchsorted(levels, chart.force_levels)])
        for row, level in enumerate(predicted.force_levels):
            colour, said = colours[np.searchsorted(levels, level)], text("{level} N, predicted", level=f"{level:.4g}")
            low, value, high = (each[row] for each in bands)
            style = {"color": colour, "label": said if name == "damping" else None}
            if len(predicted.normal_forces) > 1:
                axes.fill_between(predicted.normal_forces, low, high, color=colour, alpha=0.2, lw=0)
                axes.plot(predicted.normal_forces, value, "--", lw=1.2, **style)
            else:
                axes.errorbar(predicted.normal_forces, value, [value - low, high - value], fmt="D", ms=4, **style)
        _over_normal_force(axes, np.concatenate([each.normal_forces for each in shown]))
        axes.set_ylabel(label)
    panels[0].set_ylim(bottom=0)
    figure.legend(loc="outside lower center", ncols=3, title=text("Excitation F_E"))
    return figure


def _measured_points(
    axes: Axes, chart: ModalMap, name: str, unit: float, colours: Float[np.ndarray, "level 4"]
) -> None:
    """Points with 95 % bars, a colour for each level."""
    std = getattr(chart, f"{name}_std")
    for row, level in enumerate(chart.force_levels):
        bars = None if std is None else COVERAGE_FACTOR * unit * np.nan_to_num(std[row])
        look = {"fmt": "o", "ms": 4, "color": colours[row], "elinewidth": 0.8, "capsize": 2}
        said = text("{level} N, measured", level=f"{level:.4g}") if name == "damping" else None
        axes.errorbar(chart.normal_forces, unit * getattr(chart, name)[row], bars, label=said, **look)


def _over_normal_force(axes: Axes, forces: Float[np.ndarray, "force"]) -> None:
    """A logarithmic axis with the normal forces as ticks, so many that their labels stand beside each other."""
    axes.set_xscale("log")
    distinct = np.unique(forces[forces > 0])
    reach = np.log(distinct[-1] / distinct[0]) if len(distinct) else 0.0
    shown: list[float] = []
    for force in distinct:
        if not shown or np.log(force / shown[-1]) > _APART * reach:
            shown.append(float(force))
    axes.set_xticks(shown, [f"{force:.4g}" for force in shown])
    axes.set_xticks([], minor=True)
    axes.set_xlabel(text("Normal force F_N [N]"))
