"""From a BeamModel to one set of matrices with its contacts; and the double beam."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from ema.data import BeamModel, Damping, Finding, FrictionLaw, Joint, Matrices, NormalContact
from ema.dof import Dof, match
from ema.errors import InputError
from ema.simulate.contact import NormalPairs, normal_pairs, press, resting
from ema.simulate.friction import check_isotropic
from ema.simulate.interface import Parts, normal_rows, rocking_rows, tangential_rows
from ema.simulate.modal_host import ModalCoordinates, modal_coordinates

RIGID_FACTOR = 1000.0
"""Stiffness of the spring that stands for rigid friction, over that of the structure that holds the contact."""
_SPRING = FrictionLaw("masing", 1.0, 1.0)
"""What stands in the list of laws for a normal contact: a spring that never slides."""


@dataclass(frozen=True)
class Contacts:
    """Every contact (one node pair in one direction) of a model: what the solvers work on.

    ``slip`` (contact, n) maps the DOFs on the relative displacement u; ``stiffness`` N/m and ``limits`` N (contact,);
    ``joint`` the number of the joint of each contact; ``partner`` the contact of the same pair in the other direction
    of an isotropic law, else -1; ``friction`` the slip force of a contact over the normal force of its joint.

    The normal contacts that part or stiffen follow as the last ``normals`` rows, linearised at rest: u is the opening
    of the gap, k its stiffness, the limit infinite. ``normal_of`` is the one of them that presses each contact, counted
    from the first, or -1.
    """

    slip: Float[np.ndarray, "contact n"]
    stiffness: Float[np.ndarray, "contact"]
    limits: Float[np.ndarray, "contact"]
    joint: tuple[int, ...]
    partner: tuple[int, ...]
    laws: tuple[FrictionLaw, ...]
    friction: Float[np.ndarray, "contact"]
    normals: int = 0
    normal_of: tuple[int, ...] = ()

    @property
    def tangential(self) -> int:
        """Number of friction contacts."""
        return len(self.joint) - self.normals


@dataclass(frozen=True)
class System:
    """Matrices of the whole structure with normal, but without tangential coupling.

    The coordinates are the DOFs, or modes of a measured host followed by the DOFs of the beam: ``reach`` (dof,
    coordinate) leads from them to the DOFs, ``None`` where they are the same. ``decay`` (coordinate,) in 1/s is the
    damping a measured host brings; ``loss`` (coordinate, coordinate) in N/m holds the stiffnesses of sticking joints
    times their loss factors. ``spacing`` is the distance of neighbouring node pairs in m, infinite where unknown.
    ``normals`` are the node pairs in the normal direction, at rest under their preload; ``rocking`` holds rows and
    stiffnesses in N m of normal springs that are spread over a length.
    """

    mass: Float[np.ndarray, "n n"]
    stiffness: Float[np.ndarray, "n n"]
    dofs: tuple[Dof, ...]
    contacts: Contacts
    damping: Damping
    normals: NormalPairs
    spacing: float = float("inf")
    findings: tuple[Finding, ...] = ()
    name: str = ""
    reach: Float[np.ndarray, "dof n"] | None = None
    decay: Float[np.ndarray, "n"] | None = None
    loss: Float[np.ndarray, "n n"] | None = None
    rocking: tuple[Float[np.ndarray, "spring n"], Float[np.ndarray, "spring"]] | None = None

    def row(self, dof: Dof | str) -> Float[np.ndarray, "n"]:
        """Row of a DOF in the coordinates.

        Raises
        ------
        InputError : the structure has no such DOF.
        """
        wanted = Dof.parse(dof)
        found = match([wanted], self.dofs)
        if not found:
            raise InputError(
                "the structure has no such DOF",
                where=self.name,
                got=str(wanted),
                expected=f"one of its {len(self.dofs)} DOFs such as {self.dofs[0]} or {self.dofs[-1]}",
            )
        row = np.zeros(len(self.dofs))
        row[found[0][1]] = found[0][2]
        return row if self.reach is None else row @ self.reach


def pair_areas(joint: Joint) -> Float[np.ndarray, "pair"]:
    """Share of every node pair in the contact area of a joint."""
    count = len(joint.pairs)
    return np.full(count, 1 / count) if joint.area_shares is None else np.asarray(joint.area_shares)


def pair_forces(joint: Joint) -> Float[np.ndarray, "pair"]:
    """Normal force of every node pair of a joint in N."""
    shares = pair_areas(joint) if joint.force_shares is None else joint.force_shares
    return joint.normal_force * np.asarray(shares)


def pair_stiffness(joint: Joint, forces: Float[np.ndarray, "pair"] | None = None) -> Float[np.ndarray, "pair"]:
    """Tangential contact stiffness of every node pair of a joint in N/m, from its normal forces at rest.

    The power law k_T(F_N) with its cap holds for the pressure of the pair: its normal force over its share of the area
    takes the place of the force of the joint; a pair that is open at rest keeps a millionth of it.
    """
    law, areas = joint.law, pair_areas(joint)
    if law.stiffness_exponent == 0:
        return areas * min(law.contact_stiffness, law.stiffness_cap)
    pressed = pair_forces(joint) if forces is None else forces
    ratio = np.maximum(pressed / areas / law.reference_force, 1e-6)
    return np.asarray(areas * np.minimum(law.contact_stiffness * ratio**law.stiffness_exponent, law.stiffness_cap))


def _check_joint(joint: Joint) -> None:
    law, pairs = joint.law, joint.pairs

    def refuse(wrong: Any, what: str, got: object, expected: str, advice: str = "") -> None:
        if wrong:
            raise InputError(what, where=f"joint {joint.name}", got=got, expected=expected, advice=advice)

    refuse(
        not pairs,
        "a joint without contact pairs",
        "0 pairs",
        "at least one (host node, beam node)",
        "list the node pairs, or leave the joint out for a structure without friction",
    )
    refuse(
        not 0 <= joint.normal_force < np.inf,
        "not a normal force",
        f"{joint.normal_force} N",
        "0 N or more",
        "pressing is positive; a joint that is open has 0 N",
    )
    springs = f"{joint.normal_stiffness} N/m"
    refuse(not 0 < joint.normal_stiffness < np.inf, "not a normal stiffness", springs, "a positive number")
    for name in ("tangential_loss", "normal_loss"):
        loss = getattr(joint, name)
        refuse(not 0 <= loss < 1, "not a loss factor", f"{name} = {loss}", "0 or more, below 1")
    length = f"{joint.contact_length} m"
    refuse(not 0 <= joint.contact_length < np.inf, "not a contact length", length, "0 m or more")
    refuse(
        joint.contact_length and (len(pairs) > 1 or joint.normal_contact != NormalContact()),
        "a contact length where node pairs or the normal law describe the contact",
        f"{len(pairs)} pairs, {joint.normal_contact}",
        "one pair and a linear normal spring",
    )
    refuse(
        not 0 <= law.friction_coefficient < np.inf,
        "not a friction coefficient",
        law.friction_coefficient,
        "mu of 0 or more",
        "the direction of friction follows from the motion, mu has no sign",
    )
    refuse(
        not law.contact_stiffness > 0 or (np.isinf(law.contact_stiffness) and law.name != "coulomb"),
        "not a tangential contact stiffness",
        f"{law.contact_stiffness} N/m",
        "a positive finite number",
        "for rigid contact use ema.simulate.Coulomb",
    )
    refuse(
        not 0 <= law.stiffness_exponent < np.inf,
        "not an exponent of k_T(F_N)",
        law.stiffness_exponent,
        "0 (constant) or more, usually 0.3 to 0.9",
    )
    reference, cap = f"{law.reference_force} N", f"{law.stiffness_cap} N/m"
    refuse(not 0 < law.reference_force < np.inf, "not a reference force of k_T(F_N)", reference, "above 0 N")
    refuse(not law.stiffness_cap > 0, "not a cap of k_T(F_N)", cap, "above 0 N/m")
    heights = f"{joint.half_heights} m"
    refuse(not np.all(np.isfinite(joint.half_heights)), "not distances to the interface", heights, "two finite numbers")
    for name, shares in (("normal force", joint.force_shares), ("area", joint.area_shares)):
        if shares is not None:
            fits = shares.shape == (len(pairs),)
            refuse(not fits, f"shares of the {name} do not fit", shares.shape, f"{len(pairs)}, one per pair")
            fits = bool(np.all(np.isfinite(shares) & (shares >= 0))) and abs(shares.sum() - 1) <= 1e-9
            got = f"sum {shares.sum():g}, least {shares.min():g}"
            refuse(not fits, f"not shares of the {name}", got, "0 or more, sum 1")


def check_matrices(matrices: Matrices, where: str) -> None:
    """Refuse matrices that are no structure.

    Raises
    ------
    InputError : not finite, not symmetric, an indefinite mass or stiffness.
    """
    for name, matrix in (("mass", matrices.mass), ("stiffness", matrices.stiffness)):
        if matrix.shape != (len(matrices.dofs),) * 2:
            raise InputError(
                f"the {name} matrix does not fit its DOFs",
                where=where,
                got=matrix.shape,
                expected=f"{len(matrices.dofs)} rows and columns",
            )
        if not np.all(np.isfinite(matrix)):
            raise InputError(
                f"the {name} matrix holds NaN or infinity",
                where=where,
                got=f"{np.sum(~np.isfinite(matrix))} such entries",
                expected="numbers",
                advice="export it again",
            )
        unequal = np.abs(matrix - matrix.T).max()
        if unequal > 1e-9 * np.abs(matrix).max():
            raise InputError(
                f"the {name} matrix is not symmetric",
                where=where,
                got=f"difference {unequal:g}",
                expected="equal to its transpose",
                advice="export the full matrix",
            )
        if _surely_positive(matrix, 0.0 if name == "mass" else 1e-9 * float(np.diag(matrix).max())):
            continue
        lowest = np.linalg.eigvalsh(matrix)[[0, -1]]
        if lowest[0] < -1e-9 * lowest[1] or (name == "mass" and lowest[0] <= 0):
            raise InputError(
                f"the {name} matrix is not positive",
                where=where,
                got=f"lowest eigenvalue {lowest[0]:g}",
                expected="a positive definite mass and a stiffness without negative eigenvalues",
                advice="check the units and the sign of the exported matrices",
            )


def _surely_positive(matrix: np.ndarray, shift: float) -> bool:
    """Whether all eigenvalues are above -``shift``, by a factorisation, which is much quicker than the eigenvalues."""
    try:
        np.linalg.cholesky(matrix + shift * np.eye(len(matrix)))
    except np.linalg.LinAlgError:
        return False
    return True


def assemble(model: BeamModel) -> System:
    """Assemble the matrices of a model, with normal springs in place and the tangential contacts listed beside them.

    Parameters
    ----------
    model : BeamModel
        The model.

    Returns
    -------
    System
        Matrices, contacts and their DOFs.

    Raises
    ------
    InputError
        If a joint or a matrix is not physical, or a DOF that a joint needs is missing.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> len(assemble(beam_model()).dofs)
    6
    """
    if not model.joints:
        raise InputError(
            "a model without joints", where=model.name, got="0 contact pairs", expected="at least one joint"
        )
    for joint in model.joints:
        _check_joint(joint)
    host = model.host if isinstance(model.host, Matrices) else modal_coordinates(model.host)
    beam_part = [] if model.beam is None else [model.beam]
    for part, matrices in zip(("host", "beam"), [host, *beam_part], strict=False):
        if isinstance(matrices, Matrices):
            check_matrices(matrices, f"{model.name} {part}".strip())
    dofs = tuple(dof for matrices in (host, *beam_part) for dof in matrices.dofs)
    mass, stiffness = (block_diag(*(getattr(p, name) for p in (host, *beam_part))) for name in ("mass", "stiffness"))
    reach, decay = None, None
    if isinstance(host, ModalCoordinates):
        beam_size = len(dofs) - len(host.dofs)
        reach = block_diag(host.shapes, np.eye(beam_size))
        decay = np.concatenate([host.decay, np.zeros(beam_size)])
    split = len(model.host.dofs) if model.beam is not None else 0
    parts = (dofs[: len(model.host.dofs)], dofs[split:], split, len(dofs))
    normals = _normals(model, parts, reach)
    bound = normals.rows[normals.elastic]
    stiffness = stiffness + bound.T @ (bound * normals.stiffness[normals.elastic][:, None])
    rocking = _rocking(model, parts, reach, normals)
    if rocking is not None:
        stiffness = stiffness + rocking[0].T @ (rocking[0] * rocking[1][:, None])
    normals = press(normals, mass, stiffness, model.name)
    contacts = _contacts(model, parts, reach, normals)
    held, findings = _rigid_contacts(contacts, mass, stiffness, model.name)
    findings_of_host = () if isinstance(host, Matrices) else host.findings
    return System(
        mass,
        stiffness,
        dofs,
        held,
        model.damping,
        normals,
        _spacing(model),
        (*findings, *findings_of_host, *resting(normals, model.name).findings),
        model.name,
        reach,
        decay,
        _loss(model, held, normals),
        rocking,
    )


def _normals(model: BeamModel, parts: Parts, reach: np.ndarray | None) -> NormalPairs:
    gaps = np.vstack([normal_rows(joint, parts) for joint in model.joints])
    areas, preloads = (np.concatenate([share(joint) for joint in model.joints]) for share in (pair_areas, pair_forces))
    return normal_pairs(model.joints, gaps if reach is None else gaps @ reach, areas, preloads)


def _contacts(model: BeamModel, parts: Parts, reach: np.ndarray | None, normals: NormalPairs) -> Contacts:
    """Friction contacts of all joints in all directions, then the normal contacts that are followed."""
    slips: list[np.ndarray] = []
    limits: list[float] = []
    springs: list[float] = []
    shares: list[float] = []
    joints: list[int] = []
    partners: list[int] = []
    pressed_by: list[int] = []
    laws: list[FrictionLaw] = []
    place_of = np.where(normals.elastic, -1, np.cumsum(~normals.elastic) - 1)
    pair = 0
    for number, joint in enumerate(model.joints):
        first, count = len(limits), len(joint.pairs)
        part = slice(pair, pair + count)
        both = len(joint.directions) == 2 and joint.law.isotropic
        if both:
            check_isotropic(joint.law, f"joint {joint.name}")
        forces, friction = normals.forces[part], joint.law.friction_coefficient
        for place, direction in enumerate(joint.directions):
            slips.append(tangential_rows(joint, direction, parts))
            limits += list(friction * forces)
            shares += list(friction * pair_forces(replace(joint, normal_force=1.0)))
            springs += list(pair_stiffness(joint, forces))
            joints += [number] * count
            laws += [joint.law] * count
            other = first + (1 - place) * count
            partners += [other + k if both else -1 for k in range(count)]
            pressed_by += list(place_of[part])
        pair += count
    followed = normals.followed
    slip = np.vstack(slips) if reach is None else np.vstack(slips) @ reach
    count = len(followed)
    owner = np.repeat(np.arange(len(model.joints)), [len(joint.pairs) for joint in model.joints])
    return Contacts(
        np.vstack([slip, normals.rows[followed]]),
        np.append(springs, normals.stiffness[followed]),
        np.append(limits, np.full(count, np.inf)),
        (*joints, *owner[followed].tolist()),
        (*partners, *[-1] * count),
        (*laws, *[_SPRING] * count),
        np.append(shares, np.full(count, np.inf)),
        count,
        (*map(int, pressed_by), *[-1] * count),
    )


def _rocking(
    model: BeamModel, parts: Parts, reach: np.ndarray | None, normals: NormalPairs
) -> tuple[Float[np.ndarray, "spring n"], Float[np.ndarray, "spring"]] | None:
    """What linear normal springs spread over a length add: k_N l^2 / 12 between the rotations of host and beam."""
    rows, springs, pair = list[np.ndarray](), list[np.ndarray](), 0
    for joint in model.joints:
        count = len(joint.pairs)
        if joint.contact_length:
            rows.append(rocking_rows(joint, parts))
            springs.append(normals.stiffness[pair : pair + count] * joint.contact_length**2 / 12)
        pair += count
    if not rows:
        return None
    turned = np.vstack(rows)
    return turned if reach is None else turned @ reach, np.concatenate(springs)


def _loss(model: BeamModel, contacts: Contacts, normals: NormalPairs) -> Float[np.ndarray, "n n"] | None:
    """Stiffness of the beam and of every contact at rest times its loss factor; ``None`` where nothing has one."""
    own = None
    if model.beam is not None and model.beam_loss:
        size, count = contacts.slip.shape[1], len(model.beam.dofs)
        own = np.zeros((size, size))
        own[size - count :, size - count :] = model.beam_loss * model.beam.stiffness
    if not any(joint.tangential_loss or joint.normal_loss for joint in model.joints):
        return own
    tangential = np.array([model.joints[number].tangential_loss for number in contacts.joint[: contacts.tangential]])
    slip, springs = contacts.slip[: contacts.tangential], contacts.stiffness[: contacts.tangential]
    normal = np.repeat([joint.normal_loss for joint in model.joints], [len(joint.pairs) for joint in model.joints])
    rows, pressed = normals.rows, normals.stiffness
    lossy = slip.T @ ((tangential * springs)[:, None] * slip) + rows.T @ ((normal * pressed)[:, None] * rows)
    return np.asarray(lossy if own is None else lossy + own)


def pair_counts(model: BeamModel, system: System) -> list[int]:
    """Number of node pairs that share the joint of every contact."""
    return [len(model.joints[number].pairs) for number in system.contacts.joint]


def _rigid_contacts(
    contacts: Contacts, mass: np.ndarray, stiffness: np.ndarray, where: str
) -> tuple[Contacts, tuple[Finding, ...]]:
    """Give contacts of rigid friction a finite spring, 1000 times as stiff as the structure that holds them."""
    rigid = ~np.isfinite(contacts.stiffness)
    if not rigid.any():
        return contacts, ()
    slip, normals = contacts.slip[rigid], slice(contacts.tangential, None)
    closed = contacts.slip[normals]
    stiffness = stiffness + closed.T @ (closed * contacts.stiffness[normals][:, None])
    shift = 1e-9 * np.trace(stiffness) / np.trace(mass)
    own = 1 / np.diag(slip @ np.linalg.solve(stiffness + shift * mass, slip.T))
    chosen = RIGID_FACTOR * float(own.max())
    finding = Finding(
        "info",
        "rigid-friction",
        where,
        f"rigid friction is computed with {chosen:.2e} N/m per contact.",
        chosen,
        None,
        "Give stick_stiffness to choose another.",
    )
    return replace(contacts, stiffness=np.where(rigid, chosen, contacts.stiffness)), (finding,)


def _spacing(model: BeamModel) -> float:
    return model.pair_spacing if model.pair_spacing is not None else float("inf")
