"""Mode shapes on the geometry, or over the DOFs where there is none."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D
from mpl_toolkits.mplot3d.proj3d import proj_transform

from ema.data import Geometry, ModalModel
from ema.messages import text
from ema.shapes import Expansion, expand, realise
from ema.show.selection import check_located, chosen_modes
from ema.show.style import (
    BLUE,
    COLOUR_MAP,
    FAINT,
    GREY,
    dof_labels,
    empty_note,
    label_last_rows,
    new_figure,
    styled,
    thin_labels,
)

PER_FIGURE = 12
"""Shapes in one figure."""
_LARGEST = 0.13
"""Largest drawn displacement as a fraction of the size of the structure."""


@styled
def mode_shapes(
    model: ModalModel, geometry: Geometry, modes: Sequence[int] | None = None, interpolate: bool = True
) -> Figure:
    """Draw mode shapes on the geometry: at rest in grey, deformed in the colour of the displacement.

    Points on one straight line are drawn as a curve over the position on it.

    Parameters
    ----------
    model : ModalModel
        Modes.
    geometry : Geometry
        Where the nodes are.
    modes : sequence of int, optional
        Positions from 0; by default the first twelve.
    interpolate : bool, default True
        Move points without a measurement with their neighbours; they are drawn hollow.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no mode or no point.

    Raises
    ------
    InputError
        If the model has no mode at a position, or coordinates of the geometry are not finite.

    Examples
    --------
    >>> from ema.examples import geometry, modal_model
    >>> figure = mode_shapes(modal_model(), geometry(), modes=[0])
    >>> len(figure.axes) > 0
    True
    """
    chosen = chosen_modes(model, modes, PER_FIGURE)
    if not chosen or not len(geometry.nodes):
        figure = new_figure(1.5)
        empty_note(figure.subplots(), text("no mode, no shape") if not chosen else text("the geometry has no point"))
        return figure
    check_located(geometry)
    expansion = expand(model, geometry, interpolate)
    along = _straight(geometry)
    if along is not None:
        return _curves(model, geometry, expansion, chosen, along)
    return _panels(model, geometry, expansion, chosen)


def _title(model: ModalModel, mode: int) -> str:
    return f"{mode + 1}: {model.natural_frequencies[mode]:.5g} Hz, {100 * model.damping_ratios[mode]:.3g} %"


def _real_motion(expansion: Expansion, mode: int) -> Float[np.ndarray, "n 3"]:
    """Real displacement of one mode, its largest value 1."""
    flat = realise(expansion.displacement[:, :, mode].reshape(-1, 1)).reshape(-1, 3)
    peak = float(np.max(np.linalg.norm(flat, axis=1), initial=0.0))
    return flat / peak if peak > 0 else flat


def _straight(geometry: Geometry) -> Float[np.ndarray, "3"] | None:
    """Direction of the line on which all points lie, or nothing."""
    centred = geometry.xyz - geometry.xyz.mean(axis=0)
    _, values, directions = np.linalg.svd(centred, full_matrices=False)
    if len(geometry.nodes) < 2 or values[0] == 0 or (len(values) > 1 and values[1] > 1e-6 * values[0]):
        return None
    largest = np.argmax(np.abs(directions[0]))
    return np.asarray(directions[0] * np.sign(directions[0, largest]))


def _curves(
    model: ModalModel, geometry: Geometry, expansion: Expansion, chosen: list[int], along: Float[np.ndarray, "3"]
) -> Figure:
    columns = len(chosen) if len(chosen) <= 4 else 3
    rows = -(-len(chosen) // columns)
    figure = new_figure(1.9 * rows + 0.3)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    position = geometry.xyz @ along
    order = np.argsort(position)
    for panel, axes in enumerate(panels.flat):
        if panel >= len(chosen):
            axes.set_axis_off()
            continue
        motion = _real_motion(expansion, chosen[panel])
        # one sign for the curve: along the direction in which the structure moves most
        direction = np.linalg.svd(motion, full_matrices=False)[2][0]
        direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
        values = motion @ direction
        axes.axhline(0, color=FAINT, lw=1)
        axes.plot(position[order], values[order], color=BLUE, lw=1.2)
        for kind, face in ((expansion.measured, BLUE), (expansion.interpolated, "white")):
            axes.plot(position[kind], values[kind], "o", ms=4, mfc=face, mec=BLUE, mew=0.8)
        axes.set_title(_title(model, chosen[panel]), fontsize=8.5)
        axes.set_ylim(-1.15, 1.15)
    label_last_rows(panels, len(chosen))
    figure.supxlabel(text("Position [m]"), fontsize=9)
    figure.supylabel(text("Displacement / largest [-]"), fontsize=9)
    return figure


def _panels(model: ModalModel, geometry: Geometry, expansion: Expansion, chosen: list[int]) -> Figure:
    from matplotlib.cm import ScalarMappable

    columns = min(4, max(2, len(chosen)))
    rows = -(-len(chosen) // columns)
    figure = new_figure(2.35 * rows + 0.5)
    motions = [_real_motion(expansion, mode) for mode in chosen]
    size = _LARGEST * (float(np.linalg.norm(np.ptp(geometry.xyz, axis=0))) or 1.0)
    reach = np.concatenate([geometry.xyz, *(geometry.xyz + size * motion for motion in motions)])
    for place, (mode, motion) in enumerate(zip(chosen, motions, strict=True)):
        axes = figure.add_subplot(rows, columns, place + 1, projection="3d")
        assert isinstance(axes, Axes3D)
        _frame(axes, reach)
        _draw_shape(axes, geometry, expansion, motion, size)
        axes.set_title(_title(model, mode), fontsize=8.5, loc="center", y=1.0)
    scale = ScalarMappable(cmap=COLOUR_MAP)
    scale.set_clim(0, 1)
    figure.colorbar(
        scale,
        ax=figure.axes,
        location="bottom",
        shrink=0.35,
        aspect=40,
        pad=0.01,
        label=text("Displacement / largest [-]"),
    )
    return figure


def _draw_shape(
    axes: Axes3D, geometry: Geometry, expansion: Expansion, motion: Float[np.ndarray, "n 3"], size: float
) -> None:
    """Draw one real displacement field (largest value 1, drawn ``size`` m long) on three-dimensional axes."""
    from matplotlib import colormaps

    colours = colormaps[COLOUR_MAP]
    # by default the order of drawing follows the mean depth, which puts the structure at rest before the moved one
    axes.computed_zorder = False
    moved = geometry.xyz + size * motion
    amount = np.linalg.norm(motion, axis=1)
    chains = [[geometry.place(node) for node in line if node in geometry] for line in geometry.lines]
    sheets = [[geometry.place(node) for node in face if node in geometry] for face in geometry.faces]
    segments = [pair for chain in chains for pair in pairwise(chain)]
    rims = [pair for sheet in sheets for pair in zip(sheet, sheet[1:] + sheet[:1], strict=True)]
    if segments or rims:
        rest = np.array([geometry.xyz[list(pair)] for pair in segments + rims])
        axes.add_collection3d(Line3DCollection(rest, colors=FAINT, linewidths=0.6, zorder=1))
    else:
        axes.scatter(*geometry.xyz.T, s=3, color=FAINT, depthshade=False, zorder=1)
    if sheets:
        faces = Poly3DCollection([moved[sheet] for sheet in sheets], edgecolors="#333333", linewidths=0.25, zorder=2)
        faces.set_facecolor(colours([float(amount[sheet].mean()) for sheet in sheets]))
        axes.add_collection3d(faces)
    if segments:
        lines = Line3DCollection(
            np.array([moved[list(pair)] for pair in segments]), linewidths=1.0 if sheets else 1.6, zorder=3
        )
        lines.set_color(colours([float(amount[list(pair)].mean()) for pair in segments]))
        axes.add_collection3d(lines)
    if not sheets:
        seen, filled = expansion.measured, expansion.interpolated
        axes.scatter(*moved[seen].T, s=7, c=colours(amount[seen]), depthshade=False, zorder=4)
        axes.scatter(
            *moved[filled].T, s=7, facecolors="white", edgecolors=GREY, linewidths=0.5, depthshade=False, zorder=4
        )


def _frame(axes: Axes3D, points: Float[np.ndarray, "n 3"]) -> None:
    """Equal scales on all axes, no box, and the points filling the panel."""
    low, high = points.min(axis=0), points.max(axis=0)
    spans = np.maximum(high - low, 0.05 * float(np.max(high - low)) or 1.0)
    middle = (low + high) / 2
    limits: list[Any] = [(float(c - s / 2), float(c + s / 2)) for c, s in zip(middle, spans, strict=True)]
    axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2])
    axes.set_proj_type("ortho")
    axes.view_init(elev=24, azim=-58)
    axes.set_axis_off()
    axes.set_box_aspect(tuple(spans))
    across, up, _ = proj_transform(*points.T, axes.get_proj())
    inside = axes.transLimits.transform(np.column_stack([across, up]))
    axes.set_box_aspect(tuple(spans), zoom=float(0.92 / max(1e-9, 2 * np.max(np.abs(inside - 0.5)))))


@styled
def shapes_over_dofs(model: ModalModel, modes: Sequence[int] | None = None) -> Figure:
    """Draw mode shapes over the list of DOFs, for measurements without a geometry.

    Parameters
    ----------
    model : ModalModel
        Modes; complex shapes are made real.
    modes : sequence of int, optional
        Positions from 0; by default the first twelve.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no mode.

    Raises
    ------
    InputError
        If the model has no mode at a position.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> len(shapes_over_dofs(modal_model(), modes=[0]).axes)
    1
    """
    chosen = chosen_modes(model, modes, PER_FIGURE)
    columns = 2 if len(chosen) > 1 else 1
    rows = max(1, -(-len(chosen) // columns))
    figure = new_figure(1.5 * rows + 0.6)
    if not chosen:
        empty_note(figure.subplots(), text("no mode, no shape"))
        return figure
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    shapes = realise(model.shapes)
    places = np.arange(len(model.dofs))
    for panel, axes in enumerate(panels.flat):
        if panel >= len(chosen):
            axes.set_axis_off()
            continue
        values = shapes[:, chosen[panel]] / (np.max(np.abs(shapes[:, chosen[panel]])) or 1.0)
        axes.axhline(0, color=GREY, lw=0.6)
        axes.add_collection(
            LineCollection([[(x, 0), (x, y)] for x, y in zip(places, values)], colors=BLUE, linewidths=1.2)
        )
        axes.plot(places, values, "o", ms=2.5, color=BLUE)
        axes.set_title(_title(model, chosen[panel]), fontsize=8.5)
        axes.set_ylim(-1.15, 1.15)
        ticks, texts = thin_labels(dof_labels(model.dofs), 27)
        axes.set_xticks(ticks, texts, rotation=90, fontsize=6)
    label_last_rows(panels, len(chosen))
    figure.supxlabel("DOF", fontsize=9)
    figure.supylabel(text("Displacement / largest [-]"), fontsize=9)
    return figure
