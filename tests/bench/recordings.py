"""Raw campaigns larger than memory: ``python -m tests.bench.recordings --folder SCRATCH``.

A campaign of ``--runs`` random shaker tests, ``--channels`` x ``--samples`` in float64 each, is written block by block
into ``SCRATCH`` (40 runs of 64 channels x 1 000 000 samples are 20 GB), analysed by ``ema run`` in a process of its own
whose resident memory is looked at with that of its children, compared with the truth of the generator, and deleted.
"""

import argparse
import json
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.fft

from ema import store
from ema.data import Channel, Recording
from ema.data.modal import COVERAGE_FACTOR
from ema.dof import Dof
from tests.bench import provenance

RESULT = Path(__file__).with_name("results") / "recordings.json"
RATE, NOISE, SEED = 2048.0, 0.02, 20261126
FREQUENCIES = np.array([95.0, 142.0, 211.0, 298.0, 412.0, 563.0])
DAMPING = np.array([0.008, 0.006, 0.005, 0.006, 0.004, 0.005])
BAND = 40.0, 700.0
BLOCK = 2**15
"""Samples that are generated at once."""
PAGE = resource.getpagesize()
HEAD = """[campaign]
name = "many channels"
structure = "six modes"
files = "raw"
"""
RUN = """
[[runs]]
id = "run_{0:02d}"
kind = "random"
files = "run_{0:02d}.h5"
band = ["40 Hz", "700 Hz"]
normal_force = [{{ joint = "J1", value = "{1} N" }}]
"""


def truth(run: int) -> tuple[np.ndarray, np.ndarray]:
    """Natural frequencies in Hz and damping ratios of a run: each a little stiffer than the one before."""
    return FREQUENCIES * (1 + 1e-3 * run), DAMPING


def shapes(channels: int) -> np.ndarray:
    """Mass-normalised shapes (channel, mode) at the responses; the force acts where the first of them is."""
    x = (np.arange(channels) + 0.7) / (channels + 0.4)
    return np.sin(np.pi * np.outer(x, np.arange(1, len(FREQUENCIES) + 1)))


def record(run: int, channels: int, samples: int, seed: int = SEED) -> Recording:
    """A force and responses, exact samples of a steady state: the record is a period of the force."""
    rng = np.random.default_rng([seed, run])
    frequencies, damping = truth(run)
    lines = scipy.fft.rfftfreq(samples, 1 / RATE)
    force = (rng.standard_normal(len(lines)) + 1j * rng.standard_normal(len(lines))) * np.sqrt(samples)
    force[(lines < BAND[0]) | (lines > BAND[1])] = 0.0
    own, s = shapes(channels - 1), 2j * np.pi * lines
    signals = np.empty((channels, samples))
    signals[0] = scipy.fft.irfft(force, samples)
    signals[1:] = 0.0
    for mode, (f, zeta) in enumerate(zip(frequencies, damping, strict=True)):
        omega = 2 * np.pi * f
        motion = scipy.fft.irfft(force * s**2 / (s**2 + 2 * zeta * omega * s + omega**2), samples)
        for row in range(1, channels):
            signals[row] += own[row - 1, mode] * own[0, mode] * motion
    for row in range(1, channels):
        signals[row] += NOISE * np.std(signals[row]) * rng.standard_normal(samples)
    names = (
        Channel("force", Dof(1, "+Z"), "force", "reference", "N"),
        *(Channel(f"a{row}", Dof(row, "+Z"), "acceleration", "response", "m/s^2") for row in range(1, channels)),
    )
    return Recording(signals, RATE, names, name=f"run_{run:02d}")


def generate(folder: Path, runs: int, channels: int, samples: int, seed: int = SEED) -> None:
    """Write a campaign, each record block by block as a front end does."""
    (folder / "raw").mkdir(parents=True)
    text = HEAD + "".join(RUN.format(run, 100 + 10 * run) for run in range(runs))
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    for run in range(runs):
        whole = record(run, channels, samples, seed)
        with store.Writer(folder / "raw" / f"run_{run:02d}.h5", kind="noun") as writer:
            growing = writer.begin(replace(whole, signals=whole.signals[:, :0]))
            for start in range(0, samples, BLOCK):
                growing.append(whole.signals[:, start : start + BLOCK])
        del whole


