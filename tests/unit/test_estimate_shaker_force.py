"""Force level at resonance, drop-out, mount mass, and level control."""

import numpy as np
import pytest

from ema import estimate, synthesis
from ema.data import Channel, FrfSet, ModalModel, Recording
from ema.data.modal import poles_from
from ema.dof import Dof
from ema.errors import InputError

RATE, NATURAL, DAMPING = 4096.0, 499.0, 0.0064


def swept(dip=0.0, seconds=16.0, low=400.0, high=600.0, harmonics=0.0, noise=0.0):
    t = np.arange(int(seconds * RATE)) / RATE
    at = low + (high - low) * t / seconds
    amplitude = 20 * (1 - dip / (1 + ((at - NATURAL) / (DAMPING * NATURAL)) ** 2))
    phase = 2 * np.pi * (low * t + (high - low) * t**2 / (2 * seconds))
    force = amplitude * np.sin(phase) + harmonics * np.sin(3 * phase)
    force = force + noise * np.random.default_rng(0).standard_normal(len(t))
    return Recording(
        np.stack([force, 0 * force]),
        RATE,
        (Channel("shaker", role="reference", quantity="force", unit="N"), Channel("acc")),
        name="sweep 3",
    )


def test_level_and_dropout_of_a_sweep():
    flat = estimate.force_at_resonance(swept(), NATURAL, DAMPING)
    assert flat.level == pytest.approx(20, rel=0.005)
    assert flat.dropout == pytest.approx(1, abs=0.005)
    assert not flat.findings
    dropped = estimate.force_at_resonance(swept(0.4, noise=0.3), NATURAL, DAMPING)
    core = np.linspace(-1, 1, 201)
    assert dropped.level == pytest.approx(20 * (1 - 0.4 * np.mean(1 / (1 + core**2))), rel=0.02)
    assert dropped.findings[0].code == "force-dropout"


def test_what_is_no_sweep_through_the_mode_is_refused():
    with pytest.raises(InputError, match="does not pass"):
        estimate.force_at_resonance(swept(), 900.0, DAMPING)
    with pytest.raises(InputError, match="one force channel"):
        estimate.force_at_resonance(Recording(np.zeros((1, 99)), RATE, (Channel("a"),)), NATURAL, DAMPING)
    with pytest.raises(InputError, match="not a mode"):
        estimate.force_at_resonance(swept(), NATURAL, 0.0)


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
def test_mount_mass_is_taken_off_exactly(quantity):
    mass, drive, far = 0.3, Dof(1, "+Z"), Dof(2, "-Z")
    poles = poles_from(np.array([80.0, 210.0]), np.array([0.01, 0.02]))
    shapes = np.array([[0.8, 0.5], [-0.3, 0.9]], complex)
    model = ModalModel(poles, shapes, (drive, far), shapes[:1] / (2j * poles.imag), (drive,), scaling="unit modal mass")
    lines = np.arange(5.0, 300.0, 0.5)
    true = synthesis.frfs(model, lines, quantity)
    accelerance = synthesis.frfs(model, lines, "accelerance").values[:, 0, 0]
    # the cell reads F + m a while F acts on the structure
    loaded = FrfSet(
        lines, true.values / (1 + mass * accelerance)[:, None, None], true.outputs, true.inputs, quantity, true.unit
    )
    cleaned = estimate.without_mount_mass(loaded, mass, "1:+Z")
    assert cleaned.values == pytest.approx(true.values, rel=1e-9)
    with pytest.raises(InputError, match="drive point"):
        estimate.without_mount_mass(loaded, mass, "2:+Z")
    with pytest.raises(InputError, match="not a mass"):
        estimate.without_mount_mass(loaded, -1.0, "1:+Z")


def test_mount_masses_of_shakers_that_act_together_are_taken_off_exactly():
    """The structure moves by A (F - m a_d): with a mass at each drive point it answers to the read forces by
    A (I + m A_dd)^-1. One sensor looks against its force; the variances are those of drawn errors."""
    rng, mass = np.random.default_rng(20261127), 0.2
    dofs = (Dof(1, "+Z"), Dof(2, "-Z"), Dof(3, "+X"))
    forces = (dofs[0], Dof(2, "+Z"))
    lines, rows = np.arange(20.0, 300.0, 1.0), np.array([0, 1])
    true = rng.normal(size=(len(lines), 3, 2)) + 1j * rng.normal(size=(len(lines), 3, 2))
    along = true[:, rows] * np.array([1.0, -1.0])[:, None]
    read = true @ np.linalg.inv(np.eye(2) + mass * along)
    loaded = FrfSet(lines, read, dofs, forces, "accelerance", "m/s^2/N", variance=np.full(read.shape, 1e-6))
    cleaned = estimate.without_mount_mass(loaded, mass, forces)
    assert cleaned.values == pytest.approx(true, rel=1e-9)
    errors = np.sqrt(0.5e-6) * (rng.normal(size=(4000, *read.shape)) + 1j * rng.normal(size=(4000, *read.shape)))
    noisy = read[7] + errors[:, 7]
    turned = np.linalg.inv(np.eye(2) - mass * np.array([1.0, -1.0])[:, None] * noisy[:, rows])
    drawn = np.var(noisy @ turned, axis=0)
    assert cleaned.variance[7] == pytest.approx(drawn, rel=0.1)


def test_level_is_reached_in_few_measurements():
    rng = np.random.default_rng(1)
    for _ in range(50):
        dip, power = rng.uniform(0.2, 1.2), rng.uniform(0.6, 1.4)

        def measure(command, dip=dip, power=power):
            return dip * 20 * (command / 20) ** power * (1 + 0.005 * rng.standard_normal())

        command, levels = estimate.control_level(measure, 30.0)
        assert len(levels) <= 6
        assert levels[-1] == pytest.approx(30, rel=0.05)
        # the level itself is within what a measurement may be off, three times 0.5 %
        assert dip * 20 * (command / 20) ** power == pytest.approx(30, rel=0.05 + 0.015)
    with pytest.raises(InputError, match="not reached"):
        estimate.control_level(lambda command: 10.0 if command < 25 else 60.0, 30.0)
    with pytest.raises(InputError, match="no level"):
        estimate.control_level(lambda command: float("nan"), 30.0)
