"""Joint parameters from synthetic hysteresis loops: accuracy, honest intervals, faults of the measurement.

The resonator experiment of Gaul, Roseira and Becker, Shock and Vibration 15 (2008), Sec. 1: k_T from the slope of the
loop, Eq. (5) with m = 8. The truth is integrated here on its own, step by step, not by the formulas of the fit.
"""

import numpy as np
import pytest

from ema.data import Loop
from ema.errors import InputError
from ema.simulate import Masing, RegularisedMasing, identify, measured_loop
from ema.simulate.identification import fit_loop
from ema.simulate.loops import drive

MU, K, ALPHA, M = 0.22, 3e7, 0.55, 8.0
TOP = MU * 1000.0


def playing(x, stiffness, top, play):
    """Force of Eq. (5), m = 8, with play in series: elastic to F = 0, then across the gap, then on."""
    force, place, forces, before = 0.0, 0.0, np.empty(len(x)), x[0]
    for n, now in enumerate(x):
        way, before = now - before, now
        if force * way < 0:
            back = min(abs(way), abs(force) / stiffness) * np.sign(way)
            force, way = force + stiffness * back, way - back
            force = 0.0 if abs(force) < 1e-9 * top else force
        if way and force == 0.0:
            room = np.sign(way) * play / 2 - place
            place, way = (place + way, 0.0) if abs(way) <= abs(room) else (place + room, way - room)
        if way:
            force = float(np.clip(force + stiffness * way * (1 - abs(force / top) ** M), -top, top))
        forces[n] = force
    return forces


def made(
    generator,
    normal=1000.0,
    stiffness=K,
    ratio=3.0,
    noise=0.01,
    samples=500,
    cycles=3,
    play=0.0,
    offset=0.0,
    drift=0.0,
    sign=1,
    uneven=0.0,
    law=None,
):
    """A loop whose amplitude is ``ratio`` F_C/k_T, with noise, offset, drift per cycle, sign, jitter of the times."""
    top = MU * normal
    law = law or RegularisedMasing(MU, stiffness, M)
    amplitude = ratio * top / stiffness + play / 2
    t = (np.arange(cycles * samples) + uneven * (generator.random(cycles * samples) - 0.5)) / samples
    fine = amplitude * np.sin(2 * np.pi * np.linspace(0, cycles + 2, (cycles + 2) * 8000 + 1))
    force = playing(fine, stiffness, top, play) if play else drive(law, fine, normal)
    x = amplitude * np.sin(2 * np.pi * t) + noise * amplitude * generator.standard_normal(len(t))
    f = np.interp((t + 2) * 8000, np.arange(len(fine)), force) + noise * top * generator.standard_normal(len(t))
    f = sign * (f + (offset + drift * t) * top)
    return Loop(x + (0.3 * offset + 0.5 * drift * t) * amplitude, f, 0.0, amplitude, cycles, normal, t)


def at_several_forces(seed):
    generator = np.random.default_rng(seed)
    return [made(generator, n, K * (n / 1000) ** ALPHA) for n in (300.0, 800.0, 2000.0, 5000.0)]


@pytest.mark.parametrize("seed", range(101, 109))
def test_parameters_from_loops_with_one_percent_noise(seed):
    found = identify(at_several_forces(seed))
    assert found.friction_coefficient == pytest.approx(MU, rel=0.02)
    assert found.contact_stiffness == pytest.approx(K, rel=0.02)
    assert found.stiffness_exponent == pytest.approx(ALPHA, abs=0.03)
    assert found.exponent == pytest.approx(M, abs=1.0)
    low, high = found.friction_interval
    assert low < MU < high and high - low < 0.02 * MU
    assert not found.findings


def test_noise_free_loops_give_the_parameters_exactly():
    generator = np.random.default_rng(0)
    for cycles in (1, 3):
        fit = fit_loop(made(generator, noise=0.0, cycles=cycles))
        assert fit.contact_stiffness == pytest.approx(K, rel=1e-4)
        assert fit.slip_force == pytest.approx(TOP, rel=1e-4)
        assert fit.exponent == pytest.approx(M, rel=1e-3)


def test_intervals_hold_the_truth_in_95_of_100_draws():
    """200 draws of two loops each: each interval covers 95 %, give or take three standard deviations of the count."""
    truth, held, draws = (MU, K, 0.5, M), np.zeros(4), 200
    for seed in range(draws):
        generator = np.random.default_rng(1000 + seed)
        found = identify(
            [made(generator, n, K * (n / 1000) ** 0.5, samples=80, cycles=2, ratio=2.5) for n in (500.0, 2000.0)]
        )
        intervals = (
            found.friction_interval,
            found.stiffness_interval,
            found.stiffness_exponent_interval,
            found.exponent_interval,
        )
        held += [low <= value <= high for (low, high), value in zip(intervals, truth, strict=True)]
    assert np.all(held / draws >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / draws))
    assert np.all(held / draws < 1.0)


