"""Friction over one period of a motion given by its harmonics: exact for Masing springs; compiled.

A motion u(x) = sum_h a_h cos(h x) + b_h sin(h x), x = w t, is monotone between its turning points. A Masing spring
moves through these stretches one by one: it is stuck, then slides from a place that is found, to the end of one.
So the Fourier integrals of its force, their derivatives and its loss are sums of closed forms, without samples.
"""

import numpy as np

from ema.compiled import compiled
from ema.contact.linear_kernels import copy_into

_CLOSE = 1e-7


@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def waves(x, count, cosine, sine):
    """cos(n x) and sin(n x) for n = 0 ... count - 1."""
    c, s = np.cos(x), np.sin(x)
    cosine[0], sine[0] = 1.0, 0.0
    for n in range(1, count):
        cosine[n] = cosine[n - 1] * c - sine[n - 1] * s
        sine[n] = sine[n - 1] * c + cosine[n - 1] * s


@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def motion(amplitudes, orders, cosine, sine):
    """Displacement and its first three derivatives from the waves at an instant."""
    u, du, ddu, dddu = 0.0, 0.0, 0.0, 0.0
    for h in range(len(orders)):
        n = orders[h]
        a, b = amplitudes[2 * h], amplitudes[2 * h + 1]
        value, rate = a * cosine[n] + b * sine[n], n * (b * cosine[n] - a * sine[n])
        u += value
        du += rate
        ddu -= n * n * value
        dddu -= n * n * rate
    return u, du, ddu, dddu


@compiled(error_model="numpy")
def _next_place(x, value, slope, low, high, before):
    """Newton's next place, or the middle where it leaves the bracket or moves by more than half the step ``before``.

    Without the second condition steps over a wave can go to and fro for ever. Returns the place and the step.
    """
    new = x - value / slope if slope != 0.0 else low - 1.0
    if not low <= new <= high or abs(new - x) > 0.5 * before:
        new = 0.5 * (low + high)
    return new, abs(new - x)


@compiled(error_model="numpy")
def _root(amplitudes, orders, second, x, low, high, rising, cosine, sine):
    """Zero of the first (or ``second``) derivative in a stretch where it changes its sign; leaves its waves behind.

    ``x`` is a guess; the derivative grows through the zero if ``rising``. What the zero is needed for is of second
    order in its error.
    """
    need, change = orders[-1] + 1, 2.0 * (high - low)
    for _ in range(60):
        waves(x, need, cosine, sine)
        _, du, ddu, dddu = motion(amplitudes, orders, cosine, sine)
        value, slope = (ddu, dddu) if second else (du, ddu)
        if (value > 0.0) != rising:
            low = x
        else:
            high = x
        x, change = _next_place(x, value, slope, low, high, change)
        if change < _CLOSE or high - low < _CLOSE:
            break
    waves(x, len(cosine), cosine, sine)
    return x


@compiled(error_model="numpy")
def turning_points(amplitudes, orders, rates, bends, odd, place, value, cosine, sine):
    """Turning points of a motion in ascending order: their ``place`` x, ``value`` u and waves; returns their number.

    Samples of the first and second derivative over the whole period, ``rates`` and ``bends`` (sample,), say where to
    look: where the rate changes its sign, and where it comes close to zero in between. An odd motion turns half a
    period later at the opposite place: its second half is mirrored.
    """
    count, highest = len(rates), cosine.shape[1]
    length, end = 2 * np.pi / count, count // 2 if odd else count
    found, most = 0, len(place) // 2 - 2
    for n in range(end):
        after = n + 1 if n + 1 < count else 0
        low, high = n * length, (n + 1) * length
        up, up_after, bent, bent_after = rates[n] > 0.0, rates[after] > 0.0, bends[n] > 0.0, bends[after] > 0.0
        if odd and after == end:
            # the opposite of the begin, whatever rounding says
            up_after, bent_after = not rates[0] > 0.0, not bends[0] > 0.0
        middle, up_middle = low, up
        if up == up_after:
            if bent == bent_after or up == bent:
                continue
            middle = low + length * bends[n] / (bends[n] - bends[after])
            middle = _root(amplitudes, orders, True, middle, low, high, not bent, cosine[found], sine[found])
            _, between, _, _ = motion(amplitudes, orders, cosine[found], sine[found])
            up_middle = between > 0.0
            if up_middle == up:
                continue
        for half in range(2):
            left, right, rising = (low, middle, not up) if half == 0 else (middle, high, not up_middle)
            if right <= left or found >= most:
                continue
            x = 0.5 * (left + right)
            if middle == low and rates[n] * rates[after] < 0.0:
                x = low + length * rates[n] / (rates[n] - rates[after])
            place[found] = _root(amplitudes, orders, False, x, left, right, rising, cosine[found], sine[found])
            value[found], _, _, _ = motion(amplitudes, orders, cosine[found], sine[found])
            found += 1
    if odd:
        for m in range(found):
            place[found + m], value[found + m] = place[m] + np.pi, -value[m]
            for n in range(highest):
                sign = 1.0 if n % 2 == 0 else -1.0
                cosine[found + m, n], sine[found + m, n] = sign * cosine[m, n], sign * sine[m, n]
        found *= 2
    return found


