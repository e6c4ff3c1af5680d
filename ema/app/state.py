"""What the browser works on: the runs of a study, the poles picked in each, the impacts excluded; all with undo.

Nothing here knows of a page or a server.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import RLock

import numpy as np

from ema import shapes, store, synthesis
from ema.data import (
    FrfSet,
    HitGallery,
    ModalMap,
    ModalModel,
    Placement,
    PoleTable,
    Provenance,
    Repair,
    Run,
    RunResult,
    StudyResult,
)
from ema.errors import InputError
from ema.fit.modal import Estimate, estimated
from ema.fit.record_end import as_recorded
from ema.messages import text

_PICKED = "picked rows of the pole table"
_MOST_UNDONE = 200
"""Steps that can be taken back."""


@dataclass(frozen=True)
class Exclusion:
    """A impact that does not count: the name of its record, its number in it from 0, who says so and why."""

    record: str
    hit: int
    who: str
    why: str

    @property
    def reason(self) -> str:
        """As the gallery shows it."""
        return f"excluded by {self.who}: {self.why}"


Again = Callable[[str, Sequence[Exclusion]], tuple[FrfSet, HitGallery | None, PoleTable]]
"""FRFs, impacts and poles of a run when these impacts do not count."""


Look = Callable[[str], FrfSet]
"""FRFs of a run of the campaign, whether it was fitted or not."""


@dataclass(frozen=True)
class Work:
    """One run: its result as it stands, the rows of its pole table that are picked, and impacts excluded since it was
    opened."""

    result: RunResult
    picked: tuple[int, ...]
    excluded: tuple[Exclusion, ...] = ()


@dataclass(frozen=True)
class Moment:
    """Everything that undo brings back."""

    works: tuple[Work, ...]
    what: str


@dataclass
class Workbench:
    """A study that its user works on; every window shows the same one.

    Parameters
    ----------
    result : StudyResult
        The study.
    path : Path
        Where it is saved.
    again : Again, optional
        Computes a run again without some impacts; ``None`` where the signals are not available.
    keep : callable, optional
        Is called with every save, with the impacts of each run that were excluded since the study was opened.
    maps : tuple of ModalMap, optional
        Modal maps whose points lead to runs.
    place : int, default 0
        Position of the run that is shown, from 0.
    revision : int, default 0
        Counts the changes.
    saved : bool, default True
        Whether the last change is saved.
    who : str, optional
        Who works on it.
    placements : tuple of Placement, optional
        Where friction beams go.
    look : Look, optional
        Returns the FRFs behind a point of a map; ``None`` where the signals are not available.

    Raises
    ------
    InputError
        If the study has no run.

    Examples
    --------
    >>> from ema.data import RunResult
    >>> from ema.examples import campaign, frf_set, modal_model
    >>> runs = tuple(RunResult(run, frf_set(), None, modal_model()) for run in campaign().runs)
    >>> bench = Workbench(StudyResult(campaign(), runs), Path("study.h5"))
    >>> bench.choose("beam")
    >>> bench.place
    1
    """

    result: StudyResult
    path: Path
    again: Again | None = None
    keep: Callable[[Mapping[str, Sequence[Exclusion]]], None] | None = None
    maps: tuple[ModalMap, ...] = ()
    place: int = 0
    revision: int = 0
    saved: bool = True
    who: str = ""
    placements: tuple[Placement, ...] = ()
    look: Look | None = None
    _now: Moment = field(init=False)
    _estimates: dict[int, tuple[FrfSet, Estimate]] = field(init=False, default_factory=dict)
    _past: list[Moment] = field(init=False, default_factory=list)
    _lock: RLock = field(init=False, default_factory=RLock)

    def __post_init__(self) -> None:
        if not self.result.runs:
            raise InputError(
                "the study has no run to work on",
                where=str(self.path),
                advice='name a run with records or FRFs in a recipe, such as runs = ["bare"]',
            )
        self._now = Moment(tuple(Work(run, _picked(run)) for run in self.result.runs), "")

    @property
    def work(self) -> Work:
        """The run that is shown."""
        return self._now.works[self.place]

    @property
    def undoable(self) -> str:
        """What undo would take back; empty where there is nothing."""
        return self._now.what if self._past else ""

    def choose(self, run: str) -> None:
        """Show another run.

        Parameters
        ----------
        run : str
            Name of the run.

        Raises
        ------
        InputError
            If there is no such run.

        Examples
        --------
        >>> from ema.data import RunResult
        >>> from ema.examples import campaign, frf_set, modal_model
        >>> runs = tuple(RunResult(run, frf_set(), None, modal_model()) for run in campaign().runs)
        >>> bench = Workbench(StudyResult(campaign(), runs), Path("study.h5"))
        >>> bench.choose("beam")
        >>> bench.place
        1
        """
        names = [work.result.run.id for work in self._now.works]
        if run not in names:
            raise InputError("no such run", got=run, expected="one of " + ", ".join(names))
        self.place = names.index(run)
        self.revision += 1

    def pick(self, row: int) -> None:
        """Select a pole of the table as a mode, or drop it if it is selected; everything that follows from it follows.

        A pole that stands for a mode which is there already, in the same column, takes the place of the one before.

        Parameters
        ----------
        row : int
            Row of the pole table, from 0.

        Raises
        ------
        InputError
            If there is no such pole.

        Examples
        --------
        >>> from ema.examples import study_result
        >>> bench = Workbench(study_result(), Path("study.h5"))
        >>> bench.pick(3)
        >>> bench.as_result().runs[0].modes.natural_frequencies.round(1)
        array([40.])
        """
        with self._lock:
            work, poles = self.work, self._poles()
            if not 0 <= row < len(poles.poles):
                raise InputError("no such pole", got=row, expected=f"0 to {len(poles.poles) - 1}")
            frequency = f"{poles.natural_frequencies[row]:.5g} Hz"
            if row in work.picked:
                self._pick(
                    [other for other in work.picked if other != row], text("drop {frequency}", frequency=frequency)
                )
            elif (former := self._of_same_mode(row)) is not None:
                rows = [row if other == former else other for other in work.picked]
                self._pick(
                    rows,
                    text(
                        "swap {former} Hz for {frequency}",
                        former=f"{poles.natural_frequencies[former]:.5g}",
                        frequency=frequency,
                    ),
                )
            else:
                self._pick([*work.picked, row], text("pick {frequency}", frequency=frequency))

    def pick_near(self, frequency: float) -> None:
        """Select the most stable pole next to a frequency, as ``ema.fit.modes(near=...)`` does.

        Parameters
        ----------
        frequency : float
            Frequency [Hz].

        Raises
        ------
        InputError
            If there is no pole within 1 %.

        Examples
        --------
        >>> from ema.examples import study_result
        >>> bench = Workbench(study_result(), Path("study.h5"))
        >>> bench.pick_near(60.2)
        >>> bench.as_result().runs[0].modes.natural_frequencies.round(1)
        array([60.])
        """
        with self._lock:
            row = nearest(self._poles(), frequency)
            if row not in self.work.picked:
                self.pick(row)

    def drop(self, mode: int) -> None:
        """Drop a mode.

        Parameters
        ----------
        mode : int
            Position of the mode, from 0.

        Raises
        ------
        InputError
            If there is no such mode.

        Examples
        --------
        >>> from ema.examples import study_result
        >>> bench = Workbench(study_result(), Path("study.h5"))
        >>> bench.pick(3)
        >>> bench.drop(0)
        >>> len(bench.as_result().runs[0].modes.poles)
        0
        """
        with self._lock:
            work = self.work
            frequencies = work.result.modes.natural_frequencies
            if not 0 <= mode < len(frequencies):
                raise InputError("no such mode", got=mode + 1, expected=f"1 to {len(frequencies)}")
            picked = self._poles().natural_frequencies[list(work.picked)]
            gone = work.picked[int(np.argmin(np.abs(picked - frequencies[mode])))]
            self._pick(
                [row for row in work.picked if row != gone],
                text("drop {frequency}", frequency=f"{frequencies[mode]:.5g} Hz"),
            )

    def exclude(self, hit: int, why: str, who: str) -> None:
        """Leave an impact out of the averages, as a repair with a reason; FRFs, poles and modes are computed again.

        Parameters
        ----------
        hit : int
            Position in the gallery, from 0.
        why : str
            Reason.
        who : str
            Who decided it.

        Raises
        ------
        InputError
            If there is no such impact, no reason, no name, or no signals to compute from.

        Examples
        --------
        >>> from ema.examples import study_result
        >>> bench = Workbench(study_result(), Path("study.h5"))  # of ready FRFs, without impacts
        >>> try:
        ...     bench.exclude(0, why="double hit", who="A. Tester")
        ... except InputError as error:
        ...     print(error)
        no such impact; got 0, expected one of 0
        """
        with self._lock:
            work = self.work
            gallery = work.result.hits
            if gallery is None or not 0 <= hit < len(gallery.hits):
                raise InputError("no such impact", got=hit, expected=f"one of {len(gallery.hits) if gallery else 0}")
            impact, name = gallery.hits[hit], work.result.run.id
            if not why.strip() or not who.strip():
                raise InputError(
                    "an exclusion needs a reason and a name",
                    where=f"run {name}, {impact.recording}",
                    advice="say why the impact is left out and who decided it",
                )
            if self.again is None:
                raise InputError(
                    "the impact cannot be excluded: the signals are not available",
                    where=f"run {name}",
                    advice="open the campaign's folder or recipe instead of a result file",
                )
            excluded = (*work.excluded, Exclusion(impact.recording, impact.index, who.strip(), why.strip()))
            frfs, hits, poles = self.again(name, excluded)
            self.who = who.strip()
            repair = Repair(
                f"exclude hit {impact.index}", f"run {name}, files {impact.recording}", self.who, why.strip()
            )
            run = replace(work.result.run, repairs=(*work.result.run.repairs, repair))
            wanted = work.result.modes.natural_frequencies
            rows = list(dict.fromkeys(nearest(poles, float(frequency)) for frequency in wanted))
            base = replace(work.result, run=run, frfs=frfs, hits=hits, poles=poles)
            what = text("exclude impact {number} of {record}", number=impact.index + 1, record=impact.recording)
            self._keep(Work(self._picked(base, rows), tuple(rows), excluded), what)

    def undo(self) -> None:
        """Take back the last change of a run.

        Raises
        ------
        InputError
            If there is nothing to take back.

        Examples
        --------
        >>> from ema.examples import study_result
        >>> bench = Workbench(study_result(), Path("study.h5"))
        >>> bench.pick(3)
        >>> bench.undo()
        >>> len(bench.as_result().runs[0].modes.poles)
        0
        """
        with self._lock:
            if not self._past:
                raise InputError("there is nothing to undo")
            self._now = self._past.pop()
            self.saved = False
            self.revision += 1

    def save(self) -> Path:
        """Write the study as it stands, whole or not at all; exclusions go to the campaign as repairs.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        FailureError
            If the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> from ema.data import RunResult
        >>> from ema.examples import campaign, frf_set, modal_model
        >>> runs = tuple(RunResult(run, frf_set(), None, modal_model()) for run in campaign().runs)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     Workbench(StudyResult(campaign(), runs), Path(folder, "study.h5")).save().name
        'study.h5'
        """
        with self._lock:
            store.save(self.path, self.as_result())
            if self.keep is not None:
                self.keep({work.result.run.id: work.excluded for work in self._now.works})
            self.saved = True
            self.revision += 1
            return self.path

    def as_result(self) -> StudyResult:
        """Return the study as it stands.

        Returns
        -------
        StudyResult
            The study with the runs as they were changed.

        Examples
        --------
        >>> from ema.data import RunResult
        >>> from ema.examples import campaign, frf_set, modal_model
        >>> runs = tuple(RunResult(run, frf_set(), None, modal_model()) for run in campaign().runs)
        >>> len(Workbench(StudyResult(campaign(), runs), Path("study.h5")).as_result().runs)
        2
        """
        runs = tuple(work.result for work in self._now.works)
        repairs = dict.fromkeys([*self.result.repairs, *(repair for run in runs for repair in run.run.repairs)])
        return replace(self.result, runs=runs, repairs=tuple(repairs))

    def behind(self, chart: int, level: int, force: int) -> str:
        """Return the run that lies next to a point of a map; level and normal force are compared in octaves.

        Parameters
        ----------
        chart : int
            Position of the map, from 0.
        level : int
            Row of the force level.
        force : int
            Column of the normal force.

        Returns
        -------
        str
            Name of the run.

        Raises
        ------
        InputError
            If there is no such point, or no run states a force level and a normal force.

        Examples
        --------
        >>> from ema.data import RunResult
        >>> from ema.examples import campaign, frf_set, modal_map, modal_model
        >>> runs = tuple(RunResult(run, frf_set(), None, modal_model()) for run in campaign().runs)
        >>> bench = Workbench(StudyResult(campaign(), runs), Path("study.h5"), maps=(modal_map(),))
        >>> bench.behind(0, level=1, force=1)
        'beam'
        """
        return self._nearest([work.result.run for work in self._now.works], chart, level, force)

    def seen_at(self, chart: int, level: int, force: int) -> tuple[str, FrfSet]:
        """Return the run of the campaign next to a point of a map, fitted or not, and its FRFs.

        Parameters
        ----------
        chart : int
            Position of the map, from 0.
        level : int
            Row of the force level.
        force : int
            Column of the normal force.

        Returns
        -------
        tuple of (str, FrfSet)
            Name of the run, and its FRFs.

        Raises
        ------
        InputError
            If there is no such point, no run near it, or no signals to compute from.

        Examples
        --------
        >>> from ema.data import RunResult
        >>> from ema.examples import campaign, frf_set, modal_map, modal_model
        >>> runs = tuple(RunResult(run, frf_set(), None, modal_model()) for run in campaign().runs)
        >>> bench = Workbench(StudyResult(campaign(), runs), Path("study.h5"), maps=(modal_map(),))
        >>> bench.seen_at(0, level=1, force=1)[0]
        'beam'
        """
        fitted = {work.result.run.id: work.result for work in self._now.works}
        others = [run for run in self.result.campaign.runs if run.id not in fitted]
        name = self._nearest([*(one.run for one in fitted.values()), *others], chart, level, force)
        if name in fitted:
            return name, fitted[name].frfs
        if self.look is None:
            raise InputError(
                "the FRFs behind this point cannot be shown: the signals are not available",
                where=f"run {name}",
                advice="open the campaign's folder or recipe instead of a result file",
            )
        return name, self.look(name)

    def _nearest(self, runs: Sequence[Run], chart: int, level: int, force: int) -> str:
        """The run next to a point of a map; of equal ones, the first."""
        if not 0 <= chart < len(self.maps):
            raise InputError("no such map", got=chart + 1, expected=f"one of {len(self.maps)}")
        modal_map = self.maps[chart]
        if not (0 <= level < len(modal_map.force_levels) and 0 <= force < len(modal_map.normal_forces)):
            raise InputError(
                "no such point of the map",
                got=f"level {level}, force {force}",
                expected=f"level 0 to {len(modal_map.force_levels) - 1}, force 0 to {len(modal_map.normal_forces) - 1}",
            )
        wanted = np.array([modal_map.force_levels[level], modal_map.normal_forces[force]])
        distances = {}
        for run in runs:
            pair = np.array([run.condition.excitation.level, run.condition.normal_force])
            if np.isfinite(pair).all() and (pair > 0).all():
                distances[run.id] = float(np.linalg.norm(np.log2(pair / wanted)))
        if not distances:
            raise InputError(
                "no run lies behind this point",
                where=modal_map.name,
                expected="runs with a force level and a normal force",
            )
        return min(distances, key=lambda name: distances[name])

    def _poles(self) -> PoleTable:
        poles = self.work.result.poles
        if poles is None:
            raise InputError(
                "this run has no stabilisation diagram to pick from",
                where=self.work.result.run.id,
                advice="put the poles of ema.fit.stabilise into the result (RunResult.poles)",
            )
        return poles

    def _pick(self, rows: Sequence[int], what: str) -> None:
        work = self.work
        self._keep(replace(work, result=self._picked(work.result, rows), picked=tuple(rows)), what)

    def _picked(self, run: RunResult, rows: Sequence[int]) -> RunResult:
        """The run with the modes of these rows; the fit of all poles does not depend on them and is kept."""
        return _with_modes(run, self._estimate(run).model(index=rows), rows) if rows else _without_modes(run)

    def _estimate(self, run: RunResult) -> Estimate:
        source, known = self._estimates.get(self.place, (None, None))
        if known is None or source is not run.frfs or known.table is not run.poles:
            assert run.poles is not None
            known = estimated(run.frfs.in_memory(), run.poles)
            self._estimates[self.place] = run.frfs, known
        return known

    def _of_same_mode(self, row: int) -> int | None:
        """The picked row of the mode that another row stands for too; ``None`` where it is another mode."""
        picked, known, poles = self.work.picked, self._estimate(self.work.result), self._poles()
        if not picked or len(known.model(index=[*picked, row]).poles) > len(known.model(index=picked).poles):
            return None
        (pole,) = known.model(index=[row]).poles
        return picked[int(np.argmin(np.abs(poles.poles[list(picked)] - pole)))]

    def _keep(self, work: Work, what: str) -> None:
        works = tuple(work if place == self.place else other for place, other in enumerate(self._now.works))
        self._past = [*self._past, self._now][-_MOST_UNDONE:]
        self._now = Moment(works, what)
        self.saved = False
        self.revision += 1


def _without_modes(run: RunResult) -> RunResult:
    """The run with no mode picked."""
    nothing = replace(
        run.modes,
        poles=np.zeros(0, complex),
        shapes=run.modes.shapes[:, :0],
        covariance=None,
        confidence=None,
        participation=run.modes.participation[:, :0],
        residuals=None,
        uncertainty=None,
        findings=(),
        groups=(),
        candidates=(),
    )
    nothing = replace(nothing, provenance=_noted(nothing.provenance, ()))
    return replace(run, modes=nothing, quality=None, reconstruction=None, reconstruction_error=None, auto_mac=None)


def _with_modes(run: RunResult, modes: ModalModel, rows: Sequence[int]) -> RunResult:
    """The run with the modes picked by rows of its pole table, and all that follows from them."""
    assert run.poles is not None
    modes = replace(modes, provenance=_noted(modes.provenance, rows))
    band = run.frfs.band(*run.poles.band).in_memory()
    alone = as_recorded(_alone(modes, run.poles.band), band)
    synthesised = synthesis.frfs(alone, band.frequencies, band.quantity, outputs=band.outputs, inputs=band.inputs)
    synthesised = replace(synthesised, name=f"{run.run.id}, synthesis", unit=band.unit)
    size = np.linalg.norm(band.values, axis=0)
    error = np.linalg.norm(band.values - synthesised.values, axis=0)
    return replace(
        run,
        modes=modes,
        quality=shapes.quality(modes.shapes),
        reconstruction=synthesised,
        reconstruction_error=np.divide(error, size, out=np.full(size.shape, np.nan), where=size > 0),
        auto_mac=shapes.auto_mac(modes.shapes),
    )


def _alone(modes: ModalModel, band: tuple[float, float]) -> ModalModel:
    """The model without the poles that the fit keeps as background inside the band: what is dropped is to be missed."""
    rest = modes.residuals
    if rest is None or rest.residues is None:
        return modes
    outside = (np.abs(rest.poles) < 2 * np.pi * band[0]) | (np.abs(rest.poles) > 2 * np.pi * band[1])
    return replace(modes, residuals=replace(rest, poles=rest.poles[outside], residues=rest.residues[outside]))


def nearest(poles: PoleTable, frequency: float) -> int:
    """Row of the stable pole of the highest order next to a frequency in Hz.

    Raises
    ------
    InputError : no pole within 1 %.
    """
    distance = np.abs(poles.natural_frequencies - frequency)
    close = np.flatnonzero(distance <= 0.01 * abs(frequency))
    if not len(close):
        raise InputError("no pole near that frequency", got=f"{frequency:g} Hz", expected="a pole within 1 %")
    merit = np.isin(poles.letter[close], ["s", "d", "v"]) + poles.order[close] / poles.order.max()
    return int(close[np.argmax(merit - distance[close] / (0.001 * abs(frequency)))])


def _noted(origin: Provenance, rows: Sequence[int]) -> Provenance:
    """Provenance that says which poles were picked by hand."""
    options = [option for option in origin.options if option[0] != _PICKED]
    return replace(origin, options=(*options, (_PICKED, ", ".join(map(str, rows)))))


def _picked(run: RunResult) -> tuple[int, ...]:
    """The rows that a run's modes came from: as noted, or those next to modes that were selected automatically."""
    noted = dict(run.modes.provenance.options).get(_PICKED)
    if noted is not None:
        return tuple(int(row) for row in noted.split(", ") if row)
    if run.poles is None or not len(run.poles.poles):
        return ()
    rows = []
    for frequency in run.modes.natural_frequencies:
        try:
            rows.append(nearest(run.poles, float(frequency)))
        except InputError:
            continue
    return tuple(dict.fromkeys(rows))
