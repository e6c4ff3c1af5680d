"""Poles, selection and modes on cases with known truth: ours and the peers in one run.

``python -m tests.bench.fit`` writes ``tests/bench/results/fit.json``; ``--quick`` runs ours alone and writes nothing.
Seeds are drawn at run time and printed.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ema.data import ModalModel
from tests.bench import provenance
from tests.bench.cases import Case, case_160, case_large, random_system
from tests.bench.environments import CACHE, NAMES, PEERS, interpreter
from tests.bench.scoring import Bound, cramer_rao, modes_of_poles, score

OURS = "friction-ema"
RESULT = Path(__file__).parent / "results" / "fit.json"
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "QT_QPA_PLATFORM": "offscreen",
    "MPLBACKEND": "Agg",
}


@dataclass(frozen=True)
class Row:
    """One line of the comparison: how a case is made, the highest model order, and how many seeds each peer gets."""

    key: str
    title: str
    make: Callable[[int], Case]
    order: int
    peers: dict[str, int]


ROWS = (
    Row(
        "160x1601",
        "80 outputs x 2 references x 1601 lines, 20 modes, 1 % noise, orders to 60",
        lambda seed: case_160(1601, seed=seed),
        60,
        {"sdypy_ema": 99, "pyfbs": 99, "pyyeti": 99, "pyoma2": 1},
    ),
    Row(
        "160x6401",
        "80 outputs x 2 references x 6401 lines, 20 modes, 1 % noise, orders to 60",
        lambda seed: case_160(6401, seed=seed),
        60,
        {"sdypy_ema": 99, "pyfbs": 99, "pyyeti": 99},
    ),
    Row(
        "900x4096",
        "300 outputs x 3 references x 4096 lines, 60 modes, 1 % noise, orders to 100",
        lambda seed: case_large(4096, seed=seed),
        100,
        {"sdypy_ema": 99, "pyfbs": 2, "pyyeti": 99},
    ),
)


def run(python: Path, script: Path, warm_up: Path, case: Path, timeout: float) -> dict:
    """What the harness measured, or ``{"error": ...}``."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        harness = PEERS / "harness.py"
        command = [str(part) for part in (python, "-P", harness, script, warm_up, case, answer)]
        try:
            done = subprocess.run(
                command, env={**os.environ, **ONE_THREAD}, capture_output=True, text=True, timeout=timeout, check=False
            )
        except subprocess.TimeoutExpired:
            return {"error": f"not finished within {timeout:g} s"}
        if done.returncode or not answer.exists():
            last = done.stderr.strip().splitlines()[-1:] or ["no message"]
            return {"error": f"ended with status {done.returncode}: {last[0]}"}
        return json.loads(answer.read_text())


def save(case: Case, order: int, path: Path) -> Path:
    """The file that every system reads; ``told`` is for those that must be told the frequencies."""
    places = [case.truth.dofs.index(dof) for dof in case.truth.inputs]
    np.savez(
        path,
        frequencies=case.frfs.frequencies,
        values=case.frfs.values,
        order=order,
        places=places,
        told=case.truth.natural_frequencies,
    )
    return path


def judge(case: Case, bound: Bound, outcome: dict) -> dict:
    """The outcome with its score in place of its poles and shapes."""
    if "error" in outcome:
        return {"seed": case.seed, **outcome}
    poles = _complex(outcome.pop("poles"))
    if "shapes" in outcome:
        model = ModalModel(
            poles=poles,
            shapes=_complex(outcome.pop("shapes")),
            dofs=case.truth.dofs,
            inputs=case.truth.inputs,
            participation=_complex(outcome.pop("participation")),
        )
    else:
        model = modes_of_poles(case, poles)
    return {"seed": case.seed, **outcome, **scored(case, bound, model)}


def scored(case: Case, bound: Bound, model: ModalModel) -> dict:
    """Score of a model as plain numbers: frequencies in Hz, errors as fractions, ratios to the bound."""
    result = score(case, model, bound)
    truth = case.truth
    return {
        "modes": len(truth.poles),
        "identifiable": int(bound.identifiable.sum()),
        "found": int(np.sum(result.match[bound.identifiable] >= 0)),
        "missed": [
            [round(float(truth.natural_frequencies[mode]), 2), round(float(truth.damping_ratios[mode]), 5)]
            for mode in result.missed
        ],
        "false": [round(float(model.natural_frequencies[index]), 2) for index in result.false],
        "frequency_error": result.median_frequency_error,
        "damping_error": result.median_damping_error,
        "damping_bias": _mean(result.damping_error),
        "frequency_ratio": _rms(result.frequency_ratio),
        "damping_ratio": _rms(result.damping_ratio),
        "residue_error": float(np.nanmedian(result.residue_error)) if result.found else float("nan"),
        "residue_error_largest": float(np.nanmax(result.residue_error)) if result.found else float("nan"),
        "bound_frequency": float(np.median(bound.frequency_std / truth.natural_frequencies)),
        "bound_damping": float(np.median(bound.damping_std / truth.damping_ratios)),
        "data_bytes": case.frfs.values.nbytes,
    }


def _complex(parts: dict) -> np.ndarray:
    return (np.array(parts["re"]) + 1j * np.array(parts["im"])).reshape(parts["shape"])


