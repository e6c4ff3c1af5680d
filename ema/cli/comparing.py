"""`ema compare`: measured modes, a measured map or a measured release against a model, with a verdict."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.cli.common import Json, records, save_pictures, split_formats, write_csv
from ema.cli.ending import FINDINGS, FINE, ends_well
from ema.cli.option_groups import Reporting, grouped
from ema.errors import InputError
from ema.messages import checked_language

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from ema.data import Finding, Geometry, ModalMap, ModalModel, Recording
    from ema.data.comparison import Verdict


@dataclass
class Outcome:
    """What is printed and written of a comparison."""

    verdict: "Verdict"
    tables: "dict[str, pd.DataFrame]"
    contents: dict[str, Any]
    pictures: "dict[str, Figure]"
    findings: "list[Finding]" = field(default_factory=list)


@dataclass(frozen=True)
class Release:
    """Where in the records of a release the mode is."""

    band: Annotated[
        tuple[float, float] | None, typer.Option("--band", help="Of releases: band in Hz that holds the mode.")
    ] = None
    start: Annotated[float, typer.Option("--start", help="Of releases: s of rest before it.", min=0)] = 0.0


@dataclass(frozen=True)
class Updating:
    """Which parameters of a model are identified from a map before it is compared, and what is known of its levels."""

    update: Annotated[
        str, typer.Option("--update", help="Parameters to identify first, e.g. friction_coefficient,contact_stiffness.")
    ] = ""
    levels: Annotated[
        bool, typer.Option("--known-levels/--relative-levels", help="Whether the force levels are known in N.")
    ] = True

    @property
    def free(self) -> list[str]:
        """Names of the parameters."""
        return [name.strip() for name in self.update.split(",") if name.strip()]


FROM_THE_START, AS_IT_IS, IN_ENGLISH = Release(), Updating(), Reporting()
"""Defaults: a record without rest before the release; a model that is not updated; a report as a page in English."""


@ends_well
@grouped
def compare(
    measured: Annotated[
        Path, typer.Argument(help="File with modes, a map that `ema map` wrote, or the record of a release.")
    ],
    model: Annotated[Path, typer.Argument(help="File with modes, a map or a record, or a model.toml with [map].")],
    updating: Updating = AS_IT_IS,
    release: Release = FROM_THE_START,
    geometry: Annotated[
        Path | None,
        typer.Option("--geometry", help="Of modes: points of the test, to be found on a finite element model."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for what is written [compared/NAME].")
    ] = None,
    report: Reporting = IN_ENGLISH,
    json: Json = False,
) -> int:
    """Compare a model with a measurement; ends with status 1 where it does not agree."""
    from ema.cli import screen

    wanted, spoken = split_formats(report.formats), checked_language(report.language)
    content = _contents(measured)
    if geometry is not None and _is_model(model):
        raise InputError(
            "a model file needs no points of the test",
            where=str(model),
            got=f"--geometry {geometry}",
            expected="a file of modes with their mesh",
            advice="leave --geometry out",
        )
    with screen.Bars() as bars:
        if _is_model(model):
            outcome = _against_model(content, measured, model, updating, bars)
        elif updating.free:
            raise InputError(
                "only a model file has parameters to identify",
                where=str(model),
                got=f"--update {updating.update}",
                expected="a model.toml",
                advice="leave --update out",
            )
        else:
            other = _contents(model)
            placed = None if geometry is None else _at_points(content, other, model, geometry)
            outcome = _against_file(content, placed[0] if placed else other, (measured, model), release)
            outcome.findings += placed[1] if placed else []
    folder = out or Path("compared") / measured.resolve().stem
    written = _write(folder, outcome, wanted, spoken)
    if json:
        screen.as_json(
            {
                "agrees": outcome.verdict.agrees,
                "verdict": list(outcome.verdict.sentences),
                "tables": {name: records(table) for name, table in outcome.tables.items()},
                "findings": [str(finding) for finding in outcome.findings],
                "written": [str(one) for one in written],
            }
        )
    else:
        _print(outcome, written)
    return FINE if outcome.verdict.agrees else FINDINGS


def _is_model(path: Path) -> bool:
    return path.suffix == ".toml" or (path.is_dir() and (path / "model.toml").is_file())


def _contents(path: Path) -> "ModalMap | ModalModel | Recording":
    """The map, the modes or the record of a file."""
    import acquisition
    from ema import store
    from ema.data import MapResult, ModalMap, ModalModel, Recording
    from ema.store.reading import containers

    if not path.exists():
        raise InputError(
            "no such file",
            where=str(path),
            expected="modes, a map or a record",
            advice="`ema fit` writes modes, `ema map` a map",
        )
    if store.is_store(path):
        items = containers(path)
    else:
        read = acquisition.read(path)
        items = list(read.modes) or list(read.recordings)
    known: list[ModalMap | ModalModel | Recording] = []
    for item in items:
        item = item.chart if isinstance(item, MapResult) else item
        if isinstance(item, ModalMap | ModalModel | Recording):
            known.append(item)
    if len(known) != 1:
        raise InputError(
            "not one set of modes, one map or one record",
            where=str(path),
            got=f"{len(known)} of them",
            expected="one",
            advice="`ema fit` writes modes, `ema map` a map",
        )
    return known[0]


def _at_points(
    measured: "ModalMap | ModalModel | Recording",
    model: "ModalMap | ModalModel | Recording",
    mesh: Path,
    points: Path,
) -> "tuple[ModalModel, list[Finding]]":
    """The modes of a finite element model on the DOFs of the test, and what the search of its points says."""
    from ema import shapes
    from ema.data import ModalModel

    if not isinstance(measured, ModalModel) or not isinstance(model, ModalModel):
        raise InputError(
            "points belong to modes",
            where=str(mesh),
            got=f"{type(measured).__name__} and {type(model).__name__}",
            expected="two files of modes",
            advice="leave --geometry out",
        )
    geometry = _geometry(points)
    alignment = shapes.align(geometry, _geometry(mesh), modes=(measured, model))
    return shapes.on_test_dofs(model, alignment, measured, geometry), list(alignment.findings)


def _geometry(path: Path) -> "Geometry":
    """The points or the mesh of a file.

    Raises
    ------
    InputError : it has none.
    """
    import acquisition
    from ema import store
    from ema.store.reading import containers

    stored = store.is_store(path)
    geometry = (acquisition.Contents.of(containers(path)) if stored else acquisition.read(path)).geometry
    if geometry is None:
        raise InputError("no points in this file", where=str(path), expected="coordinates of nodes")
    return geometry


def _against_file(
    first: "ModalMap | ModalModel | Recording",
    second: "ModalMap | ModalModel | Recording",
    paths: tuple[Path, Path],
    release: Release,
) -> Outcome:
    from ema import compare, show
    from ema.data import ModalMap, ModalModel, Recording

    if isinstance(first, ModalModel) and isinstance(second, ModalModel):
        paired = compare.modes(first, second)
        return Outcome(paired.verdict, {"modes": paired.table()}, {"comparison": paired}, {})
    if isinstance(first, ModalMap) and isinstance(second, ModalMap):
        comparison = compare.maps(first, second)
        return Outcome(
            comparison.verdict, {}, {"comparison": comparison}, {"map_comparison": show.map_comparison(comparison)}
        )
    if isinstance(first, Recording) and isinstance(second, Recording):
        if release.band is None:
            raise InputError(
                "which mode do the releases show?",
                where=f"{paths[0]} and {paths[1]}",
                expected="the band in Hz that holds it",
                advice="give --band 8 60, and --start 0.3 where the records begin with 0.3 s of rest",
            )
        decays = compare.releases(first, second, release.band, release.start)
        return Outcome(decays.verdict, {}, {"comparison": decays}, {})
    kinds = {ModalModel: "modes", ModalMap: "a map", Recording: "a record"}
    raise InputError(
        f"{kinds[type(first)]} cannot be compared with {kinds[type(second)]}",
        where=f"{paths[0]} and {paths[1]}",
        expected="two of a kind",
        advice="`ema fit` writes modes, `ema map` a map, `ema record` records",
    )


def _against_model(
    content: "ModalMap | ModalModel | Recording",
    measured: Path,
    path: Path,
    updating: Updating,
    bars: Any,
) -> Outcome:
    import acquisition
    from acquisition import model_file
    from ema import compare, show
    from ema.data import ModalMap

    if not isinstance(content, ModalMap):
        raise InputError(
            "a model file is compared with a map",
            where=str(measured),
            got=type(content).__name__,
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
    contents: dict[str, Any] = {}
    findings: list[Any] = []
    if updating.free or not updating.levels:
        known = updating.levels
        fitted = compare.update(model, content, updating.free, at, output, band, known_level=known, progress=bars)
        model, findings = fitted.model, list(fitted.findings)
        tables["parameters"], contents["update"] = fitted.table(), fitted
    simulated = compare.measure(model, content, at, output, band, progress=bars)
    findings += simulated.findings
    comparison = compare.maps(content, simulated)
    contents |= {"model": model, "comparison": comparison}
    return Outcome(comparison.verdict, tables, contents, {"map_comparison": show.map_comparison(comparison)}, findings)


def _write(folder: Path, outcome: Outcome, formats: Sequence[str], language: str) -> list[Path]:
    from ema import report, store
    from ema.study.study import make_folder

    make_folder(folder)
    written = [folder / "comparison.h5"]
    store.save(written[0], outcome.contents)
    for name, table in outcome.tables.items():
        written.append(folder / f"{name}.csv")
        write_csv(written[-1], table.columns, table.itertuples(index=False))
    written += save_pictures(folder, outcome.pictures)
    report.write(outcome.contents, folder / "comparison.html", formats, language)
    return [*written, *(folder / f"comparison.{name}" for name in formats)]


def _print(outcome: Outcome, written: list[Path]) -> None:

    from ema.cli import screen

    console = screen.console()
    for name, table in outcome.tables.items():
        console.print(screen.table(table.columns, table.itertuples(index=False), name, digits=".5g"))
    console.print(str(outcome.verdict), style="bold" if outcome.verdict.agrees else "bold red", soft_wrap=True)
    screen.show_findings(console, outcome.findings)
    screen.show_written(console, written)
