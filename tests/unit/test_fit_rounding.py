"""Where elimination leaves nothing but rounding, a fit ends with bounded numbers and never with an error of algebra."""

import numpy as np
import pytest

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
