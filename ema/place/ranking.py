"""Ranking of places: all by the predictor, a shortlist with all modes together, the best with intervals and flags."""

from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ema.data.placement import Candidates, Place, Prediction, Ranking
from ema.place.flags import about_holes, about_points, flags, shifts
from ema.place.intervals import samples
from ema.place.objective import Objective, of_rows, recommended_forces, scores
from ema.place.predictor import motions
from ema.place.shortlist import verify
from ema.place.task import Task, only, predicted
from ema.progress import Progress, advance, silent


def rank(
    task: Task,
    candidates: Candidates,
    objective: Objective | None = None,
    keep: int = 10,
    draws: int = 200,
    seed: int = 0,
    progress: Progress = silent,
) -> Ranking:
    """The best places for a friction beam by the one-mode predictor, with normal forces and 95 % intervals.

    The intervals carry the uncertainty of the smoothed shapes and of mu and k_T (``BoltedJoint``); they do not carry
    what the one-mode predictor leaves out: that is what ``search`` checks.

    Parameters
    ----------
    keep : number of places to return.
    draws : samples for the intervals; 0 for none.

    Raises
    ------
    InputError : see ``ema.place.predict``.
    """
    wanted = Objective() if objective is None else objective
    prediction = predicted(task, candidates)
    advance(progress, "places", len(candidates), len(candidates))
    total = scores(prediction, wanted).max(axis=1)
    order = _best(total, keep)
    places = _described(task, prediction, wanted, order, None, draws, seed, progress)
    return Ranking(str(wanted), prediction, total, places, (*about_points(task), *about_holes(prediction)))


def search(
    task: Task,
    candidates: Candidates,
    objective: Objective | None = None,
    shortlist: int = 20,
    keep: int = 10,
    draws: int = 200,
    seed: int = 0,
    executor: Executor | None = None,
    folder: str | Path | None = None,
    resume: bool = False,
    progress: Progress = silent,
) -> Ranking:
    """The best places in two stages: all candidates by the predictor, the shortlist with all modes together.

    The shortlist holds the best by the predictor, and half as many with the largest difference of the rotations of
    their joints: what the predictor misjudges most often bends most. The harmonic balance of the full model decides;
    intervals of the predictor are moved to it.

    Parameters
    ----------
    shortlist : number of places by the predictor that are checked.
    executor : where the checks run (threads, processes, a cluster's); here and now by default.
    folder : where every finished check is kept; with ``resume`` those of the same question are taken from there.

    Raises
    ------
    InputError : see ``ema.place.predict``.
    FailureError : a worker died; finished checks are kept.
    """
    wanted = Objective() if objective is None else objective
    prediction = predicted(task, candidates)
    advance(progress, "places", len(candidates), len(candidates))
    total = scores(prediction, wanted).max(axis=1)
    ranked = [*_best(total, shortlist), *_best(_bending(task, candidates), shortlist // 2)]
    rows = np.array(list(dict.fromkeys(ranked)), dtype=np.int64)
    checked = verify(task, prediction, rows, executor, folder, resume, progress)
    order = _best(scores(checked, wanted).max(axis=1), keep)
    places = _described(task, prediction, wanted, rows[order], of_rows(checked, order), draws, seed, progress)
    return Ranking(
        str(wanted),
        prediction,
        total,
        places,
        (*about_points(task), *about_holes(prediction), *checked.findings),
        tuple(int(row) for row in rows),
        checked,
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


def _described(
    task: Task,
    prediction: Prediction,
    objective: Objective,
    rows: np.ndarray,
    checked: Prediction | None,
    draws: int,
    seed: int,
    progress: Progress,
) -> tuple[Place, ...]:
    """The places of some rows of the prediction, with the numbers of ``checked`` where they were checked."""
    few = of_rows(prediction, rows)
    drawn = (
        samples(task, only(prediction.candidates, rows), draws, np.random.default_rng(seed), progress)
        if draws and len(rows)
        else ()
    )
    decisive = few if checked is None else checked
    by_force = scores(decisive, objective)
    return tuple(
        _place(task, objective, int(row), number, few, decisive, int(by_force[number].argmax()), drawn)
        for number, row in enumerate(rows)
    )


def _place(
    task: Task,
    objective: Objective,
    row: int,
    number: int,
    few: Prediction,
    decisive: Prediction,
    force: int,
    drawn: tuple[Prediction, ...],
) -> Place:
    damping, alone = decisive.damping[number, :, :, force], few.damping[number, :, :, force]
    score = float(scores(decisive, objective)[number, force])
    low, high, score_low, score_high = np.full_like(damping, np.nan), np.full_like(damping, np.nan), np.nan, np.nan
    if drawn:
        ratio = damping / alone
        low, high = ratio * np.nanquantile([one.damping[number, :, :, force] for one in drawn], [0.025, 0.975], axis=0)
        judged = np.array([scores(of_rows(one, [number]), objective)[0, force] for one in drawn])
        offset = score - float(scores(few, objective)[number, force])
        if np.isfinite(judged).any() and np.isfinite(offset):
            score_low, score_high = offset + np.quantile(judged[np.isfinite(judged)], [0.025, 0.975])
    held = few.candidates
    kind = int(held.beams[number])
    normal_force = float(few.normal_forces[force])
    mass, stiffness = shifts(task, held, number, normal_force)
    return Place(
        row,
        (float(held.centres[number, 0]), float(held.centres[number, 1])),
        float(held.angles[number]),
        held.catalogue[kind].name or f"beam {kind + 1}",
        score,
        float(score_low),
        float(score_high),
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
        None if decisive is few else alone,
    )
