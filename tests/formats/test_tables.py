"""Text tables: decimal point and comma, several segments, header lines, Latin-1, packed."""

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acquisition
from ema.dof import Dof
from ema.errors import InputError

G = 9.80665


def test_german_table_with_units_in_the_titles(tmp_path: Path) -> None:
    text = "Messung vom 3. Mai\nZeit [ms];Kraft [kN];Beschl. [m/s²]\n0,0;1,5;2\n1,0;1,25;3\n2,0;-1,75E0;4\n"
    (tmp_path / "a.csv").write_bytes(text.encode("latin-1"))
    contents = acquisition.read(tmp_path / "a.csv")
    (record,) = contents.recordings
    assert record.sampling_rate == 1000.0
    assert [(c.name, c.quantity, c.unit, c.role) for c in record.channels] == [
        ("Kraft", "force", "N", "reference"),
        ("Beschl.", "acceleration", "m/s^2", "response"),
    ]
    np.testing.assert_allclose(record.signals, [[1500, 1250, -1750], [2, 3, 4]])
    assert contents.findings == ()


@pytest.mark.parametrize("code", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
@pytest.mark.parametrize("packed", [False, True])
def test_codes_and_packing(tmp_path: Path, code: str, packed: bool) -> None:
    data = "t [s]\ta [m/s²]\n0.0\t1.5\n0.5\t2.5\n1.0\t3.5\n".encode(code)
    path = tmp_path / ("a.txt.gz" if packed else "a.txt")
    path.write_bytes(gzip.compress(data) if packed else data)
    (record,) = acquisition.read(path).recordings
    assert record.channels[0].unit == "m/s^2"
    np.testing.assert_array_equal(record.signals, [[1.5, 2.5, 3.5]])


def test_several_segments(tmp_path: Path) -> None:
    one = "hit {}\ntime,force,acc\n0,1,2\n0.1,3,4\n0.2,5,6\n"
    (tmp_path / "a.csv").write_text("".join(one.format(k) for k in range(3)))
    records = acquisition.read(tmp_path / "a.csv", units={"force": "lbf", "acc": "g"}).recordings
    assert len(records) == 3
    assert [record.name for record in records] == [f"a.csv, segment {k}" for k in (1, 2, 3)]
    np.testing.assert_allclose(records[2].signals, [np.array([1, 3, 5]) * 4.4482216152605, np.array([2, 4, 6]) * G])


def test_units_in_a_line_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("time\tforce\tacc\ns\tkN\tg\n0\t1\t2\n1\t3\t4\n")
    (record,) = acquisition.read(tmp_path / "a.txt").recordings
    assert [c.name for c in record.channels] == ["force", "acc"]
    np.testing.assert_allclose(record.signals, [[1000, 3000], [2 * G, 4 * G]])


def test_an_unknown_unit_in_a_title_is_a_finding(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time [s],force [wobble]\n0,1\n1,3\n2,4\n")
    contents = acquisition.read(tmp_path / "a.csv")
    assert contents.recordings[0].channels[0].unit == "unstated"
    assert [finding.code for finding in contents.findings] == ["unknown-unit"]
    with_unit = acquisition.read(tmp_path / "a.csv", units=["N"])
    assert with_unit.recordings[0].channels[0].unit == "N"
    assert with_unit.findings == ()


def test_no_titles_and_a_layout(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("# exported\n0.00 1 10\n0.25 2 20\n0.50 3 30\n")
    (record,) = acquisition.read(
        tmp_path / "a.txt", time="column 0", names=["f", "a"], units=["N", "unstated"]
    ).recordings
    assert record.sampling_rate == 4.0
    np.testing.assert_array_equal(record.signals, [[1, 2, 3], [10, 20, 30]])
    (record,) = acquisition.read(tmp_path / "a.txt", signals=["column 2"], sampling_rate=50).recordings
    np.testing.assert_array_equal(record.signals, [[10, 20, 30]])
    assert record.sampling_rate == 50.0


def test_rounded_times_are_fine_and_a_gap_is_not(tmp_path: Path) -> None:
    times = np.arange(500) / 25600
    rows = "".join(f"{t:.6f},{k}\n" for k, t in enumerate(times))
    (tmp_path / "a.csv").write_text("time,a\n" + rows)
    (record,) = acquisition.read(tmp_path / "a.csv").recordings
    assert record.sampling_rate == pytest.approx(25600, rel=1e-4)
    kept = "".join(f"{t:.6f},{k}\n" for k, t in enumerate(times) if k not in (100, 101))
    (tmp_path / "b.csv").write_text("time,a\n" + kept)
    with pytest.raises(InputError, match="time steps are not constant"):
        acquisition.read(tmp_path / "b.csv")


def test_frf_by_its_titles_with_coherence(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Frequency [Hz],Real,Imag,Coherence\n0,1,2,1\n0.5,2,3,0.9\n1,3,4,0.8\n")
    (frfs,) = acquisition.read(tmp_path / "a.csv", unit="g/N", outputs="3:+Z", inputs="5:-Z").frfs
    assert (frfs.outputs, frfs.inputs) == ((Dof(3, "+Z"),), (Dof(5, "-Z"),))
    assert (frfs.quantity, frfs.unit) == ("accelerance", "(m/s^2)/N")
    np.testing.assert_allclose(frfs.values[:, 0, 0], G * np.array([1 + 2j, 2 + 3j, 3 + 4j]))
    assert frfs.coherence is not None
    np.testing.assert_array_equal(frfs.coherence[:, 0, 0], [1, 0.9, 0.8])


def test_amplitude_and_phase_in_degrees(tmp_path: Path) -> None:
    """Nothing in the file says that the amplitude is linear (20 dB and more are positive, too), so the layout does."""
    (tmp_path / "a.csv").write_text("f,amp,ph\n1,2,90\n2,3,-180\n")
    options = {"frequency": "f", "amplitude": "amp", "phase": "ph", "phase_unit": "deg"}
    with pytest.raises(InputError, match="whether its amplitude is linear or in dB"):
        acquisition.read(tmp_path / "a.csv", **options)
    (frfs,) = acquisition.read(tmp_path / "a.csv", **options, amplitude_unit="linear").frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], [2j, -3], atol=1e-12)


def test_geometry_by_its_titles(tmp_path: Path) -> None:
    (tmp_path / "g.csv").write_text("node,x [mm],y [mm],z [mm]\n1,0,0,0\n2,10,0,0\n7,10,5,-2\n")
    geometry = acquisition.read(tmp_path / "g.csv").geometry
    assert geometry is not None
    np.testing.assert_array_equal(geometry.nodes, [1, 2, 7])
    np.testing.assert_allclose(geometry.xyz[2], [0.01, 0.005, -0.002])
    (tmp_path / "h.csv").write_text("node,x,y,z\n1,0,0,0\n2,10,0,0\n1,10,5,-2\n")
    with pytest.raises(InputError, match="occurs twice"):
        acquisition.read(tmp_path / "h.csv")
    (tmp_path / "i.csv").write_text("node,x,y,z\n1,0,0,0\n2,10,0,0\n")
    assert [finding.code for finding in acquisition.read(tmp_path / "i.csv").findings] == ["unit-unstated"]


LVM_HEAD = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t{mark}
Multi_Headings\tYes
X_Columns\t{columns}
Operator\tme
Date\t2017/02/16
***End_of_Header***\t
\t
"""
LVM_SEGMENT = """Channels\t2\t\t\t
Samples\t3\t3\t\t
Date\t2017/02/16\t2017/02/16\t\t
Y_Unit_Label\tkN\tm/s²\t\t
X_Dimension\tTime\tTime\t\t
X0\t0,0E+0\t0,0E+0\t\t
Delta_X\t5,0E-4\t5,0E-4\t\t
***End_of_Header***\t\t\t\t
"""
LVM_ROWS = {
    "One": "X_Value\tforce\tacc\tComment\n0,0000\t1,5\t-2\tstart\n0,0005\t2,5\t3\n0,0010\t3,5\t4\n",
    "No": "X_Value\tforce\tacc\tComment\n\t1,5\t-2\n\t2,5\t3\n\t3,5\t4\n",
    "Multi": "X_Value\tforce\tX_Value\tacc\tComment\n0,0\t1,5\t0,0\t-2\n0,0005\t2,5\t0,0005\t3\n0,001\t3,5\t0,001\t4\n",
}


@pytest.mark.parametrize("columns", ["One", "No", "Multi"])
@pytest.mark.parametrize("mark", [",", "."])
def test_labview_text_with_two_segments(tmp_path: Path, columns: str, mark: str) -> None:
    body = (LVM_SEGMENT + LVM_ROWS[columns] + "\n") * 2
    text = LVM_HEAD.format(mark=mark, columns=columns) + (body if mark == "," else body.replace(",", "."))
    (tmp_path / "a.lvm").write_bytes(text.encode("latin-1"))
    contents = acquisition.read(tmp_path / "a.lvm")
    assert len(contents.recordings) == 2
    for record in contents.recordings:
        assert record.sampling_rate == 2000.0
        assert [(c.name, c.unit) for c in record.channels] == [("force", "N"), ("acc", "m/s^2")]
        np.testing.assert_allclose(record.signals, [[1500, 2500, 3500], [-2, 3, 4]])
    assert ("Operator", "me") in contents.metadata
    assert contents.findings == ()


def test_an_empty_cell_at_the_end_of_a_row_is_a_gap_in_its_column(tmp_path: Path) -> None:
    rows = [f"{k / 1000},{k},{-k}" for k in range(100)]
    rows[40] = "0.04,40,"
    (tmp_path / "gap.csv").write_text("time [s],a [N],b [m/s^2]\n" + "\n".join(rows) + "\n")
    (record,) = acquisition.read(tmp_path / "gap.csv").recordings
    assert record.signals.shape == (2, 100)
    assert np.flatnonzero(np.isnan(record.signals[1])).tolist() == [40]
    assert not np.isnan(record.signals[0]).any()


def test_a_rounded_time_column_gives_the_whole_rate(tmp_path: Path) -> None:
    rows = [f"{k / 1024:.5f},{k % 7}" for k in range(3000)]
    (tmp_path / "rounded.csv").write_text("time [s],a [N]\n" + "\n".join(rows) + "\n")
    assert acquisition.read(tmp_path / "rounded.csv").recordings[0].sampling_rate == 1024.0


@pytest.mark.parametrize("decimal", [".", ","])
def test_long_tables_are_read_in_blocks_of_lines(tmp_path: Path, decimal: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Line by line a table takes several times as long: of 51 201 lines a few at the edges of blocks are read so."""
    from acquisition.files.table import blocks

    single: list[str] = []

    def counted(line: str, *dialect: Any) -> Any:
        single.append(line)
        return cells_of(line, *dialect)

    cells_of = blocks.cells_of
    monkeypatch.setattr(blocks, "cells_of", counted)
    values = np.random.default_rng(0).normal(size=(51201, 3))
    values[:, 0] = np.arange(51201) / 8
    text = "Bench 7\nfrequency;real;imaginary\n" + "\n".join(";".join(f"{x:.9e}" for x in row) for row in values)
    (tmp_path / "long.csv").write_text(text.replace(".", decimal) + "\n\nmean;1;2;3\n")
    contents = acquisition.read(
        tmp_path / "long.csv", frequency="frequency", real="real", imaginary="imaginary", unit="unstated"
    )
    np.testing.assert_allclose(contents.frfs[0].values[:, 0, 0], values[:, 1] + 1j * values[:, 2], rtol=1e-9)
    assert len(single) < 100


def test_a_delimiter_within_quotation_marks_belongs_to_the_title(tmp_path: Path) -> None:
    rows = "\n".join(f'"{n / 100:.2f}","{n / 7:.6f}","{-n / 9:.6f}"' for n in range(50))
    (tmp_path / "a.csv").write_text(f'"Time (s)","Force, hammer (N)","Acc (m/s^2)"\n{rows}\n')
    (record,) = acquisition.read(tmp_path / "a.csv").recordings
    assert [(channel.name, channel.unit) for channel in record.channels] == [("Force, hammer", "N"), ("Acc", "m/s^2")]
    np.testing.assert_allclose(record.signals, [np.arange(50) / 7, -np.arange(50) / 9], atol=1e-6)


def test_a_line_between_digits_is_no_number(tmp_path: Path) -> None:
    """Python reads 1_0 as 10."""
    rows = [f"{n / 1000:.3f}\t{n / 7:.6f}" for n in range(50)]
    rows[20] = "0.020\t2_.857143".replace("2_.", "2_0.")
    head = "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n***End_of_Header***\t\n"
    about = "Channels\t1\nSamples\t50\nX0\t0.0\nDelta_X\t0.001\n***End_of_Header***\t\nX_Value\tacc\tComment\n"
    (tmp_path / "a.lvm").write_text(head + about + "\n".join(rows) + "\n")
    with pytest.raises(InputError, match="2_0"):
        acquisition.read(tmp_path / "a.lvm")


@pytest.mark.parametrize("titled", [True, False])
@pytest.mark.parametrize("closing", [False, True])
@pytest.mark.parametrize("mark", ["\t", ";", ","])
def test_rows_end_alike_with_a_delimiter_or_without(tmp_path: Path, mark: str, closing: bool, titled: bool) -> None:
    """A last digit that became a delimiter, or a closing delimiter that was lost, is damage in whatever row it is."""
    draw = np.random.default_rng(233)
    end = mark if closing else ""
    drawn = draw.uniform(10, 100, (20, 2))
    head = [mark.join(("t [s]", "a [N]", "b [N]"))] if titled else []
    rows = [mark.join((f"{0.01 * n:.2f}", *(f"{x:.4f}" for x in pair))) + end for n, pair in enumerate(drawn)]
    layout = {} if titled else {"time": "column 0", "signals": ["column 1", "column 2"], "unit": "N"}
    path = tmp_path / "a.csv"
    path.write_text("\n".join(head + rows) + "\n")
    np.testing.assert_allclose(acquisition.read(path, **layout).recordings[0].signals, drawn.T, atol=6e-5)
    for place in (0, 1, int(draw.integers(2, 19)), 19):
        changed = list(rows)
        changed[place] = rows[place][:-1] + ("" if closing else mark)
        path.write_text("\n".join(head + changed) + "\n")
        with pytest.raises(
            InputError, match=r"a row (of 4 cells|that ends otherwise|of the table stands)|does not say"
        ):
            acquisition.read(path, **layout)


@pytest.mark.parametrize("mark", ["\t", ";", ","])
def test_the_first_row_may_lack_the_last_number(tmp_path: Path, mark: str) -> None:
    """The titles say that there is a column."""
    rows = ["t [s],a [N],b [N]", "0.00,1.5,", "0.01,2.5,", *(f"{n / 100:.2f},{n},{-n}" for n in range(2, 20))]
    (tmp_path / "a.csv").write_text("\n".join(rows).replace(",", mark) + "\n")
    (record,) = acquisition.read(tmp_path / "a.csv").recordings
    assert np.flatnonzero(np.isnan(record.signals[1])).tolist() == [0, 1]
    np.testing.assert_allclose(record.signals[0], [1.5, 2.5, *range(2, 20)])


def test_a_complex_number_among_real_ones_is_refused(tmp_path: Path) -> None:
    """A column of complex numbers has them in all rows, but for a line at 0 Hz."""
    rows = [f"{n / 100:.2f},{n + 0.5}" for n in range(40)]
    (tmp_path / "a.csv").write_text("\n".join(["t [s],a [N]", *rows]).replace("17.5", "17.5j") + "\n")
    with pytest.raises(InputError, match=r"complex numbers in a column of real ones.*1 of 40"):
        acquisition.read(tmp_path / "a.csv")
    lines = [f"{n},{2 + n}{'' if n == 0 else '-3j'}" for n in range(40)]
    (tmp_path / "b.csv").write_text("\n".join(["Frequency [Hz],H", *lines]) + "\n")
    layout = {"frequency": "column 0", "frf": "H", "unit": "m/N", "outputs": ["1:+Z"], "inputs": ["1:+Z"]}
    (frfs,) = acquisition.read(tmp_path / "b.csv", **layout).frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], [2, *(2 + n - 3j for n in range(1, 40))])
