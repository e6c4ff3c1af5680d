"""Where a beam goes, or several: the placement that a recipe or a study asks for, kept as it was computed."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ema import fingerprint, store
from ema.data import (
    Campaign,
    Forecast,
    ForecastCheck,
    Geometry,
    MapResult,
    ModalModel,
    Placement,
    Provenance,
    RunResult,
)
from ema.errors import InputError
from ema.place.recipe import PlaceRecipe
from ema.progress import Progress
from ema.study import kept

if TYPE_CHECKING:
    from ema.place.beams_forecast import BeamsForecast


class PlacementTask(NamedTuple):
    """What a placement is computed from: its recipe, the folder of its files, the bare modes and the points."""

    recipe: PlaceRecipe
    folder: Path
    modes: ModalModel
    geometry: Geometry


def placement_task(
    request: str | PlaceRecipe, source: Path, campaign: Campaign, runs: Sequence[RunResult]
) -> PlacementTask:
    """A placement recipe, or the one in a file beside ``source``, with the modes of this study's bare run.

    Raises
    ------
    InputError : no bare run or no geometry, or a recipe that names a structure of its own.
    """
    from ema.place.recipe import load

    path = source.parent / request if isinstance(request, str) else source
    recipe = load(path) if isinstance(request, str) else request
    if recipe.campaign or recipe.modes:
        raise InputError(
            "the placement recipe names a structure of its own",
            where=str(path),
            got=recipe.campaign or recipe.modes,
            expected="neither campaign nor modes",
            advice="the study's own modes are used; or run `ema place` on the recipe",
        )
    bare = [one for one in runs if one.run.id == recipe.run or (not recipe.run and not one.run.condition.joints)]
    if not bare:
        raise InputError(
            "the study has no run without the friction beam",
            where=str(path),
            got=", ".join(one.run.id for one in runs) or "no run",
            expected=recipe.run or "a bare run",
            advice="add the bare run to the study",
        )
    if campaign.geometry is None:
        raise InputError(
            "the campaign has no geometry",
            where=campaign.name,
            advice="add [geometry] to campaign.toml: places come from it",
        )
    modes = replace(bare[0].modes, name=bare[0].modes.name or f"run {bare[0].run.id}")
    return PlacementTask(recipe, path.parent, modes, campaign.geometry)


class Placed(NamedTuple):
    """A placement, and what its several beams do together: ``None`` where no such forecast was asked for."""

    placement: Placement
    together: "BeamsForecast | None"


def placed(
    task: PlacementTask,
    folder: Path,
    resume: bool,
    executor: Executor | None,
    progress: Progress,
    *,
    anyway: bool = False,
) -> Placed:
    """Answer a placement; finished places, the whole, and the forecast of several beams are kept in ``folder``.

    With ``anyway`` a joint model that does not agree with its measurement is placed with, and warned of.

    Raises
    ------
    InputError : what ``ema.place`` refuses.
    """
    from ema.place.job import place, refuse_disagreement
    from ema.place.shortlist import KeptPlaces, fingerprint_of
    from ema.place.sources import verdict_of

    verdict = verdict_of(task.recipe, task.folder)
    if not anyway:
        refuse_disagreement(verdict, task.modes.name or "bare structure")

    def compute() -> Placement:
        answer = place(
            task.recipe,
            task.modes,
            task.geometry,
            verdict,
            executor=executor,
            kept=KeptPlaces(folder, resume),
            progress=progress,
        )
        return replace(answer, geometry=task.geometry)

    parts = {
        "the recipe": task.recipe.model_dump_json(),
        "the modes without the beam": task.modes,
        "the geometry": task.geometry,
        "the verdict on the joint model": verdict,
    }
    inputs = tuple((name, fingerprint_of(part)) for name, part in parts.items())
    made = Provenance(inputs, fingerprint.versions())
    answer: Placement = kept.known_or_computed(
        folder / "placement.h5", made, "placement", compute, progress, resume=resume
    )
    together = _together(task, answer, folder / "together.h5", made, progress, resume=resume)
    return Placed(answer, None) if together is None else Placed(_with_forecast(answer, together), together)


def _together(
    task: PlacementTask, answer: Placement, path: Path, made: Provenance, progress: Progress, *, resume: bool
) -> "BeamsForecast | None":
    """What the beams of a placement do together under their normal forces, kept in ``path``."""
    from ema.place.beams_choice import chosen_beams
    from ema.place.beams_forecast import BeamsForecast, forecast_together

    choice = chosen_beams(answer)
    if choice is None or task.recipe.forecast is None:
        return None

    def compute() -> Forecast:
        return forecast_together(
            task.recipe,
            task.modes,
            task.geometry,
            choice.locations,
            normal_forces=choice.normal_forces,
            progress=progress,
        ).forecast

    what = "forecast of several beams"
    forecast = kept.known_or_computed(path, made, what, compute, progress, resume=resume)
    return BeamsForecast(locations=choice.locations, normal_forces=choice.normal_forces[None], forecast=forecast)


def _with_forecast(answer: Placement, together: "BeamsForecast") -> Placement:
    """The placement with the values of the forecast as findings, and the findings that it does not have itself."""
    from ema.place.beams_forecast import about_forecast

    known, count = answer.all_findings, len(together.locations)
    own = [one for one in together.forecast.findings if one not in known]
    named = (replace(one, where=f"{count} beams, {one.where}") for one in own)
    return replace(answer, findings=(*answer.findings, *about_forecast(together), *named))


def save_together(path: Path, modes: ModalModel, together: "BeamsForecast") -> None:
    """Write what several beams do together as `ema predict --together` does, with the modes without them."""
    store.save(path, {"bare": modes, "forecast_together": together.forecast})


def forecast_check(
    request: str | PlaceRecipe, placement: Placement | None, maps: Sequence[MapResult]
) -> ForecastCheck | None:
    """The forecast of the placement against the maps that its recipe names; ``None`` where it names none.

    Raises
    ------
    InputError : no such map, and what ``ema.place.check`` refuses.
    """
    from ema.place import check

    table = None if isinstance(request, str) else request.forecast
    if table is None or not table.maps or placement is None or placement.forecast is None:
        return None
    known = {one.name: one.chart for one in maps}
    for name in table.maps:
        if name not in known:
            raise InputError(
                "the forecast is to be compared with a map that does not exist",
                where="placement.forecast",
                got=name,
                expected="one of " + (", ".join(known) or "no map"),
            )
    return check(placement.forecast, [known[name] for name in table.maps])
