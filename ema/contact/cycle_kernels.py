"""One contact followed through even samples of a motion until its cycle closes, with its tangents; compiled.

For friction in two directions and slip forces that change there is no closed form between turning points. A law is
called for a small change of every internal force, of the way and of the slip force besides: that gives its tangents,
whatever it is.
"""

import numpy as np

from ema.compiled import compiled, fast, inner
from ema.contact.call_kernels import ADDRESS, FORCE, LIMIT, STIFFNESS, WAY, WAY_BEFORE, increments

_NUDGE, _SETTLED, _LEAST = 1e-7, 1e-10, 1e-6
"""Changes over the slip force for differences: they keep half the digits, and Newton's method needs few. Change of the
states over a period below which the cycle is closed, alike. How far a period leaves nothing of what was before, below
which differences do not show it."""
LEARN, SETTLE, CLOSE, SUM = range(4)


@inner
def step(law, i, rate, after):
    """The increment of contact i."""
    groups, parameters, curves, exchange, states = law
    increments(groups[i, ADDRESS], groups[i], rate, (parameters, curves), exchange, (states[0], after))


@inner
def lag(way):
    """Weight of the old slip force in the one that stands for a step of a law that approaches it smoothly.

    To second order it solves f' = k |u'| (1 - f / F_C) for a slip force that changes evenly; ``way`` is k |du| / F_C.
    """
    if way < 1e-3:
        return 0.5 - way / 12.0
    return 1.0 / way - 1.0 / np.expm1(way) if way < 30.0 else 1.0 / way


@inner
def tangents(law, lanes, rate, capacity, changes, out):
    """How internal forces and force after a step change with what goes in.

    ``changes``: whether the slip force does, whether the law knows velocities, and room (state,). out: internal forces
    (state, lane, lane) by those before, which do not see each other; the same by the way; (state, lane) by the slip
    force; and what the force of a law that knows velocities has besides (4, lane, lane), by the internal force before,
    the way, the way before and the slip force. The step itself has been taken.
    """
    (by_state, by_way, by_limit, beside), (slides, rates, kept) = out, changes
    exchange, before, after, spare = law[3], law[4][0], law[4][1], law[4][2]
    first = lanes[0]
    k, limit = exchange[STIFFNESS, first], exchange[LIMIT, first]
    nudge, force = _NUDGE * max(limit, 1e-12 * k), (exchange[FORCE, first], exchange[FORCE, lanes[-1]])
    for d in range(len(lanes)):
        row = before[lanes[d]]
        for w in range(len(kept)):
            # inwards: beyond its slip force a law does something else
            share, kept[w] = capacity[w] if capacity[w] < np.inf else 1.0, row[w]
            row[w] += -nudge * share if row[w] > 0.0 else nudge * share
        step(law, first, rate, spare)
        for w in range(len(kept)):
            change, row[w] = row[w] - kept[w], kept[w]
            for o in range(len(lanes)):
                by_state[w, o, d] = (spare[lanes[o], w] - after[lanes[o], w]) / change if change != 0.0 else 0.0
            if rates and w == 0:
                for o in range(len(lanes)):
                    beside[0, o, d] = (exchange[FORCE, lanes[o]] - force[o]) / change - by_state[0, o, d]
        way = exchange[WAY, lanes[d]]
        exchange[WAY, lanes[d]] += nudge / k if way >= 0.0 else -nudge / k
        step(law, first, rate, spare)
        change, exchange[WAY, lanes[d]] = exchange[WAY, lanes[d]] - way, way
        for o in range(len(lanes)):
            for w in range(len(kept)):
                by_way[w, o, d] = (spare[lanes[o], w] - after[lanes[o], w]) / change
            beside[1, o, d] = (exchange[FORCE, lanes[o]] - force[o]) / change - by_way[0, o, d]
        if rates:
            ago = before[lanes[d], WAY_BEFORE]
            before[lanes[d], WAY_BEFORE] += nudge / k
            step(law, first, rate, spare)
            change, before[lanes[d], WAY_BEFORE] = before[lanes[d], WAY_BEFORE] - ago, ago
            for o in range(len(lanes)):
                beside[2, o, d] = (exchange[FORCE, lanes[o]] - force[o]) / change
    if slides:
        exchange[LIMIT, first] = limit + nudge
        step(law, first, rate, spare)
        exchange[LIMIT, first] = limit
        for w in range(len(kept)):
            for o in range(len(lanes)):
                by_limit[w, o] = (spare[lanes[o], w] - after[lanes[o], w]) / nudge
        for o in range(len(lanes)):
            beside[3, o, 0] = (exchange[FORCE, lanes[o]] - force[o]) / nudge - by_limit[0, o]


