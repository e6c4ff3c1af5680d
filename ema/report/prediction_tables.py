"""Columns and rows of what is predicted, in SI: the tables of `ema predict`, and those beside its report."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ema.data import ForcedResponse, Forecast, ModalModel
from ema.data.modal import COVERAGE_FACTOR

Bounds = tuple[float, float, float]
"""Low, value and high."""
_ENDS = ("low", "value", "high")

RESPONSE_COLUMNS = (
    "frequency_Hz",
    "force_N",
    *(f"{sweep}_{end}" for sweep in ("up", "down") for end in ("low", "median", "high")),
    "phase_up_rad",
    "phase_down_rad",
    "responses",
)
"""Columns of a response as a table: amplitudes are in the SI unit of the quantity."""
FORECAST_COLUMNS = (
    "beam",
    "x_m",
    "y_m",
    "angle_rad",
    "mode",
    "force_N",
    "normal_force_N",
    *(f"{what}_{end}" for what in ("frequency_Hz", "damping") for end in _ENDS),
    *(f"bare_{what}_{end}" for what in ("frequency_Hz", "damping") for end in _ENDS),
)
"""Columns of forecasts as a table, in SI; what is not known is NaN."""


def response_rows(response: ForcedResponse) -> Iterator[tuple[Any, ...]]:
    """Return the rows of a response as a table: one for each frequency, in the order of ``RESPONSE_COLUMNS``."""
    columns = [response.frequencies, response.force]
    for sweep in (response.up, response.down):
        columns += [sweep.low, sweep.value, sweep.high]
    columns += [response.phase_up.value, response.phase_down.value, response.solutions]
    return zip(*(column.tolist() for column in columns), strict=True)


def forecast_rows(forecasts: Sequence[Forecast], bare: ModalModel | None) -> Iterator[tuple[Any, ...]]:
    """Return one row for each location, mode and condition, in the order of ``FORECAST_COLUMNS``."""
    for forecast in forecasts:
        x, y = forecast.centre
        for row, mode in enumerate(forecast.modes):
            without = without_beam(forecast, bare, row)
            for level, force, f, z in conditions(forecast, row):
                yield (forecast.beam, x, y, forecast.angle, mode, level, force, *f, *z, *without[0], *without[1])


def without_beam(forecast: Forecast, bare: ModalModel | None, row: int) -> tuple[Bounds, Bounds]:
    """Frequency [Hz] and damping ratio of a target mode without the beam, with their 95 % intervals where known."""
    frequency, damping = float(forecast.bare_frequencies[row]), float(forecast.bare_damping[row])
    if bare is None or bare.covariance is None:
        return (np.nan, frequency, np.nan), (np.nan, damping, np.nan)
    mode = int(np.argmin(np.abs(bare.natural_frequencies - frequency)))
    half = COVERAGE_FACTOR * np.sqrt(np.diag(bare.covariance[mode]))
    return (
        (frequency - float(half[0]), frequency, frequency + float(half[0])),
        (max(damping - float(half[1]), 0.0), damping, damping + float(half[1])),
    )


def conditions(forecast: Forecast, row: int) -> Iterator[tuple[float, float, Bounds, Bounds]]:
    """F_E and F_N [N], and low, value and high of frequency and damping ratio of one mode."""
    for level, force in np.ndindex(len(forecast.force_levels), len(forecast.normal_forces)):
        f, z = (
            (
                float(getattr(forecast, f"{what}_low")[row, level, force]),
                float(getattr(forecast, what)[row, level, force]),
                float(getattr(forecast, f"{what}_high")[row, level, force]),
            )
            for what in ("frequency", "damping")
        )
        yield float(forecast.force_levels[level]), float(forecast.normal_forces[force]), f, z
