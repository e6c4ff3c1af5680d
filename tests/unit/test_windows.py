"""FRF sets that stay in their file: written in blocks, read through windows, damaged in between."""

import os
import pickle
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from ema import store
from ema.data import FrfSet
from ema.data.window import Window
from ema.dof import Dof
from ema.errors import InputError


def frfs(outputs: int = 150, lines: int = 300, inputs: int = 2) -> FrfSet:
    rng = np.random.default_rng(3)
    values = rng.standard_normal((lines, outputs, inputs, 2)).view(complex)[..., 0]
    return FrfSet(
        np.linspace(10.0, 20.0, lines),
        values,
        tuple(Dof(node, "+Z") for node in range(outputs)),
        tuple(Dof(node, "+Z") for node in range(inputs)),
        "mobility",
        "(m/s)/N",
        variance=rng.uniform(1, 2, values.shape),
        name="scan",
    )


def header(whole: FrfSet) -> FrfSet:
    return replace(
        whole, values=whole.values[:, :0], variance=None if whole.variance is None else whole.variance[:, :0]
    )


def written(path: Path, whole: FrfSet, step: int = 37) -> FrfSet:
    with store.Writer(path, kind="noun") as writer:
        parts = (range(first, min(first + step, len(whole.outputs))) for first in range(0, len(whole.outputs), step))
        writer.begin(header(whole)).extend(whole.pick(outputs=part) for part in parts)
    return store.load(path)


def test_a_set_in_blocks_is_the_same_set(tmp_path: Path):
    whole = frfs()
    found = written(tmp_path / "scan.h5", whole)
    assert found.in_file and isinstance(found.values, Window) and isinstance(found.variance, Window)
    again = found.in_memory()
    assert not again.in_file
    np.testing.assert_array_equal(again.values, whole.values)
    np.testing.assert_array_equal(again.variance, whole.variance)
    assert (again.outputs, again.inputs, again.quantity, again.unit) == (
        whole.outputs,
        whole.inputs,
        whole.quantity,
        whole.unit,
    )


def test_parts_of_a_window_are_those_of_the_array(tmp_path: Path):
    whole = frfs()
    found = written(tmp_path / "scan.h5", whole)
    mask = np.arange(300) % 7 == 0
    for part, wanted in (
        (found.band(12.0, 14.0).pick(outputs=[140, 3, 4]), whole.band(12.0, 14.0).pick(outputs=[140, 3, 4])),
        (found.lines(mask).pick(inputs=[1]), whole.lines(mask).pick(inputs=[1])),
    ):
        assert part.in_file
        np.testing.assert_array_equal(np.asarray(part.values), wanted.values)
        np.testing.assert_array_equal(part.in_memory().variance, wanted.variance)
    assert found.to_dataframe().shape == (300, 300)
    for place in (3, -1, (slice(None), 140, 1), (slice(5, 9), 3), (np.int64(2), [3, 1], 0)):
        np.testing.assert_array_equal(found.values[place], whole.values[place])
        assert isinstance(found.values[place], np.ndarray)
    np.testing.assert_array_equal(2 * found.values - whole.values, whole.values)
    np.testing.assert_array_equal(np.abs(found.values), np.abs(whole.values))
    doubled = replace(found, values=2 * found.values)
    assert not doubled.in_file and isinstance(doubled.variance, np.ndarray)
    with pytest.raises(InputError, match=r"cut by slices.*numpy\.asarray"):
        found.values[None]


def test_lines_and_outputs_are_read_without_the_rest(tmp_path: Path):
    found = written(tmp_path / "scan.h5", frfs(outputs=640, lines=2560, inputs=1))
    source = found.values.source
    np.asarray(found.lines(slice(256, 512)).values)
    assert source.bytes_read == found.values.nbytes / 10
    np.asarray(found.pick(outputs=range(64, 128)).values)
    assert source.bytes_read == 2 * found.values.nbytes / 10


def test_a_window_goes_to_another_process_without_an_open_file(tmp_path: Path):
    whole = frfs()
    found = pickle.loads(pickle.dumps(written(tmp_path / "scan.h5", whole)))
    np.testing.assert_array_equal(found.in_memory().values, whole.values)
    assert len(pickle.dumps(found.values)) < 20_000


def test_a_set_in_a_file_is_saved_in_blocks_again(tmp_path: Path):
    whole = frfs()
    store.save(tmp_path / "band.h5", {"band": written(tmp_path / "scan.h5", whole).band(12.0, 14.0)})
    found = store.load(tmp_path / "band.h5")["band"]
    assert found.in_file
    np.testing.assert_array_equal(found.in_memory().values, whole.band(12.0, 14.0).values)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda part: replace(part, quantity="accelerance", unit="(m/s^2)/N"), r"other units.*accelerance.*mobility"),
        (lambda part: replace(part, outputs=part.outputs[::-1]), "other outputs"),
        (lambda part: replace(part, inputs=part.inputs[::-1]), "other inputs"),
        (lambda part: replace(part, frequencies=part.frequencies + 1), "other frequency lines"),
        (lambda part: replace(part, variance=None), "variance of a block of FRFs is missing"),
    ],
)
def test_a_block_that_is_not_of_its_set_is_refused_and_nothing_is_written(tmp_path: Path, change, message: str):
    whole, path = frfs(), tmp_path / "scan.h5"
    with pytest.raises(InputError, match=message), store.Writer(path, kind="noun") as writer:
        growing = writer.begin(header(whole))
        growing.append(whole.pick(outputs=range(50)))
        growing.append(change(whole.pick(outputs=range(50, 100))))
    assert list(tmp_path.iterdir()) == []


def test_a_set_that_ends_early_leaves_the_former_file(tmp_path: Path):
    whole = frfs()
    written(tmp_path / "scan.h5", whole)
    with (
        pytest.raises(InputError, match=r"ended before its last output.*got 50 outputs"),
        store.Writer(tmp_path / "scan.h5", kind="noun") as writer,
    ):
        writer.begin(header(whole)).append(whole.pick(outputs=range(50)))
    np.testing.assert_array_equal(store.load(tmp_path / "scan.h5").in_memory().values, whole.values)


def test_a_file_that_changed_or_vanished_is_one_sentence(tmp_path: Path):
    found = written(tmp_path / "scan.h5", frfs())
    written(tmp_path / "scan.h5", frfs(), step=64)
    with pytest.raises(InputError, match=r"has changed since it was opened.*load it again"):
        np.asarray(found.values)
    os.remove(tmp_path / "scan.h5")
    with pytest.raises(InputError, match="not there any more"):
        np.asarray(found.values)


def damage(path: Path, output: int) -> None:
    """Turn some bytes in the chunk of an output, and leave time and size of the file as they were."""
    with h5py.File(path) as file:
        chunk = file["items/0/values"].id.get_chunk_info_by_coord((0, output // 64 * 64, 0))
    status = os.stat(path)
    with path.open("r+b") as raw:
        raw.seek(chunk.byte_offset + chunk.size // 2)
        raw.write(b"\x13" * 16)
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


def test_a_damaged_chunk_is_named_with_its_place(tmp_path: Path):
    found = written(tmp_path / "scan.h5", frfs())
    damage(tmp_path / "scan.h5", output=100)
    np.asarray(found.pick(outputs=range(64)).values)
    with pytest.raises(InputError, match=r"values at 0 to 299, 64 to 127.*part of the file is damaged.*backup"):
        np.asarray(found.pick(outputs=range(64, 128)).values)
