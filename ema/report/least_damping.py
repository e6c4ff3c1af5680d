"""The least damping of a mode over the force levels, with the interval of whichever level it belongs to."""

from typing import NamedTuple

import numpy as np

from ema.data.placement import Place


class LeastDamping(NamedTuple):
    """The smallest damping ratio of a mode over the force levels.

    ``level`` is the row of the force level at which the predicted damping ratio is smallest, ``value`` the damping
    ratio there; ``low`` and ``high`` bound the smallest one with 95 %, whichever level it belongs to (NaN without
    intervals).
    """

    level: int
    value: float
    low: float
    high: float


def least_damping(place: Place, mode: int) -> LeastDamping:
    """The smallest damping ratio of a mode (a row) over the force levels.

    Which level has the least damping is as uncertain as the values are: a level that is predicted slightly higher and
    is less certain may have it. The least one exceeds no upper bound that its level keeps, so that the smallest of
    them bounds it; it is below the smallest lower bound at most as often as all levels are below theirs, added up
    (Boole).
    """
    level = int(np.nanargmin(place.damping[mode]))
    known = np.isfinite(place.damping[mode])
    low, high = (float(np.min(bounds[mode][known])) for bounds in (place.damping_low, place.damping_high))
    return LeastDamping(level, float(place.damping[mode, level]), low, high)
