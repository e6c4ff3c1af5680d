"""Cost of the placement predictor, and the two-stage search against a full one.

``python -m tests.bench.placement`` writes ``results/placement.json`` (``--candidates 2000`` for the full case, which
takes minutes of processor time; 100 by default). The first prototype of the predictor took 18 ms per candidate.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from ema import place, shapes
from ema.data import FrictionLaw
from ema.data.placement import BoltedJoint, FrictionBeam
from ema.place.objective import scores
from ema.place.predictor import predict
from ema.place.task import only
from tests.bench.provenance import stamp
from tests.unit.placement_rig import bare_table

RESULT = Path(__file__).parent / "results" / "placement.json"
PROTOTYPE = 18.0
"""ms per candidate for 2 modes x 8 F_N x 3 F_E."""
BEAM = FrictionBeam(0.3, 0.06, 0.05, overhang=0.02)
JOINT = BoltedJoint(FrictionLaw("masing", 0.2, 2e8), 1e9, 0.045)


def task(levels: list[float], forces: int, modes: tuple[int, ...]) -> place.Task:
    """A question about the work table, its shapes with 5 % noise."""
    bare, geometry = bare_table(0.05)
    return place.Task(
        bare, shapes.smooth(bare, geometry), JOINT, "91:+Z", np.array(levels), np.geomspace(25, 1600, forces), modes
    )


def predictor() -> dict[str, Any]:
    """Processor time per candidate, best of five."""
    asked = task([15.0, 30.0, 60.0], 8, (0, 2))
    here = place.grid(asked.surface, [BEAM], 0.05, margin=0.02)
    predict(asked, here)
    times = []
    for _ in range(5):
        started = process_time()
        found = predict(asked, here)
        times.append(1e3 * (process_time() - started) / len(here))
    return {
        "ms per candidate": min(times),
        "prototype": PROTOTYPE,
        "candidates": len(here),
        "holes": float(np.mean(np.isnan(found.damping))),
    }


def stages(count: int) -> dict[str, Any]:
    """The best score of the two-stage search over that of checking every place, and the time of both."""
    asked = task([30.0], 4, (0,))
    every = place.grid(asked.surface, [BEAM], 0.0155, margin=0.0)
    picked = np.sort(np.random.default_rng(1).permutation(len(every))[:count])
    here, aim = only(every, picked), place.Objective()
    started = process_time()
    ranking = place.search(asked, here, aim, settings=place.SearchSettings(shortlist=20, keep=1, draws=0))
    short = process_time() - started
    full = scores(place.verify(asked, predict(asked, here), np.arange(len(here))), aim).max()
    return {
        "candidates": len(here),
        "best of two stages over best of all": ranking.best.score / float(full),
        "s two stages": short,
        "s all": process_time() - started - short,
    }


def section(found: dict[str, Any]) -> str:
    """The figures as a section of the page on speed."""
    one, two = found["predictor"], found["stages"]
    return "\n".join(
        [
            "## Placement",
            "",
            f"The one-mode predictor takes {one['ms per candidate']:.2f} ms of processor time per candidate (2 modes x 8 F_N x "
            f"3 F_E, {one['candidates']} places, best of five; a first prototype took {one['prototype']:.0f} ms). Of "
            f"{two['candidates']} places, the two-stage search ends at {two['best of two stages over best of all']:.4f} of "
            f"the best score that checking every place with all modes together finds, in {two['s two stages']:.1f} s instead "
            f"of {two['s all']:.0f} s of processor time. From `python -m tests.bench.placement --candidates "
            f"{two['candidates']}`, {found['date']}.",
        ]
    )


def main() -> None:
    """Measure and write."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--candidates", type=int, default=100)
    chosen = options.parse_args()
    result = {**stamp("tests.bench.placement"), "predictor": predictor(), "stages": stages(chosen.candidates)}
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
