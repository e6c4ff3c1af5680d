"""Compiled: one mode of the host with a friction beam, at given force levels.

One modal coordinate q of the host moves the joints by phi q (normal) and c phi' q (tangential, at the interface). The
receptances A of the free beam at the joints are sums over its modes; the normal springs hold it there, C = (1/k_N +
A_nn)^-1. The friction forces f act between the two, r = psi q - R f(r) with psi = c phi' + A_tn C phi and R = A_tt -
A_tn C A_nt, and the mode gains the dynamic stiffness D = phi^T C phi + psi^T f / q.
"""

import math

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def describing(amplitude, table, start, step):
    """Complex secant stiffness over k_T, and its derivative, at an amplitude in units of the slip limit."""
    place = (math.log(amplitude) - start) / step if amplitude > 0 else -1.0
    if place <= 0:
        return table[0], 0j
    if place >= len(table) - 1:
        ratio = math.exp(start + step * (len(table) - 1)) / amplitude
        return table[-1] * ratio, -table[-1] * ratio / amplitude
    cell = int(place)
    slope = table[cell + 1] - table[cell]
    return table[cell] + (place - cell) * slope, slope / (step * amplitude)


@njit(cache=True, error_model="numpy")
def receptances(omega, squares, tangential, normal, a_tt, a_tn, a_nn):
    """Receptances of the free beam between the joints."""
    joints = tangential.shape[0]
    a_tt[:], a_tn[:], a_nn[:] = 0, 0, 0
    for k in range(len(squares)):
        g = 1.0 / (squares[k] - omega * omega)
        for a in range(joints):
            ta, na = tangential[a, k] * g, normal[a, k] * g
            for b in range(joints):
                a_tt[a, b] += ta * tangential[b, k]
                a_tn[a, b] += ta * normal[b, k]
                a_nn[a, b] += na * normal[b, k]


@njit(cache=True, error_model="numpy")
def invert(matrix, inverse):
    """Inverse of a small matrix by elimination without row exchange: a sum of springs and receptances, never odd."""
    n = len(matrix)
    inverse[:] = 0
    for k in range(n):
        inverse[k, k] = 1
    for k in range(n):
        pivot = matrix[k, k]
        for j in range(n):
            matrix[k, j] /= pivot
            inverse[k, j] /= pivot
        for i in range(n):
            if i != k:
                factor = matrix[i, k]
                for j in range(n):
                    matrix[i, j] -= factor * matrix[k, j]
                    inverse[i, j] -= factor * inverse[k, j]


@njit(cache=True, error_model="numpy")
def eliminate(matrix, right):
    """Solve in place by Gaussian elimination with row exchange: quicker than a library call for a few unknowns."""
    n = len(right)
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if pivot != k:
            for j in range(k, n):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
            right[k], right[pivot] = right[pivot], right[k]
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, n):
                matrix[i, j] -= factor * matrix[k, j]
            right[i] -= factor * right[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]


@njit(cache=True, error_model="numpy")
def unbalanced(psi_q, r_tt, k_t, limit, loss, table, start, step, r, forces, residual):
    """What is left of r + R f(r) = psi q, as real and imaginary parts; its largest entry."""
    n = len(psi_q)
    for b in range(n):
        kappa, _ = describing(abs(r[b]) * k_t / limit if limit > 0 else 1e30, table, start, step)
        forces[b] = (kappa + 1j * loss * kappa.real) * k_t * r[b]
    largest = 0.0
    for a in range(n):
        value = psi_q[a] - r[a]
        for b in range(n):
            value -= r_tt[a, b] * forces[b]
        residual[2 * a], residual[2 * a + 1] = value.real, value.imag
        largest = max(largest, abs(value))
    return largest


