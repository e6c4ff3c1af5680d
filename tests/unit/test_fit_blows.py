"""Averages of a few blows: what changes from blow to blow, and noise that all FRFs of a blow share, in the intervals."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import Deviations
from ema.fit import modes, stabilise
from ema.fit.scatter import widened
from tests.unit.fit_rig import frfs, model

FREQUENCIES, DAMPING = [120.0, 150.0, 175.0], [0.004, 0.003, 0.005]
BETWEEN = "scatter between the averages"
SHARED = "noise that the FRFs share"
BLOWS, OUTPUTS = 5, 4


def averaged(seed, wander=0.0, common=0.0, noise=0.02):
    """The average of five blows on four outputs.

    ``wander``: relative change of the resonances from blow to blow; ``common``: noise that all FRFs of a blow share, a
    part of each FRF's value; ``noise``: of each FRF alone, over its rms.
    """
    rng = np.random.default_rng([7, seed])

    def draw(*shape):
        return np.sqrt(0.5) * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))

    every = []
    for _ in range(BLOWS):
        moved = np.multiply(FREQUENCIES, 1 + wander * rng.standard_normal(3))
        one = frfs(model(list(moved), DAMPING, dofs=OUTPUTS), 100, 200, 401)
        std = noise * np.sqrt(np.mean(np.abs(one.values) ** 2, axis=0))
        every.append(one.values * (1 + common * draw(401, 1, 1)) + std * draw(*one.values.shape))
    mean = np.mean(every, axis=0)
    deviations = (np.array(every) - mean) / BLOWS / np.sqrt(1 - 1 / BLOWS)
    numbers = np.arange(BLOWS)[:, None, None] + np.zeros((BLOWS, OUTPUTS, 1), int)
    return replace(one, values=mean, deviations=Deviations(deviations, numbers))


def fitted(measured):
    return modes(measured, stabilise(measured, range(4, 13, 2)), near=FREQUENCIES)


def coverage(draws, **how):
    """Share of natural frequencies and damping ratios inside 95 % intervals, and how often the basis names the blows."""
    inside, named = [], 0
    for seed in range(draws):
        found = fitted(averaged(seed, **how))
        std = np.sqrt(found.covariance[:, [0, 1], [0, 1]])
        errors = np.stack([found.natural_frequencies - FREQUENCIES, found.damping_ratios - DAMPING], axis=1)
        inside.append(np.abs(errors / std) < 1.96)
        named += BETWEEN in found.uncertainty.basis
    return np.mean(inside, axis=(0, 1)), named


def test_resonances_that_wander_from_blow_to_blow_are_in_the_intervals():
    inside, named = coverage(20, wander=2e-4, noise=0.005)
    assert np.all(inside >= 0.88), "95 % of 60 but for chance"
    assert named >= 19


def test_without_the_blows_these_intervals_are_far_too_narrow():
    """So the test above tests something."""
    measured = [averaged(seed, wander=2e-4, noise=0.005) for seed in range(10)]
    found = [fitted(replace(one, deviations=None)) for one in measured]
    errors = [(one.natural_frequencies - FREQUENCIES) / np.sqrt(one.covariance[:, 0, 0]) for one in found]
    assert np.mean(np.abs(errors) < 1.96) < 0.5


def test_noise_alone_widens_nothing():
    inside, named = coverage(25)
    assert named <= 1
    assert np.all(inside >= 0.88), "95 % of 75 but for chance"
    one = averaged(0)
    np.testing.assert_array_equal(fitted(one).covariance, fitted(replace(one, deviations=None)).covariance)


def test_noise_that_all_frfs_of_a_blow_share_is_in_the_intervals():
    """With and without the single blows: the residuals on the same line tell it too."""
    inside, named = coverage(12, common=0.3, noise=0.005)
    assert np.all(inside >= 0.86), "95 % of 36 but for chance"
    assert named >= 10
    alone = [fitted(replace(averaged(seed, common=0.3, noise=0.005), deviations=None)) for seed in range(12)]
    assert sum(SHARED in found.uncertainty.basis for found in alone) >= 11
    errors = [(found.natural_frequencies - FREQUENCIES) / np.sqrt(found.covariance[:, 0, 0]) for found in alone]
    assert np.mean(np.abs(errors) < 1.96) >= 0.86


@pytest.mark.parametrize("freedom", [1.0, 2.0, 4.0])
def test_chance_passes_for_scatter_in_one_case_of_a_hundred(freedom):
    rng = np.random.default_rng(3)
    noise, size = np.geomspace(1, 1e4, 8), np.ones(8)
    free = np.full(8, freedom)
    seen = noise * rng.chisquare(freedom, (400, 8)) / freedom
    assert np.mean([np.any(widened(row, noise, size, free) > 1) for row in seen]) <= 0.02


@pytest.mark.parametrize("freedom", [2.0, 4.0])
def test_the_factor_covers_scatter_of_an_unknown_level(freedom):
    """Modes that scatter by one level, on noise from far below to far above it."""
    rng = np.random.default_rng(4)
    noise, size, level = np.geomspace(1e-3, 10, 12), np.ones(12), 1.0
    true = noise + level
    inside = []
    for _ in range(150):
        seen = true * rng.chisquare(freedom, 12) / freedom
        std = np.sqrt(noise * widened(seen, noise, size, np.full(12, freedom)))
        inside.append(np.abs(np.sqrt(true) * rng.standard_normal(12)) < 1.96 * std)
    assert 0.93 <= np.mean(inside) <= 1.0