@compiled(error_model="numpy")
def crossing(amplitudes, orders, target, low, high, u_low, u_high, cosine, sine):
    """Place in a monotone stretch at which the motion reaches ``target``; leaves its waves behind."""
    left, right = low, high
    share = (target - u_low) / (u_high - u_low)
    # between two turning points a motion is close to half a cosine
    x = low + (high - low) * np.arccos(min(max(1.0 - 2.0 * share, -1.0), 1.0)) / np.pi
    rising = u_high > u_low
    need, change = orders[-1] + 1, 2.0 * (high - low)
    for _ in range(60):
        waves(x, need, cosine, sine)
        u, du, _, _ = motion(amplitudes, orders, cosine, sine)
        rest = u - target
        if (rest > 0.0) == rising:
            right = x
        else:
            left = x
        x, change = _next_place(x, rest, du, left, right, change)
        if change < _CLOSE or right - left < _CLOSE:
            break
    waves(x, len(cosine), cosine, sine)
    return x


@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _add_stretch(from_x, from_c, from_s, to_x, to_c, to_s, orders, weight, out):
    """Add ``weight`` times the integrals of cos(h x) and sin(h x) over a stretch for the orders h."""
    for h in range(len(orders)):
        n = orders[h]
        if n == 0:
            out[2 * h] += weight * (to_x - from_x)
        else:
            out[2 * h] += weight * (to_s[n] - from_s[n]) / n
            out[2 * h + 1] -= weight * (to_c[n] - from_c[n]) / n


@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _add_moments(from_x, from_c, from_s, to_x, to_c, to_s, weight, even_only, cosine, sine):
    """Add ``weight`` times the integrals of cos(n x) and sin(n x) over a stretch for all n."""
    cosine[0] += weight * (to_x - from_x)
    step = 2 if even_only else 1
    for n in range(step, len(cosine), step):
        cosine[n] += weight * (to_s[n] - from_s[n]) / n
        sine[n] -= weight * (to_c[n] - from_c[n]) / n


@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _products(orders, cosine, sine, out):
    """Integrals of all products of cos(h x), sin(h x) from the moments of cos(n x) and sin(n x)."""
    for i in range(len(orders)):
        for j in range(i + 1):
            a, b = orders[i], orders[j]
            total, apart = a + b, abs(a - b)
            sign = 1.0 if a >= b else -1.0
            cc = 0.5 * (cosine[apart] + cosine[total])
            ss = 0.5 * (cosine[apart] - cosine[total])
            cs = 0.5 * (sine[total] - sign * sine[apart])
            sc = 0.5 * (sine[total] + sign * sine[apart])
            r, c = 2 * i, 2 * j
            out[r, c], out[c, r] = cc, cc
            out[r + 1, c + 1], out[c + 1, r + 1] = ss, ss
            out[r, c + 1], out[c + 1, r] = cs, cs
            out[r + 1, c], out[c, r + 1] = sc, sc


