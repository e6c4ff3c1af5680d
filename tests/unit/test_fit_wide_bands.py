"""Bands of three decades and poles that describe each other: what rounding leaves of sums over lines."""

import numpy as np
import pytest

import ema
from ema.fit import estimator, model
from ema.fit.estimator import Observations
from ema.fit.full_set import _bare, _Sums
from tests.unit.test_estimate_hammer import DOFS, hammer, hammer_rig, run_of


def observations(low, high, lines, derivative, seed):
    """Noise and a few resonances on lines from ``low`` to ``high`` Hz, two outputs and two references."""
    draw = np.random.default_rng(seed)
    s = 2j * np.pi * np.linspace(low, high, lines)
    poles = resonances(low, high, 4, seed)
    shapes = draw.normal(size=(2, 2, len(poles))) + 1j * draw.normal(size=(2, 2, len(poles)))
    signals = np.sum(shapes[..., None] / (s - poles[:, None]), axis=2)
    weights = np.abs(s) ** (2 * derivative) * draw.uniform(0.5, 2, (2, 2, 1))
    return Observations(s, signals[:, None], weights), poles


def resonances(low, high, count, seed):
    draw = np.random.default_rng(seed + 1)
    frequencies = 2 * np.pi * np.geomspace(20 * low, 0.5 * high, count)
    return frequencies * (-draw.uniform(0.005, 0.02, count) + 1j)


def pairs(s, pole):
    """What the real and the imaginary part of a residue at a pole multiply."""
    direct, mirrored = 1 / (s - pole), 1 / (s - np.conj(pole))
    return direct + mirrored, 1j * (direct - mirrored)


def stacked(values, weights):
    """Complex values on lines as weighted real equations."""
    return (values * np.sqrt(weights)).view(float)


@pytest.mark.parametrize("derivative", [0, 1, 2])
@pytest.mark.parametrize("low", [0.05, 1.0, 20.0])
def test_residual_terms_are_fitted_as_least_squares_fits_them(low, derivative):
    """The cost at given poles against orthogonal least squares on all lines, output by output."""
    data, poles = observations(low, 2500.0, 2600, derivative, seed=3)
    terms = estimator.residual_terms(data, estimator.fixed_poles(data.s.imag / (2 * np.pi)))
    participation = np.array([[1.0, 1.0, 0.5, -0.3], [0.4, -0.7, 1.0, 1.0]]) + 0j
    fit = estimator.evaluate(data, poles[::-1], participation, terms)
    functions = [part for pole in terms.poles for part in pairs(data.s, pole)]
    functions += [1 / data.s**2, np.ones(len(data.s), complex)]
    cost = 0.0
    for output in range(2):
        columns = []
        for pole, entries in zip(poles[::-1], participation.T, strict=True):
            real, imaginary = pairs(data.s, pole)
            for one, other in ((real, imaginary), (imaginary, -real)):
                own = [entry.real * one + entry.imag * other for entry in entries]
                columns.append(np.concatenate([stacked(v, w) for v, w in zip(own, data.weights[output], strict=True)]))
        for place in range(2):
            for function in functions:
                own = [function if place == other else 0 * function for other in range(2)]
                columns.append(np.concatenate([stacked(v, w) for v, w in zip(own, data.weights[output], strict=True)]))
        matrix = np.array(columns).T
        matrix /= np.linalg.norm(matrix, axis=0)
        right = np.concatenate(
            [stacked(v, w) for v, w in zip(data.signals[output, 0], data.weights[output], strict=True)]
        )
        left, strength, _ = np.linalg.svd(matrix, full_matrices=False)
        # What the estimator leaves out is a thousandth of a function (`RESIDUAL_RANK`).
        kept = left[:, strength > 1e-7 * strength[0]]
        cost += float(np.sum((right - kept @ (kept.T @ right)) ** 2))
    assert fit.cost == pytest.approx(cost, rel=2e-3)


