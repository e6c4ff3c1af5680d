"""Ranking of places: all by the predictor, a shortlist with all modes together, the best with intervals and flags."""

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ema.data import Finding
from ema.data.placement import Candidates, Place, Prediction, Ranking
from ema.deprecation import fields_as_arguments
from ema.errors import InputError
from ema.messages import mark
from ema.place.flags import about_holes, about_points, flags, shifts
from ema.place.intervals import samples
from ema.place.objective import IN_DECIBELS, Objective, of_bare, of_rows, recommended_forces, scores
from ema.place.predictor import motions, predict
from ema.place.shortlist import KeptPlaces, verify
from ema.place.task import Task
from ema.progress import Progress, advance, silent


@dataclass(frozen=True)
class SearchSettings:
    """How thorough a search for the best locations is.

    Parameters
    ----------
    shortlist : int, default 20
        Number of locations by the predictor that are checked.
    keep : int, default 10
        Number of locations to return.
    draws : int, default 200
        Samples for the intervals; 0 for none.
    seed : int, default 0
        Seed of the draws.

    Examples
    --------
    >>> SearchSettings(shortlist=8).keep
    10
    """

    shortlist: int = 20
    keep: int = 10
    draws: int = 200
    seed: int = 0


DEFAULTS = SearchSettings()


def rank(
    task: Task,
    candidates: Candidates,
    objective: Objective | None = None,
    keep: int = 10,
    draws: int = 200,
    seed: int = 0,
    progress: Progress = silent,
) -> Ranking:
    """Rank the candidate locations by the one-mode predictor, with normal forces and 95 % intervals.

    The intervals contain the uncertainty of the smoothed shapes and of mu and k_T (``BoltedJoint``); they do not
    contain what the one-mode predictor leaves out: that is what :func:`search` checks.

    Parameters
    ----------
    task : Task
        Structure, joint, forces and target modes.
    candidates : Candidates
        Locations of the beam.
    objective : Objective, optional
        How locations are judged.
    keep : int, default 10
        Number of locations to return.
    draws : int, default 200
        Samples for the intervals; 0 for none.
    seed : int, default 0
        Seed of the draws.
    progress : Progress, optional
        Called during the computation.

    Returns
    -------
    Ranking
        The best locations, best first.

    Raises
    ------
    InputError
        As ``ema.place.predict``.

    Examples
    --------
    >>> from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
    >>> from ema.examples import plate
    >>> from ema.place import Task, grid
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> surface = smooth(bare, geometry)
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003)
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([20.0, 50.0]), modes=(0,))
    >>> spots = grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.1)
    >>> len(rank(task, spots, keep=3, draws=0).places)
    3
    """
    wanted = Objective() if objective is None else objective
    prediction = predict(task, candidates)
    advance(progress, "places", len(candidates), len(candidates))
    total = scores(prediction, wanted).max(axis=1)
    draw = _Draws(draws, seed, progress)
    places = _described(task, wanted, np.arange(len(candidates)), prediction, prediction, keep, draw)
    findings = (
        *about_points(task),
        *about_holes(prediction),
        *_about_range(task, places),
        *_about_gain(prediction, wanted, places),
    )
    return Ranking(str(wanted), prediction, total, places, findings)


