"""The simulator of friction beams against its peers, in the same run: OpenSeesPy in time, pyHarm in frequency.

``python -m tests.bench.simulate`` writes ``results/simulate.json`` row by row: a run that is interrupted goes on where
it ended, and rows of ``--quick`` (short runs, few points) are replaced by those of a full run. ``--only WORD`` takes the
rows whose name begins with it, ``--again`` measures them anew. One thread; processor time, best of a few repeats for
short runs. The truth of every error in time is the reference mode at half its spacing; errors are the largest over the
run, divided by the initial deflection. Snap-backs last as long as contacts slip, not until the motion has died.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from ema.data import BeamModel
from ema.dof import Dof
from ema.simulate import (
    BoucWen,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ParallelMasing,
    RegularisedMasing,
    Valanis,
    double_beam,
    snapback,
    snapback_reference,
)
from ema.simulate.transient import Drive, integrate, prepare, released
from tests.bench import provenance
from tests.bench.environments import interpreter

RESULT = Path(__file__).parent / "results" / "simulate.json"
PEER = Path(__file__).parent / "peers" / "opensees" / "run.py"
FORCES = (1000.0, 4000.0, 8000.0)
STEPS = (4e-5, 2e-5, 1e-5, 5e-6)
"""s, tried on the peer from the coarsest until its error is small enough."""
OURS = (2, 3, 4, 6, 8, 12, 16)
"""Steps between two samples, tried on one run of ours from the fewest until its error is small enough."""
ALLOWED = 1e-3
TIP, LOAD, RATE, MU, STIFFNESS = "beam 2:20:+Z", 20.0, 5000.0, 0.3, 1e9
SHARES = np.append(np.ones(19), 0.5) / 19.5
LONG = 5.0
ACTIVE = 0.1
"""s: a snap-back at 1 kN slips that long; what follows is linear."""
STEP, COUNT, PRESSED = 1e-5, 1000, 1000.0
"""s, steps and N of the rows about single steps: the first 10 ms, in which contacts slide."""

FIRST_CALLS = {
    "double_beam and snapback": "s.snapback(model, 20.0, tip, 0.01)",
    "double_beam and snapback_reference": "s.snapback_reference(model, 20.0, tip, 0.01)",
    "double_beam and frf": "s.frf(model, np.array([30.0, 31.0]), 5.0, tip, [tip])",
    "double_beam and damping_map": "s.damping_map(model, [5.0], [1000.0], tip, tip, (14.0, 34.0))",
}
SCRIPT = """
import numpy as np
import ema.simulate as s
tip = "beam 2:20:+Z"
model = s.double_beam(s.Masing(0.3, 1e9), 1000.0)
{call}
import time
print(time.process_time())
"""


def timed(action: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time in s, best of three where it is short, and the result."""
    times: list[float] = []
    result = None
    while len(times) < 3 and (not times or times[0] < LONG):
        start = process_time()
        result = action()
        times.append(process_time() - start)
    return min(times), result


def deviation(motion: Any, truth: Any) -> float:
    """Largest difference over the initial deflection."""
    return float(np.abs(np.asarray(motion) - truth).max() / abs(truth[0]))


def peer_case(force: float, duration: float, step: float) -> dict:
    """The same double beam in numbers."""
    return {
        "elements": 20,
        "length": 0.5,
        "width": 0.04,
        "height": 0.005,
        "youngs_modulus": 210e9,
        "density": 7850.0,
        "contact_stiffness": STIFFNESS,
        "normal_stiffness": 1e9,
        "slip_force": MU * force,
        "shares": SHARES.tolist(),
        "load": LOAD,
        "sampling_rate": RATE,
        "duration": duration,
        "step": step,
    }


