"""``python -m tests.bench.brake_reuss_replay``: responses of a measured lap joint, by replaying the measured forces.

Brake-Reuss beam (Chen et al. 2022, MSSP 166:108401). Response-controlled levels up to 40, 50, 60 and 80 m/s^2 are fitted
(the modal mass by those levels alone); the force measured at each line of the levels above, and of the four
force-controlled levels, is replayed as a sweep up, as they were stepped. Errors are relative to the measured peak.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.datasets import dataset_folder
from acquisition.stepped_levels import LevelLayout, read_levels
from ema.compare import amplitude_draws, forced_response
from ema.data import AmplitudeDraws, SteppedLevel
from ema.estimate import amplitude_dependent_mode
from tests.bench.provenance import stamp
from tests.bench.write_docs import table

RESULT = Path(__file__).parent / "results" / "brake_reuss.json"
MARK = "replayed forces"
COUNTS = (4, 5, 6, 8)
"""Response-controlled levels fitted, from the lowest."""
GOAL = 0.06
"""Error relative to the peak that is aimed at."""
OPEN = 2.0
"""Median half width over the peak from which on a band is called open: its upper end is beyond the draws."""
SHIFTS = np.arange(-20, 21) * 0.01
"""Shifts of the resonance [Hz] of which the best is stated: what a change of frequency between two tests explains."""


def levels(control: str) -> Sequence[SteppedLevel]:
    """The response-controlled or force-controlled levels, lowest first."""
    name = f"FRdata.{control.capitalize()}Control.*."
    layout = LevelLayout(
        frequency=f"{name}frequency",
        force=f"{name}force",
        response=f"{name}amplitude",
        phase=f"{name}phase",
        control="response" if control == "response" else "force",
    )
    return read_levels(dataset_folder() / "01_brake_reuss_beam" / "ForcedFrequencyResponses.mat", layout)


def replay(draws: AmplitudeDraws, level: SteppedLevel) -> dict[str, Any]:
    """Errors of one level over its peak, and the share of its lines inside the bands."""
    measured = np.abs(level.response)
    peak = float(measured.max())
    found = forced_response(draws, level.force, level.frequencies)
    error = np.abs(found.up.value - measured) / peak
    widths = (np.minimum(found.up.high, 10 * peak) - found.up.low) / (2 * peak)
    median = [np.median(values, axis=0)[None] for values in (draws.frequency, draws.damping)]
    assert draws.modal_mass is not None
    alone = replace(draws, frequency=median[0], damping=median[1], modal_mass=draws.modal_mass[:1], smooth_over=0.0)
    shifted = []
    for shift in SHIFTS:
        moved = forced_response(replace(alone, frequency=median[0] + shift), level.force, level.frequencies)
        shifted.append(float(np.max(np.abs(moved.up.value - measured)) / peak))
    return {
        "control": level.control,
        "peak": peak,
        "beyond": peak / float(draws.levels[-1]),
        "largest error": float(error.max()),
        "median error": float(np.median(error)),
        "error of the peak": float(found.up.value.max() / peak - 1),
        "covered": float(np.mean((found.up.low <= measured) & (measured <= found.up.high))),
        "half width": float(np.median(widths)),
        "shifted": float(np.min(shifted)),
        "shift": float(SHIFTS[int(np.argmin(shifted))]),
    }


def rows() -> list[dict[str, Any]]:
    """Every fit, and every level replayed with it."""
    response, force = levels("response"), levels("force")
    done = []
    for count in COUNTS:
        draws = amplitude_draws(amplitude_dependent_mode(response[:count], name="Brake-Reuss beam"))
        for level in [*response[count:], *(force if count == len(response) else [])]:
            done.append({"fitted": float(draws.levels[-1])} | replay(draws, level))
            print(json.dumps(done[-1]), flush=True)
    return done


def section(result: dict[str, Any]) -> str:
    """The rows as a table of the page on predictions."""
    lines = [
        [
            f"{row['fitted']:.0f}",
            f"{row['control']}, {row['peak']:.0f}",
            f"{100 * row['largest error']:.0f}",
            f"{100 * row['median error']:.1f}",
            f"{100 * row['error of the peak']:+.1f}",
            f"{100 * row['covered']:.0f}",
            f"{100 * row['half width']:.0f}" if row["half width"] < OPEN else "open",
            f"{100 * row['shifted']:.0f} ({row['shift']:+.2f})" if np.isfinite(row["shifted"]) else "-",
        ]
        for row in result["rows"]
    ]
    head = [
        "fitted up to [m/s²]",
        "replayed, peak [m/s²]",
        "largest error [%]",
        "median error [%]",
        "error of the peak [%]",
        "lines inside [%]",
        "half width [%]",
        "largest error, shifted by [%] ([Hz])",
    ]
    within = sum(row["largest error"] <= GOAL for row in result["rows"])
    peaks = sum(abs(row["error of the peak"]) <= GOAL for row in result["rows"])
    count = len(result["rows"])
    return "\n\n".join(
        [
            table(head, lines),
            f"{within} of {count} levels are within {GOAL:.0%} of the peak at every line, {peaks} at the peak. From "
            f"`python -m tests.bench.brake_reuss_replay`, commit {result['commit']}.",
        ]
    )


def write(text: str) -> str:
    """A page with the table between its marks."""
    begin, end = f"<!-- {MARK}: begin -->", f"<!-- {MARK}: end -->"
    before, rest = text.split(begin)
    return f"{before}{begin}\n{section(json.loads(RESULT.read_text(encoding='utf-8')))}\n{end}{rest.split(end)[1]}"


def main() -> None:
    """Replay, print, keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--publish", action="store_true", help="store the figures for the docs")
    publish = parser.parse_args().publish
    result = {"rows": rows()} | stamp("tests.bench.brake_reuss_replay")
    print(section(result))
    if publish:
        RESULT.write_text(json.dumps(result) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
