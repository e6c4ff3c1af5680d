"""Contacts that depend on each other over one period: alternating between harmonics and samples; compiled.

The laws are followed through even samples from the unstressed state until the cycle closes, with their tangents.
"""

import numpy as np

from ema.compiled import compiled, inner_with_arrays
from ema.contact.call_kernels import BY_GAP, FORCE, PRESSURE, SLOPE, STIFFNESS, WAY
from ema.contact.cycle_kernels import cycle, gather, step


@inner_with_arrays
def normal_period(i, motion, wave, law, forces, jacobian, derive):
    """Deviation of one normal contact; returns its normal force and how that falls with the gap, (2, sample)."""
    basis, exchange, states = wave[0], law[3], law[4]
    depth, slope = np.empty((2, len(motion))), np.empty((len(motion), 1))
    states[:, i] = 0.0
    for n in range(len(motion)):
        exchange[WAY, i] = motion[n] - motion[n - 1] if n > 0 else motion[0]
        step(law, i, 0.0, states[1])
        states[0, i] = states[1, i]
        depth[0, n], depth[1, n] = exchange[PRESSURE, i], exchange[BY_GAP, i]
        slope[n] = exchange[SLOPE, i]
        gather(n, wave, exchange[FORCE, i] - exchange[STIFFNESS, i] * motion[n], forces)
    if derive:
        jacobian[:] = np.dot((basis * wave[1]).T, slope * basis)
    return depth


@compiled()
def joined_forces(amplitudes, wave, limits, law, ties, bounds, derive):
    """Deviations G (contact, 2 H), Jacobian (contact, 3, 2 H, 2 H), losses, who deviates, and extremes of the pressure.

    The members of the Jacobian are the own motion, that of the partner, and the gap. wave: orders, cos and sin (sample,
    2 H), periods at most, angular frequency. ``limits`` (friction contact, sample) are slip forces where no normal
    contact is followed. ties: partner, pressed_by and friction of ``Couplings``. bounds: number of internal forces of
    every contact, their shares of the slip force, whether the law approaches it smoothly, and whether it knows
    velocities. Extremes (normal, 4):
    least and greatest normal force, share of the period open, widest opening. Without ``derive`` the Jacobian is 0.
    """
    (orders, basis, periods, omega), (partner, pressed_by, friction), (widths, capacity, smooth, rates) = (
        wave,
        ties,
        bounds,
    )
    (contacts, size), samples, first = amplitudes.shape, basis.shape[0], len(limits)
    weights = np.full(size, 2.0 / samples)
    for c in range(size):
        if orders[c // 2] == 0:
            weights[c] = 1.0 / samples
    around = basis, weights, omega * samples / (2.0 * np.pi), periods
    forces, jacobian = np.zeros((contacts, size)), np.zeros((contacts if derive else 1, 3, size, size))
    lost, extremes = np.zeros(contacts), np.zeros((contacts - first, 4))
    motion = np.zeros((contacts, samples))
    for i in range(contacts):
        for n in range(samples):
            for c in range(size):
                motion[i, n] += amplitudes[i, c] * basis[n, c]
    depth = np.zeros((contacts - first, 2, samples))
    for n in range(contacts - first):
        i = first + n
        depth[n] = normal_period(i, motion[i], around, law, forces[i], jacobian[i if derive else 0, 0], derive)
        pressing = depth[n, 0]
        extremes[n, 0], extremes[n, 1], extremes[n, 3] = pressing.min(), pressing.max(), motion[i].max()
        extremes[n, 2] = (pressing <= 0.0).sum() / samples
    still = np.zeros(samples)
    for i in range(first):
        j, n = partner[i], pressed_by[i] - first
        if 0 <= j < i:
            continue
        slip = limits[i], still
        if n >= 0:
            slip = friction[i] * depth[n, 0], friction[i] * depth[n, 1]
        lanes = np.array([i, j]) if j >= 0 else np.array([i])
        paths = np.empty((len(lanes), samples))
        for o in range(len(lanes)):
            paths[o] = motion[lanes[o]]
        contact = lanes, paths, slip, (widths[i], capacity[i], smooth[i], rates[i])
        own, tangent, lost[i] = cycle(law, contact, around, derive)
        for o in range(len(lanes)):
            forces[lanes[o]] = own[o]
            if not derive:
                continue
            jacobian[lanes[o], 0], jacobian[lanes[o], 2] = tangent[o, o], tangent[o, len(lanes)]
            if len(lanes) == 2:
                jacobian[lanes[o], 1] = tangent[o, 1 - o]
    deviates = np.zeros(contacts, np.bool_)
    for i in range(contacts):
        deviates[i] = np.abs(forces[i]).max() > 1e-11 * law[3][STIFFNESS, i] * np.abs(motion[i]).max()
    return forces, jacobian, lost, deviates, extremes
