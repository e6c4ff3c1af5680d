"""Universal files of many data sets are read whole and in order."""

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

import acquisition
from acquisition.files.uff.header58 import Axis, Header, Point
from acquisition.files.uff.writing import function
from ema.data import Channel, Recording
from ema.dof import Dof

ROOT = Path(acquisition.__file__).resolve().parent.parent
READ = """
import json, sys, time
import acquisition
start = time.process_time()
if sys.argv[1].endswith("toml"):
    records = acquisition.open_campaign(sys.argv[1].removesuffix("campaign.toml")).runs[0].recordings
else:
    records = acquisition.read(sys.argv[1]).recordings
values = [record.signals.reshape(-1)[:: record.signals.shape[1]].tolist() for record in records]
print(json.dumps([values, time.process_time() - start]))
"""


def first_values(path: Path) -> tuple[list[list[float]], float]:
    """The first value of every channel of each record, and the processor time in s that reading takes.

    Read in a process of its own, where types and shapes are not checked: with the checks it takes minutes.
    """
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    values, seconds = json.loads(done.stdout)
    return values, seconds


def _time(node: int, value: float) -> bytes:
    header = Header(
        function=1,
        kind=2,
        points=16,
        step=0.001,
        response=Point("NONE", node, 3),
        reference=Point("NONE", 0, 0),
        abscissa=Axis(17),
        ordinate=Axis(12, unit="m/s^2"),
        denominator=Axis(0),
        binary=True,
    )
    return function(header, None, np.full(16, value, np.float32) + np.arange(16))


def _frequency(node: int, value: float, *, coherence: bool = False, lines: int = 8) -> bytes:
    header = Header(
        function=6 if coherence else 4,
        kind=4 if coherence else 6,
        points=lines,
        step=1.0,
        start=1.0,
        response=Point("NONE", node, 3),
        reference=Point("NONE", 9, 3),
        abscissa=Axis(18),
        binary=True,
        ordinate=Axis(0) if coherence else Axis(12, unit="m/s^2"),
        denominator=Axis(0) if coherence else Axis(13, unit="N"),
    )
    return function(header, None, np.linspace(0.0, 0.5, lines) + (value if coherence else value * 1j))


def _written(path: Path, sets: Iterable[bytes]) -> Path:
    path.write_bytes(b"".join(sets))
    return path


def ten_thousand_channels(folder: Path) -> Path:
    """One record of 10 000 channels."""
    return _written(folder / "a.uff", (_time(node, node) for node in range(1, 10_001)))


def fifty_thousand_records(folder: Path) -> Path:
    """50 000 records of one channel."""
    return _written(folder / "a.uff", (_time(1, number) for number in range(50_000)))


def test_ten_thousand_channels_of_one_record(tmp_path: Path) -> None:
    values, _ = first_values(ten_thousand_channels(tmp_path))
    assert values == [list(range(1, 10_001))]


def test_fifty_thousand_records(tmp_path: Path) -> None:
    values, _ = first_values(fifty_thousand_records(tmp_path))
    assert values == [[number] for number in range(50_000)]


def test_many_frfs_with_their_coherences(tmp_path: Path) -> None:
    nodes = range(1, 1001)
    sets = [
        *(_frequency(node, float(node)) for node in nodes),
        *(_frequency(node, node / 1e4, coherence=True) for node in nodes),
    ]
    (frfs,) = acquisition.read(_written(tmp_path / "a.uff", sets)).frfs
    np.testing.assert_array_equal(frfs.values[0, :, 0].imag, np.arange(1.0, 1001))
    np.testing.assert_allclose(frfs.coherence[0, :, 0], np.arange(1, 1001) / 1e4, rtol=1e-12)


def test_each_copy_of_an_frf_has_the_coherence_that_goes_with_it(tmp_path: Path) -> None:
    sets = [part for k in range(200) for part in (_frequency(1, 1.0 + k), _frequency(1, k / 4000, coherence=True))]
    contents = acquisition.read(_written(tmp_path / "a.uff", sets))
    assert len(contents.frfs) == 200
    for k, frfs in enumerate(contents.frfs):
        assert frfs.values[0, 0, 0].imag == 1.0 + k
        np.testing.assert_allclose(frfs.coherence[0, 0, 0], k / 4000, rtol=1e-12)


def test_coherences_beyond_1_are_named_once_for_the_file(tmp_path: Path) -> None:
    parts = [_frequency(1, 1.0), _frequency(1, 0.75, coherence=True), _frequency(2, 1.0, lines=20)]
    parts += [_frequency(2, 0.7, coherence=True, lines=20)]
    (tmp_path / "a.uff").write_bytes(b"".join(parts))
    contents = acquisition.read(tmp_path / "a.uff")
    beyond = [int((np.linspace(0.0, 0.5, lines) + value > 1).sum()) for lines, value in ((8, 0.75), (20, 0.7))]
    (note,) = [note for note in contents.findings if note.code == "coherence-beyond"]
    assert note.value == pytest.approx(1.25) and note.message.startswith(f"{sum(beyond)} of 28 coherences")
    percent = _frequency(1, 1.0) + _frequency(1, 90.0, coherence=True)
    (tmp_path / "b.uff").write_bytes(percent)
    contents = acquisition.read(tmp_path / "b.uff")
    assert contents.frfs[0].coherence is None and "not-read" in [note.code for note in contents.findings]


def test_a_coherence_on_another_axis_is_left_for_the_frf_it_belongs_to(tmp_path: Path) -> None:
    sets = [
        _frequency(1, 0.25, coherence=True, lines=20),
        _frequency(1, 0.5, coherence=True),
        _frequency(1, 1.0),
        _frequency(1, 2.0, lines=20),
        _frequency(2, 0.75, coherence=True),
    ]
    contents = acquisition.read(_written(tmp_path / "a.uff", sets))
    assert [(len(f.frequencies), f.coherence[0, 0, 0]) for f in contents.frfs] == [(8, 0.5), (20, 0.25)]
    assert "1 coherences belong to no FRF" in contents.findings[-1].message


def campaign_of_two_thousand_files(folder: Path, signals: np.ndarray) -> Path:
    """A campaign with a file for each of the signals (point, channel, sample); returns its ``campaign.toml``."""
    (folder / "data").mkdir()
    hammer = '[[channels]]\nname = "hammer"\nrole = "reference"\nunit = "N"\ndof = "{point}:-Z"\n\n'
    response = '[[channels]]\nname = "acc"\nrole = "response"\nunit = "m/s^2"\ndof = "1:+Z"\n\n'
    run = '[[runs]]\nid = "bare"\nkind = "hammer"\nfiles = "bare_{point}.uff"\n'
    (folder / "campaign.toml").write_text('[campaign]\nname = "many"\nfiles = "data"\n\n' + hammer + response + run)
    for point in range(1, 2001):
        channels = (
            Channel("hammer", Dof(point, "-Z"), "force", "reference", "N"),
            Channel("acc", Dof(1, "+Z"), "acceleration", "response", "m/s^2"),
        )
        acquisition.write(folder / f"data/bare_{point}.uff", Recording(signals[point - 1], 1e3, channels), binary=True)
    return folder / "campaign.toml"


def test_a_folder_of_two_thousand_files(tmp_path: Path) -> None:
    signals = np.random.default_rng(0).normal(size=(2000, 2, 256))
    values, _ = first_values(campaign_of_two_thousand_files(tmp_path, signals))
    assert sorted(values) == sorted(signals[:, :, 0].tolist())
