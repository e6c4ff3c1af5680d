"""One mode at a time: what a friction beam does to the measured modes of a structure, at many places."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.data import ModalModel
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam, Prediction
from ema.data.provenance import Provenance
from ema.dof import Dof, match
from ema.errors import InputError
from ema.place.describing import secant_table
from ema.place.task import Task
from ema.shapes import Surface

ELEMENTS = 4
"""Beam elements between two joints."""
FAR = 5.0
"""Modes of the free beam above this multiple of the highest target frequency only yield statically."""


def predict(
    task: Task,
    candidates: Candidates,
) -> Prediction:
    """Predict frequency and damping of the target modes with the beam at every candidate location, over (F_E, F_N).

    Each mode is taken alone (its neighbours neither yield nor interact), with the beam's own modes on its normal
    springs and the first harmonic of the friction force: fast enough for thousands of locations. Check the best few
    with all modes together (``ema.place.verify``).

    Parameters
    ----------
    task : Task
        Structure, joint, forces and target modes.
    candidates : Candidates
        Locations of the beam.

    Returns
    -------
    Prediction
        Frequency and damping of every candidate; holes are NaN.

    Raises
    ------
    InputError
        If shapes have no scale, the surface has another number of modes, a mode or DOF does not exist, levels are not
        positive, beams differ in their number of joints, or the law depends on velocity.

    References
    ----------
    .. [1] Friction beams: Gaul, Roseira and Becker (2008).

    Examples
    --------
    >>> from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
    >>> from ema.examples import plate
    >>> from ema.place import Task, grid
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> surface = smooth(bare, geometry)
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003)
    >>> spots = grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.2)
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([20.0, 50.0]), modes=(0, 1))
    >>> predict(task, spots).damping.shape[1:]
    (2, 1, 2)
    """
    bare, joint = task.bare, task.joint
    levels, forces = np.asarray(task.force_levels, dtype=np.float64), np.asarray(task.normal_forces, dtype=np.float64)
    chosen = _check(task, candidates, levels, forces)
    from ema.place import predictor_kernels

    kernels: Any = predictor_kernels
    order = np.argsort(levels)
    omega, zeta = np.abs(bare.poles[chosen]), bare.damping_ratios[chosen]
    phi, lever = motions(task.surface, candidates, joint, chosen)
    driver = shapes_at(bare, task.at)[chosen]
    seen = driver if task.output is None else shapes_at(bare, task.output)[chosen]
    beams = _free(candidates.catalogue, float(omega.max()))
    count = len(candidates.catalogue[0].places)
    joints = (
        normal_stiffness(joint, forces) * (1 + 1j * joint.normal_loss),
        contact_stiffness(joint, forces),
        joint.law.friction_coefficient * forces,
        joint.tangential_loss,
        secant_table(joint.law.name, joint.law.parameters),
    )
    placed = (phi, lever, candidates.beams)
    result = kernels.all_places((omega, zeta, np.abs(driver)), levels[order], placed, beams, joints)
    back = np.argsort(order)
    result = result[:, :, :, back, :]
    return Prediction(
        candidates,
        tuple(int(mode) for mode in chosen),
        omega / (2 * np.pi),
        zeta,
        levels,
        forces,
        result[:, :, 0],
        result[:, :, 1],
        result[:, :, 3],
        result[:, :, 2],
        driver,
        seen,
        provenance=Provenance(steps=("place.predict",), options=(("joints", str(count)), ("law", joint.law.name))),
    )


def _check(task: Task, candidates: Candidates, levels: np.ndarray, forces: np.ndarray) -> np.ndarray:
    bare, surface, modes = task.bare, task.surface, task.modes
    where = bare.name or "bare structure"
    if bare.scaling != "unit modal mass":
        raise InputError(
            "placement needs scaled shapes",
            where=where,
            got=bare.scaling,
            expected="unit modal mass",
            advice="measure the force and a drive point of the bare structure",
        )
    if surface.coefficients.shape[1] != len(bare.poles):
        raise InputError(
            "the surface has other modes",
            where=where,
            got=f"{surface.coefficients.shape[1]} modes",
            expected=f"{len(bare.poles)}",
        )
    for name, values in (("force levels", levels), ("normal forces", forces)):
        if values.ndim != 1 or not len(values) or not np.all(np.isfinite(values)) or np.any(values <= 0):
            raise InputError(f"not {name}", where=where, got=values.tolist(), expected="positive numbers in N")
    if not len(candidates):
        raise InputError(
            "no place for the beam",
            where=where,
            got="0 candidates",
            expected="one or more",
            advice="shorter beams, smaller keep-out areas, or a finer grid",
        )
    if len({beam.joints for beam in candidates.catalogue}) > 1:
        raise InputError(
            "beams with different numbers of joints",
            where=where,
            got=sorted({beam.joints for beam in candidates.catalogue}),
            expected="one number",
            advice="predict each kind on its own",
        )
    chosen = np.asarray(modes, dtype=np.int64)
    if not len(chosen) or chosen.min() < 0 or chosen.max() >= len(bare.poles):
        raise InputError("no such mode", where=where, got=chosen.tolist(), expected=f"0 to {len(bare.poles) - 1}")
    return chosen


def shapes_at(bare: ModalModel, at: Dof | str) -> Float[np.ndarray, "mode"]:
    """Shapes of all modes at a measured DOF.

    Raises
    ------
    InputError : it was not measured.
    """
    wanted = Dof.parse(at)
    matches = match([wanted], bare.dofs)
    if not matches:
        raise InputError(
            "the DOF was not measured",
            where=bare.name,
            got=str(wanted),
            expected=f"one of {len(bare.dofs)} DOFs such as {bare.dofs[0]}",
        )
    return np.asarray(np.real(bare.shapes[matches[0][1]]) * matches[0][2])


def contact_stiffness(joint: BoltedJoint, forces: Float[np.ndarray, "force"]) -> Float[np.ndarray, "force"]:
    """k_T(F_N) of one joint in N/m: a power law with a cap."""
    law = joint.law
    return np.minimum(
        law.contact_stiffness * (forces / law.reference_force) ** law.stiffness_exponent, law.stiffness_cap
    )


def normal_stiffness(joint: BoltedJoint, forces: Float[np.ndarray, "force"]) -> Float[np.ndarray, "force"]:
    """k_N(F_N) of one joint in N/m."""
    return np.asarray(joint.normal_stiffness * (forces / joint.law.reference_force) ** joint.normal_exponent)


def motions(
    surface: Surface, candidates: Candidates, joint: BoltedJoint, modes: Sequence[int] | np.ndarray
) -> tuple[Float[np.ndarray, "candidate joint mode"], Float[np.ndarray, "candidate joint mode"]]:
    """Deflection at every joint, and motion of the interface against the beam's direction, c phi', per unit mode."""
    places = np.array([candidates.joints(c) for c in range(len(candidates))])
    count, joints = places.shape[:2]
    flat, angles = places.reshape(-1, 2), np.repeat(candidates.angles, joints)
    chosen = np.asarray(modes)
    deflection = surface.values(flat)[:, chosen].reshape(count, joints, len(chosen))
    slope = surface.values(flat, 1, angles)[:, chosen].reshape(count, joints, len(chosen))
    return np.ascontiguousarray(deflection), np.ascontiguousarray(joint.surface_height * slope)


def beam_matrices(
    beam: FrictionBeam,
) -> tuple[
    Float[np.ndarray, "n n"], Float[np.ndarray, "n n"], Float[np.ndarray, "joint n"], Float[np.ndarray, "joint n"]
]:
    """Mass, stiffness, and rows of the tangential motion of the lower face and of the deflection at the joints."""
    from ema.elements.beams import element

    lengths = np.repeat(beam.spacing / (beam.joints - 1) / ELEMENTS, ELEMENTS * (beam.joints - 1))
    first = 0
    if beam.overhang > 0:
        lengths, first = np.concatenate([[beam.overhang], lengths, [beam.overhang]]), 1
    size = 3 * (len(lengths) + 1)
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    for place, length in enumerate(lengths):
        rows = slice(3 * place, 3 * place + 6)
        part = element(float(length), beam.width, beam.height, beam.young_modulus, beam.density)
        mass[rows, rows] += part[0] + (_rotary(float(length), beam) if beam.rotary else 0.0)
        stiffness[rows, rows] += part[1] + (_sheared(float(length), beam) if beam.shear else 0.0)
    tangential, normal = np.zeros((beam.joints, size)), np.zeros((beam.joints, size))
    for joint in range(beam.joints):
        node = first + joint * ELEMENTS
        tangential[joint, 3 * node], tangential[joint, 3 * node + 2] = 1.0, 0.5 * beam.height
        normal[joint, 3 * node + 1] = 1.0
    return mass, stiffness, tangential, normal


def _sheared(length: float, beam: FrictionBeam) -> Float[np.ndarray, "6 6"]:
    """What shear takes off the bending stiffness of an element (Przemieniecki 1968, section 5.6); G = E/2.6."""
    bending, result = np.array([1, 2, 4, 5]), np.zeros((6, 6))
    phi = 12 * 2.6 * (6 / 5) * beam.height**2 / 12 / length**2
    scale = beam.young_modulus * beam.width * beam.height**3 / 12 / length**3

    def bent(factor: float, near: float, far: float) -> Float[np.ndarray, "4 4"]:
        """Stiffness of (w, phi) at both ends."""
        return factor * np.array(
            [
                [12, 6 * length, -12, 6 * length],
                [6 * length, near * length**2, -6 * length, far * length**2],
                [-12, -6 * length, 12, -6 * length],
                [6 * length, far * length**2, -6 * length, near * length**2],
            ]
        )

    result[np.ix_(bending, bending)] = scale * (bent(1 / (1 + phi), 4 + phi, 2 - phi) - bent(1.0, 4.0, 2.0))
    return result


def _rotary(length: float, beam: FrictionBeam) -> Float[np.ndarray, "6 6"]:
    """Mass of an element by the rotation of its sections (Rayleigh)."""
    bending, result = np.array([1, 2, 4, 5]), np.zeros((6, 6))
    result[np.ix_(bending, bending)] = (
        beam.density
        * beam.width
        * beam.height**3
        / 12
        / (30 * length)
        * np.array(
            [
                [36, 3 * length, -36, 3 * length],
                [3 * length, 4 * length**2, -3 * length, -(length**2)],
                [-36, -3 * length, 36, -3 * length],
                [3 * length, -(length**2), -3 * length, 4 * length**2],
            ]
        )
    )
    return result


def _free(catalogue: Sequence[FrictionBeam], omega: float) -> tuple[np.ndarray, ...]:
    """Modes of every free beam: squares of its angular frequencies, tangential and normal motion at the joints.

    Those far above ``omega`` are put together: the last array, shape (beam, 2, 3, joint, joint), holds their part of
    the receptances (tangential, mixed, normal) at rest and the factor of omega^2.
    """
    from scipy.linalg import eigh

    modes = []
    for beam in catalogue:
        mass, stiffness, tangential, normal = beam_matrices(beam)
        squares, vectors = eigh(stiffness, mass)
        modes.append((np.where(squares < 1e-9 * squares[-1], 0.0, squares), tangential @ vectors, normal @ vectors))
    kept = max(int(np.sum(squares < (FAR * omega) ** 2)) for squares, _, _ in modes)
    rest = np.zeros((len(catalogue), 2, 3, catalogue[0].joints, catalogue[0].joints))
    for row, (squares, tangential, normal) in enumerate(modes):
        for power in (1, 2):
            weight = squares[kept:] ** -float(power)
            pairs = ((tangential, tangential), (tangential, normal), (normal, normal))
            rest[row, power - 1] = [(left[:, kept:] * weight) @ right[:, kept:].T for left, right in pairs]
    low = [np.ascontiguousarray(np.stack([part[..., :kept] for part in column])) for column in zip(*modes)]
    return (*low, rest)
