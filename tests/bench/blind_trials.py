"""Does the next best test keep its promise? Hosts, sheets and joints of the blind bench, with truths of every test.

``python -m tests.bench.blind_trials --hosts 40 --seed 7``: forecast and tests from noisy FRFs of the bare host
(``ema.place.next_tests``), then the truth in time of the forecast and of what every test reads, with errors as stated;
the forecast is updated with each test in turn and scored with the truth. Loops of one joint are those of its sliders
alone, without rocking, at low speed.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ema import place
from ema.data import Geometry, Trial, Trials
from ema.errors import InputError
from ema.place.job import place as placed
from ema.study import chain
from ema.study.recipe import FitTable
from tests.bench.blind_hosts import hosts, truth
from tests.bench.blind_hosts.prediction import DRAWS, FULL, frfs_of, recipe_of
from tests.bench.blind_hosts.score import ACTIVE

OTHERS = 2
"""Other places at which the beam can be tried."""


def told(case: hosts.Case, draws: int) -> Trials:
    """The forecast with its tests, from the noisy FRFs of the bare host and the sheet alone."""
    measured = case.measured
    points = np.column_stack([measured.points, np.zeros(len(measured.points))])
    geometry = Geometry(np.arange(1, len(points) + 1), points)
    bare = chain.fitted(frfs_of(measured), FitTable())[1]
    answer = placed(recipe_of(measured, case.sheet, {"name": "masing"}, FULL, draws, OTHERS), bare, geometry)
    assert answer.trials is not None
    return answer.trials


class Truth:
    """What beams and joints of a case do, each motion computed once; ``numbers`` are those of its modes in forecasts."""

    def __init__(self, case: hosts.Case, numbers: tuple[int, ...], known: dict[str, Any]) -> None:
        self.case, self.numbers, self.known = case, numbers, known

    def resonance(self, spot: tuple[float, ...], mode: int, force: float, level: float) -> list[float]:
        """Frequency in Hz and damping ratio of the resonance of a bare mode, NaN where none holds half of it."""
        key = json.dumps([spot, mode, float(force), [float(level)]])
        if key not in self.known:
            case, drive = self.case, self.case.measured.points[self.case.measured.drive]
            parts = truth.assembled(case.host, case.sheet.bar, case.joint, case.loss, drive, spot, mode)
            found = [float("nan")] * 2
            if truth.share(parts, float(force), mode) >= truth.MAJORITY:
                band = truth.search_band(parts, float(force), mode)
                found = list(truth.Machine(parts, float(force)).resonance(band, float(level), mode))[:2]
            self.known[key] = found
        return list(self.known[key])

    def readings(self, trial: Trial) -> np.ndarray:
        """What a test reads without errors, in the order of its readings."""
        if trial.kind == "loop":
            return self.loops(trial)
        spot = (*trial.centre, trial.angle)
        rows = [self.resonance(spot, mode, trial.normal_force, trial.force_level) for mode in self.case.modes]
        names = [f"mode {mode}: {what}" for mode in self.numbers for what in ("f [Hz]", "zeta [-]")]
        return np.array([dict(zip(names, np.ravel(rows), strict=True))[name] for name in trial.readings])

    def loops(self, trial: Trial) -> np.ndarray:
        """First harmonic and energy of nine sliders in parallel, each in closed form (Masing springs)."""
        case, joint = self.case, self.case.joint
        stated = case.sheet.tangential * (trial.normal_force / case.sheet.reference) ** case.sheet.exponent
        mu, k_t = joint.uneven[0]
        stiffness = joint.tangential * (trial.normal_force / joint.reference) ** joint.exponent * k_t / truth.SLIDERS
        limits = joint.friction * mu * trial.normal_force * joint.force_factor * np.array(joint.pressure[0])
        result = []
        for name in trial.readings:
            slip = float(name.split(" at ")[1].split()[0]) * case.sheet.friction * trial.normal_force / stated
            y = np.minimum(limits / (stiffness * slip), 1.0)
            theta = np.arccos(1 - 2 * y)
            elastic = stiffness * (theta - np.sin(2 * theta) / 2) / np.pi
            energy = 4 * limits * (slip - np.minimum(limits / stiffness, slip))
            result.append(float(np.sum(elastic if name.startswith("stiffness") else energy)))
        return np.array(result)


def scored(offered: Trials, true: np.ndarray, bare: list[float], skipped: tuple[int, int] | None) -> list[list[float]]:
    """One row per mode, condition and quantity with a truth: quantity, active, inside, half width (logarithm)."""
    told, rows = offered.forecast, []
    for m, i, j in np.ndindex(told.damping.shape):
        if (i, j) == skipped:
            continue
        for q, name in enumerate(("frequency", "damping")):
            low, high = (float(getattr(told, name + end)[m, i, j]) for end in ("_low", "_high"))
            value = true[m, q, i, j]
            if np.isfinite([low, high, value, true[m, 1, i, j]]).all():
                active = float(true[m, 1, i, j] > ACTIVE * bare[m])
                rows.append([q, active, float(low <= value <= high), 0.5 * np.log(high / low)])
    return rows


def one(number: int, seed: int, draws: int, kept: Path | None) -> dict[str, Any]:
    """A host: its forecast, and the forecast after every test that has a truth."""
    warnings.simplefilter("ignore", RuntimeWarning)
    case = hosts.case(seed, number)
    result: dict[str, Any] = {"host": number, "family": case.joint.family}
    started = time.process_time()
    try:
        offered = told(case, draws)
    except InputError as error:
        return result | {"refused": str(error)}
    store = None if kept is None else kept / f"{seed}_{number}.json"
    forecast = offered.forecast
    stored = json.loads(store.read_text()) if store is not None and store.exists() else {}
    known, rng = Truth(case, forecast.modes, stored), np.random.default_rng([seed, number, 1])
    spot = (*forecast.centre, forecast.angle)
    true = np.full((len(case.modes), 2, *forecast.damping.shape[1:]), np.nan)
    for m, i, j in np.ndindex(forecast.damping.shape):
        level, force = float(forecast.force_levels[i]), float(forecast.normal_forces[j])
        true[m, :, i, j] = known.resonance(spot, case.modes[m], force, level)
    bare = [float(np.resize(case.host.damping, mode - 2)[mode - 3]) for mode in case.modes]
    tests = []
    for row, trial in enumerate(offered.trials):
        read = known.readings(trial) * np.exp(trial.std * rng.standard_normal(len(trial.std)))
        read[~(read > 0)] = np.nan
        if not np.isfinite(read).any():
            continue
        after = place.updated(offered, row, read)
        at = [k for k, x in enumerate(forecast.force_levels) if x == trial.force_level]
        at += [k for k, x in enumerate(forecast.normal_forces) if x == trial.normal_force]
        same = trial.kind == "beam" and trial.centre == forecast.centre and len(at) == 2
        kind = "beam at its place" if same else "beam elsewhere" if trial.kind == "beam" else "loops"
        tests.append(
            {
                "kind": kind,
                "hours": trial.hours,
                "promised": trial.damping_width,
                "reached": after.damping_width,
                "named": [finding.code for finding in after.findings],
                "rows": scored(after, true, bare, (at[0], at[1]) if same else None),
                "best": row == offered.best,
            }
        )
    if store is not None:
        store.write_text(json.dumps(known.known))
    return result | {
        "now": offered.damping_width,
        "before": scored(offered, true, bare, None),
        "tests": tests,
        "cpu [s]": time.process_time() - started,
    }


def report(answers: list[dict[str, Any]]) -> str:
    """Coverage before and after, by kind of test; promises and what came; the proposed test against the others."""
    lines = [f"{len(answers)} hosts, {sum(len(one['tests']) for one in answers)} tests"]
    for title, picked in (
        ("before", [one["before"] for one in answers]),
        *(
            (kind, [np.concatenate(rows) for one in answers if (rows := [t["rows"] for t in one["tests"] if t["kind"] == kind])])
            for kind in ("beam at its place", "beam elsewhere", "loops")
        ),
        ("after the best", [test["rows"] for one in answers for test in one["tests"] if test["best"]]),
    ):  # fmt: skip
        rng = np.random.default_rng(0)
        for q, name in enumerate(("f", "zeta")):
            for active, how in ((1.0, "active"), (0.0, "inactive")):
                each = [np.array(rows).reshape(-1, 4) for rows in picked]
                each = [rows[(rows[:, 0] == q) & (rows[:, 1] == active)] for rows in each]
                together = np.concatenate(each)
                if not len(together):
                    continue
                counts = np.array([[rows[:, 2].sum(), len(rows)] for rows in each])
                drawn = counts[rng.integers(0, len(counts), (2000, len(counts)))].sum(axis=1)
                low, high = np.nanquantile(drawn[:, 0] / np.maximum(drawn[:, 1], 1), [0.025, 0.975])
                half = 100 * np.median(together[:, 3])
                lines.append(
                    f"{title:18s} {how:8s} {name:4s} inside {together[:, 2].mean():.1%} of {len(together)} "
                    f"[{low:.1%}, {high:.1%}], half width median {half:.2f} %"
                )
    tests = [(one["now"], test) for one in answers for test in one["tests"]]
    promised, reached = (np.array([1 - test[name] / now for now, test in tests]) for name in ("promised", "reached"))
    some = promised > 0.05
    ratio = reached[some] / promised[some]
    lines.append(
        f"narrowing of the bands of zeta, promised above 5 %: {some.sum()} tests, reached over promised median "
        f"{np.median(ratio):.2f}, within a factor 2 {np.mean((ratio >= 0.5) & (ratio <= 2)):.0%}"
    )
    better = []
    for answer in answers:
        gain = [(1 - test["reached"] / answer["now"]) / test["hours"] for test in answer["tests"]]
        best = [value for value, test in zip(gain, answer["tests"], strict=True) if test["best"]]
        if best:
            better.append(best[0] >= np.median(gain))
    lines.append(
        f"the test proposed narrows at least as much per hour as the median one on {sum(better)} of {len(better)}"
    )
    named = sum("trial-unexpected" in test["named"] for _, test in tests)
    lines.append(f"unexpected readings: {named} of {len(tests)}")
    return "\n".join(lines)


def main() -> None:
    """Hosts one by one; the score at the end."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--hosts", type=int, default=40)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--seed", type=int, default=None)
    options.add_argument("--draws", type=int, default=DRAWS)
    options.add_argument("--out", type=Path)
    options.add_argument("--truths", type=Path, help="folder where truths are kept for another forecast of the hosts")
    chosen = options.parse_args()
    seed = int(time.time()) if chosen.seed is None else chosen.seed
    if chosen.truths is not None:
        chosen.truths.mkdir(parents=True, exist_ok=True)
    answers = []
    for number in range(chosen.first, chosen.first + chosen.hosts):
        answers.append(one(number, seed, chosen.draws, chosen.truths))
        print(
            number,
            answers[-1]["family"],
            answers[-1].get("refused", f"{answers[-1].get('cpu [s]', 0):.0f} s"),
            flush=True,
        )
        if chosen.out is not None:
            chosen.out.write_text(json.dumps({"seed": seed, "answers": answers}))
    known = [answer for answer in answers if "tests" in answer]
    print(f"seed {seed}; refused: {len(answers) - len(known)}")
    print(report(known))


if __name__ == "__main__":
    main()