def test_columns_of_residual_terms_are_orthonormal_in_the_products_of_every_band():
    """Against products on the lines themselves, for the mean weights that they were made with."""
    for low in (0.02, 1.0, 30.0):
        data, poles = observations(low, 3000.0, 3000, 2, seed=5)
        terms = estimator.residual_terms(data, estimator.fixed_poles(data.s.imag / (2 * np.pi)))
        found = model.functions(data.s, poles, terms.poles)
        mean = data.weights.mean(axis=(0, 1))
        np.testing.assert_allclose(terms.products(found, mean), np.eye(terms.mixing.shape[1]), atol=1e-9)


def test_sums_of_slow_poles_keep_their_digits():
    """Against twice the precision, for poles far below the lines, beside them and far above."""
    s = 2j * np.pi * np.linspace(1000.0, 3000.0, 200)
    poles = 2 * np.pi * np.array([0.1 * (-0.05 + 1j), 30 * (-0.2 + 1j), 1500 * (-0.001 + 1j), 1e6 * (-0.3 + 1j)])
    found = model.functions(s, poles, poles[:0])
    long = np.clongdouble
    fine, lines = poles.astype(long)[:, None], s.astype(long)
    sums = 2 * fine / (lines**2 - fine**2)
    squares = 2 * (lines**2 + fine**2) / (lines**2 - fine**2) ** 2
    wanted = np.concatenate([sums, squares])
    count = len(wanted)
    got = found.sums[:count] + 1j * found.sums[count + 3 :]
    assert np.max(np.abs(got.real / wanted.real - 1)) < 1e-12
    assert np.max(np.abs(got.imag / wanted.imag - 1)) < 1e-12


@pytest.fixture(scope="module")
def close():
    """A resonance, and poles above the band that describe each other, as a misfit at the upper end asks for."""
    data, _ = observations(1.0, 2560.0, 1200, 2, seed=7)
    draw = np.random.default_rng(8)
    above = 2 * np.pi * np.linspace(2600, 3100, 8) * (-0.08 + 1j)
    poles = np.append(2 * np.pi * 400 * (-0.01 + 1j), above)
    terms = estimator.residual_terms(data, estimator.fixed_poles(data.s.imag / (2 * np.pi)))
    participation = np.ones((2, len(poles)), complex)
    participation[1] = draw.uniform(-0.9, 0.9, len(poles))
    fit = estimator.evaluate(data, poles, participation, terms)
    shapes = 30 * (draw.normal(size=fit.shapes.shape) + 1j * draw.normal(size=fit.shapes.shape))
    return data, fit, shapes


def test_intervals_hold_where_poles_describe_each_other(close):
    """Standard deviations against a QR factorisation of all derivatives on all lines, written down here."""
    data, fit, shapes = close
    assert fit.share.min() < 1e-9
    start = shapes, fit.rest
    data = data_of(data, fit, shapes)
    fit = estimator.with_orthogonal_matrices(
        data, estimator.evaluate(data, fit.poles, fit.participation, fit.terms, start)
    )
    assert fit.rounding == estimator.ORTHOGONAL
    modes, references = len(fit.poles), len(fit.participation)
    fixed = [part for pole in fit.terms.poles for part in pairs(data.s, pole)]
    functions = np.array(
        [fixed[0], fixed[2], data.s**-2, np.ones(len(data.s)), fixed[1], fixed[3], 0 * data.s, 0 * data.s]
    )
    rest = fit.terms.mixing.T @ functions
    rows = []
    for output in range(2):
        weights = data.weights[output]

        def column(by_reference, weights=weights):
            return np.concatenate([stacked(v, w) for v, w in zip(by_reference, weights, strict=True)])

        def times(factor, both):
            return factor.real * both[0] + factor.imag * both[1]

        first = [pairs(data.s, pole) for pole in fit.poles]
        second = [
            (a**2 + b**2, 1j * (a**2 - b**2))
            for a, b in ((1 / (data.s - p), 1 / (data.s - p.conj())) for p in fit.poles)
        ]
        linear, shared = [], []
        for unit in (1, 1j):
            linear += [column([times(unit * e, first[m]) for e in fit.participation[:, m]]) for m in range(modes)]
            psi = fit.shapes[output, 0]
            shared += [
                column([times(unit * psi[m] * e, second[m]) for e in fit.participation[:, m]]) for m in range(modes)
            ]
            for entry in fit.free:
                place, m = divmod(entry, modes)
                own = [times(unit * psi[m], first[m]) if i == place else 0 * data.s for i in range(references)]
                shared.append(column(own))
        for place in range(references):
            linear += [column([one if i == place else 0 * one for i in range(references)]) for one in rest]
        linear = np.array(linear).T
        shared = np.array(shared).T * fit.scale
        basis, _ = np.linalg.qr(linear / np.linalg.norm(linear, axis=0))
        for _ in range(2):
            shared = shared - basis @ (basis.T @ shared)
        rows.append(shared)
    triangle = np.linalg.qr(np.concatenate([*rows, np.sqrt(estimator.PRIOR) * np.eye(len(fit.gradient))]), mode="r")
    wanted = np.linalg.norm(np.linalg.inv(triangle), axis=1) * fit.scale
    np.testing.assert_allclose(np.linalg.norm(estimator.root(fit), axis=1), wanted, rtol=2e-3)


