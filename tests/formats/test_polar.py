"""FRFs as amplitude and phase: linear or dB, degrees or radians, wrapped or not; stated or asked for, never guessed.

Truth is the receptance of a single mode, 1 / (k - m w^2 + j c w), written out in every form by this file's own formulas.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acquisition
from ema.errors import InputError, UnitError

LINES = np.linspace(5.0, 105.0, 401)
G = 9.80665


def single_mode(seed: int) -> np.ndarray:
    """Accelerance in (m/s^2)/N of two modes with random properties."""
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * LINES
    total = np.zeros(len(LINES), complex)
    for _ in range(2):
        resonance, zeta, mass = 2 * np.pi * rng.uniform(20, 90), rng.uniform(0.003, 0.03), rng.uniform(0.5, 50)
        total += -(omega**2) / mass / (resonance**2 - omega**2 + 2j * zeta * resonance * omega)
    return total


def write_table(path: Path, heading: str, frfs: np.ndarray, form: str = "dB deg", reference: float = 1.0) -> Path:
    amplitude = 20 * np.log10(np.abs(frfs) / reference) if "dB" in form else np.abs(frfs) / reference
    phase = np.angle(frfs)
    if "unwrapped" in form:
        phase = np.unwrap(phase - 2 * np.pi * LINES)  # a delay of one second makes it run on
    if "deg" in form:
        phase = np.degrees(phase)
    rows = (f"{f:.6f},{a:.12g},{p:.12g}" for f, a, p in zip(LINES, amplitude, phase, strict=True))
    path.write_text(heading + "\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def asked(path: Path, **options: Any) -> str:
    with pytest.raises(UnitError) as caught:
        acquisition.read(path, **options)
    text = str(caught.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize(
    ("heading", "reference", "unit", "scale"),
    [
        ("Frequency,Magnitude (dB re 1 (m/s^2)/N),Phase (deg)", 1.0, "(m/s^2)/N", 1.0),
        ("Frequency [Hz],Magnitude [dB re 1 g/N],Phase [°]", 1.0, "(m/s^2)/N", G),
        ("f,Mag dB re 1e-6 g/lbf,Phase degrees", 1e-6, "(m/s^2)/N", G / 4.4482216152605),
        ("Freq (Hz),Amplitude (dB ref 1e-3 (m/s²)/N),Phase_deg", 1e-3, "(m/s^2)/N", 1.0),
        ("Frequency,Magnitude (dB) re 1 (m/s^2)/N,Phase in degrees", 1.0, "(m/s^2)/N", 1.0),
        ("Frequency,FRF Magnitude (dB (g/N)),Phase (degree)", 1.0, "(m/s^2)/N", G),
        ("Frequency,Magnitude,Phase\nHz,dB re 1 g/N,deg", 1.0, "(m/s^2)/N", G),
        ("Frequency,Magnitude,Phase\n[Hz],[dB re 1],[deg]", 1.0, "unstated", 1.0),
        ("Frequency [Hz],Magnitude [dB/1.00 (m/s^2)/N],Phase [deg]", 1.0, "(m/s^2)/N", 1.0),
        ("Frequency [Hz],Magnitude dB/1.00 (m/s²)/N,Phase [deg]", 1.0, "(m/s^2)/N", 1.0),
        ("Frequency,Magnitude,Phase\nHz,dB/1.00e-3 (m/s^2)/N,degrees", 1e-3, "(m/s^2)/N", 1.0),
        ("Frequence (Hz),Amplitude (dB re 1 g/N),Phase (degrés)", 1.0, "(m/s^2)/N", G),
    ],
)
def test_decibels_and_degrees_of_the_header(
    tmp_path: Path, heading: str, reference: float, unit: str, scale: float
) -> None:
    truth = single_mode(1)
    contents = acquisition.read(write_table(tmp_path / "a.csv", heading, truth, reference=reference))
    (frfs,) = contents.frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth * scale, rtol=1e-9)
    assert frfs.unit == unit
    assert contents.findings == ()


@pytest.mark.parametrize(
    "heading",
    [
        "Frequency,Magnitude dB (um/s^2/N),Phase (deg)",
        "Frequency [Hz],Magnitude (dB) [µm/s²/N],Phase [°]",
        "f,Magnitude DB (um/s^2/N),Phase deg",
        "Frequency,Amplitude dB / (um/s^2/N),Phase / °",
        "Frequency,Amplitude in decibel (um/s^2/N),Phase angle (deg)",
        "Frequenz [Hz],Betrag in dB [um/s^2/N],Phase in Grad",
        "Frequenz,Betrag dB(µm/s²/N),Winkel [°]",
        "Frequency,Magnitude (dB),Phase\nHz,um/s^2/N,deg",
        "Frequency,Log Mag dB,Phase\nHz,um/s^2/N,deg",
        "Frequency,Magnitude (dB re 1e-6) [(m/s^2)/N],Phase [deg]",
    ],
)
def test_decibels_with_their_unit_apart(tmp_path: Path, heading: str) -> None:
    # all levels are positive: taken as linear, nothing would contradict them
    truth = single_mode(11)
    assert np.abs(truth).min() > 1e-6
    contents = acquisition.read(write_table(tmp_path / "a.csv", heading, truth, reference=1e-6))
    (frfs,) = contents.frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth, rtol=1e-9)
    assert (frfs.unit, contents.findings) == ("(m/s^2)/N", ())


@pytest.mark.parametrize(
    ("heading", "scale"),
    [
        ("Freq. Hz,Mag. (m/s^2)/N,Phs. deg", 1.0),
        ("Freq. (Hz),Mag. (g/N),Ph. (deg)", G),
        ("% Freq Hz; Mag g/N; Phase deg", G),
        ("# f [Hz]  Mag [g/N]  Phase [deg]", G),
        ("Fréquence [Hz],Module [(m/s²)/N],Phase [deg]", 1.0),
        ("Frequenza [Hz],Ampiezza [g/N],Fase [gradi]", G),
        ("Frecuencia [Hz],Amplitud [g/N],Fase [grados]", G),
        ("Hz,g/N,deg\nLinear,Magnitude,Phase", G),
    ],
)
@pytest.mark.parametrize("code", ["utf-8", "latin-1"])
def test_titles_as_programs_and_other_languages_write_them(
    tmp_path: Path, heading: str, scale: float, code: str
) -> None:
    truth = single_mode(13)
    path = write_table(tmp_path / "a.csv", heading, truth, "deg")
    path.write_bytes(path.read_text(encoding="utf-8").encode(code))
    contents = acquisition.read(path)
    (frfs,) = contents.frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth * scale, rtol=1e-9)
    np.testing.assert_allclose(frfs.frequencies, LINES, rtol=1e-9)
    assert (frfs.unit, contents.findings) == ("(m/s^2)/N", ())


@pytest.mark.parametrize(
    "heading", ["Hz,g/N,g/N\nLinear,Real,Imaginary", "Fréquence (Hz),Partie réelle (g/N),Partie imaginaire (g/N)"]
)
def test_parts_under_their_units(tmp_path: Path, heading: str) -> None:
    truth = single_mode(14)
    rows = "".join(f"{f:.6f},{h.real:.12g},{h.imag:.12g}\n" for f, h in zip(LINES, truth, strict=True))
    (tmp_path / "a.csv").write_text(f"{heading}\n{rows}", encoding="utf-8")
    (frfs,) = acquisition.read(tmp_path / "a.csv").frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth * G, rtol=1e-9)
    np.testing.assert_allclose(frfs.frequencies, LINES, rtol=1e-9)


@pytest.mark.parametrize(
    ("heading", "names"),
    [
        ("Level A,Channel V,Sensor N", ("Level A", "Channel V", "Sensor N")),
        ("measured on Monday; at noon; by hand", ("column 0", "column 1", "column 2")),
    ],
)
def test_other_words_are_neither_units_nor_titles(tmp_path: Path, heading: str, names: tuple[str, ...]) -> None:
    write_table(tmp_path / "a.csv", heading, single_mode(15), "deg")
    (record,) = acquisition.read(tmp_path / "a.csv", signals=list(names), sampling_rate=100.0).recordings
    assert tuple((channel.name, channel.unit) for channel in record.channels) == tuple((n, "unstated") for n in names)


@pytest.mark.parametrize("scale", ["dB/10", "dB/oct", "dB/div (g/N)"])
def test_fractions_of_decibels_are_no_references(tmp_path: Path, scale: str) -> None:
    path = write_table(tmp_path / "a.csv", f"Frequency,Magnitude [{scale}],Phase (deg)", single_mode(16))
    with pytest.raises(UnitError):
        acquisition.read(path)


@pytest.mark.parametrize(
    ("heading", "options"),
    [
        ("Frequency,Log Mag (um/s^2/N),Phase (deg)", {}),
        ("Frequency,Level [um/s^2/N],Phase (deg)", {}),
        ("Frequenz,Pegel (um/s^2/N),Phase (deg)", {}),
        ("Frequency,Log magnitude,Phase\nHz,um/s^2/N,deg", {}),
        ("Frequency,Log magnitude,Phase (deg)", {"unit": "um/s^2/N"}),
        (
            "Frequency,20 log10|H| (um/s^2/N),Phase (deg)",
            {"frequency": "Frequency", "amplitude": "column 1", "phase": "column 2"},
        ),
        (
            "Frequency,Magnitude dBref1 [um/s^2/N],Phase (deg)",
            {"frequency": "Frequency", "amplitude": "column 1", "phase": "column 2"},
        ),
    ],
)
def test_words_of_logarithms_are_never_linear(tmp_path: Path, heading: str, options: dict[str, Any]) -> None:
    truth = single_mode(12)
    path = write_table(tmp_path / "a.csv", heading, truth, reference=1e-6)
    assert "whether its amplitude is linear or in dB" in asked(path, **options)
    (frfs,) = acquisition.read(path, amplitude_unit="dB re 1 um/s^2/N", **options).frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth, rtol=1e-9)


@pytest.mark.parametrize(
    "phase",
    [f"Phase {unit}" for unit in ("[pi rad]", "[π rad]", "(deg/10)", "(x10 deg)", "(-deg)", "(0.01 deg)", "(mrad)")]
    + [f"Phase {unit}" for unit in ("deg (mrad)", "rad (deg)", "(turns)")],
)
def test_other_units_of_phase_are_asked_about(tmp_path: Path, phase: str) -> None:
    # a thousandth of a turn would be within any bound: only the words can tell
    heading = f"Frequency,Magnitude (g/N),{phase}"
    path = write_table(tmp_path / "a.csv", heading, 1.0 + 0.02j * single_mode(13), "linear rad")
    assert "the unit of its phase" in asked(path)


def test_a_phase_with_a_sign_in_front_is_no_phase(tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", "Frequency,Magnitude (g/N),-Phase (deg)", single_mode(14), "linear deg")
    with pytest.raises(InputError, match="does not say what its arrays are"):
        acquisition.read(path)


@pytest.mark.parametrize(
    ("heading", "form"),
    [
        ("Frequency,Magnitude ((m/s^2)/N),Phase (rad)", "linear rad"),
        ("Frequency,Magnitude [linear],Phase [rad]", "linear rad"),
        ("Frequency,Magnitude (lin),Phase (deg)", "linear deg"),
        ("Frequency,Linear magnitude,Phase (radians)", "linear rad"),
        ("Frequency,Magnitude (dB re 1 m/s^2/N),Phase (rad)", "dB rad"),
    ],
)
def test_linear_amplitudes_and_radians_of_the_header(tmp_path: Path, heading: str, form: str) -> None:
    truth = single_mode(2)
    (frfs,) = acquisition.read(write_table(tmp_path / "a.txt", heading, truth, form)).frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth, rtol=1e-9)


def test_what_is_stated_nowhere_is_asked_for_in_one_sentence(tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", "Frequency Magnitude Phase".replace(" ", ","), single_mode(3))
    text = asked(path)
    assert "whether its amplitude is linear or in dB nor the unit of its phase" in text
    assert "amplitude_unit='dB re" in text and "phase_unit='deg'" in text
    assert "the unit of its phase" in asked(path, amplitude_unit="dB re 1 g/N")
    assert "whether its amplitude" in asked(path, phase_unit="deg")
    assert "nothing says its reference" in asked(path, phase_unit="deg", amplitude_unit="dB")
    (frfs,) = acquisition.read(path, phase_unit="deg", amplitude_unit="dB re 1 g/N").frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], single_mode(3) * G, rtol=1e-9)
    (frfs,) = acquisition.read(path, phase_unit="deg", amplitude_unit="dB re unstated").frfs
    assert not frfs.scaled
    (frfs,) = acquisition.read(path, phase_unit="deg", amplitude_unit="dB re 1", unit="(m/s^2)/N").frfs
    assert frfs.scaled
    np.testing.assert_allclose(frfs.values[:, 0, 0], single_mode(3), rtol=1e-9)


def test_decibels_without_a_reference_are_asked_for_it(tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", "Frequency,Magnitude (dB),Phase (deg)", single_mode(4))
    assert "nothing says its reference" in asked(path)
    (frfs,) = acquisition.read(path, amplitude_unit="dB re 1 (m/s^2)/N").frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], single_mode(4), rtol=1e-9)


def test_columns_by_number_keep_what_their_titles_state(tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", "Frequency (kHz),Magnitude (dB re 1 g/N),Phase (deg)", single_mode(5))
    (frfs,) = acquisition.read(path, frequency="column 0", amplitude="column 1", phase="column 2").frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], single_mode(5) * G, rtol=1e-9)
    np.testing.assert_allclose(frfs.frequencies, 1000 * LINES)


def test_statements_that_contradict_the_numbers_are_errors(tmp_path: Path) -> None:
    truth = single_mode(6)
    degrees_as_radians = write_table(tmp_path / "a.csv", "Frequency,Magnitude (dB re 1),Phase (rad)", truth)
    assert "phases beyond 2 pi, though in radians" in asked(degrees_as_radians)
    assert "neither wrapped nor unwrapped" in asked(
        write_table(
            tmp_path / "a2.csv",
            "Frequency,Magnitude (dB re 1),Unwrapped phase (rad)",
            truth * np.exp(-2j * np.pi * 0.05 * LINES),
        )
    )
    levels_as_linear = write_table(tmp_path / "b.csv", "Frequency,Magnitude (g/N),Phase (deg)", truth * 1e-3)
    assert "an amplitude that is not in dB is negative" in asked(levels_as_linear)
    linear = write_table(tmp_path / "c.csv", "Frequency,Magnitude (dB re 1),Phase (deg)", truth * 1e6, "linear deg")
    assert "no structure has" in asked(linear)
    radians_as_degrees = write_table(
        tmp_path / "d.csv", "Frequency,Magnitude (dB re 1),Phase (deg)", truth * np.exp(2j * LINES), "dB rad"
    )
    assert [finding.code for finding in acquisition.read(radians_as_degrees).findings] == ["phase-unit-doubtful"]
    assert "not that of the reference" in asked(
        write_table(tmp_path / "e.csv", "Frequency,Magnitude (dB re 1 g/N),Phase (deg)", truth), unit="m/N"
    )


def test_unwrapped_phases_are_right_where_they_are_stated(tmp_path: Path) -> None:
    truth = single_mode(7)
    delayed = truth * np.exp(-2j * np.pi * LINES)
    for heading, form in (
        ("Frequency,Magnitude (dB re 1),Unwrapped phase (rad)", "dB unwrapped rad"),
        ("Frequency,Magnitude (dB re 1),Phase (unwrapped rad)", "dB unwrapped rad"),
        ("Frequency,Magnitude (dB re 1),Phase (deg)", "dB unwrapped deg"),
    ):
        (frfs,) = acquisition.read(write_table(tmp_path / "a.csv", heading, truth, form)).frfs
        np.testing.assert_allclose(frfs.values[:, 0, 0], delayed, rtol=1e-8)
    bare = write_table(tmp_path / "b.csv", "Frequency,Magnitude (dB re 1),Phase (rad)", truth, "dB unwrapped rad")
    assert "unwrapped rad" in asked(bare)
    (frfs,) = acquisition.read(bare, phase_unit="unwrapped rad").frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], delayed, rtol=1e-8)


def test_a_layout_that_says_something_else_than_the_file_is_named(tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", "Frequency,Magnitude (dB re 1 g/N),Phase (rad)", single_mode(8))
    contents = acquisition.read(path, phase_unit="deg")
    np.testing.assert_allclose(contents.frfs[0].values[:, 0, 0], single_mode(8) * G, rtol=1e-9)
    assert [finding.code for finding in contents.findings] == ["unit-overruled"]


@pytest.mark.parametrize(
    "options",
    [
        {"amplitude_unit": "decibel-ish"},
        {"amplitude_unit": "dB re wobbles"},
        {"phase_unit": "Hz"},
        {"phase_unit": "wobbles"},
        {"frequency_unit": "kg"},
    ],
)
def test_scales_that_are_none_are_refused(tmp_path: Path, options: dict[str, str]) -> None:
    path = write_table(tmp_path / "a.csv", "Frequency,Magnitude (dB re 1),Phase (deg)", single_mode(9))
    with pytest.raises(UnitError):
        acquisition.read(path, **options)


def test_workbook_with_titles_or_a_line_of_units(tmp_path: Path) -> None:
    import openpyxl

    truth = single_mode(10)
    heads = [
        [["Frequency [Hz]", "Magnitude (dB re 1 g/N)", "Phase (deg)"]],
        [["test 7"], ["Frequency", "Magnitude", "Phase"], ["Hz", "dB re 1 g/N", "deg"]],
    ]
    for number, head in enumerate(heads):
        book = openpyxl.Workbook()
        for row in head:
            book.active.append(row)
        for row in zip(LINES, 20 * np.log10(np.abs(truth)), np.degrees(np.angle(truth)), strict=True):
            book.active.append([float(cell) for cell in row])
        book.save(tmp_path / f"{number}.xlsx")
        (frfs,) = acquisition.read(tmp_path / f"{number}.xlsx").frfs
        np.testing.assert_allclose(frfs.values[:, 0, 0], truth * G, rtol=1e-9)


def test_arrays_in_containers(tmp_path: Path) -> None:
    import json

    import h5py
    import scipy.io

    truth = single_mode(11)
    arrays = {"f": LINES, "level": 20 * np.log10(np.abs(truth) / 1e-6), "arg": np.degrees(np.angle(truth))}
    places = {"frequency": "f", "amplitude": "level", "phase": "arg"}
    stated = {"amplitude_unit": "dB re 1e-6 (m/s^2)/N", "phase_unit": "deg"}
    scipy.io.savemat(tmp_path / "a.mat", arrays)
    (tmp_path / "a.json").write_text(json.dumps({name: array.tolist() for name, array in arrays.items()}))
    np.savez(tmp_path / "a.npz", **arrays)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, array in arrays.items():
            file[name] = array
    for suffix in ("mat", "json", "npz", "h5"):
        assert "nor the unit of its phase" in asked(tmp_path / f"a.{suffix}", **places)
        (frfs,) = acquisition.read(tmp_path / f"a.{suffix}", **places, **stated).frfs
        np.testing.assert_allclose(frfs.values[:, 0, 0], truth, rtol=1e-9)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        for name, array, unit in zip("fax", arrays.values(), ("Hz", stated["amplitude_unit"], "deg"), strict=True):
            file[name] = array
            file[name].attrs["unit"] = unit
    (frfs,) = acquisition.read(tmp_path / "b.h5", frequency="f", amplitude="a", phase="x").frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth, rtol=1e-9)
    named = {"f": arrays["f"], "mag_dB": arrays["level"], "phase_deg": arrays["arg"]}
    scipy.io.savemat(tmp_path / "c.mat", {"H": named})
    places = {"frequency": "H.f", "amplitude": "H.mag_dB", "phase": "H.phase_deg"}
    assert "reference" in asked(tmp_path / "c.mat", **places)
    (frfs,) = acquisition.read(tmp_path / "c.mat", **places, amplitude_unit="dB re 1e-6 (m/s^2)/N").frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth, rtol=1e-9)


def test_signalcalc_with_magnitude_and_phase(tmp_path: Path) -> None:
    truth = single_mode(12)
    head = (
        "Units: Ratio\t\nRef Chan:Resp Chan\t1+Z:2+Z\t\nChannel Name\t : \t\nChannel Comment\t : \t\n\t\n"
        "Frequency\t {}\t {}\t\n\t\nUnits:\t\nHz\t{}\t{}\t\n"
    )

    def write(titles: tuple[str, str], stated: tuple[str, str], columns: tuple[np.ndarray, np.ndarray]) -> Path:
        rows = (f"{f:.6f}\t {a:.12g}\t {b:.12g}\t\n" for f, a, b in zip(LINES, *columns, strict=True))
        (tmp_path / "a.txt").write_text(head.format(*titles, *stated) + "".join(rows), encoding="utf-8")
        return tmp_path / "a.txt"

    polar = (20 * np.log10(np.abs(truth)), np.degrees(np.angle(truth)))
    (frfs,) = acquisition.read(write(("Real", "Imaginary"), ("(m/s²)(N)", " "), (truth.real, truth.imag))).frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth, rtol=1e-9)
    assert "nor the unit" in asked(write(("Magnitude", "Phase"), ("(m/s²)(N)", " "), polar))
    path = write(("Magnitude (dB)", "Phase (deg)"), ("(m/s²)(N)", " "), polar)
    (frfs,) = acquisition.read(path, amplitude_unit="dB re 1 (m/s^2)/N").frfs
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth, rtol=1e-9)
    with pytest.raises(InputError, match="neither real and imaginary"):
        acquisition.read(write(("Nyquist", "Other"), ("", ""), polar))


def test_campaign_with_polar_tables(tmp_path: Path) -> None:
    truth = single_mode(13)
    write_table(tmp_path / "p1.csv", "Frequency,Magnitude,Phase", truth, reference=1e-3)
    text = """
