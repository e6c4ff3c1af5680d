"""Harmonic balance at the contacts: their forces over a period, receptances, Newton's steps; compiled.

Unknown are the cos and sin amplitudes (contact, 2 H) of the relative displacements at H orders. Contacts act with the
deviation g = f - k u from a stuck spring, so that a stuck contact needs no equation.
"""

import numpy as np

from ema.compiled import compiled, fast, inner
from ema.contact.call_kernels import LIMIT
from ema.contact.linear_kernels import add_rows, copy_table, matvec
from ema.simulate.bristle_kernels import bristle_period
from ema.simulate.period_kernels import masing_period, turning_points
from ema.simulate.quadrature_kernels import smooth_period

_MOST_TURNS = 200
"""Of GMRES: above 400 unknowns they take less than an elimination."""


@inner
def reach(amplitudes):
    """What a motion cannot exceed: the sum of the sizes of its harmonics."""
    total = 0.0
    for h in range(len(amplitudes) // 2):
        total += np.sqrt(amplitudes[2 * h] ** 2 + amplitudes[2 * h + 1] ** 2)
    return total


@compiled(error_model="numpy")
def contact_forces(amplitudes, period, contact, springs, smooth, bristles, derive):
    """Deviations G (contact, 2 H), Jacobian (contact, member, 2 H, 2 H), losses per period, who slips.

    ``amplitudes`` (contact, 2 H): cosine and sine amplitudes of the relative displacements; ``derive``: whether the
    Jacobian is made.

    ``period``: odd orders, first and second derivative (2, contact, sample) of the motions over half a period with both
    ends, to find the turning points, a factor on the number of nodes, angular frequency. ``contact``: stiffnesses, slip
    forces, and members (contact, member), the contacts on whose motion the force of a contact depends, itself first,
    then -1. ``springs``: as ``ContactLaws.springs`` gives them. ``smooth``: what ``ContactLaws.one_by_one`` gives.
    ``bristles``: whether a contact has LuGre's law, and the parameters of all. Either is None where no contact asks for
    it, and its quadrature is then not compiled.
    """
    (orders, samples, fine, omega), (stiffness, limits, members) = period, contact
    (counts, shares_k, shares_f, first), (contacts, size) = springs, amplitudes.shape
    forces, jacobian = np.zeros((contacts, size)), np.zeros((contacts if derive else 1, members.shape[1], size, size))
    lost, slips = np.zeros(contacts), np.zeros(contacts, np.bool_)
    length, highest = 4 * orders[-1] + 8, 2 * orders[-1] + 1
    room = np.empty(length), np.empty(length), np.empty((length, highest)), np.empty((length, highest))
    if smooth is not None:
        smooth[3][LIMIT] = limits
    for i in range(contacts):
        masing, wave = counts[i] > 0, (amplitudes[i], orders)
        out = forces[i], jacobian[i if derive else 0, 0], derive
        if masing and reach(amplitudes[i]) <= limits[i] * first[i]:
            continue
        out[1][:] = 0.0
        number = turning_points(wave, (samples[0, i], samples[1, i]), room)
        turns = number, room[0], room[1], room[2], room[3]
        if number < 2 or limits[i] <= 0.0:
            # without slip force, or without motion
            for r in range(size):
                forces[i, r], out[1][r, r] = -stiffness[i] * amplitudes[i, r], -stiffness[i]
        elif masing:
            parallel = stiffness[i], limits[i], counts[i], shares_k[i], shares_f[i]
            lost[i] = masing_period(parallel, wave, turns, out)
        elif bristles is not None and bristles[0][i]:
            law = stiffness[i], limits[i], bristles[1][i]
            lost[i] = bristle_period(law, wave, (fine, omega), turns, out)
        elif smooth is not None:
            lost[i] = smooth_period(i, smooth, wave, fine, turns, out)
        for r in range(size):
            slips[i] |= abs(forces[i, r]) > (0.0 if masing else 1e-12 * limits[i])
    return forces, jacobian, lost, slips


@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def residual(amplitudes, drive, gains, forces):
    """u - u_drive + Z G in cos and sin amplitudes (X = a - j b)."""
    contacts, size = amplitudes.shape
    out = np.empty((contacts, size))
    for i in range(contacts):
        for h in range(size // 2):
            cosine, sine = amplitudes[i, 2 * h] - drive[i, 2 * h], amplitudes[i, 2 * h + 1] - drive[i, 2 * h + 1]
            for j in range(contacts):
                real, imaginary = gains[0, h, i, j], gains[1, h, i, j]
                ga, gb = forces[j, 2 * h], forces[j, 2 * h + 1]
                cosine += real * ga + imaginary * gb
                sine += real * gb - imaginary * ga
            out[i, 2 * h], out[i, 2 * h + 1] = cosine, sine
    return out


@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def newton_matrix(gains, jacobian, members, slips, moving):
    """I + Z dG/dU over the contacts ``moving``, (contact 2 H, contact 2 H)."""
    size = jacobian.shape[2]
    place = np.empty(len(slips), np.int64)
    for n in range(len(moving)):
        place[moving[n]] = n
    out = np.zeros((len(moving) * size, len(moving) * size))
    for r in range(len(out)):
        out[r, r] = 1.0
    for j in range(len(slips)):
        if not slips[j]:
            continue
        for w in range(members.shape[1]):
            if members[j, w] < 0:
                continue
            left = place[members[j, w]] * size
            for n in range(len(moving)):
                for h in range(size // 2):
                    real, imaginary = gains[0, h, moving[n], j], gains[1, h, moving[n], j]
                    upper, lower = out[n * size + 2 * h], out[n * size + 2 * h + 1]
                    above, below = jacobian[j, w, 2 * h], jacobian[j, w, 2 * h + 1]
                    for c in range(size):
                        upper[left + c] += real * above[c] + imaginary * below[c]
                        lower[left + c] += real * below[c] - imaginary * above[c]
    return out


@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def linear_change(change, jacobian, members, slips):
    """Change of the contact forces (contact, 2 H) that follows from a change of the amplitudes, dG/dU change."""
    out = np.zeros(change.shape)
    for j in range(len(slips)):
        if not slips[j]:
            continue
        for w in range(members.shape[1]):
            if members[j, w] < 0:
                continue
            for r in range(change.shape[1]):
                total = 0.0
                for c in range(change.shape[1]):
                    total += jacobian[j, w, r, c] * change[members[j, w], c]
                out[j, r] += total
    return out


@fast
def precondition(vector, coarse, room, out):
    """A coarse inverse on what the shapes see of a vector (contact, 2 H), the identity on the rest.

    ``coarse``: shapes, weights, the inverse that holds the lowest orders together, and blocks (order, 2 shape, 2 shape)
    of the higher ones one by one.
    """
    (shapes, weights, inverse, blocks), (seen, change) = coarse, room
    count = shapes.shape[1]
    width = len(inverse) // count
    for a in range(count):
        for c in range(vector.shape[1]):
            seen[a, c] = 0.0
        add_rows(vector, weights[a], seen[a])
    for a in range(count):
        for c in range(vector.shape[1]):
            total, first = -seen[a, c], c - c % 2
            for b in range(count):
                if c < width:
                    for d in range(width):
                        total += inverse[a * width + c, b * width + d] * seen[b, d]
                else:
                    row = blocks[(c - width) // 2, 2 * a + c % 2]
                    total += row[2 * b] * seen[b, first] + row[2 * b + 1] * seen[b, first + 1]
            change[a, c] = total
    copy_table(out, vector)
    for i in range(len(out)):
        add_rows(change, shapes[i], out[i])


@fast
def squares(vector):
    """Sum of the squares."""
    total = 0.0
    for x in vector:
        total += x * x
    return total


@compiled(error_model="numpy")
def krylov_step(system, rest, coarse, forcing):
    """Solve (I + Z dG/dU) step = rest by GMRES with the coarse inverse to the share ``forcing`` of the rest.

    ``system``: receptances Z, Jacobian, its members, who slips; ``coarse`` as in ``precondition``. Returns the step and
    the number of turns (-1: it takes too many).
    """
    (gains, jacobian, members, slips), (contacts, width) = system, rest.shape
    most = min(contacts * width, _MOST_TURNS)
    zero, step = np.zeros((contacts, width)), np.zeros(contacts * width)
    turned, held = np.empty((most + 1, len(step))), np.empty((most, contacts, width))
    room = np.empty((coarse[0].shape[1], width)), np.empty((coarse[0].shape[1], width))
    triangle, target, seen = np.zeros((most + 1, most)), np.zeros(most + 1), np.empty(most)
    cosine, sine = np.zeros(most), np.zeros(most)
    new = rest.copy().reshape(-1)
    norm = np.sqrt(squares(new))
    target[0] = norm
    for r in range(len(new)):
        turned[0, r] = new[r] / norm
    for n in range(most):
        precondition(turned[n].reshape(contacts, width), coarse, room, held[n])
        pushed = linear_change(held[n], jacobian, members, slips)
        new = residual(held[n], zero, gains, pushed).reshape(-1)
        matvec(turned[: n + 1], new, seen)
        for m in range(n + 1):
            triangle[m, n], seen[m] = seen[m], -seen[m]
        add_rows(turned[: n + 1], seen, new)
        size = np.sqrt(squares(new))
        for m in range(n):
            upper, lower = triangle[m, n], triangle[m + 1, n]
            triangle[m, n] = cosine[m] * upper + sine[m] * lower
            triangle[m + 1, n] = cosine[m] * lower - sine[m] * upper
        length = np.sqrt(triangle[n, n] ** 2 + size**2)
        cosine[n], sine[n] = triangle[n, n] / length, size / length
        triangle[n, n] = length
        target[n + 1], target[n] = -sine[n] * target[n], cosine[n] * target[n]
        if abs(target[n + 1]) <= forcing * norm:
            for m in range(n, -1, -1):
                for k in range(m + 1, n + 1):
                    target[m] -= triangle[m, k] * target[k]
                target[m] /= triangle[m, m]
            add_rows(held[: n + 1].reshape(n + 1, len(step)), target, step)
            return step.reshape(contacts, width), n + 1
        for r in range(len(new)):
            turned[n + 1, r] = new[r] / size
    return zero, -1
