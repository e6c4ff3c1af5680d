"""Contacts that hang together over one period: alternating between harmonics and samples; compiled.

For friction in two directions and normal forces that change there is no closed form between turning points. The laws
are followed through even samples from the unstressed state until the cycle closes, with their tangents.
"""

import numpy as np

from ema.compiled import compiled
from ema.simulate.friction_kernels import LUGRE, PARALLEL, step
from ema.simulate.normal_kernels import FORCE, pull
from ema.simulate.plane_kernels import plane_step

_NUDGE, _SETTLED = 1e-6, 1e-10


@compiled()
def normal_period(pair, curve, k, motion, basis, weights, forces, jacobian, depth):
    """Deviation of one normal contact; ``depth`` (2, sample) receives its normal force and its fall with the gap."""
    samples, size = basis.shape
    deviation, slope = np.empty(samples), np.empty(samples)
    for n in range(samples):
        shut, rise, _ = pull(pair, curve, motion[n])
        depth[0, n], depth[1, n] = pair[FORCE] - shut, -rise
        deviation[n], slope[n] = shut - k * motion[n], rise - k
    for r in range(size):
        for n in range(samples):
            lever = weights[r] * basis[n, r]
            forces[r] += lever * deviation[n]
            for c in range(size):
                jacobian[r, c] += lever * slope[n] * basis[n, c]


@compiled()
def gather(n, weights, basis, deviation, change, forces, jacobian):
    """Add one sample to the Fourier coefficients and to their derivatives; ``change`` (member, 2 H)."""
    for r in range(len(weights)):
        lever = weights[r] * basis[n, r]
        if lever != 0.0:
            forces[r] += lever * deviation
            for m in range(change.shape[0]):
                for c in range(len(weights)):
                    jacobian[m, r, c] += lever * change[m, c]


@compiled()
def lag(code, way, changes):
    """Weight of the old slip force in the one that stands for a step: second order for laws that approach it smoothly.

    It solves f' = k |u'| (1 - f / F_C) for a slip force that changes evenly, where ``way`` is k |du| / F_C.
    """
    if code == PARALLEL or not changes:
        return 0.0
    if way < 1e-3:
        return 0.5 - way / 12.0
    return 1.0 / way - 1.0 / np.expm1(way) if way < 30.0 else 1.0 / way


@compiled()
def hold_line(limit, grown, force, tangent):
    """Bring a force below a slip force that fell, with its ``tangent`` (by motion and gap, 2 H).

    ``grown`` (2 H,): the tangent of the slip force by the gap.
    """
    if abs(force) <= limit:
        return force
    sign = 1.0 if force > 0.0 else -1.0
    tangent[0] = 0.0
    tangent[1] = sign * grown
    return sign * limit


@compiled()
def hold_plane(limit, grown, fx, fy, tangent):
    """Bring a force straight back to a circle that shrank, with its ``tangent`` (component, by x, y and gap, 2 H)."""
    size = np.sqrt(fx * fx + fy * fy)
    if size <= limit:
        return fx, fy
    nx, ny, ratio = fx / size, fy / size, limit / size
    for m in range(tangent.shape[1]):
        for c in range(tangent.shape[2]):
            across = ratio * (nx * tangent[1, m, c] - ny * tangent[0, m, c])
            along = grown[c] if m == 2 else 0.0
            tangent[0, m, c], tangent[1, m, c] = nx * along - ny * across, ny * along + nx * across
    return ratio * fx, ratio * fy