[campaign]
name = "polar"
reader = {{ {} }}

[[channels]]
column = 1
role = "response"
dof = "1:+Z"

[[channels]]
column = 2
role = "reference"
dof = "1:+Z"

[[runs]]
id = "a"
files = "p1.csv"
"""
    (tmp_path / "campaign.toml").write_text(text.format('phase_unit = "deg", amplitude_unit = "dB re 1e-3 g/N"'))
    (run,) = acquisition.open_campaign(tmp_path).runs
    np.testing.assert_allclose(run.frfs[0].values[:, 0, 0], truth * G, rtol=1e-9)
    (tmp_path / "campaign.toml").write_text(text.format('phase_unit = "turns of a screw"'))
    with pytest.raises(InputError, match="not a unit of phase"):
        acquisition.open_campaign(tmp_path)
    (tmp_path / "campaign.toml").write_text(text.format('phase_unit = "deg"'))
    with pytest.raises(InputError, match="linear or in dB"):
        acquisition.open_campaign(tmp_path)


def test_two_columns_of_one_kind_are_asked_about(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("f,Mag (dB re 1),Phase (deg),Mag (dB re 1),Phase (deg)\n1,2,3,4,5\n2,2,3,4,5\n")
    with pytest.raises(InputError, match="several columns could be the amplitude"):
        acquisition.read(tmp_path / "a.csv")


def test_two_signals_of_one_title_are_two_signals(tmp_path: Path) -> None:
    rows = "".join(f"{k / 100},{k % 7},{-k}\n" for k in range(20))
    (tmp_path / "a.csv").write_text("time,acc,acc\n" + rows)
    (record,) = acquisition.read(tmp_path / "a.csv").recordings
    assert [channel.name for channel in record.channels] == ["acc", "acc #2"]
    np.testing.assert_array_equal(record.signals, [[k % 7 for k in range(20)], [-k for k in range(20)]])


@pytest.mark.parametrize(
    ("heading", "rows", "sentence"),
    [
        ("Frequency,Real,Imag", "1,2,3\n3,1,2\n2,3,4\n", "3: the frequencies|frequencies do not increase; got 2 Hz"),
        ("Frequency,Real,Imag", "-1,2,3\n0,1,2\n2,3,4\n", "a negative frequency"),
        ("Frequency (kg),Real,Imag", "1,2,3\n2,1,2\n3,3,4\n", "not a unit of frequency"),
        ("Time (samples),a", "0,2\n1,1\n2,3\n", "not a unit of time"),
    ],
)
def test_axes_that_are_none_are_refused(tmp_path: Path, heading: str, rows: str, sentence: str) -> None:
    (tmp_path / "a.csv").write_text(heading + "\n" + rows)
    with pytest.raises(InputError, match=sentence):
        acquisition.read(tmp_path / "a.csv")


def test_units_of_complex_columns_and_frequencies_are_used(tmp_path: Path) -> None:
    truth = single_mode(14)
    rows = "".join(f"{2 * np.pi * f:.12g},{v.real:.12g},{v.imag:.12g}\n" for f, v in zip(LINES, truth, strict=True))
    (tmp_path / "a.csv").write_text("Frequency [rad/s],Real [g/N],Imag [g/N]\n" + rows)
    (frfs,) = acquisition.read(tmp_path / "a.csv").frfs
    np.testing.assert_allclose(frfs.frequencies, LINES, rtol=1e-9)
    np.testing.assert_allclose(frfs.values[:, 0, 0], truth * G, rtol=1e-9)
    assert frfs.quantity == "accelerance"


def test_a_real_array_is_half_of_an_frf(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", f=LINES, h=np.abs(single_mode(15)))
    with pytest.raises(InputError, match="half of an FRF"):
        acquisition.read(tmp_path / "a.npz", frequency="f", frf="h")


def test_constant_columns_are_findings(tmp_path: Path) -> None:
    rows = "".join(f"{f:.6f},{np.sin(f):.6f},0\n" for f in LINES)
    (tmp_path / "a.csv").write_text("Frequency,Level (dB re 1),Phase (deg)\n" + rows)
    assert [finding.code for finding in acquisition.read(tmp_path / "a.csv").findings] == ["constant"]
    (tmp_path / "b.csv").write_text("time [s],force [N],acc [g]\n" + rows)
    (finding,) = acquisition.read(tmp_path / "b.csv").findings
    assert (finding.code, finding.where) == ("constant", "b.csv, acc")


def test_sampling_rates_that_contradict_the_time_axis_are_refused(tmp_path: Path) -> None:
    import h5py
    import soundfile

    times, signal = np.arange(100) / 500, np.sin(np.arange(100))
    rows = "".join(f"{t:.4f},{v:.6f}\n" for t, v in zip(times, signal, strict=True))
    (tmp_path / "a.csv").write_text("time,a\n" + rows)
    assert acquisition.read(tmp_path / "a.csv", sampling_rate=500.0).recordings[0].sampling_rate == 500
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["data"], file["time"], file["sample_rate"] = signal[:, None], times, 1000.0
    soundfile.write(tmp_path / "c.wav", 0.5 * signal, 500)
    for name in ("a.csv", "b.h5", "c.wav"):
        options = {} if name == "b.h5" else {"sampling_rate": 1000.0}
        with pytest.raises(InputError, match="contradicts the time axis"):
            acquisition.read(tmp_path / name, **options)
    (tmp_path / "d.csv").write_text("t [ms],a [N]\n" + "".join(f"{k},{k % 5}\n" for k in range(30)))
    (record,) = acquisition.read(tmp_path / "d.csv", time="column 0", signals="column 1").recordings
    assert (record.sampling_rate, record.channels[0].unit) == (1000.0, "N")