@compiled(error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _add_memory(memory, turns, orders, cosine, sine, jacobian):
    """Add what stuck stretches owe to the turning points at which they began, with ``memory`` (turn, 2 H)."""
    size = memory.shape[1]
    for m in range(turns + 1):
        for r in range(size):
            weight = memory[m, r]
            if weight == 0.0:
                continue
            if m == turns:
                jacobian[r, 0] += weight
                continue
            for h in range(size // 2):
                jacobian[r, 2 * h] += weight * cosine[m, orders[h]]
                jacobian[r, 2 * h + 1] += weight * sine[m, orders[h]]


@compiled(error_model="numpy")
def masing_period(
    amplitudes,
    orders,
    rates,
    bends,
    odd,
    stiffness,
    limit,
    shares_k,
    shares_f,
    count,
    place,
    value,
    cosine,
    sine,
    forces,
    jacobian,
    derive,
):
    """Fourier coefficients ``forces`` (2 H,) of f - k u of parallel Masing springs, their Jacobian; returns the loss.

    Without ``derive`` the Jacobian is not made: its place is then workspace.
    The springs start unstressed and settle during one period. Order 0 has its mean in the first of its two places.
    The last arguments up to ``sine`` are workspace, with room for all turning points and twice the highest order.
    """
    size, highest = len(amplitudes), cosine.shape[1]
    for r in range(size):
        forces[r] = 0.0
        for c in range(size):
            jacobian[r, c] = 0.0
    turns = turning_points(amplitudes, orders, rates, bends, odd, place, value, cosine, sine)
    if turns < 2:
        return 0.0
    mean = amplitudes[0] if orders[0] == 0 else 0.0
    memory = np.zeros((turns + 1, size))
    cos_moments, sin_moments = np.zeros(highest), np.zeros(highest)
    constant, before = np.zeros(size), np.empty(size)
    cos_here, sin_here = np.empty(highest), np.empty(highest)
    lost = 0.0
    ends = turns // 2 if odd else turns
    for j in range(count):
        k, top = stiffness * shares_k[j], limit * shares_f[j]
        reach = top / k
        rest, last = min(max(0.0, mean - reach), mean + reach), turns
        if rest == 0.0:
            last = -1
        for m in range(turns):
            if abs(value[m] - rest) > reach:
                rest, last = value[m] - (reach if value[m] > rest else -reach), m
        for m in range(ends):
            start = m - 1 if m > 0 else turns - 1
            from_x = place[start] if m > 0 else place[start] - 2 * np.pi
            slides = abs(value[m] - rest) > reach
            if slides:
                sign = 1.0 if value[m] > rest else -1.0
                target = rest + sign * reach
                if (target - value[start]) * sign > 0.0:
                    x = crossing(
                        amplitudes, orders, target, from_x, place[m], value[start], value[m], cos_here, sin_here
                    )
                else:
                    x, target = from_x, value[start]
                    copy_into(cos_here, cosine[start])
                    copy_into(sin_here, sine[start])
                _add_stretch(x, cos_here, sin_here, place[m], cosine[m], sine[m], orders, sign * top, constant)
                _add_moments(x, cos_here, sin_here, place[m], cosine[m], sine[m], k, odd, cos_moments, sin_moments)
                lost += top * abs(value[m] - target)
            else:
                x = place[m]
                copy_into(cos_here, cosine[m])
                copy_into(sin_here, sine[m])
            if last >= 0:
                held = memory[last]
                copy_into(before, held)
                _add_stretch(from_x, cosine[start], sine[start], x, cos_here, sin_here, orders, k, held)
                for r in range(size):
                    constant[r] -= rest * (held[r] - before[r])
            if slides:
                rest, last = value[m] - sign * reach, m
    _products(orders, cos_moments, sin_moments, jacobian)
    scale = (2.0 if odd else 1.0) / np.pi
    for r in range(size):
        total = constant[r]
        for c in range(size):
            total -= jacobian[r, c] * amplitudes[c]
        forces[r] = scale * total
    if derive:
        _add_memory(memory, turns, orders, cosine, sine, jacobian)
        for r in range(size):
            for c in range(size):
                jacobian[r, c] *= -scale
    if orders[0] == 0:
        forces[0] *= 0.5
        for c in range(size):
            jacobian[0, c] *= 0.5
    return lost * (2.0 if odd else 1.0)
