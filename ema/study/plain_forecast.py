"""Forecasts of beams at named locations as plain numbers and texts, beside the structure without the beam."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ema.data import Forecast, ModalModel
from ema.report.prediction_tables import Bounds, conditions, without_beam
from ema.study.plain import finding, number

READINGS = {
    "measured": "f and damping as a one-mode fit of a stepped sine about the resonance reads them",
    "frozen": "f and damping by quadrature and power of the steady state at resonance",
}
"""What the values of each method are."""


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
        for level, force, f, z in conditions(forecast, row):
            said = _said(f, z) if np.isfinite(f[1]) else "no single resonance belongs to the mode"
            result.append(f"mode {mode}, F_E {level:.4g} N, F_N {force:.4g} N: {said}")
    return result


def _mode(forecast: Forecast, bare: ModalModel, row: int) -> dict[str, Any]:
    frequency, damping = without_beam(forecast, bare, row)
    return {
        "mode": forecast.modes[row],
        "without_beam": {"frequency": _known(frequency), "damping": _known(damping)},
        "conditions": [
            {"force": level, "normal_force": force, "frequency": _known(f), "damping": _known(z)}
            for level, force, f, z in conditions(forecast, row)
        ],
    }


def _known(bounds: Bounds) -> list[float | None]:
    return [number(one) for one in bounds]


def _said(f: Bounds, z: Bounds) -> str:
    band = f" [{f[0]:.3f}, {f[2]:.3f}]" if np.isfinite(f[0]) else " (no band)"
    percent = f" [{100 * z[0]:.3f}, {100 * z[2]:.3f}]" if np.isfinite(z[0]) else " (no band)"
    return f"{f[1]:.3f} Hz{band}, damping {100 * z[1]:.3f} %{percent}"
