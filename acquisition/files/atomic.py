"""A file that appears whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import IO

from ema.errors import FailureError, InputError
from ema.store.atomic import mark, remove_abandoned


@contextmanager
def replacing(path: Path) -> Iterator[IO[bytes]]:
    """A binary file beside ``path`` that takes its place when everything is written and on the disk.

    Raises
    ------
    InputError : ``path`` is a folder.
    FailureError : the folder is missing or read-only, or the disk is full; an old file stays as it was.
    """
    if path.is_dir():
        raise InputError("a folder, not a file", where=str(path))
    temporary, stem = "", f".{path.name}."
    remove_abandoned(path.parent, stem, ".part")
    try:
        with NamedTemporaryFile("wb", dir=path.parent, prefix=f"{stem}{mark()}-", suffix=".part", delete=False) as file:
            temporary = file.name
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        _remove(temporary)
        raise FailureError(
            f"the file cannot be written: {error.strerror or error}", where=str(path),
            advice="check that the folder exists, is writable and has room; an older file is untouched",
        ) from error  # fmt: skip
    except BaseException:
        _remove(temporary)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _remove(name: str) -> None:
    if name:
        with suppress(OSError):
            os.unlink(name)
