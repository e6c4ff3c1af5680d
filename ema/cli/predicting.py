"""`ema predict`: frequency and damping at amplitudes, forces or locations not measured, from what was."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ema.cli.common import Json, Limit, status
from ema.cli.ending import ends_well
from ema.cli.option_groups import grouped
from ema.cli.predicting_levels import of_levels
from ema.cli.predicting_location import FromPlacement, of_locations
from ema.cli.prediction_request import FromLevels, Wanted
from ema.errors import InputError

if TYPE_CHECKING:
    from ema.data import ModalMap, ModelUpdate


@dataclass(frozen=True)
class FromMap:
    """What is predicted from a map and the model that was updated by it."""

    model: Annotated[
        Path | None, typer.Option("--model", help="Of a map: the model.toml that was updated, for its [map].")
    ] = None
    force: Annotated[
        list[str] | None,
        typer.Option(
            "--force",
            help="F_E such as '4 N' (repeat): of a map, of a placement, or of stepped levels, whose response follows.",
        ),
    ] = None
    normal_force: Annotated[
        list[str] | None, typer.Option("--normal-force", help="Of a map or a placement: F_N such as '500 N' (repeat).")
    ] = None

    def __bool__(self) -> bool:
        return bool(self.model or self.normal_force)


NO_LEVELS, NO_MAP, NO_PLACEMENT = FromLevels(), FromMap(), FromPlacement()
"""Defaults: nothing asked of any."""


@ends_well
@grouped
def predict(
    measured: Annotated[
        Path,
        typer.Argument(
            help="A campaign with stepped levels, a mode over its amplitude that `ema map` wrote, what an earlier "
            "prediction wrote, the comparison.h5 of `ema compare MAP MODEL --update`, or a placement recipe."
        ),
    ],
    from_levels: FromLevels = NO_LEVELS,
    from_map: FromMap = NO_MAP,
    from_placement: FromPlacement = NO_PLACEMENT,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for what is written [predicted/NAME].")
    ] = None,
    limit: Limit = "error",
    json: Json = False,
) -> int:
    """Predict frequency, damping and response where nothing was measured: 95 % bands and the distance from the data."""
    wanted = Wanted(measured, out or Path("predicted") / measured.resolve().stem, limit, json)
    if from_placement.place and not from_levels and from_map.model is None:
        return of_locations(wanted, from_placement, from_map.force or (), from_map.normal_force or ())
    if from_map.model is not None and from_map.force and from_map.normal_force and not (from_levels or from_placement):
        return _of_map(wanted, from_map.model, from_map.force, from_map.normal_force)
    if (from_levels.amplitude or from_map.force) and not (from_map or from_placement):
        return of_levels(wanted, from_levels, from_map.force or ())
    raise InputError(
        "what is to be predicted?",
        where=str(measured),
        expected="--amplitude or --force for stepped levels; --model, --force and --normal-force for a map; "
        "--place, --normal-force and --force for a placement recipe",
        advice="docs/prediction.md has an example of each",
    )


def _of_map(wanted: Wanted, model: Path, force: list[str], normal_force: list[str]) -> int:
    """Predict at forces from a map and the model that was updated by it."""
    from acquisition import model_file
    from acquisition.quantities import measure
    from ema import show
    from ema.cli import screen
    from ema.compare import predict_map
    from ema.file_names import safe_name
    from ema.study.plain import map_lines, map_prediction

    update, chart = _updated(wanted.measured)
    table = model_file.load(model).map
    if table is None:
        raise InputError(
            "the model file has no [map]",
            where=str(model),
            expected="at, output and band",
            advice="give the file that the model was updated from",
        )
    levels, forces = (sorted(float(measure(text, "force")[0]) for text in each) for each in (force, normal_force))
    band = table.band[0], table.band[1]
    predicted = predict_map(update, chart, levels, forces, at=table.at, output=table.output or table.at, band=band)
    stem = safe_name(chart.name or "map")
    pictures = {f"{stem}_prediction": show.map_prediction(predicted, chart)}
    written = wanted.written(stem, {"prediction": predicted, "map": chart, "update": update}, pictures)
    if wanted.json:
        screen.as_json(map_prediction(predicted) | {"written": [str(path) for path in written]})
        return status(list(predicted.findings), wanted.limit)
    out = screen.console()
    lines = [f"{predicted.name}: medians and 95 % bands, which contain {predicted.contains}.", *map_lines(predicted)]
    for line in (*lines, predicted.statement):
        out.print(line, soft_wrap=True)
    screen.show_findings(out, predicted.findings)
    screen.show_written(out, written)
    return status(list(predicted.findings), wanted.limit)


def _updated(path: Path) -> "tuple[ModelUpdate, ModalMap]":
    """The update of a model and the map that it was made from.

    Raises
    ------
    InputError : the file does not hold both.
    """
    from ema import store
    from ema.data import MapComparison, ModelUpdate
    from ema.store.reading import containers

    items = containers(path) if path.is_file() and store.is_store(path) else []
    updates = [item for item in items if isinstance(item, ModelUpdate)]
    charts = [item.measured for item in items if isinstance(item, MapComparison)]
    if len(updates) != 1 or len(charts) != 1:
        raise InputError(
            "no updated model with its map",
            where=str(path),
            got="no such file" if not path.exists() else f"{len(updates)} updates and {len(charts)} maps",
            expected="the comparison.h5 that `ema compare MAP MODEL --update PARAMETERS` wrote",
        )
    return updates[0], charts[0]
