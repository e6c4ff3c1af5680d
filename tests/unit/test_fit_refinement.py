"""Refinement with a noise level for every line of every FRF: what stays, what is dropped, what the intervals rest on."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from ema.errors import InputError
from ema.fit import estimator, modes, stabilise
from ema.fit.policy import SelectionPolicy
from ema.fit.prepare import prepare
from ema.fit.refinement import refined
from ema.fit.selection import select
from tests.unit.fit_rig import frfs, model


def three(**more):
    return model([120.0, 150.0, 175.0], [0.004, 0.001, 0.005], drive=(0, 7), **more)


def with_noise_of_the_excitation(measured, share, seed=0):
    """Noise in proportion to the FRF itself: largest on the peaks."""
    rng = np.random.default_rng([9, seed])
    draw = np.sqrt(0.5) * (rng.standard_normal(measured.values.shape) + 1j * rng.standard_normal(measured.values.shape))
    return replace(measured, values=measured.values * (1 + share * draw))


def poles_over(measured):
    return stabilise(measured, range(4, 41, 2))


@pytest.mark.parametrize("seed", range(3))
def test_a_pole_in_the_noise_of_a_peak_is_dropped_and_told(seed):
    measured = with_noise_of_the_excitation(frfs(three(seed=seed), 100, 200, 801), 0.02, seed)
    data = prepare(measured)
    chosen = select(data, poles_over(measured))
    assert chosen.possible.sum() == 3
    beside = 2 * np.pi * 150.1 * (-0.0006 + 1j)
    vector = chosen.fit.participation[:, int(np.argmin(np.abs(chosen.fit.poles - beside)))]
    larger = estimator.with_modes(chosen.data, chosen.fit, np.array([beside]), vector[None])
    spoiled = replace(
        chosen,
        fit=larger,
        possible=np.append(chosen.possible, True),
        alone=np.append(chosen.alone, 1.0),
    )
    optimum = refined(measured, data, spoiled)
    assert len(spoiled.fit.poles) - 1 not in optimum.kept, "the added pole"
    assert set(np.flatnonzero(chosen.possible)) <= set(optimum.kept.tolist()), "the three modes"
    (gone,) = optimum.dropped
    assert abs(gone.pole - beside) < 0.1 * abs(beside.real) and "noise of its lines" in gone.reason


def test_a_name_chooses_what_is_reported_and_changes_no_value():
    measured = frfs(three(), 100, 200, 801, noise=0.01)
    table = poles_over(measured)
    every, named = modes(measured, table), modes(measured, table, near=[120.0, 175.0])
    rows = [0, 2]
    np.testing.assert_array_equal(named.poles, every.poles[rows])
    np.testing.assert_array_equal(named.covariance, every.covariance[rows])
    np.testing.assert_array_equal(named.shapes, every.shapes[:, rows])
    with pytest.raises(InputError, match=r"137 Hz.*the nearest are .*120.*150"):
        modes(measured, table, near=[137.0])


def drifting(share):
    """A resonance that moved during the test, with a variance of ``share`` of the energy of each FRF."""
    places = 140.2 + 0.25 * np.linspace(-1, 1, 21)
    each = [frfs(model([f, 170.0], [0.002, 0.004], drive=(0, 7)), 100, 200, 801) for f in places]
    values = np.mean([one.values for one in each], axis=0)
    variance = share * np.mean(np.abs(values) ** 2, axis=0) * np.ones(values.shape)
    return replace(each[0], values=values, variance=variance)


def test_a_misfit_beyond_the_known_variance_makes_the_weights():
    """Errors of the model, not noise, limit the fit: weights of the smallest variances would follow them blindly."""
    measured = drifting(1e-6)
    found = modes(measured, stabilise(measured, [4, 6]), near=[170.0])
    assert "beyond the variance of the FRFs" in found.uncertainty.basis
    assert found.natural_frequencies[0] == pytest.approx(170.0, rel=1e-6)
    assert found.damping_ratios[0] == pytest.approx(0.004, rel=1e-4)


def test_noise_as_large_as_its_variance_makes_no_misfit():
    measured = frfs(three(), 100, 200, 801, noise=0.01)
    variance = 1e-4 * np.mean(np.abs(measured.values) ** 2, axis=0) * np.ones(measured.values.shape)
    found = modes(replace(measured, variance=variance), poles_over(measured))
    assert found.uncertainty.basis == "variance of the FRFs, scaled to the residuals"


def test_a_single_average_has_no_say_and_is_told():
    measured = frfs(three(), 100, 200, 801, noise=0.01)
    ones = np.ones(measured.values.shape)
    single = replace(measured, coherence=ones, averages=np.ones(ones.shape[1:]))
    found, plain = (modes(one, poles_over(one)) for one in (single, measured))
    assert found.uncertainty.basis.startswith("scatter of the residuals over the lines; with a single average")
    np.testing.assert_allclose(found.covariance, plain.covariance, rtol=1e-9)


def test_the_refinement_is_never_worse_than_its_start():
    """Data without noise are fitted beyond what normal equations resolve: no step may spoil that."""
    truth = model([20.0, 120.0, 150.0, 600.0], [0.01, 0.004, 0.006, 0.01], drive=(0, 7))
    measured = frfs(truth, 100, 200, 801)
    data = prepare(measured)
    table = stabilise(measured, range(4, 41, 2))
    fit = refined(measured, data, select(data, table)).fit
    inside = (np.abs(fit.poles) > 2 * np.pi * 100) & (np.abs(fit.poles) < 2 * np.pi * 200)
    np.testing.assert_allclose(np.sort_complex(fit.poles[inside]), np.sort_complex(truth.poles[1:3]), rtol=1e-6)


def test_every_threshold_of_the_selection_is_in_the_provenance():
    measured = frfs(three(), 100, 200, 801, noise=0.01)
    stated = dict(modes(measured, poles_over(measured)).provenance.options)
    for each in dataclasses.fields(SelectionPolicy):
        assert stated[f"selection: {each.name.replace('_', ' ')}"] == str(each.default)
