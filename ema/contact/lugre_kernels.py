"""LuGre (Canudas de Wit et al. 1995). State: the force of the bristles, what the velocity adds, and the way before."""

import numpy as np

from ema.compiled import kernel
from ema.contact.call_kernels import END, EXCESS, FIRST, FORCE, LIMIT, SLOPE, STIFFNESS, WAY


@kernel
def lugre_step(k, limit, damping, viscous, ratio, stribeck, u0, u1, h, bristle0, before, known):
    """LuGre; the end velocity comes from the last two increments (second order in h).

    State: bristle force, the displacement before, and whether that is known. Returns the contact force first.
    """
    if limit <= 0.0:
        return 0.0, 0.0, 0.0, u0, 1.0, 0.0, 0.0
    du = u1 - u0
    sign = 1.0 if du >= 0.0 else -1.0
    if known != 1.0:
        before = u0
    mean, end = du / h, (3.0 * u1 - 4.0 * u0 + before) / (2.0 * h)
    top = limit * (1.0 + (ratio - 1.0) * np.exp(-((mean / stribeck) ** 2)))
    decay = np.exp(-k * abs(du) / top)
    bristle = sign * top + (bristle0 - sign * top) * decay
    b = k * (1.0 - sign * bristle / top)
    top_end = limit * (1.0 + (ratio - 1.0) * np.exp(-((end / stribeck) ** 2)))
    force = bristle + damping * (end - abs(end) * bristle / top_end) + viscous * end
    rest = damping * (1.0 - np.sign(end) * bristle / top_end) + viscous
    return force, b * (1.0 - damping * abs(end) / top_end) + rest * 1.5 / h, bristle, u0, 1.0, decay, b


@kernel
def lugre(group, rate, parameters, curves, exchange, before, after):
    """Increments of the contacts of a group; ``parameters``: sigma_1, sigma_2, F_S/F_C, Stribeck velocity.

    Where the motion is slow no velocity is left behind: what follows begins at rest.
    """
    for i in range(group[FIRST], group[END]):
        k, way, start = exchange[STIFFNESS, i], exchange[WAY, i], before[i, 0] + before[i, 1]
        force, slope, bristle, _, _, _, _ = lugre_step(
            k,
            exchange[LIMIT, i],
            parameters[i, 0],
            parameters[i, 1],
            parameters[i, 2],
            parameters[i, 3],
            0.0,
            way,
            1.0 / rate,
            before[i, 0],
            -before[i, 2],
            1.0,
        )
        after[i, 0], after[i, 1], after[i, 2] = bristle, force - bristle, way if rate > 0.0 else 0.0
        exchange[FORCE, i] = force
        exchange[EXCESS, i], exchange[SLOPE, i] = force - start - k * way, slope - k
