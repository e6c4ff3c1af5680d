"""Contacts that depend on each other, as the laws take them; and what the normal contacts went through."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ema.contact.laws import Couplings
from ema.data import ContactPressure, Finding
from ema.errors import InputError
from ema.simulate.contact import resting
from ema.simulate.structure import System


def couplings(system: System) -> Couplings | None:
    """What the contacts of a system share, or ``None`` where each stands alone."""
    contacts, first = system.contacts, system.contacts.tangential
    if not contacts.normals and max(contacts.partner) < 0:
        return None
    friction = np.array([law.friction_coefficient for law in contacts.laws])
    pressed_by = np.array([first + n if n >= 0 else -1 for n in contacts.normal_of] or [-1] * first)
    curve = system.normals.curve if system.normals.curve.size else np.zeros((3, 2))
    normals = np.ascontiguousarray(system.normals.table[system.normals.followed])
    return Couplings(np.array(contacts.partner), pressed_by, friction, normals, curve)


def refuse_joined(system: System, plane: bool, normal: bool) -> None:
    """Refuse a model whose contacts hang together, unless the solver follows friction in a ``plane`` or ``normal``
    forces that change.

    Raises
    ------
    InputError : as said.
    """
    if system.contacts.normals and not normal:
        raise InputError(
            "this solver does not follow normal contact that parts or stiffens",
            where=system.name,
            got=f"{system.contacts.normals} such pairs",
            expected="linear normal contact",
            advice="use ema.simulate.snapback, or respond without normal_forces",
        )
    if max(system.contacts.partner) >= 0 and not plane:
        raise InputError(
            "this solver has no isotropic friction in two directions",
            where=system.name,
            got="directions X and Y",
            expected="one direction, or a law with isotropic=False",
            advice="use ema.simulate.snapback or respond",
        )


def kept_at_rest(system: System) -> Float[np.ndarray, "normal 5"]:
    """What the kernels gather of every normal contact, before the first step: least and greatest force, steps open,
    the first of them, and the widest opening then."""
    forces = system.normals.forces[system.normals.followed]
    return np.stack([forces, forces, *np.zeros((2, len(forces))), np.full(len(forces), -np.inf)], axis=1)


def pressure(
    system: System,
    kept: Float[np.ndarray, "normal 5"],
    steps: int,
    step: float,
    openings: Float[np.ndarray, "sample pair"],
) -> ContactPressure:
    """Normal forces over a motion, with a finding where pairs parted.

    ``kept`` as the kernel gathers it over ``steps`` steps of ``step`` s; ``openings`` of all gaps in m.
    """
    from ema.contact.normal_kernels import PENETRATION

    rest, pairs = resting(system.normals, system.name), system.normals
    bound, follow = pairs.elastic, pairs.followed
    forces = pairs.preloads - pairs.stiffness * openings
    least, greatest = forces.min(axis=0), forces.max(axis=0)
    open_time, first, gap = np.zeros(len(least)), np.full(len(least), np.nan), rest.widest_gap.copy()
    least[follow], greatest[follow] = kept[:, 0], kept[:, 1]
    open_time[follow] = kept[:, 2] / max(steps, 1)
    gap[follow] = np.maximum(kept[:, 4] - pairs.table[follow, PENETRATION], gap[follow])
    first[follow] = np.where(kept[:, 2] > 0, kept[:, 3] * step, np.nan)
    moved = replace(rest, least=least, greatest=greatest, open_time=open_time, first_opening=first, widest_gap=gap)
    return replace(moved, findings=(*_parting(moved, system.name), *_tension(moved, bound, system.name)))


def _names(moved: ContactPressure, places: np.ndarray) -> str:
    return ", ".join(f"{moved.joints[i]} {moved.pairs[i]}" for i in places[:3]) + (" ..." if len(places) > 3 else "")


def _parting(moved: ContactPressure, where: str) -> list[Finding]:
    out = np.flatnonzero(moved.open_time > 0)
    if not len(out):
        return []
    longest, first = out[np.argmax(moved.open_time[out])], float(moved.first_opening[out].min())
    return [
        Finding(
            "warning",
            "lift-off",
            where,
            f"{len(out)} of {len(moved.pairs)} pairs part ({_names(moved, out)}), first at {first:.3g} "
            "s; the gap reaches "
            f"{moved.widest_gap[out].max():.1e} m, and {moved.pairs[longest]} is open for "
            f"{moved.open_time[longest]:.0%} "
            "of the time.",
            float(moved.widest_gap[out].max()),
            0.0,
            "Press harder there, or read the result as one of a rattling joint.",
        )
    ]


def _tension(moved: ContactPressure, bound: np.ndarray, where: str) -> list[Finding]:
    """Linear springs that pull: a real joint would part."""
    out = np.flatnonzero(bound & (moved.least < 0) & (moved.preloads > 0))
    if not len(out):
        return []
    worst = out[np.argmin(moved.least[out] / moved.preloads[out])]
    return [
        Finding(
            "info",
            "tension",
            where,
            f"{len(out)} of {len(moved.pairs)} linear normal springs pull at times, {moved.pairs[worst]} by up to "
            f"{-moved.least[worst]:.3g} N where {moved.preloads[worst]:.3g} N press.",
            float(moved.least[worst]),
            0.0,
            "There the joint would part: compare with ema.simulate.Unilateral().",
        )
    ]
