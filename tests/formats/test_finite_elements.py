"""Modes and meshes of finite element programs, against what these programs themselves print."""

import random
from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema.data import Geometry
from ema.errors import InputError
from tests.fuzz import rst

PLATE = Path(__file__).parent / "l_plate.frd"
"""A free L-shaped steel plate solved by CalculiX: 73 hexahedra (C3D8I) of 25 x 25 x 6 mm on a grid of 12 by 9 without
its upper right part from the sixth column and the fifth row on; E 210 GPa, nu 0.3, 7850 kg/m3; `*FREQUENCY`, `*NODE
FILE`, `U`."""
PRINTED = (1887.705, 2612.158, 4056.773, 4960.210, 6863.018, 9320.194)
"""rad/s, the table of eigenvalues that CalculiX printed."""


def test_modes_of_calculix() -> None:
    contents = acquisition.read(PLATE, unit="m")
    (model,) = contents.modes
    assert model.natural_frequencies * 2 * np.pi == pytest.approx(PRINTED, rel=1e-6)
    assert len(contents.geometry.nodes) == 190 and np.ptp(contents.geometry.xyz, axis=0) == pytest.approx(
        [0.3, 0.225, 0.006]
    )
    assert model.scaling == "unscaled" and not contents.findings
    corner = contents.geometry.nodes[np.argmin(np.linalg.norm(contents.geometry.xyz, axis=1))]
    row = [str(dof) for dof in model.dofs].index(f"{corner}:+Z")
    # The first line of displacements of the first step.
    assert model.shapes[row, 0].real == pytest.approx(_written(corner), rel=1e-6)


def _written(node: int) -> float:
    """Third displacement of a node in the first step, by its columns."""
    lines = PLATE.read_text().splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith(" -4  DISP"))
    line = next(line for line in lines[first:] if line.startswith(" -1") and int(line[3:13]) == node)
    return float(line[37:49])


def test_the_shapes_are_orthogonal_and_move_no_centre_of_mass() -> None:
    """Free elastic modes: with equal masses per cell the lumped momentum vanishes."""
    contents = acquisition.read(PLATE, unit="m")
    (model,), geometry = contents.modes, contents.geometry
    shapes = model.shapes.real.reshape(-1, 3, 6)
    mass = np.zeros(190)
    cells = geometry.xyz[:, :2] / 0.025
    for i in range(12):
        for j in range(9):
            if not (i >= 5 and j >= 4):
                corners = np.all((cells >= [i - 0.01, j - 0.01]) & (cells <= [i + 1.01, j + 1.01]), axis=1)
                mass[corners] += 1 / 8
    gram = np.einsum("n,nam,nak->mk", mass, shapes, shapes)
    size = np.sqrt(np.diag(gram))
    assert np.abs(gram / np.outer(size, size) - np.eye(6)).max() < 0.05
    momentum = np.einsum("n,nam->am", mass, shapes)
    assert np.abs(momentum).max() < 0.02 * np.abs(shapes).max() * mass.sum()


def test_modes_of_ansys() -> None:
    """The solved beam that comes with the library: 321 nodes, 1 x 1 x 5, doubled bending frequencies."""
    examples = pytest.importorskip("ansys.mapdl.reader.examples")
    contents = acquisition.read(examples.rstfile)
    (model,) = contents.modes
    frequencies = model.natural_frequencies
    assert len(model.dofs) == 963 and len(frequencies) == 6
    assert frequencies[0] == pytest.approx(frequencies[1], rel=1e-9) == pytest.approx(7366.495, rel=1e-6)
    assert [finding.code for finding in contents.findings] == ["unit-unstated"]
    assert isinstance(contents.geometry, Geometry) and len(contents.geometry.faces) > 0


def test_a_unit_of_length() -> None:
    contents = acquisition.read(PLATE, unit="mm")
    assert np.ptp(contents.geometry.xyz[:, 0]) == pytest.approx(0.3e-3)
    with pytest.raises(InputError, match="not a unit of length"):
        acquisition.read(PLATE, unit="N")


def test_results_without_modes_are_refused(tmp_path: Path) -> None:
    text = PLATE.read_text()
    still = tmp_path / "static.frd"
    still.write_text("\n".join(line for line in text.splitlines() if "1PMODE" not in line) + "\n")
    with pytest.raises(InputError, match=r"the results are no modes.*FREQUENCY"):
        acquisition.read(still)


@pytest.mark.parametrize("part", [0.02, 0.2, 0.5, 0.8])
def test_a_torn_file_is_refused_or_loses_whole_modes_with_a_word(tmp_path: Path, part: float) -> None:
    whole = PLATE.read_bytes()
    torn = tmp_path / "torn.frd"
    torn.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(InputError, match=r"torn\.frd"):
        acquisition.read(torn)


def test_salvage_leaves_a_damaged_mode_out_and_names_it(tmp_path: Path) -> None:
    lines = PLATE.read_text().splitlines(keepends=True)
    third = [number for number, line in enumerate(lines) if line.startswith("    1PSTEP")][2]
    del lines[third + 20]  # the line of a node
    torn = tmp_path / "torn.frd"
    torn.write_text("".join(lines))
    with pytest.raises(InputError, match=r"torn\.frd: line 764: .* is none of a node.*salvage=true"):
        acquisition.read(torn, unit="m")
    contents = acquisition.read(torn, unit="m", salvage=True)
    (model,), (whole,) = contents.modes, acquisition.read(PLATE, unit="m").modes
    assert [(finding.code, finding.where) for finding in contents.findings] == [("salvaged", "torn.frd: line 764")]
    kept = [0, 1, 3, 4, 5]
    assert np.array_equal(model.poles, whole.poles[kept]) and np.array_equal(model.shapes, whole.shapes[:, kept])


def test_damaged_elements_are_left_out_where_salvage_is_asked_for(tmp_path: Path) -> None:
    torn = tmp_path / "torn.frd"
    torn.write_text(PLATE.read_text().replace(" -1         7    1    0    1\n", "", 1))
    with pytest.raises(InputError, match=r"is none of an element"):
        acquisition.read(torn, unit="m")
    contents = acquisition.read(torn, unit="m", salvage=True)
    assert contents.geometry.faces == () and "the mesh has no faces" in contents.findings[0].message
    assert len(contents.modes[0].poles) == 6


def test_layers_of_a_composite_are_elements_that_calculix_does_not_count(tmp_path: Path) -> None:
    layers = tmp_path / "layers.frd"
    layers.write_text(
        PLATE.read_text().replace("    3C                            73", "    3C                            70")
    )
    assert len(acquisition.read(layers, unit="m").geometry.faces) == 188


def test_parts_of_complex_modes_of_ansys_are_refused(tmp_path: Path) -> None:
    made = rst.model(random.Random(1))
    words = [np.frombuffer(data, "<i4").copy() for _, data in made.records()]
    heads = [one for (name, _), one in zip(made.records(), words, strict=True) if name == "set" and len(one) == 203]
    heads[0][2 + 18] = 1
    path = tmp_path / "damped.rst"
    path.write_bytes(b"".join(one.tobytes() for one in words))
    pytest.importorskip("ansys.mapdl.reader")
    with pytest.raises(InputError, match=r"damped\.rst: mode 1: it is a part of a complex mode"):
        acquisition.read(path)
