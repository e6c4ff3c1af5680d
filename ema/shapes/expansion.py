"""From values at DOFs to displacements of points in space."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Complex

from ema.data import Geometry, ModalModel
from ema.dof import Dof


@dataclass(frozen=True)
class Expansion:
    """Mode shapes on a geometry, in global axes.

    Parameters
    ----------
    displacement : complex array of shape (n, 3, mode)
        Displacements of the nodes; zero in directions and at nodes that were neither measured nor interpolated.
    measured : boolean array of shape (n,)
        Nodes with at least one measured translation.
    interpolated : boolean array of shape (n,)
        Nodes filled from their neighbours.
    left_out : tuple of Dof, optional
        DOFs without a location: no such node, a scalar, or a rotation.

    Examples
    --------
    >>> from ema.examples import geometry, modal_model
    >>> expand(modal_model(), geometry()).displacement.shape
    (4, 3, 3)
    """

    displacement: Complex[np.ndarray, "n 3 mode"]
    measured: Bool[np.ndarray, "n"]
    interpolated: Bool[np.ndarray, "n"]
    left_out: tuple[Dof, ...] = ()


def expand(model: ModalModel, geometry: Geometry, interpolate: bool = False) -> Expansion:
    """Compute the displacements of all nodes of a geometry in global axes.

    The directions measured at a node are solved together by least squares (least displacement where they leave a
    direction open), so skewed sensors, local axes and repeated directions need no special case.

    Parameters
    ----------
    model : ModalModel
        Modes at DOFs.
    geometry : Geometry
        Where the nodes are.
    interpolate : bool, default False
        Fill nodes without a measurement from their neighbours along lines and face edges; they are marked in
        ``Expansion.interpolated``.

    Returns
    -------
    Expansion
        Displacements and where they come from.

    Examples
    --------
    >>> from ema.examples import geometry, modal_model
    >>> shapes = expand(modal_model(), geometry())
    >>> shapes.measured, shapes.left_out
    (array([ True,  True,  True,  True]), ())
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
    for node_row, rows in at_node.items():
        directions = np.array([geometry.direction(model.dofs[row]) for row in rows])
        displacement[node_row] = np.linalg.pinv(directions) @ model.shapes[rows]
        measured[node_row] = True
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
    from scipy.sparse import csr_array, diags_array
    from scipy.sparse.csgraph import connected_components
    from scipy.sparse.linalg import splu

    edges = _edges(geometry)
    if not edges:
        return np.zeros(len(measured), bool)
    first, second, length = np.array(edges).T
    ends = np.concatenate([first, second]).astype(int), np.concatenate([second, first]).astype(int)
    weight = np.tile(1 / np.maximum(length, 1e-12), 2)
    pulls = csr_array((weight, ends), shape=(len(measured), len(measured)))
    # only nodes that an edge path joins to a measured one can be filled
    part = connected_components(pulls, directed=False)[1]
    filled: np.ndarray = np.isin(part, part[measured]) & ~measured
    if filled.any():
        known = displacement[measured].reshape(int(measured.sum()), -1)
        own = diags_array(np.bincount(ends[0], weight, len(measured))[filled])
        solved = splu((own - pulls[filled][:, filled]).tocsc()).solve(pulls[filled][:, measured] @ known.view(float))
        displacement[filled] = np.ascontiguousarray(solved).view(complex).reshape(-1, *displacement.shape[1:])
    return filled
