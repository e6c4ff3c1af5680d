"""Compiled time steps: exact modal motion under the mean contact force of a step, solved at the contacts.

Old and new friction force enter with equal weight, so the work over a step is their mean times the increment of the
relative displacement: stored energy plus friction loss to the last digit, whatever the step. Short loops with one
output each: the compiler turns these into vector instructions.
"""

import numba as nb
import numpy as np

from ema.simulate.contact_kernels import add_rows, copy_into, fresh_table, matvec, slide_or_stick, sweep_contacts
from ema.simulate.friction_kernels import project, stored_energy

# rows of the table of modal coefficients (6, mode): end displacement and velocity from q, p and the mean force
Q_Q, Q_P, Q_F, P_Q, P_P, P_F = range(6)
# places in the vector of running energies
FRICTION, DAMPING, PROJECTION, SUPPLIED = range(4)
FAST = {"reassoc", "contract", "nsz", "arcp"}


@nb.njit(cache=True, fastmath=FAST)
def propagate(flow, place, q, p, force, out):
    """End displacement (``place`` Q_Q) or velocity (P_Q) of every mode."""
    for r in range(len(q)):
        out[r] = flow[place, r] * q[r] + flow[place + 1, r] * p[r] + flow[place + 2, r] * force[r]


@nb.njit(cache=True, fastmath=FAST)
def correct(response, change, out):
    """Half the change of the contact forces acts over the step."""
    for r in range(len(out)):
        out[r] -= 0.5 * response[r] * change[r]


@nb.njit(cache=True, fastmath=FAST)
def damping_loss(loss, q, p, force):
    """Energy lost to damping over a step: in every mode a quadratic form of its state and its force."""
    total = 0.0
    for r in range(len(q)):
        x, v, f = q[r], p[r], force[r]
        total += x * (loss[0, r] * x + loss[1, r] * v + loss[2, r] * f) + v * (loss[3, r] * v + loss[4, r] * f)
        total += loss[5, r] * f * f
    return total


@nb.njit(cache=True, fastmath=FAST)
def form_of(matrix, x):
    """x.T @ matrix @ x of a symmetric matrix, from its lower half."""
    total = 0.0
    for i in range(len(x)):
        row = 0.5 * matrix[i, i] * x[i]
        for j in range(i):
            row += matrix[i, j] * x[j]
        total += 2.0 * row * x[i]
    return total


@nb.njit(cache=True, fastmath=FAST)
def pushes(squares, q, p, force, x):
    """x = (p, force - w^2 q), what moves modes that damping couples."""
    for r in range(len(q)):
        x[r] = p[r]
        x[len(q) + r] = force[r] - squares[r] * q[r]


@nb.njit(cache=True)
def move(flow, squares, q, p, force, x, q1, p1):
    """State of the modes after a step: each by itself, or all together where damping couples them (three axes)."""
    if flow.ndim == 2:
        propagate(flow, Q_Q, q, p, force, q1)
        propagate(flow, P_Q, q, p, force, p1)
    else:
        pushes(squares, q, p, force, x)
        matvec(flow[0], x, q1)
        matvec(flow[1], x, p1)
        for r in range(len(q)):
            q1[r] += q[r]


@nb.njit(cache=True)
def lost(flow, loss, squares, q, p, force, x):
    """Energy lost to damping over a step; ``x`` is room to work in."""
    if flow.ndim == 2:
        return damping_loss(loss, q, p, force) if loss.shape[0] > 0 else 0.0
    else:  # noqa: RET505 - the compiler leaves out the branch of the other number of axes
        pushes(squares, q, p, force, x)
        return form_of(loss, x)


@nb.njit(cache=True, fastmath=FAST)
def correct_all(response, change, out):
    """As ``correct``, for modes that damping couples."""
    count = len(out)
    for r in range(count):
        total = 0.0
        for s in range(count):
            total += response[r, count + s] * change[s]
        out[r] -= 0.5 * total


@nb.njit(cache=True, fastmath=FAST)
def mean_load(rows, loads, n, out):
    """Modal forces of the external loads over step n: the mean of both ends."""
    for r in range(len(out)):
        out[r] = 0.0
    for m in range(loads.shape[1]):
        load = 0.5 * (loads[n, m] + loads[n + 1, m])
        for r in range(len(out)):
            out[r] += load * rows[m, r]


