"""Experimental modal analysis where joints and friction matter.

Rooms are imported when first used: ``ema.estimate``, ``ema.fit``, ``ema.simulate``, ``ema.show``, ``ema.report`` ...
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_ROOMS = (
    "app",
    "compare",
    "data",
    "estimate",
    "fit",
    "place",
    "report",
    "shapes",
    "show",
    "simulate",
    "store",
    "study",
    "synthesis",
)
_NAMES = {
    "Dof": "ema.dof",
    "EmaError": "ema.errors",
    "FrfSet": "ema.data",
    "ModalModel": "ema.data",
    "PoleTable": "ema.data",
    "Recording": "ema.data",
    "Geometry": "ema.data",
    "Finding": "ema.data",
    "Study": "ema.study",
}

__all__ = ["__version__", *_ROOMS, *_NAMES]


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return import_module(f"ema.{name}")
    if name in _NAMES:
        return getattr(import_module(_NAMES[name]), name)
    raise AttributeError(f"module 'ema' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
