"""Floquet multipliers, coexisting states and isolated branches against oscillators integrated by scipy.

Every truth is an equation of motion written out here: the variational equations where forces are smooth or have kinks
alone, and finite differences of an integration from event to event where friction sticks and slips.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.data.stability import CoexistingStates, FloquetMultipliers
from ema.dof import Dof
from ema.errors import InputError
from ema.examples import beam_model
from ema.simulate import (
    ContactCurve,
    Dahl,
    HarmonicBalance,
    Iwan,
    LuGre,
    Masing,
    Unilateral,
    coexisting_states,
    floquet_multipliers,
    frf,
    frf_curves,
    frf_up_and_down,
    register_law,
)


def oscillator(law, friction_limit, springs, decay, normal=None, normal_force=None, normal_stiffness=1.0):
    """1 kg on springs (along X, along Z) with a joint to a wall that does not move; damping decay * velocity."""
    dofs, walls = (tuple(Dof(1, axis, body) for axis in ("+X", "+Z")) for body in ("", "wall"))
    force = friction_limit if normal_force is None else normal_force
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, force, normal_stiffness)
    if normal is not None:
        joint = replace(joint, normal_contact=normal)
    host = Matrices(np.eye(2), np.diag(springs), dofs)
    wall = Matrices(1e9 * np.eye(2), 1e18 * np.eye(2), walls)
    return BeamModel(host, wall, (joint,), Damping(mass_factor=decay), "oscillator")


def variational(frequency, force, decay, restoring, slope, first):
    """Periodic motion by shooting from the first harmonic ``first``, and its multipliers, by DOP853."""
    omega, period = 2 * np.pi * frequency, 1 / frequency

    def motion(t, y):
        matrix = np.array([[0.0, 1.0], [-slope(y[0]), -decay]])
        rate = [y[1], force * np.cos(omega * t) - restoring(y[0]) - decay * y[1]]
        return np.concatenate([rate, (matrix @ y[2:].reshape(2, 2)).ravel()])

    state = np.array([first.real, -omega * first.imag])
    for _ in range(12):
        begin = np.concatenate([state, np.eye(2).ravel()])
        end = solve_ivp(motion, (0, period), begin, "DOP853", rtol=1e-9, atol=1e-13, max_step=period / 60).y[:, -1]
        monodromy, rest = end[2:].reshape(2, 2), end[:2] - state
        state = state + np.linalg.solve(np.eye(2) - monodromy, rest)
        if np.abs(rest).max() < 1e-9 * np.abs(state).max():
            return state, np.linalg.eigvals(monodromy)
    raise AssertionError("no periodic motion")


def farthest(truth, found):
    """Largest distance of a true multiplier from the nearest one that was found."""
    return max(np.abs(found - value).min() for value in truth)


# an elastic contact that softens: F_C tanh(k x / F_C)
SOFT_SPRING, SOFT_K, SOFT_FC, SOFT_DECAY = (2 * np.pi * 100.0) ** 2, 4e5, 30.0, 18.0


def softening(force, du, k, limit, p0, p1, p2, p3):
    """F_C tanh(k (u + du) / F_C) from F_C tanh(k u / F_C)."""
    if limit <= 0.0:
        return 0.0
    more = np.tanh(k * du / limit)
    return limit * (force / limit + more) / (1.0 + force / limit * more)


SOFTENING = register_law("softening without loss", softening)


def soft():
    return oscillator(SOFTENING(1.0, SOFT_K), SOFT_FC, (SOFT_SPRING, 2 * SOFT_SPRING), SOFT_DECAY)


def soft_truth(frequency, force, first):
    return variational(
        frequency,
        force,
        SOFT_DECAY,
        lambda x: SOFT_SPRING * x + SOFT_FC * np.tanh(SOFT_K * x / SOFT_FC),
        lambda x: SOFT_SPRING + SOFT_K / np.cosh(SOFT_K * x / SOFT_FC) ** 2,
        first,
    )[1]


def test_three_states_of_a_fold_are_found_with_the_multipliers_of_the_variational_equations():
    found = coexisting_states(soft(), 122.0, 4.0, "1:+X", ["1:+X"], starts=6)
    assert [state.stability.verdict for state in found.states] == ["stable", "unstable", "stable"]
    assert [state.stability.loss for state in found.states] == ["", "fold", ""]
    for state in found.states:
        truth = soft_truth(122.0, 4.0, state.first[0])
        away = farthest(truth, state.stability.multipliers)
        assert away < 1e-3 and away < state.stability.errors.max()
        # the force of this law never fades: a family of states, whose multiplier of 1 is set apart
        assert state.stability.sticking == 1
    assert [finding.code for finding in found.findings] == ["several-steady-states"]
    assert "3 steady states from 6 random starts" in found.statement and "There may be others." in found.statement


def test_states_of_both_sweeps_are_stable_inside_the_fold():
    frequencies = np.arange(121.0, 125.0)
    for swept in frf_up_and_down(soft(), frequencies, 4.0, "1:+X", ["1:+X"]):
        first = swept.values[:, 0, list(swept.orders).index(1)]
        for frequency, value, one in zip(frequencies, first, floquet_multipliers(soft(), swept), strict=True):
            assert one.stable and one.distance < 5e-3
            assert farthest(soft_truth(frequency, 4.0, value), one.multipliers) < 1e-3


def test_stability_changes_at_the_folds_of_a_curve():
    """Of a softening curve the part between the folds is unstable; at the folds a true multiplier passes 1."""
    (curve,) = frf_curves(soft(), (112.0, 133.0), 4.0, "1:+X", ["1:+X"], searched=0)
    assert len(curve.folds) == 2 and not curve.detached and curve.ends == ("edge", "edge")
    turns = 1 + np.flatnonzero(np.diff(np.sign(np.diff(curve.frequencies))) != 0)
    verdicts = np.array(curve.verdicts)
    middle = np.zeros(len(verdicts), bool)
    middle[turns[0] + 2 : turns[1] - 1] = True
    outer = np.ones(len(verdicts), bool)
    outer[turns[0] - 2 : turns[1] + 3] = False
    assert set(verdicts[middle]) == {"unstable"} and set(verdicts[outer]) == {"stable"}
    assert {curve.losses[n] for n in np.flatnonzero(middle)} == {"fold"}
    for turn in turns:
        around = [soft_truth(curve.frequencies[n], 4.0, curve.values[n, 0]) for n in (turn - 2, turn + 2)]
        sizes = [np.abs(values).max() for values in around]
        assert min(sizes) < 1 < max(sizes)


# Duffing's equation: the closing force of a normal contact about its preload is K1 x + K3 x^3
HARD_SPRING, HARD_K1, HARD_K3, HARD_DEPTH, HARD_DECAY = 7896.0, 7896.0, 1e8, 0.05, 2.5


def duffing():
    x = np.linspace(-HARD_DEPTH, HARD_DEPTH, 4001)
    closing = HARD_K1 * x + HARD_K3 * x**3
    contact = ContactCurve((x + HARD_DEPTH).tolist(), (closing - closing[0]).tolist())
    preload = -closing[0] + HARD_SPRING * HARD_DEPTH
    return oscillator(Masing(0.3, 1e5), 0.0, (HARD_SPRING, HARD_SPRING), HARD_DECAY, contact, preload)


def test_duffings_equation_in_a_normal_contact():
    (curve,) = frf_curves(duffing(), (20.3, 20.8), 1.0, "1:+Z", ["1:+Z"], searched=0)
    assert len(curve.folds) == 2 and "unstable" in curve.verdicts
    checked = 0
    for n in np.flatnonzero(np.isfinite(curve.largest))[::4]:
        if curve.verdicts[n] == "undecided":
            continue
        _, truth = variational(
            curve.frequencies[n],
            1.0,
            HARD_DECAY,
            lambda x: (HARD_SPRING + HARD_K1) * x + HARD_K3 * x**3,
            lambda x: HARD_SPRING + HARD_K1 + 3 * HARD_K3 * x * x,
            curve.values[n, 0],
        )
        # the motion along X, which friction holds, decays with the damping alone
        largest = max(np.abs(truth).max(), np.exp(-HARD_DECAY / 2 / curve.frequencies[n]))
        assert curve.largest[n] == pytest.approx(largest, abs=1e-3)
        assert (curve.verdicts[n] == "stable") == (largest < 1)
        checked += 1
    assert checked > 4


def test_a_one_sided_spring_loses_its_stability_by_a_flip():
    """Above twice its natural frequency period doubling begins: a multiplier passes -1 between 28 and 30 Hz."""
    spring, decay, preload, force = (2 * np.pi * 10) ** 2, 4.0, 5.0, 20.0
    contact = 10 * spring
    gap = preload / contact
    model = oscillator(
        Masing(0.3, 1e5), 0.0, (spring, spring), decay, Unilateral(), preload + spring * gap, normal_stiffness=contact
    )
    frequencies = np.array([27.0, 31.0])
    response = frf(model, frequencies, force, "1:+Z", ["1:+Z"])
    firsts = response.values[:, 0, list(response.orders).index(1)]
    stable, flipped = floquet_multipliers(model, response)
    assert stable.verdict == "stable" and flipped.verdict == "unstable" and flipped.loss == "flip"
    for one, frequency, first in zip((stable, flipped), frequencies, firsts, strict=True):
        _, truth = variational(
            frequency,
            force,
            decay,
            lambda x: spring * x + np.where(x > gap, preload, contact * x),
            lambda x: spring + np.where(x > gap, 0.0, contact),
            first,
        )
        assert farthest(truth, one.multipliers) < max(2e-3, one.errors.max())


def masing_period(frequency, force, state, spring, k, limit, decay):
    """State (x, v, z) after a period of the bilinear hysteretic oscillator, from event to event."""
    omega, t, period = 2 * np.pi * frequency, 0.0, 1 / frequency
    y, sliding = np.array(state), 0.0

    def stick(t, y):
        return [y[1], force * np.cos(omega * t) - spring * y[0] - y[2] - decay * y[1], k * y[1]]

    def slide(t, y):
        return [y[1], force * np.cos(omega * t) - spring * y[0] - y[2] - decay * y[1], 0.0]

    def upper(t, y):
        return y[2] - limit

    def lower(t, y):
        return y[2] + limit

    def turn(t, y):
        return y[1]

    upper.terminal = lower.terminal = turn.terminal = True
    upper.direction, lower.direction = 1, -1
    while t < period:
        if sliding:
            turn.direction = -sliding
            run = solve_ivp(slide, (t, period), y, "DOP853", events=[turn], rtol=1e-11, atol=1e-14)
        else:
            run = solve_ivp(stick, (t, period), y, "DOP853", events=[upper, lower], rtol=1e-11, atol=1e-14)
        t, y = run.t[-1], run.y[:, -1].copy()
        if run.status == 1:
            sliding = 0.0 if sliding else (1.0 if len(run.t_events[0]) else -1.0)
            if sliding:
                y[2] = sliding * limit
    return y


def test_a_friction_oscillator_that_slips_is_stable_with_the_multipliers_of_its_events():
    spring, k, limit, decay, frequency, force = (2 * np.pi * 100.0) ** 2, 4e5, 30.0, 18.0, 125.0, 25.0
    model = oscillator(Masing(1.0, k), limit, (spring, 2 * spring), decay)
    response = frf(model, np.array([frequency]), force, "1:+X", ["1:+X"])
    (one,) = floquet_multipliers(model, response)
    assert one.verdict == "stable" and one.largest < 1
    state = np.zeros(3)
    for _ in range(30):
        state = masing_period(frequency, force, state, spring, k, limit, decay)
    columns = []
    for nudge in np.diag([1e-8, 1e-5, 1e-3]):
        ends = [masing_period(frequency, force, state + sign * nudge, spring, k, limit, decay) for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * nudge.max()))
    truth = np.linalg.eigvals(np.array(columns).T)
    truth = truth[np.abs(truth) > 0.05]
    assert len(truth) == 2
    assert farthest(truth, one.multipliers) < one.errors.max() < 0.05


@pytest.mark.parametrize("law", [Masing(0.3, 1e9), Iwan(0.3, 1e9), Dahl(0.3, 1e9)], ids=lambda law: law.name)
def test_sticking_springs_are_no_loss_of_stability(law):
    """Where nothing slips the multipliers are those of the linear structure, |mu| = exp(-zeta w T)."""
    spring, decay, force = (2 * np.pi * 100.0) ** 2, 18.0, 1e-6
    model = oscillator(replace(law, contact_stiffness=4e5), 100.0, (spring, 2 * spring), decay)
    response = frf(model, np.array([125.0]), force, "1:+X", ["1:+X"])
    (one,) = floquet_multipliers(model, response)
    assert one.verdict == "stable" and one.sticking >= 1
    assert one.largest == pytest.approx(np.exp(-decay / 2 / 125.0), abs=1e-4)


# LuGre: a larger force to begin sliding than to go on, PEAK times as large
STILL, SLIDE_K, SLIDE_FC, SIGMA, STRIBECK, SLIDE_DECAY = (2 * np.pi * 10) ** 2, 1e6, 10.0, 100.0, 0.05, 4.0


def lugre(peak):
    return oscillator(LuGre(1.0, SLIDE_K, SIGMA, 0.0, peak, STRIBECK), SLIDE_FC, (STILL, 1e5), SLIDE_DECAY)


def lugre_run(frequency, state, periods, peak, force=15.0):
    """State (x, v, bristle force) after whole periods, and the first harmonic of the last one."""
    omega = 2 * np.pi * frequency

    def motion(t, y):
        x, v, z = y
        rate = SLIDE_K * (v - abs(v) * z / (SLIDE_FC * (1 + (peak - 1) * np.exp(-((v / STRIBECK) ** 2)))))
        pull = STILL * x + z + SIGMA * rate / SLIDE_K + SLIDE_DECAY * v
        return [v, force * np.cos(omega * t) - pull, rate]

    times = (periods - 1 + np.arange(65) / 64) / frequency
    path = solve_ivp(motion, (0, times[-1]), state, "LSODA", times, rtol=1e-7, atol=1e-10).y
    return path[:, -1], abs(2 / 64 * path[0, :-1] @ np.exp(-1j * omega * times[:-1]))


def lugre_state(frequency, first):
    """State of a motion that slides, at the largest force."""
    velocity = -2 * np.pi * frequency * first.imag
    return np.array([first.real, velocity, np.sign(velocity) * SLIDE_FC])


def test_friction_that_sticks_harder_than_it_slides_has_two_stable_states_and_one_between():
    """What scipy makes of motions a tenth above and below the unstable state: one slides on, the other one stops."""
    found = coexisting_states(lugre(2.0), 10.0, 15.0, "1:+X", ["1:+X"], starts=0)
    stuck, between, sliding = found.states
    assert [state.stability.verdict for state in found.states] == ["stable", "unstable", "stable"]
    assert between.stability.loss == "fold"
    first = between.first[0]
    sizes = [lugre_run(10.0, lugre_state(10.0, share * first), 30, 2.0)[1] for share in (0.9, 1.1)]
    # what is left of the slide fades slowly in bristles that hold
    assert sizes[0] < 2 * abs(stuck.first[0])
    assert sizes[1] == pytest.approx(abs(sliding.first[0]), rel=5e-3)


def test_a_branch_that_no_sweep_reaches_is_followed_and_stable_where_motions_stay_on_it():
    """Sweeps both ways stay stuck. Scipy slides on from 8.5 to 10.5 Hz, and comes to rest at 8.2 and 10.8 Hz."""
    stuck, branch = frf_curves(
        lugre(4.0), (5.0, 14.0), 15.0, "1:+X", ["1:+X"], HarmonicBalance(2e-3), searched=1, starts=0
    )
    assert stuck.ends == ("edge", "edge") and not stuck.detached and branch.detached
    for swept in frf_up_and_down(lugre(4.0), np.linspace(5.0, 14.0, 10), 15.0, "1:+X", ["1:+X"]):
        assert np.abs(swept.values[:, 0, 0]).max() < 3e-5 < 1e-3 < np.abs(branch.values).min()
    stable = np.flatnonzero(np.array(branch.verdicts) == "stable")
    assert branch.frequencies[stable].min() < 9.0 and branch.frequencies[stable].max() > 10.3
    for n in stable[1::5]:
        frequency, first = branch.frequencies[n], branch.values[n, 0]
        assert lugre_run(frequency, lugre_state(frequency, first), 12, 4.0)[1] == pytest.approx(abs(first), rel=0.01)
    for frequency in (8.2, 10.8):
        nearest = stable[np.argmin(np.abs(branch.frequencies[stable] - frequency))]
        state = lugre_state(frequency, branch.values[nearest, 0])
        assert lugre_run(frequency, state, 40, 4.0)[1] < 1e-4
        assert not np.any(np.abs(branch.frequencies[stable] - frequency) < 0.1)


def test_an_undamped_structure_is_undecided_not_stable():
    response = frf(beam_model(), np.array([60.0]), 1.0, "1:+X", ["1:+X"])
    (one,) = floquet_multipliers(beam_model(), response)
    assert one.verdict == "undecided" and not one.stable


def multipliers(*values, error=0.02, reason=""):
    return FloquetMultipliers(np.array(values, complex), np.full(len(values), error), reason=reason)


def test_verdicts_need_a_distance_from_the_circle_beyond_the_error():
    assert multipliers(0.99).verdict == multipliers(1.01).verdict == "undecided"
    assert multipliers(0.97).verdict == "stable" and multipliers(0.97).loss == ""
    assert multipliers(1.1).loss == "fold" and multipliers(-1.1).loss == "flip"
    assert multipliers(0.9 + 0.6j, 0.9 - 0.6j).loss == "Neimark-Sacker"
    undecided = multipliers(-0.56, error=0.5)  # next to nothing is known: no period doubling is named
    assert undecided.verdict == "undecided" and undecided.loss == ""
    assert multipliers(0.5, reason="not closed").verdict == multipliers(0.5, error=np.inf).verdict == "undecided"


def test_a_search_says_what_it_searched_and_never_that_there_is_nothing_else():
    found = coexisting_states(soft(), 140.0, 4.0, "1:+X", ["1:+X"], starts=4)
    assert isinstance(found, CoexistingStates) and len(found.states) == 1 and found.later == 4
    assert "no further state among the last 4 starts. There may be others." in found.statement
    assert found.forces[0] == pytest.approx(0.4) and found.forces[1] >= 40.0


@pytest.mark.parametrize(
    ("options", "message"),
    [({"starts": -1}, "not a number of starts"), ({"span": 1.0}, "not a span of forces")],
)
def test_a_search_that_is_none_gets_a_sentence(options, message):
    with pytest.raises(InputError, match=message):
        coexisting_states(soft(), 120.0, 1.0, "1:+X", ["1:+X"], **options)


@pytest.mark.parametrize("band", [(10.0, 5.0), (0.0, 5.0), (1.0, np.nan)])
def test_a_band_that_is_none_gets_a_sentence(band):
    with pytest.raises(InputError, match="not a band"):
        frf_curves(soft(), band, 1.0, "1:+X", ["1:+X"])


def test_states_of_another_model_are_refused():
    response = frf(beam_model(), np.array([60.0]), 1.0, "1:+X", ["1:+X"])
    other = replace(response, slips=np.zeros((1, response.slips.shape[1] + 1, response.slips.shape[2]), complex))
    with pytest.raises(InputError, match="another model"):
        floquet_multipliers(beam_model(), other)
