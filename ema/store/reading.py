"""Read containers from a file; nothing in a file is ever executed, and no file but the named one is touched."""

import contextlib
import json
import os
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import lru_cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ema.data import Lazy, Recording
from ema.data.invariants import as_stored
from ema.data.stored_signals import StoredSignals
from ema.data.window import Window
from ema.errors import EmaError, InputError
from ema.store import untrusted
from ema.store.document import decode
from ema.store.layout import CONTENTS, DOCUMENT, FORMAT, ITEMS, SCHEMA_VERSION
from ema.store.migrations import migrated
from ema.store.window import StoredArray

_FILTERS = frozenset({h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32})
_PIECE = 1 << 20
"""Samples of one channel that are read at once to check a record before it is handed out in blocks."""
_KINDS = "biufcS"
_DAMAGED = "the file is damaged or was not written to its end; read it from a backup or measure again"


_SIGNATURE = b"\x89HDF\r\n\x1a\n"
"""How HDF5 files begin that hold nothing in front, as ours do."""


@dataclass(frozen=True)
class Header:
    """What an item of a file is: for a record, all of it but its ``samples`` samples."""

    name: str
    noun: str
    record: Recording | None = None
    samples: int = 0


def is_store(path: str | Path) -> bool:
    """Return whether a file is one of ours, of any schema version.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    bool
        False also where there is no such file.

    Examples
    --------
    >>> is_store("no-such-file.h5")
    False
    """
    try:
        with open(path, "rb") as plain:
            if plain.read(len(_SIGNATURE)) != _SIGNATURE:
                return False
        with h5py.File(path, "r", locking=False) as file:
            return _ours(file)
    except (OSError, RuntimeError, KeyError):
        return False


def load(path: str | Path) -> Any:
    """Read what ``save`` wrote.

    Sequences of records inside a data type (a run in a campaign) are ``Lazy``: signals stay on disk until they are
    used. FRFs that were written in blocks (:meth:`Writer.begin`) stay on disk too; :func:`ema.fit.stabilise` and
    :func:`ema.fit.modes` read them piece by piece.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Container, mapping or Lazy
        A data type, a mapping of names to data types (items read when used), or a ``Lazy`` sequence.

    Raises
    ------
    InputError
        If there is no such file, it is not one of ours, was written by a newer version, is damaged, or changed since it
        was opened.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import frf_set, modal_model
    >>> from ema.store import save
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(f"{folder}/results.h5", {"frfs": frf_set(), "modes": modal_model()})
    ...     results = load(f"{folder}/results.h5")
    ...     sorted(results), len(results["modes"].poles)
    (['frfs', 'modes'], 3)
    """
    path = Path(path)
    with _opened(path) as file:
        kind, names = _contents(file, path)
        state = _state(path)
        if kind == "noun":
            return _item(file, f"{ITEMS}/0", path, state)
    if kind == "sequence":
        return Lazy([_maker(path, f"{ITEMS}/{place}", state) for place in range(len(names))])
    return StoredMapping({name: _maker(path, f"{ITEMS}/{place}", state) for place, name in enumerate(names)})


def containers(path: str | Path) -> list[Any]:
    """All containers of a file in their order, whether it holds one, a sequence, or a mapping by name.

    Raises
    ------
    InputError : what `load` raises.
    """
    content = load(path)
    if isinstance(content, StoredMapping):
        return list(content.values())
    return list(content) if isinstance(content, Lazy) else [content]


class StoredMapping(Mapping[str, Any]):
    """The containers of a file by name; each is read when asked for, and not kept."""

    def __init__(self, makers: dict[str, Any]) -> None:
        self._makers = makers

    def __getitem__(self, name: str) -> Any:
        return self._makers[name]()

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)


