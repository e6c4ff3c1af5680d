"""Results finished earlier: taken where they would come out the same, otherwise named with the reason."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ema import fingerprint, store
from ema.data import FrfSet, Provenance, RunResult
from ema.data.window import Window
from ema.errors import EmaError
from ema.progress import Progress, note

IN_FILE = 16 * 2**20
"""Bytes of the FRFs of a run from which on they stay in the file of the finished run and are read when used: runs of
a campaign, which are all there at its end, may be many."""

_SHOWN = 3
"""Changes that a sentence names; the others are counted."""


def known(path: Path, made: Provenance, what: str, progress: Progress) -> Any:
    """The result in ``path`` if it was made in the same way; ``None`` otherwise. Either is noted with its reason."""
    result, reason = None, ""
    if not path.is_file():
        reason = "not computed before"
    else:
        try:
            stored = store.load(path)
            reason = changes(stored["made"], made)
            result = None if reason else stored["result"]
            reason = f"computed again: {reason}" if reason else "taken as it was computed"
        except (EmaError, KeyError, TypeError, AttributeError) as error:
            why = error.what if isinstance(error, EmaError) else "it holds something else"
            reason = f"computed again: the kept file cannot be read ({why})"
    note(progress, f"{what}: {reason}")
    return result


def known_or_computed(
    path: Path, made: Provenance, what: str, compute: Callable[[], Any], progress: Progress, *, resume: bool
) -> Any:
    """The result in ``path`` where it is still right and ``resume`` is set; otherwise what ``compute`` gives, kept."""
    if resume and (result := known(path, made, what, progress)) is not None:
        return result
    result = compute()
    store.save(path, {"made": made, "result": result})
    return result


@dataclass(frozen=True)
class _InMemory:
    """An array as the source of a window, so that it is written in blocks."""

    array: np.ndarray

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        return self.array.shape

    @property
    def dtype(self) -> np.dtype:
        """Type of the values."""
        return self.array.dtype

    @property
    def chunks(self) -> tuple[int, ...]:
        """All of it lies together."""
        return self.array.shape

    def read(self, box: tuple[slice, ...]) -> np.ndarray:
        """The values of a box."""
        return np.asarray(self.array[box])


def save_run(path: Path, made: Provenance, result: RunResult) -> RunResult:
    """Write a finished run; what is returned has FRFs that stay in the file where they are large."""
    sets = [frfs for frfs in (result.frfs, result.reconstruction) if frfs is not None]
    if sum(map(_size, sets)) < IN_FILE:
        store.save(path, {"made": made, "result": result})
        return result
    synthesised = None if result.reconstruction is None else _in_blocks(result.reconstruction)
    store.save(
        path, {"made": made, "result": replace(result, frfs=_in_blocks(result.frfs), reconstruction=synthesised)}
    )
    stored: RunResult = store.load(path)["result"]
    return stored


def _size(frfs: FrfSet) -> int:
    """Bytes of what is in memory of a set."""
    deviations = None if frfs.deviations is None else frfs.deviations.values
    arrays = (frfs.values, frfs.coherence, frfs.variance, deviations)
    return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))


def _in_blocks(frfs: FrfSet) -> FrfSet:
    """The set with its large arrays as windows, which the store writes in blocks and leaves in the file."""

    def window(array: Any) -> Any:
        return Window(_InMemory(array)) if isinstance(array, np.ndarray) else array

    deviations = frfs.deviations
    if deviations is not None:
        deviations = replace(deviations, values=window(deviations.values))
    return replace(
        frfs,
        values=window(frfs.values),
        coherence=window(frfs.coherence),
        variance=window(frfs.variance),
        deviations=deviations,
    )


def changes(before: Provenance, now: Provenance) -> str:
    """What makes two results differ: inputs, settings, code, packages; empty where nothing does."""
    differences = []
    old, new = dict(before.inputs), dict(now.inputs)
    differences += [f"{name} has changed" for name in new if name in old and old[name] != new[name]]
    differences += [f"{name} is new" for name in new if name not in old]
    differences += [f"{name} is no longer used" for name in old if name not in new]
    old, new = dict(before.options), dict(now.options)
    names = dict.fromkeys([*old, *new])
    differences += [
        f"{name} was {old.get(name, 'not known')} and is {new.get(name, 'not known')}"
        for name in names
        if old.get(name) != new.get(name)
    ]
    old, new = dict(before.versions), dict(now.versions)
    if old.get(fingerprint.CODE) != new.get(fingerprint.CODE):
        differences.append("the code of friction-ema has changed")
    differences += [
        f"{name} was {old.get(name, 'not noted')} and is {new.get(name, 'absent')}"
        for name in dict.fromkeys([*old, *new])
        if name != fingerprint.CODE and old.get(name) != new.get(name)
    ]
    if not differences and before != now:
        differences.append("its steps have changed")
    more = len(differences) - _SHOWN
    return "; ".join(differences[:_SHOWN]) + (f"; and {more} more changes" if more > 0 else "")
