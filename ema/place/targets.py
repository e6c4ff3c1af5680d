"""What a placement recipe says of a structure: its target modes, and the conditions of a forecast."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ema.data import Finding, Geometry, ModalModel
from ema.errors import InputError
from ema.place.recipe import ForecastTable, PlaceRecipe
from ema.place.task import Task
from ema.shapes import smooth, with_body_uncertainty, with_plate, with_rigid_body

_FAR = 0.05
"""Distance of a target from the nearest mode, over its frequency, from which on there is no such mode: a wrong number
in a recipe is refused instead of placed for."""


def refuse_modes_with_a_beam(bare: ModalModel, where: str) -> None:
    """Refuse modes that were measured with a friction beam."""
    if bare.condition.joints:
        names = ", ".join(joint.joint for joint in bare.condition.joints)
        raise InputError(
            "these modes were measured with a friction beam",
            where=where,
            got=f"joints {names}",
            expected="the structure without the beam",
            advice="choose the bare run",
        )


def target_task(
    recipe: PlaceRecipe, bare: ModalModel, geometry: Geometry, where: str
) -> tuple[Task, tuple[Finding, ...]]:
    """Target modes, surface and forces of the recipe, with the rigid-body modes of a structure that hangs freely."""
    measured = len(bare.poles)
    bare, hung = with_rigid_body(_elastic(bare), geometry, recipe.mass)
    modes = tuple(_near(bare, frequency, where) for frequency in recipe.near)
    if len(set(modes)) < len(modes):
        raise InputError("two targets are one mode", where=where, got=f"{recipe.near} Hz", expected="distinct modes")
    surface = with_body_uncertainty(smooth(bare, geometry), len(bare.poles) - measured, recipe.mass is not None)
    task = Task(
        bare,
        surface,
        recipe.bolted_joint(),
        recipe.at,
        np.array(recipe.force),
        np.unique(recipe.normal_force),
        modes,
        recipe.output,
        in_plane=recipe.in_plane,
    )
    return task, tuple(hung)


def under_conditions(
    table: ForecastTable, task: Task, levels: Sequence[float], forces: Sequence[float]
) -> tuple[Task, tuple[Finding, ...]]:
    """The task of a forecast under F_E and F_N [N], and what is to be known about the modes above those measured."""
    bare, surface, beyond = task.bare, task.surface, tuple[Finding, ...]()
    if table.above == "plate":
        bare, surface, beyond = with_plate(bare, surface)
    task = task._replace(
        bare=bare,
        surface=surface,
        force_levels=np.array(levels),
        normal_forces=np.array(forces),
        scale_std=0.5 * table.calibration_std,
    )
    return task, beyond


def _elastic(bare: ModalModel) -> ModalModel:
    """Modes with real shapes; those far from proportional damping are made real."""
    from ema.shapes import realise

    lost = float(np.linalg.norm(np.imag(bare.shapes))) / max(float(np.linalg.norm(bare.shapes)), 1e-300)
    return bare if lost < 1e-9 else replace(bare, shapes=realise(bare.shapes).astype(complex))


def _near(bare: ModalModel, frequency: float, where: str) -> int:
    known = bare.natural_frequencies
    row = int(np.argmin(np.abs(known - frequency)))
    if abs(known[row] - frequency) > _FAR * frequency:
        raise InputError(
            "no mode near this frequency",
            where=where,
            got=f"{frequency:g} Hz",
            expected="one of " + ", ".join(f"{one:.1f}" for one in known) + " Hz",
        )
    return row
