"""What a file announces against what it holds: a difference is an error, or with ``salvage`` a finding; then no value moves.

Every file is written here by plain formatting or by a foreign library, then damaged; the truth is what was written.
"""

import json
import struct
import wave
import zipfile
from collections.abc import Callable
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


def test_labview_text_whose_titles_are_damaged(tmp_path: Path) -> None:
    """A tab of the titles that became another byte made the time column a channel."""
    path, whole = tmp_path / "a.lvm", "".join(lvm())
    path.write_text(whole.replace("X_Value\tforce", "X_Value}force"))
    refused(path, "other time columns than the header announces")
    path.write_text(whole.replace("X_Value\tforce\tacc", "X_Value\tforce\t"))
    (note,) = acquisition.read(path).findings
    assert (note.code, note.where) == ("no-title", "a.lvm, column 2")
    path.write_text(whole.replace("acc\tComment", "force\tComment"))
    assert [c.name for c in acquisition.read(path).recordings[0].channels] == ["force", "force #2"]


def test_labview_text_with_a_cell_too_many(tmp_path: Path) -> None:
    path, lines = tmp_path / "a.lvm", lvm()
    path.write_text("".join([lines[0], lines[1].replace("\n", "\tfirst impact\n"), *lines[2:]]))
    assert acquisition.read(path).findings == ()
    path.write_text("".join([*lines[:50], lines[50].replace("\n", "\t\t0.5\n"), *lines[51:]]))
    refused(path, "a row with too many cells")
    np.testing.assert_array_equal(salvaged(path), TRUTH[:, :49])


def test_labview_text_with_a_column_that_holds_nothing(tmp_path: Path) -> None:
    path, lines = tmp_path / "a.lvm", lvm(channels=1)
    head = lines[0].replace("Samples\t200\t200", "Samples\t200")
    path.write_text("".join([head, *(line.rpartition("\t")[0] + "\t\n" for line in lines[1:])]))
    contents = acquisition.read(path)
    assert [(f.code, f.where) for f in contents.findings] == [("not-read", "a.lvm, acc")]
    np.testing.assert_array_equal(contents.recordings[0].signals, TRUTH[:1])


def test_labview_text_whose_time_columns_differ(tmp_path: Path) -> None:
    path = tmp_path / "a.lvm"
    head = lvm()[0].replace("X_Columns\tOne", "X_Columns\tMulti").replace("\tacc", "\tX_Value\tacc")
    for step, sentence in ((0.001, ""), (0.002, "the sampling rate contradicts the time axis")):
        rows = [f"{k / 1000:.6f}\t{a:.6f}\t{step * k:.6f}\t{b:.6f}\n" for k, (a, b) in enumerate(TRUTH.T)]
        path.write_text("".join([head, *rows]))
        if sentence:
            refused(path, sentence)
        else:
            np.testing.assert_array_equal(acquisition.read(path).recordings[0].signals, TRUTH)


# ASAM MDF ---------------------------------------------------------------------------------------------------------------


def mdf(path: Path, **options: object) -> None:
    """Two groups of 200 and 100 cycles with a text channel, by asammdf."""
    import asammdf

    times = np.arange(200) / 1000
    words = np.array([b"on" if k % 3 else b"off" for k in range(200)])
    marked = np.arange(100) == 7
    with asammdf.MDF(version="4.10") as file:
        signals = [asammdf.Signal(row.copy(), times, name=name) for name, row in zip("ab", TRUTH)]
        file.append([*signals, asammdf.Signal(words, times, name="state", encoding="latin-1")])
        file.append([asammdf.Signal(TRUTH[0, ::2].copy(), times[::2], name="c", invalidation_bits=marked)])
        file.save(path, overwrite=True, **options)


@pytest.mark.parametrize("compression", [0, 1, 2])
def test_mdf_whole(tmp_path: Path, compression: int) -> None:
    pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    mdf(path, compression=compression)
    contents = acquisition.read(path)
    first, second = contents.recordings
    np.testing.assert_array_equal(first.signals, TRUTH)
    expected = TRUTH[0, ::2].copy()
    expected[7] = np.nan  # its logger marked it as invalid
    np.testing.assert_array_equal(second.signals, expected[None])
    named = {(finding.code, finding.where) for finding in contents.findings}
    assert {("not-read", "a.mf4, state"), ("invalid-values", "a.mf4, c")} <= named


