"""What every order to the simulator is checked for: numbers that are numbers, and results that fit the memory."""

import os
from typing import Any

import numpy as np

from ema.errors import InputError

_SHARE, _UNKNOWN = 0.7, 8e9
"""Share of the machine's memory that a run may take; bytes where the machine does not say how much it has."""


def is_number(value: Any) -> bool:
    """Whether this is a real number that is not NaN or infinite."""
    return isinstance(value, int | float | np.integer | np.floating) and bool(np.isfinite(value))


def positive(where: str, **numbers: Any) -> None:
    """Refuse what is no number above zero.

    Raises
    ------
    InputError : as said.
    """
    for name, value in numbers.items():
        if not (is_number(value) and value > 0):
            raise InputError("not a positive number", where=where, got=f"{name} = {value!r}", expected="above 0")


def with_unit(value: Any, unit: str) -> str:
    """A value that is refused, with its unit; a text as it stands, as it may have one."""
    return repr(value) if isinstance(value, str) else f"{value} {unit}"


def sample_count(where: str, duration: float, sampling_rate: float) -> int:
    """Whole sampling intervals of a motion, one at least.

    Raises
    ------
    InputError : a number is not positive.
    """
    positive(where, duration=duration, sampling_rate=sampling_rate)
    return max(round(duration * sampling_rate), 1)


def not_negative(where: str, **numbers: Any) -> None:
    """Refuse what is no number of zero or more.

    Raises
    ------
    InputError : as said.
    """
    for name, value in numbers.items():
        if not (is_number(value) and value >= 0):
            raise InputError("not a possible value", where=where, got=f"{name} = {value!r}", expected="0 or more")


def finite(where: str, **numbers: Any) -> None:
    """Refuse what is no number, NaN or infinite.

    Raises
    ------
    InputError : as said.
    """
    for name, value in numbers.items():
        if not is_number(value):
            raise InputError("not a number", where=where, got=f"{name} = {value!r}", expected="a finite one")


def fits_memory(where: str, samples: int, numbers_each: int) -> None:
    """Refuse a run whose samples take more memory than the machine has, before it begins.

    Raises
    ------
    InputError : as said.
    """
    needed, there = 8.0 * samples * numbers_each, _SHARE * memory()
    if needed > there:
        got = f"{samples:.2g} samples, {needed / 2**30:.3g} GiB"
        raise InputError(
            "the run does not fit the memory",
            where=where,
            got=got,
            expected=f"up to {there / 2**30:.3g} GiB",
            advice="shorten it, lower the sampling rate, or keep fewer modes",
        )


def memory() -> float:
    """Bytes of memory of this machine, as far as it says so."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return _UNKNOWN
