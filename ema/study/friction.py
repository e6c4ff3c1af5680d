"""What a study says about friction beside its modes: ring-downs, hysteresis loops, and where a beam goes."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

from ema.data import Campaign, Decay, ForecastCheck, Loop, MapResult, Placement, Recording, Run, RunResult
from ema.errors import InputError
from ema.place.recipe import PlaceRecipe
from ema.progress import Progress
from ema.study.recipe import LoopTable, RingDownTable


def ring_downs(campaign: Campaign, tables: Sequence[RingDownTable]) -> tuple[Decay, ...]:
    """The ring-down of every record of the runs named.

    Raises
    ------
    InputError : no such run, a run without records, or what ``ema.estimate.ring_down`` refuses.
    """
    from ema.estimate import ring_down

    found = []
    for table in tables:
        run = campaign[table.run]
        for name, record in _records(run):
            decay = ring_down(record, table.band, table.channel or None, table.start, table.stop)
            found.append(replace(decay, name=name))
    return tuple(found)


def hysteresis_loops(campaign: Campaign, tables: Sequence[LoopTable]) -> tuple[Loop, ...]:
    """The hysteresis loop of every record of the runs named; the normal force is the run's where the record has none.

    Raises
    ------
    InputError : no such run, a run without records, or what ``ema.estimate.measured_loop`` refuses.
    """
    from ema.estimate import measured_loop

    found = []
    for table in tables:
        run = campaign[table.run]
        for name, record in _records(run):
            loop = measured_loop(record, table.displacement, table.force)
            pressed = loop.normal_force if loop.normal_force == loop.normal_force else run.condition.normal_force
            found.append(replace(loop, name=name, normal_force=pressed))
    return tuple(found)


def _records(run: Run) -> list[tuple[str, Recording]]:
    if not len(run.recordings):
        raise InputError(
            "the run has no time records", where=f"run {run.id}", got="finished FRFs", expected="records of the motion"
        )
    several = len(run.recordings) > 1
    return [(f"{run.id}, record {n}" if several else run.id, record) for n, record in enumerate(run.recordings, 1)]


def placed(
    asked: str | PlaceRecipe,
    source: Path,
    campaign: Campaign,
    runs: Sequence[RunResult],
    folder: Path,
    resume: bool,
    executor: Executor | None,
    progress: Progress,
) -> Placement:
    """Answer a placement recipe, or the one in a file beside ``source``, with the modes of this study's bare run.

    Raises
    ------
    InputError : no bare run or no geometry, a recipe that names a structure of its own, and what ``ema.place`` refuses.
    """
    from ema.place import recipe as recipes
    from ema.place.job import place
    from ema.place.sources import verdict_of

    path = source.parent / asked if isinstance(asked, str) else source
    told = recipes.load(path) if isinstance(asked, str) else asked
    if told.campaign or told.modes:
        raise InputError(
            "the placement recipe names a structure of its own",
            where=str(path),
            got=told.campaign or told.modes,
            expected="neither campaign nor modes",
            advice="the study's own modes are used; or run `ema place` on the recipe",
        )
    bare = [one for one in runs if one.run.id == told.run or (not told.run and not one.run.condition.joints)]
    if not bare:
        raise InputError(
            "the study has no run without the friction beam",
            where=str(path),
            got=", ".join(one.run.id for one in runs) or "no run",
            expected=told.run or "a bare run",
            advice="add the bare run to the study",
        )
    if campaign.geometry is None:
        raise InputError(
            "the campaign has no geometry",
            where=campaign.name,
            advice="add [geometry] to campaign.toml: places come from it",
        )
    modes = replace(bare[0].modes, name=bare[0].modes.name or f"run {bare[0].run.id}")
    found = place(
        told,
        modes,
        campaign.geometry,
        verdict_of(told, path.parent),
        executor=executor,
        folder=folder,
        resume=resume,
        progress=progress,
    )
    return replace(found, geometry=campaign.geometry)


def forecast_check(
    asked: str | PlaceRecipe, placement: Placement | None, maps: Sequence[MapResult]
) -> ForecastCheck | None:
    """The forecast of the placement against the maps that its recipe names; ``None`` where it names none.

    Raises
    ------
    InputError : no such map, and what ``ema.place.check`` refuses.
    """
    from ema.place import check

    told = None if isinstance(asked, str) else asked.forecast
    if told is None or not told.maps or placement is None or placement.forecast is None:
        return None
    known = {one.name: one.chart for one in maps}
    for name in told.maps:
        if name not in known:
            raise InputError(
                "the forecast is to be held against a map that is not there",
                where="placement.forecast",
                got=name,
                expected="one of " + (", ".join(known) or "no map"),
            )
    return check(placement.forecast, [known[name] for name in told.maps])
