"""The frequency solver against pyHarm on the same double beam: points, maps, peaks. Called by ``simulate``.

pyHarm gets the matrices of the same beams with the slips among the coordinates, its own Jenkins element at every pair and
its condensation on the nonlinear coordinates. It sweeps with all harmonics up to the fifth, and with 1, 3, 5 alone.
"""

import json
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from ema.data import BeamModel, Damping
from ema.elements import Section
from ema.simulate import HarmonicBalance, Masing, damping_map, double_beam, frf, resonance
from ema.simulate.events import Harmonic, run_reference
from ema.simulate.harmonic import Condensed, condense
from ema.simulate.structure import assemble
from ema.simulate.transient import _State
from tests.bench.environments import interpreter

PEER = Path(__file__).parent / "peers" / "pyharm" / "run.py"
TIP, MU, STIFFNESS = "beam 2:20:+Z", 0.3, 1e9
BAND = (14.0, 34.0)
DAMPING = Damping(mass_factor=1.0)
RATIOS = (30.0, 100.0, 300.0, 1000.0, 4000.0)
MAPS = {"constant k_T": 0.0, "k_T(F_N)": 0.5}
SWEEPS = {300.0: (12.6, 13.4, 5), 1000.0: (26.0, 30.0, 9), 4000.0: (29.0, 33.0, 9)}
"""Hz and number of frequencies at every F_N/F_E where pyHarm is run too: where few pairs slip, and over two resonances."""
LONGEST = 120.0
"""s that pyHarm gets for a sweep."""


def model_at(ratio: float, elements: int = 20) -> BeamModel:
    """The double beam at a normal force, N."""
    return double_beam(Masing(MU, STIFFNESS), ratio, Section(0.5, 0.04, 0.005, elements=elements), damping=DAMPING)


