"""Compiled time steps: exact modal motion under the mean contact force of a step, solved at the contacts.

Old and new friction force enter with equal weight, so the work over a step is their mean times the increment of the
relative displacement: stored energy plus friction loss to the last digit, whatever the step. Short loops with one
output each: the compiler turns these into vector instructions.
"""

import numpy as np

from ema.compiled import fast, inner, kernel
from ema.contact.call_kernels import EXCESS, FORCE, LIMIT, PRESSURE, SLOPE, STIFFNESS
from ema.contact.linear_kernels import add_rows, copy_into, copy_table, matvec
from ema.contact.solve_kernels import solve

# rows of the table of modal coefficients (6, mode): end displacement and velocity from q, p and the mean force
Q_Q, Q_P, Q_F, P_Q, P_P, P_F = range(6)
# places in the vector of running energies
FRICTION, DAMPING, PROJECTION, SUPPLIED = range(4)
# columns of what is kept of every normal contact: extremes of its force, steps open, first of them, widest opening then
LEAST, GREATEST, OPEN, START, GAP = range(5)
_ALONE, _COUPLED = 1e-12, 1e-11
"""Sought residual of the displacements, of contacts that depend on the structure alone, and on each other: unsymmetric
equations of stiff contacts leave more of the rounding."""


@fast
def propagate(flow, place, q, p, force, out):
    """End displacement (``place`` Q_Q) or velocity (P_Q) of every mode."""
    for r in range(len(q)):
        out[r] = flow[place, r] * q[r] + flow[place + 1, r] * p[r] + flow[place + 2, r] * force[r]


@fast
def correct(response, change, out):
    """Half the change of the contact forces acts over the step."""
    for r in range(len(out)):
        out[r] -= 0.5 * response[r] * change[r]


@fast
def damping_loss(loss, q, p, force):
    """Energy lost to damping over a step: in every mode a quadratic form of its state and its force."""
    total = 0.0
    for r in range(len(q)):
        x, v, f = q[r], p[r], force[r]
        total += x * (loss[0, r] * x + loss[1, r] * v + loss[2, r] * f) + v * (loss[3, r] * v + loss[4, r] * f)
        total += loss[5, r] * f * f
    return total


@fast
def form_of(matrix, x):
    """x.T @ matrix @ x of a symmetric matrix, from its lower half."""
    total = 0.0
    for i in range(len(x)):
        row = 0.5 * matrix[i, i] * x[i]
        for j in range(i):
            row += matrix[i, j] * x[j]
        total += 2.0 * row * x[i]
    return total


@fast
def pushes(squares, q, p, force, x):
    """x = (p, force - w^2 q), what moves modes that damping couples."""
    for r in range(len(q)):
        x[r] = p[r]
        x[len(q) + r] = force[r] - squares[r] * q[r]


@inner
def move(flow, squares, begun, x, ends):
    """State of the modes after a step: each by itself, or all together where damping couples them (three axes).

    ``begun``: q, p and the mean force; ``ends``: q and p then, which are returned; ``x`` is room to work in.
    """
    (q, p, force), (q1, p1) = begun, ends
    if flow.ndim == 2:
        propagate(flow, Q_Q, q, p, force, q1)
        propagate(flow, P_Q, q, p, force, p1)
    else:
        pushes(squares, q, p, force, x)
        matvec(flow[0], x, q1)
        matvec(flow[1], x, p1)
        for r in range(len(q)):
            q1[r] += q[r]


@inner
def lost(flow, loss, squares, begun, x):
    """Energy lost to damping over a step; ``x`` is room to work in."""
    q, p, force = begun
    if flow.ndim == 2:
        return damping_loss(loss, q, p, force) if loss.shape[0] > 0 else 0.0
    else:  # noqa: RET505 - the compiler leaves out the branch of the other number of axes
        pushes(squares, q, p, force, x)
        return form_of(loss, x)


@fast
def correct_all(response, change, out):
    """As ``correct``, for modes that damping couples."""
    count = len(out)
    for r in range(count):
        total = 0.0
        for s in range(count):
            total += response[r, count + s] * change[s]
        out[r] -= 0.5 * total


@fast
def mean_load(rows, loads, n, out):
    """Modal forces of the external loads over step n: the mean of both ends."""
    for r in range(len(out)):
        out[r] = 0.0
    for m in range(loads.shape[1]):
        load = 0.5 * (loads[n, m] + loads[n + 1, m])
        for r in range(len(out)):
            out[r] += load * rows[m, r]


