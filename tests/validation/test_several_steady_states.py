"""Folded curves of steady states: an upward and a downward sweep against the motions that begin on them.

The contact force of 1 kg on a wall is F_C tanh(k x / F_C): it softens and loses nothing, so the curve over frequency
folds as that of a Duffing oscillator does. Its equation of motion is integrated by DOP853.
"""

from functools import cache
from math import cos, tanh

import numpy as np
import pytest

from ema.data import BeamModel, Channel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate import (
    FrictionRig,
    Masing,
    Shaker,
    SteppedSine,
    damping_map,
    frf,
    frf_up_and_down,
    register_law,
    resonance,
)
from ema.simulate.harmonic import condense, with_harmonics
from ema.simulate.verification import verified
from tests.dop853 import dop853

F0, K, FC, RATIO = 100.0, 4e5, 30.0, 0.01
SPRING = (2 * np.pi * F0) ** 2
STUCK = np.sqrt(SPRING + K)


def tanh_of_the_sum(force, du, k, limit, p0, p1, p2, p3):
    """F_C tanh(k (u + du) / F_C) from F_C tanh(k u / F_C)."""
    if limit <= 0.0:
        return 0.0
    more = np.tanh(k * du / limit)
    return limit * (force / limit + more) / (1.0 + force / limit * more)


ELASTIC = register_law("elastic and softening", tanh_of_the_sum)


def oscillator(law):
    dofs, walls = (tuple(Dof(1, axis, body) for axis in ("+X", "+Z")) for body in ("", "wall"))
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, FC, 1.0, directions=("X",))
    host = Matrices(np.eye(2), np.diag([SPRING, 2 * SPRING]), dofs)
    wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), walls)
    return BeamModel(host, wall, (joint,), Damping(ratio=RATIO), "oscillator")


def first_after(periods, frequency, force, first, *, mass=0.0, damper=0.0):
    """First harmonic, complex, of the period that begins after so many, from the state of one of amplitude ``first``.

    ``mass`` and ``damper`` move with the oscillator.
    """
    omega, period = 2 * np.pi * frequency, 1 / frequency
    loss = float(2 * RATIO * STUCK + damper)

    def motion(t, y):
        x, speed = y
        rest = SPRING * x + FC * tanh(K * x / FC) + loss * speed
        return speed, (force * cos(omega * t) - rest) / (1 + mass)

    times = period * (periods + np.arange(64) / 64)
    start = [first.real, -omega * first.imag]
    displacements = dop853(motion, start, times, rtol=1e-8, atol=1e-12, first_step=period / 64)[0]
    return 2 / 64 * displacements @ np.exp(-1j * omega * times)


def settled(frequency, force, first, mass=0.0, damper=0.0):
    """Amplitude of the first harmonic after 200 periods from the state of one of complex amplitude ``first``."""
    return abs(first_after(200, frequency, force, first, mass=mass, damper=damper))


def firsts(response):
    return response.values[:, 0, list(response.orders).index(1)]


def heights(response):
    return np.abs(firsts(response))


@pytest.mark.parametrize(("force", "fold"), [(2.0, (127.0, 135.0)), (4.0, (120.0, 131.0))])
def test_both_sweeps_are_where_the_motions_that_begin_on_them_stay(force, fold):
    """At 4 N the upward sweep jumps beyond 131 Hz to where the downward one came from."""
    frequencies = np.arange(fold[0], 140.0)
    up, down = frf_up_and_down(oscillator(ELASTIC(1.0, K)), frequencies, force, "1:+X", ["1:+X"], tolerance=2e-3)
    assert up.converged.all() and down.converged.all()
    (finding,) = [finding for finding in up.findings if finding.code == "several-steady-states"]
    assert finding in down.findings and finding.value == fold[0] and f"to {fold[1]:.5g} Hz" in finding.message
    assert not [finding for finding in up.findings if finding.code == "no-steady-state"]
    for place, frequency in enumerate(frequencies):
        if frequency % 3:
            continue
        low, high = (settled(frequency, force, firsts(swept)[place]) for swept in (up, down))
        assert heights(up)[place] == pytest.approx(low, rel=2e-3), frequency
        assert heights(down)[place] == pytest.approx(high, rel=2e-3), frequency


