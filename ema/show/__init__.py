"""Pictures of every data type; figures are returned, never shown or saved."""

from ema.lazy import attach

_HOMES = {
    "amplitude_modes": "ema.show.amplitude",
    "coherence": "ema.show.frf",
    "complexity": "ema.show.polar",
    "contact_loops": "ema.show.simulated",
    "control_gain": "ema.show.placement",
    "damping_curves": "ema.show.maps",
    "damping_map": "ema.show.maps",
    "error_map": "ema.show.matrices",
    "force_spectrum": "ema.show.impacts",
    "forecast_bands": "ema.show.forecast",
    "free_vibration": "ema.show.vibration",
    "frequency_map": "ema.show.maps",
    "frf_overlay": "ema.show.overlaid",
    "frf_overview": "ema.show.frf",
    "geometry": "ema.show.points",
    "hits": "ema.show.impacts",
    "hysteresis": "ema.show.simulated",
    "indicator": "ema.show.frf",
    "mac_matrix": "ema.show.matrices",
    "map_comparison": "ema.show.compared",
    "map_prediction": "ema.show.compared",
    "mode_shapes": "ema.show.shapes",
    "motion": "ema.show.simulated",
    "normal_force": "ema.show.joints",
    "placement_map": "ema.show.placement",
    "recommended_force": "ema.show.placement",
    "reconstruction": "ema.show.frf",
    "rendered_shape": "ema.show.renderer",
    "renderer_works": "ema.show.renderer",
    "ring_down": "ema.show.simulated",
    "shapes_over_dofs": "ema.show.shapes",
    "stabilisation": "ema.show.stability",
    "steady_states": "ema.show.simulated",
    "tool_point": "ema.show.simulated",
    "velocity_comparison": "ema.show.vibration",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
