"""Friction over one period of a motion given by its harmonics: exact for Masing springs; compiled.

A motion u(x) = sum_h a_h cos(h x) + b_h sin(h x), x = w t, of odd orders h is monotone between its turning points, and
half a period later it is the opposite: its first half is integrated. A Masing spring moves through these stretches one
by one: it is stuck, then slides from a place that is found, to the end of one. So the Fourier integrals of its force,
their derivatives and its loss are sums of closed forms, without samples.

``wave``: amplitudes (2 H,) and orders; ``here``: cos(n x) and sin(n x) of an instant; ``turns``: number, places,
displacements, cos(n x) and sin(n x) of the turning points, with room for more.
"""

import numpy as np

from ema.compiled import compiled, fast, inner
from ema.contact.linear_kernels import copy_into

_CLOSE = 1e-7
"""Change of a place, in rad, below which it is found: what it is needed for is of second order in its error."""


@fast
def waves(x, count, cosine, sine):
    """cos(n x) and sin(n x) for n = 0 ... count - 1, eight at a time."""
    c, s = np.cos(x), np.sin(x)
    cosine[0], sine[0] = 1.0, 0.0
    for n in range(1, min(count, 8)):
        cosine[n] = cosine[n - 1] * c - sine[n - 1] * s
        sine[n] = sine[n - 1] * c + cosine[n - 1] * s
    if count > 8:
        c, s = np.cos(8 * x), np.sin(8 * x)
        for n in range(8, count):
            cosine[n] = cosine[n - 8] * c - sine[n - 8] * s
            sine[n] = sine[n - 8] * c + cosine[n - 8] * s


@fast
def motion(amplitudes, orders, cosine, sine):
    """Return displacement and its first three derivatives at an instant.

    ``amplitudes`` (2 H,) are those of the harmonics ``orders`` (H,); ``cosine`` and ``sine`` (n,) are cos(n x) and
    sin(n x) of the instant, as ``waves`` fills them.
    """
    u, du, ddu, dddu = 0.0, 0.0, 0.0, 0.0
    for h in range(len(orders)):
        n = 2 * h + 1  # = orders[h]; known so, the compiler reads several at a time
        a, b = amplitudes[2 * h], amplitudes[2 * h + 1]
        value, rate = a * cosine[n] + b * sine[n], n * (b * cosine[n] - a * sine[n])
        u += value
        du += rate
        ddu -= n * n * value
        dddu -= n * n * rate
    return u, du, ddu, dddu


@inner
def _next_place(x, value, slope, low, high, before):
    """Newton's next place, or the middle where it leaves the bracket or moves by more than half the step ``before``.

    Without the second condition steps over a wave can go to and fro for ever. Returns the place and the step.
    """
    new = x - value / slope if slope != 0.0 else low - 1.0
    if not low <= new <= high or abs(new - x) > 0.5 * before:
        new = 0.5 * (low + high)
    return new, abs(new - x)


@inner
def seek(wave, derivative, target, x, bracket, here):
    """Where the motion, or its first or second ``derivative``, passes ``target``; leaves its waves behind.

    ``x`` is a guess; ``bracket``: a stretch in which that happens once, and whether upwards. What the place is needed
    for is of second order in its error.
    """
    (amplitudes, orders), (low, high, rising), (cosine, sine) = wave, bracket, here
    need, change = orders[-1] + 1, 2.0 * (high - low)
    for _ in range(60):
        waves(x, need, cosine, sine)
        parts = motion(amplitudes, orders, cosine, sine)
        value = parts[derivative] - target
        if (value > 0.0) != rising:
            low = x
        else:
            high = x
        x, change = _next_place(x, value, parts[derivative + 1], low, high, change)
        if change < _CLOSE or high - low < _CLOSE:
            break
    waves(x, len(cosine), cosine, sine)
    return x