@pytest.mark.parametrize(("force", "frequency"), [(3.0, 133.0), (3.0, 134.0), (4.0, 132.0), (5.0, 130.0), (5.0, 134.0)])
def test_states_beyond_a_jump_are_found_from_nothing(force, frequency):
    """The law yields below its slip force too: the stuck motion at that force is no start, with higher ones it is.

    DOP853 from the state that is found, and from rest, settles on it.
    """
    found = frf(oscillator(ELASTIC(1.0, K)), np.array([frequency]), force, "1:+X", ["1:+X"])
    assert found.converged.all()
    for first in (firsts(found)[0], 0j):
        assert heights(found)[0] == pytest.approx(settled(frequency, force, first), rel=5e-3)


@cache
def three_states(frequency, force):
    """The contact of one direction, and its three states: that of both sweeps and the one between them."""
    alone = condense(oscillator(ELASTIC(1.0, K)), force, "1:+X", ["1:+X"], 2e-3)
    low, high = alone.solve(frequency), alone.solve(135.0)
    for step in np.arange(132.0, frequency - 0.5, -2.0):
        high = alone.solve(step, high.amplitudes)
    starts = [with_harmonics(point.amplitudes, high.count) for point in (low, high)]
    return alone, low, alone.solve(frequency, starts[0] + 0.4 * (starts[1] - starts[0])), high


@pytest.mark.parametrize("pressing", [None, np.array([[FC, FC]])], ids=["one direction", "normal forces over a period"])
def test_the_state_between_both_sweeps_is_unstable(pressing):
    """At 4 N and 122 Hz: DOP853 leaves the middle one of three states, and stays on the two others.

    From the middle one itself it needs hundreds of periods to leave; it is followed from a thousandth beside.
    """
    model, frequency, force = oscillator(ELASTIC(1.0, K)), 122.0, 4.0
    alone, low, middle, high = three_states(frequency, force)
    condensed = condense(model, force, "1:+X", ["1:+X"], 2e-3, normal_forces=pressing)
    for point, stays in ((low, True), (middle, False), (high, True)):
        here = condensed.solve(frequency, point.amplitudes)
        first = condensed.first(here)[0]
        assert abs(first) == pytest.approx(abs(alone.first(point)[0]), rel=2e-3)
        if pressing is None:
            assert (settled(frequency, force, 1.001 * first) == pytest.approx(abs(first), rel=0.05)) == stays
        seen = verified(condensed, here)
        assert seen.settles == stays and (seen.error == 1.0) == (not stays)


def test_a_users_law_that_divides_by_zero_returns_no_number(capfd):
    """Far from a solution the force is F_C to the last digit and the law 0 / 0, which Newton's method steps back from."""
    from ema.simulate.friction import REGISTERED

    force = REGISTERED["elastic and softening"][1].ctypes
    assert np.isnan(force(1.0, -1.0, 1e9, 1.0, 0.0, 0.0, 0.0, 0.0))
    assert "ZeroDivisionError" not in capfd.readouterr().err


def test_a_joint_that_loses_energy_has_one_steady_state():
    """The bilinear hysteretic oscillator has no jumps (Caughey 1960)."""
    up, down = frf_up_and_down(oscillator(Masing(1.0, K)), np.linspace(95.0, 145.0, 26), 10.0, "1:+X", ["1:+X"])
    assert not [finding for finding in up.findings if finding.code == "several-steady-states"]
    np.testing.assert_allclose(heights(up), heights(down), rtol=8e-3)