@pytest.mark.parametrize(
    ("fault", "codes"),
    [
        ({"offset": 0.3}, set()),
        ({"drift": 0.1}, set()),
        ({"sign": -1}, {"force-sign"}),
        ({"play": 0.3 * TOP / K}, {"backlash"}),
        ({"play": 2.0 * TOP / K}, {"backlash"}),
        ({"uneven": 0.9}, set()),
        ({"cycles": 1}, set()),
        ({"samples": 60}, set()),
        ({"ratio": 1.5}, set()),
        ({"offset": 0.3, "drift": 0.1, "sign": -1, "play": 0.5 * TOP / K, "uneven": 0.9}, {"force-sign", "backlash"}),
    ],
    ids=["offset", "drift", "sign", "little play", "much play", "jitter", "one cycle", "coarse", "small", "all"],
)
def test_faults_of_the_measurement_do_not_move_the_joint(fault, codes):
    generator = np.random.default_rng(21)
    found = identify([made(generator, **fault), made(generator, 4000.0, 2 * K, **fault)])
    assert found.friction_coefficient == pytest.approx(MU, rel=0.02)
    assert found.contact_stiffness == pytest.approx(K, rel=0.025)
    assert found.exponent == pytest.approx(M, abs=1.6)
    assert found.stiffness_exponent == pytest.approx(0.5, abs=0.03)
    assert {finding.code for finding in found.findings} == codes
    if "play" in fault:
        assert found.loops[0].play == pytest.approx(fault["play"], rel=0.1)
    else:
        assert found.loops[0].play == 0.0


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0, 20.0])
def test_other_exponents(exponent):
    found = fit_loop(made(np.random.default_rng(4), law=RegularisedMasing(MU, K, exponent)))
    assert found.exponent == pytest.approx(exponent, rel=4 * found.std[2] + 0.01)
    assert found.contact_stiffness == pytest.approx(K, rel=0.02)


def unknown(found):
    return " ".join(f.message for f in found.findings if f.code == "not-identifiable")


def test_stuck_loops_tell_the_stiffness_and_say_what_they_do_not():
    generator = np.random.default_rng(5)
    found = identify([made(generator, n, K * (n / 1000) ** ALPHA, ratio=0.5) for n in (500.0, 1000.0, 3000.0)])
    assert found.contact_stiffness == pytest.approx(K, rel=0.02)
    assert found.stiffness_exponent == pytest.approx(ALPHA, abs=0.03)
    assert np.isnan(found.friction_coefficient) and np.isnan(found.exponent)
    low, high = found.friction_interval
    assert 0.4 * MU < low < MU and high == np.inf
    assert "friction coefficient" in unknown(found) and "exponent m" in unknown(found)
    mixed = identify([made(generator, ratio=0.5), *at_several_forces(6)[:2]])
    assert mixed.friction_coefficient == pytest.approx(MU, rel=0.02)
    assert [fit.slides for fit in mixed.loops] == [False, True, True]
    assert [finding.code for finding in mixed.findings] == ["no-slip"]


def test_one_normal_force_and_a_sharp_knee_leave_exponents_open():
    generator = np.random.default_rng(7)
    found = identify([made(generator, law=Masing(MU, K)) for _ in range(2)])
    assert np.isnan(found.stiffness_exponent)
    assert "growth of k_T" in unknown(found) and "exponent m" in unknown(found)
    assert found.contact_stiffness == pytest.approx(K, rel=0.02)


def test_loops_that_disagree_widen_the_interval():
    """mu differs by 10 % from loop to loop: the interval tells it, though every loop on its own is precise."""
    generator = np.random.default_rng(8)
    loops = [
        made(generator, n, stiffness=K, law=RegularisedMasing(MU * c, K, M))
        for n, c in ((800.0, 0.95), (1000.0, 1.05), (2000.0, 0.95), (3000.0, 1.05))
    ]
    low, high = identify(loops).friction_interval
    assert low < MU < high and high - low > 0.1 * MU


def test_bad_loops_get_a_sentence():
    x = np.sin(2 * np.pi * np.arange(300) / 100)
    with pytest.raises(InputError, match="no loop to identify"):
        identify([])
    with pytest.raises(InputError, match="without normal force"):
        identify([Loop(x, x, 0.0, 1.0, 3)])
    with pytest.raises(InputError, match="too few samples"):
        identify([Loop(x[:20], x[:20], 0.0, 1.0, 1, 100.0)])
    with pytest.raises(InputError, match="NaN"):
        identify([Loop(x, np.where(x > 0.9, np.nan, x), 0.0, 1.0, 3, 100.0)])
    with pytest.raises(InputError, match="does not move"):
        identify([Loop(x, 0 * x, 0.0, 1.0, 3, 100.0)])
    with pytest.raises(InputError, match="do not rise"):
        identify([Loop(x, x, 0.0, 1.0, 3, 100.0, np.zeros(300))])
    t = np.arange(300) / 100
    for words, arguments in (
        ("less than one cycle", (t[:50], x[:50], x[:50], 1.0)),
        ("not a frequency", (t, x, x, 0.0)),
        ("NaN or infinite", (t, x, np.full(300, np.nan), 1.0)),
        ("do not rise", (t[::-1], x, x, 1.0)),
        ("8 or more", (t[:5], x[:5], x[:5], 1.0)),
        ("constant", (t, x, np.ones(300), 1.0)),
    ):
        with pytest.raises(InputError, match=words):
            measured_loop(*arguments)


def test_whole_cycles_of_a_record_with_run_up_and_run_down():
    """Two steady cycles between turning points of 5, with ramps around them: the closed-form area to 1e-3."""
    t = np.arange(0, 7, 1e-3)
    envelope = np.interp(t, [0, 1.5, 5.5, 7], [0, 1, 1, 0])
    x = 3 * TOP / K * envelope * np.sin(2 * np.pi * t)
    loop = measured_loop(t, x, drive(Masing(MU, K), x, 1000.0), 1.0, 1000.0)
    assert loop.area == pytest.approx(4 * TOP * (2 * TOP / K), rel=1e-3)
    assert loop.amplitude == pytest.approx(3 * TOP / K, rel=1e-4)
    assert [finding.code for finding in loop.findings] == ["run-down"]
    back = measured_loop(t, x, -drive(Masing(MU, K), x, 1000.0), 1.0, 1000.0)
    assert back.area == pytest.approx(loop.area, rel=1e-12)
    assert "force-sign" in {finding.code for finding in back.findings}
