"""Harmonic balance at the contacts: their forces over a period, receptances, Newton's method; compiled.

Unknown are the cos and sin amplitudes (contact, 2 H) of the relative displacements at H orders. Contacts act with the
deviation g = f - k u from a stuck spring, so that a stuck contact needs no equation.
"""

import numba as nb
import numpy as np

from ema.simulate.period_kernels import masing_period
from ema.simulate.quadrature_kernels import smooth_period

_GOOD_ENOUGH, _FORCING, _DENSE = 1000.0, 1e-3, 80


@nb.njit(cache=True, error_model="numpy")
def contact_forces(amplitudes, orders, basis, odd, fine, omega, stiffness, limits, members, laws):
    """Deviations G (contact, 2 H), Jacobian (contact, member, 2 H, 2 H), losses per period, who slips.

    ``members`` (contact, member): the contacts on whose motion the force of a contact depends, itself first, then -1.
    ``basis`` (2, sample, 2 H): derivatives of cos and sin; they serve to find the turning points.
    """
    codes, par, shares_k, shares_f, counts, tables, user = laws
    contacts, size = amplitudes.shape
    forces, jacobian = np.zeros((contacts, size)), np.zeros((contacts, members.shape[1], size, size))
    lost, slips = np.zeros(contacts), np.zeros(contacts, np.bool_)
    room, highest = 4 * orders[-1] + 8, 2 * orders[-1] + 1
    place, value = np.empty(room), np.empty(room)
    cosine, sine = np.empty((room, highest)), np.empty((room, highest))
    rates, bends = amplitudes @ basis[0].T, amplitudes @ basis[1].T
    for i in range(contacts):
        if codes[i] == 0:
            weakest = np.inf
            for j in range(counts[i]):
                weakest = min(weakest, limits[i] * shares_f[i, j] / (stiffness[i] * shares_k[i, j]))
            peak = 0.0
            for h in range(size // 2):
                peak += np.hypot(amplitudes[i, 2 * h], amplitudes[i, 2 * h + 1])
            if peak <= weakest:
                continue
            lost[i] = masing_period(
                amplitudes[i], orders, rates[i], bends[i], odd, stiffness[i], limits[i], shares_k[i], shares_f[i],
                counts[i], place, value, cosine, sine, forces[i], jacobian[i, 0],
            )  # fmt: skip
            slips[i] = np.any(forces[i] != 0.0)
        else:
            lost[i] = smooth_period(
                i, codes[i], amplitudes[i], orders, rates[i], bends[i], odd, fine, omega, stiffness[i], limits[i], par,
                tables, user, place, value, cosine, sine, forces[i], jacobian[i, 0],
            )  # fmt: skip
            slips[i] = np.abs(forces[i]).max() > 1e-12 * limits[i]
    return forces, jacobian, lost, slips


@nb.njit(cache=True, error_model="numpy")
def residual(amplitudes, drive, gains, forces):
    """u - u_drive + Z G in cos and sin amplitudes (X = a - j b)."""
    contacts, size = amplitudes.shape
    out = amplitudes - drive
    for i in range(contacts):
        for h in range(size // 2):
            cosine, sine = 0.0, 0.0
            for j in range(contacts):
                real, imaginary = gains[0, h, i, j], gains[1, h, i, j]
                ga, gb = forces[j, 2 * h], forces[j, 2 * h + 1]
                cosine += real * ga + imaginary * gb
                sine += real * gb - imaginary * ga
            out[i, 2 * h] += cosine
            out[i, 2 * h + 1] += sine
    return out


@nb.njit(cache=True, error_model="numpy")
def columns(slips, members):
    """Contacts on whose motion any slipping contact depends."""
    wanted = np.zeros(len(slips), np.bool_)
    for i in range(len(slips)):
        if slips[i]:
            for w in range(members.shape[1]):
                if members[i, w] >= 0:
                    wanted[members[i, w]] = True
    return np.flatnonzero(wanted)


@nb.njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def newton_matrix(gains, jacobian, members, slips, moving, rows):
    """I + Z dG/dU over the contacts ``rows`` and the columns of the contacts ``moving``, (row 2 H, column 2 H)."""
    size = jacobian.shape[2]
    place = np.full(len(slips), -1)
    for n in range(len(moving)):
        place[moving[n]] = n
    out = np.zeros((len(rows) * size, len(moving) * size))
    for n in range(len(rows)):
        for c in range(len(moving)):
            if moving[c] == rows[n]:
                for r in range(size):
                    out[n * size + r, c * size + r] = 1.0
    for j in range(len(slips)):
        if not slips[j]:
            continue
        for w in range(members.shape[1]):
            if members[j, w] < 0:
                continue
            left = place[members[j, w]] * size
            for n in range(len(rows)):
                for h in range(size // 2):
                    real, imaginary = gains[0, h, rows[n], j], gains[1, h, rows[n], j]
                    upper, lower = out[n * size + 2 * h], out[n * size + 2 * h + 1]
                    above, below = jacobian[j, w, 2 * h], jacobian[j, w, 2 * h + 1]
                    for c in range(size):
                        upper[left + c] += real * above[c] + imaginary * below[c]
                        lower[left + c] += real * below[c] - imaginary * above[c]
    return out


@nb.njit(cache=True, error_model="numpy")
def linear_change(change, jacobian, members, slips):
    """Change of the contact forces (contact, 2 H) that follows from a change of the amplitudes, dG/dU change."""
    out = np.zeros_like(change)
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


@nb.njit(cache=True, error_model="numpy")
def dense_step(gains, jacobian, members, slips, rest):
    """Solve (I + Z dG/dU) step = rest: the slipping contacts by elimination, the stuck ones follow."""
    size = rest.shape[1]
    moving = columns(slips, members)
    step = np.zeros_like(rest)
    if len(moving) == 0:
        return rest.copy()
    matrix = newton_matrix(gains, jacobian, members, slips, moving, moving)
    solved = np.linalg.solve(matrix, rest[moving].copy().reshape(-1))
    for n in range(len(moving)):
        step[moving[n]] = solved[n * size : (n + 1) * size]
    follow = residual(np.zeros_like(rest), rest, gains, linear_change(step, jacobian, members, slips))
    for i in range(len(rest)):
        if step[i, 0] == 0.0 and not np.any(moving == i):
            step[i] = -follow[i]
    return step


@nb.njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def coarse_inverse(gains, jacobian, members, slips, shapes, weights):
    """Inverse of (I + Z dG/dU) seen by few ``shapes`` (contact, shape) of the contacts at all orders.

    ``weights`` (shape, contact) with weights @ shapes = I. Returns (shape 2 H, shape 2 H).
    """
    contacts, count = shapes.shape
    size = jacobian.shape[2]
    matrix = np.eye(count * size)
    upper, lower = np.empty((contacts, count * size)), np.empty((contacts, count * size))
    for h in range(size // 2):
        upper[:] = 0.0
        lower[:] = 0.0
        for j in range(contacts):
            if not slips[j]:
                continue
            for w in range(members.shape[1]):
                if members[j, w] < 0:
                    continue
                for b in range(count):
                    factor = shapes[members[j, w], b]
                    for c in range(size):
                        upper[j, b * size + c] += factor * jacobian[j, w, 2 * h, c]
                        lower[j, b * size + c] += factor * jacobian[j, w, 2 * h + 1, c]
        real, imaginary = weights @ gains[0, h], weights @ gains[1, h]
        above = real @ upper + imaginary @ lower
        below = real @ lower - imaginary @ upper
        for a in range(count):
            matrix[a * size + 2 * h] += above[a]
            matrix[a * size + 2 * h + 1] += below[a]
    return np.ascontiguousarray(np.linalg.inv(matrix))


@nb.njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def inner(left, right):
    """Scalar product of two arrays (contact, 2 H)."""
    total = 0.0
    for i in range(left.shape[0]):
        for c in range(left.shape[1]):
            total += left[i, c] * right[i, c]
    return total


@nb.njit(cache=True, error_model="numpy")
def add(factor, what, out):
    """out += factor what, for arrays (contact, 2 H)."""
    for i in range(what.shape[0]):
        for c in range(what.shape[1]):
            out[i, c] += factor * what[i, c]


@nb.njit(cache=True, error_model="numpy")
def _preconditioned(vector, shapes, weights, inverse):
    """The coarse inverse on what the shapes see of a vector (contact, 2 H), the identity on the rest."""
    seen = weights @ vector
    solved = (inverse @ seen.reshape(-1)).reshape(seen.shape)
    add(-1.0, seen, solved)
    out = shapes @ solved
    add(1.0, vector, out)
    return out


@nb.njit(cache=True, error_model="numpy")
def krylov_step(gains, jacobian, members, slips, rest, shapes, weights, inverse):
    """Solve (I + Z dG/dU) step = rest by GMRES with the coarse inverse; the step and the number of turns (-1: no)."""
    most = 30
    zero, step = np.zeros_like(rest), np.zeros_like(rest)
    turned, held = np.zeros((most + 1, *rest.shape)), np.zeros((most, *rest.shape))
    triangle, target = np.zeros((most + 1, most)), np.zeros(most + 1)
    cosine, sine = np.zeros(most), np.zeros(most)
    norm = np.sqrt(inner(rest, rest))
    add(1.0 / norm, rest, turned[0])
    target[0] = norm
    for n in range(most):
        held[n] = _preconditioned(turned[n], shapes, weights, inverse)
        new = residual(held[n], zero, gains, linear_change(held[n], jacobian, members, slips))
        for m in range(n + 1):
            triangle[m, n] = inner(new, turned[m])
            add(-triangle[m, n], turned[m], new)
        size = np.sqrt(inner(new, new))
        for m in range(n):
            upper, lower = triangle[m, n], triangle[m + 1, n]
            triangle[m, n] = cosine[m] * upper + sine[m] * lower
            triangle[m + 1, n] = cosine[m] * lower - sine[m] * upper
        length = np.hypot(triangle[n, n], size)
        cosine[n], sine[n] = triangle[n, n] / length, size / length
        triangle[n, n] = length
        target[n + 1], target[n] = -sine[n] * target[n], cosine[n] * target[n]
        if abs(target[n + 1]) <= _FORCING * norm:
            for m in range(n, -1, -1):
                for k in range(m + 1, n + 1):
                    target[m] -= triangle[m, k] * target[k]
                target[m] /= triangle[m, m]
                add(target[m], held[m], step)
            return step, n + 1
        add(1.0 / size, new, turned[n + 1])
    return step, -1


@nb.njit(cache=True, error_model="numpy")
def newton(
    start, orders, basis, odd, fine, omega, drive, gains, stiffness, limits, members, laws, shapes, weights, inverse,
    goal, most,
):  # fmt: skip
    """Solve u - u_drive + Z G(u) = 0 from a start, with step halving.

    Small systems are solved by elimination, large ones by GMRES; ``inverse`` is the coarse one of a point nearby, or
    empty.
    Returns the number of steps (-1: failed), amplitudes, forces, Jacobian, losses, who slips, the coarse inverse. With
    ``most`` of 0 a single step is made, and its result is in the amplitudes though it counts as failed.
    """
    amplitudes, trial = start.copy(), start.copy()
    step, rest = np.zeros_like(start), np.zeros_like(start)
    norm, length, steps = np.inf, 1.0, 0
    while True:
        forces, jacobian, lost, slips = contact_forces(
            trial, orders, basis, odd, fine, omega, stiffness, limits, members, laws
        )
        new_rest = residual(trial, drive, gains, forces)
        new_norm, size = np.sqrt(inner(new_rest, new_rest)), np.sqrt(inner(trial, trial))
        if new_norm <= goal * size:
            return steps, trial, forces, jacobian, lost, slips, inverse
        if not new_norm < (1.0 - 0.1 * length) * norm:
            # a contact that rolls over a tiny wave may leave no better place than this one
            if new_norm <= _GOOD_ENOUGH * goal * size:
                return steps, trial, forces, jacobian, lost, slips, inverse
            length *= 0.5
            if length < 0.005 or not np.isfinite(new_norm):
                break
            add(length, step, trial)
            continue
        amplitudes, rest, norm, length, steps = trial, new_rest, new_norm, 1.0, steps + 1
        large = shapes.shape[1] > 0 and slips.sum() * rest.shape[1] > _DENSE
        turns = -1
        if large and len(inverse) == shapes.shape[1] * rest.shape[1]:
            step, turns = krylov_step(gains, jacobian, members, slips, rest, shapes, weights, inverse)
        if large and (turns < 0 or turns > 6 + len(orders)):
            inverse = coarse_inverse(gains, jacobian, members, slips, shapes, weights)
            step, turns = krylov_step(gains, jacobian, members, slips, rest, shapes, weights, inverse)
        if turns < 0:
            step = dense_step(gains, jacobian, members, slips, rest)
        trial = amplitudes.copy()
        add(-1.0, step, trial)
        if steps > most:
            break
    return -1, trial, forces, jacobian, lost, slips, inverse
