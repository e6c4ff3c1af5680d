"""Modes of random shaker tests of random systems, from the signals on."""

import numpy as np

from tests.bench import random_tests

SEED, SYSTEMS = 5003, 15


def test_modes_of_random_tests_are_found_and_their_intervals_hold():
    """On 60 systems of seed 5002 with 231 modes 92, 90 and 91 % of f, zeta and residues are inside, one mode is missed
    and one is false: intervals are too narrow, most for peaks under twenty lines and in heavy noise. When the local model
    was the solution of the linear problem, 74 % of the damping ratios of the same tests were inside intervals 1.4 times
    as wide, and four modes were missed.
    """
    scores = random_tests.together(
        [random_tests.score(random_tests.random_test(SEED, number)) for number in range(SYSTEMS)]
    )
    assert scores.identifiable > 40
    assert scores.missed <= 0.03 * scores.identifiable
    assert scores.false <= 1
    expected = np.array([0.92, 0.89, 0.92])
    assert np.all(scores.inside > expected - 3 * np.sqrt(expected * (1 - expected) / len(scores.rows)))