@njit(cache=True, error_model="numpy")
def slips(psi_q, r_tt, k_t, limit, loss, table, start, step, r, matrix, forces):
    """Newton with halved steps for r + R f(r) = psi q from the start in ``r``; what is left, over the size."""
    n = len(psi_q)
    residual, old = np.empty(2 * n), np.empty(n, np.complex128)
    size = 1e-300
    for a in range(n):
        size = max(size, abs(psi_q[a]))
    left = unbalanced(psi_q, r_tt, k_t, limit, loss, table, start, step, r, forces, residual)
    for _ in range(30):
        if left < 1e-7 * size:
            break
        for b in range(n):
            amplitude = abs(r[b])
            kappa, slope = describing(amplitude * k_t / limit if limit > 0 else 1e30, table, start, step)
            slope *= k_t / limit if limit > 0 else 0.0
            kappa, slope = (kappa + 1j * loss * kappa.real) * k_t, (slope + 1j * loss * slope.real) * k_t
            unit = r[b] / amplitude if amplitude > 0 else 0j
            # df = kappa dr + slope r Re(conj(unit) dr)
            to_re, to_im = kappa + slope * r[b] * unit.real, 1j * kappa + slope * r[b] * unit.imag
            for a in range(n):
                g_re, g_im = r_tt[a, b] * to_re, r_tt[a, b] * to_im
                matrix[2 * a, 2 * b], matrix[2 * a + 1, 2 * b] = g_re.real, g_re.imag
                matrix[2 * a, 2 * b + 1], matrix[2 * a + 1, 2 * b + 1] = g_im.real, g_im.imag
            matrix[2 * b, 2 * b] += 1.0
            matrix[2 * b + 1, 2 * b + 1] += 1.0
        eliminate(matrix, residual)
        share, before = 1.0, left
        old[:] = r
        change = residual.copy()
        for _ in range(8):
            for a in range(n):
                r[a] = old[a] + share * (change[2 * a] + 1j * change[2 * a + 1])
            left = unbalanced(psi_q, r_tt, k_t, limit, loss, table, start, step, r, forces, residual)
            if left < before:
                break
            share *= 0.5
    return left / size


@njit(cache=True, error_model="numpy")
def linear_part(omega, beam, work):
    """psi and R into ``work``; the dynamic stiffness of the mode's beam without friction forces."""
    phi, lever, k_n, squares, tangential, normal = beam
    a_tt, a_tn, a_nn, sprung, held, psi, r_tt = work[1], work[2], work[3], work[4], work[5], work[6], work[10]
    receptances(omega, squares, tangential, normal, a_tt, a_tn, a_nn)
    n = len(phi)
    for a in range(n):
        for b in range(n):
            sprung[a, b] = a_nn[a, b] + 0j
        sprung[a, a] += 1 / k_n
    invert(sprung, held)  # normal forces per deflection of the host at the joints
    added = 0j
    for a in range(n):
        carried = 0j
        for b in range(n):
            carried += held[a, b] * phi[b]
        psi[a] = carried
        added += phi[a] * carried
    for a in range(n):
        for b in range(n):
            total = 0j
            for c in range(n):
                total += a_tn[a, c] * held[c, b]
            sprung[a, b] = total
    for a in range(n):
        for b in range(n):
            r_tt[a, b] = a_tt[a, b] + 0j
            for c in range(n):
                r_tt[a, b] -= sprung[a, c] * a_tn[b, c]
    for a in range(n):
        sprung[a, 0] = lever[a]
        for c in range(n):
            sprung[a, 0] += a_tn[a, c] * psi[c]
    for a in range(n):
        psi[a] = sprung[a, 0]
    return added


@njit(cache=True, error_model="numpy")
def under_force(stiffness, psi, r_free, load, contact, r, work):
    """Complex amplitude q of the mode under a modal force, and what is left of the contact equation.

    ``stiffness`` D of the mode with the beam but without friction. With q = (load - psi^T f) / D the slips solve the
    same equation as at a given q, with R + psi psi^T / D for R.
    """
    r_tt, drive, matrix, forces = work[0], work[7], work[8], work[9]
    n = len(psi)
    for a in range(n):
        drive[a] = psi[a] * load / stiffness
        for b in range(n):
            r_tt[a, b] = r_free[a, b] + psi[a] * psi[b] / stiffness
    left = slips(drive, r_tt, *contact, r, matrix, forces)
    q = load / stiffness
    for a in range(n):
        q -= psi[a] * forces[a] / stiffness
    return q, left


