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
    from ema.data import ModalModel
    from ema.data.placement import Placement
    from ema.place import BeamsForecast


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
    from ema.study.placement import placed
    from ema.study.placement_inputs import placement_source
    from ema.study.study import make_folder

    wanted, spoken = split_formats(report.formats), checked_language(report.language)
    asked = placement_source(source, recipe)
    folder = output or (recipe or source).parent / "_build" / f"{_stem(recipe or source)}_placement"
    make_folder(folder)
    with screen.Bars() as bars:
        task = asked.task(bars)
        with workers(work.cluster, work.jobs or 1) as executor:
            placement, together = placed(task, folder / "checked", work.resume, executor, bars, anyway=anyway)
    written = _write(placement, folder, wanted, spoken)
    if together is not None:
        written += _write_together(together, task.modes, folder)
    if json:
        screen.as_json(_as_mapping(placement, written) | {"together": _chosen(placement, together, task.modes)})
    else:
        _show(placement, written)
    return status(placement.all_findings, limit)


def _stem(path: Path) -> str:
    return path.resolve().name if path.is_dir() else path.stem


def _write(found: "Placement", folder: Path, formats: Sequence[str], language: str) -> list[Path]:
    """Store, pictures and report."""
    from ema import report, show, store
    from ema.place.beams_choice import chosen_candidates

    written = [folder / "placement.h5"]
    store.save(written[0], found)
    drawn = show.placement_map(found, together=chosen_candidates(found))
    pictures = {"placement_map": drawn, "recommended_force": show.recommended_force(found)}
    if found.control is not None:
        pictures["control"] = show.control_gain(found.control)
    written += save_pictures(folder, pictures)
    report.write(found, folder / "placement.html", formats, language)
    return [*written, *(folder / f"placement.{name}" for name in formats)]


def _write_together(together: "BeamsForecast", modes: "ModalModel", folder: Path) -> list[Path]:
    """The forecast of several beams and its picture."""
    from ema import show
    from ema.study.placement import save_together

    path = folder / "placement_together.h5"
    save_together(path, modes, together)
    return [path, *save_pictures(folder, {"forecast_together": show.forecast_bands(together.forecast)})]


def _chosen(found: "Placement", together: "BeamsForecast | None", modes: "ModalModel") -> dict[str, Any] | None:
    """Several beams that act together, and their forecast; ``None`` of a single beam."""
    from ema.place.beams_choice import chosen_beams
    from ema.study.plain_forecast import mapping_of_choice

    choice = chosen_beams(found)
    return None if choice is None else mapping_of_choice(choice, together, modes)


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
    """Print the places, the answer, findings and files."""
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
