"""Floquet multipliers with friction in two directions, rough contact and a normal force that changes in the cycle.

Every truth is a motion integrated here and differentiated by differences of its return map, what contacts remember
included: by scipy where the law is an equation, else by short steps of springs that are clipped to their slip force.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ema.contact.rough import bed
from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.simulate import (
    Dahl,
    Masing,
    RoughContact,
    RoughNormalContact,
    Unilateral,
    assemble,
    floquet_multipliers,
    frf,
)

DECAY, FREQUENCY, STIFFNESS = 60.0, 110.0, 4e5
COUPLED = np.array([[4e5, 4e4], [4e4, 6e5]])


def oscillator(law: Any, force: float, mass: np.ndarray, springs: np.ndarray, **options: Any) -> BeamModel:
    """Masses on springs with a joint to a wall that does not move; the last axis is that of the normal force."""
    axes = ("+X", "+Y", "+Z") if len(mass) == 3 else ("+X", "+Z")
    dofs, walls = (tuple(Dof(1, axis, body) for axis in axes) for body in ("", "wall"))
    joint = replace(Joint("contact", ((1, 1),), (0.0, 0.0), law, force, 1.0), **options)
    wall = Matrices(1e9 * np.eye(len(mass)), 1e18 * np.eye(len(mass)), walls)
    return BeamModel(Matrices(mass, springs, dofs), wall, (joint,), Damping(mass_factor=DECAY), "oscillator")


def in_a_plane(law: Any) -> BeamModel:
    springs = np.zeros((3, 3))
    springs[:2, :2], springs[2, 2] = COUPLED, 8e5
    return oscillator(law, 30.0, np.eye(3), springs, directions=("X", "Y"))


def agrees(model: BeamModel, force: float, at: str, truth: np.ndarray, blur: float = 0.0, **pressed: Any) -> None:
    """Every true multiplier but next to 0 is among those that are stated, within its error and that of the truth.

    Those of exactly 1 are residual forces of springs that stick.
    """
    response = frf(model, np.array([FREQUENCY]), force, at, [at], **pressed)
    (one,) = floquet_multipliers(model, response, **pressed)
    ones = np.abs(truth - 1) < 1e-6
    assert one.sticking == ones.sum() and one.verdict == "stable" and not one.reason
    for value in truth[~ones & (np.abs(truth) > 0.1)]:
        nearest = int(np.argmin(np.abs(one.multipliers - value)))
        assert abs(one.multipliers[nearest] - value) <= one.errors[nearest] + blur
        assert one.errors[nearest] < 0.06


def differentiated(period: Callable[[np.ndarray], np.ndarray], start: np.ndarray, nudges: np.ndarray) -> np.ndarray:
    """Multipliers of a return map, by differences about the motion that it comes to."""
    for _ in range(25):
        start = period(start)
    columns = [(period(start + nudge) - period(start - nudge)) / (2 * nudge.max()) for nudge in np.diag(nudges)]
    return np.linalg.eigvals(np.array(columns).T)


def integrated(motion: Callable[[float, np.ndarray], Any]) -> Callable[[np.ndarray], np.ndarray]:
    """The state a period later, by DOP853."""

    def period(state: np.ndarray) -> np.ndarray:
        path = solve_ivp(motion, (0, 1 / FREQUENCY), state, "DOP853", rtol=1e-9, atol=1e-12, max_step=0.01 / FREQUENCY)
        return path.y[:, -1]

    return period


def test_dahls_law_in_two_directions() -> None:
    """dF = k (du - F/F_C |du|)."""

    def motion(t: float, y: np.ndarray) -> np.ndarray:
        x, v, q = y[:2], y[2:4], y[4:]
        pull = np.array([40.0 * np.cos(2 * np.pi * FREQUENCY * t), 0.0]) - COUPLED @ x - q - DECAY * v
        return np.concatenate([v, pull, STIFFNESS * (v - q / 30.0 * np.linalg.norm(v))])

    truth = differentiated(integrated(motion), np.zeros(6), np.repeat([1e-8, 1e-5, 1e-3], 2))
    assert np.sum(np.abs(truth) > 0.1) == 4
    agrees(in_a_plane(Dahl(1.0, STIFFNESS, 1.0)), 40.0, "1:+X", truth)


@pytest.mark.parametrize("draw", range(3))
def test_dahls_law_under_a_normal_force_that_changes_with_the_period(draw: int) -> None:
    """Its corners and the turns of the motion fall anywhere within steps: two numbers of steps may agree by chance."""
    rng = np.random.default_rng([41, draw])
    swing, lag = rng.uniform(0.2, 0.5), rng.uniform(0, 2 * np.pi)
    pressed = 30 * (1 + swing * np.cos(2 * np.pi * np.arange(64) / 64 - lag))
    corners = np.append(pressed, pressed[0])

    def motion(t: float, y: np.ndarray) -> list[float]:
        limit = np.interp(t * FREQUENCY % 1 * 64, np.arange(65), corners)
        pull = 10.0 * np.cos(2 * np.pi * FREQUENCY * t) - 4e5 * y[0] - y[2] - DECAY * y[1]
        return [y[1], pull, STIFFNESS * (y[1] - y[2] / limit * abs(y[1]))]

    truth = differentiated(integrated(motion), np.zeros(3), np.array([1e-8, 1e-5, 1e-3]))
    model = oscillator(Dahl(1.0, STIFFNESS, 1.0), 30.0, np.eye(2), np.diag([4e5, 8e5]))
    agrees(model, 10.0, "1:+X", truth, 1e-4, normal_forces=pressed[None])


@dataclass
class Springs:
    """Friction springs of ``stiffness`` N/m on a structure, in short steps (Verlet); motions side by side.

    ``limits`` makes slip forces (spring, motion) of a normal force (motion,), and ``normal`` that of the displacement
    along the last axis, which it opposes from rest.
    """

    mass: np.ndarray
    springs: np.ndarray
    force: float
    at: int
    stiffness: np.ndarray
    limits: Callable[[Any], np.ndarray]
    normal: Callable[[np.ndarray], np.ndarray] | None = None
    lanes: int = 1
    steps: int = 2000

    def period(self, states: np.ndarray) -> np.ndarray:
        """States (displacements, velocities, forces of the springs) of motions a period later."""
        size, count = len(self.mass), states.shape[1]
        u, v, q = states[:size], states[size : 2 * size], states[2 * size :].reshape(-1, self.lanes, count)
        inverse, h = np.linalg.inv(self.mass), 1 / FREQUENCY / self.steps
        rest = None if self.normal is None else self.normal(np.zeros(1))
        load, drive = np.zeros((size, 1)), 2 * np.pi * FREQUENCY * h

        def pushed(u: np.ndarray, q: np.ndarray, step: int) -> np.ndarray:
            load[self.at] = self.force * np.cos(drive * step)
            out = load - self.springs @ u
            out[: self.lanes] -= q.sum(axis=0)
            if self.normal is not None:
                out[-1] += self.normal(u[-1]) - rest
            return np.asarray(inverse @ out)

        push = pushed(u, q, 0)
        for step in range(1, self.steps + 1):
            v = v + 0.5 * h * (push - DECAY * v)
            way, u = h * v, u + h * v
            top = self.limits(None if self.normal is None else self.normal(u[-1]))[:, None]
            q = q + self.stiffness[:, None, None] * way[: self.lanes]
            long = np.sqrt((q**2).sum(axis=1, keepdims=True))
            q = q * np.minimum(1.0, top / np.maximum(long, 1e-300))
            push = pushed(u, q, step)
            v = (v + 0.5 * h * push) / (1 + 0.5 * h * DECAY)
        return np.concatenate([u, v, q.reshape(-1, count)])

    def multipliers(self, tops: np.ndarray, start: float = 3e-4) -> np.ndarray:
        """Of the motion that it comes to from a larger one; ``tops`` N: slip forces, for the size of differences."""
        size = len(self.mass)
        state = np.zeros((2 * size + len(tops) * self.lanes, 1))
        state[0] = start
        for _ in range(25):
            state = self.period(state)
        nudges = np.concatenate([np.repeat([1e-9, 1e-6], size), np.repeat(1e-5 * tops + 1e-11, self.lanes)])
        ends = self.period(np.hstack([state + np.diag(nudges), state - np.diag(nudges)]))
        return np.linalg.eigvals((ends[:, : len(nudges)] - ends[:, len(nudges) :]) / (2 * nudges))


SKEW = np.array([[1.0, 0.3], [0.3, 1.0]])


def test_a_masing_spring_in_two_directions() -> None:
    """Elastic inside a circle, along it beyond."""
    springs = Springs(np.eye(2), COUPLED, 40.0, 0, np.array([STIFFNESS]), lambda _: np.array([[30.0]]), lanes=2)
    truth = springs.multipliers(np.array([30.0]))
    assert np.sum(np.abs(truth) > 0.1) == 4
    agrees(in_a_plane(Masing(1.0, STIFFNESS)), 40.0, "1:+X", truth, 1e-3)


@pytest.mark.parametrize(("at", "force"), [(0, 25.0), (0, 50.0), (1, 120.0)], ids=["presses", "parts", "hammers"])
def test_a_masing_spring_pressed_by_a_contact_that_follows_the_motion(at: int, force: float) -> None:
    """The contact shares the force that presses it with the structure's own spring."""
    pressed, share = 100.0, STIFFNESS / (STIFFNESS + 6e5)
    springs = Springs(
        SKEW,
        np.diag([4e5, 6e5]),
        force,
        at,
        np.array([STIFFNESS]),
        lambda normal: 0.5 * normal[None],
        lambda opening: np.maximum(share * pressed - STIFFNESS * opening, 0.0),
    )
    model = oscillator(
        Masing(0.5, STIFFNESS), pressed, SKEW, springs.springs, normal_contact=Unilateral(), normal_stiffness=STIFFNESS
    )
    # the steps of the truth, from twice as many of them
    agrees(model, force, ("1:+X", "1:+Z")[at], springs.multipliers(np.array([20.0])), 2e-3)


