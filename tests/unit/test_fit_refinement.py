"""Refinement with a noise level for every line of every FRF: what stays, what is dropped, what the intervals rest on."""

from dataclasses import replace

import numpy as np
import pytest

from ema.fit import likelihood, modes, stabilise
from ema.fit.prepare import prepare
from ema.fit.refinement import refined
from ema.fit.select import keep_picked, select
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
    assert chosen.is_mode.sum() == 3
    beside = 2 * np.pi * 150.1 * (-0.0006 + 1j)
    vector = chosen.fit.participation[:, int(np.argmin(np.abs(chosen.fit.poles - beside)))]
    larger = likelihood.with_mode(chosen.data, chosen.fit, beside, vector)
    spoiled = replace(
        chosen, fit=larger, is_mode=np.append(chosen.is_mode, True), confidence=np.append(chosen.confidence, 1.0)
    )
    optimum = refined(measured, data, spoiled)
    assert len(spoiled.fit.poles) - 1 not in optimum.kept, "the added pole"
    assert set(np.flatnonzero(chosen.is_mode)) <= set(optimum.kept.tolist()), "the three modes"
    (gone,) = optimum.dropped
    assert abs(gone.pole - beside) < 0.1 * abs(beside.real) and "noise of its lines" in gone.reason


def test_a_pole_that_a_user_names_stays_whatever_it_explains():
    measured = frfs(three(), 100, 200, 801, noise=0.01)
    table = poles_over(measured)
    wanted = [int(np.argmin(np.abs(table.natural_frequencies - f))) for f in (120.0, 137.0)]
    optimum = refined(measured, prepare(measured), keep_picked(prepare(measured), table, 0.0, wanted))
    assert {0, 1} <= set(optimum.kept.tolist()) and optimum.dropped == ()


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
    rows = [int(np.argmin(np.abs(table.natural_frequencies - f))) for f in (120.0, 150.0)]
    optimum = refined(measured, data, keep_picked(data, table, 0.0, rows))
    modal = optimum.state.poles[np.isin(optimum.kept, [0, 1])] * optimum.unit
    np.testing.assert_allclose(np.sort_complex(modal), np.sort_complex(truth.poles[1:3]), rtol=1e-6)
