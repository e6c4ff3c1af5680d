"""`ema archive`: an index of many campaigns, and questions about all of them."""

import os
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.cli.cluster import Cluster, workers
from ema.cli.common import Jobs, Json, jsonable, status, write_csv
from ema.cli.ending import FINE, ends_well
from ema.cli.option_groups import grouped
from ema.errors import InputError

if TYPE_CHECKING:
    from ema.archive import Answer, Query, Source

SHOWN = 40
"""Modes that a terminal is shown; all of them go to --json and --output."""
_PRUNED = frozenset({"_build", ".git", "parts"})
_PICTURES = (".png", ".svg", ".pdf")

app = typer.Typer(
    name="archive", no_args_is_help=True, rich_markup_mode=None, help="An index of many campaigns, and questions to it."
)

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the archive.", show_default=False)]
_RANGE = "lowest and highest, with their units"


@dataclass(frozen=True)
class Conditions:
    """Conditions on modes and their campaigns, as texts of a command line; a mode has to meet all that are given."""

    frequency: Annotated[
        tuple[str, str] | None, typer.Option("--frequency", help=f'Natural frequency: {_RANGE}, "490 Hz" "510 Hz".')
    ] = None
    damping: Annotated[
        tuple[str, str] | None, typer.Option("--damping", help=f'Damping ratio: {_RANGE}, "1 %" "3 %".')
    ] = None
    normal_force: Annotated[
        tuple[str, str] | None,
        typer.Option("--normal-force", help=f'Mean normal force of the joints: {_RANGE}, "100 N" "0.3 kN".'),
    ] = None
    force_level: Annotated[
        tuple[str, str] | None, typer.Option("--force-level", help=f'Force level: {_RANGE}, "5 N" "50 N".')
    ] = None
    since: Annotated[str, typer.Option("--since", help="First day of a campaign, such as 2023-01-01.")] = ""
    until: Annotated[str, typer.Option("--until", help="Last day of a campaign.")] = ""
    structure: Annotated[str, typer.Option("--structure", help="Pattern of the structure, such as '*table*'.")] = ""
    campaign: Annotated[str, typer.Option("--campaign", help="Pattern of the campaign's name.")] = ""
    run: Annotated[str, typer.Option("--run", help="Pattern of the run's name.")] = ""
    kind: Annotated[str, typer.Option("--kind", help="hammer, random, sweep, map ...")] = ""
    finding: Annotated[str, typer.Option("--finding", help="Only runs with this finding, such as double-hit.")] = ""
    bare: Annotated[bool, typer.Option("--bare", help="Only runs without a beam.")] = False

    def query(self) -> "Query":
        """The conditions in SI.

        Raises
        ------
        InputError : a text is no range, quantity or day.
        """
        from ema.archive import Query

        return Query(
            frequency=_limits(self.frequency, "frequency", "frequency"),
            damping=_limits(self.damping, "damping", ""),
            normal_force=_limits(self.normal_force, "normal_force", "force"),
            force_level=_limits(self.force_level, "force_level", "force"),
            since=_day(self.since, "--since"),
            until=_day(self.until, "--until"),
            structure=self.structure,
            campaign=self.campaign,
            run=self.run,
            kind=self.kind,
            finding=self.finding,
            bare=self.bare,
        )


ALL = Conditions()
"""Default: every mode."""


