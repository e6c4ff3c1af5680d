"""The full model of a measured structure with several friction beams that act at the same time."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from ema.data import BeamModel, Joint, Matrices, ModalModel
from ema.data.placement import Candidates
from ema.dof import Dof
from ema.errors import InputError
from ema.place.model import FIRST_NODE, model_at
from ema.place.task import Task
from ema.shapes import mass_of


class PressedInProportion(BeamModel):
    """A model whose joints keep the proportions of their normal forces.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> model = beam_model()
    >>> same = PressedInProportion(model.host, model.beam, model.joints)
    >>> same.with_normal_force(500.0).joints[0].normal_force
    500.0
    """

    def with_normal_force(self, force: float | Sequence[float]) -> BeamModel:
        """Return the model with another normal force in its joints.

        Parameters
        ----------
        force : float or sequence of float
            F_N [N] of the first joint, which the others follow in proportion, also where one equal force is given per
            joint; or unequal forces, one per joint.

        Returns
        -------
        BeamModel
            The model with these forces, of the same proportions from then on.

        Examples
        --------
        >>> from ema.examples import beam_model
        >>> model = beam_model()
        >>> PressedInProportion(model.host, model.beam, model.joints).with_normal_force([250.0]).joints[0].normal_force
        250.0
        """
        given = np.asarray(force, dtype=np.float64)
        if given.ndim and np.ptp(given) > 0:
            return super().with_normal_force(force)
        before = np.array([joint.normal_force for joint in self.joints])
        return super().with_normal_force((float(given.flat[0]) * before / before[0]).tolist())


def beams_model(
    task: Task, beams: Sequence[Candidates], normal_forces: Sequence[float] | Float[np.ndarray, "beam"]
) -> BeamModel:
    """Return the model of a measured host with several beams, each the first candidate of its own.

    Each beam is that of ``model_at``: its joints, its sections, and the flexibility of the modes above those known at
    its joints. The measured modes are common to all beams, and so are both translations in its own plane of a host
    that hangs freely. What the modes above those known transmit from one joint to another is left out, as between the
    joints of one beam.

    Parameters
    ----------
    task : Task
        Structure and joint.
    beams : sequence of Candidates
        One location for each beam.
    normal_forces : sequence of float or array of shape (beam,)
        F_N per joint [N] of each beam.

    Returns
    -------
    BeamModel
        Host, beams (as one part) and all joints; a normal force for all is that of the first beam, and the others
        follow it in proportion.

    Raises
    ------
    InputError
        If the beams differ in the loss factor of their material.

    Examples
    --------
    >>> from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
    >>> from ema.examples import plate
    >>> from ema.place import Task, grid
    >>> from ema.place.task import only
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> surface = smooth(bare, geometry)
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003)
    >>> spots = grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.1, angles=[0.0])
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([50.0]), modes=(0,))
    >>> model = beams_model(task, [only(spots, [0]), only(spots, [6])], [50.0, 80.0])
    >>> [part.normal_force for part in model.with_normal_force(100.0).joints]
    [100.0, 100.0, 160.0, 160.0]
    """
    singles = [model_at(task, here, 0, float(force)) for here, force in zip(beams, normal_forces, strict=True)]
    losses = sorted({(beam.loss, beam.loss_std) for beam in (here.catalogue[int(here.beams[0])] for here in beams)})
    if len(losses) > 1:
        raise InputError(
            "beams of different materials act together",
            where="beams",
            got="; ".join(f"loss {loss:g}, loss_std {std:g}" for loss, std in losses),
            expected="one loss factor, with one uncertainty, for all",
            advice="give the beams of the recipe one loss and loss_std, or leave them out",
        )
    inertia, stiffness, dofs, joints = [], [], list[Dof](), list[Joint]()
    nodes = 0
    for single in singles:
        part = single.beam
        assert part is not None
        inertia.append(part.mass)
        stiffness.append(part.stiffness)
        dofs += [replace(dof, node=dof.node + nodes) for dof in part.dofs]
        for joint in single.joints:
            ((_, node),) = joint.pairs
            number = len(joints)
            joints.append(replace(joint, name=f"J{number + 1}", pairs=((FIRST_NODE + number, node + nodes),)))
        nodes += len(part.dofs) // 3
    return PressedInProportion(
        _host(task, beams, [single.host for single in singles]),
        Matrices(block_diag(*inertia), block_diag(*stiffness), tuple(dofs)),
        tuple(joints),
        singles[0].damping,
        name=f"{len(beams)} beams",
        beam_loss=losses[0][0],
    )


def _host(task: Task, beams: Sequence[Candidates], hosts: Sequence[BeamModel | ModalModel | Matrices]) -> ModalModel:
    """The measured modes with the joints of all beams, modes of the flexibility above at each, and the translations."""
    known, points = len(task.bare.poles), len(task.bare.dofs)
    mass = mass_of(task.bare, task.surface) if task.in_plane == "free" else None
    rows, dofs, poles = [np.real(task.bare.shapes)], list(task.bare.dofs), [task.bare.poles]
    local, translations = list[np.ndarray](), list[np.ndarray]()
    for here, host in zip(beams, hosts, strict=True):
        assert isinstance(host, ModalModel)
        own = np.real(host.shapes)[points:]
        above = slice(known, own.shape[1] - (mass is not None))
        rows.append(own[:, :known])
        local.append(own[:, above])
        poles.append(host.poles[above])
        first = FIRST_NODE + (len(dofs) - points) // 3
        dofs += [replace(dof, node=dof.node - FIRST_NODE + first) for dof in host.dofs[points:]]
        if mass is not None:
            along = np.array([dof.axis == "X" for dof in host.dofs[points:]]) / np.sqrt(mass)
            angle = float(here.angles[0])
            translations.append(np.outer(along, [np.cos(angle), np.sin(angle)]))
    # nothing of the flexibility above is seen at the measured points, and none of it is common to two beams
    unseen = np.zeros((points, sum(part.shape[1] for part in local)))
    shapes = np.hstack([np.concatenate(rows), np.concatenate([unseen, block_diag(*local)])])
    if mass is not None:
        shapes = np.hstack([shapes, np.concatenate([np.zeros((points, 2)), *translations])])
        poles.append(np.full(2, task.bare.poles[np.argmin(np.abs(task.bare.poles))]))
    values, every = shapes.astype(complex), np.concatenate(poles)
    return ModalModel(
        every,
        values,
        tuple(dofs),
        values / (2j * every.imag),
        tuple(dofs),
        scaling="unit modal mass",
        condition=task.bare.condition,
        name=task.bare.name,
    )
