"""Plates with many double roots: every mode is found, and what a fit leaves of a peak is named."""

from dataclasses import replace

import numpy as np
import pytest

from ema import synthesis
from ema.fit import estimator, modal, reconstruction_error, unexplained
from ema.fit.acceptance import surplus
from ema.fit.policy import POLICY
from ema.fit.stabilisation import stabilise
from ema.fit.uncertainty import errors_of
from tests.bench import disturbances_nonlinear, repeated_roots


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
    assert "unexplained-peak" not in {finding.code for finding in model.findings}


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


def test_a_fit_without_a_mode_of_a_double_root_leaves_its_peak(small):
    """One mode of each double root left out, and one that is alone: their roots are named, and no other place."""
    made, found = small
    optimum, truth = found.optimum, made.case.truth
    assert not unexplained.unexplained(replace(optimum, misfit=True), found.data.derivative)
    paired = {index for pair in made.pairs for index in pair}
    alone = next(index for index in range(len(truth.poles)) if index not in paired)
    for index in (*(pair[0] for pair in made.pairs), alone):
        gone = int(np.argmin(np.abs(optimum.fit.poles - truth.poles[index])))
        keep = np.arange(len(optimum.fit.poles)) != gone
        left = estimator.refine(optimum.data, estimator.drop(optimum.data, optimum.fit, keep))
        peaks = unexplained.unexplained(replace(optimum, fit=left, misfit=True), found.data.derivative)
        reach = max(2 * truth.damping_ratios[index] * truth.natural_frequencies[index], made.case.frfs.frequency_step)
        assert peaks and all(abs(peak.frequency - truth.natural_frequencies[index]) < reach for peak in peaks)
        (finding,) = unexplained.findings(peaks, "plate")
        assert finding.severity == "error" and finding.value == pytest.approx(max(peak.share for peak in peaks))


@pytest.mark.parametrize("strength", [2.0, 20.0])
@pytest.mark.parametrize("kind", ["friction", "curved"])
def test_peaks_that_a_linear_mode_describes_badly_are_represented(kind, strength):
    """A slider that slips, a mode that softens: the structure has the modes that are found, so none is missing."""
    if kind == "friction":
        drawn = disturbances_nonlinear.friction(np.random.default_rng([5203, 1]), strength)
    else:
        drawn = disturbances_nonlinear.curved(np.random.default_rng([5203, 1]), strength / 10)
    found = fitted(drawn.case)
    assert found.optimum.misfit and "unexplained-peak" not in {finding.code for finding in found.model().findings}


def test_what_was_left_out_beside_a_mode_of_a_misfit_is_named():
    """A plate whose single modes move by their bandwidths between two halves of the test, which leaves a misfit: of the
    double root at 510 Hz one mode is found, and the second one that was left out is named beside it."""
    case = repeated_roots.symmetric(8303, 9).case
    truth, poles = case.truth, case.truth.poles.copy()
    single = np.array([np.sum(np.abs(poles - pole) < 1e-6 * abs(pole)) == 1 for pole in poles])
    poles[single] *= 1 + 2 * truth.damping_ratios[single]
    moved = synthesis.frfs(replace(truth, poles=poles), np.asarray(case.frfs.frequencies), "accelerance")
    values = case.frfs.values + 0.5 * (moved.values - case.clean)
    found = fitted(replace(case, frfs=replace(case.frfs, values=values, variance=None, averages=None, coherence=None)))
    model = found.model()
    at_root = np.abs(model.natural_frequencies - 510) < 1
    assert found.optimum.misfit and np.count_nonzero(at_root) == 1
    named = [finding.value for finding in model.findings if finding.code == "dropped-candidate"]
    assert np.any(np.abs(np.array(named) - 510) < 1)
