"""Modes of random shaker tests of random systems, from the signals on."""

import numpy as np
import pytest

from tests.bench import narrow_peaks, random_tests

SEED, SYSTEMS = 5003, 15


@pytest.mark.slow
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


@pytest.mark.parametrize("lines", [2, 8])
def test_stated_deviations_of_narrow_peaks_are_those_that_the_lines_allow(lines):
    """Against the bound by the spectra themselves. When the force was taken to drive each line of a peak as it does the
    lines around it on the average, what was stated for peaks of two lines was 0.8 of the bound, which errors exceeded by
    half; a local model loses up to a fifth.
    """
    ratios = [narrow_peaks.compared(seed, lines)[0] for seed in range(8)]
    assert 0.95 < np.median(ratios) < 1.25
