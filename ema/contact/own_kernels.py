"""A law of the user's own: a C function of force and way for one contact; slopes by difference. State: the force."""

from ema.compiled import kernel
from ema.contact.call_kernels import (
    ACROSS,
    BY_FORCE,
    END,
    EXCESS,
    FIRST,
    FORCE,
    LIMIT,
    OWN,
    SLOPE,
    STIFFNESS,
    WAY,
    own_force,
)

_SMALL = 1e-7
"""Way of the difference over F_C/k_T: half the digits of the slope are right."""


@kernel
def own(group, rate, tables, exchange, states):
    """Increments of the contacts of a group; ``parameters``: up to four numbers for the function."""
    (parameters, _), (before, after) = tables, states
    function = group[OWN]
    for i in range(group[FIRST], group[END]):
        k, limit, way, start = exchange[STIFFNESS, i], exchange[LIMIT, i], exchange[WAY, i], before[i, 0]
        contact, numbers = (k, limit), (parameters[i, 0], parameters[i, 1], parameters[i, 2], parameters[i, 3])
        force = own_force(function, start, way, contact, numbers)
        tiny = _SMALL * max(limit, 1e-12) / k
        step = tiny if way >= 0.0 else -tiny
        slope = (own_force(function, start, way + step, contact, numbers) - force) / step
        if rate == 0.0 or group[ACROSS] > 0:
            # what follows the old force is asked for along slow paths and in two directions only
            change = _SMALL * max(limit, 1e-12) * (-1.0 if start > 0.0 else 1.0)
            after_change = own_force(function, start + change, way, contact, numbers)
            exchange[BY_FORCE, i] = (after_change - force) / change
        after[i, 0] = exchange[FORCE, i] = force
        exchange[EXCESS, i], exchange[SLOPE, i] = force - start - k * way, slope - k
