"""Elements of CalculiX result files, and the faces that only one of them has."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

_MOST = 8
"""Nodes of the largest face."""


@dataclass(frozen=True)
class Element:
    """How many nodes an element has, and its faces, each a walk along corners and the nodes between them.

    ``solid`` tells whether its faces may lie inside of the mesh; ``stride`` is 2 where there are nodes between corners.
    """

    nodes: int
    faces: tuple[tuple[int, ...], ...]
    solid: bool
    stride: int = 1


def _quadratic(linear: Element, edges: str) -> Element:
    """The element with a node in the middle of every edge; ``edges`` are pairs of corners in their order."""
    corners = linear.nodes
    between = {frozenset(map(int, edge)): corners + place for place, edge in enumerate(edges.split())}
    faces = tuple(
        tuple(node for a, b in zip(face, (*face[1:], face[0])) for node in (a, between[frozenset((a, b))]))
        for face in linear.faces
    )
    return Element(corners + len(between), faces, linear.solid, 2)


_BRICK = Element(8, ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)), solid=True)
_WEDGE = Element(6, ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)), solid=True)
_TETRAHEDRON = Element(4, ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)), solid=True)
_PYRAMID = Element(5, ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)), solid=True)
_TRIANGLE, _QUADRANGLE = Element(3, ((0, 1, 2),), solid=False), Element(4, ((0, 1, 2, 3),), solid=False)
ELEMENTS = {
    1: _BRICK,
    2: _WEDGE,
    3: _TETRAHEDRON,
    4: _quadratic(_BRICK, "01 12 23 30 04 15 26 37 45 56 67 74"),
    5: _quadratic(_WEDGE, "01 12 20 03 14 25 34 45 53"),
    6: _quadratic(_TETRAHEDRON, "01 12 20 03 13 23"),
    7: _TRIANGLE,
    8: _quadratic(_TRIANGLE, "01 12 20"),
    9: _QUADRANGLE,
    10: _quadratic(_QUADRANGLE, "01 12 23 30"),
    11: Element(2, (), solid=False),
    12: Element(3, (), solid=False),
    15: _PYRAMID,
    16: _quadratic(_PYRAMID, "01 12 23 30 04 14 24 34"),
}
"""By the number of the type."""


def outside(cells: dict[int, list[list[int]]]) -> Int[np.ndarray, "face corner"]:
    """Faces of shells, and those of solids that no other solid shares, as nodes filled with -1.

    Parameters
    ----------
    cells : by the number of the type, the nodes of every element.
    """
    shells, solids, keys = ([np.zeros((0, width), np.int64)] for width in (_MOST, _MOST, 4))
    for kind, rows in cells.items():
        element, nodes = ELEMENTS[kind], np.array(rows, np.int64)
        for face in element.faces:
            polygons = np.full((len(nodes), _MOST), -1)
            polygons[:, : len(face)] = nodes[:, face]
            (solids if element.solid else shells).append(polygons)
            if element.solid:
                corners = nodes[:, face[:: element.stride]]
                key = np.full((len(nodes), 4), -1)
                key[:, : corners.shape[1]] = np.sort(corners, axis=1)
                keys.append(key)
    _, first, count = np.unique(np.concatenate(keys), axis=0, return_index=True, return_counts=True)
    return np.concatenate([*shells, np.concatenate(solids)[first[count == 1]]])
