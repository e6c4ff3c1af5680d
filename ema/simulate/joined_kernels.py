"""Compiled steps of contacts that hang together: friction in two directions, and normal forces that change.

The rows are those of all contacts; the last ones are the normal contacts. ``partner`` is the other direction of an
isotropic contact, ``normal_of`` the normal contact that presses it (counted from the first), both -1 where there is
none; ``friction`` is the slip force over the momentary normal force.
"""

import numpy as np

from ema.compiled import compiled
from ema.contact.linear_kernels import matvec
from ema.simulate.friction_kernels import LUGRE, PARALLEL, project, step, stored_energy
from ema.simulate.normal_kernels import FORCE, PENETRATION, mean_pull, pull
from ema.simulate.plane_kernels import plane_step
from ema.simulate.transient_kernels import (
    DAMPING,
    FRICTION,
    PROJECTION,
    SUPPLIED,
    accept,
    contact_pull,
    lost,
    mean_load,
    modal_energy,
    move,
    work,
)

# columns of what is kept of every normal contact: extremes of its force, steps open, first of them, widest gap
LEAST, GREATEST, OPEN, FIRST, GAP = range(5)
MOST, SHORTEST = 80, 1e-3
"""Evaluations of the laws from one start, and the share of a Newton step below which it is taken as it is."""


@compiled()
def forces_joined(
    stiffness,
    limits,
    laws,
    ties,
    mean,
    u0,
    f0,
    h,
    z0,
    z1,
    a,
    b,
    a2,
    b2,
    u1,
    f1,
    own,
    cross,
    pressed,
):
    """Forces at given displacements, with slopes by the ``own`` displacement, by the partner's, and by the gap."""
    codes, par, shares_k, shares_f, counts, tables, user = laws
    partner, normal_of, friction, pairs, curve = ties
    first = len(u0) - len(pairs)
    slopes = np.empty(len(pairs))
    for n in range(len(pairs)):
        i = first + n
        shut, slopes[n], _ = pull(pairs[n], curve, u1[i])
        f1[i], own[i] = shut, slopes[n]
        if mean:
            middle, slope = mean_pull(pairs[n], curve, u0[i], u1[i])
            f1[i], own[i] = 2.0 * middle - f0[i], 2.0 * slope
    for i in range(first):
        j, n, k = partner[i], normal_of[i], stiffness[i]
        if 0 <= j < i:
            continue
        more = 0.0
        if n >= 0:
            shut, _, _ = pull(pairs[n], curve, u1[first + n])
            limits[i] = friction[i] * (pairs[n, FORCE] - shut)
            more = 1e-6 * max(limits[i], 1e-3 * friction[i] * pairs[n, FORCE], 1e-12)
        if j >= 0:
            limits[j] = limits[i]
            if n >= 0:
                px, py, _, _, _, _ = plane_step(
                    codes[i],
                    i,
                    j,
                    k,
                    limits[i] + more,
                    par,
                    shares_k,
                    shares_f,
                    counts[i],
                    tables,
                    u0[i],
                    u0[j],
                    u1[i],
                    u1[j],
                    h,
                    z0,
                    z1,
                    a2,
                    b2,
                )
            f1[i], f1[j], own[i], cross[i], cross[j], own[j] = plane_step(
                codes[i],
                i,
                j,
                k,
                limits[i],
                par,
                shares_k,
                shares_f,
                counts[i],
                tables,
                u0[i],
                u0[j],
                u1[i],
                u1[j],
                h,
                z0,
                z1,
                a2,
                b2,
            )
            if n >= 0:
                gain = -friction[i] * slopes[n] / more
                pressed[i], pressed[j] = (px - f1[i]) * gain, (py - f1[j]) * gain
        else:
            if n >= 0:
                px, _ = step(
                    codes[i],
                    i,
                    k,
                    limits[i] + more,
                    par,
                    shares_k,
                    shares_f,
                    counts[i],
                    tables,
                    user,
                    u0[i],
                    u1[i],
                    h,
                    z0,
                    z1,
                    a,
                    b,
                )
            f1[i], own[i] = step(
                codes[i],
                i,
                k,
                limits[i],
                par,
                shares_k,
                shares_f,
                counts[i],
                tables,
                user,
                u0[i],
                u1[i],
                h,
                z0,
                z1,
                a,
                b,
            )
            if n >= 0:
                pressed[i] = -(px - f1[i]) * friction[i] * slopes[n] / more


