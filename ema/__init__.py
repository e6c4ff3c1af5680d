"""Experimental modal analysis where joints and friction matter.

Packages are imported when first used: ``ema.estimate``, ``ema.fit``, ``ema.simulate``, ``ema.show``, ``ema.report`` ...
"""

from ema.lazy import attach

__version__ = "0.1.0"

_ROOMS = (
    "app",
    "compare",
    "data",
    "datasets",
    "estimate",
    "fit",
    "place",
    "proposal",
    "report",
    "shapes",
    "show",
    "simulate",
    "store",
    "study",
    "synthesis",
)
_HOMES = {room: f"ema.{room}" for room in _ROOMS} | {
    "Dof": "ema.dof",
    "EmaError": "ema.errors",
    "Finding": "ema.data",
    "FrfSet": "ema.data",
    "Geometry": "ema.data",
    "ModalModel": "ema.data",
    "PoleTable": "ema.data",
    "Recording": "ema.data",
    "Study": "ema.study",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
__all__ += ["__version__"]
