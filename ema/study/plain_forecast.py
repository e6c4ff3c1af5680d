"""Forecasts of beams at named locations as plain numbers and texts, beside the structure without the beam."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ema.data import Forecast, ModalModel
from ema.place import BeamsForecast, BeamsSearch
from ema.report.prediction_tables import FORECAST_COLUMNS, Bounds, conditions, forecast_rows, without_beam
from ema.study.plain import finding, number

READINGS = {
    "measured": "f and damping as a one-mode fit of a stepped sine about the resonance reads them",
    "frozen": "f and damping by quadrature and power of the steady state at resonance",
}
"""What the values of each method are."""
_OF_A_BEAM = ("beam_@", "x_@_m", "y_@_m", "angle_@_rad", "normal_force_@_N")
"""Columns that every one of several beams has, with its number."""
_ALONE = ("beam", "x_m", "y_m", "angle_rad", "normal_force_N")
"""Columns of a beam alone that these stand for."""


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


def mapping_together(result: BeamsForecast, bare: ModalModel) -> dict[str, Any]:
    """The forecast of beams that act together, likewise; normal forces are lists, one number per beam."""
    forecast, pressed = result.forecast, _pressed(result)
    modes = [_mode(forecast, bare, row) for row in range(len(forecast.modes))]
    for condition in (condition for mode in modes for condition in mode["conditions"]):
        condition["normal_forces"] = pressed[condition.pop("normal_force")].tolist()
    return {
        "beams": [{"beam": one.beam, "centre": list(one.centre), "angle": one.angle} for one in result.locations],
        "method": forecast.method,
        "draws": forecast.draws,
        "modes": modes,
        "findings": [finding(one) for one in forecast.findings],
    }


def mapping_of_choice(choice: BeamsSearch, together: BeamsForecast | None, bare: ModalModel) -> dict[str, Any]:
    """Several beams that were chosen, how they were searched, and their forecast where there is one."""
    return {
        "searched": "one after the other, then exchanged",
        "rounds": choice.rounds,
        "cases": choice.cases,
        "objective": choice.objective,
        "value": float(choice.values[-1]),
        "value_of_the_best_alone": choice.alone,
        "beams": [
            {"beam": one.beam, "centre": list(one.centre), "angle": one.angle, "normal_force": float(force)}
            for one, force in zip(choice.locations, choice.normal_forces, strict=True)
        ],
        "forecast": None if together is None else mapping_together(together, bare),
    }


def columns_together(count: int) -> tuple[str, ...]:
    """Columns of the forecast of so many beams as a table, in SI."""
    own = (name.replace("@", str(n)) for n in range(1, count + 1) for name in _OF_A_BEAM)
    return (*own, *(name for name in FORECAST_COLUMNS if name not in _ALONE))


def rows_together(result: BeamsForecast, bare: ModalModel) -> Iterator[tuple[Any, ...]]:
    """One row for each mode and condition, in the order of ``columns_together``."""
    pressed = _pressed(result)
    for row in forecast_rows([result.forecast], bare):
        said = dict(zip(FORECAST_COLUMNS, row, strict=True))
        forces = pressed[said["normal_force_N"]].tolist()
        own = [
            value
            for one, force in zip(result.locations, forces, strict=True)
            for value in (one.beam, *one.centre, one.angle, force)
        ]
        yield (*own, *(value for name, value in said.items() if name not in _ALONE))


def lines_together(result: BeamsForecast, bare: ModalModel) -> list[str]:
    """One line for each mode without beams and for each condition with all of them, for people."""
    pressed = _pressed(result)
    return lines(result.forecast, bare, lambda force: ", ".join(f"{one:.4g}" for one in _shortened(pressed[force])))


def _pressed(result: BeamsForecast) -> dict[float, np.ndarray]:
    """Normal forces of all beams [N] by that of the beam that is pressed most."""
    return dict(zip(result.forecast.normal_forces.tolist(), result.normal_forces, strict=True))


def _shortened(forces: np.ndarray) -> np.ndarray:
    """A single force where all are alike."""
    return forces[:1] if np.ptp(forces) == 0 else forces


def lines(forecast: Forecast, bare: ModalModel, pressed: Callable[[float], str] = "{:.4g}".format) -> list[str]:
    """One line for each mode without the beam and for each condition with it, for people."""
    result = []
    for row, mode in enumerate(forecast.modes):
        result.append(f"mode {mode} without the beam: {_said(*without_beam(forecast, bare, row))}")
        for level, force, f, z in conditions(forecast, row):
            said = _said(f, z) if np.isfinite(f[1]) else "no single resonance belongs to the mode"
            result.append(f"mode {mode}, F_E {level:.4g} N, F_N {pressed(force)} N: {said}")
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
