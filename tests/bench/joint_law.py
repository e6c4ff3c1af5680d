"""Simulation-based calibration of the posterior of one friction law (Talts et al. 2018, arXiv:1804.06788).

A table is drawn from the prior; what it lets the tests read, with noise, becomes the numbers and sentences of a file like
that of the recipe: a reading is drawn about its truth, a sentence says on which side of its limits the reading fell. Ranks
of the truth among draws of the posterior are uniform where the posterior is right; 95 % intervals hold 95 %.

    python -m tests.bench.joint_law reports/work_table_joint --n 200 --seed 1
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from ema.compare.joint_law import Datum, JointModel, sample
from ema.compare.joint_statements import load


def drawn(model: JointModel, rng: np.random.Generator) -> tuple[np.ndarray, tuple[Datum, ...]]:
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
    return z[0], tuple(found)


class Said(JointModel):
    """A model whose numbers and sentences are given."""

    said: tuple[Datum, ...] = ()

    @property
    def data(self) -> tuple[Datum, ...]:
        """Those that were drawn."""
        return self.said


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--n", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    model = JointModel(load(given.file))
    ranks, held = [], []
    names = [one.name for one in model.parameters]
    for number in range(given.n):
        rng = np.random.default_rng([given.seed, number])
        truth, said = drawn(model, rng)
        table = Said(model.told)
        object.__setattr__(table, "said", said)
        found = sample(table, int(rng.integers(2**31)))
        ranks.append(np.mean(found.draws < truth, axis=0))
        held.append(np.abs(ranks[-1] - 0.5) <= 0.475)
        print(f"{number:4d}  held {np.sum(held[-1])} of {len(names)}, in all {np.mean(held):.1%}", flush=True)
    print(f"{'':45s}{'held':>8s}{'mean rank':>12s}{'std of rank':>14s}   (uniform: 0.5, 0.289)")
    for name, one, two in zip(names, np.mean(held, axis=0), np.array(ranks).T, strict=True):
        print(f"{name:45s}{one:8.1%}{two.mean():12.3f}{two.std():14.3f}")


if __name__ == "__main__":
    main()
