"""A whole placement: modes of the bare structure and a recipe -> ranking, beams together, control study, warning."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from ema.data import Finding, Geometry, ModalModel, Provenance
from ema.data.comparison import Verdict
from ema.data.forecast import Forecast
from ema.data.placement import Candidates, ControlStudy, Place, Placement, Ranking
from ema.data.trials import Trials
from ema.errors import InputError
from ema.place.bands import ForecastSettings, forecast
from ema.place.beams_choice import BeamsSearch, about_beams, as_option
from ema.place.beams_search import search_together
from ema.place.candidates import about_keep_out, grid
from ema.place.conditioning import updated
from ema.place.control import control_study
from ema.place.ranking import SearchSettings, search
from ema.place.recipe import DoneTable, PlaceRecipe, TrialsTable
from ema.place.shortlist import KeptPlaces
from ema.place.targets import refuse_modes_with_a_beam, target_task, under_conditions
from ema.place.task import Task
from ema.place.trials import TrialCondition, next_tests
from ema.progress import Progress, silent

_UNSUITABLE = ("holes", "unsolved", "joint-parts")
"""Findings that say why places do not count."""


def place(
    recipe: PlaceRecipe,
    bare: ModalModel,
    geometry: Geometry,
    verdict: Verdict | None = None,
    *,
    executor: Executor | None = None,
    kept: KeptPlaces | None = None,
    progress: Progress = silent,
) -> Placement:
    """Answer a recipe for a structure of which the modes without the beam are known.

    Parameters
    ----------
    recipe : PlaceRecipe
        Beam, candidates, target modes, objective and forces.
    bare : ModalModel
        Mass-normalised modes without the beam, at the points of ``geometry``.
    geometry : Geometry
        Points at which the beam may stand, in m.
    verdict : Verdict, optional
        Of the joint model against a measurement, where there is one. With a model that does not agree the placement
        carries a warning for the first line; :func:`refuse_disagreement` refuses it beforehand.
    executor : Executor, optional
        Runs the checks of the search, the forecast and the tests; by default they run in this process.
    kept : KeptPlaces, optional
        Where every finished check is kept and, when resuming, taken from.
    progress : Progress, optional
        Called after each step with what it is.

    Returns
    -------
    Placement
        Ranking of the places, forecast and next tests at the best ones, and findings. Where the recipe asks for several
        beams, those that were chosen to act together are a finding, and :func:`ema.place.beams_choice.chosen_beams`
        of it.

    Raises
    ------
    InputError
        The modes were measured with a beam, there is no such target mode, no place was found; or as
        :func:`ema.place.search`.
    """
    where = bare.name or "bare structure"
    refuse_modes_with_a_beam(bare, where)
    task, hung = target_task(recipe, bare, geometry, where)
    surface, effort, wanted = task.surface, recipe.search, recipe.wanted()
    candidates = grid(
        surface, recipe.catalogue(), effort.step, np.radians(effort.angles).tolist(), recipe.keep_out(), effort.margin
    )
    ranking = search(
        task,
        candidates,
        wanted,
        SearchSettings(effort.shortlist, effort.keep, effort.draws, effort.seed),
        executor,
        kept,
        progress,
    )
    if not ranking.places:
        raise InputError(
            "no place was found",
            where=where,
            got=" ".join(one.message for one in ranking.findings if one.code in _UNSUITABLE),
            advice="press more, excite less, or take another beam",
        )
    together = _together(recipe, task, candidates, ranking, progress)
    study = _control(recipe, task, candidates, ranking.best, progress)
    predicted, tests, beyond = _forecast(recipe, task, candidates, ranking, executor, progress)
    return Placement(
        recipe.title or f"Friction beam on {where}",
        ranking,
        surface.origin,
        surface.axes,
        surface.extent,
        surface.points,
        recipe.keep_out(),
        _warning(verdict),
        study,
        (
            *ranking.findings,
            *about_keep_out(surface, recipe.keep_out()),
            *recipe.former_names,
            *hung,
            *beyond,
            *about_verdict(verdict),
            *(about_beams(choice) for choice in together),
        ),
        Provenance(
            steps=("ema.place",),
            options=(("recipe", recipe.model_dump_json()), *(as_option(choice) for choice in together)),
        ),
        geometry,
        predicted,
        tests,
    )


def refuse_disagreement(verdict: Verdict | None, where: str) -> None:
    """Refuse a joint model that does not agree with its measurement.

    Parameters
    ----------
    verdict : Verdict or None
        Of the joint model against a measurement; None where there is no measurement.
    where : str
        The structure or the recipe, for the message.

    Raises
    ------
    InputError
        The model does not agree.

    Examples
    --------
    >>> refuse_disagreement(None, "table")
    """
    if verdict is not None and not verdict.agrees:
        raise InputError(
            "the joint model does not agree with the measurement",
            where=where,
            got=" ".join(verdict.sentences),
            expected="a model that agrees",
            advice="update the model; `ema place --anyway` places with it all the same",
        )


def _together(
    recipe: PlaceRecipe, task: Task, candidates: Candidates, ranking: Ranking, progress: Progress
) -> tuple[BeamsSearch, ...]:
    """The beams that act together, where the recipe asks for several."""
    wanted = recipe.search
    if wanted.beams == 1:
        return ()
    choice = search_together(
        task,
        candidates,
        ranking.places,
        beams=wanted.beams,
        objective=recipe.wanted(),
        most_mass=np.inf if wanted.most_mass is None else wanted.most_mass,
        progress=progress,
    )
    return (choice,)


def _control(
    recipe: PlaceRecipe, task: Task, candidates: Candidates, best: Place, progress: Progress
) -> ControlStudy | None:
    """What a controlled normal force would bring at the best place, where the recipe asks for it."""
    if recipe.control is None:
        return None
    return control_study(
        task,
        candidates,
        best,
        recipe.control.load,
        lag=recipe.control.lag,
        objective=recipe.wanted(),
        progress=progress,
    )


def _forecast(
    recipe: PlaceRecipe,
    task: Task,
    candidates: Candidates,
    ranking: Ranking,
    executor: Executor | None,
    progress: Progress,
) -> tuple[Forecast | None, Trials | None, tuple[Finding, ...]]:
    """The forecast that the recipe asks for, if any, with its tests, and what is to be known about the modes behind."""
    table = recipe.forecast
    if table is None:
        return None, None, ()
    best, levels = ranking.best.candidate, table.force or recipe.force
    forces = _with_recommended(table.normal_force, ranking.best.normal_force)
    task, beyond = under_conditions(table, task, levels, forces)
    settings = ForecastSettings(table.draws, table.seed, table.method)
    if recipe.trials is None:
        return forecast(task, candidates, best, settings, executor, progress), None, beyond
    next_best = ranking.places[1 : 1 + recipe.trials.places]
    others = [TrialCondition(one.candidate, max(levels), one.normal_force) for one in next_best]
    candidates, done = _done(recipe.trials, candidates, best, levels=levels, forces=forces)
    tests = next_tests(
        task,
        candidates,
        best,
        settings=settings,
        others=[*(condition for condition, _ in done if condition is not None), *others],
        costs=recipe.trials.costs(),
        executor=executor,
        progress=progress,
    )
    for _, one in done:
        tests = _after(tests, one)
    return tests.forecast, tests, beyond


def _with_recommended(forces: Sequence[float], recommended: float) -> list[float]:
    """Normal forces of a forecast, the recommended one among them."""
    return list(forces) if any(np.isclose(forces, recommended)) else sorted([*forces, recommended])


def _done(
    table: TrialsTable, candidates: Candidates, best: int, *, levels: Sequence[float], forces: Sequence[float]
) -> tuple[Candidates, list[tuple[TrialCondition | None, DoneTable]]]:
    """Tests that have been done, and the candidates with their places; no spot under a condition of the forecast."""
    result: list[tuple[TrialCondition | None, DoneTable]] = []
    for one in table.done:
        if one.centre is None and any(np.isclose(one.force, levels)) and any(np.isclose(one.normal_force, forces)):
            result.append((None, one))
            continue
        centre = candidates.centres[best] if one.centre is None else np.array(one.centre)
        angle = candidates.angles[best] if one.centre is None else np.radians(one.angle)
        candidates = replace(
            candidates,
            centres=np.vstack([candidates.centres, centre]),
            angles=np.append(candidates.angles, angle),
            beams=np.append(candidates.beams, candidates.beams[best]),
        )
        result.append((TrialCondition(len(candidates) - 1, one.force, one.normal_force), one))
    return candidates, result


def _after(tests: Trials, done: DoneTable) -> Trials:
    """The tests once one of them has been done."""
    prediction = tests.forecast
    centre, angle = (
        (prediction.centre, prediction.angle) if done.centre is None else (tuple(done.centre), np.radians(done.angle))
    )
    for number, trial in enumerate(tests.trials):
        where = [*trial.centre, trial.angle, trial.force_level, trial.normal_force]
        if trial.kind == "beam" and np.allclose(where, [*centre, angle, done.force, done.normal_force], atol=1e-9):
            read = dict.fromkeys(trial.readings, np.nan)
            for what, values in (("f [Hz]", done.frequency), ("zeta [-]", done.damping)):
                known = np.array(values, np.float64).tolist()  # None is NaN
                read.update({f"mode {mode}: {what}": one for mode, one in zip(prediction.modes, known, strict=False)})
            return updated(tests, number, [read[name] for name in trial.readings])
    raise InputError(
        "the forecast expects no reading of this test",
        where="trials.done",
        got=f"F_E {done.force:g} N, F_N {done.normal_force:g} N",
        expected="a condition in which the joints hold and a peak belongs to the mode",
    )


def _warning(verdict: Verdict | None) -> str:
    if verdict is None or verdict.agrees:
        return ""
    return "THE JOINT MODEL DOES NOT AGREE WITH THE MEASUREMENT; this placement was asked for anyway. " + " ".join(
        verdict.sentences
    )


def about_verdict(verdict: Verdict | None) -> tuple[Finding, ...]:
    """Whether the joint model was compared with no measurement."""
    if verdict is not None:
        return ()
    return (
        Finding(
            "info",
            "not-compared",
            "joint",
            "the joint model was not compared with a measurement.",
            None,
            None,
            "Compare it with a measured map, and name the result as agreement.",
        ),
    )
