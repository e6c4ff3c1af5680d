"""HDF5 and MATLAB files of unknown origin show their own bytes alone, and only what was written into them."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

import acquisition
from ema import store
from ema.data import Channel, Recording
from ema.errors import InputError

SECRET = np.arange(1.0, 201.0)


def as_matlab(path: Path, build: Callable[[h5py.File], None]) -> Path:
    """A v7.3 file: HDF5 behind a header of 512 bytes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        build(file)
    raw = bytearray(path.read_bytes())
    raw[:128] = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(raw)
    return path


def as_hdf5(path: Path, build: Callable[[h5py.File], None]) -> Path:
    with h5py.File(path, "w") as file:
        build(file)
    return path


def refused(path: Path, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as caught:
        acquisition.read(path, signals="data", sampling_rate=100.0)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


@pytest.mark.parametrize(("suffix", "wrap"), [("h5", as_hdf5), ("mat", as_matlab)])
def test_nothing_of_another_file_is_shown(
    tmp_path: Path, suffix: str, wrap: Callable[[Path, Callable[[h5py.File], None]], Path]
) -> None:
    raw, other = tmp_path / "secret.bin", tmp_path / "secret.h5"
    raw.write_bytes(SECRET.tobytes())
    as_hdf5(other, lambda file: file.create_dataset("x", data=SECRET))

    def virtual(file: h5py.File, source: Path, name: str = "x") -> None:
        layout = h5py.VirtualLayout((200,), "f8")
        layout[:] = h5py.VirtualSource(str(source), name, (200,))
        file.create_virtual_dataset("data", layout)

    def nested(file: h5py.File) -> None:
        file["data"] = np.ones(200)
        file.create_group("a/b")["c"] = h5py.ExternalLink(str(other), "x")

    def soft_way(file: h5py.File) -> None:
        file["far"] = h5py.ExternalLink(str(other), "/")
        file["data"] = h5py.SoftLink("/far/x")

    cases: dict[str, tuple[Callable[[h5py.File], object], str]] = {
        "storage": (lambda f: f.create_dataset("data", (200,), "f8", external=[(str(raw), 0, 1600)]), "another file"),
        "link": (lambda f: f.__setitem__("data", h5py.ExternalLink(str(other), "x")), "not followed"),
        "nested link": (nested, "not followed"),
        "soft link": (soft_way, "not followed"),
        "virtual": (lambda f: virtual(f, other), "another file"),
        "virtual missing": (lambda f: virtual(f, tmp_path / "absent.h5"), "another file"),
    }
    for name, (build, sentence) in cases.items():
        refused(wrap(tmp_path / f"{name}.{suffix}", build), sentence)  # type: ignore[arg-type]


@pytest.mark.parametrize(("suffix", "wrap"), [("h5", as_hdf5), ("mat", as_matlab)])
def test_values_that_were_never_written_are_not_made_up(
    tmp_path: Path, suffix: str, wrap: Callable[[Path, Callable[[h5py.File], None]], Path]
) -> None:
    def chunks(file: h5py.File) -> None:
        file.create_dataset("data", (200,), "f8", chunks=(50,))[:150] = SECRET[:150]

    def growing(file: h5py.File) -> None:
        data = file.create_dataset("data", (100,), "f8", chunks=(50,), maxshape=(None,))
        data[...] = SECRET[:100]
        data.resize((200,))

    def inside(file: h5py.File, covered: int, name: str = "x") -> None:
        file["x"] = SECRET
        layout = h5py.VirtualLayout((200,), "f8")
        layout[:covered] = h5py.VirtualSource(".", name, (200,))[:covered]
        file.create_virtual_dataset("data", layout)

    def short(file: h5py.File) -> None:
        file["x"] = SECRET[:100]
        layout = h5py.VirtualLayout((200,), "f8")
        layout[:] = h5py.VirtualSource(".", "x", (200,))
        file.create_virtual_dataset("data", layout)

    cases: dict[str, tuple[Callable[[h5py.File], object], str]] = {
        "nothing": (lambda f: f.create_dataset("data", (200,), "f8"), "never written"),
        "chunks": (chunks, "3 of 4 chunks"),
        "growing": (growing, "2 of 4 chunks"),
        "gap": (lambda f: inside(f, 120), "not all there"),
        "nowhere": (lambda f: inside(f, 200, "y"), "no such data"),  # there is no y
        "itself": (lambda f: inside(f, 200, "data"), "made of itself"),
        "short": (short, "not all there"),
    }
    for name, (build, sentence) in cases.items():
        refused(wrap(tmp_path / f"{name}.{suffix}", build), sentence)  # type: ignore[arg-type]
    good = wrap(tmp_path / f"good.{suffix}", lambda f: inside(f, 200))
    (record,) = acquisition.read(good, signals="data", sampling_rate=100.0).recordings
    np.testing.assert_array_equal(record.signals, [SECRET])


def test_objects_and_references_are_left_out_and_named(tmp_path: Path) -> None:
    def build(file: h5py.File) -> None:
        file["data"] = SECRET
        file.create_dataset("pointer", data=np.array([file["data"].ref], dtype=h5py.ref_dtype))
        file["ragged"] = np.zeros(2, [("a", "S8"), ("b", "i4")])
        file["alias"] = h5py.SoftLink("/data")
        file["loop"] = file["/"]  # a group inside itself

    contents = acquisition.read(as_hdf5(tmp_path / "a.h5", build), signals="data", sampling_rate=100.0)
    np.testing.assert_array_equal(contents.recordings[0].signals, [SECRET])
    (finding,) = contents.findings
    assert finding.code == "not-read" and "pointer" in finding.message and "ragged" in finding.message

    def table(file: h5py.File) -> None:
        file["data"] = SECRET
        file["when"] = np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype=np.uint32)
        file["when"].attrs["MATLAB_class"] = np.bytes_("datetime")
        file["when"].attrs["MATLAB_object_decode"] = 3

    contents = acquisition.read(as_matlab(tmp_path / "b.mat", table), signals="data", sampling_rate=100.0)
    assert "when" in contents.findings[0].message
    with pytest.raises(InputError, match="an array that is not read; got when, an object"):
        acquisition.read(tmp_path / "b.mat", signals="when", sampling_rate=100.0)


