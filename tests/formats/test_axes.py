"""Axes of time, frequency and channels as other programs write them: read as they are, or refused; never shifted."""

import re
from datetime import datetime, timedelta
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

import acquisition
from acquisition.files.matrices import read_matrix
from ema.errors import InputError
from tests.fuzz.uff import Function

FREQUENCIES = np.arange(0.0, 160.0, 2.5)


def frf(frequencies: np.ndarray) -> np.ndarray:
    """Accelerance of one degree of freedom at 70 Hz with 2 % of damping and 1 kg."""
    return -(frequencies**2) / (70.0**2 - frequencies**2 + 2j * 0.02 * 70 * frequencies)


def two_sided(lines: int) -> np.ndarray:
    """The spectrum of a real impulse response, on all lines of its transform."""
    return np.fft.fft(np.random.default_rng(41).standard_normal(lines))


@pytest.mark.parametrize("lines", [64, 65])
@pytest.mark.parametrize("without", [0, 1], ids=["all lines", "without 0 Hz"])
def test_a_two_sided_spectrum_is_refused_whatever_the_format(tmp_path: Path, lines: int, without: int) -> None:
    values = two_sided(lines)[without:]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["f"], file["H"] = 2.5 * np.arange(without, lines), values
    scipy.io.savemat(tmp_path / "a.mat", {"f": 2.5 * np.arange(without, lines), "H": values})
    rows = "\n".join(f"{2.5 * (k + without)},{v.real:.6e},{v.imag:.6e}" for k, v in enumerate(values))
    (tmp_path / "a.csv").write_text("Frequency (Hz),Real (g/N),Imag (g/N)\n" + rows + "\n")
    function = Function(True, 1, 3, 2.5 * without, 2.5, values, double=True)
    (tmp_path / "a.uff").write_bytes(function.bytes())
    for name, layout in (("h5", {"frf": "H", "frequency": "f"}), ("mat", {"frf": "H", "frequency": "f"})):
        with pytest.raises(InputError, match="two-sided"):
            acquisition.read(tmp_path / f"a.{name}", **layout)
    for name in ("csv", "uff"):
        with pytest.raises(InputError, match="two-sided"):
            acquisition.read(tmp_path / f"a.{name}")


def test_a_one_sided_spectrum_real_frfs_and_a_constant_are_none(tmp_path: Path) -> None:
    for number, values in enumerate((two_sided(128)[:65], frf(FREQUENCIES), np.ones(64) + 0j, np.zeros(64) + 0j)):
        with h5py.File(tmp_path / f"{number}.h5", "w") as file:
            file["H"] = values
        read = acquisition.read(tmp_path / f"{number}.h5", frf="H", frequency_step=2.5)
        np.testing.assert_array_equal(read.frfs[0].values[:, 0, 0], values)


@pytest.mark.parametrize("form", ["{0.real:.9e}{0.imag:+.9e}j", "{0.real:.9e}{0.imag:+.9e}i", "({0.real}{0.imag:+}j)"])
def test_complex_numbers_stand_beside_a_column_of_real_ones(tmp_path: Path, form: str) -> None:
    values = frf(FREQUENCIES)
    rows = "\n".join(f"{f},{form.format(v)}" for f, v in zip(FREQUENCIES, values, strict=True))
    (tmp_path / "a.csv").write_text("Frequency,H1\n" + rows + "\n")
    for frequency, place in (("Frequency", "H1"), ("column 0", "column 1")):
        read = acquisition.read(tmp_path / "a.csv", frequency=frequency, frf=place, unit="m/s^2/N").frfs[0]
        np.testing.assert_array_equal(read.frequencies, FREQUENCIES)
        np.testing.assert_allclose(read.values[:, 0, 0], values, rtol=1e-8)


def tdms(path: Path, *properties: dict) -> list[np.ndarray]:
    """A file with one channel for each set of properties; its samples."""
    nptdms = pytest.importorskip("nptdms")
    rows = list(np.random.default_rng(7).standard_normal((len(properties), 50)))
    with nptdms.TdmsWriter(str(path)) as writer:
        for number, (row, more) in enumerate(zip(rows, properties, strict=True)):
            stated = {"wf_increment": 0.01, **more}
            writer.write_segment([nptdms.ChannelObject("g", f"c{number}", row, properties=stated)])
    return rows


NOON = np.datetime64("2024-03-01T12:00:00")


