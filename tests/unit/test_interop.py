"""Objects of sdypy-EMA, pyFBS, pyOMA-2 and SDynPy, to and from ours.

The layouts are those of sdypy-EMA 0.31.0, pyFBS 1.0.7, pyOMA-2 1.4.3 and SDynPy 0.23.0, read from the installed packages.
With ``EMA_PEERS`` naming one environment or several (separated as in PATH) the packages that are found there are asked
themselves, each in a process of its own.
"""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ema import examples, interop, synthesis
from ema.data import FrfSet, Geometry, ModalModel
from ema.dof import Dof
from ema.errors import InputError


def test_importing_it_imports_none_of_them() -> None:
    code = (
        "import sys, ema.interop; ema.interop.from_sdynpy; print([m for m in sys.modules if m.split('.')[0].lower() in "
    )
    code += "('sdypy', 'pyfbs', 'pyoma2', 'sdynpy', 'xarray')])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


@pytest.fixture
def skewed() -> tuple[FrfSet, Geometry]:
    """FRFs at three points of which one is turned by 30 degrees about Z, with senses in both directions."""
    turned, plain = np.radians(30), np.eye(3)
    local = np.array([[np.cos(turned), np.sin(turned), 0], [-np.sin(turned), np.cos(turned), 0], [0, 0, 1]])
    points = Geometry(
        nodes=np.array([1, 2, 3]),
        xyz=np.array([[0, 0, 0], [0.5, 0, 0], [0.5, 0.2, 0.1]]),
        axes=np.array([plain, local, plain]),
    )
    random = np.random.default_rng(20)
    values = random.normal(size=(5, 4, 2)) + 1j * random.normal(size=(5, 4, 2))
    frfs = FrfSet.from_arrays(
        np.arange(1.0, 6.0),
        values,
        outputs=["1:+Z", "2:-X", "2:+Y", "3:-Y"],
        inputs=["1:+Z", "3:+X"],
        quantity="mobility",
    )
    return frfs, points


def test_pyfbs_positions_and_directions_are_those_of_the_structure(skewed: tuple[FrfSet, Geometry]) -> None:
    frfs, points = skewed
    frequencies, values, channels, impacts = interop.to_pyfbs(frfs, points)
    assert channels["Quantity"].unique().tolist() == ["Velocity"] and impacts["Quantity"].unique().tolist() == ["Force"]
    assert channels.loc[1, ["Direction_1", "Direction_2", "Direction_3"]].tolist() == pytest.approx(
        [-np.cos(np.pi / 6), -np.sin(np.pi / 6), 0]
    )
    back, places = interop.from_pyfbs(frequencies, values, channels, impacts)
    assert back.quantity == "mobility"
    assert np.array_equal(back.values, frfs.values)
    for old, new in zip(frfs.outputs + frfs.inputs, back.outputs + back.inputs, strict=True):
        assert points.direction(old) == pytest.approx(places.direction(new))
        assert points.xyz[points.place(old.node)] == pytest.approx(places.xyz[places.place(new.node)])


def test_pyfbs_tables_that_say_too_little_or_too_much_are_refused(skewed: tuple[FrfSet, Geometry]) -> None:
    frequencies, values, channels, impacts = interop.to_pyfbs(*skewed)
    with pytest.raises(InputError, match="df_imp: not a table of pyFBS; got no column Position_2"):
        interop.from_pyfbs(frequencies, values, channels, impacts.drop(columns="Position_2"))
    mixed = channels.assign(Quantity=["Velocity", "Velocity", "Acceleration", "Velocity"])
    with pytest.raises(InputError, match="the channels measure different quantities; got acceleration, velocity"):
        interop.from_pyfbs(frequencies, values, mixed, impacts)
    leaning = channels.assign(Direction_1=[0, 1, 1, 0], Direction_2=[0, 0, 1, -1], Direction_3=[1, 0, 0, 0])
    with pytest.raises(InputError, match="point 2: directions at a point that are neither along nor across"):
        interop.from_pyfbs(frequencies, values, leaning, impacts)
    with pytest.raises(InputError, match="the FRFs and their axes disagree"):
        interop.from_pyfbs(frequencies, values[:, :3], channels, impacts)


