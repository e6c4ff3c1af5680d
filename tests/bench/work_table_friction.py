"""What one linear mode fitted to the hammer test of the work table reads, over the force of the impacts and friction.

A hammer test determines the ratio of the peak force to the friction coefficient alone: the same motion follows from twice
both. The paper prints 492 Hz and 1.8 % at 1 kN; this says for which ratios the table reads that, all 80 points struck.

    python -m tests.bench.work_table_friction --write docs/maps.md
"""

import argparse
from dataclasses import replace
from pathlib import Path

from ema import estimate, fit
from ema.data import Condition, Run
from ema.datasets import work_table, work_table_hammer
from tests.bench import marked

BAND = (300.0, 1300.0)
COEFFICIENTS = (0.015, 0.018, 0.020, 0.0225, 0.025, 0.0275, 0.030)
NEAR = {1e3: 492.0, 5e3: 507.0, 1e4: 509.0}
"""Frequency of the paper in Hz at each normal force in N."""


def read(coefficient: float, force: float) -> tuple[float, float]:
    """Natural frequency [Hz] and damping ratio of mode 1 as a linear analysis of all points reads them.

    Parameters
    ----------
    coefficient : friction coefficient, with impacts of 1 kN.
    force : normal force of each joint, N.
    """
    setting = work_table.CENTRE
    rubbing = replace(setting, law=replace(setting.law, friction_coefficient=coefficient))
    rig = replace(work_table_hammer._rig("beam", force), model=work_table.with_beam(rubbing, force, work_table.grid()))
    frfs, _ = estimate.hammer_test(Run("beam", Condition(rig.drive.excitation), tuple(rig.takes())))
    mode = fit.local_fit(frfs.band(*BAND), NEAR[force])
    return mode.natural_frequency, mode.damping_ratio


def table() -> str:
    """Readings as lines of a page."""
    lines = ["| friction coefficient | peak force over it | 1 kN | 5 kN | 10 kN |", "|---|---|---|---|---|"]
    for coefficient in COEFFICIENTS:
        readings = [read(coefficient, force) for force in NEAR]
        text = " | ".join(f"{frequency:.1f} Hz, {100 * damping:.2f} %" for frequency, damping in readings)
        ratio = work_table_hammer.PEAK / coefficient / 1000
        lines.append(f"| {coefficient:g} | {ratio:.1f} kN | {text} |")
        print(lines[-1], flush=True)
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, help="page with a marked table")
    given = parser.parse_args()
    text = table()
    if given.write:
        marked.write(given.write, "friction coefficient", text)


if __name__ == "__main__":
    main()