@compiled()
def line_period(i, motion, basis, weights, h, periods, k, limit, fall, laws, z, z1, z2, a, b, forces, jacobian):
    """One friction contact in one direction. ``limit`` and ``fall`` (sample,): slip force, its change with the gap.

    ``jacobian`` (2, 2 H, 2 H) is by the own motion and by the gap. Returns the loss per period.
    """
    codes, par, shares_k, shares_f, counts, tables, user = laws
    samples, size = basis.shape
    width = counts[i] if codes[i] == 0 else 1
    tangent, change, old = np.zeros((width, 2, size)), np.zeros((2, size)), np.zeros(width)
    z[i] = 0.0
    before, force, lost, settled = 0.0, 0.0, 0.0, False
    held = codes[i] != LUGRE and codes[i] != PARALLEL
    for period in range(periods):
        last = settled or period == periods - 1
        old[:] = z[i, :width]
        for n in range(samples):
            u, ago = motion[n], n - 1 if period + n > 0 else 0
            g = lag(codes[i], k * abs(u - before) / max(limit[n], 1e-30), limit[n] != limit[ago])
            top = (1.0 - g) * limit[n] + g * limit[ago]
            if fall[n] != 0.0 or fall[ago] != 0.0:
                more = _NUDGE * max(top, 1e-12 * k)
                step(
                    codes[i],
                    i,
                    k,
                    top + more,
                    par,
                    shares_k,
                    shares_f,
                    counts[i],
                    tables,
                    user,
                    before,
                    u,
                    h,
                    z,
                    z2,
                    a,
                    b,
                )
            new, slope = step(
                codes[i], i, k, top, par, shares_k, shares_f, counts[i], tables, user, before, u, h, z, z1, a, b
            )
            rest = slope
            change[:] = 0.0
            for j in range(width):
                lift = 0.0
                if fall[n] != 0.0 or fall[ago] != 0.0:
                    lift = (z2[i, j] - z1[i, j]) / more
                rest -= b[i, j]
                for c in range(size):
                    moved = basis[n, c] - (basis[n - 1, c] if period + n > 0 else 0.0)
                    tangent[j, 0, c] = a[i, j] * tangent[j, 0, c] + b[i, j] * moved
                    opened = (1.0 - g) * fall[n] * basis[n, c] + g * fall[ago] * basis[ago, c]
                    tangent[j, 1, c] = a[i, j] * tangent[j, 1, c] + lift * opened
                if held:
                    z1[i, 0] = hold_line(limit[n], fall[n] * basis[n], z1[i, 0], tangent[0])
                    new = z1[i, 0]
                change += tangent[j]
            if last:
                lost += 0.5 * (new + force) * (u - before)
                for c in range(size):
                    change[0, c] += rest * (basis[n, c] - basis[n - 1, c]) - k * basis[n, c]
                gather(n, weights, basis, new - k * u, change, forces, jacobian)
            z[i] = z1[i]
            before, force = u, new
        if last:
            break
        settled = period > 0 and np.abs(z[i, :width] - old).max() <= _SETTLED * limit.max()
    return lost


@compiled()
def plane_period(
    i, j, motion_x, motion_y, basis, weights, h, periods, k, limit, fall, laws, z, z1, z2, a, b, forces, jacobian
):
    """One isotropic contact; ``jacobian`` (contact, 3, 2 H, 2 H): by own motion, that of the partner, and the gap."""
    codes, par, shares_k, shares_f, counts, tables, _ = laws
    samples, size = basis.shape
    width = counts[i] if codes[i] == 0 else 1
    # last but one axis: by x, by y, by the gap
    tangent, change = np.zeros((width, 2, 3, size)), np.zeros((2, 3, size))
    moved, old = np.empty(size), np.zeros((2, width))
    z[i] = 0.0
    z[j] = 0.0
    x0, y0, fx0, fy0, lost, settled = 0.0, 0.0, 0.0, 0.0, 0.0, False
    held = codes[i] != LUGRE and codes[i] != PARALLEL
    for period in range(periods):
        last = settled or period == periods - 1
        old[0], old[1] = z[i, :width], z[j, :width]
        for n in range(samples):
            x, y, ago = motion_x[n], motion_y[n], n - 1 if period + n > 0 else 0
            way = k * np.sqrt((x - x0) ** 2 + (y - y0) ** 2) / max(limit[n], 1e-30)
            g = lag(codes[i], way, limit[n] != limit[ago])
            top = (1.0 - g) * limit[n] + g * limit[ago]
            if fall[n] != 0.0 or fall[ago] != 0.0:
                more = _NUDGE * max(top, 1e-12 * k)
                plane_step(
                    codes[i],
                    i,
                    j,
                    k,
                    top + more,
                    par,
                    shares_k,
                    shares_f,
                    counts[i],
                    tables,
                    x0,
                    y0,
                    x,
                    y,
                    h,
                    z,
                    z2,
                    a,
                    b,
                )
            fx, fy, sxx, sxy, syx, syy = plane_step(
                codes[i], i, j, k, top, par, shares_k, shares_f, counts[i], tables, x0, y0, x, y, h, z, z1, a, b
            )
            for c in range(size):
                moved[c] = basis[n, c] - (basis[n - 1, c] if period + n > 0 else 0.0)
            change[:] = 0.0
            for w in range(width):
                sxx, sxy, syx, syy = sxx - b[i, w, 0], sxy - b[i, w, 1], syx - b[j, w, 0], syy - b[j, w, 1]
                lift_x, lift_y = 0.0, 0.0
                if fall[n] != 0.0 or fall[ago] != 0.0:
                    lift_x, lift_y = (z2[i, w] - z1[i, w]) / more, (z2[j, w] - z1[j, w]) / more
                for c in range(size):
                    for m in range(3):
                        tx, ty = tangent[w, 0, m, c], tangent[w, 1, m, c]
                        tangent[w, 0, m, c] = a[i, w, 0] * tx + a[i, w, 1] * ty
                        tangent[w, 1, m, c] = a[j, w, 0] * tx + a[j, w, 1] * ty
                    tangent[w, 0, 0, c] += b[i, w, 0] * moved[c]
                    tangent[w, 0, 1, c] += b[i, w, 1] * moved[c]
                    tangent[w, 1, 0, c] += b[j, w, 0] * moved[c]
                    tangent[w, 1, 1, c] += b[j, w, 1] * moved[c]
                    opened = (1.0 - g) * fall[n] * basis[n, c] + g * fall[ago] * basis[ago, c]
                    tangent[w, 0, 2, c] += lift_x * opened
                    tangent[w, 1, 2, c] += lift_y * opened
                if held:
                    z1[i, 0], z1[j, 0] = hold_plane(limit[n], fall[n] * basis[n], z1[i, 0], z1[j, 0], tangent[0])
                    fx, fy = z1[i, 0], z1[j, 0]
                for m in range(3):
                    # of the force in y, the own motion is that in y
                    change[0, m] += tangent[w, 0, m]
                    change[1, m if m == 2 else 1 - m] += tangent[w, 1, m]
            if last:
                lost += 0.5 * ((fx + fx0) * (x - x0) + (fy + fy0) * (y - y0))
                for c in range(size):
                    change[0, 0, c] += sxx * moved[c] - k * basis[n, c]
                    change[0, 1, c] += sxy * moved[c]
                    change[1, 0, c] += syy * moved[c] - k * basis[n, c]
                    change[1, 1, c] += syx * moved[c]
                gather(n, weights, basis, fx - k * x, change[0], forces[i], jacobian[i])
                gather(n, weights, basis, fy - k * y, change[1], forces[j], jacobian[j])
            z[i], z[j] = z1[i], z1[j]
            x0, y0, fx0, fy0 = x, y, fx, fy
        if last:
            break
        drift = max(np.abs(z[i, :width] - old[0]).max(), np.abs(z[j, :width] - old[1]).max())
        settled = period > 0 and drift <= _SETTLED * limit.max()
    return lost


