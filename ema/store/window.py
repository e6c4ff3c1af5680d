"""Arrays in our files that are read piece by piece."""

import math
import os
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from ema.errors import InputError


@dataclass(frozen=True)
class StoredArray:
    """An array of a file by the names of both, as it was when it was opened (`state`: inode, size, time in ns).

    ``bytes_read`` counts the bytes of the chunks that reads have touched, in this process.
    """

    path: Path
    name: str
    state: tuple[int, int, int]
    shape: tuple[int, ...]
    dtype: np.dtype
    chunks: tuple[int, ...]
    _read: list[int] = field(default_factory=lambda: [0], compare=False, repr=False)

    @property
    def bytes_read(self) -> int:
        """Bytes of the chunks that were read so far."""
        return self._read[0]

    def read(self, box: tuple[slice, ...]) -> np.ndarray:
        """The values of a box with steps of 1.

        Raises
        ------
        InputError : the file is gone, has changed, or is damaged there.
        """
        try:
            status = os.stat(self.path)
            if (status.st_ino, status.st_size, status.st_mtime_ns) != self.state:
                raise InputError(
                    "the file has changed since it was opened", where=str(self.path), advice="load it again"
                )
            with h5py.File(self.path, "r", locking=False) as file:
                values = np.asarray(file[self.name][box])
        except FileNotFoundError as error:
            raise InputError(
                "the file is not there any more", where=str(self.path), advice="load it from where it is now"
            ) from error
        except PermissionError as error:
            raise InputError(
                "no permission to read this file",
                where=str(self.path),
                advice="change its permissions, or ask its owner to",
            ) from error
        except (OSError, KeyError, RuntimeError) as error:
            places = ", ".join(f"{part.start} to {part.stop - 1}" for part in box)
            raise InputError(
                "a part of the file is damaged",
                where=f"{self.path}, {self.name.rpartition('/')[2]} at {places}",
                advice="read it from a backup, or measure these points again",
            ) from error
        touched = [
            (min(-(-part.stop // chunk) * chunk, length) - part.start // chunk * chunk)
            for part, chunk, length in zip(box, self.chunks, self.shape, strict=True)
        ]
        self._read[0] += math.prod(touched) * self.dtype.itemsize
        return values
