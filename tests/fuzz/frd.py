"""Results of CalculiX, written from the manual's description of their records, and a parser of fixed columns."""

import random
import zlib
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from tests.fuzz.cases import Case, Reading, Signals, reading
from tests.fuzz.mutations import damage, line_damage, noise

_CUBE = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
_PRISM = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1))
_TET = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
_PYRAMID = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1))
_BOX = ((1, 0, 0, 0), (1, 0, 0, 1), (0, 1, 0, 0), (0, 1, 0, 1), (0, 0, 1, 0), (0, 0, 1, 1))
_ROOF = ((0, 0, 1, 0), (0, 0, 1, 1), (1, 0, 0, 0), (0, 1, 0, 0), (1, 1, 0, 1))
_CORNER = ((0, 0, 1, 0), (1, 0, 0, 0), (0, 1, 0, 0), (1, 1, 1, 1))
_TENT = ((0, 0, 1, 0), (1, 0, 0, 0), (0, 1, 0, 0), (1, 0, 1, 1), (0, 1, 1, 1))
_FLAT = ((0, 0, 1, 0),)
_MIDDLES = {
    4: "01 12 23 30 04 15 26 37 45 56 67 74",
    5: "01 12 20 03 14 25 34 45 53",
    6: "01 12 20 03 13 23",
    8: "01 12 20",
    10: "01 12 23 30",
    16: "01 12 23 30 04 14 24 34",
}
_SHAPES: dict[int, tuple[Any, Any]] = {
    1: (_CUBE, _BOX),
    2: (_PRISM, _ROOF),
    3: (_TET, _CORNER),
    4: (_CUBE, _BOX),
    5: (_PRISM, _ROOF),
    6: (_TET, _CORNER),
    7: (_TET[:3], _FLAT),
    8: (_TET[:3], _FLAT),
    9: (_CUBE[:4], _FLAT),
    10: (_CUBE[:4], _FLAT),
    11: (_TET[:2], ()),
    12: (_TET[:3], ()),
    15: (_PYRAMID, _TENT),
    16: (_PYRAMID, _TENT),
}
"""By the type of an element: its corners, and the planes (a, b, c, d), ax + by + cz = d, in which its faces lie."""


@cache
def _places(kind: int) -> Any:
    corners = np.array(_SHAPES[kind][0], dtype=float)
    middles = [(corners[int(a)] + corners[int(b)]) / 2 for a, b in _MIDDLES.get(kind, "").split()]
    return np.array([*corners, *middles])


def _faces(cells: list[tuple[int, tuple[int, ...]]]) -> set[tuple[int, ...]]:
    """Nodes in each plane of each element, but for planes of solids that two of them have."""
    shells, solids = [], []
    for kind, nodes in cells:
        for *normal, distance in _SHAPES[kind][1]:
            inside = np.abs(_places(kind) @ np.array(normal) - distance) < 1e-9
            goal = shells if _SHAPES[kind][1] is _FLAT else solids
            goal.append(tuple(sorted(np.array(nodes)[inside].tolist())))
    return {*shells, *(face for face in solids if solids.count(face) == 1)}


def _signal(values: Any) -> tuple[Any, Any]:
    return np.arange(len(values), dtype=float), np.asarray(values, dtype=float)


def named(nodes: Any, xyz: Any, cells: Any, modes: list[tuple[float, Any, Any]]) -> Signals:
    """All content by names; a mode is a frequency, nodes and displacements."""
    found = {f"node {int(node)}": _signal(at) for node, at in zip(nodes, xyz)}
    found |= {f"face {face}": _signal(face) for face in _faces(cells)}
    highest = max((frequency for frequency, _, _ in modes), default=0.0)
    for frequency, at, shape in modes:
        if frequency > 1e-6 * highest:
            found |= _mode(frequency, at, shape)
    return found


def _mode(frequency: float, nodes: Any, shape: Any) -> dict[str, tuple[Any, Any]]:
    name = f"mode at {frequency:.11g}"  # more digits than the file has, so that no rounding is a tie
    found = {f"{name}, node {int(node)}": _signal(values) for node, values in zip(nodes, shape)}
    return found | {name: _signal([frequency])}