@app.command()
@ends_well
def add(
    folder: Folder,
    campaigns: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Campaigns, recipes, folders that hold campaigns, or other archives; without any, all campaigns of "
            "the archive again.",
            show_default=False,
        ),
    ] = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
    json: Json = False,
) -> int:
    """Add campaigns with the results that `ema run` kept of them; what is there already stays."""
    from ema import archive
    from ema.archive.adding import sources_of
    from ema.cli import screen

    paths, archives = [], []
    for path in campaigns or []:
        if _is_archive(path):
            archives.append(path)
        else:
            paths += _campaigns_in(path)
    sources = [_source(path) for path in paths] if campaigns else list(sources_of(folder))
    many = min(jobs or os.cpu_count() or 1, max(len(sources) // 8, 1))
    with screen.Bars() as bars, workers(cluster, many) as executor:
        added = archive.add(folder, sources, archives=archives, executor=executor, progress=bars)
    if json:
        from ema.study.plain import finding

        screen.as_json(vars(added) | {"findings": [finding(one) for one in added.findings]})
    else:
        words = [f"{getattr(added, name)} {name}" for name in ("new", "changed", "moved", "unchanged")]
        words += [f"{added.merged} parts of other archives"] if archives else []
        screen.console().print(f"{folder}: {', '.join(words)}; {added.runs} runs in these campaigns.", soft_wrap=True)
        screen.show_findings(screen.console(), added.findings)
    return status(added.findings, "error")


@app.command()
@ends_well
@grouped
def find(
    folder: Folder,
    conditions: Conditions = ALL,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write all modes to this CSV file.")] = None,
    json: Json = False,
) -> int:
    """Print the modes of all campaigns that meet the conditions, with their intervals."""
    answer = _asked(folder, conditions.query())
    if output is not None:
        from ema.archive import Observation

        write_csv(output, Observation._fields, answer.observations)
    _show(answer, output, json=json)
    return FINE


@app.command()
@ends_well
@grouped
def trend(
    folder: Folder,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The picture to write: .png, .svg or .pdf.", show_default=False)
    ],
    conditions: Conditions = ALL,
    json: Json = False,
) -> int:
    """Draw damping and frequency of these modes over the date, with their intervals."""
    if output.suffix.lower() not in _PICTURES:
        raise InputError("not a picture that can be written", got=str(output), expected=" or ".join(_PICTURES))
    answer = _asked(folder, conditions.query())
    _draw(answer, output)
    _show(answer, output, json=json)
    return FINE


def _is_archive(path: Path) -> bool:
    from ema.archive.parts import FOLDER

    return (path / FOLDER).is_dir() and not (path / "campaign.toml").exists()


def _campaigns_in(path: Path) -> list[Path]:
    """The campaign or recipe itself, or every campaign below a folder."""
    if path.is_file() or (path / "campaign.toml").is_file():
        return [path]
    if not path.is_dir():
        raise InputError(
            "there is no such file or folder", where=str(path), expected="a campaign, a recipe, or a folder of them"
        )
    campaigns = []
    for folder, below, files in os.walk(path):
        if "campaign.toml" in files:
            campaigns.append(Path(folder))
            below.clear()  # campaigns do not lie in each other, and data may be many
        below[:] = sorted(name for name in below if name not in _PRUNED)
    if not campaigns:
        raise InputError("no campaign in this folder", where=str(path), expected="campaign.toml in it or below")
    return campaigns


def _source(path: Path) -> "Source":
    """Where the study of a campaign or recipe keeps its results."""
    from ema.archive import Source
    from ema.study import Study

    study = Study.load(path)
    if study.campaign.is_file() and study.campaign.suffix.lower() != ".toml":
        raise InputError("a file with measurements is no campaign", where=str(path), expected="a campaign or recipe")
    result = study.result if path.is_file() or study.kept.is_dir() else _of_former_name(study.result)
    return Source(study=path, campaign=study.campaign, kept=result.with_suffix(""), result=result)


def _of_former_name(result: Path) -> Path:
    """The result of a campaign whose folder was renamed after the study: there is one folder of kept runs."""
    others = [path for path in result.parent.glob("*") if path.is_dir() and any(path.glob("*.h5"))]
    return Path(f"{others[0]}.h5") if len(others) == 1 else result


def _limits(texts: tuple[str, str] | None, name: str, quantity: str) -> tuple[float, float] | None:
    if texts is None:
        return None
    option = f"--{name.replace('_', '-')}"
    low, high = (_percent(text, option) if not quantity else _measured(text, quantity, option) for text in texts)
    return low, high


def _percent(text: str, option: str) -> float:
    number, unit, _ = text.partition("%")
    try:
        return float(number) / 100 if unit else float(number)
    except ValueError:
        raise InputError("not a damping ratio", where=option, got=repr(text), expected='"1.5 %", or 0.015') from None


def _measured(text: str, quantity: str, option: str) -> float:
    from acquisition import quantities

    try:
        return quantities.measure(text, quantity)[0]
    except InputError as error:
        raise InputError(
            error.what, where=option, got=error.got, expected=error.expected, advice=error.advice
        ) from error


def _day(text: str, option: str) -> date | None:
    try:
        return date.fromisoformat(text) if text else None
    except ValueError:
        raise InputError("not a day", where=option, got=repr(text), expected="a day such as 2023-01-31") from None


def _asked(folder: Path, query: "Query") -> "Answer":
    from ema import archive
    from ema.cli import screen

    with screen.Bars() as bars:
        return archive.find(folder, query, progress=bars)


def _draw(answer: "Answer", path: Path) -> None:
    from ema import store
    from ema.archive import trend as drawn

    figure = drawn(answer)
    with store.replacing(path) as target:
        figure.savefig(target, format=path.suffix.lower().removeprefix("."), dpi=150)


def _show(answer: "Answer", written: Path | None, *, json: bool) -> None:
    from ema.cli import screen
    from ema.study.plain import finding

    if json:
        modes: list[dict[str, Any]] = [jsonable(row._asdict()) for row in answer.observations]
        counts = {"campaigns": answer.campaigns, "runs": answer.runs, "modes": modes}
        paths = {"written": [] if written is None else [str(written)]}
        screen.as_json(counts | {"findings": [finding(one) for one in answer.findings]} | paths)
        return
    out = screen.console()
    if answer.observations:
        out.print(_table(answer))
    total = len(answer.observations)
    more = f"; the first {SHOWN} are shown, --json and `find --output` give all" if total > SHOWN else ""
    out.print(f"{total} modes in {answer.campaigns} campaigns with {answer.runs} runs{more}.", soft_wrap=True)
    screen.show_findings(out, answer.findings)
    if written is not None:
        screen.show_written(out, [written])


def _table(answer: "Answer") -> Any:
    from ema.cli import screen

    left = ("date", "structure", "campaign", "run")
    rows = [
        (
            row.date or "-",
            row.structure,
            row.campaign,
            row.run + (" (older)" if row.state == "older" else ""),
            row.normal_force,
            row.force_level,
            f"{row.frequency:.3f}",
            _interval(row.frequency_low, row.frequency_high, 3),
            f"{100 * row.damping:.4f}",
            _interval(100 * row.damping_low, 100 * row.damping_high, 4),
        )
        for row in answer.observations[:SHOWN]
    ]
    names = (*left, "F_N [N]", "F_E [N]", "f [Hz]", "95 %", "zeta [%]", "95 %")
    return screen.table(names, rows, left=left, whole=())


def _interval(low: float, high: float, digits: int) -> str:
    return "unknown" if low != low else f"{low:.{digits}f} ... {high:.{digits}f}"
