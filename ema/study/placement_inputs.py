"""From what a placement is computed: a recipe, a campaign, a file with modes, a model, or a study that was run."""

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import acquisition
from acquisition import model_file
from ema import store
from ema.data import Geometry, ModalModel, Placement, StudyResult
from ema.errors import InputError
from ema.estimate import without_dead
from ema.place import recipe as recipes
from ema.place.beams_forecast import BeamsForecast, forecast_together
from ema.place.job import about_verdict, refuse_disagreement
from ema.place.location import Location, forecast_at
from ema.place.recipe import PlaceRecipe
from ema.place.sources import bare_of_model, recipe_of_model, verdict_of
from ema.progress import Progress, silent
from ema.store.reading import containers
from ema.study import chain
from ema.study.measured import frfs_of
from ema.study.placement import PlacementTask, placement_task
from ema.study.recipe import FitTable
from ema.study.study import Study


class PlacementSource(NamedTuple):
    """A recipe, the folder that its paths are relative to, and the model or study with the structure, if one has it."""

    recipe: PlaceRecipe
    folder: Path
    model: Path | None = None
    study: Study | None = None

    def task(self, progress: Progress = silent) -> PlacementTask:
        """The recipe with the modes of the structure without the beam, and its points.

        Raises
        ------
        InputError : no structure, no modes or no points are known, or a study has no current result.
        """
        if self.study is not None:
            return _of_study(self.study, progress)
        bare, geometry = (
            bare_of_model(self.model) if self.model is not None else _bare(self.recipe, self.folder, progress)
        )
        return PlacementTask(self.recipe, self.folder, bare, geometry)


def read_placement(source: str | Path, recipe: str | Path | None = None, progress: Progress = silent) -> PlacementTask:
    """Read what a placement is computed from: its recipe, the modes of the structure without the beam, and its points.

    Parameters
    ----------
    source : str or Path
        A placement recipe, a model.toml with a ``[map]``, or the recipe of a study with a ``[placement]`` that was run;
        or, with ``recipe``, a campaign or a file with modes.
    recipe : str or Path, optional
        The placement recipe, where ``source`` is none.
    progress : Progress, optional
        Called as the modes are computed.

    Returns
    -------
    PlacementTask
        Recipe, folder of its files, modes and points.

    Raises
    ------
    InputError
        If there is no such file, nothing is known of joint and beam, or of the structure without the beam.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import plate
    >>> from ema.store import save
    >>> recipe = '''modes = "bare.h5"
    ... near = "84 Hz"
    ... at = "1:+Z"
    ... force = "10 N"
    ... normal_force = "50 N"
    ... beams = [{spacing = "0.2 m", width = "20 mm", height = "10 mm"}]
    ... [joint]
    ... surface_height = "3 mm"
    ... normal_stiffness = "1e8 N/m"
    ... law = {name = "masing", friction_coefficient = 0.4, contact_stiffness = "2e7 N/m"}
    ... '''
    >>> modes, points = plate()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "place.toml").write_text(recipe)
    ...     save(f"{folder}/bare.h5", {"modes": modes, "geometry": points})
    ...     task = read_placement(f"{folder}/place.toml")
    >>> task.modes.natural_frequencies.round(1)
    array([ 83.6,  89.2, 192.6])
    """
    return placement_source(Path(source), None if recipe is None else Path(recipe)).task(progress)


def forecasts_at(
    task: PlacementTask,
    locations: Sequence[Location],
    *,
    force_levels: Sequence[float] = (),
    normal_forces: Sequence[float] = (),
    together: bool = False,
    progress: Progress = silent,
) -> tuple[BeamsForecast, ...]:
    """The forecast of each beam alone, or a single one of all ``together``, with a joint model that may be used.

    Raises
    ------
    InputError : the joint model does not agree with its measurement; and what ``ema.place.forecast_at`` or
        ``ema.place.forecast_together`` refuses.
    """
    verdict = verdict_of(task.recipe, task.folder)
    refuse_disagreement(verdict, task.modes.name or "bare structure")
    asked: dict[str, Any] = {"force_levels": force_levels, "normal_forces": normal_forces, "progress": progress}
    if together:
        results = [forecast_together(task.recipe, task.modes, task.geometry, locations, **asked)]
    else:
        alone = forecast_at(task.recipe, task.modes, task.geometry, locations, **asked)
        results = [
            BeamsForecast(locations=(here,), normal_forces=one.normal_forces[:, None], forecast=one)
            for here, one in zip(locations, alone, strict=True)
        ]
    return tuple(
        replace(one, forecast=replace(one.forecast, findings=(*one.forecast.findings, *about_verdict(verdict))))
        for one in results
    )


