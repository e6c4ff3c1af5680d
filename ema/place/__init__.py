"""Where a friction beam goes, and how hard to press it."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ema.place.bands import check, forecast
    from ema.place.candidates import grid
    from ema.place.control import control_study
    from ema.place.model import model_at
    from ema.place.objective import Objective, recommended_forces
    from ema.place.predictor import predict
    from ema.place.ranking import rank, search
    from ema.place.recommend import distribute
    from ema.place.shortlist import verify
    from ema.place.task import Task

_NAMES = {
    "Objective": "objective",
    "Task": "task",
    "check": "bands",
    "control_study": "control",
    "distribute": "recommend",
    "forecast": "bands",
    "grid": "candidates",
    "model_at": "model",
    "predict": "predictor",
    "rank": "ranking",
    "recommended_forces": "objective",
    "search": "ranking",
    "verify": "shortlist",
}

__all__ = [
    "Objective",
    "Task",
    "check",
    "control_study",
    "distribute",
    "forecast",
    "grid",
    "model_at",
    "predict",
    "rank",
    "recommended_forces",
    "search",
    "verify",
]


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(f"ema.place.{_NAMES[name]}"), name)
    raise AttributeError(f"module 'ema.place' has no attribute {name!r}")
