"""Steady states are found without a guess wherever there are any, for all laws.

Double beam of Gaul, Roseira and Becker, Shock and Vibration 15 (2008), 20 contact pairs, from free sliding to sticking.
"""

import numpy as np
import pytest

from ema.data import Damping
from ema.elements import Section
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
from ema.simulate.continuation import Plane, SlipForces, bordered_newton, lowered_slip_forces
from ema.simulate.harmonic import QUADRATURE, condense

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
    model = double_beam(
        Masing(0.3, stiffness), ratio, Section(0.5, 0.04, 0.005, elements=4), damping=Damping(ratio=damping)
    )
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


@pytest.mark.parametrize("draw", range(3))
def test_no_more_nodes_than_a_steady_state_asks_for(draw):
    """A search that takes more nodes on its way gives them back: with half of them forces would err by 1e-6 or more.

    Forces of 64 harmonics cost 16 times as much with the nodes that the hardest step on the way had taken.
    """
    rng = np.random.default_rng([2611, draw])
    law = LuGre(0.3, 1e9, 0.0, 0.0, float(rng.uniform(1.3, 1.6)), float(10 ** rng.uniform(-4.2, -3.5)))
    tip = "beam 2:2:+Z"
    system = condense(double_beam(law, 60.0, Section(0.5, 0.04, 0.005, elements=2)), 2.0, tip, [tip], 5e-3, None)
    point = system.solve(float(rng.uniform(16.0, 16.4)))
    assert point is not None and point.error <= 0.02

    def forces(fine):
        return system.contact_forces(point.amplitudes, point.omega, fine, derive=False)[0]

    best = forces(32)
    errors = [np.linalg.norm(forces(fine) - best) / np.linalg.norm(best) for fine in (1, 2, 4)]
    assert system.fine == 1 or errors[system.fine.bit_length() - 2] > QUADRATURE / 10
    assert errors[system.fine.bit_length() - 1] < QUADRATURE


@pytest.mark.parametrize(("raised", "share"), [(0.0, 1.5), (6.0, 1.5), (9.0, 1.5), (9.0, 5.0)])
def test_a_step_along_a_curve_stays_where_numbers_are(raised, share):
    """Stuck contacts hardly feel their slip forces: Newton's step in their logarithm is of any size, and is cut."""
    law, tip = LuGre(0.3, 1e9, 0.0, 0.0, 1.45, 1.3e-4), "beam 2:2:+Z"
    system = condense(double_beam(law, 43.0, Section(0.5, 0.04, 0.005, elements=2)), 0.012, tip, [tip], 5e-3, None)
    omega = 2 * np.pi * 16.9
    gains = system.gains(omega, 3)
    start = system.drive(omega, 3)
    size = float(np.linalg.norm(start))
    direction = np.append(start.ravel() / size, 0.0)
    path = SlipForces(system, Plane(share * direction, direction, size), omega, gains)
    with np.errstate(all="raise", under="ignore"):
        assert bordered_newton(path, start, np.array([raised])) is None
