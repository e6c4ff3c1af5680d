"""How far a prediction can be trusted: samples of what is uncertain in the shapes and in the joint."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Complex, Float

from ema.data import FrictionLaw, ModalModel, poles_from
from ema.data.placement import BoltedJoint, Candidates, Prediction
from ema.dof import Dof, match
from ema.place.flexibility import flexibility_std
from ema.place.predictor import predict
from ema.place.task import Task
from ema.progress import Progress, advance, silent
from ema.shapes import Surface, rigid_rows

UNKNOWN_DAMPING = 0.7
"""Standard deviation of the logarithm of a damping ratio of which nothing is known, such as that of a suspension."""
_SEVERAL = 4
"""Modes from which on the scatter of their damping ratios is taken for that of others; below, `UNKNOWN_DAMPING` is."""
_MOST_DAMPING = 0.9
"""Damping ratio of a draw at most: a safeguard, for a mode with more does not oscillate."""


def samples(
    task: Task, candidates: Candidates, draws: int, rng: np.random.Generator, progress: Progress = silent
) -> tuple[Prediction, ...]:
    """Predictions for draws of what is uncertain (see ``drawn``)."""
    results = []
    for number, sample in enumerate(drawn(task, draws, rng)):
        results.append(predict(sample, candidates))
        advance(progress, "intervals", number + 1, draws)
    return tuple(results)


MICROSLIP, LAST_SLIDER = (-0.9, 0.0), (0.05, 20.0)
"""Range of Segalman's exponent chi, uniform, and of beta, logarithmic, of the laws of an open form.