@inner
def turning_points(wave, samples, room):
    """Turning points of a motion in ascending order: places x, displacements and waves go to ``room``; returns how
    many there are.

    ``samples`` of the first and second derivative over half a period, ends included, say where to look: where the rate
    changes its sign, and where it comes close to zero in between. The motion turns half a period later at the opposite
    place: the second half is mirrored.
    """
    (amplitudes, orders), (rates, bends), (place, value, cosine, sine) = wave, samples, room
    highest, end = cosine.shape[1], len(rates) - 1
    length, found, most = np.pi / end, 0, len(place) // 2 - 2
    for n in range(end):
        after, low, high = n + 1, n * length, (n + 1) * length
        up, up_after, bent, bent_after = rates[n] > 0.0, rates[after] > 0.0, bends[n] > 0.0, bends[after] > 0.0
        if after == end:
            # the opposite of the begin, whatever rounding says
            up_after, bent_after = not rates[0] > 0.0, not bends[0] > 0.0
        middle, up_middle = low, up
        if up == up_after:
            if bent == bent_after or up == bent:
                continue
            middle = low + length * bends[n] / (bends[n] - bends[after])
            middle = seek(wave, 2, 0.0, middle, (low, high, not bent), (cosine[found], sine[found]))
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
            place[found] = seek(wave, 1, 0.0, x, (left, right, rising), (cosine[found], sine[found]))
            value[found], _, _, _ = motion(amplitudes, orders, cosine[found], sine[found])
            found += 1
    for m in range(found):
        place[found + m], value[found + m] = place[m] + np.pi, -value[m]
        for n in range(highest):
            sign = 1.0 if n % 2 == 0 else -1.0
            cosine[found + m, n], sine[found + m, n] = sign * cosine[m, n], sign * sine[m, n]
    return 2 * found


@inner
def crossing(wave, target, start, end, here):
    """Place in a monotone stretch at which the motion reaches ``target``; leaves its waves behind.

    ``start``, ``end``: place and displacement.
    """
    (low, u_low), (high, u_high) = start, end
    share = (target - u_low) / (u_high - u_low)
    # between two turning points a motion is close to half a cosine
    x = low + (high - low) * np.arccos(min(max(1.0 - 2.0 * share, -1.0), 1.0)) / np.pi
    return seek(wave, 0, target, x, (low, high, u_high > u_low), here)


@fast
def _add_stretch(start, end, orders, weight, out):
    """Add ``weight`` times the integrals of cos(h x) and sin(h x) over a stretch for the orders h.

    ``start``, ``end``: place and waves.
    """
    (_, from_c, from_s), (_, to_c, to_s) = start, end
    for h in range(len(orders)):
        n = orders[h]
        out[2 * h] += weight * (to_s[n] - from_s[n]) / n
        out[2 * h + 1] -= weight * (to_c[n] - from_c[n]) / n


@fast
def _forces(moments, constant, amplitudes, room, forces):
    """Fourier coefficients (2 H,) of f - k u from the moments of the sliding stretches, and of the rest of the force.

    ``moments`` of cos(2 q x) at 2 q and of sin(2 q x) behind it; they go to ``room`` as even and odd functions of q,
    which begin at q = -H.
    """
    (even, odd), half, scale = room, len(amplitudes) // 2, 2.0 / np.pi
    for q in range(2 * half):
        even[half + q], odd[half + q] = 0.5 * scale * moments[2 * q], 0.5 * scale * moments[2 * q + 1]
    for q in range(1, half + 1):
        even[half - q], odd[half - q] = even[half + q], -odd[half + q]
    for i in range(half):
        above, below = scale * constant[2 * i], scale * constant[2 * i + 1]
        for j in range(half):
            apart, total, x, y = half + i - j, half + i + j + 1, amplitudes[2 * j], amplitudes[2 * j + 1]
            above -= (even[apart] + even[total]) * x + (odd[total] - odd[apart]) * y
            below -= (odd[total] + odd[apart]) * x + (even[apart] - even[total]) * y
        forces[2 * i], forces[2 * i + 1] = above, below


