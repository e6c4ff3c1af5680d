"""Real measurements split into halves: do two fits of the same structure agree within their intervals?"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

import acquisition
from acquisition.datasets import dataset_folder
from ema.data import FrfSet, Lazy, ModalModel, Run
from ema.study.chain import fitted
from ema.study.measured import frfs_of
from ema.study.recipe import EstimateTable, FitTable

NEAR = 0.005
"""Relative distance in frequency within which two modes are the same."""
BLOCK = 1024
"""Samples of the blocks of a record that is halved."""
Halves = tuple[FrfSet, FrfSet]


@dataclass(frozen=True)
class Measurement:
    """A real measurement and how it is split: ``halves(run, rng)`` gives one split."""

    key: str
    title: str
    campaign: str
    run: str
    data: str
    band: tuple[float, float]
    halves: Callable[[Run, np.random.Generator], Halves]


def of_points(run: Run, rng: np.random.Generator) -> Halves:
    """Two random halves of the points that were hit."""
    frfs = run.frfs[0]
    order = rng.permutation(len(frfs.inputs)).tolist()
    half = len(order) // 2
    return frfs.pick(inputs=sorted(order[:half])), frfs.pick(inputs=sorted(order[half:]))


def of_blows(run: Run, rng: np.random.Generator) -> Halves:
    """Two random halves of the blows."""
    order = rng.permutation(len(run.recordings)).tolist()
    half = len(order) // 2
    return _estimated(run, sorted(order[:half])), _estimated(run, sorted(order[half:]))


def of_blocks(run: Run, rng: np.random.Generator) -> Halves:
    """Two random halves of the blocks of a record, which begin at a random sample."""
    record = run.recordings[0]
    samples = record.signals.shape[1]
    count = samples // BLOCK
    start = int(rng.integers(0, samples - count * BLOCK + 1))
    edges = start + BLOCK * np.arange(count + 1)
    blocks = [replace(record, signals=record.signals[:, a:b]) for a, b in pairwise(edges)]
    order = rng.permutation(count)
    first, second = (
        frfs_of(replace(run, recordings=tuple(blocks[place] for place in sorted(half))), EstimateTable(block=BLOCK))[0]
        for half in (order[: count // 2], order[count // 2 :])
    )
    return first, second


def _estimated(run: Run, places: list[int]) -> FrfSet:
    chosen = Lazy([partial(run.recordings.__getitem__, place) for place in places])
    return frfs_of(replace(run, recordings=chosen), EstimateTable())[0]


MEASUREMENTS = (
    Measurement(
        "beam",
        "free-free beam, random halves of the 9 hammer points",
        "freefree_beam",
        "beam",
        "02_freefree_beam_roving_hammer",
        (50, 1000),
        of_points,
    ),
    Measurement(
        "blows",
        "one point, random halves of 5 blows",
        "hammer_blows",
        "blows",
        "03_raw_hammer_blows",
        (500, 6500),
        of_blows,
    ),
    Measurement(
        "subframe",
        "two shakers, random halves of the 8 blocks of a record",
        "steel_subframe",
        "random",
        "05_steel_subframe_mimo",
        (10, 490),
        of_blocks,
    ),
)


def available() -> Iterator[Measurement]:
    """The measurements whose data are on this machine."""
    return (one for one in MEASUREMENTS if (dataset_folder() / one.data).is_dir())


def compared(measurement: Measurement, seed: int) -> dict:
    """One split: the modes of both halves, paired, and the differences over their common standard deviation."""
    run = acquisition.open_campaign(f"datasets/{measurement.campaign}")[measurement.run]
    first, second = (
        fitted(frfs.band(*measurement.band), FitTable())[1]
        for frfs in measurement.halves(run, np.random.default_rng(seed))
    )
    pairs = paired(first, second)
    difference = np.array([differences(first, second, i, j) for i, j in pairs]).reshape(-1, 2)
    return {
        "modes": [len(first.poles), len(second.poles)],
        "frequencies": [round(float(first.natural_frequencies[i]), 3) for i, _ in pairs],
        "frequency": [round(float(value), 4) for value in difference[:, 0]],
        "damping": [round(float(value), 4) for value in difference[:, 1]],
    }


def paired(first: ModalModel, second: ModalModel) -> list[tuple[int, int]]:
    """Modes that are each other's nearest in frequency."""
    if not len(first.poles) or not len(second.poles):
        return []
    a, b = first.natural_frequencies, second.natural_frequencies
    distance = np.abs(a[:, None] - b[None, :]) / a[:, None]
    return [
        (i, int(j))
        for i, j in enumerate(distance.argmin(axis=1))
        if distance[i, j] <= NEAR and distance[:, j].argmin() == i
    ]


def differences(first: ModalModel, second: ModalModel, i: int, j: int) -> tuple[float, float]:
    """Differences of natural frequency and damping ratio over sqrt(s1^2 + s2^2)."""
    assert first.covariance is not None
    assert second.covariance is not None
    std = np.sqrt(np.diag(first.covariance[i]) + np.diag(second.covariance[j]))
    change = (
        first.natural_frequencies[i] - second.natural_frequencies[j],
        first.damping_ratios[i] - second.damping_ratios[j],
    )
    return float(change[0] / std[0]), float(change[1] / std[1])
