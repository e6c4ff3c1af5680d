"""From poles to modes: exact recovery, selection, out-of-band modes, intervals of the right size, close and heavy modes."""

from dataclasses import replace

import numpy as np
import pytest

from ema import synthesis
from ema.data import damping_ratios
from ema.errors import CancelledError, InputError
from ema.fit import modes, reconstruction_error, stabilise
from tests.unit.fit_rig import frfs, mac, model, transposed


def fitted(measured, orders=range(4, 41, 2), **wishes):
    return modes(measured, stabilise(measured, orders), **wishes)


def codes(found):
    return [finding.code for finding in found.findings]


def three(drive=(0, 7), **more):
    return model([120.0, 150.0, 175.0], [0.004, 0.006, 0.005], drive=drive, **more)


@pytest.mark.parametrize("phase", [0.0, 0.3])
def test_a_system_without_noise_is_recovered_exactly(phase):
    truth = three(phase=phase)
    found = fitted(frfs(truth, 100, 200, 801))
    np.testing.assert_allclose(found.poles, truth.poles, rtol=1e-6)
    for mode in range(3):
        residue, wanted = found.residues()[mode], truth.residues()[mode]
        assert np.linalg.norm(residue - wanted) < 1e-4 * np.linalg.norm(wanted)
        assert mac(found.participation[:, mode], truth.participation[:, mode]) > 1 - 1e-9
        assert mac(found.shapes[:, mode], truth.shapes[:, mode]) > 1 - 1e-9
    assert found.dofs == truth.dofs and found.inputs == truth.inputs


def test_noise_of_one_percent_of_the_rms():
    truth = three()
    found = fitted(frfs(truth, 100, 200, 801, noise=0.01))
    assert len(found.poles) == 3
    np.testing.assert_allclose(found.natural_frequencies, truth.natural_frequencies, rtol=1e-5)
    np.testing.assert_allclose(found.damping_ratios, truth.damping_ratios, rtol=0.005)
    sign = np.sign(np.einsum("dr,dr->r", found.shapes, truth.shapes).real)
    np.testing.assert_allclose(found.shapes * sign, truth.shapes, atol=0.01)
    assert np.all(found.confidence > 0.8) and np.all(found.confidence <= 1)


def test_a_roving_hammer_is_the_transpose_of_roving_sensors():
    truth = model([120.0, 150.0, 175.0], [0.004, 0.006, 0.005], dofs=80, drive=(0, 40))
    measured = frfs(truth, 100, 200, 401, noise=0.01)
    a, b = fitted(measured), fitted(transposed(measured))
    np.testing.assert_allclose(b.poles, a.poles, rtol=1e-10)
    np.testing.assert_allclose(b.shapes, a.shapes, rtol=1e-6, atol=1e-9)
    assert b.dofs == truth.dofs and b.inputs == truth.inputs


@pytest.mark.parametrize("quantity", ["receptance", "mobility"])
def test_the_quantity_changes_nothing_but_the_weight_of_the_noise(quantity):
    truth = three()
    measured = frfs(truth, 100, 200, 801, noise=0.01)
    a, b = fitted(measured), fitted(synthesis.convert(measured, quantity))
    std = np.sqrt(a.covariance[:, 0, 0])
    assert np.all(np.abs(b.natural_frequencies - a.natural_frequencies) < 3 * std)
    assert np.all(np.abs(b.damping_ratios - a.damping_ratios) < 3 * np.sqrt(a.covariance[:, 1, 1]))
    np.testing.assert_allclose(b.shapes, a.shapes, atol=0.02)


def test_an_uneven_axis_gives_the_modes_of_an_even_one():
    truth = three()
    f = np.linspace(100, 200, 801)
    f[1:-1] += 0.03 * np.random.default_rng(0).uniform(-1, 1, 799)
    found = fitted(synthesis.frfs(truth, f, "accelerance"))
    np.testing.assert_allclose(found.poles, truth.poles, rtol=1e-6)


