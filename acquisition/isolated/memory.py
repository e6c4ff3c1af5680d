"""Memory of a process where it has no rlimit of its own: a job object on Windows, watching from the parent on macOS."""

import ctypes
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

EVERY = 0.05
"""Seconds between two looks. Parsers fill at most a few GB/s: twice as long, and some 200 MB more are held before the
process is ended."""

_PROCESS_MEMORY = 0x100
"""JOB_OBJECT_LIMIT_PROCESS_MEMORY of the Windows API."""
_EXTENDED_LIMITS = 9
"""JobObjectExtendedLimitInformation of the Windows API."""
_TASK_INFO = 4
"""PROC_PIDTASKINFO of macOS."""


class _JobLimits(ctypes.Structure):
    """JOBOBJECT_EXTENDED_LIMIT_INFORMATION of winnt.h, the basic limits and counts of bytes flat within."""

    _fields_ = [
        ("process_time", ctypes.c_int64),
        ("job_time", ctypes.c_int64),
        ("flags", ctypes.c_uint32),
        ("least_working_set", ctypes.c_size_t),
        ("most_working_set", ctypes.c_size_t),
        ("processes", ctypes.c_uint32),
        ("affinity", ctypes.c_size_t),
        ("priority", ctypes.c_uint32),
        ("scheduling", ctypes.c_uint32),
        ("counts", ctypes.c_uint64 * 6),
        ("process_memory", ctypes.c_size_t),
        ("job_memory", ctypes.c_size_t),
        ("peak_process_memory", ctypes.c_size_t),
        ("peak_job_memory", ctypes.c_size_t),
    ]


class _Counters(ctypes.Structure):
    """PROCESS_MEMORY_COUNTERS of psapi.h."""

    _fields_ = [
        ("size", ctypes.c_uint32),
        ("faults", ctypes.c_uint32),
        ("peak_working_set", ctypes.c_size_t),
        ("working_set", ctypes.c_size_t),
        ("pools", ctypes.c_size_t * 4),
        ("committed", ctypes.c_size_t),
        ("peak_committed", ctypes.c_size_t),
    ]


class _TaskInfo(ctypes.Structure):
    """proc_taskinfo of sys/proc_info.h: two sizes, four times, twelve counts."""

    _fields_ = [
        ("virtual", ctypes.c_uint64),
        ("resident", ctypes.c_uint64),
        ("times", ctypes.c_uint64 * 4),
        ("counts", ctypes.c_int32 * 12),
    ]


class Job:
    """A Windows job object around this process, which bounds the memory that it may commit.

    Parameters
    ----------
    kernel : kernel32, or what stands for it.

    Raises
    ------
    OSError : the system refuses it.
    """

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel
        for name in ("CreateJobObjectW", "GetCurrentProcess"):
            getattr(kernel, name).restype = ctypes.c_void_p
        self._process = ctypes.c_void_p(kernel.GetCurrentProcess())
        self._job = ctypes.c_void_p(_done(kernel.CreateJobObjectW(None, None), "CreateJobObjectW"))
        _done(kernel.AssignProcessToJobObject(self._job, self._process), "AssignProcessToJobObject")

    def limit(self, memory: int) -> None:
        """So many bytes beyond what is committed now."""
        counters = _Counters(size=ctypes.sizeof(_Counters))
        reference = ctypes.byref(counters)
        size = ctypes.c_uint32(counters.size)
        _done(self._kernel.K32GetProcessMemoryInfo(self._process, reference, size), "GetProcessMemoryInfo")
        self._set(_JobLimits(flags=_PROCESS_MEMORY, process_memory=counters.committed + memory))

    def lift(self) -> None:
        """No bound until the next call."""
        self._set(_JobLimits())

    def _set(self, limits: _JobLimits) -> None:
        size = ctypes.c_uint32(ctypes.sizeof(limits))
        done = self._kernel.SetInformationJobObject(self._job, _EXTENDED_LIMITS, ctypes.byref(limits), size)
        _done(done, "SetInformationJobObject")


def _done(value: int | None, what: str) -> int:
    if not value:
        raise OSError(f"{what} failed")
    return value


def resident(process: int) -> int:
    """Bytes of memory that another process of this user holds; 0 where the system does not tell.

    Source: proc_pidinfo of libproc (macOS), statm of proc(5) (Linux).
    """
    if sys.platform == "darwin":
        return resident_by(ctypes.CDLL(None).proc_pidinfo, process)
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return 0


def resident_by(proc_pidinfo: Callable[..., int], process: int) -> int:
    """The same by the function of libproc, which returns how many bytes it filled in."""
    about = _TaskInfo()
    size = ctypes.sizeof(about)
    filled = proc_pidinfo(process, _TASK_INFO, ctypes.c_uint64(0), ctypes.byref(about), size)
    return int(about.resident) if filled == size else 0


@contextmanager
def watched(process: int, memory: int, stop: Callable[[], None]) -> Iterator[None]:
    """Call ``stop`` once when a process holds ``memory`` more bytes than at the beginning."""
    before, ended = resident(process), threading.Event()

    def watch() -> None:
        while not ended.wait(EVERY):
            if resident(process) - before > memory:
                stop()
                return

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()
