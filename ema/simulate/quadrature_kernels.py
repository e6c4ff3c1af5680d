"""Friction over one period of a motion given by its harmonics, for laws without closed form: by quadrature; compiled.

The force is smooth between the turning points of a motion. So Radau's rule is used from one to the next (Hairer and
Wanner, Solving Ordinary Differential Equations II, section IV.5: order 7 with four points), on panels that are short
next to a turning point, where the force changes fastest.
"""

import numpy as np
from numpy.polynomial import Polynomial

from ema.compiled import compiled, inner, inner_with_arrays
from ema.contact.call_kernels import ADDRESS, BY_FORCE, FORCE, LIMIT, SLOPE, STIFFNESS, WAY, increments
from ema.simulate.period_kernels import motion, waves

_STAGES = 4
"""Points of Radau's rule on a panel: of order 7."""
_PANELS, _PER_TURN = 3, 1.0
"""Panels of a quarter of a cycle at first, and further ones for every half turn of the highest order in it. They are
where a refinement begins that is judged by its result."""
_NARROWEST = 1e-8
"""Width of what happens behind a turning point over the distance to the next one; narrower ones are of no weight."""


def _radau() -> tuple[np.ndarray, np.ndarray]:
    """Radau's points in (0, 1], and the integrals of their Lagrange polynomials from 0 to each of them."""
    x = Polynomial([0.0, 1.0])
    points = np.sort((x ** (_STAGES - 1) * (x - 1.0) ** _STAGES).deriv(_STAGES - 1).roots().real)
    integrals = []
    for j in range(_STAGES):
        others = np.delete(points, j)
        basis = Polynomial.fromroots(others) / np.prod(points[j] - others)
        integrals.append(basis.integ()(points))
    return points, np.array(integrals).T.copy()


POINTS, INTEGRALS = _radau()


@inner
def _width(bend, reach, stribeck, length):
    """Distance from a turning point of curvature ``bend`` within which the force changes: to the velocity of Stribeck,
    u' = bend x, or over the way ``reach`` to full slip, u = bend x^2 / 2."""
    curved = max(abs(bend), 1e-300)
    narrow = min(stribeck / curved, np.sqrt(2.0 * reach / curved))
    return min(max(narrow, _NARROWEST * length), length)


@inner_with_arrays
def nodes(wave, turns, fine, reach, stribeck):
    """Panels over the first half of a period: at their points (panel, stage) the length of the panel there and the
    weight of the point, the displacement, its derivative, cos and sin of the orders and the derivatives of these.

    The panels grow with the distance from the turning points, as a sinh does. ``reach``: way to full slip;
    ``stribeck``: velocity over the angular frequency that matters besides.
    """
    (amplitudes, orders), (number, place, _, cosine, sine), total, row = wave, turns, 0, 0
    ends = number // 2
    widths, counts = np.empty((ends, 2)), np.empty((ends, 2), np.int64)
    for m in range(ends):
        before = m - 1 if m > 0 else number - 1
        half = 0.5 * (place[m] - place[before] + (0.0 if m > 0 else 2 * np.pi))
        for side in range(2):
            turn = m if side else before
            bend = motion(amplitudes, orders, cosine[turn], sine[turn])[2]
            widths[m, side] = _width(bend, reach, stribeck, half)
            spread = np.arcsinh(half / widths[m, side])
            more = spread * (0.5 + _PER_TURN * half * orders[-1] / np.pi)
            counts[m, side] = fine * int(np.ceil(_PANELS + more))
            total += counts[m, side]
    length, weight = np.empty((total, _STAGES)), np.empty((total, _STAGES))
    u, rate = np.empty((total, _STAGES)), np.empty((total, _STAGES))
    basis, slope = np.empty((total, _STAGES, len(amplitudes))), np.empty((total, _STAGES, len(amplitudes)))
    # the last row has room for an instant
    cosine, sine = cosine[-1], sine[-1]
    for m in range(ends):
        low = place[m - 1] if m > 0 else place[number - 1] - 2 * np.pi
        half = 0.5 * (place[m] - low)
        for side in range(2):
            width, count = widths[m, side], counts[m, side]
            spread = np.arcsinh(half / width)
            for n in range(count):
                for s in range(_STAGES):
                    share = (n + POINTS[s]) / count
                    way = share if side == 0 else 1.0 - share
                    far = width * np.sinh(way * spread)
                    length[row, s] = width * np.cosh(way * spread) * spread / count
                    weight[row, s] = INTEGRALS[_STAGES - 1, s] * length[row, s]
                    waves(low + far if side == 0 else place[m] - far, len(cosine), cosine, sine)
                    u[row, s], rate[row, s], _, _ = motion(amplitudes, orders, cosine, sine)
                    for h in range(len(orders)):
                        order = orders[h]
                        basis[row, s, 2 * h], basis[row, s, 2 * h + 1] = cosine[order], sine[order]
                        slope[row, s, 2 * h], slope[row, s, 2 * h + 1] = -order * sine[order], order * cosine[order]
                row += 1
    return length, weight, u, rate, basis, slope


