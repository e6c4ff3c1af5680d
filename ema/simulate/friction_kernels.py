"""Friction laws as maps over one increment of relative displacement, exact for monotone motion; compiled.

Each law takes its internal state ``z0`` from displacement ``u0`` to ``u1`` and returns the force and its slope df/du1,
with the tangents ``a = df1/df0`` and ``b = df1/du1`` of every internal force for harmonic balance.
"""

import numba as nb
import numpy as np

PARALLEL, REGULARISED, DAHL, LUGRE, USER = range(5)
USER_TYPE = nb.types.FunctionType(nb.float64(*[nb.float64] * 8))


@nb.cfunc(nb.float64(*[nb.float64] * 8), cache=True)
def no_user_law(force, du, stiffness, limit, p0, p1, p2, p3):
    """The place-holder of models without a law of the user's own."""
    return force


@nb.njit(cache=True)
def virgin(x, tables, place, size, span, power):
    """Normalised virgin curve of Eq. (5) at coordinate x, quintic Hermite on a graded grid."""
    if x >= span:
        return 1.0
    t = x / span
    if power != 1.0:
        t = t ** (1.0 / power)
    where = t * (size - 1)
    cell = min(int(where), size - 2)
    s = where - cell
    d = 1.0 / (size - 1)
    f0, f1 = tables[place, 0, cell], tables[place, 0, cell + 1]
    g0, g1 = tables[place, 1, cell] * d, tables[place, 1, cell + 1] * d
    c0, c1 = tables[place, 2, cell] * d * d, tables[place, 2, cell + 1] * d * d
    rise = f1 - f0
    k3 = 10 * rise - 6 * g0 - 4 * g1 - 1.5 * c0 + 0.5 * c1
    k4 = -15 * rise + 8 * g0 + 7 * g1 + 1.5 * c0 - c1
    k5 = 6 * rise - 3 * g0 - 3 * g1 - 0.5 * c0 + 0.5 * c1
    return f0 + s * (g0 + s * (0.5 * c0 + s * (k3 + s * (k4 + s * k5))))


@nb.njit(cache=True)
def virgin_coordinate(phi, tables, place, size, span, power):
    """Coordinate x at which the virgin curve reaches phi (0 ... 1): safeguarded Newton inside one cell of the table."""
    if phi <= 0.0:
        return 0.0
    if phi >= tables[place, 0, size - 1]:
        return span
    low, high = 0, size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if tables[place, 0, middle] <= phi:
            low = middle
        else:
            high = middle
    left, right = low / (size - 1.0), high / (size - 1.0)
    f0, f1 = tables[place, 0, low], tables[place, 0, high]
    t = left + (right - left) * (phi - f0) / max(f1 - f0, 1e-300)
    for _ in range(60):
        rest = virgin(span * t**power, tables, place, size, span, power) - phi
        if rest > 0.0:
            right = t
        else:
            left = t
        if abs(rest) <= 2e-16 or right - left <= 1e-16:
            break
        weight = (t * (size - 1.0)) - low
        slope = tables[place, 1, low] + (tables[place, 1, high] - tables[place, 1, low]) * weight
        new = t - rest / slope if slope > 1e-14 else 0.5 * (left + right)
        t = new if left < new < right else 0.5 * (left + right)
    return span * t**power


@nb.njit(cache=True)
def parallel_step(i, stiffness, limit, shares_k, shares_f, count, du, z0, z1, a, b):
    """Masing (Jenkins) springs in parallel: return map of Eq. (4)."""
    force, slope = 0.0, 0.0
    for j in range(count):
        k, top = stiffness * shares_k[i, j], limit * shares_f[i, j]
        trial = z0[i, j] + k * du
        if trial > top:
            trial, a[i, j], b[i, j] = top, 0.0, 0.0
        elif trial < -top:
            trial, a[i, j], b[i, j] = -top, 0.0, 0.0
        else:
            a[i, j], b[i, j] = 1.0, k
        z1[i, j] = trial
        force += trial
        slope += b[i, j]
    return force, slope


