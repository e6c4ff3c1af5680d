"""The event-driven mode against itself, the fast mode against it, and both against independent solvers.

Structure and load as in Gaul, Roseira and Becker, Shock and Vibration 15 (2008) 291-298, with fewer elements where an
independent solver has to follow.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ema.data import Damping
from ema.elements import Section
from ema.errors import InputError
from ema.simulate import (
    Iwan,
    Masing,
    ParallelMasing,
    RegularisedMasing,
    double_beam,
    snapback,
    snapback_reference,
)
from ema.simulate.structure import assemble
from ema.simulate.transient import prepare, released
from tests.bench.friction_draws import draw
from tests.bench.friction_truth import Motion, truth
from tests.bench.friction_truth import released as at_rest

TIP = "beam 2:20:+Z"


FORCES = (200.0, 1000.0, 4000.0, 6000.0, 8000.0, 12000.0)


@pytest.fixture(scope="module")
def exact():
    return {
        force: snapback_reference(double_beam(Masing(0.3, 1e9), force), 20.0, TIP, 0.06, check=True) for force in FORCES
    }


def test_reference_mode_converges_to_a_millionth_and_balances_its_energy(exact):
    for run in exact.values():
        assert run.error_estimate <= 1e-6
        assert run.energy.error <= 1e-6
        assert np.diff(run.energy.total).max() <= 1e-9 * run.energy.total[0]
    for force, run in exact.items():
        assert np.abs(run.forces).max() <= 0.3 * force / 19.5 * (1 + 1e-9)


@pytest.mark.parametrize("force", [200.0, 1000.0, 4000.0, 8000.0])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 3e-4])
def test_fast_mode_keeps_its_stated_error(exact, force, tolerance):
    fast = snapback(double_beam(Masing(0.3, 1e9), force), 20.0, TIP, 0.06, tolerance=tolerance)
    true = np.abs(fast.displacements - exact[force].displacements).max() / np.abs(fast.displacements).max()
    assert true <= tolerance
    assert true <= 2 * fast.error_estimate
    np.testing.assert_allclose(fast.dissipated.sum(), exact[force].dissipated.sum(), rtol=0.02, atol=1e-6)


@pytest.mark.parametrize("force", [500.0, 2000.0, 3000.0, 5000.0, 7000.0])
@pytest.mark.parametrize(
    "law", [Masing(0.3, 1e9), ParallelMasing(0.3, 1e9, [0.6, 0.4], [0.3, 0.7])], ids=lambda law: law.name
)
def test_fast_mode_states_no_less_than_its_error(law, force):
    """Ten elements, from sliding to sticking: the true error is below the stated one, and that below a thousandth."""
    model, tip = double_beam(law, force, Section(0.5, 0.04, 0.005, elements=10)), "beam 2:10:+Z"
    truth = snapback_reference(model, 20.0, tip, 0.05)
    fast = snapback(model, 20.0, tip, 0.05)
    true = np.abs(fast.displacements - truth.displacements).max() / np.abs(truth.displacements).max()
    assert true <= fast.error_estimate <= 1e-3
    assert fast.energy.error <= 1e-6 and truth.energy.error <= 1e-6


def masing_by_events(model, start, tip, times):
    """Tip motion by DOP853 on M x'' + K x + B^T f = 0, restarted wherever a Masing spring sticks or slips."""
    system = assemble(model)
    slip, k, top = system.contacts.slip, system.contacts.stiffness, system.contacts.limits
    inverse, n, sliding = np.linalg.inv(system.mass), len(system.dofs), np.zeros(len(system.contacts.limits))
    state, now = np.concatenate([start[0], np.zeros(n), start[1]]), 0.0
    motion = np.empty(len(times))
    while now < times[-1]:

        def rate(_, y, sliding=sliding):
            x, v, f = y[:n], y[n : 2 * n], y[2 * n :]
            change = np.where(sliding == 0, k * (slip @ v), 0.0)
            return np.concatenate([v, -inverse @ (system.stiffness @ x + slip.T @ f), change])

        def changes(i, sliding=sliding):
            def event(_, y):
                if sliding[i]:
                    return -sliding[i] * (slip[i] @ y[n : 2 * n])
                return abs(y[2 * n + i]) - top[i]

            event.terminal, event.direction = True, 1.0
            return event

        done = solve_ivp(
            rate,
            (now, times[-1]),
            state,
            "DOP853",
            dense_output=True,
            rtol=1e-11,
            atol=1e-15,
            events=[changes(i) for i in range(len(k))],
        )
        inside = (times >= now) & (times <= done.t[-1])
        if inside.any():
            motion[inside] = system.row(tip) @ done.sol(times[inside])[:n]
        now, state, sliding = done.t[-1], done.y[:, -1], sliding.copy()
        for i, found in enumerate(done.t_events):
            if len(found):
                sliding[i] = 0.0 if sliding[i] else np.sign(state[2 * n + i])
                # a hair inside, so that the same event is not found again
                state[2 * n + i] = np.sign(state[2 * n + i]) * top[i] * (1 - 1e-14 * (sliding[i] == 0))
    return motion


def test_reference_mode_against_an_independent_high_order_solver():
    """Eq. (4), three elements: the tip agrees within a millionth of the initial deflection."""
    model = double_beam(Masing(0.3, 2e7), 400.0, Section(0.5, 0.04, 0.005, elements=3), normal_stiffness=1e6)
    tip = "beam 2:3:+Z"
    run = snapback_reference(model, 20.0, tip, 0.03, sampling_rate=5000.0)
    problem = prepare(model, [tip])
    start = released(problem, 20.0, problem.outputs[0])
    expected = masing_by_events(model, (problem.base.shapes @ start.q, start.f), tip, run.times)
    assert np.abs(run.displacements[0] - expected).max() <= 1e-6 * abs(expected[0])
    assert int(run.method.split()[1]) > 10


def test_modes_after_a_spring_changes_are_those_of_the_whole_matrix():
    from ema.simulate import phase_kernels

    random = np.random.default_rng(3)
    squares = np.sort(random.uniform(1, 10, 60) ** 12)
    row = random.normal(size=60) * np.sqrt(squares)
    row[[5, 40]] = 0.0, 1e-30
    for stiffness in (1.0, 1e-9, -0.5 / (row**2 / squares).sum(), -0.99 / (row**2 / squares).sum()):
        rotation = np.empty((60, 60))
        found, done = phase_kernels.updated_modes(squares, row, stiffness, rotation)
        whole = np.diag(squares) + stiffness * np.outer(row, row)
        assert done
        np.testing.assert_allclose(np.sort(found), np.linalg.eigvalsh(whole), atol=1e-14 * np.abs(whole).max())
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(60), atol=1e-13)
        np.testing.assert_allclose(whole @ rotation, rotation * found, atol=1e-13 * np.abs(whole).max())


def test_iwan_springs_in_both_modes():
    model = double_beam(Iwan(0.3, 1e9, -0.5, 1.0, 6), 2000.0, Section(0.5, 0.04, 0.005, elements=4))
    tip = "beam 2:4:+Z"
    exact = snapback_reference(model, 20.0, tip, 0.05)
    fast = snapback(model, 20.0, tip, 0.05, tolerance=3e-4)
    assert np.abs(fast.displacements - exact.displacements).max() <= 5e-4 * np.abs(exact.displacements).max()
    assert exact.energy.error <= 1e-6


@pytest.mark.parametrize(("chi", "beta", "force"), [(-0.2, 0.5, 4000.0), (-0.5, 1.0, 300.0)])
def test_twenty_springs_of_a_contact_turn_at_one_time(chi, beta, force):
    """All springs of a contact stick as its motion turns, at their limits: by displacement alone they slip at once."""
    run = snapback_reference(double_beam(Iwan(0.3, 1e9, chi, beta, 20), force), 20.0, TIP, 2e-4)
    assert run.times[-1] == pytest.approx(2e-4) and run.energy.error <= 1e-6


@pytest.mark.parametrize(("law", "seed"), [("iwan", 6003), ("modified iwan", 6006), ("parallel masing", 6002)])
def test_reference_mode_of_many_springs_on_random_structures(law, seed):
    """Against a solver of the bench that shares no code with the project, good to 1e-6 of the largest displacement."""
    case, samples = draw(law, seed), 160
    rate, load = samples * case.lowest / 4, case.force * case.load_row
    run = snapback_reference(case.model, case.force, case.at, samples / rate, [case.output], rate, check=True)
    motion, start = Motion(load, samples, 1 / rate, None), at_rest(case.rubbing, load)
    expected, own = truth(case.rubbing, motion, start, case.output_row[None], 1e-6)
    true = np.abs(run.displacements[0] - expected[:, 0]).max() / np.abs(expected).max()
    assert true <= run.error_estimate + own <= 1e-5


def test_mass_proportional_damping_in_both_modes():
    model = double_beam(
        Masing(0.3, 1e9), 1500.0, Section(0.5, 0.04, 0.005, elements=4), damping=Damping(mass_factor=6.0)
    )
    tip = "beam 2:4:+Z"
    exact = snapback_reference(model, 20.0, tip, 0.1)
    fast = snapback(model, 20.0, tip, 0.1, tolerance=3e-4)
    assert np.abs(fast.displacements - exact.displacements).max() <= 5e-4 * np.abs(exact.displacements).max()
    assert exact.energy.damping[-1] == pytest.approx(fast.energy.damping[-1], rel=2e-3)


def test_smooth_law_against_an_independent_high_order_solver():
    """Eq. (5), m = 3, three elements: DOP853 on the first-order form of Eq. (1), good to 1e-9.

    The reference mode takes no smooth law; the fast mode reaches a millionth of the initial deflection, and says so.
    """
    law = RegularisedMasing(0.3, 2e7, 3)
    model = double_beam(law, 400.0, Section(0.5, 0.04, 0.005, youngs_modulus=210e9, elements=3), normal_stiffness=1e6)
    tip = "beam 2:3:+Z"
    problem = prepare(model, [tip])
    start = released(problem, 20.0, problem.outputs[0])
    system = assemble(model)
    slip, k, top = system.contacts.slip, system.contacts.stiffness, system.contacts.limits
    inverse = np.linalg.inv(system.mass)
    n, c = len(system.dofs), len(k)

    def rate(_, y):
        x, v, f = y[:n], y[n : 2 * n], y[2 * n :]
        rel = slip @ v
        change = k * rel * (1 - np.where(rel * f > 0, np.abs(f / top) ** 3, 0.0))
        return np.concatenate([v, inverse @ (-system.stiffness @ x - slip.T @ f), change])

    x0 = problem.base.shapes @ start.q
    duration, count = 0.02, 100
    times = np.linspace(0, duration, count + 1)
    solution = solve_ivp(
        rate,
        (0, duration),
        np.concatenate([x0, np.zeros(n), start.f]),
        "DOP853",
        times,
        rtol=1e-9,
        atol=1e-12,
        max_step=1e-5,
    )
    expected = system.row(tip) @ solution.y[:n]
    fast = snapback(model, 20.0, tip, duration, tolerance=1e-6, sampling_rate=count / duration)
    assert c == 3
    error = np.abs(fast.displacements[0] - expected).max() / abs(expected[0])
    assert error <= fast.error_estimate <= 1e-6
    assert fast.energy.error <= 1e-6


def test_the_reference_mode_says_what_it_does_not_take():
    with pytest.raises(InputError, match="Masing-type laws only"):
        snapback_reference(double_beam(RegularisedMasing(0.3, 1e9), 1000.0), 20.0, TIP, 0.01)
    with pytest.raises(InputError, match="mass-proportional"):
        snapback_reference(double_beam(Masing(0.3, 1e9), 1000.0, damping=Damping(ratio=0.01)), 20.0, TIP, 0.01)
    with pytest.raises(InputError, match="duration"):
        snapback_reference(double_beam(Masing(0.3, 1e9), 1000.0), 20.0, TIP, -1.0)
