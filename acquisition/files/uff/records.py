"""Records of numbers in the data sets that announce no lengths: geometry and mode shapes.

What such a set says twice is compared: how many nodes a line has, how many numbers every record, how many digits every
number that is written with an exponent, and all of them where one form is the rule.
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence

_EXPONENT = re.compile(r"[+-]?(\d*)\.?(\d*)(?:[eEdD]([+-]?)(\d+)|[+-]\d{3})")
_ZERO = re.compile(r"[+-]?0*\.?0*")


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
    """A real number with E or D exponent, or one of three digits without a letter, as Fortran writes it."""
    return float(re.sub(r"(?<=\d)([+-]\d{3})$", r"E\1", word.replace("D", "E").replace("d", "e")))


def whole(rows: Iterable[Sequence[str]]) -> None:
    """Refuse rows of numbers in which one is cut short, or has a digit more or less than all others.

    Numbers with exponents are written in one form: equally many digits in front of the point, behind it and, but for
    exponents beyond 99, in the exponent. Where those within the rows are, the last ones are; where most are and one of
    them ends with a zero, which a writer of as many digits as it takes leaves out, all are. The number zero may be
    written without an exponent, and a zero in front of the point may be left out behind a minus.

    Raises
    ------
    ValueError : one is damaged.
    """
    rows = list(rows)
    counts = Counter(form for row in rows for word in row if (form := _form(word)) is not None)
    if not counts:
        return
    usual, often = counts.most_common(1)[0]
    inner = {_form(word) for row in rows for word in row[:-1] if not _ZERO.fullmatch(word)}
    zeros_kept = any(re.search("0[eEdD]", word) and _form(word) == usual for row in rows for word in row)
    one_form = inner == {usual} or (zeros_kept and 2 * (counts.total() - often) <= often)
    for word in (word for row in rows for word in row) if one_form else ():
        form = _form(word)
        without_zero = (0, *usual[1:]) if word.startswith("-") and usual[0] == 1 else usual
        if form not in (usual, without_zero) and not _ZERO.fullmatch(word):
            raise ValueError(f"the number {word!r} is written with another number of digits than the others")


def _form(word: str) -> tuple[int, int, int, int] | None:
    """Of a number with an exponent: digits in front of the point and behind it, sign and digits of the exponent."""
    found = _EXPONENT.fullmatch(word)
    if found is None:
        return None
    if found[4] is None:  # Fortran's exponent of three digits
        return len(found[1]), len(found[2]), 1, 2
    return len(found[1]), len(found[2]), len(found[3]), 2 if len(found[4]) == 3 else len(found[4])
