"""Slow loading of a structure with friction: the path matters, so the load is raised in small increments."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.errors import FailureError, InputError
from ema.simulate.friction import PackedLaws
from ema.simulate.joined import Joined
from ema.simulate.reduction import stuck_stiffness
from ema.simulate.structure import System


@dataclass(frozen=True)
class StaticState:
    """Displacements (n,), relative displacements and friction forces (contact,), and the state of the laws."""

    displacements: Float[np.ndarray, "n"]
    slips: Float[np.ndarray, "contact"]
    forces: Float[np.ndarray, "contact"]
    memory: Float[np.ndarray, "contact spring"]


def ramp(
    system: System, laws: PackedLaws, load: Float[np.ndarray, "n"], increments: int = 40,
    limits: Float[np.ndarray, "contact"] | None = None, joined: Joined | None = None,
) -> StaticState:  # fmt: skip
    """State after the load (n,) has been raised slowly from zero, from unstressed contacts.

    Raises
    ------
    InputError : the structure is not held.
    FailureError : no equilibrium was found.
    """
    from ema.simulate import contact_kernels

    kernels: Any = contact_kernels
    matrix = stuck_stiffness(system, system.contacts.stiffness)
    slip, stiffness = system.contacts.slip, system.contacts.stiffness
    # what friction alone keeps from moving away, as a beam that only lies on its host, is held
    values = np.linalg.eigvalsh(matrix)
    if values[0] < 1e-12 * values[-1]:
        raise InputError("the structure is not held", where=system.name, got="a rigid-body motion",
                         expected="a support that carries the static load",
                         advice="clamp it, or excite it with a pulse instead of a snap-back")  # fmt: skip
    solved = np.linalg.solve(matrix, np.column_stack([load, slip.T]))
    gains, reach = np.ascontiguousarray(slip @ solved[:, 1:]), slip @ solved[:, 0]
    count = len(stiffness)
    u, f, z = np.zeros(count), np.zeros(count), np.zeros((count, laws.stiffness_shares.shape[1]))
    top = (system.contacts.limits if limits is None else limits).copy()
    masing = laws.single_springs and joined is None
    signs, table = np.zeros(count), np.empty((count, count))
    if masing:
        kernels.fresh_table(gains, stiffness, signs, table)
    for level in np.arange(1, increments + 1) / increments:
        if masing:
            rest = kernels.relax_masing(gains, level * reach, stiffness, top, u, f, signs, table)
        elif joined is not None:
            from ema.simulate import joined_kernels

            rest = joined_kernels.relax_joined(
                gains, level * reach, stiffness, top, laws.arguments, joined.arguments, u, f, z
            )
        else:
            rest = kernels.relax(gains, level * reach, stiffness, top, laws.arguments, u, f, z, 100_000)
        if not rest < 1e-9:
            raise FailureError("no static equilibrium", where=system.name,
                               got=f"residual {rest:.1e} at {level:.0%} of the load",
                               advice="lower the load")  # fmt: skip
    if masing:
        z[:, 0] = f
    return StaticState(solved[:, 0] - solved[:, 1:] @ (f - stiffness * u), u, f, z)
