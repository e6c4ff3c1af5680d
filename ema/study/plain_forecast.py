"""Forecasts of beams at named locations as plain numbers and texts, beside the structure without the beam."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ema.data import Forecast, ModalModel
from ema.data.modal import COVERAGE_FACTOR
from ema.study.plain import finding, number

Bounds = tuple[float, float, float]
"""Low, value and high."""
READINGS = {
    "measured": "f and damping as a one-mode fit of a stepped sine about the resonance reads them",
    "frozen": "f and damping by quadrature and power of the steady state at resonance",
}
"""What the values of each method are."""
_ENDS = ("low", "value", "high")
COLUMNS = (
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
"""Columns of the forecasts as a table, in SI; what is not known is NaN."""


def table(forecasts: Sequence[Forecast], bare: ModalModel) -> Iterator[tuple[Any, ...]]:
    """Return one row for each location, mode and condition, in the order of ``COLUMNS``."""
    for forecast in forecasts:
        x, y = forecast.centre
        for row, mode in enumerate(forecast.modes):
            without = without_beam(forecast, bare, row)
            for level, force, f, z in _conditions(forecast, row):
                yield (forecast.beam, x, y, forecast.angle, mode, level, force, *f, *z, *without[0], *without[1])


def mapping(forecasts: Sequence[Forecast], bare: ModalModel) -> list[dict[str, Any]]:
    """Forecasts as what JSON can hold: SI and fractions; a number that is not known is None."""
    return [
        {
            "beam": forecast.beam,
            "centre": list(forecast.centre),
            "angle": forecast.angle,
            "method": forecast.method,
            "draws": forecast.draws,
            "modes": [_mode(forecast, bare, row) for row in range(len(forecast.modes))],
            "findings": [finding(one) for one in forecast.findings],
        }
        for forecast in forecasts
    ]


def lines(forecast: Forecast, bare: ModalModel) -> list[str]:
    """One line for each mode without the beam and for each condition with it, for people."""
    result = []
    for row, mode in enumerate(forecast.modes):
        result.append(f"mode {mode} without the beam: {_said(*without_beam(forecast, bare, row))}")
        for level, force, f, z in _conditions(forecast, row):
            said = _said(f, z) if np.isfinite(f[1]) else "no single resonance belongs to the mode"
            result.append(f"mode {mode}, F_E {level:.4g} N, F_N {force:.4g} N: {said}")
    return result


def without_beam(forecast: Forecast, bare: ModalModel, row: int) -> tuple[Bounds, Bounds]:
    """Frequency [Hz] and damping ratio of a target mode without the beam, with their 95 % intervals where known."""
    frequency, damping = float(forecast.bare_frequencies[row]), float(forecast.bare_damping[row])
    mode = int(np.argmin(np.abs(bare.natural_frequencies - frequency)))
    if bare.covariance is None:
        return (np.nan, frequency, np.nan), (np.nan, damping, np.nan)
    half = COVERAGE_FACTOR * np.sqrt(np.diag(bare.covariance[mode]))
    return (
        (frequency - float(half[0]), frequency, frequency + float(half[0])),
        (max(damping - float(half[1]), 0.0), damping, damping + float(half[1])),
    )


def _conditions(forecast: Forecast, row: int) -> Iterator[tuple[float, float, Bounds, Bounds]]:
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


def _mode(forecast: Forecast, bare: ModalModel, row: int) -> dict[str, Any]:
    frequency, damping = without_beam(forecast, bare, row)
    return {
        "mode": forecast.modes[row],
        "without_beam": {"frequency": _known(frequency), "damping": _known(damping)},
        "conditions": [
            {"force": level, "normal_force": force, "frequency": _known(f), "damping": _known(z)}
            for level, force, f, z in _conditions(forecast, row)
        ],
    }


def _known(bounds: Bounds) -> list[float | None]:
    return [number(one) for one in bounds]


def _said(f: Bounds, z: Bounds) -> str:
    band = f" [{f[0]:.3f}, {f[2]:.3f}]" if np.isfinite(f[0]) else " (no band)"
    percent = f" [{100 * z[0]:.3f}, {100 * z[2]:.3f}]" if np.isfinite(z[0]) else " (no band)"
    return f"{f[1]:.3f} Hz{band}, damping {100 * z[1]:.3f} %{percent}"
