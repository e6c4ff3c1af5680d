"""Coordinates in named arrays become a geometry."""

from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout
from acquisition.files.polar import unit_overruled
from ema.data import Finding, Geometry
from ema.errors import InputError
from ema.units import UNSTATED


def geometry(arrays: Arrays, layout: Layout) -> Contents:
    """Nodes and lines, in m where the unit of length is stated.

    Parameters
    ----------
    arrays : arrays or columns of the file.
    layout : ``coordinates``, or ``x``, ``y``, ``z`` (a missing one is 0); ``node``, ``lines`` and ``unit``.

    Returns
    -------
    The geometry; nodes whose number or coordinates are NaN or infinite are left out, with a finding.

    Raises
    ------
    InputError : coordinates that are not (n, 3), or a node number that occurs twice.
    """
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
        raise InputError(
            "coordinates are not of shape (n, 3)",
            where=arrays.where,
            got=xyz.shape,
            advice="name an array with columns x, y and z, or say x='...', y='...' and z='...'",
        )
    numbers = np.arange(1, len(xyz) + 1) if layout.node is None else arrays.vector(layout.node)
    keep = np.isfinite(xyz).all(axis=1) & np.isfinite(numbers)
    nodes = _whole_numbers(numbers[keep], arrays.where)
    if len(np.unique(nodes)) < len(nodes):
        raise InputError(
            "a node number occurs twice",
            where=arrays.where,
            got=int(_repeated(nodes)),
            advice="give each node a number of its own",
        )
    factors, stated = _lengths(arrays, layout)
    findings = () if stated else (length_unstated(arrays.where),)
    findings = (*findings, *_overruled(arrays, layout))
    if not keep.all():
        lost = int(np.count_nonzero(~keep))
        message = (
            f"{lost} of {len(keep)} nodes have a number or coordinates that are NaN or infinite; they are left out."
        )
        findings = (*findings, Finding("error", "not-finite", arrays.where, message, float(lost), 0.0))
    lines, unknown = _lines(arrays, layout, {int(node) for node in nodes})
    found = Geometry(nodes, xyz[keep] * factors, lines, name=arrays.where)
    return Contents(geometry=found, findings=(*findings, *unknown))


def _whole_numbers(numbers: Any, where: str) -> Any:
    """Node numbers as integers.

    Raises
    ------
    InputError : one of them is no whole number.
    """
    numbers = np.asarray(numbers)
    odd = numbers[numbers != np.round(numbers)]
    if len(odd):
        raise InputError("a node number is no whole number", where=where, got=f"{odd[0]:g}", expected="1, 2, 3 ...")
    return numbers.astype(np.int64)


def _lengths(arrays: Arrays, layout: Layout) -> tuple[Any, bool]:
    """Factors to m of x, y and z, and whether their unit is stated; one that states none has that of the others.

    Raises
    ------
    UnitError : no unit of length, or one axis states none beside two that differ.
    """
    places = (layout.coordinates,) * 3 if layout.coordinates else (layout.x, layout.y, layout.z)
    texts = [layout.unit or arrays.units.get(place) for place in places if place]
    named = list(dict.fromkeys(text for text in texts if text))
    if len(named) > 1 and None in texts:
        raise units.UnitError(
            "one coordinate states no unit, and the others differ",
            where=arrays.where,
            got=", ".join(named),
            advice="say unit='mm' or the like",
        )
    texts = [layout.unit or arrays.units.get(place or "") for place in places]
    lengths = [units.parse(text or (named[0] if named else UNSTATED)) for text in texts]
    for unit in lengths:
        if unit.stated and unit.quantity != "displacement":
            text = repr(unit.text)
            raise units.UnitError("not a unit of length", where=arrays.where, got=text, expected="m, mm, in ...")
    return np.array([unit.factor for unit in lengths]), lengths[0].stated


def _overruled(arrays: Arrays, layout: Layout) -> tuple[Finding, ...]:
    """A finding where the layout states another unit of length than the file."""
    if layout.unit is None:
        return ()
    places = (layout.coordinates,) if layout.coordinates else (layout.x, layout.y, layout.z)
    texts = dict.fromkeys(arrays.units[place] for place in places if place and place in arrays.units)
    factor = units.parse(layout.unit).factor
    return tuple(
        unit_overruled(arrays.where, "coordinates", text, layout.unit)
        for text in texts
        if (there := units.known(text)) is not None and there.stated and there.factor != factor
    )


def _lines(arrays: Arrays, layout: Layout, nodes: set[int]) -> tuple[tuple[tuple[int, ...], ...], tuple[Finding, ...]]:
    """Lines between nodes, a row filled up with zeros; those with nodes that are not there are left out and named.

    Raises
    ------
    InputError : a line of less than two nodes, as where they are counted from 0.
    """
    if layout.lines is None:
        return (), ()
    rows = np.atleast_2d(arrays.numbers(layout.lines))
    lines = [tuple(int(node) for node in _whole_numbers(row[row > 0], arrays.where)) for row in rows]
    short = next((number for number, line in enumerate(lines) if len(line) < 2), None)
    if short is not None:
        raise InputError(
            "a line of less than two nodes",
            where=f"{arrays.where}, {layout.lines} row {short}",
            got=rows[short],
            expected="node numbers; 0 only fills a row",
            advice="count nodes from 1, or say node='...'",
        )
    kept = tuple(line for line in lines if nodes.issuperset(line))
    if len(kept) == len(lines):
        return kept, ()
    message = f"{len(lines) - len(kept)} lines left out because they name nodes that the file does not hold."
    return kept, (Finding("warning", "unknown-node", arrays.where, message),)


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
