"""Smooth surfaces through noisy mode shapes."""

import numpy as np
import pytest

from ema import shapes
from ema.data import Geometry, ModalModel
from ema.data.modal import poles_from
from ema.datasets.free_plate import BendingStiffness, PlateModes, free_plate
from ema.dof import Dof
from ema.errors import InputError
from tests.bench.blind_hosts.hosts import host_of


@pytest.fixture(scope="module")
def plate() -> PlateModes:
    return free_plate(0.9, 0.5, 130.0, BendingStiffness(4.87e6, 1.5, 1.5, 0.26), modes=4)


def measured(plate, noise, seed=0, turned=None, counts=(10, 8)):
    turned = np.eye(3) if turned is None else turned
    sides = np.linspace(0.03, 0.87, counts[0]), np.linspace(0.03, 0.47, counts[1])
    x, y = (part.ravel() for part in np.meshgrid(*sides, indexing="ij"))
    exact = plate.shapes(x, y)
    rng = np.random.default_rng(seed)
    values = exact + noise * np.sqrt(np.mean(exact**2, axis=0)) * rng.standard_normal(exact.shape)
    count = len(x)
    places = np.stack([x, y, np.full(count, 0.05)], axis=1) @ turned.T
    geometry = Geometry(np.arange(1, count + 1), places, axes=np.tile(turned.T, (count, 1, 1)))
    dofs = tuple(Dof.parse(f"{node}:-Z") for node in range(1, count + 1))
    poles = poles_from(plate.natural_frequencies, np.full(4, 0.006))
    return ModalModel(poles, -values.astype(complex), dofs, np.ones((1, 4), complex), dofs[:1]), geometry


def truth(plate, places, h=1e-4):
    ahead, back = (plate.shapes(places[:, 0] + step, places[:, 1]) for step in (h, -h))
    return (ahead - back) / (2 * h), (ahead - 2 * plate.shapes(places[:, 0], places[:, 1]) + back) / h**2


def test_slopes_and_curvatures_of_exact_shapes(plate):
    """This plate's modes are Legendre products of degree 8 themselves, which a fit by a few such products meets by
    kinship, on 80 points already, with bounds that hold for no other shape (tests below). Without that knowledge the
    waves that 80 points cannot tell are open: their errors lie within the stated bounds, and fall with more points."""
    places = np.random.default_rng(1).uniform([0.05, 0.05], [0.85, 0.45], (100, 2))
    slope, curvature = truth(plate, places)
    fine, coarse = (shapes.smooth(*measured(plate, 0.0, counts=counts)) for counts in ((20, 15), (10, 8)))
    assert np.all(np.linalg.norm(fine.values(places, 1) - slope, axis=0) < 0.003 * np.linalg.norm(slope, axis=0))
    assert np.all(np.linalg.norm(fine.values(places, 2) - curvature, axis=0) < 0.02 * np.linalg.norm(curvature, axis=0))
    assert np.all(np.linalg.norm(coarse.values(places, 1) - slope, axis=0) < 0.02 * np.linalg.norm(slope, axis=0))
    for order, exact in ((1, slope), (2, curvature)):
        assert np.mean(np.abs(coarse.values(places, order) - exact) < 1.96 * coarse.std(places, order)) > 0.9


def lumped(counts, noise, seed, slender):
    """Shapes of the first eight elastic modes of a plate with lumped masses, by finite elements of their own, at a grid
    of points with noise; the host, its shapes, and the model."""
    rng = np.random.default_rng(seed)
    host = host_of(rng, slender)
    length, width = host.plate.size
    x, y = (p.ravel() for p in np.meshgrid(*(np.linspace(0, s, n) for s, n in zip((length, width), counts))))
    omega, _, all_shapes = host.modes(8000.0)
    modes = all_shapes[:, 3:11]
    exact = host.plate.rows(np.stack([x, y], axis=1)) @ modes
    values = exact + noise * np.sqrt(np.mean(exact**2, axis=0)) * rng.standard_normal(exact.shape)
    dofs = tuple(Dof(node, "+Z") for node in range(len(x)))
    poles = poles_from(omega[3:11] / (2 * np.pi), np.full(8, 0.005))
    model = ModalModel(poles, values.astype(complex), dofs, np.ones((1, 8), complex), dofs[:1])
    return host, modes, smooth_of(model, x, y), rng


def smooth_of(model, x, y):
    return shapes.smooth(model, Geometry(np.arange(len(x)), np.stack([x, y, 0 * x], axis=1)))


@pytest.mark.parametrize(
    "counts, slender, error", [((17, 3), True, 0.02), ((11, 6), False, 0.03), ((21, 13), False, 0.015)]
)
def test_bounds_hold_on_plates_with_lumped_masses_and_on_slender_ones(counts, slender, error):
    """Truth: finite elements that share no code. Before, 17 x 3 points on a slender plate left as many waves along as
    across: higher bending modes were lost (errors of their size) and 64 % of the slopes lay within bounds of 95 %."""
    inside, errors = [], []
    for seed in range(8):
        host, modes, surface, rng = lumped(counts, 0.003, seed, slender)
        places = rng.uniform([0.08, 0.1], [0.92, 0.9], (60, 2)) * host.plate.size
        for order in (0, 1):
            exact = host.plate.rows(places, order) @ modes
            missed = surface.values(places, order) - exact
            inside.append(np.mean(np.abs(missed) < 1.96 * surface.std(places, order)))
        errors.append(np.linalg.norm(missed, axis=0) / np.linalg.norm(exact, axis=0))
    assert np.mean(inside) > 0.93 and min(inside) > 0.8
    assert np.median(errors) < error and np.max(errors) < 10 * error


