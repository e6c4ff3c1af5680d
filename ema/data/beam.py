"""A structure with friction joints, as the simulator takes it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.modal import ModalModel
from ema.data.provenance import Provenance
from ema.dof import Dof
from ema.errors import InputError


@dataclass(frozen=True, repr=False)
class FrictionLaw(Container):
    """A tangential contact law by name and parameters.

    The tangential stiffness of the joint follows its normal force, k_T(F_N) = min(k_T (F_N / reference)^exponent, cap).

    Parameters
    ----------
    name : str
        Name of a law in ``ema.contact.catalogue`` (``masing``, ``iwan``, ``lugre`` ...), or of one registered by the
        user.
    friction_coefficient : float
        mu, slip force over normal force.
    contact_stiffness : float
        k_T of the whole joint [N/m] at ``reference_force`` (at any force with an exponent of 0).
    parameters : tuple of tuple of (str, float), optional
        Further numbers of the law, ``(name, value)``.
    stiffness_exponent : float, default 0.0
        Exponent of k_T(F_N).
    reference_force : float, default 1000.0
        Normal force [N] of the whole joint that ``contact_stiffness`` holds at.
    stiffness_cap : float, optional
        Largest k_T [N/m].
    isotropic : bool, default True
        In two directions, whether the slip force is a circle (true) or a box with one limit per direction.

    Examples
    --------
    >>> FrictionLaw("masing", friction_coefficient=0.4, contact_stiffness=2e7)
    FrictionLaw(name='masing', friction_coefficient=0.4, contact_stiffness=2e+07)
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
    name : str, default "linear"
        ``linear`` (a spring for pressure and tension alike), ``power`` (N ~ penetration^exponent, no tension), or
        ``curve`` (points of a measured or own curve, straight between them, no tension).
    exponent : float, default 1.0
        Exponent of the power law, 1 or more; 1 is the unilateral spring.
    reference_force : float, default 1000.0
        Normal force [N] of the whole joint at which the ``normal_stiffness`` of the joint is the slope of the power
        law.
    points : tuple of tuple of (float, float), optional
        Points of the curve, ascending: penetration [m] and normal force [N] of the whole joint; the slope of the last
        stretch goes on. The ``normal_stiffness`` of the joint is not used then.

    Examples
    --------
    >>> NormalContact("power", exponent=1.5)
    NormalContact(name='power', exponent=1.5)
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
    name : str
        Name of the joint.
    pairs : tuple of tuple of (int, int)
        ``(node of the host, node of the beam)``; the beam lies on the +Z side of the host.
    half_heights : tuple of (float, float)
        Distances [m] from the middle layers of host and beam to the interface.
    law : FrictionLaw
        Tangential contact law.
    normal_force : float
        F_N of the whole joint [N].
    normal_stiffness : float
        k_N of the whole joint [N/m]; that of a power law at its reference force.
    force_shares : array of shape (pair,), optional
        Share of each pair in the normal force, sum 1; that of the area by default.
    directions : tuple of str, default ('X',)
        Tangential directions, ``("X",)``, ``("Y",)`` or ``("X", "Y")``.
    area_shares : array of shape (pair,), optional
        Share of each pair in the contact area, hence in both contact stiffnesses, sum 1; equal by default.
    normal_contact : NormalContact, optional
        Law in the normal direction; by default a linear spring that also carries tension.
    area : float, optional
        Area of the whole contact [m^2], where known.
    tangential_loss, normal_loss : float, default 0.0
        Loss factors of the sticking contact in the two directions.
    normal_exponent : float, default 0.0
        Of a linear normal contact, exponent of k_N(F_N) = k_N (F_N / reference)^exponent with the reference force of
        the law.
    contact_length : float, default 0.0
        Length [m] along the first tangential direction over which a linear normal contact of one node pair is spread:
        it resists rocking with k_N l^2 / 12.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> joint = beam_model().joints[0]
    >>> joint.normal_force, joint.directions
    (100.0, ('X',))
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
        check_axes(self)