@fast
def work(force, q1, q0):
    """Work of constant modal forces."""
    total = 0.0
    for r in range(len(force)):
        total += force[r] * (q1[r] - q0[r])
    return total


@fast
def modal_energy(squares, q, p):
    """Kinetic and elastic energy of all modes."""
    total = 0.0
    for r in range(len(q)):
        total += 0.5 * (p[r] * p[r] + squares[r] * q[r] * q[r])
    return total


@inner
def across(laws, i):
    """The contact of the same pair in the other direction, -1 where there is none."""
    if len(laws) > 3:
        return laws[3][0][i]
    return -1


@inner
def lower_limits(limit, last, bounds, laws, state, energies):
    """Bring friction forces below slip forces that fell, in two directions straight back to the circle.

    The forces jump, and with them the accelerations; returns whether one did.
    """
    (flexibility, capacity), (f, z), fell = bounds, state, False
    for i in range(len(limit)):
        other = across(laws, i)
        if limit[i] < last[i] and not 0 <= other < i:
            fell = True
            for j in range(z.shape[1]):
                if flexibility[i, j] > 0.0:
                    top = limit[i] * capacity[i, j] if limit[i] > 0.0 else 0.0
                    aside = z[other, j] if other >= 0 else 0.0
                    size = np.sqrt(z[i, j] * z[i, j] + aside * aside)
                    if size > top:
                        energies[PROJECTION] += 0.5 * flexibility[i, j] * (size * size - top * top)
                        lower(f, z, i, j, top, size)
                        if other >= 0:
                            lower(f, z, other, j, top, size)
    copy_into(last, limit)
    return fell


@inner
def lower(f, z, i, j, top, size):
    """Keep the share ``top`` / ``size`` of a force of a contact."""
    held = top * (z[i, j] / size)
    f[i] += held - z[i, j]
    z[i, j] = held


@fast
def stored(flexibility, z):
    """Energy that all contacts can give back."""
    total = 0.0
    for i in range(z.shape[0]):
        for j in range(z.shape[1]):
            total += 0.5 * flexibility[i, j] * z[i, j] * z[i, j]
    return total


@fast
def total(values):
    """Sum of the magnitudes."""
    out = 0.0
    for i in range(len(values)):
        out += abs(values[i])
    return out


@inner
def book(exchange, flexibility, contacts, after, sums):
    """Friction loss of a step, and the new displacements and forces: work of the mean force, less what is stored.

    A contact without a largest force loses nothing.
    """
    (u, f, z), (u1, z1), (energies, dissipated, sliding) = contacts, after, sums
    for i in range(len(u)):
        way, excess, k = u1[i] - u[i], exchange[EXCESS, i], exchange[STIFFNESS, i]
        if excess != 0.0 and exchange[LIMIT, i] < np.inf:
            own = (f[i] + 0.5 * (excess + k * way)) * way
            for j in range(z.shape[1]):
                own -= 0.5 * flexibility[i, j] * (z1[i, j] - z[i, j]) * (z1[i, j] + z[i, j])
            dissipated[i] += own
            energies[FRICTION] += own
            if exchange[SLOPE, i] < -0.5 * k:
                sliding[i] += 1.0
        u[i], f[i] = u1[i], exchange[FORCE, i]


@inner
def book_across(exchange, partner, sliding):
    """In two directions a contact slides where its slope does in their sum, whichever way its force points."""
    for i in range(len(partner)):
        if partner[i] >= 0 and exchange[EXCESS, i] != 0.0:
            own, limit = exchange[SLOPE, i], -0.5 * exchange[STIFFNESS, i]
            sliding[i] += (own + exchange[SLOPE, partner[i]] < limit) - (own < limit)


@inner
def book_pressures(exchange, u, n, pressures, sliding):
    """Extremes of the normal contacts, which are the last ones, after step n."""
    kept, done = pressures
    for row in range(len(kept)):
        i, record = len(u) - len(kept) + row, kept[row]
        normal = exchange[PRESSURE, i]
        record[LEAST], record[GREATEST] = min(record[LEAST], normal), max(record[GREATEST], normal)
        if normal <= 0.0:
            if record[OPEN] == 0.0:
                record[START] = done + n
            record[OPEN] += 1.0
            sliding[i] += 1.0
            record[GAP] = max(record[GAP], u[i])


@fast
def contact_pull(slip, stiffness, u, f, g, pull):
    """Force g = F - k u of every contact, and what it does to the modes, free of gathered rounding."""
    for i in range(len(u)):
        g[i] = f[i] - stiffness[i] * u[i]
    pull[:] = 0.0
    add_rows(slip, g, pull)


