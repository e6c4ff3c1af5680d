"""Compiled solution of all contacts at the end of a step, or of a load increment: u1 = free - gains (g1 - g0).

g = F - k u is what friction adds to the springs of the stuck structure: it stays where a contact sticks. ``gains`` is
the compliance at the contacts.
"""

import numba as nb
import numpy as np

from ema.simulate.friction_kernels import step

MOST_EXCHANGES = 400
"""Pivots after which the table of exchanges is made anew, so that rounding does not gather."""


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"})
def matvec(matrix, vector, out):
    """out = matrix @ vector for small matrices: four rows at a time share the loads of the vector."""
    rows, columns = matrix.shape
    i = 0
    while i + 4 <= rows:
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for j in range(columns):
            x = vector[j]
            a += matrix[i, j] * x
            b += matrix[i + 1, j] * x
            c += matrix[i + 2, j] * x
            d += matrix[i + 3, j] * x
        out[i], out[i + 1], out[i + 2], out[i + 3] = a, b, c, d
        i += 4
    while i < rows:
        a = 0.0
        for j in range(columns):
            a += matrix[i, j] * vector[j]
        out[i] = a
        i += 1


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"})
def add_rows(matrix, weights, out):
    """out += weights @ matrix; rows without weight cost nothing."""
    columns = matrix.shape[1]
    for i in range(matrix.shape[0]):
        weight = weights[i]
        if weight != 0.0:
            for j in range(columns):
                out[j] += weight * matrix[i, j]


@nb.njit(cache=True)
def copy_into(out, values):
    """out[:] = values, written out: the compiler then needs no sentence about shapes, which takes it seconds."""
    for i in range(len(out)):
        out[i] = values[i]