@compiled()
def joined_forces(amplitudes, orders, basis, periods, omega, stiffness, limits, laws, ties):
    """Deviations G (contact, 2 H), Jacobian (contact, 3, 2 H, 2 H), losses, who deviates, and extremes of the pressure.

    The members of the Jacobian are the own motion, that of the partner, and the gap. ``limits`` (friction contact,
    sample) are slip forces where no normal contact is followed. Extremes (normal, 4): least and greatest normal force,
    share of the period open, widest opening.
    """
    partner, normal_of, friction, pairs, curve = ties
    contacts, size = amplitudes.shape
    samples, first = basis.shape[0], contacts - len(pairs)
    h = 2.0 * np.pi / (omega * samples)
    weights = np.full(size, 2.0 / samples)
    for c in range(size):
        if orders[c // 2] == 0:
            weights[c] = 1.0 / samples
    forces, jacobian = np.zeros((contacts, size)), np.zeros((contacts, 3, size, size))
    lost, extremes = np.zeros(contacts), np.zeros((len(pairs), 4))
    z = np.zeros(laws[2].shape)
    z1, z2, a, b = np.zeros_like(z), np.zeros_like(z), np.zeros_like(z), np.zeros_like(z)
    a2, b2 = np.zeros((*z.shape, 2)), np.zeros((*z.shape, 2))
    motion = np.empty((contacts, samples))
    for i in range(contacts):
        for n in range(samples):
            total = 0.0
            for c in range(size):
                total += amplitudes[i, c] * basis[n, c]
            motion[i, n] = total
    depth = np.empty((len(pairs), 2, samples))
    for n in range(len(pairs)):
        i = first + n
        normal_period(pairs[n], curve, stiffness[i], motion[i], basis, weights, forces[i], jacobian[i, 0], depth[n])
        pressing = depth[n, 0]
        extremes[n, 0], extremes[n, 1], extremes[n, 3] = pressing.min(), pressing.max(), motion[i].max()
        extremes[n, 2] = (pressing <= 0.0).sum() / samples
    still = np.zeros(samples)
    both = np.empty((2, size, size))
    for i in range(first):
        n, j = normal_of[i], partner[i]
        if 0 <= j < i:
            continue
        top, fall = limits[i], still
        if n >= 0:
            top, fall = friction[i] * depth[n, 0], friction[i] * depth[n, 1]
        if j >= 0:
            lost[i] = plane_period(
                i,
                j,
                motion[i],
                motion[j],
                basis,
                weights,
                h,
                periods,
                stiffness[i],
                top,
                fall,
                laws,
                z,
                z1,
                z2,
                a2,
                b2,
                forces,
                jacobian,
            )
        else:
            both[:] = 0.0
            lost[i] = line_period(
                i,
                motion[i],
                basis,
                weights,
                h,
                periods,
                stiffness[i],
                top,
                fall,
                laws,
                z,
                z1,
                z2,
                a,
                b,
                forces[i],
                both,
            )
            jacobian[i, 0], jacobian[i, 2] = both[0], both[1]
    deviates = np.zeros(contacts, np.bool_)
    for i in range(contacts):
        deviates[i] = np.abs(forces[i]).max() > 1e-11 * stiffness[i] * np.abs(motion[i]).max()
    return forces, jacobian, lost, deviates, extremes
