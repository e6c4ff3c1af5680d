"""Modal parameters over excitation level and normal force."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import Normal, Stroke
from matplotlib.text import Text

from ema.data import ModalMap
from ema.messages import mark, text, word
from ema.show.style import COLOUR_MAP, GREY, SERIES, VERMILION, empty_note, new_figure, styled

_METHODS = (mark("measured"), mark("frozen"))
"""How a map was made, as data say it."""
_WRITTEN = 25
"""Conditions up to which their values are written into the cells: contour lines would say more than so few tell."""
_HOLE: dict[str, Any] = {"fill": False, "hatch": "////", "ec": GREY, "lw": 0}


@styled
def damping_map(chart: ModalMap) -> Figure:
    """Draw the damping ratio in percent over normal force (across) and excitation force (up).

    The ridge joins the normal force of the largest damping of each level; holes, where no mode was identified, are
    hatched.

    Parameters
    ----------
    chart : ModalMap
        A map.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.examples import modal_map
    >>> damping_map(modal_map()).axes[0].get_xlabel()
    'Normal force F_N [N]'
    """
    return _map(chart, 100 * chart.damping, text("Damping ratio [%]"), ridge=True)


@styled
def frequency_map(chart: ModalMap) -> Figure:
    """Draw the natural frequency in Hz over normal force (across) and excitation force (up); holes are hatched.

    Parameters
    ----------
    chart : ModalMap
        A map.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.examples import modal_map
    >>> frequency_map(modal_map()).axes[0].get_ylabel()
    'Excitation force F_E [N]'
    """
    return _map(chart, np.asarray(chart.frequency), text("Natural frequency [Hz]"), ridge=False)


def _map(chart: ModalMap, values: Float[np.ndarray, "level force"], label: str, ridge: bool) -> Figure:
    """Colours, and the values in the cells, or contour lines where there are many."""
    figure = new_figure(4.2, 7.0)
    axes = figure.subplots()
    x, y = np.asarray(chart.normal_forces), np.asarray(chart.force_levels)
    known_x, known_y = np.isfinite(x), np.isfinite(y)  # a condition of an unknown force lies nowhere
    x, y, values = x[known_x], y[known_y], values[np.ix_(known_y, known_x)]
    holes = ~np.isfinite(values)
    if not values.size or holes.all():
        empty_note(axes, text("the map has no point"))
        return figure
    for axis, nominal in (("x", x), ("y", y)):
        if _geometric(nominal):
            getattr(axes, f"set_{axis}scale")("log")
            shown = nominal[:: -(-len(nominal) // 10)]
            getattr(axes, f"set_{axis}ticks")(shown, [f"{value:g}" for value in shown])
            getattr(axes, f"set_{axis}ticks")([], minor=True)
    edges = [_edges(nominal, _geometric(nominal)) for nominal in (x, y)]
    axes.set_facecolor("white")
    mesh = axes.pcolormesh(*edges, np.ma.masked_array(values, holes), cmap=COLOUR_MAP, edgecolors="white", lw=0.3)
    for row, column in np.argwhere(holes):
        corner, width = (edges[0][column], edges[1][row]), np.diff(edges[0])[column]
        axes.add_patch(Rectangle(corner, width, np.diff(edges[1])[row], **_HOLE))
    span, numbers = float(np.ptp(values[~holes])), list[Text]()
    if np.count_nonzero(~holes) <= _WRITTEN:
        decimals = int(np.clip(1 - np.floor(np.log10(span)), 0, 3)) if span > 0 else 2
        numbers = [
            axes.annotate(
                f"{values[row, column]:.{decimals}f}",
                (x[column], y[row]),
                xytext=(0, 6),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color="white",
            )
            for row, column in np.argwhere(~holes)
        ]
    elif min(values.shape) > 1 and span > 0:
        lines = axes.contour(x, y, np.ma.masked_array(values, holes), levels=6, colors="white", linewidths=0.8)
        numbers = list(axes.clabel(lines, fontsize=8, fmt="%.4g"))
    for number in numbers:
        number.set_path_effects([Stroke(linewidth=2, foreground="#1a1a1a"), Normal()])  # on light colours too
    if ridge:
        rows = [row for row in range(len(y)) if not holes[row].all()]
        tops = [x[np.nanargmax(values[row])] for row in rows]
        axes.plot(
            tops,
            y[rows],
            color=VERMILION,
            marker="o",
            ms=4,
            mec="white",
            mew=0.6,
            lw=1.4,
            label=text("largest damping"),
        )
    axes.set_xlabel(text("Normal force F_N [N]"))
    axes.set_ylabel(text("Excitation force F_E [N]"))
    axes.set_title(" ".join(part for part in (chart.name, f"({word(chart.method)})") if part))
    axes.grid(visible=False)
    figure.colorbar(mesh, ax=axes, label=label)
    if holes.any():
        axes.add_patch(Rectangle((np.nan, np.nan), 0, 0, label=text("no mode found"), **_HOLE))
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside lower center", ncols=2)
    return figure


def _geometric(nominal: Float[np.ndarray, "n"]) -> bool:
    """Whether positive values grow by a factor rather than by a step."""
    return bool(len(nominal) > 2 and nominal.min() > 0 and nominal.max() / nominal.min() > 20)


def _edges(nominal: Float[np.ndarray, "n"], geometric: bool) -> Float[np.ndarray, "edge"]:
    """Edges of the cells around the nominal values."""
    centres = np.log(nominal) if geometric else np.asarray(nominal, float)
    if len(centres) == 1:
        half = max(abs(centres[0]) * 0.1, 0.5)
        edges = np.array([centres[0] - half, centres[0] + half])
    else:
        middle = (centres[1:] + centres[:-1]) / 2
        edges = np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])
    return np.exp(edges) if geometric else edges


@styled
def damping_curves(chart: ModalMap) -> Figure:
    """Draw the damping ratio in percent at every normal force over the excitation force and over the modal amplitude.

    Bars hold 95 % by the fit; dashed lines are the damping by the height of the peak, where it is known. Without modal
    amplitudes there is one panel.

    Parameters
    ----------
    chart : ModalMap
        A map.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.examples import modal_map
    >>> len(damping_curves(modal_map()).axes)
    1
    """
    amplitude = chart.modal_amplitude
    figure = new_figure(3.9)
    panels = figure.subplots(1, 1 if amplitude is None else 2, squeeze=False, sharey=True)[0]
    if not np.isfinite(chart.damping).any():
        empty_note(panels[0], text("the map has no point"))
        return figure
    levels = np.broadcast_to(np.asarray(chart.force_levels)[:, None], chart.damping.shape)
    forces = levels if chart.force_at_resonance is None else np.asarray(chart.force_at_resonance)
    axes_of = [(panels[0], forces, text("Force at resonance [N]"))]
    if amplitude is not None:
        axes_of.append((panels[1], 1e6 * np.asarray(amplitude), text("Modal amplitude [µm √kg]")))
    colours = colormaps[COLOUR_MAP](np.linspace(0, 0.92, len(chart.normal_forces)))
    std = np.zeros(chart.damping.shape) if chart.damping_std is None else np.nan_to_num(chart.damping_std)
    for axes, across, label in axes_of:
        for column, force in enumerate(chart.normal_forces):
            style: dict[str, Any] = {"color": colours[column], "marker": SERIES[column % len(SERIES)][2], "ms": 4}
            axes.errorbar(
                across[:, column],
                100 * chart.damping[:, column],
                196 * std[:, column],
                lw=1.3,
                elinewidth=0.8,
                capsize=2,
                label=f"{force:.5g} N" if axes is panels[0] else None,
                **style,
            )
            if chart.quadrature_damping is not None:
                axes.plot(
                    across[:, column], 100 * chart.quadrature_damping[:, column], "--", lw=0.9, color=colours[column]
                )
        if across is not forces and _geometric(np.sort(across[np.isfinite(across)])):
            axes.set_xscale("log")
        axes.set_xlabel(label)
        axes.set_ylim(bottom=0)
    panels[0].set_ylabel(text("Damping ratio [%]"))
    figure.legend(loc="outside lower center", ncols=min(len(chart.normal_forces), 8), title=text("Normal force F_N"))
    return figure
