"""Isotropic friction in two directions as maps over one straight increment of relative displacement; compiled.

The vector forms of the laws in ``friction_kernels``: each is exact for motion along a straight line (Eq. (5): by
Runge-Kutta steps), turns with the axes, and is the law in one direction where force and motion are parallel. Rows i
and j of the state hold the components in x and y; tangents a = df1/df0 and b = df1/du1 are (contact, spring, 2), the
last axis being the component that is varied.
"""

import numpy as np

from ema.compiled import compiled
from ema.contact.bouc_wen_kernels import bouc_wen_step
from ema.simulate.friction_kernels import DAHL, LUGRE, PARALLEL

_LONGEST = 0.06
_SMALL = 1e-7


@compiled()
def circle_step(k, top, dux, duy, fx, fy):
    """Elastic inside the circle of radius ``top``, then along it.

    On the circle the angle psi between force and motion follows tan(psi / 2) ~ exp(-k |du| / top) (Krieg and Krieg
    1977). Returns the force, a (xx, xy, yx, yy) and b.
    """
    if top <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    size = np.sqrt(fx * fx + fy * fy)
    back = 1.0
    if size > top:
        # the slip force fell: straight back to the circle
        back = top / size
        fx, fy = fx * back, fy * back
    ex, ey = k * dux, k * duy
    gx, gy = fx + ex, fy + ey
    r = np.sqrt(ex * ex + ey * ey)
    if gx * gx + gy * gy <= top * top or r == 0.0:
        axx, axy, ayx, ayy = 1.0, 0.0, 0.0, 1.0
        bxx, bxy, byx, byy = k, 0.0, 0.0, k
        if r == 0.0 and size >= top:
            bxx, bxy, byy = k * (1.0 - (fx / top) ** 2), -k * fx * fy / top**2, k * (1.0 - (fy / top) ** 2)
            byx = bxy
    else:
        dx, dy = ex / r, ey / r
        along, across = fx * dx + fy * dy, fy * dx - fx * dy
        leave = np.sqrt(max(top * top - across * across, 0.0))
        fade = np.exp(-max(r - leave + along, 0.0) / top)
        t = across / (top + leave) * fade
        cosine, sine = (1.0 - t * t) / (1.0 + t * t), 2.0 * t / (1.0 + t * t)
        ratio = 2.0 / (1.0 + t * t) * fade / (top + leave)
        gx, gy = top * (cosine * dx - sine * dy), top * (cosine * dy + sine * dx)
        # (mx, my): unit tangent of the circle at the new force
        mx, my = -sine * dx - cosine * dy, -sine * dy + cosine * dx
        turn = cosine
        if r > _SMALL * top:
            turn = (top - ratio * leave * along - sine * across) / r
        vx, vy = -ratio * leave * dy - sine * dx, ratio * leave * dx - sine * dy
        axx, axy, ayx, ayy = mx * vx, mx * vy, my * vx, my * vy
        vx, vy = -turn * dy - sine * dx, turn * dx - sine * dy
        bxx, bxy, byx, byy = k * mx * vx, k * mx * vy, k * my * vx, k * my * vy
    if back < 1.0:
        # the way back to the circle keeps the direction only
        sx, sy = fx / top, fy / top
        pxx, pxy, pyy = back * (1.0 - sx * sx), -back * sx * sy, back * (1.0 - sy * sy)
        axx, axy = axx * pxx + axy * pxy, axx * pxy + axy * pyy
        ayx, ayy = ayx * pxx + ayy * pxy, ayx * pxy + ayy * pyy
    return gx, gy, axx, axy, ayx, ayy, bxx, bxy, byx, byy


