"""What a file announces against what it holds: a difference is an error, or with ``salvage`` a finding; then no value moves.

Every file is written here by plain formatting or by a foreign library, then damaged; the truth is what was written.
"""

import json
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.files.matrices import read_matrix
from ema.errors import InputError

TRUTH = np.round(np.random.default_rng(3).standard_normal((2, 200)), 6)


def refused(path: Path, sentence: str, **options: object) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        acquisition.read(path, **options)
    assert "\n" not in str(caught.value) and path.name in str(caught.value)


def salvaged(path: Path, **options: object) -> np.ndarray:
    contents = acquisition.read(path, salvage=True, **options)
    assert any(f.code == "salvaged" and f.severity == "error" for f in contents.findings), contents.findings
    return contents.recordings[0].signals


# LabVIEW text -----------------------------------------------------------------------------------------------------------


def lvm(samples: int = 200, channels: int = 2) -> list[str]:
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        "Multi_Headings\tYes\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
        f"Channels\t{channels}\t\t\nSamples\t{samples}\t{samples}\t\nY_Unit_Label\tNewtons\tm/s^2\t\n"
        "Delta_X\t0.001\t0.001\t\n***End_of_Header***\t\t\t\nX_Value\tforce\tacc\tComment\n"
    )
    rows = [f"{k / 1000:.6f}\t{a:.6f}\t{b:.6f}\n" for k, (a, b) in enumerate(TRUTH.T)]
    return [head, *rows]


def test_labview_text_whole(tmp_path: Path) -> None:
    (tmp_path / "a.lvm").write_text("".join(lvm()) + "\n\n")
    contents = acquisition.read(tmp_path / "a.lvm")
    np.testing.assert_array_equal(contents.recordings[0].signals, TRUTH)
    assert contents.recordings[0].channels[0].unit == "N"
    assert contents.findings == ()


def test_labview_text_damaged(tmp_path: Path) -> None:
    path = tmp_path / "a.lvm"
    path.write_text("".join(lvm()[:51]))
    refused(path, "got 50, expected 200")
    np.testing.assert_array_equal(salvaged(path), TRUTH[:, :50])
    lines = lvm()
    path.write_text("".join([*lines[:101], "\n", *lines[101:]]))
    refused(path, "a blank line between the rows")
    np.testing.assert_array_equal(salvaged(path), TRUTH[:, :100])
    lines[60] = lines[60].rpartition("\t")[0] + "\n"
    path.write_text("".join(lines))
    refused(path, "too few cells")
    np.testing.assert_array_equal(salvaged(path), TRUTH[:, :59])
    path.write_text("".join(lvm(channels=3)))
    refused(path, "number of channels")
    path.write_text("".join([*lvm(), lvm()[-1]]))
    refused(path, "got 201, expected 200")
    wrong = "".join(lvm()).replace("Delta_X\t0.001\t0.001", "Delta_X\t0.002\t0.002")
    path.write_text(wrong)
    refused(path, "contradicts the time axis")


# wave audio -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["WAV", "RF64", "W64", "FLAC"])
def test_wave_audio_cut_in_half(tmp_path: Path, form: str) -> None:
    import soundfile

    signals = np.clip(TRUTH / 8, -1, 1)
    path = tmp_path / f"a.{form.lower()}"
    soundfile.write(path, signals.T, 1000, subtype="PCM_24", format=form)
    whole = acquisition.read(path).recordings[0].signals
    np.testing.assert_allclose(whole, signals, atol=2.0**-23)
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(InputError):
        acquisition.read(path)
    if form in ("WAV", "W64", "RF64"):
        refused(path, "ends too early")
        part = salvaged(path)
        assert 50 < part.shape[1] < 150
        np.testing.assert_array_equal(part, whole[:, : part.shape[1]])


# workbooks --------------------------------------------------------------------------------------------------------------


def workbook(path: Path, rows: list[list[object]]) -> Path:
    import openpyxl

    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.save(path)
    return path


