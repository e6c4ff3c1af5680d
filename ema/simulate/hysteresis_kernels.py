"""The stabilised loop of Eq. (5) in closed form up to one quadrature; compiled, because fits call it often."""

import numpy as np

from ema.compiled import compiled

_NODES = 36.0 * np.linspace(0, 1, 161) ** 4
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_POINTS, _WEIGHTS = (_POINTS + 1) / 2, _WEIGHTS / 2


@compiled()
def rate(y, exponent):
    """dx/dy of the virgin curve dphi/dx = 1 - phi^m with phi = 1 - exp(-y)."""
    if y < 1e-12:
        y = 1e-12
    rest = np.exp(-y)
    return rest / -np.expm1(exponent * np.log1p(-rest))


@compiled()
def virgin_places(exponent, nodes, points, weights):
    """Way x at every node y of the virgin curve, and the slopes dy/dx there."""
    places, slopes = np.zeros(len(nodes)), np.empty(len(nodes))
    for n in range(len(nodes)):
        slopes[n] = 1 / rate(nodes[n], exponent)
        if n > 0:
            step, total = nodes[n] - nodes[n - 1], 0.0
            for j in range(len(points)):
                total += weights[j] * rate(nodes[n - 1] + step * points[j], exponent)
            places[n] = places[n - 1] + step * total
    return places, slopes


@compiled()
def virgin_force(x, nodes, places, slopes):
    """Force over F_C at way x (in units of F_C/k_T), cubic between the nodes."""
    if x <= 0.0:
        return 0.0
    if x >= places[-1]:
        return 1.0
    cell = np.searchsorted(places, x, side="right") - 1
    cell = min(max(cell, 0), len(places) - 2)
    d = places[cell + 1] - places[cell]
    s, rise = (x - places[cell]) / d, nodes[cell + 1] - nodes[cell]
    a, b = slopes[cell] * d, slopes[cell + 1] * d
    y = nodes[cell] + s * (a + s * (3 * rise - 2 * a - b + s * (a + b - 2 * rise)))
    return -np.expm1(-y)


@compiled()
def stabilised(travel, falling, amplitude, stiffness, slip_force, exponent, play):
    """Force at ``travel`` after the last reversal: elastic to zero, across the play, then along the virgin curve."""
    places, slopes = virgin_places(exponent, _NODES, _POINTS, _WEIGHTS)
    unit = slip_force / stiffness
    whole = max(2 * amplitude - play, 1e-9 * amplitude) / unit
    low, high = 0.0, whole
    for _ in range(60):
        way = 0.5 * (low + high)
        if virgin_force(way, _NODES, places, slopes) + way > whole:
            high = way
        else:
            low = way
    top = virgin_force(low, _NODES, places, slopes)
    force = np.empty(len(travel))
    for n in range(len(travel)):
        e = travel[n] / unit
        value = top - e if e < top else -virgin_force(e - top - play / unit, _NODES, places, slopes)
        force[n] = slip_force * (value if falling[n] else -value)
    return force
