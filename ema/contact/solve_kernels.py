"""Contacts against a given compliance, compiled: one Newton method for every law, in time and in a slow load.

With f the force of a contact and k its stiffness, e = f1 - f0 - k d is what it has slipped over the way d, as a force
(0 while it sticks). The structure, with every contact stuck, answers to it by its compliance W: over a time step that
of the mean of old and new force, slowly the static one:

    u1 = free - W x,   x = e(u1 - u0)

rest = e - x is brought to zero by x += rest - T y, u1 -= y, y = Y rest, with the diagonal T = de/dd and
Y = (W^-1 + T)^-1, which follows from W by one symmetric rank-one update per contact whose tangent has changed, and is
kept from step to step. Where T is exact this is Newton's method. For laws that are monotone it descends a convex
energy, whose slope along a step is -rest.y.
"""

import numpy as np

from ema.compiled import fast, inner, kernel
from ema.contact.call_kernels import EXCESS, FORCE, LIMIT, SLOPE, WAY, evaluate
from ema.contact.coupled_kernels import solve_coupled
from ema.contact.linear_kernels import add_rows, matvec

MOST = 200
"""Evaluations of the laws in one increment; the residual says how far it came."""
_LOOSE, _TIGHT, _EARLY = 0.05, 0.001, 4
"""Changes of a tangent that Y follows, over the stiffness 1/Y_ii that holds the contact, in the first ``_EARLY`` steps
and afterwards: a step leaves about this share of the error, and smaller changes cost more as updates than as one more
step."""
_FLAT = 0.5
"""Share of the slope of the energy at the start of a Newton step that may be left at its end; above it the step is too
long or too short, and its length is sought. Without that, stiff contacts that change sides run in circles."""
_UPDATES = 400
"""Rank-one updates after which Y is made anew, so that rounding does not gather."""


@fast
def stiffen(inverse, i, change, column):
    """Y after the tangent of contact i has changed (Sherman and Morrison 1950); ``column`` is a workspace."""
    size, m = len(column), 0
    weight = change / (1.0 + change * inverse[i, i])
    for j in range(size):
        column[j] = inverse[i, j]
    # two rows at a time share the loads of the column
    while m + 1 < size:
        a, b = weight * column[m], weight * column[m + 1]
        for j in range(size):
            other = column[j]
            inverse[m, j] -= a * other
            inverse[m + 1, j] -= b * other
        m += 2
    if m < size:
        a = weight * column[m]
        for j in range(size):
            inverse[m, j] -= a * column[j]


@inner
def renew(compliance, tangents, inverse, column):
    """Y from W and the tangents."""
    for i in range(len(tangents)):
        for j in range(len(tangents)):
            inverse[i, j] = compliance[i, j]
    for i in range(len(tangents)):
        if tangents[i] != 0.0:
            stiffen(inverse, i, tangents[i], column)


@inner
def follow_tangents(compliance, exchange, share, memory):
    """Let Y follow the tangents that have changed by more than ``share`` of what holds their contact."""
    inverse, tangents, used, workspace, _ = memory
    column = workspace[2]
    for i in range(len(tangents)):
        tangent = exchange[SLOPE, i]
        if abs(tangent - tangents[i]) * inverse[i, i] > share:
            stiffen(inverse, i, tangent - tangents[i], column)
            tangents[i] = tangent
            used[0] += 1
    if used[0] > _UPDATES:
        used[0] = 0
        renew(compliance, tangents, inverse, column)


@fast
def times(matrix, x, out):
    """out = matrix @ x for a symmetric matrix; few numbers of x that are not zero cost little."""
    count = 0
    for i in range(len(x)):
        out[i] = 0.0
        count += x[i] != 0.0
    if 2 * count > len(x):
        matvec(matrix, x, out)
    elif count > 0:
        add_rows(matrix, x, out)


@fast
def begin(compliance, x, free, u0, u1):
    """u1 = free - W x; returns the size of the displacements."""
    size = 1e-300
    times(compliance, x, u1)
    for i in range(len(x)):
        size += free[i] * free[i] + u0[i] * u0[i]
        u1[i] = free[i] - u1[i]
    return np.sqrt(size)


@fast
def rests(exchange, x, change, rest):
    """What is missing, e - x; returns the sum of its squares, and the slope of the energy along ``change``."""
    squares, slope = 0.0, 0.0
    for i in range(len(x)):
        rest[i] = exchange[EXCESS, i] - x[i]
        squares += rest[i] * rest[i]
        slope -= rest[i] * change[i]
    return squares, slope


@kernel
def solve(laws, problem, displacements, exchange, states, memory):
    """Solve one increment of all contacts; returns the Newton steps taken, and the residual.

    laws: table of groups, parameters, curves. problem: W, its norm (largest sum of a row), 1/h (0: slowly), tolerance
    of the displacements over their root of the sum of squares, as is the residual. displacements: ``free`` and the
    displacements before, and after, which is returned. exchange: ``call_kernels``, as the laws left it in the end.
    states: before, and after, which is returned. memory, kept from step to step: Y, T, the number of updates, workspace
    (3, contact), and x, which is the start. Contacts that depend on each other have a fourth table in ``laws``.
    """
    if len(laws) > 3:
        return solve_coupled(laws, problem, displacements, exchange, states, memory)
    (compliance, norm, rate, tolerance), (free, u0, u1) = problem, displacements
    (before, after), (inverse, tangents, _, workspace, x) = states, memory
    rest, change, way = workspace[0], workspace[1], workspace[2]
    size = begin(compliance, x, free, u0, u1)
    iterations, start, length, low, high, worst = 0, 0.0, 1.0, 0.0, np.inf, 0.0
    for _ in range(MOST):
        for i in range(len(x)):
            exchange[WAY, i] = u1[i] - u0[i]
        evaluate(laws, rate, exchange, before, after)
        worst, slope = rests(exchange, x, change, rest)
        worst = np.sqrt(worst) * norm
        if not worst > tolerance * size:  # nor where it is no number
            break
        if start < 0.0 and abs(slope) > _FLAT * abs(start) and high - low > 1e-9:
            if slope < 0.0:
                low = length
            else:
                high = length
            longer = 0.5 * (low + high) - length if high < np.inf else length
            length += longer
        else:
            share = _LOOSE if iterations < _EARLY else _TIGHT
            follow_tangents(compliance, exchange, share, memory)
            times(inverse, rest, change)
            start = 0.0
            for i in range(len(x)):
                way[i] = rest[i] - tangents[i] * change[i]
                start -= rest[i] * change[i]
            longer, length, low, high = 1.0, 1.0, 0.0, np.inf
            iterations += 1
        for i in range(len(x)):
            x[i] += longer * way[i]
            u1[i] -= longer * change[i]
    # what the laws say at u1, exactly zero where a contact sticks
    for i in range(len(x)):
        x[i] += rest[i]
    return iterations, worst / size


@kernel
def drive(laws, motion, rate, exchange, states, forces):
    """Forces (contact, sample) along ``motion``: displacements and slip forces alike.

    1/``rate`` s between samples.
    """
    (path, limits), (before, after) = motion, states
    for n in range(path.shape[1]):
        for i in range(len(path)):
            exchange[WAY, i] = path[i, n] - path[i, max(n - 1, 0)]
            exchange[LIMIT, i] = limits[i, n]
        evaluate(laws, rate, exchange, before, after)
        for i in range(len(path)):
            forces[i, n] = exchange[FORCE, i]
        before, after = after, before
