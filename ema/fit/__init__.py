"""FrfSet -> PoleTable -> ModalModel."""

from importlib import import_module
from typing import Any

_HOME = {
    "circle_fit": "ema.fit.nyquist",
    "cmif": "ema.fit.indicators",
    "era": "ema.fit.eigensystem",
    "local_fit": "ema.fit.single",
    "mode_indicator": "ema.fit.indicators",
    "modes": "ema.fit.modal",
    "multivariate_mode_indicator": "ema.fit.indicators",
    "peak_picking": "ema.fit.peaks",
    "reconstruction_error": "ema.fit.modal",
    "second_opinion": "ema.fit.opinion",
    "stabilise": "ema.fit.stabilisation",
    "track": "ema.fit.tracking",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'ema.fit' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
