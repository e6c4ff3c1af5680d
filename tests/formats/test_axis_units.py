"""Units beside the usual ones: of an axis that is no time, of channels that no sensor measures, of what looks alike."""

from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition import units
from ema.data import Channel, Recording
from ema.errors import InputError, UnitError

SIGNAL = 0.5 * np.random.default_rng(7).uniform(-1, 1, 200)
LVM = """LabVIEW Measurement\t
Separator\tTab
Decimal_Separator\t.
X_Columns\tNo
***End_of_Header***\t
Channels\t1
Samples\t200
Y_Unit_Label\t{unit}
X_Dimension\t{dimension}
X_Unit_Label\t{label}
X0\t0.0
Delta_X\t0.5
***End_of_Header***\t
X_Value\tc
"""


def _tdms(path: Path, **properties: object) -> Path:
    import nptdms

    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.ChannelObject("g", "c", SIGNAL, properties)])
    return path


def _lvm(path: Path, unit: str = "N", dimension: str = "Time", label: str = "s") -> Path:
    head = LVM.format(unit=unit, dimension=dimension, label=label)
    path.write_text(head + "".join(f"\t{value!r}\n" for value in SIGNAL.tolist()))
    return path


def test_a_time_step_in_ms(tmp_path: Path) -> None:
    """LabVIEW and DIAdem state the unit of the axis beside its step: 0.5 ms is 2000 Hz."""
    tdms = _tdms(tmp_path / "a.tdms", wf_increment=0.5, wf_xname="Time", wf_xunit_string="ms", unit_string="N")
    for path in (tdms, _lvm(tmp_path / "a.lvm", label="ms")):
        (record,) = acquisition.read(path).recordings
        assert record.sampling_rate == pytest.approx(2000.0, rel=1e-12)
        np.testing.assert_allclose(record.signals[0], SIGNAL, rtol=1e-15)


def test_a_spectrum_is_no_time_signal(tmp_path: Path) -> None:
    """Its step of 0.5 Hz is not one of 0.5 s."""
    path = _tdms(tmp_path / "a.tdms", wf_increment=0.5, wf_xname="Frequency", wf_xunit_string="Hz", unit_string="g")
    with pytest.raises(InputError, match="over time"):
        acquisition.read(path)
    for options in ({"dimension": "Frequency", "label": ""}, {"label": "Hz"}):
        with pytest.raises(InputError, match="none of time"):
            acquisition.read(_lvm(tmp_path / "a.lvm", **options))


def test_a_spectrum_beside_time_signals_is_named(tmp_path: Path) -> None:
    import nptdms

    spectrum = nptdms.ChannelObject("g", "spectrum", SIGNAL, {"wf_increment": 0.5, "wf_xunit_string": "Hz"})
    force = nptdms.ChannelObject("g", "force", SIGNAL, {"wf_increment": 0.001, "unit_string": "N"})
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([force, spectrum])
    contents = acquisition.read(tmp_path / "a.tdms")
    assert [channel.name for record in contents.recordings for channel in record.channels] == ["force"]
    assert [(note.code, note.where) for note in contents.findings] == [("not-read", "a.tdms, spectrum")]


@pytest.mark.parametrize("kind", ["csv", "tdms", "lvm", "uff"])
def test_a_channel_in_what_no_sensor_measures_keeps_its_numbers(tmp_path: Path, kind: str) -> None:
    """Without a unit there is nothing that its numbers could have been converted to."""
    path = tmp_path / f"a.{kind}"
    if kind == "csv":
        rows = "".join(f"{0.001 * n:.3f},{value!r}\n" for n, value in enumerate(SIGNAL.tolist()))
        path.write_text("t [s],c [%]\n" + rows)
    elif kind == "tdms":
        _tdms(path, wf_increment=0.001, unit_string="%")
    elif kind == "lvm":
        _lvm(path, unit="%")
    else:
        acquisition.write(path, Recording(SIGNAL[None], 1000.0, (Channel("c"),), name="a"))
        lines = path.read_text().splitlines()
        place = next(number for number, line in enumerate(lines) if line.split()[:1] == ["58"]) + 9
        assert lines[place].split()[4:] == ["unstated", "unstated"]
        lines[place] = lines[place].replace("unstated", "NONE    ", 1).replace("unstated", "%       ")
        path.write_text("\n".join(lines) + "\n")
    contents = acquisition.read(path)
    (record,) = contents.recordings
    assert record.channels[0].unit == "unstated"
    np.testing.assert_allclose(record.signals[0], SIGNAL, rtol=1e-6)
    assert "unit-doubtful" in [note.code for note in contents.findings]