@pytest.mark.parametrize("kind", ["receptance", "mobility", "accelerance"])
def test_sdypy_frfs_round_trip(kind: str) -> None:
    frfs = replace(examples.frf_set(), quantity=kind)
    given = interop.to_sdypy(frfs, column=1)
    assert given["frf"].shape == (4, 201) and given["frf_form"] == kind
    back = interop.from_sdypy(SimpleNamespace(**given), outputs=frfs.outputs, force=frfs.inputs[1])
    assert np.array_equal(back.values, frfs.values[:, :, 1:2]) and back.outputs == frfs.outputs
    assert back.quantity == kind and back.inputs == frfs.inputs[1:]


def test_sdypy_modal_constants_are_the_residues_of_the_receptance() -> None:
    """Independently: the sum over modes that the documentation of the package states, A / (jw - p) + conjugate."""
    model = examples.modal_model()
    constants = model.residues()[::-1, :, 0].T  # modes from high to low, as people may pick them
    theirs = SimpleNamespace(nat_freq=model.natural_frequencies[::-1], nat_xi=model.damping_ratios[::-1], A=constants)
    ours = interop.modes_from_sdypy(theirs, outputs=model.dofs, force=model.inputs[0])
    lines = np.linspace(20, 120, 50)
    s = 2j * np.pi * lines[:, None, None]
    p = model.poles[::-1]
    stated = np.sum(constants[None] / (s - p) + constants.conj()[None] / (s - p.conj()), axis=2)
    assert synthesis.frfs(ours, lines, "receptance").values[:, :, 0] == pytest.approx(stated)


def test_sdypy_without_frfs_or_modes_is_refused() -> None:
    with pytest.raises(InputError, match="got a SimpleNamespace without frf, frf_form"):
        interop.from_sdypy(SimpleNamespace(freq=[1.0]))
    with pytest.raises(InputError, match="call its select_poles and get_constants first"):
        interop.modes_from_sdypy(SimpleNamespace(nat_freq=[1.0], nat_xi=[0.1]))
    with pytest.raises(InputError, match="got 3 DOFs, expected 4"):
        interop.from_sdypy(SimpleNamespace(**interop.to_sdypy(examples.frf_set())), outputs=["1", "2", "3"])
    with pytest.raises(InputError, match="unstated quantity"):
        interop.to_sdypy(replace(examples.frf_set(), quantity="unstated"))


def test_pyoma_results_round_trip_with_their_standard_deviations() -> None:
    model = examples.modal_model()
    given = interop.to_pyoma(model)
    assert np.max(np.abs(given["Phi"]), axis=0) == pytest.approx(np.ones(3))
    order = [2, 0, 1]
    theirs = SimpleNamespace(
        Fn=given["Fn"][order],
        Xi=given["Xi"][order],
        Phi=given["Phi"][:, order],
        Fn_std=np.array([0.3, 0.1, 0.2]),
        Xi_std=np.array([0.03, 0.01, 0.02]),
    )
    back = interop.from_pyoma(theirs, outputs=model.dofs)
    assert back.poles == pytest.approx(model.poles)
    assert np.sqrt(back.covariance[:, 0, 0]) == pytest.approx([0.1, 0.2, 0.3])
    assert np.sqrt(back.covariance[:, 1, 1]) == pytest.approx([0.01, 0.02, 0.03])
    assert back.scaling == "unscaled" and back.inputs == ()
    ratio = back.shapes / model.shapes
    assert ratio == pytest.approx(np.broadcast_to(ratio[:1], ratio.shape))
    with pytest.raises(InputError, match=r"without Xi, .*plain FDD has no damping"):
        interop.from_pyoma(SimpleNamespace(Fn=[1.0], Phi=[[1.0]], Xi=None))


