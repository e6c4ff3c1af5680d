"""Damping ratios from Hann blocks that are short for the damping, for every estimator and drop of the force.

    python -m tests.bench.hann_blocks [draws]

Each draw is a structure of `tests.bench.disturbances_shaker` with four modes, its signals processed by Welch's method in blocks of
1.6 s, and the fit with default settings. Errors are those of the damping ratios: what share of the 95 % intervals hold, the
median error, and the median half width of the interval over the value.
"""

import sys
from dataclasses import replace

import numpy as np

from ema.data import Channel, Recording, Run
from ema.estimate import shaker
from tests.bench.disturbances_shaker import processed, recorded, shaken
from tests.bench.stated import REACH, automatic, errors

ESTIMATORS = ("H1", "H1 less force noise", "Hc", "Hv", "H2")
DROPS = (0.0, 1.0, 3.0, 10.0)
"""How strongly the structure pulls the force down: by 0, 6, 12 and 21 dB."""
BLOCK = 2048
FORCE_NOISE = 1e-3
"""Noise of the force channel over its rms, where it is taken off."""


def run_for(estimator: str, run: Run, rng: np.random.Generator) -> Run:
    """The test with what this estimator needs: a generator, or a record at rest of a force channel with noise."""
    (record,) = run.recordings
    if estimator == "Hc":
        driven = Channel("generator", quantity="voltage", role="generator", unit="V")
        return replace(run, recordings=(replace(record, channels=(*record.channels[:-1], driven)),))
    if estimator == "H1 less force noise":
        noise = FORCE_NOISE * record.signals[0].std() * rng.standard_normal((2, record.signals.shape[1]))
        return replace(
            run, recordings=(_with_force(record, record.signals[0] + noise[0]),), at_rest=(_still(record, noise[1]),)
        )
    return run


def _with_force(record: Recording, force: np.ndarray) -> Recording:
    return replace(record, signals=np.concatenate([force[None], record.signals[1:]]))


def _still(record: Recording, noise: np.ndarray) -> Recording:
    return replace(record, signals=np.concatenate([noise[None], np.zeros_like(record.signals[1:])]), name="rest")


def one(seed: int, drop: float, estimator: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Errors over their standard deviation, relative errors, relative half widths; and whether the force is named."""
    rng = np.random.default_rng([261210, seed])
    test = shaken(rng, shaker=drop)
    run = run_for(estimator, recorded(rng, test), rng)
    kind = estimator if estimator in ("H2", "Hv") else "H1"
    frfs = shaker(run, kind, method="welch", block=BLOCK, overlap=0.5)
    if frfs.estimator != estimator:
        raise ValueError(f"{frfs.estimator} in place of {estimator}")
    case = processed(test, frfs).case
    stated = automatic(case.frfs)
    found = errors(case, stated)
    matched = found.match >= 0
    own, true = found.match[matched], case.truth.damping_ratios[matched]
    named = any(finding.code == "force-not-flat" for finding in frfs.findings)
    return found.damping[matched], stated.damping[own] / true - 1, REACH * stated.damping_std[own] / true, named


def main(draws: str = "10") -> None:
    """Write the table."""
    print(
        "| drop of the force [dB] | estimator | modes | inside [%] | error, median [%] | half width, median [%] | named |"
    )
    print("|---|---|---|---|---|---|---|")
    for drop in DROPS:
        for estimator in ESTIMATORS:
            results = [one(seed, drop, estimator) for seed in range(int(draws))]
            over, relative, half = (np.concatenate([result[part] for result in results]) for part in range(3))
            print(
                f"| {20 * np.log10(1 + drop):.0f} | {estimator} | {len(over)} of {4 * int(draws)} | "
                f"{100 * np.mean(np.abs(over) <= REACH):.0f} | {100 * np.median(relative):+.1f} | "
                f"{100 * np.median(half):.1f} | {sum(result[3] for result in results)} of {draws} |",
                flush=True,
            )


if __name__ == "__main__":
    main(*sys.argv[1:])
