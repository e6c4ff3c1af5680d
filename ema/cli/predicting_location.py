"""`ema predict` of beams at locations that are named: what they will do there, with 95 % bands."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ema.cli.common import status, write_csv
from ema.errors import InputError

if TYPE_CHECKING:
    from ema.cli.prediction_request import Wanted
    from ema.data import Finding, Forecast, ModalModel
    from ema.place import Location


@dataclass(frozen=True)
class FromPlacement:
    """Where a beam of a placement recipe is bolted."""

    place: Annotated[
        list[str] | None,
        typer.Option(
            "--place",
            help="Of a placement recipe: centre and angle of a beam such as '0.45 m, 0.25 m, 90 deg' (repeat).",
        ),
    ] = None
    beam: Annotated[
        list[str] | None,
        typer.Option("--beam", help="Which beam of the recipe is bolted there, where it has several (repeat)."),
    ] = None
    recipe: Annotated[
        Path | None, typer.Option("--recipe", help="The placement recipe, where --place is of a campaign or modes.")
    ] = None
    together: Annotated[
        bool,
        typer.Option(
            "--together",
            help="All beams act at the same time: a --beam and a --normal-force for all, or one for each --place.",
        ),
    ] = False

    def __bool__(self) -> bool:
        return bool(self.place or self.beam or self.recipe or self.together)


def of_locations(wanted: "Wanted", asked: FromPlacement, force: Sequence[str], normal_force: Sequence[str]) -> int:
    """Predict what beams at named locations do: each alone, under every excitation and normal force, or together."""
    from acquisition.quantities import measure

    levels, forces = ([float(measure(text, "force")[0]) for text in each] for each in (force, normal_force))
    return (_together if asked.together else _each_alone)(wanted, asked, levels, forces)


def _each_alone(wanted: "Wanted", asked: FromPlacement, levels: Sequence[float], forces: Sequence[float]) -> int:
    """Predict what each beam does at each location, with no other beam on the structure."""
    from ema.cli import screen
    from ema.study.placement_inputs import forecasts_at, placement_source
    from ema.study.plain_forecast import mapping

    locations = [_location(text, beam) for beam in asked.beam or ("",) for text in asked.place or ()]
    source = placement_source(wanted.measured, asked.recipe)
    with screen.Bars() as bars:
        task = source.task(bars)
        results = forecasts_at(task, locations, force_levels=levels, normal_forces=forces, progress=bars)
    forecasts = [one.forecast for one in results]
    written = _written(wanted, forecasts, task.modes)
    findings = list({(one.code, one.where, one.message): one for each in forecasts for one in each.findings}.values())
    if wanted.json:
        screen.as_json({"forecasts": mapping(forecasts, task.modes), "written": [str(path) for path in written]})
        return status(findings, wanted.limit)
    return _shown(wanted, _sentences(forecasts, task.modes), findings, written)


def _together(wanted: "Wanted", asked: FromPlacement, levels: Sequence[float], forces: Sequence[float]) -> int:
    """Predict what all beams do at the same time."""
    from ema import show
    from ema.cli import screen
    from ema.file_names import safe_name
    from ema.study import plain_forecast
    from ema.study.placement_inputs import forecasts_at, placement_source

    locations = _one_each(asked.place or (), asked.beam or ("",))
    source = placement_source(wanted.measured, asked.recipe)
    with screen.Bars() as bars:
        task = source.task(bars)
        (result,) = forecasts_at(
            task, locations, force_levels=levels, normal_forces=forces, together=True, progress=bars
        )
    forecast, stem = result.forecast, safe_name(wanted.measured.resolve().stem)
    picture = {f"{stem}_forecast_together": show.forecast_bands(forecast)}
    written = wanted.written(stem, {"bare": task.modes, "forecast_together": forecast}, picture)
    written.append(wanted.folder / f"{stem}_prediction.csv")
    columns = plain_forecast.columns_together(len(locations))
    write_csv(written[-1], columns, plain_forecast.rows_together(result, task.modes))
    if wanted.json:
        answer = {"together": plain_forecast.mapping_together(result, task.modes)}
        screen.as_json(answer | {"written": [str(path) for path in written]})
        return status(list(forecast.findings), wanted.limit)
    reading = plain_forecast.READINGS[forecast.method]
    lines = [f"{forecast.beam}: 95 % bands from {forecast.draws} draws; {reading}."]
    lines += [f"  {line}" for line in plain_forecast.lines_together(result, task.modes)]
    return _shown(wanted, lines, list(forecast.findings), written)


def _shown(wanted: "Wanted", lines: Sequence[str], findings: "list[Finding]", written: Sequence[Path]) -> int:
    """Print what is predicted, findings and files; the exit status."""
    from ema.cli import screen

    out = screen.console()
    for line in lines:
        out.print(line, soft_wrap=True)
    if not any(finding.code == "outside-recipe" for finding in findings):
        out.print("F_E and F_N lie within the ranges of the recipe.", soft_wrap=True)
    screen.show_findings(out, findings)
    screen.show_written(out, list(written))
    return status(findings, wanted.limit)


def _one_each(places: Sequence[str], beams: Sequence[str]) -> "list[Location]":
    """Locations with a beam for all, or one for each.

    Raises
    ------
    InputError : as many beams as neither.
    """
    if len(beams) not in (1, len(places)):
        raise InputError(
            "the beams do not fit the locations",
            where="--beam",
            got=f"{len(beams)} for {len(places)} locations",
            expected="one for all, or one for each --place",
        )
    return [_location(text, beam) for text, beam in zip(places, [*beams] * (len(places) // len(beams)), strict=True)]


def _sentences(forecasts: "Sequence[Forecast]", bare: "ModalModel") -> list[str]:
    """What is predicted, for people."""
    from ema.place import Location
    from ema.study.plain_forecast import READINGS, lines

    result = []
    for one in forecasts:
        where = Location(centre=one.centre, angle=one.angle, beam=one.beam)
        result.append(f"{where}: 95 % bands from {one.draws} draws; {READINGS[one.method]}.")
        result += [f"  {line}" for line in lines(one, bare)]
    return result


def _location(text: str, beam: str) -> "Location":
    """Centre and angle with their units as a location.

    Raises
    ------
    InputError : not two coordinates and an angle.
    UnitError : one of them without its unit, or with that of another quantity.
    """
    from acquisition.quantities import measure
    from ema.place import Location

    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 3:
        raise InputError(
            "not a location of a beam",
            where="--place",
            got=repr(text),
            expected="two coordinates and an angle such as '0.45 m, 0.25 m, 90 deg'",
        )
    x, y = (float(measure(part, "displacement")[0]) for part in parts[:2])
    return Location(centre=(x, y), angle=float(measure(parts[2], "rotation")[0]), beam=beam)


def _written(wanted: "Wanted", forecasts: "Sequence[Forecast]", bare: "ModalModel") -> list[Path]:
    """The files: modes without the beam and forecasts in one, a picture of each forecast, and a table of all."""
    from ema import show
    from ema.file_names import safe_name
    from ema.report.prediction_tables import FORECAST_COLUMNS, forecast_rows

    stem = safe_name(wanted.measured.resolve().stem)
    contents = {"bare": bare} | {f"forecast_{n}": one for n, one in enumerate(forecasts, 1)}
    pictures = {f"{stem}_forecast_{n}": show.forecast_bands(one) for n, one in enumerate(forecasts, 1)}
    written = wanted.written(stem, contents, pictures)
    written.append(wanted.folder / f"{stem}_prediction.csv")
    write_csv(written[-1], FORECAST_COLUMNS, forecast_rows(forecasts, bare))
    return written