@inner
def surplus(beside, rows, tangent, slides, out):
    """Tangents (lane, member, 2 H) of what a force has besides its internal force, before that is carried on."""
    moved, opened, earlier = rows[0], rows[1], rows[3]
    lanes = tangent.shape[1]
    for o in range(lanes):
        for m in range(lanes + 1):
            for c in range(out.shape[2]):
                more = beside[1, o, m] * moved[c] + beside[2, o, m] * earlier[c] if m < lanes else 0.0
                if m == lanes and slides:
                    more = beside[3, o, 0] * opened[c]
                for d in range(lanes):
                    more += beside[0, o, d] * tangent[0, d, m, c]
                out[o, m, c] = more


@inner
def carry(out, moved, opened, slides, tangent):
    """Tangents (state, lane, member, 2 H) of the internal forces from sample to sample; the last member is the slip
    force, which changes by ``opened``."""
    by_state, by_way, by_limit = out[0], out[1], out[2]
    lanes = tangent.shape[1]
    for w in range(tangent.shape[0]):
        for m in range(lanes + 1):
            more, last = moved if m < lanes else opened, lanes - 1
            bx = by_way[w, 0, m] if m < lanes else (by_limit[w, 0] if slides else 0.0)
            if lanes == 1:
                scale(tangent[w, 0, m], by_state[w, 0, 0], bx, more)
            else:
                by = by_way[w, last, m] if m < lanes else (by_limit[w, last] if slides else 0.0)
                turn(tangent[w, 0, m], tangent[w, last, m], by_state[w], (bx, by), more)


@fast
def scale(x, a, b, more):
    """x = a x + b more"""
    for c in range(len(x)):
        x[c] = a * x[c] + b * more[c]


@fast
def turn(x, y, matrix, b, more):
    """(x, y) = matrix (x, y) + b more"""
    xx, xy, yx, yy = matrix[0, 0], matrix[0, 1], matrix[1, 0], matrix[1, 1]
    for c in range(len(x)):
        u, v = x[c], y[c]
        x[c], y[c] = xx * u + xy * v + b[0] * more[c], yx * u + yy * v + b[1] * more[c]


@inner
def hold(state, lanes, limit, capacity, grown, tangent):
    """Bring internal forces straight back below a slip force that fell, with their tangents.

    ``grown`` (2 H,): the tangent of the slip force. Returns the change of the force in the first and the last lane.
    """
    dx, dy, count = 0.0, 0.0, len(lanes)
    for w in range(tangent.shape[0]):
        x, y = state[lanes[0], w], state[lanes[1], w] if count == 2 else 0.0
        size, top = np.sqrt(x * x + y * y), limit * capacity[w]
        if size > top:
            x, y, share = x / size, y / size, top / size
            for m in range(count + 1):
                for c in range(tangent.shape[3]):
                    along = x * tangent[w, 0, m, c] + y * tangent[w, count - 1, m, c] * (count - 1)
                    more = capacity[w] * grown[c] if m == count else 0.0
                    for o in range(count):
                        n = x if o == 0 else y
                        tangent[w, o, m, c] = share * (tangent[w, o, m, c] - n * along) + n * more
            for o in range(count):
                n = x if o == 0 else y
                change, state[lanes[o], w] = n * top - state[lanes[o], w], n * top
                dx, dy = dx + (change if o == 0 else 0.0), dy + (change if o == count - 1 else 0.0)
    return dx, dy


