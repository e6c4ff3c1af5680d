"""Recording -> FrfSet."""

from importlib import import_module
from typing import Any

_NAMES = {
    "hammer": "ema.estimate.impact",
    "hammer_test": "ema.estimate.impact",
    "shaker": "ema.estimate.random_excitation",
}

__all__ = list(_NAMES)


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(_NAMES[name]), name)
    raise AttributeError(f"module 'ema.estimate' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
