"""What swept and stepped sines read on the work table with a friction beam: one mode fitted to the FRFs of either.

The force on the table has a constant amplitude in both, without a shaker between, so that only the passage of the
resonance differs: steps wait for the steady state, sweeps do not. A slow and a fast sweep pass upwards from rest.

    python -m tests.bench.work_table_sweeps --setting bending --write docs/maps.md
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ema.data import Channel, Condition, FrfSet, Run
from ema.datasets import work_table
from ema.dof import Dof
from ema.errors import InputError
from ema.estimate import stepped, sweep
from ema.fit import local_fit
from ema.simulate import FrictionRig, SteppedSine, SweptShaker
from tests.bench import marked

RATE, BAND, NEAR = 4096.0, (455.0, 535.0), (470.0, 520.0)
LINES = tuple(np.arange(462.0, 527.0, 1.0).tolist())
RATES = (20.0, 160.0)
"""Hz/s of the sweeps."""
LEVELS, FORCES = (6.0, 15.0, 30.0), (25.0, 100.0, 300.0)
SETTINGS = {"absorber": work_table.ABSORBER, "bending": work_table.BENDING}


@dataclass(frozen=True)
class Reading:
    """Frequency [Hz] and damping ratio of the mode by one fit, NaN where there is no peak."""

    frequency: float
    damping: float


def _rig(setting: work_table.Setting, force: float, drive: SteppedSine | SweptShaker) -> FrictionRig:
    at = Dof(work_table.DRIVE_NODE, "+Z")
    sensor = Channel("acc", at, quantity="acceleration", unit="m/s^2")
    return FrictionRig(work_table.with_beam(setting, force), drive, (sensor,), RATE, noise={"acceleration": 0.02})


def read(setting: work_table.Setting, level: float, force: float, rate: float | None) -> Reading:
    """The reading of a sweep of ``rate`` Hz/s, or of steps."""
    at = Dof(work_table.DRIVE_NODE, "+Z")
    if rate is None:
        drive: SteppedSine | SweptShaker = SteppedSine(at, level, LINES, 400 / RATE)
        estimator = stepped
    else:
        length = (BAND[1] - BAND[0]) / rate
        drive, estimator = SweptShaker(at, level, BAND, length, length + 1.0), sweep
    run = Run("table", Condition(drive.excitation), tuple(_rig(setting, force, drive).takes()))
    return _fitted(estimator(run).band(LINES[0], LINES[-1]))


def _fitted(frfs: FrfSet) -> Reading:
    height = np.sum(np.abs(frfs.values) ** 2, axis=(1, 2))
    inside = (frfs.frequencies > NEAR[0]) & (frfs.frequencies < NEAR[1])
    try:
        mode = local_fit(frfs, float(frfs.frequencies[np.argmax(np.where(inside, height, 0))]))
    except InputError:
        return Reading(float("nan"), float("nan"))
    return Reading(mode.natural_frequency, mode.damping_ratio)


def table(setting: work_table.Setting) -> str:
    """Readings as lines of a page."""
    heads = ["steps", *(f"{rate:g} Hz/s" for rate in RATES)]
    lines = ["| F_E, F_N | " + " | ".join(heads) + " |", "|---|" + "---|" * len(heads)]
    for force in FORCES:
        for level in LEVELS:
            cells = [read(setting, level, force, rate) for rate in (None, *RATES)]
            text = " | ".join(f"{one.frequency:.1f} Hz, {100 * one.damping:.2f} %" for one in cells)
            lines.append(f"| {level:g} N, {force:g} N | {text} |")
            print(lines[-1], flush=True)
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--setting", choices=sorted(SETTINGS), default="bending")
    parser.add_argument("--write", type=Path, help="page with a marked table")
    given = parser.parse_args()
    text = table(SETTINGS[given.setting])
    if given.write:
        marked.write(given.write, f"sweeps, {given.setting}", text)


if __name__ == "__main__":
    main()
