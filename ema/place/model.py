"""The full model of a measured structure with a friction beam at one place: what the shortlist is checked with."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from ema.data import BeamModel, Damping, Joint, Matrices, ModalModel
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam
from ema.dof import Dof
from ema.place.flexibility import Flexibility, flexibility
from ema.place.predictor import ELEMENTS, beam_matrices
from ema.place.task import Task
from ema.shapes import Surface, mass_of

PART = "friction beam"
FIRST_NODE = 900_001
"""Node numbers of the joints on the host: above any measured point."""


def model_at(
    task: Task,
    candidates: Candidates,
    place: int,
    normal_force: float | Sequence[float] | Float[np.ndarray, "joint"],
) -> BeamModel:
    """Return the model of a measured host with the beam of one candidate.

    The host keeps its measured DOFs; the joints are nodes 900001, 900002, ... with axes along the beam, whose shapes
    come from the surface. Of the modes above those measured the static flexibility at each joint is estimated from the
    measured ones and the residual terms at driving points; a model without residual terms has none. A host whose
    rigid-body modes are known hangs freely: it also moves as a whole along the beam, with all its mass; its turning
    about the normal and strain in its own plane are left out. Any other host is held in its plane.

    Parameters
    ----------
    task : Task
        Structure and joint.
    candidates : Candidates
        Locations of the beam.
    place : int
        Row in ``candidates``.
    normal_force : float or sequence of float or array of shape (joint,)
        F_N [N] of every joint, or of each.

    Returns
    -------
    BeamModel
        Host, beam and joints.

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
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([50.0]), modes=(0,))
    >>> [part.normal_force for part in model_at(task, spots, 0, 50.0).joints]
    [50.0, 50.0]
    """
    bare, surface, joint = task.bare, task.surface, task.joint
    beam = candidates.catalogue[int(candidates.beams[place])]
    points, angle = candidates.joints(place), float(candidates.angles[place])
    # bolts press a round patch; where its length is not given, the beam touches with its whole width
    above = flexibility(bare, surface, points, angle, joint.contact_length or beam.width)
    host = _host(bare, surface, points, angle, above, task.flexibility_factor)
    mass = mass_of(bare, surface) if task.in_plane == "free" else None
    if mass is not None:
        host = _swaying(host, mass)
    inertia, stiffness, *_ = beam_matrices(beam)
    count = len(inertia) // 3
    beam_dofs = tuple(Dof(node, direction, PART) for node in range(count) for direction in ("+X", "+Z", "-RY"))
    return BeamModel(
        host,
        Matrices(inertia, stiffness, beam_dofs),
        _joints(beam, joint, normal_force),
        Damping(),
        name=f"place {place}",
        pair_spacing=None,
        beam_loss=beam.loss,
    )


def _host(
    bare: ModalModel,
    surface: Surface,
    points: Float[np.ndarray, "joint 2"],
    angle: float,
    above: Flexibility | None,
    flexibility_factor: float,
) -> ModalModel:
    """The measured modes with their deflection and slope at the joints, and modes of the flexibility ``above`` them."""
    deflection, slope = surface.values(points), surface.values(points, 1, angle)
    rows, dofs = [np.real(bare.shapes)], list(bare.dofs)
    for number in range(len(points)):
        node = FIRST_NODE + number
        rows += [np.zeros((1, len(bare.poles))), deflection[number : number + 1], slope[number : number + 1]]
        dofs += [Dof(node, "+X"), Dof(node, "+Z"), Dof(node, "-RY")]
    shapes, poles = np.concatenate(rows).astype(complex), bare.poles
    if above is not None:
        # one mode for each joint and motion, of the flexibility phi^2/omega^2
        amplitudes = np.sqrt(flexibility_factor * np.stack([above.deflection, above.slope])).T * above.frequency
        extra = np.zeros((len(dofs), 2 * len(points)), complex)
        for number in range(len(points)):
            for motion in range(2):
                extra[len(bare.dofs) + 3 * number + 1 + motion, 2 * number + motion] = amplitudes[number, motion]
        shapes = np.hstack([shapes, extra])
        ratio = np.median(-bare.poles.real / np.abs(bare.poles))
        poles = np.append(poles, np.full(2 * len(points), above.frequency * (-ratio + 1j * np.sqrt(1 - ratio**2))))
    return _modal_host(bare, poles, shapes, tuple(dofs))


def _swaying(host: ModalModel, mass: float) -> ModalModel:
    """The host with its translation along the beam, of unit modal mass; on the suspension, as the lowest mode normal to
    the surface.
    """
    sway = np.array([dof.node >= FIRST_NODE and dof.axis == "X" for dof in host.dofs]) / np.sqrt(mass)
    lowest = host.poles[np.argmin(np.abs(host.poles))]
    return _modal_host(
        host, np.append(host.poles, lowest), np.column_stack([host.shapes, sway.astype(complex)]), host.dofs
    )


def _modal_host(
    bare: ModalModel,
    poles: Complex[np.ndarray, "mode"],
    shapes: Complex[np.ndarray, "dof mode"],
    dofs: tuple[Dof, ...],
) -> ModalModel:
    return ModalModel(
        poles,
        shapes,
        dofs,
        shapes / (2j * poles.imag),
        dofs,
        scaling="unit modal mass",
        condition=bare.condition,
        name=bare.name,
    )


def _joints(
    beam: FrictionBeam, joint: BoltedJoint, normal_force: float | Sequence[float] | Float[np.ndarray, "joint"]
) -> tuple[Joint, ...]:
    """The joints from the nodes of the host to those of the beam, with F_N [N] of every joint, or of each."""
    first = 1 if beam.overhang > 0 else 0
    forces = np.broadcast_to(np.asarray(normal_force, dtype=np.float64), (beam.joints,))
    return tuple(
        Joint(
            f"J{number + 1}",
            ((FIRST_NODE + number, first + number * ELEMENTS),),
            (joint.surface_height, 0.5 * beam.height),
            joint.law,
            float(force),
            joint.normal_stiffness,
            tangential_loss=joint.tangential_loss,
            normal_loss=joint.normal_loss,
            normal_exponent=joint.normal_exponent,
            contact_length=joint.contact_length,
        )
        for number, force in enumerate(forces)
    )
