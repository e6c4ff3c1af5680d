"""Tones in FRFs: undamped poles to begin with where they leak into all lines, and variances of single lines."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import FrfSet
from ema.fit import candidates, modes, noise, stabilise
from ema.fit.prepare import prepare
from tests.bench import disturbances, systems
from tests.unit.fit_rig import frfs, model

FREQUENCIES = np.linspace(100.0, 500.0, 801)
NATURAL = [131.0, 217.0, 322.0, 431.0]
ZETA = [0.006, 0.009, 0.005, 0.008]
TONES = (150.06, 200.08, 250.1, 300.12, 350.14)


def exact() -> FrfSet:
    """Accelerances of four modes at six outputs."""
    return frfs(model(NATURAL, ZETA, dofs=6, seed=3), 100.0, 500.0, len(FREQUENCIES))


def measured(seed: int, size: float, share: float = 0.0) -> FrfSet:
    """The same with 0.3 % noise, ``share`` of its power in all FRFs alike, and tones of
    ``size`` times the root mean square of each FRF.
    """
    rng = np.random.default_rng(seed)
    clean = exact()
    values = np.array(clean.values)
    rms = np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
    own, common = (disturbances.unit_noise(rng, shape) for shape in (values.shape, (len(values), 1, 1)))
    error = 0.003 * rms * (np.sqrt(1 - share) * own + np.sqrt(share) * common)
    for tone in TONES if size else ():
        lines = (FREQUENCIES - tone) / (FREQUENCIES[1] - FREQUENCIES[0])
        leaked = np.sinc(lines) * np.exp(-1j * np.pi * lines)
        error = error + size * leaked[:, None, None] * rms * np.exp(2j * np.pi * rng.random(rms.shape))
    return replace(clean, values=values + error)


def places(seed: int, size: float, share: float = 0.0) -> np.ndarray:
    """Frequencies of the poles that are begun with."""
    one = prepare(measured(seed, size, share))
    poles = 2 * np.pi * np.array([(-z + 1j) * f for f, z in zip(NATURAL, ZETA, strict=True)])
    return candidates.of_single_lines(one, (100.0, 500.0), poles).poles.imag / (2 * np.pi)


@pytest.mark.parametrize("size", [0.5, 1.0, 10.0])
def test_tones_without_a_window_are_begun_with(size: float) -> None:
    """Bins of the search would average over them: their flanks made residues err by up to 4 stated deviations."""
    found = places(1, size)
    assert len(found) == len(TONES)
    assert np.all(np.abs(found - TONES) < FREQUENCIES[1] - FREQUENCIES[0])


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_noise_is_no_tone(share: float) -> None:
    """Also where all FRFs share it: 40 sets of 800 lines, and one line in 100,000 stands out, most without a flank."""
    assert sum(len(places(seed, 0.0, share=share)) for seed in range(40)) <= 1


def test_a_line_with_a_tone_keeps_its_variance_and_leaves_that_of_others() -> None:
    """Estimated from 10 averages (18 degrees of freedom), 20 times the standard deviation at one line: the mean over 25
    lines had made 17 times the variance of all of them.
    """
    rng = np.random.default_rng(4)
    true = np.ones((6, 1, 400))
    true[..., 200] = 400.0
    variance = true * rng.chisquare(18, true.shape) / 18
    size = np.ones(true.shape)
    found = noise.pooled(variance, noise.structure(variance, size), size)
    assert np.all(np.abs(np.log(found[..., 200] / 400)) < 1.5)
    beside = np.delete(found, 200, axis=-1)
    assert np.all((beside > 0.6) & (beside < 1.6))


def test_intervals_beside_tones_are_those_without_them() -> None:
    """A stated variance contains what the tones do to all lines, and the fit has them as poles. Standard deviations had
    been up to twice those without tones.
    """
    std = []
    for size in (0.0, 0.5):
        drawn = measured(7, size)
        base = np.abs(np.array(measured(7, 0.0).values) - np.array(exact().values)) ** 2
        tones = np.abs(np.array(drawn.values) - np.array(measured(7, 0.0).values)) ** 2
        variance = np.mean(base, axis=0) + tones
        variance *= np.random.default_rng(9).chisquare(18, variance.shape) / 18
        one = replace(drawn, variance=variance, averages=np.full(variance.shape[1:], 10.0))
        found = modes(one, stabilise(one))
        assert found.natural_frequencies == pytest.approx(NATURAL, abs=0.02)
        std.append(np.sqrt(np.diagonal(np.array(found.covariance), axis1=1, axis2=2)))
    ratio = std[1] / std[0]
    assert np.all((ratio > 0.9) & (ratio < 1.1))


def test_a_line_of_noise_that_was_taken_out_does_not_come_back_as_a_mode():
    """A random system where the search takes out a pole of one line at 107 Hz: the six modes of its truth, none beside."""
    case, _ = systems.system(9302, 12, systems.Extent())
    found = modes(case.frfs, stabilise(case.frfs))
    np.testing.assert_allclose(found.natural_frequencies, case.truth.natural_frequencies, rtol=2e-3)
