"""Compiled time steps: exact modal motion under the mean contact force of a step, solved at the contacts.

Old and new friction force enter with equal weight, so the work over a step is their mean times the increment of the
relative displacement: stored energy plus friction loss to the last digit, whatever the step.
"""

import numba as nb
import numpy as np

from ema.simulate.friction_kernels import project, step, stored_energy

# columns of the table of modal coefficients (mode, 6): end displacement and velocity from q, p and the mean force
Q_Q, Q_P, Q_F, P_Q, P_P, P_F = range(6)
# places in the vector of running energies
FRICTION, DAMPING, PROJECTION, SUPPLIED = range(4)


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz", "arcp"})
def matvec(matrix, vector, out):
    """out = matrix @ vector for small matrices."""
    for i in range(matrix.shape[0]):
        total = 0.0
        for j in range(matrix.shape[1]):
            total += matrix[i, j] * vector[j]
        out[i] = total


@nb.njit(cache=True)
def contact_solve(
    i, free, gain, k, tolerance, codes, limit, par, shares_k, shares_f, counts, tables, user, u0, f0, h, z0, z1, a, b
):
    """Displacement of contact i from u + gain * (f(u) - k u) = free; returns u and f.

    The sign of the slip increment is known beforehand; on its side the law is monotone, so Newton in a bracket.
    """
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
        new = u - rest / max(1.0 + gain * (slope - k), 1e-3)
        if not low < new < high:
            new = 0.5 * (low + high) if np.isfinite(low) and np.isfinite(high) else u - rest
        if new == u:
            break
        u = new
    return u, force


@nb.njit(cache=True)
def quadratic_form(c, q, p, f):
    """Energy lost in one mode over a step: a quadratic form of its state and its force."""
    return q * (c[0] * q + c[1] * p + c[2] * f) + p * (c[3] * p + c[4] * f) + c[5] * f * f


@nb.njit(cache=True)
def advance_linear(steps, every, coefficients, quadratic, loads, load_rows, q, p, energies, out_q, out_p, out_energy):
    """The modes that no contact sees: the same exact steps without contact forces."""
    sample = 0
    for n in range(steps):
        for r in range(len(q)):
            c, force = coefficients[r], 0.0
            for m in range(loads.shape[1]):
                force += 0.5 * load_rows[r, m] * (loads[n, m] + loads[n + 1, m])
            q_new = c[Q_Q] * q[r] + c[Q_P] * p[r] + c[Q_F] * force
            energies[SUPPLIED] += force * (q_new - q[r])
            if quadratic.shape[0] > 0:
                energies[DAMPING] += quadratic_form(quadratic[r], q[r], p[r], force)
            p[r] = c[P_Q] * q[r] + c[P_P] * p[r] + c[P_F] * force
            q[r] = q_new
        if (n + 1) % every == 0:
            out_q[sample], out_p[sample], out_energy[sample] = q, p, energies
            sample += 1


@nb.njit(cache=True)
def relax(gains, free, stiffness, limits, codes, par, shares_k, shares_f, counts, tables, user, u, f, z, sweeps):
    """Static equilibrium of the contacts, u + gains (f - k u) = free, from the state u, f, z; returns the residual."""
    contacts = len(u)
    z1, a, b = np.zeros_like(z), np.zeros_like(z), np.zeros_like(z)
    g, start, begun = f - stiffness * u, u.copy(), f.copy()
    change, size = 0.0, max(np.abs(free).max(), np.abs(u).max(), 1e-30)
    for _ in range(sweeps):
        change = 0.0
        for i in range(contacts):
            rest = free[i] + gains[i, i] * g[i]
            for j in range(contacts):
                rest -= gains[i, j] * g[j]
            new, force = contact_solve(
                i, rest, gains[i, i], stiffness[i], 1e-15 * size, codes, limits[i], par, shares_k, shares_f,
                counts, tables, user, start[i], begun[i], 1.0, z, z1, a, b,
            )  # fmt: skip
            change = max(change, abs(force - stiffness[i] * new - g[i]) * gains[i, i])
            g[i], u[i], f[i] = force - stiffness[i] * new, new, force
        if change <= 1e-14 * size:
            break
    z[:] = z1
    return change / size


