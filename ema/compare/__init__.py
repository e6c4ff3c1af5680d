"""Measured against simulated, and what it says about the model."""

from importlib import import_module
from typing import Any

_HOME = {
    "confirmed": "ema.compare.amplitude_prediction",
    "maps": "ema.compare.damping_maps",
    "measure": "ema.compare.replay",
    "modes": "ema.compare.pairing",
    "predict_amplitudes": "ema.compare.amplitude_prediction",
    "signals": "ema.compare.decays",
    "update": "ema.compare.fitting",
}
_HOME |= dict.fromkeys(("conditions", "difference", "repeat_findings", "repeats"), "ema.compare.scatter")
_HOME["variance_components"] = "ema.compare.components"

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'ema.compare' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
