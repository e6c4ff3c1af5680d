"""How long an archive of 100 000 runs takes: ``python -m tests.bench.archive``.

2000 campaigns of 50 runs with kept results are generated and added on two processes (``--read`` for fewer); an archive of
2000 such campaigns, written from their truth, is asked three questions with their pictures. The last campaigns are then
added once more to the archive without them, while three processes ask and the adding one is killed again and again: what
comes out has to be the same archive. Wall clock and processor time: other work on the machine disturbs the first.
``--publish`` stores the figures for docs/speed.md.
"""

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from datetime import date
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from ema import archive
from ema.archive import Query, parts
from ema.data.modal import COVERAGE_FACTOR
from tests.bench import archive_campaigns as generated
from tests.bench.provenance import stamp

RESULT = Path(__file__).with_name("results") / "archive.json"
QUERIES = {
    "F_N 100 to 300 N, f 490 to 510 Hz, from 2023 on": Query(
        normal_force=(100.0, 300.0), frequency=(490.0, 510.0), since=date(2023, 1, 1)
    ),
    "one structure, f 490 to 510 Hz": Query(structure="structure 07", frequency=(490.0, 510.0)),
    "runs with a double hit, damping 1.5 to 3 %": Query(finding="double-hit", damping=(0.015, 0.03)),
}
SEED = 20261123
LATE, KILLS, READERS = 40, 4, 3
"""Campaigns that are added while others read, times that the adding process is killed, processes that read."""


def timed(work: Callable[[], Any], repeats: int = 1) -> tuple[dict[str, float], Any]:
    """Wall clock and processor time with that of ended children in seconds, the best of ``repeats``; and the result."""
    best, result = {"wall": float("inf"), "cpu": float("inf")}, None
    for _ in range(repeats):
        wall, before = time.perf_counter(), os.times()
        result = work()
        after = os.times()
        cpu = sum(after[:4]) - sum(before[:4])
        best = {"wall": min(best["wall"], time.perf_counter() - wall), "cpu": min(best["cpu"], cpu)}
    return best, result


def built(folder: Path, campaigns: list[Path]) -> Any:
    """Add all campaigns on two processes."""
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        return archive.add(folder, [generated.source_of(one) for one in campaigns], executor=pool)