@compiled()
def _smooth_rate(y, e, m, rate, by_y, by_e):
    """Rate of the normalised force of Eq. (5) in two directions, e - |y|^m n (n . e), and its Jacobians; n . e >= 0."""
    rho = np.sqrt(y[0] * y[0] + y[1] * y[1])
    by_y[:] = 0.0
    by_e[:] = 0.0
    by_e[0, 0] = by_e[1, 1] = 1.0
    rate[:] = e
    if rho < 1e-150:
        return
    n0, n1 = y[0] / rho, y[1] / rho
    push = n0 * e[0] + n1 * e[1]
    power = rho**m
    lever = power / rho
    rate[0] -= power * n0 * push
    rate[1] -= power * n1 * push
    by_e[0, 0] -= power * n0 * n0
    by_e[1, 1] -= power * n1 * n1
    by_e[0, 1] -= power * n0 * n1
    by_e[1, 0] = by_e[0, 1]
    by_y[0, 0] = -lever * ((m - 2.0) * n0 * n0 * push + push + n0 * e[0])
    by_y[1, 1] = -lever * ((m - 2.0) * n1 * n1 * push + push + n1 * e[1])
    by_y[0, 1] = -lever * ((m - 2.0) * n0 * n1 * push + n0 * e[1])
    by_y[1, 0] = -lever * ((m - 2.0) * n0 * n1 * push + n1 * e[0])


@compiled()
def smooth_step(k, limit, m, span, dux, duy, fx, fy):
    """Eq. (5) with the force relaxing along itself: dF = k (du - |F/F_C|^m n (n . du)) where n . du > 0.

    Elastic until motion and force enclose a right angle, then fourth-order Runge-Kutta steps with their tangents.
    """
    if limit <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    y = np.array([fx / limit, fy / limit])
    size = np.sqrt(y[0] ** 2 + y[1] ** 2)
    if size > 1.0:
        y /= size
    e = np.array([k * dux / limit, k * duy / limit])
    way = np.sqrt(e[0] ** 2 + e[1] ** 2)
    start, by_start, by_e = 0.0, np.eye(2), np.zeros((2, 2))
    if way > 0.0:
        start = min(max(-(y[0] * e[0] + y[1] * e[1]) / way**2, 0.0), 1.0)
    y += start * e
    by_e[0, 0] = by_e[1, 1] = start
    rest = 1.0 - start
    if rest * way > 2.0 * span:
        # far beyond full slip the rest of the way only turns the force into the motion, which it has done by then
        rest = 2.0 * span / way
    count = int(np.ceil(rest * way * max(1.0, m / 8.0) / _LONGEST))
    rates, slopes, by_es = np.empty((4, 2)), np.empty((4, 2, 2)), np.empty((4, 2, 2))
    jacobian, direct = np.empty((2, 2)), np.empty((2, 2))
    for _ in range(count):
        h = rest / count
        for stage in range(4):
            c = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
            past = max(stage - 1, 0)
            here = y + c * rates[past] if stage > 0 else y.copy()
            of_start = by_start + c * slopes[past] if stage > 0 else by_start
            of_e = by_e + c * by_es[past] if stage > 0 else by_e
            _smooth_rate(here, e, m, rates[stage], jacobian, direct)
            for r in range(2):
                for s in range(2):
                    slopes[stage, r, s] = jacobian[r, 0] * of_start[0, s] + jacobian[r, 1] * of_start[1, s]
                    by_es[stage, r, s] = direct[r, s] + jacobian[r, 0] * of_e[0, s] + jacobian[r, 1] * of_e[1, s]
        y += h / 6.0 * (rates[0] + 2.0 * rates[1] + 2.0 * rates[2] + rates[3])
        by_start = by_start + h / 6.0 * (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3])
        by_e = by_e + h / 6.0 * (by_es[0] + 2.0 * by_es[1] + 2.0 * by_es[2] + by_es[3])
    return (
        limit * y[0],
        limit * y[1],
        by_start[0, 0],
        by_start[0, 1],
        by_start[1, 0],
        by_start[1, 1],
        k * by_e[0, 0],
        k * by_e[0, 1],
        k * by_e[1, 0],
        k * by_e[1, 1],
    )