def contents_of(contents: Contents) -> Signals:
    """Nodes, faces and modes that were read."""
    found: dict[str, tuple[Any, Any]] = {}
    there = contents.geometry
    if there is not None:
        found |= {f"node {node}": _signal(at) for node, at in zip(there.nodes, there.xyz)}
        found |= {f"face {tuple(sorted(map(int, face)))}": _signal(sorted(face)) for face in there.faces}
    salvaged = any(finding.severity == "error" for finding in contents.findings)
    for modes in contents.modes:
        nodes = list(dict.fromkeys(dof.node for dof in modes.dofs))
        assert [str(dof) for dof in modes.dofs] == [f"{node}:+{axis}" for node in nodes for axis in "XYZ"]
        for frequency, shape in zip(modes.natural_frequencies, modes.shapes.T):
            if salvaged and frequency < 1e-4:
                continue  # where nothing else is left, a rigid body's mode is taken for one of its own
            found |= _mode(frequency, nodes, np.real(shape).reshape(-1, 3))
    return found


_HEAD = [
    "    1C",
    f"    1UUSER{'':62s}",
    f"    1UDATE{'':14s}23.november.2026{'':32s}",
    f"    1UPGM{'':15s}CalculiX{'':40s}",
    "    1UMAT    1STEEL",
]


class _Binary(bytes):
    """Data behind which no line ends."""


@dataclass(frozen=True)
class Model:
    """A mesh and its modes; ``form`` is 0 for text with short numbers of nodes, 1 for long ones, 2 or 3 for binary."""

    nodes: tuple[int, ...]
    xyz: Any
    cells: list[tuple[int, tuple[int, ...]]]
    frequencies: tuple[float, ...]
    at: tuple[int, ...]
    shapes: Any
    form: int
    stresses: bool
    static: bool

    def blocks(self) -> list[list[bytes]]:
        """Head, nodes, elements, then each of the results, and the end: lines, or with binary data pieces of bytes."""
        coordinates, elements = (self.form, self.form) if self.form < 2 else (3, 2)
        found = [[line.encode() for line in _HEAD]]
        head = f"    2C{'':18s}{len(self.nodes):12d}{coordinates:38d}".encode()
        found.append([head, *self._rows(self.nodes, self.xyz, coordinates)])
        head = f"    3C{'':18s}{len(self.cells):12d}{elements:38d}".encode()
        found.append([head, *self._cells()])
        count = 0
        for step, (frequency, shape) in enumerate(zip(self.frequencies, self.shapes), 1):
            static = self.static and step == 1
            for name in ("DISP", "STRESS")[: 1 + self.stresses]:
                count += 1
                found.append(self._results(name, count, step, frequency, shape, static))
        found.append([b" 9999"])
        return found

    def _rows(self, nodes: Any, values: Any, form: int) -> list[bytes]:
        if form >= 2:
            kind = "<f4" if form == 2 else "<f8"
            table = zip(nodes, values)
            data = b"".join(np.int32(node).tobytes() + np.asarray(row, kind).tobytes() for node, row in table)
            return [_Binary(data)]
        width = (5, 10)[form]
        numbers = ["".join(f"{x:12.5E}" for x in row) for row in values]
        return [*(f" -1{node:{width}d}{row}".encode() for node, row in zip(nodes, numbers)), b" -3"]

    def _cells(self) -> list[bytes]:
        if self.form >= 2:
            rows = [[number, kind, 0, 1, *nodes] for number, (kind, nodes) in enumerate(self.cells, 1)]
            return [_Binary(np.array([one for row in rows for one in row], "<i4").tobytes())]
        width, most = ((5, 15), (10, 10))[self.form]
        rows = []
        for number, (kind, nodes) in enumerate(self.cells, 1):
            rows.append(f" -1{number:{width}d}{kind:5d}{0:5d}{1:5d}")
            for start in range(0, len(nodes), most):
                rows.append(" -2" + "".join(f"{node:{width}d}" for node in nodes[start : start + most]))
        return [*(row.encode() for row in rows), b" -3"]

    def _results(self, name: str, count: int, step: int, frequency: float, shape: Any, static: bool) -> list[bytes]:
        value = 1.0 if static else frequency
        lines = [f"{'    1PSTEP':24s}{count:12d}{1:12d}{1:12d}{'':10s}"]
        if not static:
            stiffness = (2 * np.pi * frequency) ** 2
            about = (("GM", "1.000000E+00"), ("GK", f"{stiffness:12.6E}"), ("HID", "-1"), ("SUBC", "0"))
            lines += [f"{f'    1P{key}':24s}{text:>12s}{'':34s}" for key, text in (*about, ("MODE", str(step)))]
        kind, what = (0, "") if static else (2, "MODAL")
        lines.append(
            f"  100CL{100 + step:5d}{_value(value)}{len(self.at):12d}{'':20s}{kind:2d}{step:5d}{what:10s}{self.form:2d}"
        )
        if name == "DISP":
            lines.append(" -4  DISP        4    1")
            lines += [f" -5  D{axis}          1    2    {axis}    0" for axis in (1, 2, 3)]
            lines.append(" -5  ALL         1    2    0    0    1ALL")
            values = shape
        else:
            lines.append(" -4  STRESS      6    1")
            lines += [f" -5  S{axes}         1    4    1    1" for axes in ("XX", "YY", "ZZ", "XY", "YZ", "ZX")]
            values = np.concatenate([shape, -shape], axis=1)
        return [*(line.encode() for line in lines), *self._rows(self.at, values, self.form)]

    def signals(self) -> Signals:
        """The content by names, as the file rounds it."""
        exact = self.form >= 2
        xyz = self.xyz if exact else [[float(f"{x:.5E}") for x in row] for row in self.xyz]
        modes = []
        for frequency, shape in list(zip(self.frequencies, self.shapes))[self.static :]:
            rounded = {2: np.float32(shape), 3: shape}.get(self.form)
            if rounded is None:
                rounded = [[float(f"{x:.5E}") for x in row] for row in shape]
            modes.append((float(_value(frequency)), self.at, rounded))
        return named(self.nodes, xyz, self.cells, modes)