@compiled()
def solve_joined(
    gains,
    free,
    stiffness,
    limits,
    laws,
    ties,
    mean,
    u0,
    f0,
    h,
    z0,
    z1,
    a,
    b,
    a2,
    b2,
    tolerance,
    u1,
    f1,
    change,
):
    """All contacts at once by Newton's method, halved where it must be; ``limits`` follow the normal forces.

    ``change`` is the start and returns g1 - g0, g = f - k u. ``mean``: the forces of the normal contacts are those
    whose mean with the old ones does the work of the way. Where the start leads nowhere the old state is another one.
    Returns Newton steps and the residual over the largest displacement.
    """
    partner, normal_of, _, pairs, _ = ties
    rows, first = len(u0), len(u0) - len(pairs)
    own, cross, pressed = np.empty(rows), np.zeros(rows), np.zeros(rows)
    rest, trial, jacobian = np.empty(rows), np.empty(rows), np.empty((rows, rows))
    start, step_of, size = f0 - stiffness * u0, np.zeros(rows), 1e-30
    for i in range(rows):
        size = max(size, abs(free[i]), abs(u0[i]))
    iterations, norm = 0, np.inf
    for attempt in range(2):
        if attempt == 0:
            matvec(gains, change, rest)
            for i in range(rows):
                trial[i] = free[i] - rest[i]
        else:
            trial[:] = u0
        norm, length = np.inf, 1.0
        for _ in range(MOST):
            forces_joined(
                stiffness,
                limits,
                laws,
                ties,
                mean,
                u0,
                f0,
                h,
                z0,
                z1,
                a,
                b,
                a2,
                b2,
                trial,
                f1,
                own,
                cross,
                pressed,
            )
            for i in range(rows):
                change[i] = f1[i] - stiffness[i] * trial[i] - start[i]
            matvec(gains, change, rest)
            new = 0.0
            for i in range(rows):
                rest[i] += trial[i] - free[i]
                new = max(new, abs(rest[i]))
            if new > (1.0 - 0.1 * length) * norm and length > SHORTEST:
                length *= 0.5
                for i in range(rows):
                    trial[i] = u1[i] - length * step_of[i]
                continue
            u1[:], norm, length = trial, new, 1.0
            if norm <= tolerance * size:
                return iterations, norm / size
            iterations += 1
            for r in range(rows):
                for i in range(rows):
                    jacobian[r, i] = gains[r, i] * (own[i] - stiffness[i])
                jacobian[r, r] += 1.0
                for i in range(first):
                    if partner[i] >= 0:
                        jacobian[r, partner[i]] += gains[r, i] * cross[i]
                    if normal_of[i] >= 0:
                        jacobian[r, first + normal_of[i]] += gains[r, i] * pressed[i]
            step_of[:] = np.linalg.solve(jacobian, rest)
            for i in range(rows):
                trial[i] = u1[i] - step_of[i]
    return iterations, norm / size


@compiled()
def relax_joined(
    gains,
    free,
    stiffness,
    limits,
    laws,
    ties,
    u,
    f,
    z,
):
    """Static equilibrium, u + gains (f - k u) = free, from u, f, z; ``limits`` are updated. Returns the residual."""
    rows, width = z.shape
    z1, a, b = np.zeros_like(z), np.zeros_like(z), np.zeros_like(z)
    a2, b2 = np.zeros((rows, width, 2)), np.zeros((rows, width, 2))
    u1, f1, change, ahead = u.copy(), f.copy(), np.zeros(rows), np.empty(rows)
    matvec(gains, f - stiffness * u, ahead)
    _, residual = solve_joined(
        gains,
        free - ahead,
        stiffness,
        limits,
        laws,
        ties,
        False,
        u,
        f,
        np.inf,
        z,
        z1,
        a,
        b,
        a2,
        b2,
        1e-13,
        u1,
        f1,
        change,
    )
    u[:], f[:], z[:] = u1, f1, z1
    return residual


