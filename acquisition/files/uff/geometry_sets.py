"""Nodes (15, 2411), coordinate systems (18, 2420), trace lines (82) and elements (2412) become a geometry."""

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from acquisition import units
from acquisition.files.polar import unit_overruled
from acquisition.files.uff import records
from acquisition.files.uff.header58 import integer, text_of
from acquisition.files.uff.unit_system import UnitSystem
from ema.data import Finding, Geometry

_BEAMS = frozenset({11, 21, 22, 23, 24})
"""Elements whose nodes stand in a third record."""
_SOLIDS: dict[int, tuple[tuple[int, ...], ...]] = {
    111: ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    118: ((0, 2, 4), (0, 2, 9), (2, 4, 9), (0, 4, 9)),
    112: ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    115: ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    116: ((0, 2, 4, 6), (12, 14, 16, 18), (0, 2, 14, 12), (2, 4, 16, 14), (4, 6, 18, 16), (6, 0, 12, 18)),
}
"""Corner faces of solid elements: tetrahedra, wedge and bricks, linear and parabolic."""


@dataclass(frozen=True)
class System:
    """A coordinate system: type (0 Cartesian, 1 cylindrical), axes as rows in global coordinates, origin."""

    kind: int
    axes: Any
    origin: Any

    def to_global(self, local: Any) -> Any:
        """Global coordinates of a point given in this system."""
        if self.kind == 1:
            radius, angle = local[0], np.radians(local[1])
            local = np.array([radius * np.cos(angle), radius * np.sin(angle), local[2]])
        return self.origin + local @ self.axes

    def directions(self, point: Any) -> Any:
        """Local axes at a point, as rows in global coordinates."""
        if self.kind == 0:
            return self.axes
        x, y, _ = self.axes @ (point - self.origin)
        radius = np.hypot(x, y)
        if radius == 0:
            return self.axes
        turn = np.array([[x, y, 0], [-y, x, 0], [0, 0, radius]]) / radius
        return turn @ self.axes


@dataclass
class Parts:
    """Geometry data sets of a file, gathered before they are put together."""

    nodes: dict[int, tuple[int, int, Any]] = field(default_factory=dict)
    """Node: definition system (0 where the coordinates are global), displacement system, coordinates."""
    systems: dict[int, System] = field(default_factory=dict)
    lines: list[tuple[int, ...]] = field(default_factory=list)
    faces: list[tuple[int, ...]] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    units: UnitSystem = UnitSystem()


def nodes15(parts: Parts, lines: list[bytes]) -> None:
    """Nodes with coordinates in their definition system."""
    rows, nodes, there = [], dict[int, tuple[int, int, Any]](), records.inside(lines)
    if len(there) < len(lines):
        message = f"{len(lines) - len(there)} blank records behind its nodes, whose number it does not state."
        advice = "Make sure that no node is missing."
        parts.findings.append(Finding("warning", "blank-record", "data set 15", message, advice=advice))
    for line in there:
        row = records.words(line)
        if len(row) < 7:  # numbers that touch: fixed columns
            text = text_of(line)
            columns = ((0, 10), (10, 20), (20, 30), (30, 40), (40, 53), (53, 66), (66, 79))
            row = [text[start:end].strip() for start, end in columns]
        rows.append(row[4:7])
        _add(nodes, int(row[0]), int(row[1]), int(row[2]), row[4:])
    records.whole(rows)
    parts.nodes |= nodes


def nodes2411(parts: Parts, lines: list[bytes]) -> None:
    """Nodes with coordinates in the part's system."""
    there = records.inside(lines)
    rows, nodes = [], dict[int, tuple[int, int, Any]]()
    for first, second in zip(there[::2], there[1::2], strict=True):
        label, _, displacement, *_ = records.integers(first)
        rows.append(records.words(second))
        _add(nodes, label, 0, displacement, rows[-1])
    records.whole(rows)
    parts.nodes |= nodes


def _add(nodes: dict[int, tuple[int, int, Any]], label: int, definition: int, displacement: int, xyz: Any) -> None:
    """A node of a data set, which holds it once.

    Raises
    ------
    ValueError : it is there already, or has not three coordinates.
    """
    if label in nodes:
        raise ValueError(f"node {label} stands there twice")
    if len(xyz) != 3:
        raise ValueError(f"node {label} has {len(xyz)} coordinates")
    nodes[label] = (definition, displacement, np.array([records.real(word) for word in xyz]))


def systems18(parts: Parts, lines: list[bytes]) -> None:
    """Coordinate systems by origin, a point on +x and a point on the xz plane, in a reference system."""
    lines = _in_groups(lines, 0, 4)
    for place in range(0, len(lines), 4):
        label, kind, reference = records.integers(lines[place])[:3]
        text = "".join(text_of(line).ljust(78)[:78] for line in lines[place + 2 : place + 4])
        values = [float(text[a : a + 13].replace("D", "E")) for a in range(0, 117, 13)]
        origin, on_x, on_xz = np.array(values).reshape(3, 3)
        base = parts.systems.get(reference, System(0, np.eye(3), np.zeros(3)))
        origin, on_x, on_xz = (base.to_global(point) for point in (origin, on_x, on_xz))
        x = _unit(on_x - origin)
        z = _unit((on_xz - origin) - ((on_xz - origin) @ x) * x)
        parts.systems[label] = System(kind, np.stack([x, np.cross(z, x), z]), origin)