@fast
def gather(n, wave, deviation, forces):
    """Add one sample to the Fourier coefficients (2 H,)."""
    basis, weights = wave[0], wave[1]
    for r in range(len(weights)):
        forces[r] += weights[r] * basis[n, r] * deviation


@inner
def owe(n, wave, contact, tangent, sums, derive):
    """Add sample n to the forces (lane, 2 H), once the cycle is closed, and keep what they change by there."""
    (k, displacement, force, aside), (forces, changes) = contact, sums
    basis, lanes = wave[0], tangent.shape[1]
    for o in range(lanes):
        gather(n, wave, force[o] - k * displacement[o, n], forces[o])
        for m in range(lanes + 1 if derive else 0):
            change = changes[o, m, n]
            for c in range(len(change)):
                change[c] = aside[o, m, c]
                if m == o:
                    change[c] -= k * basis[n, c]
                for w in range(tangent.shape[0]):
                    change[c] += tangent[w, o, m, c]


@inner
def close(begun, tangent):
    """Tangents at the begin of a cycle with which those at its end, reached from ``begun``, are the same.

    The last column of ``tangent`` says how what is there at the begin is carried on to the end, P: what is sought is
    begun + (I - P)^-1 (end - begun). Springs that stick have P = I, and keep what they have.
    """
    lanes, last = tangent.shape[1], tangent.shape[3] - 1
    for w in range(tangent.shape[0]):
        xx, yy = 1.0 - tangent[w, 0, 0, last], 1.0 - tangent[w, lanes - 1, lanes - 1, last]
        xy, yx = -tangent[w, 0, 1, last], -tangent[w, lanes - 1, 0, last]
        if lanes == 1:
            yy, xy, yx = 1.0, 0.0, 0.0
        whole = xx * yy - xy * yx
        for m in range(lanes + 1 if whole > _LEAST else 0):
            for c in range(last):
                x = tangent[w, 0, m, c] - begun[w, 0, m, c]
                y = tangent[w, lanes - 1, m, c] - begun[w, lanes - 1, m, c] if lanes == 2 else 0.0
                tangent[w, 0, m, c] = begun[w, 0, m, c] + (yy * x - xy * y) / whole
                if lanes == 2:
                    tangent[w, 1, m, c] = begun[w, 1, m, c] + (xx * y - yx * x) / whole


@compiled()
def cycle(law, contact, wave, derive):
    """Fourier coefficients (lane, 2 H) of f - k u of one contact, their Jacobian, and the loss per period.

    law: ``ContactLaws.one_by_one``. contact: its rows, motion (lane, sample), slip force (sample,) with its slope by
    the gap, and number of internal forces, their share of the slip force, whether the law approaches it smoothly, and
    whether it knows velocities. wave:
    cos and sin (sample, 2 H), weights (2 H,) of their integrals, 1/h, and periods at most. The Jacobian (lane, member,
    2 H, 2 H) is by the motion of the lanes, then by that of the gap. Without ``derive`` it is 0.

    The first period brings what springs keep that stick from then on; further ones close the cycle; one more closes the
    tangents, and the last one is summed.
    """
    (lanes, _, slip, (width, _, _, _)), periods, (samples, size) = contact, wave[3], wave[0].shape
    states, count, slides = law[4], len(lanes), bool(np.any(slip[1] != 0.0))
    forces, jacobian = np.zeros((count, size)), np.zeros((count, count + 1, size, size))
    changes = np.zeros((count, count + 1, samples if derive else 1, size))
    by, by_limit, beside = np.zeros((2, width, count, count)), np.zeros((width, count)), np.zeros((4, count, count))
    tangent, rows = np.zeros((width, count, count + 1, size + 1)), np.zeros((4, size + 1))
    begun, old, kept = tangent.copy(), np.zeros((count, width)), np.zeros(width)
    out, room = (by[0], by[1], by_limit, beside), (rows, kept, np.zeros((count, count + 1, size)))
    force, lost, stage = np.zeros(4), 0.0, LEARN
    now = forces, changes
    for o in range(count):
        states[:, lanes[o]] = 0.0
    for period in range(periods + 2):
        if stage == CLOSE:
            begun[:] = tangent
            tangent[:, :, :, size] = 0.0
            for o in range(count):
                tangent[:, o, o, size] = 1.0
        for o in range(count):
            old[o] = states[0, lanes[o], :width]
        for n in range(samples):
            ago = n - 1 if period + n > 0 else -samples
            place = n, ago, stage, slides, derive
            lost += follow(law, contact, wave, place, (out, room, tangent, force, now))
        if stage == SUM:
            break
        drift = 0.0
        for o in range(count):
            drift = max(drift, np.abs(states[0, lanes[o], :width] - old[o]).max())
        if stage == CLOSE:
            close(begun, tangent)
            stage = SUM
        elif period >= periods - 2 or (period > 0 and drift <= _SETTLED * slip[0].max()):
            stage = CLOSE if derive else SUM
        else:
            stage = SETTLE
    if derive:
        lever = wave[0] * wave[1]
        for o in range(count):
            for m in range(count + 1):
                jacobian[o, m] = np.dot(lever.T, changes[o, m])
    return forces, jacobian, lost


