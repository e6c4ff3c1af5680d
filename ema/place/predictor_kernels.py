"""Compiled: one mode of the host with a friction beam, at given force levels.

One modal coordinate q of the host moves the joints by phi q (normal) and c phi' q (tangential, at the interface). The
receptances A of the free beam at the joints are sums over its modes; the normal springs hold it there, C = (1/k_N +
A_nn)^-1. The friction forces f act between the two, r = psi q - R f(r) with psi = c phi' + A_tn C phi and R = A_tt -
A_tn C A_nt, and the mode gains the dynamic stiffness D = phi^T C phi + psi^T f / q.
"""

import math

import numpy as np

from ema.compiled import compiled
from ema.place.describing import START, STEP


@compiled(error_model="numpy")
def describing(amplitude, table):
    """Complex secant stiffness over k_T, and its derivative, at an amplitude in units of the slip limit."""
    position = (math.log(amplitude) - START) / STEP if amplitude > 0 else -1.0
    if position <= 0:
        return table[0], 0j
    if position >= len(table) - 1:
        ratio = math.exp(START + STEP * (len(table) - 1)) / amplitude
        return table[-1] * ratio, -table[-1] * ratio / amplitude
    cell = int(position)
    slope = table[cell + 1] - table[cell]
    return table[cell] + (position - cell) * slope, slope / (STEP * amplitude)


FORCE, KAPPA, SLOPE, OLD, DRIVE, PSI, SLIP = range(7)
"""Rows of the complex vectors ``z`` (row, joint) that are used over and over."""
COUPLED, ALONE, SPRUNG, HELD = range(4)
"""The complex matrices ``m`` (matrix, joint, joint); the real ones ``a`` are the receptances tt, tn and nn."""


@compiled(error_model="numpy")
def room_for(joints):
    """Work arrays of a structure: ``x`` of Newton's equations, ``z``, ``m`` and ``a``."""
    x, z = np.zeros((2 * joints + 1, 2 * joints)), np.zeros((7, joints), np.complex128)
    return x, z, np.zeros((4, joints, joints), np.complex128), np.zeros((3, joints, joints))


@compiled(error_model="numpy")
def receptances(square, squares, tangential, normal, rest, a):
    """Receptances of the free beam between the joints; ``rest`` are the modes far above, to second order in omega."""
    joints = tangential.shape[0]
    for i in range(joints):
        for j in range(joints):
            for kind in range(3):
                a[kind, i, j] = rest[0, kind, i, j] + square * rest[1, kind, i, j]
    for k in range(len(squares)):
        g = 1.0 / (squares[k] - square)
        for i in range(joints):
            ti, ni = tangential[i, k] * g, normal[i, k] * g
            for j in range(joints):
                a[0, i, j] += ti * tangential[j, k]
                a[1, i, j] += ti * normal[j, k]
                a[2, i, j] += ni * normal[j, k]


@compiled(error_model="numpy")
def hold(m):
    """Inverse of ``m[SPRUNG]`` by elimination without row exchange: springs and receptances are never odd."""
    n = m.shape[1]
    for k in range(n):
        for j in range(n):
            m[HELD, k, j] = 1.0 if j == k else 0.0
    for k in range(n):
        pivot = 1 / m[SPRUNG, k, k]
        for j in range(n):
            m[SPRUNG, k, j] *= pivot
            m[HELD, k, j] *= pivot
        for i in range(n):
            if i != k:
                factor = m[SPRUNG, i, k]
                for j in range(n):
                    m[SPRUNG, i, j] -= factor * m[SPRUNG, k, j]
                    m[HELD, i, j] -= factor * m[HELD, k, j]


