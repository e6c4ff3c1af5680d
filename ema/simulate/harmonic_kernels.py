"""Compiled alternating frequency/time: friction forces and their Jacobian over one period; compiled."""

import numba as nb
import numpy as np

from ema.simulate.friction_kernels import step


@nb.njit(cache=True)
def contact_period(
    i, amplitudes, basis, h, periods, k, limit, code, par, shares_k, shares_f, count, tables, user, z, z1, a, b,
    deviation, jacobian, want,
):  # fmt: skip
    """Deviation g = f - k u (sample,) of contact i over its last period, its loss per period, whether it slips.

    amplitudes (2 H,) of cos and sin; basis (sample, 2 H). ``jacobian`` (2 H, 2 H) receives d G / d amplitudes.
    """
    samples, size = basis.shape
    width = max(count, 1)
    motion = basis @ amplitudes
    slope = np.zeros((width, size))
    total = np.zeros(size)
    z[i, :] = 0.0
    before, force, lost, slips = 0.0, 0.0, 0.0, False
    for period in range(periods):
        last = period == periods - 1
        for n in range(samples):
            u = motion[n]
            new, _ = step(code, i, k, limit, par, shares_k, shares_f, count, tables, user, before, u, h, z, z1, a, b)
            first = period == 0 and n == 0
            if last:
                lost += 0.5 * (new + force) * (u - before)
                deviation[n] = new - k * u
                slips = slips or abs(new - k * u) > 1e-9 * limit
            if want:
                total[:] = 0.0
                for j in range(width):
                    aj, bj = a[i, j], b[i, j]
                    if first:
                        for c in range(size):
                            slope[j, c] = bj * basis[n, c]
                    else:
                        m = n - 1 if n > 0 else samples - 1
                        for c in range(size):
                            slope[j, c] = aj * slope[j, c] + bj * (basis[n, c] - basis[m, c])
                    for c in range(size):
                        total[c] += slope[j, c]
                if last:
                    for c in range(size):
                        total[c] -= k * basis[n, c]
                    for r in range(size):
                        weight = 2.0 / samples * basis[n, r]
                        for c in range(size):
                            jacobian[r, c] += weight * total[c]
            before, force = u, new
            for j in range(z.shape[1]):
                z[i, j] = z1[i, j]
    return lost, slips


