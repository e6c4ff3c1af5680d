"""Universal files: functions of data set 58 in text and binary, written from the description of the format."""

import contextlib
import io
import itertools
import random
import re
import struct
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.cases import Case, Reading, Signals, channels, reading
from tests.fuzz.mutations import line_damage, noise

_AXES = ("X", "Y", "Z", "RX", "RY", "RZ")
_DIRECTIONS = {0: "S"} | {
    sign * (at + 1): f"{'+' if sign > 0 else '-'}{_AXES[at]}" for at in range(6) for sign in (1, -1)
}
"""Codes of the format: a scalar, translations along and rotations about the axes, of either sign."""


@dataclass(frozen=True)
class Function:
    """One function: FRF or time record, its DOFs, axis and values."""

    frf: bool
    node: int
    direction: int
    start: float
    step: float
    values: Any
    double: bool
    binary: bool = False
    number: int = 1

    @property
    def name(self) -> str:
        """As the contents call it."""
        response = f"{self.node}:{_DIRECTIONS[self.direction]}"
        return f"{response}/99:+Z" if self.frf else response

    @property
    def signal(self) -> tuple[Any, Any]:
        """Axis and values as the file can hold them."""
        start, step = float(f"{self.start:.5e}"), float(f"{self.step:.5e}")
        raw = self.values if self.double else self.values.astype(np.complex64 if self.frf else np.float32)
        if not self.binary:
            form = "{:.12e}" if self.double else "{:.5e}"
            parts = [np.array([float(form.format(x)) for x in part]) for part in self._parts()]
            raw = parts[0] + 1j * parts[1] if self.frf else parts[0]
        return start + step * np.arange(len(self.values)), raw

    def _parts(self) -> list[Any]:
        return [self.values.real, self.values.imag] if self.frf else [self.values]

    def header(self) -> list[bytes]:
        """Eleven records behind the number of the set (record 6: function, DOFs; 7: data type, points, axis)."""
        kind = {(False, False): 2, (False, True): 4, (True, False): 5, (True, True): 6}[self.frf, self.double]
        six = f"{4 if self.frf else 1:5d}{self.number:10d}{1:5d}{0:10d} {'NONE':>10s}{self.node:10d}{self.direction:4d}"
        six += f" {'NONE':>10s}{99 if self.frf else 0:10d}{3 if self.frf else 0:4d}"
        seven = f"{kind:10d}{len(self.values):10d}{1:10d}{self.start:13.5e}{self.step:13.5e}{0:13.5e}"
        eight = f"{18 if self.frf else 17:10d}{0:5d}{0:5d}{0:5d} {'NONE':>20s} {'Hz' if self.frf else 's':>20s}"
        nine = f"{12:10d}{0:5d}{0:5d}{0:5d} {'NONE':>20s} {'m/s^2':>20s}"
        ten = f"{13 if self.frf else 0:10d}{0:5d}{0:5d}{0:5d} {'NONE':>20s} {'N' if self.frf else 'NONE':>20s}"
        eleven = f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':>20s} {'NONE':>20s}"
        ids = ["a measured function", "NONE", "01-Feb-24 12:00:00", "NONE", "NONE"]
        return [text.encode() for text in (*ids, six, seven, eight, nine, ten, eleven)]

    def lines(self) -> list[bytes]:
        """The values as lines of text."""
        width, per_line, form = (20, 4, "{:20.12e}") if self.double else (13, 6, "{:13.5e}")
        numbers = np.stack(self._parts(), axis=1).reshape(-1)
        text = "".join(form.format(number) for number in numbers)
        row = width * per_line
        return [text[place : place + row].encode() for place in range(0, len(text), row)]

    def block(self) -> bytes:
        """The values as bytes."""
        kind = {(False, False): "<f4", (False, True): "<f8", (True, False): "<c8", (True, True): "<c16"}
        return bytes(self.values.astype(kind[self.frf, self.double]).tobytes())

    def text(self) -> list[bytes]:
        """All lines of the set of text."""
        return [b"    -1", b"    58", *self.header(), *self.lines(), b"    -1"]

    def bytes(self, block: bytes | None = None) -> bytes:
        """The whole set."""
        if not self.binary:
            return b"\n".join(self.text()) + b"\n"
        data = self.block() if block is None else block
        opening = f"    58b{1:6d}{2:6d}{11:12d}{len(self.block()):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
        return b"\n".join([b"    -1", opening.encode(), *self.header()]) + b"\n" + data + b"    -1\n"


