"""Harmonic balance at the contacts: their forces over a period, receptances, Newton's method; compiled.

Unknown are the cos and sin amplitudes (contact, 2 H) of the relative displacements at H orders. Contacts act with the
deviation g = f - k u from a stuck spring, so that a stuck contact needs no equation.
"""

import numba as nb
import numpy as np

from ema.simulate.period_kernels import masing_period
from ema.simulate.quadrature_kernels import smooth_period

_GOOD_ENOUGH = 1000.0


@nb.njit(cache=True)
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
                amplitudes[i], orders, rates[i], bends[i], odd, stiffness[i], limits[i], shares_k[i], shares_f[i], counts[i],
                place, value, cosine, sine, forces[i], jacobian[i, 0],
            )  # fmt: skip
            slips[i] = np.any(forces[i] != 0.0)
        else:
            lost[i] = smooth_period(
                i, codes[i], amplitudes[i], orders, rates[i], bends[i], odd, fine, omega, stiffness[i], limits[i], par, tables,
                user, place, value, cosine, sine, forces[i], jacobian[i, 0],
            )  # fmt: skip
            slips[i] = np.abs(forces[i]).max() > 1e-12 * limits[i]
    return forces, jacobian, lost, slips


@nb.njit(cache=True)
def receptances(slip, squares, decay, omega, orders):
    """Real and imaginary Z (2, harmonic, contact, contact): relative displacement per friction force at the orders."""
    contacts, modes = slip.shape
    out = np.empty((2, len(orders), contacts, contacts))
    real, imaginary = np.empty((contacts, modes)), np.empty((contacts, modes))
    back = np.ascontiguousarray(slip.T)
    for h in range(len(orders)):
        w = omega * orders[h]
        for r in range(modes):
            distance, loss = squares[r] - w * w, w * decay[r]
            size = 1.0 / (distance * distance + loss * loss)
            for i in range(contacts):
                real[i, r] = slip[i, r] * distance * size
                imaginary[i, r] = -slip[i, r] * loss * size
        out[0, h] = real @ back
        out[1, h] = imaginary @ back
    return out


@nb.njit(cache=True)
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


@nb.njit(cache=True)
def columns(slips, members):
    """Contacts on whose motion any slipping contact depends."""
    wanted = np.zeros(len(slips), np.bool_)
    for i in range(len(slips)):
        if slips[i]:
            for w in range(members.shape[1]):
                if members[i, w] >= 0:
                    wanted[members[i, w]] = True
    return np.flatnonzero(wanted)


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
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


@nb.njit(cache=True)
def newton_step(gains, jacobian, members, slips, rest):
    """Solve (I + Z dG/dU) step = rest: the slipping contacts by elimination, the stuck ones follow."""
    contacts, size = rest.shape
    moving = columns(slips, members)
    step = rest.copy()
    if len(moving) == 0:
        return step
    matrix = newton_matrix(gains, jacobian, members, slips, moving, moving)
    solved = np.linalg.solve(matrix, rest[moving].copy().reshape(-1)).reshape((len(moving), size))
    if len(moving) < contacts:
        # u = rest - Z dG/dU u_moving for the others
        change = np.zeros_like(rest)
        place = np.full(contacts, -1)
        for n in range(len(moving)):
            place[moving[n]] = n
        for j in range(contacts):
            if slips[j]:
                for w in range(members.shape[1]):
                    if members[j, w] >= 0:
                        change[j] += jacobian[j, w] @ solved[place[members[j, w]]]
        step = residual(rest, np.zeros_like(rest), gains, change)
        # residual gives rest + Z change; the sign of Z change is turned
        step = 2.0 * rest - step
    for n in range(len(moving)):
        step[moving[n]] = solved[n]
    return step


