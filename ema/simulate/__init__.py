"""The friction-beam simulator and the virtual rig."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ema.simulate.elements import beam
    from ema.simulate.friction import (
        Coulomb,
        Dahl,
        Iwan,
        LuGre,
        Masing,
        ParallelMasing,
        RegularisedMasing,
        register_law,
    )
    from ema.simulate.inputs import Blow, Fault, RandomShakers, RovingHammer, SweptShaker
    from ema.simulate.loops import loop
    from ema.simulate.structure import assemble, double_beam
    from ema.simulate.transient import respond, snapback
    from ema.simulate.virtual import RingCell, VirtualRig

_NAMES = {
    "Blow": "inputs",
    "Coulomb": "friction",
    "Dahl": "friction",
    "Fault": "inputs",
    "Iwan": "friction",
    "LuGre": "friction",
    "Masing": "friction",
    "ParallelMasing": "friction",
    "RandomShakers": "inputs",
    "RegularisedMasing": "friction",
    "RingCell": "virtual",
    "RovingHammer": "inputs",
    "SweptShaker": "inputs",
    "VirtualRig": "virtual",
    "assemble": "structure",
    "beam": "elements",
    "double_beam": "structure",
    "loop": "loops",
    "register_law": "friction",
    "respond": "transient",
    "snapback": "transient",
}

__all__ = [
    "Blow", "Coulomb", "Dahl", "Fault", "Iwan", "LuGre", "Masing", "ParallelMasing", "RandomShakers",
    "RegularisedMasing", "RingCell", "RovingHammer", "SweptShaker", "VirtualRig", "assemble", "beam",
    "double_beam", "loop", "register_law", "respond", "snapback",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(f"ema.simulate.{_NAMES[name]}"), name)
    raise AttributeError(f"module 'ema.simulate' has no attribute {name!r}")