def describe(path: str | Path) -> tuple[Header, ...]:
    """Describe the items of a file, without reading any array.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    tuple of Header
        Name and type of every item; of a record also all but its samples, and their number.

    Raises
    ------
    InputError
        As :func:`load`.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import recording
    >>> from ema.store import save
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(f"{folder}/record.h5", recording())
    ...     header = describe(f"{folder}/record.h5")[0]
    >>> header.noun, header.samples
    ('Recording', 2048)
    """
    path = Path(path)
    with _opened(path) as file:
        _, names = _contents(file, path)
        return tuple(_header(file, f"{ITEMS}/{place}", name) for place, name in enumerate(names))


def record_of(path: Path, place: int, in_file: int) -> Recording:
    """The record that is the item ``place`` of a file; from ``in_file`` bytes on its signals stay there.

    Raises
    ------
    InputError : as :func:`load`, or the item is no record.
    """
    with _opened(path) as file:
        _contents(file, path)
        group, state = f"{ITEMS}/{place}", _state(path)
        tree = _tree(file, group)
        if tree.get("$noun") != "Recording":
            raise InputError("not a record", where=str(path), got=tree.get("$noun"), expected="Recording")
        node = tree["signals"]
        signals = _dataset(file[group], node["$array"])
        if signals.size * signals.dtype.itemsize < in_file or signals.ndim != 2 or signals.dtype.kind != "f":
            record: Recording = _item(file, group, path, state)
            return record
        whole, _ = _without_samples(file, group)
        stored = _window(file[group], node["$array"], path, state).source
    _check_once(path, f"{group}/{node['$array']}", node.get("crc32"), state)
    signals_there: Any = StoredSignals(stored)
    return replace(whole, signals=signals_there)


@lru_cache(256)
def _check_once(path: Path, name: str, checksum: int | None, state: tuple[int, int, int]) -> None:
    """Compare the signals of a file with their checksum, once for each state of it.

    Raises
    ------
    InputError : they differ.
    """
    with _opened(path) as file:
        _check_pieces(_dataset(file, name), checksum, _PIECE)


def blocks(path: str | Path, samples: int, name: str | None = None) -> Iterator[Recording]:
    """Read a record of any length in consecutive blocks.

    Parameters
    ----------
    path : str or Path
        The file.
    samples : int
        Largest number of samples of a block.
    name : str, optional
        Which of several records of the file; the first item by default.

    Yields
    ------
    Recording
        The next block, with its start time.

    Raises
    ------
    InputError
        As :func:`load`; or if there is no such record, or the item is no record.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import recording
    >>> from ema.store import save
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(f"{folder}/record.h5", recording())
    ...     [block.signals.shape[1] for block in blocks(f"{folder}/record.h5", samples=1000)]
    [1000, 1000, 48]
    """
    path = Path(path)
    with _opened(path) as file:
        _, names = _contents(file, path)
        if name is not None and name not in names:
            raise InputError("no such record in the file", where=str(path), got=name, expected=", ".join(names[:20]))
        group = f"{ITEMS}/{0 if name is None else names.index(name)}"
        if _tree(file, group).get("$noun") != "Recording":
            raise InputError(
                "not a record",
                where=str(path),
                got=_tree(file, group).get("$noun"),
                expected="Recording",
                advice="name an item that is a record, or read this one by ema.store.load",
            )
        node = _tree(file, group)["signals"]
        signals = _dataset(file[group], node["$array"])
        whole, _ = _without_samples(file, group)
        _check_pieces(signals, node.get("crc32"), max(samples, _PIECE))
        for start in range(0, signals.shape[1], samples):
            moment = None if whole.start is None else whole.start + timedelta(seconds=start / whole.sampling_rate)
            yield replace(whole, signals=signals[:, start : start + samples], start=moment)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """The file, open for reading; whatever goes wrong inside becomes one sentence."""
    if path.is_dir():
        raise InputError(
            "a folder, not a file",
            where=str(path),
            advice="name a file in it, or open a campaign by acquisition.open_campaign",
        )
    try:
        with h5py.File(path, "r", locking=False) as file:
            yield file
    except FileNotFoundError as error:
        raise InputError("there is no such file", where=str(path), advice="correct the path") from error
    except PermissionError as error:
        raise InputError(
            "no permission to read this file", where=str(path), advice="change its permissions, or ask its owner to"
        ) from error
    except InputError as error:
        if error.where:
            raise
        raise InputError(
            error.what, where=str(path), got=error.got, expected=error.expected, advice=error.advice
        ) from error
    except EmaError:
        raise
    except MemoryError as error:
        raise InputError(
            "an array in the file is larger than the memory",
            where=str(path),
            advice="read a record in pieces by ema.store.blocks, or use a machine with more memory",
        ) from error
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, RecursionError, AttributeError) as error:
        if isinstance(error, OSError) and not h5py.is_hdf5(path):
            raise InputError("not an HDF5 file, or cut short", where=str(path), advice=_DAMAGED) from error
        raise InputError("cannot be read", where=str(path), advice=_DAMAGED) from error


