"""Compiled: what decays and steady states of one mode with a Masing spring let be read."""

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
def driven(ratios, losses, wanted, curve):
    """Place of the slip at which the power of a force is lost: index of the slip below and the share of the step.

    ``ratios`` (case, condition): stiffness of the joint over that of the sliding mode; ``losses`` (2, case): damping
    ratio without friction and loss factor of the stuck contacts; ``wanted`` (case, condition): force over what the slip
    at yield needs per damping. ``curve``: slips (slip,), and k' and k'' over k there. The lowest of several is taken.
    """
    slips, stiffness, loss = curve
    count = len(slips)
    stuck_rows = 0  # below yield the force is proportional to the slip
    while stuck_rows < count and slips[stuck_rows] <= 1:
        stuck_rows += 1
    found = np.empty(ratios.shape)
    for case in range(ratios.shape[0]):
        damping, stuck = losses[0, case], losses[1, case]
        for one in range(ratios.shape[1]):
            ratio, want = ratios[case, one], wanted[case, one]
            before, place, first = 0.0, float(count - 1), 0
            each = (2 * damping * np.sqrt(1 + ratio) + ratio * stuck) / ratio
            if stuck_rows and each * slips[stuck_rows - 1] < want:
                before, first = each * slips[stuck_rows - 1], stuck_rows
            for row in range(first, count):
                root = np.sqrt(1 + ratio * stiffness[row])
                # 2 zeta w^2 q = phi F with q = s x_c / psi and k psi^2 = ratio w_sliding^2
                need = (2 * damping * root + ratio * (loss[row] + stuck * stiffness[row])) * slips[row] / ratio
                if need >= want:
                    place = max(row - 1, 0) + ((want - before) / (need - before) if row else 0.0)
                    break
                before = max(before, need)
            found[case, one] = place
    return found
