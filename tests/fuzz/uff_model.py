"""Universal files of geometry and mode shapes: data sets 15 or 2411, 82, 2412 and 55, written from their descriptions."""

import random
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from tests.fuzz.cases import Case, Reading, Signals, reading
from tests.fuzz.mutations import line_damage, noise

_UNITS = ["    -1", "   164", f"{1:10d}{'SI: Meter (newton)':20s}{2:10d}"]
_UNITS += ["".join(f"{one:25.16e}" for one in row) for row in ((1, 1, 1), (273.15,))] + ["    -1"]


@dataclass(frozen=True)
class Model:
    """Nodes with coordinates, trace lines, shells and modes of three values per node."""

    nodes: tuple[int, ...]
    xyz: Any
    lines: tuple[tuple[int, ...], ...]
    shells: tuple[tuple[int, ...], ...]
    poles: Any
    shapes: Any
    old: bool

    def text(self) -> list[bytes]:
        """All lines of the file."""
        sets = [*_UNITS]
        if self.old:
            rows = zip(self.nodes, self.xyz)
            records = [f"{node:10d}{0:10d}{0:10d}{11:10d}" + "".join(f"{x:13.5e}" for x in at) for node, at in rows]
        else:
            records = []
            for node, at in zip(self.nodes, self.xyz):
                records += [f"{node:10d}{1:10d}{0:10d}{11:10d}", "".join(f"{x:25.16e}" for x in at)]
        sets += ["    -1", "    15" if self.old else "  2411", *records, "    -1"]
        for number, cell in enumerate(self.lines):
            about = [f"{number + 1:10d}{len(cell):10d}{0:10d}", f"{'a trace line':<80s}"]
            sets += ["    -1", "    82", *about, "".join(f"{node:10d}" for node in cell), "    -1"]
        records = []
        for number, cell in enumerate(self.shells):
            about = (number + 1, {3: 91, 4: 94}[len(cell)], 1, 1, 7, len(cell))
            records += ["".join(f"{one:10d}" for one in row) for row in (about, cell)]
        sets += ["    -1", "  2412", *records, "    -1"]
        for number, (pole, shape) in enumerate(zip(self.poles, self.shapes)):
            head = ["a mode", "NONE", "NONE", "NONE", "NONE"]
            head += ["".join(f"{one:10d}" for one in row) for row in ((1, 3, 2, 8, 5, 3), (2, 6, 1, number + 1))]
            head += ["".join(f"{x:13.5e}" for x in (pole.real, pole.imag, 0, 1, 0, 1))]
            for node, values in zip(self.nodes, shape):
                row = [part for value in values for part in (value.real, value.imag)]
                head += [f"{node:10d}", "".join(f"{x:13.5e}" for x in row)]
            sets += ["    -1", "    55", *head, "    -1"]
        return [line.encode() for line in sets]

    def signals(self) -> Signals:
        """The content by names, as the texts round it."""
        nodes = zip(self.nodes, self.xyz)
        found = {f"node {node}": _signal([float(f"{x:.5e}") if self.old else x for x in at]) for node, at in nodes}
        found |= {f"line {cell}": _signal(cell) for cell in self.lines}
        found |= {f"face {cell}": _signal(cell) for cell in self.shells}
        for pole, shape in zip(self.poles, self.shapes):
            rounded = complex(float(f"{pole.real:.5e}"), float(f"{pole.imag:.5e}"))
            values = [complex(float(f"{x.real:.5e}"), float(f"{x.imag:.5e}")) for x in shape.ravel()]
            found |= _mode(rounded, self.nodes, np.array(values).reshape(-1, 3), 1j)
        return found


def _signal(values: Any) -> tuple[Any, Any]:
    return np.arange(len(values), dtype=float), np.asarray(values)


def _mode(pole: complex, nodes: Any, shape: Any, modal_a: complex) -> dict[str, tuple[Any, Any]]:
    """A mode by its pole: pole, and squares of its values for unit modal mass, which fix no sign."""
    name = f"mode at {abs(pole.imag):.3g}"
    found = {name: _signal([pole])}
    if not modal_a:
        return found
    scale = 2j * pole.imag / modal_a
    return found | {f"{name}, node {node}": _signal(scale * np.array(row) ** 2) for node, row in zip(nodes, shape)}


