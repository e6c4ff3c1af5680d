"""Simulation-based calibration of the posterior of one friction law (Talts et al. 2018, arXiv:1804.06788).

A table is drawn from the prior, of one joint or of two in turn; what it lets the tests read, with noise, becomes the
numbers and sentences of a file like that of the recipe: a reading is drawn about its truth, a sentence says on which side
of its limits the reading fell. 95 % intervals of the hypothesis that is true hold 95 %; of tables to which a weight of w
is given to one joint, the share w has one.

    python -m tests.bench.joint_law reports/work_table_joint --n 200 --seed 1 --publish

``--publish`` keeps every table as soon as it is counted; tables of other code give way.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ema.compare.joint_law import Datum, JointAssessment, JointModel, posteriors
from ema.compare.joint_statements import JointFile, load
from tests.bench import provenance
from tests.bench.joint_law_page import counts

RESULT = Path(__file__).parent / "results" / "joint_law.json"
MODULE = "tests.bench.joint_law"


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


def counted(told: JointFile, seed: int, number: int, runs: int) -> dict[str, Any]:
    """One table: what holds its truth, what is called determined, and the weight of one joint with its range."""
    rng = np.random.default_rng([seed, number])
    is_one = number % 2 == 0
    truth, said = drawn(JointModel(told, two=not is_one), rng)
    found = JointAssessment(*posteriors(JointModel(told, said=said), int(rng.integers(2**31)), runs=runs), (), ())
    right = found.one if is_one else found.two
    assert right is not None
    return {
        "seed": seed,
        "number": number,
        "runs": runs,
        "one": is_one,
        "held": {name: bool(low <= truth[name] <= high) for name, (low, high) in right.interval.items()},
        "determined": [name for name in found.one.interval if found.determined(name)] if is_one else [],
        "weight": found.weight,
        "weight_interval": list(found.weight_interval),
    }


def main() -> None:
    """Count, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--n", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first table")
    parser.add_argument("--runs", type=int, default=2, help="runs of the sampler for each table")
    parser.add_argument("--publish", action="store_true", help="store the counts for docs/joint.md")
    given = parser.parse_args()
    told, rows = load(given.file), []
    for number in range(given.first, given.first + given.n):
        row = counted(told, given.seed, number, given.runs)
        rows.append(row)
        low, high = row["weight_interval"]
        print(
            f"{number:4d}  {'one' if row['one'] else 'two'}: {np.mean(list(row['held'].values())):5.0%} held, weight of "
            f"one {row['weight']:.3f} [{low:.3f}, {high:.3f}]",
            flush=True,
        )
        if given.publish:
            publish(row)
    print("\n".join(counts(rows)))


def publish(row: dict[str, Any]) -> None:
    """Keep one table beside those of the same code."""
    stored = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.exists() else {}
    rows = [] if not stored or provenance.outdated(stored) else stored["tables"]
    others = [one for one in rows if (one["seed"], one["number"]) != (row["seed"], row["number"])]
    kept = provenance.stamp(MODULE) | {"tables": [*others, row]}
    RESULT.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