def test_two_rows_of_points_carry_bending_and_twist():
    """No curvature across can be told from two rows: it is zero, not what rounding makes of it (1e13 times the
    deflection, before)."""
    x, y = (p.ravel() for p in np.meshgrid(np.linspace(0, 1.2, 13), np.linspace(0, 0.2, 2), indexing="ij"))

    def exact(x, y):
        return np.stack([np.cos(3 * np.pi * x / 1.2), 8 * np.cos(2 * np.pi * x / 1.2) * (y - 0.1)], axis=1)

    dofs = tuple(Dof(node, "+Z") for node in range(26))
    noise = 1e-3 * np.random.default_rng(0).standard_normal((26, 2))
    values = (exact(x, y) + noise).astype(complex)
    model = ModalModel(poles_from(np.array([40.0, 60.0]), np.full(2, 0.01)), values, dofs, values[:1], dofs[:1])
    surface = smooth_of(model, x, y)
    places = np.random.default_rng(1).uniform([0.1, 0.02], [1.1, 0.18], (50, 2))
    missed = surface.values(places) - exact(*places.T)
    assert np.abs(missed).max() < 0.005 and np.all(np.abs(missed) < 3 * surface.std(places))


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


def along(plate, first, second, normal):
    """Noise-free shapes of the plate with its sides along two directions, measured along the third."""
    model, geometry = measured(plate, 0.0)
    xyz = geometry.xyz @ np.stack([first, second, normal])
    axis = "+" + "XYZ"[int(np.argmax(np.abs(normal)))]
    dofs = tuple(Dof(dof.node, axis) for dof in model.dofs)
    return ModalModel(model.poles, -model.shapes, dofs, model.participation, dofs[:1]), Geometry(geometry.nodes, xyz)


@pytest.mark.parametrize("names", ["xy", "xz", "yz", "yx", "zx", "zy"])
@pytest.mark.parametrize("shift", [0.0, -0.7])
def test_coordinates_in_a_plane_of_the_global_axes_are_the_global_ones(plate, names, shift):
    """Along x, y or z as they are, and a deflection along the positive direction that was measured is positive."""
    unit = dict(zip("xyz", np.eye(3)))
    (normal,) = set("xyz") - set(names)
    model, geometry = along(plate, unit[names[0]], unit[names[1]], unit[normal])
    geometry = Geometry(geometry.nodes, geometry.xyz + shift)
    surface = shapes.smooth(model, geometry)
    columns = sorted("xyz".index(name) for name in names)
    assert surface.axes == pytest.approx(np.stack([*np.eye(3)[columns], unit[normal]]), abs=1e-12)
    assert surface.points == pytest.approx(geometry.xyz[:, columns], abs=1e-12)
    assert surface.extent == pytest.approx(
        np.stack([geometry.xyz[:, columns].min(axis=0), geometry.xyz[:, columns].max(axis=0)], axis=1)
    )
    measured_shapes = np.real(model.shapes)
    assert np.linalg.norm(surface.values(surface.points) - measured_shapes) < 0.01 * np.linalg.norm(measured_shapes)


@pytest.mark.parametrize("degrees", [1, 30, 44, 45, 46, 60, 89, 135])
def test_heights_on_a_slanted_plate_count_upward_or_to_the_back(plate, degrees):
    """The second axis has a positive largest component, the first is x; at 45 deg rounding decides nothing."""
    slope = np.radians(degrees)
    second, normal = np.array([0, np.cos(slope), np.sin(slope)]), np.array([0, -np.sin(slope), np.cos(slope)])
    for change in (0.0, 1e-12, -1e-12):
        model, geometry = measured(plate, 0.0, turned=np.stack([[1.0, change, 0.0], second, normal], axis=1))
        axes = shapes.smooth(model, geometry).axes
        assert axes[0] == pytest.approx([1, 0, 0], abs=1e-9)
        assert axes[1] == pytest.approx(second * (1 if second[1] > -second[2] + 1e-9 else -1), abs=1e-9)


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


@pytest.mark.parametrize("counts", [(3, 2), (4, 2), (3, 3), (5, 2), (10, 2), (6, 3)])
@pytest.mark.parametrize("width", [0.8, 0.1])
def test_few_points_have_wide_bounds_but_no_endless_ones(counts, width):
    """A quadratic shape with 1 % noise on 6 to 20 points: what is stated is of the size of the shape, and holds it."""
    x, y = (
        p.ravel() for p in np.meshgrid(*(np.linspace(0, s, n) for s, n in zip((1.0, width), counts)), indexing="ij")
    )
    dofs = tuple(Dof(node, "+Z") for node in range(len(x)))
    inside = []
    for seed in range(20):
        noise = 0.01 * np.random.default_rng(seed).standard_normal(len(x))
        values = (1 + x + x**2 + 0.5 * x * y / width + noise)[:, None].astype(complex)
        model = ModalModel(poles_from(np.array([40.0]), np.array([0.01])), values, dofs, values[:1], dofs[:1])
        surface = smooth_of(model, x, y)
        places = np.random.default_rng(seed).uniform([0, 0], [1, width], (30, 2))
        exact = 1 + places[:, 0] + places[:, 0] ** 2 + 0.5 * places[:, 0] * places[:, 1] / width
        stated = surface.std(places)[:, 0]
        assert np.all(stated < 10)
        inside.append(np.mean(np.abs(surface.values(places)[:, 0] - exact) < 2.6 * stated))
    assert np.mean(inside) > 0.8