def _value(value: float) -> str:
    """Ten digits, or an exponent below 1."""
    return f"{value:12.{9 - int(np.log10(value))}f}" if value >= 1 else f"{value:12.5E}"


def model(draw: random.Random) -> Model:
    """A row of bricks, and elements of other types beside it."""
    rng = np.random.default_rng(draw.randrange(2**32))
    length = draw.choice((0, 1, 1, 2))
    kinds = draw.sample([kind for kind in _SHAPES if kind != 1], draw.choice((0, 1, 1, 2)) + (length == 0))
    needed = 4 * (length + 1) * (length > 0) + sum(len(_places(kind)) for kind in kinds)
    nodes = sorted(draw.sample(range(1, 300), needed))
    free = draw.sample(nodes, needed)
    sections = [tuple(free[4 * k : 4 * k + 4]) for k in range(length + 1)] if length else []
    cells: list[tuple[int, tuple[int, ...]]] = [(1, one + other) for one, other in pairwise(sections)]
    place = 4 * len(sections)
    for kind in kinds:
        cells.append((kind, tuple(free[place : place + len(_places(kind))])))
        place += len(_places(kind))
    at = tuple(nodes if draw.random() < 0.8 else sorted(draw.sample(nodes, needed - 1)))
    count = draw.choice((2, 3))
    frequencies = np.sort(rng.uniform(10, 50, count) * 10.0 ** draw.choice((-1, 0, 1, 2)))
    if draw.random() < 0.2:
        frequencies[0] = 1e-6 * rng.uniform(1, 9)  # a rigid body
    return Model(
        tuple(nodes),
        rng.normal(size=(needed, 3)) * 10.0 ** draw.choice((-2, 0, 3)),
        cells,
        tuple(map(float, frequencies)),
        at,
        rng.normal(size=(count, len(at), 3)) * 10.0 ** draw.choice((-3, 0, 2)),
        draw.choice((1, 1, 1, 0, 2, 3)),
        draw.random() < 0.3,
        draw.random() < 0.2,
    )


