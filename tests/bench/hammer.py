"""Hammer tests: second contacts found, clean impacts left alone, and the time from records to FRFs.

``python -m tests.bench.hammer [--cases N] [--records N] [--seed S] [--peer PYTHON]`` draws its seeds at run time, prints every miss
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
from ema.estimate.pulses import find_pulses
from ema.estimate.second_contacts import second_contacts
from tests.bench.hammer_records import RATIOS, RECORDS, Drawn, draw
from tests.bench.hammer_signals import Chain, Second, draw_chain, draw_contact, force, ringing
from tests.bench.provenance import stamp

CASES = ("clean", "near", "later")
"""No second contact; one 2-30 ms behind the end of the main pulse; one anywhere later in the block."""

DELAYS = ((0.005, 0.1), (0.1, 0.5))
"""Seconds from the beginning of an impact to that of its second contact."""

SHAPES = ("half sine", "haversine", "skew")
POINTS, IMPACTS, SAMPLES, RATE = 80, 5, 16384, 16384.0
REPEATS = 7


@dataclass(frozen=True)
class Case:
    """One impact with its truth."""

    chain: Chain
    contact: float
    shape: str
    start: float
    duration: float
    ringing: float
    second: Second | None
    seed: int


def one_case(rng: np.random.Generator, kind: str) -> Case:
    """Draw an impact; a second contact of at least 5 % of it, or 2 % where the filter rings by less than 0.5 %."""
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
    """Whether the detector is right about an impact."""
    rate = case.chain.rate
    samples = int(case.duration * rate)
    signal = force(
        case.chain, samples, case.start, case.contact, case.shape, case.second, np.random.default_rng(case.seed)
    )
    pulses, offset, noise = find_pulses(signal, rate)
    if len(pulses) != 1:  # a strong second contact is a pulse of its own: seen anyway
        return bool(pulses) and case.second is not None
    rooms = [(min(pulses[0].start, int(0.05 * rate)), samples - pulses[0].start)]
    found = second_contacts(signal, pulses, rooms, offset, noise)[0] != ()
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


def hammer_tests(cases: int, seed: int) -> dict:
    """Whole hammer tests: second contacts found by height and delay, clean tests with a finding, errors of the FRFs.

    The error is the norm of the difference from the true FRFs over their norm, up to where the force spectrum ends;
    ``clean`` is that of tests without second contacts.
    """
    rng = np.random.default_rng([seed, 1])
    result: dict[str, dict] = {}
    for records in RECORDS:
        clean = [_tested(draw(rng, records, second=False)) for _ in range(cases)]
        result[records] = {
            "clean": {
                "cases": cases,
                "false alarms": sum(found for found, _ in clean),
                "median error": float(np.median([error for _, error in clean])),
            }
        }
        for delays in DELAYS:
            counts = {ratio: [0, 0] for ratio in RATIOS}
            errors = []
            for _ in range(cases):
                drawn = draw(rng, records, second=True, delays=delays)
                found, error = _tested(drawn)
                counts[drawn.ratio][0] += found
                counts[drawn.ratio][1] += 1
                errors.append(error)
                if not found:
                    print(f"  missed, {records}: {drawn.ratio:.0%}, {1e3 * drawn.delay:.1f} ms")
            result[records][f"{1e3 * delays[0]:.0f}-{1e3 * delays[1]:.0f} ms"] = {
                "found": {f"{ratio:.0%}": counts[ratio] for ratio in RATIOS},
                "median error": float(np.median(errors)),
            }
        print(records, result[records])
    return result


def _tested(drawn: Drawn) -> tuple[bool, float]:
    """Whether any impact of the test has a second contact, and the error of the FRFs."""
    frfs, gallery = hammer_test(drawn.run)
    found = any("second contact" in hit.reason for hit in gallery.hits)
    return found, drawn.error(frfs, (20.0, min(0.8 / drawn.contact, 0.35 * drawn.run.recordings[0].sampling_rate)))


def campaign(seed: int) -> np.ndarray:
    """Signals (point, impact, channel, sample) of a structure of six modes."""
    from scipy.fft import irfft, rfft

    rng = np.random.default_rng(seed)
    t = np.arange(SAMPLES) / RATE
    tones = np.array([np.exp((-0.01 + 1j) * 2 * np.pi * f * t).imag for f in (120, 310, 500, 777, 1200, 2100)])
    signals = np.zeros((POINTS, IMPACTS, 3, SAMPLES))
    for point in range(POINTS):
        spectra = rfft(rng.standard_normal((2, 6)) @ tones, axis=1)
        for impact in range(IMPACTS):
            pulse = np.zeros(SAMPLES)
            pulse[820:836] = 100 * (1 + 0.1 * rng.standard_normal()) * np.sin(np.pi * np.arange(16) / 16)
            signals[point, impact, 0] = pulse
            signals[point, impact, 1:] = irfft(spectra * rfft(pulse), SAMPLES, axis=1)
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
    return {"wall": min(wall), "cpu": min(cpu), "impacts": len(gallery.accepted), "shape": frfs.values.shape}


def peer(signals: np.ndarray, python: str) -> dict:
    """The same by sdypy-FRF (FRFs and coherence, without its checks of the impacts)."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "signals.npy"
        np.save(path, signals)
        script = Path(__file__).parent / "peers" / "sdypy_frf" / "run.py"
        done = subprocess.run(
            [python, "-P", str(script), str(path), str(RATE), str(REPEATS)],
            capture_output=True,
            text=True,
            check=True,
            env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Run and write the result."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--records", type=int, default=300)
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--peer", default="")
    arguments = parser.parse_args()
    seed = int.from_bytes(os.urandom(4)) if arguments.seed is None else arguments.seed
    print(f"seed {seed}")
    result = {**stamp("tests.bench.hammer"), "seed": seed, "second contacts": detector(arguments.cases, seed)}
    result["records"] = hammer_tests(arguments.records, seed)
    signals = campaign(seed)
    result["ours"] = ours(signals)
    if arguments.peer:
        result["sdypy-FRF"] = peer(signals, arguments.peer)
        result["time ratio (cpu)"] = result["ours"]["cpu"] / result["sdypy-FRF"]["cpu"]
    print(
        json.dumps(
            {name: value for name, value in result.items() if name not in ("second contacts", "records")}, indent=1
        )
    )
    out = Path(__file__).parent / "results" / "hammer.json"
    out.parent.mkdir(exist_ok=True)
    out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
