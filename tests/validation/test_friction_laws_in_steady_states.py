"""Every friction law in the frequency solver: its loss per cycle against closed forms and quadrature, and its power.

Laws as in Gaul, Roseira and Becker, Shock and Vibration 15 (2008), Eqs. (4) and (5); Segalman (2005), Dahl (1968), LuGre
(Canudas de Wit et al. 1995). With one harmonic kept the contact moves harmonically, so that what a steady state says it
loses must be the area of the law's loop at the amplitude found.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.elements import Section
from ema.simulate import (
    BoucWen,
    Coulomb,
    Dahl,
    HarmonicBalance,
    Iwan,
    LuGre,
    Masing,
    ModifiedIwan,
    ParallelMasing,
    RegularisedMasing,
    Valanis,
    double_beam,
    frf,
    register_law,
)
from ema.simulate.friction import iwan_springs
from ema.simulate.harmonic import condense
from tests.closed_forms import dahl_area, masing_area, regularised_area

K, FC = 4e5, 30.0
SHARES = ([0.5, 0.3, 0.2], [0.2, 0.3, 0.5])


def springs(shares_k, shares_f, amplitude):
    return sum(masing_area(K * k, FC * f, amplitude) for k, f in zip(shares_k, shares_f, strict=True))


def rate_independent(rate, amplitude, cycles=20):
    """Loss per stabilised cycle of dF/du = rate(F in the direction of motion), by DOP853."""
    force, lost = 0.0, 0.0
    for n in range(2 * cycles):
        way = 1 if n % 2 == 0 else -1
        length = amplitude if n == 0 else 2 * amplitude
        done = solve_ivp(
            lambda _, y, w=way: [w * rate(w * y[0]), y[0] * w],
            (0, length),
            [force, 0.0],
            "DOP853",
            rtol=1e-11,
            atol=1e-13 * FC,
        )
        force, work = done.y[:, -1]
        lost += work if n >= 2 * cycles - 2 else 0.0
    return lost


DAMPING, VISCOUS, RATIO, STRIBECK = 30.0, 5.0, 1.3, 1e-3


def lugre_area(amplitude, frequency):
    """Loss per cycle of LuGre with all its rate effects, by DOP853 between the reversals."""
    omega = 2 * np.pi * frequency

    def rate(t, y):
        v = amplitude * omega * np.cos(omega * t)
        top = FC * (1 + (RATIO - 1) * np.exp(-((v / STRIBECK) ** 2)))
        change = v - K * abs(v) / top * y[0]
        return [change, (K * y[0] + DAMPING * change + VISCOUS * v) * v]

    work, z = 0.0, 0.0
    for quarter in range(4 * 6):
        start = quarter / (4 * frequency)
        done = solve_ivp(rate, (start, start + 0.25 / frequency), [z, 0.0], "DOP853", rtol=1e-11, atol=1e-16)
        z = done.y[0, -1]
        work = done.y[1, -1] + (work if quarter % 4 else 0.0)
    return work


@pytest.mark.parametrize("stribeck", [3e-2, 1e-3, 1e-5])
def test_lugre_along_several_harmonics(stribeck):
    """Forces of a motion with minor reversals, closed after three periods, by DOP853 from one reversal to the next; velocities of
    up to 0.4 m/s. On the panels that are tried first, coefficients err by a millionth, and so does their derivative
    from differences of twice as many."""
    system = condense(oscillator(LuGre(1.0, K, DAMPING, VISCOUS, RATIO, stribeck)), 1.0, "1:+X", ["1:+X"], 5e-3, None)
    omega, motion = 2 * np.pi * 100.0, 5e-4 * np.array([[1.0, 0.1, 0.2, 0.35, -0.05, 0.02]])
    orders = np.array([1, 3, 5])

    def velocity(x):
        return omega * (orders * (motion[0, 1::2] * np.cos(orders * x) - motion[0, ::2] * np.sin(orders * x))).sum()

    def top(v):
        return FC * (1 + (RATIO - 1) * np.exp(-((v / stribeck) ** 2)))

    def rate(x, y):
        v = velocity(x)
        z = v - abs(v) * y[0] / top(v)
        force = y[0] + DAMPING * z + VISCOUS * v
        return np.concatenate(
            [[K * z / omega, force * v / omega], *([force * np.cos(n * x), force * np.sin(n * x)] for n in orders)]
        )

    grid = np.linspace(0, 2 * np.pi, 4001)
    speeds = np.array([velocity(x) for x in grid])
    turns = [brentq(velocity, a, b) for a, b, s, e in zip(grid, grid[1:], speeds, speeds[1:]) if s * e < 0]
    assert len(turns) == 6
    bristle = 0.0
    for _ in range(3):
        y = np.append(bristle, np.zeros(7))
        for a, b in pairwise([0.0, *turns, 2 * np.pi]):
            y = solve_ivp(rate, (a, b), y, "DOP853", rtol=1e-10, atol=1e-13).y[:, -1]
        bristle = y[0]
    expected = y[2:] / np.pi - K * motion[0]
    forces, jacobian, lost, _ = system.contact_forces(motion, omega)
    assert lost[0] == pytest.approx(y[1], rel=2e-6)
    np.testing.assert_allclose(forces[0], expected, atol=2e-6 * np.abs(expected).max())
    for c in range(6):
        step = 1e-9 * np.eye(6)[None, c]
        more, less = (system.contact_forces(motion + s * step, omega, 2)[0][0] for s in (1, -1))
        np.testing.assert_allclose(jacobian[0, 0][:, c], (more - less) / 2e-9, atol=1e-5 * np.abs(jacobian).max())


def clip(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


def oscillator(law):
    """1 kg at 100 Hz that rubs on a wall with 30 N."""
    host = Matrices(np.diag([1.0, 1.0]), np.diag([(200 * np.pi) ** 2, 1e9]), (Dof(1, "+X"), Dof(1, "+Z")))
    wall = Matrices(np.diag([1e6, 1e6]), np.diag([1e16, 1e16]), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall")))
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, 30.0, 1.0)
    return BeamModel(host, wall, (joint,), Damping(ratio=0.003), "oscillator")


LAWS = [
    (Masing(1.0, K), lambda a, f: masing_area(K, FC, a)),
    (Coulomb(1.0, 100 * K), lambda a, f: masing_area(100 * K, FC, a)),
    (ParallelMasing(1.0, K, *SHARES), lambda a, f: springs(*SHARES, a)),
    (Iwan(1.0, K), lambda a, f: springs(*iwan_springs(-0.5, 1.0, 60), a)),
    (Iwan(1.0, K, -0.2, 0.0, 20), lambda a, f: springs(*iwan_springs(-0.2, 0.0, 20), a)),
    (RegularisedMasing(1.0, K, 8), lambda a, f: regularised_area(K, FC, a, 8.0)),
    (RegularisedMasing(1.0, K, 1), lambda a, f: regularised_area(K, FC, a, 1.0)),
    (RegularisedMasing(1.0, K, 0.5), lambda a, f: regularised_area(K, FC, a, 0.5)),
    (Dahl(1.0, K), lambda a, f: dahl_area(K, FC, a)),
    (Dahl(1.0, K, 0.5), lambda a, f: rate_independent(lambda y: K * max(1 - y / FC, 0.0) ** 0.5, a)),
    (Dahl(1.0, K, 2.0), lambda a, f: rate_independent(lambda y: K * max(1 - y / FC, 0.0) ** 2, a)),
    *(
        (
            BoucWen(1.0, K, n, g),
            lambda a, f, n=n, g=g: rate_independent(
                lambda y: K * (1 - abs(y / FC) ** n * (g + (1 - g) * np.sign(y))) if y < FC else 0.0, a
            ),
        )
        for n, g in ((1.0, -0.5), (2.0, 0.0), (8.0, 0.3))
    ),
    *(
        (
            Valanis(1.0, K, kappa),
            lambda a, f, kappa=kappa: rate_independent(
                lambda y: K * max(1 - y / FC, 0.0) / (1 - kappa * min(y / FC, 1.0)), a
            ),
        )
        for kappa in (0.3, 0.9)
    ),
    (ModifiedIwan(1.0, K, 0.8, 0.5), lambda a, f: springs(*iwan_springs(0.8, 0.5, 60), a)),
    (LuGre(1.0, K), lambda a, f: dahl_area(K, FC, a)),
    (LuGre(1.0, K, DAMPING, VISCOUS, RATIO, STRIBECK), lugre_area),
]


def found_and_expected(law, area, force=60.0):
    """Loss per cycle as the solver books it, and the area of the loop at the amplitude of the slip it found."""
    frequencies = np.array([95.0, 101.0, 108.0])
    found = frf(
        oscillator(law), frequencies, force, "1:+X", ["1:+X", "wall:1:+X"], settings=HarmonicBalance(harmonics=1)
    )
    assert found.converged.all()
    slips = np.abs(found.values[:, 0, 0] - found.values[:, 1, 0])
    return found.friction_power / frequencies, np.array([area(*pair) for pair in zip(slips, frequencies, strict=True)])


@pytest.mark.parametrize(("law", "area"), LAWS, ids=[f"{law.name} {law.parameters[:1]}" for law, _ in LAWS])
def test_the_loss_is_the_area_of_the_loop(law, area):
    """To a millionth, without a number that the user would have to set."""
    np.testing.assert_allclose(*found_and_expected(law, area), rtol=1e-6)


def test_the_loss_of_a_law_of_ones_own():
    """It has corners that the quadrature cannot know of: some millionths."""
    law = register_law("clip for steady states", clip)(1.0, K)
    np.testing.assert_allclose(*found_and_expected(law, lambda a, f: masing_area(K, FC, a)), rtol=5e-6)


@pytest.mark.parametrize("slip", [0.5, 0.9])
def test_no_loss_while_eq_4_sticks_and_a_small_one_of_eq_5(slip):
    force = slip * FC * 0.012
    stuck, _ = found_and_expected(Masing(1.0, K), lambda a, f: 0.0, force)
    assert np.all(stuck == 0.0)
    micro, expected = found_and_expected(
        RegularisedMasing(1.0, K, 3), lambda a, f: regularised_area(K, FC, a, 3), force
    )
    assert np.all(micro > 0)
    np.testing.assert_allclose(micro, expected, rtol=1e-6)


@pytest.mark.parametrize(
    "law",
    [
        Masing(0.3, 1e9),
        ParallelMasing(0.3, 1e9, [0.5, 0.5], [0.2, 0.8]),
        Iwan(0.3, 1e9),
        Dahl(0.3, 1e9),
        Dahl(0.3, 1e9, 2.0),
        RegularisedMasing(0.3, 1e9, 8),
        RegularisedMasing(0.3, 1e9, 1),
        LuGre(0.3, 1e9, 1e3, 10.0, 1.3, 1e-3),
        BoucWen(0.3, 1e9, 2.0, -0.5),
        BoucWen(0.3, 1e9, 1.0, 0.2),
        Valanis(0.3, 1e9, 0.9),
        ModifiedIwan(0.3, 1e9, 0.8),
    ],
    ids=lambda law: f"{law.name} {law.parameters[:1]}",
)
@pytest.mark.parametrize("force", [1000.0, 3000.0])
def test_power_balance_of_every_law(law, force):
    """Input = friction + damping within 1e-4 of the input, in every steady state of the double beam."""
    model = double_beam(law, force, Section(0.5, 0.04, 0.005, elements=6), damping=Damping(ratio=0.003))
    found = frf(model, np.linspace(14, 34, 9), 1.0, "beam 2:6:+Z", ["beam 2:6:+Z"])
    assert found.converged.all()
    assert found.power_error <= 1e-4
    assert np.all(found.friction_power >= 0) and found.friction_power.max() > 0.1 * found.input_power.min()


@pytest.mark.parametrize(
    "law", [Masing(0.3, 1e9), Dahl(0.3, 1e9), RegularisedMasing(0.3, 1e9, 8.0), Valanis(0.3, 1e9, 0.9)]
)
@pytest.mark.parametrize("force", [3e-10, 7e5])
def test_powers_that_rounding_makes_are_no_imbalance(law, force):
    """Friction so small beside what goes to and fro that it is below the residual: nothing is off that could be on."""
    tip = "beam 2:1:+Z"
    response = frf(
        double_beam(law, 13.0, Section(0.5, 0.04, 0.005, elements=1)), np.array([11.0, 15.0]), force, tip, [tip]
    )
    assert response.converged.all()
    assert not [finding for finding in response.findings if finding.code == "power-balance"]


@pytest.mark.parametrize("draw", range(12))
def test_the_error_of_a_given_number_of_harmonics(draw):
    """Against a solution of a tolerance of 0.001: orders 1 and 3 had been judged by the next ones alone."""
    rng = np.random.default_rng([29, draw])
    law = [Masing, Dahl, Iwan][draw % 3](0.3, 10 ** rng.uniform(8.5, 9.5))
    model = double_beam(
        law, 100.0, Section(0.5, 0.04, 0.005, elements=2), damping=Damping(ratio=10 ** rng.uniform(-3, -1.7))
    )
    tip, line, force = "beam 2:2:+Z", np.array([rng.uniform(8.0, 40.0)]), 30.0 * 10 ** rng.uniform(-2.0, -0.8)
    best = frf(model, line, force, tip, [tip], HarmonicBalance(1e-3))
    for highest in (1, 3, 7):
        few = frf(model, line, force, tip, [tip], HarmonicBalance(harmonics=highest))
        away = abs(few.values[0, 0, 0] / best.values[0, 0, 0] - 1)
        assert away <= 1e-12 + few.error_estimate[0] + best.error_estimate[0]
