"""How often `generator-coherence` names clean shaker tests, and how often tests whose generator does not drive a band.

    python -m tests.bench.generator_coherence [welch|local [draws]]

Each draw is a structure of `tests.bench.disturbances_shaker` with a drop-out of the force of 0 to 20 dB, force noise of
0 to 1 % and a record of 2^13 to 2^15 samples, by Welch's method and by the local model with the blocks that they choose.
A faulty test is the same with a generator signal of its own in a band of 10 to 40 % of the lines.
"""

import sys
from dataclasses import replace

import numpy as np

from ema.data import Channel, Run
from ema.estimate import shaker
from tests.bench import disturbances_shaker as bench


def drawn(rng: np.random.Generator, faulty: bool) -> Run:
    """A random test with the signal of its generator."""
    test = bench.shaken(rng, shaker=float(rng.choice([0.0, 3.0, 10.0])))
    noise = float(rng.choice([0.0, 0.003, 0.01]))
    run = bench.recorded(rng, test, noise, samples=2 ** int(rng.integers(13, 16)))
    (record,) = run.recordings
    signals = record.signals.copy()
    if faulty:
        lines, frequencies = np.fft.rfft(signals[-1]), np.fft.rfftfreq(signals.shape[1], 1 / bench.RATE)
        width = float(rng.uniform(0.1, 0.4)) * np.ptp(bench.FORCE_BAND)
        low = float(rng.uniform(bench.FORCE_BAND[0], bench.FORCE_BAND[1] - width))
        silent = (frequencies > low) & (frequencies < low + width)
        size = np.sqrt(np.mean(np.abs(lines[silent]) ** 2) / 2)
        lines[silent] = size * (rng.normal(size=(2, silent.sum())).T @ [1, 1j])
        signals[-1] = np.fft.irfft(lines, signals.shape[1])
    channels = (*record.channels[:-1], Channel("generator", quantity="voltage", role="generator", unit="V"))
    return replace(run, recordings=(replace(record, channels=channels, signals=signals),))


def named(run: Run, method: str) -> float:
    """Share of lines that the finding names, 0 without it."""
    findings = shaker(run, method=method).findings
    return max([0.0, *(one.value or 0.0 for one in findings if one.code == "generator-coherence")])


def main(method: str = "welch", draws: str = "40") -> None:
    """Write the rates."""
    for faulty in (False, True):
        shares = []
        for seed in range(int(draws)):
            rng = np.random.default_rng([9650, seed, faulty, method == "welch"])
            shares.append(named(drawn(rng, faulty), method))
        hits = sum(share > 0 for share in shares)
        kind = "faulty" if faulty else "clean"
        print(f"{method} {kind}: {hits} of {draws} named, largest share {100 * max(shares):.1f} %", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
