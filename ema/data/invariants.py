"""What holds for the values of every data type, whoever makes it: checked when an object is made.

Types and axes are those of the annotations. This module says the rest, type by type: bands whose ends are in order,
standard deviations that are not negative, frequencies that increase, intervals that contain their value. NaN stands for
what is not known and breaks none of it, except where a value has to be finite. Values that stay in a file are not read.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from ema.data.stored_signals import StoredSignals
from ema.data.window import Window
from ema.errors import InputError

ROUNDING = 1e-9
"""How far a share or a MAC may lie outside 0 ... 1: quotients of sums of some thousand products round by less."""

Broken = tuple[str, str, str]
"""What is wrong, what the value is, and what is expected."""


@dataclass(frozen=True)
class Invariant:
    """A statement about some fields of a data type.

    Parameters
    ----------
    fields : tuple of str
        Names of the fields; nothing is said where one of them is ``None`` or stays in a file.
    broken : callable
        Takes the values of the fields, returns ``None`` where the statement holds.
    """

    fields: tuple[str, ...]
    broken: Callable[..., Broken | None]


def each(check: Callable[[Any], Broken | None], *names: str) -> tuple[Invariant, ...]:
    """One statement about each of several fields."""
    return tuple(Invariant((name,), check) for name in names)


def _bad(where: Any, values: Any) -> str:
    """The first value that is wrong."""
    return f"{np.ravel(values)[np.flatnonzero(np.ravel(where))[0]]:g}"


def _limits(lowest: float, highest: float, words: str, *, open_below: bool = False) -> Callable[[Any], Broken | None]:
    def broken(values: Any) -> Broken | None:
        array = np.asarray(values)
        wrong = (array < lowest) | (array > highest)
        if open_below:
            wrong |= array == lowest
        return ("a value is out of range", _bad(wrong, array), words) if wrong.any() else None

    return broken


positive = _limits(0.0, np.inf, "above 0", open_below=True)
not_negative = _limits(0.0, np.inf, "0 or more")
share = _limits(-ROUNDING, 1.0 + ROUNDING, "within 0 and 1")


def finite(values: Any) -> Broken | None:
    """Neither NaN nor infinite."""
    wrong = ~np.isfinite(values)
    return ("a value is not finite", _bad(wrong, values), "finite numbers") if wrong.any() else None


def increasing(values: Any) -> Broken | None:
    """Each value above the one before."""
    steps = np.diff(values)
    wrong = ~((steps > 0) & np.isfinite(steps))
    if not wrong.any():
        return None
    row = int(np.flatnonzero(wrong)[0])
    return ("an axis that does not increase", f"{values[row + 1]:g} after {values[row]:g}", "each above the one before")


def band(ends: Any) -> Broken | None:
    """Lower and upper end, in this order."""
    low, high = ends
    wrong = low > high
    return ("a band whose ends are not in order", f"{low:g} to {high:g}", "low first") if wrong else None


def _interval(low: Any, high: Any) -> Broken | None:
    low, high = np.asarray(low), np.asarray(high)
    if low.shape != high.shape or not (wrong := low > high).any():
        return None
    return ("bounds are not in order", f"{_bad(wrong, low)} and {_bad(wrong, high)}", "low <= high")


def interval(*names: str) -> tuple[Invariant, ...]:
    """A lower and an upper bound with the value between them, or the bounds alone."""
    pairs = ((names[0], names[1]), (names[1], names[2])) if len(names) == 3 else (names,)
    return tuple(Invariant(pair, _interval) for pair in pairs)


def equally_many(first: str, second: str, axis: int = 0, *, heading: bool = False) -> Invariant:
    """As many items of a sequence as an array has along an axis; as a ``heading`` of what is written in blocks also
    with an array that has none yet."""

    def broken(one: Any, other: Any) -> Broken | None:
        wanted = other.shape[axis] if hasattr(other, "shape") else len(other)
        if len(one) == wanted or (heading and wanted == 0):
            return None
        return (f"{first} and {second} differ in number", str(len(one)), f"{wanted}, as {second} has")

    return Invariant((first, second), broken)


def bands_of(axis: str, *bands: str) -> tuple[Invariant, ...]:
    """Bands with a value for each item of an axis."""

    def broken(values: Any, one: Any) -> Broken | None:
        if one.value.shape == np.shape(values):
            return None
        return ("a band of another shape than its axis", str(one.value.shape), f"{np.shape(values)}, as {axis} has")

    return tuple(Invariant((axis, one), broken) for one in bands)


def _alike(*arrays: np.ndarray) -> Broken | None:
    shapes = [array.shape for array in arrays]
    return None if len(set(shapes)) == 1 else ("bounds and values differ in shape", str(shapes), "one shape")


def _variances(covariance: np.ndarray) -> Broken | None:
    return not_negative(np.diagonal(covariance, axis1=-2, axis2=-1))


def _distinct(nodes: np.ndarray) -> Broken | None:
    numbers, counts = np.unique(nodes, return_counts=True)
    if np.all(counts == 1):
        return None
    return ("a node is there twice", str(numbers[counts > 1][0]), "each number once")


def _ordered_rows(rows: np.ndarray) -> Broken | None:
    return next((wrong for row in rows if (wrong := band(row))), None)


def _below(first: str, second: str) -> Invariant:
    """Positions from 0 in a sequence."""

    def broken(positions: Any, listed: Any) -> Broken | None:
        wrong = (np.asarray(positions) < 0) | (np.asarray(positions) >= len(listed))
        if not wrong.any():
            return None
        return (f"a position that is in no {second}", _bad(wrong, positions), f"0 to {len(listed) - 1}")

    return Invariant((first, second), broken)


INVARIANTS: dict[str, tuple[Invariant, ...]] = {
    "AmplitudeDependentMode": (
        *each(positive, "modal_mass"),
        *each(not_negative, "force", "shape_half"),
        equally_many("dofs", "shape"),
    ),
    "AmplitudeDraws": each(positive, "modal_mass"),
    "AmplitudePrediction": (
        *bands_of("amplitude", "frequency", "damping", "force"),
        *each(not_negative, "amplitude", "beyond", "weights"),
        equally_many("laws", "weights"),
    ),
    "Band": (Invariant(("low", "value", "high"), _alike), *each(share, "level")),
    "Candidate": (
        *each(positive, "natural_frequency"),
        *each(share, "confidence"),
    ),
    "Candidates": (_below("beams", "catalogue"),),
    "Channel": each(positive, "range"),
    "Condition": each(not_negative, "temperature"),
    "ConditionDifference": (
        *each(not_negative, "frequency_half", "damping_half", "frequency_noise", "damping_noise"),
        *each(share, "mac"),
        equally_many("pairs", "mac"),
    ),
    "ContactPressure": (
        *interval("least", "greatest"),
        *each(share, "open_time"),
        *each(not_negative, "areas"),
        equally_many("joints", "forces"),
        equally_many("pairs", "forces"),
    ),
    "ControlLine": each(increasing, "times"),
    "CuttingLimits": each(not_negative, "depth"),
    "Decay": (*each(increasing, "times"), *each(not_negative, "frequency_reach", "damping_reach")),
    "Excitation": (*each(band, "band"), *each(not_negative, "level"), *each(positive, "period")),
    "Expectation": each(not_negative, "tolerance"),
    "ForceSurface": each(increasing, "frequencies"),
    "ForcedResonances": (
        *bands_of("force", "amplitude", "frequency", "damping"),
        *each(not_negative, "force", "beyond"),
        *each(share, "several"),
    ),
    "ForcedResponse": (*bands_of("frequencies", "up", "down", "phase_up", "phase_down"), *each(share, "folded")),
    "Forecast": (
        *interval("frequency_low", "frequency_high"),
        *interval("damping_low", "damping_high"),
        *each(not_negative, "force_levels", "draws"),
    ),
    "FrfSet": (
        *each(increasing, "frequencies"),
        # what other programs state of variance, coherence, windows and record length is judged by a fit
        *each(not_negative, "frequencies"),
        equally_many("outputs", "values", 1, heading=True),
        equally_many("inputs", "values", 2),
    ),
    "Geometry": each(_distinct, "nodes"),
    "HarmonicResponse": (
        equally_many("dofs", "values", 1),
        *each(positive, "frequencies"),
        *each(not_negative, "orders"),  # the mean is of order 0
    ),
    "Hit": each(positive, "sampling_rate"),
    "HitGallery": (*each(increasing, "frequencies"), *each(band, "usable_band")),
    "JointForce": each(not_negative, "run_in"),
    "LevelEffect": (*interval("lower", "value", "upper"), *interval("weakest", "strongest")),
    "Loop": each(not_negative, "amplitude", "cycles"),
    "MapComparison": each(share, "inside"),
    "MapPrediction": (
        *interval("frequency_low", "frequency", "frequency_high"),
        *interval("damping_low", "damping", "damping_high"),
        *each(not_negative, "force_levels"),
    ),
    "ModalMap": (*each(not_negative, "force_levels"),),
    # shapes of other programs may come without frequencies: their poles are NaN
    "ModalModel": each(share, "confidence"),
    "ModalUncertainty": (*each(_variances, "values"), *each(not_negative, "modal_mass")),
    "ModeComparison": (
        *each(share, "mac", "co_mac"),
        equally_many("pairs", "mac"),
        equally_many("dofs", "co_mac"),
    ),
    "ModeQuality": each(share, "modal_phase_collinearity"),
    "ModelUpdate": (
        equally_many("names", "values"),
        equally_many("identifiable", "values"),
        *each(_ordered_rows, "intervals"),
    ),
    "NonlinearMode": (equally_many("dofs", "shapes"), *each(not_negative, "amplitudes")),
    "Place": (*interval("score_low", "score_high"), *interval("damping_low", "damping_high")),
    "Placement": each(_ordered_rows, "extent"),
    "PoleTable": (
        *each(finite, "poles"),
        *each(band, "band"),
        *each(not_negative, "tolerances"),
        *each(positive, "order"),
        equally_many("letter", "poles"),
        equally_many("references", "participation", 1),
    ),
    "Recording": (
        *each(finite, "sampling_rate"),
        *each(positive, "sampling_rate"),  # whether the channel table fits is judged where a record is used
    ),
    "RepeatGroup": (equally_many("runs", "places"), equally_many("assemblies", "places")),
    "Response": (*each(increasing, "times"), *each(share, "slip_time"), equally_many("dofs", "displacements")),
    "SetUpShifts": (equally_many("names", "shifts"),),
    "SetUps": (_below("number", "names"),),
    "SignalComparison": each(not_negative, "error", "envelope_error"),
    "SingleMode": (
        *each(band, "band"),
        *each(not_negative, "lines"),
        equally_many("outputs", "residues"),
        equally_many("inputs", "residues", 1),
    ),
    "Statement": (*interval("low", "high"), *interval("lower", "upper")),
    "SteppedLevel": each(positive, "frequencies") + each(not_negative, "force", "harmonics"),
    "VarianceComponents": (
        *each(not_negative, "noise", "takes", "between", "half", "noise_half"),
        *each(_ordered_rows, "between_interval"),
    ),
}
"""Statements about each data type, beside that no standard deviation is negative in any."""


_STATEMENTS: dict[type, tuple[Invariant, ...]] = {}
"""Of each type that was asked for."""


def _statements(kind: type) -> tuple[Invariant, ...]:
    """Those of a type; a field whose name ends with ``std`` is a standard deviation."""
    if kind not in _STATEMENTS:
        spreads = [field.name for field in fields(kind) if field.name.rpartition("_")[2] == "std"]
        _STATEMENTS[kind] = INVARIANTS.get(kind.__name__, ()) + each(not_negative, *spreads)
    return _STATEMENTS[kind]


_known: "WeakValueDictionary[tuple[int, str], np.ndarray]" = WeakValueDictionary()
"""Arrays that were checked, with the type and statement: ``dataclasses.replace`` hands most of them on as they are."""

_reading: ContextVar[list[InputError] | None] = ContextVar("_reading", default=None)
"""What is wrong with objects that are read from a file, where one is being read."""


def check(container: Any) -> None:
    """Refuse an object whose values contradict each other or what they stand for.

    Parameters
    ----------
    container : object
        Any of the data types, with its fields set.

    Raises
    ------
    InputError
        If a statement about its type does not hold.

    Examples
    --------
    >>> from ema.data import Excitation
    >>> Excitation("sweep", band=(80.0, 20.0))
    Traceback (most recent call last):
        ...
    ema.errors.InputError: Excitation.band: a band whose ends are not in order; got 80 to 20, expected low first
    """
    kind = type(container)
    for number, invariant in enumerate(_statements(kind)):
        values = [getattr(container, field) for field in invariant.fields]
        if any(value is None for value in values) or isinstance(values[0], Window | StoredSignals):
            continue
        single = values[0] if len(values) == 1 and isinstance(values[0], np.ndarray) else None
        name = (id(single), f"{kind.__name__} {number}")
        if single is not None and _known.get(name) is single:
            continue
        if (wrong := invariant.broken(*values)) is not None:
            _refuse(container, invariant.fields, wrong)
        elif single is not None:
            _known[name] = single


def _refuse(container: Any, names: tuple[str, ...], wrong: Broken) -> None:
    what, got, expected = wrong
    label = getattr(container, "name", "")
    where = f"{type(container).__name__}.{names[0]}"
    error = InputError(what, where=f"{label}, {where}" if label else where, got=got, expected=expected)
    reading = _reading.get()
    if reading is None:
        raise error
    reading.append(error)


@contextmanager
def as_stored(file: str) -> Iterator[None]:
    """Read objects of earlier versions, which did not check them: what does not hold is a warning with the file's name.

    Parameters
    ----------
    file : str
        File that is read.

    Yields
    ------
    None
        While objects are made from the file.

    Examples
    --------
    >>> import warnings
    >>> from ema.data import Excitation
    >>> with warnings.catch_warnings(record=True) as said, as_stored("old.h5"):
    ...     warnings.simplefilter("always")
    ...     excitation = Excitation(band=(80.0, 20.0))
    >>> excitation.band
    (80.0, 20.0)
    """
    broken: list[InputError] = []
    token = _reading.set(broken)
    try:
        yield
    finally:
        _reading.reset(token)
    if broken:
        more = f" ({len(broken) - 1} more)" if len(broken) > 1 else ""
        warnings.warn(f"{file}: {broken[0]}{more}; the values are those of the file", UserWarning, stacklevel=4)
