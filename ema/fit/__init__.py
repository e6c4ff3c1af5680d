"""FrfSet -> PoleTable -> ModalModel."""

from importlib import import_module
from typing import Any

_HOME = {
    "circle_fit": "ema.fit.nyquist",
    "cmif": "ema.fit.cmif",
    "era": "ema.fit.eigensystem",
    "local_fit": "ema.fit.single",
    "mode_indicator": "ema.fit.cmif",
    "modes": "ema.fit.modes",
    "multivariate_mode_indicator": "ema.fit.cmif",
    "peak_picking": "ema.fit.peaks",
    "reconstruction_error": "ema.fit.modes",
    "second_opinion": "ema.fit.opinion",
    "stabilise": "ema.fit.stabilise",
    "track": "ema.fit.track",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'ema.fit' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    # The verb shares its name with its module, which the import has just put here.
    globals()[name] = value
    return value
