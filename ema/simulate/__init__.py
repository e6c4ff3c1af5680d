"""The friction-beam simulator and the virtual rig."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ema.elements import beam, double_beam, plate_matrices
    from ema.simulate.contact import ContactCurve, PowerContact, Unilateral, own_contact, preload
    from ema.simulate.control import controlled_snapback
    from ema.simulate.events import snapback_reference
    from ema.simulate.friction import (
        BoucWen,
        Coulomb,
        Dahl,
        Iwan,
        LuGre,
        Masing,
        ModifiedIwan,
        ParallelMasing,
        RegularisedMasing,
        Valanis,
        register_law,
    )
    from ema.simulate.friction_rig import FrictionRig
    from ema.simulate.harmonic import frf
    from ema.simulate.hysteresis import measured_loop
    from ema.simulate.identification import identify
    from ema.simulate.inputs import (
        Blow,
        Fault,
        RandomShakers,
        RecordedForces,
        RovingHammer,
        Shaker,
        SnapBack,
        SteppedSine,
        SweptShaker,
    )
    from ema.simulate.loops import loop
    from ema.simulate.maps import damping_map, resonance, resonances
    from ema.simulate.nonlinear_modes import backbone
    from ema.simulate.rig import RingCell
    from ema.simulate.structure import assemble
    from ema.simulate.transient import respond, snapback
    from ema.simulate.virtual import VirtualRig
    from ema.simulate.waveforms import hammer_pulse, stepped_sine, swept_sine

_NAMES = {
    "Blow": "inputs",
    "ContactCurve": "contact",
    "BoucWen": "friction",
    "Coulomb": "friction",
    "Dahl": "friction",
    "Fault": "inputs",
    "FrictionRig": "friction_rig",
    "Iwan": "friction",
    "LuGre": "friction",
    "Masing": "friction",
    "ModifiedIwan": "friction",
    "ParallelMasing": "friction",
    "PowerContact": "contact",
    "RandomShakers": "inputs",
    "RecordedForces": "inputs",
    "RegularisedMasing": "friction",
    "RingCell": "rig",
    "RovingHammer": "inputs",
    "Shaker": "inputs",
    "SnapBack": "inputs",
    "SteppedSine": "inputs",
    "SweptShaker": "inputs",
    "Unilateral": "contact",
    "Valanis": "friction",
    "VirtualRig": "virtual",
    "assemble": "structure",
    "backbone": "nonlinear_modes",
    "beam": "ema.elements",
    "controlled_snapback": "control",
    "damping_map": "maps",
    "double_beam": "ema.elements",
    "frf": "harmonic",
    "hammer_pulse": "waveforms",
    "identify": "identification",
    "loop": "loops",
    "measured_loop": "hysteresis",
    "own_contact": "contact",
    "plate_matrices": "ema.elements",
    "preload": "contact",
    "register_law": "friction",
    "resonance": "maps",
    "resonances": "maps",
    "respond": "transient",
    "snapback": "transient",
    "snapback_reference": "events",
    "stepped_sine": "waveforms",
    "swept_sine": "waveforms",
}

__all__ = [
    "Blow",
    "BoucWen",
    "ContactCurve",
    "Coulomb",
    "Dahl",
    "Fault",
    "FrictionRig",
    "Iwan",
    "LuGre",
    "Masing",
    "ModifiedIwan",
    "ParallelMasing",
    "PowerContact",
    "RandomShakers",
    "RecordedForces",
    "RegularisedMasing",
    "RingCell",
    "RovingHammer",
    "Shaker",
    "SnapBack",
    "SteppedSine",
    "SweptShaker",
    "Unilateral",
    "Valanis",
    "VirtualRig",
    "assemble",
    "backbone",
    "beam",
    "controlled_snapback",
    "damping_map",
    "double_beam",
    "frf",
    "hammer_pulse",
    "identify",
    "loop",
    "measured_loop",
    "own_contact",
    "plate_matrices",
    "preload",
    "register_law",
    "resonance",
    "resonances",
    "respond",
    "snapback",
    "snapback_reference",
    "stepped_sine",
    "swept_sine",
]


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        home = _NAMES[name]
        return getattr(import_module(home if "." in home else f"ema.simulate.{home}"), name)
    raise AttributeError(f"module 'ema.simulate' has no attribute {name!r}")
