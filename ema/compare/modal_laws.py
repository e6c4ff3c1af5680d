"""What a joint law does to one mode: storage and loss of the joint over the amplitude, for fits of f(a) and zeta(a).

In a harmonic motion of amplitude u a joint acts like the complex stiffness k (s(u) + j d(u)), the first harmonic of
its force over the amplitude. With u in multiples of F_C / k, both depend on the form of the law alone; s = 1 and d = 0
where it sticks. In one mode a joint adds to lambda = (f / f_ref)^2 and eta = 2 zeta lambda

    lambda(a) = lambda_0 - kappa (1 - s(a / a_s)),        eta(a) = eta_0 + kappa d(a / a_s)

with kappa the share of the modal stiffness that the joint carries and a_s the amplitude at which a joint of constant
stiffness would slip. lambda and eta are linear in everything but a_s and the form (Segalman 2005, Sec. 5, for the power
law; Krack and Gross 2019, Sec. 2.4, for harmonic equivalents).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float

from ema.errors import InputError

Curves = tuple[Float[np.ndarray, "draw level"], Float[np.ndarray, "draw level"]]
_ANGLES = 256
"""Samples of half a cycle from which a first harmonic is taken; twice as many change s and d by less than 1e-4."""
_AMPLITUDES = np.geomspace(1e-4, 1e4, 193)
"""Amplitudes of the tables, 24 to a decade: between them log d is interpolated within 0.2 %."""


@dataclass(frozen=True)
class Shape:
    """A number that says how a law looks: its ``name``, and the range in which it is searched."""

    name: str
    low: float
    high: float


@dataclass(frozen=True)
class ModalLaw:
    """A joint law as one mode sees it.

    ``springs`` joints in parallel have stiffness shares of their own; ``scaled`` says whether the law has an amplitude
    a_s (a pure power law has none). ``curves`` takes amplitudes over a_s (draw, level) and the shapes (draw, shape) and
    returns 1 - s and d of shape (draw, level).
    """

    name: str
    shapes: tuple[Shape, ...]
    curves: Callable[[np.ndarray, np.ndarray], Curves]
    springs: int = 1
    scaled: bool = True


def spring(amplitude: Float[np.ndarray, "..."]) -> tuple[np.ndarray, np.ndarray]:
    """1 - s and d of an elastic spring that slides from the amplitude 1 on (Jenkins element).

    With cos t = 1 - 2 / u: s = (t - sin(2 t) / 2) / pi, d = 4 (u - 1) / (pi u^2) (Caughey 1960).
    """
    u = np.maximum(amplitude, 1.0)
    angle = np.arccos(1 - 2 / u)
    return 1 - (angle - 0.5 * np.sin(2 * angle)) / np.pi, 4 * (u - 1) / (np.pi * u**2)


def _masing(amplitude: np.ndarray, shapes: np.ndarray) -> Curves:
    return spring(amplitude)


def _power(amplitude: np.ndarray, shapes: np.ndarray) -> Curves:
    """Microslip without an end: 1 - s and d grow with the power 1 + chi, in the ratio of Masing's rule."""
    chi = shapes[:, :1]
    power = amplitude ** (1 + chi)
    return power * _lost_over_loss()(chi), power


@cache
def _lost_over_loss() -> Callable[[np.ndarray], np.ndarray]:
    """(1 - s) / d of springs whose slip amplitudes have the density r^chi, as a function of chi."""
    exponents = np.linspace(-0.98, 1.5, 125)
    u = np.geomspace(1.0, 1e7, 4001)
    lost, loss = spring(u)
    # r = 1 / u: the integral over r from 0 to 1 of r^chi g(1 / r) dr, by the trapezoidal rule in log u
    weight = u[None] ** -(exponents[:, None] + 1)
    ratio = np.trapezoid(weight * lost, np.log(u), axis=1) / np.trapezoid(weight * loss, np.log(u), axis=1)
    return lambda chi: np.interp(chi, exponents, ratio)


