"""``python -m tests.bench.forced_prediction``: bands under a force, on random joints whose law is no candidate.

The joints are those of :mod:`tests.bench.amplitude_prediction`. The force that keeps up 1.25 and 1.5 times the highest level at
phase resonance is known exactly, F = 2 zeta m w^2 x. Under that force amplitude, frequency and damping are predicted from the
levels: how often the 95 % bands hold, and their half widths and errors in the median.
"""

import argparse
import json

import numpy as np

from ema.compare import amplitude_draws, forced_resonances
from ema.errors import InputError
from tests.bench import synthetic_joints
from tests.bench.amplitude_prediction import FIRST_SEED, measured

MASS = 2.0
"""Modal mass in kg, known exactly: bands of the joint are judged, not those of the mass."""
BEYOND = 2
"""How many of the amplitudes beyond the levels: the third is where bands end to be calibrated."""


def one(seed: int) -> dict[str, list] | str:
    """Truth and bands (quantity, force) of amplitude, frequency and damping; the refusal where there is one."""
    joint = synthetic_joints.draw(seed)
    at = joint.beyond[:BEYOND] * joint.amplitude[-1]
    f, zeta = joint.true_frequency[:BEYOND], joint.true_damping[:BEYOND]
    forces = 2 * zeta * MASS * (2 * np.pi * f) ** 2 * at
    mode = measured(joint, quantity="displacement")
    try:
        found = forced_resonances(amplitude_draws(mode, modal_mass=MASS), forces.tolist())
    except InputError as error:
        return error.what
    bands = [[band.low, band.value, band.high] for band in (found.amplitude, found.frequency, found.damping)]
    return {"truth": np.stack([at, f, zeta]).tolist(), "bands": np.array(bands).tolist()}


def summary(results: list[dict[str, list] | str]) -> dict[str, object]:
    """Coverage, half widths and errors at each distance, and the refusals."""
    answers = [one for one in results if isinstance(one, dict)]
    truth, bands = (np.array([one[key] for one in answers]) for key in ("truth", "bands"))
    out: dict[str, object] = {"joints": len(results), "refused": [one for one in results if isinstance(one, str)]}
    for row, name in enumerate(("amplitude", "frequency", "damping")):
        low, value, high, true = bands[:, row, 0], bands[:, row, 1], bands[:, row, 2], truth[:, row]
        out[name] = {
            "coverage": np.mean((low <= true) & (true <= high), axis=0).tolist(),
            "median half width": np.median(0.5 * (high - low) / true, axis=0).tolist(),
            "median error": np.median(np.abs(value / true - 1), axis=0).tolist(),
        }
    return out


def main() -> None:
    """Draw, predict, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--joints", type=int, default=120)
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    asked = parser.parse_args()
    print(json.dumps(summary([one(seed) for seed in range(asked.seed, asked.seed + asked.joints)]), indent=1))


if __name__ == "__main__":
    main()
