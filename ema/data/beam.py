"""A structure with friction joints: what the simulator is told."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from ema.data._arrays import freeze
from ema.data._summary import Container
from ema.data.modal import ModalModel
from ema.data.provenance import Provenance
from ema.dof import Dof
from ema.errors import InputError


@dataclass(frozen=True, repr=False)
class FrictionLaw(Container):
    """A tangential contact law by name and parameters.

    Parameters
    ----------
    name : of a law in ``ema.contact.catalogue`` (``masing``, ``iwan``, ``lugre`` ...), or of a user's own.
    friction_coefficient : mu, slip force over normal force.
    contact_stiffness : k_T of the whole joint in N/m at ``reference_force`` (at any force with exponent 0).
    stiffness_exponent, reference_force, stiffness_cap : k_T(F_N) = k_T (F_N / reference)^exponent, never above the cap;
        forces in N of the whole joint, cap in N/m.
    parameters : further numbers of the law, ``(name, value)``.
    isotropic : in two directions, whether the slip force is a circle (true) or a box with one limit per direction.
    """

    name: str
    friction_coefficient: float
    contact_stiffness: float
    parameters: tuple[tuple[str, float], ...] = ()
    stiffness_exponent: float = 0.0
    reference_force: float = 1000.0
    stiffness_cap: float = float("inf")
    isotropic: bool = True


@dataclass(frozen=True, repr=False)
class NormalContact(Container):
    """How the surfaces of a joint resist being pressed together, by name and parameters.

    Parameters
    ----------
    name : ``linear`` (a spring for pressure and tension alike), ``power`` (N ~ penetration^exponent, no tension), or
        ``curve`` (points of a measured or own curve, straight between them, no tension).
    exponent : of the power law, 1 or more; 1 is the unilateral spring.
    reference_force : N of the whole joint at which the ``normal_stiffness`` of the joint is the slope of the power law.
    points : of the curve: penetration in m and normal force in N of the whole joint, ascending; the slope of the last
        stretch goes on. The ``normal_stiffness`` of the joint is not used then.
    """

    name: str = "linear"
    exponent: float = 1.0
    reference_force: float = 1000.0
    points: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, repr=False)
class Joint(Container):
    """Node pairs of host and friction beam that are pressed together.

    Parameters
    ----------
    pairs : ``(node of the host, node of the beam)``; the beam lies on the +Z side of the host.
    half_heights : distances in m from the middle layers of host and beam to the interface.
    normal_force : F_N of the whole joint in N.
    normal_stiffness : of the whole joint in N/m; that of a power law at its reference force.
    force_shares : share of each pair in the normal force, shape (pair,), sum 1; that of the area by default.
    directions : tangential directions, ``("X",)``, ``("Y",)`` or ``("X", "Y")``.
    area_shares : share of each pair in the contact area, hence in both contact stiffnesses, shape (pair,), sum 1; equal
        by default.
    normal_contact : the law in the normal direction; by default a linear spring that also carries tension.
    area : of the whole contact in m^2, where known.
    tangential_loss, normal_loss : loss factors of the sticking contact in the two directions.
    normal_exponent : of a linear normal contact, k_N(F_N) = k_N (F_N / reference)^exponent with the law's reference
        force.
    contact_length : m along the first tangential direction over which a linear normal contact of one node pair is
        spread: it resists rocking with k_N l^2 / 12.
    """

    name: str
    pairs: tuple[tuple[int, int], ...]
    half_heights: tuple[float, float]
    law: FrictionLaw
    normal_force: float
    normal_stiffness: float
    force_shares: Float[np.ndarray, "pair"] | None = None
    directions: tuple[str, ...] = ("X",)
    area_shares: Float[np.ndarray, "pair"] | None = None
    normal_contact: NormalContact = NormalContact()
    area: float | None = None
    tangential_loss: float = 0.0
    normal_loss: float = 0.0
    normal_exponent: float = 0.0
    contact_length: float = 0.0

    def __post_init__(self) -> None:
        freeze(self, force_shares=np.float64, area_shares=np.float64)


@dataclass(frozen=True, repr=False)
class Matrices(Container):
    """Mass (kg, kg m^2) and stiffness (N/m, N m) matrices, shape (n, n), and the DOFs of their rows."""

    mass: Float[np.ndarray, "n n"]
    stiffness: Float[np.ndarray, "n n"]
    dofs: tuple[Dof, ...]

    def __post_init__(self) -> None:
        freeze(self, mass=np.float64, stiffness=np.float64)


@dataclass(frozen=True, repr=False)
class Damping(Container):
    """Background damping, without the joints.

    ``ratio`` is the modal damping ratio of every mode of the structure with stuck joints; ``mass_factor`` in 1/s
    multiplies the mass matrix.
    """

    ratio: float = 0.0
    mass_factor: float = 0.0


@dataclass(frozen=True, repr=False)
class BeamModel(Container):
    """A host structure, a friction beam, and the joints between them.

    ``host`` is given by matrices or is a measured modal model; ``beam`` by matrices. DOFs of the beam carry its part
    name, so that host and beam may use the same node numbers. ``pair_spacing`` is the distance of neighbouring node
    pairs in m, where known. ``beam_loss`` is the loss factor of the beam's material.
    """

    host: Matrices | ModalModel
    beam: Matrices | None
    joints: tuple[Joint, ...]
    damping: Damping = Damping()
    name: str = ""
    pair_spacing: float | None = None
    provenance: Provenance = field(default=Provenance(), compare=False)
    beam_loss: float = 0.0

    def with_law(self, law: FrictionLaw) -> "BeamModel":
        """The model with the same law in every joint."""
        return replace(self, joints=tuple(replace(joint, law=law) for joint in self.joints))

    def with_normal_contact(self, contact: NormalContact) -> "BeamModel":
        """The model with the same normal contact in every joint."""
        return replace(self, joints=tuple(replace(joint, normal_contact=contact) for joint in self.joints))

    def with_normal_force(self, force: float | Sequence[float]) -> "BeamModel":
        """The model with the normal force of every joint (one number for all, or one per joint) in N."""
        if np.shape(force) not in ((), (1,), (len(self.joints),)):
            raise InputError(
                "the normal forces do not fit the joints",
                where=self.name,
                got=f"{len(np.ravel(force))}",
                expected=f"one, or one for each of {len(self.joints)} joints",
            )
        forces = np.broadcast_to(np.asarray(force, dtype=np.float64), (len(self.joints),))
        joints = tuple(replace(joint, normal_force=float(f)) for joint, f in zip(self.joints, forces, strict=True))
        return replace(self, joints=joints)