@nb.njit(cache=True)
def copy_table(out, values):
    """The same for two axes."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = values[i, j]


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def exchange(table, k):
    """Principal pivot: force and slip of contact k change places. ``table[k]`` is column k; the inverse of itself."""
    size = table.shape[0]
    scale = 1.0 / table[k, k]
    for i in range(size):
        table[k, i] *= scale
    for j in range(size):
        if j != k:
            weight = table[j, k]
            for i in range(size):
                table[j, i] -= weight * table[k, i]
            table[j, k] = -weight * scale
    table[k, k] = scale


@nb.njit(cache=True)
def fresh_table(gains, stiffness, signs, table):
    """Table of exchanges of M = 1/k - gains with the sliding contacts exchanged."""
    size = len(stiffness)
    for i in range(size):
        for j in range(size):
            table[i, j] = -gains[i, j]
        table[i, i] += 1.0 / stiffness[i]
    for i in range(size):
        if signs[i] != 0.0:
            exchange(table, i)


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def slips_of(table, stiffness, limit, g, free, signs, slip):
    """``slip`` returns M y of the sticking contacts and y of the sliding ones, for a given set of these."""
    size = len(stiffness)
    for j in range(size):
        slip[j] = 0.0
    for i in range(size):
        if signs[i] != 0.0:
            excess = (g[i] - signs[i] * limit[i]) / stiffness[i] + free[i]
            for j in range(size):
                slip[j] += excess * table[i, j]


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def trial_forces(stiffness, limit, g, free, signs, slip, f1):
    """Forces with the present set of sliding contacts; returns how many contacts disagree with it."""
    wrong = 0
    for i in range(len(f1)):
        force = g[i] + stiffness[i] * (free[i] - slip[i])
        # a contact without normal force always slides
        sticks = (signs[i] == 0.0) & (abs(force) > limit[i] * (1.0 + 1e-13))
        slides = (limit[i] > 0.0) & (slip[i] * signs[i] < -1e-13 * limit[i])
        wrong += sticks | slides
        f1[i] = force
    return wrong


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def exchange_disagreeing(table, limit, signs, slip, f1, first_only):
    """Let the contacts that disagree change sides; returns how many did."""
    changed = 0
    for i in range(len(f1)):
        if signs[i] == 0.0:
            if abs(f1[i]) <= limit[i] * (1.0 + 1e-13):
                continue
            signs[i] = 1.0 if f1[i] > 0.0 else -1.0
        else:
            if limit[i] <= 0.0 or slip[i] * signs[i] >= -1e-13 * limit[i]:
                continue
            signs[i] = 0.0
        exchange(table, i)
        changed += 1
        if first_only:
            break
    return changed


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def slide_or_stick(table, gains, stiffness, limit, g, free, signs, used, slip, u1, f1, change):
    """Exact solution for one Masing spring per contact: which contacts slide, and how far. Returns rounds and residual.

    With y = k times the slip of a step, the force is F = g + k free - k (M y), M = 1/k - gains positive definite: a
    contact slides (y != 0) at its limit or stays below it. The set of sliding contacts, ``signs`` 1 and -1, is that of
    the step before until a contact disagrees. ``slip`` is room to work in; ``change`` returns g1 - g0.
    """
    rounds, wrong = 0, 1
    for i in range(len(f1)):
        change[i] = 0.0
    sliding = 0.0
    for i in range(len(f1)):
        sliding += abs(signs[i])
    if sliding == 0.0:
        for i in range(len(f1)):
            slip[i], u1[i] = 0.0, free[i]
        if trial_forces(stiffness, limit, g, free, signs, slip, f1) == 0:
            return 0, 0.0
    while rounds < 500:
        rounds += 1
        slips_of(table, stiffness, limit, g, free, signs, slip)
        wrong = trial_forces(stiffness, limit, g, free, signs, slip, f1)
        if wrong == 0:
            break
        # late: one at a time, the first that disagrees; this cannot run in circles
        used[0] += exchange_disagreeing(table, limit, signs, slip, f1, rounds > 20)
        if used[0] > MOST_EXCHANGES:
            used[0] = 0
            fresh_table(gains, stiffness, signs, table)
    for i in range(len(f1)):
        if signs[i] == 0.0:
            u1[i] = free[i] - slip[i]
        else:
            change[i], f1[i] = -slip[i], signs[i] * limit[i]
            u1[i] = (f1[i] - g[i] + slip[i]) / stiffness[i]
    return rounds, 0.0 if wrong == 0 else np.inf


@nb.njit(cache=True)
def contact_solve(i, free, gain, k, tolerance, limit, laws, u0, f0, h, z0, z1, a, b):
    """Displacement of contact i from u + gain * (f(u) - k u) = free; returns u and f.

    The sign of the slip increment is known beforehand; on its side the law is monotone, so Newton in a bracket.
    """
    codes, par, shares_k, shares_f, counts, tables, user = laws
    code, count = codes[i], counts[i]
    low, high = -np.inf, np.inf
    if u0 + gain * (f0 - k * u0) < free:
        low = u0
    else:
        high = u0
    # start from an elastic increment, exact while the contact sticks
    u = free - gain * (f0 - k * u0)
    force, slope = f0, k
    for _ in range(100):
        force, slope = step(code, i, k, limit, par, shares_k, shares_f, count, tables, user, u0, u, h, z0, z1, a, b)
        rest = u + gain * (force - k * u) - free
        if abs(rest) <= tolerance:
            break
        if rest > 0.0:
            high = u
        else:
            low = u
        new = u - rest / max(1.0 + gain * (slope - k), 1e-12)
        if not low < new < high:
            new = 0.5 * (low + high) if np.isfinite(low) and np.isfinite(high) else u - rest
        if new == u:
            break
        u = new
    return u, force


@nb.njit(cache=True)
def sweep_contacts(gains, free, stiffness, limits, laws, u0, f0, h, z0, z1, a, b, tolerance, sweeps, u1, f1, change):
    """The same for any law, contact after contact until the changes fall below ``tolerance``; ``change`` is the start.

    Returns sweeps and the last change, relative to the largest displacement.
    """
    size = 1e-30
    for i in range(len(u0)):
        size = max(size, abs(free[i]), abs(u0[i]))
    moved, last = 0.0, 0.0
    for sweep in range(sweeps):
        moved = 0.0
        loose = max(1e-3 * tolerance * size, 0.1 * last)
        for i in range(len(u0)):
            k, gain, start = stiffness[i], gains[i, i], f0[i] - stiffness[i] * u0[i]
            rest = free[i] + gain * (start + change[i])
            for j in range(len(u0)):
                rest -= gains[i, j] * change[j]
            # what holds a contact may be much softer than the contact: a small residual is then a long way
            close = loose * max(1.0 - gain * k, 1e-9)
            u1[i], f1[i] = contact_solve(i, rest, gain, k, close, limits[i], laws, u0[i], f0[i], h, z0, z1, a, b)
            new = f1[i] - k * u1[i] - start
            moved = max(moved, abs(new - change[i]) * gain)
            change[i] = new
        # a loosely solved contact may stay where it is by chance
        if max(moved, loose) <= tolerance * size:
            return sweep + 1, moved / size
        last = moved
    return sweeps, moved / size


@nb.njit(cache=True)
def relax_masing(gains, free, stiffness, limits, u, f, signs, table):
    """Static equilibrium of Masing springs, u + gains (f - k u) = free, from u and f; ``signs`` are kept.

    Returns the residual.
    """
    g, ahead, slip, change = f - stiffness * u, np.empty_like(u), np.empty_like(u), np.empty_like(u)
    matvec(gains, g, ahead)
    used = np.zeros(1, np.int64)
    _, residual = slide_or_stick(table, gains, stiffness, limits, g, free - ahead, signs, used, slip, u, f, change)
    return residual
