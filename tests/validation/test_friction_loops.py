"""Loop areas of the friction laws against closed forms and quadrature.

Gaul, Roseira and Becker, "Structural damping with friction beams", Shock and Vibration 15 (2008), Eqs. (4) and (5);
Segalman, "A four-parameter Iwan model for lap-type joints", J. Appl. Mech. 72 (2005); Dahl (1968).
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.simulate import (
    Coulomb,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ParallelMasing,
    RegularisedMasing,
    frf,
    loop,
    register_law,
)
from ema.simulate.friction import iwan_springs
from ema.simulate.loops import drive, enclosed_area
from ema.simulate.transient import Stepper, prepare
from tests.closed_forms import dahl_area, masing_area, regularised_area

K, FC = 1e6, 30.0
MU, FN = 0.3, 100.0
XC = FC / K


@pytest.mark.parametrize("ratio", [1.05, 1.5, 2.0, 5.0, 40.0])
def test_masing(ratio):
    found = loop(Masing(MU, K), FN, ratio * XC, samples=40000).area
    assert found == pytest.approx(masing_area(K, FC, ratio * XC), rel=1e-6)


def test_masing_does_not_dissipate_below_the_limit():
    assert abs(loop(Masing(MU, K), FN, 0.999 * XC).area) < 1e-12 * FC * XC


def test_masing_amplitude_of_most_dissipation_is_twice_the_critical_one():
    forces = np.linspace(5, 55, 501)
    areas = [masing_area(K, f, XC) for f in forces]
    assert forces[int(np.argmax(areas))] == pytest.approx(K * XC / 2, abs=0.1)


def test_rigid_limit_is_the_rectangle():
    found = loop(Coulomb(MU, stick_stiffness=1e12), FN, 1e-4, samples=40000).area
    assert found == pytest.approx(4 * FC * 1e-4, rel=1e-6)


@pytest.mark.parametrize("exponent", [0.5, 1, 2, 3, 8, 8.5, 30])
@pytest.mark.parametrize("ratio", [0.7, 1.0, 2.0, 5.0, 60.0])
def test_regularised(exponent, ratio):
    """Odd exponents too: the rule needs \\|F/F_C\\|^m, with the bare power an odd m diverges on one side."""
    found = loop(RegularisedMasing(MU, K, exponent), FN, ratio * XC, samples=20000)
    expected = regularised_area(K, FC, ratio * XC, exponent)
    assert found.area == pytest.approx(expected, rel=1e-6, abs=1e-9 * FC * XC)
    assert np.abs(found.forces).max() <= FC


def test_regularised_against_masing_at_twice_the_critical_amplitude():
    found = loop(RegularisedMasing(MU, K, 8), FN, 2 * XC, samples=20000).area
    assert found / masing_area(K, FC, 2 * XC) == pytest.approx(0.990, abs=0.003)


@pytest.mark.parametrize("exponent", [2.0, 8.0])
def test_regularised_dissipates_below_the_limit_with_amplitude_to_the_m_plus_2(exponent):
    areas = [regularised_area(K, FC, a * XC, exponent) for a in (0.2, 0.3)]
    slope = np.log(areas[1] / areas[0]) / np.log(1.5)
    assert slope == pytest.approx(exponent + 2, abs=0.1)


def test_a_preload_ratchets_down_under_the_regularised_rule_only():
    """200 cycles of 0.15 F_C about 0.8 F_C: relaxed by Eq. (5), kept by Eq. (4)."""
    swing = 0.15 * XC * np.sin(2 * np.pi * np.arange(1, 200 * 64 + 1) / 64)
    path = np.concatenate([np.linspace(0, 1, 100), 1 + 0 * swing]) * 0.8 * XC
    path[100:] += swing
    kept = drive(Masing(MU, K), path, FN)
    relaxed = drive(RegularisedMasing(MU, K, 8), path, FN)
    assert kept[-64:].mean() / FC == pytest.approx(0.80, abs=1e-3)
    assert relaxed[100:164].mean() / FC > 0.7
    assert relaxed[-64:].mean() / FC < 0.6


@pytest.mark.parametrize("ratio", [0.3, 1.0, 4.0])
def test_dahl(ratio):
    found = loop(Dahl(MU, K), FN, ratio * XC, samples=30000).area
    assert found == pytest.approx(dahl_area(K, FC, ratio * XC), rel=1e-6)


@pytest.mark.parametrize("ratio", [0.5, 2.0, 4.0])
def test_iwan_is_the_sum_of_its_springs(ratio):
    law = Iwan(MU, K, -0.5, 1.0)
    expected = sum(masing_area(K * k, FC * f, ratio * XC) for k, f in zip(*iwan_springs(-0.5, 1.0, 60), strict=True))
    assert loop(law, FN, ratio * XC, samples=60000).area == pytest.approx(expected, rel=1e-6)


def test_lugre_without_rate_effects_is_dahl_and_with_them_is_converged():
    same = loop(LuGre(MU, K), FN, 2 * XC, samples=30000).area
    assert same == pytest.approx(dahl_area(K, FC, 2 * XC), rel=1e-6)
    law = LuGre(MU, K, bristle_damping=30.0, viscous=0.0, static_ratio=1.3, stribeck_velocity=1e-3)
    areas = [loop(law, FN, 2 * XC, samples=n, frequency=10.0).area for n in (40000, 80000)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-6)
    slow = loop(law, FN, 2 * XC, samples=20000, frequency=0.1).area
    assert slow > 1.03 * areas[0]


@pytest.mark.parametrize("ratio", [0.4, 1.1, 6.0])
def test_parallel_springs_are_a_sum_of_closed_forms(ratio):
    shares_k, shares_f = [0.5, 0.3, 0.2], [0.2, 0.3, 0.5]
    found = loop(ParallelMasing(MU, K, shares_k, shares_f), FN, ratio * XC, samples=40000).area
    expected = sum(masing_area(K * k, FC * f, ratio * XC) for k, f in zip(shares_k, shares_f, strict=True))
    assert found == pytest.approx(expected, rel=1e-6)


def quadrature(rate, amplitude, cycles=60):
    """Loss per stabilised cycle of dF/du = rate(F, direction) by DOP853 over the slip, no step of ours in it."""
    force, lost = 0.0, 0.0
    ends = amplitude * np.resize([1.0, -1.0], 2 * cycles)
    start = 0.0
    for n, end in enumerate(ends):
        way = np.sign(end - start)
        solution = solve_ivp(
            lambda _, y, way=way: [way * rate(y[0], way), y[0] * way],
            (0, abs(end - start)),
            [force, 0.0],
            "DOP853",
            rtol=1e-11,
            atol=1e-13 * FC,
        )
        force, work = solution.y[:, -1]
        lost += work if n >= 2 * cycles - 2 else 0.0
        start = end
    return lost


@pytest.mark.parametrize("shape", [0.5, 1.0, 2.0, 3.0])
def test_dahl_of_any_shape_against_a_quadrature(shape):
    """Shapes other than 1 have no closed form."""
    found = loop(Dahl(MU, K, shape), FN, 2 * XC, samples=40000).area
    expected = quadrature(lambda f, way: K * max(1 - way * f / FC, 0.0) ** shape, 2 * XC)
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("exponent", [0.5, 1.0, 3.0, 8.0])
def test_quadrature_of_equation_5(exponent):
    """The quadrature of the closed unloading branch against plain integration of Eq. (5) itself."""

    def rate(f, way):
        return K * (1 - (abs(f / FC) ** exponent if f * way > 0 else 0.0))

    assert regularised_area(K, FC, 2 * XC, exponent) == pytest.approx(quadrature(rate, 2 * XC), rel=1e-6)


def test_lugre_with_rate_effects_against_an_independent_integration():
    """Bristle damping, viscous force and Stribeck velocity under a harmonic motion of 10 Hz."""
    damping, viscous, ratio, stribeck, amplitude, omega = 30.0, 5.0, 1.3, 1e-3, 2 * XC, 20 * np.pi

    def motion(t):
        return amplitude * omega * np.cos(omega * t)

    def rate(t, y):
        v = motion(t)
        top = FC * (1 + (ratio - 1) * np.exp(-((v / stribeck) ** 2)))
        change = v - K * abs(v) / top * y[0]
        return [change, (K * y[0] + damping * change + viscous * v) * v]

    work, z = 0.0, 0.0
    for cycle in range(12):
        for quarter in np.arange(0, 1, 0.25):
            start = (cycle + quarter) / 10
            solution = solve_ivp(rate, (start, start + 0.025), [z, 0.0], "DOP853", rtol=1e-10, atol=1e-16)
            z = solution.y[0, -1]
            work = solution.y[1, -1] + (work if quarter else 0.0)
    law = LuGre(MU, K, damping, viscous, ratio, stribeck)
    found = [loop(law, FN, amplitude, samples=n, frequency=10.0).area for n in (20000, 40000, 160000)]
    assert found[2] == pytest.approx(work, rel=1e-6)
    # of second order in the step
    assert found[1] - work == pytest.approx((found[0] - work) / 4, rel=0.05)


def clip(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


ALL = [
    Masing(1.0, 4e5),
    RegularisedMasing(1.0, 4e5, 8),
    RegularisedMasing(1.0, 4e5, 1.0),
    Dahl(1.0, 4e5),
    Dahl(1.0, 4e5, 2.0),
    Iwan(1.0, 4e5, -0.5, 1.0, 12),
    ParallelMasing(1.0, 4e5, [0.5, 0.5], [0.2, 0.8]),
    LuGre(1.0, 4e5, 10.0, 1.0, 1.3, 1e-2),
    Coulomb(1.0, 4e7),
    register_law("clip of this test", clip)(1.0, 4e5),
]


def oscillator(law, ratio=0.0):
    """1 kg at 100 Hz that rubs on a wall with 30 N."""
    host = Matrices(np.diag([1.0, 1.0]), np.diag([(200 * np.pi) ** 2, 1e9]), (Dof(1, "+X"), Dof(1, "+Z")))
    wall = Matrices(np.diag([1e6, 1e6]), np.diag([1e16, 1e16]), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall")))
    return BeamModel(
        host, wall, (Joint("contact", ((1, 1),), (0.0, 0.0), law, 30.0, 1.0),), Damping(ratio=ratio), "oscillator"
    )


@pytest.mark.parametrize("law", ALL, ids=lambda law: f"{law.name} {law.parameters[:1]}")
def test_the_time_solver_applies_the_law_and_books_its_area(law):
    """Every step's force is that of the law driven along the slips found; friction is the area less what is stored."""
    problem = prepare(oscillator(law), ["1:+X"])
    h, steps = 2e-5, 3000
    t = h * np.arange(steps + 1)
    stepper = Stepper(problem, problem.rest(), h, ["1:+X"])
    push = (60.0 * np.sin(2 * np.pi * 90 * t) * np.minimum(t / 0.01, 1))[:, None]
    run = stepper.run(steps, 1, problem.system.contacts.limits[None].copy(), push)
    slips = np.concatenate([[0.0], run["u"][:, 0]])
    forces = np.concatenate([[0.0], run["f"][:, 0]])
    np.testing.assert_allclose(forces, drive(law, slips, 30.0, h), atol=1e-7 * 30.0)
    assert np.ptp(slips) > 10 * 30.0 / 4e5
    stored = run["energy"][-1, 4]
    assert run["energy"][-1, 0] == pytest.approx(enclosed_area(slips, forces) - stored, rel=1e-9)
    balance = run["energy"][:, [0, 1, 2, 4, 5]].sum(axis=1) - run["energy"][:, 3]
    assert np.abs(balance).max() <= 1e-9 * run["energy"][:, 3].max()


