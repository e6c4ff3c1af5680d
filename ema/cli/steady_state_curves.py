"""Curves of steady states for `ema simulate frf`: what is stable, what coexists, and branches that no sweep reaches."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from acquisition.model_file import FrfTable
from ema import show, simulate
from ema.cli.simulation_job import Job
from ema.data import BeamModel
from ema.data.stability import SteadyStateCurve
from ema.progress import Progress

_MEANING = (
    "Stable means stable against small disturbances. The curves are those that the search reached: there may be others."
)


def with_curves(
    job: Job, table: FrfTable, models: dict[str, BeamModel], levels: Sequence[float], progress: Progress
) -> Job:
    """Add the curves of steady states through their folds, with their stability, to the job of an FRF.

    Parameters
    ----------
    job : Job
        What `ema simulate frf` leaves without them.
    table : FrfTable
        ``[frf]`` of the model file.
    models : dict of str to BeamModel
        The model at every normal force, by its label.
    levels : sequence of float
        Force amplitudes [N].
    progress : Progress
        Called while it is computed.

    Returns
    -------
    Job
        The same with the curves for the store, a picture, a row for every stretch of one verdict, and what the search
        can say.
    """
    settings = simulate.HarmonicBalance(table.tolerance)
    outputs = table.outputs or [table.at]
    curves: list[SteadyStateCurve] = []
    labels: list[str] = []
    rows: list[dict[str, Any]] = []
    for pressed, model in models.items():
        for level in levels:
            band = float(table.band[0]), float(table.band[1])
            followed = simulate.frf_curves(model, band, level, table.at, outputs, settings, progress=progress)
            for number, curve in enumerate(followed, start=1):
                label = f"{level:g} N, F_N {pressed}"
                curves.append(curve)
                labels.append(label)
                job.contents[f"curve {number}, {label}"] = curve
                rows += [{"F_E [N]": float(level), "F_N": pressed, "curve": number, **row} for row in _stretches(curve)]
    job.more["stability"] = rows
    job.pictures["stability"] = show.steady_state_curves(curves, labels)
    job.statement = f"{job.statement} {_MEANING}".strip()
    return job


def _stretches(curve: SteadyStateCurve) -> list[dict[str, Any]]:
    """A row for every stretch of one verdict along a curve."""
    begins = [0, *(n for n in range(1, len(curve.verdicts)) if curve.verdicts[n] != curve.verdicts[n - 1])]
    rows = []
    for first, end in zip(begins, [*begins[1:], len(curve.verdicts)], strict=True):
        part = slice(first, end)
        largest = curve.largest[part][np.isfinite(curve.largest[part])]
        rows.append(
            {
                "ends": " to ".join(curve.ends),
                "lost because": " and ".join(reason for reason in curve.reasons if reason),
                "detached": curve.detached,
                "from [Hz]": float(curve.frequencies[first]),
                "to [Hz]": float(curve.frequencies[end - 1]),
                "|X| max [um]": 1e6 * float(np.abs(curve.values[part, 0]).max()),
                "stability": curve.verdicts[first],
                "undecided because": " or ".join(dict.fromkeys(filter(None, curve.undecided_because[part]))),
                "loss": curve.losses[first],
                "largest multiplier": float(largest.max()) if len(largest) else float("nan"),
            }
        )
    return rows