@dataclass
class Frd:
    """The reader of CalculiX results; half of the files are read with salvage."""

    name: str = "frd"
    suffix: str = ".frd"

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""
        made = model(draw)
        kind = draw.choice(("edit", "lines", "blocks", "head", "bytes", "noise", "noise"))
        if kind == "edit":
            return self._edit(draw, made)
        blocks, truth = made.blocks(), made.signals()
        if kind == "blocks":
            return _block_damage(draw, blocks, truth)
        if kind == "head":
            return _head_damage(draw, blocks, truth)
        lines = [line for block in blocks for line in block]
        data = _joined(blocks)
        if kind == "noise":
            data, what = noise(draw, data)
            return Case(data, "noise", what, truth)
        if kind == "bytes" or made.form >= 2:
            data, what = damage(draw, data)
            moved = what.startswith("bytes moved")
            return Case(data, "damage", what, truth, "bytes of numbers moved" if moved else "")
        changed, what, place, goal = line_damage(draw, lines, 0, len(lines))
        return Case(b"\n".join(changed) + b"\n", "damage", f"{what} {place} to {goal}", truth)

    def _edit(self, draw: random.Random, made: Model) -> Case:
        how = draw.choice(("as it is", "a frequency", "a value", "line ends", "blanks"))
        if how == "a frequency":
            others = list(made.frequencies)
            others[-1] *= draw.choice((1.5, 2.0))
            made = replace(made, frequencies=tuple(others))
        if how == "a value":
            shapes = made.shapes.copy()
            shapes[-1, draw.randrange(len(made.at)), draw.randrange(3)] = draw.choice((0.0, -1.0, 1e12, 3e-9))
            made = replace(made, shapes=shapes)
        data = _joined(made.blocks())
        if made.form < 2 and how in ("line ends", "blanks"):
            data = data.replace(b"\n", b"\r\n") if how == "line ends" else data + b"  \n\n"
        return Case(data, "edit", how, made.signals())

    def read(self, path: Path) -> Reading:
        """What our reader makes of it."""
        made = reading(path, contents_of, unit="m", salvage=zlib.crc32(path.read_bytes()) % 2 == 1)
        assert "damaged, or not a" not in made.refusal, made.refusal  # an error that nobody foresaw
        return made

    def independent(self, path: Path) -> list[Signals]:
        """The records in their columns."""
        with suppress(ValueError, IndexError, KeyError):
            return [_parsed(path.read_bytes())]
        return []


def _joined(blocks: list[list[bytes]]) -> bytes:
    """Lines end, binary data do not."""
    return b"".join(piece if isinstance(piece, _Binary) else piece + b"\n" for block in blocks for piece in block)


def _block_damage(draw: random.Random, blocks: list[list[bytes]], truth: Signals) -> Case:
    how = draw.choice(("lost", "doubled", "moved", "exchanged rows"))
    place, goal = draw.randrange(1, len(blocks)), draw.randrange(1, len(blocks))
    changed, blind = [list(block) for block in blocks], ""
    if how == "lost":
        del changed[place]
        blind = {2: "the elements lost whole", len(blocks) - 2: "the last results lost whole"}.get(place, "")
    elif how == "doubled":
        changed.insert(goal, blocks[place])
    elif how == "moved":
        changed.insert(goal, changed.pop(place))
    else:
        changed[place][-1], changed[goal][-1] = changed[goal][-1], changed[place][-1]
        blind = "binary data of two results exchanged" if isinstance(blocks[place][-1], _Binary) else ""
    return Case(_joined(changed), "damage", f"block {place} {how} {goal}", truth, blind)


def _head_damage(draw: random.Random, blocks: list[list[bytes]], truth: Signals) -> Case:
    """A digit in the head of a block is another one, or one row of numbers is a column further on."""
    changed = [list(block) for block in blocks]
    block = draw.randrange(1, len(blocks) - 1)
    heads = [place for place, line in enumerate(changed[block]) if line[:4] in (b"    ", b"  10", b" -4 ", b" -5 ")]
    rows = [place for place, line in enumerate(changed[block]) if line[:3] in (b" -1", b" -2")]
    if rows and draw.random() < 0.4:
        place = draw.choice(rows)
        at, line = draw.randrange(3, len(changed[block][place])), changed[block][place]
        line = line[:at] + b" " + line[at:-1] if draw.random() < 0.5 else line[:at] + line[at + 1 :] + b" "
        what = "a column shifted"
    else:
        place = draw.choice(heads)
        line = changed[block][place]
        at = draw.choice([at for at, byte in enumerate(line) if chr(byte).isdigit()])
        line = line[:at] + str((int(line[at : at + 1]) + draw.randrange(1, 10)) % 10).encode() + line[at + 1 :]
        what = "a digit of a head"
    before, changed[block][place] = changed[block][place], line
    near = line[:7] == b"  100CL" and 12 <= at < 24 and np.isclose(float(before[12:24]), float(line[12:24]), 1e-6, 0)
    blind = "the last digits of a frequency, behind those of its stiffness" if near else ""
    if what == "a column shifted" and line[:3] == b" -2" and len(before[at:].split()) == 1:
        blind = "the last number of an element's nodes without its last digit"
    return Case(_joined(changed), "damage", f"{what}: block {block} line {place} byte {at}", truth, blind)