def own_dahl(force, du, k, limit, p0, p1, p2, p3):
    """Dahl with shape 1 in closed form, so exact for any length of the increment."""
    if limit <= 0.0:
        return 0.0
    top = limit if du > 0.0 else -limit
    return top + (force - top) * math.exp(-k * abs(du) / limit)


@pytest.mark.parametrize(
    ("own", "built_in"),
    [(register_law("own dahl", own_dahl)(1.0, 4e5), Dahl(1.0, 4e5)), (ALL[-1], Masing(1.0, 4e5))],
    ids=["smooth", "with corners"],
)
def test_a_law_of_ones_own_is_the_built_in_one_in_both_solvers(own, built_in):
    frequencies = np.array([95.0, 101.0, 104.0])
    one, two = (frf(oscillator(law, 0.003), frequencies, 36.0, "1:+X", ["1:+X"]) for law in (own, built_in))
    assert one.converged.all() and two.converged.all()
    np.testing.assert_allclose(np.abs(one.values[:, 0, 0]), np.abs(two.values[:, 0, 0]), rtol=1e-4)
    states = []
    for law in (own, built_in):
        problem = prepare(oscillator(law), ["1:+X"])
        stepper = Stepper(problem, problem.rest(), 5e-5, ["1:+X"])
        push = np.full((401, 1), 50.0)
        states.append(stepper.run(400, 1, problem.system.contacts.limits[None].copy(), push)["q"])
    np.testing.assert_allclose(states[0], states[1], atol=1e-8 * np.abs(states[1]).max())
