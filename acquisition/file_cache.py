"""The files of a campaign while it is open: read once where they are small, again where they are large."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from acquisition.contents import Contents
from acquisition.units import Unit
from ema import store
from ema.data import Finding, Recording
from ema.data.stored_signals import StoredSignals
from ema.errors import InputError
from ema.store.reading import Header, containers, record_of

T = TypeVar("T")

_KEPT = 256 * 2**20
"""Bytes of read files that stay in memory, so that opening and then using a campaign reads them once."""


IN_FILE = 64 * 2**20
"""Bytes from which on the signals of a record in a file of ours stay there and are read piece by piece."""

_WHOLE = IN_FILE // 1024
"""Bytes up to which a file of ours is read whole for its header, since opening it again takes longer than its samples.

Deflate packs a thousand bytes into one at most (1032, RFC 1951), so that no more than :data:`IN_FILE` come out of it.
"""


@dataclass(frozen=True)
class Take:
    """A record in a file: all of it but its samples, and how to get them."""

    header: Recording
    samples: int
    read: Callable[[], Recording]


class Files:
    """Reads the files of a campaign; what fits into memory is kept."""

    def __init__(self, kept: int = _KEPT) -> None:
        self._budget, self._size = kept, 0
        self._kept: OrderedDict[tuple[Path, Any], tuple[Any, int]] = OrderedDict()
        self._stored: dict[Path, bool] = {}
        self._headers: dict[Path, tuple[Header, ...]] = {}

    def _once(self, key: tuple[Path, Any], read: Callable[[], T], size: Callable[[T], int]) -> T:
        """What ``read`` gives, kept as long as all that is kept fits; what was used longest ago goes first."""
        if key in self._kept:
            self._kept.move_to_end(key)
            value: T = self._kept[key][0]
            return value
        value = read()
        needed = size(value)
        if needed <= self._budget:
            self._kept[key] = value, needed
            self._size += needed
            while self._size > self._budget:
                self._size -= self._kept.popitem(last=False)[1][1]
        return value

    def contents(self, path: Path, options: dict[str, Any]) -> Contents:
        """Everything in the file.

        Raises
        ------
        InputError : it cannot be read.
        """
        return self._once((path, repr(sorted(options.items()))), partial(_read, path, options), _size)

    def _is_stored(self, path: Path) -> bool:
        """Whether it is a file of ours; found out once."""
        if path not in self._stored:
            self._stored[path] = store.is_store(path)
        return self._stored[path]

    def headers(self, path: Path) -> tuple[Header, ...] | None:
        """The items of a file of ours, without their arrays; ``None`` for a file of another format.

        Raises
        ------
        InputError : the file cannot be read.
        """
        if not self._is_stored(path):
            return None
        if path not in self._headers:
            self._headers[path] = self._read_whole(path) or store.describe(path)
        return self._headers[path]

    def _read_whole(self, path: Path) -> tuple[Header, ...]:
        """Header of a small file that holds one record, which is kept; empty for any other file."""
        if path.stat().st_size > _WHOLE:
            return ()
        try:
            record = store.load(path)
        except InputError:  # that of its samples is for who reads them
            return ()
        if not isinstance(record, Recording):
            return ()
        self._once((path, 0), lambda: record, self._size_of_record)
        empty = np.zeros((len(record.signals), 0), record.signals.dtype)
        return (Header("0", "Recording", replace(record, signals=empty), record.signals.shape[1]),)

    def _record(self, path: Path, place: int) -> Recording:
        """A record of a file of ours; one whose signals stay in the file is read anew each time, a few numbers."""
        return self._once((path, place), partial(record_of, path, place, IN_FILE), self._size_of_record)

    def _size_of_record(self, record: Recording) -> int:
        return self._budget + 1 if isinstance(record.signals, StoredSignals) else record.signals.nbytes

    def findings(self, path: Path, options: dict[str, Any]) -> tuple[Finding, ...]:
        """What the reader of the file has to say about it."""
        return () if self._is_stored(path) else self.contents(path, options).findings

    def units(self, path: Path, options: dict[str, Any]) -> tuple[tuple[str, Unit], ...]:
        """The channels of the file and the units that their numbers had before they became SI."""
        return () if self._is_stored(path) else self.contents(path, options).units

    def takes(self, path: Path, options: dict[str, Any]) -> tuple[Take, ...]:
        """The records in the file; those of our own files stay on disk until they are read.

        Raises
        ------
        InputError : the file cannot be read.
        """
        if (headers := self.headers(path)) is not None:
            return tuple(
                Take(header.record, header.samples, partial(self._record, path, place))
                for place, header in enumerate(headers)
                if header.record is not None
            )
        return tuple(
            Take(
                replace(recording, signals=recording.signals[:, :0]),
                recording.signals.shape[1],
                lambda place=place: self.contents(path, options).recordings[place],  # type: ignore[misc]
            )
            for place, recording in enumerate(self.contents(path, options).recordings)
        )


def _read(path: Path, options: dict[str, Any]) -> Contents:
    if not store.is_store(path):
        from acquisition.registry import read

        contents: Contents = read(path, **options)
        return contents
    return Contents.of(containers(path))


def _size(contents: Contents) -> int:
    arrays = (array for frf in contents.frfs for array in (frf.values, frf.coherence, frf.variance, frf.deviations))
    return sum(recording.signals.nbytes for recording in contents.recordings) + sum(
        array.nbytes for array in arrays if array is not None
    )
