"""Shapes over the amplitude from ring-downs, against the nonlinear modes of the simulator (extended periodic motion)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema import store
from ema.compare.amplitude_resolved import RingDownMode, ring_down_modes
from ema.data import BeamModel, Channel, Condition, Damping, Excitation, FrictionLaw, Joint, Matrices, Run
from ema.dof import Dof
from ema.simulate import FrictionRig, RovingHammer, backbone

OMEGA = 2 * np.pi * 300.0
PEAKS = (300.0, 600.0, 900.0)


@pytest.fixture(scope="module")
def model() -> BeamModel:
    """Two masses of 10 kg on springs, joined by a third; the first rubs against a wall. Sliding, it comes close to the
    second in frequency, so that the modes mix twice as much as they do sticking."""
    k = 10 * OMEGA**2
    stiffness = np.array([[1.15 * k, -0.15 * k, 0], [-0.15 * k, 0.75 * k, 0], [0, 0, 1e9]])
    host = Matrices(np.diag([10.0, 10.0, 1e-3]), stiffness, (Dof(1, "+X"), Dof(2, "+X"), Dof(1, "+Z")))
    wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall")))
    law = FrictionLaw("masing", 1.0, 0.3 * k)
    return BeamModel(host, wall, (Joint("contact", ((1, 1),), (0.0, 0.0), law, 20.0, 1.0),), Damping(ratio=0.004))


@pytest.fixture(scope="module")
def resolved(model: BeamModel) -> tuple[RingDownMode, ...]:
    """Impacts of three levels on both masses, three each, 0.3 % of noise."""
    points = (Dof(1, "+X"), Dof(2, "+X"))
    sensors = tuple(Channel(f"acc {dof.node}", dof, "acceleration", unit="m/s^2") for dof in points)
    rng, records = np.random.default_rng(12), []
    for seed, peak in enumerate(PEAKS):
        hammer = RovingHammer(points * 3, 1, peak, 0.05, 1e-3, 0.05, 0.05, 1.2)
        rig = FrictionRig(model, hammer, sensors, 4096.0, seed=seed)
        records += [rig.take(number) for number in range(6)]
    std = 0.003 * np.std([record.signals[:, 300:800] for record in records], axis=(0, 2))
    noisy = tuple(
        replace(one, signals=one.signals + std[:, None] * rng.normal(size=one.signals.shape)) for one in records
    )
    return ring_down_modes(Run("two masses", Condition(Excitation("hammer")), noisy), (180.0, 480.0))


def test_shapes_follow_the_nonlinear_modes(model, resolved):
    """Of all shapes at all amplitudes 90 % of the intervals or more hold the truth, and MAC is 0.98 or more, 0.999 in
    the median; for one mode
    the shape at the highest amplitude is not that at small ones, beyond both intervals."""
    assert len(resolved) == 2
    inside, moved = [], []
    for found, near in zip(resolved, (260.0, 360.0), strict=True):
        mode = found.mode
        truth = backbone(model, np.geomspace(1e-6, 2e-3, 90), near=near, outputs=["1:+X", "2:+X"])
        row = int(np.argmin(np.abs(mode.shape[:, 0] - 1)))
        reached = truth.amplitudes * np.abs(truth.shapes[row]) * (2 * np.pi * truth.frequencies) ** 2
        ratio = truth.shapes[1 - row] / truth.shapes[row]
        log = np.log(mode.amplitude), np.log(reached)
        true = np.interp(*log, ratio.real) + 1j * np.interp(*log, ratio.imag)
        off, reach = mode.shape[1 - row] - true, mode.shape_half[1 - row]
        inside += [*(np.abs(off.real) <= reach), *(np.abs(off.imag) <= reach)]
        both = np.array([np.ones(len(true)), true])
        read = np.array([np.ones(len(true)), mode.shape[1 - row]])
        mac = np.abs(np.sum(both.conj() * read, 0)) ** 2 / np.sum(np.abs(both) ** 2, 0) / np.sum(np.abs(read) ** 2, 0)
        assert mac.min() >= 0.98 and np.median(mac) >= 0.999
        best = int(np.argmin(reach[: len(reach) // 2]))
        moved.append(abs(mode.shape[1 - row, -1] - mode.shape[1 - row, best]) / (reach[best] + reach[-1]))
    assert np.mean(inside) >= 0.9 and max(moved) > 2


def test_shapes_are_stored_and_cut_with_the_levels(resolved, tmp_path: Path):
    mode = resolved[0].mode
    store.save(tmp_path / "mode.h5", mode)
    again = store.load(tmp_path / "mode.h5")
    assert again.dofs == mode.dofs and np.array_equal(again.shape, mode.shape)
    assert mode.lowest(2).shape.shape == (2, 2)
