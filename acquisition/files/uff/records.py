"""Records of numbers in the data sets that announce no lengths: geometry and mode shapes.

What such a set says twice is compared: how many nodes a line has, how many numbers every record, how many digits every
number that is written with an exponent.
"""

import re
from collections.abc import Iterable, Sequence

_EXPONENT = re.compile(r"[+-]?\d*\.?(\d*)[eEdD][+-]?\d+")


def inside(lines: Sequence[bytes]) -> list[bytes]:
    """The records without blank lines behind them.

    Raises
    ------
    ValueError : a blank line between them.
    """
    kept = list(lines)
    while kept and not kept[-1].strip():
        kept.pop()
    if any(not line.strip() for line in kept):
        raise ValueError("a blank line between the records")
    return kept


def words(line: bytes) -> list[str]:
    """The numbers of a line as texts.

    Raises
    ------
    ValueError : bytes that no number holds, though Python takes them for blanks or marks between digits.
    """
    if b"_" in line or not line.isascii():
        raise ValueError(f"{line.strip()[:40]!r} is no row of numbers")
    return line.decode("ascii").split()


def integers(line: bytes) -> list[int]:
    """Integers of a line, parted by blanks.

    Raises
    ------
    ValueError : something else is there.
    """
    return [int(word) for word in words(line)]


def real(word: str) -> float:
    """A real number with E or D exponent."""
    return float(word.replace("D", "E").replace("d", "e"))


def whole(rows: Iterable[Sequence[str]]) -> None:
    """Refuse rows of numbers in which one is cut short at the end of its row.

    Numbers with exponents are written with equally many decimals; where those within the rows are, the last ones are.

    Raises
    ------
    ValueError : one is cut short.
    """
    rows = list(rows)
    decimals = {_decimals(word) for row in rows for word in row[:-1]}
    if len(decimals) == 1 and None not in decimals:
        for row in rows:
            if row and _decimals(row[-1]) not in decimals:
                raise ValueError(f"the number {row[-1]!r} is cut short")


def _decimals(word: str) -> int | None:
    """Digits behind the point of a number with an exponent."""
    found = _EXPONENT.fullmatch(word)
    return None if found is None else len(found[1])
