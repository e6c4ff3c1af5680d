"""Simulation-based calibration of the posterior of one friction law (Talts et al. 2018, arXiv:1804.06788).

A table is drawn from the prior, of one joint or of two in turn; what it lets the tests read, with noise, becomes the
numbers and sentences of a file like that of the recipe: a reading is drawn about its truth, a sentence says on which side
of its limits the reading fell. 95 % intervals of the hypothesis that is true hold 95 %; of tables to which a weight of w
is given to one joint, the share w has one.

    python -m tests.bench.joint_law reports/work_table_joint --n 200 --seed 1
"""

import argparse
from collections import defaultdict
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from ema.compare.joint_law import INDEPENDENT, Datum, JointAssessment, JointModel, posteriors
from ema.compare.joint_statements import load

EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)


def drawn(model: JointModel, rng: np.random.Generator) -> tuple[dict[str, float], tuple[Datum, ...]]:
    """Parameters of a table, and what would have been said of it."""
    z = rng.standard_normal((1, len(model.parameters)))
    found = []
    for datum, truth in zip(model.data, model.readings(z)[0], strict=True):
        reading = float(truth + datum.std * rng.standard_normal())
        if np.isfinite(datum.value):
            found.append(replace(datum, value=reading))
        elif reading < datum.low:
            found.append(replace(datum, low=-np.inf, high=datum.low))
        elif reading > datum.high:
            found.append(replace(datum, low=datum.high, high=np.inf))
        else:
            found.append(datum)
    both = model.values(z) | model.combinations(z)
    return {name: float(values[0]) for name, values in both.items()}, tuple(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--n", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first table")
    parser.add_argument("--runs", type=int, default=2, help="runs of the sampler for each table")
    given = parser.parse_args()
    told = load(given.file)
    held: dict[str, list[bool]] = defaultdict(list)
    told_determined: list[bool] = []
    weights: list[tuple[float, bool]] = []
    for number in range(given.first, given.first + given.n):
        rng = np.random.default_rng([given.seed, number])
        is_one = number % 2 == 0
        truth, said = drawn(JointModel(told, 0.0 if is_one else INDEPENDENT), rng)
        found = JointAssessment(
            *posteriors(JointModel(told, said=said), int(rng.integers(2**31)), runs=given.runs), (), ()
        )
        right = found.one if is_one else found.two
        assert right is not None
        inside = {name: low <= truth[name] <= high for name, (low, high) in right.interval.items()}
        for name, value in inside.items():
            held[name].append(value)
        if is_one:
            told_determined += [value for name, value in inside.items() if found.determined(name)]
        weights.append((found.weight, is_one))
        share = np.mean(list(inside.values()))
        low, high = found.weight_interval
        print(
            f"{number:4d}  {'one' if is_one else 'two'}: {share:5.0%} held, weight of one {found.weight:.3f} "
            f"[{low:.3f}, {high:.3f}], chance {found.one.chance:.2f} {right.chance:.2f}",
            flush=True,
        )
    everything = [value for row in held.values() for value in row]
    print(
        f"held {np.mean(everything):.1%} of {len(everything)}, of what is called determined {np.mean(told_determined):.1%}"
        f" of {len(told_determined)}"
    )
    for name, row in held.items():
        print(f"  {name:60s}{np.mean(row):7.1%} of {len(row)}")
    weight, one = (np.array(column) for column in zip(*weights, strict=True))
    right_weight = np.where(one, weight, 1 - weight)
    print(
        f"weight of what is true below 0.05: {np.sum(right_weight < 0.05)} of {len(weight)}; above 0.95: "
        f"{np.sum(right_weight > 0.95)}; in the mean {right_weight.mean():.2f}"
    )
    for low, high in pairwise(EDGES):
        rows = (weight >= low) & (weight <= high)
        if rows.any():
            print(
                f"  weight of one {low:.1f} to {high:.1f}: {one[rows].sum()} of {rows.sum()} have one joint, "
                f"{weight[rows].mean():.2f} by the weights"
            )


if __name__ == "__main__":
    main()