@compiled()
def stored_joined(stiffness, codes, shares_k, counts, pairs, curve, u, z):
    """Energy in all contacts; that of the normal contacts is counted from their preload."""
    total, first = 0.0, len(u) - len(pairs)
    for i in range(len(u)):
        if i < first:
            total += stored_energy(i, codes[i], stiffness[i], shares_k, counts[i], z)
        else:
            _, _, energy = pull(pairs[i - first], curve, u[i])
            total += energy
    return total


@compiled()
def project_plane(i, j, code, limit, shares_f, count, z):
    """Bring the forces of an isotropic contact straight back to its smaller circle; returns their changes."""
    dx, dy = 0.0, 0.0
    if code == LUGRE and limit > 0.0:
        return dx, dy
    for n in range(count if code == PARALLEL else 1):
        size, top = np.sqrt(z[i, n] ** 2 + z[j, n] ** 2), limit * shares_f[i, n]
        if size > top:
            dx, dy = dx + z[i, n] * (top / size - 1.0), dy + z[j, n] * (top / size - 1.0)
            z[i, n], z[j, n] = z[i, n] * top / size, z[j, n] * top / size
    return dx, dy


@compiled()
def lower_joined(limit, last, stiffness, laws, ties, slip, f, g, pulled, z, energies):
    """Bring friction forces below given slip forces that fell."""
    codes, _, shares_k, shares_f, counts, _, _ = laws
    partner, normal_of, _, _, _ = ties
    for i in range(len(partner)):
        j = partner[i]
        if normal_of[i] >= 0 or 0 <= j < i or not limit[i] < last[i]:
            continue
        before = stored_energy(i, codes[i], stiffness[i], shares_k, counts[i], z)
        if j >= 0:
            before += stored_energy(j, codes[i], stiffness[i], shares_k, counts[i], z)
            dx, dy = project_plane(i, j, codes[i], limit[i], shares_f, counts[i], z)
            f[j] += dy
            g[j] += dy
            after = stored_energy(j, codes[i], stiffness[i], shares_k, counts[i], z)
            for r in range(len(pulled)):
                pulled[r] += slip[j, r] * dy
        else:
            dx, after = project(i, codes[i], limit[i], shares_f, counts[i], z), 0.0
        f[i] += dx
        g[i] += dx
        after += stored_energy(i, codes[i], stiffness[i], shares_k, counts[i], z)
        energies[PROJECTION] += before - after
        for r in range(len(pulled)):
            pulled[r] += slip[i, r] * dx
    last[:] = limit


@compiled()
def book_joined(n, stiffness, laws, ties, u, f, z, u1, f1, z1, b, b2, sums, kept):
    """Friction loss of a step and the new state; normal contacts lose nothing."""
    codes, _, shares_k, _, counts, _, _ = laws
    partner, _, _, pairs, curve = ties
    energies, dissipated, sliding = sums
    rows, first = len(u), len(u) - len(pairs)
    for i in range(first):
        k, slope = stiffness[i], 0.0
        old = stored_energy(i, codes[i], k, shares_k, counts[i], z)
        new = stored_energy(i, codes[i], k, shares_k, counts[i], z1)
        own = 0.5 * (f1[i] + f[i]) * (u1[i] - u[i]) - (new - old)
        dissipated[i] += own
        energies[FRICTION] += own
        if partner[i] < 0:
            for m in range(counts[i]):
                slope += b[i, m]
        else:
            x, y = min(i, partner[i]), max(i, partner[i])
            for m in range(counts[i]):
                slope += b2[x, m, 0] + b2[y, m, 1]
            slope -= k
        if slope < 0.5 * k:
            sliding[i] += 1.0
    for i in range(first, rows):
        pair, record = pairs[i - first], kept[i - first]
        f1[i], _, _ = pull(pair, curve, u1[i])
        normal = pair[FORCE] - f1[i]
        record[LEAST], record[GREATEST] = min(record[LEAST], normal), max(record[GREATEST], normal)
        if normal <= 0.0:
            if record[OPEN] == 0.0:
                record[FIRST] = n
            record[OPEN] += 1.0
            sliding[i] += 1.0
            record[GAP] = max(record[GAP], u1[i] - pair[PENETRATION])
    u[:], f[:], z[:] = u1, f1, z1


