"""Write a file so that a reader sees the old one or the new one, never half of one."""

import contextlib
import errno
import hashlib
import os
import platform
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from ema.errors import FailureError

_REASONS = {
    errno.ENOSPC: ("the disk is full", "make room or write to another disk; the former file is untouched"),
    errno.EDQUOT: ("the disk quota is used up", "make room or write to another disk; the former file is untouched"),
    errno.EFBIG: ("the file is larger than this system allows", "write to another disk; the former file is untouched"),
    errno.EACCES: ("no permission to write here", "choose a folder that you may write to"),
    errno.EPERM: ("no permission to write here", "choose a folder that you may write to"),
    errno.EROFS: ("this folder is read-only", "choose a folder that you may write to"),
    errno.ENOENT: ("there is no such folder", "create it first"),
    errno.ENOTDIR: ("there is no such folder", "create it first"),
    errno.EEXIST: ("there is a file of this name already", "it was left as it is; choose another name"),
    errno.EISDIR: ("there is a folder of this name", "choose another file name"),
}


def write_failure(error: OSError, path: Path) -> FailureError:
    """The failure to report when ``path`` could not be written because of ``error``."""
    what, advice = _REASONS.get(
        error.errno or 0, (f"cannot be written ({error})", "the former file, if any, is untouched")
    )
    return FailureError(what, where=str(path), advice=advice)


@contextlib.contextmanager
def replacing(path: str | Path, exclusive: bool = False) -> Iterator[Path]:
    """Yield a temporary file that takes the place of another one when the block ends without an error.

    The temporary file lies beside ``path`` and is flushed to the disk before it is renamed, so a killed process or a
    power cut leaves the former file intact. When the block fails, the temporary file is removed. Every handle on it has
    to be closed when the block ends: Windows renames no open file.

    Parameters
    ----------
    path : str or Path
        The file to write; where it is a link, its target is replaced.
    exclusive : bool, default False
        Create ``path``, and never replace it.

    Yields
    ------
    Path
        The temporary file.

    Raises
    ------
    FailureError
        If the folder is absent or read-only, the disk is full, or ``path`` exists and ``exclusive`` is set.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with replacing(f"{folder}/note.txt") as temporary:
    ...         _ = temporary.write_text("whole or not at all")
    ...     Path(f"{folder}/note.txt").read_text()
    'whole or not at all'
    """
    path = Path(path)
    # a link keeps pointing where it did: its target is what gets replaced
    target = path.resolve() if path.is_symlink() else path
    stem = f".{target.name[:80]}."
    remove_abandoned(target.parent, stem, ".tmp")
    temporary = target.parent / f"{stem}{mark()}-{secrets.token_hex(6)}.tmp"
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a folder")
        # made with the umask of the process, unlike files of the tempfile module
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield temporary
        _to_disk(temporary)
        if exclusive:
            _create(temporary, target)
        else:
            os.replace(temporary, target)
    except OSError as error:
        _discard(temporary)
        raise write_failure(error, path) from error
    except BaseException:
        _discard(temporary)
        raise
    # without this the rename itself may be lost in a power cut; not every system can do it
    with contextlib.suppress(OSError):
        _to_disk(target.parent)


def _create(temporary: Path, target: Path) -> None:
    """Give the temporary file its name unless the name is taken, in one step of the file system."""
    if os.name == "nt":
        os.rename(temporary, target)  # which replaces nothing there
        return
    try:
        os.link(temporary, target)
    except FileExistsError:
        raise
    except OSError:  # a disk without hard links, such as FAT: the name is claimed by an empty file first
        os.close(os.open(target, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        try:
            os.replace(temporary, target)
        except BaseException:
            _discard(target)
            raise
    else:
        _discard(temporary)


def _discard(path: Path) -> None:
    """Remove a file that is of no use; where that is refused it stays, and the next writer of its name removes it."""
    with contextlib.suppress(OSError):
        path.unlink()


def mark() -> str:
    """Return the mark of the temporary files of this process.

    Returns
    -------
    str
        Hash of the machine's name and number of the process, which tell its files from those of other processes.
    """
    machine = hashlib.blake2s(platform.node().encode(), digest_size=3).hexdigest()
    return f"{machine}-{os.getpid()}"


def remove_abandoned(folder: Path, stem: str, suffix: str) -> None:
    """Remove temporary files and folders ``<stem><mark>-...<suffix>`` whose process was killed on this machine.

    The name of a file may stand between stem and mark: of the stem ``.`` they are those of all files of the folder.
    """
    machine = mark().partition("-")[0]
    with contextlib.suppress(OSError):
        for name in os.listdir(folder):
            owner = name.removeprefix(stem).removesuffix(suffix).rpartition(".")[2].split("-")
            ours = name.startswith(stem) and name.endswith(suffix) and len(owner) == 3 and owner[0] == machine
            if not ours or not owner[1].isdigit() or _alive(int(owner[1])):
                continue
            if (folder / name).is_dir():
                shutil.rmtree(folder / name, ignore_errors=True)
            else:
                (folder / name).unlink(missing_ok=True)


def _alive(process: int) -> bool:
    if os.name == "nt":  # where asking is ending
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
