"""First harmonics of the hysteresis loops that a joint may have: stiffness and loss over the slip.

All laws have the same parameters, slip limit F_C = mu F_N and initial stiffness k, so that the slip s is over F_C/k, at
which the spring of the first one yields. They differ in how the joint goes from sticking to sliding: at once, spread
evenly over the slip, or exponentially.
"""

import numpy as np
from scipy.special import ive

LAWS = ("Masing", "Iwan", "Dahl")
"""Yields at one slip; yields evenly up to twice that slip; approaches its limit exponentially."""


def harmonic(law: str, slips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First harmonic of a stabilised loop: in-phase stiffness k' and loss k'', both over the initial stiffness.

    Parameters
    ----------
    law : one of ``LAWS``.
    slips : amplitude of the slip over F_C/k, above 0, of any shape.

    Returns
    -------
    k'/k and k''/k, each of the shape of ``slips``; the energy lost in a cycle is pi k'' times the square of the slip.

    Raises
    ------
    KeyError : there is no such law.

    Examples
    --------
    >>> stiffness, loss = harmonic("Masing", np.array([0.5, 2.0]))
    >>> print(stiffness, loss.round(4))
    [1.  0.5] [0.     0.3183]
    """
    stiffness, loss = _HARMONICS[law](np.asarray(slips, float))
    return np.asarray(stiffness), np.asarray(loss)


def _masing(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # elastic, perfectly plastic: Caughey 1960, Journal of Applied Mechanics 27:640; y = 1/s, theta = arccos(1 - 2 y)
    y = 1 / np.maximum(s, 1.0)
    theta = np.arccos(1 - 2 * y)
    return (theta - np.sin(2 * theta) / 2) / np.pi, 4 * y * (1 - y) / np.pi


def _iwan(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # yield forces spread evenly from 0: Iwan 1966, Journal of Applied Mechanics 33:893. Virgin curve F/F_C = u - u^2/4
    # up to u = 2, then 1; Masing's rule gives the loop. While it has not slid all over, s <= 2: k'/k = 1 - s/4,
    # W = s^3/3, k''/k = W/(pi s^2). Beyond, the branch from the turning point, x = s cos phi, is
    # f = -1 + 2 (1 - b + b cos phi)^2 with b = s/4, up to 1 - cos phi = 1/b, then -1; W = 4 s - 16/3
    b = np.maximum(s, 2.0) / 4
    theta = np.arccos(1 - 1 / b)
    sine = np.sin(theta)
    square, cube = theta / 2 + np.sin(2 * theta) / 4, sine - sine**3 / 3
    sliding = ((1 - b) ** 2 * sine + 2 * b * (1 - b) * square + b**2 * cube) / (np.pi * b)
    area = np.where(s <= 2, s**3 / 3, 4 * s - 16 / 3)
    return np.where(s <= 2, 1 - s / 4, sliding), area / (np.pi * s**2)


def _dahl(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # dF/dx = k (1 - sgn(v) F/F_C): Dahl 1976, AIAA Journal 14:1675, with the exponent 1.
    # Branch from the turning point: f = -1 + (1 + tanh s) exp(-s (1 - cos phi)), and the integral of exp(s cos phi)
    # cos phi over half a turn is pi I_1(s) (Abramowitz and Stegun 1964, 9.6.19); W = 4 (s - tanh s)
    stiffness = 2 * (1 + np.tanh(s)) * ive(1, s) / s
    # s - tanh s loses its digits where s is small: its series there
    area = np.where(s < 0.02, 4 * s**3 / 3 * (1 - 2 * s**2 / 5), 4 * (s - np.tanh(s)))
    return stiffness, area / (np.pi * s**2)


_HARMONICS = dict(zip(LAWS, (_masing, _iwan, _dahl), strict=True))