@dataclass(frozen=True, repr=False)
class Matrices(Container):
    """Mass and stiffness matrices and the DOFs of their rows.

    Parameters
    ----------
    mass : array of shape (n, n)
        Mass matrix [kg, kg m, kg m^2].
    stiffness : array of shape (n, n)
        Stiffness matrix [N/m, N, N m].
    dofs : tuple of Dof
        DOF of each row and column.

    Examples
    --------
    >>> Matrices(mass=np.eye(1), stiffness=np.array([[4e4]]), dofs=(Dof(1, "+X"),)).stiffness
    array([[40000.]])
    """

    mass: Float[np.ndarray, "n n"]
    stiffness: Float[np.ndarray, "n n"]
    dofs: tuple[Dof, ...]

    def __post_init__(self) -> None:
        freeze(self, mass=np.float64, stiffness=np.float64)
        check_axes(self)


@dataclass(frozen=True, repr=False)
class Damping(Container):
    """Background damping of a structure, without its joints.

    Parameters
    ----------
    ratio : float, default 0.0
        Modal damping ratio of every mode of the structure with stuck joints. It damps the sliding motion too, by more
        the stiffer the contacts.
    mass_factor : float, default 0.0
        Factor [1/s] of the mass matrix in the damping matrix.

    Examples
    --------
    >>> Damping(ratio=0.002)
    Damping(ratio=0.002)
    """

    ratio: float = 0.0
    mass_factor: float = 0.0


@dataclass(frozen=True, repr=False)
class BeamModel(Container):
    """A host structure, a friction beam, and the joints between them.

    Parameters
    ----------
    host : Matrices or ModalModel
        Matrices, or a measured modal model.
    beam : Matrices or None
        Matrices of the friction beam; its DOFs carry its part name, so that host and beam may use the same node
        numbers.
    joints : tuple of Joint
        Joints between host and beam.
    damping : Damping, optional
        Background damping.
    name : str, optional
        What the model is called in messages.
    pair_spacing : float, optional
        Distance [m] of neighbouring node pairs, where known.
    provenance : Provenance, optional
        Inputs, versions and options behind the model.
    beam_loss : float, default 0.0
        Loss factor of the material of the beam.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> model = beam_model()
    >>> model.with_normal_force(500.0).joints[0].normal_force
    500.0
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
        """Return the model with the same law in every joint.

        Parameters
        ----------
        law : FrictionLaw
            Tangential contact law.

        Returns
        -------
        BeamModel
            The model with that law.

        Examples
        --------
        >>> from ema.examples import beam_model
        >>> law = FrictionLaw("coulomb", friction_coefficient=0.3, contact_stiffness=1e6)
        >>> beam_model().with_law(law).joints[0].law.name
        'coulomb'
        """
        return replace(self, joints=tuple(replace(joint, law=law) for joint in self.joints))

    def with_normal_contact(self, contact: NormalContact) -> "BeamModel":
        """Return the model with the same normal contact in every joint.

        Parameters
        ----------
        contact : NormalContact
            Law in the normal direction.

        Returns
        -------
        BeamModel
            The model with that contact.

        Examples
        --------
        >>> from ema.examples import beam_model
        >>> beam_model().with_normal_contact(NormalContact("power", exponent=2.0)).joints[0].normal_contact.exponent
        2.0
        """
        return replace(self, joints=tuple(replace(joint, normal_contact=contact) for joint in self.joints))

    def with_normal_force(self, force: float | Sequence[float]) -> "BeamModel":
        """Return the model with another normal force in its joints.

        Parameters
        ----------
        force : float or sequence of float
            F_N of every joint [N]: one number for all, or one per joint.

        Returns
        -------
        BeamModel
            The model with that force.

        Raises
        ------
        InputError
            If the forces are neither one nor as many as the joints.

        Examples
        --------
        >>> from ema.examples import beam_model
        >>> beam_model().with_normal_force([250.0]).joints[0].normal_force
        250.0
        """
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
