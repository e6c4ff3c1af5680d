"""Do the bands of a placement hold where the joints only slide or only stick? Hosts of ``tests.bench.blind``, in seconds.

``python -m tests.bench.blind_linear --hosts 60 --seed 7`` draws hosts, data sheets, joints and a place for each, predicts
from noisy FRFs of the bare host, and compares the draws of the forecast with the linear limits of the truth (the finite
elements and joints of ``tests.bench.blind_hosts``, which share no code). What is missed here is no matter of friction:
shapes, flexibility, mass, damping, stiffness of the joints. A condition where no mode holds half of the bare one has no
number; sheet and truth scatter as stated there.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ema import place
from ema.data import Geometry
from ema.errors import InputError
from ema.place.bands import assembled
from ema.place.fundamental import linear_modes
from ema.place.intervals import beams_drawn, drawn
from ema.place.predictor import predict
from ema.place.shortlist import Question, question
from ema.place.task import Task, only
from ema.shapes import smooth, with_body_uncertainty, with_plate, with_rigid_body
from ema.study import chain
from ema.study.recipe import FitTable
from tests.bench.blind_hosts import hosts, truth
from tests.bench.blind_hosts.prediction import FULL, frfs_of, recipe_of

DRAWS, FORCE = 100, hosts.FORCES[1]


class Row(NamedTuple):
    """One mode of one host: whether the joints stick, the truth and the quantiles of the draws (2.5, 50, 97.5 %)."""

    host: int
    slender: bool
    stuck: bool
    truth: tuple[float, float]
    low: tuple[float, float]
    middle: tuple[float, float]
    high: tuple[float, float]


def limit_of(asked: Question, mode: int, stuck: bool) -> tuple[float, float]:
    """Frequency in Hz and damping ratio of the mode that moves the bare one most, by the predictor's matrices."""
    model = asked.model.with_normal_force(float(asked.normal_forces[0]))
    found = linear_modes(model, asked.at, sticking=stuck)
    row = int(np.argmax(np.abs(found.shapes[mode])))
    return float(found.frequencies[row]), float(found.damping_ratios[row])


def true_limit(parts: truth.Parts, mode: int, stuck: bool) -> tuple[float, float]:
    """The same of the truth."""
    frequencies, shapes = truth.linear(parts, FORCE, stuck)
    found = int(np.argmax(np.abs(shapes[mode])))
    omega = 2 * np.pi * frequencies[found]
    return float(frequencies[found]), float(parts.decay @ shapes[:, found] ** 2 / (2 * omega))


def rows_of(seed: int, number: int) -> Iterator[Row]:
    """Both limits of the target modes of a host, at a place drawn from its grid."""
    case = hosts.case(seed, number)
    measured, sheet = case.measured, case.sheet
    recipe = recipe_of(measured, sheet, {"name": "masing"}, FULL, DRAWS)
    points = np.column_stack([measured.points, np.zeros(len(measured.points))])
    geometry = Geometry(np.arange(1, len(points) + 1), points)
    known = chain.fitted(frfs_of(measured), FitTable())[1]
    bare, _ = with_rigid_body(known, geometry, recipe.mass)
    surface = with_body_uncertainty(smooth(bare, geometry), len(bare.poles) - len(known.poles), mass_known=True)
    modes = tuple(int(np.argmin(np.abs(bare.natural_frequencies - near))) for near in measured.targets)
    effort = recipe.search
    angles = np.radians(effort.angles).tolist()
    candidates = place.grid(surface, recipe.catalogue(), effort.step, angles, (), effort.margin)
    rng = np.random.default_rng([seed, number])
    here = only(candidates, [int(rng.integers(len(candidates)))])
    assert recipe.forecast is not None
    bare, surface, _ = with_plate(bare, surface)
    scale = 0.5 * recipe.forecast.calibration_std
    levels = hosts.LEVELS[:1]
    task = Task(bare, surface, recipe.bolted_joint(), recipe.at, levels, np.array([FORCE]), modes, scale_std=scale)
    nominal = question(task, predict(task, here), 0)
    draws = [assembled(nominal, one, beams_drawn(here, rng), rng) for one in drawn(task, DRAWS, rng)]
    spot = (*map(float, here.centres[0]), float(here.angles[0]))
    for mode, true_mode in zip(modes, case.modes, strict=True):
        drive = measured.points[measured.drive]
        parts = truth.assembled(case.host, sheet.bar, case.joint, case.loss, drive, spot, true_mode)
        if truth.share(parts, FORCE, true_mode) < truth.MAJORITY:
            continue
        for stuck in (False, True):
            values = np.array([limit_of(one, mode, stuck) for one in draws])
            low, middle, high = np.quantile(values, [0.025, 0.5, 0.975], axis=0, method="weibull")
            expected = true_limit(parts, true_mode, stuck)
            yield Row(number, measured.kind == "slender", stuck, expected, tuple(low), tuple(middle), tuple(high))


def report(rows: list[Row]) -> str:
    """Coverage with a bootstrap over hosts, widths and errors."""
    rng, lines = np.random.default_rng(0), [f"{len({row.host for row in rows})} hosts"]
    for stuck in (False, True):
        for column, name in enumerate(("f", "zeta")):
            picked = [row for row in rows if row.stuck == stuck]
            held = np.array([row.low[column] <= row.truth[column] <= row.high[column] for row in picked])
            half = np.array([100 * (row.high[column] - row.low[column]) / 2 / row.truth[column] for row in picked])
            error = np.array([100 * (row.middle[column] / row.truth[column] - 1) for row in picked])
            owners = np.array([row.host for row in picked])
            each = [np.flatnonzero(owners == host) for host in np.unique(owners)]
            again = [
                held[np.concatenate([each[n] for n in rng.integers(0, len(each), len(each))])].mean()
                for _ in range(2000)
            ]
            low, high = np.quantile(again, [0.025, 0.975])
            lines.append(
                f"{'stick' if stuck else 'slide':5s} {name:4s} inside {held.sum()} of {len(held)} = {held.mean():.1%} "
                f"[{low:.1%}, {high:.1%}]; half width median {np.median(half):.3f} %, 90th percentile "
                f"{np.quantile(half, 0.9):.2f} %; error median size {np.median(np.abs(error)):.3f} %, mean "
                f"{error.mean():+.3f} %"
            )
    return "\n".join(lines)


def main() -> None:
    """Hosts one by one; the score at the end."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--hosts", type=int, default=60)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--seed", type=int, default=None)
    chosen = options.parse_args()
    seed = int(time.time()) if chosen.seed is None else chosen.seed
    warnings.simplefilter("ignore", RuntimeWarning)
    rows: list[Row] = []
    refused: list[Any] = []
    for number in range(chosen.first, chosen.first + chosen.hosts):
        try:
            rows += list(rows_of(seed, number))
        except InputError as error:
            refused.append(error)
        print(number, len(rows), flush=True)
    print(f"seed {seed}; refused: {len(refused)}")
    print(report(rows))


if __name__ == "__main__":
    main()