def test_added_decay_is_taken_off_and_put_back():
    truth, window = three(), 2.5
    damped = replace(truth, poles=truth.poles - window)
    measured = replace(frfs(damped, 100, 200, 801, noise=0.002), added_decay=window)
    found = fitted(measured)
    np.testing.assert_allclose(found.poles, truth.poles, rtol=1e-5)
    np.testing.assert_allclose(found.damping_ratios, truth.damping_ratios, rtol=0.01)
    rebuilt, error = reconstruction_error(measured, found)
    assert rebuilt.added_decay == window
    assert np.all(error < 0.003)
    plain = fitted(replace(measured, added_decay=0.0))
    np.testing.assert_allclose(found.poles, plain.poles + window, rtol=1e-12)


def test_modes_near_wanted_frequencies_and_no_other():
    measured = frfs(three(), 100, 200, 801, noise=0.01)
    found = fitted(measured, near=[150.4, 120.0])
    np.testing.assert_allclose(found.natural_frequencies, [120.0, 150.0], rtol=1e-4)
    assert len(fitted(measured, near=[175.0]).poles) == 1
    _, error = reconstruction_error(measured, fitted(measured, near=[175.0]))
    assert np.all(error < 0.02), "what is not named stays in the background"


def test_modes_by_index():
    measured = frfs(three(), 100, 200, 801, noise=0.01)
    table = stabilise(measured, range(4, 41, 2))
    row = int(np.argmin(np.abs(table.natural_frequencies - 150.0) + 100.0 * (table.order < 30)))
    found = modes(measured, table, index=[row])
    assert found.natural_frequencies == pytest.approx([150.0], rel=1e-4)
    for wrong in (len(table.poles), -1):
        with pytest.raises(InputError, match="no such row"):
            modes(measured, table, index=[wrong])


def test_a_wanted_frequency_without_a_pole_is_refused():
    measured = frfs(three(), 100, 200, 801)
    with pytest.raises(InputError, match=r"no pole near the wanted frequency.*500 Hz"):
        fitted(measured, near=[150.0, 500.0])


def test_real_shapes():
    truth = three(phase=0.05)
    found = fitted(frfs(truth, 100, 200, 801, noise=0.002), shapes="real")
    assert np.all(found.shapes.imag == 0)
    for mode in range(3):
        assert mac(found.shapes[:, mode], truth.shapes[:, mode]) > 0.99
    exact = three()
    found = fitted(frfs(exact, 100, 200, 801), shapes="real")
    np.testing.assert_allclose(
        found.shapes, exact.shapes * np.sign(found.shapes[:1].real * exact.shapes[:1].real), atol=1e-4
    )


def test_out_of_band_modes_are_kept_in_the_background():
    truth = model([93.0, 120.0, 150.0, 175.0, 215.0], [0.004, 0.004, 0.006, 0.005, 0.004], drive=(0, 7))
    measured = frfs(truth, 100, 200, 801, noise=0.001)
    found = fitted(measured)
    assert len(found.poles) == 3
    rebuilt, error = reconstruction_error(measured, found)
    assert rebuilt.values.shape == measured.values.shape
    assert np.all(error < 0.0013), "noise alone remains"
    for mode in range(3):
        wanted = truth.residues()[mode + 1]
        assert np.linalg.norm(found.residues()[mode] - wanted) < 0.005 * np.linalg.norm(wanted)


