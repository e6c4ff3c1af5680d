"""Every universal file of the collection of variants: read, or refused with one sentence; twins read alike."""

import gzip
import warnings
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.contents import Contents
from acquisition.files import uff
from ema.errors import InputError
from tests.formats import nouns
from tests.fuzz.uff import Function

NAMES = (
    "1858.uff",
    "2411_and_2414.uff",
    "Artemis_export_-_Geometry_RPBC_setup_05_14102016_105117.uff",
    "MPSTD_Set001_2024_10_08_10_27_07.uff",
    "MPSTD_Set001_2024_10_08_10_27_07_fixed_test.uff",
    "NX_simulation_output.uff",
    "Sample_UFF58_ascii.uff",
    "Sample_UFF58b_bin.uff",
    "TestLab_161_164_18_15_82.uff",
    "binary8byte.uff",
    "dataset_milestone_in_header.uff",
    "groups_test.uff",
    "heat_engine_housing.uff",
    "measurement_hist2_58_complex_frf.uff",
    "measurement_hist_58_complex_frf.uff",
    "mesh_Oros-modal_uff15_uff2412.uff",
    "mesh_test_uff2412_mixed.uff",
    "non_ascii_header.uff",
    "sample_dataset58_psd.uff",
    "time-history-not-all-columns-filled.uff",
    "uff55_sample_test_record10.uff",
    "uff55_translation.uff",
    "uff55_translation_rotation.uff",
)


@pytest.fixture(scope="session")
def variants(datasets: Path) -> Path:
    return datasets / "06_uff_variants"


@pytest.mark.parametrize("name", NAMES)
def test_every_file_holds_something_or_says_why_not(variants: Path, name: str) -> None:
    contents = acquisition.read(variants / name)
    assert contents or contents.findings
    assert all(finding.message.endswith(".") for finding in contents.findings)


def test_the_list_is_complete(variants: Path) -> None:
    assert sorted(path.name for path in variants.glob("*.uff")) == sorted(NAMES)


@pytest.mark.parametrize(
    "name", [n for n in NAMES if "MPSTD_Set001_2024_10_08_10_27_07.uff" not in n and "milestone" not in n]
)
def test_functions_agree_with_pyuff(variants: Path, name: str) -> None:
    with warnings.catch_warnings():
        import pyuff
    file = pyuff.UFF(str(variants / name))
    types = list(file.get_set_types())
    assert [entry.type for entry in uff.list_sets(variants / name)] == types
    ours = uff.functions(variants / name)
    theirs = [file.read_sets(number) for number, kind in enumerate(types) if kind == 58]
    assert len(ours) == len(theirs)
    for mine, other in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(mine.y, other["data"])
        np.testing.assert_allclose(mine.x, other["x"], rtol=1e-12)
        assert mine.header.ids[0] == other["id1"].encode("utf-8", "replace").decode() or "m/s" in other["id1"]


def _only_recording(contents: Contents) -> "acquisition.contents.Recording":
    (recording,) = contents.recordings
    return recording


def test_the_repaired_twin_reads_identically(variants: Path) -> None:
    broken = _only_recording(acquisition.read(variants / "MPSTD_Set001_2024_10_08_10_27_07.uff"))
    fixed = _only_recording(acquisition.read(variants / "MPSTD_Set001_2024_10_08_10_27_07_fixed_test.uff"))
    assert broken.signals.shape == (4, 222400)
    np.testing.assert_array_equal(broken.signals, fixed.signals)
    assert broken.sampling_rate == fixed.sampling_rate == 3200.0
    assert broken.channels == fixed.channels
    assert {(channel.quantity, channel.unit) for channel in fixed.channels} == {("acceleration", "m/s^2")}


def test_text_and_binary_of_one_record_agree(variants: Path) -> None:
    text = _only_recording(acquisition.read(variants / "Sample_UFF58_ascii.uff"))
    binary = _only_recording(acquisition.read(variants / "Sample_UFF58b_bin.uff"))
    assert text.signals.shape == binary.signals.shape == (1, 79292)
    assert text.sampling_rate == binary.sampling_rate == 65536.0
    assert (text.channels[0].quantity, text.channels[0].unit) == ("pressure", "Pa")
    np.testing.assert_allclose(text.signals, binary.signals, rtol=6e-6, atol=1e-12)