def peer_run(force: float, duration: float, step: float) -> dict:
    """One run of OpenSeesPy in its own process and environment."""
    with tempfile.TemporaryDirectory() as folder:
        case, result = Path(folder) / "case.json", Path(folder) / "result.json"
        case.write_text(json.dumps(peer_case(force, duration, step)))
        done = subprocess.run(
            [interpreter("opensees"), "-P", str(PEER), str(case), str(result)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            hint = "; install the system packages libblas3 and liblapack3" if "libblas" in done.stderr else ""
            return {"error": done.stderr.strip().splitlines()[-1] + hint}
        return dict(json.loads(result.read_text()))


def peer_rows(force: float, duration: float, truth: np.ndarray) -> list[dict]:
    """The peer at finer and finer steps until its error is allowed."""
    rows: list[dict] = []
    for step in STEPS:
        run = peer_run(force, duration, step)
        if "error" in run:
            return [*rows, {"step": step, "error": run["error"]}]
        wrong = deviation(run["displacements"], truth)
        rows.append({"step": step, "cpu": run["cpu"] / duration, "deviation": wrong, "version": run["version"]})
        print(f"  OpenSeesPy, {1e6 * step:g} us: {rows[-1]['cpu']:.2f} s, error {wrong:.1e}", flush=True)
        if wrong <= ALLOWED:
            break
    return rows


def own_run(model: BeamModel, duration: float, truth: np.ndarray) -> dict:
    """One run of ours at the longest step whose error is allowed: as with the peer without the raising of the load, and
    without the runs beside it from which ``snapback`` takes the error that it states."""
    problem, dof = prepare(model, [TIP]), Dof.parse(TIP)
    state, row, run = released(problem, LOAD, dof), problem.base.row(problem.system, dof), {}
    for every in OURS:
        step, samples = 1 / RATE / every, round(duration * RATE)

        def motion(step: float = step, every: int = every, samples: int = samples) -> np.ndarray:
            return np.asarray(integrate(problem, state.copy(), step, every, samples, Drive(np.zeros(1)))[0]["q"] @ row)

        motion()
        cpu, moved = timed(motion)
        run = {"step": step, "cpu": cpu / duration, "deviation": deviation(moved, truth)}
        if run["deviation"] <= ALLOWED:
            break
    return run


def snapbacks(force: float, duration: float) -> dict:
    """Both modes and the peer at one normal force."""
    model = double_beam(Masing(MU, STIFFNESS), force)
    cpu_reference, reference = timed(lambda: snapback_reference(model, LOAD, TIP, duration))
    truth = snapback_reference(model, LOAD, TIP, duration, spacing=0.5 * reference.step).displacements[0]
    cpu_fast, fast = timed(lambda: snapback(model, LOAD, TIP, duration, tolerance=ALLOWED))
    row = {
        "force": force,
        "duration": duration,
        "active": float(fast.slip_time.max()),
        "fast": {
            "cpu": cpu_fast / duration,
            "deviation": deviation(fast.displacements[0], truth),
            "stated": fast.error_estimate,
            "step": fast.step,
            "energy": fast.energy.error,
        },
        "reference": {
            "cpu": cpu_reference / duration,
            "deviation": deviation(reference.displacements[0], truth),
            "method": reference.method,
            "energy": reference.energy.error,
        },
        "one run": own_run(model, duration, truth),
    }
    row["opensees"] = peer_rows(force, duration, truth)
    return row


def first_call(call: str) -> float:
    """Processor time in s of a fresh process that has to compile everything."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT.format(call=call)],
            capture_output=True,
            text=True,
            check=True,
            env=os.environ | {"NUMBA_CACHE_DIR": folder},
        )
    return float(done.stdout.split()[-1])


def compiled(solver: Callable[..., Any]) -> None:
    """Compile a time solver, or read it from the cache, before anything is timed."""
    solver(double_beam(Masing(MU, STIFFNESS), 1000.0), LOAD, TIP, 0.01)


def snapback_row(force: float, quick: bool) -> dict:
    """Both modes and the peer at one normal force."""
    compiled(snapback)
    compiled(snapback_reference)
    return snapbacks(force, ACTIVE)


def steps_row(quick: bool) -> dict:
    """Processor time of a step of every law, us, and its share of a step of Masing's in the same run."""
    k = STIFFNESS
    laws = {
        "masing": Masing(MU, k),
        "parallel masing, 3 springs": ParallelMasing(MU, k, [0.5, 0.3, 0.2], [0.2, 0.3, 0.5]),
        "iwan, 60 springs": Iwan(MU, k, -0.5, 1.0, 60),
        "dahl": Dahl(MU, k),
        "valanis": Valanis(MU, k),
        "regularised masing, m = 8": RegularisedMasing(MU, k, 8.0),
        "bouc wen": BoucWen(MU, k, 2.0, 0.2),
        "lugre": LuGre(MU, k, 1e3, 10.0, 1.2, 1e-2),
    }
    prepared = {}
    for name, law in laws.items():
        problem = prepare(double_beam(law, PRESSED), [TIP])
        prepared[name] = problem, released(problem, LOAD, Dof.parse(TIP))

    def run(name: str) -> float:
        start = process_time()
        integrate(*prepared[name], STEP, 10, COUNT // 10, Drive(np.zeros(1)))
        return 1e6 * (process_time() - start) / COUNT

    for name in laws:
        run(name)  # compiled, or read from the cache
    turns = [{name: run(name) for name in laws} for _ in range(3 if quick else 9)]
    return {
        "laws": {
            name: {
                "us": min(turn[name] for turn in turns),
                "ratio": float(np.median([turn[name] / turn["masing"] for turn in turns])),
            }
            for name in laws
        }
    }


def jobs() -> dict[str, Callable[[bool], dict]]:
    """Every row by its name: what measures it, given whether it is to be quick."""
    from tests.bench import simulate_frequency as frequency

    rows: dict[str, Callable[[bool], dict]] = {
        f"first call, {name}": lambda _, call=call: {"cpu": first_call(call)}  # type: ignore[misc]
        for name, call in FIRST_CALLS.items()
    }
    rows |= {f"snap-back, {force:g} N": partial(snapback_row, force) for force in FORCES}
    rows |= {f"point, {ratio:g}": partial(frequency.points, ratio) for ratio in frequency.SWEEPS}
    rows |= {f"map, {name}": partial(frequency.map_row, exponent) for name, exponent in frequency.MAPS.items()}
    return rows | {"steps": steps_row, "peaks": frequency.peaks}


def main() -> None:
    """Run what is missing and write it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--out", type=Path, default=RESULT)
    told = parser.parse_args()
    rows = json.loads(told.out.read_text())["rows"] if told.out.exists() else {}
    for name, job in jobs().items():
        known = rows.get(name)
        done = known is not None and not provenance.outdated(known) and (told.quick or not known["quick"])
        if not name.startswith(told.only) or (done and not told.again):
            continue
        # a first call and a snap-back are always whole ones
        quick = told.quick and not name.startswith(("first call", "snap-back"))
        row = {"quick": quick, **provenance.stamp("tests.bench.simulate")}
        rows[name] = row | job(quick)
        print(name, {key: value for key, value in rows[name].items() if key != "machine"}, flush=True)
        told.out.parent.mkdir(exist_ok=True)
        told.out.write_text(json.dumps({"rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
