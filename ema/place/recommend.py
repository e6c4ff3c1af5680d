"""How a given sum of normal forces is shared among the joints of one beam."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel
from ema.data.placement import Candidates
from ema.errors import InputError
from ema.place.model import model_at
from ema.place.predictor import predict
from ema.place.task import Task

LEAST_SHARE = 0.02
"""Share of the total normal force that every joint has at least: with none it would be no joint."""
_TOLERANCE = 5e-3
"""Relative error of the simulation that is aimed at."""


class Distribution(NamedTuple):
    """Normal forces of the joints in N, and the least damping over the force levels with them and with equal ones."""

    normal_forces: Float[np.ndarray, "joint"]
    damping: float
    equal_damping: float


def distribute(
    task: Task, candidates: Candidates, place: int, total: float, mode: int | None = None, evaluations: int = 60
) -> Distribution:
    """Share a sum of normal forces among the joints of a beam for the most damping of one mode.

    The least damping over the force levels of the task counts, with all modes together; the simplex search starts from
    equal forces. No joint gets less than 2 % of the sum.

    Parameters
    ----------
    task : Task
        Structure, joint and target modes.
    candidates : Candidates
        Locations of the beam.
    place : int
        Row in ``candidates``.
    total : float
        Sum of the normal forces [N].
    mode : int, optional
        Row of the bare modes; the first target mode by default.
    evaluations : int, default 60
        Evaluations of the full model at every force level.

    Returns
    -------
    Distribution
        Normal forces of the joints [N], and the least damping with them and with equal forces.

    Raises
    ------
    InputError
        If the sum is not positive, there is no such candidate, the mode is no target of the task, or the model is not
        to be evaluated.

    Examples
    --------
    >>> from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
    >>> from ema.examples import plate
    >>> from ema.place import grid
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> surface = smooth(bare, geometry)
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003)
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([50.0]), modes=(0,))
    >>> spots = grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.2)
    >>> shared = distribute(task, spots, 0, total=100.0, evaluations=4)
    >>> round(float(shared.normal_forces.sum()), 9), shared.damping >= shared.equal_damping
    (100.0, True)
    """
    from scipy.optimize import minimize

    if not (np.isfinite(total) and total > 0):
        raise InputError("not a sum of normal forces", where=f"place {place}", got=f"{total} N", expected="above 0 N")
    if not 0 <= place < len(candidates):
        raise InputError("there is no such candidate", got=place, expected=f"0 to {len(candidates) - 1}")
    if evaluations < 1:
        raise InputError("no evaluation of the model", where=f"place {place}", got=evaluations, expected="1 or more")
    chosen = task.modes[0] if mode is None else mode
    joints = candidates.catalogue[int(candidates.beams[place])].joints
    each = total / joints
    model = model_at(task, candidates, place, each)
    band = _band(task, candidates, place, chosen, total / joints)

    def least(logits: Float[np.ndarray, "free"]) -> float:
        return _least_damping(model, task, total * _shares(logits), band)

    start = np.zeros(joints - 1)
    equal = least(start)
    simplex = np.vstack([start, *(0.7 * row for row in np.eye(joints - 1))])
    optimum = minimize(
        lambda logits: -least(logits),
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": evaluations, "xatol": 0.02, "fatol": 1e-3 * equal},
    )
    return Distribution(total * _shares(optimum.x), max(float(-optimum.fun), equal), equal)


def _shares(logits: Float[np.ndarray, "free"]) -> Float[np.ndarray, "joint"]:
    """Shares from numbers without bounds; all zero: equal ones."""
    parts = np.exp(np.append(logits, 0.0) - max(0.0, float(logits.max())))
    shares = parts / parts.sum()
    return np.asarray(LEAST_SHARE + (1 - LEAST_SHARE * len(shares)) * shares)


def _band(task: Task, candidates: Candidates, place: int, mode: int, force: float) -> tuple[float, float]:
    """Where the mode may go: the predicted frequencies from a tenth to ten times the normal force, a little wider."""
    from ema.place.task import only

    wide = task._replace(modes=(mode,), normal_forces=force * np.geomspace(0.1, 10, 7))
    frequency = predict(wide, only(candidates, [place])).frequency
    return 0.96 * float(np.nanmin(frequency)), 1.04 * float(np.nanmax(frequency))


def _least_damping(
    model: BeamModel, task: Task, forces: Float[np.ndarray, "joint"], band: tuple[float, float]
) -> float:
    from ema.simulate import resonances

    peaks = resonances(model.with_normal_force(forces.tolist()), task.force_levels, task.at, task.at, band, _TOLERANCE)
    return min(peak.damping for peak in peaks)
