"""Rigid-body modes from the mass or from the mass lines of a test."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import Geometry, ModalModel, Residuals, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.shapes import smooth, with_rigid_body

MASS, SIDES, CENTRE, GYRATION = 130.0, np.array([0.9, 0.5]), np.array([0.5, 0.22]), np.array([0.24, 0.16])


def points() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, SIDES[0], 8), np.linspace(0, SIDES[1], 5))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def moved(at: np.ndarray, centre=CENTRE, gyration=GYRATION) -> np.ndarray:
    return np.hstack([np.ones((len(at), 1)), (at - centre) / gyration]) / np.sqrt(MASS)


def hung(noise: float = 0.0, references=(0, 39), turned: bool = False) -> tuple[ModalModel, Geometry]:
    """One elastic mode above, and the mass lines of a body; hammer points against the normal if ``turned``."""
    at, sign = points(), -1.0 if turned else 1.0
    dofs = tuple(Dof(node, "-Z" if turned else "+Z") for node in range(1, len(at) + 1))
    inputs = tuple(Dof(row + 1, "+Z") for row in references)
    lines = sign * moved(at) @ moved(at[list(references)]).T
    lines = lines + noise * np.abs(lines).max() * np.random.default_rng(3).standard_normal(lines.shape)
    shape = sign * np.cos(np.pi * at[:, :1] / SIDES[0]) / np.sqrt(MASS)
    poles = poles_from(np.array([500.0]), np.array([0.006]))
    model = ModalModel(
        poles,
        shape.astype(complex),
        dofs,
        sign * shape[list(references)] / (2j * poles.imag),
        inputs,
        Residuals(lines.astype(complex), np.zeros(lines.shape, complex)),
        "unit modal mass",
        name="table",
    )
    return model, Geometry(np.arange(1, len(at) + 1), np.column_stack([at, np.zeros(len(at))]))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("noise", "wrong"), [(0.0, 1e-3), (0.05, 0.06)])
def test_the_body_is_read_from_the_mass_lines(noise, wrong, turned):
    model, geometry = hung(noise, turned=turned)
    whole, (told,) = with_rigid_body(model, geometry)
    true = moved(points()) @ moved(points()).T
    found = whole.shapes[:, -3:].real @ whole.shapes[:, -3:].real.T
    assert told.code == "rigid-body" and np.abs(found - true).max() <= wrong * np.abs(true).max()
    assert whole.natural_frequencies[0] == pytest.approx(500) and whole.natural_frequencies[1:].max() < 10
    again = np.einsum("kr,ir->rki", whole.shapes, whole.participation)[-3:]
    assert np.all(whole.residuals.lower == 0) and np.all(np.isfinite(again))
    assert (
        np.abs(
            np.einsum("rki->ki", again.imag * whole.poles.imag[-3:, None, None]) * -2 - model.residuals.lower.real
        ).max()
        <= (wrong + 3 * noise) * np.abs(true).max()
    )


def test_a_stated_mass_makes_a_uniform_plate():
    model, geometry = hung()
    whole, (told,) = with_rigid_body(model, geometry, MASS)
    expected = moved(points(), SIDES / 2, SIDES / np.sqrt(12))
    assert np.allclose(whole.shapes[:, -3:].real, expected) and "130 kg" in told.message
    surface = smooth(whole, geometry)
    assert np.allclose(surface.values(points())[:, -3:], expected, atol=1e-9)


def test_a_row_of_points_shows_no_rotation_about_itself():
    model, geometry = hung()
    keep = np.flatnonzero(points()[:, 1] == 0)
    row = replace(model, shapes=model.shapes[keep], dofs=tuple(model.dofs[k] for k in keep), residuals=None)
    whole, _ = with_rigid_body(row, geometry, 10.0)
    assert whole.shapes.shape[1] == 3


def test_what_is_no_rigid_body_is_left_alone():
    model, geometry = hung()
    rng = np.random.default_rng(1)
    wrong = replace(model, residuals=replace(model.residuals, lower=rng.normal(size=model.residuals.lower.shape) + 0j))
    for one in (wrong, replace(model, residuals=None)):
        same, (told,) = with_rigid_body(one, geometry)
        assert same is one and told.code == "no-rigid-body" and "Name the mass" in told.advice


def test_bad_input_is_told():
    model, geometry = hung()
    with pytest.raises(InputError, match="not a mass"):
        with_rigid_body(model, geometry, -1.0)
    with pytest.raises(InputError, match="need scaled shapes"):
        with_rigid_body(replace(model, scaling="unscaled"), geometry)


def test_a_release_is_judged_without_the_sway_on_the_suspension():
    from ema import place
    from ema.data import FrictionLaw
    from ema.data.placement import BoltedJoint
    from ema.place.task import without_suspension

    model, geometry = hung()
    whole, _ = with_rigid_body(model, geometry)
    joint = BoltedJoint(FrictionLaw("masing", 0.2, 2e8), 1e9, 0.045)
    task = place.Task(whole, smooth(whole, geometry), joint, "1:+Z", np.array([1.0]), np.array([1.0]), (0,))
    held = without_suspension(task)
    assert held.bare.natural_frequencies == pytest.approx([500.0]) and held.modes == (0,)
    assert held.surface.coefficients.shape[1] == len(held.surface.noise) == 1
    assert np.array_equal(held.bare.shapes, model.shapes)


def test_measured_rigid_body_modes_are_not_added_again():
    model, geometry = hung()
    whole, _ = with_rigid_body(model, geometry, MASS)
    for mass in (None, MASS):
        same, (told,) = with_rigid_body(whole, geometry, mass)
        assert same is whole and told.code == "rigid-body" and "measured" in told.message


def test_the_first_bending_mode_of_a_cantilever_is_no_rigid_body():
    """It is nearly a plane, but its neighbour is only 6.3 times higher."""
    model, geometry = hung()
    x = points()[:, :1] / SIDES[0]
    bent = np.hstack([model.shapes, x**1.7 / np.sqrt(MASS)])
    poles = poles_from(np.array([500.0, 80.0]), np.full(2, 0.006))
    held = replace(model, poles=poles, shapes=bent, participation=bent[[0, 39]] / (2j * poles.imag), residuals=None)
    assert with_rigid_body(held, geometry)[1][0].code == "no-rigid-body"
