"""Smooth surfaces through noisy mode shapes."""

import numpy as np
import pytest

from ema import shapes
from ema.data import Geometry, ModalModel
from ema.data.modal import poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate.plate import PlateModes, free_plate


@pytest.fixture(scope="module")
def plate() -> PlateModes:
    return free_plate(0.9, 0.5, 130.0, 4.87e6, 1.5, 1.5, 0.26, modes=4)


def measured(plate, noise, seed=0, turned=None):
    turned = np.eye(3) if turned is None else turned
    x, y = (
        part.ravel() for part in np.meshgrid(np.linspace(0.03, 0.87, 10), np.linspace(0.03, 0.47, 8), indexing="ij")
    )
    exact = plate.shapes(x, y)
    rng = np.random.default_rng(seed)
    values = exact + noise * np.sqrt(np.mean(exact**2, axis=0)) * rng.standard_normal(exact.shape)
    geometry = Geometry(
        np.arange(1, 81), np.stack([x, y, np.full(80, 0.05)], axis=1) @ turned.T, axes=np.tile(turned.T, (80, 1, 1))
    )
    dofs = tuple(Dof.parse(f"{node}:-Z") for node in range(1, 81))
    poles = poles_from(plate.natural_frequencies, np.full(4, 0.006))
    return ModalModel(poles, -values.astype(complex), dofs, np.ones((1, 4), complex), dofs[:1]), geometry


def truth(plate, places, h=1e-4):
    ahead, back = (plate.shapes(places[:, 0] + step, places[:, 1]) for step in (h, -h))
    return (ahead - back) / (2 * h), (ahead - 2 * plate.shapes(places[:, 0], places[:, 1]) + back) / h**2


def test_slopes_and_curvatures_of_exact_shapes(plate):
    surface = shapes.smooth(*measured(plate, 0.0))
    places = np.random.default_rng(1).uniform([0.05, 0.05], [0.85, 0.45], (100, 2))
    slope, curvature = truth(plate, places)
    assert np.all(np.linalg.norm(surface.values(places, 1) - slope, axis=0) < 0.003 * np.linalg.norm(slope, axis=0))
    assert np.all(
        np.linalg.norm(surface.values(places, 2) - curvature, axis=0) < 0.02 * np.linalg.norm(curvature, axis=0)
    )


def test_ten_percent_noise_leaves_slopes_usable_and_bounds_honest(plate):
    errors, inside, noises = [], [], []
    places = np.random.default_rng(1).uniform([0.05, 0.05], [0.85, 0.45], (60, 2))
    slope, _ = truth(plate, places)
    for seed in range(20):
        surface = shapes.smooth(*measured(plate, 0.1, seed))
        error = surface.values(places, 1) - slope
        errors.append(np.linalg.norm(error, axis=0) / np.linalg.norm(slope, axis=0))
        inside.append(np.mean(np.abs(error) < 1.96 * surface.std(places, 1)))
        noises.append(surface.noise / np.sqrt(np.mean(plate.shapes(*surface.points.T) ** 2, axis=0)))
    assert np.mean(errors, axis=0)[[0, 2]] == pytest.approx([0.045, 0.06], abs=0.02)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.05)
    assert np.mean(noises) == pytest.approx(0.1, rel=0.2)


def test_direction_and_plane_in_space(plate):
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # the plate stands upright in the y-z plane
    flat, upright = shapes.smooth(*measured(plate, 0.0)), shapes.smooth(*measured(plate, 0.0, turned=turn))
    middle = np.array([[0.4, 0.2]])
    step = np.array([0, 1e-5])
    along_y = flat.values(middle, 1, np.pi / 2)[0]
    assert along_y == pytest.approx((flat.values(middle + step)[0] - flat.values(middle - step)[0]) / 2e-5, rel=1e-5)
    # the same place, told by its point in space
    place = (turn @ np.array([0.4, 0.2, 0.05]) - upright.origin) @ upright.axes[:2].T
    assert np.abs(upright.values(place[None])[0]) == pytest.approx(np.abs(flat.values(middle)[0]), rel=1e-6)


def test_a_row_of_points_is_a_line():
    x = np.linspace(0, 1, 15)
    geometry = Geometry(np.arange(1, 16), np.stack([x, 0 * x, 0 * x], axis=1))
    dofs = tuple(Dof.parse(f"{node}:+Z") for node in range(1, 16))
    model = ModalModel(
        poles_from(np.array([10.0]), np.array([0.01])),
        np.sin(2 * x)[:, None].astype(complex),
        dofs,
        np.ones((1, 1), complex),
        dofs[:1],
    )
    surface = shapes.smooth(model, geometry)
    assert surface.values(np.array([[0.3, 0.0]]), 1)[0, 0] == pytest.approx(2 * np.cos(0.6), rel=1e-6)


def test_what_has_no_surface_is_refused(plate):
    model, geometry = measured(plate, 0.0)
    bent = Geometry(geometry.nodes, geometry.xyz + np.outer((geometry.xyz[:, 0] - 0.45) ** 2, [0, 0, 2.0]))
    with pytest.raises(InputError, match="no plane"):
        shapes.smooth(model, bent)
    with pytest.raises(InputError, match="too few points"):
        shapes.smooth(model, Geometry(np.arange(1, 5), geometry.xyz[:4]))
    with pytest.raises(InputError, match="complex"):
        shapes.smooth(
            ModalModel(model.poles, 1j * model.shapes, model.dofs, model.participation, model.inputs), geometry
        )