@inner
def follow(law, contact, wave, place, books):
    """One sample; returns what is lost, in the period that is summed.

    place: sample, that before, which is before the first one where nothing has moved, stage, whether the slip force
    follows a gap, and whether tangents are asked for. books: tangents of the step, room, tangents of the internal
    forces, forces now and before, sums.
    """
    (basis, _, rate, _), (lanes, motion, (limit, fall), (_, capacity, smooth, rates)) = wave, contact
    (n, ago, stage, slides, derive), (out, (rows, kept, aside), tangent, force, sums) = place, books
    exchange, states, moved, opened, grown = law[3], law[4], rows[0], rows[1], rows[2]
    k, square, begun, lost = exchange[STIFFNESS, lanes[0]], 0.0, ago > -len(limit), 0.0
    before = ago if begun else n
    for o in range(len(lanes)):
        exchange[WAY, lanes[o]] = motion[o, n] - (motion[o, before] if begun else 0.0)
        square += exchange[WAY, lanes[o]] ** 2
    weight = 0.0
    if smooth and limit[n] != limit[before]:
        weight = lag(k * np.sqrt(square) / max(limit[n], 1e-30))
    exchange[LIMIT, lanes[0]] = (1.0 - weight) * limit[n] + weight * limit[before]
    step(law, lanes[0], rate, states[1])
    force[2], force[3] = force[0], force[1]
    force[0], force[1] = exchange[FORCE, lanes[0]], exchange[FORCE, lanes[-1]]
    if derive and stage != SETTLE:
        for c in range(basis.shape[1]):
            rows[3, c] = moved[c]
            moved[c] = basis[n, c] - (basis[before, c] if begun else 0.0)
            grown[c] = fall[n] * basis[n, c]
            opened[c] = (1.0 - weight) * grown[c] + weight * fall[before] * basis[before, c]
        tangents(law, lanes, rate, capacity, (slides, rates, kept), out)
        if rates:
            surplus(out[3], rows, tangent, slides, aside)
        carry(out, moved, opened, slides, tangent)
    dx, dy = hold(states[1], lanes, limit[n], capacity, grown, tangent)
    force[0], force[1] = force[0] + dx, force[1] + dy
    if stage == SUM:
        for o in range(len(lanes)):
            lost += 0.5 * (force[o] + force[2 + o]) * exchange[WAY, lanes[o]]
        owe(n, wave, (k, motion, force, aside), tangent, sums, derive)
    for o in range(len(lanes)):
        for w in range(states.shape[2]):
            states[0, lanes[o], w] = states[1, lanes[o], w]
    return lost
