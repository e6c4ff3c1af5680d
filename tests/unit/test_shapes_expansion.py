"""Expansion of shapes whose displacement in space is known."""

import numpy as np

from ema.data import Geometry, ModalModel, poles_from
from ema.dof import Dof
from ema.shapes import expand


def model(values: dict[str, complex]) -> ModalModel:
    return ModalModel(
        poles_from(np.array([100.0]), np.array([0.01])),
        np.array([[value] for value in values.values()], complex),
        tuple(Dof.parse(name) for name in values),
        np.ones((1, 1), complex),
        (Dof(1, "+Z"),),
    )


def chain(count: int) -> Geometry:
    return Geometry(
        np.arange(1, count + 1),
        np.column_stack([np.arange(count, dtype=float), np.zeros((count, 2))]),
        lines=(tuple(range(1, count + 1)),),
    )


def test_signs_and_axes():
    found = expand(model({"1-Z": 2.0, "1X": 1j, "2Y": 3.0}), chain(3))
    np.testing.assert_allclose(found.displacement[:, :, 0], [[1j, 0, -2], [0, 3, 0], [0, 0, 0]], atol=1e-12)
    assert found.measured.tolist() == [True, True, False]
    assert not found.interpolated.any()


def test_local_axes_turn_the_motion():
    axes = np.repeat(np.eye(3)[None], 3, axis=0)
    axes[0] = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    turned = Geometry(np.arange(1, 4), chain(3).xyz, axes=axes)
    np.testing.assert_allclose(
        expand(model({"1X": 1.0, "1-Y": 2.0}), turned).displacement[0, :, 0], [2, 1, 0], atol=1e-12
    )


def test_skewed_axes_recover_the_true_motion():
    """Three sensors that are not orthogonal: the motion whose projections they are, not the sum of the readings."""
    skew = np.array([[1.0, 0, 0], [0.6, 0.8, 0], [0.0, 0.6, 0.8]])
    truth = np.array([0.3, -0.7, 1.1])
    readings = skew @ truth
    geometry = Geometry(np.array([1]), np.zeros((1, 3)), axes=skew[None])
    found = expand(model({"1X": readings[0], "1Y": readings[1], "1Z": readings[2]}), geometry)
    np.testing.assert_allclose(found.displacement[0, :, 0], truth, atol=1e-12)


def test_a_direction_measured_twice_is_averaged():
    found = expand(model({"1Z": 1.0, "1-Z": -3.0}), chain(1))
    np.testing.assert_allclose(found.displacement[0, :, 0], [0, 0, 2], atol=1e-12)


def test_interpolation_is_linear_along_a_line_and_marked():
    found = expand(model({"1Z": 0.0, "4Z": 3.0}), chain(6), interpolate=True)
    np.testing.assert_allclose(found.displacement[:, 2, 0], [0, 1, 2, 3, 3, 3], atol=1e-12)
    assert found.interpolated.tolist() == [False, True, True, False, True, True]
    assert expand(model({"1Z": 0.0, "4Z": 3.0}), chain(6)).displacement[1, 2, 0] == 0


def test_nodes_without_a_path_stay_undrawn():
    lonely = Geometry(np.array([1, 2, 3]), np.eye(3), lines=((1, 2),))
    found = expand(model({"1Z": 1.0}), lonely, interpolate=True)
    assert found.interpolated.tolist() == [False, True, False]
    assert found.displacement[2].max() == 0


def test_what_cannot_be_placed_is_listed():
    found = expand(model({"1Z": 1.0, "99Z": 1.0, "2": 1.0, "2RX": 1.0}), chain(3))
    assert [str(dof) for dof in found.left_out] == ["99:+Z", "2:S", "2:+RX"]
