"""Snap-back of the double beam in time.

Gaul, Roseira and Becker, "Structural damping with friction beams", Shock and Vibration 15 (2008) 291-298, Sec. 1 and
Fig. 3. The paper gives no dimensions: the reference set is L 0.5 m, 40 x 5 mm each, steel, 20 elements, k_T 1e9 N/m,
mu 0.3, a load of 20 N, and the closed forms for that set (beam theory) are the truth here.
"""

import numpy as np
import pytest
from scipy.linalg import eigh

from ema.data import Damping
from ema.elements import Section
from ema.errors import InputError
from ema.simulate import (
    Coulomb,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ParallelMasing,
    RegularisedMasing,
    double_beam,
    respond,
    snapback,
)
from ema.simulate.reduction import modal_base
from ema.simulate.statics import ramp
from ema.simulate.structure import assemble
from ema.simulate.transient import prepare

TIP = "beam 2:20:+Z"
E, RHO, L, B, H, MU, LOAD = 210e9, 7850.0, 0.5, 0.04, 0.005, 0.3, 20.0
INERTIA = B * H**3 / 12
SINGLE = 1.8751040687**2 / (2 * np.pi * L**2) * np.sqrt(E * INERTIA / (RHO * B * H))
FREE_DEFLECTION = LOAD * L**3 / (6 * E * INERTIA)
STATIC_STICK = 3 * LOAD * L / (4 * MU * H)


def double(force, stiffness=1e9, **options):
    return double_beam(Masing(MU, stiffness), force, **options)


@pytest.fixture(scope="module")
def runs():
    """Two seconds after release for the normal forces of the study."""
    forces = (100.0, 1000.0, 3000.0, 5000.0, 6000.0, 8000.0, 12000.0)
    return {force: snapback(double(force), LOAD, TIP, 2.0) for force in forces}


def deflection(force):
    """Tip deflection (dof value) after the slow ramp."""
    problem = prepare(double(force), [TIP])
    load = LOAD * problem.system.row(TIP)
    return float(problem.system.row(TIP) @ ramp(problem.system, problem.laws, load).displacements)


def test_frequency_of_one_beam():
    system = assemble(double(0.0))
    values = eigh(system.stiffness, system.mass, eigvals_only=True, subset_by_index=(0, 0))
    assert pytest.approx(16.710, abs=0.0005) == SINGLE
    assert np.sqrt(values[0]) / (2 * np.pi) == pytest.approx(SINGLE, rel=1e-4)


@pytest.mark.parametrize(
    ("stiffness", "ratio", "tolerance"), [(1e9, 1.890, 0.01), (1.01e10, 2.00, 0.02), (1e12, 2.00, 0.01)]
)
def test_stuck_beams_vibrate_like_one_of_double_thickness(stiffness, ratio, tolerance):
    """A flipped sign of a rotation in Eq. (2) would leave the stuck frequency at that of the sliding beams."""
    found = modal_base(assemble(double(0.0, stiffness))).frequencies[0] / (2 * np.pi)
    assert found / SINGLE == pytest.approx(ratio, abs=tolerance)
    assert found / SINGLE < 2.0


def test_the_stick_limit_is_approached_with_the_square_of_the_element_length():
    """It ends slightly below a factor of two in frequency: axial motion adds rotary inertia of order (h/L)^2."""
    ratios = [
        modal_base(
            assemble(double(0.0, 1e14, section=Section(L, B, H, elements=n), normal_stiffness=1e13))
        ).frequencies[0]
        / (2 * np.pi)
        / SINGLE
        for n in (5, 10, 20)
    ]
    steps = np.diff(ratios)
    assert steps[0] / steps[1] == pytest.approx(4.0, rel=0.15)
    limit = ratios[-1] + steps[1] / 3
    assert 0 < 2 - limit < 5 * (H / L) ** 2 * 2


