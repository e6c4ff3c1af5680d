"""Containers of arrays, and the formats that need an extra."""

import importlib
from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema.dof import Dof
from ema.errors import InputError, MissingExtraError


def _signals() -> np.ndarray:
    return 0.5 * np.random.default_rng(0).uniform(-1, 1, size=(2, 200))


@pytest.mark.parametrize(
    ("suffix", "options"),
    [
        ("npy", {"sampling_rate": 100}),
        ("npy", {"sampling_rate": 100, "axis": "rows"}),
        ("mat", {"signals": "data", "sampling_rate": 100}),
        ("h5", {"signals": "data", "sampling_rate": 100}),
        ("json", {"signals": "data", "sampling_rate": 100}),
        ("wav", {}),
        ("tdms", {}),
        ("xlsx", {}),
    ],
)
def test_two_signals_in_every_container(
    tmp_path: Path, containers: dict[str, bytes], suffix: str, options: dict
) -> None:
    (tmp_path / f"a.{suffix}").write_bytes(containers[suffix])
    (record,) = acquisition.read(tmp_path / f"a.{suffix}", **options).recordings
    assert record.sampling_rate == 100.0
    factor = {"tdms": [[1000.0], [1000.0]], "xlsx": [[1.0], [9.80665]]}.get(suffix, 1.0)
    np.testing.assert_allclose(record.signals, _signals() * factor, rtol=1e-9, atol=1e-6)
    expected = {"tdms": ["N", "N"], "xlsx": ["N", "m/s^2"]}.get(suffix, ["unstated"] * 2)
    assert [channel.unit for channel in record.channels] == expected


def test_mdf4_with_units(tmp_path: Path) -> None:
    import asammdf

    times, signals = np.arange(200) / 100, _signals()
    with asammdf.MDF() as file:
        file.append(
            [
                asammdf.Signal(signals[0], times, name="force", unit="kN"),
                asammdf.Signal(signals[1], times, name="acc", unit="g"),
            ]
        )
        file.save(tmp_path / "a.mf4")
    (record,) = acquisition.read(tmp_path / "a.mf4").recordings
    assert [(c.name, c.unit) for c in record.channels] == [("force", "N"), ("acc", "m/s^2")]
    np.testing.assert_allclose(record.signals, signals * [[1000], [9.80665]], rtol=1e-12)
    assert record.sampling_rate == 100.0


