"""Laws with memory of the motion after a slow load: LuGre released from static slip, against the full equations.

The truth is written here and shares nothing with the package: the slow load by integrating the rate form of the bristles
over the load (Canudas de Wit et al., IEEE Trans. Automat. Control 40 (1995), Eqs. 1-4, at vanishing speed), the free
vibration by DOP853 on displacements, velocities and bristle forces.
"""

from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ema.data import BeamModel, Joint, Matrices
from ema.dof import Dof
from ema.simulate import LuGre, controlled_snapback, snapback
from ema.simulate.control import constant
from ema.simulate.transient import Drive, integrate, prepare, released

SEEDS = (11, 12, 13)
SAMPLES, RATE = 100, 5000.0
FORCE, MU, TIP = 50.0, 1.0, "3:+X"


@cache
def structure(seed):
    """Three masses in a row that rub on two others; parameters of LuGre, and the load that is let go."""
    draw = np.random.default_rng(seed)
    springs, masses = draw.uniform(0.5, 2.0, 5) * 1e5, draw.uniform(0.5, 1.5, 5)
    host = np.diag([springs[0] + springs[1], springs[1] + springs[2], springs[2]])
    host[0, 1] = host[1, 0] = -springs[1]
    host[1, 2] = host[2, 1] = -springs[2]
    beam = np.array([[springs[3] + springs[4], -springs[4]], [-springs[4], springs[4] + 5e4]])
    law = {
        "contact_stiffness": draw.uniform(5e5, 2e6),
        "bristle_damping": draw.uniform(20.0, 200.0),
        "viscous": draw.uniform(0.0, 10.0),
        "static_ratio": draw.uniform(1.0, 1.5),
        "stribeck_velocity": draw.uniform(0.02, 0.1),
    }
    return masses, host, beam, law, draw.uniform(50.0, 100.0)


@cache
def model(seed, directions=("X",)):
    """With both directions the contacts are isotropic, and nothing moves in the second one."""
    masses, host, beam, law, _ = structure(seed)

    def part(own_masses, stiffness, name):
        count = len(own_masses)
        dofs = tuple(Dof(node + 1, axis, name) for axis in ("+X", "+Y", "+Z") for node in range(count))
        whole = 1e7 * np.eye(3 * count)
        whole[:count, :count] = stiffness
        return Matrices(np.diag(np.tile(own_masses, 3)), whole, dofs)

    joint = Joint("contact", ((1, 1), (2, 2)), (0.0, 0.0), LuGre(MU, **law), FORCE, 1.0, directions=directions)
    return BeamModel(part(masses[:3], host, ""), part(masses[3:], beam, "beam"), (joint,), name="masses that rub")


@cache
def truth(seed):
    """Displacement of the last mass at the samples, from the full equations."""
    masses, host, beam, law, load = structure(seed)
    stiffness = np.zeros((5, 5))
    stiffness[:3, :3], stiffness[3:, 3:] = host, beam
    rows = np.array([[-1.0, 0, 0, 1, 0], [0, -1.0, 0, 0, 1]])
    share, (k, damping, viscous) = 0.5, (0.5 * law[n] for n in ("contact_stiffness", "bristle_damping", "viscous"))
    slide, ratio, stribeck = share * MU * FORCE, law["static_ratio"], law["stribeck_velocity"]
    push = np.array([0.0, 0.0, load, 0.0, 0.0])

    def slow(_, y):
        # the signs of the slips are those that agree with themselves
        for signs in product((1.0, -1.0), repeat=2):
            tangent = k * (1.0 - np.array(signs) * y[5:] / (slide * ratio))
            rate = np.linalg.solve(stiffness + rows.T @ (tangent[:, None] * rows), push)
            if np.all(np.array(signs) * (rows @ rate) >= 0):
                return np.append(rate, tangent * (rows @ rate))
        raise AssertionError("no signs agree")

    def fast(_, y):
        v = rows @ y[5:10]
        top = slide * (1.0 + (ratio - 1.0) * np.exp(-((v / stribeck) ** 2)))
        drag = v - np.abs(v) * y[10:] / top
        force = y[10:] + damping * drag + viscous * v
        return np.concatenate([y[5:10], -(stiffness @ y[:5] + rows.T @ force) / masses, k * drag])

    held = solve_ivp(slow, (0.0, 1.0), np.zeros(7), "DOP853", rtol=1e-12, atol=1e-16).y[:, -1]
    start = np.concatenate([held[:5], np.zeros(5), held[5:]])
    times = np.arange(SAMPLES + 1) / RATE
    return solve_ivp(fast, (0.0, times[-1]), start, "DOP853", times, rtol=1e-10, atol=1e-14).y[2]


@pytest.mark.parametrize("directions", [("X",), ("X", "Y")], ids=len)
@pytest.mark.parametrize("seed", SEEDS)
def test_error_falls_with_the_step(seed, directions):
    problem = prepare(model(seed, directions), [TIP], plane=True)
    state = released(problem, structure(seed)[-1], Dof.parse(TIP))
    exact, row = truth(seed), problem.base.row(problem.system, TIP)
    assert row @ state.q == pytest.approx(exact[0], rel=1e-8)
    errors = []
    for every in (8, 16, 32, 64):
        run, _ = integrate(problem, state.copy(), 1 / RATE / every, every, SAMPLES, Drive(np.zeros(1)))
        errors.append(np.abs(run["q"] @ row - exact).max() / np.abs(exact).max())
    assert errors[0] < 3e-2
    assert np.all(np.array(errors[1:]) < 0.6 * np.array(errors[:-1])), errors


@pytest.mark.parametrize("seed", SEEDS)
def test_stated_error_holds(seed):
    exact, load = truth(seed), structure(seed)[-1]
    run = snapback(model(seed), load, TIP, SAMPLES / RATE, sampling_rate=RATE, tolerance=3e-4)
    error = np.abs(run.displacements[0] - exact).max() / np.abs(exact).max()
    assert error <= run.error_estimate <= 3e-4
    held = controlled_snapback(model(seed), constant(FORCE), load, TIP, SAMPLES / RATE, tolerance=3e-3)
    every = round(5e-4 * RATE * 2)
    error = np.abs(held.displacements[0][::2] - exact[: SAMPLES + 1 : every]).max() / np.abs(exact).max()
    assert error <= 3e-3
