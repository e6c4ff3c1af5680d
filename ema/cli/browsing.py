"""`ema app`: a campaign, recipe or result on the workbench, and the workbench in a browser."""

import webbrowser
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from ema.cli.ending import FINE, ends_well
from ema.data import (
    Campaign,
    FrfSet,
    HitGallery,
    Lazy,
    MapResult,
    ModalMap,
    Placement,
    PoleTable,
    Recording,
    Run,
    StudyResult,
)
from ema.errors import EmaError, FailureError, InputError
from ema.messages import checked_language
from ema.progress import Progress, silent

if TYPE_CHECKING:
    from ema.app.state import Exclusion, Workbench
    from ema.study import Study

app = typer.Typer(context_settings={"help_option_names": ["-h", "--help"]})

T = TypeVar("T")

_BEGIN = "# Impacts excluded in the browser:"


@app.command("app")
@ends_well
def browse(
    campaign: Annotated[
        Path,
        typer.Argument(
            help="A campaign, a recipe, a file with FRFs, or a result (.h5) of `ema run`.", show_default=False
        ),
    ],
    port: Annotated[int, typer.Option(help="0 takes a free one.", min=0, max=65535)] = 8080,
    host: Annotated[
        str, typer.Option(help="Address to serve at; others than this machine need a token.")
    ] = "127.0.0.1",
    charts: Annotated[
        list[Path] | None, typer.Option("--map", help="A file (.h5) with a modal map to show (may be repeated).")
    ] = None,
    placed: Annotated[
        list[Path] | None, typer.Option("--placement", help="A file (.h5) that `ema place` wrote (may be repeated).")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder of the result.")] = None,
    show: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")] = True,
    language: Annotated[
        str, typer.Option("--language", help="Of the page: en or de; by default what the browser prefers.")
    ] = "",
) -> int:
    """Pick poles and watch shapes in a browser; nothing leaves this machine."""
    from ema.app.server import serve
    from ema.cli import screen

    spoken = checked_language(language) if language else ""
    with screen.Bars() as bars:
        bench = workbench(campaign, output, bars.__call__, [chart for path in charts or [] for chart in maps_of(path)])
        bench.placements += tuple(one for path in placed or [] for one in placements_of(path))
    running = serve(bench, host, port, spoken)
    print(f"Open {running.address}  (Ctrl-C ends)", flush=True)
    if show:
        webbrowser.open(running.address)
    try:
        running.run()
    except KeyboardInterrupt:
        print("" if bench.saved else "ema: what was not saved is lost")
    finally:
        running.server.server_close()
    return FINE


def workbench(
    path: Path, output: Path | None = None, progress: Progress = silent, maps: Sequence[ModalMap] = ()
) -> "Workbench":
    """The workbench of a campaign, recipe or result; a study that has no result yet is run first.

    What is picked goes to ``<result>_picked.h5``, which the next opening takes up where it is newer than the result.

    Raises
    ------
    InputError : the path holds none of these.
    """
    from ema.app.state import Workbench
    from ema.study import Study

    if path.suffix.lower() == ".h5" and (result := _result(path)) is not None:
        return _with_answers(_of_result(path, result, progress, maps))
    study = Study.load(path, output)
    campaign = study.open(progress)
    picked = _picked(study.result)
    newer = picked.is_file() and not (study.result.is_file() and study.result.stat().st_mtime > picked.stat().st_mtime)
    result = _result(picked if newer else study.result) if newer or study.result.is_file() else None
    if result is None or not study.is_current(result, campaign, progress, picked=newer):
        result = study.run(progress=progress, resume=True)
    return _with_answers(_with_signals(Workbench(result, picked, maps=tuple(maps)), study, campaign))


def _of_result(path: Path, result: StudyResult, progress: Progress, maps: Sequence[ModalMap]) -> "Workbench":
    """The workbench of a result, with its signals where the recipe or campaign that it was made from is found."""
    from ema.app.state import Workbench

    bench = Workbench(result, _picked(path), maps=tuple(maps))
    study = study_of(path, result)
    if study is None:
        return bench
    try:
        campaign = study.open(progress)
        current = study.is_current(result, campaign, progress, picked=True)
    except EmaError:
        return bench  # the signals are not what the result needs: it is shown without them
    return _with_signals(bench, study, campaign) if current else bench


def study_of(path: Path, result: StudyResult) -> "Study | None":
    """The study that a result was made by, where its recipe or campaign is still what it was.

    A recipe is looked for by the name in the provenance of the result: beside it, one folder up, and in the folder
    where the command runs; its fingerprint has to be that of the provenance. A study without a recipe is the folder of
    the campaign.
    """
    from ema.fingerprint import of_files
    from ema.study import Study

    # the recipe comes first in the provenance of a study that has one
    name, print_ = next(iter(result.provenance.inputs), ("", ""))
    if not name.endswith(".toml") or name == "campaign.toml":
        folder = result.campaign.folder
        return Study.load(folder, path.parent) if folder and Path(folder).exists() else None
    for place in (path.parent, path.parent.parent, Path.cwd(), Path.cwd() / "reports"):
        file = place / Path(name).name
        if file.is_file() and of_files([file]) == print_:
            return Study.load(file, path.parent)
    return None


def _with_signals(bench: "Workbench", study: "Study", campaign: Campaign) -> "Workbench":
    """The workbench that can compute runs again, show FRFs behind maps, and keep what was excluded."""
    where = campaign_file(study.campaign)
    bench.again = partial(_again, campaign, study)
    bench.keep = None if where is None else Keeper(where).keep
    bench.look = partial(_look, campaign, study)
    return bench


def _with_answers(bench: "Workbench") -> "Workbench":
    """The workbench with the maps and the placement that its study holds."""
    bench.maps = (*(one.chart for one in bench.result.maps), *bench.maps)
    if bench.result.placement is not None:
        bench.placements = (bench.result.placement,)
    return bench


def placements_of(path: Path) -> list[Placement]:
    """The placements in a file of ours.

    Raises
    ------
    InputError : there is none.
    """
    placements = _contents(path, Placement)
    if not placements:
        raise InputError("the file holds no placement", where=str(path), advice="`ema place` writes placement.h5")
    return placements


def maps_of(path: Path) -> list[ModalMap]:
    """The modal maps in a file of ours.

    Raises
    ------
    InputError : there is none.
    """
    maps = [*_contents(path, ModalMap), *(result.chart for result in _contents(path, MapResult))]
    if not maps:
        raise InputError("the file holds no modal map", where=str(path), advice="`ema map` writes one")
    return maps


def _contents(path: Path, kind: type[T]) -> list[T]:
    """The items of one kind in a file of ours."""
    from ema.store.reading import containers

    return [item for item in containers(path) if isinstance(item, kind)]


def campaign_file(path: Path) -> Path | None:
    """The campaign.toml of a campaign.

    Parameters
    ----------
    path : folder of a campaign, its campaign.toml, or a single file of FRFs.

    Returns
    -------
    The path, whether the file is there or not; None for a single file of FRFs.
    """
    from acquisition.campaign_file import FILE_NAME

    file = path / FILE_NAME if path.is_dir() else path
    return file if file.suffix == ".toml" else None


class Keeper:
    """Writes excluded impacts to a campaign.toml as repairs, below what stood there when it was opened."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._base = self._written = path.read_text(encoding="utf-8")

    def keep(self, excluded: Mapping[str, Sequence["Exclusion"]]) -> None:
        """Write the exclusions, whole or not at all.

        Raises
        ------
        InputError : somebody else has changed the file.
        FailureError : the file cannot be written.
        """
        from acquisition import campaign_file as files
        from ema.report.files import write_bytes

        tables = [_table(run, one) for run, found in excluded.items() for one in found]
        text = self._base if not tables else f"{self._base.rstrip()}\n\n{_BEGIN}\n" + "\n".join(tables)
        if text == self._written:
            return
        try:
            if self._path.read_text(encoding="utf-8") != self._written:
                raise InputError(
                    "the campaign was changed by somebody else, so the excluded impacts were not added to it",
                    where=str(self._path),
                    advice="open it again with `ema app`; picked poles are saved",
                )
            files.parse(text, str(self._path))
            write_bytes(self._path, text.encode(), "the campaign")
        except OSError as error:
            raise FailureError(
                "the excluded impacts cannot be written",
                where=str(self._path),
                got=error.strerror,
                advice="check that the file is still there and that you may read and write it",
            ) from error
        self._written = text


def _table(run: str, one: "Exclusion") -> str:
    """One repair as TOML."""
    from ema.proposal.toml_text import table_text

    repair = {
        "what": "exclude hit",
        "runs": [run],
        "files": [one.record],
        "hits": [one.hit],
        "who": one.who,
        "why": one.why,
    }
    return table_text("[[repairs]]", repair)


def _again(
    campaign: Campaign, study: "Study", run: str, excluded: Sequence["Exclusion"]
) -> tuple[FrfSet, HitGallery | None, PoleTable]:
    """FRFs, impacts and poles of a run without some of its impacts."""
    from ema import fit
    from ema.estimate import without_dead
    from ema.study import chain
    from ema.study.measured import frfs_of

    settings = study.recipe.fit
    frfs, hits = frfs_of(_without(campaign[run], excluded), study.recipe.estimate)
    alive = without_dead(frfs.band(*(settings.band or chain.default_band(frfs, hits))))
    orders = None if settings.orders is None else range(settings.orders[0], settings.orders[1] + 1, settings.orders[2])
    whole = frfs.pick([frfs.outputs.index(dof) for dof in alive.outputs], [frfs.inputs.index(d) for d in alive.inputs])
    return whole, hits, fit.stabilise(alive, orders=orders)


def _look(campaign: Campaign, study: "Study", run: str) -> FrfSet:
    """FRFs of a run, as the study estimates them."""
    from ema.study.measured import frfs_of

    return frfs_of(campaign[run], study.recipe.estimate)[0]


def _without(run: Run, excluded: Sequence["Exclusion"]) -> Run:
    """The run with marks on the impacts that do not count."""

    def marked(place: int) -> Recording:
        record = run.recordings[place]
        more = tuple((one.hit, one.reason) for one in excluded if one.record == record.name)
        return replace(record, excluded_hits=(*record.excluded_hits, *more)) if more else record

    return replace(run, recordings=Lazy([partial(marked, place) for place in range(len(run.recordings))]))


def _picked(result: Path) -> Path:
    return result if result.stem.endswith("_picked") else result.with_name(f"{result.stem}_picked.h5")


def _result(path: Path) -> StudyResult | None:
    """The result of a study in a file of ours, if it is one."""
    from ema import store

    if not (path.is_file() and store.is_store(path)):
        return None
    try:
        contents = store.load(path)
    except EmaError:
        return None
    return contents if isinstance(contents, StudyResult) else None
