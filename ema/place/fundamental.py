"""What the draws of a forecast are computed with: all modes together, the first harmonic of the friction alone.

It errs like every balance of one harmonic, by about the same share in the nominal case as in its draws: draws are taken
relative to the nominal case of the same kind and moved to what all harmonics give for that one.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Condition, Excitation, FrfSet, ModalModel
from ema.dof import Dof
from ema.errors import InputError
from ema.place.describing import secant_table
from ema.place.lift_off import Patches, patches, softened
from ema.place.shortlist import Question

LINES = 25
"""Lines of a stepped sine about a resonance: as in ``ema.compare.replay``."""
BANDWIDTHS = 4.0
"""Half-power bandwidths to either side of a resonance that these lines span: as in ``ema.compare.replay``."""


LIFTS = 30
"""Steps towards the motion with which edges lift off, at most. What has not settled by then jumps between two motions,
and has no resonance frequency."""
_CLOSE = 1e-4
"""Relative change of the frequency that no longer matters there."""


def fundamental(question: Question) -> Float[np.ndarray, "mode 4 level force"]:
    """Every resonance by first harmonics: Hz, damping ratio, opening, height; NaN where no peak belongs to the mode.

    A peak belongs to the bare mode that moves more in it than any other. ``fitted`` questions are answered with what a
    one-mode fit of the response of the output reads. The opening is the amplitude of the normal force over that at
    rest: from 1 on a joint parts, and normal springs that also pull are no model of it any more. The height is |X| in m
    at the excited DOF. With a ``pressure`` the edges of a patch lift off before (`ema.place.lift_off`).
    """
    from ema.place import fundamental_kernels

    kernels: Any = fundamental_kernels
    levels, forces = np.asarray(question.force_levels), np.asarray(question.normal_forces)
    result = np.full((len(question.bands), 4, len(levels), len(forces)), np.nan)
    output = question.output if question.fitted and question.output is not None else question.at
    structure: tuple[np.ndarray, ...] | None = None
    for column, force in enumerate(forces):
        model = question.model.with_normal_force(float(force))
        if structure is None or any(joint.normal_exponent for joint in model.joints):
            structure = _structure(model, question.at, output)
        contact = _contact(model)
        patch = None if question.pressure is None else patches(model, question.pressure)
        for row, band in enumerate(question.bands):
            for number, level in enumerate(levels):
                peak, softer = _peak(question.targets[row], band, float(level), structure, contact, patch)
                if question.fitted and np.isfinite(peak[0]):
                    width = BANDWIDTHS * peak[1] * peak[0]
                    lines = np.linspace(peak[0] - width, peak[0] + width, LINES)
                    values = kernels.curve(lines, float(level), softer, contact) / level
                    peak = (*_fitted(lines, values, peak[0], question), *peak[2:])
                result[row, :, number, column] = peak
    return result


def _peak(
    target: int,
    band: tuple[float, float],
    level: float,
    structure: tuple[np.ndarray, ...],
    contact: tuple[Any, ...],
    patch: Patches | None,
) -> tuple[tuple[float, float, float, float], tuple[np.ndarray, ...]]:
    """Frequency, damping ratio, opening and height of a peak, and the structure with what its patches have left there.

    The opening is that of springs that also pull.
    """
    from ema.place import fundamental_kernels

    kernels: Any = fundamental_kernels
    frequency, damping, opening, height, forces = kernels.peak_of(target, *band, level, structure, contact)
    softer, whole = structure, structure[6]
    if patch is None or not np.isfinite(frequency):
        return (frequency, damping, opening, height), softer
    for _ in range(LIFTS):
        # half way: the softer a patch, the more it moves
        soft = np.sqrt(softer[6] * softened(patch, whole, forces * softer[6]))
        softer = (*structure[:6], soft, structure[7])
        before = frequency
        frequency, damping, _, height, forces = kernels.peak_of(target, *band, level, softer, contact)
        if not np.isfinite(frequency) or abs(frequency - before) < _CLOSE * before:
            return (frequency, damping, opening, height), softer
    return (np.nan, np.nan, opening, np.nan), softer


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
        parts = np.stack(
            [
                linear_modes(model, question.at, sticking=sticking).shapes[list(question.targets)]
                for sticking in (False, True)
            ]
        )
        result[:, column] = np.min(np.max(parts**2, axis=2), axis=0)
    return result


class LinearModes(NamedTuple):
    """Natural frequencies [Hz] and damping ratios (mode,) with joints that only slide or only stick, and the shapes
    (bare mode, mode) in the mass-normalised modes of host and beam, those of the host first. What moves without
    stiffness, such as a beam along its sliding joints, has 0 Hz and no damping ratio: NaN."""

    frequencies: Float[np.ndarray, "mode"]
    damping_ratios: Float[np.ndarray, "mode"]
    shapes: Float[np.ndarray, "bare mode"]


def linear_modes(model: BeamModel, at: Dof, *, sticking: bool) -> LinearModes:
    """The modes of a host with its beam where no joint slides, or every joint slides without friction.

    Damping is that of each bare mode weighted by its energy.
    """
    squares, decay, losses, rows, _, springs, flexibility, _ = _structure(model, at, at)
    total = np.diag(squares) + springs.T @ (springs / flexibility.real[:, None])
    if sticking:
        total = total + rows.T @ (rows * _contact(model)[0][:, None])
    values, shapes = np.linalg.eigh(total)
    stiff = values > len(values) * np.finfo(float).eps * values[-1]
    omega = np.sqrt(np.where(stiff, values, 0.0))
    finite = np.where(stiff, omega, np.nan)
    damping = decay @ shapes**2 / (2 * finite) + (losses * squares) @ shapes**2 / (2 * finite**2)
    return LinearModes(omega / (2 * np.pi), damping, shapes)


def _structure(model: BeamModel, at: Dof, output: Dof) -> tuple[np.ndarray, ...]:
    """Host and beam in modes of their own, where the damping of each couples none of them, and what joins them.

    Squares, decay, loss factors (mode,), host first; slips (contact, mode); excited DOF and output (2, mode); normal
    springs (spring, mode) with their flexibilities, those of the joints' gaps first; number of the host's modes.
    """
    assert isinstance(model.host, ModalModel) and model.beam is not None
    from ema.simulate.modal_host import modal_coordinates
    from ema.simulate.reduction import natural_modes
    from ema.simulate.structure import assemble

    system, host = assemble(model), modal_coordinates(model.host)
    masses, count = np.diag(host.mass), len(host.mass)
    squares, shapes = natural_modes(model.beam.stiffness, model.beam.mass)
    # the free beam's own rigid-body motion
    squares = np.where(squares < 1e-9 * squares[-1], 0.0, squares)
    reach = np.zeros((count + len(shapes), count + shapes.shape[1]))
    reach[:count, :count], reach[count:, count:] = np.diag(1 / np.sqrt(masses)), shapes
    springs, stiffness = system.normals.rows, system.normals.stiffness.astype(complex)
    losses = np.repeat([joint.normal_loss for joint in model.joints], [len(joint.pairs) for joint in model.joints])
    stiffness *= 1 + 1j * losses
    if system.rocking is not None:
        springs = np.vstack([springs, system.rocking[0]])
        stiffness = np.append(stiffness, system.rocking[1])
    return (
        np.concatenate([np.diag(host.stiffness) / masses, squares]),
        np.concatenate([host.decay, np.zeros(len(squares))]),
        np.concatenate([np.zeros(count), np.full(len(squares), float(model.beam_loss))]),
        np.ascontiguousarray(system.contacts.slip[: system.contacts.tangential] @ reach),
        np.stack([system.row(at) @ reach, system.row(output) @ reach]),
        np.ascontiguousarray(springs @ reach),
        1 / stiffness,
        np.array([count]),
    )


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