def test_sdynpy_functions_in_any_order_and_their_files(tmp_path: Path) -> None:
    frfs = replace(examples.frf_set(), outputs=tuple(Dof.parse(text) for text in ("1:+Z", "2:-X", "3:+RY", "4")))
    array = interop.to_sdynpy(frfs)
    assert array["coordinate"]["direction"][:, 0, 0].tolist() == [3, -1, 5, 0]
    shuffled = array.ravel()[np.random.default_rng(3).permutation(array.size)]
    back = interop.from_sdynpy(shuffled, quantity="accelerance")
    assert isinstance(back, FrfSet)
    for row, output in enumerate(frfs.outputs):
        for column, input_ in enumerate(frfs.inputs):
            theirs = back.values[:, back.outputs.index(output), back.inputs.index(input_)]
            assert np.array_equal(theirs, frfs.values[:, row, column])
    np.savez(tmp_path / "frf.npz", data=array, function_type=4)
    loaded = interop.from_sdynpy(np.load(tmp_path / "frf.npz"), quantity="accelerance")
    assert isinstance(loaded, FrfSet) and np.array_equal(loaded.values, frfs.values)
    np.savez(tmp_path / "time.npz", data=array, function_type=1)
    with pytest.raises(InputError, match="function type 1"):
        interop.from_sdynpy(np.load(tmp_path / "time.npz"))
    with pytest.raises(InputError, match="got 7 functions of 7 pairs, expected 4 responses x 2 references"):
        interop.from_sdynpy(array.ravel()[1:])
    with pytest.raises(InputError, match="not FRFs or shapes of SDynPy"):
        interop.from_sdynpy(np.zeros(3))


def test_sdynpy_shapes_round_trip() -> None:
    model = examples.modal_model()
    array = interop.to_sdynpy(model)
    assert array["modal_mass"].tolist() == [1.0, 1.0, 1.0] and array["shape_matrix"].dtype == float
    back = interop.from_sdynpy(array[::-1])
    assert isinstance(back, ModalModel)
    assert back.poles == pytest.approx(model.poles) and back.dofs == model.dofs
    assert np.array_equal(back.shapes, model.shapes)
    complexes = interop.to_sdynpy(replace(model, shapes=model.shapes * (1 + 0.2j), scaling="unscaled"))
    assert complexes["shape_matrix"].dtype == complex and np.isnan(complexes["modal_mass"]).all()
    with pytest.raises(InputError, match="SDynPy has no parts"):
        interop.to_sdynpy(replace(model, dofs=(Dof(1, "+Z", "table"), *model.dofs[1:])))


# what each package is asked for in a process of its own: prints one line that begins with "agrees"
PEERS: dict[str, str] = {
    "sdypy": """
from sdypy import EMA
from ema.interop import from_sdypy, modes_from_sdypy, to_sdypy
truth = examples.modal_model()
frfs = synthesis.frfs(truth, 0.125 * np.arange(1, 1025), "receptance")
model = EMA.Model(**to_sdypy(frfs) | {"driving_point": 0}, pol_order_high=20)
assert np.array_equal(from_sdypy(model, outputs=frfs.outputs, force="1:+Z").values[:, :, 0], frfs.values[: len(model.freq), :, 0])
model.get_poles(show_progress=False)
model.select_closest_poles([40.0, 60.0, 90.0], f_window=5)
model.get_constants()
modes = modes_from_sdypy(model, outputs=frfs.outputs, force="1:+Z")
assert np.allclose(modes.natural_frequencies, truth.natural_frequencies, rtol=1e-3), modes.natural_frequencies
assert np.allclose(modes.residues()[:, :, 0], truth.residues()[:, :, 0], rtol=0.02, atol=2e-2 * abs(truth.residues()).max())
""",
    "pyfbs": """
import pyfbs
from ema.interop import from_pyfbs, to_pyfbs
tables = to_pyfbs(examples.frf_set(), examples.geometry())
assert np.array_equal(from_pyfbs(*tables)[0].values, examples.frf_set().values)
channels = tables[2].assign(Grouping=1)
point = channels.iloc[[0, 0]].assign(Description=["uz", "ry"])
reduction = pyfbs.interface.VPT(channels, None, point, point).ru  # of heave and pitch at the first point
assert np.allclose(abs(np.asarray(reduction, float)), [[1, 0], [1, 0.1], [1, 0.2], [1, 0.3]]), reduction
""",
    "pyoma2": """
from pyoma2.algorithms.data.result import EFDDResult
from ema.interop import from_pyoma, to_pyoma
model = examples.modal_model()
assert np.allclose(from_pyoma(EFDDResult(**to_pyoma(model))).poles, model.poles)
""",
    "sdynpy": """
import sdynpy, tempfile, os
from ema.interop import from_sdynpy, to_sdynpy
frfs, model = examples.frf_set(), examples.modal_model()
theirs = to_sdynpy(frfs).view(sdynpy.data.TransferFunctionArray)
assert str(theirs.response_coordinate[1, 0]) == "2Z+", str(theirs.response_coordinate[1, 0])
assert np.array_equal(from_sdynpy(theirs, quantity="accelerance").values, frfs.values)
path = os.path.join(tempfile.mkdtemp(), "frf.npz")
theirs.save(path)
assert np.array_equal(from_sdynpy(np.load(path), quantity="accelerance").values, frfs.values)
shapes = to_sdynpy(model).view(sdynpy.shape.ShapeArray)
assert np.allclose(sdynpy.shape.mac(shapes, shapes).diagonal(), 1)
assert np.array_equal(from_sdynpy(shapes).shapes, model.shapes)
""",
}