def timed(action: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time in s, best of three where it is short, and the result."""
    times: list[float] = []
    result = None
    while len(times) < 3 and (not times or times[0] < 3.0):
        start = process_time()
        result = action()
        times.append(process_time() - start)
    return min(times), result


def peer_case(model: BeamModel, frequencies: np.ndarray, force: float, harmonics: int) -> dict[str, Any]:
    """Matrices of the model in coordinates that begin with the slips."""
    system = assemble(model)
    slips, size = system.contacts.slip, len(system.mass)
    replaced = [int(np.flatnonzero(row * (np.arange(size) >= size // 2))[0]) for row in slips]
    others = [n for n in range(size) if n not in replaced]
    back = np.linalg.inv(np.vstack([slips, np.eye(size)[others]]))
    driven = int(np.flatnonzero(system.row(TIP))[0])
    mass = back.T @ system.mass @ back
    return {
        "mass_matrix": mass,
        "stiffness_matrix": back.T @ system.stiffness @ back,
        "damping_matrix": model.damping.mass_factor * mass,
        "stiffness": system.contacts.stiffness,
        "limits": system.contacts.limits,
        "driven": len(slips) + others.index(driven),
        "force": force,
        "frequencies": frequencies,
        "harmonics": harmonics,
    }


def peer_sweep(model: BeamModel, frequencies: np.ndarray, harmonics: int, longest: float) -> dict[str, Any]:
    """pyHarm's sweep in its own process and environment, given up after ``longest`` s."""
    with tempfile.TemporaryDirectory() as folder:
        case, result = Path(folder) / "case.npz", Path(folder) / "result.json"
        np.savez(case, **peer_case(model, frequencies, 1.0, harmonics))
        command = [interpreter("pyharm"), "-P", str(PEER), str(case), str(result)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, timeout=longest)
        except subprocess.TimeoutExpired:
            ended = dict(json.loads(result.read_text())) if result.exists() else {}
            return ended | {"error": f"given up after {longest:g} s"}
        if done.returncode != 0:
            return {"error": done.stderr.strip().splitlines()[-1]}
        return dict(json.loads(result.read_text()))


def compiled() -> None:
    """Compile the solver, or read it from the cache, before anything is timed."""
    frf(model_at(300.0), np.array([20.0, 20.5]), 1.0, TIP, [TIP])


def points(ratio: float, quick: bool) -> dict[str, Any]:
    """One sweep at fixed harmonics, ours and theirs, and ours with as many as the error asks for."""
    compiled()
    low, high, count = SWEEPS[ratio]
    frequencies, model = np.linspace(low, high, 3 if quick else count), model_at(ratio)
    fixed, same = timed(lambda: frf(model, frequencies, 1.0, TIP, [TIP], settings=HarmonicBalance(harmonics=5)))
    free, ours = timed(lambda: frf(model, frequencies, 1.0, TIP, [TIP]))
    system = assemble(model).contacts
    row: dict[str, Any] = {
        "ratio": ratio,
        "from": frequencies[0],
        "to": frequencies[-1],
        "points": len(frequencies),
        "slipping": int(np.max(np.sum(np.abs(same.slips).sum(axis=-1) > system.limits / system.stiffness, axis=1))),
        "cpu five harmonics": fixed / len(frequencies),
        "cpu as many as needed": free / len(frequencies),
        "most harmonics": int(ours.orders[-1]),
        "stated": float(np.nanmax(ours.error_estimate)),
        "power": ours.power_error,
        "solved": bool(ours.converged.all()),
    }
    theirs = peer_sweep(model, frequencies, 5, LONGEST)
    for name in ("odd", "all"):
        if name not in theirs:
            continue
        sweep = theirs[name]
        known = frf(model, np.array(sweep["frequencies"]), 1.0, TIP, [TIP], settings=HarmonicBalance(harmonics=5))
        row[f"pyHarm {name}"] = {
            "cpu": sweep["cpu"],
            "accepted": sweep["accepted"],
            "points": sweep["points"],
            "ended at": max(sweep["frequencies"]),
            "difference": float(np.max(np.abs(np.array(sweep["amplitudes"]) / np.abs(known.values[:, 0, 0]) - 1))),
            "ratio": sweep["cpu"] * len(frequencies) / fixed,
        }
    row |= {name: theirs[name] for name in ("version", "error") if name in theirs}
    return row


def map_row(exponent: float, quick: bool) -> dict[str, Any]:
    """Resonances over 20 x 20 forces whose ratios all differ, with k_T ~ F_N^exponent."""
    compiled()
    count = 5 if quick else 20
    levels = np.sort(np.random.default_rng(0).uniform(1, 40, count))
    forces = np.geomspace(20, 8000, count)
    law = Masing(MU, STIFFNESS, stiffness_exponent=exponent)
    model = double_beam(law, 1000.0, damping=DAMPING)
    start = process_time()
    chart = damping_map(model, levels, forces, TIP, TIP, (10.0, 36.0))
    cpu, wrong = process_time() - start, []
    for level, force in zip(levels[::3], forces[::3], strict=True):
        one = resonance(model.with_normal_force(force), level, TIP, TIP, (10.0, 36.0), tolerance=1e-3)
        place = np.flatnonzero(levels == level)[0], np.flatnonzero(forces == force)[0]
        wrong.append(float(abs(chart.modal_amplitude[place] / one.modal_amplitude - 1)))
    return {"levels": count, "forces": count, "cpu": cpu, "errors of peaks": wrong}


def steady(condensed: Condensed, point: Any) -> _State:
    """State of a model of Masing springs at the start of a period of its harmonic solution."""
    orders, x, base = condensed.orders(point.count), condensed.modal(point), condensed.problem.base
    q, p = x.real.sum(axis=0), -(point.omega * orders[:, None] * x.imag).sum(axis=0)
    angle = 2 * np.pi * np.arange(4096)[:, None] / 4096 * orders
    motion = np.cos(angle) @ point.amplitudes[:, ::2].T + np.sin(angle) @ point.amplitudes[:, 1::2].T
    force, before = np.zeros(motion.shape[1]), np.zeros(motion.shape[1])
    for u in np.concatenate([motion, motion, motion[:1]]):
        force = np.clip(force + condensed.stiffness * (u - before), -condensed.limits, condensed.limits)
        before = u
    memory = np.zeros((len(force), condensed.problem.laws.states))
    memory[:, 0] = force
    return _State(q, p, base.slip @ q, force, memory)


def peaks(quick: bool, elements: int = 10) -> dict[str, Any]:
    """Heights of resonances against the exact time solver, started on the harmonic solution and left alone."""
    compiled()
    tip, rows = f"beam 2:{elements}:+Z", []
    for ratio in RATIOS[1:4] if quick else RATIOS:
        model = model_at(ratio, elements)
        peak = resonance(model, 1.0, tip, tip, BAND, tolerance=2e-3)
        condensed = condense(model, 1.0, tip, [tip], 2e-3)
        point = condensed.solve(peak.frequency)
        assert point is not None
        run = run_reference(
            condensed.problem,
            steady(condensed, point),
            16 / peak.frequency,
            64 * peak.frequency,
            None,
            Harmonic(1.0, peak.frequency, condensed.driven),
        )
        last = run.displacements[0][-128:]
        turns = np.arange(len(run.times) - 128, len(run.times)) / 64
        found = abs(2 / 128 * np.sum(last * np.exp(-2j * np.pi * turns)))
        rows.append(
            {
                "ratio": ratio,
                "frequency": peak.frequency,
                "damping": peak.damping,
                "stated": peak.error_estimate,
                "error": float(abs(abs(peak.amplitude) / found - 1)),
                "harmonics": int(condensed.orders(point.count)[-1]),
            }
        )
    return {"peaks": rows}