The small end of beta is a joint whose sliders give way one after the other up to the largest force; from beta = 20 on
the first harmonic is that of a single Masing spring within 2 %.
"""
SPRINGS = 40
"""Masing springs of such a law."""


def drawn(task: Task, draws: int, rng: np.random.Generator) -> Iterator[Task]:
    """The task with draws of the bare modes, of their smoothed shapes, and of what the joint leaves open.

    Frequencies and damping ratios of measured modes are drawn with their covariance; what nobody measured has the
    damping ratios of other modes (``UNKNOWN_DAMPING``).

    The shape at a measured DOF is as uncertain as the scatter of the points about the surface; the scale of all
    shapes is drawn with ``scale_std`` of the task. What the joint states with a relative uncertainty is log-normal,
    alike in all joints (``BoltedJoint``); so is the flexibility of the modes above those measured
    (``flexibility_std``). With ``form`` "open" every draw has another Iwan law with the same mu and k_T.
    """
    surface = task.surface
    roots = []
    for covariance in surface.covariance:
        size, turned = np.linalg.eigh(covariance)
        roots.append(turned * np.sqrt(np.maximum(size, 0)))
    above, damping = flexibility_std(task.bare, surface), _damping_std(task.bare, surface)
    rows = sorted({row for dof in (task.at, task.output) if dof is not None for row in _rows(task, dof)})
    for _ in range(draws):
        shift = np.stack([root @ rng.standard_normal(len(root)) for root in roots], axis=1)
        joint = _joint(task.joint, rng)
        shapes = task.bare.shapes.copy()
        shapes[rows] += surface.noise * rng.standard_normal((len(rows), len(surface.noise)))
        scale = 1 + task.scale_std * rng.standard_normal() if task.scale_std > 0 else 1.0
        yield task._replace(
            bare=replace(task.bare, poles=_poles(task.bare, damping, rng), shapes=scale * shapes),
            joint=joint,
            surface=replace(surface, coefficients=scale * (surface.coefficients + shift)),
            normal_forces=task.normal_forces * np.exp(task.joint.force_std * rng.standard_normal()),
            flexibility_factor=float(np.exp(above * rng.standard_normal())),
        )


def _damping_std(bare: ModalModel, surface: Surface) -> Float[np.ndarray, "mode"]:
    """Standard deviation of the logarithm of the damping ratio of every mode of which none was measured, else 0."""
    rigid = rigid_rows(bare, surface)
    unknown = ~bare.shapes.any(axis=0)
    elastic = np.setdiff1d(np.flatnonzero(~unknown), rigid)
    scatter = (
        float(np.std(np.log(bare.damping_ratios[elastic]), ddof=1)) if len(elastic) >= _SEVERAL else UNKNOWN_DAMPING
    )
    result = np.where(unknown, scatter, 0.0)
    assumed = [row for row in rigid if bare.covariance is None or not bare.covariance[row].any()]
    result[assumed] = UNKNOWN_DAMPING
    return result


def _poles(bare: ModalModel, damping_std: np.ndarray, rng: np.random.Generator) -> Complex[np.ndarray, "mode"]:
    """A draw of the poles; damping ratios stay positive."""
    count = len(bare.poles)
    frequency, ratio = bare.natural_frequencies, bare.damping_ratios
    logarithm = damping_std * rng.standard_normal(count)
    if bare.covariance is not None:
        size, turned = np.linalg.eigh(bare.covariance)
        moved = np.einsum("mij,mj,mj->mi", turned, np.sqrt(np.maximum(size, 0)), rng.standard_normal((count, 2)))
        frequency = np.maximum(frequency + moved[:, 0], 0.5 * frequency)
        logarithm = logarithm + moved[:, 1] / np.maximum(ratio, 1e-12)
    return poles_from(frequency, np.minimum(ratio * np.exp(logarithm), _MOST_DAMPING))


def _joint(joint: BoltedJoint, rng: np.random.Generator) -> BoltedJoint:
    """One draw of what is not known of the joint."""
    mu, tangential, normal, length = np.exp(
        np.array([joint.friction_std, joint.stiffness_std, joint.normal_std, joint.length_std]) * rng.standard_normal(4)
    )
    height, exponent = np.array([joint.height_std, joint.exponent_std]) * rng.standard_normal(2)
    law = joint.law
    if joint.form == "open":
        chi, beta = rng.uniform(*MICROSLIP), np.exp(rng.uniform(*np.log(LAST_SLIDER)))
        law = replace(
            law, name="iwan", parameters=(("chi", float(chi)), ("beta", float(beta)), ("springs", float(SPRINGS)))
        )
    law = replace(scaled(law, mu, tangential), stiffness_exponent=float(max(law.stiffness_exponent + exponent, 0.0)))
    return replace(
        joint,
        law=law,
        normal_stiffness=float(joint.normal_stiffness * normal),
        contact_length=float(joint.contact_length * length),
        surface_height=float(max(joint.surface_height + height, 0.0)),
    )


def scaled(law: FrictionLaw, friction: float, stiffness: float) -> FrictionLaw:
    """The law with factors on mu and on k_T with its cap."""
    return replace(
        law,
        friction_coefficient=float(law.friction_coefficient * friction),
        contact_stiffness=float(law.contact_stiffness * stiffness),
        stiffness_cap=float(law.stiffness_cap * stiffness),
    )


def scattered(law: FrictionLaw, scatter: float, rng: np.random.Generator) -> FrictionLaw:
    """The law of another joint of the kind: mu and k_T differ from joint to joint."""
    friction, stiffness = np.exp(scatter * rng.standard_normal(2))
    return scaled(law, friction, stiffness)


def beams_drawn(candidates: Candidates, rng: np.random.Generator) -> Candidates:
    """The candidates with draws of the loss factors of their beams."""
    catalogue = tuple(
        replace(beam, loss=float(beam.loss * np.exp(beam.loss_std * rng.standard_normal())))
        for beam in candidates.catalogue
    )
    return replace(candidates, catalogue=catalogue)


def _rows(task: Task, dof: Dof | str) -> list[int]:
    matches = match([Dof.parse(dof)], task.bare.dofs)
    return [matches[0][1]] if matches else []
