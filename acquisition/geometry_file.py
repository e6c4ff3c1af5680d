"""Geometry of a campaign: from a file, a table with any column names, or nodes written into ``campaign.toml``."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from acquisition import units
from acquisition.campaign_file import GeometryTable
from acquisition.columns import column, numbers, read_columns
from acquisition.files.arrays import UndescribedError
from ema.data import Geometry
from ema.errors import InputError

_TABLES = (".csv", ".txt", ".tsv")
_OF_COLUMNS = {"unit", "node", "x", "y", "z", "names_in"}
"""Keys that say what the columns of a table are; without them its titles do, as in ``x [mm]``."""


def geometry_of(table: GeometryTable | None, folder: Path, data: Path, where: str) -> Geometry | None:
    """The geometry that the campaign describes.

    Parameters
    ----------
    folder, data : of the campaign and of its data files; the file is looked for in both.

    Raises
    ------
    InputError : no such file, no geometry in it, a node twice, or a line or face to a node that is not there.
    """
    if table is None:
        return None
    if table.nodes:
        factor = units.parse(str(table.unit)).factor
        nodes = np.array(list(table.nodes))
        geometry = Geometry(nodes, factor * np.array(list(table.nodes.values()), dtype=np.float64))
    else:
        path = next((base / table.file for base in (folder, data) if (base / table.file).is_file()), None)
        if path is None:
            raise InputError(
                "there is no such geometry file",
                where=where,
                got=table.file,
                expected=f"a file in {folder}" + (f" or {data}" if data != folder else ""),
                advice='correct file = "..." of [geometry]',
            )
        geometry = _read(path, table)
    geometry = replace(
        geometry,
        lines=(*geometry.lines, *(tuple(line) for line in table.lines)),
        faces=(*geometry.faces, *(tuple(face) for face in table.faces)),
    )
    if table.axes:
        axes = np.tile(np.eye(3), (len(geometry.nodes), 1, 1)) if geometry.axes is None else np.array(geometry.axes)
        for node, own in table.axes.items():
            axes[geometry.place(node)] = _orthonormal(np.array(own, dtype=np.float64), f"{where}, axes of node {node}")
        geometry = replace(geometry, axes=axes)
    _check(geometry, where)
    return geometry


def _read(path: Path, table: GeometryTable) -> Geometry:
    is_table = path.suffix.lower() in _TABLES and not table.reader
    if is_table and table.model_fields_set & _OF_COLUMNS:
        return _from_columns(path, table)
    from acquisition.file_cache import Files

    try:
        contents = Files().contents(path, table.reader)
    except UndescribedError:
        if is_table:
            raise _without_unit(path) from None
        raise
    if is_table and any(one.code == "unit-unstated" for one in contents.findings):
        raise _without_unit(path)
    geometry = contents.geometry
    if geometry is None:
        raise InputError(
            "the file holds no geometry",
            where=str(path),
            advice="name another file, or say in [geometry.reader] where in the file the coordinates are",
        )
    return geometry


def _without_unit(path: Path) -> InputError:
    return InputError("the coordinates have no unit", where=str(path), advice='add unit = "m" to [geometry]')


def _from_columns(path: Path, table: GeometryTable) -> Geometry:
    if table.unit is None:
        raise _without_unit(path)
    columns = read_columns(path, table.names_in)
    factor = units.parse(table.unit).factor
    axes = [numbers(column(columns, name, str(path)), f"{path}, {name}") for name in (table.x, table.y, table.z)]
    xyz = factor * np.column_stack(axes)
    if table.node in columns:
        nodes = numbers(columns[table.node], f"{path}, {table.node}")
    else:
        nodes = np.arange(1.0, len(xyz) + 1)  # positions in the order of the points
    kept = np.isfinite(xyz).all(axis=1)
    if (not kept.all() and np.isfinite(xyz[~kept]).any()) or np.isnan(nodes[kept]).any():
        raise InputError(
            "a node with a number or coordinate missing",
            where=str(path),
            got=f"entry {int(np.argmax(np.where(kept, np.isnan(nodes), np.isfinite(xyz).any(axis=1)))) + 1}",
            advice="fill it in, or leave all three coordinates of the node empty",
        )
    return Geometry(nodes[kept].astype(np.int64), xyz[kept])


def _orthonormal(axes: np.ndarray, where: str) -> np.ndarray:
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    if not np.allclose(axes @ axes.T, np.eye(3), atol=1e-3) or np.linalg.det(axes) < 0:
        raise InputError(
            "local axes are not three right-handed directions at right angles",
            where=where,
            got=axes.round(3).tolist(),
            expected="+X, +Y and +Z of the node in global directions, +Z along +X cross +Y",
        )
    left, _, right = np.linalg.svd(axes)
    return np.asarray(left @ right)  # the nearest exact rotation to what was noted with a few digits


def _check(geometry: Geometry, where: str) -> None:
    if len(set(geometry.nodes.tolist())) < len(geometry.nodes):
        nodes = geometry.nodes.tolist()
        raise InputError(
            "a node twice in the geometry",
            where=where,
            got=next(n for n in nodes if nodes.count(n) > 1),
            advice="give each node a number of its own",
        )
    if not np.isfinite(geometry.xyz).all():
        raise InputError(
            "a coordinate of the geometry is no finite number",
            where=where,
            got=f"node {geometry.nodes[~np.isfinite(geometry.xyz).all(axis=1)][0]}",
            advice="correct the coordinate, or leave the node out",
        )
    for kind, groups in (("line", geometry.lines), ("face", geometry.faces)):
        for group in groups:
            absent = [node for node in group if node not in geometry]
            if absent:
                raise InputError(
                    f"a {kind} of the geometry goes to a node that is not there",
                    where=where,
                    got=absent[0],
                    expected=f"one of its {len(geometry.nodes)} nodes",
                    advice=f"add the node, or correct the {kind}",
                )