def test_outputs_of_a_set_larger_than_memory_hold_as_much_where_poles_describe_each_other(close):
    """Collected output by output, as from a file, against the fit of all in memory."""
    data, fit, shapes = close
    data = data_of(data, fit, shapes)
    fit = estimator.evaluate(data, fit.poles, fit.participation, fit.terms, (shapes, fit.rest))
    exact = estimator.with_orthogonal_matrices(data, fit)
    sums = _Sums(exact, exact.rest.shape[-1], 2, np.zeros(0, int))
    for output in range(2):
        own = slice(output, output + 1)
        begin = _bare(exact, exact.shapes[own], exact.rest[own])
        sums.take(np.array([output]), Observations(data.s, data.signals[own], data.weights[own]), begin)
    stds, wanted = (np.linalg.norm(estimator.root(one), axis=1) for one in (sums.all_terms, exact))
    np.testing.assert_allclose(stds, wanted, rtol=1e-4)
    # How far normal equations are off here is rounding, which differs between processors; that they are not used does not.
    assert fit.rounding != estimator.ORTHOGONAL == exact.rounding


def data_of(data, fit, shapes):
    """The observations that a fit with these shapes describes but for noise."""
    draw = np.random.default_rng(9)
    signals = estimator.fitted(data, fit.__class__(**{**vars(fit), "shapes": shapes}))
    noise = draw.normal(size=signals.shape) + 1j * draw.normal(size=signals.shape)
    return Observations(data.s, signals + noise / np.sqrt(data.weights[:, None]), data.weights)


@pytest.mark.parametrize(
    ("points", "noise", "low"), [(2, 1.0, 0.0), (2, 0.01, 1.8), (4, 0.01, 0.9), (4, 0.01, 0.0), (3, 0.1, 3.7)]
)
def test_hammer_tests_are_fitted_from_the_first_line_to_the_last(points, noise, low):
    """Near the Nyquist frequency the records of the rig are no modal model: a misfit that must not reach the modes."""
    frfs = hammer(run_of(list(hammer_rig(points=DOFS[:points], noise=noise).takes())))
    band = frfs.band(low, 2560.0)
    found = ema.fit.modes(band, ema.fit.stabilise(band))
    truth = np.array([100.0, 160.0, 431.0, 900.0]), np.array([0.02, 0.015, 0.01, 0.008])
    np.testing.assert_allclose(found.natural_frequencies, truth[0], rtol=3e-4)
    np.testing.assert_allclose(found.damping_ratios, truth[1], rtol=5e-3)
    # A line is 0.95 Hz: what tells no more than that of a resonance with a coherence of 1 says nothing.
    assert np.all(np.sqrt(found.covariance[:, 0, 0]) < 1e-3 * truth[0])
    assert np.all(np.sqrt(found.covariance[:, 1, 1]) < 0.02 * truth[1])
