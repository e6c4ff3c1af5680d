"""The measured points in space, with their numbers, and an arrow for every measured direction."""

from collections.abc import Sequence
from itertools import pairwise
from typing import cast

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from ema.data import Geometry
from ema.dof import SCALAR, Dof
from ema.errors import InputError
from ema.show.selection import check_located
from ema.show.shapes import _frame
from ema.show.style import FAINT, GREY, styled

_LABELLED = 120
"""Points up to which every one has its number; of more, every second, third ... one has."""


@styled
def geometry(
    geometry: Geometry, responses: Sequence[Dof] = (), references: Sequence[Dof] = (), *, title: str = ""
) -> Figure:
    """Draw the points of a structure with numbers, arrows along the measured directions, the axes, and the extent in m.

    Parameters
    ----------
    geometry : Geometry
        Points [m], with the lines and faces between them.
    responses, references : sequence of Dof, optional
        Measured directions of responses and forces; those without a direction or without a point are not drawn.
    title : str, optional
        Above the picture; by default the name of the geometry.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    InputError
        If the geometry has no points, or coordinates are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> bar = Geometry(np.array([1, 2]), np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]), ((1, 2),))
    >>> figure = geometry(bar, [Dof(2, "+Z")], [Dof(1, "-Z")])
    >>> figure.texts[-1].get_text()
    'extent: 0.5 m x 0 m x 0 m'
    """
    if not len(geometry.nodes):
        raise InputError("a geometry without points cannot be drawn", where=geometry.name, expected="one node or more")
    check_located(geometry)
    sides = np.ptp(geometry.xyz, axis=0)
    arrow = 0.12 * (float(sides.max()) or 1.0)
    figure = Figure(figsize=(9, 5))
    axes = cast(Axes3D, figure.add_axes((0.02, 0.06, 0.96, 0.84), projection="3d"))
    axes.computed_zorder = False
    pairs = [pair for line in geometry.lines for pair in pairwise(line)]
    pairs = [pair for pair in pairs if pair[0] in geometry and pair[1] in geometry]
    if pairs:
        ends = np.array([[geometry.xyz[geometry.place(node)] for node in pair] for pair in pairs])
        axes.add_collection3d(Line3DCollection(ends, colors=GREY, linewidths=0.8, zorder=1))
    sheets = [[geometry.place(node) for node in face] for face in geometry.faces if all(n in geometry for n in face)]
    if sheets:
        faces = Poly3DCollection([geometry.xyz[sheet] for sheet in sheets], edgecolors=FAINT, linewidths=0.5, zorder=0)
        faces.set_facecolor((0.93, 0.94, 0.96, 0.6))
        axes.add_collection3d(faces)
    axes.scatter(*geometry.xyz.T, s=8, color="#333333", depthshade=False, zorder=2)
    every = -(-len(geometry.nodes) // _LABELLED)
    for node, point in list(zip(geometry.nodes, geometry.xyz, strict=True))[::every]:
        axes.text(*point, f" {int(node)}", fontsize=7, color="#333333", zorder=3)
    drawn = [geometry.xyz]
    for dofs, colour, label in ((references, _FORCE, "force"), (responses, _RESPONSE, "response")):
        placed = [dof for dof in dict.fromkeys(dofs) if dof.node in geometry and dof.direction != SCALAR]
        if not placed:
            continue
        starts = np.array([geometry.xyz[geometry.place(dof.node)] for dof in placed])
        along = arrow * np.array([geometry.direction(dof) for dof in placed])
        # a force is drawn towards its point, a response away from it
        starts = starts - along if label == "force" else starts
        axes.quiver(*starts.T, *along.T, color=colour, linewidth=1.6, arrow_length_ratio=0.3, label=label, zorder=4)
        drawn += [starts, starts + along]
    corner = np.min(np.vstack(drawn), axis=0) - 0.6 * arrow
    for axis, name in zip(np.eye(3), "xyz", strict=True):
        axes.quiver(*corner, *(0.7 * arrow * axis), color=GREY, linewidth=0.8, arrow_length_ratio=0.25)
        axes.text(*(corner + 0.85 * arrow * axis), name, fontsize=8, color=GREY, ha="center", va="center")
    _frame(axes, np.vstack([*drawn, corner[None]]))
    if len(drawn) > 1:
        axes.legend(loc="upper right", frameon=False)
    if title or geometry.name:
        figure.suptitle(title or geometry.name)
    size = " x ".join(f"{side:.4g} m" for side in sides)
    figure.text(0.5, 0.02, f"extent: {size}", ha="center")
    return figure


_RESPONSE, _FORCE = "#0072b2", "#d55e00"
"""Blue and vermilion of the palette of Okabe and Ito, which colour-blind readers tell apart."""
