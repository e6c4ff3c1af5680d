"""Steady states are found without a guess wherever there are any, for all laws.

Double beam of Gaul, Roseira and Becker, Shock and Vibration 15 (2008), 20 contact pairs, from free sliding to sticking.
"""

import numpy as np
import pytest

from ema.data import Damping
from ema.simulate import (
    BoucWen,
    Dahl,
    HarmonicBalance,
    Iwan,
    LuGre,
    Masing,
    RegularisedMasing,
    Valanis,
    double_beam,
    frf,
    resonance,
)
from ema.simulate.continuation import lowered_slip_forces
from ema.simulate.harmonic import condense

TIP = "beam 2:20:+Z"
LAWS = [
    Masing(0.3, 2e9),
    Iwan(0.3, 2e9),
    RegularisedMasing(0.3, 2e9, 8.0),
    BoucWen(0.3, 2e9, 2.0, 0.1),
    Dahl(0.3, 2e9),
    Valanis(0.3, 2e9, 0.9),
    LuGre(0.3, 2e9, 1e3, 10.0, 1.1, 1e-2),
]


def condensed(law, normal_force):
    return condense(double_beam(law, normal_force, damping=Damping(mass_factor=2.0)), 1.0, TIP, [TIP], 5e-3, None)


def test_a_smooth_law_near_its_damping_optimum():
    """At 36 Hz and F_N/F_E 225 Newton's method had met forces that jump with the number of their nodes.

    A Masing spring is the limit of the law for a large exponent: with 32 the response is its own within 0.5 %, with 8
    within 2 %.
    """
    smooth, smoother, limit = (
        condensed(law, 225.0) for law in (RegularisedMasing(0.3, 2e9, 8.0), RegularisedMasing(0.3, 2e9, 32.0), LAWS[0])
    )
    points = [system.solve(36.0) for system in (smooth, smoother, limit)]
    assert all(point is not None for point in points)
    heights = [abs(system.first(point)[0]) for system, point in zip((smooth, smoother, limit), points, strict=True)]
    assert heights[0] == pytest.approx(heights[2], rel=2e-2)
    assert heights[1] == pytest.approx(heights[2], rel=5e-3)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_random_forces_and_frequencies(law):
    rng = np.random.default_rng(60)
    for normal_force, frequency in zip(10 ** rng.uniform(1, 4, 3), rng.uniform(10, 60, 3), strict=True):
        system = condensed(law, float(normal_force))
        point = system.solve(float(frequency))
        assert point is not None, f"F_N {normal_force!r} N at {frequency!r} Hz"
        supplied, friction, damping = system.powers(point)
        assert friction + damping == pytest.approx(supplied, rel=1e-4)


@pytest.mark.parametrize("draw", range(2))
def test_no_frequency_beside_a_peak_responds_more(draw):
    """Peaks with superharmonics on their flanks: a fine grid of single frequencies stays within the stated errors."""
    rng = np.random.default_rng([72, draw])
    ratio, damping, stiffness = 10 ** rng.uniform(1.7, 3.7), 10 ** rng.uniform(-3.3, -2), 10 ** rng.uniform(8.5, 9.7)
    tip = "beam 2:4:+Z"
    model = double_beam(Masing(0.3, stiffness), ratio, elements=4, damping=Damping(ratio=damping))
    peak = resonance(model, 1.0, tip, tip, (12.0, 45.0))
    width = float(np.clip(3 * peak.frequency_error, 0.3 * peak.damping, 0.15))
    grid = peak.frequency * np.linspace(1 - width, 1 + width, 31)
    line = frf(model, grid, 1.0, tip, [tip], settings=HarmonicBalance(tolerance=2e-3))
    heights = np.abs(line.values[:, 0, 0])
    highest = int(np.nanargmax(heights))
    doubt = peak.error_estimate + line.error_estimate[highest]
    assert heights[highest] <= (1 + doubt) * abs(peak.amplitude)
    assert abs(grid[highest] / peak.frequency - 1) <= peak.frequency_error + 1.01 * (grid[1] / grid[0] - 1)


def test_a_rival_is_a_peak_of_its_own():
    """20 pairs at F_N/F_E 1000: another peak within 7 % of the largest, which single frequencies beside it confirm."""
    model = double_beam(Masing(0.3, 1e9), 1000.0, damping=Damping(mass_factor=2.0))
    peak = resonance(model, 1.0, TIP, TIP, (14.0, 38.0))
    assert peak.frequency_error > 10 * abs(peak.error_estimate * peak.damping)
    (rival,) = peak.rivals
    assert 0.93 * abs(peak.amplitude) <= abs(rival.amplitude) < abs(peak.amplitude)
    between = np.sqrt(peak.frequency * rival.frequency)
    line = frf(model, np.array([between, rival.frequency, 1.03 * rival.frequency]), 1.0, TIP, [TIP])
    heights = np.abs(line.values[:, 0, 0])
    assert heights[1] > max(heights[0], heights[2])


def test_slip_forces_are_lowered_along_the_arc():
    """From two solutions with higher slip forces to that which Newton's method finds from the stuck side."""
    system = condensed(LAWS[1], 100.0)
    omega = 2 * np.pi * 25.0
    gains = system.gains(omega, 3)
    system.left = system.budget
    reference = system._cold_start(omega, gains)
    levels = (1.5, 1.4)
    known = [(level, system._newton(omega, reference[1], gains, level)[1]) for level in levels]
    motion = lowered_slip_forces(system, omega, gains, known)
    assert np.linalg.norm(motion - reference[1]) < 0.1 * np.linalg.norm(reference[1])
    again = system._newton(omega, motion, gains)
    np.testing.assert_allclose(again[1], reference[1], atol=1e-6 * np.linalg.norm(reference[1]))
