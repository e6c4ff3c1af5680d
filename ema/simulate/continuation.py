"""Newton's method for motions of the contacts together with a few further unknowns, such as the frequency.

Unknown are the amplitudes U (contact, 2 H) of the contacts and the numbers y (unknown,), for which as many conditions
hold. Newton's step is found by block elimination (Keller 1977): the contacts' equations are solved for the residual and
for what every further unknown changes in it, then the conditions give the change of y.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from ema.simulate.harmonic import Condensed

_NUDGE = 1e-7
"""Relative change for differences by y: Newton's method keeps half the digits of its matrix, which is enough."""
_MOST_STEPS, _SHORTEST = 30, 0.005
"""Newton steps before a start counts as a bad one, and the share of a step below which none is tried."""


@runtime_checkable
class Equations(Protocol):
    """Equations of the contacts, and conditions on further unknowns; amplitudes and forces as in ``Condensed``."""

    condensed: Condensed

    @property
    def scales(self) -> Float[np.ndarray, "unknown"]:
        """Sizes of the further unknowns, of which the first one is the angular frequency in rad/s."""

    def gains(
        self, unknowns: Float[np.ndarray, "unknown"], count: int
    ) -> Float[np.ndarray, "2 harmonic contact contact"]:
        """Receptances of the contacts at ``count`` harmonics."""

    def rest(
        self,
        amplitudes: Float[np.ndarray, "contact size"],
        forces: Float[np.ndarray, "contact size"],
        unknowns: Float[np.ndarray, "unknown"],
    ) -> Float[np.ndarray, "contact size"]:
        """Displacements that the contacts' equations leave in m."""

    def conditions(
        self,
        amplitudes: Float[np.ndarray, "contact size"],
        forces: Float[np.ndarray, "contact size"],
        unknowns: Float[np.ndarray, "unknown"],
    ) -> Float[np.ndarray, "unknown"]:
        """What the conditions leave, over the sizes of their terms."""


@dataclass(frozen=True)
class Solution:
    """Amplitudes and forces (contact, 2 H) in m and N, further unknowns, losses in J per period, who slips."""

    amplitudes: Float[np.ndarray, "contact size"]
    unknowns: Float[np.ndarray, "unknown"]
    forces: Float[np.ndarray, "contact size"]
    lost: Float[np.ndarray, "contact"]
    slips: Bool[np.ndarray, "contact"]

    @property
    def count(self) -> int:
        """Number of harmonics."""
        return self.amplitudes.shape[1] // 2


def bordered_newton(
    equations: Equations, amplitudes: Float[np.ndarray, "contact size"], unknowns: Float[np.ndarray, "unknown"]
) -> Solution | None:
    """Solve the equations from a start, with step halving; ``None`` where that fails."""
    condensed = equations.condensed
    here, at = np.ascontiguousarray(amplitudes), np.asarray(unknowns, dtype=float)
    step, change, length, best, steps = np.zeros_like(here), np.zeros_like(at), 1.0, np.inf, 0
    trial, trial_at = here, at
    while True:
        forces, jacobian, lost, slips = condensed.contact_forces(trial, trial_at[0], condensed.fine)
        rest, open_conditions = equations.rest(trial, forces, trial_at), equations.conditions(trial, forces, trial_at)
        size = max(float(np.linalg.norm(trial)), 1e-300)
        merit = float(np.linalg.norm(rest)) / size + float(np.linalg.norm(open_conditions))
        if merit <= condensed.accuracy:
            return Solution(trial, trial_at, forces, lost, slips)
        if not merit < (1 - 0.1 * length) * best:
            length *= 0.5
            if length < _SHORTEST or not np.isfinite(merit):
                return None
            trial, trial_at = here - length * step, at - length * change
            continue
        here, at, best, length, steps = trial, trial_at, merit, 1.0, steps + 1
        if steps > _MOST_STEPS:
            return None
        step, change = _step(equations, (here, at), (forces, jacobian, slips), (rest, open_conditions))
        trial, trial_at = here - step, at - change
        if not trial_at[0] > 0:
            return None


def _step(
    equations: Equations,
    point: tuple[np.ndarray, np.ndarray],
    contact: tuple[np.ndarray, np.ndarray, np.ndarray],
    left: tuple[np.ndarray, np.ndarray],
) -> tuple[Float[np.ndarray, "contact size"], Float[np.ndarray, "unknown"]]:
    """Newton's step in amplitudes and further unknowns.

    With J, B the derivatives of ``rest`` by U and y, and C, D those of the conditions:
    (D - C J^-1 B) dy = conditions - C J^-1 rest, dU = J^-1 (rest - B dy).
    """
    (here, at), (forces, jacobian, slips), (rest, conditions) = point, contact, left
    condensed, gains = equations.condensed, equations.gains(at, here.shape[1] // 2)
    columns, own = [rest], []
    for index, scale in enumerate(equations.scales):
        nudged, moved = at.copy(), forces
        nudged[index] += _NUDGE * scale
        if index == 0 and condensed.rates.any():
            moved = condensed.contact_forces(here, nudged[0], condensed.fine, derive=False)[0]
        columns.append((equations.rest(here, moved, nudged) - rest) / (_NUDGE * scale))
        own.append((equations.conditions(here, moved, nudged) - conditions) / (_NUDGE * scale))
    solved, seen = [], []
    for column in columns:
        answer = condensed.newton_step(at[0], gains, (jacobian, slips), column)
        pushed = condensed.kernels.linear_change(answer, jacobian, condensed.members, slips)
        share = _NUDGE * np.linalg.norm(here) / max(float(np.linalg.norm(answer)), 1e-300)
        nearby = equations.conditions(here + share * answer, forces + share * pushed, at)
        solved.append(answer)
        seen.append((nearby - conditions) / share)
    matrix = np.array(own).T - np.array(seen[1:]).T
    change = np.linalg.lstsq(matrix * equations.scales, conditions - seen[0], rcond=None)[0] * equations.scales
    return solved[0] - np.tensordot(change, np.array(solved[1:]), 1), change