def test_a_truncated_tdms_is_reported(
    tmp_path: Path, containers: dict[str, bytes], capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.tdms").write_bytes(containers["tdms"][:-900])
    findings = acquisition.read(tmp_path / "a.tdms").findings
    assert [finding.code for finding in findings] == ["damaged-set"]
    assert capfd.readouterr() == ("", "")


def test_matlab_7_3(tmp_path: Path) -> None:
    """A v7.3 file is HDF5 behind a header of 512 bytes, with the axes reversed and attributes for the classes."""
    import h5py

    signals = _signals()
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("test")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        data = group.create_dataset("data", data=signals.T)
        data.attrs["MATLAB_class"] = np.bytes_("double")
        rate = group.create_dataset("rate", data=[[100.0]])
        rate.attrs["MATLAB_class"] = np.bytes_("double")
        words = group.create_dataset("who", data=np.array([[ord(c)] for c in "lab 3"], dtype=np.uint16))
        words.attrs["MATLAB_class"] = np.bytes_("char")
        pair = np.dtype([("real", "f8"), ("imag", "f8")])
        frf = group.create_dataset("frf", data=np.array([[(1.0, 2.0), (3.0, -4.0)]], dtype=pair))
        frf.attrs["MATLAB_class"] = np.bytes_("double")
    raw = bytearray(path.read_bytes())
    raw[:128] = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(raw)
    contents = acquisition.read(path, signals="test.data", axis="rows", sampling_rate="test.rate")
    np.testing.assert_array_equal(contents.recordings[0].signals, signals)
    assert contents.recordings[0].sampling_rate == 100.0
    assert ("test.who", "lab 3") in contents.metadata
    (frfs,) = acquisition.read(path, frf="test.frf", frequency_step=2.0).frfs
    np.testing.assert_array_equal(frfs.values[:, 0, 0], [1 + 2j, 3 - 4j])


def test_frfs_of_several_points_in_one_array(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    values = random.normal(size=(50, 3)) + 1j * random.normal(size=(50, 3))
    np.savez(tmp_path / "a.npz", H=values, f=np.arange(50.0))
    outputs = ["1:+Z", "2:+Z", "3:-Z"]
    (frfs,) = acquisition.read(tmp_path / "a.npz", frf="H", frequency="f", outputs=outputs, inputs="9:+Z").frfs
    assert frfs.outputs == tuple(Dof.parse(text) for text in outputs)
    np.testing.assert_array_equal(frfs.values[:, :, 0], values)
    (turned,) = acquisition.read(tmp_path / "a.npz", frf="H", frequency="f", outputs="9:+Z", inputs=outputs).frfs
    np.testing.assert_array_equal(turned.values[:, 0, :], values)
    with pytest.raises(InputError, match="named twice"):
        acquisition.read(tmp_path / "a.npz", frf="H", frequency="f", outputs=["1:+Z"] * 3, inputs="9:+Z")


@pytest.mark.parametrize("package", ["nptdms", "asammdf", "soundfile", "openpyxl"])
def test_a_missing_extra_says_how_to_install_it(
    tmp_path: Path, containers: dict[str, bytes], package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = next(kind for kind in acquisition.formats() if kind.packages == (package,))
    monkeypatch.setattr("acquisition.registry.find_spec", lambda name: None if name == package else object())
    (tmp_path / "a").write_bytes(next(iter(containers.values())))
    with pytest.raises(MissingExtraError, match=r"pip install 'friction-ema\[formats\]'"):
        acquisition.read(tmp_path / "a", format=kind.name)


def test_the_list_of_formats_is_complete() -> None:
    kinds = {kind.name: kind for kind in acquisition.formats()}
    assert {"uff", "table", "lvm", "matlab", "hdf5", "npy", "wav", "tdms", "mdf4", "xlsx"} <= kinds.keys()
    assert kinds["uff"].writes == ("recordings", "frfs", "geometry", "modes")
    assert kinds["tdms"].extra == "formats"
    assert all(kind.available for kind in kinds.values() if not kind.extra)
    assert all(hasattr(importlib.import_module(kind.module), "read") for kind in kinds.values())
    with pytest.raises(InputError, match="one of uff"):
        acquisition.read("anything", format="nonsense")


def test_reading_loads_no_heavy_package() -> None:
    import subprocess
    import sys

    code = "import sys, acquisition; acquisition.formats(); print([m for m in ('pandas','pint','scipy','h5py','pyuff') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_rate_beside_the_signals_that_contradicts_their_time_axis_is_named(tmp_path: Path) -> None:
    times = np.arange(200) / 100
    for name, number, codes in (("fs", 100.0, []), ("fs", 200.0, ["rate-overruled"]), ("dt", 0.02, ["rate-overruled"])):
        np.savez(tmp_path / "a.npz", t=times, a=_signals()[0], **{name: number})
        contents = acquisition.read(tmp_path / "a.npz", time="t", signals="a")
        assert contents.recordings[0].sampling_rate == 100.0
        assert [note.code for note in contents.findings] == codes


def test_one_output_and_several_inputs_stay_what_they_are(tmp_path: Path) -> None:
    """The axes of an array (frequency, output, input) mean the same however long they are."""
    draw = np.random.default_rng(3)
    frequencies = np.arange(50) * 2.0
    for outputs, inputs in ((1, 4), (4, 1), (1, 1)):
        values = draw.normal(size=(50, outputs, inputs)) + 1j * draw.normal(size=(50, outputs, inputs))
        np.savez(tmp_path / "a.npz", f=frequencies, h=values)
        (frf,) = acquisition.read(tmp_path / "a.npz", frequency="f", frf="h").frfs
        np.testing.assert_array_equal(frf.values, values)
        assert (len(frf.outputs), len(frf.inputs)) == (outputs, inputs)


def test_a_column_of_formulas_that_were_never_calculated_is_named(tmp_path: Path) -> None:
    """A workbook that another program wrote holds no results of its formulas."""
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["t [s]", "a [N]", "twice a [N]"])
    for place, value in enumerate(_signals()[0].tolist()):
        book.active.append([0.01 * place, value, f"=2*B{place + 2}"])
    book.save(tmp_path / "a.xlsx")
    contents = acquisition.read(tmp_path / "a.xlsx")
    np.testing.assert_allclose(contents.recordings[0].signals, _signals()[:1], rtol=1e-15)
    (note,) = contents.findings
    assert note.code == "not-read" and "twice a [N]" in note.message and "formulas" in note.message
