"""Complexity of shapes built with a known phase scatter."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.shapes import mean_phase, mean_phase_deviation, modal_phase_collinearity, quality, realise

REAL = np.array([[1.0, -0.5], [-0.3, 0.8], [0.7, 0.2]])


@given(degrees=st.floats(-89.9, 89.9))
def test_turned_real_shapes_have_that_mean_phase_and_no_complexity(degrees):
    turned = REAL * np.exp(1j * np.radians(degrees))
    np.testing.assert_allclose(mean_phase(turned), degrees, atol=1e-9)
    np.testing.assert_allclose(modal_phase_collinearity(turned), 1, atol=1e-12)
    np.testing.assert_allclose(mean_phase_deviation(turned), 0, atol=1e-9)
    np.testing.assert_allclose(realise(turned), REAL, atol=1e-12)


def test_two_equal_points_at_plus_and_minus_ten_degrees():
    """s1 = sqrt2 cos 10, s2 = sqrt2 sin 10: MPC = cos(20 deg)^2, mean phase 0, deviation 10 deg."""
    shape = np.exp(1j * np.radians([[10.0], [-10.0]]))
    assert modal_phase_collinearity(shape)[0] == pytest.approx(np.cos(np.radians(20)) ** 2, rel=1e-12)
    assert mean_phase(shape)[0] == pytest.approx(0, abs=1e-9)
    assert mean_phase_deviation(shape)[0] == pytest.approx(10, rel=1e-9)


def test_a_circle_has_no_line():
    angles = 2 * np.pi * np.arange(8) / 8
    assert modal_phase_collinearity(np.exp(1j * angles)[:, None])[0] == pytest.approx(0, abs=1e-12)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-200, 1e200), phase=st.floats(0, 6.28))
def test_complexity_knows_no_scale_and_no_phase(seed, scale, phase):
    generator = np.random.default_rng(seed)
    shapes = generator.normal(size=(9, 2)) + 0.2j * generator.normal(size=(9, 2))
    turned = shapes * scale * np.exp(1j * phase)
    np.testing.assert_allclose(modal_phase_collinearity(turned), modal_phase_collinearity(shapes), atol=1e-9)
    np.testing.assert_allclose(mean_phase_deviation(turned), mean_phase_deviation(shapes), atol=1e-6)


def test_mean_phase_deviation_is_weighted_by_amplitude():
    """A large point on the line and a small one 90 degrees off it: the deviation is the amplitude-weighted mean."""
    assert mean_phase_deviation(np.array([[1.0], [0.1j]]))[0] == pytest.approx(90 * 0.1 / 1.1, rel=1e-9)


def test_realised_shape_is_the_nearest_real_line():
    shape = REAL[:, :1] + 0.05j * np.array([[1.0], [1.0], [1.0]])
    nearest = realise(shape)[:, 0]
    line = np.exp(1j * np.radians(mean_phase(shape)[0]))
    best = np.linalg.norm(shape[:, 0] - nearest * line)
    for degrees in np.linspace(-90, 90, 181):
        turn = np.exp(1j * np.radians(degrees))
        assert best <= np.linalg.norm(shape[:, 0] - np.real(shape[:, 0] / turn) * turn) + 1e-12


def test_zero_shape_has_no_phase_and_one_point_is_always_in_phase():
    found = quality(np.array([[0.0]]))
    assert np.isnan([found.modal_phase_collinearity[0], found.mean_phase[0], found.mean_phase_deviation[0]]).all()
    assert realise(np.array([[0j]]))[0, 0] == 0
    assert quality(np.array([[1 + 1j]])).modal_phase_collinearity[0] == pytest.approx(1)
