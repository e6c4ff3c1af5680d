"""An array that stays in its file: what is asked for is read, and nothing is kept."""

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from ema.errors import InputError


@runtime_checkable
class Stored(Protocol):
    """Where the values of a window are: an array in a file, opened for each read."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""

    @property
    def dtype(self) -> np.dtype:
        """Type of the values."""

    @property
    def chunks(self) -> tuple[int, ...]:
        """Lengths along the axes of what lies together in the file."""

    def read(self, box: tuple[slice, ...]) -> np.ndarray:
        """The values of a box with steps of 1."""


class Arithmetic(NDArrayOperatorsMixin):
    """Operators and functions of numpy on an array that stays in its file: on its values, read now."""

    def __array_ufunc__(self, function: np.ufunc, method: str, *operands: Any, **options: Any) -> Any:
        values = [np.asarray(one) if isinstance(one, Arithmetic) else one for one in operands]
        return getattr(function, method)(*values, **options)


class Window(Arithmetic):
    """A part of an array in a file. Slices, masks and positions give a smaller window, ``numpy.asarray`` its values; so
    does an index that leaves one value along an axis.

    It holds the name of a file and no open handle, so that it can be sent to another process.

    Parameters
    ----------
    source : Stored
        The array.
    axes : sequence of integer arrays, optional
        Positions along each axis; all by default.
    memory : dict, optional
        What was computed from the file and is kept with it; all windows on it that come from one share it.

    Examples
    --------
    >>> class Square:
    ...     shape, dtype, chunks = (4, 3), np.dtype(float), (2, 3)
    ...     def read(self, box):
    ...         return np.arange(12.0).reshape(4, 3)[box]
    >>> window = Window(Square())[1:3]
    >>> window.shape, np.asarray(window)
    ((2, 3), array([[3., 4., 5.],
           [6., 7., 8.]]))
    """

    def __init__(
        self, source: Stored, axes: Sequence[np.ndarray] | None = None, memory: dict[str, Any] | None = None
    ) -> None:
        self.source = source
        self.axes = tuple(np.arange(length) for length in source.shape) if axes is None else tuple(axes)
        self.memory: dict[str, Any] = {} if memory is None else memory

    def __getstate__(self) -> tuple[Stored, tuple[np.ndarray, ...]]:
        return self.source, self.axes

    def __setstate__(self, state: tuple[Stored, tuple[np.ndarray, ...]]) -> None:
        self.source, self.axes = state
        self.memory = {}

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def dtype(self) -> np.dtype:
        """Type of the values."""
        return self.source.dtype

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.axes)

    @property
    def size(self) -> int:
        """Number of values."""
        return math.prod(self.shape)

    @property
    def nbytes(self) -> int:
        """Bytes of the values."""
        return self.size * self.dtype.itemsize

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, index: Any) -> Any:
        """A smaller window by slices, masks or positions, each for one axis; values where a number drops its axis."""
        parts = index if isinstance(index, tuple) else (index,)
        dropped = tuple(axis for axis, part in enumerate(parts) if isinstance(part, int | np.integer))
        if dropped and len(parts) <= self.ndim:
            kept = tuple([part] if axis in dropped else part for axis, part in enumerate(parts))
            return np.asarray(self[kept]).squeeze(axis=dropped)
        if len(parts) > self.ndim or any(np.ndim(part) != 1 and not isinstance(part, slice) for part in parts):
            raise InputError(
                "a window on a file is cut by slices, masks or positions",
                got=repr(index)[:60],
                expected="one of them for each axis",
                advice="read its values first, by numpy.asarray",
            )
        cut = [
            axis[np.asarray(p) if not isinstance(p, slice) else p] for axis, p in zip(self.axes, parts, strict=False)
        ]
        return Window(self.source, [*cut, *self.axes[len(parts) :]], self.memory)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """The values, read now."""
        wanted = self.dtype if dtype is None else np.dtype(dtype)
        found = np.empty(self.shape, wanted)
        for box in product(*(list(runs(axis)) for axis in self.axes)):
            found[tuple(here for here, _ in box)] = self.source.read(tuple(there for _, there in box))
        return found

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Window):
            return NotImplemented
        same = self.source == other.source and self.shape == other.shape
        return same and all(np.array_equal(a, b) for a, b in zip(self.axes, other.axes, strict=True))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"<{self.dtype} {self.shape}, read when used>"


def runs(axis: np.ndarray) -> Iterator[tuple[slice, slice]]:
    """Where runs of neighbouring positions come to lie, and where they are."""
    ends = np.flatnonzero(np.diff(axis) != 1) + 1
    for first, last in zip([0, *ends.tolist()], [*ends.tolist(), len(axis)], strict=True):
        if last > first:
            yield slice(first, last), slice(int(axis[first]), int(axis[last - 1]) + 1)