@nb.njit(cache=True, fastmath=FAST)
def work(force, q1, q0):
    """Work of constant modal forces."""
    total = 0.0
    for r in range(len(force)):
        total += force[r] * (q1[r] - q0[r])
    return total


@nb.njit(cache=True, fastmath=FAST)
def modal_energy(squares, q, p):
    """Kinetic and elastic energy of all modes."""
    total = 0.0
    for r in range(len(q)):
        total += 0.5 * (p[r] * p[r] + squares[r] * q[r] * q[r])
    return total


@nb.njit(cache=True, fastmath=FAST)
def advance_linear(steps, every, flow, loss, squares, loads, rows, q, p, energies, places, out_q, out_p, out_energy):
    """The modes that no contact sees: the same exact steps without contact forces."""
    force, q1, p1 = np.zeros_like(q), np.empty_like(q), np.empty_like(q)
    for n in range(steps):
        if loads.shape[0] > 0:
            mean_load(rows, loads, n, force)
        propagate(flow, Q_Q, q, p, force, q1)
        propagate(flow, P_Q, q, p, force, p1)
        if loss.shape[0] > 0:
            energies[DAMPING] += damping_loss(loss, q, p, force)
        if loads.shape[0] > 0:
            energies[SUPPLIED] += work(force, q1, q)
        copy_into(q, q1)
        copy_into(p, p1)
        if (n + 1) % every == 0:
            sample = (n + 1) // every - 1
            for r in range(len(places)):
                out_q[sample, places[r]], out_p[sample, places[r]] = q[r], p[r]
            for e in range(4):
                out_energy[sample, e] += energies[e]
            out_energy[sample, 5] += modal_energy(squares, q, p)


@nb.njit(cache=True)
def lower_limits(limit, last, stiffness, laws, slip, f, g, pull, z, energies):
    """Bring friction forces below slip forces that fell: the forces jump, and with them the accelerations."""
    codes, _, shares_k, shares_f, counts, _, _ = laws
    for i in range(len(limit)):
        if limit[i] < last[i]:
            before = stored_energy(i, codes[i], stiffness[i], shares_k, counts[i], z)
            change = project(i, codes[i], limit[i], shares_f, counts[i], z)
            if change != 0.0:
                energies[PROJECTION] += before - stored_energy(i, codes[i], stiffness[i], shares_k, counts[i], z)
                f[i] += change
                g[i] += change
                for r in range(len(pull)):
                    pull[r] += slip[i, r] * change
        last[i] = limit[i]


@nb.njit(cache=True)
def book_masing(stiffness, signs, u, f, z, u1, f1, energies, dissipated, sliding):
    """Friction loss of a step and the new state, where every contact is one Masing spring."""
    for i in range(len(u)):
        if signs[i] != 0.0:
            own = 0.5 * (f1[i] + f[i]) * (u1[i] - u[i] - (f1[i] - f[i]) / stiffness[i])
            dissipated[i] += own
            energies[FRICTION] += own
            sliding[i] += 1.0
        u[i], f[i], z[i, 0] = u1[i], f1[i], f1[i]


@nb.njit(cache=True)
def book(stiffness, laws, u, f, z, u1, f1, z1, b, energies, dissipated, sliding):
    """The same for any law."""
    codes, _, shares_k, _, counts, _, _ = laws
    for i in range(len(u)):
        k, slope = stiffness[i], 0.0
        old = stored_energy(i, codes[i], k, shares_k, counts[i], z)
        new = stored_energy(i, codes[i], k, shares_k, counts[i], z1)
        own = 0.5 * (f1[i] + f[i]) * (u1[i] - u[i]) - (new - old)
        dissipated[i] += own
        energies[FRICTION] += own
        for j in range(counts[i]):
            slope += b[i, j]
        if slope < 0.5 * k:
            sliding[i] += 1.0
        for j in range(z.shape[1]):
            z[i, j] = z1[i, j]
        u[i], f[i] = u1[i], f1[i]


