"""Result files of CalculiX (.frd): the modes of a frequency analysis and their mesh.

Records of fixed columns as the manual of CalculiX GraphiX describes them, in text or with binary blocks. Every count,
length and number that the file announces is compared with what it delivers.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from acquisition.contents import Contents
from acquisition.files.finite_elements.elements import ELEMENTS, outside
from acquisition.files.finite_elements.nodal import contents
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from ema.data import Finding
from ema.errors import InputError

_MESH = re.compile(r"    ([23])C {18}([ \d]{11}\d) {37}([0-3])", re.ASCII)
"""Head of the nodes or elements: how many, and how they are written."""
_RESULT = re.compile(r"  100CL([ \d]{4}\d)(.{12})([ \d]{11}\d).{20}([ \d]\d)([ \d]{4}\d)(.{10})( [0-3])", re.ASCII)
"""Head of results: 100 and the number of the step, frequency, how many nodes, kind of analysis, number of the step,
name of the kind, and how they are written."""
_FIELD = re.compile(r" -4  (.{8})([ \d]{4}\d)[ \d]{4}\d", re.ASCII)
_DISPLACEMENT = re.compile(r" -5  D([1-6])          1    2    ([1-6])    0(?:    0)?")
_COMPUTED = "    1"
"""What marks a component that is not written, in its columns."""
_TEXT = {0: 5, 1: 10}
"""Columns of the number of a node or element by the way of writing; the others are binary."""
_BINARY = {2: "<f4", 3: "<f8"}
_DIGIT, _SIGN, _LEAD = (np.isin(np.arange(256), list(codes)) for codes in (b"0123456789", b"+-", b" -"))
_POINT, _EXPONENT = (np.isin(np.arange(256), list(codes)) for codes in (b".", b"E"))
_NUMBER = [_LEAD, _DIGIT, _POINT, *[_DIGIT] * 5, _EXPONENT, _SIGN, _DIGIT, _DIGIT]
"""Bytes that may stand in the twelve columns of a number (E12.5)."""
_MODAL = "2", "MODAL"
"""Kind of a frequency analysis, and its name."""


class _Damage(Exception):
    """What does not fit in a block: ``args`` are what, got and expected."""


@dataclass
class _Parser:
    """A place in the bytes of a file, and what was read before it."""

    data: bytes
    place: int = 0

    def line(self) -> str:
        """The next line without blanks at its end."""
        end = self.data.find(b"\n", self.place)
        end = len(self.data) if end < 0 else end
        text = self.data[self.place : end].decode("latin-1")
        self.place = min(end + 1, len(self.data))
        return text[:-1].rstrip(" ") if text.endswith("\r") else text.rstrip(" ")

    def number(self, place: int) -> int:
        """The number of the line that begins at a place."""
        return self.data.count(b"\n", 0, place) + 1

    def nodal(self, count: int, form: int, width: int = 3) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n w"]]:
        """Numbers and values of nodes up to the end of their block."""
        if form in _BINARY:
            layout = np.dtype([("node", "<i4"), ("values", _BINARY[form], width)])
            raw = self.data[self.place : self.place + count * layout.itemsize]
            if len(raw) < count * layout.itemsize:
                raise _Damage("the file ends within binary data", len(raw) // layout.itemsize, count)
            self.place += len(raw)
            table = np.frombuffer(raw, layout)
            with np.errstate(invalid="ignore"):  # signalling NaNs are refused with all that is not finite
                nodes, values = table["node"].astype(np.int64), table["values"].astype(float)
        else:
            nodes, values = self._text(count, _TEXT[form], width)
            if (end := self.line()) != " -3":
                raise _Damage(f"no end behind {count} nodes", repr(end[:20]), "' -3'")
        if np.any(nodes < 1) or len(np.unique(nodes)) < count:
            raise _Damage("a node number occurs twice or is not above 0")
        return nodes, values

    def _text(self, count: int, digits: int, width: int) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n w"]]:
        end = self.data.find(b"\n", self.place)
        ends = b"\r\n" if self.data[end - 1 : end] == b"\r" else b"\n"
        last = 3 + digits + 12 * width
        length = last + len(ends)
        fits = min(count, (len(self.data) - self.place) // length)
        rows = np.frombuffer(self.data, np.uint8, fits * length, self.place).reshape(fits, length)
        right = np.all(rows[:, :3] == np.frombuffer(b" -1", np.uint8), axis=1) & _is_count(rows[:, 3 : 3 + digits])
        for column, allowed in enumerate(_NUMBER * width, 3 + digits):
            right &= allowed[rows[:, column]]
        right &= np.all(rows[:, last:] == np.frombuffer(ends, np.uint8), axis=1)
        if fits < count or not np.all(right):
            row = fits if np.all(right) else int(np.argmin(right))
            self.place += row * length
            line = self.number(self.place)
            raise _Damage(f"line {line} is none of a node", repr(self.line()[:60]), f"node {row + 1} of {count}")
        self.place += count * length
        nodes = rows[:, 3 : 3 + digits].copy().view(f"S{digits}")[:, 0].astype(np.int64)
        return nodes, rows[:, 3 + digits : last].copy().view("S12").astype(float)

    def skip(self, count: int, form: int, width: int) -> None:
        """Pass values of nodes that are no displacements."""
        if form in _BINARY:
            self.place += count * (4 + width * np.dtype(_BINARY[form]).itemsize)
            if self.place > len(self.data):
                raise _Damage("the file ends within binary data")
            return
        end = self.data.find(b"\n -3", self.place - 1)
        lines = self.data[self.place - 1 : max(end, self.place - 1)]
        first = lines.count(b"\n -1")
        if end < 0 or first != count or lines.count(b"\n") != first + lines.count(b"\n -2"):
            raise _Damage("values of nodes are missing", f"{first} nodes", count)
        self.place = end + 1
        self.line()

    def elements(self, count: int, form: int) -> dict[int, list[list[int]]]:
        """Nodes of the elements by type; a layer of a composite is an element that CalculiX does not count."""
        found: dict[int, list[list[int]]] = {}
        numbers = set()
        materials = [int(number) for number in re.findall(rb"^    1UMAT( *\d+)", self.data[: self.place], re.MULTILINE)]
        for number, kind, material, nodes in (
            self._binary_elements(count) if form in _BINARY else self._text_elements(form)
        ):
            if materials and material > max(materials):
                raise _Damage("an element has a material that is not in the file", material, f"up to {max(materials)}")
            found.setdefault(kind, []).append(nodes)
            numbers.add(number)
        total = sum(map(len, found.values()))
        if len(numbers) < total or min(numbers, default=1) < 1:
            raise _Damage("an element number occurs twice or is not above 0")
        if total < count:
            raise _Damage("elements are missing", total, count)
        return found

    def _binary_elements(self, count: int) -> Iterator[tuple[int, int, int, list[int]]]:
        for _ in range(count):
            number, kind, _, material = self._integers(4)
            if kind not in ELEMENTS:
                raise _Damage("binary data hold no element", f"type {kind}")
            yield number, kind, material, self._integers(ELEMENTS[kind].nodes)

    def _integers(self, count: int) -> list[int]:
        if len(self.data) < self.place + 4 * count:
            raise _Damage("the file ends within binary data")
        self.place += 4 * count
        return np.frombuffer(self.data, "<i4", count, self.place - 4 * count).tolist()

    def _text_elements(self, form: int) -> Iterator[tuple[int, int, int, list[int]]]:
        digits = _TEXT[form]
        head = re.compile(rf" -1([ \d]{{{digits - 1}}}\d)([ \d]{{4}}\d)[ \d]{{4}}\d([ \d]{{4}}\d)")
        while (line := self.line()) != " -3":
            match = head.fullmatch(line)
            kind = _integer(match[2]) if match else 0
            if match is None or kind not in ELEMENTS:
                raise _Damage(f"line {self.number(self.place) - 1} is none of an element", repr(line[:60]))
            nodes: list[int] = []
            while len(nodes) < ELEMENTS[kind].nodes:
                row = self.line()
                most = min({5: 15, 10: 10}[digits], ELEMENTS[kind].nodes - len(nodes))
                if row[:3] != " -2" or len(row) != 3 + digits * most:
                    raise _Damage(f"line {self.number(self.place) - 1} is none of an element's nodes", repr(row[:60]))
                nodes += [_integer(row[at : at + digits]) for at in range(3, len(row), digits)]
            yield _integer(match[1]), kind, _integer(match[3]), nodes


def _is_count(columns: UInt8[np.ndarray, "n w"]) -> Any:
    """Whether the bytes are blanks, then digits."""
    digits = _DIGIT[columns]
    blank_first = np.all(digits[:, 1:] >= digits[:, :-1], axis=1)
    return np.all(digits | (columns == ord(" ")), axis=1) & blank_first & digits[:, -1]


def _integer(text: str) -> int:
    if not re.fullmatch(r" *[0-9]+", text):
        raise _Damage("no whole number in its columns", repr(text))
    return int(text)


def _real(text: str) -> float:
    if not re.fullmatch(r" *-?\d*\.?\d+\.?(?:E[+-]\d\d)?", text, re.ASCII):
        raise _Damage("no number in its columns", repr(text))
    return float(text)


class _Announced(dict[str, str]):
    """Values of the records of parameters by name, which tell of the results behind them."""

    def take(self, line: str) -> None:
        """Read a record."""
        name = line[6:24].rstrip(" ")
        if not re.fullmatch(r"[ -~]+", line) or name in self:
            raise _Damage("a record of parameters is damaged or stands twice", repr(line[:60]))
        self[name] = line[24:36]


@dataclass(frozen=True)
class _Mode:
    """Number of its step, frequency, and displacements by node in the order of their numbers."""

    step: int
    frequency: float
    nodes: Int[np.ndarray, "n"]
    shape: Float[np.ndarray, "n 3"]


class _Reader:
    """Blocks one after the other; damage is an error, or with salvage a finding."""

    def __init__(self, data: bytes, layout: Layout, where: str) -> None:
        self.layout, self.where, self.findings = layout, where, list[Finding]()
        self.parser, self.announced = _Parser(data), _Announced()
        self.nodes: Any = None  # numbers, once they were read
        self.xyz = np.zeros((0, 3))
        self.cells: dict[int, list[list[int]]] | None = None
        self.modes: list[_Mode] = []
        self.others = False  # results of another analysis
        self.any_mode = re.search(rb"^    1PMODE", data, re.MULTILINE) is not None
        self.before: int | None = 0  # number of the results before

    def run(self) -> None:
        """Read all blocks.

        Raises
        ------
        InputError : damage that may not or cannot be salvaged.
        """
        parser, whole = self.parser, False
        while not whole and parser.place < len(parser.data):
            start, line = parser.place, parser.line()
            try:
                whole = self._block(line)
            except _Damage as damage:
                self._damaged(damage, line, parser.number(start))
        if not whole:
            self._differs("the file ends too early", ("no record 9999 at its end", "one"), "what is complete is read")
        elif parser.data[parser.place :].strip():
            self._differs("the file goes on behind its last record", (), "what stands before it is read")

    def _differs(self, what: str, numbers: tuple[Any, ...], recovered: str, where: str = "") -> None:
        got, expected = (*numbers, None, None)[:2]
        self.findings += differs(
            what, where=where or self.where, layout=self.layout, got=got, expected=expected, recovered=recovered
        )

    def _damaged(self, damage: _Damage, line: str, number: int) -> None:
        """Go on behind a damaged block."""
        what, *numbers = damage.args
        recovered = ""
        if not line.startswith("    2C") and self.nodes is not None:
            recovered = "the mesh has no faces" if line.startswith("    3C") else "the results there are left out"
        self._differs(what, tuple(numbers), recovered, f"{self.where}: line {number}")
        data, self.announced, self.before = self.parser.data, _Announced(), None
        goal = re.compile(rb"^(?:    1PSTEP| 9999)", re.MULTILINE).search(data, max(self.parser.place - 1, 0))
        self.parser.place = goal.start() if goal else len(data)

    def _block(self, line: str) -> bool:
        """Read what begins with a line; whether it was the last one of the file."""
        if line == " 9999":
            return True
        if line.startswith("    1P"):
            self.announced.take(line)
        elif mesh := _MESH.fullmatch(line):
            self._mesh(int(mesh[1]), _integer(mesh[2]), int(mesh[3]))
        elif result := _RESULT.fullmatch(line):
            self._result(result)
        elif re.match(r"    1[CU]", line) is None:
            raise _Damage("a record that begins no block", repr(line[:60]))
        return False

    def _mesh(self, key: int, count: int, form: int) -> None:
        if (self.nodes if key == 2 else self.cells) is not None:
            raise _Damage("a second block of nodes" if key == 2 else "a second block of elements")
        if key == 2:
            self.nodes, self.xyz = self.parser.nodal(count, form)
        elif self.nodes is None:
            raise _Damage("elements in front of the nodes")
        else:
            cells = self.parser.elements(count, form)
            used = np.unique([node for rows in cells.values() for row in rows for node in row])
            unknown = np.setdiff1d(used, self.nodes)
            if len(unknown):
                raise _Damage("an element has a node that is not in the file", int(unknown[0]))
            self.cells = cells

    def _result(self, head: re.Match[str]) -> None:
        announced, self.announced = self.announced, _Announced()
        count, step, form = _integer(head[3]), _integer(head[5]), int(head[7])
        if "STEP" not in announced or _integer(head[1]) != 100 + step:
            raise _Damage("the number of a step is missing or contradicts", f"{announced}, {head[1]}, {step}")
        number = _integer(announced["STEP"])
        if self.before is not None and number not in (self.before + 1, 1):
            raise _Damage("results are missing or stand twice", f"number {number}", self.before + 1)
        self.before = number
        kind = head[4].strip() == _MODAL[0], head[6].strip() == _MODAL[1]
        if kind[0] != kind[1] or (kind[0] and "MODE" not in announced and self.any_mode):
            raise _Damage("the kind of an analysis contradicts", f"{head[4]}{head[6]}, {announced}")
        name, width = self._field(all(kind))
        if name != "DISP" or not all(kind) or "MODE" not in announced:
            self.others |= name == "DISP"
            self.parser.skip(count, form, width)
            return
        frequency = _real(head[2])
        if "GK" in announced and _real(announced["GK"]) >= 0 and not _agree(head[2], announced["GK"]):
            raise _Damage("a frequency contradicts the stiffness of its mode", head[2].strip(), announced["GK"])
        nodes, values = self.parser.nodal(count, form, width)
        order = np.argsort(nodes)
        mode = _Mode(step, frequency, nodes[order], values[order, :3])
        if self.nodes is None or len(np.setdiff1d(nodes, self.nodes)):
            raise _Damage("results at a node that the file does not have")
        if self.modes and not np.array_equal(self.modes[0].nodes, mode.nodes):
            raise _Damage("two modes are known at different nodes", len(nodes), len(self.modes[0].nodes))
        if any(other.step == step for other in self.modes):
            raise _Damage("two displacements of one mode, as real and imaginary part of a sector", f"step {step}")
        self.modes.append(mode)

    def _field(self, modal: bool) -> tuple[str, int]:
        """Name of what follows, and how many components are written; of modes those of displacements have one name."""
        line = self.parser.line()
        field = _FIELD.fullmatch(line)
        if field is None:
            raise _Damage("no record -4 behind the head of results", repr(line[:60]))
        name, lines = field[1].rstrip(), [self.parser.line() for _ in range(_integer(field[2]))]
        for place, line in enumerate(lines):
            component = _DISPLACEMENT.fullmatch(line)
            wrong = component is None or not component[1] == component[2] == str(place + 1)
            magnitude = place == 3 and line == " -5  ALL         1    2    0    0    1ALL"
            if not line.startswith(" -5") or (name == "DISP" and wrong and not magnitude):
                raise _Damage("a record -5 of a component is damaged", repr(line[:60]))
            if modal and name != "DISP" and not wrong:
                raise _Damage("displacements of a mode by another name", repr(name), "DISP")
        return name, sum(line[33:38] != _COMPUTED for line in lines)


def _agree(frequency: str, stiffness: str) -> bool:
    """Whether the stiffness per unit of mass is (2 pi f)^2, to the digits of both texts."""
    f, k = float(frequency), float(stiffness)
    return abs((2 * np.pi * f) ** 2 - k) <= _unit(stiffness) + 8 * np.pi**2 * abs(f) * _unit(frequency)


def _unit(text: str) -> float:
    """One in the last digit of a number."""
    mantissa, _, exponent = text.strip().partition("E")
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))


def read(path: Path, layout: Layout) -> Contents:
    """Read all modes above 0 Hz.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        ``unit``: length unit of the coordinates, which the format does not state; ``salvage``: leave damaged steps out.

    Returns
    -------
    Contents
        One modal model with its mesh, and findings for everything that was left out.

    Raises
    ------
    InputError
        The file is damaged, or holds no modes.
    UnitError
        ``unit`` is no unit of length.
    """
    reader = _Reader(path.read_bytes(), layout, path.name)
    reader.run()
    if not reader.modes and reader.others:
        raise InputError(
            "the results are no modes",
            where=path.name,
            got="no step of a frequency analysis",
            expected="*FREQUENCY with *NODE FILE and U",
        )
    nodes = np.zeros(0, np.int64) if reader.nodes is None else reader.nodes
    faces, order = outside(reader.cells or {}), np.argsort(nodes)
    rows = np.where(faces < 0, -1, order[np.searchsorted(nodes, faces, sorter=order).clip(max=max(len(nodes) - 1, 0))])
    parsed = {"nodes": nodes, "xyz": reader.xyz, "faces": rows}
    parsed["frequencies"] = np.array([mode.frequency for mode in reader.modes])
    parsed["shapes"] = np.array([mode.shape for mode in reader.modes])
    parsed["at"] = reader.modes[0].nodes if reader.modes else nodes
    found = contents(parsed, layout, path.name)
    return replace(found, findings=(*reader.findings, *found.findings))
