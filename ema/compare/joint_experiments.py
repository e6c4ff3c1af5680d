"""Measurements that are yet to be made: what one joint and two, or the laws of a joint, let them read."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.compare.joint_loops import LAWS, harmonic
from ema.compare.joint_model import Draws, JointModel

Outcome = tuple[Callable[[JointModel, Draws], np.ndarray], float]
"""What a measurement reads, of a model and draws of its parameters, and the standard deviation of that."""
_SURE = 0.95
"""Weight of the right hypothesis from which on an outcome has decided."""
_FEW = 50
"""Draws of a law below which its outcomes are not known."""
_CELLS = 200
"""Cells of the histograms of outcomes, over all but a thousandth of them."""


@dataclass(frozen=True)
class Experiment:
    """A measurement that is yet to be made, as one joint and two joints predict it.

    ``separates`` is the share of outcomes, drawn from either, after which the right one has a weight of 0.95.
    """

    name: str
    one: tuple[float, float]
    two: tuple[float, float]
    separates: float


@dataclass(frozen=True)
class LawExperiment:
    """A measurement that is yet to be made, as the laws of the joint predict it.

    Parameters
    ----------
    name : what is measured.
    outcomes : 95 % interval of what is read, by law; laws that too few draws have are left out.
    separates : share of outcomes, drawn from each of these laws as often, after which the right one has a weight of
        0.95; NaN where there is one law at most.
    """

    name: str
    outcomes: dict[str, tuple[float, float]]
    separates: float


@dataclass(frozen=True)
class Weighted:
    """Draws of a model with their weights, which need not add up to one."""

    model: JointModel
    draws: Draws
    weights: Float[np.ndarray, "draw"]


def between_joints(one: Weighted, two: Weighted) -> tuple[Experiment, ...]:
    """Outcomes under one joint and under two, with the noise that they would have; the best experiment first."""
    experiments = []
    for row, (name, (outcome, std)) in enumerate(JOINTS.items()):
        noise = np.random.default_rng(row)
        values = [outcome(each.model, each.draws) for each in (one, two)]
        values = [each + std * noise.standard_normal(len(each)) for each in values]
        weights = [each.weights for each in (one, two)]
        ends = [_interval(*each) for each in zip(values, weights, strict=True)]
        experiments.append(Experiment(name, ends[0], ends[1], _separates(values, weights)))
    return tuple(sorted(experiments, key=lambda each: -each.separates))


def between_laws(parts: Sequence[Weighted]) -> tuple[LawExperiment, ...]:
    """Outcomes under every law, over all ``parts``, with the noise that they would have; the best experiment first."""
    law = np.concatenate([each.model.laws(each.draws) for each in parts])
    weights = np.concatenate([each.weights for each in parts])
    rows = [row for row in range(len(LAWS)) if np.sum(law == row) >= _FEW]
    experiments = []
    for number, (name, (outcome, std)) in enumerate(of_laws(parts[0].model).items()):
        values = np.concatenate([outcome(each.model, each.draws) for each in parts])
        values = values + std * np.random.default_rng(number).standard_normal(len(values))
        by_law = [values[law == row] for row in rows]
        their = [weights[law == row] for row in rows]
        ends = {LAWS[row]: _interval(*each) for row, *each in zip(rows, by_law, their, strict=True)}
        separates = _separates(by_law, their) if len(rows) > 1 else float("nan")
        experiments.append(LawExperiment(name, ends, separates))
    return tuple(sorted(experiments, key=lambda each: -each.separates))


def _interval(values: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """95 % of weighted values."""
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    low, high = (float(values[order][min(int(np.searchsorted(share, q)), len(share) - 1)]) for q in (0.025, 0.975))
    return low, high


def _separates(values: Sequence[np.ndarray], weights: Sequence[np.ndarray]) -> float:
    """Share of outcomes, drawn from every hypothesis as often, after which the right one has a weight of ``_SURE``.

    Densities of the outcomes are histograms; the weights of a hypothesis add up to its weight so far.
    """
    lowest, highest = (float(end) for end in np.quantile(np.concatenate(values), [0.0005, 0.9995]))
    grid = np.linspace(lowest, highest, _CELLS)
    masses = [float(each.sum()) for each in weights]
    joint = np.stack(
        [
            mass * (np.histogram(each, bins=grid, weights=its / mass, density=True)[0] + 1e-6 / np.ptp(grid))
            for each, its, mass in zip(values, weights, masses, strict=True)
        ]
    )
    posterior = joint / joint.sum(axis=0)
    right = []
    for row, (each, its) in enumerate(zip(values, weights, strict=True)):
        cell = np.clip(np.searchsorted(grid, each) - 1, 0, len(grid) - 2)
        right.append(np.average(posterior[row, cell] > _SURE, weights=its))
    return float(np.mean(right))


def _of_loop(model: JointModel, z: Draws) -> np.ndarray:
    """Logarithm of the ratio of the friction coefficients of both joints."""
    p = model.values(z)
    return np.asarray(
        np.log(p[model.named("friction coefficient", "hammer")] / p[model.named("friction coefficient", "shaker")])
    )


def _of_growth(model: JointModel, z: Draws) -> np.ndarray:
    """Difference of the exponents of k_T."""
    p = model.values(z)
    return np.asarray(p[model.named("exponent of k_T", "hammer")] - p[model.named("exponent of k_T", "shaker")])


def _impact(scale: float) -> Callable[[JointModel, Draws], np.ndarray]:
    """Damping [%] that impacts of a share of the force read at 1 kN."""
    return lambda model, z: 100 * model.hammer(z, np.array([1000.0]), scale)[1][:, 0]


def _force(model: JointModel, z: Draws) -> np.ndarray:
    """Logarithm of the peak force [N]."""
    return np.asarray(np.log(model.values(z)["peak force"]))


JOINTS: Mapping[str, Outcome] = {
    "hysteresis loops of both joints: ln of the ratio of their friction coefficients": (_of_loop, 0.05),
    "hysteresis loops of both joints: difference of the exponents of k_T": (_of_growth, 0.05),
    "hammer, 1 kN, half the impact: damping [%]": (_impact(0.5), 0.05),
    "peak force of the impacts: ln of N": (_force, 0.05),
}
"""Measurements that could decide between one joint and two."""


def of_laws(model: JointModel) -> dict[str, Outcome]:
    """Measurements that could decide between the laws of a joint, of the tests that there were."""
    found: dict[str, Outcome] = {
        "hysteresis loops with slips of F_C/k_T and twice that: energy of the first over that of the second": (
            _energies,
            0.02,
        )
    }
    if model.file.hammer:
        found["hammer, 1 kN, a tenth of the impact: damping [%]"] = (_impact(0.1), 0.05)
    if model.file.shaker:
        forces = np.sort(model.file.swept(model.file.modes_of_shaker[0])[1])
        name = f"shaker, {forces[len(forces) // 2]:g} N: damping at half the highest level over that at the highest"
        found[name] = (_levels, 0.05)
    return found


def _energies(model: JointModel, z: Draws) -> np.ndarray:
    # W = pi (k'' + eta k') s^2, of loops at s = 1 and s = 2
    loss = model.values(z)[model.named("loss factor", model.tests[0])]
    loops = np.stack([np.stack(harmonic(law, np.array([1.0, 2.0]))) for law in LAWS])[model.laws(z)]
    energy = (loops[:, 1] + loss[:, None] * loops[:, 0]) * np.array([1.0, 4.0])
    return np.asarray(energy[:, 0] / energy[:, 1])


def _levels(model: JointModel, z: Draws) -> np.ndarray:
    mode = model.file.modes_of_shaker[0]
    levels, forces = (np.sort(each) for each in model.file.swept(mode))
    conditions = np.array([[levels[-1] / 2, levels[-1]], [forces[len(forces) // 2]] * 2])
    damping = model.shaker(z, f"shaker, mode {mode}" if mode else "shaker", conditions)[1]
    return np.asarray(damping[:, 0] / damping[:, 1])
