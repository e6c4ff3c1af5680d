"""One recipe, the whole chain: campaign, FRFs, modes, shapes, findings, report."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ema.study.plain import summary
    from ema.study.study import Study

_HOMES = {"Study": "study", "summary": "plain"}

__all__ = ["Study", "summary"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"ema.study.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'ema.study' has no attribute {name!r}")
