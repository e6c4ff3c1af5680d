"""A block of rows of a text table, with the lines above it."""

from dataclasses import dataclass
from typing import Any

from ema.data import Finding


@dataclass(frozen=True)
class Segment:
    """A block of rows with equally many columns, and the lines of text above it."""

    header: tuple[str, ...]
    values: Any
    titles: tuple[str, ...]
    labels: tuple[str, ...] = ()
    """Names of the rows, where every row begins with one."""
    units: tuple[str, ...] = ()
    """What a line of units above the columns says of each; empty where there is no such line."""
    line: int = 0
    """Number of the first row in the file, counted from 1."""
    source: tuple[str, ...] = ()
    """The rows as text, where every row begins with a name."""
    closed: bool = False
    """Whether a delimiter stands behind the last number of every row."""
    decimal: str = "."
    """The decimal mark of its numbers."""
    notes: tuple[Finding, ...] = ()
