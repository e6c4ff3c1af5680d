"""Small systems with exact FRFs: the ground of the tests of the fit."""

from dataclasses import replace

import numpy as np

from ema import synthesis
from ema.data import FrfSet, ModalModel, poles_from
from ema.dof import Dof


def model(
    frequencies: list[float],
    damping: list[float],
    dofs: int = 12,
    drive: tuple[int, ...] = (0,),
    seed: int = 0,
    phase: float = 0.0,
) -> ModalModel:
    """Unit modal mass; ``drive`` are the rows that are references too; ``phase`` (rad) turns components at random."""
    rng = np.random.default_rng([3, seed])
    poles = poles_from(np.array(frequencies), np.array(damping))
    x = (np.arange(dofs)[:, None] + 0.5) / dofs
    shapes = np.cos(np.pi * x * np.arange(1, len(poles) + 1)) + 0.15 * rng.standard_normal((dofs, len(poles)))
    shapes = shapes * np.exp(1j * phase * rng.standard_normal(shapes.shape))
    points = tuple(Dof(node, "+Z") for node in range(1, dofs + 1))
    return ModalModel(
        poles,
        shapes,
        points,
        shapes[list(drive)] / (2j * poles.imag),
        tuple(points[row] for row in drive),
        scaling="unit modal mass",
    )


def frfs(
    truth: ModalModel,
    low: float,
    high: float,
    lines: int,
    noise: float = 0.0,
    seed: int = 0,
    quantity: str = "accelerance",
) -> FrfSet:
    """FRFs of a model; ``noise`` is the complex standard deviation over the rms of each FRF."""
    exact = synthesis.frfs(truth, np.linspace(low, high, lines), quantity)
    exact = replace(exact, name="rig")
    if not noise:
        return exact
    rng = np.random.default_rng([4, seed])
    std = noise * np.sqrt(np.mean(np.abs(exact.values) ** 2, axis=0))
    draw = np.sqrt(0.5) * (rng.standard_normal(exact.values.shape) + 1j * rng.standard_normal(exact.values.shape))
    return replace(exact, values=exact.values + std * draw)


def transposed(measured: FrfSet) -> FrfSet:
    """The same test with a roving hammer."""

    def turn(array: np.ndarray | None) -> np.ndarray | None:
        return None if array is None else array.transpose(0, 2, 1)

    return replace(
        measured,
        values=measured.values.transpose(0, 2, 1),
        outputs=measured.inputs,
        inputs=measured.outputs,
        coherence=turn(measured.coherence),
        variance=turn(measured.variance),
    )


def mac(a: np.ndarray, b: np.ndarray) -> float:
    return float(abs(np.vdot(a, b)) ** 2 / (np.vdot(a, a).real * np.vdot(b, b).real))