def test_frequencies_that_do_not_ascend_get_a_sentence():
    with pytest.raises(InputError, match="each above the one before"):
        frf_up_and_down(oscillator(Masing(1.0, K)), np.array([50.0, 40.0]), 1.0, "1:+X", ["1:+X"])


def swept_in_time(frequencies, force):
    """Between which neighbours a stepped sweep in time jumps: DOP853, each frequency from the state of the one before.

    A jump is a change to more than one and a half or less than two thirds, which no step on these branches is.
    """
    first, jumps, before = 0j, [], None
    for frequency in frequencies:
        first = first_after(120, frequency, force, first)
        if before is not None and not 2 / 3 < abs(first) / abs(before[1]) < 1.5:
            jumps.append((before[0], frequency))
        before = frequency, first
    return jumps


@pytest.mark.parametrize(
    ("frequencies", "force"),
    [(np.arange(119.5, 134.0, 1.5), 4.5), (np.arange(137.8, 112.0, -1.9), 4.0), (np.arange(126.2, 137.0, 1.3), 3.0)],
    ids=["upward", "downward", "upward at 3 N"],
)
def test_a_sweep_says_where_its_states_change_to_another_branch(frequencies, force):
    """As the sweep in time jumps, so do the states, each of which begins from its neighbour."""
    (jump,) = swept_in_time(frequencies, force)
    found = frf(oscillator(ELASTIC(1.0, K)), frequencies, force, "1:+X", ["1:+X"])
    (finding,) = [finding for finding in found.findings if finding.code == "branch-jump"]
    assert finding.value == pytest.approx(jump[0])
    assert f"between {min(jump):.5g} and {max(jump):.5g} Hz" in finding.message


def test_a_sweep_that_stays_on_its_branch_names_no_jump():
    for law, force in ((ELASTIC(1.0, K), 0.5), (Masing(1.0, K), 10.0)):
        for frequencies in (np.linspace(95.0, 145.0, 14), np.linspace(145.0, 95.0, 41)):
            found = frf(oscillator(law), frequencies, force, "1:+X", ["1:+X"])
            assert found.converged.all() and "branch-jump" not in [finding.code for finding in found.findings]


def largest_by_describing_function(force):
    """Frequency in Hz and amplitude in m of the largest response with the first harmonic alone.

    (k(A) - w^2)^2 + (c w)^2 = (F/A)^2 has a real w up to the largest A, with c w = F/A there but for c^2/2.
    """
    angle, c = 2 * np.pi * np.arange(256) / 256, 2 * RATIO * STUCK
    sizes = np.geomspace(1e-6, 1e-2, 20001)
    spring = SPRING + 2 * np.mean(FC * np.tanh(K * sizes[:, None] * np.cos(angle) / FC) * np.cos(angle), axis=1) / sizes
    exists = c**2 * (spring - c**2 / 4) <= (force / sizes) ** 2
    last = np.flatnonzero(exists)[-1]
    return np.sqrt(spring[last] - c**2 / 2) / (2 * np.pi), sizes[last]


@pytest.mark.parametrize("force", [1.3, 5.2])
def test_the_resonance_of_a_curve_that_folds_is_its_largest_response(force):
    """An upward scan jumps beyond it: it had been 130.6 instead of 114.1 Hz at 4 N, with 0.4 of its height."""
    frequency, size = largest_by_describing_function(force)
    found = resonance(oscillator(ELASTIC(1.0, K)), force, "1:+X", "1:+X", (90.0, 160.0))
    assert found.frequency == pytest.approx(frequency, rel=found.frequency_error + 2e-3)
    assert abs(found.amplitude) == pytest.approx(size, rel=found.error_estimate + 3e-3)
    assert abs(found.amplitude) == pytest.approx(settled(found.frequency, force, found.amplitude), rel=5e-3)


