"""Loop areas of the friction laws against closed forms and quadrature.

Gaul, Roseira and Becker, "Structural damping with friction beams", Shock and Vibration 15 (2008), Eqs. (4) and (5);
Segalman, "A four-parameter Iwan model for lap-type joints", J. Appl. Mech. 72 (2005); Dahl (1968).
"""

import numpy as np
import pytest

from ema.simulate import Coulomb, Dahl, Iwan, LuGre, Masing, RegularisedMasing, loop
from ema.simulate.friction import iwan_springs
from ema.simulate.loops import dahl_area, drive, masing_area, regularised_area

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
@pytest.mark.parametrize("ratio", [0.7, 1.0, 2.0, 5.0])
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
    areas = [loop(law, FN, 2 * XC, samples=n, frequency=10.0).area for n in (20000, 80000)]
    assert areas[0] == pytest.approx(areas[1], rel=2e-6)
    slow = loop(law, FN, 2 * XC, samples=20000, frequency=0.1).area
    assert slow > 1.03 * areas[0]
