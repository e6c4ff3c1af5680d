"""``python -m tests.bench.brake_reuss``: what lies beyond the levels of a measured lap joint, predicted from those below.

Brake-Reuss beam (Chen et al. 2022, MSSP 166:108401), response-controlled levels from 5 to 80 m/s^2, all lines of each.
Levels up to 20, 30, 40, 50 and 60 m/s^2 are fitted, all higher ones predicted, with the same settings.
"""

import argparse
import json

import numpy as np

from acquisition.datasets import dataset_folder
from acquisition.stepped_levels import LevelLayout, read_levels
from ema.compare import confirmed, predict_amplitudes
from ema.data import AmplitudeDependentMode
from ema.estimate import amplitude_dependent_mode

SPLITS = (20.0, 30.0, 40.0, 50.0, 60.0)
"""Highest nominal level fitted in m/s^2."""


def levels() -> AmplitudeDependentMode:
    """The mode over its amplitude, as all levels show it."""
    name = "FRdata.ResponseControl.*."
    layout = LevelLayout(
        frequency=f"{name}frequency",
        force=f"{name}force",
        response=f"{name}amplitude",
        phase=f"{name}phase",
        control="response",
    )
    path = dataset_folder() / "01_brake_reuss_beam" / "ForcedFrequencyResponses.mat"
    return amplitude_dependent_mode(read_levels(path, layout), name="Brake-Reuss beam")


def split(mode: AmplitudeDependentMode, highest: float) -> list[dict[str, object]]:
    """Every level above ``highest``: measured, predicted, and whether it is covered."""
    count = int(np.sum(mode.amplitude < 1.05 * highest))
    found = predict_amplitudes(mode.lowest(count), mode.amplitude[count:].tolist())
    rows: list[dict[str, object]] = []
    for n, amplitude in enumerate(found.amplitude):
        f, zeta = mode.frequency.value[count + n], mode.damping.value[count + n]
        bands = found.frequency, found.damping
        rows.append(
            {
                "fitted up to": highest,
                "level": round(float(amplitude), 2),
                "times beyond": round(float(found.beyond[n]), 2),
                "next": n == 0,
                "zeta": zeta,
                "zeta error": float(bands[1].value[n] / zeta - 1),
                "zeta half width": float(bands[1].half_width[n] / bands[1].value[n]),
                "zeta covered": bool(bands[1].low[n] <= zeta <= bands[1].high[n]),
                "f error": float(bands[0].value[n] / f - 1),
                "f half width": float(bands[0].half_width[n] / f),
                "f covered": bool(bands[0].low[n] <= f <= bands[0].high[n]),
                "weights": dict(zip(found.laws, found.weights.round(2).tolist(), strict=True)),
                "findings": [finding.message for finding in found.findings],
                "identifiable": [p.name for p in found.parameters if p.identifiable],
                "confirmed": confirmed(found, mode),
            }
        )
    return rows


def main() -> None:
    """Fit every split, predict, print a table or JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    mode = levels()
    rows = [row for highest in SPLITS for row in split(mode, highest)]
    if parser.parse_args().json:
        print(json.dumps(rows, indent=1))
        return
    columns = [name for name in rows[0] if name not in ("weights", "findings", "identifiable", "confirmed", "next")]
    print(" | ".join(columns))
    for row in rows:
        print(" | ".join(f"{row[name]:.4g}" if isinstance(row[name], float) else str(row[name]) for name in columns))
    for highest in SPLITS:
        first = next(row for row in rows if row["fitted up to"] == highest)
        print(f"up to {highest:g}: {first['weights']} {first['findings']} identifiable {first['identifiable']}")
    for what in ("zeta", "f"):
        covered = [row[f"{what} covered"] for row in rows]
        near = [row[f"{what} half width"] for row in rows if row["next"]]
        print(
            f"{what}: {sum(covered)} of {len(covered)} covered, median half width at the next level {np.median(near):.3g}"
        )


if __name__ == "__main__":
    main()
