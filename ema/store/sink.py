"""The file under the HDF5 library while it writes.

The library loses its footing when a write fails: closing the file fails again, and the process may crash. So the
library never sees a failure here: the first one is kept, later writes are dropped, and ``Writer`` raises it.
"""

import io
import os
from pathlib import Path


class Sink(io.RawIOBase):
    """A file that keeps its first failure instead of raising it."""

    def __init__(self, path: Path) -> None:
        self._file = open(path, "r+b", buffering=0)  # noqa: SIM115 (closed by close)
        self.failure: OSError | None = None

    def write(self, data: object) -> int:
        """Write, or remember why not."""
        view = memoryview(data).cast("B")  # type: ignore[arg-type]
        done = 0
        while self.failure is None and done < len(view):
            try:
                done += self._file.write(view[done:])
            except OSError as error:
                self.failure = error
        if self.failure is not None:
            self._file.seek(len(view) - done, os.SEEK_CUR)
        return len(view)

    def readinto(self, buffer: object) -> int:
        """Read; what was never written is zero."""
        view = memoryview(buffer).cast("B")  # type: ignore[arg-type]
        done = 0
        while done < len(view) and (count := self._file.readinto(view[done:])):
            done += count
        view[done:] = bytes(len(view) - done)
        return len(view)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Where the next byte goes."""
        return self._file.tell()

    def truncate(self, size: int | None = None) -> int:
        """Cut or extend, or remember why not."""
        wanted = self._file.tell() if size is None else size
        if self.failure is None:
            try:
                self._file.truncate(wanted)
            except OSError as error:
                self.failure = error
        return wanted

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """Close, or remember why not (network file systems report a full disk only here)."""
        if not self._file.closed:
            try:
                self._file.close()
            except OSError as error:
                self.failure = self.failure or error
        super().close()

    def readable(self) -> bool:
        """It can be read."""
        return True

    def writable(self) -> bool:
        """It can be written."""
        return True

    def seekable(self) -> bool:
        """It can be positioned."""
        return True