@pytest.mark.parametrize(
    "later", [{"wf_start_offset": 0.25}, {"wf_start_time": NOON + np.timedelta64(250, "ms")}], ids=["offset", "stamp"]
)
def test_channels_of_a_tdms_file_that_begin_apart_are_recordings_of_their_own(tmp_path: Path, later: dict) -> None:
    """Read as one, a delay of 250 ms would be a phase of 90 degrees for each Hz."""
    stated = {"wf_start_time": NOON, "wf_start_offset": 0.0}
    rows = tdms(tmp_path / "a.tdms", stated, {**stated, **later}, stated)
    contents = acquisition.read(tmp_path / "a.tdms")
    assert [[c.name for c in one.channels] for one in contents.recordings] == [["c0", "c2"], ["c1"]]
    np.testing.assert_array_equal(contents.recordings[1].signals[0], rows[1])
    (finding,) = contents.findings
    assert (finding.code, finding.value) == ("begins-later", pytest.approx(0.25))


def test_channels_that_begin_within_a_hundredth_of_a_sample_are_one_recording(tmp_path: Path) -> None:
    tdms(tmp_path / "a.tdms", {"wf_start_time": NOON}, {"wf_start_time": NOON + np.timedelta64(50, "us")})
    (record,) = acquisition.read(tmp_path / "a.tdms").recordings
    assert record.signals.shape == (2, 50)


