"""Friction over one period of a motion given by its harmonics, for laws without closed form: by quadrature; compiled.

The force is smooth between the turning points of a motion. So Gauss's rule is used from one to the next, on places that
crowd behind a turning point, where the force changes fastest.
"""

import numpy as np

from ema.compiled import compiled, inner
from ema.contact.call_kernels import ADDRESS, BY_FORCE, FORCE, LIMIT, SLOPE, STIFFNESS, WAY, increments
from ema.simulate.period_kernels import motion, waves

_GAUSS = np.array([0.069431844202973712, 0.33000947820757187, 0.66999052179242813, 0.93056815579702629])
_WEIGHTS = np.array([0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693])


@inner
def _panels(orders, fine, place, m, number):
    """Begin and length of the stretch before turning point m, and number of its panels."""
    low = place[m - 1] if m > 0 else place[number - 1] - 2 * np.pi
    length = place[m] - low
    return low, length, fine * (5 + int(np.ceil(length * orders[-1] / np.pi)))


@compiled(error_model="numpy")
def _nodes(wave, turns, ends, fine):
    """Weights, displacement, its derivative, cos and sin of the orders at the nodes of the first ``ends`` stretches.

    Turning points are nodes of weight 0.
    """
    (amplitudes, orders), (number, place, _, cosine, sine), total, row = wave, turns, 0, 0
    for m in range(ends):
        total += 4 * _panels(orders, fine, place, m, number)[2] + 1
    weight, u, rate, basis = np.empty(total), np.empty(total), np.empty(total), np.empty((total, len(amplitudes)))
    # the last row has room for an instant
    cosine, sine = cosine[-1], sine[-1]
    for m in range(ends):
        low, length, panels = _panels(orders, fine, place, m, number)
        for n in range(4 * panels + 1):
            if n == 4 * panels:
                x, weight[row] = place[m], 0.0
            else:
                s = (n // 4 + _GAUSS[n % 4]) / panels
                x, weight[row] = low + length * s * s, _WEIGHTS[n % 4] / panels * 2 * length * s
            waves(x, len(cosine), cosine, sine)
            u[row], rate[row], _, _ = motion(amplitudes, orders, cosine, sine)
            for h in range(len(orders)):
                order = orders[h]
                basis[row, 2 * h], basis[row, 2 * h + 1] = cosine[order], sine[order]
            row += 1
    return weight, u, rate, basis


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
    (k, scale), (weight, _, _, basis), (a, b), (count, size) = numbers, nodes, tangents, nodes[3].shape
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
    nodes = _nodes(wave, turns, number // 2, fine)
    (weight, u, rate, basis), count, first_basis = nodes, len(nodes[0]), np.empty(size)
    for h in range(size // 2):
        first_basis[2 * h], first_basis[2 * h + 1] = cosine[number - 1, orders[h]], sine[number - 1, orders[h]]
    force, a, b = np.empty(count), np.empty(count), np.empty(count)
    start_u, along = value[number - 1], (force, a, b)
    start = _settle(i, law, start_u, u, along)
    _follow(i, law, start, start_u, u, along)
    scale, lost = 2.0 / np.pi, 0.0
    if derive:
        _differentiate((k, scale), first_basis, nodes, (a, b), jacobian)
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