@nb.njit(cache=True)
def regularised_step(k, limit, exponent, tables, place, size, span, power, du, f0, x0, top0):
    """Eq. (5) with |F/F_C|^m: elastic until the force reverses, then along the virgin curve.

    State: force, its coordinate on the virgin curve, and the slip force for which that holds (0 where it does not).
    """
    if limit <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    phi = min(max(f0 / limit, -1.0), 1.0)
    sign = 1.0 if du >= 0.0 else -1.0
    way, phi = k * abs(du) / limit, sign * phi
    if phi + way <= 0.0:
        return sign * (phi + way) * limit, k, 0.0, 0.0, 1.0, k
    start_slope = 1.0
    if phi <= 0.0:
        x = phi + way
    else:
        x = x0 if top0 == limit and x0 > 0.0 else virgin_coordinate(phi, tables, place, size, span, power)
        start_slope = max(1.0 - phi**exponent, 1e-15)
        x += way
    x = min(x, span)
    value = virgin(x, tables, place, size, span, power)
    slope = max(1.0 - value**exponent, 0.0)
    return sign * value * limit, k * slope, x, limit, min(slope / start_slope, 1.0), k * slope


@nb.njit(cache=True)
def dahl_step(k, limit, alpha, du, f0):
    """Dahl: dF/du = sigma |1 - sgn(v) F/F_C|^alpha, solved in closed form."""
    if limit <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    sign = 1.0 if du >= 0.0 else -1.0
    way = k * abs(du) / limit
    y0 = min(max(1.0 - sign * f0 / limit, 0.0), 2.0)
    y1 = 0.0
    if y0 > 0.0 and alpha == 1.0:
        y1 = y0 * np.exp(-way)
    elif y0 > 0.0:
        base = y0 ** (1.0 - alpha) - (1.0 - alpha) * way
        y1 = base ** (1.0 / (1.0 - alpha)) if base > 0.0 else 0.0
    a = (y1 / y0) ** alpha if y0 > 0.0 else 0.0
    b = k * y1**alpha
    return sign * limit * (1.0 - y1), b, 0.0, 0.0, a, b


@nb.njit(cache=True)
def lugre_step(k, limit, damping, viscous, ratio, stribeck, u0, u1, h, bristle0, before, known):
    """LuGre; the end velocity comes from the last two increments (second order in h).

    State: bristle force, the displacement before, and whether that is known. Returns the contact force first.
    """
    if limit <= 0.0:
        return 0.0, 0.0, 0.0, u0, 1.0, 0.0, 0.0
    du = u1 - u0
    sign = 1.0 if du >= 0.0 else -1.0
    if known != 1.0:
        before = u0
    mean, end = du / h, (3.0 * u1 - 4.0 * u0 + before) / (2.0 * h)
    top = limit * (1.0 + (ratio - 1.0) * np.exp(-((mean / stribeck) ** 2)))
    decay = np.exp(-k * abs(du) / top)
    bristle = sign * top + (bristle0 - sign * top) * decay
    b = k * (1.0 - sign * bristle / top)
    top_end = limit * (1.0 + (ratio - 1.0) * np.exp(-((end / stribeck) ** 2)))
    force = bristle + damping * (end - abs(end) * bristle / top_end) + viscous * end
    rest = damping * (1.0 - np.sign(end) * bristle / top_end) + viscous
    return force, b * (1.0 - damping * abs(end) / top_end) + rest * 1.5 / h, bristle, u0, 1.0, decay, b


@nb.njit(cache=True)
def user_step(k, limit, p0, p1, p2, p3, user, du, f0):
    """A user's own law: new force from old force and slip increment; slopes by difference."""
    force = user(f0, du, k, limit, p0, p1, p2, p3)
    tiny = 1e-7 * max(limit, 1e-12) / k
    step = tiny if du >= 0.0 else -tiny
    b = (user(f0, du + step, k, limit, p0, p1, p2, p3) - force) / step
    change = 1e-7 * max(limit, 1e-12) * (-1.0 if f0 > 0.0 else 1.0)
    a = (user(f0 + change, du, k, limit, p0, p1, p2, p3) - force) / change
    return force, b, 0.0, 0.0, a, b


