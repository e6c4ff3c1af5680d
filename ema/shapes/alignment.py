"""Where the points of a test lie on a finite element model: scale, rotation and translation between their coordinates.

The points of a test are few and lie on the model; their numbers and coordinate axes are their own. Placements are found
by iterated closest points (Besl and McKay, IEEE PAMI 14, 1992, 239-256) from many rotations; the mode shapes tell apart
what the coordinates of a symmetric structure do not.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from ema.data import Finding, Geometry, ModalModel
from ema.dof import SCALAR, Dof
from ema.errors import InputError
from ema.shapes.correlation import mac

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

UNIT_RATIOS = (1.0, 1e-3, 1e3, 1e-2, 1e2, 0.0254, 1 / 0.0254, 0.3048, 1 / 0.3048)
"""Lengths of a model over those of the test that come from units: m, mm, cm, inches and feet."""
COVERED = 0.4
"""Part of the length of the model that the points of a test span at least, for a ratio of units to be considered."""
_ROOM = 1.03
"""The same at most: points are measured to a few per cent of the length of the structure."""
_ROTATIONS = 240
"""Random rotations from which a search starts, beside those between the principal axes: any rotation is within 43
degrees of one of them, half of all within 22."""
_COARSE = 8
"""Iterations of the search from each rotation, which only ranks them."""
_FINE = 60
"""Iterations of the best placements, which are followed to their end."""
_SHAKES = 30
"""Starts beside a placement, a tenth to three mesh widths away: of twelve draws of ten nodes of a plate, seven searches
ended at nodes beside the right ones without them, one with them.
"""
_POINTS = 150
"""Points of the test that the search from each rotation looks at."""
_BEST = 16
"""Placements that are followed to the end."""
_AS_NEAR = 1.2
"""Root mean square distance over the smallest one within which a placement counts as equally near."""
_SAME = 0.5
"""Displacement of the points, over the distance of neighbouring nodes of the model, within which two placements are
one: the same nodes are nearest to most points.
"""
_TURNED = np.radians(6)
"""Angle from which on they are two all the same: points on one line do not move when they turn about it."""
_HELD = 1e-6
"""Weight of the rotation before, over that of the points."""
_TOLD_APART = 0.02
"""Difference of the mean MAC of paired modes that tells two placements apart: noise of 3 % of a shape gives 0.001, and
symmetric structures differ by no more than their mesh."""
_OFF = 0.02
"""Root mean square distance over the extent of the points from which the test does not lie on the model."""


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """Coordinates of a test from those of a model: ``scale * rotation @ model + translation``.

    Parameters
    ----------
    scale : float
        Length of the test over that of the model.
    rotation : array of shape (3, 3)
        Directions of the test from those of the model.
    translation : array of shape (3,)
        Where the origin of the model lies in the test [m].
    test_nodes, model_nodes : integer array of shape (node,)
        Nodes of the test, and the nearest ones of the model.
    distances : array of shape (node,)
        Distance of these two [m].
    findings : tuple of Finding
        Points far from the model, a scale that is no ratio of units, a mirrored or an ambiguous placement.

    Examples
    --------
    >>> from ema.examples import geometry
    >>> align(geometry(), geometry()).distances.max()
    np.float64(0.0)
    """

    scale: float
    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    test_nodes: Int[np.ndarray, "node"]
    model_nodes: Int[np.ndarray, "node"]
    distances: Float[np.ndarray, "node"]
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class _Placement:
    """Test points from scaled model points: ``rotation @ model + translation``; root mean square distance [m]."""

    scale: float
    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]
    rms: float

    def into_model(self, points: Float[np.ndarray, "node 3"]) -> Float[np.ndarray, "node 3"]:
        """Test points in the scaled coordinates of the model."""
        return np.asarray((points - self.translation) @ self.rotation)


def align(test: Geometry, model: Geometry, *, modes: tuple[ModalModel, ModalModel] | None = None) -> Alignment:
    """Find the points of a test on a finite element model whose coordinates have another origin, axes and unit.

    Parameters
    ----------
    test : Geometry
        Points of the test [m]; they span at least 0.4 of the model.
    model : Geometry
        Nodes of the model, in any unit of length.
    modes : tuple of (ModalModel, ModalModel), optional
        Modes of the test and of the model: only nodes of the test with a measured DOF count, and of placements that
        are equally near the one whose shapes agree best is taken.

    Returns
    -------
    Alignment
        The placement, and the node of the model that is nearest to each node of the test.

    Raises
    ------
    InputError
        If test or model has fewer than two points, or a coordinate is not finite.

    References
    ----------
    Besl and McKay (1992): A method for registration of 3-D shapes.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> nodes = Geometry(np.arange(1, 61), rng.uniform(size=(60, 3)) * [400.0, 300.0, 50.0])
    >>> turned = nodes.xyz[::3] @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]) / 1000
    >>> alignment = align(Geometry(np.arange(101, 121), turned + [1, 2, 3]), nodes)
    >>> alignment.scale, alignment.model_nodes[:4]
    (0.001, array([ 1,  4,  7, 10]))
    """
    from scipy.spatial import cKDTree

    measured = test.nodes if modes is None else _measured(test, modes[0])
    points = test.xyz[[test.place(int(node)) for node in measured]]
    for geometry in (test, model):
        if not np.all(np.isfinite(geometry.xyz)):
            bad = geometry.nodes[~np.isfinite(geometry.xyz).all(axis=1)][0]
            raise InputError(
                "a coordinate is NaN or infinite",
                where=geometry.name,
                got=f"node {bad}",
                advice="correct this node, or leave it out of the geometry",
            )
    if len(points) < 2 or not np.ptp(points) > 0 or not np.ptp(model.xyz, axis=0).max(initial=0.0) > 0:
        raise InputError(
            "the points have no orientation",
            where=test.name,
            got=f"{len(points)} points of the test, {len(model.nodes)} nodes of the model",
            expected="two or more of each, in different places",
        )
    extent = _length(points)
    length = _length(model.xyz)
    placements = [one for scale in _scales(extent, length) for one in _placed(points, model.xyz, scale)]
    if not placements or min(one.rms for one in placements) > _OFF * extent:
        placements += _placed(points, model.xyz, extent / length)
    best = min(one.rms for one in placements)
    near = [one for one in placements if one.rms <= _AS_NEAR * best + 1e-6 * extent]
    chosen, findings = near[0], []
    if modes is not None and len(near) > 1:
        chosen, ambiguous = _by_shapes(near, test, model, measured, modes=modes)
        findings += ambiguous
    distances, rows = cKDTree(chosen.scale * model.xyz).query(chosen.into_model(points))
    result = Alignment(
        scale=chosen.scale,
        rotation=chosen.rotation,
        translation=chosen.translation,
        test_nodes=np.asarray(measured),
        model_nodes=model.nodes[rows],
        distances=distances,
    )
    findings += _doubts(result, chosen, points, model.xyz, where=test.name or model.name)
    return Alignment(**(vars(result) | {"findings": tuple(findings)}))


def on_test_dofs(model: ModalModel, alignment: Alignment, test: ModalModel, geometry: Geometry) -> ModalModel:
    """The modes of a model on the DOFs of a test: those of the nearest nodes, in the directions of the test.

    Parameters
    ----------
    model : ModalModel
        Modes of the model; a node has up to three translations in global directions.
    alignment : Alignment
        Where the points of the test lie on it.
    test : ModalModel
        Modes of the test; translations count.
    geometry : Geometry
        Points and directions of the test.

    Returns
    -------
    ModalModel
        Poles of the model, unscaled shapes on the DOFs of the test.

    Raises
    ------
    InputError
        If no DOF of the test is a translation at an aligned node.

    Examples
    --------
    >>> from ema.examples import geometry, modal_model
    >>> alignment = align(geometry(), geometry())
    >>> on_test_dofs(modal_model(), alignment, modal_model(), geometry()).dofs == modal_model().dofs
    True
    """
    row = {int(node): int(other) for node, other in zip(alignment.test_nodes, alignment.model_nodes, strict=True)}
    values = _motions(model)
    dofs = tuple(dof for dof in test.dofs if dof.node in row and row[dof.node] in values and _translation(dof))
    if not dofs:
        raise InputError(
            "no DOF of the test is on the model",
            where=test.name,
            got=", ".join(map(str, test.dofs[:4])),
            expected="translations at aligned nodes",
        )
    directions = np.array([geometry.direction(dof) for dof in dofs]) @ alignment.rotation
    shapes = np.array([np.tensordot(u, values[row[dof.node]], 1) for u, dof in zip(directions, dofs, strict=True)])
    empty = np.zeros((0, len(model.poles)), complex)
    return ModalModel(model.poles, shapes, dofs, empty, (), scaling="unscaled", name=model.name)


def _translation(dof: Dof) -> bool:
    return dof.direction != SCALAR and len(dof.axis) == 1


def _measured(test: Geometry, modes: ModalModel) -> Int[np.ndarray, "node"]:
    """Nodes of the test with a measured translation."""
    nodes = {dof.node for dof in modes.dofs if _translation(dof)}
    return np.array([node for node in test.nodes if int(node) in nodes], dtype=np.int64)


def _motions(model: ModalModel) -> dict[int, np.ndarray]:
    """Displacement (3, mode) of every node in global directions; what a model does not hold does not move."""
    values: dict[int, np.ndarray] = {}
    for dof, row in zip(model.dofs, model.shapes, strict=True):
        if _translation(dof):
            values.setdefault(dof.node, np.zeros((3, row.size), complex))["XYZ".index(dof.axis)] = dof.sign * row
    return values


def _length(points: Float[np.ndarray, "node 3"]) -> float:
    """Largest distance of two points, which no rotation changes."""
    from scipy.spatial import ConvexHull, QhullError
    from scipy.spatial.distance import pdist

    with suppress(QhullError, ValueError):  # points on one line or in one place have no hull
        points = points[ConvexHull(points, qhull_options="QJ").vertices]
    step = max(1, len(points) // 2000)
    return float(pdist(points[::step]).max())


def _scales(extent: float, length: float) -> list[float]:
    """Ratios of units at which the points fit on the model, the fullest coverage first."""
    covered = {ratio: extent / (ratio * length) for ratio in UNIT_RATIOS}
    fitting = [ratio for ratio, part in covered.items() if COVERED <= part <= _ROOM]
    return sorted(fitting, key=lambda ratio: -covered[ratio])


def _placed(points: Float[np.ndarray, "node 3"], nodes: Float[np.ndarray, "n 3"], scale: float) -> list[_Placement]:
    """Distinct placements of the points on the scaled model, the nearest first; the one that is there comes before
    others as near.
    """
    from scipy.spatial import cKDTree

    scaled = scale * nodes
    tree = cKDTree(scaled)
    spacing = float(np.median(tree.query(scaled, 2)[0][:, 1])) if len(scaled) > 1 else 0.0
    some = points[np.linspace(0, len(points) - 1, min(len(points), _POINTS)).round().astype(int)]
    starts = [_closest(some, tree, *start, _COARSE) for start in _starts(points, scaled)]
    order = np.argsort([one.rms for one in starts], kind="stable")[:_BEST]
    placements: list[_Placement] = []
    for index in sorted({0, *order.tolist()}):
        begun = starts[index]
        placement = _shaken(points, tree, _closest(points, tree, begun.rotation, begun.translation, _FINE), spacing)
        if all(_differ(placement, other, points, spacing) for other in placements):
            placements.append(_Placement(scale, placement.rotation, placement.translation, placement.rms))
    return sorted(placements, key=lambda one: one.rms)


def _starts(
    points: Float[np.ndarray, "node 3"], scaled: Float[np.ndarray, "n 3"]
) -> Iterator[tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]]:
    """Rotations with the translation that brings the boxes together; first of all, coordinates as they are."""
    from scipy.spatial.transform import Rotation

    yield np.eye(3), np.zeros(3)
    own, other = _axes(points), _axes(scaled)
    rotations = [own.T @ turn @ other for turn in Rotation.create_group("O").as_matrix()]
    rotations += list(Rotation.random(_ROTATIONS, random_state=np.random.default_rng(0)).as_matrix())
    middle = 0.5 * (points.max(axis=0) + points.min(axis=0))
    for rotation in rotations:
        turned = scaled @ rotation.T
        yield rotation, middle - 0.5 * (turned.max(axis=0) + turned.min(axis=0))


def _axes(points: Float[np.ndarray, "node 3"]) -> Float[np.ndarray, "3 3"]:
    """Principal axes as rows, right-handed."""
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)[2]
    axes[2] *= np.linalg.det(axes)
    return np.asarray(axes)


def _closest(
    points: Float[np.ndarray, "node 3"],
    tree: "cKDTree",
    rotation: Float[np.ndarray, "3 3"],
    translation: Float[np.ndarray, "3"],
    iterations: int,
) -> _Placement:
    """Iterated closest points: each test point goes to its nearest node, then all move rigidly (Kabsch 1976)."""
    before = np.full(len(points), -1)
    distances, rows = tree.query((points - translation) @ rotation)
    for _ in range(iterations):
        if np.array_equal(rows, before):
            break
        nearest = tree.data[rows]
        covariance = (points - points.mean(axis=0)).T @ (nearest - nearest.mean(axis=0))
        # About the line of a straight row of points nothing tells the rotation: it stays as it is.
        left, _, right = np.linalg.svd(covariance + _HELD * np.linalg.norm(covariance) * rotation)
        rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        translation = points.mean(axis=0) - rotation @ nearest.mean(axis=0)
        before = rows
        distances, rows = tree.query((points - translation) @ rotation)
    return _Placement(1.0, rotation, translation, float(np.sqrt(np.mean(distances**2))))


def _shaken(points: Float[np.ndarray, "node 3"], tree: "cKDTree", start: _Placement, spacing: float) -> _Placement:
    """The nearest placement around one: closest points stay where each has its own node, one mesh width beside too."""
    from scipy.spatial.transform import Rotation

    rng, best, middle = np.random.default_rng(1), start, points.mean(axis=0)
    extent = max(float(np.ptp(points, axis=0).max()), 1e-300)
    for _ in range(_SHAKES):
        size = spacing * 10 ** rng.uniform(-1, 0.5)
        turn = Rotation.from_rotvec(rng.normal(size=3) * size / extent).as_matrix()
        translation = middle + turn @ (best.translation - middle) + rng.normal(size=3) * size
        tried = _closest(points, tree, turn @ best.rotation, translation, _COARSE)
        best = tried if tried.rms < best.rms else best
    return _closest(points, tree, best.rotation, best.translation, _FINE) if best is not start else start


def _differ(one: _Placement, other: _Placement, points: Float[np.ndarray, "node 3"], spacing: float) -> bool:
    """Whether two placements put the points at other nodes, or turn their directions."""
    from scipy.spatial.transform import Rotation

    moved = np.sqrt(np.mean(np.sum((one.into_model(points) - other.into_model(points)) ** 2, axis=1)))
    turned = Rotation.from_matrix(one.rotation.T @ other.rotation).magnitude()
    return bool(moved > _SAME * spacing or turned > _TURNED)


def _by_shapes(
    near: list[_Placement],
    test: Geometry,
    model: Geometry,
    measured: Int[np.ndarray, "node"],
    *,
    modes: tuple[ModalModel, ModalModel],
) -> tuple[_Placement, list[Finding]]:
    """Of placements that are equally near, the one whose shapes agree best."""
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial import cKDTree

    points = test.xyz[[test.place(int(node)) for node in measured]]
    agreement = []
    for one in near:
        distances, rows = cKDTree(one.scale * model.xyz).query(one.into_model(points))
        alignment = Alignment(
            scale=one.scale,
            rotation=one.rotation,
            translation=one.translation,
            test_nodes=measured,
            model_nodes=model.nodes[rows],
            distances=distances,
        )
        table = np.nan_to_num(mac(modes[0], on_test_dofs(modes[1], alignment, modes[0], test)))
        agreement.append(float(table[linear_sum_assignment(table, maximize=True)].mean()))
    best = int(np.argmax(np.array(agreement) - _TOLD_APART * np.minimum(np.arange(len(near)), 1)))
    rivals = [value for index, value in enumerate(agreement) if index != best and value > agreement[best] - _TOLD_APART]
    if not rivals:
        return near[best], []
    return near[best], [
        Finding.of(
            "info",
            "symmetric-placement",
            test.name,
            "{count} placements of the points on the model are equally near, with shapes that agree "
            "equally well: the structure is symmetric, or too few modes tell them apart.",
            agreement[best],
            count=len(rivals) + 1,
        )
    ]


def _doubts(
    alignment: Alignment,
    chosen: _Placement,
    points: Float[np.ndarray, "node 3"],
    nodes: Float[np.ndarray, "n 3"],
    *,
    where: str,
) -> list[Finding]:
    """What speaks against a placement."""
    findings, extent = [], float(np.ptp(points, axis=0).max())
    straight = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] <= 1e-3 * extent
    if straight and not np.allclose(chosen.rotation, np.eye(3)):
        findings.append(
            Finding(
                "warning",
                "turns-about-line",
                where,
                "the points of the test lie on one line: only the shapes tell how the model is turned about it.",
                advice="Give the test the coordinates of the model, or add a point beside the line.",
            )
        )
    if alignment.scale not in UNIT_RATIOS:
        findings.append(
            Finding.of(
                "warning",
                "odd-scale",
                where,
                "the test is {scale} times as large as the model, which is no ratio of units.",
                alignment.scale,
                advice="Check the coordinates and the unit of both.",
                scale=f"{alignment.scale:.4g}",
            )
        )
    if chosen.rms > _OFF * extent:
        mirrored = min(one.rms for one in _placed(points, nodes * [-1.0, 1.0, 1.0], alignment.scale))
        hint = " Mirrored, they do: one coordinate has the wrong sign." if mirrored < 0.5 * chosen.rms else ""
        worst = int(np.argmax(alignment.distances))
        findings.append(
            Finding(
                "error",
                "points-off-model",
                where,
                f"the points of the test do not lie on the model: they are {chosen.rms:.3g} m away (root mean square), "
                f"node {alignment.test_nodes[worst]} {alignment.distances[worst]:.3g} m.{hint}",
                advice="Correct the coordinates of these nodes.",
                value=chosen.rms,
                limit=_OFF * extent,
            )
        )
    return findings
