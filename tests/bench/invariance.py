"""The same measurement said in another way must give the same modes: changes over what is stated, and decisions that flip.

Every change below leaves the information in the FRFs as it is: their unit, the order of their outputs and references, a
factor next to one, receptance instead of accelerance with the variance carried along, the number of threads, which of the
modes are asked for, and whether Python or the command line asks. Values may move by 1e-6 of their standard deviation,
standard deviations by 1e-3 of themselves. A change of the model (more orders, a little less of the band) may move values by
a tenth of a standard deviation and standard deviations by 5 %.
"""

import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

import acquisition
import ema.fit
from ema.data import FrfSet
from tests.bench import disturbances
from tests.bench.cases import Case, random_system
from tests.bench.draws import Knowledge, drawn
from tests.bench.fit import ONE_THREAD
from tests.bench.stated import Stated, automatic, finite, of_model

TITLE = "Invariance: the same measurement said in another way"
COUNT, QUICK = 40, 3
"""Systems of a full run and of a quick one."""
RESCALED, RESCALED_QUICK = 250, 3
"""Rescaled runs of each system."""
VALUE_LIMIT = 1e-6
"""Largest change of a value over its stated standard deviation."""
STD_LIMIT = 1e-3
"""Largest relative change of a stated standard deviation."""
MODEL_VALUE_LIMIT, MODEL_STD_LIMIT = 0.1, 0.05
"""The same where the model or the lines change."""
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Change:
    """How two fits differ.

    Parameters
    ----------
    value : largest change of a frequency, damping ratio or residue over its stated standard deviation.
    std : largest relative change of the stated standard deviations of frequencies and damping ratios.
    flipped : whether another set of modes was accepted.
    findings : codes that only one of two automatic fits reports.
    model : whether the model was changed, so that the wider limits hold.
    """

    value: float
    std: float
    flipped: bool
    findings: tuple[str, ...] = ()
    model: bool = False

    @property
    def within(self) -> bool:
        """Whether nothing moved beyond the limits and no decision flipped."""
        if self.model:
            return self.value <= MODEL_VALUE_LIMIT and self.std <= MODEL_STD_LIMIT and not self.flipped
        return self.value <= VALUE_LIMIT and self.std <= STD_LIMIT and not self.flipped and not self.findings


@dataclass(frozen=True)
class Said:
    """A measurement said in another way.

    Parameters
    ----------
    frfs : the FRFs to be fitted.
    outputs, inputs : where the original's outputs and inputs stand in it.
    scale : factor of its residues over those of the original.
    near : frequencies asked for, all of them by default.
    kept : indices of the original's modes that are asked for; ``None`` for all.
    request : other arguments of the fit.
    orders : model orders of the poles, where not the default.
    model : whether the model or the lines are changed.
    """

    frfs: FrfSet
    outputs: np.ndarray
    inputs: np.ndarray
    scale: float = 1.0
    near: tuple[float, ...] | None = None
    kept: tuple[int, ...] | None = None
    request: dict = field(default_factory=dict)
    orders: tuple[int, ...] | None = None
    model: bool = False


def plain(frfs: FrfSet) -> Said:
    """As it is."""
    return Said(frfs, np.arange(len(frfs.outputs)), np.arange(len(frfs.inputs)))


def scaled(frfs: FrfSet, factor: float) -> Said:
    """All values times a real factor: another unit, or rounding."""
    variance = None if frfs.variance is None else frfs.variance * factor**2
    return replace(plain(replace(frfs, values=frfs.values * factor, variance=variance)), scale=factor)


def permuted(frfs: FrfSet, rng: np.random.Generator, side: str) -> Said:
    """Outputs or inputs in another order; each keeps its DOF."""
    said = plain(frfs)
    count = len(getattr(frfs, side))
    order = rng.permutation(count)
    where = np.argsort(order)
    return replace(said, frfs=frfs.pick(**{side: order.tolist()}), **{side: where})


def as_receptance(frfs: FrfSet) -> Said:
    """Accelerance divided by -w^2, its variance by w^4."""
    square = (2 * np.pi * frfs.frequencies[:, None, None]) ** 2
    variance = None if frfs.variance is None else frfs.variance / square**2
    return plain(replace(frfs, values=-frfs.values / square, variance=variance, quantity="receptance", unit="m/N"))


