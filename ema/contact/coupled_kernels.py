"""Contacts that depend on each other, against a given compliance: two directions, normal forces that press; compiled.

Equations and words are those of ``solve_kernels``. Here the excess e of a contact depends on its own way, on that in
the other direction, and through its slip force on that of a normal contact: with T = de/dd, which is not symmetric,
Newton's step for u1 = free - W e is (I + W T)^-1 rest. Only the rows of T that are not zero count: with y = T step,
(I + T W) y = T rest and step = rest - W y.
"""

import numpy as np

from ema.compiled import inner
from ema.contact.call_kernels import (
    ADDRESS,
    BY_GAP,
    CROSS,
    EXCESS,
    LIMIT,
    PRESSURE,
    SLOPE,
    WAY,
    increments,
)
from ema.contact.linear_kernels import add_rows, copy_into, eliminate, matvec

MOST, SHORTEST = 80, 1e-3
"""Evaluations of the laws from one start, and the share of a Newton step below which it is taken as it is."""
_SMALL = 1e-6
"""Change of a slip force, relative, whose effect is its derivative."""
# rows of the room
REST, STEP, BASE, PRESSED, PUSH, MORE = range(6)
ROOM = 6
"""Vectors of the work array."""


@inner
def evaluate_coupled(laws, rate, exchange, before, after):
    """Let the normal contacts take their increments, then those that they press; slopes by their gap to ``PRESSED``."""
    groups, tables, (_, pressed_by, friction, least, room, _, spare) = laws[0], (laws[1], laws[2]), laws[3]
    pressed, more, pressing, count = room[PRESSED], room[MORE], False, len(groups)
    for i in range(len(pressed)):
        pressed[i] = 0.0
        pressing |= pressed_by[i] >= 0
    if pressing:
        count -= 1
        increments(groups[count, ADDRESS], groups[count], rate, tables, exchange, (before, after))
        for i in range(len(pressed)):
            if pressed_by[i] >= 0:
                limit = friction[i] * exchange[PRESSURE, pressed_by[i]]
                more[i] = _SMALL * max(limit, least[i])
                exchange[LIMIT, i] = limit + more[i]
        for n in range(count):
            increments(groups[n, ADDRESS], groups[n], rate, tables, exchange, (before, spare))
        for i in range(len(pressed)):
            if pressed_by[i] >= 0:
                pressed[i] = exchange[EXCESS, i]
                exchange[LIMIT, i] = friction[i] * exchange[PRESSURE, pressed_by[i]]
    for n in range(count):
        increments(groups[n, ADDRESS], groups[n], rate, tables, exchange, (before, after))
    for i in range(len(pressed)):
        if pressed_by[i] >= 0:
            by_limit = (pressed[i] - exchange[EXCESS, i]) / more[i]
            pressed[i] = by_limit * friction[i] * exchange[BY_GAP, pressed_by[i]]


@inner
def newton_step(compliance, ties, exchange, matrix):
    """Newton's step from the ``REST`` of the room to its ``STEP``."""
    partner, pressed_by, _, _, room, active, _ = ties
    rest, step, pressed, push = room[REST], room[STEP], room[PRESSED], room[PUSH]
    count = 0
    for i in range(len(rest)):
        if exchange[SLOPE, i] != 0.0 or exchange[CROSS, i] != 0.0 or pressed[i] != 0.0:
            active[count] = i
            count += 1
    for a in range(count):
        i = active[a]
        # contacts without another have zeros there: any row will do
        j, n = max(partner[i], 0), max(pressed_by[i], 0)
        own, cross, gap = exchange[SLOPE, i], exchange[CROSS, i], pressed[i]
        push[a] = own * rest[i] + cross * rest[j] + gap * rest[n]
        for b in range(count):
            c = active[b]
            matrix[a, b] = own * compliance[i, c] + cross * compliance[j, c] + gap * compliance[n, c]
        matrix[a, a] += 1.0
    eliminate(matrix, push, count)
    # step holds the weights until they are used up
    for i in range(len(rest)):
        step[i] = 0.0
    for a in range(count):
        step[active[a]] = -push[a]
    copy_into(push, rest)
    add_rows(compliance, step, push)
    copy_into(step, push)


@inner
def solve_coupled(laws, problem, displacements, exchange, states, memory):
    """As ``solve_kernels.solve``: Newton's method, halved where it must be; the residual is the largest one.

    Where the start leads nowhere the displacements before are another one.
    """
    (compliance, _, rate, tolerance), (free, u0, u1) = problem, displacements
    (before, after), ties, matrix, x = states, laws[3], memory[0], memory[4]
    room, iterations, norm, size = ties[4], 0, np.inf, 1e-30
    rest, step, base = room[REST], room[STEP], room[BASE]
    for i in range(len(u0)):
        size = max(size, abs(free[i]), abs(u0[i]))
    matvec(compliance, x, rest)
    for attempt in range(2):
        for i in range(len(u0)):
            u1[i] = free[i] - rest[i] if attempt == 0 else u0[i]
        norm, length = np.inf, 1.0
        for _ in range(MOST):
            for i in range(len(u0)):
                exchange[WAY, i] = u1[i] - u0[i]
            evaluate_coupled(laws, rate, exchange, before, after)
            matvec(compliance, exchange[EXCESS], rest)
            new = 0.0
            for i in range(len(u0)):
                rest[i] += u1[i] - free[i]
                new = max(new, abs(rest[i]))
            if new > (1.0 - 0.1 * length) * norm and length > SHORTEST:
                length *= 0.5
            else:
                norm, length = new, 1.0
                if norm <= tolerance * size:
                    copy_into(x, exchange[EXCESS])
                    return iterations, norm / size
                iterations += 1
                newton_step(compliance, ties, exchange, matrix)
                copy_into(base, u1)
            for i in range(len(u0)):
                u1[i] = base[i] - length * step[i]
    copy_into(x, exchange[EXCESS])
    return iterations, norm / size