@nb.njit(cache=True)
def contact_forces(
    amplitudes, basis, interval, periods, stiffness, limits, codes, par, shares_k, shares_f, counts, tables, user, want
):
    """Fourier coefficients G (contact, 2 H) of the deviations, Jacobian (contact, 2 H, 2 H), losses, who slips."""
    contacts, size = amplitudes.shape
    samples = basis.shape[0]
    z = np.zeros(shares_k.shape)
    z1, a, b = np.zeros_like(z), np.zeros_like(z), np.zeros_like(z)
    forces, lost, slips = np.zeros((contacts, size)), np.zeros(contacts), np.zeros(contacts, np.bool_)
    jacobian = np.zeros((contacts, size, size) if want else (1, 1, 1))
    deviation = np.zeros(samples)
    for i in range(contacts):
        if codes[i] == 0:
            # below the smallest limit of its springs a contact is a linear spring
            peak = 0.0
            for h in range(size // 2):
                peak += np.sqrt(amplitudes[i, 2 * h] ** 2 + amplitudes[i, 2 * h + 1] ** 2)
            weakest = np.inf
            for j in range(counts[i]):
                weakest = min(weakest, limits[i] * shares_f[i, j] / (stiffness[i] * shares_k[i, j]))
            if peak <= weakest:
                continue
        target = jacobian[i] if want else jacobian[0]
        lost[i], slips[i] = contact_period(
            i, amplitudes[i], basis, interval, periods, stiffness[i], limits[i], codes[i], par, shares_k, shares_f,
            counts[i], tables, user, z, z1, a, b, deviation, target, want,
        )  # fmt: skip
        forces[i] = 2.0 / samples * (basis.T @ deviation)
    return forces, jacobian, lost, slips


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def masing_forces(amplitudes, basis, stiffness, limits, want):
    """``contact_forces`` for contacts of one Masing spring: its state is the instant at which it last slid.

    While it sticks, df/dU = k (T_now - T_last); while it slides, 0.
    """
    contacts, size = amplitudes.shape
    samples = basis.shape[0]
    forces, lost, slips = np.zeros((contacts, size)), np.zeros(contacts), np.zeros(contacts, np.bool_)
    jacobian = np.zeros((contacts, size, size) if want else (1, 1, 1))
    motion, deviation, run = np.empty(samples), np.empty(samples), np.empty(size)
    for i in range(contacts):
        k, limit = stiffness[i], limits[i]
        for n in range(samples):
            total = 0.0
            for c in range(size):
                total += basis[n, c] * amplitudes[i, c]
            motion[n] = total
        if k * np.abs(motion).max() <= limit:
            continue
        rest, last = 0.0, -1  # displacement without force; sample of the last sliding
        for n in range(samples):
            force = k * (motion[n] - rest)
            if abs(force) > limit:
                rest, last = motion[n] - np.sign(force) * limit / k, n
        run[:] = 0.0
        before = k * (motion[samples - 1] - rest)
        loss = 0.0
        for n in range(samples):
            u = motion[n]
            force = k * (u - rest)
            sliding = abs(force) > limit
            if sliding:
                force = np.sign(force) * limit
                loss += 0.5 * (force + before) * (u - force / k - rest)
            if want:
                if sliding:
                    if last >= 0:
                        for r in range(size):
                            for c in range(size):
                                jacobian[i, r, c] -= run[r] * basis[last, c]
                        run[:] = 0.0
                    for r in range(size):
                        for c in range(size):
                            jacobian[i, r, c] -= basis[n, r] * basis[n, c]
                else:
                    for r in range(size):
                        run[r] += basis[n, r]
            if sliding:
                rest, last = u - force / k, n
            deviation[n] = force - k * u
            before = force
        if want and last >= 0:
            for r in range(size):
                for c in range(size):
                    jacobian[i, r, c] = 2.0 / samples * k * (jacobian[i, r, c] - run[r] * basis[last, c])
        lost[i] = loss
        for c in range(size):
            total = 0.0
            for n in range(samples):
                total += basis[n, c] * deviation[n]
            forces[i, c] = 2.0 / samples * total
        slips[i] = True
    return forces, jacobian, lost, slips


@nb.njit(cache=True)
def receptances(slip, squares, decay, omega, orders):
    """Z (harmonic, contact, contact): relative displacement of the contacts per friction force, at the harmonics."""
    contacts, modes = slip.shape
    out = np.empty((len(orders), contacts, contacts), np.complex128)
    weighted = np.empty((contacts, modes), np.complex128)
    for h in range(len(orders)):
        w = omega * orders[h]
        for r in range(modes):
            gain = 1.0 / (squares[r] - w * w + 1j * w * decay[r])
            for i in range(contacts):
                weighted[i, r] = slip[i, r] * gain
        for i in range(contacts):
            for j in range(i + 1):
                total = 0.0 + 0.0j
                for r in range(modes):
                    total += weighted[i, r] * slip[j, r]
                out[h, i, j] = total
                out[h, j, i] = total
    return out


@nb.njit(cache=True)
def residual(amplitudes, drive, gains, forces):
    """u - u_drive + Z G in cos and sin amplitudes (X = a - j b)."""
    contacts, size = amplitudes.shape
    out = amplitudes - drive
    for h in range(size // 2):
        for i in range(contacts):
            cosine, sine = 0.0, 0.0
            for j in range(contacts):
                z = gains[h, i, j]
                ga, gb = forces[j, 2 * h], forces[j, 2 * h + 1]
                cosine += z.real * ga + z.imag * gb
                sine += z.real * gb - z.imag * ga
            out[i, 2 * h] += cosine
            out[i, 2 * h + 1] += sine
    return out


@nb.njit(cache=True)
def newton_matrix(gains, jacobian, moving):
    """I + Z dG/dU over all rows (contact, 2 H) and the columns of the slipping contacts ``moving``."""
    contacts, size = gains.shape[1], jacobian.shape[1]
    out = np.zeros((contacts, size, len(moving), size))
    for place in range(len(moving)):
        j = moving[place]
        for i in range(contacts):
            for h in range(size // 2):
                z = gains[h, i, j]
                for c in range(size):
                    ja, jb = jacobian[j, 2 * h, c], jacobian[j, 2 * h + 1, c]
                    out[i, 2 * h, place, c] = z.real * ja + z.imag * jb
                    out[i, 2 * h + 1, place, c] = z.real * jb - z.imag * ja
        for c in range(size):
            out[j, c, place, c] += 1.0
    return out
