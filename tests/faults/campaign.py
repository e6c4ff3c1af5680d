"""Disturb a subject in a forked process, check what is left, and let the next start finish the work."""

import atexit
import os
import shutil
import signal
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, ClassVar

from ema.cli.ending import is_interruption
from ema.errors import EmaError
from tests.faults.operations import Operations

_DISK = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
"""Where the folders are: in memory where there is such a disk. What a process wrote outlives it on either."""

SIGNALS = {"KILL": signal.SIGKILL, "TERM": signal.SIGTERM, "INT": signal.SIGINT}

FINE, SENTENCE, INTERRUPTED, FAULT = 0, 3, 130, 70
"""How a forked process ends by itself: done, refused with a sentence, interrupted, or with a fault of ours."""


@dataclass(frozen=True)
class Outcome:
    """One disturbance: its name, how the process ended, what it had announced, and what is wrong, if anything."""

    what: str
    status: int
    announced: tuple[str, ...]
    wrong: str = ""


def forked(work: Callable[[Callable[[str], None]], None], operations: Operations | None = None) -> tuple[int, int]:
    """Begin ``work`` in a process of its own; its number, and where its announcements can be read."""
    reading, writing = os.pipe()
    # an interruption of the fork itself would be swallowed by what Python does after it; it waits for the work
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    child = os.fork()
    if child:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        os.close(writing)
        return child, reading
    status = FAULT
    try:
        os.close(reading)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        if operations is not None:
            operations.install()
        work(lambda line: os.write(writing, f"{line}\n".encode()) and None)
        if operations is not None and operations.at < 0:
            os.write(writing, "".join(f"# {one}\n" for one in operations.seen).encode())
        status = FINE
    except KeyboardInterrupt:
        status = INTERRUPTED
    except EmaError as error:
        os.write(writing, f"! {error}\n".encode())
        status = SENTENCE
    except BaseException as error:
        if is_interruption(error):
            status = INTERRUPTED
        else:
            os.write(writing, f"!! {traceback.format_exc()}\n".encode())
    finally:
        os._exit(status)


def ended(child: int, reading: int) -> tuple[int, list[str]]:
    """Status (negative for a signal) and whole lines of a forked process."""
    with os.fdopen(reading, "rb") as pipe:
        text = pipe.read().decode()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return status, text.splitlines()[: text.count("\n")]


def operations_of(subject: Any, seed: int = 0) -> list[str]:
    """The durable operations of a subject, in their order."""
    with _prepared(subject) as folder:
        found = Operations(folder)
        status, lines = ended(*forked(lambda report: subject.work(folder, seed, report), found))
        assert status == FINE, lines
        subject.finished(folder)
        return [line[2:] for line in lines if line.startswith("# ")]


