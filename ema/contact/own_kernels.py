"""A law of the user's own: a C function of force and way for one contact; slopes by difference. State: the force."""

import numpy as np

from ema.compiled import inner, kernel
from ema.contact.call_kernels import (
    ACROSS,
    BY_FORCE,
    END,
    EXCESS,
    FIRST,
    FORCE,
    LIMIT,
    OWN,
    SLOPE,
    STIFFNESS,
    WAY,
    own_force,
)

_SMALL = 1e-7
"""Way of the difference over F_C/k_T: half the digits of the slope are right."""
_CLOSE = 1e-10
"""Change of a force over F_C by the last order of an extrapolation at which it is taken. Quadrature and Newton's method
ask for 1e-9; every factor of 10 takes steps shorter by a third."""
_SHORTEST = 1e-11
"""Step over F_C/k_T that is taken as it is: a kink is passed in it."""
_LONGEST = 0.1
"""Longest step over F_C/k_T: in longer ones a rule may overshoot to a clip in whole and in halves alike."""
_SLIDES = 1e-6
"""Slope over k_T below which how the new force follows the old one is a difference, not a ratio of slopes."""

_ROWS = (2, 5, 9)
"""Numbers of terms that an extrapolation is tried with."""


def _weights(most: int) -> np.ndarray:
    """Weights (rows, n) of the results in n = 1 ... rows equal parts in the extrapolation of so many of them."""
    weights = np.zeros((most + 1, most + 1))
    for rows in range(1, most + 1):
        for n in range(1, rows + 1):
            weights[rows, n] = np.prod([n / (n - other) for other in range(1, rows + 1) if other != n])
    return weights


_WEIGHTS = _weights(_ROWS[-1])


@kernel
def own(group, rate, tables, exchange, states):
    """Increments of the contacts of a group; ``parameters``: up to four numbers for the function."""
    (parameters, _), (before, after) = tables, states
    function = group[OWN]
    for i in range(group[FIRST], group[END]):
        k, limit, way, start = exchange[STIFFNESS, i], exchange[LIMIT, i], exchange[WAY, i], before[i, 0]
        contact, numbers = (k, limit), (parameters[i, 0], parameters[i, 1], parameters[i, 2], parameters[i, 3])
        force = own_force(function, start, way, contact, numbers)
        tiny = _SMALL * max(limit, 1e-12) / k
        step = tiny if way >= 0.0 else -tiny
        slope = (own_force(function, start, way + step, contact, numbers) - force) / step
        if rate == 0.0 or group[ACROSS] > 0:
            # what follows the old force is asked for along slow paths and in two directions only
            change = _SMALL * max(limit, 1e-12) * (-1.0 if start > 0.0 else 1.0)
            after_change = own_force(function, start + change, way, contact, numbers)
            exchange[BY_FORCE, i] = (after_change - force) / change
        after[i, 0] = exchange[FORCE, i] = force
        exchange[EXCESS, i], exchange[SLOPE, i] = force - start - k * way, slope - k


@inner
def _in_parts(function, start, way, parts, contact, numbers):
    """Force after a way in so many equal parts."""
    for _ in range(parts):
        start = own_force(function, start, way / parts, contact, numbers)
    return start


@inner
def _extrapolated(function, start, way, contact, numbers):
    """Force after a way in ever shorter steps of a rule, and the change by the last order of the extrapolation.

    The force after a way in n equal parts is a polynomial in 1/n where the rule is smooth: Aitken and Neville's
    extrapolation to 1/n = 0 (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, section II.9).
    """
    enough, total, last = _CLOSE * contact[1], 0.0, 0.0
    for rows in _ROWS:
        total = last = 0.0
        for n in range(1, rows + 1):
            force = _in_parts(function, start, way, n, contact, numbers)
            total += _WEIGHTS[rows, n] * force
            last += _WEIGHTS[rows - 1, n] * force
        if abs(total - last) <= enough:
            break
    return total, total - last


@inner
def _limit_of_steps(function, start, way, contact, numbers):
    """Force after a way in steps without length; halved where the rule has a kink."""
    k, limit = contact
    force, rest, step, shortest, longest = start, way, way, _SHORTEST * limit / k, _LONGEST * limit / k
    if abs(step) > longest:
        step = longest if way > 0.0 else -longest
    while rest != 0.0:
        if abs(step) >= abs(rest):
            step = rest
        new, change = _extrapolated(function, force, step, contact, numbers)
        if abs(change) > _CLOSE * limit and abs(step) > shortest:
            step *= 0.5
            continue
        if new == force and abs(step) >= 0.5 * longest:
            break  # it slides, and will
        force, rest = min(max(new, -limit), limit), rest - step
        if abs(2.0 * step) <= longest:
            step *= 2.0
    return force


@kernel
def own_in_steps(group, rate, tables, exchange, states):
    """The same for a function that is a rule of short increments: what it tends to as they are made shorter.

    The force follows dF/du = h(F), of which dF1/du = h(F1) and dF1/dF0 = h(F1) / h(F0), across kinks too.
    """
    (parameters, _), (before, after) = tables, states
    function = group[OWN]
    for i in range(group[FIRST], group[END]):
        k, limit, way, start = exchange[STIFFNESS, i], exchange[LIMIT, i], exchange[WAY, i], before[i, 0]
        contact, numbers = (k, limit), (parameters[i, 0], parameters[i, 1], parameters[i, 2], parameters[i, 3])
        if limit > 0.0:
            start = min(max(start, -limit), limit)
            force = _limit_of_steps(function, start, way, contact, numbers)
        else:
            force = own_force(function, start, way, contact, numbers)
        tiny = _SMALL * max(limit, 1e-12) / k
        step = tiny if way >= 0.0 else -tiny
        slope = (own_force(function, force, step, contact, numbers) - force) / step
        if rate == 0.0 or group[ACROSS] > 0:
            slope_before = (own_force(function, start, step, contact, numbers) - start) / step
            if slope_before > _SLIDES * k:
                exchange[BY_FORCE, i] = slope / slope_before
            elif limit > 0.0:
                change = _SMALL * limit * (-1.0 if start > 0.0 else 1.0)
                after_change = _limit_of_steps(function, start + change, way, contact, numbers)
                exchange[BY_FORCE, i] = (after_change - force) / change
            else:
                exchange[BY_FORCE, i] = 0.0
        after[i, 0] = exchange[FORCE, i] = force
        exchange[EXCESS, i], exchange[SLOPE, i] = force - before[i, 0] - k * way, slope - k