def _unit(vector: Any) -> Any:
    length = np.linalg.norm(vector)
    if not length > 0:
        raise ValueError("a coordinate system without an axis")
    return vector / length


def systems2420(parts: Parts, lines: list[bytes]) -> None:
    """Coordinate systems by a 4 x 3 matrix: three axes as rows and the origin."""
    lines = _in_groups(lines, 2, 6)
    systems = {}
    for place in range(2, len(lines), 6):
        label, kind = records.integers(lines[place])[:2]
        rows = [records.words(line) for line in lines[place + 2 : place + 6]]
        records.whole(rows)
        matrix = np.array([[records.real(word) for word in row] for row in rows])
        if matrix.shape != (4, 3):
            raise ValueError(f"coordinate system {label} is no matrix of 4 by 3")
        systems[label] = System(kind, matrix[:3], matrix[3])
    parts.systems |= systems


def _in_groups(lines: list[bytes], head: int, count: int) -> list[bytes]:
    """Lines that come in groups behind a head, without blank ones behind them; a name within a group may be blank.

    Raises
    ------
    ValueError : a group is not complete.
    """
    kept = list(lines)
    while (len(kept) - head) % count and kept and not kept[-1].strip():
        kept.pop()
    if (len(kept) - head) % count:
        raise ValueError(f"{len(kept) - head} lines where each system has {count}")
    return kept


def lines82(parts: Parts, lines: list[bytes]) -> None:
    """A trace line: nodes to draw to; 0 lifts the pen."""
    head = records.integers(lines[0])
    count = head[1] if len(head) > 1 else 0
    nodes = [int(float(word)) for line in lines[2:] for word in _columns(line)]
    if count and (len(nodes) < count or any(nodes[count:])):
        raise ValueError(f"{len(nodes)} nodes of {count} announced")
    if _in_columns(lines[0]) and not all(map(_in_columns, lines[2:])):
        raise ValueError("nodes that do not end where their columns do, as the numbers of the header do")
    run: list[int] = []
    for node in [*nodes[: count or None], 0]:
        if node:
            run.append(node)
        else:
            if len(run) > 1:
                parts.lines.append(tuple(run))
            run = []


def _in_columns(line: bytes) -> bool:
    """Whether all numbers of a line end where columns of ten do."""
    return all(found.end() % 10 == 0 for found in re.finditer(rb"\S+", line))


def _columns(line: bytes) -> list[str]:
    """Integers of a line: by blanks, or by columns of ten where they touch."""
    words = records.words(line)
    if any(len(word) > 10 for word in words):
        words = [text_of(line)[a : a + 10] for a in range(0, len(line.rstrip()), 10)]
    return words


def elements2412(parts: Parts, lines: list[bytes]) -> None:
    """Elements: two nodes are a line, shells are faces, of solids the outer faces are kept."""
    faces: Counter[frozenset[int]] = Counter()
    shapes: dict[frozenset[int], tuple[int, ...]] = {}
    traces: list[tuple[int, ...]] = []
    shells: list[tuple[int, ...]] = []
    lines, place = records.inside(lines), 0
    while place < len(lines):
        label, descriptor, *_, count = records.integers(lines[place])[:6]
        place += 2 if descriptor in _BEAMS else 1
        nodes: list[int] = []
        # some systems write 0 and then the nodes
        while place < len(lines) and len(nodes) < max(count, 1):
            nodes += [int(word) for word in _columns(lines[place])]
            place += 1
        if count and len(nodes) != count:
            raise ValueError(f"element {label} has {len(nodes)} of {count} nodes")
        if descriptor in _SOLIDS and len(nodes) > max(max(face) for face in _SOLIDS[descriptor]):
            for corners in _SOLIDS[descriptor]:
                face = tuple(nodes[corner] for corner in corners)
                faces[frozenset(face)] += 1
                shapes[frozenset(face)] = face
        elif len(nodes) == 2:
            traces.append((nodes[0], nodes[1]))
        elif len(nodes) > 2:
            shells.append(tuple(nodes))
    parts.lines += traces
    parts.faces += shells
    parts.faces += [shapes[key] for key, times in faces.items() if times == 1]


