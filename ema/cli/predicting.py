"""`ema predict`: frequency and damping at amplitudes, or forces, that were not measured, from those that were."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ema.cli.common import Json, Limit, save_pictures, status
from ema.cli.ending import ends_well
from ema.cli.option_groups import grouped
from ema.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ema.data import AmplitudeDependentMode, AmplitudePrediction, ModalMap, ModelUpdate


@dataclass(frozen=True)
class FromLevels:
    """What is predicted from stepped levels."""

    amplitude: Annotated[
        list[str] | None, typer.Option(help="Of stepped levels: amplitude with its unit, such as '60 m/s^2' (repeat).")
    ] = None
    run: Annotated[str, typer.Option("--run", help="The run of stepped levels, where there are several.")] = ""
    up_to: Annotated[
        str, typer.Option("--up-to", help="Fit levels up to this amplitude; higher ones confirm or refute.")
    ] = ""

    def __bool__(self) -> bool:
        return bool(self.amplitude or self.run or self.up_to)


@dataclass(frozen=True)
class FromMap:
    """What is predicted from a map and the model that was updated by it."""

    model: Annotated[
        Path | None, typer.Option("--model", help="Of a map: the model.toml that was updated, for its [map].")
    ] = None
    force: Annotated[list[str] | None, typer.Option("--force", help="Of a map: F_E such as '4 N' (repeat).")] = None
    normal_force: Annotated[
        list[str] | None, typer.Option("--normal-force", help="Of a map: F_N such as '500 N' (repeat).")
    ] = None

    def __bool__(self) -> bool:
        return bool(self.model or self.force or self.normal_force)


NO_LEVELS, NO_MAP = FromLevels(), FromMap()
"""Defaults: nothing asked of either."""


@ends_well
@grouped
def predict(
    measured: Annotated[
        Path,
        typer.Argument(
            help="A campaign with stepped levels, a mode over its amplitude that `ema map` wrote, or the comparison.h5 "
            "of `ema compare MAP MODEL --update`."
        ),
    ],
    from_levels: FromLevels = NO_LEVELS,
    from_map: FromMap = NO_MAP,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for what is written [predicted/NAME].")
    ] = None,
    limit: Limit = "error",
    json: Json = False,
) -> int:
    """Predict frequency and damping where nothing was measured, with 95 % bands and their distance from the data."""
    wanted = _Wanted(measured, out or Path("predicted") / measured.resolve().stem, limit, json)
    if from_map.model is not None and from_map.force and from_map.normal_force and not from_levels:
        return _of_map(wanted, from_map.model, from_map.force, from_map.normal_force)
    if from_levels.amplitude and not from_map:
        return _of_levels(wanted, from_levels.amplitude, from_levels.run, from_levels.up_to)
    raise InputError(
        "what is to be predicted?",
        where=str(measured),
        expected="--amplitude for stepped levels; --model, --force and --normal-force for a map",
        advice="docs/prediction.md has an example of each",
    )


@dataclass(frozen=True)
class _Wanted:
    """From what, where to, and how it is reported."""

    measured: Path
    folder: Path
    limit: str
    json: bool

    def written(self, stem: str, contents: "Mapping[str, object]", picture: "Figure") -> list[Path]:
        """The files of a prediction."""
        from ema import store
        from ema.study.study import make_folder

        make_folder(self.folder)
        first = self.folder / f"{stem}_prediction.h5"
        store.save(first, contents)
        return [first, *save_pictures(self.folder, {f"{stem}_prediction": picture})]


def _of_levels(wanted: _Wanted, amplitude: list[str], run: str, up_to: str) -> int:
    """Predict at amplitudes from stepped levels."""
    from ema import show
    from ema.cli import screen
    from ema.compare import confirmed, predict_amplitudes
    from ema.file_names import safe_name
    from ema.study.plain import amplitude_lines, prediction

    mode = _mode(wanted.measured, run)
    fitted = _fitted(mode, up_to) if up_to else mode
    predicted = predict_amplitudes(fitted, sorted(_in_si(text, mode.quantity) for text in amplitude))
    predicted = replace(predicted, findings=(*mode.findings, *predicted.findings))
    inside, held_out = confirmed(predicted, mode) if up_to else (0, 0)
    picture = show.amplitude_modes([mode], [predicted])
    written = wanted.written(safe_name(mode.name or "mode"), {"mode": fitted, "prediction": predicted}, picture)
    if wanted.json:
        tested = {"held_out": held_out, "inside": inside} if up_to else None
        screen.as_json(prediction(predicted) | {"confirmed": tested, "written": [str(path) for path in written]})
    else:
        _print(predicted, [*amplitude_lines(predicted)], (inside, held_out) if up_to else None)
        screen.show_written(screen.console(), written)
    return status(list(predicted.findings), wanted.limit)


def _fitted(mode: "AmplitudeDependentMode", up_to: str) -> "AmplitudeDependentMode":
    """The levels up to an amplitude.

    Raises
    ------
    InputError : fewer than two of them, or all.
    """
    count = int((mode.amplitude <= _in_si(up_to, mode.quantity) * 1.01).sum())
    if 2 <= count < len(mode.amplitude):
        return mode.lowest(count)
    from ema.units import SI_UNIT

    raise InputError(
        "--up-to leaves fewer than two levels to fit" if count < 2 else "--up-to leaves no level out",
        where=mode.name,
        got=f"--up-to '{up_to}'",
        expected="an amplitude from the second level to below the highest one; there are "
        + ", ".join(f"{amplitude:.4g}" for amplitude in mode.amplitude)
        + f" {SI_UNIT[mode.quantity]}",
    )


def _of_map(wanted: _Wanted, model: Path, force: list[str], normal_force: list[str]) -> int:
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
    picture = show.map_prediction(predicted, chart)
    written = wanted.written(safe_name(chart.name or "map"), {"prediction": predicted}, picture)
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


def _in_si(text: str, quantity: str) -> float:
    """An amplitude with its unit, in SI.

    Raises
    ------
    InputError : no unit, or that of another quantity.
    """
    from acquisition.quantities import measure

    try:
        float(text)
    except ValueError:
        return float(measure(text, quantity)[0])
    raise InputError(
        "an amplitude without a unit",
        got=text,
        expected=f"a unit of {quantity}",
        advice=f"write --amplitude '{text} m/s^2', or whichever unit it is in",
    )


def _mode(path: Path, run: str) -> "AmplitudeDependentMode":
    """The mode over its amplitude of a file, or of a run of stepped levels in a campaign.

    Raises
    ------
    InputError : there is none, or several and none is named.
    """
    from ema import store
    from ema.data import AmplitudeDependentMode
    from ema.estimate import amplitude_dependent_mode
    from ema.study import Study, mapping

    if path.is_file() and store.is_store(path):
        loaded = store.load(path)
        if isinstance(loaded, AmplitudeDependentMode):
            return loaded
        raise InputError(
            "not a mode over its amplitude",
            where=str(path),
            got=type(loaded).__name__,
            expected="what `ema map` writes for stepped levels",
        )
    every = mapping.stepped_runs(Study.load(path).open(), [])
    runs = [one for one in every if not run or fnmatch(one.id, run)]
    if len(runs) != 1:
        raise InputError(
            "which run of stepped levels is to be predicted from?" if every else "no run of stepped levels",
            where=str(path),
            got=f"{f'--run {run}' if run else 'no --run'}; there are {', '.join(one.id for one in every) or 'none'}",
            expected="one run with [runs.levels]",
            advice="name it by --run" if every else "docs/campaign.md shows how levels enter a campaign",
        )
    return amplitude_dependent_mode(runs[0].levels, name=runs[0].id, condition=runs[0].condition)


def _print(found: "AmplitudePrediction", lines: list[str], tested: tuple[int, int] | None) -> None:
    from ema.cli import screen

    out = screen.console()

    def say(text: str) -> None:
        out.print(text, soft_wrap=True)

    say(f"{found.name}: medians and 95 % bands, which contain {found.damping.contains}.")
    for line in lines:
        say(f"  {line}")
    say(found.statement)
    weights = sorted(zip(found.weights, found.laws, strict=True), reverse=True)
    say(
        "Laws, weighted by how they predict the highest levels from those below: "
        + ", ".join(f"{name} {weight:.2f}" for weight, name in weights)
    )
    for one in found.parameters:
        judged = "identifiable" if one.identifiable else f"not identifiable: {one.reason}"
        say(f"  {one.law}, {one.name}: {one.value:.3g} [{one.low:.3g}, {one.high:.3g}], {judged}")
    if tested is not None and not tested[1]:
        say("No level that was held out has one of these amplitudes: nothing confirms the prediction.")
    elif tested is not None:
        say(f"Confirmed by held-out levels: {tested[0]} of {tested[1]} inside the bands of frequency and damping.")
    screen.show_findings(out, found.findings)
