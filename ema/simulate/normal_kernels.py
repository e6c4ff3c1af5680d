"""Normal contact as an elastic law without tension; compiled.

The gap of a node pair opens by v from the state of preload: the force that pulls it shut again is N_s - N(d_s - v),
with the penetration d_s and the normal force N_s at rest. Its energy is counted from there.
"""

import numpy as np

from ema.compiled import compiled

POWER, CURVE = range(2)
# columns of the table of pairs
KIND, SCALE, EXPONENT, PENETRATION, FORCE, ENERGY, FIRST, LAST = range(8)


@compiled()
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


@compiled()
def pull(pair, curve, v):
    """Force that closes a gap opened by v, its slope, and the energy since the preload."""
    force, slope, energy = press(pair, curve, pair[PENETRATION] - v)
    return pair[FORCE] - force, slope, energy - pair[ENERGY] + pair[FORCE] * v


@compiled()
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


@compiled()
def press_all(pairs, curve, depth):
    """Normal forces, slopes and energies (pair,) at penetrations (pair,)."""
    out = np.empty((3, len(depth)))
    for i in range(len(depth)):
        out[0, i], out[1, i], out[2, i] = press(pairs[i], curve, depth[i])
    return out
