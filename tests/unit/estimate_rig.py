"""A small structure with known modes and the campaigns that the estimation tests measure on it."""

import numpy as np

from ema.data import Channel, Condition, ModalModel, Recording, Run, poles_from
from ema.dof import Dof
from ema.simulate import RandomShakers, RovingHammer, SweptShaker, VirtualRig

DOFS = tuple(Dof(node, "+Z") for node in range(1, 5))


def structure(frequencies=(100.0, 160.0, 431.0, 900.0), damping=(0.02, 0.015, 0.01, 0.008)) -> ModalModel:
    rng = np.random.default_rng(3)
    poles = poles_from(np.array(frequencies), np.array(damping))
    shapes = rng.normal(size=(4, len(poles))) * 0.1
    return ModalModel(
        poles, shapes.astype(complex), DOFS, shapes[:2] / (2j * poles.imag), DOFS[:2], scaling="unit modal mass"
    )


def truth(model: ModalModel, frequencies, outputs, inputs, added_decay=0.0):
    """Accelerance at ``j w + added_decay``: what an exponential window on both channels leaves."""
    s = 2j * np.pi * frequencies + added_decay
    total = np.zeros((len(s), len(outputs), len(inputs)), complex)
    for r, pole in enumerate(model.poles):
        residue = np.outer(model.shapes[outputs, r], model.shapes[inputs, r]) / (2j * pole.imag)
        total += residue / (s - pole)[:, None, None] + residue.conj() / (s - pole.conj())[:, None, None]
    return total * (s**2)[:, None, None]


def accelerometers(count=2, **more):
    return tuple(Channel(f"acc {n + 1}", DOFS[n], quantity="acceleration", unit="m/s^2", **more) for n in range(count))


def hammer_rig(model=None, rate=5120.0, noise=0.0, points=DOFS, **drive) -> VirtualRig:
    return VirtualRig(
        model or structure(),
        RovingHammer(points, **drive),
        accelerometers(),
        rate,
        noise={"acceleration": 0.02 * noise, "force": 0.3 * noise},
    )


def shaker_rig(model=None, seconds=16.0, noise=0.0, band=(5.0, 500.0)) -> VirtualRig:
    return VirtualRig(
        model or structure(),
        RandomShakers(DOFS[:2], 10.0, band, seconds),
        accelerometers(4),
        1024.0,
        noise={"acceleration": noise},
    )


def sweep_rig(noise=0.0) -> VirtualRig:
    drive = SweptShaker(DOFS[0], 5.0, (20.0, 480.0), 4.0, 6.0, takes=3)
    return VirtualRig(structure(), drive, accelerometers(), 2048.0, noise={"acceleration": noise})


def run_of(recordings, name="test") -> Run:
    return Run(name, Condition(), tuple(recordings))


def error(found, wanted) -> float:
    """Norm of the difference over the norm."""
    return float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))


def recording(signals, rate=5120.0, channels=None, **more) -> Recording:
    """A record of a hammer and accelerometers."""
    signals = np.asarray(signals, float)
    if channels is None:
        hammer = Channel("hammer", DOFS[0], quantity="force", role="reference", unit="N")
        channels = (hammer, *accelerometers(len(signals) - 1))
    return Recording(signals, rate, channels, name="take", **more)
