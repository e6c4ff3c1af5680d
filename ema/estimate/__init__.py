"""From recordings to frequency response functions."""

from ema.public import attach

_HOMES = {
    "Calibration": "ema.estimate.calibrate",
    "ForceLevel": "ema.estimate.shaker_force",
    "Homogeneity": "ema.estimate.nonlinearity",
    "Phase": "ema.estimate.decay",
    "PhaseResonance": "ema.estimate.shaker_force",
    "Steps": "ema.estimate.stepped_sine",
    "amplitude_dependent_mode": "ema.estimate.amplitude_mode",
    "causality": "ema.estimate.nonlinearity",
    "check_hit": "ema.estimate.live",
    "check_impact": "ema.estimate.live",
    "control_level": "ema.estimate.shaker_force",
    "force_at_resonance": "ema.estimate.shaker_force",
    "HammerSettings": "ema.estimate.impact",
    "h1_h2_bounds": "ema.estimate.force_or_response",
    "hammer": "ema.estimate.impact",
    "hammer_test": "ema.estimate.impact",
    "homogeneity": "ema.estimate.nonlinearity",
    "integrated": "ema.estimate.integrate",
    "known_mass": "ema.estimate.calibrate",
    "level_bins": "ema.estimate.levels",
    "measured_loop": "ema.estimate.cycles",
    "NonlinearDistortion": "ema.estimate.detection_lines",
    "nonlinear_distortion": "ema.estimate.detection_lines",
    "phase_resonance": "ema.estimate.shaker_force",
    "phases": "ema.estimate.decay",
    "quality": "ema.estimate.frf_checks",
    "ring_down": "ema.estimate.decay",
    "shaker": "ema.estimate.random_excitation",
    "stepped": "ema.estimate.stepped_sine",
    "stepped_test": "ema.estimate.stepped_sine",
    "sweep": "ema.estimate.swept_sine",
    "sweep_rate": "ema.estimate.shaker_force",
    "to_quantity": "ema.estimate.integrate",
    "without_dead": "ema.estimate.frf_checks",
    "without_mount_mass": "ema.estimate.shaker_force",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES, {"hammer": "settings", "hammer_test": "settings"})
