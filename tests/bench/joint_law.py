"""Simulation-based calibration of the posterior of one friction joint (Talts et al. 2018, arXiv:1804.06788).

A table is drawn from the prior, of one joint or of two in turn and of each law in turn; what it lets the tests read,
with noise, becomes the numbers and sentences of a file like that of the recipe: a reading is drawn about its truth, a
sentence says on which side of its limits the reading fell. 95 % intervals of the hypothesis that is true, over all laws,
hold 95 %; of tables to which a weight of w is given to one joint, or to a law, the share w has it. A law differs from
the truth where even the nearest of its draws is more than three standard deviations off in some number or sentence:
its weight should be below 0.05. Every table also makes the experiments that are proposed, once: an outcome of its own
truth reweights the draws.

    python -m tests.bench.joint_law reports/work_table_joint --n 200 --seed 1 --publish
    python -m tests.bench.joint_law reports/work_table_joint --n 60 --seed 1 --like --publish

``--like`` draws the joints from what the file itself leaves possible under the law in turn, where the laws differ most;
only the weights of laws and the experiments are counted on these, for their truth is not drawn from the prior.
``--publish`` keeps every table as soon as it is counted; tables of other code give way. ``--first`` divides them among
processes.
"""

import argparse
import fcntl
import json
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ema.compare.joint_experiments import JOINTS, between_joints, between_laws, of_laws
from ema.compare.joint_law import Datum, JointAssessment, JointModel, Posterior, posteriors, weighted
from ema.compare.joint_loops import LAWS
from ema.compare.joint_statements import load
from tests.bench import provenance
from tests.bench.joint_law_page import counts

RESULT = Path(__file__).parent / "results" / "joint_law.json"
MODULE = "tests.bench.joint_law"
OFF = 3.0
"""Standard deviations beyond which a law differs from the truth somewhere."""
FEW = 200
"""Draws of a law below which a run of its own looks for its nearest."""


class Table(NamedTuple):
    """Which table: its random numbers, its place in turn, runs of the sampler, and where its joint is drawn from."""

    seed: int
    number: int
    runs: int
    like: bool


def said_of(model: JointModel, z: np.ndarray, rng: np.random.Generator) -> tuple[Datum, ...]:
    """What would have been said of a table of these parameters (1, parameter)."""
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
    return tuple(found)


@cache
def _possible(file: Path, two: bool, law: str) -> np.ndarray:
    """Draws of what the file leaves possible."""
    found = posteriors(JointModel(load(file), law=law), 0, runs=1)[two]
    assert found is not None
    return found.draws