@njit(cache=True, error_model="numpy")
def height_at(log_ratio, omega0, zeta0, load, beam, contact, r, work):
    """Amplitude of the mode under a modal force at a frequency; 0 where the contacts were not solved."""
    omega = omega0 * math.exp(log_ratio)
    stiffness = omega0**2 - omega**2 + 2j * zeta0 * omega0 * omega + linear_part(omega, beam, work)
    q, left = under_force(stiffness, work[6], work[10], load, contact, r, work)
    return q if left < 1e-4 else 0j


COARSE, COUNT = 0.014, 8
"""Spacing and number of the first frequencies to either side of that with the beam's mass, in the logarithm."""


@njit(cache=True, error_model="numpy")
def climb(places, heights, top, omega0, zeta0, load, beam, contact, r, work):
    """Place of the maximum next to ``top`` to 1e-4: one over the squared height is nearly a parabola there."""
    x, y = places[top - 1 : top + 2].copy(), heights[top - 1 : top + 2].copy()
    least = 1e-4
    for _ in range(12):
        if x[2] - x[0] < 4 * least:
            break
        a, b, c = 1 / max(y[0], 1e-300) ** 2, 1 / y[1] ** 2, 1 / max(y[2], 1e-300) ** 2
        top_part = (x[1] - x[0]) ** 2 * (b - c) - (x[1] - x[2]) ** 2 * (b - a)
        bottom = (x[1] - x[0]) * (b - c) - (x[1] - x[2]) * (b - a)
        new = x[1] - 0.5 * top_part / bottom if bottom != 0 else x[1]
        if abs(new - x[1]) < least:
            wide = max(x[2] - x[1], x[1] - x[0])
            new = x[1] + (least if x[2] - x[1] > x[1] - x[0] else -least) * (1 if wide < 8 * least else 3)
        new = min(max(new, x[0] + 0.1 * (x[1] - x[0])), x[2] - 0.1 * (x[2] - x[1]))
        value = abs(height_at(new, omega0, zeta0, load, beam, contact, r, work))
        side = 0 if new < x[1] else 2
        if value > y[1]:
            x[2 - side], y[2 - side] = x[1], y[1]
            x[1], y[1] = new, value
        else:
            x[side], y[side] = new, value
    return x[1]