def placement_source(source: Path, recipe: Path | None = None) -> PlacementSource:
    """What a placement is computed from, its recipe checked; no measurement is opened yet.

    Raises
    ------
    InputError : there is no such file, or nothing is known about joint and beam.
    """
    if not source.exists():
        raise InputError(
            "there is no such file or folder",
            where=str(source),
            expected="a placement recipe, a campaign, a file with modes, or a model.toml",
        )
    if (source / model_file.FILE_NAME).is_file() or source.name == model_file.FILE_NAME:
        read = recipes.load(recipe) if recipe is not None else recipe_of_model(source)
        return PlacementSource(read, (recipe or source).parent, model_file.locate(source))
    is_campaign = source.is_dir() or source.name == "campaign.toml"
    if not is_campaign and source.suffix.lower() == ".toml":
        study = _study(source)
        return PlacementSource(recipes.load(source), source.parent) if study is None else study
    if recipe is None:
        _refuse_answers(source)
        raise InputError(
            "nothing is known about the joint and the beam",
            where=str(source),
            expected="a joint law with normal forces F_N, a beam, and the range of F_E",
            advice="write them in a recipe (docs/placement.md) and give it with --recipe",
        )
    given = (
        {"campaign": str(source.resolve()), "modes": ""}
        if is_campaign
        else {"modes": str(source.resolve()), "campaign": ""}
    )
    return PlacementSource(recipes.load(recipe).model_copy(update=given), recipe.parent)


def _refuse_answers(source: Path) -> None:
    """Refuse a stored placement: it keeps the answer, not the modes that it was computed from.

    Raises
    ------
    InputError : it is one.
    """
    if source.is_file() and store.is_store(source) and isinstance(store.load(source), Placement):
        raise InputError(
            "the file keeps the answer of a placement, not the modes that it was computed from",
            where=str(source),
            got="a stored placement",
            expected="the recipe that it was computed from",
            advice="give the recipe in place of this file",
        )


def _study(path: Path) -> PlacementSource | None:
    """The placement of a study's recipe; ``None`` where the file is no such recipe."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None  # the placement recipe says what is wrong, and where
    if "placement" not in document:
        return None
    study = Study.load(path)
    placement = study.recipe.placement
    read = recipes.load(path.parent / placement) if isinstance(placement, str) else placement
    return PlacementSource(read, path.parent, study=study)


def _of_study(study: Study, progress: Progress) -> PlacementTask:
    """The placement of a study with the modes of its stored result.

    Raises
    ------
    InputError : the study was not run, or something changed since.
    """
    where = str(study.source)
    advice = f"run `ema run {study.source}` first"
    if not study.result.is_file():
        raise InputError("the study was not run yet", where=where, expected=str(study.result), advice=advice)
    result = store.load(study.result)
    campaign = study.open(progress)
    if not isinstance(result, StudyResult) or not study.is_current(result, campaign, progress):
        raise InputError(
            "the result of the study is not that of its present recipe, data and code",
            where=where,
            got=str(study.result),
            expected="a current result",
            advice=advice,
        )
    return placement_task(study.recipe.placement, study.source, campaign, result.runs)


def _bare(recipe: PlaceRecipe, origin: Path, progress: Progress) -> tuple[ModalModel, Geometry]:
    """Modes of the structure without the beam, and where its points are."""
    if recipe.modes:
        return _of_file(origin / recipe.modes)
    if not recipe.campaign:
        raise InputError(
            "the recipe names no structure",
            expected="campaign, or modes (a file)",
            advice="add one, or give a campaign as SOURCE and the recipe with --recipe",
        )
    study = Study.load(origin / recipe.campaign)
    campaign = study.open(progress)
    runs = [run for run in campaign.runs if not run.condition.joints]
    if recipe.run:
        run = campaign[recipe.run]
    elif runs:
        run = runs[0]
    else:
        raise InputError(
            "the campaign has no run without the friction beam",
            where=campaign.name,
            got=", ".join(run.id for run in campaign.runs),
            expected="a bare run",
            advice="measure the structure without the beam",
        )
    if run.condition.joints:
        raise InputError(
            "this run was measured with a friction beam",
            where=f"run {run.id}",
            got=", ".join(joint.joint for joint in run.condition.joints),
            expected="the structure without the beam",
            advice="name the bare run",
        )
    if campaign.geometry is None:
        raise InputError(
            "the campaign has no geometry",
            where=campaign.name,
            advice="add [geometry] to campaign.toml: places come from it",
        )
    frfs, hits = frfs_of(run, study.recipe.estimate, progress)
    band = (recipe.band[0], recipe.band[1]) if recipe.band else chain.default_band(frfs, hits)
    return chain.fitted(without_dead(frfs.band(*band)), FitTable(), progress)[1], campaign.geometry


def _of_file(path: Path) -> tuple[ModalModel, Geometry]:
    """Modes and geometry of a file in our own or a foreign format."""
    if not path.exists():
        raise InputError(
            "there is no such file with modes",
            where=str(path),
            advice="correct `modes` in the recipe; its paths start from the folder of the recipe",
        )
    if path.suffix.lower() == ".h5" and store.is_store(path):
        items = containers(path)
    else:
        contents = acquisition.read(path)
        items = [*contents.modes, *([contents.geometry] if contents.geometry is not None else [])]
    models = [item for item in items if isinstance(item, ModalModel)]
    shapes = [item for item in items if isinstance(item, Geometry)]
    if not models or not shapes:
        raise InputError(
            "the file lacks modes or geometry",
            where=str(path),
            got=", ".join(type(item).__name__ for item in items) or "nothing",
            expected="one modal model and its geometry",
        )
    return models[0], shapes[0]
