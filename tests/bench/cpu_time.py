"""Processor time of an automatic fit, everything included, against the pole time of sdypy-EMA on the same case in one run.

Both run one after the other in processes of their own with one thread and equal orders; what ours finds is scored in the
same run. Sizes: 160 FRFs x 1601 and x 6401 lines, 300 x 3 FRFs x 4096 lines, one FRF of 25 000 lines, and 6 FRFs of
16 385 lines of a structure with friction, which no linear model fits.
"""

import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.bench import disturbances_nonlinear
from tests.bench.cases import Case, _case, _log_uniform, _spread, case_160
from tests.bench.environments import CACHE, PEERS, interpreter
from tests.bench.fit import ROWS as FIT_ROWS
from tests.bench.fit import Row, judge, run, save
from tests.bench.scoring import cramer_rao

TITLE = "Processor time"
PEER = "sdypy_ema"
TIMEOUT, TIMEOUT_QUICK = 900.0, 100.0
"""Seconds after which a run is given up."""


@dataclass(frozen=True)
class Goal:
    """A size and what is asked: most of the peer's pole time, or most seconds."""

    row: Row
    ratio: float | None
    seconds: float | None = None


def one_frf(seed: int, lines: int = 25_000) -> Case:
    """One FRF of 25 000 lines with 20 modes in 10-2500 Hz."""
    rng = np.random.default_rng([25, seed])
    frequencies = np.linspace(10.0, 2500.0, lines)
    inside, zeta = _spread(rng, 20, 10.0, 2500.0), _log_uniform(rng, 0.001, 0.02, 20)
    return _case("one FRF", seed, 0.01, frequencies, rng, inside, zeta, outputs=1, references=1, beyond=0.1)


def with_friction(seed: int, lines: int = 16_385) -> Case:
    """A structure whose joint slips up to ten times its limit: the search for further modes finds no end by itself."""
    return replace(disturbances_nonlinear.friction(np.random.default_rng([36, seed]), 10.0, lines).case, seed=seed)


GOALS = (
    Goal(FIT_ROWS[0], 0.5),
    Goal(FIT_ROWS[1], 0.4),
    Goal(Row("1x25000", "one FRF x 25 000 lines, 20 modes, 1 % noise, orders to 60", one_frf, 60, {}), None, 3.0),
    Goal(
        Row("friction", "6 FRFs x 16 385 lines, a joint that slips, 0.3 % noise, orders to 60", with_friction, 60, {}),
        None,
        5.0,
    ),
    Goal(FIT_ROWS[2], 0.15),
)
COUNT, QUICK = 20 * len(GOALS), len(GOALS) - 1
"""Runs: 20 seeds of each size; quick, one of each but the largest."""


def one(seed: int, number: int, quick: bool = False) -> dict:
    """One size and seed: ours, then the peer."""
    goal = GOALS[number % len(GOALS)]
    own_seed = int(np.random.default_rng([seed, number]).integers(1, 1_000_000))
    case = goal.row.make(own_seed)
    systems = {"ours": (Path(sys.executable), Path(__file__).parent / "ours.py")}
    if goal.ratio is not None:
        systems["peer"] = (interpreter(PEER, CACHE), PEERS / PEER / "run.py")
    found: dict = {"row": goal.row.key, "seed": own_seed}
    with tempfile.TemporaryDirectory() as folder:
        warm_up = save(case_160(401, seed=own_seed + 1), 30, Path(folder) / "warm_up.npz")
        path = save(case, goal.row.order, Path(folder) / "case.npz")
        for name, (python, script) in systems.items():
            outcome = judge(
                case, cramer_rao(case), run(python, script, warm_up, path, TIMEOUT_QUICK if quick else TIMEOUT)
            )
            kept = ("error", "time_poles", "time_selection", "found", "identifiable", "false", "version")
            found[name] = {part: outcome[part] for part in kept if part in outcome}
    return found


def _total(outcome: dict) -> float:
    return outcome["time_poles"] + outcome["time_selection"] if "error" not in outcome else float("inf")


def line(row: dict) -> str:
    """One run as a line."""
    text = f"{row['row']:9} seed {row['seed']:<7}"
    for name, part in (("ours", "everything"), ("peer", "poles")):
        outcome = row.get(name)
        if outcome is None:
            continue
        if "error" in outcome:
            text += f" {name}: {outcome['error']};"
            continue
        taken = _total(outcome) if name == "ours" else outcome["time_poles"]
        text += f" {name} {part} {taken:.2f} s, {outcome['found']} of {outcome['identifiable']}"
        text += f", false {len(outcome['false'])};"
    return text


def summary(rows: list[dict]) -> dict:
    """For each size: seconds and ratio, median and worst, recall and false modes."""
    sizes = {}
    for goal in GOALS:
        own = [row for row in rows if row["row"] == goal.row.key]
        if not own:
            continue
        seconds = np.array([_total(row["ours"]) for row in own])
        ended = [row["ours"] for row in own if "error" not in row["ours"]]
        peer = [row["peer"]["time_poles"] for row in own if "error" not in row.get("peer", {"error": ""})]
        wanted = sum(one["identifiable"] for one in ended)
        sizes[goal.row.key] = {
            "title": goal.row.title,
            "runs": len(own),
            "ended": len(ended),
            "goal ratio": goal.ratio,
            "goal seconds": goal.seconds,
            "median": _number(np.median(seconds)),
            "worst": _number(seconds.max()),
            "worst over median": _number(seconds.max() / np.median(seconds)),
            "peer": float(np.median(peer)) if peer else None,
            "ratio": _number(np.median(seconds) / np.median(peer)) if peer else None,
            "recall": sum(one["found"] for one in ended) / wanted if wanted else None,
            "false": sum(len(one["false"]) for one in ended),
            "version": next((row["peer"]["version"] for row in own if "version" in row.get("peer", {})), ""),
        }
    return {"sizes": sizes}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def report(found: dict) -> str:
    """The summary in words."""

    def said(value: float | None, unit: str = "") -> str:
        return "-" if value is None else f"{value:.3g}{unit}"

    return "\n".join(
        f"{one['title']}: median {said(one['median'], ' s')}, worst {said(one['worst'], ' s')} "
        f"({said(one['worst over median'])} x the median, goal 2); sdypy-EMA {one['version']} poles "
        f"{said(one['peer'], ' s')}; ratio {said(one['ratio'])} (goal {said(one['goal ratio'])}, or "
        f"{said(one['goal seconds'], ' s')}); recall {said(one['recall'])}, false {one['false']}; ended {one['ended']} of "
        f"{one['runs']}"
        for one in found["sizes"].values()
    )
