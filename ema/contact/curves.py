"""Curves of the law of Bouc and Wen as tables: dphi/dx = 1 - phi^n along the force, dphi/dx = 1 + d phi^n against it.

The first is the virgin curve of Eq. (5) (Gaul, Roseira and Becker 2008) too, where the way back is straight, d = 0.
"""

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
    power = _grading(exponent)
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
    return _over_grid(t, phi, slope, curvature, span, power), span, power


def _grading(exponent: float) -> float:
    """Power of the grid: with an exponent that is no whole number the curve is not smooth at its beginning."""
    return 1.0 if exponent >= 5 or exponent == round(exponent) else 5.0


def _over_grid(
    t: np.ndarray, phi: np.ndarray, slope: np.ndarray, curvature: np.ndarray, span: float, power: float
) -> Float[np.ndarray, "3 size"]:
    """Values, slopes and curvatures over the coordinate x = span t^power as those over t."""
    stretch = span * power * t ** (power - 1)
    bend = span * power * (power - 1) * t ** max(power - 2, 0)
    return np.array([phi, slope * stretch, curvature * stretch**2 + slope * bend])


@lru_cache(maxsize=32)
def release_curve(exponent: float, d: float) -> tuple[np.ndarray, float, float]:
    """The curve dphi/dx = 1 + d phi^n from 0 to 1, as ``virgin_curve`` gives its own."""
    points, weights = np.polynomial.legendre.leggauss(12)
    points, weights = (points + 1) / 2, weights / 2

    def climb(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        phi = start[:, None] + (end - start)[:, None] * points
        return np.asarray(((1 / (1 + d * phi**exponent)) @ weights) * (end - start))

    nodes = np.linspace(0, 1, 600) ** 5
    places = np.concatenate([[0.0], np.cumsum(climb(nodes[:-1], nodes[1:]))])
    span, power = float(places[-1]), _grading(exponent)
    t = np.linspace(0, 1, _TABLE_SIZE)
    x = span * t**power
    cell = np.clip(np.searchsorted(places, x, side="right") - 1, 0, len(nodes) - 2)
    phi = np.interp(x, places, nodes)
    for _ in range(8):
        rest = places[cell] + climb(nodes[cell], phi) - x
        phi = np.clip(phi - rest * (1 + d * phi**exponent), nodes[cell], nodes[cell + 1])
    slope = 1 + d * phi**exponent
    curvature = d * exponent * np.maximum(phi, 1e-60) ** (exponent - 1) * slope
    curvature[0] = d if exponent == 1 else 0.0
    return _over_grid(t, phi, slope, curvature, span, power), span, power


def bouc_wen_shape(exponent: float, gamma: float, known: dict[tuple[float, float], int]) -> Float[np.ndarray, "9"]:
    """``shape`` of ``bouc_wen_step``; ``known`` gathers the curves that ``tables`` makes, and their numbers."""
    d = 1 - 2 * gamma
    place, back = known.setdefault((exponent, -1.0), len(known)), 0
    _, span, power = virgin_curve(exponent)
    span_back, power_back = 1.0, 1.0
    if d != 0:
        back = known.setdefault((exponent, d), len(known))
        _, span_back, power_back = release_curve(exponent, d)
    return np.array([exponent, place, _TABLE_SIZE, span, power, d, back, span_back, power_back])


def tables(known: dict[tuple[float, float], int]) -> Float[np.ndarray, "curve 3 size"]:
    """The curves that ``bouc_wen_shape`` gathered: exponent and d, which is -1 for the virgin curve."""
    if not known:
        return np.zeros((1, 3, 2))
    return np.array([virgin_curve(n)[0] if d == -1 else release_curve(n, d)[0] for n, d in known])
