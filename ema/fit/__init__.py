"""From FRFs to poles and modes, with their intervals."""

from ema.public import attach

_HOMES = {
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

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
