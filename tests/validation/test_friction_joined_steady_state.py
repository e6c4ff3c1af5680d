"""Steady states of contacts that hang together against closed forms and the time solver.

Isotropic friction in two directions (a circle of radius A loses 2 pi F_C A sqrt(1 - (x_c/A)^2) per turn), normal forces
that change with the period of the exciting force, and normal contact that parts or stiffens.
"""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate import (
    BoucWen,
    Dahl,
    HarmonicBalance,
    Iwan,
    LuGre,
    Masing,
    PowerContact,
    RegularisedMasing,
    RoughContact,
    Unilateral,
    Valanis,
    frf,
    register_law,
    resonance,
    respond,
)
from ema.simulate.harmonic import condense
from ema.simulate.stability import multipliers_of
from ema.simulate.verification import settled_from_rest

F0, K, FC = 100.0, 4e5, 30.0
LAWS = [
    Masing(1.0, K),
    RegularisedMasing(1.0, K, 8),
    Dahl(1.0, K),
    Iwan(1.0, K, -0.5, 1.0, 12),
    LuGre(1.0, K, 5.0, 1.0, 1.2, 1e-2),
    RoughContact(1.0, FC / K, springs=12, reference_force=FC),
]
BOTH, ONE = ("X", "Y"), ("X",)


