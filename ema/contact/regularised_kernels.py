"""The smooth rule (Gaul, Roseira and Becker 2008, Eq. 5), exact for monotone motion: its virgin curve is a table.

State: the force, its coordinate on the virgin curve, and the slip force for which that holds (0 where it does not).
"""

from ema.compiled import kernel
from ema.contact.call_kernels import END, EXCESS, FIRST, FORCE, LIMIT, SLOPE, STIFFNESS, WAY


@kernel
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


@kernel
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


@kernel
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


@kernel
def regularised(group, rate, parameters, curves, exchange, before, after):
    """Increments of the contacts of a group; ``parameters``: exponent, number of its curve, and what that is over."""
    for i in range(group[FIRST], group[END]):
        k, way = exchange[STIFFNESS, i], exchange[WAY, i]
        force, slope, place, top, _, _ = regularised_step(
            k, exchange[LIMIT, i], parameters[i, 0], curves, int(parameters[i, 1]), int(parameters[i, 2]),
            parameters[i, 3], parameters[i, 4], way, before[i, 0], before[i, 1], before[i, 2],
        )  # fmt: skip
        after[i, 0] = exchange[FORCE, i] = force
        after[i, 1], after[i, 2] = place, top
        exchange[EXCESS, i], exchange[SLOPE, i] = force - before[i, 0] - k * way, slope - k