@cache
def _iwan_table() -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Curves of the modified Iwan law on a grid of chi, the share of the last spring, and amplitude."""
    chis, shares = np.linspace(-0.9, 1.0, 20), np.linspace(0.0, 0.95, 20)
    edges = np.geomspace(1e-7, 1.0, 281)
    middle = np.sqrt(edges[1:] * edges[:-1])
    # a_s is the amplitude of the last slip: in units of F_C / k it would depend on the shape
    each = np.stack(spring(_AMPLITUDES[:, None] / middle))  # (2, amplitude, spring)
    last = np.stack(spring(_AMPLITUDES))
    table = np.empty((2, len(chis), len(shares), len(_AMPLITUDES)))
    for i, chi in enumerate(chis):
        stiffness = np.diff(edges ** (chi + 1))
        spread = each @ (stiffness / stiffness.sum())
        table[:, i] = (1 - shares)[:, None] * spread[:, None] + shares[:, None] * last[:, None]
    return (chis, shares), np.log(np.maximum(table, 1e-30))


def _iwan(amplitude: np.ndarray, shapes: np.ndarray) -> Curves:
    return _interpolated(_iwan_table, amplitude, shapes)


@cache
def _regularised_table() -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Eq. (5) of Gaul, Roseira and Becker (2008): unloading is elastic, loading follows dF/du = 1 - F^m."""
    logarithms = np.linspace(np.log(0.3), np.log(20.0), 43)
    fine = np.concatenate([[0.0], np.geomspace(1e-8, 0.5, 400), 1 - np.geomspace(0.5, 1e-13, 3000)[1:]])
    tops = np.concatenate([np.geomspace(1e-6, 0.5, 100), 1 - np.geomspace(0.5, 1e-12, 200)[1:]])
    rows = []
    for exponent in np.exp(logarithms):
        compliance = 1 / -np.expm1(exponent * np.log(np.maximum(fine, 1e-300)))
        way = np.concatenate([[0.0], np.cumsum(0.5 * (compliance[1:] + compliance[:-1]) * np.diff(fine))])
        curves = []
        for top, amplitude in _turning_points(tops, 0.5 * (tops + np.interp(tops, fine, way))):
            travelled = amplitude * (1 - np.cos(_angles()))
            force = np.where(travelled <= top, top - travelled, -np.interp(travelled - top, way, fine))
            curves.append((amplitude, *_first_harmonic(force, amplitude)))
        rows.append(_on_grid(np.array(curves)))
    return (logarithms,), np.stack(rows, axis=1)


def _regularised(amplitude: np.ndarray, shapes: np.ndarray) -> Curves:
    return _interpolated(_regularised_table, amplitude, shapes)


@cache
def _valanis_table() -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Valanis (1971): x(F) = kappa F - (1 - kappa) ln(1 - F) on every loading; kappa = 0 is Dahl's law."""
    kappas = np.linspace(0.0, 0.98, 43)
    tops = np.concatenate([np.geomspace(1e-4, 0.5, 100), 1 - np.geomspace(0.5, 1e-12, 200)[1:]])
    rows = []
    for kappa in kappas:
        curves = []
        ways = kappa * tops - (1 - kappa) * np.log1p(-tops), -kappa * tops - (1 - kappa) * np.log1p(tops)
        for top, amplitude in _turning_points(tops, 0.5 * (ways[0] - ways[1])):
            left = np.geomspace(1 + top, 1 - top, 1200)  # 1 - F from the turning point on
            way = kappa * (left[0] - left) - (1 - kappa) * np.log(left / left[0])
            travelled = amplitude * (1 - np.cos(_angles()))
            force = -np.interp(travelled, way, 1 - left)
            curves.append((amplitude, *_first_harmonic(force, amplitude)))
        rows.append(_on_grid(np.array(curves)))
    return (kappas,), np.stack(rows, axis=1)


def _valanis(amplitude: np.ndarray, shapes: np.ndarray) -> Curves:
    return _interpolated(_valanis_table, amplitude, shapes)


def _turning_points(tops: Float[np.ndarray, "row"], amplitudes: Float[np.ndarray, "row"]) -> list[tuple[float, float]]:
    """Force over F_C and amplitude of the turning points; beyond the last one the joint slides with the same force."""
    sliding = np.geomspace(1.05 * amplitudes[-1], 2 * _AMPLITUDES[-1], 120)
    rows = np.concatenate([np.stack([tops, amplitudes]), np.stack([np.full(120, tops[-1]), sliding])], axis=1)
    return [(float(top), float(amplitude)) for top, amplitude in rows.T]


