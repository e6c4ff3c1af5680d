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

_MOST_STEPS = 200


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
    from ema.simulate import contact_kernels, friction_kernels

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
    gains, reach = slip @ solved[:, 1:], slip @ solved[:, 0]
    # A beam that friction alone holds is free when all its contacts slide: 1/k - gains is then singular, and rounding
    # would give it a sign. A sliding contact yields by 1e-12 of its slip less, which no result shows.
    gains = 0.5 * (gains + gains.T) - np.diag(1e-12 / stiffness)
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
            rest = _relax(gains, level * reach, stiffness, top, laws, u, f, z)
        if not rest < 1e-9:
            raise FailureError("no static equilibrium", where=system.name,
                               got=f"residual {rest:.1e} at {level:.0%} of the load",
                               advice="lower the load")  # fmt: skip
    if masing:
        z[:, 0] = f
    # LuGre keeps the displacement one increment ago to see its velocity: at the end of a slow load nothing moves
    z[laws.codes == friction_kernels.LUGRE, 1:] = 0.0
    return StaticState(solved[:, 0] - solved[:, 1:] @ (f - stiffness * u), u, f, z)


def _relax(
    gains: np.ndarray, free: np.ndarray, stiffness: np.ndarray, limits: np.ndarray, laws: PackedLaws, u: np.ndarray,
    f: np.ndarray, z: np.ndarray,
) -> float:  # fmt: skip
    """Equilibrium u + gains g = free with g = f(u) - k u, from u, f and z, which are changed; returns the residual.

    It is the least of an energy whose slope along a step ``way`` of g is -rest @ gains @ way: Newton's method, with
    steps that are shortened where that slope has changed its sign.
    """
    from ema.simulate import friction_kernels

    kernels: Any = friction_kernels
    count, g = len(u), f - stiffness * u
    force, slope, memory = f.copy(), np.empty(count), z.copy()

    def missing(load: np.ndarray) -> np.ndarray:
        place = free - gains @ load
        kernels.all_steps(stiffness, limits, laws.arguments, u, place, np.inf, z, memory, force, slope)
        return np.asarray(force - stiffness * place - load)

    rest = missing(g)
    size = max(float(np.abs(free).max()), float(np.abs(u).max()), 1e-300)
    for _ in range(_MOST_STEPS):
        if np.abs(gains @ rest).max() <= 1e-14 * size:
            break
        way = np.linalg.solve(np.eye(count) + (slope - stiffness)[:, None] * gains, rest)
        start, low, high, length = -float(rest @ gains @ way), 0.0, np.inf, 1.0
        for _ in range(40):
            rest = missing(g + length * way)
            now = -float(rest @ gains @ way)
            if abs(now) <= 0.5 * abs(start) or start >= 0:
                break
            low, high = (length, high) if now < 0 else (low, length)
            length = 0.5 * (low + high) if np.isfinite(high) else 2 * length
        g = g + length * way
    u[:], f[:], z[:] = free - gains @ g, force, memory
    return float(np.abs(gains @ rest).max()) / size
