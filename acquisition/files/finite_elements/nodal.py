"""Natural frequencies, shapes at nodes and a mesh become a modal model and a geometry."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.layout import Layout
from acquisition.files.points import length_unstated
from ema.data import Finding, Geometry, ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.units import UNSTATED

_DIRECTIONS = ("+X", "+Y", "+Z")


def contents(parsed: dict[str, Any], layout: Layout, where: str) -> Contents:
    """The modes and the mesh of a file; files of finite element programs state no unit.

    Parameters
    ----------
    parsed : ``nodes`` (n,), ``xyz`` (n, 3), ``faces`` (face, corner) as rows of ``nodes`` filled with -1; and of
        results ``frequencies`` (mode,) in Hz and ``shapes`` (mode, m, 3) in global directions at the nodes ``at`` (m,).

    Raises
    ------
    InputError : a number is not finite, or a node occurs twice.
    """
    nodes, xyz = np.asarray(parsed["nodes"], np.int64), np.asarray(parsed["xyz"], float)
    if not len(nodes):
        raise InputError("the file holds no nodes", where=where, advice="write the mesh into the file as well")
    if not np.all(np.isfinite(xyz)):
        raise InputError(
            "a coordinate is NaN or infinite",
            where=where,
            got=f"node {nodes[_first_bad(xyz)]}",
            advice="correct the mesh and export it again",
        )
    if len(np.unique(nodes)) < len(nodes):
        values, counts = np.unique(nodes, return_counts=True)
        raise InputError(
            "a node number occurs twice",
            where=where,
            got=int(values[counts > 1][0]),
            advice="give each node a number of its own and export the file again",
        )
    unit = units.parse(layout.unit or UNSTATED)
    if unit.stated and unit.quantity != "displacement":
        raise units.UnitError("not a unit of length", where=where, got=repr(layout.unit), expected="m, mm, in ...")
    findings: tuple[Finding, ...] = () if unit.stated else (length_unstated(where),)
    geometry = Geometry(nodes, unit.to_si(xyz), faces=_faces(nodes, parsed["faces"]), name=where)
    if "shapes" not in parsed:
        return Contents(geometry=geometry, findings=findings)
    return Contents(modes=(_model(parsed, where),), geometry=geometry, findings=findings)


def _model(parsed: dict[str, Any], where: str) -> ModalModel:
    """The modes: undamped and, since the units of mass are not stated, unscaled."""
    frequencies, shapes = np.asarray(parsed["frequencies"], float), np.asarray(parsed["shapes"], float)
    if not np.all(np.isfinite(frequencies)) or not np.all(np.isfinite(shapes)):
        raise InputError(
            "a natural frequency or a mode shape is NaN or infinite",
            where=where,
            advice="check the modal analysis and export its results again",
        )
    # A free structure has rigid-body modes, at 0 Hz but for rounding: as modes they have no pole of their own.
    elastic = frequencies > 1e-6 * np.max(frequencies, initial=0.0)
    if not elastic.any():
        raise InputError(
            "the file holds no mode above 0 Hz",
            where=where,
            got=f"{len(frequencies)} modes",
            advice="compute elastic modes as well and export the results again",
        )
    return ModalModel(
        poles_from(frequencies[elastic], np.zeros(int(elastic.sum()))),
        shapes[elastic].reshape(int(elastic.sum()), -1).T.astype(complex),
        tuple(Dof(int(node), direction) for node in parsed["at"] for direction in _DIRECTIONS),
        np.zeros((0, int(elastic.sum())), complex),
        (),
        scaling="unscaled",
        name=where,
    )


def surface(mesh: Any) -> Int[np.ndarray, "face corner"]:
    """Polygons of the surface of a pyvista mesh as rows of its points, filled with -1."""
    outside = mesh.extract_surface(algorithm=None, pass_pointid=True)
    rows = np.asarray(outside["vtkOriginalPointIds"])
    polygons = [rows[face] for face in outside.irregular_faces]
    most = max((len(polygon) for polygon in polygons), default=0)
    filled = np.full((len(polygons), most), -1)
    for row, polygon in enumerate(polygons):
        filled[row, : len(polygon)] = polygon
    return filled


def _faces(nodes: Int[np.ndarray, "n"], faces: Any) -> tuple[tuple[int, ...], ...]:
    return tuple(tuple(int(nodes[row]) for row in face if row >= 0) for face in np.asarray(faces, int))


def _first_bad(xyz: Float[np.ndarray, "n 3"]) -> int:
    return int(np.flatnonzero(~np.isfinite(xyz).all(axis=1))[0])