def _parsed(data: bytes) -> Signals:
    """The file by the columns of its records, without any comparison of what they announce; a damaged block is left out."""
    lines = _Lines(data)
    nodes: dict[int, Any] = {}
    cells: list[tuple[int, tuple[int, ...]]] = []
    modes: list[tuple[float, Any, Any]] = []
    modal = False
    while b"\n" in data[(at := lines.place) :] and (line := lines.next()) != " 9999":
        try:
            if line[:6] == "    2C":
                nodes = dict(lines.rows(int(line[24:36]), int(line[73]), 3))
            elif line[:6] == "    3C":
                cells = lines.cells(int(line[24:36]), int(line[73]))
            elif line[:6] == "  100C":
                modal, displaced = False, modal
                modes += lines.results(line, displaced)
            elif line[:5] != "    1":
                raise ValueError(line)
            modal |= line.startswith("    1PMODE")
        except (ValueError, IndexError, KeyError):
            later = [place for key in (b"\n    1PSTEP", b"\n 9999") if (place := data.find(key, at)) >= 0]
            modal, lines.place = False, min(later, default=len(data) - 1) + 1
    return named(list(nodes), list(nodes.values()), cells, modes)


@dataclass
class _Lines:
    data: bytes
    place: int = 0

    def next(self) -> str:
        """The next line.

        Raises
        ------
        ValueError : there is none.
        """
        end = self.data.index(b"\n", self.place)
        line = self.data[self.place : end].decode("latin-1").rstrip("\r ")
        self.place = end + 1
        return line

    def _take(self, kind: str, count: int) -> list[Any]:
        size = np.dtype(kind).itemsize * count
        values = np.frombuffer(self.data[self.place : self.place + size], kind)
        self.place += size
        if len(values) != count:
            raise ValueError(kind)
        return values.tolist()

    def results(self, line: str, modal: bool) -> list[tuple[float, Any, Any]]:
        """The mode behind the head of results, if it is one."""
        field = self.next()
        components = [self.next() for _ in range(int(field[13:18]))]
        width = sum(component[33:38] != "    1" for component in components)
        displaced = modal and field[5:13].rstrip() == "DISP"
        table = self.rows(int(line[24:36]), int(line[73:75]), width, keep=displaced)
        rows = [node for node, _ in table], [row for _, row in table]
        return [(float(line[12:24]), *rows)] if displaced else []

    def rows(self, count: int, form: int, width: int, *, keep: bool = True) -> list[tuple[int, list[float]]]:
        """Numbers and values of nodes; of a table that is not kept its end alone."""
        if form >= 2:
            return [(self._take("<i4", 1)[0], self._take(("<f4", "<f8")[form - 2], width)) for _ in range(count)]
        digits, found = (5, 10)[form], []
        while (line := self.next()) != " -3":
            if not keep:
                continue
            if line[:3] != " -1":
                raise ValueError(line)
            columns = range(3 + digits, 3 + digits + 12 * width, 12)
            found.append((int(line[3 : 3 + digits]), [float(line[at : at + 12]) for at in columns]))
        return found

    def cells(self, count: int, form: int) -> list[tuple[int, tuple[int, ...]]]:
        """Types and nodes of elements."""
        found = []
        if form >= 2:
            for _ in range(count):
                kind = self._take("<i4", 4)[1]
                found.append((kind, tuple(self._take("<i4", len(_places(kind))))))
            return found
        digits = (5, 10)[form]
        while (line := self.next()) != " -3":
            kind = int(line[3 + digits : 8 + digits])
            nodes: list[int] = []
            while len(nodes) < len(_places(kind)):
                row = self.next()
                nodes += [int(row[at : at + digits]) for at in range(3, len(row), digits)]
            found.append((kind, tuple(nodes)))
        return found
