"""Arrays of records (compound types of HDF5) and sparse matrices of MATLAB files: read where their meaning is plain."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse

import acquisition
from ema.errors import InputError

RECORDS = np.zeros(30, dtype=[("t", "f8"), ("force", "f4"), ("acc", "i2"), ("more", "f8", (2,)), ("label", "S4")])
RECORDS["t"], RECORDS["force"], RECORDS["acc"] = np.arange(30) / 100, np.sin(np.arange(30)), np.arange(30)
RECORDS["more"] = np.arange(60).reshape(30, 2)


def test_the_fields_of_records_are_arrays(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["group/records"] = RECORDS
    places = [f"group/records/{name}" for name in ("force", "acc")]
    contents = acquisition.read(tmp_path / "a.h5", signals=places, time="group/records/t")
    (record,) = contents.recordings
    assert record.sampling_rate == 100.0 and [channel.name for channel in record.channels] == places
    np.testing.assert_array_equal(record.signals, np.stack([RECORDS["force"], RECORDS["acc"]]))
    assert [(note.code, "records/label" in note.message) for note in contents.findings] == [("not-read", True)]
    more = acquisition.read(tmp_path / "a.h5", signals="group/records/more", time="group/records/t").recordings[0]
    np.testing.assert_array_equal(more.signals, RECORDS["more"].T)


def test_a_table_of_pandas(tmp_path: Path) -> None:
    """``DataFrame.to_hdf(format="table")`` keeps the columns of one type as one field beside the index."""
    both = np.stack([RECORDS["force"], RECORDS["acc"]], axis=1).astype(float)
    table = np.zeros(len(both), dtype=[("index", "f8"), ("values_block_0", "f8", (2,))])
    table["index"], table["values_block_0"] = RECORDS["t"], both
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run/table"] = table
    layout = {"signals": "run/table/values_block_0", "time": "run/table/index"}
    (record,) = acquisition.read(tmp_path / "a.h5", **layout).recordings
    np.testing.assert_array_equal(record.signals, both.T)


@pytest.mark.parametrize("kind", ["npy", "npz"])
def test_the_fields_of_records_of_numpy_are_arrays(tmp_path: Path, kind: str) -> None:
    path, prefix = tmp_path / f"a.{kind}", "" if kind == "npy" else "run/"
    np.save(path, RECORDS) if kind == "npy" else np.savez(path, run=RECORDS)
    (record,) = acquisition.read(path, signals=[f"{prefix}force"], time=f"{prefix}t").recordings
    np.testing.assert_array_equal(record.signals[0], RECORDS["force"])
    with pytest.raises(InputError, match="an array that is not read"):
        acquisition.read(path, signals=[f"{prefix}label"], time=f"{prefix}t")


def _sparse_v73(path: Path, matrix: scipy.sparse.csc_matrix) -> None:
    """As MATLAB writes it: the columns' ends, the rows and the numbers that are not zero."""
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("H")
        group.attrs["MATLAB_class"], group.attrs["MATLAB_sparse"] = np.bytes_("double"), np.uint64(matrix.shape[0])
        group["data"], group["ir"] = matrix.data, matrix.indices.astype(np.uint64)
        group["jc"] = matrix.indptr.astype(np.uint64)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


@pytest.mark.parametrize("version", [5, 7.3])
def test_a_sparse_matrix_is_read_in_full(tmp_path: Path, version: float) -> None:
    full = np.zeros((3, 40))
    full[0, 4], full[2, 4], full[1, 39] = 1.5, -2.0, 3.0
    sparse = scipy.sparse.csc_matrix(full)
    if version == 5:
        scipy.io.savemat(tmp_path / "a.mat", {"H": sparse})
    else:
        _sparse_v73(tmp_path / "a.mat", sparse)
    (record,) = acquisition.read(tmp_path / "a.mat", signals="H", sampling_rate=100.0).recordings
    np.testing.assert_array_equal(record.signals, full)


@pytest.mark.parametrize("version", [5, 7.3])
def test_a_sparse_matrix_that_is_large_in_full_is_named(tmp_path: Path, version: float) -> None:
    sparse = scipy.sparse.csc_matrix(([1.0], ([0], [1])), shape=(100_000, 100_000))
    if version == 5:
        scipy.io.savemat(tmp_path / "a.mat", {"H": sparse, "x": np.ones(3)})
    else:
        _sparse_v73(tmp_path / "a.mat", sparse)
    with pytest.raises(InputError, match=r"a sparse matrix that is large in full.*100000 by 100000"):
        acquisition.read(tmp_path / "a.mat", signals="H", sampling_rate=100.0)


@pytest.mark.parametrize("version", [5, 7.3])
def test_a_damaged_sparse_matrix_is_refused_with_the_name_of_its_file(tmp_path: Path, version: float) -> None:
    path = tmp_path / "a.mat"
    if version == 5:
        scipy.io.savemat(path, {"H": scipy.sparse.csc_matrix(np.eye(4)), "x": np.ones(3)})
        whole = path.read_bytes()
        rows = np.arange(4, dtype="<i4").tobytes()  # one entry in each column, and so in each row
        assert whole.count(rows) == 2  # the rows, and the beginning of where the columns begin
        path.write_bytes(whole.replace(rows, np.array([0, 1, 17, 3], "<i4").tobytes(), 1))
    else:
        _sparse_v73(path, scipy.sparse.csc_matrix(np.eye(4)))
        with h5py.File(path, "r+") as file:
            file["H/ir"][2] = 17
    with pytest.raises(InputError, match="a sparse matrix whose places do not fit") as refused:
        acquisition.read(path, signals="H", sampling_rate=100.0)
    assert str(path) in str(refused.value)
