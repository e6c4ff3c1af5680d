"""Results of Ansys, written record by record from the description of the file, and a parser of these records."""

import random
import struct
import zlib
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.cases import Case, Reading, Signals, reading
from tests.fuzz.frd import contents_of, named
from tests.fuzz.mutations import damage, noise

_CELLS = {185: (8, 1, 8), 186: (20, 1, 8), 187: (10, 3, 4), 181: (4, 9, 4)}
"""By the number of an element routine: its nodes, the shape that its corners draw (as in CalculiX), and how many they are."""
_SETS = 6
"""Sets of results for which there is room in the tables."""
_ABSENT = 2.0**100
_DISPLACEMENTS = 0x8000200
"""Bits of what is stored: nodal solutions among it."""


@dataclass(frozen=True)
class Model:
    """A mesh and its modes; displacements are written in the directions of each node."""

    nodes: tuple[int, ...]
    xyz: Any
    angles: Any
    cells: tuple[tuple[int, tuple[int, ...]], ...]
    frequencies: tuple[float, ...]
    shapes: Any
    order: tuple[int, ...]
    directions: tuple[int, ...]
    missing: int | None

    def records(self) -> list[tuple[str, bytes]]:
        """Name and bytes of every record in their order."""
        kinds = sorted({kind for kind, _ in self.cells})
        table = _record([0] * len(kinds))
        types = []
        for number, kind in enumerate(kinds, 1):
            about = np.zeros(200, int)
            about[:2], about[60], about[62], about[93] = (
                (number, kind),
                _CELLS[kind][0],
                _CELLS[kind][0],
                _CELLS[kind][2],
            )
            about[133:135] = np.frombuffer(f"{'SHELL' if kind == 181 else 'SOLID'}{kind}".encode(), ">i4")
            types.append(_record(about))
        size = len(table) // 4
        table = _record([size + 203 * place for place in range(len(kinds))])
        places = [_record([node, *at, *turned], "<f8") for node, at, turned in zip(self.nodes, self.xyz, self.angles)]
        cells = [
            _record([1, kinds.index(kind) + 1, 1, 1, 0, 0, 0, 0, number, 0, *nodes])
            for number, (kind, nodes) in enumerate(self.cells, 1)
        ]
        starts = np.cumsum([2 * len(cells) + 3, *(len(cell) // 4 for cell in cells)])[:-1]
        index = _record(np.array(starts, "<i8").view("<i4"))
        sets = [self._set(number) for number in range(len(self.frequencies))]
        found: list[tuple[str, bytes]] = [
            ("standard", b"\0" * 412),
            ("header", b"\0" * 332),
            ("nodes with results", _record(np.array(self.nodes)[list(self.order)])),
            ("elements", _record(range(1, len(self.cells) + 1))),
            ("pointers", _record([0] * 2 * _SETS)),
            ("frequencies", _record([*self.frequencies, *[0.0] * (_SETS - len(sets))], "<f8")),
            (
                "steps",
                _record([one for k in range(_SETS) for one in ((1, k + 1, k + 1) if k < len(sets) else (0,) * 3)]),
            ),
            ("geometry", b"\0" * 332),
            ("table of types", table),
            *(("type", one) for one in types),
            *(("node", one) for one in places),
            ("table of cells", index),
            *(("cell", one) for one in cells),
        ]
        at: dict[str, int] = {}
        word = 0
        for name, data in found:
            at.setdefault(name, word)
            word += len(data) // 4
        pointers = []
        for parts in sets:
            pointers.append(word)
            found += zip(("set", "frequency", "set", "nodes of a set"), parts)
            word += sum(map(len, parts)) // 4
        count = len(self.nodes)
        whole = {"pointers": _record([*pointers, *[0] * (2 * _SETS - len(sets))])}
        standard = np.full(100, int.from_bytes(b"    ", "little"), "<i4")  # texts are blank but for the version
        standard[:9], standard[9] = (12, -1, 131803, 20180321, -1, 0, 0, 0, 0), int.from_bytes(b"15.0", "big")
        standard[25:28], standard[94] = (16384, word, 1), 0
        whole["standard"] = _record(standard)
        head = np.zeros(80, "<i4")
        head[:9] = (
            12,
            max(self.nodes),
            count,
            _SETS,
            len(self.directions),
            len(self.cells),
            len(self.cells),
            2,
            len(sets),
        )
        names = ("pointers", "frequencies", "steps", "elements", "nodes with results", "geometry")
        head[9:16] = word, *(at[name] for name in names)
        head[20], head[35] = 1, _DISPLACEMENTS
        whole["header"] = _record(head)
        geometry = np.zeros(80, "<i4")
        geometry[1], geometry[3:5], geometry[14:20] = len(kinds), (count, len(self.cells)), (0, 0, 24, 20, 200, 0)
        for place, name in ((20, "table of types"), (26, "node"), (28, "table of cells")):
            geometry[place] = at[name]
        whole["geometry"] = _record(geometry)
        return [(name, whole.get(name, data)) for name, data in found]

    def _set(self, number: int) -> list[bytes]:
        values = self.shapes[number][list(self.order)]
        rows = [row for row in range(len(self.nodes)) if row != self.missing]
        head = np.zeros(200, "<i4")
        head[1:3], head[4:7], head[19] = (
            (len(self.cells), len(self.nodes)),
            (1, number + 1, number + 1),
            len(self.directions),
        )
        head[20 : 20 + len(self.directions)] = self.directions
        frequency = _record([self.frequencies[number], *[0.0] * 9], "<f8")
        head[10] = head[104] = 203 + len(frequency) // 4
        parts = [_record(head), frequency, _record(values[rows].ravel(), "<f8")]
        return parts + [_record([row + 1 for row in rows]) for _ in range(self.missing is not None)]

    def signals(self) -> Signals:
        """The content by names."""
        at = [
            node for place, node in enumerate(self.nodes) if self.missing is None or self.order[self.missing] != place
        ]
        modes = []
        for frequency, shape in zip(self.frequencies, self.shapes):
            moved = _turned(shape, self.directions, self.angles)
            modes.append((frequency, at, [moved[self.nodes.index(node)] for node in at]))
        return named(self.nodes, self.xyz, [_drawn(kind, nodes) for kind, nodes in self.cells], modes)


def _drawn(kind: int, nodes: tuple[int, ...]) -> tuple[int, tuple[int, ...]]:
    _, shape, corners = _CELLS[kind]
    return shape, nodes[:corners]


def _turned(shape: Any, directions: tuple[int, ...], angles: Any) -> Any:
    """Displacements in global directions: about local Z, X and Y in turn."""
    found = []
    for row, (z, x, y) in zip(shape, np.radians(angles)):
        local = np.array([row[directions.index(axis)] if axis in directions else 0.0 for axis in (1, 2, 3)])
        local[local == _ABSENT] = 0.0
        about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
        about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
        about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
        found.append(about_z @ about_x @ about_y @ local)
    return found


def _record(numbers: Any, kind: str = "<i4") -> bytes:
    """Length in words, kind, numbers, and the length again."""
    data = np.array(list(numbers), kind).tobytes()
    length = struct.pack("<i", len(data) // 4)
    return length + struct.pack("<I", 0x80000000 if kind == "<i4" else 0) + data + length


def model(draw: random.Random) -> Model:
    """One or two elements without common nodes."""
    rng = np.random.default_rng(draw.randrange(2**32))
    kinds = draw.sample(list(_CELLS), draw.choice((1, 1, 2)))
    count = sum(_CELLS[kind][0] for kind in kinds)
    nodes = sorted(draw.sample(range(1, 300), count))
    free = draw.sample(nodes, count)
    cells, place = [], 0
    for kind in kinds:
        cells.append((kind, tuple(free[place : place + _CELLS[kind][0]])))
        place += _CELLS[kind][0]
    modes = draw.choice((2, 3))
    directions = draw.choice(((1, 2, 3), (1, 2, 3), (1, 2, 3, 4, 5, 6), (2, 3, 1), (1, 2), (8, 1, 2, 3)))
    shapes = rng.normal(size=(modes, count, len(directions)))
    if draw.random() < 0.2:
        shapes[:, draw.randrange(count), draw.randrange(2)] = _ABSENT
    frequencies = np.sort(rng.uniform(10, 500, modes))
    if draw.random() < 0.2:
        frequencies[0] = 0.0
    return Model(
        tuple(nodes),
        rng.normal(size=(count, 3)),
        rng.uniform(-90, 90, (count, 3)) * (rng.random((count, 1)) < 0.2),
        tuple(cells),
        tuple(map(float, frequencies)),
        shapes,
        tuple(draw.sample(range(count), count)),
        directions,
        draw.randrange(count) if draw.random() < 0.2 else None,
    )


@dataclass
class Rst:
    """The reader of Ansys results; half of the files are read with salvage."""

    name: str = "rst"
    suffix: str = ".rst"

    def case(self, draw: random.Random) -> Case:
        """A mutated file."""
        made = model(draw)
        kind = draw.choice(("edit", "records", "integer", "bytes", "noise", "noise"))
        if kind == "edit":
            return _edit(draw, made)
        records, truth = made.records(), made.signals()
        data = b"".join(one for _, one in records)
        if kind == "noise":
            data, what = noise(draw, data)
            return Case(data, "noise", what, truth)
        if kind == "integer":
            return _integer(draw, records, truth)
        if kind == "bytes":
            data, what = damage(draw, data)
            return Case(data, "damage", what, truth, "bytes of numbers moved" if what.startswith("bytes moved") else "")
        how = draw.choice(("lost", "doubled", "moved"))
        place, goal = draw.randrange(len(records)), draw.randrange(len(records))
        name = records[place][0]
        if how == "doubled":
            records.insert(goal, records[place])
        else:
            one = records.pop(place)
            records[goal:goal] = [one] * (how == "moved")
        blind = "results in the place of others of the same length" if name == "set" and how != "lost" else ""
        return Case(
            b"".join(one for _, one in records), "damage", f"record {name} {how} {place} to {goal}", truth, blind
        )

    def read(self, path: Path) -> Reading:
        """What our reader makes of it."""
        return reading(path, contents_of, unit="m", salvage=zlib.crc32(path.read_bytes()) % 2 == 1)

    def independent(self, path: Path) -> list[Signals]:
        """The records by their pointers."""
        with suppress(ValueError, IndexError, KeyError, OverflowError):
            return [_parsed(path.read_bytes())]
        return []


def _edit(draw: random.Random, made: Model) -> Case:
    how = draw.choice(("as it is", "a frequency", "a value", "a longer file"))
    if how == "a frequency":
        made = replace(made, frequencies=(*made.frequencies[:-1], 2 * made.frequencies[-1]))
    if how == "a value":
        shapes = made.shapes.copy()
        shapes[-1, draw.randrange(len(made.nodes)), draw.randrange(len(made.directions))] = draw.choice(
            (0.0, -1.0, 1e12)
        )
        made = replace(made, shapes=shapes)
    data = b"".join(one for _, one in made.records())
    return Case(data + b"\0" * 4096 * (how == "a longer file"), "edit", how, made.signals())


def _integer(draw: random.Random, records: list[tuple[str, bytes]], truth: Signals) -> Case:
    """A count, a pointer, a length or a number is another one."""
    place = draw.randrange(len(records))
    name, data = records[place]
    words = np.frombuffer(data, "<i4").copy()
    integers = words[1] < 0
    used = [at for at in range(len(words)) if (integers and words[at]) or at in (0, 1, len(words) - 1)]
    at = draw.choice(used)
    now = int(words[at])
    words[at] = draw.choice((min(now, 2**31 - 2) + 1, max(now, 1 - 2**31) - 1, 0, -1, 2**31 - 1, draw.randrange(400)))
    records[place] = (name, words.tobytes())
    once = (name == "cell" and at >= 12) or name == "nodes of a set"
    blind = "the number of a node in an element or a set, which stands there once" if once else ""
    return Case(b"".join(one for _, one in records), "damage", f"integer {at} of {name}", truth, blind)


def _parsed(data: bytes) -> Signals:
    """The file by its pointers and counts, without comparing them.

    Raises
    ------
    ValueError, IndexError, KeyError, OverflowError : a record is none.
    """

    def words(at: int, kind: str = "<i4") -> Any:
        length = struct.unpack_from("<i", data, 4 * at)[0] if 0 <= 4 * at <= len(data) - 4 else -1
        if length < 0 or 4 * (at + length + 3) > len(data):
            raise ValueError(at)
        return np.frombuffer(data[4 * at + 8 : 4 * (at + length + 2)], kind)

    head, geometry = words(103), words(int(words(103)[15]))
    count, sets = int(head[2]), int(head[8])
    pointers, times = words(int(head[10])), words(int(head[11]), "<f8")
    table, at = words(int(head[14])), int(geometry[26])
    places = [words(at + 17 * row, "<f8") for row in range(int(geometry[3]))]
    about = {int(place[0]): place for place in places}
    types = {
        int(one[0]): int(one[1]) for one in (words(int(geometry[20]) + int(at)) for at in words(int(geometry[20])))
    }
    index = words(int(geometry[28])).view("<i8")
    cells = [words(int(geometry[28]) + int(index[row])) for row in range(int(geometry[4]))]
    drawn = [_drawn(types[int(cell[1])], tuple(map(int, cell[10:]))) for cell in cells]
    modes = []
    for number in range(sets):
        with suppress(ValueError, IndexError, KeyError):
            start = int(pointers[number])
            top = words(start)
            directions = tuple(map(int, top[20 : 20 + int(top[19])]))
            first = start + int(top[104])
            values = words(first, "<f8").reshape(-1, len(directions))[:count]
            rows = words(first + 2 * values.size + 3) - 1 if len(values) < count else range(count)
            nodes = [int(table[row]) for row in rows]
            moved = dict(zip(nodes, _turned(values, directions, np.array([about[node][4:] for node in nodes]))))
            columns = [directions.index(axis) for axis in (1, 2, 3) if axis in directions]
            there = {node for node, row in zip(nodes, values) if np.any(row[columns] != _ABSENT)}
            modes.append((float(times[number]), moved, there))
    both = sorted(set(about).intersection(*(there for _, _, there in modes)))
    rows = [(frequency, both, [moved[node] for node in both]) for frequency, moved, _ in modes]
    return named(list(about), [place[1:4] for place in about.values()], drawn, rows)
