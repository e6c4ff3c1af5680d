"""A plate of a model file as if it had been measured: its bare modes, its points, and the question its file asks."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import acquisition
from acquisition import model_file
from ema.data import Geometry, Matrices, ModalModel, poles_from
from ema.data.comparison import Verdict
from ema.dof import Dof
from ema.errors import InputError
from ema.place.recipe import PlaceRecipe
from ema.store.reading import containers

MODES = 16
"""Elastic modes of the bare structure that are kept."""


def bare_of_model(path: Path) -> tuple[ModalModel, Geometry]:
    """Elastic modes of the plate of a model file without its beam, and the places of its nodes.

    Raises
    ------
    InputError : the structure is no plate, whose points are known.
    """
    file, model = model_file.load(path), acquisition.open_model(path)
    x, y = _plate(file, path)
    assert isinstance(model.host, Matrices)
    from scipy.linalg import eigh

    squares, vectors = eigh(model.host.stiffness, model.host.mass)
    kept = _elastic(squares)[:MODES]
    rows = [row for row, dof in enumerate(model.host.dofs) if dof.direction == "+Z"]
    dofs = tuple(Dof(model.host.dofs[row].node, "+Z") for row in rows)
    shapes = vectors[rows][:, kept].astype(complex)
    poles = poles_from(np.sqrt(squares[kept]) / (2 * np.pi), np.full(len(kept), model.damping.ratio or 1e-4))
    bare = ModalModel(
        poles, shapes, dofs, shapes / (2j * poles.imag), dofs, scaling="unit modal mass", name=file.model.name
    )
    nodes = np.arange(len(x))
    return bare, Geometry(nodes, np.stack([x, y, np.zeros(len(x))], axis=1))


def _elastic(squares: np.ndarray) -> np.ndarray:
    """Rows of the modes above the widest gap: the rigid-body modes lie decades below the others."""
    positive = np.maximum(squares, 1e-12 * squares[-1])
    gaps = np.log(positive[1:8] / positive[:7])
    first = int(np.argmax(gaps)) + 1 if gaps.max() > np.log(1e3) else 0
    return np.arange(first, len(squares))


def _plate(file: model_file.ModelFile, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of the nodes of the plate, node i * (ny + 1) + j at (x_i, y_j)."""
    structure = file.structure
    if structure.kind != "plate" or structure.length is None or structure.width is None:
        raise InputError(
            "no points are known of this structure",
            where=str(path),
            got=f"a {structure.kind}",
            expected="a plate",
            advice="give a campaign or a file with modes and geometry",
        )
    assert isinstance(structure.elements, list)
    parts = np.meshgrid(
        np.linspace(0, structure.length, structure.elements[0] + 1),
        np.linspace(0, structure.width, structure.elements[1] + 1),
        indexing="ij",
    )
    return parts[0].ravel(), parts[1].ravel()


def verdict_of(recipe: PlaceRecipe, origin: Path) -> Verdict | None:
    """The verdict of the comparison that a recipe names, relative to the folder ``origin``.

    Raises
    ------
    InputError : the file cannot be read, or holds no verdict.
    """
    if not recipe.agreement:
        return None
    path = origin / recipe.agreement
    results = containers(path)
    for result in results:
        verdict = result if isinstance(result, Verdict) else getattr(result, "verdict", None)
        if isinstance(verdict, Verdict):
            return verdict
    raise InputError(
        "the file holds no verdict",
        where=str(path),
        got=", ".join(type(result).__name__ for result in results) or "nothing",
        expected="a comparison of the joint model with a measurement",
    )


def recipe_of_model(path: Path) -> PlaceRecipe:
    """The placement that a model file itself asks for: its beam and law, the forces and the band of its ``[map]``.

    Raises
    ------
    InputError : it has no map, no uniform beam, or its joints are not alike.
    """
    where = model_file.locate(path)
    file = model_file.load(where)
    x, y = _plate(file, where)
    beam, map_table, joint = file.beam, file.map, file.joints[0]
    if beam is None or beam.length is None or beam.width is None or beam.height is None or map_table is None:
        raise InputError(
            "the model says too little for a placement",
            where=str(where),
            expected="a uniform [beam] and a [map] with force levels, normal forces and a band",
            advice="add them, or give a recipe with --recipe",
        )
    nodes = [(one.pairs[0] if one.pairs else [(one.host_nodes or [0])[0]])[0] for one in file.joints]
    spread = float(np.hypot(*(np.ptp(axis[nodes]) for axis in (x, y))))
    law = joint.law or file.law
    assert law is not None and file.structure.height is not None
    height = joint.half_heights[0] if joint.half_heights is not None else file.structure.height / 2
    mass = _hung_mass(where)
    return PlaceRecipe.model_validate(
        {
            "title": f"{file.model.name}: placement",
            "mass": None if mass is None else f"{mass!r} kg",
            "near": [f"{_nearest(where, map_table.band)!r} Hz"],
            "at": Dof(map_table.at.node, "+Z"),
            "force": _texts(map_table.force, "N"),
            "normal_force": _texts([force for force in map_table.normal_force if force > 0], "N"),
            "beams": [
                {
                    "name": beam.part or "beam",
                    "joints": len(file.joints),
                    "spacing": f"{spread!r} m",
                    "width": f"{beam.width!r} m",
                    "height": f"{beam.height!r} m",
                    "overhang": f"{max(0.5 * (beam.length - spread), 0.0)!r} m",
                    "youngs_modulus": f"{beam.youngs_modulus!r} Pa",
                    "density": f"{beam.density!r} kg/m^3",
                }
            ],
            "joint": {
                "law": law,
                "surface_height": f"{height!r} m",
                "normal_stiffness": f"{joint.normal_stiffness or 1e9!r} N/m",
                "normal_exponent": joint.normal_exponent,
                "tangential_loss": joint.tangential_loss,
                "normal_loss": joint.normal_loss,
            },
        }
    )


def _hung_mass(path: Path) -> float | None:
    """Mass in kg of the bare structure where it hangs freely."""
    from scipy.linalg import eigvalsh

    host = acquisition.open_model(path).host
    assert isinstance(host, Matrices)
    if _elastic(eigvalsh(host.stiffness, host.mass))[0] == 0:
        return None
    moved = np.array([float(dof.direction == "+Z") for dof in host.dofs])
    return float(moved @ host.mass @ moved)


def _texts(values: Sequence[float], unit: str) -> list[str]:
    return [f"{value!r} {unit}" for value in values]


def _nearest(path: Path, band: list[float]) -> float:
    """Natural frequency of the bare structure next to the middle of a band, Hz."""
    frequencies = bare_of_model(path)[0].natural_frequencies
    return float(frequencies[np.argmin(np.abs(frequencies - 0.5 * (band[0] + band[1])))])
