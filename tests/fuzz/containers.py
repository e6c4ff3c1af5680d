"""Containers of arrays and loggers' formats: damage and noise of bytes, checked with libraries that are not ours."""

import io
import logging
import os
import pickle
import random
import re
import tempfile
import wave
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from tests.fuzz.cases import Case, Reading, Signals, channels, reading
from tests.fuzz.mutations import damage, noise
from tests.fuzz.tables import STEP

_RATE = 1 / STEP
_WRITTEN = datetime(2024, 2, 1, 12, 0, 0, tzinfo=UTC)
"""When files that state it were written, so that a seed makes the same bytes at any time."""


@dataclass
class Container:
    """Two signals in a container: how it is written, how another library reads it, and what our reader has to be told."""

    name: str
    suffix: str
    write: Callable[[Path, Any], None]
    other: Callable[[Path], Any]
    options: dict[str, Any]
    names: tuple[str, str]
    scale: float = 1.0
    blind: str = ""

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""
        seed = draw.randrange(50)
        kind = draw.choice(("edit", "damage", "damage", "noise", "noise"))
        data, values = _sample(self.name, seed if kind == "edit" else seed % 5)
        truth = self._signals(values)
        if kind == "edit":
            return Case(data, "edit", "other values", truth)
        changed, what = (damage if kind == "damage" else noise)(draw, data)
        blind = self.blind if what.startswith("bytes moved") else ""
        if self.name == "matlab" and what.startswith(f"bytes lost: {_SECOND} "):
            blind = "as many bytes lost as the next variable has"
        return Case(changed, kind, what, truth, blind)

    def _signals(self, values: Any) -> Signals:
        return {name: (STEP * np.arange(values.shape[1]), self.scale * row) for name, row in zip(self.names, values)}

    def read(self, path: Path) -> Reading:
        """What our reader makes of it."""
        return reading(path, channels, **self.options)

    def independent(self, path: Path) -> list[Signals]:
        """What the other library makes of it."""
        try:
            found = self.other(path)
            if isinstance(found, dict):
                return [found]
            values = np.atleast_2d(np.asarray(found, dtype=np.float64))
        except Exception:
            return []
        return [self._signals(values)] if values.ndim == 2 and len(values) == 2 else []


@cache
def _sample(name: str, seed: int) -> tuple[bytes, Any]:
    """Bytes of a sound file and its two signals."""
    rng = np.random.default_rng(seed)
    values = np.round(0.5 * rng.uniform(-1, 1, size=(2, 60 + seed)), 6)
    if name == "wav":
        values = np.round(values * 2**15) / 2**15
    container = CONTAINERS[name]()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{container.suffix}"
        container.write(path, values)
        return path.read_bytes(), values


def _write_hdf5(path: Path, values: Any) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["data"] = values


def _read_hdf5(path: Path) -> Any:
    import h5py

    with h5py.File(path, "r") as file:
        return file["data"][()]


def _write_matlab(path: Path, values: Any) -> None:
    import scipy.io

    scipy.io.savemat(path, {"data": values, "text": "words"}, do_compression=values.shape[1] % 2 == 1)


_SECOND = 64
"""Bytes of the variable ``text`` where it is not packed."""


def _read_matlab(path: Path) -> Any:
    import scipy.io

    return scipy.io.loadmat(path)["data"]


def _write_wav(path: Path, values: Any) -> None:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(int(_RATE))
        file.writeframes((values.T * 2**15).astype("<i2").tobytes())


def _read_wav(path: Path) -> Any:
    with wave.open(str(path), "rb") as file:
        assert file.getsampwidth() == 2
        raw = file.readframes(file.getnframes())
        values = np.frombuffer(raw, "<i2").reshape(-1, file.getnchannels()).T / 2**15
        axis = np.arange(values.shape[1]) / file.getframerate()
    return {f"channel {number + 1}": (axis, row) for number, row in enumerate(values)}


def _write_tdms(path: Path, values: Any) -> None:
    import nptdms

    with nptdms.TdmsWriter(path) as writer:
        about = {"wf_increment": STEP, "unit_string": "N"}
        writer.write_segment([nptdms.ChannelObject("g", name, row, about) for name, row in zip("ab", values)])


