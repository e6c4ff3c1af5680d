"""Normal contact as an elastic law without tension; compiled.

The gap of a node pair opens by v from the state of preload: the force that pulls it shut again is N_s - N(d_s - v),
with the penetration d_s and the normal force N_s at rest. Its energy is counted from there. State: the opening v, and
the root of twice the energy.
"""

import numpy as np

from ema.compiled import compiled, inner, kernel
from ema.contact import call_kernels as call

POWER, CURVE = range(2)
# columns of the table of pairs
KIND, SCALE, EXPONENT, PENETRATION, FORCE, ENERGY, FIRST, LAST = range(8)


@inner
def press(pair, curve, depth):
    """Normal force, its slope and the energy stored at a penetration ``depth``."""
    if pair[KIND] == POWER:
        if depth <= 0.0:
            return 0.0, 0.0, 0.0
        scale, n = pair[SCALE], pair[EXPONENT]
        if n == 1.0:
            return scale * depth, scale, 0.5 * scale * depth * depth
        force = scale * depth**n
        return force, n * force / depth, force * depth / (n + 1.0)
    first, last = int(pair[FIRST]), int(pair[LAST])
    if depth <= curve[0, first]:
        return 0.0, 0.0, 0.0
    low, high = first, last
    while high - low > 1:
        middle = (low + high) // 2
        if curve[0, middle] <= depth:
            low = middle
        else:
            high = middle
    slope = (curve[1, high] - curve[1, low]) / (curve[0, high] - curve[0, low])
    way = depth - curve[0, low]
    force = curve[1, low] + slope * way
    return pair[SCALE] * force, pair[SCALE] * slope, pair[SCALE] * (curve[2, low] + 0.5 * (curve[1, low] + force) * way)


@inner
def pull(pair, curve, v):
    """Force that closes a gap opened by v, its slope, and the energy since the preload."""
    force, slope, energy = press(pair, curve, pair[PENETRATION] - v)
    return pair[FORCE] - force, slope, energy - pair[ENERGY] + pair[FORCE] * v


@inner
def mean_pull(pair, curve, v0, v1):
    """Mean of the closing force while the gap goes from v0 to v1, and its slope by v1: work to the last digit."""
    moved = v1 - v0
    deep = max(abs(pair[PENETRATION] - v0), abs(pair[PENETRATION] - v1))
    if abs(moved) <= 1e-4 * deep:
        f0, _, _ = pull(pair, curve, v0)
        fm, sm, _ = pull(pair, curve, 0.5 * (v0 + v1))
        f1, s1, _ = pull(pair, curve, v1)
        return (f0 + 4.0 * fm + f1) / 6.0, (2.0 * sm + s1) / 6.0
    f1, _, e1 = pull(pair, curve, v1)
    _, _, e0 = pull(pair, curve, v0)
    mean = (e1 - e0) / moved
    return mean, max((f1 - mean) / moved, 0.0)


@kernel
def normal(group, rate, tables, exchange, states):
    """Increments of the contacts of a group; ``parameters``: the table of pairs, ``group[OWN]`` the curve.

    Over a step in time their excess is that of a force whose mean with the old one does the work of the way.
    """
    (parameters, curves), (before, after) = tables, states
    for i in range(group[call.FIRST], group[call.END]):
        pair, curve = parameters[i], curves[group[call.OWN]]
        k, way, v0 = exchange[call.STIFFNESS, i], exchange[call.WAY, i], before[i, 0]
        v1 = v0 + way
        start, _, _ = pull(pair, curve, v0)
        force, slope, energy = pull(pair, curve, v1)
        after[i, 0], after[i, 1] = v1, np.sqrt(2.0 * max(energy, 0.0))
        exchange[call.FORCE, i], exchange[call.PRESSURE, i], exchange[call.BY_GAP, i] = (
            force,
            pair[FORCE] - force,
            -slope,
        )
        if rate > 0.0:
            middle, by_middle = mean_pull(pair, curve, v0, v1)
            force, slope = 2.0 * middle - start, 2.0 * by_middle
        exchange[call.EXCESS, i], exchange[call.SLOPE, i] = force - start - k * way, slope - k


@compiled()
def press_all(pairs, curve, depth):
    """Normal forces, slopes and energies (pair,) at penetrations (pair,)."""
    out = np.empty((3, len(depth)))
    for i in range(len(depth)):
        out[0, i], out[1, i], out[2, i] = press(pairs[i], curve, depth[i])
    return out
