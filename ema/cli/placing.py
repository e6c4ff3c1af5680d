"""`ema place`: a recipe on a campaign, modes or a model -> places, pictures, a report."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.cli.cluster import workers
from ema.cli.common import Json, Limit, records, save_pictures, split_formats, status
from ema.cli.ending import ends_well
from ema.cli.option_groups import Reporting, Work, grouped
from ema.errors import InputError
from ema.messages import checked_language

if TYPE_CHECKING:
    from ema.data import Geometry, ModalModel
    from ema.data.placement import Placement
    from ema.place.recipe import PlaceRecipe
    from ema.progress import Progress


IN_THIS_PROCESS, IN_ENGLISH = Work(jobs=1), Reporting()
"""Defaults: one process, nothing taken over; a report as a page in English."""


@ends_well
@grouped
def place(
    source: Annotated[
        Path,
        typer.Argument(
            help="A placement recipe; or a campaign, a file with modes, or a model.toml.", show_default=False
        ),
    ],
    recipe: Annotated[Path | None, typer.Option("--recipe", help="The recipe, where SOURCE is none.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for what is written.")] = None,
    work: Work = IN_THIS_PROCESS,
    anyway: Annotated[bool, typer.Option("--anyway", help="Place although the joint model does not agree.")] = False,
    report: Reporting = IN_ENGLISH,
    limit: Limit = "error",
    json: Json = False,
) -> int:
    """Where a friction beam goes, and how hard to press it."""
    from ema.cli import screen
    from ema.place.sources import bare_of_model
    from ema.study.friction import PlacementTask, placed
    from ema.study.study import make_folder

    wanted, spoken = split_formats(report.formats), checked_language(report.language)
    read, origin, model = _read(source, recipe)
    folder = output or (recipe or source).parent / "_build" / f"{_stem(recipe or source)}_placement"
    make_folder(folder)
    with screen.Bars() as bars:
        bare, geometry = bare_of_model(model) if model is not None else _bare(read, origin, bars)
        task = PlacementTask(read, origin, bare, geometry)
        with workers(work.cluster, work.jobs or 1) as executor:
            placement = placed(task, folder / "checked", work.resume, executor, bars, anyway=anyway)
    written = _write(placement, folder, wanted, spoken)
    if json:
        screen.as_json(_as_mapping(placement, written))
    else:
        _show(placement, written)
    return status(placement.all_findings, limit)


def _stem(path: Path) -> str:
    return path.resolve().name if path.is_dir() else path.stem


def _read(source: Path, recipe: Path | None) -> "tuple[PlaceRecipe, Path, Path | None]":
    """The recipe, the folder its paths are relative to, and the model file where there is one."""
    from acquisition import model_file
    from ema.place import recipe as recipes
    from ema.place.sources import recipe_of_model

    if not source.exists():
        raise InputError(
            "there is no such file or folder",
            where=str(source),
            expected="a placement recipe, a campaign, a file with modes, or a model.toml",
        )
    if (source / model_file.FILE_NAME).is_file() or source.name == model_file.FILE_NAME:
        read = recipes.load(recipe) if recipe is not None else recipe_of_model(source)
        return read, (recipe or source).parent, model_file.locate(source)
    is_campaign = source.is_dir() or source.name == "campaign.toml"
    if not is_campaign and source.suffix.lower() == ".toml":
        return recipes.load(source), source.parent, None
    if recipe is None:
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
    return recipes.load(recipe).model_copy(update=given), recipe.parent, None


def _bare(recipe: "PlaceRecipe", origin: Path, progress: "Progress") -> "tuple[ModalModel, Geometry]":
    """Modes of the structure without the beam, and where its points are."""
    if recipe.modes:
        return _of_file(origin / recipe.modes)
    if not recipe.campaign:
        raise InputError(
            "the recipe names no structure",
            expected="campaign, or modes (a file)",
            advice="add one, or give a campaign as SOURCE and the recipe with --recipe",
        )
    from ema.estimate import without_dead
    from ema.study import Study, chain
    from ema.study.measured import frfs_of
    from ema.study.recipe import FitTable

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


def _of_file(path: Path) -> "tuple[ModalModel, Geometry]":
    """Modes and geometry of a file in our own or a foreign format."""
    from ema import store
    from ema.data import Geometry, ModalModel
    from ema.store.reading import containers

    if not path.exists():
        raise InputError(
            "there is no such file with modes",
            where=str(path),
            advice="correct `modes` in the recipe; its paths start from the folder of the recipe",
        )
    if path.suffix.lower() == ".h5" and store.is_store(path):
        items = containers(path)
    else:
        import acquisition

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


def _write(found: "Placement", folder: Path, formats: Sequence[str], language: str) -> list[Path]:
    """Store, pictures and report."""
    from ema import report, show, store

    written = [folder / "placement.h5"]
    store.save(written[0], found)
    pictures = {"placement_map": show.placement_map(found), "recommended_force": show.recommended_force(found)}
    if found.control is not None:
        pictures["control"] = show.control_gain(found.control)
    written += save_pictures(folder, pictures)
    report.write(found, folder / "placement.html", formats, language)
    return [*written, *(folder / f"placement.{name}" for name in formats)]


def _as_mapping(found: "Placement", written: list[Path]) -> dict[str, Any]:
    from ema.report.placement import answer
    from ema.report.trials import proposal
    from ema.study.plain import finding

    return {
        "warning": found.warning,
        "answer": answer(found),
        "candidates": len(found.ranking.scores),
        "checked": len(found.ranking.shortlist),
        "places": records(found.ranking.table().reset_index()),
        "normal_forces": found.ranking.best.normal_forces.tolist(),
        "forecast": [] if found.forecast is None else records(found.forecast.table()),
        "next_test": None if found.trials is None else proposal(found.trials),
        "trials": [] if found.trials is None else records(found.trials.table()),
        "control": None if found.control is None else found.control.verdict,
        "findings": [finding(one) for one in found.all_findings],
        "written": [str(path) for path in written],
    }


def _show(found: "Placement", written: list[Path]) -> None:

    from ema.cli import screen
    from ema.report.placement import answer
    from ema.report.trials import proposal

    out = screen.console()
    if found.warning:
        out.print(found.warning, style="bold red", soft_wrap=True)
    frame = found.ranking.table().reset_index()
    title = f"{found.title}: {found.ranking.objective}"
    out.print(screen.table(frame.columns, frame.itertuples(index=False), title, whole=()))
    out.print(answer(found), soft_wrap=True)
    if found.trials is not None:
        out.print(proposal(found.trials), soft_wrap=True)
    if found.control is not None:
        out.print(found.control.verdict, soft_wrap=True)
    screen.show_findings(out, found.all_findings)
    screen.show_written(out, written)