def _read_tdms(path: Path) -> Any:
    import nptdms

    logging.disable(logging.WARNING)
    file, found = nptdms.TdmsFile.read(path), {}
    for group in file.groups():
        for channel in group.channels():
            name = channel.name if len(file.groups()) == 1 else f"{group.name}/{channel.name}"
            found[name] = (float(channel.properties["wf_increment"]) * np.arange(len(channel)), channel[:])
    return found


def _write_mdf(path: Path, values: Any) -> None:
    import asammdf

    times = STEP * np.arange(values.shape[1])
    # the time of day stands in two blocks
    with mock.patch("time.time", return_value=_WRITTEN.timestamp()), asammdf.MDF() as file:
        file.append([asammdf.Signal(row.copy(), times, name=name, unit="N") for name, row in zip("ab", values)])
        file.save(path, overwrite=True)


def _write_xlsx(path: Path, values: Any) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["t [s]", "a [N]", "b [N]"])
    for place, row in enumerate(values.T):
        book.active.append([round(STEP * place, 2), *row.tolist()])
    whole = io.BytesIO()
    book.save(whole)
    with zipfile.ZipFile(whole) as old, zipfile.ZipFile(path, "w") as new:
        for about in old.infolist():  # without the time of day, in the archive and in the properties of the book
            data = re.sub(rb"\d{4}-\d\d-\d\dT[\d:]{8}Z", _WRITTEN.strftime("%FT%TZ").encode(), old.read(about))
            fixed = zipfile.ZipInfo(about.filename, _WRITTEN.timetuple()[:6])
            new.writestr(fixed, data, zipfile.ZIP_DEFLATED)


def _read_xlsx(path: Path) -> Any:
    import openpyxl

    rows = list(openpyxl.load_workbook(path).active.iter_rows(values_only=True))[1:]
    return np.array([row[1:] for row in rows], dtype=float).T


def _read_mdf(path: Path) -> Any:
    """In a process of its own, since damaged files crash the library."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            import asammdf

            logging.disable(logging.WARNING)
            with path.open("rb") as raw, asammdf.MDF(raw) as file:
                found = {one.name: (one.timestamps, one.samples) for one in file.iter_channels(skip_master=True)}
            with os.fdopen(writing, "wb") as pipe:
                pickle.dump(found, pipe)
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        data = pipe.read()
    os.waitpid(child, 0)
    found = pickle.loads(data)  # empty where it failed, which is an error
    return {name: (_evened(stamps), values) for name, (stamps, values) in found.items()}


def _evened(stamps: Any) -> Any:
    """Time stamps without a disturbance of single ones, which no reader of an even axis keeps."""
    step = float(np.median(np.diff(stamps)))
    even = stamps[0] + step * np.arange(len(stamps))
    return even if np.all(np.abs(stamps - even) < 0.25 * step) else stamps


_DATA = {"signals": "data", "axis": "rows", "sampling_rate": _RATE}
CONTAINERS: dict[str, Callable[[], Container]] = {
    "npy": lambda: Container(
        "npy",
        ".npy",
        lambda path, values: np.save(path, values),
        np.load,
        {"sampling_rate": _RATE, "axis": "rows"},
        ("row 0", "row 1"),
        blind="bytes of an array moved",
    ),
    "npz": lambda: Container(
        "npz",
        ".npz",
        lambda path, values: np.savez(path, data=values),
        lambda path: np.load(path)["data"],
        _DATA,
        ("row 0", "row 1"),
    ),
    "hdf5": lambda: Container(
        "hdf5", ".h5", _write_hdf5, _read_hdf5, _DATA, ("row 0", "row 1"), blind="bytes of an array moved"
    ),
    "matlab": lambda: Container(
        "matlab", ".mat", _write_matlab, _read_matlab, _DATA, ("row 0", "row 1"), blind="bytes of an array moved"
    ),
    "wav": lambda: Container(
        "wav", ".wav", _write_wav, _read_wav, {}, ("channel 1", "channel 2"), blind="bytes of an array moved"
    ),
    "tdms": lambda: Container(
        "tdms", ".tdms", _write_tdms, _read_tdms, {}, ("a", "b"), blind="bytes of an array moved"
    ),
    "mdf4": lambda: Container("mdf4", ".mf4", _write_mdf, _read_mdf, {}, ("a", "b"), blind="bytes of an array moved"),
    "xlsx": lambda: Container("xlsx", ".xlsx", _write_xlsx, _read_xlsx, {}, ("a", "b")),
}