def _angles() -> Float[np.ndarray, "angle"]:
    return (np.arange(_ANGLES) + 0.5) * np.pi / _ANGLES


def _first_harmonic(force: Float[np.ndarray, "angle"], amplitude: float) -> tuple[float, float]:
    """1 - s and d of the force on the way from +amplitude to -amplitude (the other half of the cycle is odd to it)."""
    angles = _angles()
    return (
        1 - 2 / _ANGLES * float(force @ np.cos(angles)) / amplitude,
        -2 / _ANGLES * float(force @ np.sin(angles)) / amplitude,
    )


def _on_grid(curves: Float[np.ndarray, "row 3"]) -> Float[np.ndarray, "2 amplitude"]:
    """Logarithms of both curves at the amplitudes of the tables, continued beyond the ends along their slope."""
    sound = (curves[:, 1] > 1e-12) & (curves[:, 2] > 1e-12)
    x, y = np.log(curves[sound, 0]), np.log(curves[sound, 1:])
    out = np.empty((2, len(_AMPLITUDES)))
    grid = np.log(_AMPLITUDES)
    for n in range(2):
        out[n] = np.interp(grid, x, y[:, n])
        low, high = grid < x[0], grid > x[-1]
        first = (y[10, n] - y[0, n]) / (x[10] - x[0])
        last = (y[-1, n] - y[-10, n]) / (x[-1] - x[-10])
        out[n, low] = y[0, n] + first * (grid[low] - x[0])
        out[n, high] = y[-1, n] + last * (grid[high] - x[-1])
    return out


def _interpolated(
    table: Callable[[], tuple[tuple[np.ndarray, ...], np.ndarray]], amplitude: np.ndarray, shapes: np.ndarray
) -> Curves:
    """Both curves by linear interpolation between the shapes and amplitudes of a table."""
    axes, values = table()
    places = [
        np.clip(np.interp(shapes[:, n], axis, np.arange(len(axis))), 0, len(axis) - 1 - 1e-9)
        for n, axis in enumerate(axes)
    ]
    places = [np.broadcast_to(place[:, None], amplitude.shape) for place in places]
    top = len(_AMPLITUDES) - 1
    where = np.log(np.maximum(amplitude, 1e-300) / _AMPLITUDES[0]) / np.log(_AMPLITUDES[-1] / _AMPLITUDES[0]) * top
    places.append(np.clip(where, 0, top - 1e-9))
    cells = [place.astype(int) for place in places]
    parts = [place - cell for place, cell in zip(places, cells, strict=True)]
    out = np.zeros((2, *amplitude.shape))
    for corner in np.ndindex(*(2,) * len(places)):
        weight = np.ones(amplitude.shape)
        for part, side in zip(parts, corner, strict=True):
            weight = weight * (part if side else 1 - part)
        out += weight * values[(slice(None), *(cell + side for cell, side in zip(cells, corner, strict=True)))]
    return np.exp(out[0]), np.exp(out[1])


LAWS: tuple[ModalLaw, ...] = (
    ModalLaw("power law", (Shape("chi", -0.95, 1.2),), _power, scaled=False),
    ModalLaw("masing", (), _masing),
    ModalLaw("two masing springs", (), _masing, springs=2),
    ModalLaw("modified iwan", (Shape("chi", -0.9, 1.0), Shape("last spring", 0.0, 0.95)), _iwan),
    ModalLaw("regularised masing", (Shape("log exponent", float(np.log(0.3)), float(np.log(20.0))),), _regularised),
    ModalLaw("valanis", (Shape("kappa", 0.0, 0.98),), _valanis),
)


def law(name: str) -> ModalLaw:
    """The modal form of a law.

    Raises
    ------
    InputError : there is none of that name.
    """
    for candidate in LAWS:
        if candidate.name == name:
            return candidate
    raise InputError(
        "no modal form of this law", got=name, expected="one of " + ", ".join(known.name for known in LAWS)
    )
