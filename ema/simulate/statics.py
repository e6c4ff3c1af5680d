"""Slow loading of a structure with friction: the path matters, so the load is raised in small increments."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.contact.laws import ContactLaws
from ema.errors import FailureError, InputError
from ema.simulate.reduction import stuck_stiffness
from ema.simulate.structure import System

_TOLERANCE, _FAILED = 1e-13, 1e-9
"""Sought and largest allowed residual of the displacements over the largest one: rounding leaves some 1e-15 of a stiff
contact, and 1e-9 is a thousandth of the least error that a result in time can state."""


INCREMENTS = 40
"""Of a slow load, before anything shows that it takes more."""

_LOOSE, _AWAY = 1e-10, 1e4
"""Stiffness that is left where all contacts slide, over theirs, below which nothing else holds the structure, and slips
over those of stuck contacts from which on it slides away."""
_HOLDS = (1e-12, 1e-9)
"""What a sliding contact yields less, as a part of its slip. A beam that friction alone holds is free when all its
contacts slide: 1/k - gains is then singular, and rounding would give it a sign. The first is one that no result shows;
with it steps of Newton along the free direction may be as large as a structure that is not held would go, so that
where the solution is far away the second decides."""


@dataclass(frozen=True)
class StaticState:
    """Displacements (n,), relative displacements and friction forces (contact,), and the state of the laws."""

    displacements: Float[np.ndarray, "n"]
    slips: Float[np.ndarray, "contact"]
    forces: Float[np.ndarray, "contact"]
    memory: Float[np.ndarray, "contact spring"]


def ramp(
    system: System,
    laws: ContactLaws,
    load: Float[np.ndarray, "n"],
    increments: int = INCREMENTS,
    limits: Float[np.ndarray, "contact"] | None = None,
) -> StaticState:
    """State after the load (n,) has been raised slowly from zero, from unstressed contacts.

    Raises
    ------
    InputError : the structure is not held.
    FailureError : no equilibrium was found.
    """
    matrix = stuck_stiffness(system, system.contacts.stiffness)
    slip, stiffness = system.contacts.slip, system.contacts.stiffness
    # what friction alone keeps from moving away, as a beam that only lies on its host, is held
    values = np.linalg.eigvalsh(matrix)
    if values[0] < 1e-12 * values[-1]:
        raise InputError(
            "the structure is not held",
            where=system.name,
            got="a rigid-body motion",
            expected="a support that carries the static load",
            advice="clamp it, or excite it with a pulse instead of a snap-back",
        )
    solved = np.linalg.solve(matrix, np.column_stack([load, slip.T]))
    gains, reach = slip @ solved[:, 1:], slip @ solved[:, 0]
    gains = 0.5 * (gains + gains.T)
    top = (system.contacts.limits if limits is None else limits).copy()
    levels = np.arange(1, increments + 1) / increments
    loose = 1 - np.linalg.eigvalsh(np.sqrt(stiffness)[:, None] * gains * np.sqrt(stiffness)).max(initial=0.0) < _LOOSE
    for hold in _HOLDS:
        yielding = gains - np.diag(hold / stiffness)
        u, f, z = _raised(laws, yielding, levels[:, None] * reach, top, system.name)
        if not (loose and np.abs(u).max() > _AWAY * np.abs(reach).max()):
            return StaticState(solved[:, 0] - solved[:, 1:] @ (f - stiffness * u), u, f, z)
    raise InputError(
        "the structure is not held",
        where=system.name,
        got="a load above the friction that alone holds it: contacts slide away",
        expected="a support that carries the static load",
        advice="clamp it, press harder, lower the load, or excite it with a pulse instead of a snap-back",
    )


def _raised(
    laws: ContactLaws, gains: np.ndarray, reach: Float[np.ndarray, "level contact"], limits: np.ndarray, where: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacements, forces and states of the contacts after the load has been raised."""
    from ema.contact import solve_kernels
    from ema.contact.call_kernels import FORCE, LIMIT

    kernels: Any = solve_kernels
    exchange, memory, arguments = laws.exchange(), laws.memory(gains), laws.arguments()
    exchange[LIMIT] = limits
    u, u1, f = np.zeros(len(limits)), np.zeros(len(limits)), np.zeros(len(limits))
    z, z1 = np.zeros_like(laws.flexibility), np.zeros_like(laws.flexibility)
    problem = gains, float(np.abs(gains).sum(axis=1).max()), 0.0, _TOLERANCE
    for n, free in enumerate(reach):
        held = free - gains @ (f - laws.stiffness * u)
        _, residual = kernels.solve(arguments, problem, (held, u, u1), exchange, (z, z1), memory)
        _check(residual, (n + 1) / len(reach), where)
        u, u1, z, z1, f = u1, u, z1, z, exchange[FORCE].copy()
    return u, f, z


def _check(residual: float, level: float, where: str) -> None:
    if not residual < _FAILED:
        got = f"residual {residual:.1e} at {level:.0%} of the load"
        raise FailureError("no static equilibrium", where=where, got=got, advice="lower the load")
