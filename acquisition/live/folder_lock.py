"""One session records into a folder at a time."""

from pathlib import Path

from filelock import FileLock, Timeout

from ema.errors import FailureError

LOCK = ".record.lock"
"""Name of the lock file. It stays in the folder; what counts is who holds it, and the system ends that with the
process, however it ends. On a drive without locks the file itself counts, and a killed session leaves it."""

PATIENCE = 2.0
"""Seconds to wait for a lock. Opening a session holds it for less than a second at some hundred takes; a session that
records holds it for minutes. Halved, two sessions that are opened together may refuse each other more often; doubled,
the refusal comes later."""


class FolderLock:
    """The right to record into a folder; given up by ``release``, and by a system with locks when the process ends."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / LOCK
        # a generator may be closed in another thread than the one that began it
        self._lock = FileLock(self._path, thread_local=False)

    def acquire(self) -> None:
        """Take the lock.

        Raises
        ------
        FailureError : another session has it, or the drive grants none.
        """
        try:
            self._lock.acquire(timeout=PATIENCE)
        except Timeout as error:
            raise FailureError(
                "another session records into this folder",
                where=str(self._path.parent),
                advice=f"end it, or record into another folder; if none runs on any computer, remove {LOCK} there",
            ) from error
        except (OSError, NotImplementedError) as error:  # the latter from versions of filelock that know locks alone
            raise FailureError(
                "this folder cannot be locked against a second session",
                where=str(self._path),
                got=getattr(error, "strerror", None) or str(error),
                advice="record into a folder of a local disk that you may write to, and copy it afterwards",
            ) from error

    def release(self) -> None:
        """Give the lock back; nothing happens where it is not held."""
        self._lock.release()
