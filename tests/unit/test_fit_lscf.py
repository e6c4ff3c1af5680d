"""Poles of all orders from one factorisation: exactness, independence of axis and orientation, reading of either end."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import natural_frequencies
from ema.fit import lscf, noise, stabilise
from ema.fit.prepare import prepare
from tests.unit.fit_rig import frfs, mac, model, transposed


def matrices(measured, degrees):
    data = prepare(measured)
    weights = np.ones(len(data.frequencies))
    return lscf.normal_matrices(data.frequencies, data.values, degrees, weights)


def nearest(found, wanted):
    """Relative distance of each wanted pole to the nearest one found."""
    return np.min(np.abs(np.asarray(found)[None, :] - np.asarray(wanted)[:, None]), axis=1) / np.abs(wanted)


def many(lines=801):
    truth = model([110.0, 131.0, 160.0, 161.0, 205.0], [0.004, 0.01, 0.003, 0.003, 0.05], drive=(0, 7), phase=0.2)
    return truth, frfs(truth, 90, 230, lines)


@pytest.mark.parametrize("clear", [True, False])
def test_poles_and_participation_of_a_system_without_noise_are_exact(clear):
    truth, measured = many()
    found, participation = lscf.poles(matrices(measured, [24]), 24, clear)
    distance = nearest(found, truth.poles)
    assert np.all(distance < 1e-6), distance
    for mode, pole in enumerate(truth.poles):
        row = int(np.argmin(np.abs(found - pole)))
        assert mac(participation[row], truth.participation[:, mode]) > 1 - 1e-6


def test_all_orders_of_one_factorisation_equal_those_of_separate_ones():
    _, measured = many()
    together = matrices(measured, range(2, 21))
    for degree in (2, 3, 7, 20):
        alone = matrices(measured, [degree])
        scale = np.abs(alone.matrices[degree]).max()
        np.testing.assert_allclose(together.matrices[degree], alone.matrices[degree], atol=1e-12 * scale)


def test_the_reduced_matrix_is_what_a_plain_least_squares_gives():
    """The residual energy min_B |H A - B|^2 for a random denominator A equals the quadratic form of the matrix."""
    _, measured = many(201)
    data, degree = prepare(measured), 4
    polynomials = matrices(measured, [degree])
    rng = np.random.default_rng(1)
    a = rng.standard_normal((degree + 1, 2)) + 1j * rng.standard_normal((degree + 1, 2))
    turns = np.exp(1j * polynomials.sampling_time * (2 * np.pi * data.frequencies - polynomials.start))
    powers = turns[:, None] ** np.arange(degree + 1)
    energy = 0.0
    for output in range(len(data.dofs)):
        target = np.einsum("ki,kn,ni->k", data.values[:, output], powers, a)
        energy += np.linalg.norm(target - powers @ np.linalg.lstsq(powers, target, rcond=None)[0]) ** 2
    form = (a.ravel().conj() @ polynomials.matrices[degree] @ a.ravel()).real
    assert form == pytest.approx(energy, rel=1e-8)


def test_an_axis_with_an_uneven_line_gives_the_same_poles():
    truth, measured = many()
    moved = np.array(measured.frequencies)
    rng = np.random.default_rng(0)
    moved[1:-1] += 0.3 * measured.frequency_step * rng.uniform(-1, 1, len(moved) - 2)
    from ema import synthesis

    uneven = synthesis.frfs(truth, moved, "accelerance")
    assert np.all(nearest(lscf.poles(matrices(uneven, [24]), 24)[0], truth.poles) < 1e-6)
    holes = measured.lines(np.flatnonzero(np.arange(801) % 7 != 3))
    assert np.all(nearest(lscf.poles(matrices(holes, [24]), 24)[0], truth.poles) < 1e-6)


def test_the_slow_and_the_fast_transform_agree():
    _, measured = many()
    data = prepare(measured)
    nudged = np.array(data.frequencies)
    nudged[400] += 2e-3 * measured.frequency_step  # just enough to leave the FFT
    fast = lscf.normal_matrices(data.frequencies, data.values, [8], np.ones(801))
    slow = lscf.normal_matrices(nudged, data.values, [8], np.ones(801))
    np.testing.assert_allclose(slow.matrices[8], fast.matrices[8], atol=1e-4 * np.abs(fast.matrices[8]).max())


@pytest.mark.parametrize("start", [5.0, 900.0, 40_000.0])
def test_the_place_of_the_band_does_not_matter(start):
    """A band far from 0 Hz, where an unshifted basis would wrap."""
    width = 100.0
    truth = model([start + 20, start + 47, start + 81], [1.0 / (start + 20), 0.5 / (start + 47), 1.5 / (start + 81)])
    measured = frfs(truth, start + 0.5, start + width, 801, quantity="receptance")
    found, _ = lscf.poles(matrices(measured, [16]), 16)
    error = np.min(np.abs(found[None, :] - truth.poles[:, None]), axis=1) / np.abs(truth.poles.real)
    assert np.all(error < 1e-4), error


def test_modes_beside_the_band_do_not_wrap_to_its_other_end():
    truth = model([97.0, 120.0, 160.0, 205.0], [0.005, 0.005, 0.005, 0.005])
    found, _ = lscf.poles(matrices(frfs(truth, 100, 200, 801), [16]), 16)
    distance = nearest(found, truth.poles)
    assert np.all(distance[1:3] < 1e-6)
    assert np.all(distance < 1e-3), "3 % outside the band they keep their own place"
    sharp = found[-found.real < 0.007 * np.abs(found)]
    assert all(np.min(np.abs(natural_frequencies(sharp) - f)) < 0.1 for f in truth.natural_frequencies)
    assert len(sharp) == 4


def test_a_roving_hammer_is_the_transpose_of_roving_sensors():
    """To the grid of 1e-12 that data are read on: changes of that size move the poles by more than the transposition."""
    truth = model([120.0, 150.0, 170.0], [0.004, 0.006, 0.005], dofs=80, drive=(0, 40))
    measured = frfs(truth, 100, 200, 401, noise=0.01)
    hammer = transposed(measured)
    assert hammer.values.shape == (401, 2, 80)
    a, b = stabilise(measured, range(4, 25, 2)), stabilise(hammer, range(4, 25, 2))
    changes = 1 + 1e-12 * np.random.default_rng(1).standard_normal(measured.values.shape)
    changed = stabilise(replace(measured, values=measured.values * changes), range(4, 25, 2))
    moved = np.abs(changed.poles / a.poles - 1).max()
    assert moved < 3e-11
    np.testing.assert_allclose(b.poles, a.poles, rtol=moved)
    assert a.references == b.references == truth.inputs
    np.testing.assert_array_equal(a.letter, b.letter)


def test_repeated_roots_need_two_references():
    truth = model([120.0, 150.0, 150.0, 180.0], [0.004, 0.006, 0.006, 0.005], drive=(0, 7))
    measured = frfs(truth, 100, 200, 801)
    table = stabilise(measured, [8, 12, 16])
    top = table.poles[table.order == 16]
    at = np.flatnonzero(np.abs(top - truth.poles[1]) < 1e-3 * abs(truth.poles[1].real) * 100)
    assert len(at) == 2
    vectors = table.participation[table.order == 16][at]
    assert np.linalg.svd(vectors)[1][1] > 0.05, "the two participation vectors are independent"
    single = stabilise(measured.pick(inputs=[0]), [16])
    assert np.count_nonzero(np.abs(single.poles - truth.poles[1]) < 1e-3 * abs(truth.poles[1].real) * 100) == 1


def test_noise_lowers_damping_at_one_end_and_less_so_at_the_other():
    truth = model([120.0, 150.0, 170.0], [0.004, 0.006, 0.005], dofs=20)
    bias = {True: [], False: []}
    for seed in range(10):
        polynomials = matrices(frfs(truth, 100, 200, 801, noise=0.15, seed=seed), [25])
        for clear in bias:
            found, _ = lscf.poles(polynomials, 25, clear)
            for pole in truth.poles:
                near = found[np.argmin(np.abs(found - pole))]
                bias[clear].append(near.real / pole.real - 1)
    assert np.mean(bias[True]) < -0.015
    assert abs(np.mean(bias[False])) < 0.5 * abs(np.mean(bias[True]))


def test_principal_outputs_keep_what_stands_out_of_the_noise():
    truth = model([120.0, 150.0, 170.0], [0.004, 0.006, 0.005], dofs=60, drive=(0, 9))
    data = prepare(frfs(truth, 100, 200, 401, noise=0.01))
    weights = np.ones(401)
    kept = lscf.principal_outputs(data.values, weights, data.noise)
    assert 4 <= kept.shape[1] < 12
    whitened = data.values / (data.noise.outputs[:, None] * data.noise.references)
    assert np.linalg.norm(kept) > 0.99 * np.linalg.norm(whitened)
    few = lscf.principal_outputs(
        data.values[:, :6], weights, noise.NoiseLevel(weights, data.noise.outputs[:6], data.noise.references)
    )
    np.testing.assert_allclose(few, whitened[:, :6])


def test_weights_of_lines_take_a_disturbed_stretch_out():
    truth, measured = many()
    values = np.array(measured.values)
    values[200:260] += np.abs(values).max()
    spoiled = replace(measured, values=values)
    data = prepare(spoiled)
    weights = np.ones(801)
    weights[200:260] = 0
    found, _ = lscf.poles(lscf.normal_matrices(data.frequencies, data.values, [24], weights), 24)
    assert np.all(nearest(found, truth.poles) < 1e-6)
