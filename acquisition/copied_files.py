"""One file under several names: what was measured once would count several times."""

import hashlib
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from pathlib import Path

from ema.data import Finding
from ema.fingerprint import of_files

_ENDS = 64 * 2**10
"""Bytes at the beginning and the end of a file that are compared before the whole of it is read."""


def copies(paths: Sequence[Path], where: str) -> list[Finding]:
    """A finding for every group of files with the same content; a measurement never has the same noise twice."""
    groups: list[list[Path]] = [list(paths)]
    for mark in (_size, _ends, _whole):
        groups = [alike for group in groups for alike in _grouped(group, mark)]
    return [_finding(group, where) for group in groups]


def _grouped(paths: Iterable[Path], mark: Callable[[Path], Hashable]) -> list[list[Path]]:
    """Those that share their mark with another one."""
    found = defaultdict(list)
    for path in paths:
        found[mark(path)].append(path)
    return [group for group in found.values() if len(group) > 1]


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
    return Finding(
        "error",
        "copied-file",
        where,
        f"{len(paths)} files are copies of one: {names}. What was measured once counts {len(paths)} times, and "
        "coherence and intervals are too good.",
        len(paths),
        1,
        "Remove the copies, exclude them by a repair, or measure these points again.",
    )
