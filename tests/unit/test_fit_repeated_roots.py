"""Plates with many double roots: every mode is found."""

from dataclasses import replace

import numpy as np
import pytest

from ema.fit import estimator, modal, reconstruction_error
from ema.fit.acceptance import surplus
from ema.fit.policy import POLICY
from ema.fit.stabilisation import stabilise
from ema.fit.uncertainty import errors_of
from tests.bench import repeated_roots


def fitted(case):
    return modal.estimated(case.frfs, stabilise(case.frfs))


@pytest.fixture(scope="module")
def small():
    """A plate with 10 modes, some of its roots double, seen by two references."""
    made = repeated_roots.symmetric(8101, 8)
    return made, fitted(made.case)


@pytest.mark.parametrize(("seed", "number"), [(8101, 0), (8102, 0), (8102, 1), (8101, 16)])
def test_two_references_show_both_modes_of_every_double_root(seed, number):
    """Plates in closed form: as many modes at every root as it has, none beside, and noise alone is left."""
    case = repeated_roots.symmetric(seed, number).case
    model = fitted(case).model()
    assert len(model.poles) == len(case.truth.poles)
    width = 2 * case.truth.damping_ratios * case.truth.natural_frequencies
    assert np.all(np.abs(np.sort(model.natural_frequencies) - np.sort(case.truth.natural_frequencies)) < 0.1 * width)
    noise = np.sqrt(np.sum(case.noise_std**2, axis=0) / np.sum(np.abs(case.clean) ** 2, axis=0))
    assert np.all(reconstruction_error(case.frfs, model)[1] < 1.2 * noise)


def test_poles_of_a_double_root_that_coincide_are_two(small):
    """At equal poles nothing tells the participation of each; the rank of their joint residue, 2 in truth, is told."""
    made, found = small
    optimum = found.optimum
    poles = np.array(optimum.fit.poles)
    for pair in made.pairs:
        root = made.case.truth.poles[pair[0]]
        both = np.argsort(np.abs(poles - root))[:2]
        poles[both] = poles[both].mean()
    fit = optimum.fit
    equal = estimator.evaluate(optimum.data, poles, fit.participation, fit.terms, (fit.shapes, fit.rest))
    optimum = replace(optimum, fit=equal, at_optimum=equal)
    assert not len(surplus(optimum, errors_of(optimum), np.ones(len(poles), bool), POLICY))