@nb.njit(cache=True)
def newton(start, orders, basis, odd, fine, omega, drive, gains, stiffness, limits, members, laws, goal, most):
    """Solve u - u_drive + Z G(u) = 0 from a start, with step halving.

    Returns the number of steps (-1: failed), amplitudes, forces, Jacobian, losses, who slips.
    """
    amplitudes, trial = start, start.copy()
    step, rest = np.zeros_like(start), np.zeros_like(start)
    norm, length, steps = np.inf, 1.0, 0
    while True:
        forces, jacobian, lost, slips = contact_forces(
            trial, orders, basis, odd, fine, omega, stiffness, limits, members, laws
        )
        new_rest = residual(trial, drive, gains, forces)
        new_norm, size = np.sqrt(np.sum(new_rest**2)), np.sqrt(np.sum(trial**2))
        if new_norm <= goal * size:
            return steps, trial, forces, jacobian, lost, slips
        if not new_norm < (1.0 - 0.1 * length) * norm:
            # a contact that rolls over a tiny wave may leave no better place than this one
            if new_norm <= _GOOD_ENOUGH * goal * size:
                return steps, trial, forces, jacobian, lost, slips
            length *= 0.5
            if length < 0.005 or not np.isfinite(new_norm):
                break
            trial = amplitudes - length * step
            continue
        if steps == most:
            break
        amplitudes, rest, norm, length, steps = trial, new_rest, new_norm, 1.0, steps + 1
        step = newton_step(gains, jacobian, members, slips, rest)
        trial = amplitudes - step
    return -1, trial, forces, jacobian, lost, slips


@nb.njit(cache=True)
def cold_start(orders, basis, odd, fine, omega, drive, gains, stiffness, limits, members, laws, goal):
    """From the stuck state: slip forces are lowered from where nothing slips, in steps that adapt.

    Returns what ``newton`` returns.
    """
    level = 1.0
    for i in range(len(limits)):
        if limits[i] > 0.0:
            reach = 0.0
            for h in range(len(orders)):
                reach += np.hypot(drive[i, 2 * h], drive[i, 2 * h + 1])
            level = max(level, 1.001 * stiffness[i] * reach / limits[i])
    amplitudes, ratio, wanted = drive, 0.5, level
    while True:
        found = newton(
            amplitudes,
            orders,
            basis,
            odd,
            fine,
            omega,
            drive,
            gains,
            stiffness,
            limits * wanted,
            members,
            laws,
            goal,
            25,
        )
        if found[0] >= 0:
            amplitudes, level = found[1], wanted
            if level == 1.0:
                return found
            ratio = max(ratio**1.5, 0.1)
        else:
            ratio = np.sqrt(ratio)
            if ratio > 0.9995:
                return found
        wanted = max(level * ratio, 1.0)


@nb.njit(cache=True)
def widen(amplitudes, kept, orders, basis, odd, fine, omega, gains, stiffness, limits, members, laws):
    """What the orders beyond the first ``kept`` would add to a solution, and what that would change in the kept ones.

    One step of block elimination: every new order on its own, then the kept ones. ``amplitudes`` (contact, 2 kept);
    ``gains``, ``orders`` and ``basis`` of all orders. Returns the widened amplitudes, the change of the kept part.
    """
    contacts, size, inner = len(amplitudes), 2 * len(orders), 2 * kept
    wide = np.zeros((contacts, size))
    wide[:, :inner] = amplitudes
    forces, jacobian, _, slips = contact_forces(wide, orders, basis, odd, fine, omega, stiffness, limits, members, laws)
    nothing = np.zeros((contacts, 2))
    for h in range(kept, len(orders)):
        part = slice(2 * h, 2 * h + 2)
        gain = np.ascontiguousarray(gains[:, h : h + 1])
        rest = residual(nothing, nothing, gain, np.ascontiguousarray(forces[:, part]))
        inside = np.ascontiguousarray(jacobian[:, :, part, part])
        wide[:, part] -= newton_step(gain, inside, members, slips, rest)
    change = np.zeros((contacts, inner))
    for j in range(contacts):
        if slips[j]:
            for w in range(members.shape[1]):
                if members[j, w] >= 0:
                    across = np.ascontiguousarray(jacobian[j, w, :inner, inner:])
                    change[j] += across @ wide[members[j, w], inner:]
    gain = np.ascontiguousarray(gains[:, :kept])
    zero = np.zeros_like(change)
    rest = residual(zero, zero, gain, change)
    step = newton_step(gain, np.ascontiguousarray(jacobian[:, :, :inner, :inner]), members, slips, rest)
    wide[:, :inner] -= step
    return wide, step
