"""Lines that a multisine leaves out: closed forms of a linear and of two nonlinear structures, and random friction."""

from dataclasses import replace

import numpy as np
import pytest

from ema import estimate
from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.errors import InputError
from ema.estimate.detection_lines import DISTORTED, distortion_finding, nonlinear_distortion
from ema.fit import modes, stabilise
from tests.bench import detection_lines as bench

RATE, PERIOD = 1024, 1024


def linear_response(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One period of an odd multisine, its excited lines, and the displacement (std 1) of a mode at 90 Hz, 3 %, to it."""
    odd = np.arange(21, 181, 2)
    lines = np.concatenate([np.delete(odd[k : k + 4], rng.integers(4)) for k in range(0, len(odd), 4)])
    spectrum = np.zeros(PERIOD // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    at = np.fft.rfftfreq(PERIOD, 1 / RATE) / 90
    motion = np.fft.irfft(spectrum / (1 - at**2 + 0.06j * at))
    return np.fft.irfft(spectrum), lines, motion / motion.std()


def run_of(force: np.ndarray, response: np.ndarray, periods: int = 5, noise: float = 0.0, seed: int = 0) -> Run:
    """A periodic run in steady state."""
    rows = (Channel("f", None, "force", "reference", "N"), Channel("d", None, "displacement", unit="m"))
    signals = np.vstack([np.tile(force, periods), np.tile(response, periods)])
    signals[1] += noise * np.random.default_rng(seed).standard_normal(signals.shape[1])
    return Run("m", Condition(Excitation("sweep", period=1.0)), (Recording(signals, float(RATE), rows),))


@pytest.mark.parametrize(("power", "parity"), [(3, "odd"), (2, "even")])
def test_the_distortion_is_that_of_the_spectrum_of_the_power(power, parity):
    """x + c x^p: the lines left out hold those of c x^p, which its transform over one period gives, and nothing else."""
    rng = np.random.default_rng(20261124)
    force, lines, motion = linear_response(rng)
    response = motion + 0.02 * motion**power
    spectrum = np.abs(np.fft.rfft(response)) ** 2
    left_out = [k for k in range(lines[0], lines[-1]) if k not in lines and k % 2 == (parity == "odd")]
    expected = np.sqrt(spectrum[left_out].mean() / spectrum[lines].mean())
    read = nonlinear_distortion(run_of(force, response))
    assert getattr(read, parity) == pytest.approx(expected, rel=1e-9) and expected > DISTORTED
    assert getattr(read, "even" if parity == "odd" else "odd") < 1e-9
    assert read.verdict == "not linear" and distortion_finding(read, "run m").code == "nonlinear-distortion"


def test_noise_is_not_distortion_and_hides_it_honestly():
    """1 % of noise: linear; 30 %: not testable. Noise shows of a mean power over n lines 1/sqrt(n), so its size is
    known: over 200 draws the verdict is never ``not linear``."""
    rng = np.random.default_rng(7)
    force, _, motion = linear_response(rng)
    for noise, verdict in ((0.01, "linear"), (0.3, "not testable")):
        read = [nonlinear_distortion(run_of(force, motion, noise=noise, seed=seed)) for seed in range(200)]
        assert [one.verdict for one in read].count("not linear") == 0
        assert [one.verdict for one in read].count(verdict) >= 195
    assert distortion_finding(read[0], "run m").code == "linearity-not-testable"


def test_a_shaker_that_answers_the_structure_does_not_make_it_nonlinear():
    """A force with 9 % of distortion in it, on a linear structure: the response to it at the lines left out is the FRF's.

    Half-power bandwidth 18 Hz, excited lines 2 and 4 Hz apart."""
    force, _, motion = linear_response(np.random.default_rng(5))
    bent = force + 0.03 * force.std() * motion**3
    at = np.fft.rfftfreq(PERIOD, 1 / RATE) / 90
    response = np.fft.irfft(np.fft.rfft(bent) / (1 - at**2 + 0.2j * at))
    assert nonlinear_distortion(run_of(bent, response, noise=0.01 * response.std())).verdict == "linear"
    blind = nonlinear_distortion(run_of(force, response, noise=0.01 * response.std()))
    assert blind.odd > 10 * DISTORTED, "without the force that was measured it would have been"


def test_random_friction_tables():
    """100 tables that no threshold was set on: the truth is the change of their FRFs from half the level."""
    told = bench.outcomes(20261124, 100)
    changed = [verdict for index, _, verdict in told if index >= 0.05]
    same = [verdict for index, _, verdict in told if index < 0.01]
    assert len(changed) > 15 and changed.count("not linear") >= 0.95 * len(changed)
    assert len(same) > 30 and same.count("not linear") <= 0.05 * len(same) and same.count("not testable") == 0


def test_frfs_of_a_multisine_are_those_of_its_lines_with_the_verdict_beside_them():
    rng = np.random.default_rng(3)
    force, lines, motion = linear_response(rng)
    frfs = estimate.sweep(run_of(force, motion + 0.02 * motion**3, noise=1e-3))
    np.testing.assert_allclose(frfs.frequencies, lines)
    assert [one.code for one in frfs.findings] == ["nonlinear-distortion"]
    frfs = estimate.sweep(run_of(force, motion, noise=1e-3))
    assert [one.code for one in frfs.findings] == ["level-tested"]
    (frequency,), (damping,) = (lambda m: (m.natural_frequencies, m.damping_ratios))(modes(frfs, stabilise(frfs)))
    assert frequency == pytest.approx(90, rel=1e-4) and damping == pytest.approx(0.03, rel=2e-3)
    short = estimate.sweep(run_of(force, motion, periods=3, noise=1e-3))
    assert [one.code for one in short.findings] == ["linearity-not-testable"]


def test_a_periodic_chirp_has_no_lines_left_out():
    t = np.arange(4 * PERIOD) % PERIOD / RATE
    force = np.sin(2 * np.pi * (30 * t + 50 * t**2))
    frfs = estimate.sweep(run_of(force[:PERIOD], force[:PERIOD], periods=4))
    assert not frfs.findings and np.ptp(np.diff(frfs.frequencies)) < 1e-9
    with pytest.raises(InputError, match="no line of the excitation was left out"):
        nonlinear_distortion(run_of(force[:PERIOD], force[:PERIOD], periods=4))


def test_what_is_no_multisine_is_refused_in_one_sentence():
    force, _, motion = linear_response(np.random.default_rng(1))
    run = run_of(force, motion)
    with pytest.raises(InputError, match="no period"):
        nonlinear_distortion(replace(run, condition=Condition(Excitation("sweep"))))
    with pytest.raises(InputError, match=r"three periods or more"):
        nonlinear_distortion(run, discard=2.5)
    with pytest.raises(InputError, match=r"whole samples"):
        nonlinear_distortion(replace(run, condition=Condition(Excitation("sweep", period=1.0003))))
