"""Records larger than memory: signals that stay in their file give the FRFs of those in memory."""

import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.signal

import acquisition
from acquisition import file_cache
from ema import store
from ema.data import Channel, Condition, Excitation, FrfSet, Recording, Run
from ema.data.stored_signals import StoredSignals
from ema.dof import Dof
from ema.errors import InputError
from ema.estimate import hammer_test, shaker, stepped, sweep
from ema.store.reading import record_of
from tests.bench import recordings as bench

RATE = 1024.0
CHANNELS = (
    Channel("force", Dof(1, "+Z"), "force", "reference", "N"),
    *(Channel(f"a{row}", Dof(row, "+Z"), "acceleration", "response", "m/s^2") for row in (1, 2, 3)),
)


def structure(force: np.ndarray, rng: np.random.Generator) -> Recording:
    """Three accelerometers on a structure of two modes, with noise, under a force; the second drifts."""
    signals = np.empty((4, len(force)))
    signals[0] = force
    for row, shape in enumerate(((1.0, 0.7), (0.5, -0.9), (-0.8, 0.4)), 1):
        signals[row] = 1e-3 * rng.standard_normal(len(force))
        for f, zeta, size in ((83.0, 0.02, shape[0]), (171.0, 0.015, shape[1])):
            pole = np.exp(2 * np.pi * f / RATE * (-zeta + 1j))
            signals[row] += size * scipy.signal.lfilter([1, -2, 1], [1, -2 * pole.real, abs(pole) ** 2], force)
    signals[2] += np.linspace(0.0, 3.0, len(force)) ** 2
    return Recording(signals, RATE, CHANNELS, name="take")


def test(kind: str, rng: np.random.Generator) -> tuple[Run, callable]:
    """A run of two records, and what estimates its FRFs."""
    t = np.arange(20480) / RATE
    if kind == "random":  # a fit on every line: the time of 20 s would be that of all other kinds
        forces, estimator = [rng.standard_normal(8192) for _ in range(2)], shaker
    elif kind == "welch":
        forces, estimator = [rng.standard_normal(20480) for _ in range(2)], lambda run: shaker(run, method="welch")
    elif kind == "sweep":
        chirp = np.where(t < 15, np.sin(2 * np.pi * (40 * t + 6 * t**2)), 0.0)
        forces, estimator = [chirp, 1.1 * chirp], sweep
    elif kind == "stepped sine":
        forces, estimator = [np.sin(2 * np.pi * f * t) for f in (80.0, 84.0)], stepped
    else:
        forces = []
        for _ in range(2):
            force = np.zeros(20480)
            for begin in (500, 7000, 13500):
                force[begin : begin + 8] = rng.uniform(50, 90) * np.sin(np.pi * np.arange(8) / 8)
            forces.append(force + 0.01 * rng.standard_normal(20480))
        estimator = lambda run: hammer_test(run)[0]  # noqa: E731
    excitation = Excitation({"welch": "random"}.get(kind, kind))
    return Run(kind, Condition(excitation), tuple(structure(force, rng) for force in forces)), estimator


test.__test__ = False


@pytest.mark.parametrize("kind", ["random", "welch", "sweep", "stepped sine", "hammer"])
def test_frfs_of_signals_in_a_file_are_those_in_memory(tmp_path: Path, kind: str):
    """Of files that were written at once, and of files that grew block by block."""
    run, estimator = test(kind, np.random.default_rng(20261201))
    inside = estimator(run)
    for growing in (False, True):
        stored = []
        for number, record in enumerate(run.recordings):
            path = tmp_path / f"{number} {growing}.h5"
            if growing:
                with store.Writer(path, kind="noun") as writer:
                    block = writer.begin(replace(record, signals=record.signals[:, :0]))
                    for start in range(0, record.signals.shape[1], 3000):
                        block.append(record.signals[:, start : start + 3000])
            else:
                store.save(path, record)
            stored.append(record_of(path, 0, 1))
            assert isinstance(stored[-1].signals, StoredSignals)
        there = estimator(replace(run, recordings=tuple(stored)))
        assert isinstance(there, FrfSet) and np.array_equal(inside.values, there.values)
        assert np.array_equal(inside.variance, there.variance) and np.array_equal(inside.coherence, there.coherence)
        assert inside.findings == there.findings
        if kind in ("random", "sweep"):
            assert "drift" in {finding.code for finding in there.findings}


