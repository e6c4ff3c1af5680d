"""Modes of FRF sets that are larger than memory: ``python -m tests.bench.large --folder SCRATCH``.

For each number of ``--outputs`` a set of 2 references and ``--lines`` is generated output by output into ``SCRATCH``
(50 000 outputs of 6401 lines are 10 GB), fitted in a process of its own, compared with the truth of the generator, and
deleted. ``--publish`` stores processor time, wall clock, memory over time and bytes read for docs/large.md.
"""

import argparse
import json
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ema import store
from ema.data import FrfSet, ModalModel, poles_from
from ema.data.modal import COVERAGE_FACTOR
from ema.dof import Dof
from ema.fit import modes, stabilise
from tests.bench import provenance

RESULT = Path(__file__).with_name("results") / "large.json"
MODES, BAND, NOISE, SEED = 20, (100.0, 900.0), 0.05, 20261124
PAGE = resource.getpagesize()


def truth(outputs: int, seed: int) -> ModalModel:
    """Twenty modes of a plate with slightly complex shapes, two of them references."""
    rng = np.random.default_rng([17, seed])
    gaps = rng.uniform(0.5, 1.5, MODES + 1)
    natural = BAND[0] + (BAND[1] - BAND[0]) * np.cumsum(gaps)[:-1] / gaps.sum()
    poles = poles_from(natural, np.exp(rng.uniform(np.log(0.003), np.log(0.02), MODES)))
    columns = int(np.ceil(np.sqrt(outputs)))
    y, x = np.divmod(np.arange(outputs), columns)
    waves = np.array(sorted(np.ndindex(8, 8), key=lambda w: w[0] ** 2 + 1.3 * w[1] ** 2)[:MODES])
    shapes = np.cos(np.pi * np.outer((x + 0.5) / columns, waves[:, 0]))
    shapes = (
        shapes * np.cos(np.pi * np.outer((y + 0.5) / columns, waves[:, 1])) * (1 + 0.03j * rng.standard_normal(MODES))
    )
    dofs = tuple(Dof(node + 1, "+Z") for node in range(outputs))
    drives = [outputs // 7, outputs // 3]
    return ModalModel(
        poles=poles,
        shapes=shapes,
        dofs=dofs,
        inputs=tuple(dofs[row] for row in drives),
        participation=shapes[drives] / (2j * poles.imag),
        scaling="unit modal mass",
    )


def blocks(model: ModalModel, lines: int, seed: int, step: int = 256) -> Iterator[FrfSet]:
    """The accelerances output by output, with noise of another level at each output and of another one along the band."""
    frequencies = np.linspace(*BAND, lines)
    s = 2j * np.pi * frequencies[:, None]
    direct, mirrored = s**2 / (s - model.poles), s**2 / (s - model.poles.conj())
    typical = float(np.sqrt(np.mean(np.abs(direct @ (model.shapes[:200] * model.participation[0]).T) ** 2)))
    profile = 1 + 0.5 * np.sin(2 * np.pi * np.linspace(0, 1.5, lines))
    for first in range(0, len(model.dofs), step):
        rng = np.random.default_rng([18, seed, first])
        own = model.shapes[first : first + step]
        values = np.empty((lines, len(own), 2), complex)
        for column, entries in enumerate(model.participation):
            values[:, :, column] = direct @ (own * entries).T + mirrored @ (own * entries).conj().T
        level = NOISE * typical * np.exp(0.7 * rng.standard_normal(len(own)))
        draw = rng.standard_normal((*values.shape, 2)).view(complex)[..., 0] * np.sqrt(0.5)
        values += draw * level[:, None] * profile[:, None, None]
        yield FrfSet(
            frequencies, values, model.dofs[first : first + step], model.inputs, "accelerance", "(m/s^2)/N", name="scan"
        )


def generate(path: Path, outputs: int, lines: int, seed: int) -> None:
    """Write a set; nothing of it is whole in memory."""
    model = truth(outputs, seed)
    empty = np.zeros((lines, 0, 2), complex)
    header = FrfSet(np.linspace(*BAND, lines), empty, model.dofs, model.inputs, "accelerance", "(m/s^2)/N", name="scan")
    with store.Writer(path, kind="noun") as writer:
        writer.begin(header).extend(blocks(model, lines, seed))


class Memory(threading.Thread):
    """Resident memory of this process over time, in MB by seconds."""

    def __init__(self, every: float) -> None:
        super().__init__(daemon=True)
        self.every, self.begin, self.seen, self.task = every, time.perf_counter(), [], "start"
        self.ended = threading.Event()

    def run(self) -> None:
        while not self.ended.wait(self.every):
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            self.seen.append([round(time.perf_counter() - self.begin, 1), round(pages * PAGE / 1e6), self.task])


def fit(path: Path, outputs: int, seed: int) -> dict:
    """Fit a set, and what that took."""
    memory = Memory(1.0)
    memory.start()

    def note(task: str, done: int, total: int) -> None:
        memory.task = task

    before = time.process_time(), time.perf_counter()
    frfs = store.load(path)
    table = stabilise(frfs, progress=note)
    model = modes(frfs, table, progress=note)
    cpu, wall = time.process_time() - before[0], time.perf_counter() - before[1]
    memory.ended.set()
    source = frfs.values.source
    every = max(1, len(memory.seen) // 60)
    return {
        "cpu": cpu,
        "wall": wall,
        "data_bytes": frfs.values.nbytes,
        "passes": source.bytes_read / frfs.values.nbytes,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "memory": memory.seen[::every],
        **compared(model, truth(outputs, seed)),
    }


def compared(model: ModalModel, true: ModalModel) -> dict:
    """Errors of the modes in their standard deviations, and how many of the stated intervals hold the truth."""
    place = [int(np.argmin(np.abs(model.poles - pole))) for pole in true.poles]
    std = np.sqrt(model.covariance[place][:, [0, 1], [0, 1]])
    f = (model.natural_frequencies[place] - true.natural_frequencies) / std[:, 0]
    z = (model.damping_ratios[place] - true.damping_ratios) / std[:, 1]
    own, exact = model.residues()[place], true.residues()
    stated = model.uncertainty.residues[place]
    error = np.stack([(own - exact).real ** 2 / stated[..., 0, 0], (own - exact).imag ** 2 / stated[..., 1, 1]])
    return {
        "modes": len(model.poles),
        "true_modes": len(true.poles),
        "frequency_errors": np.round(f, 3).tolist(),
        "damping_errors": np.round(z, 3).tolist(),
        "held": int(np.sum(np.abs(f) < COVERAGE_FACTOR) + np.sum(np.abs(z) < COVERAGE_FACTOR)),
        "residues_held": float(np.mean(error < COVERAGE_FACTOR**2)),
        "residues_z_rms": float(np.sqrt(np.mean(error))),
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.large", description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True, help="where the sets are written for a while")
    parser.add_argument("--outputs", default="25000,50000", help="numbers of outputs, separated by commas")
    parser.add_argument("--lines", type=int, default=6401)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--publish", action="store_true", help=f"store the figures in {RESULT.name}")
    parser.add_argument("--fit", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    counts = [int(count) for count in options.outputs.split(",")]
    if options.fit:
        print(json.dumps(fit(options.fit, counts[0], options.seed)))
        return
    options.folder.mkdir(parents=True, exist_ok=True)
    rows = {}
    for count in counts:
        path = options.folder / f"scan_{count}.h5"
        try:
            begin = time.process_time()
            generate(path, count, options.lines, options.seed)
            made = time.process_time() - begin
            command = [sys.executable, "-m", "tests.bench.large", "--folder", str(options.folder), "--fit", str(path)]
            command += ["--outputs", str(count), "--seed", str(options.seed)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise SystemExit(done.stderr)
            rows[str(count)] = json.loads(done.stdout.splitlines()[-1]) | {"generation_cpu": made, "seed": options.seed}
        finally:
            path.unlink(missing_ok=True)
        shown = {key: value for key, value in rows[str(count)].items() if key != "memory"}
        print(count, json.dumps(shown), flush=True)
        if options.publish:
            known = json.loads(RESULT.read_text())["rows"] if RESULT.exists() else {}
            stamped = {"lines": options.lines, **rows[str(count)], **provenance.stamp("tests.bench.large")}
            RESULT.write_text(json.dumps({"rows": known | {str(count): stamped}}, indent=1) + "\n")


if __name__ == "__main__":
    main()
