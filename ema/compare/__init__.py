"""Measured against simulated, and what it says about the model."""

from ema.public import attach

_HOMES = {
    "amplitude_draws": "ema.compare.predictive_draws",
    "conditions": "ema.compare.scatter",
    "confirmed": "ema.compare.amplitude_prediction",
    "difference": "ema.compare.scatter",
    "force_surface": "ema.compare.force_predictions",
    "forced_resonances": "ema.compare.force_predictions",
    "forced_response": "ema.compare.force_predictions",
    "joint_posterior": "ema.compare.joint_law",
    "maps": "ema.compare.damping_maps",
    "measure": "ema.compare.replay",
    "modes": "ema.compare.pairing",
    "predict_amplitudes": "ema.compare.amplitude_prediction",
    "predict_from_draws": "ema.compare.predictive_draws",
    "predict_map": "ema.compare.map_prediction",
    "repeat_findings": "ema.compare.scatter",
    "repeats": "ema.compare.scatter",
    "releases": "ema.compare.decays",
    "ring_down_modes": "ema.compare.amplitude_resolved",
    "signals": "ema.compare.decays",
    "update": "ema.compare.fitting",
    "variance_components": "ema.compare.components",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
