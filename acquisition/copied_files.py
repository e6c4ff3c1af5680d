"""One file under several names: what was measured once would count several times."""

import hashlib
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from itertools import combinations
from pathlib import Path

from ema.data import Finding
from ema.fingerprint import of_files

_ENDS = 64 * 2**10
"""Bytes at the beginning and the end of a file that are compared before the whole of it is read."""


def copies(paths: Sequence[Path], where: str) -> list[Finding]:
    """A finding for every group of files with the same content; a measurement never has the same noise twice."""
    return [_finding(group, where) for group in alike(paths)]


def alike(paths: Sequence[Path]) -> list[list[Path]]:
    """Groups of files with the same content."""
    groups: list[list[Path]] = [list(paths)]
    for mark in (_size, _ends, _whole):
        groups = [same for group in groups for same in _grouped(group, mark)]
    return groups


def copied_repeats(runs: Mapping[str, Sequence[Path]], label: str) -> list[Finding]:
    """A finding for runs that are said to repeat a condition and share a file: that repeats nothing."""
    findings = []
    for (former, first), (latter, second) in combinations(runs.items(), 2):
        groups = alike([*first, *second])
        shared = [group for group in groups if set(group) & set(first) and set(group) & set(second)]
        if shared:
            findings.append(
                Finding.of(
                    "error",
                    "copied-file",
                    f"repeat {label}",
                    "Runs {former} and {latter} repeat one condition with the same measurement ({names}): the "
                    "scatter between assemblies is too small, and changes seem significant that are not.",
                    len(shared),
                    0,
                    advice="Name the file of each repeat, or take the label repeat away.",
                    former=former,
                    latter=latter,
                    names=", ".join(sorted({path.name for path in shared[0]})),
                )
            )
    return findings


def _grouped(paths: Iterable[Path], mark: Callable[[Path], Hashable]) -> list[list[Path]]:
    """Those that share their mark with another one."""
    by_mark = defaultdict(list)
    for path in paths:
        by_mark[mark(path)].append(path)
    return [group for group in by_mark.values() if len(group) > 1]


def _size(path: Path) -> int:
    return path.stat().st_size


def _ends(path: Path) -> str:
    with path.open("rb") as file:
        first = file.read(_ENDS)
        file.seek(max(path.stat().st_size - _ENDS, 0))
        return hashlib.sha256(first + file.read()).hexdigest()


def _whole(path: Path) -> str:
    return of_files([path])


def _finding(paths: list[Path], where: str) -> Finding:
    names = ", ".join(path.name for path in paths[:5]) + (" ..." if len(paths) > 5 else "")
    return Finding.of(
        "error",
        "copied-file",
        where,
        "{count} files are copies of one: {names}. What was measured once counts {count} times, and "
        "coherence and intervals are too good.",
        len(paths),
        1,
        advice="Remove the copies, exclude them by a repair, or measure these points again.",
        count=len(paths),
        names=names,
    )
