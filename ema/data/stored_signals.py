"""Signals that stay in their file: rows and stretches are read when they are asked for, and not kept."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ema.data.window import Arithmetic, Stored, runs
from ema.errors import InputError


class StoredSignals(Arithmetic):
    """Signals (channel, sample) in a file, in the units of their channels; an index gives values, as of an array.

    It holds the name of a file and no open handle, so that it can be sent to another process.

    Parameters
    ----------
    source : Stored
        The array in the file.
    rows : sequence of int, optional
        Rows of the file, in the order of the channels; all by default.
    factor, offset : sequence of float, optional
        For each row, ``factor * number + offset`` is the signal; by default the number itself.

    Examples
    --------
    >>> class Square:
    ...     shape, dtype, chunks = (2, 4), np.dtype(float), (1, 2)
    ...     def read(self, box):
    ...         return np.arange(8.0).reshape(2, 4)[box]
    >>> signals = StoredSignals(Square(), [1, 0], factor=[10.0, 1.0])
    >>> signals.shape, signals[0, 1:3], signals[:, 0]
    ((2, 4), array([50., 60.]), array([40.,  0.]))
    """

    def __init__(
        self,
        source: Stored,
        rows: Sequence[int] | None = None,
        factor: Sequence[float] | None = None,
        offset: Sequence[float] | None = None,
    ) -> None:
        self.source = source
        self.rows = np.arange(source.shape[0]) if rows is None else np.asarray(rows, dtype=int)
        self.factor = np.ones(len(self.rows)) if factor is None else np.asarray(factor, dtype=float)
        self.offset = np.zeros(len(self.rows)) if offset is None else np.asarray(offset, dtype=float)

    @property
    def shape(self) -> tuple[int, int]:
        """Channels and samples."""
        return len(self.rows), self.source.shape[1]

    @property
    def dtype(self) -> np.dtype:
        """Type of the values."""
        return self.source.dtype

    @property
    def chunks(self) -> tuple[int, ...]:
        """Lengths along the axes of what lies together in the file."""
        return self.source.chunks

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return 2

    @property
    def nbytes(self) -> int:
        """Bytes of the values."""
        return len(self.rows) * self.source.shape[1] * self.dtype.itemsize

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self[row] for row in range(len(self)))

    def __getitem__(self, index: Any) -> np.ndarray:
        """The values of a row, of rows, or of a stretch of them; ``signals[rows, first:last]`` is read at once."""
        rows, samples = index if isinstance(index, tuple) else (index, slice(None))
        chosen = np.arange(len(self))[rows]
        stretch, within = _stretch(samples, self.shape[1])
        values = self._read(np.atleast_1d(chosen), stretch)[:, within]
        return np.asarray(values if np.ndim(chosen) else values[0])

    def read(self, box: tuple[slice, ...]) -> np.ndarray:
        """The values of a box with steps of 1."""
        return self[box]

    def chosen(
        self, rows: Sequence[int], factor: Sequence[float] | None = None, offset: Sequence[float] | None = None
    ) -> "StoredSignals":
        """Some of the rows, with another factor and offset on top of those they have."""
        more = np.ones(len(rows)) if factor is None else np.asarray(factor, dtype=float)
        added = np.zeros(len(rows)) if offset is None else np.asarray(offset, dtype=float)
        own, shift = self.factor[list(rows)], self.offset[list(rows)]
        return StoredSignals(
            self.source, self.rows[list(rows)].tolist(), (more * own).tolist(), (more * shift + added).tolist()
        )

    def _read(self, rows: np.ndarray, stretch: slice) -> np.ndarray:
        found = np.empty((len(rows), stretch.stop - stretch.start), self.dtype)
        if not found.size:
            return found
        for here, there in runs(self.rows[rows]):
            found[here] = self.source.read((there, stretch))
        factor, offset = (values[rows].astype(self.dtype)[:, None] for values in (self.factor, self.offset))
        if np.any(factor != 1):
            found *= factor
        if np.any(offset != 0):
            found += offset
        return found

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """All values, read now."""
        return self[:, :].astype(self.dtype if dtype is None else dtype, copy=False)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, StoredSignals):
            return NotImplemented
        pairs = ((self.rows, other.rows), (self.factor, other.factor), (self.offset, other.offset))
        return self.source == other.source and all(np.array_equal(a, b) for a, b in pairs)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"<{self.dtype} {self.shape}, read when used>"


def _stretch(samples: Any, length: int) -> tuple[slice, Any]:
    """The samples from the first to the last that is asked for, and which of them are."""
    if isinstance(samples, slice):
        places = range(*samples.indices(length))
        if not len(places):
            return slice(0, 0), slice(None)
        if places.step == 1:
            return slice(places.start, places.stop), slice(None)
        samples = np.array(places)
    chosen = np.arange(length)[samples] if np.ndim(samples) or isinstance(samples, list) else samples % length
    if np.ndim(samples) == 0 and not -length <= samples < length:
        raise InputError("no such sample", got=samples, expected=f"0 to {length - 1}")
    if np.ndim(chosen) and not len(chosen):
        return slice(0, 0), chosen
    first, last = int(np.min(chosen)), int(np.max(chosen))
    return slice(first, last + 1), chosen - first