def least_residual(measured, truth, inside):
    """Relative error, norm over norm, that the residual terms leave at best: least squares at the true poles.

    Columns: modes of the band, one pole at half the lower and one at twice the upper edge with 5 % damping, 1 / s^2 and
    a constant, all as accelerance. Nothing of it is code of the fit.
    """
    s = 2j * np.pi * measured.frequencies
    omega = 2 * np.pi * np.array([measured.frequencies[0] / 2, 2 * measured.frequencies[-1]])
    columns = []
    for pole in [*truth.poles[inside], *(omega * (-0.05 + 1j))]:
        one, other = s**2 / (s - pole), s**2 / (s - pole.conjugate())
        columns += [one + other, 1j * (one - other)]
    columns += [np.ones(len(s), complex), s**2]
    matrix = np.stack([np.concatenate([column.real, column.imag]) for column in columns], axis=1)
    matrix /= np.linalg.norm(matrix, axis=0)
    errors = []
    for frf in measured.values.reshape(len(s), -1).T:
        right = np.concatenate([frf.real, frf.imag])
        best = np.linalg.lstsq(matrix, right, rcond=1e-14)[0]
        errors.append(np.linalg.norm(matrix @ best - right) / np.linalg.norm(right))
    return np.array(errors).reshape(measured.values.shape[1:])


def test_residual_terms_alone_follow_modes_far_away():
    """What they leave is what they leave at best: 1.5e-4 in the worst FRF. The fit states values, not this error, so
    its residual may not be larger, and the poles are exact.
    """
    truth = model([20.0, 120.0, 150.0, 600.0], [0.01, 0.004, 0.006, 0.01], drive=(0, 7))
    measured = frfs(truth, 100, 200, 801)
    found = fitted(measured, near=[120, 150])
    _, error = reconstruction_error(measured, found)
    best = least_residual(measured, truth, slice(1, 3))
    assert np.max(best) < 2e-4
    assert np.linalg.norm(error) < 1.25 * np.linalg.norm(best), "the fit weighs the lines, least squares do not"
    np.testing.assert_allclose(found.poles, truth.poles[1:3], rtol=1e-6)


@pytest.mark.parametrize("near", [None, [120, 150, 150, 180]], ids=["told nothing", "named twice"])
def test_repeated_roots_with_two_references(near):
    truth = model([120.0, 150.0, 150.0, 180.0], [0.004, 0.006, 0.006, 0.005], drive=(0, 7))
    found = fitted(frfs(truth, 100, 200, 801, noise=0.003), near=near)
    np.testing.assert_allclose(found.natural_frequencies, truth.natural_frequencies, rtol=1e-6)
    np.testing.assert_allclose(found.damping_ratios, truth.damping_ratios, rtol=1e-3)
    pair = (np.abs(found.natural_frequencies - 150) < 1).nonzero()[0]
    span = np.linalg.svd(np.column_stack([truth.shapes[:, 1:3], found.shapes[:, pair]]))[1]
    assert len(pair) == 2 and span[2] < 0.02 * span[0], "their shapes span the plane of the true ones"


def test_a_root_named_twice_that_is_single_is_taken_once():
    truth = model([120.0, 150.0], [0.004, 0.006], drive=(0, 7))
    assert len(fitted(frfs(truth, 100, 200, 801, noise=0.003), near=[120, 120]).poles) == 1


@pytest.mark.parametrize("drive", [(0,), (0, 7)])
def test_two_modes_three_thousandths_apart(drive):
    truth = model([120.0, 150.0, 150.45, 180.0], [0.004, 0.002, 0.003, 0.005], drive=drive)
    found = fitted(frfs(truth, 100, 200, 1601, noise=0.003))
    np.testing.assert_allclose(found.natural_frequencies, truth.natural_frequencies, rtol=5e-5)
    np.testing.assert_allclose(found.damping_ratios, truth.damping_ratios, rtol=0.05)
    for mode in range(4):
        assert mac(found.shapes[:, mode], truth.shapes[:, mode]) > 0.99


def test_a_mode_with_ten_percent_damping():
    truth = model([120.0, 150.0, 180.0], [0.004, 0.10, 0.005], drive=(0, 7))
    found = fitted(frfs(truth, 80, 220, 801, noise=0.01))
    assert len(found.poles) == 3
    np.testing.assert_allclose(found.natural_frequencies, truth.natural_frequencies, rtol=2e-3)
    assert found.damping_ratios[1] == pytest.approx(0.10, rel=0.05)


