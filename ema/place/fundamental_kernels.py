"""Compiled: the fundamental of a structure with friction contacts, all its modes together, under a harmonic force.

Host and beam apart have modes of squared frequencies s, decay rates d and loss factors e, and receptances that are
sums of g = 1/(s (1 + j e) - omega^2 + j omega d). Normal springs of flexibilities c join them with the forces
p = (C + G_pp)^-1 (F G_pd - G_pr f), which makes the slips at the contacts r = F D - R f(r) with
R = G_rr - G_rp (C + G_pp)^-1 G_pr, D likewise, and f the first harmonic of the friction forces (describing function of
the law). Nothing is left out of the damping, as it would be in modes of the whole.
"""

import math

import numpy as np

from ema.compiled import compiled
from ema.place.predictor_kernels import COUPLED, DRIVE, FORCE, SLIP, slips

LEFT = 1e-4
"""Relative error of the contact equation from which a frequency counts as unsolved."""


@compiled(error_model="numpy")
def solved(matrix, columns):
    """Gauss with pivots, in place: ``columns`` become the solution, NaN where there is none (LAPACK would stop)."""
    n = len(matrix)
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        for j in range(n):
            matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        for j in range(columns.shape[1]):
            columns[k, j], columns[pivot, j] = columns[pivot, j], columns[k, j]
        for i in range(k + 1, n):
            part = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, n):
                matrix[i, j] -= part * matrix[k, j]
            for j in range(columns.shape[1]):
                columns[i, j] -= part * columns[k, j]
    for j in range(columns.shape[1]):
        for k in range(n - 1, -1, -1):
            for i in range(k + 1, n):
                columns[k, j] -= matrix[k, i] * columns[i, j]
            columns[k, j] /= matrix[k, k]


@compiled(error_model="numpy")
def room_for(structure):
    """Work arrays of a structure: ``x``, ``z`` and ``m`` as for ``slips``, modal amplitudes, forces of the springs."""
    n = structure[3].shape[0]
    x, z = np.zeros((2 * n + 1, 2 * n)), np.zeros((7, n), np.complex128)
    m, q = np.zeros((4, n, n), np.complex128), np.zeros(len(structure[0]), np.complex128)
    return x, z, m, q, np.zeros(len(structure[6]), np.complex128)


@compiled(error_model="numpy")
def respond(omega, load, structure, contact, room):
    """Solve the structure at the angular frequency ``omega`` under a harmonic force of amplitude ``load`` [N].

    Returns the displacements [m] of the excited DOF and of the output, NaN where unsolved; in ``room`` (see
    ``room_for``) stand the modal amplitudes and the forces of the normal springs then.

    ``structure``: squares, decay, loss (mode,), ``rows`` (contact, mode), ``ends`` (2, mode): excited DOF, output;
    ``springs`` (spring, mode), flexibilities (spring,), number of the host's modes, which come first. ``contact``: k_T,
    slip forces, loss factor, first harmonic of the law, F_N at rest (joint,).
    """
    squares, decay, loss, rows, ends, springs, flexibility, _ = structure
    (k_t, limit, tangential_loss, table, _), (x, z, m, q, p) = contact, room
    n, held, square = rows.shape[0], springs.shape[0], omega * omega
    # receptances between slips and springs; the last column is under the load
    g = np.zeros((n + held, n + held + 1), np.complex128)
    for k in range(len(squares)):
        q[k] = 1 / complex(squares[k] - square, squares[k] * loss[k] + omega * decay[k])
        for i in range(n + held):
            row = rows[i, k] if i < n else springs[i - n, k]
            if row == 0.0:
                continue
            part = row * q[k]
            g[i, n + held] += part * (load * ends[0, k])
            for j in range(i + 1):
                g[i, j] += part * (rows[j, k] if j < n else springs[j - n, k])
    for i in range(n + held):
        for j in range(i):
            g[j, i] = g[i, j]
    joined = g[n:, n : n + held].copy()
    for s in range(held):
        joined[s, s] += flexibility[s]
    towards = np.empty((held, n + 1), np.complex128)
    for s in range(held):
        towards[s, :n], towards[s, n] = g[n + s, :n], g[n + s, n + held]
    solved(joined, towards)
    for i in range(n):
        z[DRIVE, i] = g[i, n + held]
        for s in range(held):
            z[DRIVE, i] -= g[i, n + s] * towards[s, n]
        for j in range(n):
            m[COUPLED, i, j] = g[i, j]
            for s in range(held):
                m[COUPLED, i, j] -= g[i, n + s] * towards[s, j]
    left = slips((k_t, limit, tangential_loss, table), x, z, m)
    for s in range(held):
        p[s] = towards[s, n]
        for i in range(n):
            p[s] -= towards[s, i] * z[FORCE, i]
    driver, output = 0j, 0j
    for k in range(len(squares)):
        pushed = complex(load * ends[0, k], 0.0)
        for i in range(n):
            pushed -= rows[i, k] * z[FORCE, i]
        for s in range(held):
            pushed -= springs[s, k] * p[s]
        q[k] *= pushed
        driver += ends[0, k] * q[k]
        output += ends[1, k] * q[k]
    if not left < LEFT:
        return complex(np.nan, 0.0), complex(np.nan, 0.0)
    return driver, output