@fast
def accept(change, slip, flow, ends, forces):
    """Let the changes of the contact forces over the step act on the modes.

    ``ends``: q and p at the end of the step; ``forces``: g, what it does to the modes, their mean force, and room.
    """
    (q1, p1), (g, pull, force, moved) = ends, forces
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


@fast
def amplitudes(squares, q, p, pull, out):
    """Of all modes about the place where the contact forces hold them; damping can only lower them."""
    for r in range(len(out)):
        away = q[r] + pull[r] / squares[r]
        out[r] = np.sqrt(away * away + p[r] * p[r] / squares[r])


@inner
def margins(limit, bounds, stiffness, z, out):
    """How far the force of every contact can change before one of its springs comes to its slip force."""
    flexibility, capacity = bounds
    for i in range(len(out)):
        out[i] = np.inf
        for j in range(z.shape[1]):
            if flexibility[i, j] > 0.0:
                left = (limit[i] * capacity[i, j] - abs(z[i, j])) * flexibility[i, j] * stiffness[i]
                out[i] = min(out[i], left)


@inner
def stride(spans, amplitude, reach, known, margin, left):
    """Longest stride (2, 4, 8 ... steps: level 0, 1, 2 ...) in which no contact can come to its limit; -1 is none.

    ``spans`` (level, contact, mode): how far a unit amplitude can change the contact forces meanwhile; ``reach``
    (level, contact) keeps that of the present amplitudes for the first ``known`` levels; ``left``: steps at most.
    """
    level = 0
    while level < spans.shape[0] and 2 << level <= left:
        if level >= known[0]:
            matvec(spans[level], amplitude, reach[level])
            known[0] = level + 1
        for i in range(len(margin)):
            if reach[level, i] >= margin[i]:
                return level - 1
        level += 1
    return level - 1


@inner
def glide(tables, contact, modes, forces, state):
    """A stride in which every contact sticks: exact over any length. Returns the loss to damping.

    ``tables``: flow and loss over its length; ``contact``: rows, stiffness and flexibility; ``modes``: q and p, and
    those at the end; ``forces``: g, what it does to the modes, and their mean force; ``state``: u, f, z.
    """
    (flow, loss), (slip, stiffness, flexibility), (q, p, q1, p1) = tables, contact, modes
    (g, pull, force), (u, f, z) = forces, state
    for r in range(len(q)):
        force[r] = -pull[r]
    propagate(flow, Q_Q, q, p, force, q1)
    propagate(flow, P_Q, q, p, force, p1)
    for i in range(len(u)):
        f[i] = -u[i]
    matvec(slip, q1, u)
    for i in range(len(u)):
        for j in range(z.shape[1]):
            if flexibility[i, j] > 0.0:
                z[i, j] += (u[i] + f[i]) / flexibility[i, j]
        f[i] = g[i] + stiffness[i] * u[i]
    return damping_loss(loss, q, p, force) if loss.shape[0] > 0 else 0.0


