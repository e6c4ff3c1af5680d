"""Hammer tests: second blows found, clean blows left alone, and the time from records to FRFs.

``python -m tests.bench.hammer [--cases N] [--seed S] [--peer PYTHON]`` draws its seeds at run time, prints every miss
and writes ``results/hammer.json``. PYTHON is the interpreter of the environment that peers/sdypy_frf/requirements.txt
describes.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ema.data import Channel, Condition, Recording, Run
from ema.dof import Dof
from ema.estimate import hammer_test
from ema.estimate.blows import find_blows
from ema.estimate.double_hits import second_hits
from tests.bench.hammer_signals import Chain, Second, draw_chain, draw_contact, force, ringing
from tests.bench.provenance import stamp

CASES = ("clean", "near", "later")
"""No second blow; one 2-30 ms behind the end of the main pulse; one anywhere later in the block."""

SHAPES = ("half sine", "haversine", "skew")
POINTS, BLOWS, SAMPLES, RATE = 80, 5, 16384, 16384.0
REPEATS = 7


@dataclass(frozen=True)
class Case:
    """One blow with its truth."""

    chain: Chain
    contact: float
    shape: str
    start: float
    duration: float
    ringing: float
    second: Second | None
    seed: int


def one_case(rng: np.random.Generator, kind: str) -> Case:
    """Draw a blow; a second one of at least 5 % of it, or 2 % where the filter rings by less than 0.5 %."""
    chain, contact, shape = draw_chain(rng), draw_contact(rng), str(rng.choice(SHAPES))
    duration, start = float(rng.uniform(0.15, 0.6)), float(rng.uniform(0.005, 0.03))
    ripple = ringing(chain, contact, shape)
    second = None
    if kind != "clean":
        smallest = 0.05 if ripple >= 0.005 else 0.02
        ratio = float(np.exp(rng.uniform(np.log(smallest), np.log(0.8))))
        room = duration - start - 2.5 * contact - 0.005
        gap = rng.uniform(0.002, 0.03) if kind == "near" else rng.uniform(0.03, room)
        second = Second(ratio, float(rng.uniform(0.7, 1.4)), float(gap))
    return Case(chain, contact, shape, start, duration, ripple, second, int(rng.integers(2**31)))


def verdict(case: Case) -> bool:
    """Whether the detector is right about a blow."""
    rate = case.chain.rate
    samples = int(case.duration * rate)
    signal = force(
        case.chain, samples, case.start, case.contact, case.shape, case.second, np.random.default_rng(case.seed)
    )
    blows, offset, noise = find_blows(signal, rate)
    if len(blows) != 1:  # a strong second pulse is a pulse of its own: seen anyway
        return bool(blows) and case.second is not None
    rooms = [(min(blows[0].start, int(0.05 * rate)), samples - blows[0].start)]
    found = second_hits(signal, blows, rooms, offset, noise)[0] is not None
    return found == (case.second is not None)


def detector(cases: int, seed: int) -> dict:
    """Share of right verdicts of each kind; prints every wrong one."""
    rng = np.random.default_rng(seed)
    result = {}
    for kind in CASES:
        wrong = 0
        for _ in range(cases):
            case = one_case(rng, kind)
            if not verdict(case):
                wrong += 1
                print(f"  wrong, {kind}: {case}")
        result[kind] = {"cases": cases, "wrong": wrong, "right": 1 - wrong / cases}
        print(f"{kind}: {wrong} wrong of {cases}")
    return result


def campaign(seed: int) -> np.ndarray:
    """Signals (point, blow, channel, sample) of a structure of six modes."""
    from scipy.fft import irfft, rfft

    rng = np.random.default_rng(seed)
    t = np.arange(SAMPLES) / RATE
    tones = np.array([np.exp((-0.01 + 1j) * 2 * np.pi * f * t).imag for f in (120, 310, 500, 777, 1200, 2100)])
    signals = np.zeros((POINTS, BLOWS, 3, SAMPLES))
    for point in range(POINTS):
        spectra = rfft(rng.standard_normal((2, 6)) @ tones, axis=1)
        for blow in range(BLOWS):
            pulse = np.zeros(SAMPLES)
            pulse[820:836] = 100 * (1 + 0.1 * rng.standard_normal()) * np.sin(np.pi * np.arange(16) / 16)
            signals[point, blow, 0] = pulse
            signals[point, blow, 1:] = irfft(spectra * rfft(pulse), SAMPLES, axis=1)
    return signals + 1e-3 * signals.std(axis=-1, keepdims=True) * rng.standard_normal(signals.shape)


def ours(signals: np.ndarray) -> dict:
    """Seconds from records to FRFs, coherence, variance, verdicts and findings."""
    channels = [
        Channel("hammer", None, "force", "reference", "N"),
        *(Channel(f"acc {n}", Dof(1000 + n, "+Z"), "acceleration", "response", "m/s^2") for n in (1, 2)),
    ]
    records = []
    for point in range(POINTS):
        hammer = Channel("hammer", Dof(point + 1, "+Z"), "force", "reference", "N")
        joined = np.concatenate(list(signals[point]), axis=1)
        records.append(Recording(joined, RATE, (hammer, *channels[1:]), name=f"point {point + 1}"))
    run = Run("bench", Condition(), tuple(records))
    wall, cpu = [], []
    for _ in range(REPEATS):
        start = time.perf_counter(), time.process_time()
        frfs, gallery = hammer_test(run)
        wall.append(time.perf_counter() - start[0])
        cpu.append(time.process_time() - start[1])
    return {"wall": min(wall), "cpu": min(cpu), "blows": len(gallery.accepted), "shape": frfs.values.shape}


def peer(signals: np.ndarray, python: str) -> dict:
    """The same by sdypy-FRF (FRFs and coherence, without its checks of the blows)."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "signals.npy"
        np.save(path, signals)
        script = Path(__file__).parent / "peers" / "sdypy_frf" / "run.py"
        done = subprocess.run(
            [python, "-P", str(script), str(path), str(RATE), str(REPEATS)], capture_output=True, text=True, check=True,
            env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Run and write the result."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--peer", default="")
    arguments = parser.parse_args()
    seed = int.from_bytes(os.urandom(4)) if arguments.seed is None else arguments.seed
    print(f"seed {seed}")
    result = {**stamp("tests.bench.hammer"), "seed": seed, "second blows": detector(arguments.cases, seed)}
    signals = campaign(seed)
    result["ours"] = ours(signals)
    if arguments.peer:
        result["sdypy-FRF"] = peer(signals, arguments.peer)
        result["time ratio (cpu)"] = result["ours"]["cpu"] / result["sdypy-FRF"]["cpu"]
    print(json.dumps({name: value for name, value in result.items() if name != "second blows"}, indent=1))
    out = Path(__file__).parent / "results" / "hammer.json"
    out.parent.mkdir(exist_ok=True)
    out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