def test_static_deflection_free_sliding_and_stuck():
    assert deflection(0.0) == pytest.approx(4.762e-3, rel=1e-3)
    assert pytest.approx(4.762e-3, rel=1e-3) == FREE_DEFLECTION
    slope = (deflection(400.0) - deflection(200.0)) / 200.0 * 1000
    assert slope == pytest.approx(-0.714e-3, rel=0.03)
    assert deflection(8000.0) == pytest.approx(1.29e-3, rel=0.02)
    assert deflection(1000.0) / deflection(8000.0) == pytest.approx(3.1, abs=0.1)


def test_full_static_stick_begins_at_the_closed_form_force():
    assert pytest.approx(5000.0) == STATIC_STICK
    stuck = deflection(1e6)
    forces = np.linspace(3000, 7000, 41)
    loose = [f for f in forces if deflection(f) > stuck * (1 + 1e-9)]
    assert max(loose) == pytest.approx(STATIC_STICK, rel=0.10)


def test_static_stick_does_not_mean_no_slip_after_the_release(runs):
    """The release raises the interface forces to about twice the static ones."""
    assert runs[6000.0].dissipated.sum() > 0.05 * runs[6000.0].energy.total[0]
    assert runs[12000.0].dissipated.sum() < 1e-9 * runs[12000.0].energy.total[0]
    stuck = snapback(double(1e6), LOAD, TIP, 0.2)
    rise = np.abs(stuck.forces).max() / np.abs(stuck.forces[:, 0]).max()
    assert 1.5 < rise < 2.5


def test_energy_balance_and_no_energy_from_nowhere(runs):
    for run in runs.values():
        assert run.energy.error <= 1e-6
        assert np.diff(run.energy.total).max() <= 1e-9 * run.energy.total[0]
        assert run.error_estimate <= 1e-3
        assert [finding.code for finding in run.findings if finding.severity != "info"] == []
        np.testing.assert_allclose(run.dissipated.sum(), run.energy.friction[-1], rtol=1e-9, atol=1e-12)


def test_residual_energy_after_two_seconds(runs):
    left = {force: run.energy.total[-1] / run.energy.total[0] for force, run in runs.items()}
    assert left[1000.0] <= 0.01
    assert left[3000.0] == pytest.approx(0.15, abs=0.02)
    assert left[5000.0] == pytest.approx(0.48, abs=0.03)
    assert left[8000.0] == pytest.approx(0.88, abs=0.03)


def test_stuck_amplitude_stays(runs):
    tip, times = runs[12000.0].displacements[0], runs[12000.0].times
    cycles = 60 / 31.55
    peaks = [np.abs(tip[(times >= t) & (times < t + 0.1)]).max() for t in (0.0, cycles - 0.1)]
    assert peaks[1] == pytest.approx(peaks[0], rel=0.01)


def mode_motion(run):
    """Tip motion below 60 Hz (zero phase), so that the waves of the release do not disturb the peaks."""
    spectrum = np.fft.rfft(np.concatenate([run.displacements[0], run.displacements[0][::-1]]))
    frequencies = np.fft.rfftfreq(2 * len(run.times), run.times[1])
    spectrum *= 1 / (1 + (frequencies / 60) ** 12)
    return np.fft.irfft(spectrum, 2 * len(run.times))[: len(run.times)]


def test_sliding_phase_has_the_frequency_of_one_beam_and_the_coulomb_decrement(runs):
    run = runs[100.0]
    tip = mode_motion(run)
    up = np.flatnonzero((tip[1:-1] > tip[:-2]) & (tip[1:-1] >= tip[2:]) & (tip[1:-1] > 1e-3)) + 1
    up = up[1:10]
    periods = np.diff(run.times[up])
    assert 1 / periods.mean() == pytest.approx(SINGLE, rel=0.02)
    drop = -np.diff(tip[up]).mean()
    assert drop == pytest.approx(4 * MU * 100.0 * H * L**2 / (6 * E * INERTIA), rel=0.05)
    assert drop == pytest.approx(0.279e-3, abs=0.01e-3)


