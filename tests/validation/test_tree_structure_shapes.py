"""A branched structure with skewed local axes, and more shapes than frequencies.

Data: set 10 (ladisk/uff_widget): points with the angles of their local axes, 26 shapes of 43 points, 24 frequencies.
Row 0 of the point list is the reference accelerometer; the shapes belong to rows 1 ... 43.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from ema.data import Geometry, ModalModel, poles_from
from ema.dof import Dof
from ema.shapes import auto_mac, expand
from ema.show import mode_shapes


@pytest.fixture(scope="module")
def folder(datasets: Path) -> Path:
    return datasets / "10_tree_structure_shapes"


@pytest.fixture(scope="module")
def geometry(folder: Path) -> Geometry:
    table = pd.read_excel(folder / "points.xlsx", sheet_name="List2")
    systems = np.array([np.cos(np.radians(table[[f"x{i}", f"y{i}", f"z{i}"]].to_numpy()[:3])) for i in range(5)])
    branch = table["cs"].to_numpy(int)
    lines = tuple(tuple(int(node) for node in np.flatnonzero(branch == label)) for label in (1, 2, 3, 4))
    return Geometry(
        np.arange(len(table)), table[["X", "Y", "Z"]].to_numpy(float) / 1000, lines, axes=systems[branch], name="tree"
    )


@pytest.fixture(scope="module")
def tree(folder: Path) -> ModalModel:
    shapes, frequencies = (np.load(folder / name, allow_pickle=False) for name in ("shapes.npy", "nat-freq.npy"))
    flat = shapes.transpose(1, 0, 2).reshape(129, 26)[:, :24]
    dofs = tuple(Dof(node, direction) for node in range(1, 44) for direction in ("+X", "+Y", "+Z"))
    return ModalModel(
        poles_from(frequencies, np.full(24, 1e-3)),
        flat.astype(complex),
        dofs,
        np.ones((1, 24), complex),
        (Dof(0, "+Z"),),
        name="tree",
    )


def test_more_shapes_than_frequencies_are_noticed(folder: Path):
    """As a user meets it: without the shape checker of the test run."""
    script = (
        "import sys, numpy as np; from ema.data import ModalModel, poles_from; from ema.dof import Dof\n"
        "from ema.errors import InputError\n"
        "shapes, f = np.load(sys.argv[1] + '/shapes.npy').reshape(129, 26), np.load(sys.argv[1] + '/nat-freq.npy')\n"
        "dofs = tuple(Dof(n, d) for n in range(1, 44) for d in ('+X', '+Y', '+Z'))\n"
        "try: ModalModel(poles_from(f, 0 * f), shapes, dofs, np.ones((1, 26)), dofs[:1], name='tree')\n"
        "except InputError as error: print(error)\n"
    )
    told = subprocess.run([sys.executable, "-c", script, str(folder)], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == (
        "ModalModel.shapes: arrays and axes disagree; got 26 along mode, expected 24, as in poles"
    )


def test_local_axes_are_orthonormal(geometry: Geometry):
    assert geometry.axes is not None
    products = np.einsum("nij,nkj->nik", geometry.axes, geometry.axes)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=2e-3)


def test_every_point_is_placed_and_the_reference_is_not(tree: ModalModel, geometry: Geometry):
    found = expand(tree, geometry)
    assert found.left_out == ()
    assert found.measured.sum() == 43
    assert not found.measured[0]


@pytest.mark.parametrize("branch", [0, 1, 2, 3])
def test_branches_bend_and_do_not_stretch(tree: ModalModel, geometry: Geometry, branch: int):
    """In global axes the points of a slender branch move along it together; with wrong axes they would not."""
    nodes = list(geometry.lines[branch])
    along = geometry.xyz[nodes[-1]] - geometry.xyz[nodes[0]]
    along /= np.linalg.norm(along)
    motion = expand(tree, geometry).displacement[nodes].real
    axial = np.einsum("nim,i->nm", motion, along)
    across = motion - along[None, :, None] * axial[:, None, :]
    stretch = np.median(axial.std(axis=0) / np.sqrt(np.mean(np.sum(across**2, axis=1), axis=0)))
    assert stretch < 0.01


def test_shapes_are_distinct(tree: ModalModel):
    table = auto_mac(tree.shapes)
    np.testing.assert_allclose(np.diag(table), 1, atol=1e-12)
    assert np.median(table[~np.eye(24, dtype=bool)]) < 0.05


def test_shapes_are_drawn_on_the_branches(tree: ModalModel, geometry: Geometry):
    """Twelve panels, in each all pieces of the four branches."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    panels = [axes for axes in mode_shapes(tree, geometry).axes if axes.name == "3d"]
    assert [axes.get_title().split(":")[0] for axes in panels] == [str(mode) for mode in range(1, 13)]
    pieces = sum(len(line) - 1 for line in geometry.lines)
    for axes in panels:
        moved = [c for c in axes.collections if isinstance(c, Line3DCollection)][1]
        assert len(moved.get_colors()) == pieces
