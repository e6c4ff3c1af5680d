"""What the draws of a forecast are computed with: all modes together, the first harmonic of the friction alone.

It errs like every balance of one harmonic, by about the same share in the nominal case as in its draws: draws are taken
relative to the nominal case of the same kind and moved to what all harmonics give for that one.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Condition, Excitation, FrfSet, ModalModel
from ema.dof import Dof
from ema.errors import InputError
from ema.place.describing import secant_table
from ema.place.shortlist import Question

LINES, BANDWIDTHS = 25, 4.0
"""Lines of a stepped sine about a resonance, and its half-power bandwidths to either side: as in ``ema.compare``."""


def fundamental(question: Question) -> Float[np.ndarray, "mode 3 level force"]:
    """Every resonance by first harmonics: Hz, damping ratio, opening; NaN where no peak belongs to the mode.

    A peak belongs to the bare mode that moves more in it than any other. ``fitted`` questions are answered with what a
    one-mode fit of the response of the output reads. The opening is the amplitude of the normal force over that at
    rest: from 1 on a joint parts, and normal springs that also pull are no model of it any more.
    """
    from ema.place import fundamental_kernels

    kernels: Any = fundamental_kernels
    levels, forces = np.asarray(question.force_levels), np.asarray(question.normal_forces)
    result = np.full((len(question.bands), 3, len(levels), len(forces)), np.nan)
    output = question.output if question.fitted and question.output is not None else question.at
    structure: tuple[np.ndarray, ...] | None = None
    for column, force in enumerate(forces):
        model = question.model.with_normal_force(float(force))
        if structure is None or any(joint.normal_exponent for joint in model.joints):
            structure = _structure(model, question.at, output)
        contact = _contact(model)
        for row, band in enumerate(question.bands):
            for number, level in enumerate(levels):
                found = kernels.peak_of(question.targets[row], *band, float(level), structure, contact)
                if question.fitted and np.isfinite(found[0]):
                    width = BANDWIDTHS * found[1] * found[0]
                    lines = np.linspace(found[0] - width, found[0] + width, LINES)
                    values = kernels.curve(lines, float(level), structure, contact) / level
                    found = (*_fitted(lines, values, found[0], question), found[2])
                result[row, :, number, column] = found
    return result


MAJORITY = 0.5
"""Share of a bare mode that one resonance has to hold to be that mode; of two resonances at most one can hold it."""


def shares(question: Question) -> Float[np.ndarray, "mode force"]:
    """The largest share of each target mode that one mode of the structure with the beam holds.

    In mass-normalised coordinates the squared parts of a bare mode in all modes with the beam add up to one. The
    smaller of the shares with sliding and with sticking joints counts.
    """
    result = np.empty((len(question.targets), len(question.normal_forces)))
    for column, force in enumerate(question.normal_forces):
        model = question.model.with_normal_force(float(force))
        squares, _, _, rows, _, bare, _ = _structure(model, question.at, question.at)
        stiffness = _contact(model)[0]
        _, stuck = np.linalg.eigh(np.diag(squares) + rows.T @ (rows * stiffness[:, None]))
        parts = np.stack([bare, bare @ stuck])[:, list(question.targets)]
        result[:, column] = np.min(np.max(parts**2, axis=2), axis=0)
    return result


def _structure(model: BeamModel, at: Dof, output: Dof) -> tuple[np.ndarray, ...]:
    """Modes without the tangential contacts: squares, decay, loss, slips, excited DOF and output, bare modes."""
    assert isinstance(model.host, ModalModel)
    from ema.simulate.reduction import natural_modes
    from ema.simulate.structure import assemble

    system = assemble(replace(model, joints=tuple(replace(joint, tangential_loss=0.0) for joint in model.joints)))
    squares, shapes = natural_modes(system.stiffness, system.mass)
    squares = np.where(squares < 1e-12 * squares[-1], 0.0, squares)
    decay, losses = np.zeros(len(squares)), np.zeros(len(squares))
    if system.decay is not None:
        decay = (system.decay * np.diag(system.mass)) @ shapes**2
    if system.loss is not None:
        lost = np.sum(shapes * (system.loss @ shapes), axis=0)
        losses = np.divide(lost, squares, out=np.zeros_like(lost), where=squares > 0)
    rows = np.ascontiguousarray(system.contacts.slip[: system.contacts.tangential] @ shapes)
    ends = np.stack([system.row(at) @ shapes, system.row(output) @ shapes])
    # coordinates of the host are its bare modes, those of the beam follow
    bare = np.ascontiguousarray(shapes[: len(model.host.poles)])
    normals = system.normals
    pressing = np.ascontiguousarray((normals.stiffness[:, None] * normals.rows) @ shapes)
    return squares, decay, losses, rows, ends, bare, pressing


def _contact(model: BeamModel) -> tuple[Any, ...]:
    """Tangential stiffnesses and slip forces of the contacts, their loss factor, and the first harmonic of the law."""
    from ema.simulate.structure import pair_forces, pair_stiffness

    law = model.joints[0].law
    stiffness = np.concatenate([pair_stiffness(joint) for joint in model.joints])
    limits = np.concatenate([joint.law.friction_coefficient * pair_forces(joint) for joint in model.joints])
    pressed = np.concatenate([pair_forces(joint) for joint in model.joints])
    return stiffness, limits, model.joints[0].tangential_loss, secant_table(law.name, law.parameters), pressed


def _fitted(lines: np.ndarray, values: np.ndarray, near: float, question: Question) -> tuple[float, float]:
    """Frequency and damping ratio that a one-mode fit reads."""
    from ema.fit import local_fit

    good = np.isfinite(values)
    frfs = FrfSet(
        lines[good],
        values[good][:, None, None],
        (question.output or question.at,),
        (question.at,),
        "receptance",
        "m/N",
        condition=Condition(Excitation("stepped sine", 1.0)),
    )
    try:
        mode = local_fit(frfs, near)
    except InputError:
        return float("nan"), float("nan")
    return mode.natural_frequency, mode.damping_ratio
