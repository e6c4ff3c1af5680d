"""FRFs that were measured one after the other: a resonance that moves between them belongs in the interval."""

from dataclasses import replace

import numpy as np
import pytest

from ema.fit import modes, stabilise
from tests.unit.fit_rig import frfs, model

FREQUENCIES, DAMPING = [120.0, 150.0, 175.0], [0.004, 0.003, 0.005]
BETWEEN = "scatter between the FRFs"


def roving(shift, seed):
    """Twelve FRFs with noise; each sees the resonances moved by a part ``shift`` of their frequency, at random."""
    rng = np.random.default_rng([12, seed])
    moved = 1 + shift * rng.standard_normal((12, 3))
    each = [frfs(model(list(np.multiply(FREQUENCIES, row)), DAMPING), 100, 200, 801) for row in moved]
    values = np.stack([one.values[:, place] for place, one in enumerate(each)], axis=1)
    std = 0.02 * np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
    draw = np.sqrt(0.5) * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
    return replace(each[0], values=values + std * draw)


def fitted(shift, seed):
    measured = roving(shift, seed)
    return modes(measured, stabilise(measured, range(4, 31, 2)), near=FREQUENCIES)


def errors(found):
    """Of the frequencies, over the stated standard deviations."""
    return (found.natural_frequencies - FREQUENCIES) / np.sqrt(found.covariance[:, 0, 0])


def test_intervals_hold_what_changes_from_one_frf_to_the_next():
    every = [fitted(5e-5, seed) for seed in range(12)]
    inside = np.mean([np.abs(errors(found)) < 1.96 for found in every])
    assert inside >= 0.85, "95 % of 36 but for chance"
    assert sum(BETWEEN in found.uncertainty.basis for found in every) >= 10
    # The shape weighs the points; with equal weights it would be the standard deviation of a mean of twelve.
    stated = np.median([np.sqrt(found.covariance[:, 0, 0]) for found in every], axis=0)
    expected = 5e-5 * np.array(FREQUENCIES) / np.sqrt(12)
    assert np.all(stated > expected) and np.all(stated < 4 * expected)


@pytest.mark.parametrize("seed", range(4))
def test_noise_alone_is_no_scatter_between_the_frfs(seed):
    found = fitted(0.0, seed)
    assert BETWEEN not in found.uncertainty.basis
    assert np.all(np.abs(errors(found)) < 4)