@compiled()
def approach_step(k, limit, alpha, dux, duy, fx, fy):
    """Dahl: dF = k |d - F/F_C|^(alpha - 1) (d - F/F_C) |du|, straight towards F_C d with d the direction of motion."""
    if limit <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    r = np.sqrt(dux * dux + duy * duy)
    if r == 0.0:
        # no direction of motion: the slope along the force is what both directions share
        return fx, fy, 1.0, 0.0, 0.0, 1.0, k, 0.0, 0.0, k
    dx, dy, way = dux / r, duy / r, k * r / limit
    cx, cy = dx - fx / limit, dy - fy / limit
    y0 = np.sqrt(cx * cx + cy * cy)
    if y0 < 1e-14:
        return limit * dx, limit * dy, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    y1 = 0.0
    if alpha == 1.0:
        y1 = y0 * np.exp(-way)
    else:
        base = y0 ** (1.0 - alpha) - (1.0 - alpha) * way
        y1 = base ** (1.0 / (1.0 - alpha)) if base > 0.0 else 0.0
    q = y1 / y0
    gain = (q**alpha - q) / y0**2  # dq/dy0 over y0
    speed = y1**alpha / y0  # -dq/dway
    gx, gy = limit * (dx - q * cx), limit * (dy - q * cy)
    # dq/df0 = -gain c / limit
    axx, axy = q + gain * cx * cx, gain * cx * cy
    ayx, ayy = axy, q + gain * cy * cy
    turn = (1.0 - q) / way if way > 1e-9 else y0 ** (alpha - 1.0)
    spin = gain * (-cx * dy + cy * dx) / way if way > 1e-9 else 0.0
    vx, vy = -speed * dx - spin * dy, -speed * dy + spin * dx
    bxx, bxy = k * (turn * dy * dy - cx * vx), k * (-turn * dx * dy - cx * vy)
    byx, byy = k * (-turn * dx * dy - cy * vx), k * (turn * dx * dx - cy * vy)
    return gx, gy, axx, axy, ayx, ayy, bxx, bxy, byx, byy


@compiled()
def _brush(k, limit, par, i, j, ux0, uy0, ux1, uy1, h, z0, z1, a, b):
    """LuGre in two directions: bristles that follow the motion, and what depends on the speed."""
    damping, viscous, ratio, stribeck = par[i, 0], par[i, 1], par[i, 2], par[i, 3]
    wx, wy = (z0[i, 1], z0[j, 1]) if z0[i, 2] == 1.0 else (ux0, uy0)
    dux, duy = ux1 - ux0, uy1 - uy0
    mean = np.sqrt(dux * dux + duy * duy) / h
    top = limit * (1.0 + (ratio - 1.0) * np.exp(-((mean / stribeck) ** 2)))
    zx, zy, axx, axy, ayx, ayy, bxx, bxy, byx, byy = approach_step(k, top, 1.0, dux, duy, z0[i, 0], z0[j, 0])
    z1[i, 0], z1[j, 0], z1[i, 1], z1[j, 1] = zx, zy, ux0, uy0
    z1[i, 2] = z1[j, 2] = 1.0
    a[i, 0, 0], a[i, 0, 1], a[j, 0, 0], a[j, 0, 1] = axx, axy, ayx, ayy
    b[i, 0, 0], b[i, 0, 1], b[j, 0, 0], b[j, 0, 1] = bxx, bxy, byx, byy
    if limit <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    vx, vy = (3.0 * ux1 - 4.0 * ux0 + wx) / (2.0 * h), (3.0 * uy1 - 4.0 * uy0 + wy) / (2.0 * h)
    speed = np.sqrt(vx * vx + vy * vy)
    end = limit * (1.0 + (ratio - 1.0) * np.exp(-((speed / stribeck) ** 2)))
    lag = damping * speed / end
    fx, fy = zx + damping * vx - lag * zx + viscous * vx, zy + damping * vy - lag * zy + viscous * vy
    nx, ny = (vx / speed, vy / speed) if speed > 0.0 else (0.0, 0.0)
    c = 1.5 / h
    sxx = bxx * (1.0 - lag) + c * (damping * (1.0 - nx * zx / end) + viscous)
    syy = byy * (1.0 - lag) + c * (damping * (1.0 - ny * zy / end) + viscous)
    sxy = bxy * (1.0 - lag) - c * damping * ny * zx / end
    syx = byx * (1.0 - lag) - c * damping * nx * zy / end
    return fx, fy, sxx, sxy, syx, syy