@inner
def _follow(i, law, start, start_u, nodes, out):
    """Forces along the nodes from the internal force ``start``, and its tangents; returns its last value."""
    groups, parameters, curves, exchange, states = law
    force, a, b = out
    k, before, after, place = exchange[STIFFNESS, i], states[0], states[1], start_u
    before[i] = 0.0
    before[i, 0] = start
    for n in range(len(nodes)):
        exchange[WAY, i] = nodes[n] - place
        increments(groups[i, ADDRESS], groups[i], 0.0, (parameters, curves), exchange, (before, after))
        start = force[n] = exchange[FORCE, i]
        a[n], b[n] = exchange[BY_FORCE, i], exchange[SLOPE, i] + k
        before, after, place = after, before, nodes[n]
    return start


@compiled(error_model="numpy")
def _differentiate(numbers, first_basis, nodes, tangents, jacobian):
    """Jacobian of the Fourier coefficients from the tangents along the nodes.

    ``numbers``: stiffness, factor of the integrals.
    """
    (k, scale), (weight, basis), (a, b), (count, size) = numbers, nodes, tangents, nodes[1].shape
    # d state / d amplitudes = chain * (that of the start) + grown
    chain, grown = np.empty(count), np.empty((count, size))
    product = 1.0
    for n in range(count):
        product *= a[n]
        chain[n] = product
        for c in range(size):
            before = first_basis[c] if n == 0 else basis[n - 1, c]
            grown[n, c] = b[n] * (basis[n, c] - before) + (a[n] * grown[n - 1, c] if n > 0 else 0.0)
    for n in range(count):
        for c in range(size):
            begin = -grown[count - 1, c] / (1.0 + product)
            grown[n, c] = weight[n] * (grown[n, c] + chain[n] * begin - k * basis[n, c])
    for n in range(count):
        for r in range(size):
            lever = scale * basis[n, r]
            for c in range(size):
                jacobian[r, c] += lever * grown[n, c]


@compiled(error_model="numpy")
def smooth_period(i, law, wave, fine, turns, out):
    """Fourier coefficients (2 H,) of f - k u of one contact in its cycle, their Jacobian; returns the loss.

    ``law`` as ``ContactLaws.one_by_one`` gives it, with the slip forces in its table; ``fine`` is a factor on the
    number of nodes. The rest as in ``masing_period``.
    """
    orders, (number, _, value, cosine, sine), (forces, jacobian, derive) = wave[1], turns, out
    k, size = law[3][STIFFNESS, i], len(forces)
    _, weight, u, rate, basis, _ = nodes(wave, turns, fine, law[3][LIMIT, i] / k, np.inf)
    count, first_basis = weight.size, np.empty(size)
    weight, u, rate, basis = weight.reshape(count), u.reshape(count), rate.reshape(count), basis.reshape(count, size)
    for h in range(size // 2):
        first_basis[2 * h], first_basis[2 * h + 1] = cosine[number - 1, orders[h]], sine[number - 1, orders[h]]
    force, a, b = np.empty(count), np.empty(count), np.empty(count)
    start_u, along = value[number - 1], (force, a, b)
    start = _settle(i, law, start_u, u, along)
    _follow(i, law, start, start_u, u, along)
    scale, lost = 2.0 / np.pi, 0.0
    if derive:
        _differentiate((k, scale), first_basis, (weight, basis), (a, b), jacobian)
    for n in range(count):
        lost += weight[n] * force[n] * rate[n]
        force[n] = weight[n] * (force[n] - k * u[n])
        for r in range(size):
            forces[r] += scale * basis[n, r] * force[n]
    return 2.0 * lost


@inner
def _settle(i, law, start_u, nodes, out):
    """Internal force at the first turning point with which the cycle closes."""
    start, limit, a = 0.0, law[3][LIMIT, i], out[1]
    for trial in range(60):
        end = _follow(i, law, start, start_u, nodes, out)
        product = 1.0
        for n in range(len(a)):
            product *= a[n]
        # half a period later the force is the opposite; every fourth step is one that always contracts
        step = -(start + end) / (1.0 + product if trial % 4 != 3 else 2.0)
        new = min(max(start + step, -4.0 * limit), 4.0 * limit)
        done = abs(new - start) <= 1e-13 * limit
        start = new
        if done:
            break
    return start
