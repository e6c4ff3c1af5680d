"""Friction over one period of a motion given by its harmonics, for laws without closed form: by quadrature; compiled.

The force is smooth between the turning points of a motion. So Radau's rule is used from one to the next (Hairer and
Wanner, Solving Ordinary Differential Equations II, section IV.5: order 7 with four points), on panels that are short
next to a turning point, where the force changes fastest. Of laws of the user's own it is not known where they kink:
panels are halved there until it no longer matters.
"""

import numpy as np
from numpy.polynomial import Polynomial

from ema.compiled import compiled, inner, inner_with_arrays
from ema.contact.call_kernels import ADDRESS, BY_FORCE, FORCE, LIMIT, OWN, SLOPE, STIFFNESS, WAY, increments
from ema.simulate.period_kernels import motion, waves

_STAGES = 4
"""Points of Radau's rule on a panel: of order 7."""
_PANELS, _PER_TURN = 3, 1.0
"""Panels of a quarter of a cycle at first, and further ones for every half turn of the highest order in it. They are
where a refinement begins that is judged by its result."""
_NARROWEST = 1e-8
"""Width of what happens behind a turning point over the distance to the next one; narrower ones are of no weight."""

_KINKED, _HALVINGS = 1e-10, 30
"""Integral of the force over F_C and half a period by which a panel may differ from its halves, and how many
of its parts may wait. An error of the places where panels end is of the size of what Newton's method leaves."""

_ELASTIC, _AS_STIFF = 1e-13, 1e-6
"""Force over F_C, and slope over k_T, by which a spring is missed at most by rounding, the slope being a difference."""
_JUMP = 1e-3
"""Jump of the slope over k_T at which a panel is cut; a smaller one is halved down to, as it is weaker."""


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
def _grading(wave, turns, fine, reach, stribeck):
    """Of both halves of every stretch, (stretch, 2): width of what happens at its turning point, number of panels."""
    (amplitudes, orders), (number, place, _, cosine, sine) = wave, turns
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
    return widths, counts


@inner
def _instant(turns, widths, panel, share):
    """Place at a share (0 ... 1) of one half of a stretch, and its derivative by the share; ``panel``: stretch, half.

    Panels grow with the distance from the turning points, as a sinh does.
    """
    (number, place, _, _, _), (m, side) = turns, panel
    low = place[m - 1] if m > 0 else place[number - 1] - 2 * np.pi
    width, half = widths[m, side], 0.5 * (place[m] - low)
    spread = np.arcsinh(half / width)
    way = share if side == 0 else 1.0 - share
    far = width * np.sinh(way * spread)
    return low + far if side == 0 else place[m] - far, width * np.cosh(way * spread) * spread


@inner_with_arrays
def _even(counts):
    """Panels of equal shares: stretch and half of each, and the share where it begins and its length."""
    total, row = counts.sum(), 0
    panels, cuts = np.empty((total, 2), np.int64), np.empty((total, 2))
    for m in range(len(counts)):
        for side in range(2):
            for n in range(counts[m, side]):
                panels[row, 0], panels[row, 1] = m, side
                cuts[row, 0], cuts[row, 1] = n / counts[m, side], 1.0 / counts[m, side]
                row += 1
    return panels, cuts


@inner_with_arrays
def _filled(wave, turns, widths, panels, cuts):
    """What ``nodes`` returns, for panels as ``_even`` gives them."""
    (amplitudes, orders), total = wave, len(panels)
    length, weight = np.empty((total, _STAGES)), np.empty((total, _STAGES))
    u, rate = np.empty((total, _STAGES)), np.empty((total, _STAGES))
    basis, slope = np.empty((total, _STAGES, len(amplitudes))), np.empty((total, _STAGES, len(amplitudes)))
    # the last row has room for an instant
    cosine, sine = turns[3][-1], turns[4][-1]
    for row in range(total):
        for s in range(_STAGES):
            share = cuts[row, 0] + POINTS[s] * cuts[row, 1]
            x, stretched = _instant(turns, widths, (panels[row, 0], panels[row, 1]), share)
            length[row, s] = stretched * cuts[row, 1]
            weight[row, s] = INTEGRALS[_STAGES - 1, s] * length[row, s]
            waves(x, len(cosine), cosine, sine)
            u[row, s], rate[row, s], _, _ = motion(amplitudes, orders, cosine, sine)
            for h in range(len(orders)):
                order = orders[h]
                basis[row, s, 2 * h], basis[row, s, 2 * h + 1] = cosine[order], sine[order]
                slope[row, s, 2 * h], slope[row, s, 2 * h + 1] = -order * sine[order], order * cosine[order]
    return length, weight, u, rate, basis, slope