@nb.njit(cache=True, fastmath=FAST)
def contact_pull(slip, stiffness, u, f, g, pull):
    """Force g = F - k u of every contact, and what it does to the modes, free of gathered rounding."""
    for i in range(len(u)):
        g[i] = f[i] - stiffness[i] * u[i]
    pull[:] = 0.0
    add_rows(slip, g, pull)


@nb.njit(cache=True, fastmath=FAST)
def accept(change, slip, flow, g, q1, p1, pull, force, moved):
    """Let the changes of the contact forces over the step act on the modes."""
    for r in range(len(moved)):
        moved[r] = 0.0
    add_rows(slip, change, moved)
    if flow.ndim == 2:
        correct(flow[Q_F], moved, q1)
        correct(flow[P_F], moved, p1)
    else:
        correct_all(flow[0], moved, q1)
        correct_all(flow[1], moved, p1)
    for r in range(len(pull)):
        pull[r] += moved[r]
        force[r] -= 0.5 * moved[r]
    for i in range(len(change)):
        g[i] += change[i]


@nb.njit(cache=True, fastmath=FAST)
def amplitudes(squares, q, p, pull, out):
    """Of all modes about the place where the contact forces hold them; damping can only lower them."""
    for r in range(len(out)):
        away = q[r] + pull[r] / squares[r]
        out[r] = np.sqrt(away * away + p[r] * p[r] / squares[r])


@nb.njit(cache=True)
def stride(spans, amplitude, reach, known, limit, f, left):
    """Longest stride (2, 4, 8 ... steps: level 0, 1, 2 ...) in which no contact can come to its limit; -1 is none.

    ``spans`` (level, contact, mode): how far a unit amplitude can change the contact forces meanwhile; ``reach``
    (level, contact) keeps that of the present amplitudes for the first ``known`` levels; ``left``: steps at most.
    """
    level = 0
    while level < spans.shape[0] and 2 << level <= left:
        if level >= known[0]:
            matvec(spans[level], amplitude, reach[level])
            known[0] = level + 1
        for i in range(len(limit)):
            if abs(f[i]) + reach[level, i] >= limit[i]:
                return level - 1
        level += 1
    return level - 1


@nb.njit(cache=True)
def glide(flow, loss, slip, stiffness, g, q, p, force, pull, q1, p1, u, f, z):
    """A stride in which every contact sticks: exact over any length. Returns the loss to damping."""
    for r in range(len(q)):
        force[r] = -pull[r]
    propagate(flow, Q_Q, q, p, force, q1)
    propagate(flow, P_Q, q, p, force, p1)
    matvec(slip, q1, u)
    for i in range(len(u)):
        f[i] = g[i] + stiffness[i] * u[i]
        z[i, 0] = f[i]
    return damping_loss(loss, q, p, force) if loss.shape[0] > 0 else 0.0