def representatives(operations: list[str]) -> list[int]:
    """Every operation, but of a row of writes to one file the first, the middle and the last: all others leave the same
    kind of unfinished temporary file."""
    rows = [list(row) for _, row in groupby(range(len(operations)), key=lambda n: operations[n])]
    return sorted({n for row in rows for n in (row[0], row[len(row) // 2], row[-1])})


def at_operation(subject: Any, at: int, how: str, seed: int = 0) -> Outcome:
    """Disturb the subject at one operation."""
    with _prepared(subject) as folder:
        child = forked(lambda report: subject.work(folder, seed, report), Operations(folder, at, how))
        status, lines = ended(*child)
        expected = (FINE, SENTENCE) if how in ("full", "denied") else (-signal.SIGKILL,)
        if how == "clock":
            _set_back(folder)
        return _judged(subject, folder, f"{how} operation {at}", status, lines, expected)


def at_moment(subject: Any, moment: float, name: str, seed: int = 0) -> Outcome:
    """Send the subject a signal some seconds after its start."""
    with _prepared(subject) as folder:
        child, reading = forked(lambda report: subject.work(folder, seed, report))
        time.sleep(moment)
        os.kill(child, SIGNALS[name])
        status, lines = ended(child, reading)
        expected = (FINE, INTERRUPTED, SENTENCE) if name == "INT" else (FINE, -SIGNALS[name])
        return _judged(subject, folder, f"{name} after {moment:.4f} s", status, lines, expected)


def beside(subject: Any, moment: float, killed: float | None, seed: int = 0) -> Outcome:
    """Two processes work in one folder, the second some seconds after the first; ``killed``: when the first is killed.

    Each comes to its end or is refused with a sentence, and one at least comes to its end.
    """
    with _prepared(subject) as folder:
        first = forked(lambda report: subject.work(folder, seed, report))
        times = {"begin": moment} if killed is None else {"begin": moment, "kill": killed}
        start, second = time.monotonic(), (0, 0)
        for what in sorted(times, key=times.__getitem__):
            time.sleep(max(0.0, start + times[what] - time.monotonic()))
            if what == "kill":
                os.kill(first[0], signal.SIGKILL)
            else:
                second = forked(lambda report: subject.work(folder, seed + 2, report))
        ends = [ended(*first), ended(*second)]
        what = f"two, {moment:.4f} s apart, " + (f"one killed after {killed:.4f} s" if killed else "none killed")
        allowed = ((FINE, SENTENCE) if killed is None else (FINE, SENTENCE, -signal.SIGKILL), (FINE, SENTENCE))
        for (status, lines), expected in zip(ends, allowed, strict=True):
            said = sum(line.startswith("! ") for line in lines)
            if status not in expected or said != (status == SENTENCE):
                return Outcome(what, status, (), f"ended with {status}: {' '.join(lines[-12:])}")
        if killed is None and FINE not in [status for status, _ in ends]:
            return Outcome(what, SENTENCE, (), "neither came to its end")
        return _judged(subject, folder, what, FINE, [line for _, lines in ends for line in lines], (FINE,))


def duration(subject: Any) -> float:
    """Seconds of the undisturbed work in a forked process."""
    with _prepared(subject) as folder:
        start = time.monotonic()
        ended(*forked(lambda report: subject.work(folder, 0, report)))
        return time.monotonic() - start


def _judged(subject: Any, folder: Path, what: str, status: int, lines: list[str], expected: tuple[int, ...]) -> Outcome:
    announced = tuple(line for line in lines if not line.startswith(("!", "#")))
    outcome = Outcome(what, status, announced)
    if status not in expected:
        return Outcome(what, status, announced, f"ended with {status}: {' '.join(lines[-12:])}")
    said = [line for line in lines if line.startswith("! ")]
    if status == SENTENCE and len(said) != 1:
        return Outcome(what, status, announced, "no sentence")
    try:
        subject.check(folder, list(announced))
        again, more = ended(*forked(lambda report: subject.work(folder, 1, report)))
        assert again == FINE, f"the next start ended with {again}: {' '.join(more[-12:])}"
        twice = [line for line in more if line.startswith("computing ") and f"finished {line[10:]}" in announced]
        assert not twice, f"finished before, and again {twice}"
        subject.check(folder, [*announced, *more])
        subject.finished(folder)
    except Exception as error:
        return Outcome(what, status, announced, f"{type(error).__name__}: {str(error)[:500]}")
    return outcome


def _set_back(folder: Path) -> None:
    """Make every file a day younger: as the next start sees them when the clock was set back."""
    for path in (folder, *folder.rglob("*")):
        times = path.stat()
        os.utime(path, (times.st_atime + 86400, times.st_mtime + 86400))


class _prepared:
    """A folder with what the subject begins from; made once for each subject and copied."""

    _masters: ClassVar[dict[str, Path]] = {}

    def __init__(self, subject: Any) -> None:
        if subject.name not in self._masters:
            master = Path(tempfile.mkdtemp(prefix=f"faults-{subject.name}-", dir=_DISK))
            atexit.register(shutil.rmtree, master, ignore_errors=True)
            subject.prepare(master)
            self._masters[subject.name] = master
        self._base = Path(tempfile.mkdtemp(prefix="faults-", dir=_DISK))
        self._folder = self._base / "folder"
        shutil.copytree(self._masters[subject.name], self._folder)

    def __enter__(self) -> Path:
        return self._folder

    def __exit__(self, *error: object) -> None:
        shutil.rmtree(self._base, ignore_errors=True)