@compiled(error_model="numpy")
def curve(frequencies, load, structure, contact):
    """Displacement of the output at ascending frequencies in Hz, each started from the one before."""
    room = room_for(structure)
    result = np.empty(len(frequencies), np.complex128)
    for k in range(len(frequencies)):
        result[k] = respond(2 * math.pi * frequencies[k], load, structure, contact, room)[1]
    return result


SPACING = 2.5e-3
"""Spacing of the frequencies that are looked at, in the logarithm. Twice as wide, peaks of damping ratios below 0.2 %
are missed."""
CLOSE = 2e-5
"""Distance from the maximum that no longer matters, in the logarithm of the frequency."""
STEPS = 16
"""Steps towards the maximum at most: a bound on the work."""


@compiled(error_model="numpy")
def taking_part(target, count, q):
    """Amplitude of the bare mode ``target`` in a motion where none of the other bare modes moves more; else 0."""
    wanted = abs(q[target])
    for b in range(count):
        if abs(q[b]) > wanted:
            return 0.0
    return wanted


@compiled(error_model="numpy")
def peak_of(target, low, high, load, structure, contact):
    """The peak of the output that belongs to a bare mode: Hz, damping ratio, how far the joints open, height [m] at the
    excited DOF, or NaN, and the forces of the normal springs.

    The third is the amplitude of the normal force over that at rest, of the joint where it is largest.
    Of the peaks within the band in which that mode moves more than any other bare mode, the one where it moves most.
    The damping ratio is P/(omega^3 sum |q|^2) with the mean power P that the force supplies: energy lost per period
    over 4 pi times the largest kinetic energy of the fundamental.
    """
    n, count = structure[3].shape[0], max(int(math.log(high / low) / SPACING) + 1, 5)
    room = room_for(structure)
    _, z, _, q, p = room
    step, top, best = math.log(high / low) / (count - 1), -1, 0.0
    heights, slip, before = np.zeros(count), np.zeros(n, np.complex128), np.zeros(n, np.complex128)
    moved, moved_before = 0.0, 0.0
    for k in range(count):
        before[:] = z[SLIP]
        output = respond(2 * math.pi * low * math.exp(k * step), load, structure, contact, room)[1]
        heights[k] = abs(output) if not math.isnan(output.real) else 0.0
        moved_before, moved = moved, taking_part(target, structure[7][0], q)
        if k > 1 and heights[k - 2] < heights[k - 1] >= heights[k] and moved_before > best:
            top, best = k - 1, moved_before
            slip[:] = before
    at_peak = np.zeros_like(p)
    if top < 0:
        return np.nan, np.nan, np.nan, np.nan, at_peak
    z[SLIP] = slip
    at = np.array([top - 1.0, float(top), top + 1.0]) * step
    y = heights[top - 1 : top + 2].copy()
    frequency, damping, opening, height = np.nan, np.nan, np.nan, np.nan
    for _ in range(STEPS):
        left, middle, right = 1 / max(y[0], 1e-300) ** 2, 1 / y[1] ** 2, 1 / max(y[2], 1e-300) ** 2
        above = (at[1] - at[0]) ** 2 * (middle - right) - (at[1] - at[2]) ** 2 * (middle - left)
        below = (at[1] - at[0]) * (middle - right) - (at[1] - at[2]) * (middle - left)
        new = at[1] - 0.5 * above / below if below != 0 else at[1]
        done = abs(new - at[1]) < CLOSE
        if done and at[2] - at[0] > 40 * CLOSE:
            # both neighbours have to be near before the parabola is believed
            new = at[1] + 8 * CLOSE * (1 if at[2] - at[1] > at[1] - at[0] else -1)
            done = False
        new = min(max(new, at[0] + 0.1 * (at[1] - at[0])), at[2] - 0.1 * (at[2] - at[1]))
        omega = 2 * math.pi * low * math.exp(at[1] if done else new)
        driver, output = respond(omega, load, structure, contact, room)
        value = abs(output) if not math.isnan(output.real) else 0.0
        if done or value > y[1]:
            energy = 0.0
            for k in range(len(q)):
                energy += q[k].real ** 2 + q[k].imag ** 2
            frequency = omega / (2 * math.pi)
            damping = -0.5 * load * driver.imag / (omega**2 * energy)
            height = abs(driver)
            at_peak[:] = p
            opening = 0.0
            for i in range(len(contact[4])):
                opening = max(opening, abs(p[i]) / contact[4][i])
        if done:
            break
        side = 0 if new < at[1] else 2
        if value > y[1]:
            at[2 - side], y[2 - side] = at[1], y[1]
            at[1], y[1] = new, value
        else:
            at[side], y[side] = new, value
    return frequency, damping, opening, height, at_peak
