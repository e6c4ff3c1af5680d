"""Peaks far narrower than the distance to which a resonance is placed, against closed forms for 1 kg on a wall."""

import numpy as np
import pytest

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.simulate import Masing, resonance, resonances

SPRING, STIFFNESS, SLIP = (2 * np.pi * 50.0) ** 2, 1e5, 30.0


def oscillator(damping):
    """The mass on the wall, with viscous ``damping`` in kg/s."""
    dofs, walls = (tuple(Dof(1, axis, body) for axis in ("+X", "+Z")) for body in ("", "wall"))
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), Masing(0.3, STIFFNESS), SLIP / 0.3, 1.0, directions=("X",))
    host = Matrices(np.eye(2), np.diag([SPRING, 2 * SPRING]), dofs)
    wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), walls)
    return BeamModel(host, wall, (joint,), Damping(mass_factor=damping), "narrow")


@pytest.mark.parametrize("ratio", [3e-4, 2e-5, 1e-6])
def test_a_stuck_joint_leaves_the_peak_of_a_linear_oscillator(ratio):
    """|x| = F / (c sqrt(w0^2 - c^2/4)); at 1e-6 two thirds of it had been missing, with a stated error of 0."""
    stuck = np.sqrt(SPRING + STIFFNESS)
    damping = 2 * ratio * stuck
    force = 0.01 * SLIP * 2 * ratio
    found = resonance(oscillator(damping), force, "1:+X", "1:+X", (30.0, 95.0))
    true = force / (damping * np.sqrt(stuck**2 - damping**2 / 4))
    assert abs(abs(found.amplitude) / true - 1) <= found.error_estimate <= 5e-3
    assert found.damping == pytest.approx(ratio, rel=1e-3 + found.damping_error)
    (again,) = resonances(oscillator(damping), [force], "1:+X", "1:+X", (30.0, 95.0))
    assert abs(abs(again.amplitude) / true - 1) <= again.error_estimate


@pytest.mark.parametrize("ratio", [3e-4, 2e-5])
def test_a_sliding_joint_takes_four_slip_forces_a_cycle(ratio):
    """F > 4 F_C / pi: c w x = F - 4 F_C / pi at the frequency without the joint (Den Hartog 1931), far beyond u_c."""
    free = np.sqrt(SPRING)
    damping = 2 * ratio * free
    found = resonance(oscillator(damping), 2 * SLIP, "1:+X", "1:+X", (30.0, 95.0))
    true = (2 - 4 / np.pi) * SLIP / (damping * free)
    assert abs(abs(found.amplitude) / true - 1) <= found.error_estimate + 4 * SLIP / STIFFNESS / true
    assert found.frequency == pytest.approx(50.0, rel=found.frequency_error)


def two_masses(natural, angle, damping):
    """Two masses, of natural frequencies in Hz without the wall, of which the first one sticks to it."""
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    springs = turned @ np.diag((2 * np.pi * np.asarray(natural)) ** 2) @ turned.T
    dofs = tuple(Dof(node, axis) for axis in ("+X", "+Z") for node in (1, 2))
    walls = tuple(Dof(1, axis, "wall") for axis in ("+X", "+Z"))
    stiffness = np.block([[springs, np.zeros((2, 2))], [np.zeros((2, 2)), 1e8 * np.eye(2)]])
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), Masing(0.3, STIFFNESS), 1e9, 1.0, directions=("X",))
    wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), walls)
    model = BeamModel(Matrices(np.eye(4), stiffness, dofs), wall, (joint,), Damping(mass_factor=damping), "two")
    return model, springs + np.diag([STIFFNESS, 0.0])


@pytest.mark.parametrize("seed", [14, 21, 29])
def test_the_larger_one_of_two_peaks_is_found_though_neither_is_seen_on_the_grid(seed):
    """Of 45 such draws these three had given the lower one."""
    rng = np.random.default_rng([seed, 77])
    natural = rng.uniform(35.0, 80.0, 2)
    damping = 4 * np.pi * 50 * 10 ** rng.uniform(-5, -2)
    model, springs = two_masses(natural, rng.uniform(0.2, 1.4), damping)
    squares, shapes = np.linalg.eigh(springs)
    lines = [w + damping * np.linspace(-2, 2, 4001) for w in np.sqrt(squares)]
    omega = np.concatenate([*lines, 2 * np.pi * np.linspace(25.0, 110.0, 20001)])
    parts = shapes[0] ** 2 / (squares - omega[:, None] ** 2 + 1j * damping * omega[:, None])
    height = np.abs(parts.sum(axis=1))
    found = resonance(model, 1.0, "1:+X", "1:+X", (25.0, 110.0))
    assert abs(found.amplitude) == pytest.approx(height.max(), rel=found.error_estimate + 1e-4)