def test_rough_contact_under_a_constant_normal_force() -> None:
    law = RoughContact(0.3, 1e-4, springs=12, reference_force=100.0)
    count, row = bed(law, law.contact_stiffness)
    touching = int(row[-1])
    tops = row[count : count + touching]
    springs = Springs(np.eye(2), np.diag([4e5, 8e5]), 20.0, 0, row[:touching], lambda _: tops[:, None])
    truth = springs.multipliers(tops)
    assert np.sum(np.abs(truth - 1) < 1e-6) == 4  # summits so deep that they never slip
    agrees(oscillator(law, 100.0, np.eye(2), np.diag([4e5, 8e5])), 20.0, "1:+X", truth, 1e-3)


def test_rough_contact_whose_normal_force_follows_the_motion() -> None:
    """Summits g deep slip at k (D - g) mu / kappa (Popov and Hess 2015): all deeper by as much as mu F_N asks for."""
    pressed, friction = 100.0, 0.5
    law, normal = RoughContact(friction, 1e-4, springs=12, reference_force=pressed), RoughNormalContact(1e-4, pressed)
    model = oscillator(law, pressed, SKEW, np.diag([4e5, 6e5]), normal_contact=normal)
    depths, forces = np.array(normal.points).T
    rest = brentq(lambda depth: np.interp(depth, depths, forces) + 6e5 * depth - pressed, 0, depths[-1])
    count, row = bed(law, float(assemble(model).contacts.stiffness[0]))
    stiffness, yields = row[:count], row[count : 2 * count] / row[:count]
    deeper = np.linspace(-yields.max(), 3 * yields.max(), 20001)
    bearing = (stiffness[:, None] * np.maximum(yields[:, None] + deeper, 0)).sum(axis=0)
    springs = Springs(
        SKEW,
        np.diag([4e5, 6e5]),
        100.0,
        0,
        stiffness,
        lambda force: (
            stiffness[:, None] * np.maximum(yields[:, None] + np.interp(friction * force, bearing, deeper), 0)
        ),
        lambda opening: np.interp(rest - opening, depths, forces),
    )
    agrees(model, 100.0, "1:+X", springs.multipliers(row[count : 2 * count]), 1e-3)
