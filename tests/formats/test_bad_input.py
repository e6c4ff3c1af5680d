"""Bad files: always contents, or one sentence; never a crash, never a hang. Mutated ones, with their truth: tests/fuzz."""

import gzip
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import acquisition
from acquisition.contents import Contents
from acquisition.files.uff.header58 import Axis, Header, Point
from acquisition.files.uff.writing import function
from ema.errors import EmaError, InputError, UnitError
from tests.formats import nouns

FUZZ = settings(max_examples=60, deadline=5000, suppress_health_check=[HealthCheck.function_scoped_fixture])


def _read(path: Path) -> Contents | EmaError:
    try:
        contents = acquisition.read(path)
    except EmaError as error:
        assert "\n" not in str(error)
        assert str(error).count("Traceback") == 0
        return error
    assert isinstance(contents, Contents)
    return contents


@pytest.fixture(scope="module", params=[False, True], ids=["text", "binary"])
def sample(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("uff") / "a.uff"
    parts = (nouns.geometry(), nouns.modal_model(), nouns.modal_model(True), nouns.frf_set(21), nouns.recording())
    acquisition.write(path, *parts, binary=request.param)
    return path.read_bytes()


@given(place=st.integers(0, 10**9))
@FUZZ
def test_cut_anywhere(sample: bytes, tmp_path: Path, place: int) -> None:
    """Refused or named, unless the cut is between two data sets; what is delivered is exact."""
    length = place % len(sample)
    (tmp_path / "cut.uff").write_bytes(sample[:length])
    made = _read(tmp_path / "cut.uff")
    between = [found.end() - 7 for found in re.finditer(b"    -1\n    -1\n", sample)]
    if isinstance(made, EmaError):
        return
    whole = any(sample[:length].rstrip() == sample[:end].rstrip() for end in (*between, len(sample)))
    assert whole or any(finding.severity == "error" for finding in made.findings)
    truth = nouns.frf_set(21)
    for frfs in made.frfs:
        rows = [truth.outputs.index(dof) for dof in frfs.outputs]
        columns = [truth.inputs.index(dof) for dof in frfs.inputs]
        np.testing.assert_allclose(frfs.values, truth.values[:, rows][:, :, columns], rtol=1e-12)
    for record in made.recordings:
        signals = {channel.name: row for channel, row in zip(record.channels, record.signals, strict=True)}
        for channel, row in zip(nouns.recording().channels, nouns.recording().signals, strict=True):
            there = signals.get(channel.name, row)
            np.testing.assert_allclose(there, row[: len(there)], rtol=1e-12)


def test_a_file_cut_in_its_last_function_keeps_the_others_and_says_so(sample: bytes, tmp_path: Path) -> None:
    (tmp_path / "cut.uff").write_bytes(sample[:-2000])
    contents = acquisition.read(tmp_path / "cut.uff")
    np.testing.assert_allclose(contents.frfs[0].values, nouns.frf_set(21).values, rtol=1e-12)
    assert any(finding.code == "damaged-set" and finding.severity == "error" for finding in contents.findings)


def test_no_file_a_folder_an_empty_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        acquisition.read(tmp_path / "nothing.uff")
    with pytest.raises(InputError, match="a folder"):
        acquisition.read(tmp_path)
    (tmp_path / "empty.uff").write_bytes(b"")
    with pytest.raises(InputError, match="empty"):
        acquisition.read(tmp_path / "empty.uff")
    (tmp_path / "noise.bin").write_bytes(bytes(range(256)) * 9)
    with pytest.raises(InputError, match="not known"):
        acquisition.read(tmp_path / "noise.bin")
    (tmp_path / "noise.mat").write_bytes(bytes(range(256)) * 9)
    with pytest.raises(InputError, match="MATLAB"):
        acquisition.read(tmp_path / "noise.mat")
    (tmp_path / "half.csv.gz").write_bytes(gzip.compress(b"t,a\n0,1\n1,2\n" * 500)[:40])
    assert isinstance(_read(tmp_path / "half.csv.gz"), InputError)


def test_a_wrong_suffix_and_a_path_with_blanks_and_letters(tmp_path: Path) -> None:
    folder = tmp_path / "Prüfstand 1 ▷ 台"
    folder.mkdir()
    path = folder / "Meßpunkt 1.uff"
    acquisition.write(path, nouns.frf_set())
    assert acquisition.read(path).findings == ()
    wrong = path.rename(folder / "falsch benannt.csv")
    contents = acquisition.read(wrong)
    assert len(contents.frfs) == 1
    assert [finding.code for finding in contents.findings] == ["wrong-suffix"]


def _frf(node: int, points: int, step: float, values: complex = 1 + 1j, binary: bool = False) -> bytes:
    header = Header(
        function=4,
        kind=6,
        points=points,
        step=step,
        response=Point("NONE", node, 3),
        reference=Point("NONE", 9, 3),
        abscissa=Axis(18),
        ordinate=Axis(12, unit="m/s^2"),
        denominator=Axis(13, unit="N"),
        binary=binary,
    )
    return function(header, None, np.full(points, values))


def test_unequal_frequency_axes_become_several_sets(tmp_path: Path) -> None:
    path = tmp_path / "a.uff"
    path.write_bytes(_frf(1, 10, 1.0) + _frf(2, 10, 1.0) + _frf(3, 20, 1.0) + _frf(4, 10, 2.0))
    shapes = [frfs.values.shape for frfs in acquisition.read(path).frfs]
    assert sorted(shapes) == [(10, 1, 1), (10, 2, 1), (20, 1, 1)]


def test_a_dof_that_occurs_twice_is_reported_and_nothing_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "a.uff"
    path.write_bytes(_frf(1, 10, 1.0, 1j) + _frf(2, 10, 1.0) + _frf(1, 10, 1.0, 2j))
    contents = acquisition.read(path)
    assert [frfs.values.shape for frfs in contents.frfs] == [(10, 2, 1), (10, 1, 1)]
    assert contents.frfs[1].values[0, 0, 0] == 2j
    assert [finding.code for finding in contents.findings] == ["duplicated-dof"]


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_not_finite_are_reported(tmp_path: Path, bad: float, binary: bool) -> None:
    path = tmp_path / "a.uff"
    path.write_bytes(_frf(1, 10, 1.0, complex(bad, 0), binary) + _frf(2, 10, 1.0, binary=binary))
    contents = acquisition.read(path)
    assert contents.frfs[0].values.shape == (10, 2, 1)
    (finding,) = contents.findings
    assert (finding.code, finding.severity, finding.value) == ("not-finite", "error", 10.0)


def test_bytes_that_signal_while_they_are_compared_are_findings_and_no_warnings(tmp_path: Path) -> None:
    """A flipped bit makes 1.0 a signalling NaN of IEEE 754 (0x7ff0000000000001), which numpy warns of in a comparison."""
    one = np.frombuffer(bytes.fromhex("010000000000f07f0000000000000000"), "<c16")
    assert np.isnan(one.real[0])
    header = Header(
        function=4, kind=6, points=64, step=1.0, response=Point("NONE", 1, 3), reference=Point("NONE", 9, 3)
    )
    header = replace(header, abscissa=Axis(18), ordinate=Axis(12), denominator=Axis(13), binary=True)
    path = tmp_path / "a.uff"
    plain = function(header, None, np.ones(64, "<c16"))
    path.write_bytes(plain.replace(np.ones(61, "<c16").tobytes(), one.tobytes() * 61, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        contents = acquisition.read(path)
    assert [finding.code for finding in contents.findings] == ["not-finite"]


def test_a_huge_announced_length_costs_nothing(tmp_path: Path) -> None:
    data = _frf(1, 10, 1.0, binary=True).replace(b"        10         1", b"2000000000         1")
    (tmp_path / "a.uff").write_bytes(data + _frf(2, 10, 1.0))
    contents = acquisition.read(tmp_path / "a.uff")
    assert any(finding.code == "damaged-set" for finding in contents.findings)


def test_conflicting_and_unknown_units_are_findings(tmp_path: Path) -> None:
    data = _frf(1, 10, 1.0).replace(b" m/s^2 ", b" furlon")
    (tmp_path / "a.uff").write_bytes(data)
    contents = acquisition.read(tmp_path / "a.uff")
    assert (contents.frfs[0].quantity, contents.frfs[0].unit) == ("accelerance", "unstated")
    assert [finding.code for finding in contents.findings] == ["unit-doubtful"]
    (tmp_path / "b.uff").write_bytes(_frf(1, 10, 1.0).replace(b" m/s^2 ", b" mm/s  "))
    contents = acquisition.read(tmp_path / "b.uff")
    assert contents.frfs[0].quantity == "mobility"
    assert contents.frfs[0].values[0, 0, 0] == pytest.approx(1e-3 * (1 + 1j))
    assert "velocity" in contents.findings[0].message


def test_file_units_scale_what_has_no_label(tmp_path: Path) -> None:
    """Units of millimetre and millinewton: accelerance in (mm/s^2)/mN is that in (m/s^2)/N."""
    mm = (
        b"    -1\n   164\n         5mm (milli-newton)            2\n"
        + b"  1.0D+03  1.0D+03  1.0D+00\n  2.7315D+02\n    -1\n"
    )
    bare = _frf(1, 10, 1.0).replace(b" m/s^2 ", b" NONE  ").replace(b" N   ", b" NONE")
    (tmp_path / "a.uff").write_bytes(mm + bare)
    (frfs,) = acquisition.read(tmp_path / "a.uff").frfs
    assert (frfs.unit, frfs.values[0, 0, 0]) == ("(m/s^2)/N", pytest.approx(1 + 1j))
    inch = mm.replace(b"  1.0D+03  1.0D+03", b"  39.37007874015748  0.224808943099710482")
    (tmp_path / "b.uff").write_bytes(inch + bare)
    (frfs,) = acquisition.read(tmp_path / "b.uff").frfs
    assert frfs.values[0, 0, 0] == pytest.approx((1 + 1j) * 0.0254 / 4.4482216152605, rel=1e-6)


def test_text_that_is_no_table(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Dear all,\nplease find attached\n")
    with pytest.raises(InputError, match="no table of numbers"):
        acquisition.read(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("1,2,3\n4,5,6\n")
    with pytest.raises(InputError, match="does not say what its arrays are"):
        acquisition.read(tmp_path / "b.csv")


@given(text=st.text(alphabet="0123456789.,;-+eE \t\nabc[]()/%²", max_size=300))
@FUZZ
def test_any_text_is_read_or_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    _read(tmp_path / "t.csv")


def test_layout_mistakes_are_sentences(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.arange(12.0).reshape(3, 4))
    cases = {
        "did you mean sampling_rate": {"samplin_rate": 3},
        "columns or rows": {"axis": "sideways", "sampling_rate": 1},
        "no row 7": {"time": "row 7"},
        "nothing at this place": {"signals": "dat", "sampling_rate": 1},
        "the number of units": {"sampling_rate": 1, "units": ["N", "g"]},
        "the number of names": {"sampling_rate": 1, "names": ["a", "b"]},
        "no sampling rate": {"sampling_rate": -1.0},
        "half of an FRF": {"real": "row 0", "frequency": "row 1"},
        "do not increase": {"real": "row 0", "imaginary": "row 1", "frequency_step": 0.0},
    }
    for sentence, options in cases.items():
        with pytest.raises(InputError, match=sentence):
            acquisition.read(path, **options)
    with pytest.raises(UnitError, match="wobbles"):
        acquisition.read(path, sampling_rate=1.0, units="wobbles")


def test_objects_in_numpy_files_are_never_loaded(tmp_path: Path) -> None:
    np.save(tmp_path / "o.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="pickle"):
        acquisition.read(tmp_path / "o.npy", sampling_rate=1.0)


def test_a_record_of_one_sample_is_refused(tmp_path: Path) -> None:
    record = nouns.recording()
    acquisition.write(tmp_path / "a.uff", replace(record, signals=record.signals[:, :1]))
    with pytest.raises(InputError, match="too short"):
        acquisition.read(tmp_path / "a.uff")


def test_what_a_killed_writer_left_goes_with_the_next_write_and_a_living_one_is_left_alone(tmp_path: Path) -> None:
    import os
    import subprocess
    import sys

    from ema.store.atomic import mark

    ended = subprocess.Popen([sys.executable, "-c", "pass"])
    ended.wait()
    machine = mark().partition("-")[0]
    dead, alive = (tmp_path / f".a.uff.{machine}-{process}-x1.tmp" for process in (ended.pid, os.getpid()))
    elsewhere = tmp_path / f".a.uff.ffffff-{ended.pid}-x1.tmp"
    for path in (dead, alive, elsewhere):
        path.touch()
    acquisition.write(tmp_path / "a.uff", nouns.frf_set(21))
    assert sorted(tmp_path.iterdir()) == sorted([alive, elsewhere, tmp_path / "a.uff"])
