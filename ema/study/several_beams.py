"""The several beams that a placement recipe asks for: chosen, and forecast together."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ema.data import Placement
from ema.place.beams_forecast import BeamsForecast, forecast_together
from ema.place.beams_recipe import BeamsRecipe
from ema.place.beams_search import BeamsSearch, about_beams, search_together
from ema.place.job import target_task
from ema.progress import Progress, silent
from ema.study.friction import PlacementTask
from ema.study.plain_forecast import mapping_together


class SeveralBeams(NamedTuple):
    """Beams that act together, and their forecast where the recipe asks for one."""

    choice: BeamsSearch
    forecast: BeamsForecast | None

    def plain(self, task: PlacementTask) -> dict[str, Any]:
        """As what JSON can hold: SI and fractions."""
        choice, forecast = self.choice, self.forecast
        return {
            "searched": "one after the other, then exchanged",
            "rounds": choice.rounds,
            "cases": choice.cases,
            "objective": choice.objective,
            "value": float(choice.values[-1]),
            "value_of_the_best_alone": choice.alone,
            "beams": [
                {"beam": one.beam, "centre": list(one.centre), "angle": one.angle, "normal_force": float(force)}
                for one, force in zip(choice.locations, choice.normal_forces, strict=True)
            ],
            "forecast": None if forecast is None else mapping_together(forecast, task.modes),
        }


def several_beams(
    task: PlacementTask, placement: Placement, progress: Progress = silent
) -> tuple[Placement, SeveralBeams | None]:
    """Choose as many beams as the recipe asks for, from the candidates of a placement; none where it asks for one.

    The placement gets the choice as a finding, with the findings of the forecast: that of ``forecast_together`` under
    the normal forces that were chosen.

    Raises
    ------
    InputError : no set of beams fits; and what ``ema.place.search_together`` refuses.
    """
    recipe = task.recipe
    if not isinstance(recipe, BeamsRecipe) or recipe.search.beams == 1:
        return placement, None
    target, _ = target_task(recipe, task.modes, task.geometry, task.modes.name or "bare structure")
    choice = search_together(
        target,
        placement.ranking.prediction.candidates,
        placement.ranking.places,
        beams=recipe.search.beams,
        objective=recipe.wanted(),
        most_mass=np.inf if recipe.search.most_mass is None else recipe.search.most_mass,
        progress=progress,
    )
    forecast = None
    if recipe.forecast is not None:
        forecast = forecast_together(
            recipe,
            task.modes,
            task.geometry,
            choice.locations,
            normal_forces=choice.normal_forces.tolist(),
            progress=progress,
        )
    known = placement.all_findings
    own = [] if forecast is None else [one for one in forecast.forecast.findings if one not in known]
    named = (replace(one, where=f"{recipe.search.beams} beams, {one.where}") for one in own)
    found = replace(placement, findings=(*placement.findings, about_beams(choice), *named))
    return found, SeveralBeams(choice, forecast)
