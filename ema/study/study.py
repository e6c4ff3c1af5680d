"""A study: one recipe, or one campaign with nothing said about it, from the signals to the report."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from acquisition import model_file
from ema import fingerprint, store
from ema.compare.linearity import other_levels
from ema.data import (
    AmplitudeDependentMode,
    Campaign,
    Decay,
    Finding,
    Loop,
    MapResult,
    Provenance,
    Run,
    RunResult,
    StudyResult,
)
from ema.errors import CancelledError, FailureError, InputError
from ema.estimate import amplitude_dependent_mode
from ema.file_names import safe_name
from ema.progress import Progress, advance, silent
from ema.store.atomic import remove_abandoned
from ema.study import (
    chain,
    expectations,
    friction,
    kept,
    mapping,
    model_releases,
    placement,
    recipe,
    remote,
    statements,
)
from ema.study.model_releases import ModelRelease
from ema.study.recipe import RELEASE_QUANTITIES, EstimateTable, MapTable, Recipe
from ema.study.sources import data_of, opened


@dataclass(frozen=True)
class _Beside:
    """What a study says beside runs and maps."""

    decays: tuple[Decay, ...]
    loops: tuple[Loop, ...]
    placed: placement.Placed | None
    released: Mapping[str, ModelRelease]


def _is_release(run: Run) -> bool:
    """Whether a run is a free vibration, without a measured force."""
    return run.kind == "snap-back" and not run.frfs


@dataclass(frozen=True)
class Study:
    r"""What is to be done: a recipe and where it came from.

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    campaign : Path
        Folder or file with the measurements.
    report : Path
        Where the report (HTML) is written.
    result : Path
        Where the result (HDF5) is written; finished runs are kept beside it.
    source : Path
        File or folder that the study was read from.
    salvage : bool, default False
        Read damaged files as far as they are right.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "study.toml").write_text('campaign = "raw"\n')
    ...     Study.load(f"{folder}/study.toml").report.name
    'study.html'
    """

    recipe: Recipe
    campaign: Path
    report: Path
    result: Path
    source: Path
    salvage: bool = False

    @classmethod
    def load(cls, path: str | Path, output: str | Path | None = None) -> "Study":
        r"""Read a recipe.

        The folder or file of a campaign, or a file with FRFs, is accepted as well and gets the defaults.

        Parameters
        ----------
        path : str or Path
            The recipe, campaign or file.
        output : str or Path, optional
            Folder for what is written, instead of the one that the recipe names or ``_build`` beside it.

        Returns
        -------
        Study
            The study.

        Raises
        ------
        InputError
            If there is no such file, or the recipe is wrong.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = Path(folder, "study.toml").write_text('campaign = "raw"\n')
        ...     Study.load(f"{folder}/study.toml", output=folder).result.suffix
        '.h5'
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
        r"""Return the study that uses some impacts in spite of their faults, besides those that its recipe keeps.

        Parameters
        ----------
        impacts : sequence of str
            Impacts as in ``keep`` of :func:`ema.estimate.hammer_test`.

        Returns
        -------
        Study
            The study.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = Path(folder, "study.toml").write_text('campaign = "raw"\n')
        ...     Study.load(f"{folder}/study.toml").keeping(["double-hit"]).recipe.estimate.keep
        ['double-hit']
        """
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
        """Open the campaign; the signals of a built-in one are written first where they are missing.

        Parameters
        ----------
        progress : Progress, optional
            Called with the file that is being opened.

        Returns
        -------
        Campaign
            The campaign.

        Raises
        ------
        InputError
            If the campaign cannot be opened.

        Examples
        --------
        >>> import tempfile
        >>> from ema.examples import frf_set
        >>> from ema.store import save
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     save(f"{folder}/bare.h5", frf_set())
        ...     len(Study.load(f"{folder}/bare.h5").open().runs)
        1
        """
        return opened(self.campaign, progress, salvage=self.salvage)

    def run(self, progress: Progress = silent, resume: bool = False, executor: Executor | None = None) -> StudyResult:
        """Run the study: every run from signals to modes, expectations, result file and report.

        Parameters
        ----------
        progress : Progress, optional
            Called as the work goes on. One with a method ``note`` is given for each finished run whether it was used
            again, or why it is computed again.
        resume : bool, default False
            Use runs and maps finished earlier where inputs, settings, code and the versions of the packages under it
            agree.
        executor : Executor, optional
            Where runs, conditions of maps and locations for a beam are computed; in this process by default. Anything
            with ``submit`` of ``concurrent.futures`` will do: processes, a cluster's. Results are the same.

        Returns
        -------
        StudyResult
            The finished study.

        Raises
        ------
        InputError
            If the recipe or a measurement cannot be used.
        FailureError
            If something cannot be written.
        CancelledError
            If it was interrupted; finished runs are kept.

        Examples
        --------
        >>> import tempfile
        >>> from ema.examples import frf_set
        >>> from ema.store import save
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     save(f"{folder}/bare.h5", frf_set(0.001))
        ...     result = Study.load(f"{folder}/bare.h5", output=folder).run()
        >>> result.runs[0].modes.natural_frequencies.round(1)
        array([40., 60., 90.])
        """
        campaign = self.open(progress)
        for folder in (self.result.parent, self.kept):  # what cannot be written is to be known before the work
            make_folder(folder)
        runs = self._runs(campaign)
        finished: list[RunResult] = []
        with _interruptible(self.kept, finished):
            data = data_of(self.campaign, progress)
            self._finish(campaign, runs, finished, data, progress, resume=resume, executor=executor)
            maps = tuple(self._map(campaign, table, data, progress, resume, executor) for table in self.recipe.map)
            stepped = self._stepped(campaign)
            names = [*(run.id for run in runs), *(name for one in maps for name in one.runs)]
            used = dict.fromkeys([*names, *(mode.name for mode in stepped), *self._beside()])
            inputs = tuple(print_ for name in used if name in data for print_ in data[name]) + self._models()
            stepped += tuple(
                mode for one in finished for mode in self._ring_downs(one, campaign, data[one.run.id], progress, resume)
            )
            beside = self._friction(campaign, finished, progress, resume, executor)
            result = self._conclude(campaign, tuple(finished), (maps, stepped), beside, inputs)
            self._write(result, progress, executor)
            return result

    def is_current(
        self, result: StudyResult, campaign: Campaign, progress: Progress = silent, *, picked: bool = False
    ) -> bool:
        """Return whether a result was made of the inputs, settings and code with which this study would make it now.

        Parameters
        ----------
        result : StudyResult
            A finished study.
        campaign : Campaign
            The opened campaign.
        progress : Progress, optional
            Called as the files are read.
        picked : bool, default False
            The result was changed by hand: it outlives new code, and what was noted in the campaign file meanwhile, but
            no other data and settings.

        Returns
        -------
        bool
            Whether it is current.

        Examples
        --------
        >>> import tempfile
        >>> from ema.examples import frf_set, study_result
        >>> from ema.store import save
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     save(f"{folder}/bare.h5", frf_set())
        ...     study = Study.load(f"{folder}/bare.h5")
        ...     study.is_current(study_result(), study.open())
        False
        """
        if [one.run.id for one in result.runs] != [run.id for run in self._runs(campaign)] or result.provenance is None:
            return False
        data = data_of(self.campaign, progress)
        used = dict.fromkeys(
            [
                *(one.run.id for one in result.runs),
                *(name for one in result.maps for name in one.runs),
                *(mode.name for mode in result.amplitude_modes if friction.RING_DOWN not in mode.provenance.steps),
                *self._beside(),
            ]
        )
        if not used.keys() <= data.keys():
            return False
        prints = tuple(print_ for name in used for print_ in data[name]) + self._models()
        now = self._made(campaign, prints)
        if picked:
            return set(prints) <= set(result.provenance.inputs) and now.options == result.provenance.options
        return not kept.changes(replace(result.provenance, steps=now.steps, created=now.created), now)

    def _runs(self, campaign: Campaign) -> tuple[Run, ...]:
        """The runs that are fitted one by one: those named, or all that belong to no map, ring-down or loop."""
        if self.recipe.runs:
            requested = self._requested()
            named = tuple(map(campaign.__getitem__, self.recipe.runs))
            return tuple(run for run in named if not (run.levels or (_is_release(run) and run.id in requested)))
        measured = [table for table in self.recipe.map if not table.model]
        mapped = {run.id for table in measured for run in mapping.chosen(campaign, table)}
        mapped |= {one.run for one in self.recipe.ring_down} | {one.run for one in self.recipe.loop}
        free = {run.id for run in campaign.runs if run.levels or _is_release(run)}
        return tuple(run for run in campaign.runs if run.id not in mapped | free)

    def _beside(self) -> list[str]:
        """The runs of ring-downs, loops and releases that statements are about."""
        settings = self.recipe
        about = [one for one in settings.statements if one.quantity in RELEASE_QUANTITIES]
        names = [*(one.run for one in settings.ring_down), *(one.run for one in settings.loop)]
        return [*names, *(name for one in about for name in (one.run, one.other) if name)]

    def _requested(self) -> set[str]:
        """The runs that ring-downs and statements of the recipe name."""
        settings = self.recipe
        return {one.run for one in settings.ring_down} | {
            name for one in settings.statements if one.run for name in (one.run, one.other)
        }

    def _models(self) -> tuple[tuple[str, str], ...]:
        """Fingerprints of the model files that maps and releases are computed from."""
        names = [*(one.model for one in self.recipe.map if one.model), *(one.model for one in self.recipe.release)]
        return tuple(
            (f"model {name}", fingerprint.of_files([model_file.locate(self.source.parent / name)]))
            for name in dict.fromkeys(names)
        )

    def _stepped(self, campaign: Campaign) -> tuple[AmplitudeDependentMode, ...]:
        """The modes over their amplitude of the runs of stepped levels."""
        runs = [run for run in campaign.runs if run.levels and (not self.recipe.runs or run.id in self.recipe.runs)]
        return tuple(amplitude_dependent_mode(run.levels, name=run.id, condition=run.condition) for run in runs)

    def _ring_downs(
        self,
        result: RunResult,
        campaign: Campaign,
        data: tuple[tuple[str, str], ...],
        progress: Progress,
        resume: bool,
    ) -> tuple[AmplitudeDependentMode, ...]:
        """The modes over their amplitude of a hammer test, computed or taken from their file.

        Of tests that are not linear, and of those of which a publication states numbers: they are marked on the curves.
        """
        stated = {one.run for one in self.recipe.statements if one.sentence}
        linear = not any(finding.code == "slip-then-ring" for finding in result.findings)
        run = campaign[result.run.id]
        if run.kind != "hammer" or not len(run.recordings) or run.frfs or (linear and run.id not in stated):
            return ()
        made = self._made(campaign, data)
        path = self.kept / f"{safe_name('ring-downs ' + run.id)}.h5"

        def compute() -> StudyResult:
            band = self.recipe.fit.band or chain.default_band(result.frfs, result.hits)
            modes = friction.over_amplitude(run, result, band, progress)
            return StudyResult(replace(campaign, runs=()), runs=(), amplitude_modes=modes)

        what = f"ring-downs of {run.id}"
        return tuple(kept.known_or_computed(path, made, what, compute, progress, resume=resume).amplitude_modes)

    def _friction(
        self,
        campaign: Campaign,
        runs: Sequence[RunResult],
        progress: Progress,
        resume: bool,
        executor: Executor | None,
    ) -> _Beside:
        """Ring-downs, hysteresis loops, the placement and the releases of models that the recipe asks for."""
        settings, placed = self.recipe, None
        if settings.placement:
            task = placement.placement_task(settings.placement, self.source, campaign, runs)
            placed = placement.placed(task, self.kept / "placement", resume, executor, progress)
            if placed.together is not None:
                placement.save_together(self.kept / "placement_together.h5", task.modes, placed.together)
        released = model_releases.simulated(self.source.parent, settings.release, progress)
        return _Beside(
            friction.ring_downs(campaign, settings.ring_down),
            friction.hysteresis_loops(campaign, settings.loop) + model_releases.loops(released, settings.release),
            placed,
            released,
        )

    def _without_results(self, campaign: Campaign) -> tuple[Finding, ...]:
        """Free vibrations of which the recipe says no band, unless it says what it is about: runs, or models alone."""
        requested = self._requested()
        of_models = [*self.recipe.release, *(one for one in self.recipe.map if one.model)]
        if self.recipe.runs or (of_models and not any(requested)):
            return ()
        return tuple(
            chain.ring_down_finding(run) for run in campaign.runs if _is_release(run) and run.id not in requested
        )

    def _map(
        self,
        campaign: Campaign,
        table: MapTable,
        data: dict[str, tuple[tuple[str, str], ...]],
        progress: Progress,
        resume: bool,
        executor: Executor | None = None,
    ) -> MapResult:
        """One map, computed or, where it was made in the same way before, taken from its file."""
        model = self.source.parent / table.model
        if table.model:
            inputs: tuple[tuple[str, str], ...] = (
                (f"model {table.model}", fingerprint.of_files([model_file.locate(model)])),
            )
        else:
            runs = mapping.chosen(campaign, table)
            reference = mapping.reference_run(campaign, table)
            used = dict.fromkeys([*(run.id for run in runs), *([] if reference is None else [reference.id])])
            inputs = tuple(pair for name in used for pair in data[name])
        made = self._made(campaign, inputs)
        made = replace(made, options=(*made.options, ("map", str(table.model_dump()))))
        path = self.kept / f"{safe_name('map ' + table.title)}.h5"

        def compute() -> MapResult:
            if table.model:
                return mapping.simulated(model, table, progress)
            return self.mapped(campaign, table, self.recipe.estimate, progress, executor)

        result: MapResult = kept.known_or_computed(path, made, f"map {table.title}", compute, progress, resume=resume)
        return result

    def _finish(
        self,
        campaign: Campaign,
        runs: Sequence[Run],
        finished: list[RunResult],
        data: dict[str, tuple[tuple[str, str], ...]],
        progress: Progress,
        *,
        resume: bool,
        executor: Executor | None,
    ) -> None:
        """Put the result of every run to ``finished``, computed or, where it was made in the same way before, kept."""
        results: dict[str, RunResult] = {}
        tasks: list[tuple[Run, tuple[Run, ...], Provenance]] = []
        for run in runs:
            others = other_levels(run, campaign.runs)
            made = self._made(campaign, tuple(pair for one in (run, *others) for pair in data[one.id]))
            known = kept.known(self._kept_run(run), made, f"run {run.id}", progress) if resume else None
            if known is None:
                tasks.append((run, others, made))
            else:
                results[run.id] = replace(known, run=run)
        computed = self._computed(tasks, progress, executor)
        for number, run in enumerate(runs):
            advance(progress, "runs", number, len(runs))
            if run.id not in results:
                made = next(made for one, _, made in tasks if one is run)
                results[run.id] = self._keep(run, next(computed), made)
            finished.append(results[run.id])
        advance(progress, "runs", len(runs), len(runs))

    def _keep(self, run: Run, result: RunResult, made: Provenance) -> RunResult:
        """Write the result of a run beside those that are finished."""
        kept_result = kept.save_run(self._kept_run(run), made, replace(result, run=remote.without_signals(run)))
        return replace(kept_result, run=run)

    def _kept_run(self, run: Run) -> Path:
        return self.kept / f"{safe_name(run.id)}.h5"

    def _computed(
        self, tasks: Sequence[tuple[Run, tuple[Run, ...], Provenance]], progress: Progress, executor: Executor | None
    ) -> Iterator[RunResult]:
        """The results of runs in their order."""
        estimate, fit = self.recipe.estimate, self.recipe.fit
        if executor is None or not tasks:
            return (chain.analyse(run, estimate, fit, progress, others=others) for run, others, _ in tasks)
        measured = remote.Measured.of(self.campaign, self.salvage)
        return remote.in_order(
            [
                executor.submit(remote.run_result, measured, run.id, [one.id for one in others], estimate, fit)
                for run, others, _ in tasks
            ]
        )

    def mapped(
        self,
        campaign: Campaign,
        table: MapTable,
        estimate: EstimateTable,
        progress: Progress = silent,
        executor: Executor | None = None,
    ) -> MapResult:
        r"""Return a map of the runs of the campaign.

        Parameters
        ----------
        campaign : Campaign
            The opened campaign.
        table : MapTable
            Which mode and runs.
        estimate : EstimateTable
            Settings of the FRFs.
        progress : Progress, optional
            Called for each run.
        executor : Executor, optional
            Where its conditions are computed; in this process by default.

        Returns
        -------
        MapResult
            The map.

        Raises
        ------
        InputError
            If there are no such runs, or one of them cannot be used.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = Path(folder, "study.toml").write_text('campaign = "raw"\n')
        ...     callable(Study.load(f"{folder}/study.toml").mapped)
        True
        """
        if executor is None:
            return mapping.mapped(campaign, table, estimate, progress)
        measured = remote.Measured.of(self.campaign, self.salvage)
        computed = partial(remote.points, executor, measured, table=table, estimate=estimate)
        return mapping.mapped(campaign, table, estimate, progress, computed)

    def _conclude(
        self,
        campaign: Campaign,
        runs: tuple[RunResult, ...],
        over_levels: tuple[tuple[MapResult, ...], tuple[AmplitudeDependentMode, ...]],
        beside: _Beside,
        inputs: tuple[tuple[str, str], ...],
    ) -> StudyResult:
        """Findings, statements and expectations about all of it."""
        from ema import compare

        conditions, differences = compare.conditions(runs)
        findings = self.recipe.former_names + campaign.findings + compare.repeat_findings([one.run for one in runs])
        findings += tuple(finding for one in conditions for finding in one.findings)
        maps, stepped = over_levels
        stepped = friction.with_stated(stepped, self.recipe.statements)
        findings += tuple(finding for result in maps for finding in result.findings)
        findings += friction.to_know(stepped)
        findings += self._without_results(campaign)
        decays, loops = beside.decays, beside.loops
        answer = None if beside.placed is None else beside.placed.placement
        findings += tuple(finding for one in loops for finding in one.findings)
        if answer is not None:
            findings += answer.all_findings
        checked = placement.forecast_check(self.recipe.placement, answer, maps)
        judged = statements.judge(
            self.recipe.statements, maps, runs, self.recipe.assumed, campaign=campaign, released=beside.released
        )
        if self.recipe.logo:
            campaign = replace(campaign, logo=str((self.source.parent / self.recipe.logo).resolve()))
        return StudyResult(
            campaign=campaign,
            runs=runs,
            findings=findings,
            title=self.recipe.title or campaign.name,
            repairs=tuple(dict.fromkeys(repair for one in runs for repair in one.run.repairs)),
            expectations=(
                *expectations.check(self.recipe.expect, runs),
                *expectations.of_verdicts(judged),
                *expectations.of_placement(self.recipe.placement, answer, checked),
            ),
            provenance=replace(self._made(campaign, inputs), steps=("ema.study",), created=datetime.now(UTC)),
            conditions=conditions,
            differences=differences,
            maps=maps,
            statements=judged,
            decays=decays,
            loops=loops,
            placement=answer,
            forecast_check=checked,
            amplitude_modes=stepped,
            language=self.recipe.language,
        )

    def _write(self, result: StudyResult, progress: Progress, executor: Executor | None) -> None:
        """Result file and report."""
        from ema import report

        advance(progress, "saving the result", 0, 2)
        store.save(self.result, light(result))
        advance(progress, "writing the report", 1, 2)
        report.write(result, self.report, executor=executor)
        advance(progress, "writing the report", 2, 2)

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
    runs = tuple(replace(one, run=remote.without_signals(one.run)) for one in result.runs)
    campaign = replace(result.campaign, runs=tuple(remote.without_signals(run) for run in result.campaign.runs))
    return replace(result, runs=runs, campaign=campaign)


def make_folder(folder: Path) -> None:
    """Make the folder that results go to, try it out, and remove what a killed process has left in it and
    in its folders.

    Raises
    ------
    FailureError : it cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        for place in (folder, *(path for path in folder.iterdir() if path.is_dir() and not path.is_symlink())):
            remove_abandoned(place, ".", ".tmp")
    except OSError as error:
        raise FailureError(
            "the folder for the results cannot be used",
            where=str(folder),
            got=error.strerror,
            advice="choose another one with --output",
        ) from error


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
