"""Isotropic friction in two directions: the vector forms of the laws, exact for motion along a straight line.

A contact has two lanes: i in x, and that in y, which is ``group[ACROSS]`` rows further. Each law turns with the axes,
and is the law in one direction where force and motion are parallel. States as in one direction, a row for each lane.
"""

import numpy as np

from ema.compiled import inner, kernel
from ema.contact.bouc_wen_kernels import bouc_wen_step
from ema.contact.call_kernels import (
    ACROSS,
    BY_FORCE,
    CROSS,
    END,
    EXCESS,
    FIRST,
    FORCE,
    LIMIT,
    LINE,
    OWN,
    SLOPE,
    STIFFNESS,
    WAY,
    increments,
)
from ema.contact.springs_kernels import bed, deeper

_LONGEST = 0.06
"""Way in F_C/k_T of a Runge-Kutta step of Eq. (5) with m up to 8: it errs by about 1e-8 of F_C then."""
_SMALL = 1e-7
"""Way over F_C/k_T below which a ratio of differences is replaced by its limit: it keeps half the digits."""


@inner
def give(exchange, lanes, start, force, slopes):
    """Hand over the force at the end, and its slopes dfx/dux, dfx/duy, dfy/dux, dfy/duy; ``start``: force before."""
    (i, j), (xx, xy, yx, yy) = lanes, slopes
    k = exchange[STIFFNESS, i]
    exchange[FORCE, i], exchange[FORCE, j] = force
    exchange[EXCESS, i] = force[0] - (start[0] + k * exchange[WAY, i])
    exchange[EXCESS, j] = force[1] - (start[1] + k * exchange[WAY, j])
    exchange[SLOPE, i], exchange[CROSS, i], exchange[CROSS, j], exchange[SLOPE, j] = xx - k, xy, yx, yy - k


