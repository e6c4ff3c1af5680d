"""Do the 95 % bands of a placement hold 95 %? Random hosts, beams and joints, with truths that share no code.

``python -m tests.bench.blind --hosts 40 --seed 7`` draws hosts, data sheets and joints (``tests.bench.blind_hosts``),
predicts from noisy FRFs of the bare host, stores the fingerprint of every prediction, then computes the truth in time,
and prints the score. ``--law`` takes the law the sheet names (JSON), ``--joint`` further keys of ``[joint]``.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import hashlib
import json
import time
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.blind_hosts import hosts, truth
from tests.bench.blind_hosts.prediction import DRAWS, FULL, InputError, prediction
from tests.bench.blind_hosts.score import report
from tests.bench.workers import mapping


def answered(case: hosts.Case, told: dict[str, Any], known: dict[str, Any]) -> dict[str, Any]:
    """The truth at the predicted place, and at the places whose order was predicted. ``known`` keeps what was run."""

    def resonances(place: list[float], mode: int, force: float, levels: np.ndarray) -> list[list[float]]:
        key = json.dumps([place, mode, float(force), levels.tolist()])
        if key not in known:
            drive = case.measured.points[case.measured.drive]
            parts = truth.assembled(case.host, case.sheet.bar, case.joint, case.loss, drive, tuple(place), mode)
            machine = truth.Machine(parts, float(force))
            if truth.share(parts, float(force), mode) < truth.MAJORITY:
                known[key] = [[float("nan")] * 2 for _ in levels]
                return known[key]
            band = truth.search_band(parts, float(force), mode)
            known[key] = [list(machine.resonance(band, float(level), mode))[:2] for level in levels]
        return known[key]

    grids = np.array([[resonances(told["place"], mode, f, hosts.LEVELS) for f in hosts.FORCES] for mode in case.modes])
    order = [[resonances(p, m, hosts.FORCES[1], hosts.LEVELS[-1:])[0][1] for p in told["places"]] for m in case.modes]
    return {
        "frequency": grids[..., 0].transpose(0, 2, 1).tolist(),
        "damping": grids[..., 1].transpose(0, 2, 1).tolist(),
        "ranked": order,
    }


def one(number: int, seed: int, law: dict[str, Any], joint: dict[str, Any], draws: int, kept: Path | None) -> dict:
    """Draw, predict, fix the prediction, then ask the truth."""
    warnings.simplefilter("ignore", RuntimeWarning)
    case = hosts.case(seed, number)
    result: dict[str, Any] = {"host": number, "kind": case.measured.kind, "family": case.joint.family}
    started = time.process_time()
    try:
        told = prediction(case.measured, case.sheet, law, joint, draws)
    except InputError as error:
        return result | {"refused": str(error)}
    text = json.dumps(told, sort_keys=True)
    result |= {"prediction": json.loads(text), "fingerprint": hashlib.sha256(text.encode()).hexdigest()}
    result["cpu prediction [s]"] = time.process_time() - started
    store = None if kept is None else kept / f"{seed}_{number}.json"
    known = json.loads(store.read_text()) if store is not None and store.exists() else {}
    result["truth"] = answered(case, told, known)
    result["bare"] = [float(np.resize(case.host.damping, mode - 2)[mode - 3]) for mode in case.modes]
    if store is not None:
        store.write_text(json.dumps(known))
    result["cpu [s]"] = time.process_time() - started
    return result


def main() -> None:
    """Hosts one by one, or several at a time; the score at the end."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--hosts", type=int, default=40)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--seed", type=int, default=None)
    options.add_argument("--draws", type=int, default=DRAWS)
    options.add_argument("--law", type=json.loads, default={"name": "masing"})
    options.add_argument("--joint", type=json.loads, default=FULL)
    options.add_argument("--workers", type=int, default=1)
    options.add_argument("--cluster", default=None, help="address of a Dask scheduler, in place of --workers")
    options.add_argument("--out", type=Path)
    options.add_argument("--truths", type=Path, help="folder where truths are kept for another prediction of the hosts")
    chosen = options.parse_args()
    seed = int(time.time()) if chosen.seed is None else chosen.seed
    if chosen.truths is not None:
        chosen.truths.mkdir(parents=True, exist_ok=True)
    ask = partial(one, seed=seed, law=chosen.law, joint=chosen.joint, draws=chosen.draws, kept=chosen.truths)
    answers: list[dict[str, Any]] = []
    with mapping(chosen.cluster, chosen.workers) as each:
        for answer in each(ask, range(chosen.first, chosen.first + chosen.hosts)):
            answers.append(answer)
            print(
                answer["host"],
                answer["kind"],
                answer["family"],
                answer.get("refused", f"{answer.get('cpu [s]', 0):.0f} s"),
                flush=True,
            )
            if chosen.out is not None:
                chosen.out.write_text(json.dumps({"seed": seed, "answers": answers}))
    scored = [answer for answer in answers if "truth" in answer]
    print(f"seed {seed}; refused: {len(answers) - len(scored)}")
    print(report(scored))


if __name__ == "__main__":
    main()
