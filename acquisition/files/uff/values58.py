"""The values of data set 58: where they lie, reading and writing them."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from acquisition.files.uff.header58 import Header

_LINES = {
    (2, True): (13,) * 6, (2, False): (13,) * 6, (5, True): (13,) * 6, (5, False): (13,) * 6,
    (4, True): (20,) * 4, (4, False): (13, 20, 13, 20), (6, True): (20,) * 4, (6, False): (13, 20, 20),
}  # fmt: skip
"""Widths of the fields of one line of text, by ordinate type and even spacing."""


@dataclass(frozen=True)
class Function:
    """One function: its header, abscissa (point,) and ordinate (point,) as written in the file."""

    header: Header
    x: Any
    y: Any


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
    points = np.frombuffer(data[: len(data) // dtype.itemsize * dtype.itemsize], dtype)
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
    """Values of a block of text.

    Raises
    ------
    ValueError : something in it is no number.
    """
    numbers = _fixed(data, widths(header))
    if numbers is None:
        numbers = _free(data)
    count = per_point(header)
    points = numbers[: min(len(numbers) // count, header.points) * count].reshape(-1, count)
    y = np.ascontiguousarray(points[:, -2:]).view(np.complex128)[:, 0] if header.is_complex else points[:, -1]
    x = points[:, 0] if not header.even else _even(header.start, header.step, len(points))
    return Function(header, x, y)


def _free(data: bytes) -> Any:
    """Numbers of text that does not keep to the columns."""
    words = _exponents(data).split()
    try:
        return np.array(words, dtype=np.bytes_).astype(np.float64) if words else np.zeros(0)
    except ValueError:
        for word in words:
            try:
                float(word)
            except ValueError:
                raise ValueError(f"{word.decode('latin-1')[:40]!r} is no number") from None
        raise


def _exponents(data: bytes) -> bytes:
    return data.replace(b"D", b"E").replace(b"d", b"e") if b"D" in data or b"d" in data else data


def _fixed(data: bytes, fields: tuple[int, ...]) -> Any:
    """Numbers of text in the fixed columns of the format, or ``None`` where the text does not keep to them.

    Fixed columns need no blanks between the numbers and are read without taking the lines apart.
    """
    end = data.find(b"\n") + 1
    width = sum(fields)
    if end == 0 or len(data[:end].rstrip()) != width:
        return None
    lines = len(data) // end
    block = np.frombuffer(data, np.uint8, lines * end).reshape(lines, end)
    if not (block[:, end - 1] == 10).all():
        return None
    rest = data[lines * end :].rstrip()
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
    return np.concatenate([numbers, tail]) if tail else numbers


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
