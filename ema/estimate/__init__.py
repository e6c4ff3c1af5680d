"""Recording -> FrfSet."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ema.estimate.calibrate import Calibration, known_mass
    from ema.estimate.decay import Phase, phases, ring_down
    from ema.estimate.frf_checks import quality, without_dead
    from ema.estimate.impact import hammer, hammer_test
    from ema.estimate.integrate import integrated, to_quantity
    from ema.estimate.levels import level_bins
    from ema.estimate.live import check_hit
    from ema.estimate.nonlinearity import Homogeneity, causality, homogeneity
    from ema.estimate.random_excitation import shaker
    from ema.estimate.shaker_force import ForceLevel, control_level, force_at_resonance, without_mount_mass
    from ema.estimate.swept_sine import sweep

_NAMES = {
    "Calibration": "calibrate",
    "ForceLevel": "shaker_force",
    "Homogeneity": "nonlinearity",
    "Phase": "decay",
    "causality": "nonlinearity",
    "check_hit": "live",
    "control_level": "shaker_force",
    "force_at_resonance": "shaker_force",
    "hammer": "impact",
    "hammer_test": "impact",
    "homogeneity": "nonlinearity",
    "integrated": "integrate",
    "known_mass": "calibrate",
    "level_bins": "levels",
    "phases": "decay",
    "quality": "frf_checks",
    "ring_down": "decay",
    "shaker": "random_excitation",
    "sweep": "swept_sine",
    "to_quantity": "integrate",
    "without_dead": "frf_checks",
    "without_mount_mass": "shaker_force",
}

__all__ = [
    "Calibration", "ForceLevel", "Homogeneity", "Phase", "causality", "check_hit", "control_level",
    "force_at_resonance", "hammer", "hammer_test", "homogeneity", "integrated", "known_mass", "level_bins", "phases",
    "quality", "ring_down", "shaker", "sweep", "to_quantity", "without_dead", "without_mount_mass",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(f"ema.estimate.{_NAMES[name]}"), name)
    raise AttributeError(f"module 'ema.estimate' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
