"""Two workers against one: ``python -m tests.bench.machines --folder SCRATCH``.

A campaign of 40 random tests, a map of 60 conditions and hosts of the blind bench are computed on a Dask cluster of one
worker process and on one of two, each with one thread, and have to give the same numbers. Wall clock runs from the
opening of the campaign to its report, without the start of the workers and what they import; other work on the machine
disturbs it, so that the processor time of each worker stands beside it. ``--publish`` stores the figures, which
docs/large.md shows.
"""

import argparse
import json
import os
import shutil
import time
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import acquisition
from ema import store
from ema.cli import cluster
from ema.study import Study
from ema.study.remote import in_order
from tests.bench import blind, provenance, recordings
from tests.unit import test_map_campaign

RESULT = Path(__file__).with_name("results") / "machines.json"
SEED, CHANNELS, SAMPLES, DRAWS = 20261128, 4, 2**16, 40
LEVELS, FORCES = (5, 10, 20, 40, 60, 80), tuple(range(50, 550, 50))


def campaign(folder: Path, runs: int) -> None:
    """Random tests of a few channels, and the recipe of their study."""
    recordings.generate(folder / "campaign", runs, CHANNELS, SAMPLES, SEED)
    (folder / "study.toml").write_text('campaign = "campaign"\n\n[estimate]\nblock = 4096\n', encoding="utf-8")


def of_campaign(folder: Path, executor: Executor, output: Path) -> list[Any]:
    """Modes of all runs, with their intervals."""
    Study.load(folder / "study.toml", output=output).run(executor=executor)
    found = []
    for run in store.load(output / "study.h5").runs:
        found += [run.modes.poles.tolist(), run.modes.covariance.tolist()]
    return found


def of_map(folder: Path, executor: Executor, output: Path) -> list[Any]:
    """The map of the stepped sines."""
    study = Study.load(folder / "map.toml", output=output)
    runs = acquisition.open_campaign(folder / "map")
    found = study.mapped(runs, study.recipe.map[0], study.recipe.estimate, executor=executor).chart
    return [np.nan_to_num(getattr(found, name)).tolist() for name in ("frequency", "damping")]


def of_blind(hosts: int, executor: Executor, output: Path) -> list[Any]:
    """Forecasts of hosts of the blind bench."""
    ask = partial(blind.one, seed=SEED, law={"name": "masing"}, joint=blind.FULL, draws=DRAWS, kept=None)
    answers = in_order([executor.submit(ask, number) for number in range(hosts)])
    return [{key: value for key, value in answer.items() if not key.startswith("cpu")} for answer in answers]


def imported() -> None:
    """Load the packages that compute, as workers that have computed before have."""
    import ema.compare
    import ema.estimate
    import ema.fit
    import ema.place
    import ema.study.remote  # noqa: F401


def computed(count: int, work: Callable[[Executor, Path], list[Any]], output: Path) -> tuple[list[Any], dict[str, Any]]:
    """What a cluster of so many workers gives, wall clock and the processor time of each worker in seconds."""
    from distributed import LocalCluster, get_client

    shutil.rmtree(output, ignore_errors=True)
    with (
        LocalCluster(
            n_workers=count, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
        ) as local,
        cluster.workers(local.scheduler_address, 1) as executor,
    ):
        assert executor is not None
        client = get_client()
        client.run(imported)
        before, wall = client.run(time.process_time), time.perf_counter()
        found = work(executor, output)
        wall, after = time.perf_counter() - wall, client.run(time.process_time)
        return found, {"wall": wall, "cpu": [after[worker] - before[worker] for worker in before]}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.machines", description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="where campaigns are written for a while")
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--hosts", type=int, default=8)
    parser.add_argument("--only", default="campaign,map,blind")
    parser.add_argument("--publish", action="store_true", help=f"store the figures in {RESULT.name}")
    given = parser.parse_args()
    folder = given.folder / "machines"
    rows = json.loads(RESULT.read_text())["rows"] if RESULT.exists() else {}
    try:
        campaign(folder, given.runs)
        test_map_campaign.campaign(folder / "map", LEVELS, FORCES)
        (folder / "map.toml").write_text('campaign = "map"\n\n[[map]]\nnear = 497\n', encoding="utf-8")
        tasks = {
            "campaign": (f"campaign of {given.runs} runs", partial(of_campaign, folder)),
            "map": (f"map of {len(LEVELS) * len(FORCES)} conditions", partial(of_map, folder)),
            "blind": (f"blind bench, {given.hosts} hosts", partial(of_blind, given.hosts)),
        }
        for name in given.only.split(","):
            title, work = tasks[name]
            (one, alone), (two, both) = (computed(count, work, folder / f"{name}_{count}") for count in (1, 2))
            row = {
                "one": alone,
                "two": both,
                "identical": json.dumps(one, default=repr) == json.dumps(two, default=repr),  # NaN is NaN
                "faster": alone["wall"] / both["wall"],
                "load": os.getloadavg()[0],
            }
            print(title, json.dumps(row), flush=True)
            rows[title] = row | provenance.stamp("tests.bench.machines")
            if given.publish:
                RESULT.write_text(json.dumps({"rows": rows}, indent=1) + "\n")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