@nb.njit(cache=True)
def advance(
    steps, every, h, modal, contact, limits, loads, rows, laws, state, sums, last_limits, places, samples, general,
    strides,
):  # fmt: skip
    """Take ``steps`` steps from ``state`` (q, p, u, f, z), which is updated; sample every ``every``-th.

    modal: tables of ``ema.simulate.flow`` and squared frequencies of the modes; contact: rows of the relative
    displacements, compliance over a step, stiffness; limits (row, contact): slip forces, one row for all steps or one
    per step; loads (row, load): external forces at the ends of the steps, no row without them. ``general`` is
    None when every contact is one Masing spring: its exact solution is then all that is compiled. strides: tables of
    2, 4, 8 ... steps at once, ``spans`` of ``stride``, and the step from which on they may be taken: that motion is
    the same, with fewer looks at contacts that stick. Returns the largest number of rounds and the worst residual.
    """
    (flow, loss, squares), (slip, gains, stiffness), (q, p, u, f, z) = modal, contact, state
    (flows, losses, spans, quiet), (energies, dissipated, sliding) = strides, sums
    contacts, modes = slip.shape
    force, outside, pull, moved = np.empty(modes), np.zeros(modes), np.zeros(modes), np.empty(modes)
    q0, p0, q1, p1, x = q.copy(), p.copy(), np.empty(modes), np.empty(modes), np.empty(2 * modes)
    free, u1, f1, g = np.empty(contacts), np.empty(contacts), np.empty(contacts), np.empty(contacts)
    change, slid, signs = np.zeros(contacts), np.empty(contacts), np.zeros(contacts)
    z1, a, b, table, used = (
        np.zeros_like(z), np.zeros_like(z), np.zeros_like(z), np.empty((contacts, contacts)), np.zeros(1, np.int64)
    )  # fmt: skip
    amplitude, reach, known = np.empty(modes), np.empty((len(spans), contacts)), np.zeros(1, np.int64)
    if general is None:
        fresh_table(gains, stiffness, signs, table)
    contact_pull(slip, stiffness, u, f, g, pull)
    worst, most, loaded, n, rounds = 0.0, 0, loads.shape[0] > 0, 0, 1
    while n < steps:
        limit = limits[n if limits.shape[0] > 1 else 0]
        level = -1
        # all stuck since the last step: until one slips, the motion is known in closed form
        if rounds == 0 and n >= quiet:
            if known[0] == 0:
                amplitudes(squares, q0, p0, pull, amplitude)
            level = stride(spans, amplitude, reach, known, limit, f, every - n % every)
        if level >= 0:
            energies[DAMPING] += glide(
                flows[level], losses[level], slip, stiffness, g, q0, p0, force, pull, q1, p1, u, f, z
            )
            n += 2 << level
        else:
            if n == 0 or limits.shape[0] > 1:
                lower_limits(limit, last_limits, stiffness, laws, slip, f, g, pull, z, energies)
            if loaded:
                mean_load(rows, loads, n, outside)
            for r in range(modes):
                force[r] = outside[r] - pull[r]
            move(flow, squares, q0, p0, force, x, q1, p1)
            matvec(slip, q1, free)
            if general is None:
                rounds, residual = slide_or_stick(
                    table, gains, stiffness, limit, g, free, signs, used, slid, u1, f1, change
                )
            else:
                rounds, residual = sweep_contacts(
                    gains, free, stiffness, limit, laws, u, f, h, z, z1, a, b, 1e-12, 1000, u1, f1, change
                )
            most, worst = max(most, rounds), max(worst, residual)
            if rounds > 0:
                accept(change, slip, flow, g, q1, p1, pull, force, moved)
                known[0] = 0
            energies[DAMPING] += lost(flow, loss, squares, q0, p0, force, x)
            if loaded:
                energies[SUPPLIED] += work(outside, q1, q0)
            if general is None:
                book_masing(stiffness, signs, u, f, z, u1, f1, energies, dissipated, sliding)
            else:
                book(stiffness, laws, u, f, z, u1, f1, z1, b, energies, dissipated, sliding)
            n += 1
        q0, q1, p0, p1 = q1, q0, p1, p0
        if n % every == 0:
            contact_pull(slip, stiffness, u, f, g, pull)
            record(n // every - 1, stiffness, laws, squares, (q0, p0, u, f, z), energies, places, samples)
            if loss.shape[0] > 0:
                known[0] = 0
    copy_into(q, q0)
    copy_into(p, p0)
    return most, worst


@nb.njit(cache=True)
def record(sample, stiffness, laws, squares, state, energies, places, samples):
    """Keep one sample; the modes go to their ``places`` among all modes."""
    codes, _, shares_k, _, counts, _, _ = laws
    (q, p, u, f, z), (out_q, out_p, out_u, out_f, out_energy) = state, samples
    for r in range(len(places)):
        out_q[sample, places[r]], out_p[sample, places[r]] = q[r], p[r]
    stored, springs = 0.0, 0.0
    for i in range(len(u)):
        out_u[sample, i], out_f[sample, i] = u[i], f[i]
        stored += stored_energy(i, codes[i], stiffness[i], shares_k, counts[i], z)
        springs += 0.5 * stiffness[i] * u[i] * u[i]
    for e in range(4):
        out_energy[sample, e] += energies[e]
    out_energy[sample, 4] += stored
    out_energy[sample, 5] += modal_energy(squares, q, p) - springs
