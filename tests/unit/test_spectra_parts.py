"""What parts of a test say of the variance of its averaged FRFs, and of errors that outputs have in common."""

import numpy as np
import pytest

from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.dof import Dof
from ema.estimate import shaker

RATE, SAMPLES, RESPONSES = 256.0, 2**15, 6


def frfs(seed, overlap, common, forces=1):
    """FRFs of responses that are the forces and noise, whose part ``common`` (of its power) is the same in all of them."""
    rng = np.random.default_rng(seed)
    *force, shared = rng.standard_normal((forces + 1, SAMPLES))
    own = rng.standard_normal((RESPONSES, SAMPLES))
    motion = np.sum(force, axis=0) + 0.5 * (np.sqrt(common) * shared + np.sqrt(1 - common) * own)
    channels = [
        Channel(f"force {k}", Dof(k, "+X"), quantity="force", unit="N", role="reference") for k in range(1, forces + 1)
    ]
    channels += [
        Channel(f"acc {k}", Dof(k, "+Z"), quantity="acceleration", unit="m/s^2") for k in range(1, RESPONSES + 1)
    ]
    record = Recording(np.vstack([*force, motion]), RATE, tuple(channels))
    run = Run("random", Condition(Excitation("random")), (record,))
    return shaker(run, method="welch", block=512, overlap=overlap)


@pytest.mark.parametrize(("overlap", "forces"), [(0.0, 1), (0.5, 1), (0.75, 1), (0.75, 2)])
def test_squares_of_deviations_add_up_to_the_variance(overlap, forces):
    """The FRFs are 1 and their noise is white: errors over all lines, responses and draws say what the variance is."""
    errors, stated, by_parts = [], [], []
    for seed in range(12):
        found = frfs(seed, overlap, 0.0, forces)
        inner = slice(4, -4)
        errors.append(np.mean(np.abs(found.values[inner] - 1) ** 2))
        stated.append(np.mean(found.variance[inner]))
        by_parts.append(np.mean(np.sum(np.abs(found.deviations.values[:, inner]) ** 2, axis=0)))
    assert np.mean(stated) == pytest.approx(np.mean(errors), rel=0.1)
    assert np.mean(by_parts) == pytest.approx(np.mean(errors), rel=0.1)


@pytest.mark.parametrize("common", [0.0, 0.5, 1.0])
def test_correlation_of_outputs_is_that_of_their_noise(common):
    """Equal FRFs: the correlation of errors along them is the power that they share."""
    found = np.mean([frfs(seed, 0.75, common).output_correlation for seed in range(4)])
    assert found == pytest.approx(common, abs=0.07)