if os.environ.get("EMA_PEERS"):  # the packages themselves are no part of the suite

    @pytest.mark.parametrize("package", PEERS)
    def test_the_packages_themselves_agree(package: str, root: Path) -> None:
        found = [
            place
            for place in os.environ.get("EMA_PEERS", "").split(os.pathsep)
            for _ in Path(place).glob(f"[Ll]ib*/**/site-packages/{package}")
            if place
        ]
        if not found:
            pytest.skip(f"no environment of EMA_PEERS holds {package}")
        place = found[0]
        python = next(one for one in (Path(place) / "bin/python", Path(place) / "Scripts/python.exe") if one.exists())
        # ours is found behind theirs: what they pin wins
        paths = [str(root), *(entry for entry in sys.path if entry.endswith("site-packages"))]
        code = f"import sys; sys.path += {paths!r}\nimport numpy as np\nfrom ema import examples, synthesis\n{PEERS[package]}\nprint('agrees')"
        environment = os.environ | {"QT_QPA_PLATFORM": "offscreen", "MPLBACKEND": "agg", "OMP_NUM_THREADS": "1"}
        done = subprocess.run([str(python), "-c", code], capture_output=True, text=True, env=environment, timeout=300)
        assert done.returncode == 0 and done.stdout.endswith("agrees\n"), done.stderr[-2000:]


def test_xarray_keeps_axes_units_and_values() -> None:
    pytest.importorskip("xarray")
    noisy = examples.frf_set(0.01)
    frfs = replace(noisy, coherence=np.full(noisy.values.shape, 0.9))
    array = interop.to_xarray(frfs)
    assert array.dims == ("frequency", "output", "input") and array.attrs["units"] == "(m/s^2)/N"
    assert array.frequency.attrs["units"] == "Hz" and array.coherence.dims == array.dims
    column = array.sel(output="3:+Z", input="1:+Z")
    assert np.array_equal(column.values, frfs.values[:, 2, 0])
    modes: Any = interop.to_xarray(examples.modal_model())
    assert modes["shape"].sel(dof="2:+Z", mode=3).item() == examples.modal_model().shapes[1, 2]
    record: Any = interop.to_xarray(examples.recording())
    assert record.sel(channel="hammer").units.item() == "N" and record.time.attrs["units"] == "s"
    chart: Any = interop.to_xarray(examples.modal_map())
    assert chart.frequency_std.dims == ("force_level", "normal_force") and chart.frequency.attrs["units"] == "Hz"
    unscaled = interop.to_xarray(replace(frfs, unit="unstated"))
    assert unscaled.attrs["units"] == ""  # no unit that a program would take for one
