"""Nouns with known content, for writing and reading back."""

import numpy as np

from ema.data import Channel, FrfSet, Geometry, ModalModel, Recording, poles_from
from ema.dof import Dof


def frf_set(lines: int = 101, quantity: str = "accelerance", unit: str = "(m/s^2)/N", seed: int = 1) -> FrfSet:
    random = np.random.default_rng(seed)
    outputs = (Dof(1, "+Z"), Dof(2, "-Y"), Dof(3, "S"))
    inputs = (Dof(7, "-X"), Dof(2, "+RY", "beam"))
    values = random.normal(size=(lines, 3, 2)) + 1j * random.normal(size=(lines, 3, 2))
    coherence = random.uniform(size=(lines, 3, 2))
    return FrfSet(
        0.25 * np.arange(lines),
        values,
        outputs,
        inputs,
        quantity,
        unit,
        coherence=coherence,
        estimator="H1",
        name="run 1",
    )


def recording(rate: float = 51200.0, dtype: type = np.float64, seed: int = 2) -> Recording:
    signals = np.random.default_rng(seed).normal(size=(3, 1000)).astype(dtype)
    channels = (
        Channel("hammer", Dof(3, "-Z"), "force", "reference", "N"),
        Channel("acc 1", Dof(4, "+X"), "acceleration", "response", "m/s^2"),
        Channel("bare", Dof(5, "+Y"), "unstated", "response"),
    )
    return Recording(signals, rate, channels, name="take 1")


def geometry() -> Geometry:
    xyz = np.random.default_rng(3).normal(size=(5, 3))
    turned = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    axes = np.stack([np.eye(3), np.eye(3), turned, turned, np.eye(3)])
    return Geometry(np.array([1, 2, 3, 4, 12]), xyz, ((1, 2, 3), (4, 12)), ((1, 2, 3, 4), (3, 4, 12)), axes)


def modal_model(real: bool = False) -> ModalModel:
    random = np.random.default_rng(4)
    poles = poles_from(np.array([99.5, 1234.5678]), np.array([0.01, 0.0023]))
    shapes = random.normal(size=(5, 2)) + (0j if real else 0.3j * random.normal(size=(5, 2)))
    dofs = (Dof(1, "+Z"), Dof(2, "+Z"), Dof(3, "+X"), Dof(3, "+Z"), Dof(4, "+Y"))
    participation = shapes[:2] / (2j * poles.imag)
    return ModalModel(poles, shapes, dofs, participation, dofs[:2], scaling="unit modal mass", name="modes")
