"""The records of a campaign are read once while it is open, as far as they fit into memory; results are the same."""

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest

import acquisition.folder
from acquisition.file_cache import Files
from ema import store
from ema.data import StudyResult
from ema.errors import InputError
from ema.examples import recording
from ema.study import Study

STATED = """
[[statements]]
sentence = "120 Hz"
text = "mode 1"
source = "the model"
run = "first"
near = 120
quantity = "run frequency"
low = 119
high = 121
verdict = "matched"
"""
"""A number of which the ring-downs are asked, after the runs have been analysed."""


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each HDF5 file was opened."""
    counts: Counter[str] = Counter()

    class Counting(h5py.File):
        def __init__(self, name, *arguments, **options) -> None:
            if isinstance(name, str | Path):  # others are sinks that write
                counts[Path(name).name] += 1
            super().__init__(name, *arguments, **options)

    monkeypatch.setattr(h5py, "File", Counting)
    return counts


def numbers(result: StudyResult) -> list[np.ndarray]:
    """Everything that was computed from the records."""
    runs = [
        part
        for one in result.runs
        for part in (
            one.frfs.values,
            one.modes.poles,
            one.modes.shapes,
            one.modes.covariance,
            one.reconstruction.values,
        )
    ]
    return runs + [part for one in result.amplitude_modes for part in (one.amplitude, one.frequency.value, one.shape)]


def test_a_study_opens_each_record_for_its_kind_its_header_and_its_signals(
    small_study: Path, without_report: None, opened: Counter[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It had been opened twelve times and more: by checks, estimates, the test of linearity and ring-downs."""
    text = 'runs = ["first"]\n' + small_study.read_text(encoding="utf-8") + STATED
    small_study.write_text(text, encoding="utf-8")
    files = [path.name for path in (small_study.parent / "campaign" / "data").glob("first_*.h5")]
    once = Study.load(small_study, output=small_study.parent / "once").run()
    assert len(files) == 5 and {name: opened[name] for name in files} == dict.fromkeys(files, 3)
    opened.clear()
    monkeypatch.setattr(acquisition.folder, "Files", partial(Files, 0))
    each_time = Study.load(small_study, output=small_study.parent / "each").run()
    assert min(opened[name] for name in files) > 3
    assert len(once.amplitude_modes) > 0 and once.runs[0].findings == each_time.runs[0].findings
    for one, other in zip(numbers(once), numbers(each_time), strict=True):
        np.testing.assert_array_equal(one, other)


def test_records_are_kept_as_far_as_they_fit(tmp_path: Path, opened: Counter[str]) -> None:
    record = recording()
    for name in "abc":
        store.save(tmp_path / f"{name}.h5", record)
    files = Files(2 * record.signals.nbytes)
    takes = {name: files.takes(tmp_path / f"{name}.h5", {})[0] for name in "abc"}
    opened.clear()
    for name in "abab":
        np.testing.assert_array_equal(takes[name].read().signals, record.signals)
    assert opened == {"a.h5": 1, "b.h5": 1}
    takes["c"].read()  # in place of a, which was used longest ago
    takes["b"].read()
    takes["a"].read()
    assert opened == {"a.h5": 2, "b.h5": 1, "c.h5": 1}


def test_a_small_file_is_opened_for_its_kind_and_once_for_the_rest(tmp_path: Path, opened: Counter[str]) -> None:
    record = replace(recording(), signals=recording().signals[:, :100])
    store.save(tmp_path / "a.h5", record)
    opened.clear()
    (take,) = Files().takes(tmp_path / "a.h5", {})
    np.testing.assert_array_equal(take.read().signals, record.signals)
    assert take.samples == 100 and take.header.signals.shape == (len(record.channels), 0) and opened["a.h5"] == 2


def test_damaged_samples_of_a_small_file_are_for_who_reads_them(tmp_path: Path) -> None:
    """Checks read headers of all files; one with a wrong checksum is named when its samples are asked for."""
    signals = np.random.default_rng(0).normal(size=(len(recording().channels), 100))
    record = replace(recording(), signals=signals)
    store.save(tmp_path / "a.h5", record)
    data = bytearray((tmp_path / "a.h5").read_bytes())
    there = data.index(signals[0, 50:58].tobytes())
    data[there] ^= 1
    (tmp_path / "a.h5").write_bytes(data)
    (take,) = Files().takes(tmp_path / "a.h5", {})
    assert take.samples == 100
    with pytest.raises(InputError, match=r"a\.h5"):
        take.read()