def test_the_three_frfs_of_two_writers_and_of_the_text_files_agree(variants: Path) -> None:
    (first,) = acquisition.read(variants / "measurement_hist_58_complex_frf.uff").frfs
    (second,) = acquisition.read(variants / "measurement_hist2_58_complex_frf.uff").frfs
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.frequencies, np.arange(1001.0))
    assert first.values.shape == (1001, 1, 3)
    assert (first.quantity, first.unit) == ("accelerance", "unstated")
    for point in range(3):
        path = variants / f"meas_point_{point + 1}.txt"
        (single,) = acquisition.read(path, frf="column 0", frequency_step=1.0, unit="(m/s^2)/N").frfs
        np.testing.assert_allclose(first.values[1:, 0, point], single.values[1:, 0, 0], rtol=1e-9, atol=1e-12)


def test_the_truncated_file_is_reported(variants: Path) -> None:
    contents = acquisition.read(variants / "dataset_milestone_in_header.uff")
    (finding,) = [finding for finding in contents.findings if finding.code == "damaged-set"]
    assert finding.severity == "error"
    assert "42 of 2508876" in finding.message
    assert _only_recording(contents).signals.shape == (1, 42)


def test_g_becomes_metres_per_second_squared(variants: Path) -> None:
    record = _only_recording(acquisition.read(variants / "binary8byte.uff"))
    assert record.channels[0].unit == "m/s^2"
    assert record.signals.max() == pytest.approx(9.80665, rel=1e-6)


def test_latin_1_units_and_a_last_line_that_is_not_full(variants: Path) -> None:
    (frfs,) = acquisition.read(variants / "non_ascii_header.uff").frfs
    assert (frfs.quantity, frfs.unit) == ("accelerance", "(m/s^2)/N")
    assert frfs.values[2, 0, 0] == pytest.approx(2.58750e-02 - 2.30085e-04j)
    record = _only_recording(acquisition.read(variants / "time-history-not-all-columns-filled.uff"))
    assert record.signals[0, -1] == -5.84096
    assert (record.channels[0].unit, record.signals.shape) == ("m/s^2", (1, 13))


def test_units_and_local_axes_of_an_analysis(variants: Path) -> None:
    contents = acquisition.read(variants / "NX_simulation_output.uff")
    geometry = contents.geometry
    assert geometry is not None
    assert geometry.axes is not None
    np.testing.assert_allclose(geometry.xyz[0], [2.0940900802612305e-2, 1.3069399833679199e-2, 3.9683275171308864e-2])
    np.testing.assert_allclose(geometry.axes[0][0], [0, 0, -1], atol=1e-7)
    identity = np.einsum("nij,nkj->nik", geometry.axes, geometry.axes)
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(3), identity.shape), atol=1e-9)
    (modes,) = contents.modes
    assert len(modes.poles) == 176
    assert modes.natural_frequencies[:2] == pytest.approx([23383.2, 23384.1])
    assert modes.scaling == "unit modal mass"


def test_shapes_of_an_analysis(variants: Path) -> None:
    contents = acquisition.read(variants / "2411_and_2414.uff")
    (modes,) = contents.modes
    assert modes.natural_frequencies[0] == pytest.approx(0.956363)
    row = [str(dof) for dof in modes.dofs].index("1:+Z")
    assert modes.shapes[row, 0] == pytest.approx(-0.708571)
    assert contents.geometry is not None
    assert (len(contents.geometry.nodes), len(contents.geometry.faces)) == (441, 400)
    assert any(finding.code == "unit-unstated" for finding in contents.findings)