def functions(draw: random.Random) -> list[Function]:
    """A few functions of one kind on one axis."""
    rng = np.random.default_rng(draw.randrange(2**32))
    frf, double, binary = draw.random() < 0.5, draw.random() < 0.5, draw.random() < 0.5
    points = draw.randrange(5, 40)
    values = rng.normal(size=(draw.randrange(1, 5), points)) * 10.0 ** rng.integers(-6, 6)
    if frf:
        values = values + 1j * rng.normal(size=values.shape)
    start, step = (draw.choice((0.0, 1.0, 25.0)) if frf else 0.0), draw.choice((0.5, 0.25, 1e-3, 0.0078125))
    nodes = draw.sample(range(1, 90), len(values))
    return [
        Function(frf, node, draw.randrange(-3, 4), start, step, row, double, binary, place + 1)
        for place, (node, row) in enumerate(zip(nodes, values, strict=True))
    ]


def truth(sets: list[Function]) -> Signals:
    """What the functions hold."""
    return {one.name: one.signal for one in sets}


def _between(whole: bytes, sets: list[bytes]) -> bool:
    """Whether a file ends between two of its data sets, but for blanks."""
    ends = [sum(map(len, sets[: count + 1])) for count in range(len(sets))]
    return any(whole.rstrip() == b"".join(sets)[:end].rstrip() for end in ends)


@dataclass
class Uff:
    """The reader of universal files."""

    name: str = "uff"
    suffix: str = ".uff"

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""
        sets = functions(draw)
        kind = draw.choice(("edit", "damage", "damage", "noise"))
        if kind == "edit":
            return self._edit(draw, sets)
        if kind == "noise":
            data, what = noise(draw, b"".join(one.bytes() for one in sets))
            blind = ""
            if sets[0].binary and "lost" in what and "put in" in what:
                blind = "binary values shifted by as many bytes"
            elif any(data.count(sets[0].header()[record]) < len(sets) for record in (7, 8, 9)):
                blind = "a unit that is another one"
            return Case(data, "noise", what, truth(sets), blind)
        return self._binary_damage(draw, sets) if sets[0].binary else self._text_damage(draw, sets)

    def _edit(self, draw: random.Random, sets: list[Function]) -> Case:
        place = draw.randrange(len(sets))
        how = draw.choice(("value", "node", "step", "line ends", "blanks", "order"))
        changed, one = list(sets), sets[place]
        if how == "value":
            values = one.values.copy()
            values[draw.randrange(len(values))] = draw.choice((0.0, -1.0, 1.0, 1e-30, 1.2345678e20))
            changed[place] = replace(one, values=values)
        elif how == "node":
            changed[place] = replace(one, node=draw.randrange(100, 9999))
        elif how == "step":
            step = draw.choice((0.1, 2.0, 1e-4))
            changed = [replace(other, step=step) for other in sets]
        elif how == "order":
            draw.shuffle(changed)
        data = b"".join(other.bytes() for other in changed)
        if how == "line ends" and not one.binary:
            data = data.replace(b"\n", b"\r\n")
        if how == "blanks":
            data += draw.choice((b"\n", b"  \n", b"\r\n\n"))
        return Case(data, "edit", how, truth(changed))

    def _text_damage(self, draw: random.Random, sets: list[Function]) -> Case:
        if draw.random() < 0.15:
            return self._counts(draw, sets)
        parts = [one.text() for one in sets]
        lines = [line for part in parts for line in part]
        owner = [(place, row) for place, part in enumerate(parts) for row in range(len(part))]
        changed, what, place, goal = line_damage(draw, lines, 0, len(lines))
        goal = min(goal, len(owner) - 1)
        number, row = owner[place]
        # records 1 to 5 are free texts, and nothing counts the blanks behind a line
        free = 2 <= row < 7 and what in ("line blanked", "line shortened")
        blind = ""
        inside = 13 <= row < len(parts[number]) - 1
        if (
            what == "line moved"
            and owner[goal][0] == number
            and inside
            and 13 <= owner[goal][1] < len(parts[number]) - 1
        ):
            blind = "values exchanged within a function"
        if what == "line moved" and 2 <= row < 7 and owner[goal][0] == number and 2 <= owner[goal][1] < 7:
            free = True
        what += f", row {row} of set {number}" + (
            f" to row {owner[goal][1]} of set {owner[goal][0]}" if goal != place else ""
        )
        return Case(b"\n".join(changed) + b"\n", "edit" if free else "damage", what, truth(sets), blind)

    def _counts(self, draw: random.Random, sets: list[Function]) -> Case:
        """The number of points in a header is another than there are."""
        place = draw.randrange(len(sets))
        one = sets[place]
        wrong = max(1, len(one.values) + draw.choice((-10, -2, -1, 1, 2, 100, 10**9)))
        right, stated = f"{len(one.values):10d}{1:10d}".encode(), f"{wrong:10d}{1:10d}".encode()
        data = [other.bytes() for other in sets]
        data[place] = data[place].replace(right, stated, 1)
        blind = ""
        numbers = one._parts()[-1]
        if wrong < len(one.values) and not np.any(numbers[wrong:]):
            blind = "zeros behind the announced values"
        return Case(b"".join(data), "damage", f"{len(one.values)} points announced as {wrong}", truth(sets), blind)

    def _binary_damage(self, draw: random.Random, sets: list[Function]) -> Case:
        if draw.random() < 0.15:
            return self._counts(draw, sets)
        place = draw.randrange(len(sets))
        block = sets[place].block()
        how = draw.choice(("lost", "doubled", "cut"))
        at, length = draw.randrange(len(block)), draw.choice((1, 2, 3, 4, 8, 16, 31))
        data = [one.bytes() for one in sets]
        if how == "lost":
            data[place] = sets[place].bytes(block[:at] + block[at + length :])
        elif how == "doubled":
            data[place] = sets[place].bytes(block[:at] + block[at : at + length] + block[at:])
        whole = b"".join(data)
        if how == "cut":
            whole = whole[: draw.randrange(1, len(whole))]
        blind = "whole sets lost at the end" if how == "cut" and _between(whole, data) else ""
        return Case(whole, "damage", f"bytes {how}: {length} at {at} of set {place}", truth(sets), blind)

    def read(self, path: Path) -> Reading:
        """What our reader makes of it."""
        return reading(path, channels)

    def independent(self, path: Path) -> list[Signals]:
        """What pyuff makes of it, and a reader that takes the file apart by columns."""
        return [found for found in (_by_pyuff(path), _by_columns(path)) if found]