def counted(file: Path, table: Table) -> dict[str, Any]:
    """One table: what holds its truth, what is called determined, and the weights with their ranges."""
    told, (seed, number, runs, like) = load(file), table
    is_one, law = number % 2 == 0, LAWS[number // 2 % len(LAWS)]
    truth = JointModel(told, two=not is_one, law=law)
    possible = _possible(file, not is_one, law) if like else None
    rng, start = np.random.default_rng([seed, number, like]), time.process_time()
    if possible is None:
        z = rng.standard_normal((1, len(truth.parameters)))
    else:
        z = possible[[int(rng.integers(len(possible)))]]
    said = said_of(truth, z, rng)
    one, two = posteriors(JointModel(told, said=said), int(rng.integers(2**31)), runs=runs)
    found = JointAssessment(one, two, (), ())
    right = one if is_one else two
    assert right is not None and two is not None
    values = truth.values(z) | truth.combinations(z)
    return {
        **table._asdict(),
        "one": is_one,
        "law": law,
        "held": {name: bool(low <= values[name][0] <= high) for name, (low, high) in right.interval.items()},
        "determined": [name for name in one.interval if found.determined(name)] if is_one else [],
        "weight": found.weight,
        "weight_interval": list(found.weight_interval),
        "laws": {each.name: [each.weight, each.low, each.high] for each in found.laws},
        "off": {other: _off((one, two), other, truth.readings(z)[0]) for other in LAWS},
        "experiments": _made(truth, z, (one, two), rng),
        "seconds": round(time.process_time() - start, 1),
    }


def _off(found: tuple[Posterior, Posterior], law: str, truth: np.ndarray) -> float:
    """Largest distance of a reading from the truth, in standard deviations, of the nearest draw of a law.

    Of a law that few draws have a run of its own says it. What lies within the limits of a sentence differs in nothing
    that was said.
    """
    model, row = found[0].model, LAWS.index(law)
    readings = np.concatenate([each.model.readings(each.draws[each.model.laws(each.draws) == row]) for each in found])
    if len(readings) < FEW:
        alone = posteriors(replace(model, law=law), 0, runs=1, draws=FEW)[0]
        readings = alone.model.readings(alone.draws)
    off = [datum.excess(readings[:, column]) - datum.excess(truth[column]) for column, datum in enumerate(model.data)]
    return float(np.abs(off).max(axis=0).min())


def _made(
    truth: JointModel, z: np.ndarray, found: tuple[Posterior, Posterior], rng: np.random.Generator
) -> dict[str, list[float]]:
    """For every proposed experiment: the share of outcomes that was predicted to decide, and the weight of the truth.

    The weight is that after one outcome of the truth: draws are weighted by its density, as normal about what each
    draw would read.
    """
    parts = weighted(*found)
    made = {}
    predicted: dict[str, float] = {each.name: each.separates for each in between_joints(*parts)}
    predicted |= {each.name: each.separates for each in between_laws(parts)}
    outcomes = {name: (*each, False) for name, each in JOINTS.items()}
    outcomes |= {name: (*each, True) for name, each in of_laws(truth).items()}
    for name, (outcome, std, of_law) in outcomes.items():
        read = float(outcome(truth, z)[0] + std * rng.standard_normal())
        after, is_right = [], []
        for part in parts:
            away = (outcome(part.model, part.draws) - read) / std
            after.append(part.weights * np.exp(-0.5 * away**2) + 1e-300)
            laws = part.model.laws(part.draws)
            of_truth = (
                laws == LAWS.index(truth.law or LAWS[0]) if of_law else np.full(len(laws), part.model.two == truth.two)
            )
            is_right.append(of_truth)
        made[name] = [predicted[name], float(np.average(np.concatenate(is_right), weights=np.concatenate(after)))]
    return made


def main() -> None:
    """Count, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--n", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first table")
    parser.add_argument("--runs", type=int, default=2, help="runs of the sampler for each table")
    parser.add_argument("--like", action="store_true", help="draw joints that the file itself leaves possible")
    parser.add_argument("--publish", action="store_true", help="store the counts for docs/joint.md")
    given = parser.parse_args()
    rows = []
    for number in range(given.first, given.first + given.n):
        table = Table(given.seed, number, given.runs, given.like)
        if given.publish and (row := _stored(table)) is not None:
            rows.append(row)
            continue
        row = counted(given.file, table)
        rows.append(row)
        low, high = row["weight_interval"]
        print(
            f"{number:4d}  {'one' if row['one'] else 'two'}, {row['law']:6s}: {np.mean(list(row['held'].values())):5.0%} "
            f"held, weight of one {row['weight']:.3f} [{low:.3f}, {high:.3f}], of the law {row['laws'][row['law']][0]:.3f}, "
            f"{row['seconds']:.0f} s",
            flush=True,
        )
        if given.publish:
            publish(row)
    print("\n".join(counts(rows)))


def _tables() -> list[dict[str, Any]]:
    """Tables that are kept, of the present code."""
    stored = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.exists() else {}
    return [] if not stored or provenance.outdated(stored) else list(stored["tables"])


def _key(row: dict[str, Any]) -> Table:
    return Table(row["seed"], row["number"], row["runs"], row["like"])


def _stored(table: Table) -> dict[str, Any] | None:
    """A table that was counted before."""
    return next((one for one in _tables() if _key(one) == table), None)


def publish(row: dict[str, Any]) -> None:
    """Keep one table beside those of the same code; processes that count at the same time wait for each other."""
    with Path(__file__).open(encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        others = [one for one in _tables() if _key(one) != _key(row)]
        kept = provenance.stamp(MODULE) | {"tables": [*others, row]}
        RESULT.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