@compiled(error_model="numpy")
def eliminate(x):
    """Solve by Gaussian elimination with row exchange: quicker than a library call for a few unknowns.

    Rows of ``x``: the matrix, and the right side, which becomes the solution.
    """
    n = x.shape[1]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(x[i, k]) > abs(x[pivot, k]):
                pivot = i
        if pivot != k:
            for j in range(k, n):
                x[k, j], x[pivot, j] = x[pivot, j], x[k, j]
            x[n, k], x[n, pivot] = x[n, pivot], x[n, k]
        inverse = 1 / x[k, k]
        for i in range(k + 1, n):
            factor = x[i, k] * inverse
            for j in range(k + 1, n):
                x[i, j] -= factor * x[k, j]
            x[n, i] -= factor * x[n, k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[n, k] -= x[k, j] * x[n, j]
        x[n, k] /= x[k, k]


@compiled(error_model="numpy")
def unbalanced(contact, x, z, m):
    """What is left of r + R f(r) = psi q, as real and imaginary parts in the last row of ``x``; its largest entry.

    ``contact``: k_T and slip forces (joint,), loss factor, first harmonic of the law.
    """
    (k_t, limit, loss, table), n = contact, z.shape[1]
    for b in range(n):
        r = z[SLIP, b]
        amplitude = math.sqrt(r.real * r.real + r.imag * r.imag)
        per = k_t[b] / limit[b] if limit[b] > 0 else 0.0
        kappa, slope = describing(amplitude * per if limit[b] > 0 else 1e30, table)
        slope *= per
        z[KAPPA, b] = complex(kappa.real, kappa.imag + loss * kappa.real) * k_t[b]
        z[SLOPE, b] = complex(slope.real, slope.imag + loss * slope.real) * k_t[b]
        z[FORCE, b] = z[KAPPA, b] * r
    largest = 0.0
    for i in range(n):
        value = z[DRIVE, i] - z[SLIP, i]
        for b in range(n):
            value -= m[COUPLED, i, b] * z[FORCE, b]
        x[2 * n, 2 * i], x[2 * n, 2 * i + 1] = value.real, value.imag
        largest = max(largest, value.real * value.real + value.imag * value.imag)
    return math.sqrt(largest)


@compiled(error_model="numpy")
def slips(contact, x, z, m):
    """Newton with halved steps for r + R f(r) = psi q from the start in ``z``; what is left, over the size."""
    n = z.shape[1]
    size = 1e-300
    for a in range(n):
        size = max(size, abs(z[DRIVE, a]))
    left = unbalanced(contact, x, z, m)
    if left > 0.3 * size:
        # far from the known state: free slip may be nearer
        for a in range(n):
            z[OLD, a], z[SLIP, a] = z[SLIP, a], z[DRIVE, a]
        free = unbalanced(contact, x, z, m)
        if free < left:
            left = free
        else:
            for a in range(n):
                z[SLIP, a] = z[OLD, a]
            left = unbalanced(contact, x, z, m)
    for _ in range(30):
        if left < 1e-6 * size:
            break
        for b in range(n):
            r, kappa, slope = z[SLIP, b], z[KAPPA, b], z[SLOPE, b]
            amplitude = math.sqrt(r.real * r.real + r.imag * r.imag)
            per = 1 / amplitude if amplitude > 0 else 0.0
            # df = kappa dr + slope r Re(conj(unit) dr)
            to_re, to_im = kappa + slope * r * (r.real * per), 1j * kappa + slope * r * (r.imag * per)
            for a in range(n):
                g_re, g_im = m[COUPLED, a, b] * to_re, m[COUPLED, a, b] * to_im
                x[2 * a, 2 * b], x[2 * a + 1, 2 * b] = g_re.real, g_re.imag
                x[2 * a, 2 * b + 1], x[2 * a + 1, 2 * b + 1] = g_im.real, g_im.imag
            x[2 * b, 2 * b] += 1.0
            x[2 * b + 1, 2 * b + 1] += 1.0
        eliminate(x)
        share, before = 1.0, left
        for a in range(n):
            z[OLD, a] = complex(x[2 * n, 2 * a], x[2 * n, 2 * a + 1])
            z[SLIP, a] += z[OLD, a]
        for halving in range(8):
            left = unbalanced(contact, x, z, m)
            if left < before or halving == 7:
                break
            share *= 0.5
            for a in range(n):
                z[SLIP, a] -= share * z[OLD, a]
    return left / size


@compiled(error_model="numpy")
def linear_part(omega, beam, z, m, a):
    """psi and R of the beam on its normal springs; the dynamic stiffness it gives the mode without friction forces."""
    phi, lever, k_n, squares, tangential, normal, rest = beam
    n = len(phi)
    receptances(omega * omega, squares, tangential, normal, rest, a)
    for i in range(n):
        for j in range(n):
            m[SPRUNG, i, j] = a[2, i, j]
        m[SPRUNG, i, i] += 1 / k_n
    hold(m)  # normal forces per deflection of the host at the joints
    added = 0j
    for i in range(n):
        carried = 0j
        for j in range(n):
            carried += m[HELD, i, j] * phi[j]
        z[OLD, i] = carried
        added += phi[i] * carried
    for i in range(n):
        for j in range(n):
            total = 0j
            for k in range(n):
                total += a[1, i, k] * m[HELD, k, j]
            m[SPRUNG, i, j] = total
    for i in range(n):
        z[PSI, i] = lever[i]
        for k in range(n):
            z[PSI, i] += a[1, i, k] * z[OLD, k]
        for j in range(n):
            total = complex(a[0, i, j], 0.0)
            for k in range(n):
                total -= m[SPRUNG, i, k] * a[1, j, k]
            m[ALONE, i, j] = total
    return added


@compiled(error_model="numpy")
def under_force(stiffness, load, contact, x, z, m):
    """Complex amplitude q of the mode under a modal force, and what is left of the contact equation.

    ``stiffness`` D of the mode with the beam but without friction. With q = (load - psi^T f) / D the slips solve the
    same equation as at a given q, with R + psi psi^T / D for R.
    """
    n, yielding = z.shape[1], 1 / stiffness
    for a in range(n):
        part = z[PSI, a] * yielding
        z[DRIVE, a] = part * load
        for b in range(n):
            m[COUPLED, a, b] = m[ALONE, a, b] + part * z[PSI, b]
    left = slips(contact, x, z, m)
    pushed = complex(load, 0.0)
    for a in range(n):
        pushed -= z[PSI, a] * z[FORCE, a]
    return pushed * yielding, left


@compiled(error_model="numpy")
def bare_stiffness(omega, omega0, zeta0):
    """Dynamic stiffness of the mode without the beam, per modal mass."""
    return omega0**2 - omega**2 + 2j * zeta0 * omega0 * omega


@compiled(error_model="numpy")
def height_at(log_ratio, case, room):
    """Amplitude of the mode under a modal force at a frequency; 0 where the contacts were not solved.

    ``case``: omega and damping ratio of the bare mode, modal force, beam and contacts. ``room``: see ``room_for``.
    """
    (mode, load, beam, contact), (x, z, m, a) = case, room
    omega = mode[0] * math.exp(log_ratio)
    stiffness = bare_stiffness(omega, mode[0], mode[1]) + linear_part(omega, beam, z, m, a)
    q, left = under_force(stiffness, load, contact, x, z, m)
    return q if left < 1e-4 else 0j


COARSE = 0.014
"""Spacing of the frequencies that are looked at, in the logarithm."""
FIRST = 8
"""Frequencies to either side for the first force level; where the last one is highest, the scan goes on beyond it."""
NEXT = 4
"""Frequencies to either side for the following force levels, about the peak of the one before."""
WIDEST = 30
"""Frequencies to either side at most, a factor of 1.5 in frequency: what moves farther counts as unsolved."""


@compiled(error_model="numpy")
def climb(places, heights, top, case, room):
    """Place and response of the maximum next to ``top`` to 1e-4: 1 / height^2 is nearly a parabola. Slips in ``z``."""
    at, y, z = places[top - 1 : top + 2].copy(), heights[top - 1 : top + 2].copy(), room[1]
    response, slip = 0j, np.zeros(z.shape[1], np.complex128)
    least = 1e-4
    for _ in range(12):
        if at[2] - at[0] < 4 * least:
            break
        left, middle, right = 1 / max(y[0], 1e-300) ** 2, 1 / y[1] ** 2, 1 / max(y[2], 1e-300) ** 2
        above = (at[1] - at[0]) ** 2 * (middle - right) - (at[1] - at[2]) ** 2 * (middle - left)
        below = (at[1] - at[0]) * (middle - right) - (at[1] - at[2]) * (middle - left)
        new = at[1] - 0.5 * above / below if below != 0 else at[1]
        if abs(new - at[1]) < least:
            wide = max(at[2] - at[1], at[1] - at[0])
            new = at[1] + (least if at[2] - at[1] > at[1] - at[0] else -least) * (1 if wide < 8 * least else 3)
        new = min(max(new, at[0] + 0.1 * (at[1] - at[0])), at[2] - 0.1 * (at[2] - at[1]))
        q = height_at(new, case, room)
        value = abs(q)
        side = 0 if new < at[1] else 2
        if value > y[1]:
            at[2 - side], y[2 - side] = at[1], y[1]
            at[1], y[1], response = new, value, q
            slip[:] = z[SLIP]
        else:
            at[side], y[side] = new, value
    if response == 0:
        response = height_at(at[1], case, room)
    else:
        z[SLIP] = slip
    return at[1], response


@compiled(error_model="numpy")
def look(k, scan, case, room):
    """Height of the response at one frequency of the scan, computed when it is asked for."""
    places, heights, known, stiffness, psis, frees = scan
    if heights[k] < 0:
        (mode, load, beam, contact), (x, z, m, a) = case, room
        if not known[k]:
            omega = mode[0] * math.exp(places[k])
            stiffness[k] = bare_stiffness(omega, mode[0], mode[1]) + linear_part(omega, beam, z, m, a)
            psis[k], frees[k], known[k] = z[PSI], m[ALONE], True
        else:
            z[PSI], m[ALONE] = psis[k], frees[k]
        q, left = under_force(stiffness[k], load, contact, x, z, m)
        heights[k] = abs(q) if left < 1e-4 else 0.0
    return heights[k]


@compiled(error_model="numpy")
def highest(middle, reach, scan, case, room):
    """The highest place of the scan with two lower neighbours; -1 where there is none.

    Every second frequency around the middle first; where the highest is the last one, the scan goes on beyond it.
    """
    size = len(scan[0])
    low, high = max(middle - reach, 0), min(middle + reach, size - 1)
    top = low
    for k in range(low, high + 1, 2):
        if look(k, scan, case, room) > scan[1][top]:
            top = k
    for _ in range(size):
        if scan[1][top] <= 0 or top == 0 or top == size - 1:
            return -1
        before = top
        for k in (before - 1, before + 1):
            if look(k, scan, case, room) > scan[1][top]:
                top = k
        if top == before:
            return top
    return -1


@compiled(error_model="numpy")
def one_mode(omega0, zeta0, driver, levels, beam, contact):
    """Frequency, damping, slip ratio and dynamic stiffness of a mode at every force level (ascending), or NaN.

    The highest response under the force: frequencies around that of the structure carrying the beam first, then up the
    best hill. The damping is that of a single mode of this height and of the local slope of the dynamic stiffness.
    """
    n, size = len(beam[0]), 2 * WIDEST + 1
    room = room_for(n)
    _, z, m, a = room
    result = np.full((4, len(levels)), np.nan)
    heights = np.empty(size)
    scan = (
        COARSE * (np.arange(size) - WIDEST),
        heights,
        np.zeros(size, np.bool_),
        np.empty(size, np.complex128),
        np.empty((size, n), np.complex128),
        np.empty((size, n, n), np.complex128),
    )
    mode = (omega0, zeta0)
    carried = linear_part(omega0, beam, z, m, a).real / omega0**2
    shift = 0.5 * math.log(min(max(1 + carried, 0.5), 2.0))
    middle, reach = WIDEST + round(shift / COARSE), FIRST
    for row in range(len(levels)):
        load = levels[row] * driver
        case = (mode, load, beam, contact)
        z[SLIP] = 0
        heights[:] = -1.0
        top = highest(middle, reach, scan, case, room)
        if top < 0:
            continue
        middle, reach = top, NEXT
        best, q = climb(scan[0], heights, top, case, room)
        if q == 0:
            continue
        omega, total = omega0 * math.exp(best), load / q
        ratio = 0.0
        for joint in range(n):
            limit = contact[1][joint]
            ratio = max(ratio, abs(z[SLIP, joint]) * contact[0][joint] / limit if limit > 0 else math.inf)
        slope = -held_ahead(omega, mode, beam, contact, z, m, a) / (1e-4 * omega)
        if not omega < slope < 4 * omega:
            slope = 2 * omega
        result[0, row], result[1, row] = omega / (2 * math.pi), abs(total) / (omega * slope)
        result[2, row], result[3, row] = ratio, abs(total)
    return result


@compiled(error_model="numpy")
def held_ahead(omega, mode, beam, contact, z, m, a):
    """Change of the real dynamic stiffness over a frequency step of 1e-4 with the contacts' secant stiffness held."""
    k_t, limit, loss, table = contact
    n = z.shape[1]
    total = np.zeros(2, np.complex128)
    kappa, psi = np.zeros(n, np.complex128), np.zeros(n, np.complex128)
    for i in range(n):
        value, _ = describing(abs(z[SLIP, i]) * k_t[i] / limit[i] if limit[i] > 0 else 1e30, table)
        kappa[i] = complex(value.real, value.imag + loss * value.real) * k_t[i]
    for side in range(2):
        here = omega * (1 + 1e-4 * side)
        total[side] = bare_stiffness(here, mode[0], mode[1]) + linear_part(here, beam, z, m, a)
        psi[:] = z[PSI]
        for i in range(n):
            for j in range(n):
                m[SPRUNG, i, j] = m[ALONE, i, j] * kappa[j]
            m[SPRUNG, i, i] += 1
        hold(m)
        for i in range(n):
            for j in range(n):
                total[side] += psi[i] * kappa[i] * m[HELD, i, j] * psi[j]
    return (total[1] - total[0]).real


@compiled(error_model="numpy")
def all_places(bare, levels, placed, beams, joints):
    """``one_mode`` for all candidates, modes and normal forces: (candidate, mode, 4, level, force).

    ``bare``: angular frequencies, damping ratios and motions of the excited DOF (mode,); ``placed``: deflections and
    motions of the interface (candidate, joint, mode) and the beam of every candidate; ``beams``: squares, tangential
    and normal motions of their modes and what the modes far above add; ``joints``: k_N, k_T and slip forces (force,),
    loss factor, first harmonic of the law.
    """
    (omega0, zeta0, driver), (phi, lever, kind) = bare, placed
    (squares, tangential, normal, rest), (k_n, k_t, limits, loss, table) = beams, joints
    candidates, modes, forces = phi.shape[0], phi.shape[2], len(k_t)
    result = np.full((candidates, modes, 4, len(levels), forces), np.nan)
    for c in range(candidates):
        for mode in range(modes):
            if driver[mode] <= 0:
                continue
            for f in range(forces):
                beam = (
                    phi[c, :, mode].copy(),
                    lever[c, :, mode].copy(),
                    k_n[f],
                    squares[kind[c]],
                    tangential[kind[c]],
                    normal[kind[c]],
                    rest[kind[c]],
                )
                contact = (np.full(phi.shape[1], k_t[f]), np.full(phi.shape[1], limits[f]), loss, table)
                result[c, mode, :, :, f] = one_mode(omega0[mode], zeta0[mode], driver[mode], levels, beam, contact)
    return result