@pytest.mark.parametrize("zeta", [0.201, 0.25])
def test_a_resonance_heavier_than_modes_is_a_candidate_that_can_be_named(zeta):
    truth = model([30.0, 60.0, 180.0], [0.02, zeta, 0.02])
    size = np.array([1.0, 4.0, 1.0])
    truth = replace(truth, shapes=truth.shapes * size, participation=truth.participation * size)
    measured = frfs(truth, 5, 300, 591, noise=0.01)
    table = stabilise(measured, range(4, 25, 4))
    found = modes(measured, table)
    np.testing.assert_allclose(found.natural_frequencies, [30, 180], rtol=0.01)
    (candidate,) = found.candidates
    assert abs(candidate.damping_ratio - zeta) < 4 * candidate.damping_std < 0.05 * zeta
    assert "above 20%" in candidate.reason and "dominant-candidate" in codes(found)
    near = modes(measured, table, near=[60.0])
    assert near.damping_ratios == pytest.approx([zeta], rel=0.05) and "candidate" in codes(near)


def test_a_mode_cut_by_the_band_is_told():
    truth = model([120.0, 150.0, 199.8], [0.004, 0.006, 0.005], drive=(0, 7))
    found = fitted(frfs(truth, 100, 200, 801, noise=0.001))
    assert "band-edge" in codes(found)
    at = next(finding for finding in found.findings if finding.code == "band-edge")
    assert at.value == pytest.approx(199.8, rel=1e-3)
    assert "band-edge" not in codes(fitted(frfs(three(), 100, 200, 801, noise=0.001)))


def test_a_mode_just_outside_the_band_is_named():
    truth = model([120.0, 150.0, 200.5], [0.004, 0.006, 0.005], drive=(0, 7))
    found = fitted(frfs(truth, 100, 200, 801, noise=0.001))
    assert len(found.poles) == 2
    (at,) = (finding for finding in found.findings if finding.code == "band-edge")
    assert at.value == pytest.approx(200.5, rel=1e-3) and "outside the band" in at.message


@pytest.mark.parametrize("shape", [(4, 1), (20, 1), (20, 2)])
def test_noise_alone_holds_no_mode(shape):
    exact = frfs(model([120.0], [0.01], dofs=shape[0], drive=tuple(range(shape[1]))), 100, 200, 801)
    for seed in range(3):
        rng = np.random.default_rng([9, seed])
        noise = rng.standard_normal(exact.values.shape) + 1j * rng.standard_normal(exact.values.shape)
        found = fitted(replace(exact, values=noise))
        assert len(found.poles) == 0, found.natural_frequencies
        assert "no-modes" in codes(found)
        assert found.shapes.shape == (shape[0], 0)


@pytest.mark.parametrize("size", [0.02, 0.5, 2])
def test_a_spur_in_one_line_is_no_mode(size):
    truth = three()
    measured = frfs(truth, 100, 200, 801, noise=0.005)
    values = np.array(measured.values)
    values[300] += size * np.abs(values).max() * np.exp(1j * np.arange(values[0].size)).reshape(values[0].shape)
    found = fitted(replace(measured, values=values))
    np.testing.assert_allclose(found.natural_frequencies, truth.natural_frequencies, rtol=1e-3)
    assert len(found.poles) == 3


def test_a_dead_output_is_left_out_and_told():
    truth = three()
    measured = frfs(truth, 100, 200, 801, noise=0.005)
    values = np.array(measured.values)
    values[:, 4] = 0
    found = fitted(replace(measured, values=values))
    assert found.dofs == truth.dofs[:4] + truth.dofs[5:]
    assert len(found.poles) == 3
    dead = next(finding for finding in found.findings if finding.code == "dead-output")
    assert "5:+Z" in dead.message


