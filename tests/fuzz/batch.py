"""Run cases in forked processes, so that a crash, a hang or a growth belongs to its case and the others go on."""

import mmap
import os
import random
import resource
import signal
import struct
import tempfile
import traceback
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

from tests.fuzz.cases import Case, Subject, judged

SECONDS = 5
"""Processor time from which a case is a hang."""
MEMORY = 1 << 30
"""Bytes by which a case may make the process grow."""
_DISK = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
"""Where the files of the cases are: in memory where there is such a disk, since others wait for what is overwritten."""


@dataclass
class Campaign:
    """What became of the cases: how many of each outcome, and those that are wrong with their number."""

    outcomes: Counter[str] = field(default_factory=Counter)
    wrong: list[tuple[int, str, str]] = field(default_factory=list)


def case_of(subject: Subject, seed: int, number: int) -> Case:
    """A case by its seed and number, whenever it is made: scipy writes the date into the head of MAT files."""
    with mock.patch("time.asctime", return_value="Thu Jan  1 00:00:00 1970"):
        return subject.case(random.Random(f"{subject.name} {seed} {number}"))


def run(subject: Subject, seed: int, numbers: range) -> Campaign:
    """All cases of a row of numbers."""
    made = Campaign()
    start = numbers.start
    while start < numbers.stop:
        lines, stopped = _forked(subject, seed, range(start, numbers.stop))
        for number, outcome, what in lines:
            made.outcomes[outcome.partition(": ")[0] if not outcome.startswith("blind") else outcome] += 1
            if outcome.startswith("wrong"):
                made.wrong.append((number, what, outcome))
        start += len(lines)
        if stopped is not None:
            number, how = stopped
            made.outcomes["wrong"] += 1
            made.wrong.append((number, case_of(subject, seed, number).what, f"wrong: {how}"))
            start = number + 1
    return made


def _forked(subject: Subject, seed: int, numbers: range) -> tuple[list[tuple[int, str, str]], tuple[int, str] | None]:
    """Outcomes of the cases until the end or a crash, and where and how it crashed."""
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=_DISK) as folder, mmap.mmap(-1, 16) as shared:
        path = Path(folder) / f"a{subject.suffix}"
        report = Path(folder) / "report"
        child = os.fork()
        if not child:
            try:
                _work(subject, seed, numbers, path, report, shared)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(0)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        lines = []
        for line in report.read_text(encoding="utf-8", errors="replace").splitlines():
            number, _, rest = line.partition("\t")
            what, _, outcome = rest.partition("\t")
            lines.append((int(number), outcome, what))
        current, finished = struct.unpack("qq", shared[:16])
        if finished:
            return lines, None
        how = {-signal.SIGPROF: f"hangs over {SECONDS} s"}.get(status, f"crash, status {status}")
        return lines, (current, how)


def _work(subject: Subject, seed: int, numbers: range, path: Path, report: Path, shared: mmap.mmap) -> None:
    with report.open("w", encoding="utf-8") as file:
        for number in numbers:
            shared[:8] = struct.pack("q", number)
            # of this case alone: RLIMIT_CPU counts ticks, which part from the time of the process by seconds a minute
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            case = case_of(subject, seed, number)
            try:
                outcome = judged(subject, case, path)
            except Exception as error:
                place = traceback.extract_tb(error.__traceback__)[-1]
                outcome = f"wrong: {type(error).__name__} {error} ({Path(place.filename).name}:{place.lineno})"
            if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before > MEMORY // 1024:
                outcome = "wrong: grows by more than 1 GB"
            outcome = " ".join(outcome.split())
            file.write(f"{number}\t{case.kind} {case.what}\t{outcome}\n")
            file.flush()
    shared[8:16] = struct.pack("q", 1)
    from acquisition.isolated.process import _PARSERS

    _PARSERS.close()