def test_mdf_counts_and_lengths(tmp_path: Path) -> None:
    """Every count of a block changed where the standard puts it."""
    pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    mdf(path)
    whole = path.read_bytes()

    def changed(block: bytes, offset: int, form: str, value: int) -> None:
        place = whole.index(block)
        links = int.from_bytes(whole[place + 16 : place + 24], "little")
        begin = place + (24 + 8 * links if offset >= 0 else 0) + abs(offset)
        size = struct.calcsize(form)
        path.write_bytes(whole[:begin] + struct.pack(form, value) + whole[begin + size :])

    for cycles in (199, 201, 0, 10**15):  # cycles of the first group
        changed(b"##CG", 8, "<Q", cycles)
        refused(path, "other data than the header announces")
    changed(b"##CG", 24, "<I", 40)  # bytes of a record
    refused(path, "other data than the header announces|lies outside of its record")
    changed(b"##CN", 4, "<I", 1000)  # where a channel lies in the record
    refused(path, "a channel lies outside of its record")
    changed(b"##DT", -8, "<Q", 10**6)
    refused(path, "a block does not fit into the file")
    changed(b"##CG", -32, "<Q", 64)  # link to the first channel
    refused(path, "a link leads to the wrong block; got HD")
    changed(b"##CG", -32, "<Q", 10**6 * 8)
    refused(path, "a link leads nowhere")
    path.write_bytes(whole[:-40])
    refused(path, "a link leads nowhere|does not fit")
    path.write_bytes(b"UnFinMF " + whole[8:])
    refused(path, "the logger did not finish the file")
    path.write_bytes(whole[:28] + struct.pack("<H", 330) + whole[30:])
    refused(path, "the version of the file is stated twice and differs")


