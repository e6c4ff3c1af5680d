"""LuGre's law (Canudas de Wit et al. 1995) over one period of a motion given by its harmonics; compiled.

Between two turning points the bristle force z of a given motion u(x), x = w t, follows a linear equation,

    dz/dx = k u' (1 - sgn(u') z / g),   g = F_C (1 + (F_S/F_C - 1) exp(-(w u'/v_S)^2)),

which collocation at Radau's points solves (Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.5:
order 7 with four points, damped where it is stiff), and its derivative by the motion alike. The same points integrate
force and loss. The force changes fastest where the velocity passes through zero: panels grow with the distance from
there, as a sinh does.
"""

import numpy as np

from ema.compiled import compiled, inner, inner_with_arrays
from ema.simulate.quadrature_kernels import INTEGRALS, nodes


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


@inner
def _panel(law, omega, rate, length, out, matrix):
    """Collocation on one panel for known velocities; ``out``: the law at its points, rows g, dg/dv and sign of v.

    ``matrix`` becomes (1 - A diag(a))^-1, with dz/ds = a z + b, both over the panel.
    """
    (k, limit, par), stages = law, len(rate)
    sign = np.sign(rate[0])  # the last point may be the turning point, where rounding decides
    for s in range(stages):
        v = omega * rate[s]
        peak = np.exp(-((v / par[3]) ** 2))
        out[0, s] = limit * (1.0 + (par[2] - 1.0) * peak)
        out[1, s] = -limit * (par[2] - 1.0) * peak * 2.0 * v / par[3] ** 2
        out[2, s] = sign
    for r in range(stages):
        for s in range(stages):
            own = 1.0 if r == s else 0.0
            matrix[r, s] = own + INTEGRALS[r, s] * length[s] * k * abs(rate[s]) / out[0, s]
    _invert(matrix)


@inner
def _follow(law, omega, points, solved):
    """Bristle force at all points from an unstressed start; returns it at the end, and what is left there of 1 N at the
    start. ``points``: panels, derivative of the motion and room for the force."""
    (k, _, _), (length, rate, z), (chain, inverse, rows), stages = law, points, solved, points[0].shape[1]
    gone, left = 0.0, 1.0
    for n in range(len(length)):
        _panel(law, omega, rate[n], length[n], rows[n], inverse[n])
        for r in range(stages):
            z[n, r], chain[n, r] = 0.0, 0.0
            for s in range(stages):
                grown = gone
                for q in range(stages):
                    grown += INTEGRALS[s, q] * length[n, q] * k * rate[n, q]
                z[n, r] += inverse[n, r, s] * grown
                chain[n, r] += inverse[n, r, s] * left
        gone, left = z[n, stages - 1], chain[n, stages - 1]
    return gone, left


@compiled(error_model="numpy")
def bristle_period(law, wave, period, turns, out):
    """Fourier coefficients (2 H,) of f - k u of one contact in its cycle, their Jacobian; returns the loss.

    law: stiffness, slip force F_C, and sigma_1, sigma_2, F_S/F_C, v_S. ``period``: a factor on the number of nodes, and
    the angular frequency. The rest as in ``masing_period``.
    """
    (k, limit, par), (fine, omega), (forces, jacobian, derive), size = law, period, out, len(wave[0])
    length, weight, u, rate, basis, slope = nodes(wave, turns, fine, par[2] * limit / k, par[3] / omega)
    count, stages = weight.shape
    z, chain, rows = np.empty((count, stages)), np.empty((count, stages)), np.empty((count, 3, stages))
    inverse = np.empty((count, stages, stages))
    gone, left = _follow(law, omega, (length, rate, z), (chain, inverse, rows))
    start, scale = -gone / (1.0 + left), 2.0 / np.pi
    lost, spread = 0.0, np.empty((count, 3, stages))
    for n in range(count):
        for s in range(stages):
            z[n, s] += start * chain[n, s]
            v, top, rise, sign = omega * rate[n, s], rows[n, 0, s], rows[n, 1, s], rows[n, 2, s]
            lag = 1.0 - sign * z[n, s] / top
            bent = lag + abs(v) * z[n, s] * rise / top**2
            force = z[n, s] + par[0] * v * lag + par[1] * v
            # derivatives of dz/dx by u', of the force by z and u'
            spread[n, 0, s] = k * bent
            spread[n, 1, s], spread[n, 2, s] = 1.0 - par[0] * abs(v) / top, omega * (par[0] * bent + par[1])
            share = weight[n, s]
            lost += share * force * rate[n, s]
            for r in range(size):
                forces[r] += scale * share * basis[n, s, r] * (force - k * u[n, s])
    if derive:
        _differentiate((k, scale, left), (inverse, chain, length, weight), (basis, slope, spread), jacobian)
    return 2.0 * lost


@inner_with_arrays
def _differentiate(numbers, collocation, tables, jacobian):
    """Jacobian of the Fourier coefficients: the linear equation of dz by the amplitudes on the same points."""
    (k, scale, left), (inverse, chain, length, weight), (basis, slope, spread) = numbers, collocation, tables
    count, stages, size = basis.shape
    grown, pushed, carried = np.zeros((count * stages, size)), np.empty((stages, size)), np.zeros(size)
    for n in range(count):
        for s in range(stages):
            for c in range(size):
                pushed[s, c] = carried[c]
            for q in range(stages):
                lever = INTEGRALS[s, q] * length[n, q] * spread[n, 0, q]
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
            row, lever = grown[n * stages + s], scale * weight[n, s]
            for c in range(size):
                change = spread[n, 1, s] * (row[c] + chain[n, s] * begin[c]) + spread[n, 2, s] * slope[n, s, c]
                row[c] = lever * (change - k * basis[n, s, c])
    jacobian += np.dot(basis.reshape(count * stages, size).T.copy(), grown)