def test_coordinate_systems_of_a_test_geometry(variants: Path) -> None:
    geometry = acquisition.read(variants / "TestLab_161_164_18_15_82.uff").geometry
    assert geometry is not None
    assert geometry.axes is not None
    np.testing.assert_allclose(geometry.axes[0], [[-1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-6)
    assert len(geometry.lines) == 11
    assert geometry.lines[0] == (2, 5, 6, 3, 4, 1, 2, 3)


def test_complex_modes_with_modal_a(variants: Path) -> None:
    (modes,) = acquisition.read(variants / "uff55_sample_test_record10.uff").modes
    assert modes.poles[0] == pytest.approx(-0.1111111 + 41.11111j)
    assert [str(dof) for dof in modes.dofs] == ["111111:+Y", "111111:+Z", "60101:+Z"]
    assert modes.shapes[0, 0] == pytest.approx(0.1111111 + 0.09111111j)


def test_mixed_elements(variants: Path) -> None:
    geometry = acquisition.read(variants / "mesh_test_uff2412_mixed.uff").geometry
    assert geometry is not None
    assert geometry.faces == ((3, 4, 5, 6), (3, 4, 11), (4, 5, 11), (5, 6, 11), (3, 6, 11))


def test_what_is_not_read_is_named(variants: Path) -> None:
    findings = acquisition.read(variants / "sample_dataset58_psd.uff").findings
    assert any("power spectral density" in finding.message for finding in findings)
    assert any("1858" in finding.message for finding in acquisition.read(variants / "1858.uff").findings)
    (function,) = uff.functions(variants / "sample_dataset58_psd.uff")
    assert function.y[1] == pytest.approx(1.255863e-06)
    assert function.x[-1] == pytest.approx(3200.0)


@pytest.mark.parametrize(("unit", "factor"), [("rpm", 1 / 60), ("rad/s", 1 / (2 * np.pi)), ("kHz", 1000.0)])
def test_frequency_axes_in_other_units(tmp_path: Path, unit: str, factor: float) -> None:
    """60 revolutions in a minute are one in a second; 2 pi radians are one revolution."""
    acquisition.write(tmp_path / "a.uff", nouns.frf_set(21))
    data = (tmp_path / "a.uff").read_bytes()
    line = next(line for line in data.split(b"\n") if line.startswith(b"        18"))
    data = data.replace(line, line[:46].ljust(46) + f" {unit:<20}"[-21:].encode())
    (tmp_path / "a.uff").write_bytes(data)
    contents = acquisition.read(tmp_path / "a.uff")
    np.testing.assert_allclose(contents.frfs[0].frequencies, 0.25 * np.arange(21) * factor, rtol=1e-9)


def test_an_axis_in_a_unit_of_something_else_is_named(tmp_path: Path) -> None:
    acquisition.write(tmp_path / "a.uff", nouns.frf_set(21))
    data = (tmp_path / "a.uff").read_bytes()
    line = next(line for line in data.split(b"\n") if line.startswith(b"        18"))
    (tmp_path / "a.uff").write_bytes(data.replace(line, line[:46].ljust(46) + f" {'mm':<20}".encode()))
    contents = acquisition.read(tmp_path / "a.uff")
    np.testing.assert_allclose(contents.frfs[0].frequencies, 0.25 * np.arange(21), rtol=1e-12)
    assert "'mm' of the axis is none of frequency" in contents.findings[0].message


@pytest.mark.parametrize("damage", ["number", "place"])
def test_a_function_under_another_number_is_no_unknown_data_set(tmp_path: Path, damage: str) -> None:
    acquisition.write(tmp_path / "a.uff", nouns.recording())
    lines = (tmp_path / "a.uff").read_bytes().split(b"\n")
    place = lines.index(b"    58")
    if damage == "number":
        lines[place] = b"     5"
    else:
        lines.insert(place, lines.pop(place + 9))
    (tmp_path / "a.uff").write_bytes(b"\n".join(lines))
    contents = acquisition.read(tmp_path / "a.uff")
    assert len(contents.recordings[0].channels) == 2
    assert [(f.code, f.severity) for f in contents.findings] == [("damaged-set", "error")]


CODES = {
    "UTF-8 with its mark": lambda data: b"\xef\xbb\xbf" + data,
    "UTF-16": lambda data: data.decode().encode("utf-16"),
    "UTF-16, big endian": lambda data: b"\xfe\xff" + data.decode().encode("utf-16-be"),
    "UTF-16 without a mark": lambda data: data.decode().encode("utf-16-le"),
    "carriage returns": lambda data: data.replace(b"\n", b"\r"),
    "UTF-8 with its mark and carriage returns": lambda data: b"\xef\xbb\xbf" + data.replace(b"\n", b"\r"),
}


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("packed", [False, True], ids=["plain", "gz"])
def test_text_that_an_editor_saved_in_another_code(tmp_path: Path, code: str, packed: bool) -> None:
    functions = [Function(False, node, 3, 0.0, 0.01, np.sin(node * np.arange(70.0)), double=True) for node in (1, 2)]
    written = CODES[code](b"".join(function.bytes() for function in functions))
    path = tmp_path / ("a.uff.gz" if packed else "a.uff")
    path.write_bytes(gzip.compress(written) if packed else written)
    contents = acquisition.read(path)
    np.testing.assert_allclose(contents.recordings[0].signals, [f.values for f in functions], atol=1e-12)
    assert contents.findings == ()


@pytest.mark.parametrize("code", ["UTF-16", "carriage returns"])
def test_binary_values_that_an_editor_converted_are_refused(tmp_path: Path, code: str) -> None:
    whole = Function(False, 1, 3, 0.0, 0.01, np.full(50, 2.0), double=True, binary=True).bytes()
    (tmp_path / "a.uff").write_bytes(CODES[code](whole))
    with pytest.raises(InputError, match="was converted as if it were text"):
        acquisition.read(tmp_path / "a.uff")
