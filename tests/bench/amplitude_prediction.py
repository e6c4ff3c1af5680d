"""``python -m tests.bench.amplitude_prediction``: bands beyond the data, on random joints whose law is no candidate.

Frequency and damping at 5 to 10 levels with noise; predicted at 1.25, 1.5 and 2 times the highest. Coverage of the 95 %
bands at each distance, median half width and error, and the mean interval score (Gneiting and Raftery 2007, over the
true value) beside those of every single law with its own parameter bands.
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from ema.compare.amplitude_prediction import observations, predict_amplitudes
from ema.compare.modal_laws import LAWS
from ema.compare.modal_posterior import posterior
from ema.data import AmplitudeDependentMode, Band
from tests.bench import synthetic_joints
from tests.bench.synthetic_joints import SyntheticJoint

FIRST_SEED = 6000
"""Priors were set with seeds 1000 to 1059."""
_Z = 1.959964


def measured(joint: SyntheticJoint, quantity: str = "acceleration") -> AmplitudeDependentMode:
    """The levels of a joint as a measurement gives them, as amplitudes of ``quantity``."""

    def band(value: np.ndarray, std: np.ndarray) -> Band:
        return Band(value - _Z * std, value, value + _Z * std, 0.95, "noise")

    return AmplitudeDependentMode(
        amplitude=joint.amplitude,
        frequency=band(joint.frequency, joint.frequency_std),
        damping=band(joint.damping, joint.damping_std),
        control="response",
        quantity=quantity,
        name=joint.family,
    )


def score(low: np.ndarray, high: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Interval score at 95 %, over the truth."""
    return (high - low + 40 * np.maximum(low - truth, 0) + 40 * np.maximum(truth - high, 0)) / truth


def one(seed: int) -> dict[str, list]:
    """Bands and truth of a joint: (quantity, low value high, distance), and scores of single laws (law, quantity)."""
    joint = synthetic_joints.draw(seed)
    mode = measured(joint)
    at = joint.beyond * joint.amplitude[-1]
    found = predict_amplitudes(mode, at.tolist())
    truth = np.stack([joint.true_frequency, joint.true_damping])
    bands = [[band.low, band.value, band.high] for band in (found.frequency, found.damping)]
    data, generator = observations(mode), np.random.default_rng(seed)
    levels, targets = len(mode.amplitude), np.log(at / mode.amplitude[0])
    singles = []
    for law in LAWS:
        drawn = (
            posterior(law, data, targets).given(levels).sample(levels + np.arange(len(at)), 1000, generator, form=False)
        )
        values = mode.frequency.value[0] * np.sqrt(drawn[:, 0]), drawn[:, 1] / (2 * drawn[:, 0])
        low, high = np.moveaxis(np.quantile(values, [0.025, 0.975], axis=1), 0, 0)
        singles.append([score(low[q], high[q], truth[q]).tolist() for q in range(2)])
    return {
        "family": joint.family,
        "truth": truth.tolist(),
        "bands": np.array(bands).tolist(),
        "singles": singles,
        "weights": found.weights.tolist(),
    }


def summary(results: list[dict[str, list]]) -> dict[str, object]:
    """Coverage, widths, errors and scores at each distance."""
    truth, bands = (np.array([r[key] for r in results]) for key in ("truth", "bands"))
    singles = np.array([r["singles"] for r in results])
    out: dict[str, object] = {"joints": len(results), "distances": [1.25, 1.5, 2.0]}
    families = np.array([r["family"] for r in results])
    for q, name in enumerate(("frequency", "damping")):
        low, value, high, true = bands[:, q, 0], bands[:, q, 1], bands[:, q, 2], truth[:, q]
        inside = (low <= true) & (true <= high)
        mean = singles[:, :, q].mean(axis=0)
        out[name] = {
            "coverage": inside.mean(axis=0).tolist(),
            "coverage by family": {f: inside[families == f].mean(axis=0).tolist() for f in np.unique(families)},
            "median half width": np.median(0.5 * (high - low) / true, axis=0).tolist(),
            "median error": np.median(np.abs(value / true - 1), axis=0).tolist(),
            "interval score": score(low, high, true).mean(axis=0).tolist(),
            "interval score of the single laws": dict(zip([law.name for law in LAWS], mean.tolist(), strict=True)),
        }
    out["mean weights"] = dict(zip([law.name for law in LAWS], np.mean([r["weights"] for r in results], axis=0)))
    return out


def main() -> None:
    """Draw, predict, and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--joints", type=int, default=200)
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--out", type=Path, help="write the figures to this file too")
    asked = parser.parse_args()
    with ProcessPoolExecutor(2) as executor:
        results = list(executor.map(one, range(asked.seed, asked.seed + asked.joints)))
    text = json.dumps({"seed": asked.seed} | summary(results), indent=1)
    if asked.out is not None:
        asked.out.write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