def model(draw: random.Random) -> Model:
    """A small model with two modes."""
    rng = np.random.default_rng(draw.randrange(2**32))
    count = draw.randrange(3, 8)
    nodes = tuple(sorted(draw.sample(range(1, 200), count)))
    cells = [tuple(draw.sample(nodes, min(size, count))) for size in (2, 3, 3, 4)]
    poles = np.array([complex(-rng.uniform(1, 9), 100 * (n + 1) + rng.uniform(0, 50)) for n in range(2)])
    shapes = rng.normal(size=(2, count, 3)) + 1j * rng.normal(size=(2, count, 3))
    xyz = np.round(rng.normal(size=(count, 3)), draw.choice((2, 5, 12)))
    return Model(nodes, xyz, (cells[0], cells[1]), tuple(dict.fromkeys(cells[2:])), poles, shapes, draw.random() < 0.5)


def contents_of(contents: Contents) -> Signals:
    """Nodes, lines, faces and modes that were read."""
    found: dict[str, tuple[Any, Any]] = {}
    if contents.geometry is not None:
        there = contents.geometry
        found |= {f"node {node}": _signal(at) for node, at in zip(there.nodes, there.xyz)}
        found |= {f"line {tuple(map(int, cell))}": _signal(cell) for cell in there.lines}
        found |= {f"face {tuple(map(int, cell))}": _signal(cell) for cell in there.faces}
    for modes in contents.modes:
        nodes = list(dict.fromkeys(dof.node for dof in modes.dofs)) if modes.scaling == "unit modal mass" else []
        for pole, shape in zip(modes.poles, modes.shapes.T):
            found |= _mode(pole, nodes, np.reshape(shape, (-1, 3)) if nodes else [], 2j * pole.imag)
    return found


@dataclass
class UffModel:
    """The reader of universal files, on geometry and modes."""

    name: str = "uff-model"
    suffix: str = ".unv"

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""
        made = model(draw)
        lines, truth = made.text(), made.signals()
        kind = draw.choice(("edit", "damage", "damage", "noise"))
        if kind == "edit":
            data = b"\n".join(lines) + b"\n"
            how = draw.choice(("as it is", "line ends", "blanks"))
            data = data.replace(b"\n", b"\r\n") if how == "line ends" else data + b" \n" * (how == "blanks")
            return Case(data, "edit", how, truth)
        if kind == "noise":
            data, what = noise(draw, b"\n".join(lines) + b"\n")
            units = "\n".join(_UNITS).encode()
            return Case(data, "noise", what, truth, "" if data.startswith(units) else "a unit that is another one")
        first = len(_UNITS)
        changed, what, place, goal = line_damage(draw, lines, first, len(lines))
        blind = "records exchanged" if what == "line moved" else ""
        if what == "line lost" and made.old and len(lines[place].split()) == 7:
            blind = "a node lost: data set 15 holds no count"
        if what == "line shortened" and len(lines[place].split()) == 1:
            blind = "digits of a number that stands alone"
        return Case(b"\n".join(changed) + b"\n", "damage", f"{what} {place} to {goal}", truth, blind)

    def read(self, path: Path) -> Reading:
        """What our reader makes of it."""
        return reading(path, contents_of)

    def independent(self, path: Path) -> list[Signals]:
        """The data sets taken apart at blanks."""
        found: dict[str, tuple[Any, Any]] = {}
        text = path.read_bytes().decode("latin-1")
        for number, body in re.findall(
            r"(?:^|\n) {0,5}-1 *\n +(\d+) *\n(.*?)(?=\n {0,5}-1 *(?:\n|$))", text, re.DOTALL
        ):
            with suppress(ValueError, IndexError, KeyError):
                found |= _set(int(number), body.split("\n"))
        return [found]


def _set(number: int, lines: list[str]) -> dict[str, tuple[Any, Any]]:
    # a sign behind a digit begins a number, as in fixed columns without blanks between them; Fortran's exponents are d
    rows = [re.sub(r"(?<=\d)(?=[+-]\d\.)", " ", re.sub(r"(?<=\d)[dD](?=[+-]\d)", "e", line)).split() for line in lines]
    if number == 15:
        return {f"node {int(row[0])}": _signal([float(x) for x in row[4:]]) for row in rows}
    if number == 2411:
        return {f"node {int(a[0])}": _signal([float(x) for x in b]) for a, b in zip(rows[::2], rows[1::2], strict=True)}
    if number == 82:
        cell = tuple(int(x) for row in rows[2:] for x in row)
        return {f"line {cell}": _signal(cell)}
    if number == 2412:
        cells = [tuple(map(int, row)) for row in rows[1::2]]
        return {f"face {cell}": _signal(cell) for cell in cells}
    if number == 55:
        real = [float(x) for x in rows[7]]
        values = np.array([[float(x) for x in row] for row in rows[9::2]])
        nodes = [int(row[0]) for row in rows[8::2]]
        pole, modal_a = complex(real[0], real[1]), complex(real[2], real[3])
        return _mode(pole, nodes, values[:, ::2] + 1j * values[:, 1::2], modal_a)
    return {}