def test_an_index_gives_what_it_gives_of_an_array(tmp_path: Path):
    whole = structure(np.random.default_rng(3).standard_normal(5000), np.random.default_rng(4))
    store.save(tmp_path / "a.h5", whole)
    record = record_of(tmp_path / "a.h5", 0, 1)
    signals, values = record.signals, whole.signals
    for index in (
        0, -1, slice(None), slice(1, 3), [2, 0], np.array([True, False, True, False]), (1, slice(7, 90)), ([3, 1], slice(9)),
        (slice(None), 4), (2, -1), (slice(None), slice(5, 4000, 7)), (1, [5, 3, 4999]), (slice(None), slice(-4, None)),
        (slice(None), slice(9, 9)), (slice(2), slice(None, None, -1)),
    ):  # fmt: skip
        np.testing.assert_array_equal(signals[index], values[index])
    np.testing.assert_array_equal(np.asarray(signals), values)
    np.testing.assert_array_equal(3 * signals - values, 3 * values - values)
    np.testing.assert_array_equal([row[17] for row in signals], values[:, 17])
    assert (signals.shape, signals.nbytes, len(signals), signals.dtype) == (
        values.shape,
        values.nbytes,
        4,
        values.dtype,
    )
    scaled = signals.chosen([2, 0], [10.0, 1.0], [0.0, 5.0]).chosen([1, 0], [2.0, 3.0], [1.0, 0.0])
    np.testing.assert_allclose(scaled[:, :50], [2 * (values[0, :50] + 5) + 1, 30 * values[2, :50]], rtol=1e-14)
    there = pickle.loads(pickle.dumps(record))
    assert there == record and repr(there) == repr(whole)
    np.testing.assert_array_equal(there.signal("a2"), whole.signal("a2"))


def test_a_record_that_changed_vanished_or_is_damaged_is_one_sentence(tmp_path: Path):
    whole = structure(np.random.default_rng(3).standard_normal(200_000), np.random.default_rng(4))
    path = tmp_path / "a.h5"
    with store.Writer(path, kind="noun") as writer:
        writer.begin(replace(whole, signals=whole.signals[:, :0])).append(whole.signals)
    record = record_of(path, 0, 1)
    raw = bytearray(path.read_bytes())
    place = raw.find(whole.signals[3, 150_000:150_008].tobytes())
    raw[place] ^= 0x40
    path.write_bytes(raw)
    with pytest.raises(InputError, match=r"changed since it was opened.*load it again"):
        record.signals[3]
    record = record_of(path, 0, 1)
    np.testing.assert_array_equal(record.signals[2], whole.signals[2])
    with pytest.raises(InputError, match=r"a\.h5, signals at 3 to 3, 0 to 199999: a part of the file is damaged"):
        record.signals[3]
    path.unlink()
    with pytest.raises(InputError, match="not there any more"):
        record.signals[0]
    store.save(path, whole)  # in one piece, with one checksum
    raw = bytearray(path.read_bytes())
    raw[raw.find(whole.signals[1, 100:108].tobytes())] ^= 0x40
    path.write_bytes(raw)
    with pytest.raises(InputError, match="does not match its checksum"):
        record_of(path, 0, 1)


def test_a_campaign_scales_signals_that_stay_in_their_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    bench.generate(tmp_path, 1, 4, 4096)
    text = (tmp_path / "campaign.toml").read_text() + "\n".join(
        f'[[channels]]\nname = "{name}"\nrole = "{role}"\nunit = "{unit}"\ndof = "{node}:+Z"\n'
        for name, role, unit, node in (("a2", "response", "g", 2), ("force", "reference", "kN", 1))
    )
    path = tmp_path / "raw" / "run_00.h5"
    record = store.load(path)
    bare = tuple(replace(channel, unit="unstated", quantity="unstated") for channel in record.channels)
    store.save(path, replace(record, channels=bare))
    (tmp_path / "campaign.toml").write_text(text)
    whole = acquisition.open_campaign(tmp_path).runs[0].recordings[0]
    monkeypatch.setattr(file_cache, "IN_FILE", 1)
    there = acquisition.open_campaign(tmp_path).runs[0].recordings[0]
    assert isinstance(there.signals, StoredSignals) and isinstance(whole.signals, np.ndarray)
    np.testing.assert_allclose(np.asarray(there.signals), whole.signals, rtol=1e-14)
    np.testing.assert_allclose(there.signal("a2"), 9.80665 * record.signals[2], rtol=1e-14)


PEAK = """
import resource, sys
import acquisition, scipy.fft, scipy.ndimage
from ema.estimate import shaker
for folder in sys.argv[1:]:
    shaker(acquisition.open_campaign(folder).runs[0], method="welch", block=4096)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="resource is of POSIX")
def test_frfs_of_a_large_record_take_a_part_of_its_memory(tmp_path: Path):
    """24 channels x 600 000 samples are 115 MB; the whole of them at once, several times over, had been 0.6 GB."""
    bench.generate(tmp_path / "small", 1, 24, 20_000)
    bench.generate(tmp_path / "large", 1, 24, 600_000)
    peaks = []
    for names in (("small",), ("small", "large")):
        command = [sys.executable, "-c", PEAK, *(str(tmp_path / name) for name in names)]
        peaks.append(int(subprocess.run(command, capture_output=True, text=True, check=True).stdout))
    assert peaks[1] - peaks[0] < 80e6, peaks
