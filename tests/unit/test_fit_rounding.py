"""Where elimination leaves nothing but rounding, a fit ends with bounded numbers and never with an error of algebra."""

import numpy as np
import pytest

from ema.data import FrfSet
from ema.dof import Dof
from ema.fit import estimator, modes, stabilise
from tests.bench.cases import random_system


def test_a_matrix_with_a_rounded_direction_has_a_bounded_inverse():
    """A rank-one matrix of ones plus a negative pivot as rounding leaves it: the closed form bounds the inverse."""
    matrix = np.ones((3, 3))
    matrix[2, 2] -= 1e-13
    root = estimator._root_of_inverse(matrix)
    inverse = root @ root.T
    assert np.all(np.isfinite(inverse))
    # Eigenvalues 3, 0 and about -1e-13: the two last are taken as rounding.
    assert np.linalg.eigvalsh(inverse).max() == pytest.approx(1 / estimator.ROUNDING, rel=1e-6)


def test_a_definite_matrix_has_its_inverse():
    rng = np.random.default_rng(5)
    half = rng.standard_normal((6, 9))
    matrix = half @ half.T
    root = estimator._root_of_inverse(matrix)
    np.testing.assert_allclose(root @ root.T, np.linalg.inv(matrix), rtol=1e-9)


@pytest.mark.parametrize("orders", [range(2, 61, 2), range(2, 101, 2)])
def test_orders_far_beyond_the_modes_end_in_modes(orders):
    case = random_system(1, 0.001, 6, 8, 2, 401)
    found = modes(case.frfs, stabilise(case.frfs, orders))
    std = np.sqrt(found.covariance[:, [0, 1], [0, 1]])
    assert len(found.poles) and np.all(np.isfinite(std)) and np.all(std[:, 0] < 0.1 * found.natural_frequencies)


LINES = np.arange(100, 260, 0.25)


def receptance(parameters):
    """Of one resonance: natural frequency, damping ratio, real and imaginary part of the residue."""
    frequency, damping, real, imag = parameters
    omega = 2 * np.pi * frequency
    pole = -damping * omega + 1j * omega * np.sqrt(1 - damping**2)
    s = 2j * np.pi * LINES
    return (real + 1j * imag) / (s - pole) - (real - 1j * imag) / (s - pole.conj())


def narrow_peak(seed, width):
    """A resonance whose half-power bandwidth is ``width`` lines: its frequency and damping ratio, the standard
    uncertainties of both that any unbiased estimate has at least (Cramér-Rao), and its modes. No multiple of 50 or
    60 Hz lies near it: there a peak without damping is a line of the mains.
    """
    rng = np.random.default_rng(seed)
    spacing, frequency = LINES[1] - LINES[0], 187 + rng.uniform(-1, 1)
    truth = np.array([frequency, 0.5 * width * spacing / frequency, 1.0, 0.0])
    clean = receptance(truth)
    std = 0.05 * np.sort(np.abs(clean))[-3]
    steps = np.diag([1e-6 * width * spacing, 1e-5 * truth[1], 1e-6, 1e-6])
    slopes = [(receptance(truth + one) - receptance(truth - one)) / (2 * one.sum() * std) for one in steps]
    parts = np.hstack([np.real(slopes), np.imag(slopes)])
    bound = np.sqrt(np.diag(np.linalg.inv(parts @ parts.T)))[:2]
    values = clean + std * (rng.standard_normal((len(LINES), 2)) @ [1, 1j])
    frfs = FrfSet(LINES, values[:, None, None], (Dof(1, "+Z"),), (Dof(1, "+Z"),), "receptance")
    return truth[:2], bound, modes(frfs, stabilise(frfs, orders=range(2, 11, 2)))


def only_mode(model, frequency):
    """Place and stated standard uncertainties of the one mode within a line of ``frequency``."""
    (near,) = np.flatnonzero(np.abs(model.natural_frequencies - frequency) < LINES[1] - LINES[0])
    return near, np.sqrt(model.covariance[near, [0, 1], [0, 1]])


def test_a_peak_narrower_than_the_lines_is_a_mode_with_the_uncertainty_of_its_data():
    """Of a half-power bandwidth of a tenth of a line the damping ratio is determined to 3 to 12 % of itself, by the
    bound of Cramér and Rao for the noise that was added: the flanks tell it.

    Six lines hold the peak, 30 to 40 dB above all others: noise read from the other lines as a slope over the size of
    the FRF, and carried on to the peak, would be off by a multiple there.
    """
    deviations = []
    for seed in range(30):
        truth, bound, model = narrow_peak(seed, 0.1)
        near, std = only_mode(model, truth[0])
        assert 0.02 < bound[1] / truth[1] < 0.13, seed
        # 640 lines tell the standard deviation of the noise to 3 %
        np.testing.assert_allclose(std, bound, rtol=0.25, err_msg=str(seed))
        found = np.array([model.natural_frequencies[near], model.damping_ratios[near]])
        deviations.append((found - truth) / std)
        assert "damping-not-resolved" not in {finding.code for finding in model.findings}, seed
    # of 30 normal deviates: by chance once in a million outside these bounds
    rms = np.sqrt(np.mean(np.square(deviations), axis=0))
    assert np.all((rms > 0.42) & (rms < 1.70)), rms


@pytest.mark.parametrize("seed", range(8))
def test_the_damping_of_a_peak_much_narrower_than_the_lines_is_bounded_from_above(seed):
    """Of a bandwidth of 3/1000 of a line most draws tell no damping (bound of Cramér and Rao up to 400 %)."""
    truth, _, model = narrow_peak(seed, 0.003)
    near, std = only_mode(model, truth[0])
    assert abs(model.natural_frequencies[near] - truth[0]) < 5 * std[0] < LINES[1] - LINES[0]
    assert abs(model.damping_ratios[near] - truth[1]) < 3 * std[1]
    (finding,) = (one for one in model.findings if one.code == "damping-not-resolved")
    assert truth[1] < finding.limit < 0.01
