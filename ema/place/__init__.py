"""Where a friction beam goes, and how hard to press it."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ema.place.candidates import grid
    from ema.place.model import model_at
    from ema.place.objective import Objective
    from ema.place.predictor import predict
    from ema.place.search import Task, rank

_NAMES = {
    "Objective": "objective",
    "Task": "search",
    "grid": "candidates",
    "model_at": "model",
    "predict": "predictor",
    "rank": "search",
}

__all__ = ["Objective", "Task", "grid", "model_at", "predict", "rank"]


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(f"ema.place.{_NAMES[name]}"), name)
    raise AttributeError(f"module 'ema.place' has no attribute {name!r}")