def test_fig_3_sliding_then_sticking(runs):
    """At 1 kN the beam first slides and then sticks at about the frequency of double thickness; at 8 kN it only sticks."""
    sampling = 1 / runs[1000.0].times[1]
    for force, low, high in ((1000.0, 28.0, 32.5), (8000.0, 30.5, 32.0)):
        tail = runs[force].displacements[0][int(1.0 * sampling) :]
        spectrum = np.abs(np.fft.rfft((tail - tail.mean()) * np.hanning(len(tail)), 8 * len(tail)))
        frequency = np.argmax(spectrum) * sampling / (8 * len(tail))
        assert low < frequency < high
    assert runs[8000.0].displacements[0, 0] < runs[1000.0].displacements[0, 0] / 3
    losses = np.interp([0.3, 2.0], runs[1000.0].times, runs[1000.0].energy.friction)
    assert losses[0] > 0.98 * losses[1]


def test_most_of_the_slip_is_near_the_free_end(runs):
    run = runs[1000.0]
    largest = np.abs(run.slips).max(axis=1)
    assert np.all(np.diff(largest) > 0)
    density = run.dissipated / np.append(np.ones(19), 0.5)
    assert density[0] / density[-1] <= 0.2
    near_stick = runs[3000.0].slip_time
    assert near_stick[0] < 0.5 * near_stick[8:12].mean()


def energy_integral(model, duration=1.5):
    run = snapback(model, LOAD, TIP, duration)
    share = run.energy.total / run.energy.total[0]
    return float(np.sum(0.5 * (share[1:] + share[:-1])) * run.times[1])


AREAS = np.append(np.ones(19), 0.5)


def gain(weights, force):
    shares = AREAS * weights / (AREAS * weights).sum()
    return 1 - energy_integral(double(force, force_shares=shares)) / energy_integral(double(force))


def test_more_force_near_the_tip_helps_below_the_optimum():
    """Pressure growing linearly towards the tip, integral of the energy over 1.5 s against uniform pressure."""
    assert gain(np.arange(1, 21), 500.0) >= 0.10
    assert gain(np.arange(1, 21), 1000.0) >= 0.10


def test_pressing_the_outer_half_only_helps_first_and_hurts_near_the_optimum():
    """The advice reverses between 500 N and 1 kN (the best uniform force is 1.2 kN) when the root is left open."""
    outer = (np.arange(1, 21) > 10).astype(float)
    assert gain(outer, 500.0) >= 0.10
    assert gain(outer, 2000.0) < -0.10


def test_homogeneity():
    one = snapback(double(800.0), LOAD, TIP, 0.3)
    two = snapback(double(1600.0), 2 * LOAD, TIP, 0.3)
    np.testing.assert_allclose(two.displacements, 2 * one.displacements, atol=2e-6 * one.displacements.max())


def test_regularised_rule_looks_like_material_damping_where_masing_is_stuck():
    """Energy left half a second after the release at 8 kN: the tail of Eq. (5), m = 8, is not material damping."""
    left = {}
    for law in (RegularisedMasing(MU, 1e9, 8), Masing(MU, 1e9)):
        run = snapback(double_beam(law, 8000.0), LOAD, TIP, 0.5, tolerance=1e-2)
        assert run.energy.error <= 1e-6
        left[law.name] = run.energy.total[-1] / run.energy.total[0]
    assert left["masing"] == pytest.approx(0.87, abs=0.03)
    assert left["regularised masing"] < 0.8 * left["masing"]


def test_truncated_modes_with_static_correction_agree(runs):
    short = snapback(double(1000.0), LOAD, TIP, 0.5, modes=12)
    full = runs[1000.0].displacements[0][: short.displacements.shape[1]]
    assert np.abs(short.displacements[0] - full).max() <= 2e-3 * full.max()
    assert short.energy.error <= 1e-6


