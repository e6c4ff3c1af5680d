"""LuGre in two directions against its equations, integrated by DOP853, and their differences.

With z the force of the bristles, v the velocity along the wall and g = F_C (1 + (F_S/F_C - 1) exp(-(|v|/v_S)^2)),

    dz/dt = k (v - |v| z / g),   f = z + sigma_1 (v - |v| z / g) + sigma_2 v

(Canudas de Wit et al. 1995, Eqs. (2) to (4), with vectors for motion in a plane: Velenis, Tsiotras and Canudas de Wit
2002).
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ema.contact.catalogue import CATALOGUE
from ema.contact.laws import contact_laws
from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.simulate import LuGre, Masing, floquet_multipliers, frf, respond
from ema.simulate.harmonic import condense, with_harmonics
from ema.simulate.stability import PeriodMap
from ema.simulate.turning_points import slope
from tests.dop853 import dop853

DECAY, NORMAL, STIFFNESS = 60.0, 30.0, 4e5
COUPLED = np.array([[4e5, 4e4], [4e4, 6e5]])
BRISTLES = [(0.0, 0.0, 1.0, 1.0), (40.0, 10.0, 1.0, 1.0), (60.0, 5.0, 1.3, 0.03)]
"""sigma_1 and sigma_2 in N s/m, F_S/F_C, and v_S in m/s."""


def law(numbers: tuple[float, ...]) -> Any:
    return LuGre(1.0, STIFFNESS, *numbers)


def oscillator(friction: Any, directions: tuple[str, ...] = ("X", "Y")) -> BeamModel:
    """1 kg on springs that couple X to Y, on a wall that does not move."""
    springs = np.zeros((3, 3))
    springs[:2, :2], springs[2, 2] = COUPLED, 8e5
    dofs, walls = (tuple(Dof(1, axis, body) for axis in ("+X", "+Y", "+Z")) for body in ("", "wall"))
    wall = Matrices(1e9 * np.eye(3), 1e18 * np.eye(3), walls)
    joint = replace(Joint("contact", ((1, 1),), (0.0, 0.0), friction, NORMAL, 1.0), directions=directions)
    return BeamModel(Matrices(np.eye(3), springs, dofs), wall, (joint,), Damping(mass_factor=DECAY), "oscillator")


def equations(numbers: tuple[float, ...], force: float, frequency: float) -> Any:
    """dy/dt of x, v, z under a force along X; DOP853 hands lists."""
    bristle, viscous, ratio, stribeck = numbers
    turn = 2 * np.pi * frequency

    def motion(t: float, y: list[float]) -> list[float]:
        x, z, (vx, vy) = y[:2], y[4:], y[2:4]
        speed = float(np.hypot(vx, vy))
        top = NORMAL * (1 + (ratio - 1) * np.exp(-((speed / stribeck) ** 2)))
        lag = [vx - speed * z[0] / top, vy - speed * z[1] / top]
        fx, fy = (z[n] + bristle * lag[n] + viscous * (vx, vy)[n] for n in range(2))
        return [
            vx,
            vy,
            force * np.cos(turn * t) - COUPLED[0, 0] * x[0] - COUPLED[0, 1] * x[1] - fx - DECAY * vx,
            -COUPLED[1, 0] * x[0] - COUPLED[1, 1] * x[1] - fy - DECAY * vy,
            STIFFNESS * lag[0],
            STIFFNESS * lag[1],
        ]

    return motion


@pytest.mark.parametrize("numbers", BRISTLES)
def test_motion_in_time(numbers: tuple[float, ...]) -> None:
    force, frequency, rate = 40.0, 90.0, 20_000.0
    times = np.arange(1501) / rate
    truth = dop853(equations(numbers, force, frequency), [0.0] * 6, times, rtol=1e-10, atol=1e-13)
    push = force * np.cos(2 * np.pi * frequency * times)[None]
    found = respond(oscillator(law(numbers)), push, ["1:+X"], rate, ["1:+X", "1:+Y"], tolerance=3e-4)
    # between samples the push is a straight line: of second order in their distance
    size = np.abs(truth[:2]).max()
    assert np.abs(truth[1]).max() > 0.03 * size
    assert np.abs(found.displacements - truth[:2]).max() < 2e-3 * size
    assert found.energy.error < 1e-6


@pytest.mark.parametrize("numbers", BRISTLES)
def test_steady_state_and_multipliers(numbers: tuple[float, ...]) -> None:
    """The return map of the equations over a period, differentiated where it closes."""
    force, frequency = 40.0, 110.0
    motion = equations(numbers, force, frequency)

    def period(start: np.ndarray, samples: int = 1) -> np.ndarray:
        times = np.arange(samples + 1) / samples / frequency
        return dop853(motion, list(start), times, rtol=1e-10, atol=1e-13, max_step=0.01 / frequency)[:, 1:]

    start = np.zeros(6)
    for _ in range(30):
        start = period(start)[:, -1]
    samples = 256
    last = period(start, samples)
    expected = 2 / samples * last[:2] @ np.exp(-2j * np.pi * np.arange(1, samples + 1) / samples)
    nudges = np.repeat([1e-8, 1e-5, 1e-3], 2)
    columns = [(period(start + n)[:, -1] - period(start - n)[:, -1]) / (2 * n.max()) for n in np.diag(nudges)]
    truth = np.linalg.eigvals(np.array(columns).T)
    model = oscillator(law(numbers))
    response = frf(model, np.array([frequency]), force, "1:+X", ["1:+X", "1:+Y"])
    found = response.values[0][:, list(response.orders).index(1)]
    assert np.linalg.norm(found - expected) < response.error_estimate[0] * np.linalg.norm(expected)
    (one,) = floquet_multipliers(model, response)
    assert one.verdict == "stable" and not one.reason
    for value in truth[np.abs(truth) > 0.05]:
        nearest = int(np.argmin(np.abs(one.multipliers - value)))
        assert abs(one.multipliers[nearest] - value) <= one.errors[nearest] + 1e-4
        assert one.errors[nearest] < 0.02


def test_multipliers_are_those_of_the_map_of_the_time_solver() -> None:
    """Differences of runs about the state that runs from the harmonic solution come to, each coordinate by itself."""
    model, frequency, force, steps = oscillator(law(BRISTLES[2])), 110.0, 40.0, 1024
    condensed = condense(model, force, "1:+X", ["1:+X"], 5e-3)
    point = condensed.solve(frequency)
    assert point is not None
    period = PeriodMap(condensed, point, steps)
    start = period.start
    for _ in range(40):
        start = period.ahead(start)[0]
    nudges = 1e-6 * np.maximum(np.abs(start), 1e-3 * np.abs(start).max())
    columns = [(period.ahead(start + n)[0] - period.ahead(start - n)[0]) / (2 * n.max()) for n in np.diag(nudges)]
    truth = np.linalg.eigvals(np.array(columns).T)
    (one,) = floquet_multipliers(model, frf(model, np.array([frequency]), force, "1:+X", ["1:+X"]))
    for value in truth[np.abs(truth) > 0.05]:
        nearest = int(np.argmin(np.abs(one.multipliers - value)))
        assert abs(one.multipliers[nearest] - value) <= one.errors[nearest] + 1e-4


@pytest.mark.parametrize("directions", [("X",), ("X", "Y")])
@pytest.mark.parametrize("numbers", BRISTLES)
def test_the_jacobian_has_the_velocities_in_it(numbers: tuple[float, ...], directions: tuple[str, ...]) -> None:
    condensed = condense(oscillator(law(numbers), directions), 1.0, "1:+X", ["1:+X"], 1e-3)
    rng, omega, fine = np.random.default_rng(71), 2 * np.pi * 110.0, 4
    motion = 2e-4 * rng.standard_normal((len(condensed.limits), 6)) / np.array([1, 1, 4, 4, 9, 9])
    jacobian = condensed.contact_forces(motion, omega, fine)[1]
    for way in rng.standard_normal((4, *motion.shape)):
        ends = [condensed.contact_forces(motion + side * 1e-10 * way, omega, fine, derive=False)[0] for side in (1, -1)]
        expected = (ends[0] - ends[1]) / 2e-10
        change = np.array(
            [
                sum(jacobian[i, m] @ way[j] for m, j in enumerate(condensed.members[i]) if j >= 0)
                for i in range(len(motion))
            ]
        )
        np.testing.assert_allclose(change, expected, atol=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize("directions", [("X",), ("X", "Y")])
def test_the_slope_of_a_curve_has_the_velocities_in_it(directions: tuple[str, ...]) -> None:
    """Against solutions on both sides of the frequency."""
    condensed = condense(oscillator(law(BRISTLES[2]), directions), 40.0, "1:+X", ["1:+X"], 5e-3)
    condensed.harmonics = 5
    points = [condensed.solve(frequency) for frequency in (110.0, 109.95, 110.05)]
    assert all(point is not None for point in points)
    here, low, high = (condensed._again(point, condensed.gains(point.omega, 5)) for point in points)
    expected = (high.amplitudes - low.amplitudes) / (high.omega - low.omega)
    found = slope(condensed, replace(here, amplitudes=with_harmonics(here.amplitudes, 5)))
    np.testing.assert_allclose(found, expected, atol=2e-3 * np.abs(expected).max())


def test_laws_say_whether_their_force_depends_on_velocities() -> None:
    """By its data, for every law of the catalogue in one direction and in two: forces at two speeds differ."""
    assert [name for name, known in CATALOGUE.items() if known.rates] == ["lugre"]
    for friction in (law(BRISTLES[2]), Masing(1.0, STIFFNESS)):
        for directions in (("X",), ("X", "Y")):
            laws = condense(oscillator(friction, directions), 1.0, "1:+X", ["1:+X"], 1e-3).problem.laws
            assert laws.rates.tolist() == [friction.name == "lugre"] * len(directions)
    both = contact_laws([Masing(1.0, STIFFNESS), law(BRISTLES[1])], np.full(2, STIFFNESS), [1, 1])
    path = np.tile(1e-3 * np.sin(np.linspace(0, 3, 200)), (2, 1))
    slow, fast = (both.followed(path, np.full_like(path, NORMAL), interval)[0] for interval in (1e-2, 1e-4))
    assert (np.abs(slow - fast).max(axis=1) > 1e-6).tolist() == both.rates.tolist()
