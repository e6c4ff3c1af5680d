"""A DOF that occurs twice: no value depends on the names, and a finding names it."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import SetUps
from ema.dof import Dof
from ema.fit import modes, stabilise
from tests.unit.fit_rig import frfs, model, transposed


def measured():
    """Five outputs with a stated variance, the last a hundred times as noisy as the others."""
    exact = frfs(model([120.0, 150.0], [0.004, 0.006], dofs=5, drive=(1, 2)), 100, 180, 401)
    level = np.array([0.005, 0.005, 0.005, 0.005, 0.5])[:, None]
    std = np.broadcast_to(level * np.sqrt(np.mean(np.abs(exact.values) ** 2, axis=0)), exact.values.shape)
    real, imaginary = np.random.default_rng(6).standard_normal((2, *std.shape))
    return replace(exact, values=exact.values + std * (real + 1j * imaginary) / np.sqrt(2), variance=std**2)


def renamed(test):
    return replace(test, outputs=(*test.outputs[:4], Dof(1, "+Z")))


def fitted(test):
    return modes(test, stabilise(test, range(4, 25, 4)))


def named(found):
    return [finding.message for finding in found.findings if finding.code == "duplicated-dof"]


@pytest.mark.parametrize("turn", [lambda test: test, transposed], ids=["sensors", "hammer"])
def test_values_and_intervals_do_not_depend_on_the_name(turn):
    one, other = fitted(turn(measured())), fitted(turn(renamed(measured())))
    np.testing.assert_allclose(other.poles, one.poles, rtol=1e-12)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-9)
    np.testing.assert_allclose(other.uncertainty.residues, one.uncertainty.residues, rtol=1e-6)
    assert not named(one)
    (message,) = named(other)
    assert message.startswith("1:+Z occur more than once")


def test_a_dof_that_is_measured_in_each_set_up_is_no_repeated_one():
    number = np.array([[0, 0], [0, 0], [0, 0], [1, 1], [1, 1]])
    assert not named(fitted(replace(renamed(measured()), set_ups=SetUps(("A", "B"), number))))


def test_set_ups_that_share_a_dof_are_moved_each_by_itself():
    """The second set-up is 1 % higher in frequency."""
    at = {"damping": [0.004, 0.006], "dofs": 8, "drive": (1, 2)}
    low, high = (frfs(model([120.0 * k, 150.0 * k], **at), 100, 180, 401, noise=0.002) for k in (1.0, 1.01))
    values = np.concatenate([low.values[:, :4], high.values[:, 4:]], axis=1)
    number = np.repeat([[0, 0], [1, 1]], 4, axis=0)
    test = replace(low, values=values, set_ups=SetUps(("A", "B"), number))
    same = replace(test, outputs=(*test.outputs[:7], test.outputs[0]))
    one, other = fitted(test), fitted(same)
    np.testing.assert_allclose(other.poles, one.poles, rtol=1e-7)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-3)
