"""The virgin curve of Eq. (5) (Gaul, Roseira and Becker 2008), dphi/dx = 1 - phi^m, as a table."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float

_TABLE_SIZE = 2049


def virgin_rate(y: Float[np.ndarray, "*shape"], exponent: float) -> Float[np.ndarray, "*shape"]:
    """dx/dy of the virgin curve of Eq. (5), dphi/dx = 1 - phi^m, with phi = 1 - exp(-y): smooth up to full slip."""
    rest = np.maximum(np.exp(-y), 1e-300)
    with np.errstate(divide="ignore"):
        return np.asarray(rest / -np.expm1(exponent * np.log1p(-rest)))


@lru_cache(maxsize=32)
def virgin_curve(exponent: float) -> tuple[np.ndarray, float, float]:
    """Virgin curve of Eq. (5) for one exponent: (value, slope, curvature) over a graded grid, its span and grading."""
    points, weights = np.polynomial.legendre.leggauss(12)
    points, weights = (points + 1) / 2, weights / 2

    def climb(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        y = start[:, None] + (end - start)[:, None] * points
        return np.asarray((virgin_rate(y, exponent) @ weights) * (end - start))

    nodes = 36.0 * np.linspace(0, 1, 1200) ** 5
    places = np.concatenate([[0.0], np.cumsum(climb(nodes[:-1], nodes[1:]))])
    span = float(places[-1])
    power = 1.0 if exponent >= 5 or exponent == round(exponent) else 5.0
    t = np.linspace(0, 1, _TABLE_SIZE)
    x = span * t**power
    cell = np.clip(np.searchsorted(places, x, side="right") - 1, 0, len(nodes) - 2)
    y = np.interp(x, places, nodes)
    for _ in range(8):
        rate = virgin_rate(np.maximum(y, 1e-300), exponent)
        y = np.clip(y - (places[cell] + climb(nodes[cell], y) - x) / rate, nodes[cell], nodes[cell + 1])
    phi = -np.expm1(-y)
    slope = -np.expm1(exponent * np.log(np.maximum(phi, 1e-300)))
    curvature = -exponent * np.maximum(phi, 1e-60) ** (exponent - 1) * slope
    curvature[0] = -1.0 if exponent == 1 else 0.0
    stretch = span * power * t ** (power - 1)
    bend = span * power * (power - 1) * t ** max(power - 2, 0)
    return np.array([phi, slope * stretch, curvature * stretch**2 + slope * bend]), span, power