def resident(process: int) -> int:
    """Bytes of a process and all below it that are in memory; what they share counts once for each."""
    total, waiting = 0, [process]
    while waiting:
        one = waiting.pop()
        try:
            total += int(Path(f"/proc/{one}/statm").read_text().split()[1]) * PAGE
            for task in Path(f"/proc/{one}/task").iterdir():
                waiting += map(int, (task / "children").read_text().split())
        except (FileNotFoundError, ProcessLookupError):
            continue
    return total


def analysed(recipe: Path, output: Path, more: Sequence[str] = ()) -> dict[str, Any]:
    """What ``ema run`` takes: processor time, wall clock, and resident memory over time."""
    command = [sys.executable, "-m", "ema", "run", str(recipe), "--output", str(output), *more]
    begin, memory = time.perf_counter(), []
    with (output.parent / "ema.log").open("wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
        while process.poll() is None:
            memory.append([round(time.perf_counter() - begin, 1), round(resident(process.pid) / 1e6)])
            time.sleep(0.1)
    if process.returncode not in (0, 1):
        raise SystemExit((output.parent / "ema.log").read_text()[-2000:])
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    every = max(1, len(memory) // 100)
    return {
        "wall": time.perf_counter() - begin,
        "cpu": spent.ru_utime + spent.ru_stime,
        "peak_mb": max(size for _, size in memory),
        "memory": [[moment, max(size for _, size in memory[place : place + every])]
                   for place, (moment, _) in enumerate(memory) if place % every == 0],
    }  # fmt: skip


def compared(result: Path) -> dict[str, Any]:
    """How many modes were found, and how many of their intervals hold the truth."""
    held = modes = true = 0
    for number, run in enumerate(store.load(result).runs):
        frequencies, damping = truth(number)
        true, modes = true + len(frequencies), modes + len(run.modes.poles)
        place = [int(np.argmin(np.abs(run.modes.natural_frequencies - f))) for f in frequencies]
        half = COVERAGE_FACTOR * np.sqrt(run.modes.covariance[place][:, [0, 1], [0, 1]])
        held += int(np.sum(np.abs(run.modes.natural_frequencies[place] - frequencies) < half[:, 0]))
        held += int(np.sum(np.abs(run.modes.damping_ratios[place] - damping) < half[:, 1]))
    return {"modes": modes, "true_modes": true, "held": held}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.recordings", description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="where the campaign is written for a while")
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--channels", type=int, default=64)
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--block", type=int, default=4096, help="samples of a block")
    parser.add_argument("--method", default="local", help="local or welch")
    parser.add_argument("--jobs", type=int, default=1, help="processes of `ema run`")
    parser.add_argument("--keep", action="store_true", help="keep campaign and results")
    parser.add_argument("--publish", action="store_true", help=f"store the figures in {RESULT.name}")
    given = parser.parse_args()
    campaign, output = given.folder / "campaign", given.folder / "results"
    try:
        if not campaign.exists():
            generate(campaign, given.runs, given.channels, given.samples)
        size = sum(path.stat().st_size for path in (campaign / "raw").iterdir())
        output.mkdir(parents=True, exist_ok=True)
        recipe = given.folder / "study.toml"
        recipe.write_text(
            f'campaign = "campaign"\n\n[estimate]\nmethod = "{given.method}"\nblock = {given.block}\n', encoding="utf-8"
        )
        found = analysed(recipe, output, ("--jobs", str(given.jobs)))
        found |= {"data_bytes": size, **compared(output / "study.h5")}
    finally:
        if not given.keep:
            shutil.rmtree(given.folder, ignore_errors=True)
    shape = {"runs": given.runs, "channels": given.channels, "samples": given.samples, "block": given.block}
    shape |= {"method": given.method, "jobs": given.jobs}
    print(json.dumps(shape | {key: value for key, value in found.items() if key != "memory"}), flush=True)
    if given.publish:
        known = json.loads(RESULT.read_text())["rows"] if RESULT.exists() else {}
        stamped = shape | found | provenance.stamp("tests.bench.recordings")
        RESULT.write_text(
            json.dumps({"rows": known | {f"{given.runs} runs, {given.method}": stamped}}, indent=1) + "\n"
        )


if __name__ == "__main__":
    main()