def _rms(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def compare(row: Row, seeds: list[int], peers: Iterable[str], cache: Path, timeout: float) -> dict:
    """All systems on the row's case, seed by seed."""
    runs: dict[str, list[dict]] = {}
    with tempfile.TemporaryDirectory() as folder:
        warm_up = save(case_160(401, seed=seeds[0] + 1), 30, Path(folder) / "warm_up.npz")
        for count, seed in enumerate(seeds):
            case = row.make(seed)
            bound = cramer_rao(case)
            path = save(case, row.order, Path(folder) / "case.npz")
            systems = {OURS: (Path(sys.executable), Path(__file__).parent / "ours.py")}
            for peer in peers:
                if count < row.peers.get(peer, 0):
                    systems[peer] = (interpreter(peer, cache), PEERS / peer / "run.py")
            for name, (python, script) in systems.items():
                outcome = judge(case, bound, run(python, script, warm_up, path, timeout))
                runs.setdefault(name, []).append(outcome)
                print(line(row, name, outcome), flush=True)
    return {"title": row.title, "order": row.order, "seeds": seeds, "runs": runs}


def line(row: Row, name: str, outcome: dict) -> str:
    """One run as a line, with every miss."""
    start = f"{row.key:9} seed {outcome['seed']:<7} {NAMES.get(name, name):13}"
    if "error" in outcome:
        return f"{start} {outcome['error']}"
    text = (
        f"{start} poles {outcome['time_poles']:7.2f} s, selection {outcome['time_selection']:6.2f} s, "
        f"{outcome['extra_memory'] / outcome['data_bytes']:5.1f} x data, "
        f"{outcome['found']:2} of {outcome['identifiable']:2}, false {len(outcome['false'])}, "
        f"damping error {100 * outcome['damping_error']:.3f} %, {outcome['damping_ratio']:.2f} x bound"
    )
    if outcome["missed"]:
        text += "; missed " + ", ".join(f"{f:g} Hz ({100 * z:.2f} %)" for f, z in outcome["missed"])
    if outcome["false"]:
        text += "; false " + ", ".join(f"{f:g} Hz" for f in outcome["false"])
    return text


def random_systems(seeds: list[int]) -> dict:
    """Ours on random systems with default settings: recall of identifiable modes and false modes."""
    runs = []
    for seed in seeds:
        runs.append(random_outcome(seed))
        print(random_line(runs[-1]), flush=True)
    return {"title": "random systems, default settings", "seeds": seeds, "runs": {OURS: runs}}


def random_outcome(seed: int, noise: float | None = None) -> dict:
    """Ours on one random system, told nothing; the noise is drawn too unless given."""
    import ema.fit

    case = random_system(seed, noise)
    bound = cramer_rao(case)
    try:
        outcome = scored(case, bound, ema.fit.modes(case.frfs, ema.fit.stabilise(case.frfs)))
    except Exception as error:  # one system that fails must not hide the others
        outcome = {"error": f"{type(error).__name__}: {error}"}
    _, outputs, references = case.frfs.values.shape
    return outcome | {"seed": seed, "noise": case.noise, "outputs": outputs, "references": references}


def random_line(outcome: dict) -> str:
    """One random system as a line, with every miss."""
    start = (
        f"random seed {outcome['seed']:<7} {outcome['outputs']:3} x {outcome['references']}, "
        f"noise {100 * outcome['noise']:g} %:"
    )
    if "error" in outcome:
        return f"{start} {outcome['error']}"
    text = f"{start} {outcome['found']} of {outcome['identifiable']} identifiable of {outcome['modes']}"
    if outcome["missed"]:
        text += "; missed " + ", ".join(f"{f:g} Hz ({100 * z:.2f} %)" for f, z in outcome["missed"])
    if outcome["false"]:
        text += "; false " + ", ".join(f"{f:g} Hz" for f in outcome["false"])
    return text


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.fit", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="ours alone; nothing is written")
    parser.add_argument("--rows", default=",".join(row.key for row in ROWS), help="rows to run, or 'none'")
    parser.add_argument("--peers", default=",".join(NAMES), help="peers to run")
    parser.add_argument("--count", type=int, default=3, help="seeds drawn for each row")
    parser.add_argument("--random", type=int, default=20, help="random systems for the automatic selection")
    parser.add_argument("--seeds", help="use these seeds, separated by commas, instead of drawing")
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of the peers' environments")
    parser.add_argument("--timeout", type=float, default=900.0, help="seconds after which a run is given up")
    options = parser.parse_args()
    generator = np.random.default_rng()

    def seeds(count: int) -> list[int]:
        return [int(seed) for seed in options.seeds.split(",")] if options.seeds else _draw(generator, count)

    peers = [] if options.quick else [peer for peer in options.peers.split(",") if peer]
    known = json.loads(RESULT.read_text()) if RESULT.exists() else {"rows": {}}
    for row in ROWS:
        if row.key in options.rows.split(","):
            known["rows"][row.key] = compare(row, seeds(options.count), peers, options.cache, options.timeout)
            known["rows"][row.key] |= _stamp()
            _keep(known, options.quick)
    if options.random:
        known["rows"]["random"] = random_systems(seeds(options.random)) | _stamp()
        _keep(known, options.quick)


def _draw(generator: np.random.Generator, count: int) -> list[int]:
    return [int(seed) for seed in generator.integers(1, 1_000_000, count)]


def _stamp() -> dict:
    return provenance.stamp("tests.bench.fit", "tests.bench.ours")


def _keep(known: dict, quick: bool) -> None:
    if not quick:
        RESULT.parent.mkdir(exist_ok=True)
        RESULT.write_text(json.dumps(known, indent=1) + "\n")


if __name__ == "__main__":
    main()