def compared(first: Stated, second: Stated, said: Said) -> Change:
    """The change from ``first``, the original, to ``second``, the same said in another way."""
    kept = list(range(len(first.model.poles))) if said.kept is None else list(said.kept)
    automatic_again = said.near is None and not said.request
    only = tuple(sorted(set(first.findings) ^ set(second.findings))) if automatic_again else ()
    if len(kept) != len(second.model.poles):
        return Change(float("inf"), float("inf"), True, only, said.model)
    order = _order(first.model.poles[kept], second.model.poles)
    a, b = np.array(kept, int), order
    value = [
        np.abs(second.frequencies[b] - first.frequencies[a]) / first.frequency_std[a],
        np.abs(second.damping[b] - first.damping[a]) / first.damping_std[a],
    ]
    # Other lines hold other noise: of hundreds of residues one moves further than a tenth even then.
    if first.residue_variance is not None and not said.model:
        given = second.model.residues()[b][:, said.outputs][:, :, said.inputs] / said.scale
        error = np.abs(given - first.model.residues()[a])
        value.append(error / np.sqrt(np.trace(first.residue_variance[a], axis1=-2, axis2=-1)))
    std = [second.frequency_std[b] / first.frequency_std[a] - 1, second.damping_std[b] / first.damping_std[a] - 1]
    return Change(_largest(value), _largest(std), False, only, said.model)


