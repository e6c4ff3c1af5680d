"""From values at DOFs to displacements of points in space."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Complex, Float

from ema.data import Geometry, ModalModel
from ema.dof import Dof


@dataclass(frozen=True)
class Expansion:
    """Mode shapes on a geometry, in global axes.

    Parameters
    ----------
    displacement : shape (n, 3, mode); zero in directions and at nodes that nobody measured or filled.
    measured : nodes with at least one measured translation, shape (n,).
    interpolated : nodes filled from their neighbours, shape (n,).
    left_out : DOFs that cannot be placed: no such node, a scalar, or a rotation.
    """

    displacement: Complex[np.ndarray, "n 3 mode"]
    measured: Bool[np.ndarray, "n"]
    interpolated: Bool[np.ndarray, "n"]
    left_out: tuple[Dof, ...] = ()


def expand(model: ModalModel, geometry: Geometry, interpolate: bool = False) -> Expansion:
    """Displacements of all nodes of ``geometry`` in global axes, from the DOFs of ``model``.

    The directions measured at a node are solved together by least squares (least displacement where they leave a
    direction open), so skewed sensors, local axes and repeated directions need no special case.

    Parameters
    ----------
    interpolate : fill nodes without a measurement from their neighbours along lines and face edges; they are marked
        in ``Expansion.interpolated``.
    """
    at_node: dict[int, list[int]] = {}
    left_out = []
    for row, dof in enumerate(model.dofs):
        if dof.axis in ("X", "Y", "Z") and dof.node in geometry:
            at_node.setdefault(geometry.place(dof.node), []).append(row)
        else:
            left_out.append(dof)
    displacement = np.zeros((len(geometry.nodes), 3, model.shapes.shape[1]), complex)
    measured = np.zeros(len(geometry.nodes), bool)
    for place, rows in at_node.items():
        directions = np.array([geometry.direction(model.dofs[row]) for row in rows])
        displacement[place] = np.linalg.pinv(directions) @ model.shapes[rows]
        measured[place] = True
    interpolated = np.zeros(len(geometry.nodes), bool)
    if interpolate:
        interpolated = _fill(displacement, measured, geometry)
    return Expansion(displacement, measured, interpolated, tuple(left_out))


def _edges(geometry: Geometry) -> list[tuple[int, int, float]]:
    """Neighbouring nodes (as rows) along lines and around faces, with the distance between them in m."""
    pairs: set[tuple[int, int]] = set()
    for chain in [*geometry.lines, *(face + face[:1] for face in geometry.faces)]:
        places = [geometry.place(node) for node in chain if node in geometry]
        pairs |= {(min(a, b), max(a, b)) for a, b in pairwise(places) if a != b}
    return [(a, b, float(np.linalg.norm(geometry.xyz[a] - geometry.xyz[b]))) for a, b in sorted(pairs)]


def _fill(
    displacement: Complex[np.ndarray, "n 3 mode"], measured: Bool[np.ndarray, "n"], geometry: Geometry
) -> Bool[np.ndarray, "n"]:
    """Write into ``displacement`` the values at unmeasured nodes for which the sum over the edges of
    |difference|^2 / length is least: linear along a line, and constant beyond its last measured point."""
    laplacian: Float[np.ndarray, "n n"] = np.zeros((len(measured), len(measured)))
    for a, b, length in _edges(geometry):
        weight = 1 / max(length, 1e-12)
        laplacian[[a, b], [a, b]] += weight
        laplacian[[a, b], [b, a]] -= weight
    # only nodes that an edge path joins to a measured one can be filled
    reached = measured.copy()
    while (grown := reached | ((laplacian != 0) @ reached)).sum() > reached.sum():
        reached = grown
    open_nodes = np.flatnonzero(reached & ~measured)
    if len(open_nodes):
        known = displacement[measured].reshape(int(measured.sum()), -1)
        pull = -laplacian[np.ix_(open_nodes, np.flatnonzero(measured))] @ known
        solved = np.linalg.solve(laplacian[np.ix_(open_nodes, open_nodes)], pull)
        displacement[open_nodes] = solved.reshape(len(open_nodes), *displacement.shape[1:])
    return reached & ~measured