def _by_columns(path: Path) -> Signals:
    """Functions in the fixed columns of the format and nothing else; those that do not keep to them are left out."""
    data, found = path.read_bytes(), {}
    for opening in re.finditer(rb"(?:^|\n)[ \t\v\f]{0,5}-1\n {0,9}58([bB]?)[^\n]*\n", data):
        with contextlib.suppress(ValueError, KeyError, IndexError):
            name, signal = _function(data[opening.end() :], bool(opening[1]))
            found[_free(name, found)] = signal
    return found


def _free(name: str, found: Signals) -> str:
    """The name, with a number behind it where it is that of a former function of the file."""
    return next(
        one for one in itertools.chain([name], (f"{name} #{n}" for n in itertools.count(2))) if one not in found
    )


def _function(data: bytes, binary: bool) -> tuple[str, tuple[Any, Any]]:
    *head, rest = data.split(b"\n", 11)
    kind, points = int(head[6][:10]), int(head[6][10:20])
    start, step = (float(_fortran(head[6][at : at + 13])) for at in (30, 43))
    frf, size = kind in (5, 6), {2: 4, 4: 8, 5: 8, 6: 16}[kind]

    def side(at: int) -> str:
        part = head[5][at : at + 11].decode("latin-1").strip()
        name = f"{int(head[5][at + 11 : at + 21])}:{_DIRECTIONS[int(head[5][at + 21 : at + 25])]}"
        return name if part.upper() in ("", "NONE") else f"{part}:{name}"

    if binary:
        values = np.frombuffer(rest[: size * points], f"<{'c' if frf else 'f'}{size}")
    else:
        closing = re.search(rb"^ {0,5}-1 *$", rest, re.MULTILINE)
        if closing is None:
            raise ValueError("no closing line")
        text = rest[: closing.start()]
        if b"\0" in text:
            raise ValueError(text)
        numbers = np.array([float(word) for word in _fortran(text).split()])
        with np.errstate(all="ignore"):
            values = numbers[::2] + 1j * numbers[1::2] if frf else numbers
    if len(values) != points:
        raise ValueError(points)
    name = side(30) + (f"/{side(55)}" if frf else "")
    with np.errstate(all="ignore"):
        # a record begins at its first sample, whatever the time of that
        return name, ((start if frf else 0.0) + step * np.arange(points), values)


def _fortran(text: bytes) -> bytes:
    """Numbers whose exponents Fortran may have written with a D, as Python writes them."""
    return re.sub(rb"(?<=\d)[dD](?=[+-]\d)", b"e", text)


def _by_pyuff(path: Path) -> Signals | None:
    import pyuff

    found: dict[str, tuple[Any, Any]] = {}
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            file = pyuff.UFF(str(path))
            for number, kind in enumerate(file.get_set_types()):
                if int(kind) != 58:
                    continue
                one = file.read_sets(number)
                response = f"{one['rsp_node']}:{_DIRECTIONS[one['rsp_dir']]}"
                frf = one["func_type"] == 4
                parts = [one[f"{side}_ent_name"].strip() for side in ("rsp", "ref")]
                first, second = (f"{part}:" if part not in ("", "NONE") else "" for part in parts)
                response = first + response
                name = f"{response}/{second}{one['ref_node']}:{_DIRECTIONS[one['ref_dir']]}" if frf else response
                found[_free(name, found)] = (np.asarray(one["x"]), np.asarray(one["data"]))
    except (Exception, struct.error):
        return None
    return found
