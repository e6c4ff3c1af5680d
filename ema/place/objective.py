"""What a good place is: one number per place and normal force."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from ema.data.placement import Prediction
from ema.errors import InputError

IN_DECIBELS = ("peak reduction", "chatter")
"""Aims in dB above the bare structure; the others are damping ratios."""
AIMS = ("damping", "least damping", "geometric mean", *IN_DECIBELS)


@dataclass(frozen=True)
class Objective:
    """How locations are judged, at the normal force common to all force levels and modes that serves them best.

    Parameters
    ----------
    aim : str, default "damping"
        ``damping`` (weighted mean over the target modes), ``least damping`` (the worst of the modes), ``geometric
        mean`` (over the modes), ``peak reduction`` (dB by which the highest of the target modes' peaks of the response
        comes down) or ``chatter`` (dB by which the most negative real part of the receptance at the excited point, a
        tool, comes up: it sets the stable depth of cut).
    over_levels : str, default "least"
        ``least`` (the worst force level) or ``mean`` of the levels.
    mode_weights : tuple of float, optional
        Of ``damping``, one per target mode; equal by default.
    robust : bool, default False
        Whether place and normal force are chosen by the lower end of the 95 % interval of the value, not by the value.
        The normal force that is best at each level (``recommended_forces``) stays that of the value.

    Examples
    --------
    >>> Objective(aim="least damping").over_levels
    'least'
    """

    aim: str = "damping"
    over_levels: str = "least"
    mode_weights: tuple[float, ...] | None = None
    robust: bool = False

    def __str__(self) -> str:
        chosen = ", lower end of its 95 % interval" if self.robust else ""
        return f"{self.aim}, {self.over_levels} over the force levels{chosen}"


def scores(prediction: Prediction, objective: Objective) -> Float[np.ndarray, "candidate force"]:
    """Value of the objective at every place and normal force; -inf where a mode was not found.

    Raises
    ------
    InputError : an unknown aim, or weights that do not fit the modes.
    """
    if objective.aim in IN_DECIBELS:
        joined = _decibels(prediction, objective.aim == "chatter")
    else:
        joined = _of_modes(np.asarray(prediction.damping), objective)
    over = joined.min(axis=1) if objective.over_levels == "least" else joined.mean(axis=1)
    return np.where(np.isfinite(over), over, -np.inf)


def of_bare(prediction: Prediction, objective: Objective) -> float:
    """Value of the objective without the beam: of the damping of the bare modes, or 0 dB."""
    if objective.aim in IN_DECIBELS:
        return 0.0
    return float(_of_modes(prediction.bare_damping[None, :, None, None], objective)[0, 0, 0])


def _of_modes(
    damping: Float[np.ndarray, "candidate mode level force"], objective: Objective
) -> Float[np.ndarray, "candidate level force"]:
    """Value of the damping of all modes."""
    if objective.aim == "damping":
        return np.asarray(np.einsum("cmlf,m->clf", damping, _weights(objective, damping.shape[1])))
    if objective.aim == "least damping":
        return np.asarray(damping.min(axis=1))
    if objective.aim == "geometric mean":
        return np.asarray(np.exp(np.mean(np.log(np.maximum(damping, 1e-12)), axis=1)))
    raise InputError("not an aim of a placement", where="objective", got=objective.aim, expected=", ".join(AIMS))


def _decibels(prediction: Prediction, chatter: bool) -> Float[np.ndarray, "candidate level force"]:
    """Reduction in dB of the highest peak, or of the most negative real part at the excited point.

    Of a mode alone the latter is the peak over 2 (1 + zeta) (Tlusty).
    """
    weight = np.abs(prediction.driver * (prediction.driver if chatter else prediction.output))[:, None, None]
    omega, zeta = 2 * np.pi * prediction.bare_frequencies, prediction.bare_damping

    def worst(stiffness: np.ndarray, damping: np.ndarray) -> np.ndarray:
        return np.asarray((weight / (stiffness * (1 + damping if chatter else 1))).max(axis=-3))

    bare = worst((2 * zeta * omega**2)[:, None, None], zeta[:, None, None])
    return np.asarray(20 * np.log10(bare / worst(prediction.stiffness, prediction.damping)))


def of_rows(prediction: Prediction, rows: Sequence[int] | Int[np.ndarray, "row"]) -> Prediction:
    """The prediction of some of its candidates."""
    picked, held = np.asarray(rows, dtype=np.int64), prediction.candidates
    few = replace(held, centres=held.centres[picked], angles=held.angles[picked], beams=held.beams[picked])
    return replace(
        prediction,
        candidates=few,
        frequency=prediction.frequency[picked],
        damping=prediction.damping[picked],
        stiffness=prediction.stiffness[picked],
        slip=prediction.slip[picked],
    )


def at_level(prediction: Prediction, row: int) -> Prediction:
    """The prediction at one force level."""
    part = slice(row, row + 1)
    return replace(
        prediction,
        force_levels=prediction.force_levels[part],
        frequency=prediction.frequency[:, :, part],
        damping=prediction.damping[:, :, part],
        stiffness=prediction.stiffness[:, :, part],
        slip=prediction.slip[:, :, part],
    )


def recommended_forces(prediction: Prediction, objective: Objective, candidate: int) -> Float[np.ndarray, "level"]:
    """Return the normal force that serves the modes best at every force level.

    Between the normal forces of the prediction by a parabola in their logarithm.

    Parameters
    ----------
    prediction : Prediction
        Modes with a beam at every candidate.
    objective : Objective
        How the modes are judged.
    candidate : int
        Row of the candidate.

    Returns
    -------
    array of shape (level,)
        Normal force per joint [N]; an end of the range of the prediction where the best is there, NaN where there is no
        value.

    Examples
    --------
    >>> from ema.examples import ranking
    >>> recommended_forces(ranking().prediction, Objective(), candidate=0).round(0)
    array([403., 400.])
    """
    chosen = of_rows(prediction, [candidate])
    forces = np.log(prediction.normal_forces)
    result = np.full(len(prediction.force_levels), np.nan)
    for row in range(len(result)):
        values = scores(at_level(chosen, row), objective)[0]
        top = int(values.argmax())
        if not np.isfinite(values[top]):
            continue
        result[row] = np.exp(forces[top])
        if 0 < top < len(forces) - 1 and np.all(np.isfinite(values[top - 1 : top + 2])):
            left, right = forces[top - 1] - forces[top], forces[top + 1] - forces[top]
            below, above = (values[top - 1] - values[top]) / left, (values[top + 1] - values[top]) / right
            bend = (above - below) / (right - left)
            shift = -(below - bend * left) / (2 * bend) if bend < 0 else 0.0
            result[row] = np.exp(forces[top] + np.clip(shift, left, right))
    return result


def _weights(objective: Objective, modes: int) -> Float[np.ndarray, "mode"]:
    given: Sequence[float] = objective.mode_weights if objective.mode_weights is not None else np.ones(modes).tolist()
    weights = np.asarray(given, dtype=np.float64)
    if weights.shape != (modes,) or np.any(weights < 0) or not weights.sum() > 0:
        raise InputError(
            "weights do not fit the modes",
            where="objective",
            got=list(given),
            expected=f"{modes} numbers of 0 or more, not all 0",
        )
    return np.asarray(weights / weights.sum())
