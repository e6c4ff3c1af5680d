"""An output of noise alone: the modes that the others show stay, in any unit, and a finding names it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ema.fit import modes, stabilise
from ema.fit.uncertainty import _Errors, _scatter
from tests.unit.fit_rig import frfs, model

STANDARD_GRAVITY = 9.80665


def four():
    return model([30.0, 55.0, 110.0, 180.0], [0.012, 0.01, 0.005, 0.008], dofs=6, seed=3)


@cache
def fitted(size=0.0, unit=1.0):
    """Modes with noise of 1 %; the fourth output is noise of ``size`` over the rms of all FRFs, and in a unit."""
    measured = frfs(four(), 20, 260, 481, noise=0.01)
    values = np.array(measured.values)
    if size:
        real, imaginary = np.random.default_rng(4).standard_normal((2, *values[:, 3].shape))
        rms = np.sqrt(np.mean(np.abs(values) ** 2))
        values[:, 3] = unit * size * rms * (real + 1j * imaginary) / np.sqrt(2)
    measured = replace(measured, values=values)
    return modes(measured, stabilise(measured))


def named(found):
    return [finding.message for finding in found.findings if finding.code == "dof-without-modes"]


@pytest.mark.parametrize("size", [0.3, 1.0, 3.0])
def test_an_output_of_noise_takes_no_mode_away(size):
    found = fitted(size)
    np.testing.assert_allclose(found.natural_frequencies, four().natural_frequencies, rtol=1e-3)
    std = np.sqrt(np.trace(found.uncertainty.shapes[:, 3], axis1=1, axis2=2))
    assert np.all(np.abs(found.shapes[3]) < 4 * std)
    (message,) = named(found)
    assert "1 of 6 DOFs" in message and "(4:+Z)" in message


def test_the_unit_of_such_an_output_does_not_matter():
    one, other = fitted(1.0), fitted(1.0, 1 / STANDARD_GRAVITY)
    np.testing.assert_allclose(other.poles, one.poles, rtol=1e-9)
    np.testing.assert_allclose(other.confidence, one.confidence, rtol=1e-6)
    assert named(other) == named(one)


def test_outputs_that_follow_the_modes_are_not_named():
    assert len(fitted().poles) == 4
    assert not named(fitted())


def errors(own, unit=1.0):
    """Errors of a shape of six outputs: those that two causes make together, and ``own`` of each."""
    rng = np.random.default_rng(5)
    psi, shared = rng.standard_normal(6) + 0j, 0.1 * (rng.standard_normal((6, 2)) + 1j * rng.standard_normal((6, 2)))
    unit = np.broadcast_to(unit, 6)
    alone = np.sqrt(0.5) * np.broadcast_to(own, 6)[:, None] * np.array([1, 1j])
    nothing = np.zeros(2, complex)
    return unit * psi, _Errors(nothing, nothing[None], unit[:, None] * shared, unit[:, None] * alone)


def test_for_outputs_that_are_as_noisy_scatter_is_the_variance_across_the_shape_over_its_energy():
    psi, found = errors(0.2)
    across = np.eye(6) - np.outer(psi, psi.conj()) / np.vdot(psi, psi).real
    covariance = found.shape @ found.shape.conj().T + 0.2**2 * np.eye(6)
    expected = np.trace(across @ covariance).real / np.vdot(psi, psi).real
    assert _scatter(psi, found) == pytest.approx(expected, rel=1e-12)


def test_scatter_does_not_depend_on_the_units_of_outputs():
    own = np.array([0.1, 0.2, 0.1, 0.3, 0.2, 0.1])
    unit = np.array([1.0, 1e3, STANDARD_GRAVITY, 1e-6, 1.0, 25.4])
    assert _scatter(*errors(own, unit)) == pytest.approx(_scatter(*errors(own)), rel=1e-9)


def test_noise_of_an_output_without_signal_adds_the_share_of_one_output():
    """Beside clean ones it is a small share, however large it is."""
    own = np.full(6, 0.01)
    own[3] = 1e3
    psi, found = errors(own)
    psi[3], found.shape[3] = 0, 0
    assert _scatter(psi, found) < 1.5 * _scatter(*errors(0.01)) + 1e-3
