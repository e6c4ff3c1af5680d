"""`ema place`: a recipe on a campaign, modes or a model -> places, pictures, a report."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.cli.cluster import workers
from ema.cli.common import Json, Limit, records, save_pictures, split_formats, status
from ema.cli.ending import ends_well
from ema.cli.option_groups import Reporting, Work, grouped
from ema.messages import checked_language

if TYPE_CHECKING:
    from ema.data.placement import Placement
    from ema.place import BeamsForecast
    from ema.study.friction import PlacementTask


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
    from ema.study.friction import placed
    from ema.study.placement_inputs import placement_source
    from ema.study.several_beams import several_beams
    from ema.study.study import make_folder

    wanted, spoken = split_formats(report.formats), checked_language(report.language)
    asked = placement_source(source, recipe)
    folder = output or (recipe or source).parent / "_build" / f"{_stem(recipe or source)}_placement"
    make_folder(folder)
    with screen.Bars() as bars:
        task = asked.task(bars)
        with workers(work.cluster, work.jobs or 1) as executor:
            placement = placed(task, folder / "checked", work.resume, executor, bars, anyway=anyway)
        placement, several = several_beams(task, placement, bars)
    written = _write(placement, folder, wanted, spoken)
    predicted = None if several is None else several.forecast
    if predicted is not None:
        written += _write_together(predicted, task, folder)
    if json:
        together = None if several is None else several.plain(task)
        screen.as_json(_as_mapping(placement, written) | {"together": together})
    else:
        _show(placement, written, [] if predicted is None else _sentences(predicted, task))
    return status(placement.all_findings, limit)


def _stem(path: Path) -> str:
    return path.resolve().name if path.is_dir() else path.stem


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


def _write_together(forecast: "BeamsForecast", task: "PlacementTask", folder: Path) -> list[Path]:
    """The forecast of several beams, as `ema predict --together` stores it, and its picture."""
    from ema import show, store

    path = folder / "placement_together.h5"
    store.save(path, {"bare": task.modes, "forecast_together": forecast.forecast})
    return [path, *save_pictures(folder, {"forecast_together": show.forecast_bands(forecast.forecast)})]


def _sentences(together: "BeamsForecast", task: "PlacementTask") -> list[str]:
    """The forecast of several beams, for people; their choice is a finding."""
    from ema.study.plain_forecast import READINGS, lines_together

    forecast = together.forecast
    first = f"{forecast.beam}: 95 % bands from {forecast.draws} draws; {READINGS[forecast.method]}."
    return [first, *(f"  {line}" for line in lines_together(together, task.modes))]


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


def _show(found: "Placement", written: list[Path], together: Sequence[str]) -> None:
    """Print the places, the answer, what several beams do together, findings and files."""
    from ema.cli import screen
    from ema.report.placement import answer
    from ema.report.trials import proposal

    out = screen.console()
    if found.warning:
        out.print(found.warning, style="bold red", soft_wrap=True)
    frame = found.ranking.table().reset_index()
    title = f"{found.title}: {found.ranking.objective}"
    out.print(screen.table(frame.columns, frame.itertuples(index=False), title, whole=()))
    for sentence in (answer(found), *together):
        out.print(sentence, soft_wrap=True)
    if found.trials is not None:
        out.print(proposal(found.trials), soft_wrap=True)
    if found.control is not None:
        out.print(found.control.verdict, soft_wrap=True)
    screen.show_findings(out, found.all_findings)
    screen.show_written(out, written)
