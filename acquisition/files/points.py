"""Coordinates in named arrays become a geometry."""

from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout
from ema.data import Finding, Geometry
from ema.errors import InputError
from ema.units import UNSTATED


def geometry(arrays: Arrays, layout: Layout) -> Contents:
    """Nodes and lines."""
    if layout.coordinates is not None:
        xyz = arrays.numbers(layout.coordinates)
        xyz = xyz.T if xyz.ndim == 2 and xyz.shape[1] != 3 and xyz.shape[0] == 3 else xyz
    else:
        columns = [None if place is None else arrays.vector(place) for place in (layout.x, layout.y, layout.z)]
        length = max(len(column) for column in columns if column is not None)
        xyz = np.stack(
            [np.zeros(length) if c is None else _of_length(c, length, arrays.where) for c in columns], axis=1
        )
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise InputError("coordinates are not of shape (n, 3)", where=arrays.where, got=xyz.shape)
    numbers = np.arange(1, len(xyz) + 1) if layout.node is None else arrays.vector(layout.node)
    keep = np.isfinite(xyz).all(axis=1) & np.isfinite(numbers)
    nodes = numbers[keep].astype(np.int64)
    if len(np.unique(nodes)) < len(nodes):
        raise InputError("a node number occurs twice", where=arrays.where, got=int(_repeated(nodes)))
    stated = [arrays.units[place] for place in (layout.x, layout.y, layout.z) if place and place in arrays.units]
    text = layout.unit or (stated[0] if stated else UNSTATED)
    unit = units.parse(text)
    if unit.stated and unit.quantity != "displacement":
        raise units.UnitError("not a unit of length", where=arrays.where, got=repr(text), expected="m, mm, in ...")
    rows = () if layout.lines is None else arrays.numbers(layout.lines)
    lines = tuple(tuple(int(node) for node in row if node > 0) for row in rows)
    found = Geometry(nodes, unit.to_si(xyz[keep]), lines, name=arrays.where)
    findings: tuple[Finding, ...] = () if unit.stated else (length_unstated(arrays.where),)
    return Contents(geometry=found, findings=findings)


def length_unstated(where: str) -> Finding:
    """The file does not say in which unit its coordinates are."""
    return Finding(
        "warning",
        "unit-unstated",
        where,
        "the unit of the coordinates is not stated; the numbers are taken as they are.",
        advice="Say unit='mm' or the like.",
    )


def _repeated(numbers: Any) -> Any:
    values, counts = np.unique(numbers, return_counts=True)
    return values[counts > 1][0]


def _of_length(column: Any, length: int, where: str) -> Any:
    if len(column) != length:
        raise InputError("the coordinates differ in length", where=where, got=len(column), expected=length)
    return column
