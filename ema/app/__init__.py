"""The browser: pick poles, watch shapes, exclude impacts."""

from ema.lazy import attach

_HOMES = {
    "Workbench": "ema.app.state",
    "serve": "ema.app.server",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