def test_workbooks(tmp_path: Path) -> None:
    good = [["t [s]", "a [N]", "b [g]", "Comment"]]
    good += [[k / 1000, float(a), float(b), "start" if not k else None] for k, (a, b) in enumerate(TRUTH.T)]
    contents = acquisition.read(workbook(tmp_path / "good.xlsx", good))
    np.testing.assert_array_equal(contents.recordings[0].signals[0], TRUTH[0])
    assert [f.code for f in contents.findings] == ["not-read"]
    rows = [list(row) for row in good]
    rows[50][:3] = ["#N/A", "#N/A", "#N/A"]
    refused(workbook(tmp_path / "na.xlsx", rows), "cell A51: a cell among the numbers is none; got '#N/A'")
    rows = [list(row) for row in good]
    rows[50][2] = None
    rows[50][1] = "1,5"
    refused(workbook(tmp_path / "text.xlsx", rows), "cell B51")
    rows = [[row[0], f"{row[1]}".replace(".", ",") if number else row[1], row[2]] for number, row in enumerate(good)]
    refused(workbook(tmp_path / "column.xlsx", rows), "cell B2: a column of texts that look like numbers")
    rows = [list(row) for row in good]
    rows.insert(50, [None, None, None, None])
    refused(workbook(tmp_path / "empty.xlsx", rows), "row 51: a row among the numbers holds none")


# matrices ---------------------------------------------------------------------------------------------------------------


def harwell_boeing(values: list[str], lines: int = 1, extra: str = "") -> str:
    """A diagonal matrix of size 3; four numbers to a line."""
    return (
        f"{'title':<72}{'key':<8}\n{2 + lines:14d}{1:14d}{1:14d}{lines:14d}{0:14d}\n{'RSA':<14}{3:14d}{3:14d}{3:14d}{0:14d}\n"
        f"{'(4I10)':<16}{'(4I10)':<16}{'(4E20.12)':<20}{'':<20}\n"
        + "".join(f"{k:10d}" for k in (1, 2, 3, 4))
        + "\n"
        + "".join(f"{k:10d}" for k in (1, 2, 3))
        + "\n"
        + "".join(f"{v:>20}" for v in values)
        + "\n"
        + extra
    )


def test_harwell_boeing(tmp_path: Path) -> None:
    path = tmp_path / "a.hb"
    path.write_text(harwell_boeing(["1.0", "2.0", "3.0"]))
    np.testing.assert_array_equal(read_matrix(path), np.diag([1.0, 2.0, 3.0]))
    cases = {
        "not finite": harwell_boeing(["1.0", "NaN", "3.0"]),
        "ends too early": harwell_boeing(["1.0", "2.0"]),
        "more numbers": harwell_boeing(["1.0", "2.0", "3.0", "4.0"]),
        "behind the matrix": harwell_boeing(["1.0", "2.0", "3.0"], extra="  5.0\n"),
    }
    for sentence, text in cases.items():
        path.write_text(text)
        with pytest.raises(InputError, match=sentence):
            read_matrix(path)
    market = tmp_path / "a.mtx"
    market.write_text("%%MatrixMarket matrix coordinate real general\n2 2 2\n1 1 1.0\n2 2 nan\n")
    with pytest.raises(InputError, match="not finite"):
        read_matrix(market)


# tables and arrays ------------------------------------------------------------------------------------------------------


def table(separator: str = ",") -> list[str]:
    rows = [separator.join((f"{k / 1000:.3f}", f"{a:.6f}", f"{b:.6f}")) + "\n" for k, (a, b) in enumerate(TRUTH.T)]
    return [separator.join(("time [s]", "a [N]", "b [g]")) + "\n", *rows]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_text_tables(tmp_path: Path, separator: str) -> None:
    path = tmp_path / "a.csv"
    for at, damaged, sentence in (
        (101, "\n", "line 102: a blank line inside the table"),
        (101, f"0.100{separator}x.12345{separator}0.5\n", "line 102: a row that holds no numbers"),
        (101, f"0.100{separator}0.5\n", "line 102: a row of 2 cells in a table of 3 columns"),
    ):
        lines = table(separator)
        lines.insert(at, damaged)
        path.write_text("".join(lines))
        refused(path, sentence)
        np.testing.assert_array_equal(salvaged(path)[0], TRUTH[0, :100])
        refused(path, "line 102", time="column 0", signals=["column 1", "column 2"])
    lines = table(separator)
    lines[-1] = f"0.199{separator}0.1"
    path.write_text("".join(lines))
    refused(path, "a row of 2 cells")


