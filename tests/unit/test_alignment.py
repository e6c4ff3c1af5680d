"""Points of a test on a finite element model: known placements are found again, doubtful ones are named."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import acquisition
from ema.data import Geometry, ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.shapes import Alignment, align, compare, mac, on_test_dofs

PLATE = Path(__file__).parents[1] / "formats" / "l_plate.frd"


def plate() -> tuple[Geometry, ModalModel]:
    contents = acquisition.read(PLATE, unit="m")
    return contents.geometry, contents.modes[0]


def measured(
    geometry: Geometry, model: ModalModel, rows: np.ndarray, *, unit: float, seed: int, error: float = 0.0
) -> tuple[Geometry, ModalModel, Rotation]:
    """Triaxial measurement at some nodes in axes of its own, numbered from 501, with ``error`` m of position."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=rng)
    points = turn.apply(geometry.xyz[rows] * unit) + rng.normal(size=3)
    points += error * rng.normal(size=points.shape)
    nodes = np.arange(501, 501 + len(rows))
    own = model.shapes.reshape(len(geometry.nodes), 3, -1)[rows]
    shapes = np.einsum("ab,nbm->nam", turn.as_matrix(), own)
    shapes = shapes + 0.02 * np.abs(shapes).max(axis=(0, 1)) * rng.normal(size=shapes.shape)
    dofs = tuple(Dof(int(node), direction) for node in nodes for direction in ("+X", "+Y", "+Z"))
    empty = np.zeros((0, len(model.poles)), complex)
    modes = ModalModel(model.poles, shapes.reshape(-1, len(model.poles)), dofs, empty, (), scaling="unscaled")
    return Geometry(nodes, points, name="test"), modes, turn


@pytest.mark.parametrize("unit", [1.0, 1e-3, 0.0254])
@pytest.mark.parametrize("seed", range(3))
def test_a_known_placement_is_found(unit: float, seed: int) -> None:
    geometry, model = plate()
    rows = np.sort(np.random.default_rng([seed, 1]).choice(190, 45, replace=False))
    # Corners are measured in every test.
    rows = np.union1d(rows, [int(np.argmin(geometry.xyz @ corner)) for corner in ([1, 1, 0], [-1, 1, 0], [1, -1, 0])])
    test, modes, turn = measured(geometry, model, rows, unit=unit, seed=seed, error=0.002 * unit)
    alignment = align(test, geometry, modes=(modes, model))
    assert alignment.scale == unit and not alignment.findings
    error = Rotation.from_matrix(alignment.rotation) * turn.inv()
    assert error.magnitude() < np.radians(3)
    compared = compare(modes, on_test_dofs(model, alignment, modes, test))
    assert list(compared.pairs) == [(mode, mode) for mode in range(6)]
    assert np.all(np.diag(compared.mac) > 0.97)