@kernel
def advance(count, modal, contact, drive, laws, state, books, strides):
    """Take steps from a state, which is updated.

    count: steps, those from sample to sample, 1/h. modal: tables of ``ema.simulate.flow`` and squared frequencies of
    the modes. contact: rows of the relative displacements, stiffness, flexibility and capacity of the springs
    (``ema.contact.laws``), compliance over a step with its norm, tables and memory of ``ema.contact.solve_kernels``.
    drive: slip forces (row, contact), one row for all steps or one per step; external forces at the ends of the steps
    (row, load), no row without them, and how they act on the modes. state: q, p, u, f, z. books: sums of energies,
    friction loss and steps that slide of every contact, the last slip forces, places of the modes, samples. laws:
    where contacts depend on each other also what is kept of the normal ones, and the steps taken before. strides:
    tables of 2, 4, 8 ... steps at once, ``spans`` of ``stride``, and the step from which on they may be taken: that
    motion is the same, with fewer looks at contacts that stick; and room to work in. Returns the largest number of
    Newton steps and the worst residual. Modes that no contact sees have no contacts.
    """
    (steps, every, rate), (flow, loss, squares), (q, p, u, f, z) = count, modal, state
    slip, stiffness, bounds, compliance, exchange, memory = contact
    (limits, loads, rows), (flows, losses, spans, quiet, room) = drive, strides
    energies, dissipated, sliding, last_limits, places, samples = books
    of_modes, of_contacts, both, z1, reach, known = room
    force, outside, pull, moved, amplitude = of_modes[0], of_modes[1], of_modes[2], of_modes[3], of_modes[4]
    q0, p0, q1, p1, z0 = q, p, of_modes[5], of_modes[6], z
    free, u1, g, margin = of_contacts[0], of_contacts[1], of_contacts[2], of_contacts[3]
    problem, x = (compliance[0], compliance[1], rate, _COUPLED if len(laws) > 3 else _ALONE), memory[4]
    contact_pull(slip, stiffness, u, f, g, pull)
    worst, most, loaded, n, stuck = 0.0, 0, loads.shape[0] > 0, 0, False
    contact_rows = slip, stiffness, bounds[0]
    known[0] = 0
    while n < steps:
        limit = limits[n if limits.shape[0] > 1 else 0]
        level = -1
        # all stuck since the last step: until one slips, the motion is known in closed form
        if stuck and n >= quiet and len(spans) > 0:
            if known[0] == 0:
                amplitudes(squares, q0, p0, pull, amplitude)
            margins(limit, bounds, stiffness, z0, margin)
            level = stride(spans, amplitude, reach, known, margin, every - n % every)
        if level >= 0:
            modes, forces = (q0, p0, q1, p1), (g, pull, force)
            energies[DAMPING] += glide((flows[level], losses[level]), contact_rows, modes, forces, (u, f, z0))
            n += 2 << level
        else:
            if n == 0 or limits.shape[0] > 1:
                if lower_limits(limit, last_limits, bounds, laws, (f, z0), energies):
                    contact_pull(slip, stiffness, u, f, g, pull)
                copy_into(exchange[LIMIT], limit)
            if loaded:
                mean_load(rows, loads, n, outside)
            for r in range(len(force)):
                force[r] = outside[r] - pull[r]
            begun, ends = (q0, p0, force), (q1, p1)
            move(flow, squares, begun, both, ends)
            matvec(slip, q1, free)
            iterations, residual = solve(laws, problem, (free, u, u1), exchange, (z0, z1), memory)
            most, worst = max(most, iterations), max(worst, residual)
            stuck = total(x) == 0.0
            if not stuck:
                accept(exchange[EXCESS], slip, flow, ends, (g, pull, force, moved))
                known[0] = 0
            energies[DAMPING] += lost(flow, loss, squares, begun, both)
            if loaded:
                energies[SUPPLIED] += work(outside, q1, q0)
            book(exchange, bounds[0], (u, f, z0), (u1, z1), (energies, dissipated, sliding))
            z0, z1 = z1, z0
            n += 1
            if len(laws) > 3:
                # the force at the end may be another one than that of the step
                contact_pull(slip, stiffness, u, f, g, pull)
                book_across(exchange, laws[3][0], sliding)
                book_pressures(exchange, u, n, laws[4], sliding)
        q0, q1, p0, p1 = q1, q0, p1, p0
        if n % every == 0:
            contact_pull(slip, stiffness, u, f, g, pull)
            record(n // every - 1, contact_rows, squares, (q0, p0, u, f, z0), energies, (places, samples))
            if loss.shape[0] > 0:
                known[0] = 0
    copy_into(q, q0)
    copy_into(p, p0)
    copy_table(z, z0)
    return most, worst


@inner
def record(sample, contact, squares, state, energies, kept):
    """Keep one sample in the row ``sample`` of the arrays (sample, ...) of ``kept``.

    ``contact``: rows, stiffness and flexibility of the springs; ``squares`` (mode,): squared frequencies of the modes
    computed; ``state``: q, p, u, f, z; ``energies`` (4,): what was booked so far, to which the stored energies are
    added; ``kept``: places of the modes computed among all modes, and the arrays of modal displacement and velocity,
    of displacement and force of the contacts, and of the energies.
    """
    (_, stiffness, flexibility), (q, p, u, f, z) = contact, state
    places, (out_q, out_p, out_u, out_f, out_energy) = kept
    for r in range(len(places)):
        out_q[sample, places[r]], out_p[sample, places[r]] = q[r], p[r]
    springs = 0.0
    for i in range(len(u)):
        out_u[sample, i], out_f[sample, i] = u[i], f[i]
        springs += 0.5 * stiffness[i] * u[i] * u[i]
    for e in range(4):
        out_energy[sample, e] += energies[e]
    out_energy[sample, 4] += stored(flexibility, z)
    out_energy[sample, 5] += modal_energy(squares, q, p) - springs
