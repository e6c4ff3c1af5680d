"""Newton's method for motions of the contacts together with a few further unknowns, and curves of such motions.

Unknown are the amplitudes U (contact, 2 H) of the contacts and the numbers y (unknown,), for which as many conditions
hold. Newton's step is found by block elimination (Keller 1977): the contacts' equations are solved for the residual and
for what every further unknown changes in it, then the conditions give the change of y.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from ema.simulate.harmonic import EVALUATION, Condensed

_NUDGE = 1e-7
"""Relative change for differences by y: Newton's method keeps half the digits of its matrix, which is enough."""
_MOST_STEPS, _SHORTEST = 30, 0.005
"""Newton steps before a start counts as a bad one, and the share of a step below which none is tried."""
_MOST_ARCS, _SHORTEST_ARC, _LONGEST_ARC = 150, 1e-5, 0.5
"""Steps along a curve, and the least and the largest length of one, relative to the size of the motion. They bound the
work; no sensitivity to them was measured."""


@runtime_checkable
class Equations(Protocol):
    """Equations of the contacts, and conditions on further unknowns; amplitudes and forces as in ``Condensed``."""

    @property
    def condensed(self) -> Condensed:
        """The model seen from its contacts."""

    @property
    def scales(self) -> Float[np.ndarray, "unknown"]:
        """Sizes of the further unknowns."""

    def frequency(self, unknowns: Float[np.ndarray, "unknown"]) -> float:
        """Angular frequency in rad/s."""

    def contact_forces(
        self, amplitudes: Float[np.ndarray, "contact size"], unknowns: Float[np.ndarray, "unknown"]
    ) -> tuple[np.ndarray, ...]:
        """As ``Condensed.contact_forces``."""

    def moves_forces(self, index: int) -> bool:
        """Whether the contact forces depend on that unknown where the amplitudes stay."""

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
        return int(self.amplitudes.shape[1] // 2)


def bordered_newton(
    equations: Equations,
    amplitudes: Float[np.ndarray, "contact size"],
    unknowns: Float[np.ndarray, "unknown"],
    least: float = 1e-300,
) -> Solution | None:
    """Solve the equations from a start, with step halving; ``None`` where that fails.

    What the contacts' equations leave counts over the size of their motion, or over ``least`` m where that is larger.
    """
    condensed = equations.condensed
    here, at = np.ascontiguousarray(amplitudes), np.asarray(unknowns, dtype=float)
    step, change, length, best, steps = np.zeros_like(here), np.zeros_like(at), 1.0, np.inf, 0
    trial, trial_at = here, at
    while True:
        forces, jacobian, lost, slips = equations.contact_forces(trial, trial_at)
        rest, open_conditions = equations.rest(trial, forces, trial_at), equations.conditions(trial, forces, trial_at)
        size = max(float(np.linalg.norm(trial)), least)
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
        # a matrix that is nearly singular asks for steps of any size in the further unknowns
        length = 1.0 / max(1.0, float(np.abs(change / equations.scales).max()))
        trial, trial_at = here - length * step, at - length * change
        if not equations.frequency(trial_at) > 0:
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
        if equations.moves_forces(index):
            moved = equations.contact_forces(here, nudged)[0]
        columns.append((equations.rest(here, moved, nudged) - rest) / (_NUDGE * scale))
        own.append((equations.conditions(here, moved, nudged) - conditions) / (_NUDGE * scale))
    solved, seen = [], []
    for column in columns:
        answer = condensed.newton_step(equations.frequency(at), gains, (jacobian, slips), column)
        pushed = condensed.kernels.linear_change(answer, jacobian, condensed.members, slips)
        length = float(np.linalg.norm(answer))
        share = _NUDGE * np.linalg.norm(here) / length if length else 1.0
        nearby = equations.conditions(here + share * answer, forces + share * pushed, at)
        solved.append(answer)
        seen.append((nearby - conditions) / share)
    matrix = np.array(own).T - np.array(seen[1:]).T
    change = np.linalg.lstsq(matrix * equations.scales, conditions - seen[0], rcond=None)[0] * equations.scales
    return solved[0] - np.tensordot(change, np.array(solved[1:]), 1), change


@dataclass(frozen=True)
class Plane:
    """What a point of a curve is sought in: the plane across ``tangent`` through a predicted point (Keller 1977).

    Points are amplitudes over ``size`` in m, then the further unknown, one after the other; the tangent has length 1.
    """

    point: Float[np.ndarray, "coordinate"]
    tangent: Float[np.ndarray, "coordinate"]
    size: float

    def coordinates(
        self, amplitudes: Float[np.ndarray, "contact size"], unknowns: Float[np.ndarray, "unknown"]
    ) -> Float[np.ndarray, "coordinate"]:
        """A point in these coordinates."""
        return np.append(amplitudes.ravel() / self.size, unknowns)


@dataclass(frozen=True)
class ForcedMotion:
    """Forced motion with one further unknown, of a curve that ``plane`` cuts."""

    condensed: Condensed
    plane: Plane

    @property
    def scales(self) -> Float[np.ndarray, "unknown"]:
        """1, as all unknowns are relative."""
        return np.ones(1)

    def frequency(self, unknowns: np.ndarray) -> float:
        """Angular frequency in rad/s."""
        raise NotImplementedError

    def level(self, unknowns: np.ndarray) -> float:
        """Slip forces over those of the model."""
        return 1.0

    def contact_forces(self, amplitudes: np.ndarray, unknowns: np.ndarray) -> tuple[np.ndarray, ...]:
        """As ``Condensed.contact_forces``; counts against the budget."""
        self.condensed.left -= amplitudes.size + EVALUATION
        omega, level = self.frequency(unknowns), self.level(unknowns)
        return self.condensed.contact_forces(amplitudes, omega, self.condensed.fine, level)

    def moves_forces(self, index: int) -> bool:
        """Whether a law depends on velocities."""
        return bool(self.condensed.rates.any())

    def gains(self, unknowns: np.ndarray, count: int) -> Float[np.ndarray, "2 harmonic contact contact"]:
        """Receptances of the contacts."""
        return self.condensed.gains(self.frequency(unknowns), count)

    def rest(
        self, amplitudes: np.ndarray, forces: np.ndarray, unknowns: np.ndarray
    ) -> Float[np.ndarray, "contact size"]:
        """U - U_drive + Z G."""
        count = amplitudes.shape[1] // 2
        drive = self.condensed.drive(self.frequency(unknowns), count)
        return np.asarray(self.condensed.kernels.residual(amplitudes, drive, self.gains(unknowns, count), forces))

    def conditions(
        self, amplitudes: np.ndarray, forces: np.ndarray, unknowns: np.ndarray
    ) -> Float[np.ndarray, "unknown"]:
        """Distance from the plane."""
        return np.array([self.plane.tangent @ (self.plane.coordinates(amplitudes, unknowns) - self.plane.point)])


@dataclass(frozen=True)
class SlipForces(ForcedMotion):
    """Motion at one frequency with slip forces raised by a factor, of which the logarithm is the unknown."""

    omega: float
    receptances: Float[np.ndarray, "2 harmonic contact contact"]

    def frequency(self, unknowns: np.ndarray) -> float:
        """Angular frequency in rad/s."""
        return self.omega

    def level(self, unknowns: np.ndarray) -> float:
        """Slip forces over those of the model."""
        return float(np.exp(unknowns[0]))

    def moves_forces(self, index: int) -> bool:
        """They depend on the slip forces."""
        return True

    def gains(self, unknowns: np.ndarray, count: int) -> Float[np.ndarray, "2 harmonic contact contact"]:
        """Receptances of the contacts."""
        return self.receptances


@dataclass(frozen=True)
class Arcs:
    """Steps along a curve: the first length, the longest and shortest one over the size of the motion, how many.

    ``bend``: cosine of the angle between two of them below which the second is halved.
    """

    first: float
    longest: float
    shortest: float
    most: int
    bend: float = -1.0


def along(
    motion: Callable[[Plane], ForcedMotion],
    place: Float[np.ndarray, "coordinate"],
    tangent: Float[np.ndarray, "coordinate"],
    size: float,
    arcs: Arcs,
) -> Iterator[Float[np.ndarray, "coordinate"]]:
    """Points along a curve behind ``place``, in the coordinates of ``Plane``, as far as it can be followed."""
    step = arcs.first
    for _ in range(arcs.most):
        ahead = place + step * tangent
        equations = motion(Plane(ahead, tangent, size))
        shape = len(equations.condensed.limits), -1
        found = bordered_newton(equations, ahead[:-1].reshape(shape) * size, ahead[-1:])
        reached = None if found is None else equations.plane.coordinates(found.amplitudes, found.unknowns)
        way = np.zeros_like(place) if reached is None else reached - place
        if reached is None or way @ tangent < arcs.bend * np.linalg.norm(way):
            step *= 0.5
            if step < arcs.shortest or equations.condensed.left < 0:
                return
            continue
        place, tangent = reached, way / np.linalg.norm(way)
        yield place
        step = min(1.5 * step, arcs.longest * max(1.0, float(np.linalg.norm(place[:-1]))))


def lowered_slip_forces(
    condensed: Condensed, omega: float, gains: np.ndarray, known: Sequence[tuple[float, np.ndarray]]
) -> Float[np.ndarray, "contact size"] | None:
    """Amplitudes at the slip forces of the model, along the arc of the curve through two solutions with higher ones.

    ``known``: factors on the slip forces and amplitudes of these, the lower one last. Where the curve turns back to
    higher slip forces, as the motion jumps, it is followed round the bend. ``None`` where it does not come down.
    """
    size, shape = float(np.linalg.norm(known[-1][1])), known[-1][1].shape
    before, here = (np.append(motion.ravel() / size, np.log(level)) for level, motion in known)
    first = float(np.linalg.norm(here - before))
    arcs = Arcs(first, _LONGEST_ARC, _SHORTEST_ARC, _MOST_ARCS)
    for point in along(
        lambda plane: SlipForces(condensed, plane, omega, gains), here, (here - before) / first, size, arcs
    ):
        before, here = here, point
        if here[-1] <= 0.0:
            share = before[-1] / (before[-1] - here[-1])
            return np.asarray((before + share * (here - before))[:-1].reshape(shape) * size)
    return None
