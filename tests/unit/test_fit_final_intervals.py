"""Acceptance and confidence hold for the intervals that are stated, what no noise makes of them included."""

import numpy as np
import pytest
from scipy.stats import norm

from ema import fit
from ema.fit.policy import POLICY
from tests.bench.disturbances_nonlinear import friction
from tests.bench.scoring import cramer_rao
from tests.bench.stated import automatic, errors
from tests.bench.systems import SMALL, Extent, system

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


@pytest.mark.parametrize("number", [75, 129, 158, 214])
def test_candidates_and_background_poles_are_no_part_of_the_peak_of_a_wide_mode(number):
    """The truth is in closed form. Poles beyond the band, and candidates ten bandwidths away, had counted as residual
    of wide modes with residues that happen to be alike over a few FRFs: intervals up to 5000 times the bound, and modes
    with 76 % of the energy around them that were not accepted. The Cramér-Rao bound is that of the true poles with
    residual terms; a fit has more unknowns.
    """
    case = system(905592, number, Extent())[0]
    stated = automatic(case.frfs)
    identifiable, bound = cramer_rao(case).identifiable, cramer_rao(case, residual_terms=True)
    match = errors(case, stated).match[identifiable]
    assert np.all(match >= 0)
    assert np.all(stated.damping_std[match] < 2 * bound.damping_std[identifiable])
