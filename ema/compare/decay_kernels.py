"""Compiled: what decays and steady states of one mode with a friction joint let be read."""

import numpy as np

from ema.compiled import compiled


@compiled(error_model="numpy")
def explained(frequencies, rates, start, decay, counts):
    """What exponentials explain of all decays: 2 sigma sum_n |int z_n conj(e^pt) dt|^2 (case, frequency, rate).

    Trial poles p = -sigma + j omega have every one of the ``frequencies`` (case, frequency) with every one of the
    ``rates`` (case, rate), both in rad/s, so that few exponentials make all of theirs. ``start``: cell (case, level) in
    which each decay begins, counted from the linear end, its share of that cell and its slip. ``decay``: pole [rad/s]
    and duration [s] of the cells (case, cell), and the pole ``linear`` (case,) behind them. ``counts`` (level,) decays
    each.
    """
    cells, shares, slips = start
    poles, durations, linear = decay
    cases, columns, rows = frequencies.shape[0], frequencies.shape[1], rates.shape[1]
    after = np.empty((columns, rows, poles.shape[1] + 1), np.complex128)
    turns, falls = np.empty(columns, np.complex128), np.empty(rows)
    energy = np.zeros((cases, columns, rows))
    for case in range(cases):
        # backwards from the linear end: what follows a node, for an amplitude of one there
        for column in range(columns):
            for row in range(rows):
                rate = linear[case] + complex(-rates[case, row], -frequencies[case, column])
                after[column, row, 0] = -1 / rate
        top = 0
        for level in range(len(counts)):
            top = max(top, cells[case, level])
        for cell in range(top):
            _exponentials(poles[case, cell], durations[case, cell], frequencies[case], rates[case], turns, falls)
            for column in range(columns):
                for row in range(rows):
                    whole = falls[row] * turns[column]
                    piece = _integral(whole, poles[case, cell], frequencies[case, column], rates[case, row])
                    after[column, row, cell + 1] = piece + whole * after[column, row, cell]
        for level in range(len(counts)):
            cell = cells[case, level]
            lasts = durations[case, cell] * shares[case, level]
            _exponentials(poles[case, cell], lasts, frequencies[case], rates[case], turns, falls)
            worth = 2 * counts[level] * slips[case, level] ** 2
            for column in range(columns):
                for row in range(rows):
                    whole = falls[row] * turns[column]
                    piece = _integral(whole, poles[case, cell], frequencies[case, column], rates[case, row])
                    value = piece + whole * after[column, row, cell]
                    energy[case, column, row] += worth * rates[case, row] * (value.real**2 + value.imag**2)
    return energy


@compiled(error_model="numpy")
def _exponentials(pole, duration, frequencies, rates, turns, falls):
    """exp((pole + conj p) duration) of trial poles p: ``turns`` of their frequencies times ``falls`` of their rates."""
    for column in range(len(frequencies)):
        angle = (pole.imag - frequencies[column]) * duration
        turns[column] = complex(np.cos(angle), np.sin(angle))
    for row in range(len(rates)):
        falls[row] = np.exp((pole.real - rates[row]) * duration)


@compiled(error_model="numpy")
def _integral(whole, pole, frequency, rate):
    """The integral of exp((pole + conj p) t) up to where it is ``whole``: (whole - 1) / (pole + conj p)."""
    real, imaginary = pole.real - rate, pole.imag - frequency
    size = real * real + imaginary * imaginary
    return (whole - 1) * complex(real, -imaginary) / size


@compiled(error_model="numpy")
def driven(ratios, losses, wanted, laws, curve):
    """Stiffness and loss over k, each (case, condition), at the slip at which the power of a force is lost.

    ``ratios`` (case, condition): stiffness of the joint over that of the sliding mode; ``losses`` (2, case): damping
    ratio without friction and loss factor of the stuck contacts; ``wanted`` (case, condition): force over what the slip
    at yield needs per damping; ``laws`` (case,): rows of the loops. ``curve``: slips (slip,), and k' and k'' over k
    there, each (law, slip), with ``slips`` even in the logarithm. The lowest of several slips is taken; between those
    of the curve both are straight.
    """
    slips, stiffness, loss = curve
    count, step = len(slips), np.log(slips[1] / slips[0])
    most = np.zeros(len(loss))
    for law in range(len(loss)):
        most[law] = loss[law].max()
    found = np.empty((2, *ratios.shape))
    for case in range(ratios.shape[0]):
        damping, stuck, law = losses[0, case], losses[1, case], laws[case]
        for one in range(ratios.shape[1]):
            ratio, want = ratios[case, one], wanted[case, one]
            # 2 zeta w^2 q = phi F, q = s x_c / psi, k psi^2 = ratio w_sliding^2; over the slip, at most this
            highest = 2 * damping * np.sqrt(1 + ratio) / ratio + most[law] + stuck
            place = int(np.log(want / (highest * slips[0])) / step) if want > highest * slips[0] else 0
            before, below, share = 0.0, count - 2, 1.0
            for row in range(min(place, count - 1), count):
                root = np.sqrt(1 + ratio * stiffness[law, row])
                need = (2 * damping * root / ratio + loss[law, row] + stuck * stiffness[law, row]) * slips[row]
                if need >= want:
                    below = max(row - 1, 0)
                    share = (want - before) / (need - before) if row else 0.0
                    break
                before = need
            found[0, case, one] = stiffness[law, below] + share * (stiffness[law, below + 1] - stiffness[law, below])
            found[1, case, one] = loss[law, below] + share * (loss[law, below + 1] - loss[law, below])
    return found


@compiled(error_model="numpy")
def interpolated(table, laws, places):
    """Values (case, value) of a ``table`` (law, a, b, c, d, value) between its nodes, straight along every axis.

    ``laws`` (case,): rows of the first axis; ``places`` (case, 4): indices of the others with their fractions.
    """
    found = np.zeros((len(laws), table.shape[5]))
    below, share = np.empty(4, np.int64), np.empty(4)
    for case in range(len(laws)):
        for axis in range(4):
            last = table.shape[1 + axis] - 1
            place = min(max(places[case, axis], 0.0), float(last))
            below[axis] = min(int(place), last - 1)
            share[axis] = place - below[axis]
        for corner in range(16):
            weight = 1.0
            a, b = below[0] + (corner & 1), below[1] + (corner >> 1 & 1)
            c, d = below[2] + (corner >> 2 & 1), below[3] + (corner >> 3 & 1)
            for axis in range(4):
                weight *= share[axis] if corner >> axis & 1 else 1 - share[axis]
            for value in range(table.shape[5]):
                found[case, value] += weight * table[laws[case], a, b, c, d, value]
    return found