def _order(wanted: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """For each wanted pole the index of its partner: the assignment with the least distance in decay rates."""
    distance = np.abs(wanted[:, None] - poles[None, :]) / np.maximum(np.abs(wanted.real), 1e-12)[:, None]
    return linear_sum_assignment(distance)[1]


def _largest(parts: list[np.ndarray]) -> float:
    values = np.concatenate([np.abs(part).ravel() for part in parts])
    return float(np.nan_to_num(values, nan=np.inf).max()) if len(values) else 0.0


def sayings(frfs: FrfSet, original: Stated, rng: np.random.Generator) -> dict[str, Said]:
    """Every way in which the measurement can be said again in this process."""
    every = tuple(float(value) for value in original.frequencies)
    said = {
        "times 1 + 1e-12": scaled(frfs, 1 + 1e-12),
        "times 1 + 2e-12": scaled(frfs, 1 + 2e-12),
        "times 1e6": scaled(frfs, 1e6),
        "times 1e-9": scaled(frfs, 1e-9),
        "in g": scaled(frfs, 1 / 9.80665),
        "outputs permuted": permuted(frfs, rng, "outputs"),
        "references permuted": permuted(frfs, rng, "inputs"),
        "near = the same frequencies": replace(plain(frfs), near=every),
    }
    if frfs.variance is not None:
        said["as receptance"] = as_receptance(frfs)
    highest = int(ema.fit.stabilise(frfs).order.max())
    said["more orders"] = replace(plain(frfs), orders=tuple(range(2, highest + 21, 2)), model=True)
    cut = max(1, len(frfs.frequencies) // 200)
    said["half a percent less at both ends"] = replace(plain(frfs.lines(slice(cut, -cut))), model=True)
    if len(every) > 1:
        kept = tuple(sorted(rng.choice(len(every), len(every) - 1, replace=False).tolist()))
        said["one mode not asked for"] = replace(plain(frfs), near=tuple(every[one] for one in kept), kept=kept)
        one = int(rng.integers(len(every)))
        said["one mode asked for"] = replace(plain(frfs), near=(every[one],), kept=(one,))
        rows, shown = _twice(frfs, original)
        if shown:
            said["one mode asked for twice"] = replace(plain(frfs), kept=shown, request={"index": rows})
    return said


def _twice(frfs: FrfSet, original: Stated) -> tuple[list[int], tuple[int, ...]]:
    """Rows of the pole table: the nearest to each mode, and the next nearest of another order to one of the modes; and the
    modes that these ask for. A mode that the search of the residual brought has no row within its width.
    """
    table = ema.fit.stabilise(frfs)
    widths = np.abs(original.model.poles.real[:, None]) + np.abs(table.poles.real)
    distance = np.abs(original.model.poles[:, None] - table.poles) / widths
    # A row belongs to the nearest mode.
    distance[np.arange(len(distance))[:, None] != np.argmin(distance, axis=0)] = np.inf
    shown = np.flatnonzero(np.min(distance, axis=1) <= 1)
    rows: list[int] = []
    for place, mode in enumerate(shown):
        nearest = np.argsort(distance[mode])
        rows.append(int(nearest[0]))
        if place == len(shown) // 2:
            rows += [
                int(row)
                for row in nearest[1:]
                if table.order[row] != table.order[nearest[0]] and distance[mode, row] <= 1
            ][:1]
    return list(dict.fromkeys(rows)), tuple(shown.tolist())


def fitted(said: Said) -> Stated:
    """The fit of what was said."""
    return automatic(said.frfs, near=said.near, orders=said.orders, **said.request)


def case(seed: int, number: int) -> Case:
    """A system of moderate size; with and without a known variance in turn."""
    rng = np.random.default_rng([seed, number])
    modes, outputs, references = int(rng.integers(2, 13)), int(rng.integers(3, 13)), int(rng.integers(1, 4))
    noise = (0.001, 0.01, 0.05)[number % 3]
    one = random_system(int(rng.integers(1, 2**31)), noise, modes, outputs, references, 801)
    known = Knowledge("", 5 if number % 2 else 1, known=number % 2 == 1)
    return replace(one, frfs=drawn(one, known, rng))


def one(seed: int, number: int, quick: bool = False) -> dict:
    """One system: the change by each way of saying it, and how many rescaled runs flip a decision."""
    rescaled = RESCALED_QUICK if quick else RESCALED
    made = case(seed, number)
    rng = np.random.default_rng([seed, number, 1])
    original = automatic(made.frfs)
    rows = {}
    for name, said in sayings(made.frfs, original, rng).items():
        rows[name] = _row(lambda said=said: compared(original, fitted(said), said))
    # On an axis that the header of a universal file holds exactly.
    plate = disturbances.structure(rng)
    rows["from the command line"] = _row(lambda: by_command(disturbances.noisy(rng, plate, plate.clean).frfs))
    rows["two threads"] = _row(lambda: compared(original, with_threads(made.frfs, 2), plain(made.frfs)))
    flips, worst = 0, [0.0, 0.0]
    for _ in range(rescaled):
        said = scaled(made.frfs, float(np.exp(rng.uniform(-20, 20))))
        change = compared(original, fitted(said), said)
        flips += change.flipped or bool(change.findings)
        worst = [max(worst[0], change.value), max(worst[1], change.std)]
    return {
        "number": number,
        "noise": made.noise,
        "shape": list(made.frfs.values.shape),
        "changes": rows,
        "modes": len(original.model.poles),
        "rescaled": rescaled,
        "flips": flips,
        "rescaled, worst": finite(np.array(worst), 12),
    }


def _row(make: Callable[[], Change]) -> dict:
    try:
        change = make()
    except Exception as error:  # a request that fails is a result
        return {"error": f"{type(error).__name__}: {error}"}
    value, std = (min(float(part), 1e9) for part in (change.value, change.std))
    return {
        "value": value,
        "std": std,
        "flipped": change.flipped,
        "findings": list(change.findings),
        "model": change.model,
    }


def by_command(frfs: FrfSet) -> Change:
    """``ema fit --json`` of a file against the fit of what Python reads from it, on the band of the file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "measured.uff"
        acquisition.write(path, replace(frfs, variance=None, coherence=None, averages=None))
        (read,) = acquisition.read(path).frfs
        first = automatic(read)
        band = [repr(float(edge)) for edge in (read.frequencies[0], read.frequencies[-1])]
        command = [sys.executable, "-m", "ema", "fit", str(path), "--json", "--band", *band]
        environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, timeout=600)
    if not done.stdout.startswith("{"):
        raise RuntimeError(done.stderr.strip()[:200])
    (answer,) = json.loads(done.stdout).values()
    rows = answer["modes"] if isinstance(answer, dict) else answer
    if len(rows) != len(first.model.poles):
        return Change(float("inf"), float("inf"), True)
    names = ("natural_frequency", "damping_ratio", "natural_frequency_std", "damping_ratio_std")
    f, z, f_std, z_std = (np.array([row[name] for row in rows], float) for name in names)
    return Change(
        _largest([(f - first.frequencies) / first.frequency_std, (z - first.damping) / first.damping_std]),
        _largest([f_std / first.frequency_std - 1, z_std / first.damping_std - 1]),
        False,
    )


def with_threads(frfs: FrfSet, count: int) -> Stated:
    """The automatic fit in a process whose linear algebra has ``count`` threads."""
    names = [name for name in ONE_THREAD if name.endswith("_THREADS")]
    with tempfile.TemporaryDirectory() as folder:
        given, answer = Path(folder) / "frfs.pickle", Path(folder) / "model.pickle"
        given.write_bytes(pickle.dumps(frfs))
        environment = {**os.environ, **dict.fromkeys(names, str(count)), "PYTHONPATH": str(ROOT)}
        command = [sys.executable, "-m", "tests.bench.invariance", str(given), str(answer)]
        subprocess.run(command, env=environment, cwd=ROOT, check=True, timeout=600)
        return of_model(pickle.loads(answer.read_bytes()), frfs)


def line(row: dict) -> str:
    """One system: the ways that change more than they may."""
    bad = [name for name, change in row["changes"].items() if not within(change)]
    text = f"invariance {row['number']:3} {row['shape']}, {row['modes']} modes, noise {100 * row['noise']:g} %: "
    text += ", ".join(f"{name} ({describe(row['changes'][name])})" for name in bad) or "nothing moved"
    return text + f"; {row['flips']} of {row['rescaled']} rescaled runs flip"


def within(change: dict) -> bool:
    """Whether a change is within the limits."""
    return (
        "error" not in change
        and Change(change["value"], change["std"], change["flipped"], tuple(change["findings"]), change["model"]).within
    )


def describe(change: dict) -> str:
    """A change in few words."""
    if "error" in change:
        return change["error"][:60]
    if change["flipped"]:
        return "other modes"
    text = f"value {change['value']:.2g} std, std {change['std']:.2g}"
    return text + (f", findings {'+'.join(change['findings'])}" if change["findings"] else "")


def summary(rows: list[dict]) -> dict:
    """For each way of saying it: systems within the limits, median and largest change, and flips."""
    names = dict.fromkeys(name for row in rows for name in row["changes"])
    ways = {}
    for name in names:
        own = [row["changes"][name] for row in rows if name in row["changes"]]
        ended = [one for one in own if "error" not in one]
        steady = [one for one in ended if not one["flipped"]]
        ways[name] = {
            "systems": len(own),
            "within": sum(map(within, own)),
            "failed": len(own) - len(ended),
            "other modes": len(ended) - len(steady),
            "other findings": sum(bool(one["findings"]) for one in ended),
            **{
                f"{part} {which}": float(function([one[part] for one in steady])) if steady else None
                for part in ("value", "std")
                for which, function in (("median", np.median), ("largest", np.max))
            },
        }
    return {
        "systems": len(rows),
        "ways": ways,
        "rescaled": sum(row["rescaled"] for row in rows),
        "flips": sum(row["flips"] for row in rows),
    }


def report(found: dict) -> str:
    """The summary in words."""

    def small(value: float | None) -> str:
        return "-" if value is None else f"{value:.1e}"

    lines = [f"{found['systems']} systems; {found['flips']} of {found['rescaled']} rescaled runs flip a decision"]
    for name, own in found["ways"].items():
        lines.append(
            f"  {name:28} {own['within']:3} of {own['systems']:3} within; value {small(own['value median'])} to "
            f"{small(own['value largest'])} std, std {small(own['std median'])} to {small(own['std largest'])}; other "
            f"modes {own['other modes']}, other findings {own['other findings']}, failed {own['failed']}"
        )
    return "\n".join(lines)


def main() -> None:
    """The automatic fit of pickled FRFs, for a run with other threads."""
    frfs = pickle.loads(Path(sys.argv[1]).read_bytes())
    Path(sys.argv[2]).write_bytes(pickle.dumps(automatic(frfs).model))


if __name__ == "__main__":
    main()
