"""A mutated file with what it holds, and the judgement of what a reader makes of it.

Three kinds: an *edit* is valid and is read as edited; *damage* of the structure (bytes or lines lost, doubled, moved, counts
wrong) is refused or named, and every channel that is delivered is exact; *noise* is refused, named, or equal to what a
parser that is not ours reads from the same bytes. The truth is made by the mutator, never by a reader of ours.
"""

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

import acquisition
from acquisition.contents import Contents
from ema.errors import EmaError

Signals = Mapping[str, tuple[Any, Any]]
"""Axis (sample,) and values (sample,) of every channel or FRF by a name that the file states."""


@dataclass(frozen=True)
class Case:
    """A mutated file: its bytes, how it was made, and the signals that it really holds.

    ``blind`` names the class of damage that the format has no redundancy to show, where this is one.
    """

    data: bytes
    kind: str
    what: str
    truth: Signals
    blind: str = ""


@dataclass(frozen=True)
class Reading:
    """What was read: signals, and how many places findings name as wrong; or the sentence of the refusal."""

    signals: Signals = field(default_factory=dict)
    named: int = 0
    refusal: str = ""


class Subject(Protocol):
    """A reader with its mutator."""

    name: str
    suffix: str

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""

    def read(self, path: Path) -> Reading:
        """What our reader makes of a file."""

    def independent(self, path: Path) -> list[Signals]:
        """What other parsers make of it; empty where they fail."""


_ALL = 1 << 30
"""Places named where it is the whole file."""


def reading(path: Path, pick: Callable[[Contents], Signals], **options: Any) -> Reading:
    """What ``acquisition.read`` makes of a file.

    Raises
    ------
    AssertionError : a refusal of more than one line.
    """
    try:
        contents = acquisition.read(path, **options)
    except EmaError as error:
        assert "\n" not in str(error) and "Traceback" not in str(error), str(error)
        return Reading(refusal=str(error))
    if any(finding.severity == "error" and finding.where == path.name for finding in contents.findings):
        return Reading(pick(contents), _ALL)  # the file as a whole
    named = {finding.where for finding in contents.findings if finding.severity != "info" or finding.code == "not-read"}
    return Reading(pick(contents), len(named))


def channels(contents: Contents) -> Signals:
    """The channels of all recordings by DOF, or by name where they have none."""
    found: dict[str, tuple[Any, Any]] = {}
    for record in contents.recordings:
        axis = np.arange(record.signals.shape[1]) / record.sampling_rate
        for channel, row in zip(record.channels, record.signals, strict=True):
            _add(found, str(channel.dof or channel.name), (axis, np.asarray(row)))
    for frfs in contents.frfs:
        for row, output in enumerate(frfs.outputs):
            for column, input_ in enumerate(frfs.inputs):
                _add(found, f"{output}/{input_}", (frfs.frequencies, frfs.values[:, row, column]))
    return found


def _add(found: dict[str, tuple[Any, Any]], name: str, signal: tuple[Any, Any]) -> None:
    copies = sum(other == name or other.startswith(f"{name} #") for other in found)
    found[f"{name} #{copies + 1}" if copies else name] = signal


def equal(one: tuple[Any, Any], other: tuple[Any, Any], *, prefix: bool = False) -> bool:
    """Whether two signals are the same to the rounding of a text, or the first is the beginning of the second."""
    (axis, values), (other_axis, other_values) = one, other
    if prefix:
        other_axis, other_values = other_axis[: len(axis)], other_values[: len(values)]
    if len(values) != len(other_values) or len(axis) != len(other_axis):
        return False
    with np.errstate(all="ignore"):
        # a sampling rate that the file rounds moves the last sample by its rounding, times the number of samples
        span = float(np.max(np.abs(other_axis), initial=0.0)) if len(axis) else 0.0
        close = np.abs(np.asarray(axis) - other_axis) <= 1e-5 * span + 1e-12
        same = np.isclose(values, other_values, rtol=1e-6, atol=0, equal_nan=True)
    return bool(np.all(close) and np.all(same))


def same(there: Signals, expected: Signals) -> bool:
    """Whether two sets of signals are the same."""
    return there.keys() == expected.keys() and all(equal(there[name], expected[name]) for name in there)


def judged(subject: Subject, case: Case, path: Path) -> str:
    """``fine``, ``refused``, ``named``, ``independent``, ``blind: class``, or ``wrong: why``."""
    path.write_bytes(case.data)
    there = subject.read(path)
    if there.refusal:
        return "refused" if case.kind != "edit" else f"wrong: a valid edit is refused: {there.refusal[:200]}"
    if same(there.signals, case.truth):
        return "fine"
    if case.kind == "edit":
        return f"wrong: the edit is not read as edited: {_difference(there.signals, case.truth)}"
    inexact = [
        name
        for name, signal in there.signals.items()
        if name not in case.truth or not equal(signal, case.truth[name], prefix=there.named > 0)
    ]
    others = subject.independent(path) if case.kind == "noise" else []
    inexact = [
        name for name in inexact if not any(_read_so(name, there.signals, case.truth, other) for other in others)
    ]
    if there.named >= max(len(inexact), 1):  # each that is not exact has a finding of its own
        return "named"
    if case.blind:
        return f"blind: {case.blind}"
    complete = (
        others and not inexact and there.signals.keys() == case.truth.keys()
    )  # each is exact or read so by others
    if complete or any(same(there.signals, other) for other in others):
        return "independent"
    return f"wrong: {_difference(there.signals, case.truth)}" + (" though something is named" if there.named else "")


def _read_so(name: str, there: Signals, truth: Signals, other: Signals) -> bool:
    """Whether another parser reads the values of a signal, and the axis is that of the truth or of that parser.

    Of time stamps that are not even a reader keeps the even axis, as of rounded ones.
    """
    if name not in other or len(other[name][1]) != len(there[name][1]):
        return False
    axes = [other[name][0]] + [truth[name][0] for _ in range(name in truth)]
    return any(equal(there[name], (axis, other[name][1])) for axis in axes)


def _difference(there: Signals, truth: Signals) -> str:
    for name in [*there, *truth]:
        if name not in truth:
            return f"{name} is not in the file"
        if name not in there:
            return f"{name} is missing"
        if not equal(there[name], truth[name]):
            (axis, values), (true_axis, true_values) = there[name], truth[name]
            if len(values) != len(true_values):
                return f"{name} has {len(values)} values, not {len(true_values)}"
            with np.errstate(all="ignore"):
                place = int(np.argmax(~np.isclose(values, true_values, rtol=1e-6, atol=0, equal_nan=True)))
            last = (axis[-1], true_axis[-1]) if len(values) else ""
            return f"{name}: value {place} is {values[place]}, not {true_values[place]}; axis ends {last}"
    return "nothing"
