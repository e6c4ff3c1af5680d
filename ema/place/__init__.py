"""Where a friction beam goes, and how hard to press it."""

from ema.public import attach

_HOMES = {
    "BeamsForecast": "ema.place.beams_forecast",
    "BeamsSearch": "ema.place.beams_choice",
    "Costs": "ema.place.trials",
    "ForecastSettings": "ema.place.bands",
    "KeptPlaces": "ema.place.shortlist",
    "Location": "ema.place.location",
    "Objective": "ema.place.objective",
    "TrialCondition": "ema.place.trials",
    "SearchSettings": "ema.place.ranking",
    "Task": "ema.place.task",
    "check": "ema.place.forecast_check",
    "control_study": "ema.place.control",
    "distribute": "ema.place.recommend",
    "forecast": "ema.place.bands",
    "forecast_at": "ema.place.location",
    "forecast_together": "ema.place.beams_forecast",
    "grid": "ema.place.candidates",
    "model_at": "ema.place.model",
    "next_tests": "ema.place.trials",
    "predict": "ema.place.predictor",
    "rank": "ema.place.ranking",
    "recommended_forces": "ema.place.objective",
    "search": "ema.place.ranking",
    "search_together": "ema.place.beams_search",
    "updated": "ema.place.conditioning",
    "verify": "ema.place.shortlist",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES, {"forecast": "settings", "search": "settings"})
