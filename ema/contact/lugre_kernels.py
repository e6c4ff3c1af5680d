"""LuGre (Canudas de Wit et al. 1995). State: the force of the bristles, what the velocity adds, and the way before."""

import numpy as np

from ema.compiled import kernel
from ema.contact.call_kernels import END, EXCESS, FIRST, FORCE, LIMIT, SLOPE, STIFFNESS, WAY


@kernel
def lugre(group, rate, tables, exchange, states):
    """Increments of the contacts of a group; ``parameters``: sigma_1, sigma_2, F_S/F_C, Stribeck velocity.

    The velocity at the end comes from the last two increments, of second order in the step. Where the motion is slow no
    velocity is left behind: what follows begins at rest.
    """
    (parameters, _), (before, after) = tables, states
    for i in range(group[FIRST], group[END]):
        k, limit, way, start = exchange[STIFFNESS, i], exchange[LIMIT, i], exchange[WAY, i], before[i, 0] + before[i, 1]
        damping, viscous, peak, stribeck = parameters[i, 0], parameters[i, 1], parameters[i, 2] - 1.0, parameters[i, 3]
        bristle, force, slope = 0.0, 0.0, 0.0
        if limit > 0.0:
            sign = 1.0 if way >= 0.0 else -1.0
            end = 0.5 * rate * (3.0 * way - before[i, 2])
            top = limit * (1.0 + peak * np.exp(-((way * rate / stribeck) ** 2)))
            # bristles bear F_S at most, also where the normal force fell while nothing moved
            most = limit * (1.0 + peak)
            bounded = min(max(before[i, 0], -most), most)
            bristle = bounded + (bounded - sign * top) * np.expm1(-k * abs(way) / top)
            top_end = limit * (1.0 + peak * np.exp(-((end / stribeck) ** 2)))
            force = bristle + damping * (end - abs(end) * bristle / top_end) + viscous * end
            slope = k * (1.0 - sign * bristle / top) * (1.0 - damping * abs(end) / top_end)
            slope += 1.5 * rate * (damping * (1.0 - np.sign(end) * bristle / top_end) + viscous)
        after[i, 0], after[i, 1], after[i, 2] = bristle, force - bristle, way if rate > 0.0 else 0.0
        exchange[FORCE, i] = force
        exchange[EXCESS, i], exchange[SLOPE, i] = force - start - k * way, slope - k