def test_background_damping_leaves_the_energy_balance_exact():
    for damping in (Damping(ratio=0.01), Damping(mass_factor=2.0)):
        run = snapback(double(1000.0, damping=damping), LOAD, TIP, 0.3)
        assert run.energy.damping[-1] > 0.01 * run.energy.total[0]
        assert run.energy.error <= 1e-6


def test_a_falling_normal_force_pumps_no_energy_in():
    """F_N is switched between 3 kN and 300 N every 5 ms; forces above the new limit are projected and booked."""
    count = 2001
    times = np.arange(count) / 5000.0
    forces = np.where((times // 0.005) % 2 == 0, 3000.0, 300.0)[None]
    push = np.where(times < 0.1, 20.0 * times / 0.1, 0.0)[None]
    run = respond(double(3000.0), push, [TIP], 5000.0, [TIP], normal_forces=forces, tolerance=0.02)
    after = run.times > 0.1005
    assert run.energy.projection[-1] > 0.01 * run.energy.total.max()
    assert np.diff(run.energy.total[after]).max() <= 1e-9 * run.energy.total.max()
    assert run.energy.error <= 1e-6
    assert np.abs(run.forces).max() <= MU * 3000.0 / 19.5 * (1 + 1e-9)


def pressing(t):
    """Normal force that swings between 400 N and 2800 N."""
    return 1600.0 + 1200.0 * np.sin(300.0 * t)


@pytest.fixture(scope="module")
def swinging():
    return snapback(double(1600.0), LOAD, TIP, 0.1, normal_forces=pressing)


def test_normal_force_over_time_is_followed_and_its_energy_booked(swinging):
    run = swinging
    assert run.energy.error <= 1e-6
    assert run.error_estimate <= 1e-3
    assert run.energy.projection[-1] > 1e-3 * run.energy.total[0]
    np.testing.assert_allclose(run.normal_forces[0], pressing(run.times))
    shares = AREAS / AREAS.sum()
    assert np.all(np.abs(run.forces) <= MU * shares[:, None] * run.normal_forces[0] * (1 + 1e-2) + 1e-9)


def test_normal_force_as_array_and_as_function_are_the_same(swinging):
    times = np.arange(501) / 5000.0
    run = snapback(double(1600.0), LOAD, TIP, 0.1, normal_forces=pressing(times)[None])
    np.testing.assert_array_equal(run.displacements, swinging.displacements)
    constant = snapback(double(3000.0), LOAD, TIP, 0.05, normal_forces=lambda t: 1600.0)
    np.testing.assert_allclose(
        constant.displacements, snapback(double(1600.0), LOAD, TIP, 0.05).displacements, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize(
    "forces", [lambda t: -1.0, lambda t: float("nan"), lambda t: [1.0, 2.0], np.ones((1, 7)), np.full((1, 51), np.nan)]
)
def test_normal_forces_that_are_none(forces):
    with pytest.raises(InputError, match="normal force"):
        snapback(double(1600.0), LOAD, TIP, 0.01, normal_forces=forces)


@pytest.mark.parametrize(
    "law",
    [
        Masing(MU, 1e9),
        Coulomb(MU),
        ParallelMasing(MU, 1e9, [0.6, 0.4], [0.3, 0.7]),
        Iwan(MU, 1e9, springs=12),
        RegularisedMasing(MU, 1e9, 8.0),
        Dahl(MU, 1e9),
        LuGre(MU, 1e9),
    ],
    ids=lambda law: law.name,
)
def test_energy_balance_of_every_law(law):
    """With a normal force that rises and falls, so that the books of friction and projection are both needed."""
    run = snapback(
        double_beam(law, 1500.0, Section(0.5, 0.04, 0.005, elements=5)),
        LOAD,
        "beam 2:5:+Z",
        0.05,
        tolerance=0.1,
        normal_forces=pressing,
    )
    assert run.energy.error <= 1e-6
    assert run.energy.friction[-1] > 0.05 * run.energy.total[0]
