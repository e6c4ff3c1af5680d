"""LuGre's law (Canudas de Wit et al. 1995) over one period of a motion given by its harmonics; compiled.

Between two turning points the bristle force z of a given motion u(x), x = w t, follows a linear equation,

    dz/dx = k u' (1 - sgn(u') z / g),   g = F_C (1 + (F_S/F_C - 1) exp(-(w u'/v_S)^2)),

which collocation at Radau's points solves (Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.5:
order 7 with four points, damped where it is stiff), and its derivative by the motion alike. The same points integrate
force and loss. The force changes fastest where the velocity passes through zero: panels grow with the distance from
there, as a sinh does.
"""

import numpy as np
from numpy.polynomial import Polynomial

from ema.compiled import compiled, inner, inner_with_arrays
from ema.simulate.period_kernels import motion, waves

_STAGES = 4
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


_POINTS, _INTEGRALS = _radau()


@inner
def _width(bend, reach, stribeck, length):
    """Distance from a turning point of curvature ``bend`` within which the force changes: to the velocity of Stribeck,
    u' = bend x, or over the way ``reach`` to full slip, u = bend x^2 / 2."""
    curved = max(abs(bend), 1e-300)
    narrow = min(stribeck / curved, np.sqrt(2.0 * reach / curved))
    return min(max(narrow, _NARROWEST * length), length)


@inner
def _panels(orders, fine, half, spread):
    """Number of panels from a turning point to the middle of the way to the next one."""
    return fine * int(np.ceil(_PANELS + spread * (0.5 + _PER_TURN * half * orders[-1] / np.pi)))


@inner
def _invert(matrix):
    """Invert a small matrix in its place, without pivots: its diagonal is 1 or more, as a friction law descends."""
    size = len(matrix)
    for p in range(size):
        factor = 1.0 / matrix[p, p]
        matrix[p, p] = 1.0
        for c in range(size):
            matrix[p, c] *= factor
        for r in range(size):
            if r != p:
                factor = matrix[r, p]
                matrix[r, p] = 0.0
                for c in range(size):
                    matrix[r, c] -= factor * matrix[p, c]


@inner_with_arrays
def _nodes(orders, turns, ends, fine, widths):
    """Panels of all stretches: where the points are and their weights, (panel, stage)."""
    number, place, total = turns[0], turns[1], 0
    for m in range(ends):
        half = 0.5 * (place[m] - (place[m - 1] if m > 0 else place[number - 1] - 2 * np.pi))
        for side in range(2):
            total += _panels(orders, fine, half, np.arcsinh(half / widths[m, side]))
    where, weight = np.empty((total, _STAGES)), np.empty((total, _STAGES))
    row = 0
    for m in range(ends):
        low = place[m - 1] if m > 0 else place[number - 1] - 2 * np.pi
        half = 0.5 * (place[m] - low)
        for side in range(2):
            width = widths[m, side]
            spread = np.arcsinh(half / width)
            count = _panels(orders, fine, half, spread)
            for n in range(count):
                for s in range(_STAGES):
                    share = (n + _POINTS[s]) / count
                    way = share if side == 0 else 1.0 - share
                    far = width * np.sinh(way * spread)
                    where[row, s] = low + far if side == 0 else place[m] - far
                    weight[row, s] = width * np.cosh(way * spread) * spread / count
                row += 1
    return where, weight


@inner
def _panel(law, omega, rate, weight, out, matrix):
    """Collocation on one panel for known velocities; ``out``: the law at its points, rows g, dg/dv and sign of v.

    ``matrix`` becomes (1 - A diag(a))^-1, with dz/ds = a z + b, both over the panel.
    """
    k, limit, par = law
    sign = np.sign(rate[0])  # the last point may be the turning point, where rounding decides
    for s in range(_STAGES):
        v = omega * rate[s]
        peak = np.exp(-((v / par[3]) ** 2))
        out[0, s] = limit * (1.0 + (par[2] - 1.0) * peak)
        out[1, s] = -limit * (par[2] - 1.0) * peak * 2.0 * v / par[3] ** 2
        out[2, s] = sign
    for r in range(_STAGES):
        for s in range(_STAGES):
            own = 1.0 if r == s else 0.0
            matrix[r, s] = own + _INTEGRALS[r, s] * weight[s] * k * abs(rate[s]) / out[0, s]
    _invert(matrix)


@inner
def _follow(law, wave, instant, panels, points, solved):
    """Motion and bristle force at all points from an unstressed start; returns the force at the end, and what is left
    there of 1 N at the start. ``instant``: angular frequency, and room for the waves of an instant."""
    (k, _, _), (amplitudes, orders), (omega, here_c, here_s), (where, weight) = law, wave, instant, panels
    (u, rate, z, basis, slope), (chain, inverse, rows) = points, solved
    gone, left = 0.0, 1.0
    for n in range(len(where)):
        for s in range(_STAGES):
            waves(where[n, s], orders[-1] + 1, here_c, here_s)
            u[n, s], rate[n, s], _, _ = motion(amplitudes, orders, here_c, here_s)
            for h in range(len(orders)):
                order = orders[h]
                basis[n, s, 2 * h], basis[n, s, 2 * h + 1] = here_c[order], here_s[order]
                slope[n, s, 2 * h], slope[n, s, 2 * h + 1] = -order * here_s[order], order * here_c[order]
        _panel(law, omega, rate[n], weight[n], rows[n], inverse[n])
        for r in range(_STAGES):
            z[n, r], chain[n, r] = 0.0, 0.0
            for s in range(_STAGES):
                grown = gone
                for q in range(_STAGES):
                    grown += _INTEGRALS[s, q] * weight[n, q] * k * rate[n, q]
                z[n, r] += inverse[n, r, s] * grown
                chain[n, r] += inverse[n, r, s] * left
        gone, left = z[n, _STAGES - 1], chain[n, _STAGES - 1]
    return gone, left


