"""Loops from records: the energy of a Jenkins element, the channels, and the bad inputs."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import Channel, Recording
from ema.errors import InputError
from ema.estimate import measured_loop

REACH, STIFFNESS, SLIP, RATE = 2e-5, 2e7, 100.0, 10_000.0
AREA = 4 * SLIP * (REACH - SLIP / STIFFNESS)


def record(cycles: float = 12.3, frequency: float = 37.0, noise: float = 0.0, offset: float = 0.0) -> Recording:
    """A Jenkins element moved by a sine, an exciting force and the normal force beside it."""
    t = np.arange(round(RATE * cycles / frequency)) / RATE
    x = REACH * np.sin(2 * np.pi * frequency * t)
    force, held = np.zeros(len(t)), 0.0
    for k in range(1, len(t)):
        held = float(np.clip(held + STIFFNESS * (x[k] - x[k - 1]), -SLIP, SLIP))
        force[k] = held
    rng = np.random.default_rng(3)
    signals = np.stack(
        [
            10 * x / REACH,
            x + offset + noise * REACH * rng.normal(size=len(t)),
            force + noise * SLIP * rng.normal(size=len(t)),
            500 + rng.normal(size=len(t)),
        ]
    )
    channels = (
        Channel("shaker", quantity="force", unit="N", role="reference"),
        Channel("slip", quantity="displacement", unit="m"),
        Channel("cell", quantity="force", unit="N"),
        Channel("ring", quantity="force", unit="N", role="normal force", joint="J1"),
    )
    return Recording(signals, RATE, channels, name="joint")


@pytest.mark.parametrize("cycles", [3.4, 12.3, 50.4])
def test_energy_per_cycle_is_that_of_the_element(cycles):
    found = measured_loop(record(cycles))
    # the first quarter of the first cycle starts in the middle of the loop
    assert found.area == pytest.approx(AREA, rel=0.08 if cycles < 5 else 0.02)
    assert found.cycles == int(cycles - 0.01)
    assert found.amplitude == pytest.approx(REACH, rel=1e-3)
    assert found.normal_force == pytest.approx(500, abs=0.5)


def test_noise_and_offset_do_not_bias_the_energy():
    found = measured_loop(record(80.0, noise=0.02, offset=1e-3))
    assert found.area == pytest.approx(AREA, rel=0.02)
    assert abs(found.displacements.mean()) < 1e-12


def test_bad_records_are_refused():
    good = record()
    with pytest.raises(InputError, match=r"too short for a loop; got 1\.[23] cycles"):
        measured_loop(record(1.3))
    with pytest.raises(InputError, match="does not move"):
        measured_loop(replace(good, signals=np.ones_like(good.signals)))
    with pytest.raises(InputError, match="no such displacement; got gap"):
        measured_loop(good, "gap")
    with pytest.raises(InputError, match="this channel is no displacement; got force"):
        measured_loop(good, "cell")
    signals = good.signals.copy()
    signals[2, 5] = np.nan
    with pytest.raises(InputError, match="NaN"):
        measured_loop(replace(good, signals=signals))
