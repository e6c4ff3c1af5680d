"""From values at DOFs to displacements of points in space."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Complex

from ema.data import Geometry, ModalModel
from ema.dof import Dof, match
from ema.errors import InputError

_ALIKE = 1e3
"""Condition number of the shapes at the measured DOFs above which their combinations are refused: errors of a measured
shape grow by up to this factor. With 100, modes that differ at a tenth of the points are refused; with 1e4, an error of
1 % may become a hundred times the shape."""


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


def expand_by_modes(test: ModalModel, model: ModalModel, modes: "list[int] | None" = None) -> ModalModel:
    """Expand measured shapes to all DOFs of a model, as the combinations of its modes that fit them best.

    Each measured shape is replaced by ``P c`` with ``c = pinv(P_m) u``: P are the shapes of the model, P_m their rows
    at the measured DOFs, u the measured shape. What the modes of the model cannot combine is lost, so compare the
    expanded shapes with the measured ones by ``ema.shapes.mac``.

    Parameters
    ----------
    test : ModalModel
        Measured modes.
    model : ModalModel
        Modes of a model with more DOFs, the measured ones among them (see ``ema.shapes.align``, ``on_test_dofs``).
    modes : list of int, optional
        Positions of the modes of the model that are combined; all by default.

    Returns
    -------
    ModalModel
        The measured modes with shapes at the DOFs of the model; the uncertainty of the shapes is not carried over.

    Raises
    ------
    InputError
        If fewer DOFs are shared than modes are combined, the modes look alike at the shared DOFs, or a position is that
        of no mode.

    References
    ----------
    .. [1] System equivalent reduction expansion process: O'Callahan, Avitabile and Riemer (1989), Proc. IMAC VII, 29.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ema.examples import modal_model
    >>> model = modal_model()
    >>> test = replace(model, shapes=model.shapes[:3], dofs=model.dofs[:3])
    >>> expand_by_modes(test, model).shapes.shape
    (4, 3)
    """
    chosen = list(range(len(model.poles))) if modes is None else list(modes)
    if not chosen or not all(0 <= mode < len(model.poles) for mode in chosen):
        raise InputError(
            "these are no positions of modes of the model",
            where=test.name,
            got=chosen,
            expected=f"one or more of 0 to {len(model.poles) - 1}",
        )
    pairs = match(test.dofs, model.dofs)
    if len(pairs) < len(chosen):
        raise InputError(
            "too few DOFs are shared to combine so many modes",
            where=test.name,
            got=f"{len(pairs)} shared DOFs, {len(chosen)} modes",
            expected="at least as many DOFs as modes",
            advice="choose fewer modes, or map the points first with ema.shapes.align",
        )
    rows, columns, signs = (np.array(each) for each in zip(*pairs, strict=True))
    basis = signs[:, None] * model.shapes[columns][:, chosen]
    condition = float(np.linalg.cond(basis))
    if condition > _ALIKE:
        raise InputError(
            "modes of the model look alike at the measured DOFs",
            where=test.name,
            got=f"condition number {condition:.3g}",
            expected=f"below {_ALIKE:g}",
            advice="choose fewer modes, or measure more points",
        )
    shapes = model.shapes[:, chosen] @ (np.linalg.pinv(basis) @ test.shapes[rows])
    return replace(test, shapes=shapes, dofs=model.dofs, uncertainty=None, residuals=None)


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
