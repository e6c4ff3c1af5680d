"""Unit modal mass from drive points, and what must hold whatever the numbers are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ema.fit import modes, reconstruction_error, stabilise
from ema.fit.scaling import scale_to_unit_modal_mass
from tests.unit.fit_rig import frfs, model

FEW = settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)


def fitted(measured):
    return modes(measured, stabilise(measured, range(4, 25, 2)))


def same_shapes(a, b, **tolerance):
    """Equal but for the sign of each mode."""
    sign = np.sign(np.einsum("dr,dr->r", a.conj(), b).real)
    np.testing.assert_allclose(a * sign, b, **tolerance)


def two(drive=(0,), phase=0.0):
    return model([120.0, 160.0], [0.004, 0.006], dofs=10, drive=drive, phase=phase)


@pytest.mark.parametrize("drive", [(0,), (3, 7), (0, 4, 9)])
def test_unit_modal_mass_from_one_and_several_drive_points(drive):
    truth = two(drive)
    found = fitted(frfs(truth, 100, 180, 401))
    assert found.scaling == "unit modal mass"
    same_shapes(found.shapes, truth.shapes, atol=1e-4)
    np.testing.assert_allclose(found.participation * 2j * found.poles.imag, found.shapes[list(drive)], atol=1e-3)


def test_a_drive_point_of_reversed_sense():
    """Force along -Z beside a sensor along +Z: the FRF is negative, the modal mass is not."""
    truth = two((2,))
    measured = frfs(truth, 100, 180, 401)
    turned = replace(measured, values=-measured.values, inputs=(measured.inputs[0].reversed(),))
    found = fitted(turned)
    assert found.scaling == "unit modal mass"
    same_shapes(found.shapes, truth.shapes, atol=1e-4)
    wrong = fitted(replace(measured, values=-measured.values))
    assert not np.allclose(np.abs(wrong.shapes.real), np.abs(truth.shapes.real), atol=1e-2), "the sense matters"


def test_several_drive_points_with_one_reversed():
    truth = two((2, 7))
    measured = frfs(truth, 100, 180, 401)
    turned = replace(
        measured,
        values=measured.values * np.array([1, -1]),
        inputs=(measured.inputs[0], measured.inputs[1].reversed()),
    )
    found = fitted(turned)
    same_shapes(found.shapes, truth.shapes, atol=1e-4)
    assert "drive-points-disagree" not in [finding.code for finding in found.findings]


def test_drive_points_that_disagree_are_told():
    truth = two((2, 7))
    measured = frfs(truth, 100, 180, 401)
    wrong = fitted(replace(measured, values=measured.values * np.array([1.0, 1.5])))
    found = [finding for finding in wrong.findings if finding.code == "drive-points-disagree"]
    assert len(found) >= 1 and found[0].value > 0.1 and found[0].limit == 0.1
    right = fitted(measured)
    assert not [finding for finding in right.findings if finding.code == "drive-points-disagree"]


def test_drive_points_that_noise_alone_parts_are_not_accused():
    """Reciprocal FRFs with noise of 20 %, which parts weak modes by more than 10 %; a wrong sensitivity is more."""
    truth = model([30.0, 55.0, 90.0, 125.0, 180.0], [0.01, 0.01, 0.005, 0.01, 0.008], dofs=6, drive=(1, 4))
    size = np.array([1.0, 0.4, 1.0, 0.3, 1.0])
    truth = replace(truth, shapes=truth.shapes * size, participation=truth.participation * size)
    parted = 0
    for seed in range(4):
        measured = frfs(truth, 20, 260, 481, noise=0.2, seed=seed)
        found = fitted(measured)
        masses = np.abs(found.participation * 2 * found.poles.imag), np.abs(found.shapes[[1, 4]])
        parted += np.any(np.abs(masses[0] - masses[1]) > 0.1 * np.linalg.norm(masses[1], axis=0))
        assert "drive-points-disagree" not in [finding.code for finding in found.findings]
        wrong = fitted(replace(measured, values=measured.values * np.array([1.0, 2.0])))
        assert "drive-points-disagree" in [finding.code for finding in wrong.findings]
    assert parted >= 2


def test_an_unstated_unit_is_not_scaled():
    measured = replace(frfs(two(), 100, 180, 401), unit="unstated", quantity="unstated")
    found = fitted(measured)
    assert found.scaling == "unscaled"
    np.testing.assert_allclose(np.max(np.abs(found.shapes), axis=0), 1, rtol=1e-12)
    np.testing.assert_allclose(found.poles, two().poles, rtol=1e-6)
    _, error = reconstruction_error(measured, found)
    assert np.all(error < 1e-5)


def test_without_a_drive_point_nothing_is_scaled_and_a_finding_says_so():
    measured = frfs(two(), 100, 180, 401).pick(outputs=list(range(1, 10)))
    found = fitted(measured)
    assert found.scaling == "unscaled"
    assert "no-drive-point" in [finding.code for finding in found.findings]


def test_scaling_leaves_residues_and_is_idempotent():
    truth = two((2, 7), phase=0.2)
    raw = replace(truth, shapes=3j * truth.shapes, participation=truth.participation / 3j, scaling="unscaled")
    once = scale_to_unit_modal_mass(raw)
    np.testing.assert_allclose(once.residues(), truth.residues(), rtol=1e-12)
    same_shapes(once.shapes, truth.shapes, rtol=1e-9)
    np.testing.assert_allclose(scale_to_unit_modal_mass(once).shapes, once.shapes, rtol=1e-12)


def test_a_node_at_a_drive_point_leaves_the_others_to_scale():
    truth = two((2, 7))
    shapes = np.array(truth.shapes)
    shapes[2, 0] = 0
    truth = replace(truth, shapes=shapes, participation=shapes[[2, 7]] / (2j * truth.poles.imag))
    scaled = scale_to_unit_modal_mass(replace(truth, shapes=2 * shapes, participation=truth.participation / 2))
    same_shapes(scaled.shapes, truth.shapes, atol=1e-9)
    assert not scaled.findings


@FEW
@given(st.floats(-12, 12))
def test_frfs_times_c_are_shapes_times_the_root_of_c(power):
    c = 10.0**power
    measured = frfs(two((2, 7)), 100, 180, 201, noise=0.003)
    a, b = fitted(measured), fitted(replace(measured, values=c * measured.values))
    np.testing.assert_allclose(b.poles, a.poles, rtol=1e-8)
    np.testing.assert_allclose(b.shapes, np.sqrt(c) * a.shapes, rtol=1e-4, atol=1e-6 * np.sqrt(c))
    np.testing.assert_allclose(b.covariance, a.covariance, rtol=1e-3)


@FEW
@given(st.integers(0, 1000))
def test_reciprocity_of_what_was_fitted(seed):
    """The residue between two points that are both reference and response is the same both ways round."""
    truth = model([120.0, 160.0], [0.004, 0.006], dofs=8, drive=(1, 6), seed=seed)
    found = fitted(frfs(truth, 100, 180, 201, noise=0.002, seed=seed))
    for mode in range(len(found.poles)):
        block = found.residues()[mode][[1, 6]]
        assert abs(block[0, 1] - block[1, 0]) < 0.03 * np.abs(found.residues()[mode]).max()


@FEW
@given(st.lists(st.sampled_from([-1.0, 1.0]), min_size=10, max_size=10))
def test_turning_a_sensor_round_turns_its_row_of_the_shapes(signs):
    measured = frfs(two((2, 7)), 100, 180, 201, noise=0.003)
    sign = np.array(signs)
    outputs = tuple(dof if s > 0 else dof.reversed() for dof, s in zip(measured.outputs, signs, strict=True))
    turned = replace(measured, values=measured.values * sign[None, :, None], outputs=outputs)
    a, b = fitted(measured), fitted(turned)
    np.testing.assert_allclose(b.poles, a.poles, rtol=1e-9)
    same_shapes(b.shapes * sign[:, None], a.shapes, rtol=1e-6, atol=1e-9)