@inner
def circle_step(k, top, way, force):
    """Elastic inside the circle of radius ``top``, then along it: the force, and its slopes.

    On the circle the angle psi between force and motion follows tan(psi / 2) ~ exp(-k |du| / top) (Krieg and Krieg
    1977).
    """
    if top <= 0.0:
        return (0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    fx, fy = force
    size = np.sqrt(fx * fx + fy * fy)
    if size > top:
        # the slip force fell: straight back to the circle
        fx, fy = fx * top / size, fy * top / size
    ex, ey = k * way[0], k * way[1]
    gx, gy = fx + ex, fy + ey
    r = np.sqrt(ex * ex + ey * ey)
    if r == 0.0 and size >= top:
        # which way it would go is not known: that along the force would slide, that across it would not
        nx, ny = fx / top, fy / top
        return (gx, gy), (k * (1.0 - nx * nx), -k * nx * ny, -k * nx * ny, k * (1.0 - ny * ny))
    if gx * gx + gy * gy <= top * top or r == 0.0:
        return (gx, gy), (k, 0.0, 0.0, k)
    dx, dy = ex / r, ey / r
    along, across = fx * dx + fy * dy, fy * dx - fx * dy
    leave = np.sqrt(max(top * top - across * across, 0.0))
    fade = np.exp(-max(r - leave + along, 0.0) / top)
    t = across / (top + leave) * fade
    cosine, sine = (1.0 - t * t) / (1.0 + t * t), 2.0 * t / (1.0 + t * t)
    # (mx, my): unit tangent of the circle at the new force
    mx, my = -sine * dx - cosine * dy, -sine * dy + cosine * dx
    turn = cosine
    if r > _SMALL * top:
        ratio = 2.0 / (1.0 + t * t) * fade / (top + leave)
        turn = (top - ratio * leave * along - sine * across) / r
    vx, vy = k * (-turn * dy - sine * dx), k * (turn * dx - sine * dy)
    return (top * (cosine * dx - sine * dy), top * (cosine * dy + sine * dx)), (mx * vx, mx * vy, my * vx, my * vy)


@inner
def _in_parallel(springs, bearing, lanes, exchange, states):
    """Springs of one contact, each with its circle; those from ``touching`` on are no part of k_T."""
    (stiffness, tops), (share, depth, touching), (i, j), (before, after) = springs, bearing, lanes, states
    way = exchange[WAY, i], exchange[WAY, j]
    sx, sy, fx, fy, ex, ey = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    xx, xy, yx, yy = 0.0, 0.0, 0.0, 0.0
    for n in range(len(stiffness)):
        k, start = stiffness[n], (before[i, n], before[j, n])
        force, slopes = circle_step(k, max(share * tops[n] + depth * k, 0.0), way, start)
        after[i, n], after[j, n] = force
        sx, sy, fx, fy = sx + start[0], sy + start[1], fx + force[0], fy + force[1]
        # exactly zero where it sticks
        stuck = k if n < touching else 0.0
        ex, ey = ex + (force[0] - (start[0] + stuck * way[0])), ey + (force[1] - (start[1] + stuck * way[1]))
        xx, xy, yx, yy = xx + slopes[0], xy + slopes[1], yx + slopes[2], yy + slopes[3]
    give(exchange, lanes, (sx, sy), (fx, fy), (xx, xy, yx, yy))
    exchange[EXCESS, i], exchange[EXCESS, j] = ex, ey


@kernel
def plane_springs(group, rate, tables, exchange, states):
    """Masing springs in parallel, each with its circle; ``parameters``: as those of ``springs``."""
    parameters, count = tables[0], group[OWN]
    for i in range(group[FIRST], group[END]):
        pair = parameters[i, :count], parameters[i, count : 2 * count]
        _in_parallel(pair, (exchange[LIMIT, i], 0.0, count), (i, i + group[ACROSS]), exchange, states)


@kernel
def plane_rough(group, rate, tables, exchange, states):
    """Springs that touch at depths of their own, each with its circle; ``parameters``: as those of ``rough``."""
    for i in range(group[FIRST], group[END]):
        pair, touching = bed(tables[0][i], group[OWN])
        bearing = 1.0, deeper(pair, touching, exchange[LIMIT, i]), touching
        _in_parallel(pair, bearing, (i, i + group[ACROSS]), exchange, states)


@inner
def _rates(state, direction, m):
    """Rates of the normalised force y of Eq. (5) in two directions, e - |y|^m n (n . e), and of dy/de, while n . e > 0.

    ``state``: y, and dy/de row by row.
    """
    (yx, yy, bxx, bxy, byx, byy), (ex, ey) = state, direction
    rho = np.sqrt(yx * yx + yy * yy)
    if rho < 1e-150:
        return ex, ey, 1.0, 0.0, 0.0, 1.0
    nx, ny, power = yx / rho, yy / rho, rho**m
    push, lever = nx * ex + ny * ey, power / rho
    jxx, jxy = -lever * ((m - 2.0) * nx * nx * push + push + nx * ex), -lever * ((m - 2.0) * nx * ny * push + nx * ey)
    jyx, jyy = -lever * ((m - 2.0) * ny * nx * push + ny * ex), -lever * ((m - 2.0) * ny * ny * push + push + ny * ey)
    return (
        ex - power * nx * push,
        ey - power * ny * push,
        1.0 - power * nx * nx + jxx * bxx + jxy * byx,
        -power * nx * ny + jxx * bxy + jxy * byy,
        -power * nx * ny + jyx * bxx + jyy * byx,
        1.0 - power * ny * ny + jyx * bxy + jyy * byy,
    )


@inner
def _further(state, h, rates):
    """The state after a step ``h`` with constant rates."""
    (a, b, c, d, e, f), (u, v, w, x, y, z) = state, rates
    return a + h * u, b + h * v, c + h * w, d + h * x, e + h * y, f + h * z


@inner
def smooth_step(k, limit, exponent, way, force):
    """Eq. (5) with the force relaxing along itself: dF = k (du - |F/F_C|^m n (n . du)) where n . du > 0.

    ``exponent``: m, and the way in F_C/k_T that takes the force to F_C. Elastic until motion and force enclose a right
    angle, then fourth-order Runge-Kutta steps. Returns the force and its slopes.
    """
    m, span = exponent
    yx, yy = force[0] / limit, force[1] / limit
    size = np.sqrt(yx * yx + yy * yy)
    if size > 1.0:
        yx, yy = yx / size, yy / size
    direction = k * way[0] / limit, k * way[1] / limit
    square = direction[0] ** 2 + direction[1] ** 2
    start = 0.0
    if square > 0.0:
        start = min(max(-(yx * direction[0] + yy * direction[1]) / square, 0.0), 1.0)
    state = yx + start * direction[0], yy + start * direction[1], start, 0.0, 0.0, start
    # far beyond full slip the rest of the way only turns the force into the motion, which it has done by then
    rest = 1.0 - start
    if rest * np.sqrt(square) > 2.0 * span:
        rest = 2.0 * span / np.sqrt(square)
    count = int(np.ceil(rest * np.sqrt(square) * max(1.0, m / 8.0) / _LONGEST))
    for _ in range(count):
        h = rest / count
        first = _rates(state, direction, m)
        second = _rates(_further(state, 0.5 * h, first), direction, m)
        third = _rates(_further(state, 0.5 * h, second), direction, m)
        fourth = _rates(_further(state, h, third), direction, m)
        state = _further(_further(state, h / 6.0, first), h / 3.0, second)
        state = _further(_further(state, h / 3.0, third), h / 6.0, fourth)
    return (limit * state[0], limit * state[1]), (k * state[2], k * state[3], k * state[4], k * state[5])


@kernel
def plane_regularised(group, rate, tables, exchange, states):
    """Eq. (5); ``parameters``: ``shape`` of ``bouc_wen_step``. Where force and motion are parallel by its curve."""
    (parameters, curves), (before, after) = tables, states
    for i in range(group[FIRST], group[END]):
        j = i + group[ACROSS]
        k, limit, shape = exchange[STIFFNESS, i], exchange[LIMIT, i], parameters[i]
        ux, uy, start = exchange[WAY, i], exchange[WAY, j], (before[i, 0], before[j, 0])
        force, slopes = (0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
        r, size = np.sqrt(ux * ux + uy * uy), np.sqrt(start[0] ** 2 + start[1] ** 2)
        if limit > 0.0:
            force, slopes = smooth_step(k, limit, (shape[0], shape[3]), (ux, uy), start)
        if limit > 0.0 and r > 0.0 and abs(start[0] * uy - start[1] * ux) <= 1e-13 * size * r:
            dx, dy = ux / r, uy / r
            state = start[0] * dx + start[1] * dy, 0.0, 0.0
            size, slope, _, _, _, _ = bouc_wen_step((k, limit), shape, curves, r, state)
            turn = slopes[0] * dy * dy - (slopes[1] + slopes[2]) * dx * dy + slopes[3] * dx * dx
            force, skew = (size * dx, size * dy), (slope - turn) * dx * dy
            slopes = slope * dx * dx + turn * dy * dy, skew, skew, slope * dy * dy + turn * dx * dx
        after[i, 0], after[j, 0] = force
        give(exchange, (i, j), start, force, slopes)


@inner
def within(force, top):
    """The force, straight back on the circle of radius ``top`` where it is beyond it, as the slip force fell."""
    size = np.sqrt(force[0] * force[0] + force[1] * force[1])
    share = top / size if size > top else 1.0
    return force[0] * share, force[1] * share


@inner
def approach_step(k, limit, alpha, way, force):
    """Dahl: dF = k |d - F/F_C|^(alpha - 1) (d - F/F_C) |du|, straight towards F_C d with d the direction of motion."""
    if limit <= 0.0:
        return (0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    r = np.sqrt(way[0] * way[0] + way[1] * way[1])
    if r == 0.0:
        # no direction of motion: the slope along the force is what both directions share
        return (force[0], force[1]), (k, 0.0, 0.0, k)
    dx, dy, far = way[0] / r, way[1] / r, k * r / limit
    cx, cy = dx - force[0] / limit, dy - force[1] / limit
    y0 = np.sqrt(cx * cx + cy * cy)
    if y0 < 1e-14:
        return (limit * dx, limit * dy), (0.0, 0.0, 0.0, 0.0)
    y1 = 0.0
    if alpha == 1.0:
        y1 = y0 * np.exp(-far)
    else:
        base = y0 ** (1.0 - alpha) - (1.0 - alpha) * far
        y1 = base ** (1.0 / (1.0 - alpha)) if base > 0.0 else 0.0
    q = y1 / y0
    # dq/dy0 over y0, and -dq/dfar
    gain, speed = (q**alpha - q) / y0**2, y1**alpha / y0
    turn = (1.0 - q) / far if far > 1e-9 else y0 ** (alpha - 1.0)
    spin = gain * (-cx * dy + cy * dx) / far if far > 1e-9 else 0.0
    vx, vy = -speed * dx - spin * dy, -speed * dy + spin * dx
    xx, xy = k * (turn * dy * dy - cx * vx), k * (-turn * dx * dy - cx * vy)
    yx, yy = k * (-turn * dx * dy - cy * vx), k * (turn * dx * dx - cy * vy)
    return (limit * (dx - q * cx), limit * (dy - q * cy)), (xx, xy, yx, yy)


@kernel
def plane_dahl(group, rate, tables, exchange, states):
    """Dahl's law; ``parameters``: the exponent."""
    (parameters, _), (before, after) = tables, states
    for i in range(group[FIRST], group[END]):
        j = i + group[ACROSS]
        way, start = (exchange[WAY, i], exchange[WAY, j]), (before[i, 0], before[j, 0])
        limit = exchange[LIMIT, i]
        force, slopes = approach_step(exchange[STIFFNESS, i], limit, parameters[i, 0], way, within(start, limit))
        after[i, 0], after[j, 0] = force
        give(exchange, (i, j), start, force, slopes)


@kernel
def plane_lugre(group, rate, tables, exchange, states):
    """LuGre: bristles that follow the motion, and what depends on the speed; states and parameters as in one
    direction."""
    (parameters, _), (before, after) = tables, states
    for i in range(group[FIRST], group[END]):
        j = i + group[ACROSS]
        limit, damping, viscous = exchange[LIMIT, i], parameters[i, 0], parameters[i, 1]
        peak, stribeck = parameters[i, 2] - 1.0, parameters[i, 3]
        ux, uy = exchange[WAY, i], exchange[WAY, j]
        start = before[i, 0] + before[i, 1], before[j, 0] + before[j, 1]
        mean = np.sqrt(ux * ux + uy * uy) * rate
        top = limit * (1.0 + peak * np.exp(-((mean / stribeck) ** 2)))
        (zx, zy), (xx, xy, yx, yy) = approach_step(
            exchange[STIFFNESS, i], top, 1.0, (ux, uy), within((before[i, 0], before[j, 0]), limit * (1.0 + peak))
        )
        fx, fy = zx, zy
        if limit > 0.0 and rate > 0.0:
            # the velocity at the end, of second order; where the motion is slow none is left behind
            vx, vy = 0.5 * rate * (3.0 * ux - before[i, 2]), 0.5 * rate * (3.0 * uy - before[j, 2])
            speed = np.sqrt(vx * vx + vy * vy)
            end = limit * (1.0 + peak * np.exp(-((speed / stribeck) ** 2)))
            lag, c = damping * speed / end, 1.5 * rate
            fx, fy = zx * (1.0 - lag) + (damping + viscous) * vx, zy * (1.0 - lag) + (damping + viscous) * vy
            nx, ny = (vx / speed, vy / speed) if speed > 0.0 else (0.0, 0.0)
            xx = xx * (1.0 - lag) + c * (damping * (1.0 - nx * zx / end) + viscous)
            yy = yy * (1.0 - lag) + c * (damping * (1.0 - ny * zy / end) + viscous)
            xy, yx = xy * (1.0 - lag) - c * damping * ny * zx / end, yx * (1.0 - lag) - c * damping * nx * zy / end
        after[i, 0], after[i, 1], after[i, 2] = zx, fx - zx, ux if rate > 0.0 else 0.0
        after[j, 0], after[j, 1], after[j, 2] = zy, fy - zy, uy if rate > 0.0 else 0.0
        give(exchange, (i, j), start, (fx, fy), (xx, xy, yx, yy))


@inner
def _trial(k, way, force):
    """Size and direction of the force after an elastic increment."""
    gx, gy = force[0] + k * way[0], force[1] + k * way[1]
    size = np.sqrt(gx * gx + gy * gy)
    return (size, gx / size, gy / size) if size > 0.0 else (0.0, 1.0, 0.0)


@kernel
def plane_projected(group, rate, tables, exchange, states):
    """Any law of one internal force that is odd and elastic with k at first, along the force of an elastic increment.

    What it lacks of that force is taken off along it (radial return, Wilkins 1964): an increment dF = dF(du) along the
    force, k du across it. Of first order in the angle by which the force turns in an increment. The law in one
    direction is that at ``group[LINE]``, with its parameters and states in lane i.
    """
    across, (before, after) = group[ACROSS], states
    for i in range(group[FIRST], group[END]):
        # lane i takes what the law in one direction sees; lane j keeps what that overwrites until it is read below
        j, way, start = i + across, exchange[WAY, i], before[i, 0]
        _, nx, ny = _trial(exchange[STIFFNESS, i], (way, exchange[WAY, j]), (start, before[j, 0]))
        exchange[FORCE, j], exchange[EXCESS, j] = way, start
        exchange[WAY, i], before[i, 0] = way * nx + exchange[WAY, j] * ny, start * nx + before[j, 0] * ny
    increments(group[LINE], group, rate, tables, exchange, states)
    for i in range(group[FIRST], group[END]):
        j, k = i + across, exchange[STIFFNESS, i]
        exchange[WAY, i], before[i, 0] = exchange[FORCE, j], exchange[EXCESS, j]
        ux, uy, start = exchange[WAY, i], exchange[WAY, j], (before[i, 0], before[j, 0])
        size, nx, ny = _trial(k, (ux, uy), start)
        force, by_way, by_force = exchange[FORCE, i], exchange[SLOPE, i] + k, exchange[BY_FORCE, i]
        # both the force before and the way along n change as n turns with the way across it
        spin, swing = (
            (k * (start[1] * nx - start[0] * ny) / size, k * (uy * nx - ux * ny) / size) if size > 0.0 else (0.0, 0.0)
        )
        turn = k * force / size if size > 0.0 else by_way
        lever = by_force * spin + by_way * swing
        px, py = by_way * nx - lever * ny, by_way * ny + lever * nx
        after[i, 0], after[j, 0] = force * nx, force * ny
        slopes = nx * px + turn * ny * ny, nx * py - turn * nx * ny, ny * px - turn * nx * ny, ny * py + turn * nx * nx
        give(exchange, (i, j), start, (force * nx, force * ny), slopes)