def test_arrays_and_objects(tmp_path: Path) -> None:
    import scipy.io

    np.save(tmp_path / "a.npy", TRUTH)
    raw = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(raw + raw[-40:])
    refused(tmp_path / "a.npy", "bytes behind the array", sampling_rate=1.0)
    np.testing.assert_array_equal(salvaged(tmp_path / "a.npy", sampling_rate=1.0), TRUTH)
    (tmp_path / "a.npy").write_bytes(raw[:-8])
    refused(tmp_path / "a.npy", "damaged", sampling_rate=1.0)
    text = json.dumps({"a": TRUTH[0].tolist()})
    (tmp_path / "a.json").write_text(text[:-1] + ', "a": [1.0, 2.0, 3.0]}')
    refused(tmp_path / "a.json", "two values of one name", signals="a", sampling_rate=1.0)
    for packed in (False, True):
        scipy.io.savemat(tmp_path / "a.mat", {"a": TRUTH, "b": TRUTH[0]}, do_compression=packed)
        (record,) = acquisition.read(tmp_path / "a.mat", signals="a", sampling_rate=1.0).recordings
        np.testing.assert_array_equal(record.signals, TRUTH)
        raw = (tmp_path / "a.mat").read_bytes()
        (tmp_path / "a.mat").write_bytes(raw[:-100])
        refused(tmp_path / "a.mat", "ends inside a variable", signals="a", sampling_rate=1.0)


# loggers ----------------------------------------------------------------------------------------------------------------

LOGGER = """Model,X-200
Serial,00123
Sampling Rate(Hz),50
Channels,2
Start,2026-03-01 10:00:00

No.,Force (N),Acc (g)
"""


def test_a_logger_states_its_sampling_rate_in_the_header(tmp_path: Path) -> None:
    rows = "".join(f"{k + 1},{a:.6f},{b:.6f}\n" for k, (a, b) in enumerate(TRUTH.T))
    for line, rate in (
        ("Sampling Rate(Hz),50", 50),
        ("Sample rate: 50 Hz", 50),
        ("Sampling frequency [kHz],0.05", 50),
        ("Fs = 50 Hz", 50),
    ):
        (tmp_path / "a.csv").write_text(LOGGER.replace("Sampling Rate(Hz),50", line) + rows)
        (record,) = acquisition.read(tmp_path / "a.csv").recordings
        assert record.sampling_rate == rate
        assert [(c.name, c.unit) for c in record.channels] == [("Force", "N"), ("Acc", "m/s^2")]
        np.testing.assert_array_equal(record.signals[0], TRUTH[0])
    timed = "".join(f"{k / 100},{a:.6f},{b:.6f}\n" for k, (a, b) in enumerate(TRUTH.T))
    (tmp_path / "b.csv").write_text(LOGGER.replace("No.", "Time (s)") + timed)
    refused(tmp_path / "b.csv", "contradicts the time axis")


@pytest.mark.parametrize(("spoken", "unit"), [("Newtons", "N"), ("Volts", "V"), ("Meters", "m"), ("Pascals", "Pa")])
def test_units_as_labview_spells_them(tmp_path: Path, spoken: str, unit: str) -> None:
    (tmp_path / "a.csv").write_text(f"time,a [{spoken}]\n0,1\n1,3\n2,2\n")
    assert acquisition.read(tmp_path / "a.csv").recordings[0].channels[0].unit == unit
