"""What a container says about itself in a console and in a notebook: one short line, and a table that unfolds."""

import math
from collections.abc import Sequence
from dataclasses import MISSING, fields, is_dataclass
from html import escape
from typing import Any

import numpy as np

from ema.data.window import Window

LONGEST_TEXT = 60
"""Characters of a text that are shown; a line of a console has 80 to 120."""
MOST_ITEMS = 4
"""Items of a sequence that are shown one by one; longer ones are counted."""
DEEPEST = 2
"""Containers inside containers that are shown; deeper ones by the name of their class."""


class Container:
    """Base of the data types: a short ``repr``, and the same as a folding table in notebooks.

    Neither shows the numbers in an array, and neither promises that ``eval`` gives the object back.
    """

    __slots__ = ()

    def _headline(self) -> str:
        """What it is in a few words; by default the fields that differ from their defaults."""
        rows = _rows(self)
        shown = [f"{name}={text}" for name, text in rows[:12]]
        return ", ".join([*shown, f"and {len(rows) - 12} more fields"] if len(rows) > 12 else shown)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._headline()})"

    def _repr_html_(self) -> str:
        """The headline with every field below it; no script, all text escaped."""
        cells = "".join(
            f'<tr><td style="text-align:left">{escape(name)}</td><td style="text-align:left">{escape(text)}</td></tr>'
            for name, text in _rows(self)
        )
        summary = f"<b>{escape(type(self).__name__)}</b> {escape(self._headline())}"
        return f"<details><summary>{summary}</summary><table>{cells}</table></details>"


def _rows(container: Any) -> list[tuple[str, str]]:
    """``(name, text)`` of the public fields that are not at their defaults."""
    rows = []
    for field in fields(container):
        value = getattr(container, field.name)
        if not field.name.startswith("_") and not _is_default(value, field.default):
            rows.append((field.name, brief(value)))
    return rows


def _is_default(value: Any, default: Any) -> bool:
    return (
        default is not MISSING and not isinstance(value, np.ndarray | Window) and (value is default or value == default)
    )


def brief(value: Any, depth: int = 0) -> str:
    """A value in a few words: shape and range of an array, number of items of a long sequence.

    Parameters
    ----------
    value : object
        Any field of a container.
    depth : int
        How many containers and sequences it is inside of.

    Returns
    -------
    str
        At most a few hundred characters.

    Examples
    --------
    >>> brief(np.linspace(0, 1600, 6401))
    '<float64 (6401,), 0 ... 1600>'
    >>> brief(("a", "b", "c", "d", "e"))
    '<5 str>'
    """
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, str):
        return repr(value if len(value) <= LONGEST_TEXT else value[: LONGEST_TEXT - 3] + "...")
    if isinstance(value, bool | int | type(None)):
        return repr(value)
    if isinstance(value, float | complex | np.number):
        return f"{value:.6g}"
    if isinstance(value, Sequence):
        return _sequence(value, depth)
    if is_dataclass(value) and depth >= DEEPEST:
        return f"<{type(value).__name__}>"
    if isinstance(value, Container):
        return repr(value) if depth == 0 and len(repr(value)) <= 2 * LONGEST_TEXT else f"<{type(value).__name__}>"
    text = str(value)
    return text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 3] + "..."


def _array(values: np.ndarray) -> str:
    kind = f"{values.dtype} {values.shape}" if values.dtype.kind != "U" else f"str {values.shape}"
    if values.size and values.dtype.kind in "iuf":
        finite = values[np.isfinite(values)]
        if finite.size:
            kind += f", {float(finite.min()):.6g} ... {float(finite.max()):.6g}"
        if finite.size < values.size:
            kind += f", {values.size - finite.size} NaN"
    return f"<{kind}>"


def _sequence(values: Sequence[Any], depth: int) -> str:
    if not isinstance(values, tuple | list):  # made when asked for
        return f"<{len(values)} items, read when used>"
    if not values:
        return "()"
    if len(values) <= MOST_ITEMS and depth < DEEPEST:
        shown = "(" + ", ".join(brief(value, depth + 1) for value in values) + ("," if len(values) == 1 else "") + ")"
        if len(shown) <= 2 * LONGEST_TEXT:
            return shown
    kinds = list(dict.fromkeys(type(value).__name__ for value in values))
    return f"<{len(values)} {kinds[0] if len(kinds) == 1 else 'items'}>"


def count(number: int, what: str, several: str = "") -> str:
    """``1 mode``, ``3 modes``."""
    return f"{number} {what if number == 1 else several or what + 's'}"


def span(values: np.ndarray, unit: str) -> str:
    """``0 to 1600 Hz``; empty for no values."""
    finite = np.asarray(values)[np.isfinite(values)]
    if not finite.size:
        return ""
    low, high = float(finite.min()), float(finite.max())
    return f"{low:.5g} {unit}" if math.isclose(low, high) else f"{low:.5g} to {high:.5g} {unit}"


def phrase(*parts: str) -> str:
    """The parts that say something, in one line."""
    return ", ".join(part for part in parts if part)