@compiled()
def advance_joined(
    steps,
    every,
    h,
    modal,
    joints,
    limits,
    loads,
    load_rows,
    laws,
    ties,
    state,
    sums,
    last_limits,
    kept,
    done,
    places,
    samples,
):
    """As ``transient_kernels.advance``, for contacts that hang together.

    ``kept`` (normal contact, 5) gathers extremes, counted on from step ``done``.
    """
    flow, loss, squares = modal
    slip, gains, stiffness = joints
    _, _, shares_k, _, counts, _, _ = laws
    _, normal_of, _, pairs, curve = ties
    q, p, u, f, z = state
    energies = sums[0]
    contacts, modes = slip.shape
    force, outside, pulled, moved = np.empty(modes), np.zeros(modes), np.zeros(modes), np.empty(modes)
    q0, p0, q1, p1, x = q.copy(), p.copy(), np.empty(modes), np.empty(modes), np.empty(2 * modes)
    free, u1, f1, g, change = np.empty(contacts), u.copy(), f.copy(), np.empty(contacts), np.zeros(contacts)
    z1, a, b = z.copy(), np.zeros_like(z), np.zeros_like(z)
    a2, b2 = np.zeros((*z.shape, 2)), np.zeros((*z.shape, 2))
    momentary = last_limits.copy()
    worst, most, loaded = 0.0, 0, loads.shape[0] > 0
    for n in range(steps):
        limit = limits[n if limits.shape[0] > 1 else 0]
        contact_pull(slip, stiffness, u, f, g, pulled)
        if n == 0 or limits.shape[0] > 1:
            lower_joined(limit, last_limits, stiffness, laws, ties, slip, f, g, pulled, z, energies)
            for i in range(len(normal_of)):
                if normal_of[i] < 0:
                    momentary[i] = limit[i]
        if loaded:
            mean_load(load_rows, loads, n, outside)
        for r in range(modes):
            force[r] = outside[r] - pulled[r]
        move(flow, squares, q0, p0, force, x, q1, p1)
        matvec(slip, q1, free)
        rounds, residual = solve_joined(
            gains, free, stiffness, momentary, laws, ties, True, u, f, h, z, z1, a, b, a2, b2, 1e-11, u1, f1, change
        )
        worst, most = max(worst, residual), max(most, rounds)
        accept(change, slip, flow, g, q1, p1, pulled, force, moved)
        energies[DAMPING] += lost(flow, loss, squares, q0, p0, force, x)
        if loaded:
            energies[SUPPLIED] += work(outside, q1, q0)
        q0, q1, p0, p1 = q1, q0, p1, p0
        book_joined(done + n + 1, stiffness, laws, ties, u, f, z, u1, f1, z1, b, b2, sums, kept)
        if (n + 1) % every == 0:
            sample, springs = (n + 1) // every - 1, 0.0
            out_q, out_p, out_u, out_f, out_energy = samples
            for r in range(len(places)):
                out_q[sample, places[r]], out_p[sample, places[r]] = q0[r], p0[r]
            for i in range(contacts):
                out_u[sample, i], out_f[sample, i] = u[i], f[i]
                springs += 0.5 * stiffness[i] * u[i] * u[i]
            for e in range(4):
                out_energy[sample, e] += energies[e]
            out_energy[sample, 4] += stored_joined(stiffness, laws[0], shares_k, counts, pairs, curve, u, z)
            out_energy[sample, 5] += modal_energy(squares, q0, p0) - springs
    q[:], p[:] = q0, p0
    return most, worst
