"""Resonances outside the band: what they do to a heavy mode at its edge is in the fit and in its interval."""

import numpy as np
import pytest

from ema import synthesis
from ema.data import FrfSet, ModalModel, poles_from
from ema.dof import Dof
from ema.fit import estimator, modes, stabilise
from ema.fit.prepare import prepare
from ema.fit.selection import select
from tests.bench.cases import Case, case_small
from tests.bench.draws import UNTOLD, drawn

SYSTEM, HEAVY, DRAWS = 12345, 4, 16


@pytest.fixture(scope="module")
def case() -> Case:
    """A mode of 5 % damping at 476 Hz, the band's end at 500 Hz, and a resonance at 525 Hz that is hard to see."""
    return case_small(seed=SYSTEM)


def test_a_heavy_mode_at_the_edge_is_told_with_an_interval_that_holds_it(case: Case):
    error = []
    for draw in range(DRAWS):
        frfs = drawn(case, UNTOLD, np.random.default_rng([5, draw]))
        model = modes(frfs, stabilise(frfs))
        place = int(np.argmin(np.abs(model.natural_frequencies - case.truth.natural_frequencies[HEAVY])))
        assert model.covariance is not None
        std = np.sqrt(np.diagonal(model.covariance[place])[:2])
        error.append(
            (
                (model.natural_frequencies[place] - case.truth.natural_frequencies[HEAVY]) / std[0],
                (model.damping_ratios[place] - case.truth.damping_ratios[HEAVY]) / std[1],
            )
        )
    # Without the resonance outside the damping errs by 1.65 of its standard deviations.
    assert np.sqrt(np.mean(np.square(error), axis=0)).max() < 1.35


def two_modes(seed: int) -> FrfSet:
    """Two light modes in the middle of 100-500 Hz and nothing else, with 1 % noise."""
    rng = np.random.default_rng(seed)
    dofs = tuple(Dof(node, "+Z") for node in range(1, 9))
    poles = poles_from(np.array([220.0, 340.0]), np.array([0.01, 0.008]))
    shapes = rng.normal(size=(8, 2)).astype(complex)
    model = ModalModel(poles, shapes, dofs, shapes[:2] / (2j * poles.imag), dofs[:2])
    clean = synthesis.frfs(model, np.linspace(100, 500, 401), "accelerance", dofs, dofs[:2])
    size = 0.01 * np.abs(clean.values).mean(axis=0)
    noise = (rng.normal(size=clean.values.shape) + 1j * rng.normal(size=clean.values.shape)) / np.sqrt(2)
    return FrfSet(clean.frequencies, clean.values + size * noise, dofs, dofs[:2], "accelerance", clean.unit)


def test_nothing_is_added_where_nothing_is_outside():
    added = 0
    for seed in range(20):
        frfs = two_modes(seed)
        data = prepare(frfs)
        found = select(data, stabilise(frfs))
        inside = found.fit.poles[found.possible]
        np.testing.assert_allclose(np.sort(np.abs(inside)) / 2 / np.pi, [220.0, 340.0], rtol=1e-3)
        added += len(found.fit.poles) - len(inside)
        assert estimator.correlation(found.data, found.fit) < 0.1
    assert added <= 3