@fields_as_arguments("settings", SearchSettings)
def search(
    task: Task,
    candidates: Candidates,
    objective: Objective | None = None,
    settings: SearchSettings = DEFAULTS,
    executor: Executor | None = None,
    kept: KeptPlaces | None = None,
    progress: Progress = silent,
) -> Ranking:
    """Search the best locations in two stages: all candidates by the predictor, the shortlist with all modes together.

    The shortlist holds the best by the predictor, and half as many with the largest difference of the rotations of
    their joints: what the predictor misjudges most often bends most. The harmonic balance of the full model decides;
    intervals of the predictor are moved to it.

    Parameters
    ----------
    task : Task
        Structure, joint, forces and target modes.
    candidates : Candidates
        Locations of the beam.
    objective : Objective, optional
        How locations are judged.
    settings : SearchSettings, optional
        How many locations are checked and returned, and the draws of their intervals.
    executor : Executor, optional
        Where the checks run (threads, processes, a cluster's); in this process by default.
    kept : KeptPlaces, optional
        Where every finished check is kept and, when resuming, taken from.
    progress : Progress, optional
        Called during the computation.

    Returns
    -------
    Ranking
        The best locations, best first.

    Raises
    ------
    InputError
        As ``ema.place.predict``.
    FailureError
        If a worker died; finished checks are kept.

    Examples
    --------
    >>> from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
    >>> from ema.examples import plate
    >>> from ema.place import SearchSettings, Task, grid
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> surface = smooth(bare, geometry)
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003)
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([50.0]), modes=(0,))
    >>> spots = grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.2)
    >>> search(task, spots, settings=SearchSettings(shortlist=1, keep=1, draws=0)).places[0].method
    'all modes'
    """
    wanted = Objective() if objective is None else objective
    prediction = predict(task, candidates)
    advance(progress, "places", len(candidates), len(candidates))
    total = scores(prediction, wanted).max(axis=1)
    ranked = [*_best(total, settings.shortlist), *_best(_bending(task, candidates), settings.shortlist // 2)]
    rows = np.array(list(dict.fromkeys(ranked)), dtype=np.int64)
    checked = verify(task, prediction, rows, executor, kept, progress)
    draw = _Draws(settings.draws, settings.seed, progress)
    places = _described(task, wanted, rows, of_rows(prediction, rows), checked, settings.keep, draw)
    return Ranking(
        str(wanted),
        prediction,
        total,
        places,
        (
            *about_points(task),
            *about_holes(prediction),
            *checked.findings,
            *_about_range(task, places),
            *_about_gain(prediction, wanted, places),
        ),
        tuple(int(row) for row in rows),
        checked,
    )


def _about_range(task: Task, places: tuple[Place, ...]) -> tuple[Finding, ...]:
    """Whether the best place wants the smallest or the largest normal force that was asked for."""
    tried = np.sort(task.normal_forces)
    if not places or len(tried) < 2 or places[0].normal_force not in (tried[0], tried[-1]):
        return ()
    best = places[0].normal_force
    end, beyond = (mark("smallest"), mark("smaller")) if best == tried[0] else (mark("largest"), mark("larger"))
    return (
        Finding.of(
            "warning",
            "edge-of-range",
            "rank 1",
            "the best normal force, {best} N, is the {end} of those asked: a {beyond} one may serve better.",
            best,
            advice="Ask for {beyond} normal forces too, or take it as what the joint allows.",
            best=f"{best:g}",
            end=end,
            beyond=beyond,
        ),
    )


def _about_gain(prediction: Prediction, objective: Objective, places: tuple[Place, ...]) -> tuple[Finding, ...]:
    """Whether no place is better than the bare structure."""
    bare = of_bare(prediction, objective)
    best = max((one.score for one in places), default=np.inf)
    if best > bare:
        return ()
    scale, unit = (1.0, "dB") if objective.aim in IN_DECIBELS else (100.0, "%")
    return (
        Finding.of(
            "warning",
            "no-gain",
            "placement",
            "the objective is {best} {unit} at the best place and {bare} {unit} without the beam.",
            best,
            bare,
            advice="Ask for other normal forces, or take another beam.",
            best=f"{scale * best:.4g}",
            bare=f"{scale * bare:.4g}",
            unit=unit,
        ),
    )


def _best(values: Float[np.ndarray, "candidate"], count: int) -> np.ndarray:
    """Rows of the largest finite values, the largest first."""
    order = np.argsort(-values, kind="stable")[:count]
    return np.asarray(order[np.isfinite(values[order])])


def _bending(task: Task, candidates: Candidates) -> Float[np.ndarray, "candidate"]:
    """Squared relative rotation of the outer joints over the squared frequency, summed over the target modes."""
    _, lever = motions(task.surface, candidates, task.joint, task.modes)
    omega = np.abs(task.bare.poles[list(task.modes)])
    return np.asarray((((lever[:, -1] - lever[:, 0]) / omega) ** 2).sum(axis=1))


class _Draws(NamedTuple):
    """How many draws the intervals take."""

    draws: int
    seed: int
    progress: Progress

    def of(self, task: Task, few: Prediction) -> tuple[Prediction, ...]:
        """Predictions of the same locations under drawn parameters; none where no draws are asked for."""
        if not self.draws or not len(few.candidates):
            return ()
        return samples(task, few.candidates, self.draws, np.random.default_rng(self.seed), self.progress)


class _Judged(NamedTuple):
    """Value of the objective at every location and normal force, -inf where there is none, and its 95 % interval."""

    value: Float[np.ndarray, "place force"]
    low: Float[np.ndarray, "place force"]
    high: Float[np.ndarray, "place force"]

    def by(self, objective: Objective) -> Float[np.ndarray, "place force"]:
        """What decides."""
        return np.where(np.isfinite(self.low), self.low, -np.inf) if objective.robust else self.value


def _judged(objective: Objective, few: Prediction, decisive: Prediction, drawn: tuple[Prediction, ...]) -> _Judged:
    """The value of ``decisive``, and the interval of the draws of the one-mode prediction ``few`` moved to it."""
    value = scores(decisive, objective)
    if not drawn:
        return _Judged(value, np.full_like(value, np.nan), np.full_like(value, np.nan))
    each, alone = np.array([scores(one, objective) for one in drawn]), scores(few, objective)
    known = np.isfinite(each).any(axis=0) & np.isfinite(value) & np.isfinite(alone)
    quantiles = np.nanquantile(np.where(np.isfinite(each) | ~known, each, np.nan), [0.025, 0.975], axis=0)
    offset = np.subtract(value, alone, out=np.zeros_like(value), where=known)
    low, high = np.where(known, offset + quantiles, np.nan)
    return _Judged(value, low, high)


def _described(
    task: Task,
    objective: Objective,
    rows: np.ndarray,
    few: Prediction,
    decisive: Prediction,
    keep: int,
    draw: _Draws,
) -> tuple[Place, ...]:
    """The best of the locations in ``rows`` of all candidates.

    ``few`` is their prediction by the one-mode predictor; ``decisive`` has the values that count: those of ``few``
    itself, or with all modes together.

    Raises
    ------
    InputError : a robust choice without draws.
    """
    if objective.robust and not draw.draws:
        raise InputError(
            "a robust choice needs intervals", where="search", got="draws = 0", expected="draws above 0, such as 200"
        )
    drawn = draw.of(task, few) if objective.robust else ()
    order = _best(_judged(objective, few, decisive, drawn).by(objective).max(axis=1), keep)
    few, decisive = of_rows(few, order), of_rows(decisive, order)
    drawn = tuple(of_rows(one, order) for one in drawn) if objective.robust else draw.of(task, few)
    judged = _judged(objective, few, decisive, drawn)
    return tuple(
        replace(_place(task, objective, number, few, decisive, drawn, judged), candidate=int(row))
        for number, row in enumerate(rows[order])
    )


def _place(
    task: Task,
    objective: Objective,
    number: int,
    few: Prediction,
    decisive: Prediction,
    drawn: tuple[Prediction, ...],
    judged: _Judged,
) -> Place:
    """One location of ``few``, at the normal force that its objective prefers."""
    force = int(judged.by(objective)[number].argmax())
    damping, alone = decisive.damping[number, :, :, force], few.damping[number, :, :, force]
    low, high = np.full_like(damping, np.nan), np.full_like(damping, np.nan)
    if drawn:
        ratio = damping / alone
        low, high = ratio * np.nanquantile([one.damping[number, :, :, force] for one in drawn], [0.025, 0.975], axis=0)
    candidates = few.candidates
    kind = int(candidates.beams[number])
    normal_force = float(few.normal_forces[force])
    mass, stiffness = shifts(task, candidates, number, normal_force)
    return Place(
        number,
        (float(candidates.centres[number, 0]), float(candidates.centres[number, 1])),
        float(candidates.angles[number]),
        candidates.catalogue[kind].name or f"beam {kind + 1}",
        float(judged.value[number, force]),
        float(judged.low[number, force]),
        float(judged.high[number, force]),
        normal_force,
        recommended_forces(decisive, objective, number),
        decisive.frequency[number, :, :, force],
        damping,
        low,
        high,
        mass,
        stiffness,
        flags(task, few, number, force),
        decisive.method,
        None if decisive.method == few.method else alone,
    )
