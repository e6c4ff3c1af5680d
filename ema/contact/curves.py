"""Curves of the law of Bouc and Wen as tables: dphi/dx = 1 - phi^n along the force, dphi/dx = 1 + d phi^n against it.

The first is the virgin curve of Eq. (5) (Gaul, Roseira and Becker 2008) too, where the way back is straight, d = 0.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Float

_TABLE_SIZE = 2049
"""Places of a tabulated curve."""


def virgin_rate(y: Float[np.ndarray, "*shape"], exponent: float) -> Float[np.ndarray, "*shape"]:
    """dx/dy of the virgin curve of Eq. (5), dphi/dx = 1 - phi^m, with phi = 1 - exp(-y): smooth up to full slip."""
    rest = np.maximum(np.exp(-y), 1e-300)
    with np.errstate(divide="ignore"):
        return np.asarray(rest / -np.expm1(exponent * np.log1p(-rest)))


@lru_cache(maxsize=32)
def curve(exponent: float, d: float) -> tuple[Float[np.ndarray, "3 size"], float, float]:
    """The curve dphi/dx = 1 + d phi^n from 0 to 1: (value, slope, curvature) over a graded grid, its span and grading.

    Integrated over phi, and over -ln(1 - phi) for d = -1, where it takes infinitely long to come to 1. With an exponent
    that is no whole number it is not smooth at its beginning, where the grid is finer.
    """
    virgin = d == -1
    nodes = 36.0 * np.linspace(0, 1, 1200) ** 5 if virgin else np.linspace(0, 1, 600) ** 5
    points, weights = np.polynomial.legendre.leggauss(12)

    def rate(s: np.ndarray) -> np.ndarray:
        return virgin_rate(np.maximum(s, 1e-300), exponent) if virgin else 1 / (1 + d * s**exponent)

    def climb(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        inside = start[:, None] + (end - start)[:, None] * (points + 1) / 2
        return np.asarray((rate(inside) @ weights) * (end - start) / 2)

    places = np.concatenate([[0.0], np.cumsum(climb(nodes[:-1], nodes[1:]))])
    span, power = float(places[-1]), 1.0 if exponent >= 5 or exponent == round(exponent) else 5.0
    t = np.linspace(0, 1, _TABLE_SIZE)
    x = span * t**power
    cell = np.clip(np.searchsorted(places, x, side="right") - 1, 0, len(nodes) - 2)
    s = np.interp(x, places, nodes)
    for _ in range(8):
        s = np.clip(s - (places[cell] + climb(nodes[cell], s) - x) / rate(s), nodes[cell], nodes[cell + 1])
    phi = -np.expm1(-s) if virgin else s
    slope = -np.expm1(exponent * np.log(np.maximum(phi, 1e-300))) if virgin else 1 + d * phi**exponent
    curvature = d * exponent * np.maximum(phi, 1e-60) ** (exponent - 1) * slope
    curvature[0] = d if exponent == 1 else 0.0
    # by t instead of x
    stretch = span * power * t ** (power - 1)
    bend = span * power * (power - 1) * t ** max(power - 2, 0)
    return np.array([phi, slope * stretch, curvature * stretch**2 + slope * bend]), span, power


def bouc_wen_shape(exponent: float, gamma: float, known: dict[tuple[float, float], int]) -> Float[np.ndarray, "9"]:
    """``shape`` of ``bouc_wen_step``; ``known`` gathers the curves that ``tables`` makes, and their numbers."""
    d = 1 - 2 * gamma
    place, back = known.setdefault((exponent, -1.0), len(known)), 0
    _, span, power = curve(exponent, -1.0)
    span_back, power_back = 1.0, 1.0
    if d != 0:
        back = known.setdefault((exponent, d), len(known))
        _, span_back, power_back = curve(exponent, d)
    return np.array([exponent, place, _TABLE_SIZE, span, power, d, back, span_back, power_back])


def tables(known: dict[tuple[float, float], int]) -> Float[np.ndarray, "curve 3 size"]:
    """The curves that ``bouc_wen_shape`` gathered: exponent and d, which is -1 for the virgin curve."""
    if not known:
        return np.zeros((1, 3, 2))
    return np.array([curve(n, d)[0] for n, d in known])