def assemble(parts: Parts, where: str, length_unit: float | None = None) -> Geometry | None:
    """The geometry, in m where the unit of length is stated; what it lacks is added to the findings of ``parts``.

    Parameters
    ----------
    parts : nodes, coordinate systems, lines and units that were gathered from the data sets.
    where : name of the file, for findings.
    length_unit : unit of length in m that overrules that of the file.

    Returns
    -------
    None where the file has no nodes.
    """
    if not parts.nodes:
        return None
    lost = {cs for d, a, _ in parts.nodes.values() for cs in (d, a)} - parts.systems.keys() - {0}
    spherical = {label for label, system in parts.systems.items() if system.kind == 2}
    lost |= spherical & {cs for d, a, _ in parts.nodes.values() for cs in (d, a)}
    if lost:
        _warn(
            parts,
            where,
            "coordinate-system",
            f"coordinate systems {_some(lost)} are missing or spherical; global axes are taken.",
        )
    factor = length_unit if length_unit is not None else parts.units.to_si((1, 0, 0))
    if length_unit is not None and parts.units.stated:
        there = units.named("displacement", parts.units.to_si((1, 0, 0)))
        if not units.same_factor(there.factor, length_unit):
            taken = units.named("displacement", length_unit)
            parts.findings.append(unit_overruled(where, "coordinates", there.text, taken.text))
    if length_unit is None and not parts.units.stated:
        _warn(
            parts,
            where,
            "unit-unstated",
            "no data set 164: the unit of length is not stated; the numbers are taken as they are.",
        )
    usable = {label: system for label, system in parts.systems.items() if system.kind in (0, 1)}
    numbers = list(parts.nodes)
    xyz, axes = [], []
    for definition, displacement, local in parts.nodes.values():
        point = usable[definition].to_global(local) if definition in usable else local
        xyz.append(point)
        axes.append(usable[displacement].directions(point) if displacement in usable else np.eye(3))
    turned = not np.allclose(axes, np.eye(3), atol=1e-12)
    lines = _existing(parts, parts.lines, where, "lines")
    faces = _existing(parts, parts.faces, where, "faces")
    if not np.isfinite(xyz).all():
        _warn(parts, where, "not-finite", "some coordinates are NaN or infinite.")
    return Geometry(
        np.array(numbers),
        factor * np.array(xyz, dtype=float),
        lines,
        faces,
        np.array(axes) if turned else None,
        name=where,
    )


def _existing(parts: Parts, cells: list[tuple[int, ...]], where: str, what: str) -> tuple[tuple[int, ...], ...]:
    kept = tuple(dict.fromkeys(cell for cell in cells if all(node in parts.nodes for node in cell)))
    lost = sum(1 for cell in cells if not all(node in parts.nodes for node in cell))
    if lost:
        _warn(
            parts, where, "unknown-node", f"{lost} {what} left out because they name nodes that the file does not hold."
        )
    return kept


def _warn(parts: Parts, where: str, code: str, message: str) -> None:
    parts.findings.append(Finding("warning", code, where, message))


def _some(labels: set[int]) -> str:
    shown = sorted(labels)
    return ", ".join(map(str, shown[:5])) + (" ..." if len(shown) > 5 else "")


def write_geometry(geometry: Geometry) -> bytes:
    """Data sets 2420 (where axes are turned), 2411 and 82 of a geometry; faces become 2412."""
    blocks = []
    labels = np.zeros(len(geometry.nodes), dtype=int)
    if geometry.axes is not None:
        lines = [f"{1:10d}", f"{'part':<40}"]
        distinct: dict[bytes, int] = {}
        for place, axes in enumerate(np.asarray(geometry.axes)):
            label = distinct.setdefault(axes.tobytes(), len(distinct) + 1)
            labels[place] = label
            if label == len(distinct) and not any(labels[:place] == label):
                lines += [f"{label:10d}{0:10d}{8:10d}", f"CS{label}", *(_row(row) for row in (*axes, np.zeros(3)))]
        blocks.append((2420, lines))
    lines = []
    for node, xyz, label in zip(geometry.nodes, geometry.xyz, labels, strict=True):
        lines += [f"{int(node):10d}{0:10d}{int(label):10d}{11:10d}", _row(xyz)]
    blocks.append((2411, lines))
    for number, cell in enumerate(geometry.lines):
        for start in range(0, max(len(cell) - 1, 1), 249):  # a trace line holds 250 nodes at most
            run = cell[start : start + 250]
            blocks.append((82, [f"{number + 1:10d}{len(run):10d}{0:10d}", f"{'trace line':<80}", *_rows(run)]))
    if geometry.faces:
        shells = {3: 91, 4: 94}
        lines = []
        for number, face in enumerate(geometry.faces):
            lines += [
                f"{number + 1:10d}{shells.get(len(face), 94):10d}{1:10d}{1:10d}{7:10d}{len(face):10d}",
                *_rows(face),
            ]
        blocks.append((2412, lines))
    return b"".join(block(number, lines) for number, lines in blocks)


def block(number: int, lines: list[str]) -> bytes:
    """A data set of text lines with its number and delimiters."""
    return "".join(line + "\n" for line in (f"{-1:6d}", f"{number:6d}", *lines, f"{-1:6d}")).encode(
        "latin-1", "replace"
    )


def _row(values: Any) -> str:
    return "".join(f"{value:25.16e}" for value in values)


def _rows(nodes: tuple[int, ...]) -> list[str]:
    return ["".join(f"{node:10d}" for node in nodes[a : a + 8]) for a in range(0, len(nodes), 8)]


__all__ = ["Parts", "assemble", "block", "integer", "write_geometry"]
