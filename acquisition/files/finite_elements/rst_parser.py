"""Ansys results by ansys-mapdl-reader, in the process of the parsers.

The library follows pointers and takes counts as they come. Before it draws the mesh, every record that it will use is
found by its pointer, within the file and with one length in front of it and behind it, and what is written twice is
compared.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
from ansys.mapdl import reader
from ansys.mapdl.reader._binary_reader import c_read_record
from ansys.mapdl.reader._rst_keys import geometry_header_keys, result_header_keys, solution_data_header_keys
from ansys.mapdl.reader.common import parse_header
from jaxtyping import Float, Int

from acquisition.files.finite_elements.nodal import surface
from ema.errors import InputError

_MODAL = 2
"""Number of a modal analysis in the header of a result file (ANTYPE)."""
_RESULTS = 12
"""Number of the kind of a file with results."""
_HEADER = 103
"""Word at which the header of the results begins."""
_PACKED, _UNKNOWN = 0x38000000, 0x07000000
"""Bits of a record whose data are packed, and those that have no meaning."""
_WHOLE, _HALF = 0x80000000, 0x40000000
"""Bits of a record of integers, and of one whose numbers have half of the usual bytes."""
_ABSENT = 2.0**100
"""Value of a direction in which a node cannot move."""
_TYPE_NAME = slice(133, 135)
"""Place of the name of an element type, such as SOLID186, in its record; blank in some versions."""
_SET_NUMBERS = slice(4, 7)
"""Place of the numbers of load step, substep and set in the header of a result set."""


class _Damage(Exception):
    """What does not fit: ``args`` are what, got and expected."""


class _Records:
    """Records by the number of the word at which they begin: length, kind, data, length."""

    def __init__(self, path: Path) -> None:
        self.words = np.memmap(path, "<i4", "r", shape=(path.stat().st_size // 4,))
        self.path = path

    def size(self, place: int) -> int:
        """Words of a record with its three of length and kind."""
        if not 0 <= place <= len(self.words) - 3:
            raise _Damage("a pointer leads out of the file", f"word {place}", f"{len(self.words)} words")
        length = int(self.words[place])
        if not 0 <= length <= len(self.words) - place - 3:
            raise _Damage(f"the record at word {place} does not end within the file", length, len(self.words))
        if self.words[place + 2 + length] != length:
            raise _Damage(f"a record has two lengths at word {place}", int(self.words[place + 2 + length]), length)
        return length + 3

    def read(self, place: int, *, integers: bool) -> Any:
        """The numbers of a record."""
        length, kind = self.size(place) - 3, int(self.words[place + 1]) & 0xFFFFFFFF
        if kind & _UNKNOWN or bool(kind & _WHOLE) != integers:
            raise _Damage(f"the record at word {place} is of another kind", hex(kind))
        if kind & _PACKED:
            return np.asarray(c_read_record(str(self.path), place))
        data = self.words[place + 2 : place + 2 + length].tobytes()
        number = {(True, False): "<i4", (True, True): "<i2", (False, False): "<f8", (False, True): "<f4"}
        form = np.dtype(number[integers, bool(kind & _HALF)])
        if len(data) % form.itemsize:
            raise _Damage(f"the record at word {place} ends within a number", length)
        return np.frombuffer(data, form)

    def counted(self, place: int, count: int, what: str, *, integers: bool = True) -> Any:
        """The numbers of a record that has as many as are announced."""
        found = self.read(place, integers=integers)
        if len(found) != count:
            raise _Damage(f"the number of {what} contradicts", len(found), count)
        return found


class _Announced:
    """Headers of a file, and what they announce.

    Raises
    ------
    _Damage : they contradict the file or each other.
    """

    def __init__(self, records: _Records) -> None:
        self.records = records
        if len(records.counted(0, 100, "words of the first record")) and records.words[2] != _RESULTS:
            raise _Damage("the first record is not that of results", int(records.words[2]), _RESULTS)
        self.head = parse_header(records.read(_HEADER, integers=True), result_header_keys)
        self.undrawn = ""  # why the mesh has no faces
        self.kind, self.sectors = int(self.head["kan"]), int(self.head["nSector"])

    def compare(self) -> None:
        """Read the tables.

        Raises
        ------
        _Damage : they contradict the file or each other.
        """
        records, head = self.records, self.head
        geometry = parse_header(records.read(int(head["ptrGEO"]), integers=True), geometry_header_keys)
        for place in (head["ptrCYC"], geometry["ptrCSY"], geometry["ptrCOMP"]):
            records.size(int(place))
        self.count, self.sets = int(head["nnod"]), int(head["nsets"])
        most = int(head["resmax"])
        if not 0 <= self.sets <= most:
            raise _Damage("more sets of results than there may be", self.sets, most)
        self.numbers = records.counted(int(head["ptrNOD"]), self.count, "nodes with results")
        cells = records.counted(int(head["ptrELM"]), int(head["nelm"]), "elements")
        low_high = records.counted(int(head["ptrDSI"]), 2 * most, "pointers to results").view("<u4").astype(np.int64)
        places = low_high[:most] + (low_high[most:] << 32)
        if np.count_nonzero(places) != self.sets or not np.all(places[: self.sets]):
            raise _Damage("the number of sets of results contradicts", np.count_nonzero(places), self.sets)
        self.places = places[: self.sets]
        self.times = records.counted(int(head["ptrTIM"]), most, "frequencies", integers=False)[: self.sets]
        self.steps = records.counted(int(head["ptrLSP"]), 3 * most, "numbers of steps").reshape(-1, 3)[: self.sets]
        if len(np.unique(self.places)) < self.sets:
            raise _Damage("two sets of results at one place")
        for name, ids in (("node", self.numbers), ("element", cells)):
            if np.any(ids < 1) or len(np.unique(ids)) < len(ids):
                raise _Damage(f"the number of a {name} occurs twice or is not above 0")
        self.nodes, self.xyz, angles = self._nodes(int(geometry["ptrLOC"]), int(geometry["nnod"]))
        self.axes = _axes(angles)
        if missing := set(self.numbers.tolist()) - set(self.nodes.tolist()):
            raise _Damage("results at a node without a place", f"node {min(missing)}")
        self._cells(geometry, cells)
        kinds = {tuple(self._directions(records.read(int(place), integers=True))) for place in self.places}
        if len(kinds) > 1 or any(len(one) != int(head["numdof"]) for one in kinds):
            raise _Damage("sets of results have other degrees of freedom than the file", sorted(kinds), head["numdof"])

    def _nodes(self, place: int, count: int) -> tuple[Any, Any, Any]:
        """Numbers, coordinates and angles: one record behind the other of number, three coordinates, three angles."""
        count = max(count, 0)
        words = self.records.words[max(place, 0) : max(place, 0) + 17 * count]
        table = words.reshape(count, 17) if len(words) == 17 * count else words[:0].reshape(0, 17)
        if len(table) and np.all(table[:, [0, 1, 16]] == (14, 0, 14)):
            rows = np.ascontiguousarray(table[:, 2:16]).view("<f8")
        else:
            rows = np.zeros((min(count, len(self.records.words) // 4), 7))
            for row in rows:
                row[:] = self.records.counted(place, 7, "values of a node", integers=False)
                place += self.records.size(place)
        with np.errstate(invalid="ignore"):
            nodes = rows[:, 0].astype(np.int64)
        if len(rows) != count or not np.all(np.isfinite(rows)) or np.any(nodes != rows[:, 0]) or np.any(nodes < 1):
            raise _Damage("a node has no number or no place")
        if len(np.unique(nodes)) < count:
            raise _Damage("the number of a node occurs twice")
        return nodes, rows[:, 1:4], rows[:, 4:]

    def _cells(self, geometry: dict[str, Any], numbers: Int[np.ndarray, "e"]) -> None:
        """Compare the elements with their table, their types and the nodes."""
        types = self._types(int(geometry["ptrETY"]), geometry)
        table = int(geometry["ptrEID"])
        count = int(geometry["nelm"])
        places = self.records.counted(table, 2 * count, "pointers to elements").view("<i8") if count else []
        known, found = {0, *self.nodes.tolist()}, []
        for place in places:
            cell = self.records.read(table + int(place), integers=True)
            if len(cell) < 11 or int(cell[1]) not in types:
                raise _Damage("an element has no type", f"word {table + int(place)}")
            if not known.issuperset(cell[10:].tolist()):
                raise _Damage("an element has nodes that are not in the file", f"element {cell[8]}")
            found.append(int(cell[8]))
            if len(cell) - 10 != types[int(cell[1])] and not self.undrawn:
                self.undrawn = f"element {cell[8]} has {len(cell) - 10} nodes and its type {types[int(cell[1])]}"
        if len(set(found)) < len(found) or not set(numbers.tolist()).issubset(found):
            raise _Damage("the elements are other ones than their table has", len(found), len(numbers))

    def _types(self, table: int, geometry: dict[str, Any]) -> dict[int, int]:
        """How many nodes an element has by the number of its type."""
        places = self.records.read(table, integers=True)
        if geometry["mapFlag"]:
            places = self.records.read(table + self.records.size(table), integers=True)
        elif len(places) < int(geometry["maxety"]):
            raise _Damage("the number of element types contradicts", len(places), int(geometry["maxety"]))
        found: dict[int, int] = {}
        for place in places[places != 0]:
            about = self.records.read(table + int(place), integers=True)
            if len(about) < 94 or int(about[0]) in found:
                raise _Damage("an element type is damaged", f"word {table + int(place)}")
            name = about[_TYPE_NAME].astype(">i4").tobytes()
            if re.fullmatch(rb"[A-Z]+[0-9]+ *", name) and int(re.findall(rb"[0-9]+", name)[0]) != about[1]:
                raise _Damage("an element type has another name than number", int(about[1]), name.decode())
            found[int(about[0])] = int(about[60])
        return found

    def _directions(self, head: Any) -> list[int]:
        """Degrees of freedom in a set of results by their numbers."""
        kinds = [int(kind) for kind in head[20 : 20 + int(head[19])]] if len(head) >= 95 else []
        if not 0 < len(kinds) == int(head[19]) or len(set(kinds)) < len(kinds) or not {1, 2, 3} & set(kinds):
            raise _Damage("a set of results has no displacements", f"degrees of freedom {kinds}")
        return kinds

    def moved(self, index: int) -> tuple[float, Int[np.ndarray, "m"], Float[np.ndarray, "m 3"]]:
        """Frequency, nodes and displacements in global directions of a set of results."""
        place = int(self.places[index])
        head = self.records.read(place, integers=True)
        if not np.array_equal(head[_SET_NUMBERS], self.steps[index]):
            raise _Damage("its numbers contradict the table of steps", head[_SET_NUMBERS].tolist(), self.steps[index])
        if int(head[2]) != self.count:
            raise _Damage("it has other nodes than the file", int(head[2]), self.count)
        if head[18]:
            raise _Damage("it is a part of a complex mode, which is not read")
        about = self.records.read(place + self.records.size(place), integers=False)
        if not len(about) or not np.isclose(about[0], self.times[index], rtol=1e-6, atol=0):
            raise _Damage("its frequency contradicts the table", float(about[0]), float(self.times[index]))
        header, kinds = parse_header(head, solution_data_header_keys), self._directions(head)
        width, start = len(kinds) + int(header["nfldof"]), place + int(header["ptrNSL"])
        values = self.records.read(start, integers=False)
        if width < len(kinds) or len(values) % width or len(values) > width * self.count:
            raise _Damage("the number of its values contradicts", len(values), f"{width} at {self.count} nodes")
        values, nodes = values.reshape(-1, width), self.numbers
        if len(values) < self.count:
            rows = self.records.counted(start + self.records.size(start), len(values), "nodes of a set")
            if np.any(rows < 1) or np.any(rows > self.count) or len(np.unique(rows)) < len(rows):
                raise _Damage("it names nodes that are not in the table")
            nodes = nodes[rows - 1]
        columns = [kinds.index(kind) if kind in kinds else -1 for kind in (1, 2, 3)]
        shape = np.where(np.array(columns) < 0, _ABSENT, values[:, columns])
        if not np.all(np.isfinite(shape)):
            raise _Damage("a displacement is NaN or infinite")
        there = ~np.all(shape == _ABSENT, axis=1)
        local = np.where(shape == _ABSENT, 0.0, shape)[there]
        axes = self.axes[_rows(self.nodes, nodes[there])]
        return float(self.times[index]), nodes[there], np.einsum("nij,nj->ni", axes, local)


def _axes(angles: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Directions of nodes as columns: turned about Z, then the new X, then the new Y, in degrees."""
    (a, b, c), (sa, sb, sc) = np.cos(np.radians(angles)).T, np.sin(np.radians(angles)).T
    rows = [
        [a * c - sa * sb * sc, -sa * b, a * sc + sa * sb * c],
        [sa * c + a * sb * sc, a * b, sa * sc - a * sb * c],
        [-b * sc, sb, b * c],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def modes(path: Path) -> dict[str, Any]:
    """Parse the modes and the mesh of a result file.

    Parameters
    ----------
    path : Path
        Binary result file of Ansys Mechanical APDL.

    Returns
    -------
    dict
        ``analysis``: ``"modes"``, or what the file holds instead, and then nothing else. Of modes: ``nodes`` (n,),
        ``xyz`` (n, 3), ``faces`` (face, corner), ``frequencies`` (mode,) in Hz, ``shapes`` (mode, m, 3) at the nodes
        ``at`` (m,); ``undrawn``: why there are no faces, or an empty text; ``damaged``: for every mode that is left
        out its name, what is wrong, what was got and what was expected.

    Raises
    ------
    InputError
        The mesh or the tables are damaged.
    """
    try:
        announced = _Announced(_Records(path))
        if announced.kind != _MODAL or announced.sectors > 1:
            return {"analysis": f"an analysis of type {announced.kind}, {announced.sectors} sectors"}
        announced.compare()
    except _Damage as damage:
        what, got, expected = _sentence(damage)
        advice = "copy or export the file again"
        raise InputError(what, where=path.name, got=got, expected=expected, advice=advice) from None
    result = reader.read_binary(str(path))
    if type(result).__name__ != "Result":
        return {"analysis": f"a {type(result).__name__}"}
    found, damaged = [], []
    for index in range(announced.sets):
        try:
            found.append(announced.moved(index))
        except _Damage as damage:
            damaged.append([f"mode {index + 1}", *(None if one is None else str(one) for one in _sentence(damage))])
    at = sorted(set(announced.numbers.tolist()).intersection(*(nodes.tolist() for _, nodes, _ in found)))
    return {
        "analysis": "modes",
        "nodes": announced.nodes,
        "xyz": announced.xyz,
        "faces": np.zeros((0, 0), int) if announced.undrawn else _faces(result.grid, announced.nodes),
        "undrawn": announced.undrawn,
        "at": np.array(at, np.int64),
        "frequencies": np.array([frequency for frequency, _, _ in found]),
        "shapes": np.array([shape[_rows(nodes, at)] for _, nodes, shape in found]),
        "damaged": damaged,
    }


def _sentence(damage: _Damage) -> tuple[Any, Any, Any]:
    what, got, expected = (*damage.args, None, None)[:3]
    return what, got, expected


def _rows(nodes: Int[np.ndarray, "n"], some: Any) -> Int[np.ndarray, "*m"]:
    """Places of some of the nodes."""
    order = np.argsort(nodes)
    return order[np.searchsorted(nodes, some, sorter=order)]


def _faces(grid: Any, nodes: Int[np.ndarray, "n"]) -> Int[np.ndarray, "face corner"]:
    rows = surface(grid)
    return np.where(rows < 0, -1, _rows(nodes, np.asarray(grid["ansys_node_num"])[rows]))