@njit(cache=True, error_model="numpy")
def one_mode(omega0, zeta0, driver, levels, beam, contact):
    """Frequency, damping and slip ratio of a mode at every force level (ascending); NaN where nothing was found.

    The highest response under the force: frequencies around that of the structure carrying the beam first, then up the
    best hill. The damping is that of a single mode of this height and of the local slope of the dynamic stiffness.
    """
    n = len(beam[0])
    work = (
        np.zeros((n, n), np.complex128), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)),
        np.zeros((n, n), np.complex128), np.zeros((n, n), np.complex128), np.zeros(n, np.complex128),
        np.zeros(n, np.complex128), np.zeros((2 * n, 2 * n)), np.zeros(n, np.complex128),
        np.zeros((n, n), np.complex128),
    )  # fmt: skip
    result = np.full((3, len(levels)), np.nan)
    size = 2 * COUNT + 1
    places, heights = np.empty(size), np.empty(size)
    bare, psis, frees = (
        np.empty(size, np.complex128),
        np.empty((size, n), np.complex128),
        np.empty((size, n, n), np.complex128),
    )
    carried = linear_part(omega0, beam, work).real / omega0**2
    centre = 0.5 * math.log(max(1 + carried, 0.5)) if carried < 1 else 0.0
    for k in range(size):
        places[k] = centre + COARSE * (k - COUNT)
        omega = omega0 * math.exp(places[k])
        bare[k] = omega0**2 - omega**2 + 2j * zeta0 * omega0 * omega + linear_part(omega, beam, work)
        psis[k], frees[k] = work[6], work[10]
    for row in range(len(levels)):
        load = levels[row] * driver
        r = np.zeros(n, np.complex128)
        heights[:] = -1.0
        for k in range(0, size, 2):
            q, left = under_force(bare[k], psis[k], frees[k], load, contact, r, work)
            heights[k] = abs(q) if left < 1e-4 else 0.0
        first = heights.argmax()
        for k in range(max(first - 1, 0), min(first + 2, size), 2):
            if heights[k] < 0:
                q, left = under_force(bare[k], psis[k], frees[k], load, contact, r, work)
                heights[k] = abs(q) if left < 1e-4 else 0.0
        top = heights.argmax()
        if heights[top] <= 0 or top == 0 or top == size - 1:
            continue
        for k in (top - 1, top + 1):
            if heights[k] < 0:
                q, left = under_force(bare[k], psis[k], frees[k], load, contact, r, work)
                heights[k] = abs(q) if left < 1e-4 else 0.0
        best = climb(places, heights, top, omega0, zeta0, load, beam, contact, r, work)
        q = height_at(best, omega0, zeta0, load, beam, contact, r, work)
        if q == 0:
            continue
        omega, total = omega0 * math.exp(best), load / q
        ahead = held_ahead(omega, omega0, zeta0, beam, contact, r, work)
        slope = -ahead.real / (1e-4 * omega)
        if not omega < slope < 4 * omega:
            slope = 2 * omega
        ratio = 0.0
        for a in range(n):
            ratio = max(ratio, abs(r[a]) * contact[0] / contact[1] if contact[1] > 0 else math.inf)
        result[0, row], result[1, row], result[2, row] = omega / (2 * math.pi), abs(total) / (omega * slope), ratio
    return result


@njit(cache=True, error_model="numpy")
def held_ahead(omega, omega0, zeta0, beam, contact, r, work):
    """Change of the total dynamic stiffness over a frequency step of 1e-4 with the contacts' secant stiffness held."""
    k_t, limit, loss, table, start, step = contact
    n = len(r)
    total = np.zeros(2, np.complex128)
    kappa = np.zeros(n, np.complex128)
    for a in range(n):
        value, _ = describing(abs(r[a]) * k_t / limit if limit > 0 else 1e30, table, start, step)
        kappa[a] = (value + 1j * loss * value.real) * k_t
    matrix, inverse = np.zeros((n, n), np.complex128), np.zeros((n, n), np.complex128)
    for side in range(2):
        here = omega * (1 + 1e-4 * side)
        total[side] = omega0**2 - here**2 + 2j * zeta0 * omega0 * here + linear_part(here, beam, work)
        r_tt, psi = work[10], work[6]
        for a in range(n):
            for b in range(n):
                matrix[a, b] = r_tt[a, b] * kappa[b]
            matrix[a, a] += 1
        invert(matrix, inverse)
        for a in range(n):
            for b in range(n):
                total[side] += psi[a] * kappa[a] * inverse[a, b] * psi[b]
    return total[1] - total[0]


@njit(cache=True, error_model="numpy")
def all_places(
    omega0, zeta0, driver, levels, phi, lever, kind, k_n, squares, tangential, normal, k_t, limits, loss, table,
    start, step,
):  # fmt: skip
    """``one_mode`` for all candidates, modes and normal forces: (candidate, mode, 3, level, force)."""
    candidates, modes, forces = phi.shape[0], phi.shape[2], len(k_t)
    result = np.full((candidates, modes, 3, len(levels), forces), np.nan)
    for c in range(candidates):
        one = kind[c]
        for mode in range(modes):
            if driver[mode] <= 0:
                continue
            for f in range(forces):
                beam = (
                    phi[c, :, mode].copy(), lever[c, :, mode].copy(), k_n[f], squares[one], tangential[one], normal[one]
                )  # fmt: skip
                contact = (k_t[f], limits[f], loss, table, start, step)
                result[c, mode, :, :, f] = one_mode(omega0[mode], zeta0[mode], driver[mode], levels, beam, contact)
    return result