def _ours(file: h5py.File) -> bool:
    """Whether the root says so.

    The word is a text of fixed length. Older files keep it in a heap of texts, which is not touched, since the library
    never returns from a damaged one: there the names of the attributes have to do, and the document behind them.
    """
    if not {"format", "schema_version", "written_by"} <= set(file.attrs):
        return False
    if file.attrs.get_id("format").dtype.kind != "S":
        return file.attrs.get_id("schema_version").dtype.kind in "iu" and CONTENTS in file
    return _text(file.attrs["format"]) == FORMAT


def _contents(file: h5py.File, path: Path) -> tuple[str, list[str]]:
    if not _ours(file):
        raise InputError(
            "an HDF5 file, but not one of ours", where=str(path), advice="read it with acquisition.read instead"
        )
    version = int(file.attrs["schema_version"])
    if version > SCHEMA_VERSION:
        raise InputError(
            "written by a newer friction-ema",
            where=str(path),
            got=f"schema version {version}",
            expected=f"at most {SCHEMA_VERSION}",
            advice="update with: pip install -U friction-ema",
        )
    contents = json.loads(_document(file, CONTENTS))
    names = [str(name) for name in contents["names"]]
    there = len(file[ITEMS]) if ITEMS in file else 0
    if len(names) != there:
        raise InputError(
            "holds another number of items than it announces", got=there, expected=len(names), advice=_DAMAGED
        )
    return str(contents["kind"]), names


def _state(path: Path) -> tuple[int, int, int]:
    status = os.stat(path)
    return status.st_ino, status.st_size, status.st_mtime_ns


def _maker(path: Path, group: str, state: tuple[int, int, int]) -> Any:
    def read() -> Any:
        if path.exists() and _state(path) != state:
            raise InputError("the file has changed since it was opened", where=str(path), advice="load it again")
        with _opened(path) as file:
            return _item(file, group, path, state)

    return read


def _item(file: h5py.File, group: str, path: Path, state: tuple[int, int, int]) -> Any:
    tree = _tree(file, group)
    _check_sequences(file, group, tree)
    with as_stored(str(path)):
        return decode(
            tree,
            lambda part, checksum: _array(file[group], part, checksum),
            lambda part, place: _maker(path, f"{group}/{part}/{place}", state)(),
            lambda part: _window(file[group], part, path, state),
        )


def _window(group: h5py.Group, part: str, path: Path, state: tuple[int, int, int]) -> Window:
    """The array at ``part``, which stays in the file; each of its chunks has a checksum."""
    values = _dataset(group, part)
    chunks = values.chunks or values.shape
    return Window(StoredArray(path.resolve(), f"{group.name}/{part}", state, values.shape, values.dtype, chunks))


