"""The values of data set 58: where they lie, reading and writing them."""

import re
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from acquisition.files.uff.header58 import Header

_LINES = {
    (2, True): (13,) * 6,
    (2, False): (13,) * 6,
    (5, True): (13,) * 6,
    (5, False): (13,) * 6,
    (4, True): (20,) * 4,
    (4, False): (13, 20, 13, 20),
    (6, True): (20,) * 4,
    (6, False): (13, 20, 20),
}
"""Widths of the fields of one line of text, by ordinate type and even spacing."""


_CONTROL = re.compile(rb"[\0-\x08\v\f\x0e-\x1f]")
"""What no text of numbers holds; a conversion to numbers may skip it, or take it for a blank."""


_LONGEST_LINE = 1 << 16
"""Most characters of a line of values: the format has 80; text that does not keep to it is taken apart in memory."""


@dataclass(frozen=True)
class Function:
    """One function: its header, abscissa (point,) and ordinate (point,) as written in the file."""

    header: Header
    x: Any
    y: Any
    problem: str = ""
    """How the values differ from what the header announces; those in front of the difference are here."""


def per_point(header: Header) -> int:
    """Numbers written for each point."""
    return (2 if header.is_complex else 1) + (0 if header.even else 1)


def widths(header: Header) -> tuple[int, ...]:
    """Widths of the fields of one line of text."""
    return _LINES[header.kind, header.even]


def record_types(header: Header) -> list[np.dtype[Any]]:
    """How one point may lie in a binary block: an uneven abscissa is written in single or in full precision."""
    order = "<" if header.byte_order == 1 else ">"
    value = f"{order}{'c' if header.is_complex else 'f'}{(2 if header.is_complex else 1) * (8 if header.double else 4)}"
    if header.even:
        return [np.dtype([("y", value)])]
    abscissas = ["f8", "f4"] if header.double else ["f4"]
    return [np.dtype([("x", order + abscissa), ("y", value)]) for abscissa in abscissas]


