"""Compiled: what decays and steady states of one mode with a Masing spring let be read."""

import numpy as np

from ema.compiled import compiled


@compiled(error_model="numpy")
def explained(trials, start, decay, counts):
    """What exponentials of poles explain of all decays: 2 sigma sum_n |int z_n conj(e^pt) dt|^2 (case, trial).

    ``trials`` (case, trial) in rad/s. ``start``: cell (case, level) in which each decay begins, counted from the linear
    end, its share of that cell and its slip. ``decay``: pole [rad/s] and duration [s] of the cells (case, cell), and
    the pole ``linear`` (case,) behind them. ``counts`` (level,) decays each.
    """
    cells, shares, slips = start
    poles, durations, linear = decay
    count = poles.shape[1]
    after = np.empty(count + 1, np.complex128)
    found = np.empty(trials.shape)
    for case in range(trials.shape[0]):
        for trial in range(trials.shape[1]):
            conjugate = np.conj(trials[case, trial])
            # backwards from the linear end: what follows a node, for an amplitude of one there
            after[0] = -1 / (linear[case] + conjugate)
            for cell in range(count):
                rate = poles[case, cell] + conjugate
                whole = np.exp(rate * durations[case, cell])
                after[cell + 1] = (whole - 1) / rate + whole * after[cell]
            total = 0.0
            for level in range(len(counts)):
                cell = cells[case, level]
                rate = poles[case, cell] + conjugate
                part = np.exp(rate * (durations[case, cell] * shares[case, level]))
                value = (part - 1) / rate + part * after[cell]
                size = slips[case, level] ** 2
                total += counts[level] * size * (value.real**2 + value.imag**2)
            found[case, trial] = -2 * trials[case, trial].real * total
    return found


@compiled(error_model="numpy")
def driven(ratios, losses, wanted, curve):
    """Place of the slip at which the power of a force is lost: index of the slip below and the share of the step.

    ``ratios`` (case, condition): stiffness of the joint over that of the sliding mode; ``losses`` (2, case): damping
    ratio without friction and loss factor of the stuck contacts; ``wanted`` (case, condition): force over what the slip
    at yield needs per damping. ``curve``: slips (slip,), and k' and k'' over k there. The lowest of several is taken.
    """
    slips, stiffness, loss = curve
    count = len(slips)
    found = np.empty(ratios.shape)
    for case in range(ratios.shape[0]):
        damping, stuck = losses[0, case], losses[1, case]
        for one in range(ratios.shape[1]):
            ratio, want = ratios[case, one], wanted[case, one]
            before, place = 0.0, float(count - 1)
            for row in range(count):
                root = np.sqrt(1 + ratio * stiffness[row])
                # 2 zeta w^2 q = phi F with q = s x_c / psi and k psi^2 = ratio w_sliding^2
                need = (2 * damping * root + ratio * (loss[row] + stuck * stiffness[row])) * slips[row] / ratio
                if need >= want:
                    place = max(row - 1, 0) + ((want - before) / (need - before) if row else 0.0)
                    break
                before = max(before, need)
            found[case, one] = place
    return found
