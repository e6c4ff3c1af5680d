"""Friction over one period of a motion given by its harmonics, for laws without closed form: by quadrature; compiled.

The force is smooth between the turning points of a motion. So Gauss's rule is used from one to the next, on places that
crowd behind a turning point, where the force changes fastest.
"""

import numpy as np

from ema.compiled import compiled
from ema.contact.call_kernels import ADDRESS, BY_FORCE, FORCE, LIMIT, SLOPE, STIFFNESS, WAY, increments
from ema.simulate.period_kernels import motion, turning_points, waves

_GAUSS = np.array([0.069431844202973712, 0.33000947820757187, 0.66999052179242813, 0.93056815579702629])
_WEIGHTS = np.array([0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693])


@compiled(error_model="numpy")
def _count_nodes(orders, odd, fine, turns, place):
    """Number of nodes that ``_nodes`` makes."""
    total = 0
    for m in range(turns // 2 if odd else turns):
        length = place[m] - place[m - 1] if m > 0 else place[0] - place[turns - 1] + 2 * np.pi
        total += 4 * fine * (5 + int(np.ceil(length * orders[-1] / np.pi))) + 1
    return total


@compiled(error_model="numpy")
def _nodes(amplitudes, orders, odd, fine, turns, place, cosine, sine, where, weight, u, rate, basis):
    """Places, weights, displacement, its derivative, and cos and sin of the orders.

    Turning points are nodes of weight 0.
    """
    row = 0
    for m in range(turns // 2 if odd else turns):
        low = place[m - 1] if m > 0 else place[turns - 1] - 2 * np.pi
        length = place[m] - low
        panels = fine * (5 + int(np.ceil(length * orders[-1] / np.pi)))
        for n in range(4 * panels + 1):
            if n == 4 * panels:
                x, weight[row] = place[m], 0.0
            else:
                s = (n // 4 + _GAUSS[n % 4]) / panels
                x, weight[row] = low + length * s * s, _WEIGHTS[n % 4] / panels * 2 * length * s
            where[row] = x
            waves(x, len(cosine), cosine, sine)
            u[row], rate[row], _, _ = motion(amplitudes, orders, cosine, sine)
            for h in range(len(orders)):
                order = orders[h]
                basis[row, 2 * h], basis[row, 2 * h + 1] = cosine[order], sine[order]
            row += 1


@compiled(error_model="numpy")
def _follow(i, law, start, start_u, nodes, out):
    """Forces along the nodes from the internal force ``start``, and its tangents; returns its last value."""
    groups, parameters, curves, exchange, states = law
    force, a, b = out
    k, before, after, place = exchange[STIFFNESS, i], states[0], states[1], start_u
    before[i] = 0.0
    before[i, 0] = start
    for n in range(len(nodes)):
        exchange[WAY, i] = nodes[n] - place
        increments(groups[i, ADDRESS], groups[i], 0.0, parameters, curves, exchange, before, after)
        start = force[n] = exchange[FORCE, i]
        a[n], b[n] = exchange[BY_FORCE, i], exchange[SLOPE, i] + k
        before, after, place = after, before, nodes[n]
    return start


@compiled(error_model="numpy")
def _differentiate(odd, k, first_basis, basis, weight, a, b, scale, jacobian):
    """Jacobian of the Fourier coefficients from the tangents ``a``, ``b`` along the nodes."""
    count, size = basis.shape
    # d state / d amplitudes = chain * (that of the start) + grown
    chain, grown = np.empty(count), np.empty((count, size))
    product = 1.0
    for n in range(count):
        product *= a[n]
        chain[n] = product
        for c in range(size):
            before = first_basis[c] if n == 0 else basis[n - 1, c]
            grown[n, c] = b[n] * (basis[n, c] - before) + (a[n] * grown[n - 1, c] if n > 0 else 0.0)
    closing = 1.0 + product if odd else 1.0 - product
    for n in range(count):
        for c in range(size):
            begin = 0.0
            if odd:
                begin = -grown[count - 1, c] / closing
            elif closing > 1e-6:
                begin = grown[count - 1, c] / closing
            grown[n, c] = weight[n] * (grown[n, c] + chain[n] * begin - k * basis[n, c])
    for n in range(count):
        for r in range(size):
            lever = scale * basis[n, r]
            for c in range(size):
                jacobian[r, c] += lever * grown[n, c]


@compiled(error_model="numpy")
def smooth_period(i, law, amplitudes, period, room, forces, jacobian, derive):
    """Fourier coefficients ``forces`` (2 H,) of f - k u of one contact in its cycle, their Jacobian, the loss.

    ``law`` as ``ContactLaws.one_by_one`` gives it, with the slip forces in its table. ``period``: orders, whether the
    motion is odd, a factor on the number of nodes, and the angular frequency. ``room`` and the rest are those of
    ``masing_period``.
    """
    (orders, odd, fine, _), (rates, bends, place, value, cosine, sine) = period, room
    k, limit = law[3][STIFFNESS, i], law[3][LIMIT, i]
    size = len(amplitudes)
    for r in range(size):
        forces[r] = 0.0
        for c in range(size):
            jacobian[r, c] = 0.0
    turns = turning_points(amplitudes, orders, rates, bends, odd, place, value, cosine, sine)
    if turns < 2 or limit <= 0.0:
        for r in range(size):
            forces[r] = -k * amplitudes[r] if turns >= 2 else 0.0
            jacobian[r, r] = -k
        return 0.0
    count = _count_nodes(orders, odd, fine, turns, place)
    where, weight, u, rate = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    basis, first_basis = np.empty((count, size)), np.empty(size)
    for h in range(size // 2):
        first_basis[2 * h], first_basis[2 * h + 1] = cosine[turns - 1, orders[h]], sine[turns - 1, orders[h]]
    last = len(place) - 1
    _nodes(amplitudes, orders, odd, fine, turns, place, cosine[last], sine[last], where, weight, u, rate, basis)
    force, a, b = np.empty(count), np.empty(count), np.empty(count)
    start_u, out = value[turns - 1], (force, a, b)
    start = _settle(i, law, start_u, odd, u, out)
    _follow(i, law, start, start_u, u, out)
    scale, lost = (2.0 if odd else 1.0) / np.pi, 0.0
    if derive:
        _differentiate(odd, k, first_basis, basis, weight, a, b, scale, jacobian)
    for n in range(count):
        lost += weight[n] * force[n] * rate[n]
        force[n] = weight[n] * (force[n] - k * u[n])
        for r in range(size):
            forces[r] += scale * basis[n, r] * force[n]
    if orders[0] == 0:
        forces[0] *= 0.5
        for c in range(size):
            jacobian[0, c] *= 0.5
    return lost * (2.0 if odd else 1.0)


@compiled(error_model="numpy")
def _settle(i, law, start_u, odd, nodes, out):
    """Internal force at the first turning point with which the cycle closes."""
    start, limit, a = 0.0, law[3][LIMIT, i], out[1]
    for trial in range(60):
        end = _follow(i, law, start, start_u, nodes, out)
        product = 1.0
        for n in range(len(a)):
            product *= a[n]
        if odd:
            # half a period later the force is the opposite; every fourth step is one that always contracts
            step = -(start + end) / (1.0 + product if trial % 4 != 3 else 2.0)
        elif trial < 4 or product > 1.0 - 1e-6:
            step = end - start
        else:
            step = (end - start) / (1.0 - product)
        new = min(max(start + step, -4.0 * limit), 4.0 * limit)
        done = abs(new - start) <= 1e-13 * limit
        start = new
        if done:
            break
    return start
