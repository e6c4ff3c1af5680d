"""Accuracy against known truth, against real data and against peers; writes the tables of the accuracy page.

``python -m tests.bench.accuracy`` runs everything (sizes are options), keeps each draw so that ``--resume`` goes on
after an interruption, and writes ``tests/bench/results/accuracy.json`` and ``docs/accuracy.md``. ``--quick`` takes small
numbers, about a minute a section, and writes nothing. ``--only systems,disturbed`` takes some of the sections. Seeds are
drawn at run time and printed; ``--seed`` repeats a run.

Sections: ``systems`` (coverage on random systems), ``invariance`` (the same measurement said in another way), ``disturbed``
(errors that are not noise), ``roots`` (double roots), ``setups`` (set-ups that do not agree), ``time`` (against the peer's
pole time); ``case``, ``small``, ``random``, ``residues`` (errors over the bound), ``cost``, ``listed`` and ``halves`` (real
measurements), ``peers``.
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np

import ema.fit
from acquisition.datasets import dataset_folder
from ema.data import FrfSet
from ema.fit import modal
from ema.study import Study, chain, expectations
from tests.bench import (
    cpu_time,
    disturbed,
    draws,
    halves,
    invariance,
    provenance,
    repeated_roots,
    set_ups,
    systems,
)
from tests.bench.cases import Case, case_160, case_small
from tests.bench.environments import CACHE
from tests.bench.fit import OURS, ROWS, compare, random_line, random_outcome
from tests.bench.scoring import Bound, cramer_rao, residue_bound, score
from tests.bench.workers import mapping

ROOT = Path(__file__).resolve().parents[2]
RESULT = Path(__file__).parent / "results" / "accuracy.json"
NOISES = (0.001, 0.01, 0.05)
PEERS = ("sdypy_ema", "pyfbs", "pyyeti", "pyoma2", "pydvma")
SECTIONS = ("case", "random", "small", "residues", "cost", "listed", "halves", "peers")
JUDGES: dict[str, ModuleType] = {
    "systems": systems,
    "invariance": invariance,
    "disturbed": disturbed,
    "roots": repeated_roots,
    "setups": set_ups,
    "time": cpu_time,
}
"""Benches of one form: ``COUNT`` and ``QUICK`` items, ``one(seed, number, quick)``, ``line``, ``summary``, ``report``."""
RESTS: dict[str, tuple[str, ...]] = {
    "case": ("tests.bench.draws",),
    "small": ("tests.bench.draws",),
    "random": ("tests.bench.fit", "tests.bench.ours"),
    "residues": ("tests.bench.draws",),
    "cost": ("tests.bench.draws",),
    "listed": ("ema.study.chain",),
    "halves": ("tests.bench.halves",),
    "peers": ("tests.bench.fit", "tests.bench.ours"),
    **{name: (module.__name__,) for name, module in JUDGES.items()},
}
"""The modules whose code, with all that it imports, makes the figures of a section."""
RECIPES = (("freefree_beam", "02"), ("hammer_blows", "03"), ("steel_subframe", "05"))
"""Recipes about real measurements, and how their folder begins."""


@dataclass(frozen=True)
class Sizes:
    """How much of everything: draws, systems, splits, peer seeds."""

    case: int = 100
    small: int = 1000
    random: int = 200
    residues: int = 30
    cost: int = 3
    halves: int = 4
    peers: int = 2


QUICK = Sizes(case=5, small=40, random=6, residues=3, cost=1, halves=1, peers=1)


class Kept:
    """Draws done so far, one JSON object per line in a file, so that an interrupted run can go on."""

    def __init__(self, path: Path | None, resume: bool, fixed: int | None = None) -> None:
        self.path = path
        self.fixed = fixed
        self._done: dict[str, list] = {}
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            if resume and path.exists():
                for line in path.read_text().splitlines():
                    entry = json.loads(line)
                    self._done.setdefault(entry["key"], []).append(entry["value"])
            else:
                path.write_text("")

    def items(
        self, key: str, count: int, make: Callable[[int], object], show: Callable | None = None, mapped: Callable = map
    ) -> list:
        """The first ``count`` items of ``key``; those that are missing are made, through ``mapped``, and kept."""
        done = self._done.setdefault(key, [])
        missing = range(len(done), count)
        for number, value in zip(missing, mapped(make, missing), strict=True):
            done.append(value)
            if self.path is not None:
                with self.path.open("a") as file:
                    file.write(json.dumps({"key": key, "value": value}) + "\n")
            if show is not None:
                print(show(value), flush=True)
            elif count > 1 and (number + 1) % max(1, count // 5) == 0:
                print(f"{key}: {number + 1} of {count}", flush=True)
        return done[:count]

    def seed(self, key: str) -> int:
        """The seed that was asked for, or one drawn at run time, printed, and kept."""
        if self.fixed is not None:
            print(f"{key}: seed {self.fixed}", flush=True)
            return self.fixed
        value = self.items(f"seed of {key}", 1, lambda _: int(np.random.default_rng().integers(1, 1_000_000)))[0]
        print(f"{key}: seed {value}", flush=True)
        return int(value)


def case_draws(kept: Kept, count: int, noises: tuple[float, ...], knowledge: tuple[draws.Knowledge, ...]) -> list[dict]:
    """The 160-FRF case: many noise draws on one system for each noise level."""
    return [
        _draws(kept, f"case {noise:g} {known.name}", case_160, noise, known, count)
        for noise in noises
        for known in knowledge
    ]


def small_draws(
    kept: Kept, count: int, noises: tuple[float, ...], knowledge: tuple[draws.Knowledge, ...]
) -> list[dict]:
    """The 16-FRF case: a system whose modes are all identifiable, drawn for each row."""
    return [
        _draws(kept, f"small {noise:g} {known.name}", case_small, noise, known, count)
        for noise in noises
        for known in knowledge
    ]


def _draws(
    kept: Kept, key: str, make: Callable[..., Case], noise: float, knowledge: draws.Knowledge, count: int
) -> dict:
    seed = kept.seed(key)
    case, bound = _identifiable(make, noise, seed)
    done = kept.items(key, count, lambda number: draws.one(case, bound, knowledge, [seed, number]))
    found = draws.summary(done, bound, residue_bound(case))
    found["truth"] = [
        [round(float(f), 2), round(float(z), 5)]
        for f, z in zip(
            case.truth.natural_frequencies[bound.identifiable],
            case.truth.damping_ratios[bound.identifiable],
            strict=True,
        )
    ]
    frequency, damping = found["frequency over bound"], found["damping over bound"]
    found["over bound with residual terms"] = _with_residual_terms(case, bound, frequency["single"], damping["single"])
    print(
        f"{key}: over the bound f {frequency['pooled']:.3f}, zeta {damping['pooled']:.3f} (single "
        f"{max(frequency['largest'], damping['largest']):.2f}, band to {frequency['band'][1]:.2f}); bias f "
        f"{frequency['bias']:+.3f}, zeta {damping['bias']:+.3f}; coverage f {found['frequency coverage']:.3f}, zeta "
        f"{found['damping coverage']:.3f}, residues {found['residues coverage']:.3f}; residues over the bound "
        f"{found['residue over bound']:.3f}; missed {found['missed']}, false {found['false']}",
        flush=True,
    )
    return {"noise": noise, "knowledge": knowledge.name, "seed": case.seed, **found}


def _with_residual_terms(case: Case, bound: Bound, frequency: list[float], damping: list[float]) -> dict[str, float]:
    """Errors over the bound of a fit that has to find out whether there are residual terms, pooled and the largest."""
    wide, keep = cramer_rao(case, residual_terms=True), bound.identifiable
    f = np.array(frequency) * (bound.frequency_std / wide.frequency_std)[keep]
    z = np.array(damping) * (bound.damping_std / wide.damping_std)[keep]
    return {
        "frequency": float(np.sqrt(np.mean(f**2))),
        "damping": float(np.sqrt(np.mean(z**2))),
        "largest": float(max(f.max(), z.max())),
    }


def _identifiable(make: Callable[..., Case], noise: float, seed: int) -> tuple[Case, Bound]:
    """The first system from ``seed`` on all of whose modes are identifiable."""
    for number in range(seed, seed + 200):
        case = make(noise=noise, seed=number)
        bound = cramer_rao(case)
        if bound.identifiable.all():
            return case, bound
    raise RuntimeError("no identifiable system in 200 draws")


def random_systems(kept: Kept, count: int, jobs: int = 1, cluster: str | None = None) -> dict:
    """Automatic selection, told nothing, on random systems: the three noise levels in turn."""
    seed = kept.seed("random")
    one = partial(_random_one, np.random.default_rng(seed).integers(1, 1_000_000, count).tolist())
    with mapping(cluster, jobs) as each:
        done = kept.items("random", count, one, random_line, each)
    return {"title": "random systems, default settings", "seeds": [seed], "runs": {OURS: done}}


def judged(kept: Kept, name: str, count: int | None, quick: bool, jobs: int = 1, cluster: str | None = None) -> dict:
    """One of ``JUDGES``: its items, kept under the fingerprint of the code that made them, and their summary."""
    judge = JUDGES[name]
    key = f"{name} {provenance.fingerprint(judge.__name__)}{' quick' if quick else ''}"
    seed = kept.seed(key)
    wanted = (judge.QUICK if quick else judge.COUNT) if count is None else count
    one = partial(judge.one, seed, quick=quick)
    with mapping(cluster, jobs) as each:
        rows = kept.items(f"{key} {seed}", wanted, one, judge.line, each)
    found = judge.summary(rows)
    print(judge.report(found), flush=True)
    return {"seed": seed, **found}


def _random_one(seeds: list[int], number: int) -> dict:
    return random_outcome(seeds[number], NOISES[number % len(NOISES)])


def residues(kept: Kept, count: int, noise: float = 0.01) -> dict:
    """Residues on new systems of the 160-FRF case, the first mode outside 5 % beyond each end of the band."""
    seed = kept.seed("residues")

    def make(number: int) -> dict:
        case = case_160(noise=noise, seed=seed + number)
        bound = cramer_rao(case)
        model = ema.fit.modes(case.frfs, ema.fit.stabilise(case.frfs))
        error = score(case, model, bound).residue_error
        known, allowed = np.isfinite(error), residue_bound(case)
        return {
            "median": float(np.nanmedian(error)),
            "largest": float(np.nanmax(error)),
            "missed": int(np.sum(~known)),
            "over bound": float(np.sqrt(np.mean((error[known] / allowed[known]) ** 2))),
            "bound median": float(np.median(allowed)),
            "bound largest": float(allowed.max()),
        }

    done = kept.items("residues", count, make)
    result = {name: [one[name] for one in done] for name in done[0]}
    print(
        f"residues: median {100 * np.median(result['median']):.3f} %, largest {100 * np.max(result['largest']):.2f} % "
        f"(the bound allows {100 * np.median(result['bound median']):.3f} and "
        f"{100 * np.max(result['bound largest']):.2f} %), over the bound "
        f"{np.sqrt(np.mean(np.square(result['over bound']))):.3f}, missed {sum(result['missed'])}",
        flush=True,
    )
    return {"noise": noise, "seed": seed, "systems": count, **result}


def cost(kept: Kept, count: int) -> dict:
    """Processor time of poles, of the selection, and of what follows, on the 160-FRF case."""
    seed = kept.seed("cost")

    def make(number: int) -> dict:
        frfs = case_160(noise=0.01, seed=seed + number).frfs
        return min((_timed(modal, frfs) for _ in range(3)), key=lambda one: one["poles"] + one["modes"])

    runs = kept.items("cost", count, make)
    poles, chosen, whole = (float(np.median([run[part] for run in runs])) for part in ("poles", "selection", "modes"))
    print(
        f"cost: poles {poles:.3f} s, selection {chosen:.3f} s, after it {whole - chosen:.3f} s, "
        f"{(whole - chosen) / (poles + chosen):.2f} times poles and selection",
        flush=True,
    )
    return {"seed": seed, "runs": runs}


def _timed(module: ModuleType, frfs: FrfSet) -> dict:
    """Processor times in s: ``poles``, ``selection`` and ``modes`` (selection, refinement, residues and intervals)."""
    spent = [0.0]
    plain = module.select

    def timed(*args: object, **named: object) -> object:
        start = time.process_time()
        result = plain(*args, **named)
        spent[0] += time.process_time() - start
        return result

    module.select = timed
    try:
        start = time.process_time()
        poles = ema.fit.stabilise(frfs)
        middle = time.process_time()
        ema.fit.modes(frfs, poles)
        end = time.process_time()
    finally:
        module.select = plain
    return {"poles": middle - start, "selection": spent[0], "modes": end - middle}


def listed(kept: Kept) -> list[dict]:
    """Real measurements that are on this machine, against the numbers that are listed with them."""
    rows = []
    for name, start in RECIPES:
        if any(dataset_folder().glob(f"{start}_*")):
            rows += kept.items(f"listed {name}", 1, lambda _, name=name: _listed(name))
    return rows


def _listed(name: str) -> dict:
    study = Study.load(ROOT / "reports" / f"{name}.toml")
    campaign, wanted = study.open(), study.recipe
    names = dict.fromkeys(one.run for one in wanted.expect)
    runs = tuple(chain.analyse(campaign[run], wanted.estimate, wanted.fit) for run in names)
    numbers = [
        {"what": one.what, "expected": one.expected, "tolerance": one.tolerance, "found": one.found, "met": one.met}
        for one in expectations.check(wanted.expect, runs)
    ]
    print(f"listed {name}: {sum(one['met'] for one in numbers)} of {len(numbers)} numbers met", flush=True)
    return {"key": name, "title": wanted.title, "numbers": numbers}


def real_halves(kept: Kept, count: int) -> list[dict]:
    """Splits of the real measurements that are on this machine."""
    rows = []
    for measurement in halves.available():
        seed = kept.seed(f"halves {measurement.key}")
        done = kept.items(
            f"halves {measurement.key}", count, lambda number, m=measurement, s=seed: halves.compared(m, s + number)
        )
        every = {name: np.concatenate([one[name] for one in done]) for name in ("frequency", "damping")}
        row = {"key": measurement.key, "title": measurement.title, "seed": seed, "splits": len(done)}
        row["modes"] = [one["modes"] for one in done]
        row["pairs"] = sum(len(one["frequency"]) for one in done)
        row |= {f"{name} within": float(np.mean(np.abs(every[name]) <= 1.96)) for name in every}
        row |= {f"{name} median": float(np.median(np.abs(every[name]))) for name in every}
        print(
            f"halves {row['key']}: {row['pairs']} pairs, f within {row['frequency within']:.2f} (median "
            f"{row['frequency median']:.2f} std), zeta within {row['damping within']:.2f} ({row['damping median']:.2f})",
            flush=True,
        )
        rows.append(row)
    return rows


def peers(
    kept: Kept, count: int, names: list[str], noises: tuple[float, ...], cache: Path, timeout: float
) -> list[dict]:
    """All systems on the 160-FRF case, the same draws for each; those that take minutes get one."""
    rows = []
    for noise in noises:
        key = f"peers {noise:g}"
        seed = kept.seed(key)
        row = replace(
            ROWS[0],
            key=key,
            make=lambda one, noise=noise: case_160(1601, noise, one),
            title=f"{100 * noise:g} % noise",
            peers={name: 99 if name != "pyoma2" else int(noise == 0.01) for name in names},
        )
        found = kept.items(
            key, count, lambda number, row=row, seed=seed: compare(row, [seed + number], names, cache, timeout)["runs"]
        )
        runs: dict[str, list] = {}
        for one in found:
            for name, own in one.items():
                runs.setdefault(name, []).extend(own)
        rows.append({"title": row.title, "noise": noise, "seeds": [seed + n for n in range(count)], "runs": runs})
    return rows


def parsed() -> argparse.Namespace:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.accuracy", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small numbers; nothing is written")
    parser.add_argument("--only", default=",".join((*SECTIONS, *JUDGES)), help="sections to run")
    parser.add_argument("--seed", type=int, help="one seed for all sections, instead of seeds drawn at run time")
    parser.add_argument("--resume", action="store_true", help="go on with the draws of the last run")
    parser.add_argument("--noise", help="noise levels instead of 0.001,0.01,0.05")
    parser.add_argument(
        "--knowledge",
        default="unknown,known",
        help="of unknown, known, from 5 averages; by default the last in small too",
    )
    parser.add_argument("--peers", default=",".join(PEERS), help="peers to run")
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of the environments and of the draws kept")
    parser.add_argument("--jobs", type=int, default=1, help="processes for the random systems")
    parser.add_argument("--cluster", help="address of a Dask scheduler, in place of --jobs")
    parser.add_argument("--timeout", type=float, default=900.0, help="seconds after which a peer is given up")
    sizes = ",".join(f"{name}={size}" for name, size in vars(Sizes()).items())
    parser.add_argument("--sizes", default="", help=f"such as case=20,random=50; by default {sizes}")
    return parser.parse_args()


def main() -> None:
    """Run the sections that are asked for, and write the results and the page."""
    options = parsed()
    given = dict(pair.split("=") for pair in options.sizes.split(",") if pair)
    sizes = replace(
        QUICK if options.quick else Sizes(), **{name: int(size) for name, size in given.items() if name not in JUDGES}
    )
    noises = tuple(map(float, options.noise.split(","))) if options.noise else NOISES
    every = {one.name: one for one in (draws.UNTOLD, draws.KNOWN, draws.FIVE)}
    told = tuple(every[name.strip()] for name in options.knowledge.split(","))
    small_told = told if told != (draws.UNTOLD, draws.KNOWN) else (*told, draws.FIVE)
    kept = Kept(None if options.quick else options.cache / "accuracy.jsonl", options.resume, options.seed)
    peer_names = [name for name in options.peers.split(",") if name]
    sections: dict[str, Callable[[], object]] = {
        "case": lambda: case_draws(kept, sizes.case, noises, told),
        "small": lambda: small_draws(kept, sizes.small, (noises[len(noises) // 2],), small_told),
        "random": lambda: random_systems(kept, sizes.random, options.jobs, options.cluster),
        "residues": lambda: residues(kept, sizes.residues),
        "cost": lambda: cost(kept, sizes.cost),
        "listed": lambda: listed(kept),
        "halves": lambda: real_halves(kept, sizes.halves),
        "peers": lambda: peers(kept, sizes.peers, peer_names, noises, options.cache, options.timeout),
    }
    for name in JUDGES:
        count = int(given[name]) if name in given else None
        # runs side by side would take time from each other
        jobs, cluster = (1, None) if name == "time" else (options.jobs, options.cluster)
        sections[name] = partial(judged, kept, name, count, options.quick, jobs, cluster)
    known = json.loads(RESULT.read_text()) if RESULT.exists() else {}
    for name in options.only.split(","):
        start = time.process_time()
        found = sections[name]()
        print(f"-- {name}: {time.process_time() - start:.0f} s of processor time", flush=True)
        known[name] = {"found": found, "seconds": time.process_time() - start, **provenance.stamp(*RESTS[name])}
        if not options.quick:
            RESULT.parent.mkdir(exist_ok=True)
            RESULT.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")
    if not options.quick:
        from tests.bench import write_docs

        write_docs.main()


if __name__ == "__main__":
    main()