@pytest.mark.parametrize("text", ["Gs", "pa", "a", "ka"])
def test_no_measurement_lasts_giga_seconds_or_parts_of_a_year(text: str) -> None:
    """Meant were g, Pa, A and kA."""
    with pytest.raises(UnitError, match="unit of time"):
        units.parse(text)


def test_a_unit_of_the_layout_that_overrules_the_file_is_named(tmp_path: Path) -> None:
    rows = "".join(f"{n},{value!r}\n" for n, value in enumerate(SIGNAL.tolist()))
    (tmp_path / "a.csv").write_text("t [ms],c [m/s^2]\n" + rows)
    tdms = _tdms(tmp_path / "a.tdms", wf_increment=0.001, unit_string="m/s^2")
    for path in (tmp_path / "a.csv", tdms):
        for unit, codes in (("g", ["unit-overruled"]), ("m/s²", [])):
            contents = acquisition.read(path, units={"c": unit})
            factor = 9.80665 if unit == "g" else 1.0
            np.testing.assert_allclose(contents.recordings[0].signals[0], factor * SIGNAL, rtol=1e-12)
            assert [note.code for note in contents.findings] == codes
    contents = acquisition.read(tmp_path / "a.csv", time="t", signals=["c"], time_unit="s")
    assert contents.recordings[0].sampling_rate == 1.0
    assert [note.code for note in contents.findings] == ["unit-overruled"]


def test_a_unit_of_a_channel_that_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "t [s],acc\n" + "".join(f"{n / 1000},{v!r}\n" for n, v in enumerate(SIGNAL.tolist()))
    )
    (note,) = acquisition.read(tmp_path / "a.csv", units={"ac": "g"}).findings
    assert note.code == "unit-doubtful" and "'ac'" in note.message


