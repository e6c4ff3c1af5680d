"""`ema place`: a recipe on a campaign, modes or a model -> places, pictures, a report."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema import show, store
from ema.cli import screen
from ema.cli.cluster import workers
from ema.cli.common import Json, Limit, made, records, save_pictures, write_report
from ema.cli.ending import ends_well
from ema.cli.option_groups import Reporting, Work, grouped

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
    from ema.study.placement import placed
    from ema.study.placement_inputs import placement_source

    wanted = report.checked()
    inputs = placement_source(source, recipe)
    folder = made(output or (recipe or source).parent / "_build" / f"{_stem(recipe or source)}_placement")
    with screen.Bars() as bars:
        task = inputs.task(bars)
        with workers(work.cluster, work.jobs or 1) as executor:
            placement, together = placed(task, folder / "checked", work.resume, executor, bars, anyway=anyway)
    written = _write(placement, folder, *wanted)
    if together is not None:
        written += _write_together(together, task.modes, folder)
    document = _as_mapping(placement) | {"together": _chosen(placement, together, task.modes)}
    return screen.answer(document, _content(placement), placement.all_findings, written, limit=limit, json=json)


def _stem(path: Path) -> str:
    return path.resolve().name if path.is_dir() else path.stem


def _write(found: "Placement", folder: Path, formats: Sequence[str], language: str) -> list[Path]:
    """Store, pictures and report."""
    from ema.place.beams_choice import chosen_candidates

    written = [folder / "placement.h5"]
    store.save(written[0], found)
    drawn = show.placement_map(found, together=chosen_candidates(found))
    pictures = {"placement_map": drawn, "recommended_force": show.recommended_force(found)}
    if found.control is not None:
        pictures["control"] = show.control_gain(found.control)
    written += save_pictures(folder, pictures)
    return [*written, *write_report(found, folder / "placement", formats, language)]


def _write_together(together: "BeamsForecast", modes: "ModalModel", folder: Path) -> list[Path]:
    """The forecast of several beams, as `ema predict --together` stores it, and its picture."""
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


def _as_mapping(found: "Placement") -> dict[str, Any]:
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
    }


def _content(found: "Placement") -> "Iterator[screen.Content]":
    """The places, the answer, and findings."""
    from ema.report.placement import answer
    from ema.report.trials import proposal

    if found.warning:
        yield screen.styled(found.warning, "bold red")
    frame = found.ranking.table().reset_index()
    title = f"{found.title}: {found.ranking.objective}"
    yield screen.table(frame.columns, frame.itertuples(index=False), title, whole=())
    yield answer(found)
    yield from () if found.trials is None else (proposal(found.trials),)
    yield from () if found.control is None else (found.control.verdict,)
    yield from found.all_findings
