"""Recording -> FrfSet."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ema.estimate.amplitude_mode import amplitude_dependent_mode
    from ema.estimate.calibrate import Calibration, known_mass
    from ema.estimate.cycles import measured_loop
    from ema.estimate.decay import Phase, phases, ring_down
    from ema.estimate.frf_checks import quality, without_dead
    from ema.estimate.impact import hammer, hammer_test
    from ema.estimate.integrate import integrated, to_quantity
    from ema.estimate.levels import level_bins
    from ema.estimate.live import check_hit, check_impact
    from ema.estimate.nonlinearity import Homogeneity, causality, homogeneity
    from ema.estimate.random_excitation import shaker
    from ema.estimate.shaker_force import (
        ForceLevel,
        PhaseResonance,
        control_level,
        force_at_resonance,
        phase_resonance,
        sweep_rate,
        without_mount_mass,
    )
    from ema.estimate.stepped_sine import Steps, stepped, stepped_test
    from ema.estimate.swept_sine import sweep

_NAMES = {
    "Calibration": "calibrate",
    "ForceLevel": "shaker_force",
    "Homogeneity": "nonlinearity",
    "Phase": "decay",
    "PhaseResonance": "shaker_force",
    "Steps": "stepped_sine",
    "amplitude_dependent_mode": "amplitude_mode",
    "causality": "nonlinearity",
    "check_hit": "live",
    "check_impact": "live",
    "control_level": "shaker_force",
    "force_at_resonance": "shaker_force",
    "hammer": "impact",
    "hammer_test": "impact",
    "homogeneity": "nonlinearity",
    "integrated": "integrate",
    "known_mass": "calibrate",
    "level_bins": "levels",
    "measured_loop": "cycles",
    "phase_resonance": "shaker_force",
    "phases": "decay",
    "quality": "frf_checks",
    "ring_down": "decay",
    "shaker": "random_excitation",
    "stepped": "stepped_sine",
    "stepped_test": "stepped_sine",
    "sweep": "swept_sine",
    "sweep_rate": "shaker_force",
    "to_quantity": "integrate",
    "without_dead": "frf_checks",
    "without_mount_mass": "shaker_force",
}

__all__ = [
    "Calibration",
    "ForceLevel",
    "Homogeneity",
    "Phase",
    "PhaseResonance",
    "Steps",
    "amplitude_dependent_mode",
    "causality",
    "check_hit",
    "check_impact",
    "control_level",
    "force_at_resonance",
    "hammer",
    "hammer_test",
    "homogeneity",
    "integrated",
    "known_mass",
    "level_bins",
    "measured_loop",
    "phase_resonance",
    "phases",
    "quality",
    "ring_down",
    "shaker",
    "stepped",
    "stepped_test",
    "sweep",
    "sweep_rate",
    "to_quantity",
    "without_dead",
    "without_mount_mass",
]


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(f"ema.estimate.{_NAMES[name]}"), name)
    raise AttributeError(f"module 'ema.estimate' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