def test_groups_of_an_mdf_file_that_begin_apart_are_recordings_of_their_own(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    times = np.arange(50) / 100
    with asammdf.MDF(version="4.10") as file:
        for name, late in (("a", 0.0), ("b", 0.25)):
            file.append([asammdf.Signal(samples=np.sin(times), timestamps=times + late, name=name, unit="g")])
        file.save(str(tmp_path / "a.mf4"))
    contents = acquisition.read(tmp_path / "a.mf4")
    assert [[c.name for c in one.channels] for one in contents.recordings] == [["a"], ["b"]]
    assert [finding.code for finding in contents.findings] == ["begins-later"]


LVM = """LabVIEW Measurement
Separator	Tab
Decimal_Separator	.
X_Columns	{columns}
***End_of_Header***
Channels	2
Samples	20	20
X0	0	{start}
Delta_X	0.01	0.01
***End_of_Header***
{titles}
"""


@pytest.mark.parametrize(("header", "column"), [("0.5", 0.0), ("0", 0.5)], ids=["header", "time column"])
def test_channels_of_an_lvm_file_that_begin_apart_are_refused(tmp_path: Path, header: str, column: float) -> None:
    def text(header: str, column: float) -> str:
        rows = [f"{k / 100:.2f}\t{k}\t{column + k / 100:.2f}\t{-k}" for k in range(20)]
        return LVM.format(columns="Multi", start=header, titles="X_Value\ta\tX_Value\tb") + "\n".join(rows) + "\n"

    (tmp_path / "a.lvm").write_text(text("0", 0.0))
    assert acquisition.read(tmp_path / "a.lvm").recordings[0].signals.shape == (2, 20)
    (tmp_path / "a.lvm").write_text(text(header, column))
    with pytest.raises(InputError, match="begin at different times"):
        acquisition.read(tmp_path / "a.lvm")


def test_a_square_array_does_not_say_which_side_is_time(tmp_path: Path) -> None:
    signals = np.random.default_rng(3).standard_normal((30, 30))
    np.save(tmp_path / "a.npy", signals)
    with pytest.raises(InputError, match="axis='columns'"):
        acquisition.read(tmp_path / "a.npy", sampling_rate=100.0)
    for axis, expected in (("rows", signals), ("columns", signals.T)):
        read = acquisition.read(tmp_path / "a.npy", sampling_rate=100.0, axis=axis)
        np.testing.assert_array_equal(read.recordings[0].signals, expected)


def test_whole_numbers_of_a_matrix_market_file_are_whole(tmp_path: Path) -> None:
    """scipy reads 1.5 in a file of integers as 1, without a word."""
    text = "%%MatrixMarket matrix coordinate integer symmetric\n2 2 2\n1 1 {}\n2 2 3\n"
    (tmp_path / "a.mtx").write_text(text.format("-2"))
    np.testing.assert_array_equal(read_matrix(tmp_path / "a.mtx"), [[-2, 0], [0, 3]])
    for wrong in ("1.5", "1.", "1e1"):
        (tmp_path / "a.mtx").write_text(text.format(wrong))
        with pytest.raises(InputError, match=re.escape(f"line 3 is no entry: '1 1 {wrong}'")):
            read_matrix(tmp_path / "a.mtx")


def table(path: Path, titles: str, *columns: np.ndarray) -> Path:
    """A text table of columns under their titles."""
    rows = (",".join(f"{number:.9g}" for number in row) for row in zip(*columns, strict=True))
    path.write_text(f"{titles}\n" + "\n".join(rows) + "\n")
    return path


def test_a_column_that_counts_its_rows_is_no_channel_wherever_the_times_come_from(tmp_path: Path) -> None:
    count, signal = np.arange(40.0), np.random.default_rng(4).standard_normal(40)
    beside = table(tmp_path / "a.csv", "Index,Time (s),Force (N)", count, count / 128, signal)
    alone = table(tmp_path / "b.csv", "Sample,Force (N)", count, signal)
    for path, layout in (
        (beside, {}),
        (beside, {"time": "Time"}),
        (beside, {"time": "Time (s)"}),
        (beside, {"time": "column 1"}),
        (alone, {"sampling_rate": 128.0}),
    ):
        (record,) = acquisition.read(path, **layout).recordings
        assert [channel.name for channel in record.channels] == ["Force"] and record.sampling_rate == 128
        np.testing.assert_allclose(record.signals[0], signal, rtol=1e-8)
    named = acquisition.read(alone, sampling_rate=128.0, signals=["Sample", "Force"]).recordings[0]
    np.testing.assert_array_equal(named.signals[0], count)


def test_real_numbers_in_brackets_are_not_read_as_positive(tmp_path: Path) -> None:
    """In exports of spreadsheets they are negative; of two parts without a sign between them none is known."""
    for cell in ("(1.5)", "1.5 2j"):
        (tmp_path / "a.csv").write_text("Time (s),a\n" + "".join(f"{k / 10},{cell}\n" for k in range(20)))
        with pytest.raises(InputError, match="no table of numbers"):
            acquisition.read(tmp_path / "a.csv")


BEGIN = datetime(2024, 2, 28, 23, 59, 59, 700_000)
"""Half a second before midnight, and a day before the day that only leap years have."""


def stamped(
    path: Path, form: str, delimiter: str = ",", titles: str = "Time,Force (N)", rate: float = 200.0
) -> np.ndarray:
    """A table of 200 rows with time stamps from :data:`BEGIN` on; its signal."""
    signal = np.round(np.random.default_rng(12).standard_normal(200), 6)
    rows = []
    for number, value in enumerate(signal):
        moment = (BEGIN + timedelta(seconds=number / rate)).strftime(form)
        rows.append(moment + delimiter + (f"{value:.6f}" if delimiter == "," else f"{value:.6f}".replace(".", ",")))
    path.write_text(titles.replace(",", delimiter) + "\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return signal


@pytest.mark.parametrize(
    ("form", "delimiter", "titles"),
    [
        ("%Y-%m-%dT%H:%M:%S.%f", ",", "Timestamp,Force (N)"),
        ("%Y-%m-%d %H:%M:%S.%f+01:00", ",", "Time,Force (N)"),
        ('"%Y/%m/%d %H:%M:%S.%f"', ",", '"Date/Time","Force (N)"'),
        ("%d.%m.%Y %H:%M:%S,%f", ";", "Zeit,Force (N)"),
        ("%d/%m/%Y %H:%M:%S.%f", ",", "Time,Force (N)"),
        ("%H:%M:%S.%f", "\t", "Time (hh:mm:ss),Force (N)"),
        ("%H:%M:%S.%f", ",", "Time,Force\nhh:mm:ss,N"),
        ("%Y-%m-%d,%H:%M:%S.%f", ",", "Date,Time,Force (N)"),
        ("%m/%d/%Y;%H:%M:%S,%f", ";", "Date,Time,Force (N)"),
    ],
)
def test_time_stamps_are_seconds_also_across_midnight(tmp_path: Path, form: str, delimiter: str, titles: str) -> None:
    signal = stamped(tmp_path / "a.csv", form, delimiter, titles)
    contents = acquisition.read(tmp_path / "a.csv")
    (record,) = contents.recordings
    assert [(channel.name, channel.unit) for channel in record.channels] == [("Force", "N")]
    assert record.sampling_rate == 200 and contents.findings == ()
    np.testing.assert_array_equal(record.signals[0], signal)


def test_stamps_that_are_too_coarse_ambiguous_or_damaged_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    stamped(path, "%Y-%m-%d %H:%M:%S")
    with pytest.raises(InputError, match="time"):
        acquisition.read(path)
    stamped(path, "%H:%M:%S.%f")
    text = path.read_text()
    lost = text.splitlines(keepends=True)
    for wrong, words in (
        (text.replace("23:59:59.900000", "23:59:5x.900000"), "line"),
        (text.replace("23:59:59.900000", "23:59:49.900000"), "time steps are not constant"),
        ("".join(lost[:60] + lost[70:]), "time steps are not constant"),
    ):
        assert wrong != text
        path.write_text(wrong)
        with pytest.raises(InputError, match=words):
            acquisition.read(path)
    rows = [f"0{1 + n // 50}/0{2 + n // 50}/2024 10:00:00.{n:03d},1.5\n" for n in range(100)]
    path.write_text("Time,a\n" + "".join(rows))
    with pytest.raises(InputError, match="which number is the day"):
        acquisition.read(path)


def test_null_beside_numbers_is_a_missing_number_and_the_channel_stays(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"fs": 100, "a": [1, null, 3.5, 4], "b": [[1, 2], [null, 4], [5, 6]]}')
    contents = acquisition.read(tmp_path / "a.json", signals="a", sampling_rate="fs")
    np.testing.assert_array_equal(contents.recordings[0].signals, [[1, np.nan, 3.5, 4]])
    assert [(finding.code, finding.value) for finding in contents.findings] == [("not-finite", 1.0)]
    table = acquisition.read(tmp_path / "a.json", signals="b", sampling_rate="fs").recordings[0]
    np.testing.assert_array_equal(table.signals, [[1, np.nan, 5], [2, 4, 6]])
    for other in ("[true, null, 1]", '["1", null]', "[null, null]"):
        (tmp_path / "a.json").write_text(f'{{"a": {other}}}')
        with pytest.raises(InputError):
            acquisition.read(tmp_path / "a.json", signals="a", sampling_rate=1.0)


@pytest.mark.parametrize("size", [2, 3, 6])
def test_harwell_boeing_files_that_scipy_writes_are_read(tmp_path: Path, size: int) -> None:
    """Their fields of numbers are one character narrower than the header says; a lost character is still found."""
    from scipy.sparse import csc_matrix

    rng = np.random.default_rng(size)
    matrix = rng.standard_normal((size, size)) * 10.0 ** rng.integers(-8, 8, (size, size))
    path = tmp_path / "a.hb"
    scipy.io.hb_write(str(path), csc_matrix(matrix))
    np.testing.assert_allclose(read_matrix(path), matrix, rtol=1e-15)
    lines = path.read_text().splitlines(keepends=True)
    for place in range(5, len(lines)):
        for at in range(0, len(lines[place]) - 1, 5):
            damaged = [*lines[:place], lines[place][:at] + lines[place][at + 1 :], *lines[place + 1 :]]
            path.write_text("".join(damaged))
            try:
                np.testing.assert_allclose(read_matrix(path), matrix, rtol=1e-15)
            except InputError:
                continue


def test_a_square_array_of_frfs_does_not_say_which_side_is_frequency(tmp_path: Path) -> None:
    frequencies = 2.5 * np.arange(1, 9)
    values = np.random.default_rng(3).standard_normal((8, 8, 2)).view(complex)[..., 0]  # lines, outputs
    block = np.random.default_rng(4).standard_normal((8, 8, 2, 2)).view(complex)[..., 0]  # lines, outputs, inputs
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["f"], file["H"], file["B"] = frequencies, values, block
        file["T"], file["C"] = values.T, block.transpose(1, 2, 0)
        file["coh"] = np.full((8, 8), 0.9)
    for place in ("H", "B", "C"):
        with pytest.raises(InputError, match=r"which axis.*is that of frequency.*axis='columns'"):
            acquisition.read(tmp_path / "a.h5", frf=place, frequency="f")
    for place, axis in (("H", "columns"), ("T", "rows")):
        for more in ({"frequency": "f"}, {"frequency_step": 2.5}):
            found = acquisition.read(tmp_path / "a.h5", frf=place, coherence="coh", axis=axis, **more).frfs[0]
            np.testing.assert_array_equal(found.values[:, :, 0], values)
    for place, axis in (("B", "columns"), ("C", "rows")):
        found = acquisition.read(tmp_path / "a.h5", frf=place, frequency="f", axis=axis).frfs[0]
        np.testing.assert_array_equal(found.values, block)
