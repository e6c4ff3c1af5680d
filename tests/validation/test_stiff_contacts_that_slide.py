"""Structures that slide on contacts much stiffer than themselves, with damping in proportion to their mass.

Between two turning points a mass on a spring that rubs against a wall moves as x - d with d = F_C/k to either side (Den
Hartog, Mechanical Vibrations, section 8.6); viscous damping c = 2 zeta sqrt(k m) takes exp(-pi zeta/sqrt(1 - zeta^2)).
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.simulate import Coulomb, Masing, frf, snapback

MASS, STIFFNESS, ZETA = 2.3, 2.3 * (2 * np.pi * 37.0) ** 2, 0.012


def slider(law, normal_force):
    """A mass on a spring that rubs against a wall."""
    host = Matrices(np.diag([MASS, MASS]), np.diag([STIFFNESS, 1e10]), (Dof(1, "+X"), Dof(1, "+Z")))
    wall = Matrices(np.diag([1e4, 1e4]), np.diag([1e17, 1e17]), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall")))
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, normal_force, 1.0)
    return BeamModel(host, wall, (joint,), Damping(mass_factor=2 * ZETA * np.sqrt(STIFFNESS / MASS)), "slider")


@pytest.mark.parametrize("law", [Coulomb(0.5), Masing(0.5, 3e4 * STIFFNESS)], ids=["rigid", "stiff"])
def test_turning_points_of_a_free_decay(law):
    slip_force, load = 0.5 * 24.0, 900.0
    run = snapback(slider(law, 24.0), load, "1:+X", 0.06, ["1:+X"], 20000.0)
    x = np.asarray(run.displacements)[0]
    ends = np.flatnonzero((np.diff(x)[1:] * np.diff(x)[:-1]) < 0) + 1
    offset, left = slip_force / STIFFNESS, np.exp(-np.pi * ZETA / np.sqrt(1 - ZETA**2))
    height, expected = abs(x[0]), []
    for _ in range(3):
        height = left * (height - offset) - offset
        expected.append(height)
    assert np.abs(x[ends[:3]]) == pytest.approx(expected, rel=2e-3)


def test_resonance_of_a_mass_that_slides_on_a_rigid_contact():
    """At the peak of a structure that slides nearly all the time, against the equation of motion by LSODA."""
    slip_force, force, omega = 0.5 * 24.0, 150.0, np.sqrt(STIFFNESS / MASS)
    response = frf(slider(Coulomb(0.5), 24.0), np.array([omega / (2 * np.pi)]), force, "1:+X", ["1:+X"])

    def rate(t, y):
        lost = 2 * ZETA * np.sqrt(STIFFNESS * MASS) * y[1] + slip_force * np.tanh(y[1] / 1e-3)
        return y[1], (force * np.cos(omega * t) - lost - STIFFNESS * y[0]) / MASS

    top = (force - 4 / np.pi * slip_force) / (2 * ZETA * STIFFNESS)
    period = 2 * np.pi / omega
    times = 80 * period + np.linspace(0, period, 257)[:-1]
    run = solve_ivp(rate, (0, times[-1]), [0.0, top * omega], "LSODA", times, rtol=1e-9, atol=1e-12)
    first = 2 * np.mean(run.y[0] * np.exp(-1j * omega * times))
    assert abs(response.values[0, 0, 0] - first) < 0.01 * abs(first)


@pytest.mark.parametrize("draw", range(6))
def test_stiff_contacts_that_let_go_at_once(draw):
    """From just above the slip force: the stuck motion is micrometres, the sliding one centimetres, nothing between."""
    rng = np.random.default_rng([37, draw])
    law = Coulomb(0.5) if draw % 2 else Masing(0.5, STIFFNESS * 10 ** rng.uniform(1.5, 5))
    force, frequency = 12.0 * 10 ** rng.uniform(0.1, 1.5), 37.0 * rng.uniform(0.7, 1.3)
    response = frf(slider(law, 24.0), np.array([frequency]), force, "1:+X", ["1:+X"])
    assert response.converged[0] and response.error_estimate[0] < 0.05
    assert response.power_error < 1e-5
