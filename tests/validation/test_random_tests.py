"""Modes of random shaker tests of random systems, from the signals on."""

import numpy as np
import pytest

import ema.fit
from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.dof import Dof
from ema.estimate.random_excitation import shaker
from tests.bench import random_tests

SEED, SYSTEMS = 5003, 15


def test_modes_of_random_tests_are_found_and_their_intervals_hold():
    """On 60 systems of seed 5002 with 231 modes 95, 92 and 93 % of f, zeta and residues are inside, and one mode is
    missed: intervals of damping are too narrow, for peaks under twenty lines. When the local model was the solution of the
    linear problem, 74 % of the damping ratios of the same tests were inside, and four modes were missed.
    """
    scores = random_tests.together(
        [random_tests.score(random_tests.random_test(SEED, number)) for number in range(SYSTEMS)]
    )
    assert scores.identifiable > 40
    assert scores.missed <= 0.03 * scores.identifiable
    assert scores.false <= 1
    expected = np.array([0.95, 0.92, 0.93])
    assert np.all(scores.inside > expected - 3 * np.sqrt(expected * (1 - expected) / len(scores.rows)))


def narrow_peak(seed, lines):
    """Record of a mode near 25 Hz whose peak is so many lines wide, in a random test with three responses in 2 % noise.

    Also its pole, the standard deviation of the noise, and spectra of force and responses of both halves.
    """
    rng = np.random.default_rng([seed, lines])
    rate, samples = 128.0, 4096
    half = samples // 2
    natural = 25 + rng.uniform(-2, 2)
    zeta = lines * rate / half / (2 * natural)
    pole = 2 * np.pi * natural * (-zeta + 1j * np.sqrt(1 - zeta**2))
    s = 2j * np.pi * np.arange(2 * samples + 1) * rate / (4 * samples)
    force = rng.standard_normal(s.shape) + 1j * rng.standard_normal(s.shape)
    force[[0, -1]] = 0
    shape = np.array([1.0, -0.7, 0.5])
    motion = shape[:, None] * s**2 / ((s - pole) * (s - np.conj(pole))) * force
    signals = np.fft.irfft(np.vstack([force, motion]), 4 * samples)[:, :samples]
    noise = 0.02 * np.std(signals[1:], axis=1, keepdims=True)
    signals[1:] += noise * rng.standard_normal((3, samples))
    spectra = np.fft.rfft(signals.reshape(4, 2, half), axis=2)[:, :, 1:-1]
    channels = [Channel("force", Dof(1, "+Z"), quantity="force", unit="N", role="reference")]
    channels += [Channel(f"acc {k}", Dof(k, "+Z"), quantity="acceleration", unit="m/s^2") for k in (1, 2, 3)]
    run = Run("random", Condition(Excitation("random")), (Recording(signals, rate, tuple(channels)),))
    return run, pole, noise[:, 0], spectra, 2j * np.pi * np.arange(1, half // 2) * rate / half


def least_std(pole, noise, spectra, s):
    """Standard deviation of the imaginary part of the pole [rad/s] at best, by the spectra on 301 lines around it: the
    residue, a background linear in the frequency, and the transient of each half with one of its own are unknown.
    """
    near = np.abs(s.imag - pole.imag) < 150.5 * (s[1] - s[0]).imag
    s, force = s[near], spectra[0][:, near]
    smooth = np.array([np.ones_like(s), (s - s.mean()) / np.abs(s).max()])
    information = 0.0
    for response, level in zip(spectra[1:], noise, strict=True):
        own = np.concatenate([[s**2 / (s - pole)], smooth])
        columns = [np.concatenate([function * one for one in force]) for function in own]
        for block in range(2):
            for function in np.concatenate([[1 / (s - pole)], smooth]):
                columns.append(np.concatenate([function * (place == block) for place in range(2)]))
        matrix = np.array(columns).T
        matrix /= np.linalg.norm(matrix, axis=0)
        basis, triangle = np.linalg.qr(matrix)
        values = np.concatenate(response[:, near])
        amplitudes = np.linalg.solve(triangle, basis.conj().T @ values)
        moved = sum(amplitudes[k] * matrix[:, k] / np.tile(s - pole, 2) for k in (0, 3, 6))
        moved = moved - basis @ (basis.conj().T @ moved)
        # A line of a block of n samples has noise of n times the variance of a sample.
        information += 2 * np.vdot(moved, moved).real / (2 * (spectra.shape[2] + 1) * level**2)
    return 1 / np.sqrt(information)


@pytest.mark.parametrize("lines", [2, 8])
def test_stated_deviations_of_narrow_peaks_are_those_that_the_lines_allow(lines):
    """Against the bound by the spectra themselves. When the force was taken to drive each line of a peak as it does the
    lines around it on the average, what was stated for peaks of two lines was 0.8 of the bound, which errors exceeded by
    half; a local model loses up to a fifth.
    """
    ratio = []
    for seed in range(8):
        run, pole, noise, spectra, s = narrow_peak(seed, lines)
        frfs = shaker(run).band(15.0, 35.0)
        found = ema.fit.modes(frfs, ema.fit.stabilise(frfs))
        nearest = int(np.argmin(np.abs(found.natural_frequencies - abs(pole) / (2 * np.pi))))
        stated = 2 * np.pi * np.sqrt(found.covariance[nearest, 0, 0])
        ratio.append(stated / least_std(pole, noise, spectra, s))
    assert 0.95 < np.median(ratio) < 1.25
