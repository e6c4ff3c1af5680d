"""Resonances too weak to be modes stay in the fit, in the intervals of their neighbours, and are no modes."""

from dataclasses import replace

import numpy as np

from ema.fit import stabilise
from ema.fit.modal import estimated
from tests.unit.fit_rig import frfs, model

SEEDS = range(12)


def with_a_weak_neighbour(strength):
    """Two wide modes at 100 and 103.5 Hz, the second with a shape of this size, and a third one."""
    truth = model([100.0, 103.5, 140.0], [0.04, 0.03, 0.01], dofs=4)
    return replace(truth, shapes=truth.shapes * np.array([1.0, strength, 1.0]))


def fits(strength):
    truth = with_a_weak_neighbour(strength)
    for seed in SEEDS:
        measured = frfs(truth, 60, 180, 801, noise=0.02, seed=seed)
        yield truth, estimated(measured, stabilise(measured))


def test_a_weak_neighbour_stays_in_the_fit_widens_the_interval_beside_it_and_is_no_mode():
    wide = {True: [], False: []}
    reasons = []
    for truth, found in fits(0.012):
        accepted = found.model()
        assert len(accepted.poles) == 2
        here = int(np.argmin(np.abs(accepted.natural_frequencies - truth.natural_frequencies[0])))
        reasons += [reason for reason in found.verdict.reasons if reason]
        wide[len(found.optimum.fit.poles) > 2].append(accepted.covariance[here, 0, 0])
    assert len(wide[True]) >= 3 and len(wide[False]) >= 3
    assert any("times what noise may" in reason for reason in reasons)
    assert np.median(wide[True]) > 1.2 * np.median(wide[False])


def test_noise_alone_is_hardly_ever_taken_for_a_weak_resonance():
    poles = [len(found.optimum.fit.poles) for _, found in fits(0.0)]
    # One in a hundred has one by chance: four of twelve once in 100,000.
    assert sum(count > 2 for count in poles) < 4