@nb.njit(cache=True)
def lower_limits(limit, last, stiffness, codes, shares_k, shares_f, counts, slip_t, f, g, pull, z, energies):
    """Bring friction forces below slip forces that fell; returns the change of stored energy.

    The force jumps, and with it the acceleration at the start of the step.
    """
    moved = 0.0
    for i in range(len(limit)):
        if limit[i] < last[i]:
            before = stored_energy(i, codes[i], stiffness[i], shares_k, counts[i], z)
            change = project(i, codes[i], limit[i], shares_f, counts[i], z)
            if change != 0.0:
                after = stored_energy(i, codes[i], stiffness[i], shares_k, counts[i], z)
                energies[PROJECTION] += before - after
                moved += after - before
                f[i] += change
                g[i] += change
                for r in range(len(pull)):
                    pull[r] += slip_t[r, i] * change
        last[i] = limit[i]
    return moved


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def advance(
    steps, every, h, coefficients, quadratic, slip, slip_t, gains, stiffness, limits, loads, load_rows,
    codes, par, shares_k, shares_f, counts, tables, user,
    q, p, u, f, z, energies, dissipated, sliding, last_limits, out_q, out_p, out_u, out_f, out_energy, general,
):  # fmt: skip
    """Take ``steps`` steps from the state in q, p, u, f, z; sample every ``every``-th.

    limits (row, contact): slip forces, one row for all steps or one per step; loads (row, load): external forces at
    the ends of the steps, no row without them. ``general`` is None when every contact is one Masing spring: its closed
    form is then all that is compiled. Returns the largest number of sweeps and the worst residual.
    """
    contacts, modes = slip.shape
    qh, ph, force, uh, g = np.empty(modes), np.empty(modes), np.empty(modes), np.empty(contacts), np.empty(contacts)
    z1, a, b = np.zeros_like(z), np.zeros_like(z), np.zeros_like(z)
    u1, before, pull, new_pull = np.empty(contacts), np.empty(contacts), np.empty(modes), np.empty(modes)
    stored = 0.0
    for i in range(contacts):
        g[i] = f[i] - stiffness[i] * u[i]
        before[i] = g[i]
        stored += stored_energy(i, codes[i], stiffness[i], shares_k, counts[i], z)
    matvec(slip_t, g, pull)
    sample, worst, most = 0, 0.0, 0
    damped, loaded = quadratic.shape[0] > 0, loads.shape[0] > 0
    for n in range(steps):
        limit = limits[n if limits.shape[0] > 1 else 0]
        if n == 0 or limits.shape[0] > 1:
            stored += lower_limits(
                limit, last_limits, stiffness, codes, shares_k, shares_f, counts, slip_t, f, g, pull, z, energies
            )
        for r in range(modes):
            c = coefficients[r]
            outside = 0.0
            if loaded:
                for m in range(loads.shape[1]):
                    outside += 0.5 * load_rows[r, m] * (loads[n, m] + loads[n + 1, m])
            force[r] = outside - 0.5 * pull[r]
            qh[r] = c[Q_Q] * q[r] + c[Q_P] * p[r] + c[Q_F] * force[r]
            ph[r] = c[P_Q] * q[r] + c[P_P] * p[r] + c[P_F] * force[r]
            if loaded:
                energies[SUPPLIED] -= outside * q[r]
        matvec(slip, qh, uh)
        size = 1e-30
        for i in range(contacts):
            size = max(size, abs(uh[i]), abs(u[i]))
        for i in range(contacts):
            # slipping contacts go on as before: a start close to the answer
            guess = g[i] + (g[i] - before[i])
            before[i], g[i] = g[i], guess
        sweeps, change, last = 0, 0.0, np.inf
        while sweeps < 1000:
            sweeps += 1
            change = 0.0
            for i in range(contacts):
                gain, k = gains[i, i], stiffness[i]
                free = uh[i] + gain * g[i]
                for j in range(contacts):
                    free -= gains[i, j] * g[j]
                if general is None:
                    start = z[i, 0] - k * u[i]
                    new = free - gain * start
                    contact = k * new + start
                    b[i, 0] = k
                    if abs(contact) > limit[i]:
                        contact = limit[i] if contact > 0.0 else -limit[i]
                        new = (free - gain * contact) / (1.0 - gain * k)
                        b[i, 0] = 0.0
                    z1[i, 0] = contact
                    rest = contact - k * new if b[i, 0] == 0.0 else start
                else:
                    loose = max(1e-13 * size, 0.1 * last)
                    new, contact = contact_solve(
                        i, free, gain, k, loose, codes, limit[i], par, shares_k, shares_f,
                        counts, tables, user, u[i], f[i], h, z, z1, a, b,
                    )  # fmt: skip
                    rest = contact - k * new
                change = max(change, abs(rest - g[i]) * gain)
                g[i], u1[i] = rest, new
            if change <= 1e-10 * size:
                break
            last = change
        worst, most = max(worst, change / size), max(most, sweeps)
        matvec(slip_t, g, new_pull)
        for r in range(modes):
            c = coefficients[r]
            outside = force[r] + 0.5 * pull[r]
            force[r] -= 0.5 * new_pull[r]
            if damped:
                energies[DAMPING] += quadratic_form(quadratic[r], q[r], p[r], force[r])
            q[r] = qh[r] - 0.5 * c[Q_F] * new_pull[r]
            p[r] = ph[r] - 0.5 * c[P_F] * new_pull[r]
            pull[r] = new_pull[r]
            if loaded:
                energies[SUPPLIED] += outside * q[r]
        kept = 0.0
        for i in range(contacts):
            k = stiffness[i]
            if general is None:
                old, new = z[i, 0] * z[i, 0] / (2.0 * k), z1[i, 0] * z1[i, 0] / (2.0 * k)
                slope, contact = b[i, 0], z1[i, 0]
                z[i, 0] = z1[i, 0]
            else:
                old = stored_energy(i, codes[i], k, shares_k, counts[i], z)
                new = stored_energy(i, codes[i], k, shares_k, counts[i], z1)
                slope, contact = 0.0, g[i] + k * u1[i]
                for j in range(counts[i]):
                    slope += b[i, j]
                for j in range(z.shape[1]):
                    z[i, j] = z1[i, j]
            own = 0.5 * (contact + f[i]) * (u1[i] - u[i]) - (new - old)
            kept += new
            dissipated[i] += own
            energies[FRICTION] += own
            if slope < 0.5 * k:
                sliding[i] += 1.0
            f[i], u[i] = contact, u1[i]
        stored = kept
        if (n + 1) % every == 0:
            out_q[sample], out_p[sample], out_u[sample], out_f[sample] = q, p, u, f
            out_energy[sample, :4] = energies
            out_energy[sample, 4] = stored
            sample += 1
    return most, worst