@compiled()
def _one_step(code, i, k, limit, par, tables, dux, duy, fx, fy):
    """Eq. (5) and Dahl; parallel force and motion take the law in one direction, which is exact for Eq. (5) too."""
    if code == DAHL:
        return approach_step(k, limit, par[i, 0], dux, duy, fx, fy)
    r, size = np.sqrt(dux * dux + duy * duy), np.sqrt(fx * fx + fy * fy)
    if r > 0.0 and abs(fx * duy - fy * dux) <= 1e-13 * size * r:
        dx, dy = dux / r, duy / r
        force, slope, _, _, a, _ = bouc_wen_step(k, limit, par[i], tables, r, fx * dx + fy * dy, 0.0, 0.0)
        full = smooth_step(k, limit, par[i, 0], par[i, 3], dux, duy, fx, fy)
        across = full[2] * dy * dy - (full[3] + full[4]) * dx * dy + full[5] * dx * dx
        turn = full[6] * dy * dy - (full[7] + full[8]) * dx * dy + full[9] * dx * dx
        return (
            force * dx,
            force * dy,
            a * dx * dx + across * dy * dy,
            (a - across) * dx * dy,
            (a - across) * dx * dy,
            a * dy * dy + across * dx * dx,
            slope * dx * dx + turn * dy * dy,
            (slope - turn) * dx * dy,
            (slope - turn) * dx * dy,
            slope * dy * dy + turn * dx * dx,
        )
    return smooth_step(k, limit, par[i, 0], par[i, 3], dux, duy, fx, fy)


@compiled()
def plane_step(
    code, i, j, stiffness, limit, par, shares_k, shares_f, count, tables, ux0, uy0, ux1, uy1, h, z0, z1, a, b
):
    """One increment of the contact with components i (x) and j (y).

    Returns the force fx, fy and its slope dfx/dux, dfx/duy, dfy/dux, dfy/duy. ``z0`` -> ``z1`` (contact, spring) is the
    state, ``a`` and ``b`` (contact, spring, 2) receive the tangents of the internal forces.
    """
    if code == LUGRE:
        return _brush(stiffness, limit, par, i, j, ux0, uy0, ux1, uy1, h, z0, z1, a, b)
    fx, fy, sxx, sxy, syx, syy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    dux, duy = ux1 - ux0, uy1 - uy0
    for n in range(count if code == PARALLEL else 1):
        if code == PARALLEL:
            k = stiffness * shares_k[i, n]
            gx, gy, axx, axy, ayx, ayy, bxx, bxy, byx, byy = circle_step(
                k, limit * shares_f[i, n], dux, duy, z0[i, n], z0[j, n]
            )
        else:
            gx, gy, axx, axy, ayx, ayy, bxx, bxy, byx, byy = _one_step(
                code, i, stiffness, limit, par, tables, dux, duy, z0[i, 0], z0[j, 0]
            )
        z1[i, n], z1[j, n] = gx, gy
        a[i, n, 0], a[i, n, 1], a[j, n, 0], a[j, n, 1] = axx, axy, ayx, ayy
        b[i, n, 0], b[i, n, 1], b[j, n, 0], b[j, n, 1] = bxx, bxy, byx, byy
        fx, fy = fx + gx, fy + gy
        sxx, sxy, syx, syy = sxx + bxx, sxy + bxy, syx + byx, syy + byy
    return fx, fy, sxx, sxy, syx, syy


@compiled()
def drive_plane(code, stiffness, limits, par, shares_k, shares_f, count, tables, ux, uy, h, z):
    """Forces (2, sample) of one contact (rows 0 and 1 of the arrays) along a path; ``z`` (2, spring) is updated."""
    forces = np.empty((2, len(ux)))
    z1, a, b = np.zeros_like(z), np.zeros((2, z.shape[1], 2)), np.zeros((2, z.shape[1], 2))
    x, y = 0.0, 0.0
    for n in range(len(ux)):
        forces[0, n], forces[1, n], _, _, _, _ = plane_step(
            code, 0, 1, stiffness, limits[n], par, shares_k, shares_f, count, tables, x, y, ux[n], uy[n], h, z, z1, a, b
        )
        x, y = ux[n], uy[n]
        z[:] = z1
    return forces
