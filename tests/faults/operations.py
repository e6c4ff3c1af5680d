"""Durable operations of a process below a folder: counted, and stopped or refused at one of them.

Python's own doors to the file system are wrapped (``open`` in its three homes, and the functions of ``os``); compiled
libraries of this project write through them. To be installed in a process of its own.
"""

import builtins
import errno
import io
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

HOWS = ("before", "after", "half", "full", "denied", "clock")
"""Killed before the operation, after it, or in the middle of a write; the disk full from there on, or the folder somebody
else's; killed before the operation, and the next start finds files that are a day younger than its clock."""

_REFUSED = {
    "full": (errno.ENOSPC, ("create", "write", "link", "mkdir", "truncate")),
    "denied": (errno.EACCES, ("create", "rename", "delete", "link", "mkdir")),
}
"""What the system says, and of which operations."""


@dataclass
class Operations:
    """What is done below ``folder``; ``at`` is the number of the operation to disturb, from 0."""

    folder: Path
    at: int = -1
    how: str = "before"
    seen: list[str] = field(default_factory=list)

    def install(self) -> None:
        """Watch this process from now on."""
        real_open = io.open

        def opened(file: Any, mode: str = "r", *rest: Any, **options: Any) -> Any:
            writes = any(letter in mode for letter in "wxa+")
            if not writes or not self._meant(file):
                return real_open(file, mode, *rest, **options)
            if "r" not in mode:
                return _Watched(self._done("create", file, lambda: real_open(file, mode, *rest, **options)), self, file)
            return _Watched(real_open(file, mode, *rest, **options), self, file)

        import _io

        builtins.open = io.open = _io.open = opened  # type: ignore[assignment]
        for name, what in (
            ("replace", "rename"),
            ("rename", "rename"),
            ("link", "link"),
            ("unlink", "delete"),
            ("remove", "delete"),
            ("mkdir", "mkdir"),
            ("rmdir", "delete"),
            ("truncate", "truncate"),
        ):
            self._wrap(name, what)
        plain = os.open

        def low(path: Any, flags: int, *rest: Any, **options: Any) -> int:
            if not flags & os.O_CREAT or not self._meant(path):
                return plain(path, flags, *rest, **options)
            return int(self._done("create", path, lambda: plain(path, flags, *rest, **options)))

        os.open = low

    def _wrap(self, name: str, what: str) -> None:
        real = getattr(os, name)

        def wrapped(path: Any, *rest: Any, **options: Any) -> Any:
            if not self._meant(path):
                return real(path, *rest, **options)
            return self._done(what, path, lambda: real(path, *rest, **options))

        setattr(os, name, wrapped)

    def written(self, path: Any, write: Callable[[Any], Any], data: Any) -> Any:
        """A write, whole or in part."""
        if len(self.seen) == self.at and self.how == "half":
            write(data[: len(data) // 2])
            _kill()
        return self._done("write", path, lambda: write(data))

    def _meant(self, path: Any) -> bool:
        return isinstance(path, str | os.PathLike) and str(self.folder) in os.path.abspath(os.fspath(path))

    def _done(self, what: str, path: Any, action: Callable[[], Any]) -> Any:
        number = len(self.seen)
        self.seen.append(f"{what} {Path(path).name}")
        code, meant = _REFUSED.get(self.how, (0, ()))
        if 0 <= self.at <= number and what in meant:
            raise OSError(code, os.strerror(code), str(path))
        if number == self.at and self.how in ("before", "clock"):
            _kill()
        try:
            return action()
        finally:
            if number == self.at and self.how in ("after", "half"):
                _kill()


class _Watched:
    """A file whose writes are counted; all else is the file's own."""

    def __init__(self, file: Any, operations: Operations, path: Any) -> None:
        self._file, self._operations, self._path = file, operations, path

    def write(self, data: Any) -> Any:
        return self._operations.written(self._path, self._file.write, data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __enter__(self) -> "_Watched":
        self._file.__enter__()
        return self

    def __exit__(self, *error: Any) -> Any:
        return self._file.__exit__(*error)

    def __iter__(self) -> Any:
        return iter(self._file)


def _kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)
