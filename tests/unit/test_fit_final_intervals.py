"""Acceptance and confidence hold for the intervals that are stated, what no noise makes of them included."""

import numpy as np
import pytest
from scipy.stats import norm

from ema import fit
from ema.fit.policy import POLICY
from tests.bench.disturbances_nonlinear import friction
from tests.bench.systems import SMALL, system

SLIPS = 10.0
"""Largest joint amplitude over the slip limit."""


@pytest.mark.parametrize("seed", range(6))
def test_what_is_said_of_the_modes_of_a_slipping_joint_holds_for_their_stated_intervals(seed):
    """A mode decays with the probability that a normal distribution of the stated variance has above zero, and lies
    three standard deviations from its neighbour of the same participation (one reference: from every neighbour).
    """
    frfs = friction(np.random.default_rng([881, seed]), SLIPS).case.frfs
    found = fit.modes(frfs, fit.stabilise(frfs))
    frequency_std, damping_std = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)).T
    assert np.all(found.confidence <= norm.cdf(found.damping_ratios / damping_std) + 1e-9)
    distance = np.abs(found.poles[:, None] - found.poles) / (2 * np.pi) + np.diag(np.full(len(found.poles), np.inf))
    assert np.all(frequency_std <= POLICY.frequency_uncertainty * distance.min(axis=1))
    for candidate in found.candidates:
        assert candidate.reason


@pytest.mark.parametrize("number", [9, 12, 36])
def test_a_weak_mode_of_a_linear_system_is_accepted_with_the_interval_of_its_noise(number):
    """The truth is in closed form; what is left around a mode that makes no peak is that of all the band, not its."""
    case = system(5310, number, SMALL)[0]
    found = fit.modes(case.frfs, fit.stabilise(case.frfs))
    std = np.sqrt(found.covariance[:, 1, 1])
    assert np.all(std <= POLICY.visible_uncertainty * found.damping_ratios)
    assert np.all(found.confidence >= POLICY.confidence)
    truth = case.truth
    nearest = np.argmin(np.abs(found.poles[:, None] - truth.poles), axis=1)
    assert len(set(nearest.tolist())) == len(found.poles)
    assert np.all(np.abs(found.damping_ratios - truth.damping_ratios[nearest]) < 4 * std)