def test_standard_deviations_have_the_right_size():
    truth = model([120.0, 150.0, 152.0], [0.004, 0.006, 0.005], dofs=6)
    scores = []
    for seed in range(30):
        found = fitted(frfs(truth, 100, 180, 401, noise=0.02, seed=seed), range(4, 25, 4), near=[120, 150, 152])
        frequency = (found.natural_frequencies - truth.natural_frequencies) / np.sqrt(found.covariance[:, 0, 0])
        damping = (found.damping_ratios - truth.damping_ratios) / np.sqrt(found.covariance[:, 1, 1])
        scores.append([frequency, damping])
    rms = np.sqrt(np.mean(np.square(scores), axis=(0, 2)))
    assert np.all((rms > 0.7) & (rms < 1.5)), rms


def test_covariance_is_symmetric_and_positive():
    found = fitted(frfs(three(), 100, 200, 801, noise=0.01))
    assert found.covariance.shape == (3, 2, 2)
    np.testing.assert_allclose(found.covariance, found.covariance.transpose(0, 2, 1), rtol=1e-9)
    assert np.all(np.linalg.eigvalsh(found.covariance) > 0)
    quieter = fitted(frfs(three(), 100, 200, 801, noise=0.001))
    ratio = np.sqrt(found.covariance[:, 1, 1] / quieter.covariance[:, 1, 1])
    np.testing.assert_allclose(ratio, 10, rtol=0.3)


def test_intervals_follow_the_number_of_lines():
    few, many = (fitted(frfs(three(), 100, 200, lines, noise=0.01)) for lines in (401, 1601))
    np.testing.assert_allclose(np.sqrt(few.covariance[:, 1, 1] / many.covariance[:, 1, 1]), 2, rtol=0.3)


def test_the_order_of_outputs_does_not_matter():
    measured = frfs(three(), 100, 200, 801, noise=0.01)
    shuffled = np.random.default_rng(2).permutation(12).tolist()
    a, b = fitted(measured), fitted(measured.pick(outputs=shuffled))
    np.testing.assert_allclose(b.poles, a.poles, rtol=1e-8)
    np.testing.assert_allclose(b.shapes, a.shapes[shuffled], rtol=1e-5, atol=1e-8)


def test_variance_tells_the_fit_which_frfs_to_trust():
    truth = three()
    exact = frfs(truth, 100, 200, 801)
    rng = np.random.default_rng(5)
    std = (
        np.abs(exact.values).mean()
        * np.where(np.arange(12) < 6, 1e-3, 1.0)[None, :, None]
        * np.ones(exact.values.shape)
    )
    draw = np.sqrt(0.5) * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape))
    measured = replace(exact, values=exact.values + std * draw, variance=std**2)
    found = fitted(measured)
    assert len(found.poles) == 3
    np.testing.assert_allclose(found.damping_ratios, truth.damping_ratios, rtol=0.002)


def test_the_band_of_the_table_is_the_band_of_the_fit():
    truth = model([120.0, 150.0, 175.0, 250.0], [0.004, 0.006, 0.005, 0.004], drive=(0, 7))
    measured = frfs(truth, 100, 300, 1601, noise=0.005)
    found = modes(measured, stabilise(measured.band(100, 200), range(4, 41, 2)))
    np.testing.assert_allclose(found.natural_frequencies, truth.natural_frequencies[:3], rtol=1e-4)


def test_cancelling():
    measured = frfs(three(), 100, 200, 401, noise=0.01)
    table = stabilise(measured, range(4, 25, 2))
    with pytest.raises(CancelledError, match="selection of modes"):
        modes(measured, table, progress=lambda what, done, total: False)
    with pytest.raises(CancelledError, match="residues"):
        modes(measured, table, progress=lambda what, done, total: what != "residues")


def test_heavily_and_lightly_damped_neighbours_keep_their_damping():
    truth = model([120.0, 122.0, 180.0], [0.05, 0.001, 0.005], drive=(0, 7))
    found = fitted(frfs(truth, 80, 220, 1601, noise=0.003))
    order = np.argsort(found.damping_ratios)
    np.testing.assert_allclose(np.sort(found.damping_ratios), np.sort(damping_ratios(truth.poles)), rtol=0.03)
    assert len(order) == 3
