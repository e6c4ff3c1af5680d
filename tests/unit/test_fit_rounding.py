"""Where elimination leaves nothing but rounding, a fit ends with bounded numbers and never with an error of algebra."""

import numpy as np
import pytest

from ema.data import FrfSet, poles_from
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


def narrow_peak(seed):
    """Frequency and damping ratio of a resonance with a half-power bandwidth of a tenth of a line, and its modes."""
    rng = np.random.default_rng(seed)
    spacing, frequency = 0.25, 180 + rng.uniform(-1, 1)
    damping = 0.05 * spacing / frequency
    lines = np.arange(100, 260, spacing)
    pole = poles_from(np.array([frequency]), np.array([damping]))
    clean = 1 / (2j * np.pi * lines - pole) - 1 / (2j * np.pi * lines - pole.conj())
    noise = rng.standard_normal((len(lines), 2)) @ [1, 1j]
    values = clean + 0.05 * np.sort(np.abs(clean))[-3] * noise
    frfs = FrfSet(lines, values[:, None, None], (Dof(1, "+Z"),), (Dof(1, "+Z"),), "receptance")
    return frequency, damping, spacing, modes(frfs, stabilise(frfs, orders=range(2, 11, 2)))


def test_a_peak_narrower_than_the_lines_is_a_mode_whose_damping_is_bounded():
    """The natural frequency is determined; the damping ratio of most draws is not, and no interval leaves it out."""
    bounded = modes_found = 0
    for seed in range(20):
        frequency, damping, spacing, model = narrow_peak(seed)
        for near in np.flatnonzero(np.abs(model.natural_frequencies - frequency) < spacing):
            std = np.sqrt(model.covariance[near, [0, 1], [0, 1]])
            assert abs(model.natural_frequencies[near] - frequency) < 5 * std[0] < spacing, seed
            assert abs(model.damping_ratios[near] - damping) < 3 * std[1], seed
            limits = [finding.limit for finding in model.findings if finding.code == "damping-not-resolved"]
            assert bool(limits) == bool(std[1] > model.damping_ratios[near] / 3), seed
            assert all(limit > damping for limit in limits), seed
            bounded, modes_found = bounded + len(limits), modes_found + 1
    assert modes_found >= 16 and bounded >= 10