def _check_sequences(file: h5py.File, group: str, tree: Any) -> None:
    """Refuse a document that announces another number of items of a sequence than the file holds, or items in a circle.

    Raises
    ------
    InputError : it does.
    """
    steps = group.split("/")
    levels = [untrusted.member(file, "/".join(steps[: end + 1])) for end in range(len(steps))]
    if len({h5py.h5o.get_info(level.id).addr for level in levels}) < len(levels):
        raise InputError("holds an item inside itself", got=group, advice=_DAMAGED)
    waiting = [tree]
    while waiting:
        part = waiting.pop()
        if isinstance(part, dict) and "$items" in part:
            there = len(untrusted.member(file, f"{group}/{part['$items']}")) if part["count"] else 0
            if part["count"] != there:
                raise InputError(
                    "holds another number of items than it announces",
                    got=there,
                    expected=part["count"],
                    advice=_DAMAGED,
                )
        elif isinstance(part, (dict, list)):
            waiting.extend(part.values() if isinstance(part, dict) else part)


def _header(file: h5py.File, group: str, name: str) -> Header:
    tree = _tree(file, group)
    kind = str(tree.get("$noun"))
    if kind != "Recording":
        return Header(name, kind)
    record, samples = _without_samples(file, group)
    return Header(name, kind, record, samples)


def _without_samples(file: h5py.File, group: str) -> tuple[Recording, int]:
    tree = _tree(file, group)
    path = tree["signals"]["$array"]
    signals = _dataset(file[group], path)
    empty = np.zeros((signals.shape[0], 0), signals.dtype)
    with as_stored(file.filename):
        record = decode(
            tree,
            lambda part, checksum: empty if part == path else _array(file[group], part, checksum),
            _no_items,
        )
    return record, int(signals.shape[1])


def _no_items(path: str, place: int) -> Any:
    raise InputError("holds a sequence where none may stand", got=path, advice=_DAMAGED)


def _tree(file: h5py.File, group: str) -> dict[str, Any]:
    """The document of an item under today's names."""
    tree = json.loads(_document(file, f"{group}/{DOCUMENT}"))
    if not isinstance(tree, dict):
        raise InputError("holds a document that is no container", advice=_DAMAGED)
    document: dict[str, Any] = migrated(tree, int(file.attrs["schema_version"]))
    return document


def _document(file: h5py.File, path: str) -> str:
    return bytes(_dataset(file, path)[0]).decode("utf-8")


def _dataset(parent: h5py.Group, path: str) -> h5py.Dataset:
    """The dataset at ``path``, refused where it would reach outside this file or make the library load code."""
    place = untrusted.member(parent, path)
    if not isinstance(place, h5py.Dataset):
        raise InputError("holds a group where an array belongs", got=path, advice=_DAMAGED)
    if place.dtype.kind not in _KINDS or place.dtype.names:
        raise InputError(
            "holds an array of a kind that is not read (references, compounds)",
            got=path,
            expected="numbers or texts",
            advice="write the file again by ema.store.save",
        )
    untrusted.check(place, path, _FILTERS)
    return place


def _array(group: h5py.Group, path: str, checksum: int | None) -> np.ndarray:
    """The array at ``path``; compared with the ``checksum`` of the document, where there is one."""
    array = np.asarray(_dataset(group, path)[()])
    if checksum is not None and zlib.crc32(np.asarray(array, order="C").data) != checksum:
        raise InputError("an array does not match its checksum", got=path, advice=_DAMAGED)
    return np.char.decode(array, "utf-8") if array.dtype.kind == "S" else array


def _check_pieces(signals: h5py.Dataset, checksum: int | None, samples: int) -> None:
    """Compare signals (channel, sample) with their checksum, reading at most ``samples`` samples at a time.

    Raises
    ------
    InputError : they differ.
    """
    if checksum is None:
        return
    computed = 0
    for channel in range(signals.shape[0]):
        for start in range(0, signals.shape[1], samples):
            computed = zlib.crc32(signals[channel, start : start + samples], computed)
    if computed != checksum:
        raise InputError("an array does not match its checksum", got="signals", advice=_DAMAGED)


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
