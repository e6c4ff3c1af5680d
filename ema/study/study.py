"""A study: one recipe, or one campaign with nothing said about it, from the signals to the report."""

import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from ema import fingerprint, store
from ema.data import (
    AmplitudeDependentMode,
    Campaign,
    Decay,
    Finding,
    Loop,
    MapResult,
    Placement,
    Provenance,
    Run,
    RunResult,
    StudyResult,
)
from ema.errors import CancelledError, FailureError, InputError
from ema.estimate import amplitude_dependent_mode
from ema.file_names import safe_name
from ema.progress import Progress, advance, silent
from ema.study import chain, expectations, friction, kept, mapping, recipe, statements
from ema.study.recipe import EstimateTable, MapTable, Recipe
from ema.study.sources import data_of, opened


@dataclass(frozen=True)
class Study:
    """What is to be done: a recipe and the place it came from.

    ``campaign`` is the folder or file with the measurements; ``report`` and ``result`` are where the report (HTML) and
    the result (HDF5) are written; finished runs are kept beside the result. With ``salvage``, damaged files are read as
    far as they are right.
    """

    recipe: Recipe
    campaign: Path
    report: Path
    result: Path
    source: Path
    salvage: bool = False

    @classmethod
    def load(cls, path: str | Path, output: str | Path | None = None) -> "Study":
        """Read a recipe; a campaign's folder or file, or a file with FRFs, will do as well and gets the defaults.

        Parameters
        ----------
        output : folder for what is written, instead of the one the recipe names or ``_build`` beside it.

        Raises
        ------
        InputError : there is no such file, or the recipe is wrong.
        """
        path = Path(path)
        if not path.exists():
            raise InputError(
                "there is no such file or folder",
                where=str(path),
                expected="a recipe, a campaign's folder or a file with measurements",
            )
        if path.is_file() and path.suffix.lower() == ".toml" and path.name != "campaign.toml":
            read = recipe.load(path)
            campaign = path.parent / read.campaign
            report = path.parent / (read.report or f"_build/{path.stem}.html")
        else:
            read, campaign = Recipe(campaign=str(path)), path
            folder = path if path.is_dir() else path.parent
            # with its suffix: beam.uff and beam.csv have results of their own
            alone = f"{path.stem}{path.suffix.lower().replace('.', '_')}"
            name = folder.resolve().name if path.is_dir() or path.name == "campaign.toml" else alone
            report = folder / "_build" / f"{name}.html"
        if output is not None:
            report = Path(output) / report.name
        return cls(read, campaign, report, report.with_suffix(".h5"), path)

    def keeping(self, impacts: Sequence[str]) -> "Study":
        """The study that uses some impacts in spite of their faults, besides those that its recipe keeps."""
        settings = self.recipe.estimate
        if not impacts:
            return self
        settings = EstimateTable(**(settings.given() | {"keep": [*settings.keep, *impacts]}))
        return replace(self, recipe=self.recipe.model_copy(update={"estimate": settings}))

    @property
    def kept(self) -> Path:
        """Folder of the finished runs."""
        return self.result.with_suffix("")

    def open(self, progress: Progress = silent) -> Campaign:
        """The campaign; the signals of a built-in one are written first where they are missing.

        Raises
        ------
        InputError : the campaign cannot be opened.
        """
        return opened(self.campaign, progress, salvage=self.salvage)

    def run(self, progress: Progress = silent, resume: bool = False, executor: Executor | None = None) -> StudyResult:
        """Do it: every run from signals to modes, expectations, result file and report.

        Parameters
        ----------
        resume : take runs and maps finished earlier as they are where inputs, settings, code and the versions of the
            packages under it agree. A ``progress`` with a method ``note`` is told for each whether it was taken, or why
            it is computed again.
        executor : where places for a beam are computed; here and now by default. Anything with ``submit`` of
            ``concurrent.futures`` will do: threads, processes, a cluster's.

        Raises
        ------
        InputError : the recipe or a measurement cannot be used.
        FailureError : something cannot be written.
        CancelledError : interrupted; finished runs are kept.
        """
        campaign = self.open(progress)
        make_folder(self.kept)  # a place that cannot be written is to be known before the work, not after it
        runs = self._runs(campaign)
        finished: list[RunResult] = []
        with _interruptible(self.kept, finished):
            data = data_of(self.campaign, progress)
            for number, run in enumerate(runs):
                advance(progress, "runs", number, len(runs))
                finished.append(self._one(run, self._made(campaign, data[run.id]), progress, resume))
            advance(progress, "runs", len(runs), len(runs))
            maps = tuple(self._map(campaign, table, data, progress, resume) for table in self.recipe.map)
            stepped = self._stepped(campaign)
            names = [*(run.id for run in runs), *(name for one in maps for name in one.runs)]
            used = dict.fromkeys([*names, *(mode.name for mode in stepped)])
            inputs = tuple(print_ for name in used for print_ in data[name])
            beside = self._friction(campaign, finished, progress, resume, executor)
            return self._conclude(campaign, tuple(finished), (maps, stepped), beside, inputs, progress)

    def is_current(
        self, result: StudyResult, campaign: Campaign, progress: Progress = silent, *, picked: bool = False
    ) -> bool:
        """Whether a result was made of the inputs, settings and code of which this study would make it now.

        Parameters
        ----------
        picked : the result was changed by hand: it outlives new code, and what was noted in the campaign file
            meanwhile, but no other data and settings.
        """
        if [one.run.id for one in result.runs] != [run.id for run in self._runs(campaign)] or result.provenance is None:
            return False
        data = data_of(self.campaign, progress)
        used = dict.fromkeys(
            [
                *(one.run.id for one in result.runs),
                *(name for one in result.maps for name in one.runs),
                *(mode.name for mode in result.amplitude_modes),
            ]
        )
        if not used.keys() <= data.keys():
            return False
        prints = tuple(print_ for name in used for print_ in data[name])
        now = self._made(campaign, prints)
        if picked:
            return set(prints) <= set(result.provenance.inputs) and now.options == result.provenance.options
        return not kept.changes(replace(result.provenance, steps=now.steps, created=now.created), now)

    def _runs(self, campaign: Campaign) -> tuple[Run, ...]:
        """The runs that are fitted one by one: those named, or all that belong to no map, ring-down or loop."""
        if self.recipe.runs:
            return tuple(run for run in map(campaign.__getitem__, self.recipe.runs) if not run.levels)
        mapped = {run.id for table in self.recipe.map for run in mapping.chosen(campaign, table)}
        mapped |= {one.run for one in self.recipe.ring_down} | {one.run for one in self.recipe.loop}
        free = {run.id for run in campaign.runs if run.levels or (run.kind == "snap-back" and not run.frfs)}
        return tuple(run for run in campaign.runs if run.id not in mapped | free)

    def _stepped(self, campaign: Campaign) -> tuple[AmplitudeDependentMode, ...]:
        """The modes over their amplitude of the runs of stepped levels."""
        runs = [run for run in campaign.runs if run.levels and (not self.recipe.runs or run.id in self.recipe.runs)]
        return tuple(amplitude_dependent_mode(run.levels, name=run.id, condition=run.condition) for run in runs)

    def _friction(
        self,
        campaign: Campaign,
        runs: Sequence[RunResult],
        progress: Progress,
        resume: bool,
        executor: Executor | None,
    ) -> tuple[tuple[Decay, ...], tuple[Loop, ...], Placement | None]:
        """Ring-downs, hysteresis loops and the placement that the recipe asks for."""
        told, placement = self.recipe, None
        if told.placement:
            placement = friction.placed(
                told.placement, self.source, campaign, runs, self.kept / "placement", resume, executor, progress
            )
        return (
            friction.ring_downs(campaign, told.ring_down),
            friction.hysteresis_loops(campaign, told.loop),
            placement,
        )

    def _without_results(self, campaign: Campaign) -> tuple[Finding, ...]:
        """Free vibrations of which the recipe says no band."""
        asked = {table.run for table in self.recipe.ring_down}
        return tuple(
            chain.ring_down_finding(run)
            for run in campaign.runs
            if run.kind == "snap-back" and not run.frfs and run.id not in asked and not self.recipe.runs
        )

    def _map(
        self,
        campaign: Campaign,
        table: MapTable,
        data: dict[str, tuple[tuple[str, str], ...]],
        progress: Progress,
        resume: bool,
    ) -> MapResult:
        """One map, computed or, where it was made in the same way before, taken from its file."""
        runs = mapping.chosen(campaign, table)
        reference = mapping.reference_run(campaign, table)
        used = dict.fromkeys([*(run.id for run in runs), *([] if reference is None else [reference.id])])
        made = self._made(campaign, tuple(pair for name in used for pair in data[name]))
        made = replace(made, options=(*made.options, ("map", str(table.model_dump()))))
        path = self.kept / f"{safe_name('map ' + table.title)}.h5"
        if resume and (known := kept.known(path, made, f"map {table.title}", progress)) is not None:
            return known
        result = mapping.mapped(campaign, table, self.recipe.estimate, progress)
        store.save(path, {"made": made, "result": result})
        return result

    def _one(self, run: Run, made: Provenance, progress: Progress, resume: bool) -> RunResult:
        """One run, computed or, where it was made in the same way before, taken from its file."""
        path = self.kept / f"{safe_name(run.id)}.h5"
        if resume and (known := kept.known(path, made, f"run {run.id}", progress)) is not None:
            return replace(known, run=run)
        result = chain.analyse(run, self.recipe.estimate, self.recipe.fit, progress)
        store.save(path, {"made": made, "result": replace(result, run=_without_signals(run))})
        return result

    def _conclude(
        self,
        campaign: Campaign,
        runs: tuple[RunResult, ...],
        over_levels: tuple[tuple[MapResult, ...], tuple[AmplitudeDependentMode, ...]],
        beside: tuple[tuple[Decay, ...], tuple[Loop, ...], Placement | None],
        inputs: tuple[tuple[str, str], ...],
        progress: Progress,
    ) -> StudyResult:
        """Expectations, result file and report."""
        from ema import compare, report

        conditions, differences = compare.conditions(runs)
        findings = self.recipe.former_names + campaign.findings + compare.repeat_findings([one.run for one in runs])
        findings += tuple(finding for one in conditions for finding in one.findings)
        maps, stepped = over_levels
        findings += tuple(finding for result in maps for finding in result.findings)
        findings += tuple(finding for mode in stepped for finding in mode.findings)
        findings += self._without_results(campaign)
        decays, loops, placement = beside
        findings += tuple(finding for one in loops for finding in one.findings)
        if placement is not None:
            findings += (*placement.findings, *placement.ranking.best.findings)
        checked = friction.forecast_check(self.recipe.placement, placement, maps)
        judged = statements.judge(self.recipe.statements, maps, runs, self.recipe.assumed)
        if self.recipe.logo:
            campaign = replace(campaign, logo=str((self.source.parent / self.recipe.logo).resolve()))
        result = StudyResult(
            campaign=campaign,
            runs=runs,
            findings=findings,
            title=self.recipe.title or campaign.name,
            repairs=tuple(dict.fromkeys(repair for one in runs for repair in one.run.repairs)),
            expectations=(
                *expectations.check(self.recipe.expect, runs),
                *expectations.of_verdicts(judged),
                *expectations.of_placement(self.recipe.placement, placement, checked),
            ),
            provenance=replace(self._made(campaign, inputs), steps=("ema.study",), created=datetime.now(UTC)),
            conditions=conditions,
            differences=differences,
            maps=maps,
            statements=judged,
            decays=decays,
            loops=loops,
            placement=placement,
            forecast_check=checked,
            amplitude_modes=stepped,
        )
        advance(progress, "saving the result", 0, 2)
        store.save(self.result, light(result))
        advance(progress, "writing the report", 1, 2)
        report.write(result, self.report)
        advance(progress, "writing the report", 2, 2)
        return result

    def _made(self, campaign: Campaign, data: tuple[tuple[str, str], ...]) -> Provenance:
        """From what, with what and how: equal provenance means an equal result."""
        inputs = campaign.inputs + data
        if self.source != self.campaign:
            inputs = ((self.source.name, fingerprint.of_files([self.source])), *inputs)
        options = [(f"estimate.{name}", str(value)) for name, value in self.recipe.estimate.model_dump().items()]
        options += [(f"fit.{name}", str(value)) for name, value in self.recipe.fit.model_dump().items()]
        return Provenance(inputs, fingerprint.versions(), tuple(options))


def light(result: StudyResult) -> StudyResult:
    """The result without the signals that it was computed from: those stay where they are."""
    runs = tuple(replace(one, run=_without_signals(one.run)) for one in result.runs)
    campaign = replace(result.campaign, runs=tuple(_without_signals(run) for run in result.campaign.runs))
    return replace(result, runs=runs, campaign=campaign)


def make_folder(folder: Path) -> None:
    """Make the folder that results go to, and try it out.

    Raises
    ------
    FailureError : it cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise FailureError(
            "the folder for the results cannot be used",
            where=str(folder),
            got=error.strerror,
            advice="choose another one with --output",
        ) from error


def _without_signals(run: Run) -> Run:
    return replace(run, recordings=(), frfs=(), levels=())


@contextmanager
def _interruptible(kept: Path, finished: list[RunResult]) -> Iterator[None]:
    """Turn an interruption into an error that says what is kept."""
    try:
        yield
    except (KeyboardInterrupt, CancelledError) as error:
        names = ", ".join(result.run.id for result in finished) or "none"
        raise CancelledError(
            "interrupted", got=f"finished runs: {names}", advice=f"they are kept in {kept}; go on with --resume"
        ) from error
