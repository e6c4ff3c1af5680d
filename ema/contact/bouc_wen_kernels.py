"""Law of Bouc (1967) and Wen (1976), exact for monotone motion: dF/du = k (1 - |F/F_C|^n (gamma + beta sgn(F du))).

With beta + gamma = 1 the force ends at F_C, and n and gamma are left; gamma = 1/2 is Eq. (5) of Gaul, Roseira and
Becker (2008). State: the force, its coordinate on the virgin curve, and the |F/F_C| for which that holds (0 where it
does not).
"""

from ema.compiled import inner, kernel
from ema.contact.call_kernels import BY_FORCE, END, EXCESS, FIRST, FORCE, LIMIT, SLOPE, STIFFNESS, WAY


@inner
def virgin(x, tables, curve):
    """Normalised force on a curve (number, size, span, grading) at coordinate x, quintic Hermite on a graded grid."""
    place, size, span, power = curve
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


@inner
def virgin_coordinate(phi, tables, curve):
    """Coordinate x at which a curve reaches phi (0 ... 1): safeguarded Newton inside one cell of the table."""
    place, size, span, power = curve
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
        rest = virgin(span * t**power, tables, curve) - phi
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


@inner
def bouc_wen_step(contact, shape, tables, du, state):
    """Against the force along the release curve, from F = 0 on along the virgin curve; both are tables.

    ``contact``: stiffness and slip force. ``shape``: exponent n; number, size, span and grading of the virgin curve;
    d = 1 - 2 gamma; number, span and grading of the release curve. ``state``: force, its coordinate on the virgin
    curve, and the |F/F_C| for which that holds (0 where it does not). Returns the force, df1/du, the new coordinate and
    what it holds for, df1/df0 and df1/du again.
    """
    (k, limit), (f0, x0, phi0) = contact, state
    if limit <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    exponent, span, d = shape[0], shape[3], shape[5]
    along = int(shape[1]), int(shape[2]), span, shape[4]
    release = int(shape[6]), int(shape[2]), shape[7], shape[8]
    phi = min(max(f0 / limit, -1.0), 1.0)
    sign = 1.0 if du >= 0.0 else -1.0
    way, phi, start_slope = k * abs(du) / limit, sign * phi, 1.0
    if phi <= 0.0:
        back = -phi
        if d != 0.0:
            start_slope = 1.0 + d * back**exponent
            back = virgin_coordinate(back, tables, release)
        if way <= back:
            value, slope = back - way, 1.0
            if d != 0.0:
                value = virgin(value, tables, release)
                slope = 1.0 + d * value**exponent
            return -sign * value * limit, k * slope, 0.0, 0.0, slope / start_slope, k * slope
        x = way - back
    else:
        x = x0 if phi0 == phi and x0 > 0.0 else virgin_coordinate(phi, tables, along)
        start_slope = max(1.0 - phi**exponent, 1e-15)
        x += way
    x = min(x, span)
    value = virgin(x, tables, along)
    slope = max(1.0 - value**exponent, 0.0)
    return sign * value * limit, k * slope, x, value * limit / limit, min(slope / start_slope, 1.0), k * slope


@kernel
def bouc_wen(group, rate, tables, exchange, states):
    """Increments of the contacts of a group; ``parameters``: ``shape`` of ``bouc_wen_step``."""
    (parameters, curves), (before, after) = tables, states
    for i in range(group[FIRST], group[END]):
        k, way = exchange[STIFFNESS, i], exchange[WAY, i]
        state = before[i, 0], before[i, 1], before[i, 2]
        force, slope, place, valid, exchange[BY_FORCE, i], _ = bouc_wen_step(
            (k, exchange[LIMIT, i]), parameters[i], curves, way, state
        )
        after[i, 0] = exchange[FORCE, i] = force
        after[i, 1], after[i, 2] = place, valid
        exchange[EXCESS, i], exchange[SLOPE, i] = force - before[i, 0] - k * way, slope - k