@inner_with_arrays
def nodes(wave, turns, fine, reach, stribeck):
    """Panels over the first half of a period: at their points (panel, stage) the length of the panel there and the
    weight of the point, the displacement, its derivative, cos and sin of the orders and the derivatives of these.

    ``reach``: way to full slip; ``stribeck``: velocity over the angular frequency that matters besides.
    """
    widths, counts = _grading(wave, turns, fine, reach, stribeck)
    panels, cuts = _even(counts)
    return _filled(wave, turns, widths, panels, cuts)


@inner
def _integral(i, law, wave, turns, panel, cut, at):
    """Integral of the force over a panel; the displacement and the force at its begin and end are in ``at`` (2, 2).

    ``panel``: widths, stretch and half. ``cut``: share where it begins, its length.
    """
    (widths, m, side), (amplitudes, orders), (first, size) = panel, wave, cut
    groups, parameters, curves, exchange, states = law
    cosine, sine, total, place, force = turns[3][-1], turns[4][-1], 0.0, at[0, 0], at[0, 1]
    before, after = states[0], states[1]
    for s in range(_STAGES):
        x, stretched = _instant(turns, widths, (m, side), first + POINTS[s] * size)
        waves(x, orders[-1] + 1, cosine, sine)
        u = motion(amplitudes, orders, cosine, sine)[0]
        before[i, 0], exchange[WAY, i], place = force, u - place, u
        increments(groups[i, ADDRESS], groups[i], 0.0, (parameters, curves), exchange, (before, after))
        force = exchange[FORCE, i]
        total += INTEGRALS[_STAGES - 1, s] * stretched * size * force
    at[1, 0], at[1, 1] = place, force
    return total


@inner
def _slope(i, law, wave, turns, panel, share, begin):
    """Slope of the force at a share of half a stretch, reached at once from ``begin``: displacement and force."""
    (widths, m, side), (amplitudes, orders), cosine, sine = panel, wave, turns[3][-1], turns[4][-1]
    groups, parameters, curves, exchange, states = law
    x, _ = _instant(turns, widths, (m, side), share)
    waves(x, orders[-1] + 1, cosine, sine)
    states[0][i, 0] = begin[1]
    exchange[WAY, i] = motion(amplitudes, orders, cosine, sine)[0] - begin[0]
    increments(groups[i, ADDRESS], groups[i], 0.0, (parameters, curves), exchange, (states[0], states[1]))
    return exchange[SLOPE, i]


@inner
def _kink(i, law, wave, turns, panel, cut, begin):
    """Share at which the slope jumps, in a panel that begins at ``begin``; its middle where no jump is seen."""
    (low, size), k = cut, law[3][STIFFNESS, i]
    high = low + size
    below = _slope(i, law, wave, turns, panel, low + 1e-3 * size, begin)
    above = _slope(i, law, wave, turns, panel, high, begin)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        slope = _slope(i, law, wave, turns, panel, middle, begin)
        if abs(slope - below) > abs(above - slope):
            high, above = middle, slope
        else:
            low, below = middle, slope
    inside = cut[0] < low and high < cut[0] + size
    return high if inside and abs(above - below) > _JUMP * k else cut[0] + 0.5 * size


