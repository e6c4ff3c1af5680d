"""The noise of an FRF over its size: what is read from residuals of known variance."""

from dataclasses import replace

import numpy as np
import pytest

from ema.fit import modes, noise, stabilise
from tests.unit.fit_rig import frfs, model

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


@pytest.mark.parametrize("seed", [2, 4, 6, 9])
def test_a_coherence_that_was_not_estimated_makes_no_modes(seed: int) -> None:
    """0.99 at all lines, while the noise is additive: it overrates the lines where an accelerance is small."""
    exact = frfs(model([75.0, 117.0], [0.01, 0.006], dofs=3), 5, 200, 391)
    level = (0.01, 0.1)[seed % 2] * np.sqrt(np.mean(np.abs(exact.values) ** 2))
    draw = np.random.default_rng([5, seed]).standard_normal((2, *exact.values.shape)) / np.sqrt(2)
    values = exact.values + level * (draw[0] + 1j * draw[1])
    measured = replace(
        exact, values=values, coherence=np.full(values.shape, 0.99), averages=np.full(values.shape[1:], 10.0)
    )
    found = modes(measured, stabilise(measured))
    assert len(found.poles) == 2, found.natural_frequencies
    assert [one.severity for one in found.findings if one.code == "coherence-constant"] == ["warning"]


def test_a_coherence_says_no_more_than_its_decimals() -> None:
    exact = np.random.default_rng(6).uniform(0.96, 0.9999, (400, 2, 1))
    rounded = noise.estimated(np.round(exact, 2))
    assert rounded is not None and rounded.max() == pytest.approx(0.995) and rounded.min() == pytest.approx(0.96)
    np.testing.assert_array_equal(noise.estimated(exact), exact)
    assert noise.estimated(np.full((400, 2, 1), 0.9)) is None and noise.estimated(np.ones((400, 2, 1))) is None
