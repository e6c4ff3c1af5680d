"""Where several beams go: one after the other with those before in place, then exchanged one at a time."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ema.data.placement import Candidates, Place, Prediction
from ema.errors import InputError
from ema.place.beams_choice import BeamsSearch
from ema.place.beams_forecast import beams_question, overlap
from ema.place.fundamental import MAJORITY, fundamental, shares
from ema.place.location import Location
from ema.place.objective import Objective, scores
from ema.place.predictor import shapes_at
from ema.place.recipe import ROBUST_TOGETHER
from ema.place.task import Task, only
from ema.progress import Progress, advance, silent

STARTS = 2
"""Locations of a single beam, the best ones, at which the search begins.

On 16 plates with random modes (10 locations, 40 pairs) a single start misses the best pair in 4 of 32 searches, by 30 %
at most, and two starts in none. On 32 further plates, after that choice, two starts miss it in 2 of 64, by 31 %.
"""
ROUNDS = 2
"""Rounds of exchanges at most: a bound on the work."""
GAIN = 1e-6
"""Relative gain of the objective from which on a beam moves: what is less is rounding of the search for a peak."""


class _Pressed(NamedTuple):
    """A candidate and its normal force [N]."""

    row: int
    force: float


class _Set(NamedTuple):
    """Beams that were chosen, the value of the objective after every step, and the rounds of exchanges."""

    chosen: list[_Pressed]
    values: list[float]
    rounds: int


def search_together(
    task: Task,
    candidates: Candidates,
    ranked: Sequence[Place],
    *,
    beams: int,
    objective: Objective | None = None,
    most_mass: float = np.inf,
    progress: Progress = silent,
) -> BeamsSearch:
    """Choose locations and normal forces of several beams: one after the other, then exchanged.

    The first beam is at the best of the ranked locations, and in a second search at the next one; the better set
    counts. Each further beam goes, with a normal force of its own, where the objective is largest with those before in
    place. Then every beam in turn may move, and be pressed otherwise, while the others stay, until no move improves the
    objective or two rounds are done. Sets are judged with all modes together and the first harmonic of the friction.
    A set that spreads a target mode over several resonances, of which none holds half of it, is not taken: a forecast
    states nothing of such a mode. Beams do not overlap with their whole length and width; areas that are kept free are
    those that the candidates leave out.

    Parameters
    ----------
    task : Task
        Structure, joint, forces and target modes.
    candidates : Candidates
        Locations of the beams; one may be taken by every beam of the catalogue.
    ranked : sequence of Place
        Locations for a single beam, best first, as of :func:`search` with these candidates.
    beams : int
        How many beams, two or more.
    objective : Objective, optional
        How sets are judged.
    most_mass : float, default inf
        Mass [kg] of all beams at most.
    progress : Progress, optional
        Called after each location.

    Returns
    -------
    BeamsSearch
        Beams, normal forces, and what was searched.

    Raises
    ------
    InputError
        If there are fewer than two beams, the objective is robust, or no further beam fits.

    Examples
    --------
    >>> from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
    >>> from ema.examples import plate
    >>> from ema.place import Task, grid, rank
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> surface = smooth(bare, geometry)
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003)
    >>> spots = grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.1, angles=[0.0])
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([20.0]), modes=(0,))
    >>> chosen = search_together(task, spots, rank(task, spots, draws=0).places, beams=2)
    >>> len(chosen.locations), chosen.rounds <= 2, chosen.gain >= 1
    (2, True, True)
    """
    wanted = Objective() if objective is None else objective
    _check(beams, wanted)
    search = _Search(task, candidates, wanted, most_mass, beams, progress)
    sets = [search.begun_at(first) for first in search.starts(ranked)]
    best = max(sets, key=lambda one: one.values[-1])
    return BeamsSearch(
        locations=tuple(Location.of(candidates, one.row) for one in best.chosen),
        rows=tuple(one.row for one in best.chosen),
        normal_forces=np.array([one.force for one in best.chosen]),
        objective=str(wanted),
        alone=max(one.values[0] for one in sets),
        values=np.array(best.values),
        rounds=best.rounds,
        cases=search.cases,
    )


def _check(beams: int, objective: Objective) -> None:
    if beams < 2:
        raise InputError("not a number of several beams", where="search", got=beams, expected="2 or more")
    if objective.robust:
        raise InputError(
            "several beams are not chosen by the lower end of an interval",
            where="objective",
            got=str(objective),
            expected="robust = false",
            advice=ROBUST_TOGETHER,
        )


class _Search:
    """Sets of candidates and normal forces, and what they reach."""

    def __init__(
        self,
        task: Task,
        candidates: Candidates,
        objective: Objective,
        most_mass: float,
        beams: int,
        progress: Progress,
    ) -> None:
        self.task, self.candidates, self.objective = task, candidates, objective
        self.most_mass, self.beams, self.progress = most_mass, beams, progress
        self.mass = np.array([beam.mass for beam in candidates.catalogue])[candidates.beams]
        self.cases = 0

    def fits(self, others: Sequence[_Pressed]) -> Int[np.ndarray, "row"]:
        """Rows of the candidates that overlap none of the others and leave mass for the beams still to come."""
        to_come = self.beams - len(others) - 1
        whole = self.mass + sum(self.mass[one.row] for one in others) + to_come * self.mass.min()
        free = whole <= self.most_mass * (1 + 1e-12)
        for one in others:
            free &= ~overlap(only(self.candidates, [one.row]), self.candidates)
        return np.flatnonzero(free)

    def starts(self, ranked: Sequence[Place]) -> list[_Pressed]:
        """The best of the ranked locations that leave mass for the others, and have a resonance of every mode."""
        free, firsts = set(self.fits([]).tolist()), list[_Pressed]()
        for one in ranked:
            first = _Pressed(one.candidate, one.normal_force)
            if len(firsts) < STARTS and one.candidate in free and np.isfinite(self.value([], first)):
                firsts.append(first)
        if not firsts:
            raise self._full(0)
        return firsts

    def begun_at(self, first: _Pressed) -> _Set:
        """The first beam, then one after the other, then exchanged."""
        chosen, values = [first], [self.value([], first)]
        while len(chosen) < self.beams:
            best, value = self.best(chosen)
            chosen.append(best)
            values.append(value)
        rounds, moved = 0, True
        while moved and rounds < ROUNDS:
            rounds, moved = rounds + 1, False
            for number in range(self.beams):
                best, value = self.best(chosen[:number] + chosen[number + 1 :])
                if value > values[-1] + GAIN * abs(values[-1]):
                    chosen[number], moved = best, True
                    values.append(value)
        return _Set(chosen, values, rounds)

    def value(self, others: Sequence[_Pressed], added: _Pressed) -> float:
        """Value of the objective with all of them; -inf where a mode has no resonance."""
        return self._values(others, added.row, [added.force])[0]

    def best(self, others: Sequence[_Pressed]) -> tuple[_Pressed, float]:
        """The location and normal force that serve the others best.

        Raises
        ------
        InputError : none fits, or none has a resonance of every mode.
        """
        rows, forces = self.fits(others), np.unique(self.task.normal_forces).tolist()
        found, best = _Pressed(-1, 0.0), -np.inf
        for number, row in enumerate(rows.tolist()):
            values = self._values(others, row, forces)
            if max(values) > best:
                best = max(values)
                found = _Pressed(row, forces[values.index(best)])
            advance(self.progress, "beams together", number + 1, len(rows))
        if found.row < 0:
            raise self._full(len(others))
        return found, best

    def _full(self, count: int) -> InputError:
        limit = "" if np.isinf(self.most_mass) else f", and weigh at most {self.most_mass:g} kg together"
        return InputError(
            "no further beam fits",
            where="search",
            got=f"{count} of {self.beams} beams",
            expected="beams that do not overlap and have a resonance of every target mode" + limit,
            advice="ask for fewer beams, a finer step, or lighter ones",
        )

    def _values(self, others: Sequence[_Pressed], row: int, forces: Sequence[float]) -> list[float]:
        """Value of the objective for each normal force of the beam in ``row``, with the others as they are."""
        beams = [only(self.candidates, [one]) for one in (row, *(one.row for one in others))]
        peaks = np.full((3, 1, len(self.task.modes), len(self.task.force_levels), len(forces)), np.nan)
        for column, force in enumerate(forces):
            pressed = [force, *(one.force for one in others)]
            asked = beams_question(self.task._replace(normal_forces=np.array([force])), beams, pressed)
            frequency, damping, opening, height = fundamental(asked)[..., 0].swapaxes(0, 1)
            parted = (opening >= 1) & (asked.pressure is not None)
            # of a mode that is spread over several resonances a forecast states nothing
            spread_out = shares(asked) < MAJORITY
            peaks[:, 0, ..., column] = np.where(parted | spread_out, np.nan, [frequency, damping, height])
            self.cases += 1
        return [float(one) for one in scores(self._prediction(row, forces, peaks), self.objective)[0]]

    def _prediction(
        self, row: int, forces: Sequence[float], peaks: Float[np.ndarray, "3 1 mode level force"]
    ) -> Prediction:
        """What the objective judges, from Hz, damping ratio and height: the set as the candidate that was added."""
        task, (frequency, damping, height) = self.task, peaks
        modes = list(task.modes)
        poles, driver = task.bare.poles[modes], shapes_at(task.bare, task.at)[modes]
        return Prediction(
            only(self.candidates, [row]),
            task.modes,
            np.abs(poles) / (2 * np.pi),
            -poles.real / np.abs(poles),
            task.force_levels,
            np.array(forces),
            frequency,
            damping,
            # as where a shortlist is checked: the drive phi^2 F of the bare mode over |X|
            driver[:, None, None] ** 2 * task.force_levels[:, None] / height,
            np.full_like(damping, np.nan),
            driver,
            driver if task.output is None else shapes_at(task.bare, task.output)[modes],
            method="all modes",
        )
