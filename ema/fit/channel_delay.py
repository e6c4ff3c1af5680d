"""Responses that were recorded later than the force: what a delay does to the phases of the residues.

The residues of a structure with damping proportional to mass and stiffness are imaginary; those of a channel that is
late by t are turned by -w t at a mode with frequency w. Complex modes turn residues too, by angles that have nothing
to do with the frequency: their scatter over all channels and modes says how well a delay is known.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.stats
from jaxtyping import Complex, Float

from ema.data import Finding, ModalModel
from ema.dof import Dof
from ema.messages import mark

CHANCE = 1e-4
"""Probability that the scatter of the phases alone looks like a delay, for any channel of a test."""
TURN = 0.25 * np.pi
"""Angle at the highest mode beyond which a turn may as well be one by half a turn more."""
FEWEST = 3
"""Modes from which on a delay can be distinguished from complex modes: two modes leave one phase of each channel to
judge its scatter by."""


@dataclass(frozen=True)
class Delay:
    """Delay [s] of the response channel at a DOF, in ``row`` of the model's DOFs (of its references where the forces
    rove), with its standard deviation.
    """

    dof: Dof
    row: int
    value: float
    std: float


def delays(model: ModalModel, roving_forces: bool = False) -> tuple[Delay, ...]:
    """Response channels whose delay against the forces the modes show, beyond the scatter by complex modes."""
    residues = model.residues().transpose(0, 2, 1) if roving_forces else model.residues()
    dofs = model.inputs if roving_forces else model.dofs
    modes, count = len(model.poles), len(dofs)
    if modes < FEWEST or not count:
        return ()
    # Angle to the imaginary axis; strong components count as their energy.
    phase = 0.5 * np.angle(-(residues**2))
    weight = np.abs(residues) ** 2 / np.maximum(np.sum(np.abs(residues) ** 2, axis=(1, 2), keepdims=True), 1e-300)
    omega = model.poles.imag[:, None, None]
    information = np.maximum(np.sum(weight * omega**2, axis=(0, 2)), 1e-300)
    value = -np.sum(weight * omega * phase, axis=(0, 2)) / information
    freedom = count * (modes - 1)
    scatter = np.sum(weight * (phase + omega * value[:, None]) ** 2) / freedom
    std = np.sqrt(scatter / information)
    reach = scipy.stats.t.isf(0.5 * CHANCE / count, freedom)
    late = (np.abs(value) > reach * std) & (np.abs(value) * omega.max() < TURN)
    return tuple(Delay(dofs[k], int(k), float(value[k]), float(std[k])) for k in np.flatnonzero(late))


def widened(model: ModalModel, late: tuple[Delay, ...], roving_forces: bool = False) -> ModalModel:
    """The model with the turn by each delay in the intervals of residues and shapes of its channel."""
    stated = model.uncertainty
    if not late or stated is None:
        return model
    residues, shapes, participation = (np.array(one) for one in (stated.residues, stated.shapes, stated.participation))
    for delay in late:
        turn = model.poles.imag * delay.value
        if roving_forces:
            residues[:, :, delay.row] += _turned(model.residues()[:, :, delay.row], turn[:, None])
            participation[:, delay.row] += _turned(model.participation[delay.row], turn)
        else:
            residues[:, delay.row] += _turned(model.residues()[:, delay.row], turn[:, None])
            shapes[:, delay.row] += _turned(model.shapes[delay.row], turn)
    return replace(model, uncertainty=replace(stated, residues=residues, shapes=shapes, participation=participation))


def _turned(
    values: Complex[np.ndarray, "*shape"], angle: Float[np.ndarray, "*angle"]
) -> Float[np.ndarray, "*shape 2 2"]:
    """Covariance of real and imaginary part of values that may as well be turned by an angle."""
    result = 0.0
    for size, direction in ((np.sin(angle), 1j), (1 - np.cos(angle), 1.0)):
        error = values * size * direction
        parts = np.stack([error.real, error.imag], axis=-1)
        result = result + parts[..., :, None] * parts[..., None, :]
    return np.asarray(result)


def findings(late: tuple[Delay, ...], where: str) -> tuple[Finding, ...]:
    """A finding for each late channel."""
    return tuple(
        Finding.of(
            "warning",
            "channel-delay",
            f"{where}, {delay.dof}",
            "From the phases of the modes this channel is {delay} ± {std} us {sense} relative to the force.",
            delay.value,
            1.96 * delay.std,
            advice=("Check the filters and the sampling of the channel; shapes and residues there are turned by it."),
            delay=f"{1000000.0 * abs(delay.value):.3g}",
            std=f"{1960000.0 * delay.std:.2g}",
            sense=mark("late") if delay.value > 0 else mark("early"),
        )
        for delay in late
    )
