"""Masing (Jenkins) springs in parallel: Masing, Coulomb, n springs, Iwan. State: the force of every spring."""

from ema.compiled import kernel
from ema.contact.call_kernels import END, EXCESS, FIRST, FORCE, LIMIT, OWN, SLOPE, STIFFNESS, WAY


@kernel
def spring(group, rate, tables, exchange, states):
    """One spring per contact; without parameters."""
    before, after = states
    for i in range(group[FIRST], group[END]):
        k, top = exchange[STIFFNESS, i], exchange[LIMIT, i]
        trial = before[i, 0] + k * exchange[WAY, i]
        clipped = top if trial > top else (-top if trial < -top else trial)
        slides = (clipped != trial) | (top <= 0.0)
        after[i, 0] = exchange[FORCE, i] = clipped
        exchange[EXCESS, i] = clipped - trial
        exchange[SLOPE, i] = -k if slides else 0.0


@kernel
def springs(group, rate, tables, exchange, states):
    """Return map of Eq. (4) (Gaul, Roseira and Becker 2008).

    ``parameters``: stiffnesses of the springs, then their shares of the slip force.
    """
    (parameters, _), (before, after) = tables, states
    count = group[OWN]
    for i in range(group[FIRST], group[END]):
        limit, way = exchange[LIMIT, i], exchange[WAY, i]
        excess, force, slope = 0.0, 0.0, 0.0
        for j in range(count):
            k, top = parameters[i, j], limit * parameters[i, count + j]
            trial = before[i, j] + k * way
            clipped = top if trial > top else (-top if trial < -top else trial)
            # a spring without slip force slides even where it stands still
            slides = (clipped != trial) | (top <= 0.0)
            excess += clipped - trial
            slope -= k if slides else 0.0
            after[i, j] = clipped
            force += clipped
        exchange[EXCESS, i], exchange[FORCE, i], exchange[SLOPE, i] = excess, force, slope