def test_a_damping_map_follows_the_curve_round_its_fold():
    levels = np.array([0.9, 3.6])
    found = damping_map(oscillator(ELASTIC(1.0, K)), levels, [FC], "1:+X", "1:+X", (90.0, 160.0))
    wanted = [largest_by_describing_function(level)[0] for level in levels]
    np.testing.assert_allclose(found.frequency[:, 0], wanted, rtol=5e-3)
    np.testing.assert_allclose(found.damping[:, 0], RATIO * STUCK / (2 * np.pi * np.array(wanted)), rtol=0.02)


@pytest.mark.parametrize("upward", [True, False])
@pytest.mark.parametrize(
    ("shaker", "level", "fold"), [(None, 4.0, 131.0), (Shaker(2.2, 0.04, 0.013), 4.3, 127.0)], ids=["bare", "shaker"]
)
def test_records_of_a_stepped_sine_stay_on_a_branch_as_long_as_it_goes(shaker, level, fold, upward):
    """Every record is where DOP853 stays that begins on it, with the armature of the shaker on the mass and its coil
    keeping the force; the rig names the jump of an upward sweep, and no other."""
    frequencies = np.arange(118.0, 138.0)[:: 1 if upward else -1]
    drive = SteppedSine(Dof(1, "+X"), level, tuple(frequencies), 1.0, shaker=shaker)
    rig = FrictionRig(oscillator(ELASTIC(1.0, K)), drive, (Channel("x", Dof(1, "+X"), "displacement"),), 2000.0)
    records, mount = list(rig.takes()), 0.0 if shaker is None else shaker.mount_mass
    mass, damper = (0.0, 0.0) if shaker is None else (shaker.moving_mass, shaker.damping)
    for frequency, record in list(zip(frequencies, records, strict=True))[::4]:
        rates = 2j * np.pi * frequency
        force, x = 2 / 2000 * record.signals @ np.exp(-rates * np.arange(2000) / 2000)
        assert abs(x) == pytest.approx(settled(frequency, level, x, mass + mount, damper), rel=2e-3)
        assert force + (damper * rates + mass * rates**2) * x == pytest.approx(level, rel=1e-6)
    jumps = [finding for finding in rig.findings if finding.code == "branch-jump"]
    assert [finding.value for finding in jumps] == ([fold] if upward else [])


def test_a_settling_time_does_not_pass_over_a_shaker():
    with pytest.raises(InputError, match="leave out settle"):
        SteppedSine(Dof(1, "+X"), 4.0, (120.0,), settle=1.0, shaker=Shaker(2.0))


@pytest.mark.parametrize(
    ("force", "lines", "folded"),
    [
        (1.0, (136.0, 139.0), True),
        (1.0, (120.0, 135.5), False),
        (2.2, (108.0, 138.0), True),
        (3.7, (105.0, 136.0), True),
    ],
)
def test_a_fold_that_lies_between_two_lines_is_named(force, lines, folded):
    """Both lines have one state. Within the named frequencies DOP853 stays on two, outside of them it does not."""
    model = oscillator(ELASTIC(1.0, K))
    coarse = frf(model, np.array(lines), force, "1:+X", ["1:+X"])
    named = [finding for finding in coarse.findings if finding.code == "fold-between-lines"]
    assert len(named) == folded
    if not folded:
        return
    begin, end = (float(word) for word in named[0].message.split(" at ")[1].split(" Hz")[0].split(" and "))
    assert lines[0] < begin < end < lines[1]
    inside = begin + (end - begin) * np.array([0.05, 0.95])
    beyond = np.array([begin - 0.05 * (end - begin), end + 0.05 * (end - begin)])
    for frequencies, several in ((inside, True), (beyond, False)):
        grid = np.unique([*np.arange(lines[0], lines[1], (end - begin) / 10), *frequencies])
        states = frf_up_and_down(model, grid, force, "1:+X", ["1:+X"])
        up, down = ([settled(f, force, firsts(one)[list(grid).index(f)]) for f in frequencies] for one in states)
        assert [abs(a / b - 1) > 0.05 for a, b in zip(up, down, strict=True)] == [several, several]
