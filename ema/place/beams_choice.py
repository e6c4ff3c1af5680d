"""Several beams that were chosen to act together, and what a placement keeps of them."""

import json
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data import Finding
from ema.data.placement import Candidates, Placement
from ema.place.location import Location
from ema.place.objective import IN_DECIBELS
from ema.place.task import only

OPTION = "beams together"
"""Name under which the provenance of a placement keeps the beams that were chosen: a file of any version has room."""


@dataclass(frozen=True, kw_only=True)
class BeamsSearch:
    """Several beams that were chosen to act together.

    Parameters
    ----------
    locations : tuple of Location
        Where the beams go, in the order in which they were chosen.
    rows : tuple of int
        Their rows in the candidates.
    normal_forces : array of shape (beam,)
        F_N per joint [N] of every beam.
    objective : str
        The objective in words.
    alone : float
        Value of the objective [-, or dB] of the best beam alone.
    values : array of shape (step,)
        Value of the objective [-, or dB] with the first beam, with every one that was added, and after every exchange.
    rounds : int
        Rounds of exchanges.
    cases : int
        Sets of beams and normal forces that were computed.

    Examples
    --------
    >>> here = (Location(centre=(0.1, 0.1)), Location(centre=(0.4, 0.1)))
    >>> BeamsSearch(
    ...     locations=here, rows=(4, 7), normal_forces=np.array([50.0, 80.0]), objective="damping", alone=0.01,
    ...     values=np.array([0.01, 0.016]), rounds=1, cases=120,
    ... ).gain
    1.6
    """

    locations: tuple[Location, ...]
    rows: tuple[int, ...]
    normal_forces: Float[np.ndarray, "beam"]
    objective: str
    alone: float
    values: Float[np.ndarray, "step"]
    rounds: int
    cases: int

    @property
    def gain(self) -> float:
        """Value of the objective over that of the best beam alone; of an objective in dB the ratio of the levels."""
        if self.in_decibels:
            return float(10 ** ((self.values[-1] - self.alone) / 20))
        return float(self.values[-1] / self.alone)

    @property
    def in_decibels(self) -> bool:
        """Whether the values are levels in dB, and not damping ratios."""
        return self.objective.startswith(IN_DECIBELS)


def as_option(choice: BeamsSearch) -> tuple[str, str]:
    """What the provenance of a placement keeps of a choice: rows of its candidates, their F_N, and how they came."""
    kept = {
        "rows": choice.rows,
        "normal_forces": choice.normal_forces.tolist(),
        "alone": choice.alone,
        "values": choice.values.tolist(),
        "rounds": choice.rounds,
        "cases": choice.cases,
    }
    return OPTION, json.dumps(kept)


def chosen_beams(placement: Placement) -> BeamsSearch | None:
    """The beams of a placement that act together; ``None`` where it is for a single beam."""
    text = dict(placement.provenance.options).get(OPTION)
    if text is None:
        return None
    kept, candidates = json.loads(text), placement.ranking.prediction.candidates
    return BeamsSearch(
        locations=tuple(Location.of(candidates, row) for row in kept["rows"]),
        rows=tuple(kept["rows"]),
        normal_forces=np.array(kept["normal_forces"]),
        objective=placement.ranking.objective,
        alone=kept["alone"],
        values=np.array(kept["values"]),
        rounds=kept["rounds"],
        cases=kept["cases"],
    )


def chosen_candidates(placement: Placement) -> Candidates | None:
    """The beams that act together as candidates of their own; ``None`` where there are none."""
    choice = chosen_beams(placement)
    return None if choice is None else only(placement.ranking.prediction.candidates, choice.rows)


def about_beams(choice: BeamsSearch) -> Finding:
    """The choice as a finding of a placement: what it is, and how it was searched."""
    listed = "; ".join(
        f"{one}, F_N {force:g} N" for one, force in zip(choice.locations, choice.normal_forces, strict=True)
    )
    value, alone = (
        f"{one:.4g} dB" if choice.in_decibels else f"{100 * one:.4g} %" for one in (choice.values[-1], choice.alone)
    )
    return Finding.of(
        "info",
        "several-beams",
        "search",
        "{count} beams that act together: {listed}. Their objective ({objective}) is {value}, that of the best "
        "beam alone {alone}, by all modes and the first harmonic. They were chosen one after the other, then "
        "exchanged in {rounds} rounds, over {cases} cases in all: this need not be the best set.",
        choice.gain,
        advice="Their forecast with bands is that of `ema predict --together`.",
        count=len(choice.locations),
        listed=listed,
        objective=choice.objective,
        value=value,
        alone=alone,
        rounds=choice.rounds,
        cases=choice.cases,
    )
