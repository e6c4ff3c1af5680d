"""How far a prediction can be trusted: samples of what is uncertain in the shapes and in the joint."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ema.data.placement import Candidates, Prediction
from ema.dof import Dof, match
from ema.place.task import Task, predicted
from ema.progress import Progress, advance, silent


def samples(
    task: Task, candidates: Candidates, draws: int, rng: np.random.Generator, progress: Progress = silent
) -> tuple[Prediction, ...]:
    """Predictions for draws of what is uncertain (see ``drawn``)."""
    results = []
    for number, sample in enumerate(drawn(task, draws, rng)):
        results.append(predicted(sample, candidates))
        advance(progress, "intervals", number + 1, draws)
    return tuple(results)


def drawn(task: Task, draws: int, rng: np.random.Generator) -> Iterator[Task]:
    """The task with draws of the smoothed shapes, of the shapes at the excited DOF, of mu and of k_T.

    The shape at a measured DOF is as uncertain as the scatter of the points about the surface; mu and k_T are
    log-normal with ``friction_std`` and ``stiffness_std`` of the joint, alike in all joints; the scale of all shapes is
    drawn with ``scale_std`` of the task.
    """
    surface, law = task.surface, task.joint.law
    roots = []
    for covariance in surface.covariance:
        size, turned = np.linalg.eigh(covariance)
        roots.append(turned * np.sqrt(np.maximum(size, 0)))
    rows = sorted({row for dof in (task.at, task.output) if dof is not None for row in _rows(task, dof)})
    for _ in range(draws):
        shift = np.stack([root @ rng.standard_normal(len(root)) for root in roots], axis=1)
        mu = law.friction_coefficient * np.exp(task.joint.friction_std * rng.standard_normal())
        factor = np.exp(task.joint.stiffness_std * rng.standard_normal())
        changed = replace(
            law,
            friction_coefficient=mu,
            contact_stiffness=law.contact_stiffness * factor,
            stiffness_cap=law.stiffness_cap * factor,
        )
        shapes = task.bare.shapes.copy()
        shapes[rows] += surface.noise * rng.standard_normal((len(rows), len(surface.noise)))
        scale = 1 + task.scale_std * rng.standard_normal() if task.scale_std > 0 else 1.0
        yield task._replace(
            bare=replace(task.bare, shapes=scale * shapes),
            joint=replace(task.joint, law=changed),
            surface=replace(surface, coefficients=scale * (surface.coefficients + shift)),
        )


def _rows(task: Task, dof: Dof | str) -> list[int]:
    found = match([Dof.parse(dof)], task.bare.dofs)
    return [found[0][1]] if found else []
