"""The named arrays of one file, and the places in them."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from acquisition.units import bracketed
from ema.data import Finding
from ema.errors import InputError

PLACE = re.compile(r"^(?P<array>.*?)\s*\b(?P<axis>row|column)\s+(?P<number>\d+)$")
"""A row or a column of an array, or of the main array where none is named."""


@dataclass(frozen=True)
class Arrays:
    """The arrays of one file by name.

    ``main`` names the array that ``"column 2"`` and ``"row 0"`` mean. ``units`` holds unit strings that the file
    itself states; ``labels`` holds every text that stands where a unit belongs, whether a unit or not; ``headings`` the
    whole title of a place; ``findings`` what the reader has to say.
    """

    where: str
    arrays: Mapping[str, Any]
    main: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    titles: Sequence[str] = ()
    metadata: tuple[tuple[str, str], ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict)
    headings: Mapping[str, str] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Arrays of the file that were not read, and what they are."""

    def label(self, place: str) -> str:
        """What stands where a unit belongs; empty where nothing does."""
        return self.labels.get(place) or self.units.get(place) or bracketed(place)[1]

    def title(self, place: str) -> str:
        """All that the file calls a place, its label included."""
        return self.headings.get(place) or f"{place} {self.labels.get(place, '')}".strip()

    def listing(self) -> str:
        """The names with their shapes, for messages."""
        shown = [f"{name or 'main array'} {np.shape(array)}" for name, array in self.arrays.items()]
        return ", ".join(shown[:20]) + (" ..." if len(shown) > 20 else "")

    def __getitem__(self, place: str) -> Any:
        """The array at a place.

        Raises
        ------
        InputError : there is no such place.
        """
        if place in self.arrays:
            return self.arrays[place]
        if place in self.left_out:
            raise InputError(
                "an array that is not read",
                where=self.where,
                got=f"{place}, {self.left_out[place]}",
                expected=self.listing() or None,
                advice="name another array, or export this one as numbers",
            )
        found = PLACE.match(place)
        if found is None or (found["array"] or self.main) not in self.arrays:
            raise InputError("nothing at this place", where=self.where, got=repr(place), expected=self.listing())
        array, number = np.asarray(self.arrays[found["array"] or self.main]), int(found["number"])
        axis = 0 if found["axis"] == "row" else 1
        if array.ndim != 2 or number >= array.shape[axis]:
            raise InputError(
                f"no {found['axis']} {number}",
                where=self.where,
                got=f"an array of shape {array.shape}",
                expected="a smaller number; counting starts at 0",
            )
        return array[number] if axis == 0 else array[:, number]

    def vector(self, place: str, dtype: Any = np.float64) -> Any:
        """The numbers at a place as a vector.

        Raises
        ------
        InputError : no such place, no numbers there, or more than a vector.
        """
        return np.squeeze(self.numbers(place, dtype)).reshape(-1) if self._slim(place) else self._not_a_vector(place)

    def _slim(self, place: str) -> bool:
        return sum(length > 1 for length in np.shape(self[place])) <= 1

    def _not_a_vector(self, place: str) -> Any:
        raise InputError(
            "a vector is wanted here",
            where=self.where,
            got=f"{place} of shape {np.shape(self[place])}",
            expected="'column 0' or 'row 0' of it",
        )

    def numbers(self, place: str, dtype: Any = np.float64) -> Any:
        """The numbers at a place.

        Raises
        ------
        InputError : no such place, or no numbers there.
        """
        array = np.asarray(self[place])
        if array.dtype.kind not in "biufc" or (array.dtype.kind == "c" and dtype == np.float64):
            raise InputError(
                "no real numbers" if dtype == np.float64 else "no numbers",
                where=self.where,
                got=f"{place} of type {array.dtype}",
                advice="say frf='...' if these are complex FRFs, or name another array"
                if array.dtype.kind == "c"
                else "name another array, or export this one as numbers",
            )
        return array.astype(dtype)

    def texts(self, value: Any) -> list[str]:
        """Texts given directly, or at a place."""
        if isinstance(value, str):
            value = self.arrays.get(value, [value])
        return [item.decode("utf-8", "replace") if isinstance(item, bytes) else str(item) for item in np.ravel(value)]


class UndescribedError(InputError):
    """A file does not say what its arrays are.

    Parameters
    ----------
    arrays : Arrays
        The arrays, so that a caller can find out or ask.

    Examples
    --------
    >>> issubclass(UndescribedError, InputError)
    True
    """

    def __init__(self, arrays: Arrays) -> None:
        self.arrays = arrays
        super().__init__(
            "the file does not say what its arrays are",
            where=arrays.where,
            got=arrays.listing(),
            advice="say it, e.g. signals='...' with time='...' or sampling_rate=..., frequency='...' with real='...' "
            "and imaginary='...', or x, y, z",
        )


def fields(records: Any, prefix: str) -> tuple[dict[str, Any], dict[str, str]]:
    """The fields of an array of records that are numbers as arrays by name, and what the others are."""
    kinds = {name: records.dtype[name].base.kind for name in records.dtype.names}
    numbers = {
        f"{prefix}{name}": np.ascontiguousarray(records[name]) for name, kind in kinds.items() if kind in "biufc"
    }
    others = {f"{prefix}{name}": "a field of records that is no number" for name in kinds}
    return numbers, {name: what for name, what in others.items() if name not in numbers}


CONSTANT_FROM = 16
"""Values from which equal ones are no chance: shorter columns may be steady by rounding. Halved or doubled, only
columns of that length are judged otherwise."""


def constant(values: Any, name: str | None, where: str) -> tuple[Finding, ...]:
    """A finding where a vector of numbers is one and the same number throughout."""
    values = np.asarray(values)
    if values.ndim != 1 or len(values) < CONSTANT_FROM or not (values == values[0]).all():
        return ()
    message = f"all {len(values)} values of {name} are {values[0]:.6g}."
    return (
        Finding(
            "warning",
            "constant",
            where,
            message,
            float(values[0].real),
            None,
            "The channel was dead, or the column was filled in; leave it out.",
        ),
    )


def not_finite(values: Any, where: str) -> tuple[Finding, ...]:
    """A finding where some values are NaN or infinite."""
    bad = int(np.size(values) - np.count_nonzero(np.isfinite(values)))
    if not bad:
        return ()
    message = f"{bad} of {np.size(values)} values are NaN or infinite."
    return (Finding("error", "not-finite", where, message, float(bad), 0.0, "Export the file again or leave it out."),)
