"""Modes above the measured ones, from the plate that the measured ones imply."""

from dataclasses import replace

import numpy as np
import pytest

from ema import shapes
from ema.data import Geometry, ModalModel, poles_from
from ema.datasets.free_plate import BendingStiffness, PlateModes, free_plate
from ema.dof import Dof
from ema.errors import InputError

MEASURED, LENGTH, WIDTH, MASS = 6, 0.9, 0.5, 130.0
ALONG = 4.87e6
TRUSTED = 10
"""Modes that the Ritz plate with 9 x 9 polynomials, the truth here, resolves."""


@pytest.fixture(scope="module")
def plate() -> PlateModes:
    return free_plate(LENGTH, WIDTH, MASS, BendingStiffness(ALONG, 1.5, 1.5, 0.26), modes=TRUSTED)


def measured(plate: PlateModes, count: int = MEASURED, noise: float = 0.0):
    x, y = (p.ravel() for p in np.meshgrid(np.linspace(0, LENGTH, 13), np.linspace(0, WIDTH, 7), indexing="ij"))
    values = plate.shapes(x, y)[:, :count]
    size = np.sqrt(np.mean(values**2, axis=0))
    values = values + noise * size * np.random.default_rng(1).standard_normal(values.shape)
    dofs = tuple(Dof(node, "+Z") for node in range(1, len(x) + 1))
    poles = poles_from(plate.natural_frequencies[:count], np.full(count, 0.005))
    moved = values.astype(complex)
    model = ModalModel(poles, moved, dofs, moved[:1] / (2j * poles.imag), dofs[:1], scaling="unit modal mass")
    geometry = Geometry(np.arange(1, len(x) + 1), np.stack([x, y, 0 * x], axis=1))
    hung, _ = shapes.with_rigid_body(model, geometry, MASS)
    return hung, shapes.smooth(hung, geometry)


@pytest.mark.parametrize(("noise", "allowed"), [(0.0, 0.01), (0.02, 0.04)])
def test_the_plate_is_found_again(plate, noise, allowed):
    hung, surface = measured(plate, noise=noise)
    longer, continued, (told,) = shapes.with_plate(hung, surface)
    assert told.code == "plate" and told.value < allowed
    added = longer.natural_frequencies[len(hung.poles) :]
    truth = plate.natural_frequencies[MEASURED:]
    assert added[: len(truth)] == pytest.approx(truth, rel=allowed)
    assert np.array_equal(longer.poles[: len(hung.poles)], hung.poles)
    assert np.allclose(longer.shapes[:, : len(hung.poles)], hung.shapes)
    places = np.random.default_rng(2).uniform([0.1, 0.1], [0.8, 0.4], (20, 2))
    assert np.allclose(continued.values(places)[:, : len(hung.poles)], surface.values(places))


def test_the_structure_yields_around_a_joint_as_the_whole_plate_does(plate):
    """Rotation per moment at a point, of the modes above the measured ones that the truth knows; more follow."""
    hung, surface = measured(plate)
    longer, continued, _ = shapes.with_plate(hung, surface)
    places = np.array([[0.3, 0.2], [0.6, 0.33]])
    squares = (2 * np.pi * plate.natural_frequencies[MEASURED:]) ** 2
    known = np.sum(plate.slopes(*places.T)[:, MEASURED:] ** 2 / squares, axis=1)
    first = len(hung.poles)
    omega = np.abs(longer.poles[first:])
    each = (continued.values(places, 1)[:, first:] / omega) ** 2
    assert np.sum(each[:, : TRUSTED - MEASURED], axis=1) == pytest.approx(known, rel=0.05)
    assert np.all(np.sum(each, axis=1) > 1.5 * known)


def test_what_is_no_plate_is_left_alone(plate):
    hung, surface = measured(plate)
    odd = replace(hung, poles=hung.poles * np.append([1.0, 1.9, 0.7, 1.3, 2.5, 0.6], np.ones(3)))
    same, kept, (told,) = shapes.with_plate(odd, surface)
    assert same is odd and kept is surface and told.code == "no-plate" and told.severity == "warning"
    few, small = measured(plate, 3)
    assert shapes.with_plate(few, small)[2][0].code == "no-plate"


def test_bad_input_is_told(plate):
    _, surface = measured(plate)
    with pytest.raises(InputError, match="other modes"):
        shapes.with_plate(measured(plate, 5)[0], surface)
