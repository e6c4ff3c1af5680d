"""Runs of a study and conditions of a map as tasks of their own: for other processes and other machines.

A task carries where the campaign is and the settings, never signals or open files; the worker opens the campaign
itself, once. What comes back has no signals. Results are those of this process, number for number.
"""

import platform
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from acquisition import campaign_file
from ema.data import Campaign, Run, RunResult
from ema.errors import EmaError, FailureError, InputError
from ema.fingerprint import of_files
from ema.study import chain, mapping
from ema.study.recipe import EstimateTable, FitTable, MapTable
from ema.study.sources import opened

T = TypeVar("T")

_OPEN = 2
"""Campaigns that a worker keeps open: the one at work, and one before it."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Where a campaign is, for whoever is to open it.

    Parameters
    ----------
    path : str
        Absolute path of its folder, or of the file with FRFs.
    file : str
        Absolute path of the campaign file, or of the file with FRFs.
    print : str
        SHA-256 of ``file``.
    salvage : bool
        Read damaged files as far as they are right.
    """

    path: str
    file: str
    print: str
    salvage: bool = False

    @classmethod
    def of(cls, campaign: Path, salvage: bool) -> "Measured":
        """The campaign as it is seen here."""
        path = campaign.resolve()
        file = path / campaign_file.FILE_NAME if path.is_dir() else path
        return cls(path=str(path), file=str(file), print=of_files([file]), salvage=salvage)


def run_result(
    measured: Measured, run: str, others: Sequence[str], estimate: EstimateTable, fit: FitTable
) -> RunResult:
    """One run of a campaign, analysed.

    Raises
    ------
    InputError : the campaign cannot be seen from here, or the run cannot be used.
    """
    campaign = _campaign(measured)
    beside = [campaign[name] for name in others]
    result = chain.analyse(campaign[run], estimate, fit, others=beside)
    return replace(result, run=without_signals(result.run))


def map_point(measured: Measured, run: str, table: MapTable, estimate: EstimateTable) -> mapping.Point:
    """One condition of a map.

    Raises
    ------
    InputError : as :func:`run_result`.
    """
    return mapping.point(_campaign(measured)[run], table, estimate)


def in_order(futures: Sequence[Future[T]]) -> Iterator[T]:
    """The results of tasks in their order, each let go once it is handed out; the rest is called off where one fails.

    Raises
    ------
    EmaError : what a task raised, or that its worker did not survive it.
    """
    waiting = deque(futures)
    del futures  # which would hold all results
    try:
        while waiting:
            try:
                result = waiting.popleft().result()
            except EmaError:
                raise
            except MemoryError as error:
                raise FailureError(
                    "a task needs more memory than its worker has",
                    got=str(error).splitlines()[0] if str(error) else "",
                    advice="start workers with more memory, or fewer of them on a machine",
                ) from error
            except Exception as error:
                if type(error).__name__ not in ("KilledWorker", "BrokenProcessPool"):
                    raise
                raise InputError(
                    "a task ended its workers one after the other",
                    got=str(error).splitlines()[0],
                    expected="workers with enough memory",
                    advice="look into the log of a worker, and start workers with more memory",
                ) from error
            yield result
            del result
    finally:
        for future in waiting:
            future.cancel()


def points(
    executor: Executor, measured: Measured, runs: Sequence[Run], table: MapTable, estimate: EstimateTable
) -> Iterator[mapping.Point]:
    """The conditions of a map, computed by an executor."""
    return in_order([executor.submit(map_point, measured, run.id, table, estimate) for run in runs])


@lru_cache(_OPEN)
def _campaign(measured: Measured) -> Campaign:
    """The campaign, opened by this worker."""
    file, machine = Path(measured.file), platform.node()
    if not file.is_file():
        raise InputError(
            "a worker cannot see the data",
            where=f"worker on {machine}",
            got=f"no {file}",
            expected="the campaign under the same path on every machine",
            advice="mount the disk with the measurements there under the same name",
        )
    if of_files([file]) != measured.print:
        raise InputError(
            "a worker sees another campaign under the same path",
            where=f"worker on {machine}",
            got=f"another content of {file}",
            expected="the same disk on every machine",
        )
    return opened(Path(measured.path), salvage=measured.salvage)


def without_signals(run: Run) -> Run:
    """The run with its condition and findings alone."""
    return replace(run, recordings=(), frfs=(), levels=())
