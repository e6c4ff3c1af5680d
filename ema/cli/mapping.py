"""`ema map`: from a shaker campaign to the map of a mode over excitation and normal force."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.cli.cluster import Cluster, workers
from ema.cli.common import Json, Limit, save_pictures, status, write_csv
from ema.cli.ending import ends_well
from ema.cli.option_groups import grouped
from ema.errors import InputError

if TYPE_CHECKING:
    from ema.data import AmplitudeDependentMode, MapResult
    from ema.study import Study
    from ema.study.recipe import MapTable


@dataclass(frozen=True)
class MapWanted:
    """Which mode is mapped over which runs, in place of what the recipe says."""

    near: Annotated[list[float] | None, typer.Option(help="Frequency of a mode in Hz (may be repeated).")] = None
    run: Annotated[list[str] | None, typer.Option("--run", help="Runs, or patterns such as 'mode1_*'.")] = None
    reference: Annotated[str, typer.Option(help="Run without a beam, for the damping by height.")] = ""
    force: Annotated[list[float] | None, typer.Option(help="Nominal normal force in N (repeat).")] = None
    level: Annotated[list[float] | None, typer.Option(help="Nominal force level in N (repeat).")] = None

    def tables(self, study: "Study") -> "list[MapTable]":
        """The maps of the recipe, or those of the frequencies given, with the other options over them.

        Raises
        ------
        InputError : neither the recipe nor an option names a mode.
        """
        from ema.study.recipe import MapTable

        given: dict[str, Any] = {"reference": self.reference} if self.reference else {}
        given |= {"runs": self.run} if self.run else {}
        given |= {"force_levels": sorted(self.level)} if self.level else {}
        given |= {"normal_forces": sorted(self.force)} if self.force else {}
        if self.near:
            return [MapTable(near=frequency, **given) for frequency in self.near]
        if not study.recipe.map:
            raise InputError(
                "which mode is to be mapped?",
                where=str(study.source),
                expected="its frequency in Hz",
                advice="give --near 500, or a recipe with [[map]]",
            )
        return [table.model_copy(update=given) for table in study.recipe.map]


OF_RECIPE = MapWanted()
"""Default: as the recipe says."""


@ends_well
@grouped
def make_map(
    campaign: Annotated[Path, typer.Argument(help="A campaign's folder or a recipe with [[map]].", show_default=False)],
    wanted: MapWanted = OF_RECIPE,
    mount_mass: Annotated[float | None, typer.Option(help="kg between load cell and structure.", min=0)] = None,
    out: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for what is written [maps/NAME].")] = None,
    cluster: Cluster = None,
    limit: Limit = "error",
    json: Json = False,
) -> int:
    """Follow a mode over excitation and normal force, or over the levels of a stepped sine: table, CSV, pictures."""
    from ema.cli import screen
    from ema.estimate import amplitude_dependent_mode
    from ema.study import Study, mapping
    from ema.study.plain import amplitude_lines, amplitude_mode, chart

    study = Study.load(campaign)
    with screen.Bars() as bars:
        opened = study.open(bars)
    stepped = mapping.stepped_runs(opened, wanted.run or [])
    tables = [] if stepped and not (wanted.near or study.recipe.map) else wanted.tables(study)
    estimate = study.recipe.estimate
    if mount_mass is not None:
        estimate = estimate.model_copy(update={"mount_mass": mount_mass})
    folder = out or Path("maps") / campaign.resolve().stem
    from ema.study.study import make_folder

    make_folder(folder)
    with screen.Bars() as bars, workers(cluster, 1) as executor:
        results = [study.mapped(opened, table, estimate, bars, executor) for table in tables]
    modes = [amplitude_dependent_mode(one.levels, name=one.id, condition=one.condition) for one in stepped]
    written = [path for result in results for path in _write(folder, result)]
    written += [path for mode in modes for path in _write_mode(folder, mode)]
    findings = [finding for result in results for finding in result.findings]
    findings += [finding for mode in modes for finding in mode.findings]
    if json:
        levels = {mode.name: amplitude_mode(mode) for mode in modes}
        maps = {"maps": [chart(result) for result in results], "levels": levels}
        screen.as_json(maps | {"written": [str(path) for path in written]})
    else:
        for result in results:
            _print(result)
        for mode in modes:
            screen.console().print(f"{mode.name}, controlled: {mode.control}")
            for line in amplitude_lines(mode):
                screen.console().print(f"  {line}")
            screen.show_findings(screen.console(), mode.findings)
        screen.show_written(screen.console(), written)
    return status(findings, limit)


def _write(folder: Path, result: "MapResult") -> list[Path]:
    """Store, CSV and pictures of one map."""
    from ema import show, store
    from ema.study.plain import points

    stem = "".join(c if c.isalnum() else "_" for c in result.name)
    written = [folder / f"{stem}.h5", folder / f"{stem}.csv"]
    store.save(written[0], result)
    rows = points(result)
    write_csv(written[1], rows[0], [row.values() for row in rows])
    pictures = {
        f"{stem}_damping": show.damping_map(result.chart),
        f"{stem}_frequency": show.frequency_map(result.chart),
        f"{stem}_curves": show.damping_curves(result.chart),
    }
    return [*written, *save_pictures(folder, pictures)]


def _write_mode(folder: Path, mode: "AmplitudeDependentMode") -> list[Path]:
    """Store, CSV and picture of a mode over its amplitude."""
    from ema import show, store
    from ema.file_names import safe_name

    stem = safe_name(mode.name)
    written = [folder / f"{stem}.h5", folder / f"{stem}.csv"]
    store.save(written[0], mode)
    header = ["amplitude", "frequency", "frequency_low", "frequency_high", "damping", "damping_low", "damping_high"]
    columns = [mode.amplitude]
    for band in (mode.frequency, mode.damping):
        columns += [band.value, band.low, band.high]
    write_csv(written[1], header, zip(*columns, strict=True))
    return [*written, *save_pictures(folder, {f"{stem}_amplitude": show.amplitude_modes([mode])})]


def _print(result: "MapResult") -> None:
    """Damping over normal force (across) and excitation (down), and what was noticed."""
    from ema.cli import screen

    out, chart = screen.console(), result.chart
    for values, title, digits in (
        (100 * chart.damping, "damping [%]", ".2f"),
        (chart.frequency, "frequency [Hz]", ".1f"),
    ):
        names = ["F_E [N]", *(f"F_N {force:.5g} N" for force in chart.normal_forces)]
        rows = [(f"{level:.3g}", *row) for level, row in zip(chart.force_levels, values, strict=True)]
        out.print(screen.table(names, rows, f"{result.name}: {title}", whole=(), digits=digits))
    screen.show_findings(out, result.findings)