def test_mdf_records_that_are_there_are_salvaged(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "a.mf4"
    times = np.arange(200) / 100
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(row, times, name=name, unit="N") for row, name in zip(TRUTH, "ab", strict=True)])
        file.save(path, overwrite=True)
    whole = path.read_bytes()
    records, group = whole.index(b"##DT"), whole.index(b"##CG")
    count = group + 24 + 8 * int.from_bytes(whole[group + 16 : group + 24], "little") + 8
    assert whole[count : count + 8] == struct.pack("<Q", 200)

    for cycles in (0, 150, 300):  # the logger did not come to write how many there are
        path.write_bytes(whole[:count] + struct.pack("<Q", cycles) + whole[count + 8 :])
        refused(path, "other data than the header announces.*salvage=true")
        np.testing.assert_array_equal(salvaged(path), TRUTH)
    # the records stand at the end, as loggers write them, and the file is cut within them
    length = int.from_bytes(whole[records + 8 : records + 16], "little")
    link = whole.index(struct.pack("<Q", records), whole.index(b"##DG"))
    behind = whole + bytes(-len(whole) % 8)
    behind = behind[:link] + struct.pack("<Q", len(behind)) + behind[link + 8 :] + whole[records : records + length]
    path.write_bytes(behind)
    np.testing.assert_array_equal(acquisition.read(path).recordings[0].signals, TRUTH)
    for lost in (1, 24, 1000, 4000):
        path.write_bytes(behind[:-lost])
        refused(path, "a block does not fit into the file.*salvage=true")
        there = salvaged(path)
        assert there.shape[1] == 200 - -(-lost // 24)  # records of three numbers
        np.testing.assert_array_equal(there, TRUTH[:, : there.shape[1]])
    # a record of another length: nothing tells where the next one begins
    path.write_bytes(whole[: count + 16] + struct.pack("<I", 40) + whole[count + 20 :])
    refused(path, "other data than the header announces", salvage=True)


def test_tdms_channels_of_texts_are_named(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        force = nptdms.ChannelObject("g", "force", TRUTH[0], {"wf_increment": 0.01, "unit_string": "N"})
        writer.write_segment([force, nptdms.ChannelObject("g", "state", ["on", "off"], {})])
    contents = acquisition.read(tmp_path / "a.tdms")
    assert [(f.code, f.where) for f in contents.findings] == [("not-read", "a.tdms, state")]


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
        ("Sampling interval (ms),20", 50),
        ("dt = 0.02 s", 50),
    ):
        (tmp_path / "a.csv").write_text(LOGGER.replace("Sampling Rate(Hz),50", line) + rows)
        (record,) = acquisition.read(tmp_path / "a.csv").recordings
        assert record.sampling_rate == rate
        assert [(c.name, c.unit) for c in record.channels] == [("Force", "N"), ("Acc", "m/s^2")]
        np.testing.assert_array_equal(record.signals[0], TRUTH[0])
    timed = "".join(f"{k / 100},{a:.6f},{b:.6f}\n" for k, (a, b) in enumerate(TRUTH.T))
    (tmp_path / "b.csv").write_text(LOGGER.replace("No.", "Time (s)") + timed)
    refused(tmp_path / "b.csv", "contradicts the time axis")


def test_a_rate_whose_mark_may_part_thousands_states_nothing(tmp_path: Path) -> None:
    """``2,048 Hz`` above a table with points is 2048 Hz rather than 2.048 Hz, and so is ``51.200 Hz`` with commas."""
    rows = "".join(f"{a:.6f};{b:.6f}\n" for a, b in TRUTH.T)
    comma = rows.replace(".", ",")
    for line, body in (("Sampling Rate: 2,048 Hz", rows), ("Abtastrate: 51.200 Hz", comma), ("dt = 1,250 s", rows)):
        (tmp_path / "a.csv").write_text(f"{line}\nF [N];a [g]\n{body}")
        refused(tmp_path / "a.csv", "does not say what its arrays are")
        assert acquisition.read(tmp_path / "a.csv", sampling_rate=2048.0).recordings[0].sampling_rate == 2048.0
    for line, body, rate in (
        ("Sampling Rate: 2.048 kHz", rows, 2048.0),
        ("Sampling Rate: 0,128 kHz", rows, 128.0),
        ("Sampling Rate: 2,048 kHz", comma, 2048.0),
    ):
        (tmp_path / "a.csv").write_text(f"{line}\nF [N];a [g]\n{body}")
        assert acquisition.read(tmp_path / "a.csv").recordings[0].sampling_rate == rate


@pytest.mark.parametrize("line", ["# sampling_rate = 200", "Fs,200", "Sample Rate: 200", "Sample Rate: 2,000"])
def test_a_rate_without_a_unit_that_contradicts_the_time_axis(tmp_path: Path, line: str) -> None:
    rows = "".join(f"{k / 100:.2f},{a:.6f}\n" for k, a in enumerate(TRUTH[0]))
    (tmp_path / "a.csv").write_text(f"{line}\nt [s],a [N]\n{rows}")
    refused(tmp_path / "a.csv", "the sampling rate contradicts the time axis")
    for stated in ("100", "0.1", "1e-4"):  # Hz, kHz, MHz
        (tmp_path / "a.csv").write_text(f"Sample Rate: {stated}\nt [s],a [N]\n{rows}")
        assert acquisition.read(tmp_path / "a.csv").recordings[0].sampling_rate == 100.0


def test_a_rate_of_the_header_that_the_layout_overrules_is_named(tmp_path: Path) -> None:
    for line in ("Sampling Rate(Hz),50", "Sample Interval,0.02"):
        (tmp_path / "a.csv").write_text(f"{line}\nForce (N)\n" + "".join(f"{a:.6f}\n" for a in TRUTH[0]))
        contents = acquisition.read(tmp_path / "a.csv", sampling_rate=100.0)
        assert contents.recordings[0].sampling_rate == 100.0
        assert [note.code for note in contents.findings] == ["rate-overruled"]


SCOPE = "Model,A 3014\nHorizontal Units,s\nSample Interval,{interval}\nRecord Length,{count}\n\nTIME,CH1,CH2\n"


@pytest.mark.parametrize("interval", ["0.01", "1.000000e-02", "10", "10000"])  # without a unit: s, ms or us
@pytest.mark.parametrize("count", ["200", "2", "200,200"])  # or the length in s
def test_a_table_as_its_header_announces_it(tmp_path: Path, interval: str, count: str) -> None:
    rows = "".join(f"{k / 100:.2f},{a:.6f},{b:.6f}\n" for k, (a, b) in enumerate(TRUTH.T))
    (tmp_path / "a.csv").write_text(SCOPE.format(interval=interval, count=count) + rows)
    contents = acquisition.read(tmp_path / "a.csv")
    assert contents.findings == ()
    np.testing.assert_array_equal(contents.recordings[0].signals, TRUTH)


@pytest.mark.parametrize(
    "line",
    ["Record Length,250", "MaxLength: 250", "Number of samples;250;250", "Number of points = 250", "Anzahl Werte: 250"],
)
def test_a_table_shorter_than_its_header_announces(tmp_path: Path, line: str) -> None:
    rows = "".join(f"{k / 100:.2f},{a:.6f},{b:.6f}\n" for k, (a, b) in enumerate(TRUTH.T))
    (tmp_path / "a.csv").write_text(f"a logger\n{line}\nt [s],a,b\n" + rows)
    refused(tmp_path / "a.csv", "another number of rows than the header announces; got 200, expected 250")
    np.testing.assert_array_equal(salvaged(tmp_path / "a.csv"), TRUTH)


@pytest.mark.parametrize("interval", ["0.02", "0.015", "2.000000e-02", "0.002"])
def test_an_interval_that_contradicts_the_time_axis(tmp_path: Path, interval: str) -> None:
    rows = "".join(f"{k / 100:.2f},{a:.6f},{b:.6f}\n" for k, (a, b) in enumerate(TRUTH.T))
    (tmp_path / "a.csv").write_text(SCOPE.format(interval=interval, count=200) + rows)
    refused(tmp_path / "a.csv", "the sampling rate contradicts the time axis")


def test_times_without_a_unit_that_make_a_slow_record_are_named(tmp_path: Path) -> None:
    for title, factor, codes in (
        ("Time", 1000, ["time-unit-assumed"]),
        ("Time (ms)", 1000, []),
        ("Time", 1, []),
    ):
        rows = "".join(f"{k / 100 * factor:.2f},{a:.6f}\n" for k, a in enumerate(TRUTH[0]))
        (tmp_path / "a.csv").write_text(f"{title},a\n" + rows)
        assert [f.code for f in acquisition.read(tmp_path / "a.csv").findings] == codes
    (tmp_path / "b.csv").write_text("Time,a\n" + "".join(f"{k * 10},{a:.6f}\n" for k, a in enumerate(TRUTH[0])))
    assert acquisition.read(tmp_path / "b.csv", time_unit="s").findings == ()
    assert acquisition.read(tmp_path / "b.csv", time_unit="ms").recordings[0].sampling_rate == 100


@pytest.mark.parametrize("name", ["fs", "Fs", "sampling_rate", "SampleRate", "dt"])
def test_a_sampling_rate_beside_the_signals_that_the_layout_overrules(tmp_path: Path, name: str) -> None:
    import h5py
    import scipy.io

    number = 0.005 if name == "dt" else 200.0
    np.savez(tmp_path / "a.npz", data=TRUTH, **{name: number})
    scipy.io.savemat(tmp_path / "a.mat", {"run": {"data": TRUTH, name: number}})
    (tmp_path / "a.json").write_text(json.dumps({"data": TRUTH.tolist(), name: number}))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"] = TRUTH
        file["data"].attrs[name] = number
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["data"] = TRUTH
        file.attrs[name] = number
    for path in sorted(tmp_path.iterdir()):
        layout = {"signals": "run.data" if path.suffix == ".mat" else "data", "axis": "rows"}
        contents = acquisition.read(path, sampling_rate=100.0, **layout)
        assert [(f.code, f.value) for f in contents.findings] == [("rate-overruled", 200.0)], path.name
        assert contents.recordings[0].sampling_rate == 100
        assert acquisition.read(path, sampling_rate=200.0, **layout).findings == ()


def test_two_arrays_of_one_name(tmp_path: Path) -> None:
    import scipy.io

    for number, values in enumerate((TRUTH, -TRUTH)):
        np.save(tmp_path / f"{number}.npy", values)
        scipy.io.savemat(tmp_path / f"{number}.mat", {"data": values})
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive, pytest.warns(UserWarning, match="Duplicate"):
        for number in range(2):
            archive.writestr("data.npy", (tmp_path / f"{number}.npy").read_bytes())
    (tmp_path / "a.mat").write_bytes((tmp_path / "0.mat").read_bytes() + (tmp_path / "1.mat").read_bytes()[128:])
    for name in ("a.npz", "a.mat"):
        refused(tmp_path / name, "two arrays of one name; got data", signals="data", sampling_rate=100.0)


def test_numbers_that_cannot_be_measured_are_named(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", TRUTH)
    data = bytearray((tmp_path / "a.npy").read_bytes())
    (tmp_path / "b.npy").write_bytes(data.replace(b"<f8", b">f8"))  # the bytes in the wrong order
    layout = {"axis": "rows", "sampling_rate": 100.0}
    assert acquisition.read(tmp_path / "a.npy", **layout).findings == ()
    assert [f.code for f in acquisition.read(tmp_path / "b.npy", **layout).findings] == ["implausible"]


def test_fortran_writes_exponents_with_a_sign(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t [s],a\n" + "".join(f"{k / 100:.2f},{k + 1}.5D-01\n" for k in range(30)))
    np.testing.assert_allclose(acquisition.read(path).recordings[0].signals[0], 0.1 * (np.arange(30) + 1.5), rtol=1e-15)
    path.write_text(path.read_text().replace("8.5D-01", "8.5D001"))
    refused(path, "a row that holds no numbers")


def test_a_pattern_is_no_matrix(tmp_path: Path) -> None:
    (tmp_path / "a.mtx").write_text("%%MatrixMarket matrix coordinate pattern symmetric\n2 2 2\n1 1\n2 2\n")
    with pytest.raises(InputError, match="a pattern without values"):
        read_matrix(tmp_path / "a.mtx")


@pytest.mark.parametrize(("spoken", "unit"), [("Newtons", "N"), ("Volts", "V"), ("Meters", "m"), ("Pascals", "Pa")])
def test_units_as_labview_spells_them(tmp_path: Path, spoken: str, unit: str) -> None:
    (tmp_path / "a.csv").write_text(f"time,a [{spoken}]\n0,1\n1,3\n2,2\n")
    assert acquisition.read(tmp_path / "a.csv").recordings[0].channels[0].unit == unit


# Containers with bytes put in -------------------------------------------------------------------------------------------


def _hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["data"] = TRUTH


def _hdf5_behind_a_text(path: Path) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512, libver="latest") as file:
        file["data"] = TRUTH


def _tdms(path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        for part in (TRUTH[:, :50], TRUTH[:, 50:]):
            about = {"wf_increment": 0.001}
            writer.write_segment([nptdms.ChannelObject("g", name, row, about) for name, row in zip("ab", part)])


def _wav(path: Path) -> None:
    pytest.importorskip("soundfile")
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(1000)
        file.writeframes((1000 * TRUTH.T).astype("<i2").tobytes())


@pytest.mark.parametrize("write", [_hdf5, _hdf5_behind_a_text, _tdms, _wav])
@pytest.mark.parametrize("count", [1, 4, 64])
def test_bytes_put_in_that_shift_the_values(tmp_path: Path, write: Callable[[Path], None], count: int) -> None:
    suffix = {"_hdf5": ".h5", "_hdf5_behind_a_text": ".h5"}.get(write.__name__, write.__name__.replace("_", "."))
    path = tmp_path / f"a{suffix}"
    options = {"signals": "data", "axis": "rows", "sampling_rate": 1000.0} if suffix == ".h5" else {}
    write(path)
    contents = acquisition.read(path, **options)
    assert contents.recordings[0].signals.shape == (2, 200)
    assert {finding.code for finding in contents.findings} <= {"full-scale"}
    whole = path.read_bytes()
    path.write_bytes(whole[:-700] + whole[-700 - count : -700] + whole[-700:])
    refused(path, "the file is not as long as it announces|other bytes behind a segment than the next one", **options)


# Universal files of modes ---------------------------------------------------------------------------------------------


def shape(*, form: str = "{:13.5e}", last: str = "", modal_a: float = 1.0, frequency: float = 100.0) -> str:
    """A data set 55 with one complex mode of small numbers on twelve nodes."""
    head = ["a mode", "NONE", "NONE", "NONE", "NONE", f"{1:10d}{3:10d}{2:10d}{8:10d}{5:10d}{3:10d}"]
    head.append(f"{2:10d}{6:10d}{1:10d}{1:10d}")
    head.append("".join(f"{x:13.5e}" for x in (-1.0, frequency, 0.0, modal_a, 0.0, 1.0)))
    rows = []
    for node in range(12):
        values = "".join(form.format(x) for x in 1e-9 * np.random.default_rng(node).normal(size=6))
        rows += [f"{node + 1:10d}", values if not last or node < 11 else values[:-13] + last]
    return "\n".join(["    -1", "    55", *head, *rows, "    -1", ""])


UNITS = "\n".join(
    [
        "    -1",
        "   164",
        f"{1:10d}{'SI':20s}{2:10d}",
        "".join(f"{1:25.16e}" for _ in range(3)),
        f"{0:25.16e}",
        "    -1",
        "",
    ]
)


@pytest.mark.parametrize("last", ["  1.00000e-0", "   .00000e+00", " 1.000000e+00", "  1.0000e+00"])
def test_a_number_of_a_shape_with_other_digits_than_all_others_is_damage(tmp_path: Path, last: str) -> None:
    (tmp_path / "a.unv").write_text(UNITS + shape() + shape(frequency=200.0, last=last))
    contents = acquisition.read(tmp_path / "a.unv")
    assert contents.modes[0].poles.shape == (1,)
    assert ["written with another number of digits" in f.message for f in contents.findings] == [True]


@pytest.mark.parametrize("form", [" {:.6g}", "{:13.5e}", "{:14.6E}", " {:.17g}"])
def test_numbers_in_one_form_or_in_as_many_digits_as_they_take_are_read(tmp_path: Path, form: str) -> None:
    (tmp_path / "a.unv").write_text(UNITS + shape(form=form))
    contents = acquisition.read(tmp_path / "a.unv")
    assert len(contents.modes) == 1 and contents.findings == ()


def test_a_mode_without_its_scale_leaves_all_unscaled_and_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.unv").write_text(UNITS + shape() + shape(modal_a=0.0, frequency=200.0))
    contents = acquisition.read(tmp_path / "a.unv")
    assert contents.modes[0].scaling == "unscaled"
    assert [f.code for f in contents.findings] == ["scaling-missing"]


# Text tables with rows and columns that go missing ----------------------------------------------------------------------


def titled(titles: str = "t [s],a,b", rows: int = 50) -> list[str]:
    return [titles, *(f"{k / 100:.2f},{a:.6f},{b:.6f}" for k, (a, b) in enumerate(TRUTH.T[:rows]))]


@pytest.mark.parametrize("row", [1, 50])
def test_a_row_of_the_table_in_front_of_its_titles(tmp_path: Path, row: int) -> None:
    lines = titled()
    (tmp_path / "a.csv").write_text("\n".join([lines.pop(row), *lines]))
    refused(tmp_path / "a.csv", "a row of the table stands in front of its titles")


def test_a_row_of_other_numbers_in_front_of_the_titles(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("\n".join(["17,1,2", *titled()]))
    contents = acquisition.read(tmp_path / "a.csv")
    assert [f.code for f in contents.findings] == ["not-read"]
    np.testing.assert_array_equal(contents.recordings[0].signals, TRUTH[:, :50])


@pytest.mark.parametrize(
    ("behind", "name"),
    [
        (["", "mean,0.1,0.2"], " 'mean'"),
        (["mean,0.1,0.2,0.3"], " 'mean'"),
        (["", "9.9,0.1"], ""),
        (["Statistics", "9.9,0.1,3"], ""),
    ],
)
def test_a_single_row_behind_the_table_is_named(tmp_path: Path, behind: list[str], name: str) -> None:
    (tmp_path / "a.csv").write_text("\n".join([*titled(), *behind]))
    contents = acquisition.read(tmp_path / "a.csv")
    assert [(f.code, f.where, f.message) for f in contents.findings] == [
        ("not-read", f"a.csv, line {51 + len(behind)}", f"a row of numbers{name} behind the table, not read.")
    ]
    np.testing.assert_array_equal(contents.recordings[0].signals, TRUTH[:, :50])


def test_a_row_that_goes_on_behind_a_table_without_titles(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("\n".join([*titled()[1:], "", "0.5,1,2"]))
    refused(tmp_path / "a.csv", "a row of the table stands behind its end", time="column 0")


@pytest.mark.parametrize("damaged", [1, 2, 3])
@pytest.mark.parametrize("merged", [False, True])
def test_a_last_row_behind_rows_without_numbers_goes_on(tmp_path: Path, *, damaged: int, merged: bool) -> None:
    *lines, last = titled()
    rows = lines[-damaged:]
    if merged:  # the end of a row is lost, and with it the row behind
        rows = [f"{row}{lines[-damaged - 1]}" for row in rows]
        damaged *= 2
    kept = lines[: len(lines) - damaged]
    broken = ["".join("x" if k % 3 else sign for k, sign in enumerate(row)) for row in rows]
    (tmp_path / "a.csv").write_text("\n".join([*kept, *broken, last]))
    refused(tmp_path / "a.csv", "a row of the table stands behind its end")


def test_a_column_with_a_title_and_nothing_else_is_named(tmp_path: Path) -> None:
    lines = titled("t [s],a,b,c,")
    (tmp_path / "a.csv").write_text("\n".join([lines[0], *(f"{line},," for line in lines[1:])]))
    contents = acquisition.read(tmp_path / "a.csv")
    assert [(f.code, f.where) for f in contents.findings] == [("not-read", "a.csv, c")]
    np.testing.assert_array_equal(contents.recordings[0].signals, TRUTH[:, :50])


@pytest.mark.parametrize("rows", [1, 2, 10])
def test_rows_with_an_empty_cell_too_many(tmp_path: Path, rows: int) -> None:
    """A second delimiter made them a table of their own, whose empty column was left out, and the rest vanished."""
    lines = titled()
    lines[-1 - rows : -1] = [line.replace(",", ",,") for line in lines[-1 - rows : -1]]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    refused(tmp_path / "a.csv", "a row of 5 cells in a table of 3 columns|rows of another number of cells")


# What gives numbers another meaning ---------------------------------------------------------------------------------------


def test_attributes_that_scale_numbers_or_stand_for_missing_ones_are_named(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["raw"] = np.arange(200)
        file["raw"].attrs["scale_factor"] = 0.01
        file["raw"].attrs["add_offset"] = 0.0
        for name, key, value in (("gain", "Gain", 2.0), ("mV", "sensitivity_mV_per_g", 100.0), ("one", "gain", 1.0)):
            file[name] = np.arange(200) * 1.0
            file[name].attrs[key] = value
        file.create_dataset("gap", data=np.where(np.arange(200) == 7, -9999.0, 1.5), fillvalue=-9999.0)
        file["zero"] = np.arange(200) * 1.0
    contents = acquisition.read(tmp_path / "a.h5", signals=["raw", "gap", "zero"], sampling_rate=10.0)
    assert [(f.code, f.where, f.message.split()[0]) for f in contents.findings] == [
        ("meaning", "a.h5, gain", "its"),
        ("meaning", "a.h5, gap", "1"),
        ("meaning", "a.h5, mV", "its"),
        ("meaning", "a.h5, raw", "its"),
    ]


def test_a_sampling_rate_that_is_several_numbers(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", data=TRUTH, rate=[100.0, 200.0])
    refused(tmp_path / "a.npz", "the sampling rate is not one number", signals="data", sampling_rate="rate")


def test_sheets_that_were_not_read_are_named(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (("t [s]", "a [N]"), *((k / 10, k + 0.5) for k in range(20))):
        book.active.append(row)
        book["second"].append(row) if "second" in book.sheetnames else book.create_sheet("second").append(row)
    book.save(tmp_path / "a.xlsx")
    contents = acquisition.read(tmp_path / "a.xlsx")
    assert [(f.code, "second" in f.message) for f in contents.findings] == [("not-read", True)]
    assert acquisition.read(tmp_path / "a.xlsx", sheet="second").findings == ()


def test_a_unit_code_that_contradicts_its_factors(tmp_path: Path) -> None:
    path = tmp_path / "a.unv"
    path.write_text(UNITS + shape())
    assert acquisition.read(path).findings == ()
    path.write_text(UNITS.replace(f"{1:10d}SI", f"{5:10d}SI") + shape())
    (note,) = acquisition.read(path).findings
    assert note.code == "unit-contradiction" and "code 5" in note.message


def test_an_exponent_of_three_digits_without_its_letter(tmp_path: Path) -> None:
    """Fortran drops the letter where the exponent needs its column (ISO/IEC 1539-1, 13.7.2.3.3)."""
    path = tmp_path / "a.unv"
    path.write_text(UNITS + shape(last="  1.00000-101"))
    (modes,) = acquisition.read(path).modes
    assert np.abs(modes.shapes[-1, 0].imag) < 1e-90


def test_nodes_of_a_trace_line_that_left_their_columns(tmp_path: Path) -> None:
    """Five bytes lost make of the nodes 100, 97 and 1 the nodes 0 (pen up), 97 and 1."""
    path = tmp_path / "a.unv"
    nodes = "".join(f"{n:10d}{1:10d}{0:10d}{11:10d}\n{n * 1.0:25.16e}{0:25.16e}{0:25.16e}\n" for n in (1, 97, 100))
    head = f"    -1\n  2411\n{nodes}    -1\n    -1\n    82\n{1:10d}{3:10d}{0:10d}\na line\n"
    path.write_text(UNITS + head + f"{100:10d}{97:10d}{1:10d}\n    -1\n")
    assert acquisition.read(path).geometry.lines == ((100, 97, 1),)
    path.write_text(UNITS + head + f"    0{97:10d}{1:10d}\n    -1\n")
    contents = acquisition.read(path)
    assert contents.geometry.lines == () and [f.code for f in contents.findings] == ["damaged-set"]


@pytest.mark.parametrize("kind", ["   151", "   164", "  2411", "   999"])
def test_an_end_and_a_beginning_on_one_line_take_no_data_set_along_in_silence(tmp_path: Path, kind: str) -> None:
    path, node = tmp_path / "a.unv", f"{7:10d}{1:10d}{0:10d}{11:10d}\n{0:25.16e}{0:25.16e}{0:25.16e}\n"
    body = {"   164": UNITS.split("\n    -1")[0].split("\n", 2)[2] + "\n", "  2411": node.replace("7", "8")}
    first = f"    -1\n{kind}\n{body.get(kind, 'a text' + chr(10))}"
    path.write_text(shape() + first + f"    -1    -1\n  2411\n{node}    -1\n")
    contents = acquisition.read(path)
    assert len(contents.modes) == 1
    assert any(f.code == "damaged-set" and "on one line" in f.message for f in contents.findings)


def test_a_segment_without_a_time_step_is_not_said_to_differ_in_it(tmp_path: Path):
    path = tmp_path / "step.lvm"
    for steps, said in (("0\t0", "the time step is not above 0"), ("0.001\t0.002", "differ in their time step")):
        text = "".join(lvm()).replace("Delta_X\t0.001\t0.001", f"Delta_X\t{steps}")
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=f"{said}; got {', '.join(steps.split())}, expected one Delta_X above 0"):
            acquisition.read(path, units="m/s^2")
