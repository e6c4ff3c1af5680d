"""Geometry and modes in arrays: what a file announces of their units and numbers, and what no structure has."""

from pathlib import Path

import h5py
import numpy as np
import pytest

import acquisition
from ema.errors import InputError, UnitError

XYZ = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 9.0]])
SHAPES = np.array([[1.0, 2.0], [-1.0, 0.5], [3.0, 4.0]])


def _hdf5(path: Path, units: dict[str, str] | None = None, **arrays: object) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values
            if units and name in units:
                file[name].attrs["unit"] = units[name]
    return path


def test_every_coordinate_has_its_own_unit(tmp_path: Path) -> None:
    rows = "".join(f"{number},{x},{y},{z}\n" for number, (x, y, z) in enumerate(XYZ, 1))
    for titles, factors in (
        ("Node,X [mm],Y [mm],Z [in]", (1e-3, 1e-3, 25.4e-3)),
        ("Node,X [mm],Y,Z", (1e-3, 1e-3, 1e-3)),
        ("Node,X,Y,Z [mm]", (1e-3, 1e-3, 1e-3)),
    ):
        (tmp_path / "a.csv").write_text(f"{titles}\n{rows}")
        contents = acquisition.read(tmp_path / "a.csv")
        np.testing.assert_allclose(contents.geometry.xyz, XYZ * factors, rtol=1e-14)
        assert contents.findings == ()
    (tmp_path / "a.csv").write_text(f"Node,X [mm],Y [in],Z\n{rows}")
    with pytest.raises(UnitError, match="states no unit"):
        acquisition.read(tmp_path / "a.csv")
    np.testing.assert_allclose(acquisition.read(tmp_path / "a.csv", unit="mm").geometry.xyz, 1e-3 * XYZ, rtol=1e-14)


def test_the_unit_of_an_array_of_coordinates(tmp_path: Path) -> None:
    contents = acquisition.read(_hdf5(tmp_path / "a.h5", {"xyz": "mm"}, xyz=XYZ), coordinates="xyz")
    np.testing.assert_allclose(contents.geometry.xyz, 1e-3 * XYZ, rtol=1e-14)
    assert contents.findings == ()


def test_nodes_and_lines_that_cannot_be_drawn_are_named(tmp_path: Path) -> None:
    holed = np.where(np.arange(3)[:, None] == 1, np.nan, XYZ)
    path = _hdf5(tmp_path / "a.h5", {"xyz": "m"}, xyz=holed, lines=[[1, 3, 0], [1, 2, 3]])
    contents = acquisition.read(path, coordinates="xyz", lines="lines")
    assert contents.geometry.nodes.tolist() == [1, 3] and contents.geometry.lines == ((1, 3),)
    assert [note.code for note in contents.findings] == ["not-finite", "unknown-node"]
    path = _hdf5(tmp_path / "b.h5", xyz=XYZ, lines=[[0, 1], [1, 2]])
    with pytest.raises(InputError, match="less than two nodes"):  # counted from 0
        acquisition.read(path, coordinates="xyz", lines="lines")


def test_a_node_number_is_whole(tmp_path: Path) -> None:
    """1.7 is not node 1."""
    (tmp_path / "a.csv").write_text("Node,X,Y,Z\n" + "".join(f"{n}.7,{n},0,0\n" for n in range(4)))
    with pytest.raises(InputError, match="no whole number"):
        acquisition.read(tmp_path / "a.csv")


def test_units_of_frequencies_and_damping(tmp_path: Path) -> None:
    units = {"f": "kHz", "zeta": "%"}
    path = _hdf5(tmp_path / "a.h5", units, phi=SHAPES, f=[0.01, 0.02], zeta=[1.0, 2.0], w=[60.0, 120.0])
    (model,) = acquisition.read(path, shapes="phi", natural_frequencies="f", damping_ratios="zeta").modes
    np.testing.assert_allclose(model.natural_frequencies, [10.0, 20.0], rtol=1e-12)
    np.testing.assert_allclose(model.damping_ratios, [0.01, 0.02], rtol=1e-12)
    path = _hdf5(tmp_path / "b.h5", {"w": "rad/s"}, phi=SHAPES, w=[60.0, 120.0])
    (model,) = acquisition.read(path, shapes="phi", natural_frequencies="w").modes
    np.testing.assert_allclose(model.natural_frequencies, np.array([60.0, 120.0]) / (2 * np.pi), rtol=1e-12)
    path = _hdf5(tmp_path / "c.h5", {"f": "mm"}, phi=SHAPES, f=[10.0, 20.0])
    with pytest.raises(UnitError, match="not the unit of frequency"):
        acquisition.read(path, shapes="phi", natural_frequencies="f")


@pytest.mark.parametrize(
    ("frequencies", "damping"),
    [
        ([10.0, 20.0], [1.0, 2.0]),
        ([10.0, -20.0], [0.1, 0.1]),
        ([10.0, np.nan], [0.1, 0.1]),
        ([10.0, 20.0], [0.1, -0.1]),
    ],
)
def test_what_no_mode_has_is_refused(tmp_path: Path, frequencies: list[float], damping: list[float]) -> None:
    """As in universal files; damping in % had made frequencies that are not a number."""
    path = _hdf5(tmp_path / "a.h5", phi=SHAPES)
    with pytest.raises(InputError, match="no mode of a structure"):
        acquisition.read(path, shapes="phi", natural_frequencies=frequencies, damping_ratios=damping)
