"""The noise of an FRF over its size: what is read from residuals of known variance."""

import numpy as np
import pytest

from ema.fit import noise

LINES = np.arange(640)
PEAK = 1 / ((LINES - 320.3) ** 2 + 0.05**2)
"""Squared modulus of a resonance of a tenth of a line: one line 20 dB and more above all but its neighbours."""


def stated_over_true(variance, model, seed):
    """Stated over true variance, per line, from residuals with this variance (Gaussian, so exponential in power)."""
    power = variance * np.random.default_rng(seed).exponential(size=variance.shape)
    return noise.structure(power, model).variance(power, model) / variance


@pytest.mark.parametrize("seed", range(20))
def test_noise_that_is_constant_is_constant_at_a_lone_peak(seed):
    """The level of 640 lines is known to 4 % (one standard deviation); nothing tells of a slope, so none is carried on
    to the line of the peak, where it would be multiplied by its distance.
    """
    model = PEAK[None, None]
    ratio = stated_over_true(np.ones((1, 1, len(LINES))), model, seed)[0, 0]
    assert 0.5 < ratio[320] < 2
    assert 0.8 < np.median(ratio) < 1.25


@pytest.mark.parametrize("seed", range(5))
def test_noise_in_proportion_to_the_frf_is_followed_to_the_peak(seed):
    model = np.repeat(PEAK[None, None], 8, axis=0)
    ratio = stated_over_true(1e-3 * model, model, seed)
    assert 0.5 < ratio[:, 0, 320].mean() < 2
    assert 0.8 < np.median(ratio) < 1.25


@pytest.mark.parametrize("seed", range(5))
def test_noise_of_both_kinds_is_followed_to_the_peak(seed):
    """Constant below, in proportion above: a bend, which no straight line describes.

    Of 200 draws the logarithm of the ratio at the peak has a standard deviation of 0.18 about -0.14.
    """
    model = np.repeat((1 / ((LINES - 320.3) ** 2 / 900 + 0.05**2))[None, None], 8, axis=0)
    ratio = stated_over_true(1 + 0.1 * model, model, seed)
    assert 0.4 < ratio[:, 0, 320].mean() < 2
    assert 0.8 < np.median(ratio) < 1.25
