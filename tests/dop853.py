"""Equations of motion by DOP853 as Hairer, Norsett and Wanner (1993) wrote it, for truths in time."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import ode


def dop853(
    motion: Callable[[float, list[float]], Sequence[float]], start: Sequence[float], times: np.ndarray, **options: float
) -> np.ndarray:
    """States (state, time) of ``y' = motion(t, y)`` from ``start`` at zero; ``rtol``, ``atol``, ``first_step``, ``max_step``.

    The method is that of ``scipy.integrate.solve_ivp``, whose steps in Python take six times as long. Steps end at each
    time, so that nothing is interpolated.
    """
    path = ode(lambda t, y: motion(t, y.tolist())).set_integrator("dop853", nsteps=10**7, **options)
    path.set_initial_value(start)
    states = np.array([path.integrate(time) if time > 0 else np.array(start, float) for time in times]).T
    assert path.successful()
    return states
