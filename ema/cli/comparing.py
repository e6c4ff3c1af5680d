"""`ema compare`: measured modes or a measured map against a model, with a verdict."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.cells import as_text
from ema.cli.common import Formats, Json, jsonable, save_pictures, split_formats
from ema.cli.ending import FINDINGS, FINE, ends_well
from ema.errors import InputError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from ema.data import Finding, ModalMap, ModalModel
    from ema.data.comparison import Verdict


@dataclass
class Outcome:
    """What is printed and written of a comparison."""

    verdict: "Verdict"
    tables: "dict[str, pd.DataFrame]"
    nouns: dict[str, Any]
    pictures: "dict[str, Figure]"
    findings: "list[Finding]" = field(default_factory=list)


@ends_well
def compare(
    measured: Annotated[Path, typer.Argument(help="File with modes, or a map that `ema map` wrote.")],
    model: Annotated[Path, typer.Argument(help="File with modes or a map, or a model.toml with [map].")],
    update: Annotated[
        str, typer.Option("--update", help="Parameters to identify first, e.g. friction_coefficient,contact_stiffness.")
    ] = "",
    levels: Annotated[
        bool, typer.Option("--known-levels/--relative-levels", help="Whether the force levels are known in N.")
    ] = True,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder for what is written [compared/NAME].")] = None,
    formats: Formats = "html",
    json: Json = False,
) -> int:
    """Hold a model against a measurement; ends with status 1 where it does not agree."""
    from ema.cli import screen

    wanted = split_formats(formats)
    free = [name.strip() for name in update.split(",") if name.strip()]
    found = _contents(measured)
    with screen.Bars() as bars:
        if _is_model(model):
            outcome = _against_model(found, measured, model, free, levels, bars)
        elif free:
            raise InputError(
                "only a model file has parameters to identify",
                where=str(model),
                got=f"--update {update}",
                expected="a model.toml",
                advice="leave --update out",
            )
        else:
            outcome = _against_file(found, _contents(model), measured, model)
    folder = out or Path("compared") / measured.resolve().stem
    written = _write(folder, outcome, wanted)
    if json:
        screen.as_json(
            {
                "agrees": outcome.verdict.agrees,
                "verdict": list(outcome.verdict.sentences),
                "tables": {name: _rows(table) for name, table in outcome.tables.items()},
                "findings": [str(finding) for finding in outcome.findings],
                "written": [str(one) for one in written],
            }
        )
    else:
        _print(outcome, written)
    return FINE if outcome.verdict.agrees else FINDINGS


def _is_model(path: Path) -> bool:
    return path.suffix == ".toml" or (path.is_dir() and (path / "model.toml").is_file())


def _contents(path: Path) -> "ModalMap | ModalModel":
    """The map or the modes of a file."""
    import acquisition
    from ema import store
    from ema.data import MapResult, ModalMap, ModalModel

    if not path.exists():
        raise InputError(
            "no such file", where=str(path), expected="modes or a map", advice="`ema fit` writes modes, `ema map` a map"
        )
    if store.is_store(path):
        held = store.load(path)
        items = list(held.values()) if hasattr(held, "values") and not isinstance(held, ModalModel) else [held]
    else:
        items = list(acquisition.read(path).modes)
    known: list[ModalMap | ModalModel] = []
    for item in items:
        noun = item.chart if isinstance(item, MapResult) else item
        if isinstance(noun, ModalMap | ModalModel):
            known.append(noun)
    if len(known) != 1:
        raise InputError(
            "not one set of modes or one map",
            where=str(path),
            got=f"{len(known)} of them",
            expected="one",
            advice="`ema fit` writes modes, `ema map` a map",
        )
    return known[0]


def _against_file(
    found: "ModalMap | ModalModel", other: "ModalMap | ModalModel", measured: Path, model: Path
) -> Outcome:
    from ema import compare, show
    from ema.data import ModalMap, ModalModel

    if isinstance(found, ModalModel) and isinstance(other, ModalModel):
        paired = compare.modes(found, other)
        return Outcome(paired.verdict, {"modes": paired.table()}, {"comparison": paired}, {})
    if isinstance(found, ModalMap) and isinstance(other, ModalMap):
        held = compare.maps(found, other)
        return Outcome(held.verdict, {}, {"comparison": held}, {"map_comparison": show.map_comparison(held)})
    raise InputError(
        "modes cannot be compared with a map",
        where=f"{measured} and {model}",
        got=f"{type(found).__name__} and {type(other).__name__}",
        expected="two of a kind",
    )


def _against_model(
    found: "ModalMap | ModalModel", measured: Path, path: Path, free: list[str], levels: bool, bars: Any
) -> Outcome:
    import acquisition
    from acquisition import model_file
    from ema import compare, show
    from ema.data import ModalMap

    if not isinstance(found, ModalMap):
        raise InputError(
            "a model file is compared with a map",
            where=str(measured),
            got=type(found).__name__,
            expected="what `ema map` wrote",
            advice="compare modes with a file of modes",
        )
    table, model = model_file.load(path).map, acquisition.open_model(path)
    if table is None:
        raise InputError(
            "the model file has no [map]",
            where=str(path),
            expected="at, output and band",
            advice="docs/simulate.md shows what stands there",
        )
    at, output, band = table.at, table.output or table.at, (table.band[0], table.band[1])
    tables: dict[str, Any] = {}
    nouns: dict[str, Any] = {}
    findings: list[Any] = []
    if free or not levels:
        fitted = compare.update(model, found, free, at, output, band, known_level=levels, progress=bars)
        model, findings = fitted.model, list(fitted.findings)
        tables["parameters"], nouns["update"] = fitted.table(), fitted
    simulated = compare.measure(model, found, at, output, band, progress=bars)
    held = compare.maps(found, simulated)
    nouns |= {"model": model, "comparison": held}
    return Outcome(held.verdict, tables, nouns, {"map_comparison": show.map_comparison(held)}, findings)


def _write(folder: Path, outcome: Outcome, formats: Sequence[str]) -> list[Path]:
    from ema import report, store
    from ema.study.study import make_folder

    make_folder(folder)
    written = [folder / "comparison.h5"]
    store.save(written[0], outcome.nouns)
    for name, table in outcome.tables.items():
        written.append(folder / f"{name}.csv")
        with store.replacing(written[-1]) as target:
            table.map(lambda cell: as_text(cell) if isinstance(cell, str) else cell).to_csv(target, index=False)
    written += save_pictures(folder, outcome.pictures)
    report.write(outcome.nouns, folder / "comparison.html", formats)
    return [*written, *(folder / f"comparison.{name}" for name in formats)]


def _rows(table: "pd.DataFrame") -> list[dict[str, Any]]:
    return [jsonable(row) for row in table.to_dict("records")]


def _print(outcome: Outcome, written: list[Path]) -> None:
    from rich.table import Table
    from rich.text import Text

    from ema.cli import screen

    console = screen.console()
    for name, table in outcome.tables.items():
        drawn = Table(title=name, title_justify="left", title_style="bold")
        for column in table.columns:
            drawn.add_column(Text(str(column)), justify="right", no_wrap=True)
        for row in _rows(table):
            drawn.add_row(*(f"{value:.5g}" if isinstance(value, float) else str(value) for value in row.values()))
        console.print(drawn)
    console.print(Text(str(outcome.verdict), style="bold" if outcome.verdict.agrees else "bold red"), soft_wrap=True)
    screen.show_findings(console, outcome.findings)
    console.print(Text("Written: " + ", ".join(str(path) for path in written)), soft_wrap=True)