def from_binary(header: Header, data: bytes) -> Function:
    """Values of a binary block of exactly the right length, or of one that is too short.

    Raises
    ------
    ValueError : no layout of the points fits the length.
    """
    for dtype in record_types(header):
        if len(data) == dtype.itemsize * header.points:
            points = np.frombuffer(data, dtype)
            return Function(header, _abscissa(header, points), points["y"])
    dtype = record_types(header)[0]
    # a closing line that is cut itself stands behind the values
    points = np.frombuffer(data, dtype, min(len(data) // dtype.itemsize, header.points))
    return Function(header, _abscissa(header, points), points["y"])


@lru_cache(maxsize=8)
def _even(start: float, step: float, points: int) -> Any:
    """An even abscissa, shared by the functions that lie on it."""
    axis = start + step * np.arange(points)
    axis.flags.writeable = False
    return axis


def _abscissa(header: Header, points: Any) -> Any:
    if header.even:
        return _even(header.start, header.step, len(points))
    return points["x"].astype(np.float64)


def from_text(header: Header, data: bytes) -> Function:
    """Values of a block of text; where lines are lost or doubled, those in front of the place, and a problem.

    Raises
    ------
    ValueError : something in it is no number, or a line is longer than any writer makes it.
    """
    if len(data) > _LONGEST_LINE and data.find(b"\n", 0, _LONGEST_LINE) < 0:
        raise ValueError(f"a line of more than {_LONGEST_LINE} characters")
    if _CONTROL.search(data):
        raise ValueError("a control character among the values")
    fields = widths(header)
    wanted = header.points * per_point(header)
    numbers, problem = _fixed(data, fields, wanted), ""
    if numbers is None:
        numbers, problem = _free(data, fields, wanted)
    count = per_point(header)
    points = numbers[: min(len(numbers) // count, header.points) * count].reshape(-1, count)
    y = np.ascontiguousarray(points[:, -2:]).view(np.complex128)[:, 0] if header.is_complex else points[:, -1]
    x = points[:, 0] if not header.even else _even(header.start, header.step, len(points))
    return Function(header, x, y, problem)


def _free(data: bytes, fields: tuple[int, ...], wanted: int) -> tuple[Any, str]:
    """Numbers of text that does not keep to the columns, up to the first line that is out of step, and why.

    Every line holds as many numbers as the first, the last one the rest; text that mostly keeps to the columns of the
    format has no line of another length.

    Raises
    ------
    ValueError : something in it is no number, or a line is longer than any writer makes it.
    """
    lines = data.rstrip().split(b"\n")
    if max(map(len, lines)) > _LONGEST_LINE:
        raise ValueError(f"a line of more than {_LONGEST_LINE} characters")
    words = [_exponents(line).split() for line in lines]
    each = len(words[0])
    full = sum(fields)
    kept = sum(len(line.rstrip()) == full for line in lines[:-1]) + (len(lines[-1].rstrip()) in np.cumsum(fields))
    fixed = len(lines) > 1 and 2 * kept >= len(lines)
    count = -(-wanted // max(each, 1))
    problem, sound = "", len(lines)
    if not each:
        problem, sound = "a blank line between the values", 0
    for place, line in enumerate(lines[:-1] if each else []):
        if len(words[place]) != each or (fixed and len(line.rstrip()) != full):
            what = "a blank line" if not words[place] else "a line of another length"
            problem, sound = f"{what} between the values", place
            break
    if not problem and len(lines) != count:
        problem = f"{len(lines)} lines of values where its header announces {count}"
        whole = len(lines[-1].rstrip()) == full  # else the last one may be cut inside a number
        sound = 0 if len(lines) > count else len(lines) - (not whole)
    rest = wanted - each * (count - 1)
    if not problem and (len(words[-1]) < rest or any(map(float, words[-1][rest:]))):
        problem, sound = f"{len(words[-1])} values on the last line where its header announces {rest}", len(lines) - 1
    if not problem and fixed and len(lines[-1].rstrip()) not in np.cumsum(fields):
        problem, sound = "a last line of another length", len(lines) - 1
    if not problem and _cut([word for line in words for word in line][:wanted]):
        problem, sound = "the last number is cut short", len(lines) - 1
    if not problem and b"E+" in (text := _exponents(data).replace(b"e", b"E")) and re.search(rb"E\d", text):
        # a writer that puts the sign of positive exponents puts that of all
        sound = next(place for place, line in enumerate(text.rstrip().split(b"\n")) if re.search(rb"E\d", line))
        problem = "an exponent without its sign"
    numbers = [word for line in words[:sound] for word in line]
    try:
        return np.array(numbers, dtype=np.bytes_).astype(np.float64) if numbers else np.zeros(0), problem
    except ValueError:
        return np.array([_number(word) for word in numbers]), problem


def _number(word: bytes) -> float:
    """A number; one with an exponent of three digits may lack its letter, as Fortran writes it.

    Raises
    ------
    ValueError : it is none.
    """
    try:
        return float(re.sub(rb"(?<=\d)([+-]\d{3})$", rb"E\1", word))
    except ValueError:
        raise ValueError(f"{word.decode('latin-1')[:40]!r} is no number") from None


def _cut(words: list[bytes]) -> bool:
    """Whether the last of some numbers has fewer digits behind its point than all others, which have equally many."""
    tails = [len(word) - word.find(b".") if b"." in word else 0 for word in words]
    return len(set(tails[:-1])) == 1 and len(tails) > 3 and tails[0] > 2 and tails[-1] < tails[0]


def _exponents(data: bytes) -> bytes:
    return data.replace(b"D", b"E").replace(b"d", b"e") if b"D" in data or b"d" in data else data


def _fixed(data: bytes, fields: tuple[int, ...], wanted: int) -> Any:
    """Numbers of text in the fixed columns of the format, or ``None`` where the text does not keep to them.

    Fixed columns need no blanks between the numbers and are read without taking the lines apart. Text that holds more
    or fewer numbers than announced does not keep to them either; zeros that fill the last line do no harm.
    """
    end = data.find(b"\n") + 1
    width = sum(fields)
    if end == 0 or len(data[:end].rstrip()) != width:
        return None
    lines = len(data) // end
    block = np.frombuffer(data, np.uint8, lines * end).reshape(lines, end)
    if not (block[:, end - 1] == 10).all() or (block[:, :width] == 10).any():
        return None
    rest = data[lines * end :].rstrip()
    if b"\n" in rest or len(rest) not in (0, *np.cumsum(fields)):
        return None  # numbers end where their field does; a last one that does not is cut
    try:
        if len(set(fields)) == 1:
            whole = np.ascontiguousarray(block[:, :width]).reshape(-1).view(f"S{fields[0]}")
            numbers = _floats(whole)
        else:
            edges = np.cumsum((0, *fields))
            columns = [np.ascontiguousarray(block[:, a:b]).view(f"S{b - a}")[:, 0] for a, b in pairwise(edges)]
            numbers = np.stack([_floats(column) for column in columns], axis=1).reshape(-1)
        tail, start = [], 0
        for field in fields:
            text = rest[start : start + field].strip()
            if not text:
                break
            tail.append(float(_exponents(text)))
            start += field
    except ValueError:
        return None
    numbers = np.concatenate([numbers, tail]) if tail else numbers
    surplus = len(numbers) - wanted
    if not 0 <= surplus < len(fields) or (surplus and numbers[wanted:].any()):
        return None
    return numbers[:wanted]


def _floats(fields: Any) -> Any:
    """Numbers of byte fields; a last line that is padded with blank fields ends the numbers."""
    blank = np.flatnonzero(np.char.strip(fields[-6:]) == b"")
    if len(blank):
        fields = fields[: len(fields) - len(fields[-6:]) + blank[0]]
    try:
        return fields.astype(np.float64)
    except ValueError:
        return np.char.replace(np.char.upper(fields), b"D", b"E").astype(np.float64)


def to_binary(header: Header, x: Any, y: Any) -> bytes:
    """A binary block; an uneven abscissa is written in the precision of the ordinate."""
    points = np.empty(header.points, record_types(header)[0])
    points["y"] = y
    if not header.even:
        points["x"] = x
    return points.tobytes()


def to_text(header: Header, x: Any, y: Any) -> bytes:
    """A block of text in the fixed columns of the format."""
    fields = widths(header)
    columns = [] if header.even else [x]
    columns += [np.real(y), np.imag(y)] if header.is_complex else [y]
    numbers = np.stack(columns, axis=1).reshape(-1).tolist()
    forms = ["%13.5e" if field == 13 else "%20.12e" for field in fields]
    full, rest = divmod(len(numbers), len(fields))
    line = "".join(forms) + "\n"
    text = (line * full) % tuple(numbers[: full * len(fields)])
    if rest:
        text += ("".join(forms[:rest]) + "\n") % tuple(numbers[full * len(fields) :])
    return text.encode("ascii")
