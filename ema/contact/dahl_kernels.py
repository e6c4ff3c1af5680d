"""Dahl's law in closed form (Dahl 1968). State: the force."""

import numpy as np

from ema.compiled import inner, kernel
from ema.contact.call_kernels import BY_FORCE, END, EXCESS, FIRST, FORCE, LIMIT, SLOPE, STIFFNESS, WAY


@inner
def dahl_step(k, limit, alpha, du, f0):
    """Force, slope df1/du and tangent df1/df0 of dF/du = k |1 - sgn(v) F/F_C|^alpha after the way ``du``.

    What the force changes by is computed itself, as rounding of a large F_C would swamp it as a difference.
    """
    if limit <= 0.0:
        return 0.0, 0.0, 0.0
    sign = 1.0 if du >= 0.0 else -1.0
    way = k * abs(du) / limit
    y0 = min(max(1.0 - sign * f0 / limit, 0.0), 2.0)
    start = min(max(f0, -limit), limit)
    if alpha == 1.0:
        fade = np.exp(-way)
        return start - sign * limit * y0 * np.expm1(-way), k * y0 * fade, fade
    if y0 == 0.0:
        return start, 0.0, 0.0
    used = (1.0 - alpha) * way * y0 ** (alpha - 1.0)
    change = np.expm1(np.log1p(-used) / (1.0 - alpha)) if used < 1.0 else -1.0
    fade = (1.0 + change) ** alpha
    return start - sign * limit * y0 * change, k * y0**alpha * fade, fade


@kernel
def dahl(group, rate, tables, exchange, states):
    """Increments of the contacts of a group; ``parameters``: the exponent."""
    (parameters, _), (before, after) = tables, states
    for i in range(group[FIRST], group[END]):
        k, way = exchange[STIFFNESS, i], exchange[WAY, i]
        force, slope, exchange[BY_FORCE, i] = dahl_step(k, exchange[LIMIT, i], parameters[i, 0], way, before[i, 0])
        after[i, 0] = exchange[FORCE, i] = force
        exchange[EXCESS, i], exchange[SLOPE, i] = force - before[i, 0] - k * way, slope - k
