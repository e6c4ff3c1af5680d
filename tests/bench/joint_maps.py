"""Joint parameters from maps whose truth is a describing function in closed form, of laws that the model may not have.

``python -m tests.bench.joint_maps --n 100 --seed 5``: random hosts of one mode, joints of parallel Masing springs (one,
a power law of many, a few of any size), maps with noise; ``compare.update`` with a law of its own choice. Counted: how
often the 95 % intervals of mu, k_T and its growth hold the truth, those of parameters that are called identifiable, and
the bands of ``compare.predict_map`` at force levels and normal forces up to twice those of the map.

Resonances of laws that are Masing springs come from describing functions too, which the simulator agrees with within
its tolerance (``tests/validation/test_friction_traps.py``) and which takes a tenth of its time; ``--simulator`` takes
the simulator for all of them, ``--springs`` leaves out the fits of a law that is none.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from itertools import product, repeat
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from ema import compare
from ema.contact.iwan import springs_of as springs_of_law
from ema.data import BeamModel, Damping, FrictionLaw, Joint, Matrices, ModalMap, ModelUpdate
from ema.dof import Dof
from ema.errors import EmaError
from ema.simulate import Masing, ModifiedIwan, RegularisedMasing, maps
from ema.simulate.maps import Resonance
from tests.bench.provenance import stamp
from tests.bench.write_docs import older, table

ON = Dof(1, "+X")
NAMES = "friction_coefficient", "contact_stiffness", "stiffness_exponent"
LAWS = {"masing": Masing, "modified iwan": ModifiedIwan, "regularised masing": RegularisedMasing}
TURNS = "masing", "modified iwan", "masing", "modified iwan", "masing", "regularised masing"
"""Laws that are fitted, in turn; the last one needs the simulator and with it thirty times as long as the others."""
KINDS = "one", "power", "few", "falling"
"""Springs of a joint; the last has a few, and a mu that falls with the normal force, which no law here does."""
RESULT = Path(__file__).parent / "results" / "joint_maps.json"
SHAPES = {"masing": (), "modified iwan": ("chi",), "regularised masing": ("exponent",)}
OUTSIDE = 1.0, 1.25, 1.5, 2.0
"""Factors by which force levels and normal forces of a prediction lie outside those of the map."""


@dataclass(frozen=True)
class Host:
    """A mass of 1 kg at ``frequency`` Hz with a damping ratio."""

    frequency: float
    ratio: float

    @property
    def omega(self) -> float:
        """In rad/s."""
        return 2 * np.pi * self.frequency

    def model(self, law: FrictionLaw) -> BeamModel:
        """That mass, rubbing against a wall."""
        sides = ON, Dof(1, "+Z")
        host = Matrices(np.eye(2), np.diag([self.omega**2, 1e9]), sides)
        wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), tuple(replace(dof, part="wall") for dof in sides))
        joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, 100.0, 1.0)
        return BeamModel(host, wall, (joint,), Damping(ratio=self.ratio))


@dataclass(frozen=True)
class Springs:
    """Masing springs in parallel: shares of k_T and of the slip force, each of sum 1."""

    stiffness: np.ndarray
    slip: np.ndarray

    def describing(
        self, k: np.ndarray | float, limit: np.ndarray | float, amplitude: np.ndarray | float
    ) -> tuple[np.ndarray, np.ndarray]:
        """k' and k'' in N/m: of one spring with y = F_C / (k A), cos theta = 1 - 2 y,

        k' = (k / pi) (theta - sin(2 theta) / 2), k'' = 4 k y (1 - y) / pi (Caughey 1960).
        """
        each = np.multiply.outer(k, self.stiffness)
        y = np.minimum(np.multiply.outer(limit, self.slip) / (each * np.asarray(amplitude)[..., None]), 1.0)
        theta = np.arccos(1 - 2 * y)
        return np.sum(each * (theta - np.sin(2 * theta) / 2), axis=-1) / np.pi, np.sum(
            4 * each * y * (1 - y), axis=-1
        ) / np.pi


def closed_form_map(
    host: Host,
    springs: Springs,
    truth: Sequence[float],
    levels: Sequence[float],
    forces: Sequence[float],
    *,
    falling: tuple[float, float] = (0.0, 1000.0),
) -> ModalMap:
    """Frequency and damping of the host's mode at resonance; ``truth`` is mu, k_T at 1 kN and its exponent.

    mu falls with the normal force by the first number of ``falling`` as its power, and is as stated at the second.

    At quadrature w^2 = w_0^2 + k', F_E = A (k'' + 2 zeta w_s w), solved by bisection, and the damping ratio is
    (k'' + 2 zeta w_s w) / (2 w^2). w_s is the frequency with the joint stuck, for which the ratio of a model is stated.
    """
    mu, stiffness, exponent = truth
    level, force = np.meshgrid(levels, forces, indexing="ij")
    limit, joint = mu * force * (force / falling[1]) ** -falling[0], stiffness * (force / 1000) ** exponent
    low, high = np.full(level.shape, 1e-15), np.full(level.shape, 1e3)
    for _ in range(64):
        amplitude = np.sqrt(low * high)
        elastic, lost = springs.describing(joint, limit, amplitude)
        w = np.sqrt(host.omega**2 + elastic)
        loss = lost + 2 * host.ratio * np.sqrt(host.omega**2 + joint) * w
        above = amplitude * loss > level
        low, high = np.where(above, low, amplitude), np.where(above, amplitude, high)
    frequency, damping = w / (2 * np.pi), loss / (2 * w**2)
    return ModalMap(np.asarray(levels), np.asarray(forces), frequency, damping, method="frozen", name="closed form")


def described(
    model: BeamModel, levels: Sequence[float], at: Dof, output: Dof, band: tuple[float, float], tolerance: float
) -> list[Resonance]:
    """As `ema.simulate.maps.resonances`, of a ``Host`` with Masing springs; ``at`` and ``output`` are its mass.

    Where the band does not hold the resonance its nearer end is returned, as by the simulator.
    """
    (joint,) = model.joints
    law, omega = joint.law, np.sqrt(model.host.stiffness[0, 0])
    growth = (1000.0 / law.reference_force) ** law.stiffness_exponent
    truth = law.friction_coefficient, law.contact_stiffness * growth, law.stiffness_exponent
    host = Host(omega / (2 * np.pi), model.damping.ratio)
    chart = closed_form_map(host, Springs(*springs_of_law(law)), truth, levels, [joint.normal_force])
    frequency = np.clip(chart.frequency[:, 0], *band)
    return [Resonance(f, 0j, zeta, 0.0, 0.0) for f, zeta in zip(frequency, chart.damping[:, 0], strict=True)]


@contextmanager
def describing_functions() -> Iterator[None]:
    """Resonances of Masing springs from describing functions in place of the simulator."""
    simulated = maps.resonances

    def resonances(model: BeamModel, *of: Any) -> list[Resonance]:
        """By describing functions, or of a law that is none of springs by the simulator."""
        own = model.joints[0].law.name == "regularised masing"
        return simulated(model, *of) if own else described(model, *of)

    maps.resonances = resonances
    try:
        yield
    finally:
        maps.resonances = simulated


def noisy(chart: ModalMap, rng: np.random.Generator, of_damping: float, of_frequency: float) -> ModalMap:
    """With relative noise of damping and frequency, stated as it is."""
    draws = rng.standard_normal((2, *chart.damping.shape))
    damping = chart.damping * np.exp(of_damping * draws[0])
    frequency = chart.frequency * (1 + of_frequency * draws[1])
    stds = of_damping * damping, of_frequency * frequency
    return replace(chart, damping=damping, frequency=frequency, damping_std=stds[0], frequency_std=stds[1])


def springs_of(kind: str, rng: np.random.Generator) -> Springs:
    """One spring, forty of a power law (Segalman 2005) with a share that slips last, or two to four of any size."""
    if kind == "one":
        return Springs(np.ones(1), np.ones(1))
    if kind == "power":
        chi, last = rng.uniform(-0.9, 0.8), rng.uniform(0.0, 0.5)
        phi = (np.arange(40) + 0.5) / 40
        stiffness = phi ** (1 + chi) / np.sum(phi ** (1 + chi))
        slip = stiffness * phi
        stiffness, slip = np.append((1 - last) * stiffness, last), np.append((1 - last) * slip, last)
        return Springs(stiffness, slip / slip.sum())
    count = int(rng.integers(2, 5))
    return Springs(rng.dirichlet(np.full(count, 2.0)), rng.dirichlet(np.full(count, 2.0)))


@dataclass(frozen=True)
class Case:
    """One joint with its map, and the law that is fitted."""

    kind: str
    law: str
    host: Host
    springs: Springs
    truth: tuple[float, float, float]
    falling: tuple[float, float]
    model: BeamModel
    chart: ModalMap

    @property
    def band(self) -> tuple[float, float]:
        """Of the search: the map's frequencies and a fifth to either side."""
        return 0.8 * float(self.chart.frequency.min()), 1.2 * float(self.chart.frequency.max())

    def updated(self) -> ModelUpdate:
        """What the map says of the parameters."""
        return compare.update(self.model, self.chart, (*NAMES, *SHAPES[self.law]), ON, ON, band=self.band)

    def parameters(self, found: ModelUpdate) -> list[tuple[str, bool, bool, float]]:
        """Per parameter: name, whether it was held, whether it was called identifiable, and the interval's width."""
        rows = []
        for name, truth in zip(NAMES, self.truth, strict=True):
            n = found.names.index(name)
            low, high = found.intervals[n]
            width = high - low if name == "stiffness_exponent" else np.log(high / low)
            rows.append((name, bool(low <= truth <= high), found.identifiable[n], float(width)))
        return rows

    def predicted(self, found: ModelUpdate) -> list[dict[str, float | bool]]:
        """Of conditions within the map and outside it: how far, whether held, relative half widths and errors."""
        levels, forces = (_conditions(each) for each in (self.chart.force_levels, self.chart.normal_forces))
        told = compare.predict_map(found, self.chart, levels, forces, at=ON, output=ON, band=self.band)
        true = closed_form_map(self.host, self.springs, self.truth, levels, forces, falling=self.falling)
        rows = []
        for i, level in enumerate(levels):
            for j, force in enumerate(forces):
                row: dict[str, float | bool] = {
                    "level": _outside(level, self.chart.force_levels),
                    "force": _outside(force, self.chart.normal_forces),
                }
                for name in ("damping", "frequency"):
                    value = float(getattr(true, name)[i, j])
                    low, middle, high = (float(getattr(told, name + end)[i, j]) for end in ("_low", "", "_high"))
                    row[name] = bool(low <= value <= high)
                    row[f"{name} half"], row[f"{name} error"] = 0.5 * (high - low) / value, middle / value - 1
                rows.append(row)
        return rows


