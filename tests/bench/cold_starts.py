"""Steady states from nothing: random laws, normal forces and frequencies on the double beam with 20 pairs.

``python -m tests.bench.cold_starts`` draws points until ``--seconds`` of processor time or ``--points`` are reached and
writes ``results/cold_starts.json``; it goes on where the run before ended, as long as the code has not changed. Where no
steady state is found, the time solver runs from rest for a while and says whether there is one.
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

from ema.data import Damping, FrictionLaw
from ema.simulate import (
    BoucWen,
    Coulomb,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ModifiedIwan,
    ParallelMasing,
    RegularisedMasing,
    Valanis,
    double_beam,
    respond,
)
from ema.simulate.harmonic import condense
from tests.bench import provenance

RESULT = Path(__file__).parent / "results" / "cold_starts.json"
TIP, MU, BAND, FORCES = "beam 2:20:+Z", 0.3, (10.0, 60.0), (1.0, 4.0)
"""Hz, and logarithms of the normal force in N, at an exciting force of 1 N."""
SECONDS, PERIODS = 3.0, 20
"""Of the run from rest where no steady state was found, and periods at its end that are compared."""


def law_of(rng: np.random.Generator) -> FrictionLaw:
    """One of all laws with random parameters."""
    k = float(10 ** rng.uniform(8.5, 9.7))
    made = [
        lambda: Masing(MU, k),
        lambda: Coulomb(MU, 30 * k),
        lambda: ParallelMasing(MU, k, [0.5, 0.3, 0.2], [0.2, 0.3, 0.5]),
        lambda: Iwan(MU, k, float(rng.uniform(-0.9, 0.0)), float(rng.uniform(0.0, 1.5))),
        lambda: ModifiedIwan(MU, k, float(rng.uniform(-0.9, 1.0)), float(rng.uniform(0.0, 1.5))),
        lambda: RegularisedMasing(MU, k, float(10 ** rng.uniform(-0.3, 1.5))),
        lambda: BoucWen(MU, k, float(10 ** rng.uniform(-0.3, 0.9)), float(rng.uniform(-1.0, 0.5))),
        lambda: Dahl(MU, k, float(rng.uniform(0.5, 2.0))),
        lambda: Valanis(MU, k, float(rng.uniform(0.0, 0.98))),
        lambda: LuGre(MU, k, 1e3, 10.0, float(rng.uniform(1.0, 1.4)), float(10 ** rng.uniform(-4, -1))),
    ]
    return made[rng.integers(len(made))]()


def cold_start(number: int) -> dict[str, Any]:
    """One point: what was found, and where nothing was, what the time solver says."""
    rng = np.random.default_rng([5, number])
    law, normal = law_of(rng), float(10 ** rng.uniform(*FORCES))
    frequency = float(rng.uniform(*BAND))
    model = double_beam(law, normal, damping=Damping(mass_factor=2.0))
    condensed, begun = condense(model, 1.0, TIP, [TIP], 5e-3), process_time()
    point = condensed.solve(frequency)
    row = {"number": number, "law": law.name, "normal force": normal, "frequency": frequency}
    row |= {"cpu": process_time() - begun, "found": point is not None}
    if point is None:
        rate = 200 * frequency
        force = np.cos(2 * np.pi * frequency * np.arange(int(SECONDS * rate)) / rate)[None]
        run = respond(model, force, [TIP], rate, [TIP])
        last, before = run.displacements[0][-200:], run.displacements[0][-200 * (PERIODS + 1) : -200 * PERIODS]
        return row | {"time solver, change over 20 periods": float(np.abs(last - before).max() / np.abs(last).max())}
    supplied, friction, damping = condensed.powers(point)
    return row | {"error": point.error, "power": abs(supplied - friction - damping) / supplied}


def main() -> None:
    """Draw on where the last run ended, write, and say what came out."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=280.0)
    parser.add_argument("--points", type=int, default=2000)
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    stamp = provenance.stamp("tests.bench.cold_starts")
    known = json.loads(given.out.read_text()) if given.out.exists() else {}
    if known.get("fingerprint") != stamp["fingerprint"]:
        known = {**stamp, "points": []}
    points, begun = known["points"], process_time()
    given.out.parent.mkdir(exist_ok=True)
    while len(points) < given.points and process_time() - begun < given.seconds:
        points.append(cold_start(len(points)))
        if not len(points) % 50:
            given.out.write_text(json.dumps(known) + "\n")
        if not points[-1]["found"] or points[-1]["cpu"] > 5.0:
            print(points[-1], flush=True)
    given.out.write_text(json.dumps(known) + "\n")
    found = [point for point in points if point["found"]]
    print(f"{len(points)} points, {len(points) - len(found)} without a solution;", end=" ")
    cpu = np.array([point["cpu"] for point in points])
    print(
        f"{1e3 * np.median(cpu):.0f} ms in the median, {cpu.mean():.2f} s in the mean, {cpu.max():.1f} s at most;",
        end=" ",
    )
    print(f"{sum(point['error'] > 5e-3 for point in found)} state an error above 0.5 %, at most", end=" ")
    print(f"{max(point['error'] for point in found):.2g}; power balance {max(point['power'] for point in found):.1e}")


if __name__ == "__main__":
    main()