@nb.njit(cache=True)
def single_step(code, i, k, limit, par, tables, user, u0, u1, h, s0, s1, s2):
    """One increment of a law with one internal force: force, slope, the three numbers of its state, tangents a, b."""
    du = u1 - u0
    if code == REGULARISED:
        force, slope, x, top, a, b = regularised_step(
            k, limit, par[i, 0], tables, int(par[i, 1]), int(par[i, 2]), par[i, 3], par[i, 4], du, s0, s1, s2
        )
        return force, slope, force, x, top, a, b
    if code == DAHL:
        force, slope, x, top, a, b = dahl_step(k, limit, par[i, 0], du, s0)
        return force, slope, force, x, top, a, b
    if code == LUGRE:
        return lugre_step(k, limit, par[i, 0], par[i, 1], par[i, 2], par[i, 3], u0, u1, h, s0, s1, s2)
    force, slope, x, top, a, b = user_step(k, limit, par[i, 0], par[i, 1], par[i, 2], par[i, 3], user, du, s0)
    return force, slope, force, x, top, a, b


@nb.njit(cache=True)
def step(code, i, stiffness, limit, par, shares_k, shares_f, count, tables, user, u0, u1, h, z0, z1, a, b):
    """One increment of contact i with any law: force at u1 and its slope; arrays are those of all contacts."""
    if code == PARALLEL:
        return parallel_step(i, stiffness, limit, shares_k, shares_f, count, u1 - u0, z0, z1, a, b)
    force, slope, z1[i, 0], z1[i, 1], z1[i, 2], a[i, 0], b[i, 0] = single_step(
        code, i, stiffness, limit, par, tables, user, u0, u1, h, z0[i, 0], z0[i, 1], z0[i, 2]
    )
    return force, slope


@nb.njit(cache=True)
def all_steps(stiffness, limits, laws, u0, u1, h, z0, z1, f1, slopes):
    """One increment of every contact: forces and their slopes, and the state that belongs to them."""
    codes, par, shares_k, shares_f, counts, tables, user = laws
    a, b = np.empty_like(z0), np.empty_like(z0)
    for i in range(len(u0)):
        f1[i], slopes[i] = step(
            codes[i], i, stiffness[i], limits[i], par, shares_k, shares_f, counts[i], tables, user, u0[i], u1[i], h,
            z0, z1, a, b,
        )  # fmt: skip


@nb.njit(cache=True)
def stored_energy(i, code, stiffness, shares_k, count, z):
    """Energy that the springs of contact i can give back."""
    if code == PARALLEL:
        energy = 0.0
        for j in range(count):
            energy += z[i, j] * z[i, j] / (2.0 * stiffness * shares_k[i, j])
        return energy
    return z[i, 0] * z[i, 0] / (2.0 * stiffness)


@nb.njit(cache=True)
def project(i, code, limit, shares_f, count, z):
    """Bring the forces of contact i below a new slip force; returns the change of its force."""
    change = 0.0
    for j in range(count):
        top = limit * shares_f[i, j]
        if code == LUGRE:
            top = max(top, abs(z[i, j]) if limit > 0.0 else 0.0)
        clipped = min(max(z[i, j], -top), top)
        change += clipped - z[i, j]
        z[i, j] = clipped
    return change


@nb.njit(cache=True)
def drive(codes, stiffness, limits, par, shares_k, shares_f, counts, tables, user, u, h, z):
    """Forces (sample,) of contact 0 along prescribed displacements; ``limits`` (sample,) N; ``z`` is updated."""
    forces = np.empty(len(u))
    z1, a, b = np.zeros_like(z), np.zeros_like(z), np.zeros_like(z)
    before = u[0]
    for n in range(len(u)):
        forces[n], _ = step(
            codes[0], 0, stiffness, limits[n], par, shares_k, shares_f, counts[0], tables, user, before, u[n], h,
            z, z1, a, b,
        )  # fmt: skip
        before = u[n]
        z[:] = z1
    return forces