@fast
def _derivatives(room, memory, orders, turns, jacobian):
    """Their derivatives by the amplitudes: of sliding stretches, and what stuck ones owe to the turning points at which
    they began, with ``memory`` (turn, 2 H); ``room`` as ``_forces`` leaves it."""
    (even, odd), half, (number, _, _, cosine, sine) = room, len(orders), turns
    for i in range(half):
        above, below = jacobian[2 * i], jacobian[2 * i + 1]
        for j in range(half):
            apart, total = half + i - j, half + i + j + 1
            above[2 * j], above[2 * j + 1] = -even[apart] - even[total], odd[apart] - odd[total]
            below[2 * j], below[2 * j + 1] = -odd[total] - odd[apart], even[total] - even[apart]
    for m in range(number):
        owed = 0.0
        for r in range(2 * half):
            owed += abs(memory[m, r])
        if owed == 0.0:
            continue
        for h in range(half):
            even[2 * h], even[2 * h + 1] = cosine[m, orders[h]], sine[m, orders[h]]
        for r in range(2 * half):
            weight, row = -2.0 / np.pi * memory[m, r], jacobian[r]
            for c in range(2 * half):
                row[c] += weight * even[c]


@inner
def _follow(spring, wave, turns, sums):
    """Follow one spring, unstressed at first, over half a period; returns its loss.

    ``spring``: stiffness and slip force. ``sums``: what stuck stretches owe to turning points, constant part of the
    integrals, moments of the sliding ones and their even orders, waves of an instant, and room.
    """
    (k, top), (number, place, value, cosine, sine) = spring, turns
    (memory, constant, moments, evens, here, before), orders, lost = sums, wave[1], 0.0
    reach, rest, last = top / k, 0.0, -1
    for m in range(number):
        if abs(value[m] - rest) > reach:
            rest, last = value[m] - (reach if value[m] > rest else -reach), m
    for m in range(number // 2):
        begun = m - 1 if m > 0 else number - 1
        x = place[begun] if m > 0 else place[begun] - 2 * np.pi
        start, end = (x, cosine[begun], sine[begun]), (place[m], cosine[m], sine[m])
        slides, sign, target = abs(value[m] - rest) > reach, 1.0 if value[m] > rest else -1.0, value[begun]
        if not slides:
            leave = end
        elif (rest + sign * reach - value[begun]) * sign > 0.0:
            target = rest + sign * reach
            x = crossing(wave, target, (x, value[begun]), (place[m], value[m]), here)
            leave = x, here[0], here[1]
        else:
            leave = start
        if slides:
            _add_stretch(leave, end, orders, sign * top, constant)
            moments[0] += k * (end[0] - leave[0])
            _add_stretch(leave, end, evens, k, moments[2:])
            lost += top * abs(value[m] - target)
        if last >= 0:
            held = memory[last]
            copy_into(before, held)
            _add_stretch(start, leave, orders, k, held)
            for r in range(len(held)):
                constant[r] -= rest * (held[r] - before[r])
        if slides:
            rest, last = value[m] - sign * reach, m
    return lost


@compiled(error_model="numpy")
def masing_period(law, wave, turns, out):
    """Fourier coefficients (2 H,) of f - k u of parallel Masing springs, their Jacobian; returns the loss.

    law: stiffness, slip force, number of springs and their shares of both. out: both results, and whether the Jacobian
    is asked for. The springs start unstressed and settle during one period.
    """
    (stiffness, limit, count, shares_k, shares_f), (amplitudes, orders), (forces, jacobian, derive) = law, wave, out
    size, highest, lost = len(amplitudes), turns[3].shape[1], 0.0
    memory, moments, evens = np.zeros((turns[0], size)), np.zeros(highest + 1), np.arange(2, highest, 2)
    constant, before, here = np.zeros(size), np.empty(size), (np.empty(highest), np.empty(highest))
    for j in range(count):
        spring = stiffness * shares_k[j], limit * shares_f[j]
        lost += _follow(spring, wave, turns, (memory, constant, moments, evens, here, before))
    room = np.empty(3 * size // 2), np.empty(3 * size // 2)
    _forces(moments, constant, amplitudes, room, forces)
    if derive:
        _derivatives(room, memory, orders, turns, jacobian)
    return 2.0 * lost