def test_the_unit_of_an_array_is_that_of_its_channels(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"] = np.stack([SIGNAL, 2 * SIGNAL])
        file["data"].attrs["unit"] = "kN"
    for options in ({}, {"names": ["a", "b"]}):
        (record,) = acquisition.read(tmp_path / "a.h5", signals="data", sampling_rate=1000.0, **options).recordings
        np.testing.assert_allclose(record.signals, [1000 * SIGNAL, 2000 * SIGNAL], rtol=1e-12)
        assert [channel.unit for channel in record.channels] == ["N", "N"]


def test_single_coherences_beyond_1_are_named(tmp_path: Path) -> None:
    """One finding with the largest and how many; what rounding leaves is none of them."""
    for worst, codes in ((1.25, ["coherence-beyond"]), (1.00005, [])):
        coherences = np.full(200, 0.9)
        coherences[3], coherences[7], coherences[9] = worst, 1 + 0.4 * (worst - 1), 1.00001
        rows = zip(SIGNAL.tolist(), coherences.tolist(), strict=True)
        text = "".join(f"{2 * n + 2},{v!r},0.1,{c}\n" for n, (v, c) in enumerate(rows))
        (tmp_path / "a.csv").write_text(f"Frequency [Hz],Real [g/N],Imag [g/N],Coherence\n{text}")
        contents = acquisition.read(tmp_path / "a.csv")
        np.testing.assert_array_equal(contents.frfs[0].coherence[:, 0, 0], coherences)
        assert [note.code for note in contents.findings] == codes
        if codes:
            assert contents.findings[0].value == 1.25 and contents.findings[0].message.startswith("2 of 200 coherences")


def test_what_is_no_coherence_is_left_out(tmp_path: Path) -> None:
    """In per cent without saying so, as some programs write it; where they say so it is read."""
    rows = "".join(f"{2 * n + 2},{v!r},0.1,{60 + n / 10}\n" for n, v in enumerate(SIGNAL.tolist()))
    head = "Frequency [Hz],Real [g/N],Imag [g/N],Coherence"
    (tmp_path / "a.csv").write_text(f"{head}\n{rows}")
    contents = acquisition.read(tmp_path / "a.csv")
    assert contents.frfs[0].coherence is None
    assert [note.code for note in contents.findings] == ["not-read"]
    (tmp_path / "a.csv").write_text(f"{head} [%]\n{rows}")
    contents = acquisition.read(tmp_path / "a.csv")
    np.testing.assert_allclose(contents.frfs[0].coherence[:, 0, 0], (60 + np.arange(200) / 10) / 100, rtol=1e-12)
    assert contents.findings == ()


def test_units_of_the_layout_that_overrule_lvm_and_tdms_are_named(tmp_path: Path) -> None:
    lvm = _lvm(tmp_path / "a.lvm", unit="m/s^2")
    tdms = _tdms(tmp_path / "a.tdms", wf_increment=0.001, unit_string="m/s^2")
    for path in (lvm, tdms):
        for given in ({"c": "g"}, ["g"], "g"):
            contents = acquisition.read(path, units=given)
            np.testing.assert_allclose(contents.recordings[0].signals[0], 9.80665 * SIGNAL, rtol=1e-12)
            assert [note.code for note in contents.findings] == ["unit-overruled"]
        contents = acquisition.read(path, units={"d": "g"})  # the unit of the file holds for the others
        assert contents.recordings[0].channels[0].unit == "m/s^2"
        assert [(n.code, "'d'" in n.message) for n in contents.findings] == [("unit-doubtful", True)]
        assert acquisition.read(path, units={"c": "m/s²"}).findings == ()
        with pytest.raises(InputError, match="number of units"):
            acquisition.read(path, units=["g", "N"])


def test_a_unit_of_frequency_that_overrules_the_file_is_named(tmp_path: Path) -> None:
    rows = "".join(f"{line / 10},{line},-{line}\n" for line in range(1, 60))
    (tmp_path / "a.csv").write_text("Frequency [kHz],Real [g/N],Imag [g/N]\n" + rows)
    (tmp_path / "b.csv").write_text("Frequency kHz,Real [g/N],Imag [g/N]\n" + rows)
    places = {"frequency": "column 0", "real": "column 1", "imaginary": "column 2"}
    for path in (tmp_path / "a.csv", tmp_path / "b.csv"):
        for unit, factor, codes in (("Hz", 1.0, ["unit-overruled"]), ("kHz", 1e3, [])):
            contents = acquisition.read(path, frequency_unit=unit, **places)
            np.testing.assert_allclose(contents.frfs[0].frequencies, factor * np.arange(1, 60) / 10, rtol=1e-12)
            assert [note.code for note in contents.findings] == codes, path.name


def test_a_unit_of_signalcalc_that_the_layout_overrules_is_named(tmp_path: Path) -> None:
    head = "Units: Ratio\t\nRef Chan:Resp Chan\t1+Z:2+Z\t\n\t\nFrequency\t Real\t Imaginary\t\nHz\t(m/s^2)(N)\t \t\n"
    rows = "".join(f"{line}.0\t{line}.0\t0.0\t\n" for line in range(1, 60))
    (tmp_path / "a.txt").write_text(head + rows)
    contents = acquisition.read(tmp_path / "a.txt", unit="g/N")
    np.testing.assert_allclose(contents.frfs[0].values[:, 0, 0], 9.80665 * np.arange(1, 60), rtol=1e-12)
    assert [note.code for note in contents.findings] == ["unit-overruled"]
    assert acquisition.read(tmp_path / "a.txt", unit="m/s^2/N").findings == ()


def test_a_unit_of_length_that_the_layout_overrules_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("node,x [mm],y [mm],z [mm]\n1,1,0,0\n2,2,1,0\n3,3,0,5\n")
    nodes = "".join(f"{n:10d}{0:10d}{0:10d}{1:10d}{n:13.5E}{0.0:13.5E}{0.0:13.5E}\n" for n in (1, 2, 3))
    factors = "".join(f"{factor:25.17E}" for factor in (1000.0, 1.0, 1.0)).replace("E", "D")
    system = f"    -1\n   164\n{9:10d}{'mm, N':<20s}{2:10d}\n{factors}\n{0.0:25.17E}\n    -1\n"
    (tmp_path / "a.uff").write_text(f"{system}    -1\n    15\n{nodes}    -1\n")
    layout = {"a.csv": {"x": "x", "y": "y", "z": "z", "node": "node"}, "a.uff": {}}
    for name, places in layout.items():
        contents = acquisition.read(tmp_path / name, unit="m", **places)
        np.testing.assert_allclose(contents.geometry.xyz[:, 0], [1, 2, 3], rtol=1e-6)
        assert [note.code for note in contents.findings] == ["unit-overruled"], name
        assert acquisition.read(tmp_path / name, unit="mm", **places).findings == ()


def test_a_row_of_lvm_that_is_shifted_by_a_cell_is_refused(tmp_path):
    """A digit of a time that became a tab: its row was read with the time as the first channel's value."""
    rows = [f"{n / 100:.2f}\t{n}.5\t-{n}.25" for n in range(12)]
    rows[7] = "\t.07\t7.5\t-7.25"
    header = "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n***End_of_Header***\t\n"
    part = "Channels\t2\t\nSamples\t12\t12\t\nDelta_X\t0.01\t0.01\t\n***End_of_Header***\t\t\nX_Value\ta\tb\tComment\n"
    (tmp_path / "a.lvm").write_text(header + part + "\n".join(rows) + "\n")
    with pytest.raises(InputError, match="a row without its time"):
        acquisition.read(tmp_path / "a.lvm")