@compiled(error_model="numpy")
def bristle_period(law, wave, period, turns, out):
    """Fourier coefficients (2 H,) of f - k u of one contact in its cycle, their Jacobian; returns the loss.

    law: stiffness, slip force F_C, and sigma_1, sigma_2, F_S/F_C, v_S. ``period``: a factor on the number of nodes, and
    the angular frequency. The rest as in ``masing_period``.
    """
    (k, limit, par), (amplitudes, orders), (fine, omega) = law, wave, period
    (number, place, _, cosine, sine), (forces, jacobian, derive), size = turns, out, len(amplitudes)
    ends = number // 2
    widths = np.empty((ends, 2))
    for m in range(ends):
        before = m - 1 if m > 0 else number - 1
        half = 0.5 * (place[m] - place[before] + (0.0 if m > 0 else 2 * np.pi))
        for side in range(2):
            turn = m if side else before
            bend = motion(amplitudes, orders, cosine[turn], sine[turn])[2]
            widths[m, side] = _width(bend, par[2] * limit / k, par[3] / omega, half)
    where, weight = _nodes(orders, turns, ends, fine, widths)
    count = len(where)
    u, rate, z = np.empty((count, _STAGES)), np.empty((count, _STAGES)), np.empty((count, _STAGES))
    basis, slope = np.empty((count, _STAGES, size)), np.empty((count, _STAGES, size))
    rows = np.empty((count, 3, _STAGES))
    chain, inverse = np.empty((count, _STAGES)), np.empty((count, _STAGES, _STAGES))
    points, solved = (u, rate, z, basis, slope), (chain, inverse, rows)
    # the last row has room for an instant
    gone, left = _follow(law, wave, (omega, cosine[-1], sine[-1]), (where, weight), points, solved)
    start, scale = -gone / (1.0 + left), 2.0 / np.pi
    lost, spread = 0.0, np.empty((count, 5, _STAGES))
    for n in range(count):
        for s in range(_STAGES):
            z[n, s] += start * chain[n, s]
            v, top, rise, sign = omega * rate[n, s], rows[n, 0, s], rows[n, 1, s], rows[n, 2, s]
            lag = 1.0 - sign * z[n, s] / top
            bent = lag + abs(v) * z[n, s] * rise / top**2
            force = z[n, s] + par[0] * v * lag + par[1] * v
            # derivatives of dz/dx by u', of the force by z and u'
            spread[n, 0, s] = k * bent
            spread[n, 1, s], spread[n, 2, s] = 1.0 - par[0] * abs(v) / top, omega * (par[0] * bent + par[1])
            share = _INTEGRALS[_STAGES - 1, s] * weight[n, s]
            lost += share * force * rate[n, s]
            for r in range(size):
                forces[r] += scale * share * basis[n, s, r] * (force - k * u[n, s])
    if derive:
        _differentiate((k, scale, left), (inverse, chain, weight), (basis, slope, spread), jacobian)
    return 2.0 * lost


@inner_with_arrays
def _differentiate(numbers, collocation, tables, jacobian):
    """Jacobian of the Fourier coefficients: the linear equation of dz by the amplitudes on the same points."""
    (k, scale, left), (inverse, chain, weight), (basis, slope, spread) = numbers, collocation, tables
    count, stages, size = basis.shape
    grown, pushed, carried = np.zeros((count * stages, size)), np.empty((stages, size)), np.zeros(size)
    for n in range(count):
        for s in range(stages):
            for c in range(size):
                pushed[s, c] = carried[c]
            for q in range(stages):
                lever = _INTEGRALS[s, q] * weight[n, q] * spread[n, 0, q]
                for c in range(size):
                    pushed[s, c] += lever * slope[n, q, c]
        for r in range(stages):
            row = grown[n * stages + r]
            for s in range(stages):
                lever = inverse[n, r, s]
                for c in range(size):
                    row[c] += lever * pushed[s, c]
        for c in range(size):
            carried[c] = grown[n * stages + stages - 1, c]
    begin = -carried / (1.0 + left)
    for n in range(count):
        for s in range(stages):
            row, lever = grown[n * stages + s], scale * _INTEGRALS[stages - 1, s] * weight[n, s]
            for c in range(size):
                change = spread[n, 1, s] * (row[c] + chain[n, s] * begin[c]) + spread[n, 2, s] * slope[n, s, c]
                row[c] = lever * (change - k * basis[n, s, c])
    jacobian += np.dot(basis.reshape(count * stages, size).T.copy(), grown)
