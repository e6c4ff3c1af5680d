"""The files of a campaign while it is open: read once where they are small, again where they are large."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from acquisition.contents import Contents
from acquisition.units import Unit
from ema import store
from ema.data import Finding, Recording
from ema.store.reading import containers, record_of

_KEPT = 256 * 2**20
"""Bytes of read files that stay in memory, so that opening and then using a campaign reads them once."""


IN_FILE = 64 * 2**20
"""Bytes from which on the signals of a record in a file of ours stay there and are read piece by piece."""


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
        self._contents: OrderedDict[tuple[Path, str], Contents] = OrderedDict()
        self._stored: dict[Path, bool] = {}

    def contents(self, path: Path, options: dict[str, Any]) -> Contents:
        """Everything in the file.

        Raises
        ------
        InputError : it cannot be read.
        """
        key = (path, repr(sorted(options.items())))
        if key in self._contents:
            self._contents.move_to_end(key)
            return self._contents[key]
        contents = _read(path, options)
        if _size(contents) <= self._budget:
            self._contents[key] = contents
            self._size += _size(contents)
            while self._size > self._budget:
                _, dropped = self._contents.popitem(last=False)
                self._size -= _size(dropped)
        return contents

    def _is_stored(self, path: Path) -> bool:
        """Whether it is a file of ours; found out once."""
        if path not in self._stored:
            self._stored[path] = store.is_store(path)
        return self._stored[path]

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
        if self._is_stored(path):
            return tuple(
                Take(header.record, header.samples, _reader_of(path, place))
                for place, header in enumerate(store.describe(path))
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


def _reader_of(path: Path, index: int) -> Callable[[], Recording]:
    def read() -> Recording:
        """The record, read anew from its file."""
        return record_of(path, index, IN_FILE)

    return read


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
