"""How often the friction simulator's errors are within what it states, on random models with every law.

``python -m tests.bench.stated_errors`` draws models (``friction_draws``), solves them by ``ema.simulate`` and a second
time by ``friction_truth``, which shares no code with it, and writes what was stated and what was true into
``results/stated_errors.json``. ``--only`` takes one of the kinds below, ``--law`` one law, ``--seconds`` bounds the
time: a run goes on with the next draw where the one before ended, as long as the code has not changed.
``python -m tests.bench.write_docs`` writes the tables into ``docs/simulate.md``.

``time``: snap-backs and random forces at four tolerances; the error is the largest over the run, over the largest
displacement. ``frequency``: steady states at random frequencies, default settings, from nothing; the error is that of
the first harmonic of the output. The truth goes on in time from the harmonic solution until it has settled.
``verified``: the same with ``verify=True``.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import signal
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from ema.simulate import HarmonicBalance, frf, respond, snapback
from ema.simulate.harmonic import condense
from tests.bench import provenance
from tests.bench.friction_draws import LAWS, Draw, draw
from tests.bench.friction_truth import Motion, followed, released, steady, truth

RESULT = Path(__file__).parent / "results" / "stated_errors.json"
TOLERANCES = (1e-2, 1e-3, 3e-4, 1e-4)
PERIODS, SAMPLES = 8, (80, 640)
"""Of the lowest mode in a run in time, and least and greatest number of its samples."""
JUDGED = 0.2
"""Largest error of the truth over the stated one with which a draw is judged."""
PATIENCE = 90
"""s of processor time for one draw."""

Row = dict[str, Any]


def in_time(case: Draw, rng: np.random.Generator) -> list[Row]:
    """A snap-back or a random force with every tolerance."""
    duration = PERIODS / case.lowest
    samples = int(np.exp(rng.uniform(*np.log(SAMPLES))))
    rate = samples / duration
    load, seen = case.force * case.load_row, case.output_row[None]
    free = bool(rng.integers(2))
    if free:
        start, wave = released(case.rubbing, load), None
    else:
        start = (0 * load, 0 * load, case.rubbing.memory())
        wave = _noise(rng, case.lowest, rate, samples)
    motion = Motion(load, samples, 1 / rate, wave)
    rows, found = [], []
    for tolerance in TOLERANCES:
        begun = process_time()
        if wave is None:
            run = snapback(case.model, case.force, case.at, duration, [case.output], rate, tolerance)
        else:
            force = case.force * wave[None]
            run = respond(case.model, force, [case.at], rate, [case.output], tolerance=tolerance)
        kind = "snap-back" if free else "force"
        row = {"kind": kind, "tolerance": tolerance, "stated": run.error_estimate, "cpu": process_time() - begun}
        rows.append(row | {"step": run.step})
        found.append(run.displacements[0])
    exact, own = truth(case.rubbing, motion, start, seen, 0.1 * min(row["stated"] for row in rows))
    for row, motions in zip(rows, found, strict=True):
        row |= {"true": float(np.abs(motions - exact[:, 0]).max() / np.abs(motions).max()), "own": own}
    return rows


def _noise(rng: np.random.Generator, lowest: float, rate: float, samples: int) -> np.ndarray:
    """A force of 1 N at most in a band about the lowest modes, rising from zero."""
    t = np.arange(samples + 1) / rate
    parts = lowest * rng.uniform(0.3, 3.0, 6)
    wave = np.sin(2 * np.pi * parts * t[:, None] + rng.uniform(0, 2 * np.pi, 6)).sum(axis=1)
    wave *= np.minimum(t * lowest, 1.0)
    return np.asarray(wave / np.abs(wave).max())


def in_frequency(case: Draw, rng: np.random.Generator, verify: bool = False) -> list[Row]:
    """One steady state, found from nothing."""
    low, high = 0.7 * min(case.sliding, case.lowest), 1.6 * case.lowest
    frequency = float(rng.uniform(low, high))
    begun = process_time()
    found = frf(case.model, np.array([frequency]), case.force, case.at, [case.output], HarmonicBalance(verify=verify))
    row: Row = {"kind": "steady", "frequency": frequency, "cpu": process_time() - begun}
    row |= {"solved": bool(found.converged[0]), "tolerance": 5e-3, "highest": int(found.orders[-1])}
    condensed = condense(case.model, case.force, case.at, [case.output], 5e-3)
    point = condensed.solve(frequency)
    if point is None:
        return [row]
    system, base = condensed.problem.system, condensed.problem.base
    rows = np.array([base.row(system, dof) for dof in _dofs(case)])
    waves = condensed.outputs(point, rows)
    orders = condensed.orders(point.count)
    angle = 2 * np.pi * np.arange(1, 1025)[:, None] / 1024 * orders
    shapes = (waves @ np.exp(1j * angle).T).real.T
    start = (
        waves.real.sum(axis=1),
        (1j * orders * point.omega * waves).real.sum(axis=1),
        followed(case.rubbing, np.tile(shapes @ case.rubbing.slips.T, (3, 1))),
    )
    stated = float(found.error_estimate[0])
    wanted = max(0.05 * stated, 1e-6) if np.isfinite(stated) else 1e-4
    load = case.force * case.load_row
    exact, own = steady(case.rubbing, load, point.omega, start, case.output_row[None], wanted)
    true = float(abs(found.values[0, 0, list(found.orders).index(1)] - exact[0]) / abs(exact[0]))
    return [row | {"stated": stated, "true": true, "own": own}]


def _dofs(case: Draw) -> list[str]:
    """All DOFs of the numbers, in their order."""
    names = []
    for part in (case.model.host, case.model.beam):
        along = [str(dof) for dof in part.dofs]
        names += along if case.host == "beams" else along[: len(along) // 2]
    return names


KINDS: dict[str, tuple[Callable[..., list[Row]], float]] = {
    "time": (in_time, 0.0),
    "frequency": (in_frequency, 0.01),
    "verified": (lambda case, rng: in_frequency(case, rng, verify=True), 0.01),
}
"""What is run, and the least damping ratio of its models: the truth of a steady state has to settle."""


class Patience(Exception):
    """A draw takes too long."""


def _late(*_: object) -> None:
    raise Patience


def judged(kind: str, law: str, seed: int) -> list[Row]:
    """The rows of one draw; one that says why where there is no answer."""
    solve, lightest = KINDS[kind]
    signal.signal(signal.SIGVTALRM, _late)
    signal.setitimer(signal.ITIMER_VIRTUAL, PATIENCE)
    try:
        case = draw(law, seed, lightest)
        rows = solve(case, np.random.default_rng([7, LAWS.index(law), seed]))
        return [{"law": law, "seed": seed, "host": case.host, **_short(row)} for row in rows]
    except Patience:
        return [{"law": law, "seed": seed, "late": True}]
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


def _short(row: Row) -> Row:
    """Numbers with four digits."""
    return {key: float(f"{value:.4g}") if isinstance(value, float) else value for key, value in row.items()}


def counted(rows: list[Row]) -> tuple[list[Row], list[Row]]:
    """Rows that are judged, and those among them whose error is above the stated one."""
    fair = [row for row in rows if "true" in row and row["own"] <= JUDGED * max(row["stated"], 1e-7)]
    return fair, [row for row in fair if row["true"] > row["stated"] + row["own"]]


def main() -> None:
    """Draw on where the last run ended, and write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", choices=list(KINDS), default="time")
    parser.add_argument("--law", choices=LAWS)
    parser.add_argument("--seconds", type=float, default=280.0)
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    results = json.loads(given.out.read_text()) if given.out.exists() else {}
    stamp = provenance.stamp("tests.bench.stated_errors")
    known = results.get(given.only)
    if known is None or known["stamp"]["fingerprint"] != stamp["fingerprint"]:
        known = {"stamp": stamp, "rows": []}
    results[given.only] = known
    rows, begun = known["rows"], process_time()
    done = {(row["law"], row["seed"]) for row in rows}
    for seed in range(given.first, given.draws):
        for law in [given.law] if given.law else LAWS:
            if (law, seed) in done:
                continue
            if process_time() - begun > given.seconds:
                break
            new = judged(given.only, law, seed)
            rows += new
            for row in counted(new)[1]:
                print("above:", {key: value for key, value in row.items() if key != "cpu"}, flush=True)
        given.out.parent.mkdir(exist_ok=True)
        given.out.write_text(json.dumps(results) + "\n")
    fair, above = counted(rows)
    print(f"{given.only}: {len(rows)} rows, {len(fair)} judged, {len(above)} above what was stated")


if __name__ == "__main__":
    main()