def jenkins(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


OWN = register_law("jenkins of steady states", jenkins)
PROJECTED = [OWN(1.0, K), Valanis(1.0, K, 0.6), BoucWen(1.0, K, 2.0, 0.1)]


def oscillator(law, directions=BOTH, skew=0.05, lift=0.0, **joint):
    """1 kg that moves in three directions and rubs on a wall; ``skew`` and ``lift`` couple X to Y and to Z."""
    k = (2 * np.pi * F0) ** 2
    stiffness = np.diag([k, 1.21 * k, 2 * k])
    stiffness[0, 1] = stiffness[1, 0] = skew * k
    stiffness[0, 2] = stiffness[2, 0] = lift * k
    dofs, walls = (tuple(Dof(1, axis, body) for axis in ("+X", "+Y", "+Z")) for body in ("", "wall"))
    contact = Joint("contact", ((1, 1),), (0.0, 0.0), law, FC, 1.0, directions=directions)
    return BeamModel(
        Matrices(np.eye(3), stiffness, dofs),
        Matrices(1e3 * np.eye(3), 1e16 * np.eye(3), walls),
        (replace(contact, **joint),),
        Damping(ratio=0.02),
        "oscillator",
    )


def in_time(model, frequency, force, output, pressing=None, cycles=60, samples=200):
    """First harmonic and mean of the motion after many cycles, by the time solver."""
    turns = np.arange(cycles * samples + 1) / samples
    normal = None
    if pressing is not None:
        phases = np.arange(pressing.shape[1] + 1) / pressing.shape[1]
        normal = np.array([np.interp(turns % 1, phases, np.append(row, row[0])) for row in pressing])
    push = force * np.cos(2 * np.pi * turns)[None]
    run = respond(model, push, ["1:+X"], frequency * samples, [output], normal_forces=normal, tolerance=3e-4)
    last, turn = run.displacements[0][-2 * samples :], turns[-2 * samples :]
    return np.mean(2 * last * np.exp(-2j * np.pi * turn)), last.mean()


def first(found):
    return found.values[0, 0, list(found.orders).index(1)]


@pytest.mark.parametrize("law", LAWS[:2], ids=lambda law: law.name)
def test_loss_on_a_circle(law):
    """Eq. (5) with m = 8 slides as well once it has turned: its force is at the circle."""
    condensed = condense(oscillator(law), 1.0, "1:+X", ["1:+X"], 1e-3)
    amplitude = 2.5 * FC / K
    lost = condensed.contact_forces(np.array([[amplitude, 0.0], [0.0, amplitude]]), 2 * np.pi * F0, 64)[2]
    expected = 2 * np.pi * FC * amplitude * np.sqrt(1 - (FC / K / amplitude) ** 2)
    assert lost.sum() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_motion_along_a_line_is_the_law_in_one_direction(law):
    """Through samples here, in closed form or by Gauss's quadrature there."""
    motion = 1e-4 * np.array([1.0, 0.4, -0.1, 0.2, 0.05, 0.02])
    way = np.array([np.cos(0.5), np.sin(0.5)])
    both, one = (condense(oscillator(law, axes), 1.0, "1:+X", ["1:+X"], 1e-3) for axes in (BOTH, ONE))
    force, _, lost, _ = both.contact_forces(np.outer(way, motion), 2 * np.pi * F0, 64)
    expected, _, loss, _ = one.contact_forces(motion[None], 2 * np.pi * F0, 16)
    np.testing.assert_allclose(force, np.outer(way, expected), atol=1e-5 * np.abs(expected).max())
    assert lost.sum() == pytest.approx(loss.sum(), rel=3e-5)


@pytest.mark.parametrize("law", [LAWS[0], LAWS[3], LAWS[1], LAWS[2], *PROJECTED], ids=lambda law: law.name)
@pytest.mark.parametrize("normal", [None, Unilateral()], ids=["pressed", "parts"])
def test_the_jacobian_is_the_derivative_of_the_forces(law, normal):
    """By the own motion, that across and the gap, against central differences of the forces themselves."""
    joint = {} if normal is None else {"normal_contact": normal, "normal_stiffness": 2e5}
    condensed = condense(oscillator(law, **joint), 1.0, "1:+X", ["1:+X"], 1e-3)
    draw, orders = np.random.default_rng(2), 3
    contacts = len(condensed.limits)
    motion = 1e-4 * draw.normal(size=(contacts, 2 * orders)) / (1 + np.repeat(condensed.orders(orders), 2)) ** 2
    jacobian = condensed.contact_forces(motion, 2 * np.pi * F0)[1]
    for i, across in enumerate(condensed.members):
        for place, other in enumerate(across):
            for c in range(2 * orders if other >= 0 else 0):
                step = np.zeros_like(motion)
                step[other, c] = 1e-10
                more, less = (condensed.contact_forces(motion + s * step, 2 * np.pi * F0)[0][i] for s in (1, -1))
                np.testing.assert_allclose(jacobian[i, place, :, c], (more - less) / 2e-10, atol=2e-3 * K)


def test_the_isotropic_law_has_no_preferred_direction():
    """The structure is the same in X and Y: what is driven along X and along Y differs by a quarter turn."""
    model = oscillator(LAWS[0], skew=0.0)
    stiffness = model.host.stiffness.copy()
    stiffness[1, 1] = stiffness[0, 0]
    model = replace(model, host=replace(model.host, stiffness=stiffness))
    one, two = (frf(model, np.array([101.0, 104.0]), 40.0, at, [at]) for at in ("1:+X", "1:+Y"))
    np.testing.assert_allclose(one.values, two.values, rtol=1e-6)


@pytest.mark.parametrize("law", [*LAWS, *PROJECTED], ids=lambda law: law.name)
def test_isotropic_friction_against_the_time_solver(law):
    model = oscillator(law)
    found = frf(model, np.array([103.0]), 60.0, "1:+X", ["1:+Y"], settings=HarmonicBalance(tolerance=1e-3))
    assert found.converged.all() and found.power_error <= 1e-4 and found.error_estimate[0] <= 1e-3
    assert abs(first(found) / in_time(model, 103.0, 60.0, "1:+Y")[0] - 1) <= 3e-3


PHASES = 2 * np.pi * np.arange(32) / 32


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_normal_forces_that_change_against_the_time_solver(law):
    """Once per period in one direction, which gives a mean displacement; twice per period in two directions."""
    once = (FC + 15 * np.cos(PHASES + 1) + 5 * np.sin(2 * PHASES))[None]
    twice = (FC + 20 * np.cos(2 * PHASES + 1))[None]
    for model, pressing in ((oscillator(law, ONE), once), (oscillator(law), twice)):
        found = frf(model, np.array([103.0]), 40.0, "1:+X", ["1:+X"], HarmonicBalance(1e-3), normal_forces=pressing)
        assert found.converged.all() and found.power_error <= 1e-4
        motion, mean = in_time(model, 103.0, 40.0, "1:+X", pressing)
        assert abs(first(found) / motion - 1) <= 3e-3
        offset = found.values[0, 0, 0].real if found.orders[0] == 0 else 0.0
        assert offset == pytest.approx(mean, abs=3e-3 * abs(motion))


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_constant_normal_force_is_the_one_of_the_model(law):
    model, frequencies = oscillator(law, ONE), np.array([95.0, 103.0])
    one, two = (
        frf(model, frequencies, 40.0, "1:+X", ["1:+X"], HarmonicBalance(1e-3), normal_forces=pressing)
        for pressing in (None, np.full((1, 8), FC))
    )
    np.testing.assert_allclose(two.values[:, 0, 0], one.values[:, 0, 0], rtol=2e-3)
    assert two.power_error <= 1e-4


@pytest.mark.parametrize("contact", [PowerContact(1.5, FC), Unilateral()], ids=["stiffens", "parts"])
@pytest.mark.parametrize("force", [10.0, 100.0])
@pytest.mark.parametrize("law", [Masing(0.5, 2e5), OWN(0.5, 2e5)], ids=["masing", "own"])
def test_normal_contact_against_the_time_solver(contact, force, law):
    model = oscillator(law, ONE, lift=0.2, normal_contact=contact, normal_stiffness=2e5)
    found = frf(model, np.array([112.0]), force, "1:+X", ["1:+X"], settings=HarmonicBalance(tolerance=1e-3))
    assert found.converged.all() and found.power_error <= 1e-4
    motion, mean = in_time(model, 112.0, force, "1:+X")
    assert abs(first(found) / motion - 1) <= 3e-3
    assert found.values[0, 0, 0].real == pytest.approx(mean, abs=3e-3 * abs(motion))
    assert ("lift-off" in {finding.code for finding in found.findings}) == (force == 100.0)


@pytest.mark.parametrize("kind", ["plane", "normal force", "lift-off"])
def test_verified_against_a_run_from_rest(kind):
    """The distance from the settled motion is stated; the run in time is good to 3e-4 of its largest displacement."""
    model, pressing = {
        "plane": (oscillator(RegularisedMasing(1.0, K, 8)), None),
        "normal force": (oscillator(Dahl(1.0, K), ONE), np.array([[30.0, 20.0, 30.0, 45.0]])),
        "lift-off": (
            oscillator(Masing(1.0, K), ONE, lift=0.3, normal_stiffness=2e5, normal_contact=Unilateral()),
            None,
        ),
    }[kind]
    found = frf(model, np.array([95.0]), 20.0, "1:+X", ["1:+X"], HarmonicBalance(verify=True), normal_forces=pressing)
    first, _ = in_time(model, 95.0, 20.0, "1:+X", pressing)
    assert found.error_estimate[0] <= 1e-3 and "unstable-state" not in [finding.code for finding in found.findings]
    here = found.values[0, 0, list(found.orders).index(1)]
    assert abs(here - first) <= (found.error_estimate[0] + 3e-4) * abs(first)


def test_the_peak_of_a_motion_with_a_mean_is_that_of_its_first_harmonic():
    model = oscillator(Masing(0.5, 2e5), ONE, lift=0.2, normal_contact=Unilateral(), normal_stiffness=2e5)
    peak = resonance(model, 40.0, "1:+X", "1:+X", (85.0, 125.0))
    swept = frf(model, np.array([0.98, 1.0, 1.02]) * peak.frequency, 40.0, "1:+X", ["1:+X"])
    heights = np.abs(swept.values[:, 0, list(swept.orders).index(1)])
    assert abs(peak.amplitude) == pytest.approx(heights[1], rel=1e-2)
    assert heights[1] > max(heights[0], heights[2])
    assert peak.modal_amplitude >= abs(peak.amplitude)


def test_normal_forces_that_are_none_get_a_sentence():
    model, frequencies = oscillator(LAWS[0], ONE), np.array([100.0])

    def run(pressing, model=model):
        frf(model, frequencies, 40.0, "1:+X", ["1:+X"], normal_forces=pressing)

    with pytest.raises(InputError, match="oscillator: not a normal force"):
        run(np.array([[10.0, -1.0]]))
    with pytest.raises(InputError, match=r"do not fit.*1 joints"):
        run(np.ones((2, 8)))
    moved = oscillator(LAWS[0], ONE, normal_contact=Unilateral(), normal_stiffness=2e5)
    with pytest.raises(InputError, match="does not follow normal contact"):
        run(np.ones((1, 8)), moved)
    floating = replace(model, host=replace(model.host, stiffness=np.diag([0.0, 0.0, 1e6])))
    with pytest.raises(InputError, match="not held"):
        run(np.array([[10.0, 20.0, 10.0]]), replace(floating, beam=replace(model.beam, stiffness=np.zeros((3, 3)))))


def knocking(draw):
    """One to three masses that move in three directions, each on a wall from which it parts; a force and a frequency."""
    rng, k = np.random.default_rng([2026, draw]), (2 * np.pi * F0) ** 2
    nodes, both = int(rng.integers(1, 4)), rng.random() < 0.3
    stiffness = np.zeros((3 * nodes, 3 * nodes))
    for n in range(nodes):
        up = rng.uniform(0.02, 1.0) * k
        own = np.diag([k * rng.uniform(0.7, 1.5), k * rng.uniform(0.7, 1.5), up])
        own[0, 2] = own[2, 0] = rng.uniform(-0.5, 0.5) * np.sqrt(own[0, 0] * up)
        own[0, 1] = own[1, 0] = rng.uniform(-0.2, 0.2) * k * 0.7
        own += max(0.01 * k - np.linalg.eigvalsh(own).min(), 0.0) * np.eye(3)
        stiffness[3 * n : 3 * n + 3, 3 * n : 3 * n + 3] += own
    for n in range(nodes - 1):
        between = np.diag(rng.uniform(0.1, 1.0, 3) * k)
        stiffness[3 * n : 3 * n + 6, 3 * n : 3 * n + 6] += np.block([[between, -between], [-between, between]])
    tangential, normal, mu = k * 10 ** rng.uniform(-0.5, 1.5), k * 10 ** rng.uniform(-0.5, 1.5), rng.uniform(0.2, 0.8)
    laws = Masing(mu, tangential), Dahl(mu, tangential), Iwan(mu, tangential, -0.5, 1.0, 8)
    law = (*laws, LuGre(mu, tangential, 10.0, 1.0, 1.2, 1e-2))[int(rng.integers(0, 4))]
    axes, size = ("+X", "+Y", "+Z"), 3 * nodes
    dofs, walls = (tuple(Dof(n + 1, axis, body) for n in range(nodes) for axis in axes) for body in ("", "wall"))
    pairs = tuple((n + 1, n + 1) for n in range(nodes))
    contact = Joint("contact", pairs, (0.0, 0.0), law, 30.0 * nodes, normal, directions=BOTH if both else ONE)
    joint, wall = (
        replace(contact, normal_contact=Unilateral()),
        Matrices(1e3 * np.eye(size), 1e16 * np.eye(size), walls),
    )
    host, damping = Matrices(np.eye(size), stiffness, dofs), Damping(ratio=float(rng.uniform(0.005, 0.05)))
    force, at = 30.0 * nodes * 10 ** rng.uniform(-0.3, 1.0), f"1:+{'XZ'[int(rng.integers(0, 2))]}"
    return BeamModel(host, wall, (joint,), damping, "knocking"), force, at, float(rng.uniform(40, 220))


@pytest.mark.parametrize("draw", [0, 1, 7, 10, 19, 22])
def test_gaps_that_open_in_every_period_against_the_time_solver(draw):
    """Where the time solver settles there is a solution, within its stated error and a part of the budget."""
    model, force, at, frequency = knocking(draw)
    condensed = condense(model, force, at, [at], 5e-3)
    point = condensed.solve(frequency)
    turns = np.arange(150 * 200 + 1) / 200
    run = respond(model, force * np.cos(2 * np.pi * turns)[None], [at], frequency * 200, [at], tolerance=3e-4)
    waves = run.displacements[0] * np.exp(-2j * np.pi * turns)
    last, before = (2 * np.mean(waves[end - 200 : end]) for end in (30_000, 29_600))
    assert abs(last - before) < 1e-3 * abs(last) and run.pressure.open_time.max() > 0.3
    assert point is not None and condensed.left > 0.5 * condensed.budget and point.error < 0.05
    assert abs(condensed.first(point)[0] - last) <= (point.error + 1e-3) * abs(last)


@pytest.mark.parametrize(("draw", "loss"), [(2, "flip"), (18, "Neimark-Sacker")])
def test_gaps_whose_motion_does_not_repeat_with_the_force_have_an_unstable_steady_state(draw, loss):
    """The motion in time leaves it, and turns about it; its period map comes back to it, within a thousandth."""
    model, force, at, frequency = knocking(draw)
    condensed = condense(model, force, at, [at], 5e-3)
    point = condensed.solve(frequency)
    assert point is not None and point.error <= 5e-3 and condensed.left > 0.5 * condensed.budget
    multipliers = multipliers_of(condensed, point)
    assert multipliers.verdict == "unstable" and multipliers.loss == loss and multipliers.distance < 1e-3
    for steps in (256, 512):
        mean, settled = settled_from_rest(condensed, point.omega, steps)
        assert not settled and np.all(np.isfinite(mean))


def test_the_motion_about_a_state_that_loses_its_stability_by_a_flip_repeats_after_six_periods():
    model, force, at, frequency = knocking(2)
    turns = np.arange(150 * 200 + 1) / 200
    run = respond(model, force * np.cos(2 * np.pi * turns)[None], [at], frequency * 200, [at], tolerance=3e-4)
    firsts = (run.displacements[0] * np.exp(-2j * np.pi * turns))[:-1].reshape(150, 200).mean(axis=1)
    away = [abs(firsts[-1] - firsts[-1 - periods]) / abs(firsts[-1]) for periods in range(1, 7)]
    assert min(away[:5]) > 0.05 and away[5] < 1e-3
