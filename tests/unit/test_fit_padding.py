"""Records with zeros appended: the lines between those that the records resolve hold nothing more."""

import numpy as np
import pytest

from ema.data import FrfSet, ModalModel, poles_from
from ema.dof import Dof
from ema.fit import modes, padding, stabilise
from tests.bench.cases import case_small

NATURAL, ZETA = np.array([160.0, 250.0, 390.0]), np.array([0.012, 0.009, 0.006])
"""After 1 s a ten-thousandth is left of each."""
DOFS = tuple(Dof(node, "+Z") for node in range(1, 6))
SHAPES = np.array([[1, 0.7, 0.5], [0.6, -0.8, 0.9], [-0.4, -0.9, -0.7], [-0.8, 0.5, 0.6], [0.9, 0.6, -1]])
RATE, SAMPLES, BAND = 1024, 1024, (100, 470)
NOISE = 1e-7
"""m/N: a four-hundredth of the highest peak."""


def receptances(total: int, seed: int, before: int = 0) -> FrfSet:
    """Receptances from a record of 1 s that was brought to so many samples by zeros, ``before`` of them before the impact.

    The vibration exp(p t) from the impact to the end of the record has (1 - exp((p - s) T)) / (s - p) as its transform;
    the noise is that of the samples, in time.
    """
    rng = np.random.default_rng(seed)
    frequencies = np.fft.rfftfreq(total, 1 / RATE)
    keep = (frequencies >= BAND[0]) & (frequencies <= BAND[1])
    s = 2j * np.pi * frequencies[keep][:, None, None, None]
    rest = (SAMPLES - before) / RATE
    poles = poles_from(NATURAL, ZETA)
    residues = np.einsum("or,ir,r->roi", SHAPES, SHAPES[:1], 1 / (2j * poles.imag))
    values = sum(
        np.sum(r * (1 - np.exp((p[:, None, None] - s) * rest)) / (s - p[:, None, None]), axis=1)
        for p, r in ((poles, residues), (poles.conj(), residues.conj()))
    )
    noise = np.fft.rfft(rng.standard_normal((SAMPLES, *values.shape[1:])), total, axis=0)[keep]
    noise *= np.exp(2j * np.pi * frequencies[keep] * before / RATE)[:, None, None] / np.sqrt(SAMPLES)
    values = values + NOISE * noise
    return FrfSet(frequencies[keep], values, DOFS, DOFS[:1], "receptance", "m/N", estimator="H1")


def fitted(frfs: FrfSet) -> ModalModel:
    return modes(frfs, stabilise(frfs))


@pytest.mark.parametrize(("total", "before"), [(2048, 0), (2048, 40), (3072, 0), (1536, 0), (1680, 30), (2640, 0)])
def test_zeros_add_nothing(total: int, before: int) -> None:
    """The same record without zeros gives the same values and intervals, and those hold the truth."""
    squares = []
    for seed in range(4):
        padded = fitted(receptances(total, 9100 + seed, before))
        plain = fitted(receptances(SAMPLES, 9100 + seed, before))
        std = np.sqrt(plain.covariance[:, [0, 1], [0, 1]])
        ratio = np.sqrt(padded.covariance[:, [0, 1], [0, 1]]) / std
        moved = np.stack([padded.natural_frequencies, padded.damping_ratios], 1)
        moved -= np.stack([plain.natural_frequencies, plain.damping_ratios], 1)
        assert np.abs(moved / std).max() < 0.5
        assert ratio.min() > 0.85
        assert ratio.max() < 1.25
        squares.append(((padded.natural_frequencies - NATURAL) / std[:, 0]) ** 2)
        squares.append(((padded.damping_ratios - ZETA) / std[:, 1]) ** 2)
        (finding,) = [one for one in padded.findings if one.code == "dependent-lines"]
        assert abs(finding.value / (total / SAMPLES) - 1) < 0.08
        assert not [one for one in plain.findings if one.code == "dependent-lines"]
    # The mean of 24 squares of standard normal numbers exceeds 2.4 once in 10^4; with these seeds it is 0.7 to 1.3.
    assert np.mean(squares) < 2.4


@pytest.mark.parametrize("whole", [2, 3])
def test_whole_multiples_are_lines_that_are_there(whole: int) -> None:
    dense, plain = receptances(whole * SAMPLES, 9201), receptances(SAMPLES, 9201)
    lines = padding.resolved(dense, padding.density(dense))
    assert np.array_equal(lines.frequencies, plain.frequencies)
    assert np.allclose(lines.values, plain.values, rtol=0, atol=1e-12 * np.abs(plain.values).max())


def test_lines_between_are_those_of_the_record() -> None:
    """Sampled anew at lines 1/U apart, the values are those that the record has there, by its transform of length U."""
    dense = receptances(1680, 9202)
    density = padding.density(dense)
    lines = padding.resolved(dense, density)
    rng = np.random.default_rng(0)
    poles = poles_from(rng.uniform(110, 460, 4), np.full(4, 0.01))
    ends = 2j * np.pi * density.middle / dense.frequency_step

    def low_pass(frequencies: np.ndarray) -> np.ndarray:
        """Transform of vibrations about the middle of the records, which have faded before their ends."""
        s = 2j * np.pi * frequencies[:, None]
        return np.exp(-ends * frequencies) * np.sum(1 / ((s - 1j * poles.imag) ** 2 - 40.0**2), axis=1)

    made = FrfSet(
        dense.frequencies, low_pass(dense.frequencies)[:, None, None], DOFS[:1], DOFS[:1], "receptance", "m/N"
    )
    found = padding.resolved(made, density)
    assert np.array_equal(found.frequencies, lines.frequencies)
    expected = low_pass(found.frequencies)
    assert np.abs(found.values[:, 0, 0] - expected).max() < 1e-3 * np.abs(expected).max()


@pytest.mark.parametrize("seed", range(6))
def test_what_is_not_padded_is_left(seed: int) -> None:
    """Noise on all lines; resonances that beat, fade early, or have no noise."""
    rng = np.random.default_rng(9300 + seed)
    assert padding.density(case_small(seed=9300 + seed).frfs) is None
    count = 401
    s = 2j * np.pi * np.arange(count)[:, None]
    for noise in (0.0, 1e-6, 1e-3, 0.1):
        for decay in (1.0, 5.0, 20.0, 60.0):
            middle = 2 * np.pi * rng.uniform(100, 300)
            poles = -decay + 1j * (middle + 2 * np.pi * rng.uniform(1, 15) * np.array([-1, 1]))
            values = np.sum(1 / (s - poles), axis=1)
            values = values + noise * np.abs(values).max() * (rng.standard_normal((count, 2)) @ [1, 1j])
            # With the phase reversed, a vibration grows until the period ends, and leaves the noise.
            for own in (values, values.conj()) if noise >= 1e-3 else (values,):
                frfs = FrfSet(np.arange(count) + 1.0, own[:, None, None], DOFS[:1], DOFS[:1], "receptance", "m/N")
                assert padding.density(frfs) is None
