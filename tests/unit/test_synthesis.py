"""A modal model against the closed form of one oscillator, and conversion between FRF quantities."""

import numpy as np
import pytest

from ema import synthesis
from ema.data import ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError


def oscillator(mass=2.0, frequency=50.0, damping=0.02):
    pole = poles_from(np.array([frequency]), np.array([damping]))
    shape = np.array([[1 / np.sqrt(mass)]], complex)
    return ModalModel(
        pole, shape, (Dof(1, "+Z"),), shape / (2j * pole.imag), (Dof(1, "+Z"),), scaling="unit modal mass"
    )


def test_receptance_of_one_oscillator():
    mass, f0, zeta = 2.0, 50.0, 0.02
    f = np.linspace(0, 120, 241)
    w, w0 = 2 * np.pi * f, 2 * np.pi * f0
    exact = 1 / (mass * (w0**2 - w**2 + 2j * zeta * w0 * w))
    found = synthesis.frfs(oscillator(mass, f0, zeta), f)
    np.testing.assert_allclose(found.values[:, 0, 0], exact, rtol=1e-12)
    assert found.unit == "m/N"


def test_reversed_dof_changes_the_sign():
    f = np.array([10.0, 20.0])
    plus = synthesis.frfs(oscillator(), f)
    minus = synthesis.frfs(oscillator(), f, outputs=[Dof(1, "-Z")])
    np.testing.assert_allclose(minus.values, -plus.values, rtol=1e-14)


@pytest.mark.parametrize("quantity", ["mobility", "accelerance"])
def test_conversion_round_trip(quantity):
    frfs = synthesis.frfs(oscillator(), np.linspace(1, 100, 100))
    back = synthesis.convert(synthesis.convert(frfs, quantity), "receptance")
    np.testing.assert_allclose(back.values, frfs.values, rtol=1e-12)
    np.testing.assert_allclose(
        synthesis.convert(frfs, quantity).values,
        synthesis.frfs(oscillator(), frfs.frequencies, quantity).values,
        rtol=1e-12,
    )


def test_missing_dof_is_refused():
    with pytest.raises(InputError, match="does not hold"):
        synthesis.frfs(oscillator(), np.array([1.0]), outputs=[Dof(7, "+X")])
