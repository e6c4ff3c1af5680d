"""Recording -> FrfSet."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ema.estimate.impact import hammer, hammer_test
    from ema.estimate.levels import level_bins
    from ema.estimate.random_excitation import shaker

_NAMES = {
    "hammer": "impact",
    "hammer_test": "impact",
    "level_bins": "levels",
    "shaker": "random_excitation",
}

__all__ = ["hammer", "hammer_test", "level_bins", "shaker"]


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(f"ema.estimate.{_NAMES[name]}"), name)
    raise AttributeError(f"module 'ema.estimate' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
