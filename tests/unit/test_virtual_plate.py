"""The Ritz plate against published eigenvalues of the free square plate."""

import numpy as np
import pytest

from ema.datasets.free_plate import BendingStiffness, free_plate


def test_free_square_plate_has_the_published_eigenvalues():
    """Leissa (1973), free square plate, nu = 0.3: omega a^2 sqrt(rho h / D)."""
    plate = free_plate(1.0, 1.0, 1.0, BendingStiffness(1.0), modes=5)
    published = np.array([13.468, 19.596, 24.270, 34.801, 34.801])
    assert 2 * np.pi * plate.natural_frequencies == pytest.approx(published, rel=1e-3)


def test_shapes_have_unit_modal_mass_and_slopes_are_their_derivatives():
    plate = free_plate(0.9, 0.5, 130.0, BendingStiffness(4e6, 1.5, 1.5, 0.26), modes=8)
    u, w = np.polynomial.legendre.leggauss(20)
    x, y = (g.ravel() for g in np.meshgrid(0.45 * (u + 1), 0.25 * (u + 1), indexing="ij"))
    weights = np.outer(w, w).ravel() / 4
    shapes = plate.shapes(x, y)
    assert np.allclose(130 * shapes.T @ (weights[:, None] * shapes), np.eye(8), atol=1e-9)
    step = 1e-6
    numeric = (plate.shapes(x + step, y) - plate.shapes(x - step, y)) / (2 * step)
    assert np.allclose(plate.slopes(x, y), numeric, atol=1e-6 * np.abs(numeric).max())