def _conditions(measured: np.ndarray) -> list[float]:
    """Below, within and above what was measured."""
    low, high = float(measured.min()), float(measured.max())
    return [low / 2, low / 1.25, (low * high) ** 0.5, 1.25 * high, 1.5 * high, 2 * high]


def _outside(value: float, measured: np.ndarray) -> float:
    """The factor by which a value lies outside what was measured; 1 within."""
    return round(max(value / float(measured.max()), float(measured.min()) / value, 1.0), 4)


def case(seed: int, number: int) -> Case:
    """A random joint."""
    rng = np.random.default_rng([seed, number])
    host = Host(10 ** rng.uniform(1.3, 2.9), 10 ** rng.uniform(-3, -2))
    kind, law = KINDS[number % 4], TURNS[(number // 4) % 6]
    exponent, mu = rng.uniform(0.0, 0.8), rng.uniform(0.1, 0.6)
    joint = 10 ** rng.uniform(-2.0, -0.5) * host.omega**2
    springs = springs_of(kind, rng)
    forces = np.geomspace(1.0, 10 ** rng.uniform(0.6, 1.6), rng.integers(3, 7)) * 10 ** rng.uniform(1.0, 2.0)
    levels = np.geomspace(1.0, 10 ** rng.uniform(0.4, 1.2), rng.integers(2, 5))
    middle = np.sqrt(forces[0] * forces[-1])
    stiffness = joint * (1000 / middle) ** exponent
    # damping is largest near A = 2 F_C / k_T; the middle of the map lies within a factor of 3 of it
    amplitude = 2 * mu * middle / joint * 10 ** rng.uniform(-0.5, 0.5)
    elastic, lost = springs.describing(joint, mu * middle, amplitude)
    w = np.sqrt(host.omega**2 + elastic)
    levels *= amplitude * (lost + 2 * host.ratio * np.sqrt(host.omega**2 + joint) * w) / np.sqrt(levels[0] * levels[-1])
    truth = mu, stiffness, exponent
    falling = (rng.uniform(0.05, 0.2) if kind == "falling" else 0.0, float(middle))
    exact = closed_form_map(host, springs, truth, levels, forces, falling=falling)
    chart = noisy(exact, rng, 10 ** rng.uniform(-2, -1.4), 10 ** rng.uniform(-4, -3))
    start = LAWS[law](mu * 4 ** rng.uniform(-1, 1), stiffness * 4 ** rng.uniform(-1, 1))
    return Case(kind, law, host, springs, truth, falling, host.model(start), chart)


def one(seed: int, number: int, simulator: bool) -> dict[str, Any]:
    """The outcome of a case as a row."""
    drawn, start = case(seed, number), time.process_time()
    row = {"seed": seed, "number": number, "joint": drawn.kind, "law": drawn.law, "points": drawn.chart.damping.size}
    with nullcontext() if simulator else describing_functions():
        try:
            found = drawn.updated()
            row |= {"parameters": drawn.parameters(found), "cpu": time.process_time() - start}
            row["predicted"] = drawn.predicted(found)
        except EmaError as error:
            row["refused"] = str(error)
    return {"cpu": time.process_time() - start} | row


def section(result: dict[str, Any]) -> str:
    """The counts as a table of the page on comparing."""
    lines = []
    for kind, law in product((*KINDS, "all"), (*LAWS, "all")):
        if (kind == "all") != (law == "all"):
            continue
        rows = [row for row in result["rows"] if kind in (row["joint"], "all") and law in (row["law"], "all")]
        whole = [part for row in rows for part in row.get("parameters", [])]
        sure = [part for part in whole if part[2]]
        widths = [np.median([part[3] for part in sure if part[0] == name] or [np.nan]) for name in NAMES]
        factors = [f"± {100 * (np.exp(width / 2) - 1):.0f} %" for width in widths[:2]]
        lines.append(
            [
                kind,
                law,
                f"{len(rows)}",
                f"{sum(part[1] for part in whole)} of {len(whole)}",
                f"{sum(part[1] for part in sure)} of {len(sure)}",
                *([*factors, f"± {widths[2] / 2:.2g}"] if sure else ["-"] * 3),
                f"{np.median([row['cpu'] for row in rows]):.0f}" if rows else "-",
            ]
        )
    head = ["joint", "law fitted", "maps", "held", "held, identifiable", "mu", "k_T", "growth", "CPU s"]
    refused = sum("refused" in row for row in result["rows"])
    return "\n\n".join([table(head, lines), f"{_source(result)}; {refused} maps refused."])


def _source(result: dict[str, Any]) -> str:
    command = f"python -m tests.bench.joint_maps {result['options']}"
    return f"From `{command}`, commit {result['commit']}"


def predictions(result: dict[str, Any]) -> str:
    """The counts of predictions as a table of the page on predictions."""
    rows = [part for row in result["rows"] for part in row.get("predicted", [])]
    lines = []
    for level, force in product(OUTSIDE, OUTSIDE):
        if min(level, force) > 1 and level != force:
            continue
        here = [row for row in rows if (row["level"], row["force"]) == (level, force)]
        known = [row for row in here if np.isfinite(row["damping half"])]
        line = [f"{level:g}", f"{force:g}", f"{len(known)} of {len(here)}"]
        for name in ("damping", "frequency"):
            half, error = (np.median(np.abs([row[f"{name} {what}"] for row in known])) for what in ("half", "error"))
            line += [f"{100 * np.mean([row[name] for row in known]):.1f}", f"{100 * half:.2g}", f"{100 * error:.2g}"]
        lines.append(line)
    head = ["F_E outside by", "F_N outside by", "conditions"]
    head += [f"{name} {what} [%]" for name in ("ζ", "f") for what in ("held", "half width", "error")]
    return "\n\n".join([table(head, lines), f"{_source(result)}. Half widths and errors are medians."])


def write(text: str, mark: str, part: Callable[[dict[str, Any]], str]) -> str:
    """A page with one of the tables between its marks."""
    begin, end = f"<!-- {mark}: begin -->", f"<!-- {mark}: end -->"
    before, rest = text.split(begin)
    made = part(json.loads(RESULT.read_text(encoding="utf-8"))) + older(("joint_maps",))
    return f"{before}{begin}\n{made}\n{end}{rest.split(end)[1]}"


def main() -> None:
    """Count, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=90)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--simulator", action="store_true", help="resonances of all laws by the simulator")
    parser.add_argument("--springs", action="store_true", help="fit only laws that are Masing springs")
    parser.add_argument("--publish", action="store_true", help="store the counts for the docs")
    options = parser.parse_args()
    rows, numbers = [], range(options.n)
    if options.springs:
        numbers = [n for n in numbers if TURNS[(n // 4) % 6] != "regularised masing"]
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        for row in pool.map(one, repeat(options.seed), numbers, repeat(options.simulator)):
            rows.append(row)
            print(json.dumps(row), flush=True)
    asked = (
        f"--n {options.n} --seed {options.seed}" + " --springs" * options.springs + " --simulator" * options.simulator
    )
    result = {"options": asked, "rows": rows} | stamp("tests.bench.joint_maps")
    print(section(result), predictions(result), sep="\n\n")
    if options.publish:
        RESULT.write_text(json.dumps(result) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