def test_cells_are_read_and_a_cell_inside_itself_ends(tmp_path: Path) -> None:
    def cells(file: h5py.File, circle: bool) -> None:
        store_ = file.create_group("#refs#")
        store_["a"] = SECRET
        cell = file.create_dataset("data", (1, 1), h5py.ref_dtype)
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        cell[0, 0] = cell.ref if circle else store_["a"].ref

    (record,) = acquisition.read(
        as_matlab(tmp_path / "a.mat", lambda f: cells(f, False)), signals="data.0", sampling_rate=100.0
    ).recordings
    np.testing.assert_array_equal(record.signals, [SECRET])
    refused(as_matlab(tmp_path / "b.mat", lambda f: cells(f, True)), "inside itself")


HANG = """
import sys
from pathlib import Path
import acquisition
from ema import store
from ema.errors import EmaError
for read in (store.is_store, store.load, acquisition.read):
    try:
        print(type(read(Path(sys.argv[1]))).__name__)
    except EmaError as error:
        print(error)
"""


@pytest.mark.parametrize("version", [1, 2])
def test_a_spliced_heap_of_texts_ends_in_a_sentence(tmp_path: Path, version: int) -> None:
    """Zeros in a global heap are free space of size zero, over which the library never gets."""
    path = tmp_path / "a.h5"
    store.save(path, Recording(np.ones((1, 50)), 100.0, (Channel("a"),)))
    with h5py.File(path, "r+") as file:
        if version == 1:  # as earlier versions wrote it
            file.attrs["format"] = "friction-ema store"
        file["items/0"].attrs["unit"] = "N"
    raw = bytearray(path.read_bytes())
    place = raw.find(b"GCOL\x01\0\0\0")
    while place >= 0:
        raw[place + 16 : place + 200] = bytes(184)
        place = raw.find(b"GCOL\x01\0\0\0", place + 1)
    path.write_bytes(raw)
    done = subprocess.run([sys.executable, "-c", HANG, str(path)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 3 and "damaged" in lines[2]


def test_a_store_that_announces_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    import json

    path = tmp_path / "a.h5"
    record = Recording(np.ones((1, 50)), 100.0, (Channel("a"),))
    store.save(path, {"a": record, "b": record})
    with h5py.File(path, "r+") as file:
        del file["items/1"]
    with pytest.raises(InputError, match="another number of items"):
        store.load(path)
    store.save(path, record)
    with h5py.File(path, "r+") as file:
        tree = json.loads(bytes(file["items/0/document"][0]))
        del file["items/0/document"]
        tree["channels"] = {"$items": "channels", "count": 10**15}
        file["items/0"].create_dataset("document", data=np.array([json.dumps(tree).encode()]))
    with pytest.raises(InputError, match=r"another number of items|no such data"):
        store.load(path)
    store.save(path, record)
    with h5py.File(path, "r+") as file:
        file["items/0/again/0"] = file["items/0"]
        tree = json.loads(bytes(file["items/0/document"][0]))
        tree["channels"] = {"$items": "again", "count": 1}
        del file["items/0/document"]
        file["items/0"].create_dataset("document", data=np.array([json.dumps(tree).encode()]))
    with pytest.raises(InputError):
        _ = store.load(path).channels[0]
