"""Small results as `ema predict` stores them: of levels at amplitudes and under forces, of a map, and at locations."""

from dataclasses import replace
from typing import Any

import numpy as np

from ema import examples
from ema.compare import force_surface, forced_resonances, forced_response, predict_from_draws
from ema.data import (
    AmplitudeDependentMode,
    AmplitudeDraws,
    Band,
    Finding,
    MapPrediction,
    ModelUpdate,
    Provenance,
)
from ema.data.amplitude import LawParameter

LEVELS = np.array([5.0, 10.0, 20.0, 40.0, 60.0])
"""Amplitudes of the levels that were measured [m/s²]; the highest is held out."""
FAR = Finding(
    "warning",
    "far-outside-the-data",
    "mode 1",
    "the highest amplitude is 2.5 times the highest measured one.",
    2.5,
    2.0,
    "The bands are calibrated up to twice the highest level; measure nearer to these amplitudes.",
)


def frequency(amplitude: np.ndarray) -> np.ndarray:
    return 100 - 0.01 * amplitude


def damping(amplitude: np.ndarray) -> np.ndarray:
    return 0.001 + 1e-4 * amplitude


def measured() -> AmplitudeDependentMode:
    f, z = frequency(LEVELS), damping(LEVELS)
    origin = Provenance(versions=(("numpy", "2.4.6"),), inputs=(("levels.mat", "ab12"),))
    bands = Band(f - 0.01, f, f + 0.01), Band(0.98 * z, z, 1.02 * z)
    return AmplitudeDependentMode(LEVELS, *bands, name="mode 1", provenance=origin)


def draws(count: int = 60) -> AmplitudeDraws:
    """Draws that spread more the further they lie beyond 40 m/s²."""
    amplitude, rng = np.geomspace(2.5, 120.0, 25), np.random.default_rng(4)
    spread = 0.01 + 0.3 * np.maximum(np.log(amplitude / 40), 0)
    off = rng.standard_normal((count, 1)) * spread
    return AmplitudeDraws(
        amplitude,
        frequency(amplitude) * (1 - 1e-3 * off),
        damping(amplitude) * np.exp(off),
        levels=LEVELS[:4],
        modal_mass=np.full(count, 2.0),
        laws=("power law", "masing", "two masing springs", "valanis"),
        weights=np.array([0.55, 0.3, 0.1, 0.05]),
        contains="noise of the levels, parameters and form of the law",
        name="mode 1",
    )


def levels() -> dict[str, Any]:
    """At amplitudes within, above and far above the levels, and under two forces; two parameters of a law."""
    kept = draws()
    parameters = (
        LawParameter("two masing springs", "ln a_max/a_s of spring 1", 0.2, 0.31, 0.55, identifiable=True),
        LawParameter(
            "power law", "chi", -0.9, 0.1, 1.1, identifiable=False,
            reason="its interval does not close within the prior; its estimates with levels left out disagree",
        ),
    )  # fmt: skip
    at = predict_from_draws(kept, [15.0, 60.0, 100.0])
    at = replace(at, parameters=parameters, findings=(FAR,))
    return {
        "mode": measured().lowest(4),
        "measured": measured(),
        "draws": kept,
        "prediction": at,
        "resonances": forced_resonances(kept, [0.5, 1.5]),
        "surface": force_surface(kept),
        "response_1": forced_response(kept, 0.5),
        "response_2": forced_response(kept, 1.5),
    }


def of_map() -> dict[str, Any]:
    """Below, within and above the forces of a map; one condition without a resonance."""
    chart = examples.modal_map()
    f, z = np.array([[40.1, 40.4], [40.2, np.nan]]), np.array([[0.011, 0.015], [0.021, np.nan]])
    predicted = MapPrediction(
        [2.0, 12.0],
        [300.0, 2000.0],
        f,
        f - 0.21,
        f + 0.33,
        z,
        0.8 * z,
        1.3 * z,
        statement="The highest normal force is 2 times the highest measured one.",
        contains="noise of the map, parameters, form of the law, frequency of the host",
        name=chart.name,
        findings=(replace(FAR, message="the lowest measured force level is 2.5 times the lowest one predicted."),),
    )
    names, intervals = ("friction_coefficient", "contact_stiffness"), [[0.41, 0.52], [1e6, 9e7]]
    model = examples.beam_model()
    update = ModelUpdate(model, names, [0.45, 2.1e7], intervals, (True, False), np.eye(2), 1.01, misfit=1.1)
    return {"prediction": predicted, "map": chart, "update": update}


def locations() -> dict[str, Any]:
    """One beam at two locations, with conditions beyond those that the first screen says."""
    here = replace(examples.forecast(), beam="steel 60 x 50")
    there = replace(
        here, centre=(0.2, 0.13), angle=np.pi / 2, damping=1.4 * here.damping, damping_high=2 * here.damping
    )
    return {"bare": examples.modal_model(), "forecast_1": here, "forecast_2": there}


def results() -> dict[str, dict[str, Any]]:
    return {"predicted levels": levels(), "predicted map": of_map(), "predicted locations": locations()}
