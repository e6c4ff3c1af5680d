"""How much time, memory and unpacked data one file may cost, each in proportion to its size."""

import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from zipfile import ZipFile

from acquisition.isolated.memory import Job
from ema.errors import InputError

_MB = 1 << 20
SECONDS, SECONDS_PER_MB = 60.0, 20.0
"""Seconds by the clock for a file, and for each MB of it. Workbooks, the slowest, take about 3 s of processor time per
MB; the rest is for busy machines and slow disks. Halved or doubled, only the wait for a hanging parser changes."""
CPU_SECONDS, CPU_SECONDS_PER_MB = 5, 10.0
"""The same in processor time, which a busy machine does not lengthen: three times what workbooks take."""
TOO_MUCH = "it needs more memory than a file of its size should"
"""What is said of a parser that grows beyond its memory."""
MEMORY, MEMORY_PER_BYTE = 512 * _MB, 40
"""Bytes beyond the loaded packages, and for each byte of the file: measured peaks are below 15 bytes per byte."""
UNPACKED, RATIO = 64 * _MB, 100
"""An archive may unpack to this many bytes, or to so many times its size where that is more. Recorded signals pack by 3
to 10, tables with constant columns by 30; deflate can do 1000. Halved, a table of zeros is refused."""


@dataclass(frozen=True)
class Limits:
    """What one call may use: ``seconds`` by the clock, ``cpu_seconds``, ``memory`` in bytes."""

    seconds: float
    cpu_seconds: int
    memory: int

    @classmethod
    def of(cls, path: Path) -> "Limits":
        """The limits of a file.

        Raises
        ------
        OSError : there is no such file.
        """
        size = path.stat().st_size
        return cls(
            SECONDS + SECONDS_PER_MB * size / _MB,
            int(CPU_SECONDS + CPU_SECONDS_PER_MB * size / _MB),
            MEMORY + MEMORY_PER_BYTE * size,
        )


def unpacked(packed: int) -> int:
    """Bytes to which so many packed ones may unpack."""
    return max(UNPACKED, RATIO * packed)


def too_large(path: Path, size: str, packed: int) -> InputError:
    """The refusal of an archive that grows beyond measure."""
    return InputError(
        "the packed file grows too large",
        where=str(path),
        got=f"{size} from {packed / 1e6:.3g} MB",
        expected=f"at most {unpacked(packed) / 1e6:.3g} MB",
        advice="unpack it first if it is what it should be",
    )


def check_zip(path: Path) -> None:
    """Refuse a ZIP archive whose members unpack to more than measurements do.

    The sizes in its directory bind: the library reads no member beyond them.

    Raises
    ------
    InputError : it does.
    """
    with ZipFile(path) as archive:
        total = sum(member.file_size for member in archive.infolist())
    packed = path.stat().st_size
    if total > unpacked(packed):
        raise too_large(path, f"{total / 1e6:.3g} MB", packed)


def apply(limits: Limits) -> None:
    """Limit this process from now on: memory (Linux, Windows), processor time (Linux, macOS).

    On macOS the parent watches the memory, see :mod:`acquisition.isolated.memory`.
    """
    if os.name == "nt":
        with suppress(OSError):  # without a job object the bounds on unpacked data hold
            _job().limit(limits.memory)
        return
    import resource
    import signal

    spent = sum(os.times()[:2])
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    soft = int(spent) + 1 + limits.cpu_seconds
    resource.setrlimit(resource.RLIMIT_CPU, (soft if hard == resource.RLIM_INFINITY else min(soft, hard), hard))
    # the parent keeps the time; this one ends the process where the parent was killed meanwhile
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, limits.seconds + 5)
    if sys.platform == "linux":
        mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        soft = mapped + limits.memory
        resource.setrlimit(resource.RLIMIT_AS, (soft if hard == resource.RLIM_INFINITY else min(soft, hard), hard))


@cache
def _job() -> Job:
    import ctypes

    return Job(ctypes.WinDLL("kernel32"))  # type: ignore[attr-defined]


def lift() -> None:
    """Take the limits off between two calls, in which packages are loaded."""
    if os.name == "nt":
        with suppress(OSError):
            _job().lift()
        return
    import resource
    import signal

    signal.setitimer(signal.ITIMER_REAL, 0)
    for what in (resource.RLIMIT_CPU, resource.RLIMIT_AS):
        hard = resource.getrlimit(what)[1]
        resource.setrlimit(what, (hard, hard))
