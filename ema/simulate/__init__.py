"""The friction-beam simulator and the virtual rig."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ema.simulate.inputs import Blow, Fault, RandomShakers, RovingHammer, SweptShaker
    from ema.simulate.virtual import RingCell, VirtualRig

_NAMES = {
    "Blow": "inputs",
    "Fault": "inputs",
    "RandomShakers": "inputs",
    "RovingHammer": "inputs",
    "SweptShaker": "inputs",
    "RingCell": "virtual",
    "VirtualRig": "virtual",
}

__all__ = ["Blow", "Fault", "RandomShakers", "RingCell", "RovingHammer", "SweptShaker", "VirtualRig"]


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(f"ema.simulate.{_NAMES[name]}"), name)
    raise AttributeError(f"module 'ema.simulate' has no attribute {name!r}")