def rectangle(shapes: list) -> tuple[Geometry, ModalModel]:
    """A grid of 13 by 9 points on 1.2 m by 0.8 m with out-of-plane shapes of x and y in -1 ... 1."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-1, 1, 13), np.linspace(-1, 1, 9), indexing="ij"))
    nodes = np.arange(1, 118)
    motion = np.zeros((117, 3, len(shapes)))
    motion[:, 2] = np.array([shape(x, y) for shape in shapes]).T
    dofs = tuple(Dof(int(node), direction) for node in nodes for direction in ("+X", "+Y", "+Z"))
    count = len(shapes)
    poles = poles_from(np.arange(1.0, count + 1) * 100, np.zeros(count))
    model = ModalModel(
        poles, motion.reshape(-1, count).astype(complex), dofs, np.zeros((0, count), complex), (), scaling="unscaled"
    )
    return Geometry(nodes, np.stack([0.6 * x, 0.4 * y, 0 * x], axis=1), name="model"), model


@pytest.mark.parametrize("seed", range(4))
def test_shapes_tell_the_sides_of_a_symmetric_structure_apart(seed: int) -> None:
    """A rectangle fits in four placements; a heavier end, which only the shapes show, leaves one."""
    geometry, model = rectangle(
        [lambda x, y: x**2 + 0.7 * x, lambda x, y: x * y + 0.4 * y, lambda x, y: y**2 + 0.4 * y - 0.5 * x]
    )
    test, modes, _ = measured(geometry, model, np.arange(0, 117, 2), unit=1.0, seed=seed)
    alignment = align(test, geometry, modes=(modes, model))
    assert "symmetric-placement" not in [finding.code for finding in alignment.findings]
    assert np.array_equal(alignment.model_nodes, geometry.nodes[::2])
    assert np.all(np.diag(mac(modes, on_test_dofs(model, alignment, modes, test))) > 0.97)


def test_a_symmetric_structure_is_said_to_be_one_and_its_coordinates_are_kept() -> None:
    geometry, model = rectangle([lambda x, y: x**2 - 0.3, lambda x, y: x * y])
    alignment = align(geometry, geometry, modes=(model, model))
    assert np.array_equal(alignment.model_nodes, geometry.nodes) and np.allclose(alignment.rotation, np.eye(3))
    assert [finding.code for finding in alignment.findings] == ["symmetric-placement"]


def test_a_mirrored_coordinate_is_named() -> None:
    geometry, _ = plate()
    rng = np.random.default_rng(3)
    # A block on one leg: without it a plate is its own mirror image, turned over.
    block = Geometry(
        np.arange(1, 241),
        np.concatenate([geometry.xyz, [0.0, 0.0, 0.006] + rng.uniform(size=(50, 3)) * [0.1, 0.05, 0.08]]),
    )
    test = Geometry(block.nodes[::2], block.xyz[::2] * [-1.0, 1.0, 1.0], name="test")
    (finding,) = align(test, block).findings
    assert finding.code == "points-off-model" and "Mirrored, they do" in finding.message


def test_a_wrong_coordinate_is_named_with_its_node() -> None:
    geometry, _ = plate()
    xyz = geometry.xyz[::5].copy()
    xyz[7, 2] += 0.1
    (finding,) = align(Geometry(geometry.nodes[::5], xyz, name="test"), geometry).findings
    assert finding.code == "points-off-model" and f"node {geometry.nodes[::5][7]} " in finding.message


def test_a_scale_that_is_no_ratio_of_units_is_named() -> None:
    geometry, _ = plate()
    test = Geometry(geometry.nodes, geometry.xyz * 0.2, name="test")
    alignment = align(test, geometry)
    assert [finding.code for finding in alignment.findings] == ["odd-scale"]
    assert alignment.scale == pytest.approx(0.2, rel=1e-6)


def test_points_on_a_line_keep_their_coordinates() -> None:
    xyz = np.zeros((9, 3))
    xyz[:, 0] = np.linspace(0, 1, 9)
    line = Geometry(np.arange(1, 10), xyz)
    alignment = align(line, line)
    assert np.allclose(alignment.rotation, np.eye(3)) and not alignment.findings
    tilted = align(Geometry(np.arange(1, 10), xyz[:, [1, 0, 2]]), line)
    assert [finding.code for finding in tilted.findings] == ["turns-about-line"] and tilted.distances.max() < 1e-9


def test_one_point_has_no_orientation() -> None:
    geometry, _ = plate()
    with pytest.raises(InputError, match="no orientation"):
        align(Geometry(geometry.nodes[:1], geometry.xyz[:1]), geometry)
    with pytest.raises(InputError, match="no orientation"):
        align(geometry, Geometry(geometry.nodes[:2], np.ones((2, 3))))
    with pytest.raises(InputError, match=f"NaN or infinite; got node {geometry.nodes[3]}"):
        align(Geometry(geometry.nodes, np.where(np.arange(190)[:, None] == 3, np.nan, geometry.xyz)), geometry)


def test_a_test_of_rotations_alone_is_refused() -> None:
    geometry, model = plate()
    alignment = align(geometry, geometry)
    assert isinstance(alignment, Alignment)
    turned = ModalModel(
        model.poles[:1], np.ones((1, 1), complex), (Dof(1, "+RX"),), np.zeros((0, 1), complex), (), scaling="unscaled"
    )
    with pytest.raises(InputError, match="no DOF of the test is on the model"):
        on_test_dofs(model, alignment, turned, geometry)