def disturbed(whole: Path, folder: Path, places: list[Path]) -> dict[str, Any]:
    """Add the last campaigns of an archive under readers and by a process that is killed; how the readers fared.

    The parts have to be those of the archive that nothing disturbed.
    """
    late = {str(place.resolve()) for place in places[-LATE:]}
    for name in parts.names(whole):
        if parts.read(whole, name).seen["study"] not in late:
            parts.copy(whole, folder, name)
    archive.find(folder, Query(run="run_000"))  # the cache is filled
    context, rng = get_context("spawn"), np.random.default_rng(SEED)
    ended, answers = context.Event(), context.Queue()
    readers = [context.Process(target=_read_on, args=(folder, ended, answers)) for _ in range(READERS)]
    for reader in readers:
        reader.start()
    kills, begin = 0, time.perf_counter()
    while True:
        adder = context.Process(target=_add, args=(folder, places[-LATE:]))
        adder.start()
        before, enough = len(parts.names(folder)), int(rng.integers(1, LATE // KILLS))
        while adder.is_alive() and (kills == KILLS or len(parts.names(folder)) < before + enough):
            time.sleep(0.01 * rng.random())
        if not adder.is_alive():
            break
        adder.kill()
        adder.join()
        kills += 1
    took = time.perf_counter() - begin
    ended.set()
    asked_by = [answers.get(timeout=600) for _ in readers]
    for reader in readers:
        reader.join()
    assert parts.names(folder) == parts.names(whole)
    assert all(counts[-1] == len(places) and counts == sorted(counts) for counts, _ in asked_by)
    times = [one for _, own in asked_by for one in own]
    return {
        "campaigns": LATE, "kills": kills, "readers": READERS, "wall": took, "answers": len(times),
        "median": float(np.median(times)), "slowest": max(times),
    }  # fmt: skip


def _add(folder: Path, places: list[Path]) -> None:
    archive.add(folder, [generated.source_of(one) for one in places])


def _read_on(folder: Path, ended: Any, answers: Any) -> None:
    """Ask until the others have ended: whole campaigns each time, and never fewer than before."""
    counts, times = list[int](), list[float]()
    last = False
    while not last:
        last = ended.is_set()
        begin = time.perf_counter()
        answer = archive.find(folder, Query(run="run_000"))
        times.append(time.perf_counter() - begin)
        assert len(answer.observations) == 6 * answer.campaigns and not answer.findings
        counts.append(answer.campaigns)
        ended.wait(0.2)
    answers.put((counts, times))


def asked(folder: Path, query: Query, picture: Path) -> dict[str, Any]:
    """Times of a question and of its picture."""
    find, answer = timed(lambda: archive.find(folder, query), 3)
    draw, _ = timed(lambda: archive.trend(answer).savefig(picture, dpi=150), 3)
    return {"modes": len(answer.observations), "find": find, "picture": draw}


def record_of(campaign: int, runs: int) -> dict[str, Any]:
    """What is indexed of a generated campaign, straight from its truth: a test compares it with what is read."""
    drawn = [generated.truth(campaign, run, SEED) for run in range(runs)]
    half = COVERAGE_FACTOR * generated.STD
    about = drawn[0]
    return {
        "name": about.campaign,
        "structure": about.structure,
        "operator": "",
        "date": about.date,
        "comment": "",
        "file": f"{campaign:064x}",
        "maps": [],
        "levels": [],
        "findings": [],
        "runs": [_run(own, f"{campaign:032x}{place:032x}", half, place) for place, own in enumerate(drawn)],
    }


def _run(own: generated.Truth, data: str, half: np.ndarray, place: int) -> dict[str, Any]:
    modes = [
        [f, f - half[0], f + half[0], z, z - half[1], z + half[1], 0.99]
        for f, z in zip(own.frequencies.tolist(), own.damping.tolist(), strict=True)
    ]
    joint = {"joint": "J1", "mean": own.normal_force, "std": 2.0, "drift": -1.0}
    return {
        "id": own.run,
        "kind": "hammer",
        "level": 100.0,
        "joints": [] if own.normal_force is None else [joint],
        "repeat": "",
        "state": "current",
        "data": [data],
        "version": "0.1.0",
        "modes": modes,
        "findings": [["warning", "double-hit", f"run {own.run}", "one impact hit twice."]] if place % 10 == 3 else [],
    }


def measured(root: Path, campaigns: int, runs: int) -> dict[str, Any]:
    """All figures: of reading the campaigns below a folder, and of asking an archive of many more."""
    with tempfile.TemporaryDirectory() as scratch:
        os.environ["EMA_CACHE"] = f"{scratch}/cache"
        places = sorted(root.iterdir())
        build, added = timed(lambda: built(Path(scratch, "built"), places))
        assert (added.new, added.runs, added.findings) == (len(places), runs * len(places), ())
        safe = disturbed(Path(scratch, "built"), Path(scratch, "disturbed"), places)
        folder = Path(scratch, "archive")
        for number in range(campaigns):
            place = str(root / f"campaign_{number:05d}")
            seen = {"study": place, "campaign": f"{place}/campaign.toml", "kept": place, "result": place}
            parts.write(folder, record_of(number, runs), seen | {"state": [None, None, None]})
        size = sum(path.stat().st_size for path in (folder / parts.FOLDER).iterdir())
        one = Query(run="run_000", campaign="campaign 00000")
        first, answer = timed(lambda: archive.find(folder, one))
        archive.trend(answer).savefig(f"{scratch}/a.png")  # what is loaded once
        asks = {name: asked(folder, query, Path(scratch, "a.png")) for name, query in QUERIES.items()}
    return {
        "campaigns": answer.campaigns, "runs": answer.runs, "built runs": added.runs, "build": build, "bytes": size,
        "queries": asks, "first question": first, "disturbed": safe,
    }  # fmt: skip


def main() -> None:
    """Generate, measure, print, and keep the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=2000)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--read", type=int, default=2000, help="campaigns that are generated with files and read")
    parser.add_argument("--below", type=Path, help="campaigns of an earlier call; by default they are generated")
    parser.add_argument("--publish", action="store_true")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        root = chosen.below or Path(scratch, "campaigns")
        if chosen.below is None:
            with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
                generated.generate(root, chosen.read, chosen.runs, SEED, pool)
        found = measured(root, chosen.campaigns, chosen.runs)
    print(json.dumps(found, indent=1))
    if chosen.publish:
        RESULT.write_text(json.dumps(found | stamp("tests.bench.archive"), indent=1) + "\n", encoding="utf-8")


def section(found: dict[str, Any]) -> str:
    """The figures as a section of the page on speed."""
    lines = [
        f"| {name} | {one['modes']} | {one['find']['wall']:.2f} | {one['find']['cpu']:.2f} | {one['picture']['wall']:.2f} "
        f"| {one['picture']['cpu']:.2f} |"
        for name, one in found["queries"].items()
    ]
    share = found["runs"] / found["built runs"]
    build, first, machine, safe = found["build"], found["first question"], found["machine"], found["disturbed"]
    return "\n".join(
        [
            "## Archive",
            "",
            f"{found['built runs']} generated runs with six modes each, in campaigns of 50 as `ema run` leaves them, are added on "
            f"two processes in {build['wall']:.0f} s with {build['cpu']:.0f} s of processor time; "
            f"{found['runs']} runs at that rate take {share * build['cpu'] / 2:.0f} s of two processors of their own. The parts of "
            f"{found['runs']} runs in {found['campaigns']} campaigns take {found['bytes'] / 1e6:.0f} MB. The first question on a "
            f"machine that has not seen them reads all of them: {first['wall']:.0f} s ({first['cpu']:.0f} s of processor time). "
            "Then, best of three:",
            "",
            "| question | modes | answer, wall [s] | processor [s] | picture, wall [s] | processor [s] |",
            "| --- | --- | --- | --- | --- | --- |",
            *lines,
            "",
            f"While {safe['campaigns']} campaigns are added to the archive of the others, {safe['readers']} processes ask, "
            f"and the adding process is killed {safe['kills']} times (`kill -9`): {safe['answers']} answers, in "
            f"{safe['median']:.2f} s in the median and {safe['slowest']:.1f} s at most, each of whole campaigns and never of "
            "fewer than the one before; the parts are those of the archive that nothing disturbed.",
            "",
            f"From `python -m tests.bench.archive`, {found['date']}, {machine['processor']} ({machine['cores']} cores, shared "
            "with other work).",
        ]
    )


if __name__ == "__main__":
    main()
