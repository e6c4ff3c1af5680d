"""Compiled search for the next change of stick and slip along an exact modal motion."""

import numba as nb
import numpy as np


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def motion(wave, rate, mean, tide, pulse, t):
    """Modal displacements and velocities (2, mode) at time t after the start of a phase.

    eta = mean + Re(wave exp(rate t)) + Re(tide exp(j pulse t)).
    """
    out = np.empty((2, len(wave)))
    forced = np.exp(1j * pulse * t)
    for r in range(len(wave)):
        free = wave[r] * np.exp(rate[r] * t)
        drive = tide[r] * forced
        out[0, r] = mean[r] + free.real + drive.real
        out[1, r] = (rate[r] * free).real - pulse * drive.imag
    return out


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def contact_motion(row, wave, rate, mean, tide, pulse, t):
    """Relative displacement and velocity of one contact at time t."""
    state = motion(wave, rate, mean, tide, pulse, t)
    u, v = 0.0, 0.0
    for r in range(len(row)):
        u += row[r] * state[0, r]
        v += row[r] * state[1, r]
    return u, v


@nb.njit(cache=True)
def excess(slide, k, limit, rest, u, v, blur, still):
    """Positive once a spring has to change: a stuck one above its limit, a sliding one whose velocity reverses.

    Displacements below ``blur`` and velocities below ``still`` are rounding.
    """
    if slide == 0:
        return k * (abs(u - rest) - blur) - limit
    return -slide * v - still


@nb.njit(cache=True)
def crossing(row, wave, rate, mean, tide, pulse, slide, k, limit, rest, blur, still, low, high, start, end):
    """Time in (low, high) at which a spring changes, by the Illinois form of false position on the exact motion."""
    if start >= 0.0:
        return low
    for _ in range(60):
        middle = (low * end - high * start) / (end - start)
        if not low < middle < high:
            middle = 0.5 * (low + high)
        u, v = contact_motion(row, wave, rate, mean, tide, pulse, middle)
        value = excess(slide, k, limit, rest, u, v, blur, still)
        if value > 0.0:
            high, end = middle, value
            start *= 0.5
        else:
            low, start = middle, value
            end *= 0.5
        if high - low <= 1e-15 + 1e-13 * high:
            break
    return high


@nb.njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def next_event(slip, wave, rate, mean, tide, pulse, contact, slide, k, limit, rest, horizon, spacing, blur, still):
    """First time up to ``horizon`` at which a spring sticks or slips, and that spring (-1: none)."""
    contacts, modes = slip.shape
    steps = max(int(np.ceil(horizon / spacing)), 1)
    dt = horizon / steps
    now, turn = wave.copy(), np.exp(rate * dt)
    forced, forced_turn = 1.0 + 0.0j, np.exp(1j * pulse * dt)
    u, v = np.zeros(contacts), np.zeros(contacts)
    q, p = np.empty(modes), np.empty(modes)
    before, after = np.empty(len(k)), np.empty(len(k))
    for n in range(steps + 1):
        if n > 0:
            for r in range(modes):
                now[r] *= turn[r]
            forced *= forced_turn
        for r in range(modes):
            drive = tide[r] * forced
            q[r] = mean[r] + now[r].real + drive.real
            p[r] = (rate[r] * now[r]).real - pulse * drive.imag
        for i in range(contacts):
            a, b = 0.0, 0.0
            for r in range(modes):
                a += slip[i, r] * q[r]
                b += slip[i, r] * p[r]
            u[i], v[i] = a, b
        found, when = -1, horizon + 1.0
        for j in range(len(k)):
            i = contact[j]
            after[j] = excess(slide[j], k[j], limit[j], rest[j], u[i], v[i], blur, still)
            if n > 0 and after[j] > 0.0:
                at = crossing(
                    slip[i], wave, rate, mean, tide, pulse, slide[j], k[j], limit[j], rest[j], blur, still,
                    (n - 1) * dt, n * dt,
                    before[j], after[j],
                )  # fmt: skip
                if at < when:
                    found, when = j, at
        if found >= 0:
            return when, found
        before, after = after, before
    return horizon, -1