@inner_with_arrays
def _halved(i, law, wave, turns, plan, start):
    """Panels as ``_even`` gives them, cut where the force is not smooth; ``plan``: what ``_grading`` gives.

    ``start``: force at the last turning point, with which the cycle closes.
    """
    (widths, counts), (number, _, value, _, _), total = plan, turns, 0
    left = counts.sum()
    enough, room = _KINKED * np.pi * law[3][LIMIT, i], 4 * left + 200
    panels, cuts, at = np.empty((room, 2), np.int64), np.empty((room, 2)), np.empty((3, 2))
    later = np.empty((_HALVINGS + 2, 2))
    at[0, 0], at[0, 1] = value[number - 1], start
    for m in range(len(counts)):
        for side in range(2):
            panel = widths, m, side
            for n in range(counts[m, side]):
                later[0, 0], later[0, 1], waiting, left = n / counts[m, side], 1.0 / counts[m, side], 1, left - 1
                while waiting > 0:
                    first, size = later[waiting - 1, 0], later[waiting - 1, 1]
                    whole = _integral(i, law, wave, turns, panel, (first, size), at)
                    apart = _integral(i, law, wave, turns, panel, (first, 0.5 * size), at)
                    apart += _integral(i, law, wave, turns, panel, (first + 0.5 * size, 0.5 * size), at[1:])
                    spare = room - total - left - waiting
                    if abs(apart - whole) > enough and waiting <= _HALVINGS and spare > 1:
                        cut = _kink(i, law, wave, turns, panel, (first, size), at[0])
                        later[waiting - 1, 0], later[waiting - 1, 1] = cut, first + size - cut
                        later[waiting, 0], later[waiting, 1] = first, cut - first
                        waiting += 1
                        continue
                    panels[total, 0], panels[total, 1] = m, side
                    cuts[total, 0], cuts[total, 1] = first, size
                    at[0, 0], at[0, 1], total, waiting = at[2, 0], at[2, 1], total + 1, waiting - 1
    return panels[:total], cuts[:total]


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


@inner_with_arrays
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
    jacobian += scale * np.dot(basis.T, grown)


@compiled(error_model="numpy")
def smooth_period(i, law, wave, fine, turns, out):
    """Fourier coefficients (2 H,) of f - k u of one contact in its cycle, their Jacobian; returns the loss.

    ``law`` as ``ContactLaws.one_by_one`` gives it, with the slip forces in its table; ``fine`` is a factor on the
    number of nodes. The rest as in ``masing_period``.
    """
    orders, (number, _, value, cosine, sine), (forces, jacobian, derive) = wave[1], turns, out
    k, size, ends = law[3][STIFFNESS, i], len(forces), number // 2
    start_u, reach, start = value[number - 1], law[3][LIMIT, i] / k, 0.0
    widths, counts = _grading(wave, turns, fine, reach, np.inf)
    own = law[0][i, OWN] != 0
    if own:
        along = np.empty(ends), np.empty(ends), np.empty(ends)
        start = _settle(i, law, start_u, value[:ends], along)
        if _sticks(i, law, (start_u, start), value[:ends], along):
            return 0.0
        panels, cuts = _halved(i, law, wave, turns, (widths, counts), start)
    else:
        panels, cuts = _even(counts)
    _, weight, u, rate, basis, _ = _filled(wave, turns, widths, panels, cuts)
    count, first_basis = weight.size, np.empty(size)
    weight, u, rate, basis = weight.reshape(count), u.reshape(count), rate.reshape(count), basis.reshape(count, size)
    for h in range(size // 2):
        first_basis[2 * h], first_basis[2 * h + 1] = cosine[number - 1, orders[h]], sine[number - 1, orders[h]]
    force, a, b = np.empty(count), np.empty(count), np.empty(count)
    along = (force, a, b)
    if not own:
        start = _settle(i, law, start_u, u, along)
    _follow(i, law, start, start_u, u, along)
    scale, lost = 2.0 / np.pi, 0.0
    if derive:
        _differentiate((k, scale), first_basis, (weight, basis), (a, b), jacobian)
    for n in range(count):
        # a spring loses nothing: what is lost is the work of the deviation from it
        force[n] = weight[n] * (force[n] - k * u[n])
        lost += force[n] * rate[n]
        for r in range(size):
            forces[r] += scale * basis[n, r] * force[n]
    return 2.0 * lost


@inner
def _sticks(i, law, begin, value, out):
    """Whether a contact is a spring from turning point to turning point; ``begin``: displacement and force."""
    (place, before), k, limit = begin, law[3][STIFFNESS, i], law[3][LIMIT, i]
    _follow(i, law, before, place, value, out)
    for m in range(len(value)):
        elastic = before + k * (value[m] - place)
        if abs(out[0][m] - elastic) > _ELASTIC * limit or abs(out[2][m] - k) > _AS_STIFF * k:
            return False
        place, before = value[m], out[0][m]
    return True


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
