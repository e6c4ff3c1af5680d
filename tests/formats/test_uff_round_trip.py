"""What is written as a universal file is read back, by us and by pyuff, and the reverse."""

import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.files import uff
from ema.data import FrfSet
from ema.dof import Dof
from ema.errors import FailureError, InputError
from tests.formats import nouns

with warnings.catch_warnings():
    import pyuff


@pytest.fixture(params=[False, True], ids=["text", "binary"])
def binary(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


def test_frfs_with_signs_coherence_and_units(tmp_path: Path, binary: bool) -> None:
    frfs = nouns.frf_set()
    acquisition.write(tmp_path / "a.uff", frfs, binary=binary)
    contents = acquisition.read(tmp_path / "a.uff")
    (read,) = contents.frfs
    assert contents.findings == ()
    assert (read.outputs, read.inputs) == (frfs.outputs, frfs.inputs)
    assert (read.quantity, read.unit) == ("accelerance", "(m/s^2)/N")
    np.testing.assert_array_equal(read.frequencies, frfs.frequencies)
    np.testing.assert_allclose(read.values, frfs.values, rtol=0 if binary else 1e-12)
    assert read.coherence is not None
    np.testing.assert_allclose(read.coherence, frfs.coherence, rtol=0 if binary else 1e-12)


@pytest.mark.parametrize(
    ("quantity", "unit"),
    [("receptance", "m/N"), ("mobility", "(m/s)/N"), ("accelerance", "unstated"), ("unstated", "unstated")],
)
def test_every_kind_of_frf_keeps_its_quantity_and_unit(tmp_path: Path, quantity: str, unit: str) -> None:
    frfs = nouns.frf_set(quantity=quantity, unit=unit)
    acquisition.write(tmp_path / "a.uff", frfs)
    (read,) = acquisition.read(tmp_path / "a.uff").frfs
    assert (read.quantity, read.unit) == (quantity, unit)
    np.testing.assert_allclose(read.values, frfs.values, rtol=1e-12)


def test_uneven_frequencies(tmp_path: Path, binary: bool) -> None:
    frfs = replace(nouns.frf_set(), frequencies=np.cumsum(np.linspace(0.1, 2, 101)))
    acquisition.write(tmp_path / "a.uff", frfs, binary=binary)
    (read,) = acquisition.read(tmp_path / "a.uff").frfs
    np.testing.assert_allclose(read.frequencies, frfs.frequencies, rtol=1e-15 if binary else 1e-5)
    np.testing.assert_allclose(read.values, frfs.values, rtol=1e-12)


@pytest.mark.parametrize("rate", [51200.0, 44100.0, 65536.0, 25600.0, 1000.0, 333.25])
def test_recordings_with_their_sampling_rate(tmp_path: Path, binary: bool, rate: float) -> None:
    first, second = nouns.recording(rate), replace(nouns.recording(rate, seed=9), name="take 2")
    acquisition.write(tmp_path / "a.uff", first, second, binary=binary)
    read = acquisition.read(tmp_path / "a.uff").recordings
    assert len(read) == 2
    for found, truth in zip(read, (first, second), strict=True):
        assert found.sampling_rate == pytest.approx(rate, rel=1e-7)
        assert found.channels == truth.channels
        np.testing.assert_allclose(found.signals, truth.signals, rtol=0 if binary else 1e-12)


def test_single_precision_stays_single(tmp_path: Path) -> None:
    record = nouns.recording(dtype=np.float32)
    acquisition.write(tmp_path / "a.uff", record, binary=True)
    (read,) = acquisition.read(tmp_path / "a.uff").recordings
    assert read.signals.dtype == np.float32
    np.testing.assert_array_equal(read.signals, record.signals)


def test_geometry_with_local_axes(tmp_path: Path) -> None:
    geometry = nouns.geometry()
    acquisition.write(tmp_path / "a.uff", geometry)
    contents = acquisition.read(tmp_path / "a.uff")
    read = contents.geometry
    assert read is not None
    assert contents.findings == ()
    np.testing.assert_array_equal(read.nodes, geometry.nodes)
    np.testing.assert_array_equal(read.xyz, geometry.xyz)
    np.testing.assert_allclose(read.axes, geometry.axes)
    assert (read.lines, read.faces) == (geometry.lines, geometry.faces)


def test_a_long_trace_line_is_split_and_stays_connected(tmp_path: Path) -> None:
    nodes = np.arange(1, 601)
    geometry = replace(
        nouns.geometry(), nodes=nodes, xyz=np.ones((600, 3)), lines=(tuple(range(1, 601)),), faces=(), axes=None
    )
    acquisition.write(tmp_path / "a.uff", geometry)
    read = acquisition.read(tmp_path / "a.uff").geometry
    assert read is not None
    assert {pair for line in read.lines for pair in pairwise(line)} == {(k, k + 1) for k in range(1, 600)}


@pytest.mark.parametrize("real", [False, True], ids=["complex", "real"])
def test_modes_rebuild_the_same_residues(tmp_path: Path, real: bool) -> None:
    modes = nouns.modal_model(real)
    acquisition.write(tmp_path / "a.uff", modes)
    (read,) = acquisition.read(tmp_path / "a.uff").modes
    assert read.dofs == modes.dofs
    assert read.scaling == "unit modal mass"
    np.testing.assert_allclose(read.natural_frequencies, modes.natural_frequencies, rtol=1e-6)
    np.testing.assert_allclose(read.damping_ratios, modes.damping_ratios, rtol=1e-5)
    rebuilt = read.residues()[:, :, [read.inputs.index(dof) for dof in modes.inputs]]
    np.testing.assert_allclose(rebuilt, modes.residues(), rtol=1e-4, atol=1e-9)


def test_two_models_on_the_same_nodes_stay_apart(tmp_path: Path) -> None:
    acquisition.write(tmp_path / "a.uff", nouns.modal_model(), nouns.modal_model())
    assert [len(model.poles) for model in acquisition.read(tmp_path / "a.uff").modes] == [2, 2]


def test_equal_nodes_of_two_parts_are_refused_with_both_names(tmp_path: Path) -> None:
    modes = nouns.modal_model()
    dofs = (Dof(1, "+Z", "table"), Dof(1, "-Z", "beam"), *(Dof(node, "+Z") for node in range(2, len(modes.dofs))))
    modes = replace(modes, dofs=dofs, inputs=dofs[: len(modes.inputs)])
    with pytest.raises(InputError, match=r"two DOFs are one in data set 55.*got table:1:[+]Z and beam:1:-Z"):
        acquisition.write(tmp_path / "a.uff", modes)


def test_a_negative_direction_turns_the_sign_of_the_shape(tmp_path: Path) -> None:
    modes = nouns.modal_model()
    turned = replace(
        modes, dofs=(Dof(1, "-Z"), *modes.dofs[1:]), shapes=modes.shapes * np.array([[-1], [1], [1], [1], [1]])
    )
    acquisition.write(tmp_path / "a.uff", turned)
    (read,) = acquisition.read(tmp_path / "a.uff").modes
    assert read.dofs[0] == Dof(1, "+Z")
    np.testing.assert_allclose(abs(read.shapes), abs(modes.shapes), rtol=1e-4)


def test_contents_are_written_as_they_were_read(tmp_path: Path, binary: bool) -> None:
    acquisition.write(tmp_path / "a.uff", nouns.geometry(), nouns.modal_model(), nouns.frf_set(), nouns.recording())
    first = acquisition.read(tmp_path / "a.uff")
    acquisition.write(tmp_path / "b.uff", first, binary=binary)
    second = acquisition.read(tmp_path / "b.uff")
    np.testing.assert_allclose(second.frfs[0].values, first.frfs[0].values, rtol=1e-12)
    np.testing.assert_allclose(second.recordings[0].signals, first.recordings[0].signals, rtol=1e-12)
    np.testing.assert_array_equal(second.geometry.xyz, first.geometry.xyz)
    np.testing.assert_allclose(second.modes[0].shapes, first.modes[0].shapes, rtol=1e-4)


def test_pyuff_reads_what_we_write(tmp_path: Path, binary: bool) -> None:
    frfs, record, geometry, modes = nouns.frf_set(), nouns.recording(), nouns.geometry(), nouns.modal_model()
    path = tmp_path / "a.uff"
    acquisition.write(path, geometry, modes, frfs, record, binary=binary)
    sets = pyuff.UFF(str(path)).read_sets()
    by_type: dict[int, list] = {}
    for found in sets:
        by_type.setdefault(int(found["type"]), []).append(found)
    np.testing.assert_array_equal(by_type[2411][0]["node_nums"], geometry.nodes)
    np.testing.assert_array_equal(by_type[2411][0]["z"], geometry.xyz[:, 2])
    np.testing.assert_array_equal(by_type[82][0]["nodes"], [1, 2, 3])
    np.testing.assert_allclose(by_type[2420][0]["CS_matrices"][1][:3], geometry.axes[2])
    assert by_type[164][0]["length"] == 1.0
    assert [m["eig"] for m in by_type[55]] == pytest.approx(list(modes.poles), rel=1e-6)
    np.testing.assert_allclose(by_type[55][0]["r3"][0], modes.shapes[0, 0], rtol=1e-5)
    functions = by_type[58]
    first = next(f for f in functions if f["func_type"] == 4)
    assert (first["rsp_node"], first["rsp_dir"], first["ref_node"], first["ref_dir"]) == (1, 3, 7, -1)
    assert (first["ordinate_spec_data_type"], first["orddenom_spec_data_type"]) == (12, 13)
    np.testing.assert_allclose(first["data"], frfs.values[:, 0, 0], rtol=1e-12)
    np.testing.assert_array_equal(first["x"], frfs.frequencies)
    hammer = next(f for f in functions if f["func_type"] == 1)
    assert (hammer["id1"], hammer["rsp_node"], hammer["rsp_dir"], hammer["ordinate_spec_data_type"]) == (
        "hammer",
        3,
        -3,
        13,
    )
    np.testing.assert_allclose(hammer["data"], record.signals[0], rtol=1e-12)


def _pyuff_file(path: Path, sets: list[dict]) -> None:
    file = pyuff.UFF(str(path))
    for one in sets:
        file.write_sets(one, "add")


@pytest.mark.parametrize("even", [1, 0], ids=["even", "uneven"])
@pytest.mark.parametrize("kind", ["complex", "real"])
def test_we_read_what_pyuff_writes(tmp_path: Path, binary: bool, even: int, kind: str) -> None:
    random = np.random.default_rng(0)
    x = 0.5 * np.arange(47)
    data = [random.normal(size=47) + (1j * random.normal(size=47) if kind == "complex" else 0) for _ in range(3)]
    common = {
        "type": 58,
        "binary": int(binary),
        "func_type": 4 if kind == "complex" else 1,
        "x": x,
        "rsp_node": 2,
        "rsp_dir": -3,
        "ref_node": 5,
        "ref_dir": 1,
        "abscissa_spacing": even,
        "abscissa_spec_data_type": 18 if kind == "complex" else 17,
        "ordinate_spec_data_type": 12,
        "orddenom_spec_data_type": 13,
    }
    _pyuff_file(
        tmp_path / "p.uff", [{**common, "data": y, "rsp_node": k + 1, "id1": f"f{k}"} for k, y in enumerate(data)]
    )
    theirs = pyuff.UFF(str(tmp_path / "p.uff")).read_sets()
    ours = uff.functions(tmp_path / "p.uff")
    assert len(ours) == 3
    for mine, other in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(mine.y, other["data"])
        np.testing.assert_allclose(mine.x, other["x"], rtol=1e-12)
    contents = acquisition.read(tmp_path / "p.uff")
    if kind == "complex":
        (frfs,) = contents.frfs
        assert frfs.outputs == tuple(Dof(k, "-Z") for k in (1, 2, 3))
        assert frfs.inputs == (Dof(5, "+X"),)
        assert (frfs.quantity, frfs.unit) == ("accelerance", "unstated")
    else:
        (record,) = contents.recordings
        assert record.sampling_rate == 2.0
        assert [channel.name for channel in record.channels] == ["f0", "f1", "f2"]


def test_values_that_are_not_finite_are_refused_and_the_old_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.uff"
    acquisition.write(path, nouns.frf_set())
    before = path.read_bytes()
    for bad in (np.nan, np.inf):
        values = nouns.frf_set().values.copy()
        values[3, 0, 1] = bad
        with pytest.raises(InputError, match="NaN or infinite"):
            acquisition.write(path, replace(nouns.frf_set(), values=values))
    signals = nouns.recording().signals.copy()
    signals[0, 5] = np.nan
    with pytest.raises(InputError, match="NaN or infinite"):
        acquisition.write(path, replace(nouns.recording(), signals=signals))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import errno

    path = tmp_path / "a.uff"
    acquisition.write(path, nouns.geometry())
    before = path.read_bytes()

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(FailureError, match="the disk is full"):
        acquisition.write(path, nouns.frf_set())
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_or_unwritable_folder_is_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(FailureError, match="there is no such folder"):
        acquisition.write(tmp_path / "no such folder" / "a.uff", nouns.geometry())

    def read_only(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("ema.store.atomic.os.open", read_only)
    with pytest.raises(FailureError, match="no permission to write here"):
        acquisition.write(tmp_path / "a.uff", nouns.geometry())


def test_a_noun_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot hold"):
        acquisition.write(tmp_path / "a.uff", "words")
    with pytest.raises(InputError, match="not written"):
        acquisition.write(tmp_path / "a.mat", nouns.geometry())
    with pytest.raises(InputError, match="a folder"):
        (tmp_path / "b.uff").mkdir()
        acquisition.write(tmp_path / "b.uff", nouns.geometry())


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_an_odd_frequency_step_reads_back(tmp_path: Path, binary: bool, seed: int) -> None:
    """Start and step of eight digits fill their columns, so that no blank parts them from the integer in front."""
    random = np.random.default_rng(seed)
    start, end = (82.54683618, 307.4) if not seed else (float(random.uniform(1, 99)), float(random.uniform(100, 900)))
    axis = np.linspace(start, end, 801)
    values = random.normal(size=(801, 1, 1)) + 1j
    frfs = FrfSet(axis, values, (Dof(1, "+Z"),), (Dof(2, "+Z"),), "accelerance", "(m/s^2)/N")
    acquisition.write(tmp_path / "a.uff", frfs, binary=binary)
    contents = acquisition.read(tmp_path / "a.uff")
    assert contents.findings == ()
    np.testing.assert_allclose(contents.frfs[0].values, values, rtol=1e-11)
    # eight digits: half a unit of the last one of the start, and 800 times that of the step
    np.testing.assert_allclose(contents.frfs[0].frequencies, axis, rtol=0, atol=5e-7 + 800 * 5e-8)
