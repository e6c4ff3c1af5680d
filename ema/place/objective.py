"""What a good place is: one number per place and normal force."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ema.data.placement import Prediction
from ema.errors import InputError


@dataclass(frozen=True)
class Objective:
    """How places are judged, at the normal force common to all force levels and modes that serves them best.

    Parameters
    ----------
    aim : ``damping`` (weighted mean over the target modes), ``least damping`` (the worst of the modes),
        ``geometric mean`` (over the modes), or ``peak reduction`` (dB by which the worst resonance peak of the force
        response, and with it the most negative real part that sets the chatter limit, comes down).
    over_levels : ``least`` (the worst force level: robust) or ``mean`` of the levels.
    mode_weights : of ``damping``, one per target mode; equal by default.
    """

    aim: str = "damping"
    over_levels: str = "least"
    mode_weights: tuple[float, ...] | None = None

    def __str__(self) -> str:
        return f"{self.aim}, {self.over_levels} over the force levels"


def scores(
    prediction: Prediction,
    objective: Objective,
    damping: Float[np.ndarray, "*draw candidate mode level force"] | None = None,
) -> Float[np.ndarray, "*draw candidate force"]:
    """Value of the objective at every place and normal force; -inf where a mode was not found.

    ``damping`` replaces that of the prediction (draws for intervals, the few of a shortlist).

    Raises
    ------
    InputError : an unknown aim, or weights that do not fit the modes.
    """
    values = np.asarray(prediction.damping if damping is None else damping)
    if objective.aim == "damping":
        joined = np.einsum("...mlf,m->...lf", values, _weights(objective, len(prediction.modes)))
    elif objective.aim == "least damping":
        joined = values.min(axis=-3)
    elif objective.aim == "geometric mean":
        joined = np.exp(np.mean(np.log(np.maximum(values, 1e-12)), axis=-3))
    elif objective.aim == "peak reduction":
        joined = 20 * np.log10(values / prediction.bare_damping[:, None, None]).min(axis=-3)
    else:
        raise InputError("not an aim of a placement", where="objective", got=objective.aim,
                         expected="damping, least damping, geometric mean or peak reduction")  # fmt: skip
    over = joined.min(axis=-2) if objective.over_levels == "least" else joined.mean(axis=-2)
    return np.where(np.isfinite(over), over, -np.inf)


def best_forces(prediction: Prediction, objective: Objective, candidate: int) -> Int[np.ndarray, "level"]:
    """For every force level, which of the normal forces serves the modes best there."""
    one = prediction.damping[candidate : candidate + 1]
    picks = [scores(prediction, objective, one[:, :, row : row + 1])[0].argmax() for row in range(one.shape[2])]
    return np.array(picks, dtype=np.int64)


def _weights(objective: Objective, modes: int) -> Float[np.ndarray, "mode"]:
    given: Sequence[float] = objective.mode_weights if objective.mode_weights is not None else np.ones(modes).tolist()
    weights = np.asarray(given, dtype=np.float64)
    if weights.shape != (modes,) or np.any(weights < 0) or not weights.sum() > 0:
        raise InputError("weights do not fit the modes", where="objective", got=list(given),
                         expected=f"{modes} numbers of 0 or more, not all 0")  # fmt: skip
    return np.asarray(weights / weights.sum())
