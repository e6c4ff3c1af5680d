"""Friction laws as maps over one increment of relative displacement, exact for monotone motion; compiled.

Each law takes its internal state ``z0`` from displacement ``u0`` to ``u1`` and returns the force and its slope df/du1,
with the tangents ``a = df1/df0`` and ``b = df1/du1`` of every internal force for harmonic balance.
"""

from functools import cache

import numba as nb

from ema.compiled import compiled
from ema.contact.bouc_wen_kernels import bouc_wen_step
from ema.contact.dahl_kernels import dahl_step
from ema.contact.lugre_kernels import lugre_step
from ema.contact.valanis_kernels import valanis_step

PARALLEL, BOUC_WEN, DAHL, LUGRE, USER, VALANIS = range(6)


@cache
def no_user_law():
    """The place-holder of models without a law of the user's own."""
    return nb.cfunc(nb.float64(*[nb.float64] * 8))(_unchanged)


def _unchanged(force, du, stiffness, limit, p0, p1, p2, p3):
    return force


@compiled()
def parallel_step(i, stiffness, limit, shares_k, shares_f, count, du, z0, z1, a, b):
    """Masing (Jenkins) springs in parallel: return map of Eq. (4)."""
    force, slope = 0.0, 0.0
    for j in range(count):
        k, top = stiffness * shares_k[i, j], limit * shares_f[i, j]
        trial = z0[i, j] + k * du
        if trial > top:
            trial, a[i, j], b[i, j] = top, 0.0, 0.0
        elif trial < -top:
            trial, a[i, j], b[i, j] = -top, 0.0, 0.0
        else:
            a[i, j], b[i, j] = 1.0, k
        z1[i, j] = trial
        force += trial
        slope += b[i, j]
    return force, slope


@compiled()
def user_step(k, limit, p0, p1, p2, p3, user, du, f0):
    """A user's own law: new force from old force and slip increment; slopes by difference."""
    force = user(f0, du, k, limit, p0, p1, p2, p3)
    tiny = 1e-7 * max(limit, 1e-12) / k
    step = tiny if du >= 0.0 else -tiny
    b = (user(f0, du + step, k, limit, p0, p1, p2, p3) - force) / step
    change = 1e-7 * max(limit, 1e-12) * (-1.0 if f0 > 0.0 else 1.0)
    a = (user(f0 + change, du, k, limit, p0, p1, p2, p3) - force) / change
    return force, b, 0.0, 0.0, a, b


@compiled()
def single_step(code, i, k, limit, par, tables, user, u0, u1, h, s0, s1, s2):
    """One increment of a law with one internal force: force, slope, the three numbers of its state, tangents a, b."""
    du = u1 - u0
    if code == BOUC_WEN:
        force, slope, x, top, a, b = bouc_wen_step(k, limit, par[i], tables, du, s0, s1, s2)
        return force, slope, force, x, top, a, b
    if code == VALANIS:
        force, slope, a = valanis_step(k, limit, par[i, 0], du, s0)
        return force, slope, force, 0.0, 0.0, a, slope
    if code == DAHL:
        force, slope, a = dahl_step(k, limit, par[i, 0], du, s0)
        return force, slope, force, 0.0, 0.0, a, slope
    if code == LUGRE:
        return lugre_step(k, limit, par[i, 0], par[i, 1], par[i, 2], par[i, 3], u0, u1, h, s0, s1, s2)
    force, slope, x, top, a, b = user_step(k, limit, par[i, 0], par[i, 1], par[i, 2], par[i, 3], user, du, s0)
    return force, slope, force, x, top, a, b


@compiled()
def step(code, i, stiffness, limit, par, shares_k, shares_f, count, tables, user, u0, u1, h, z0, z1, a, b):
    """One increment of contact i with any law: force at u1 and its slope; arrays are those of all contacts."""
    if code == PARALLEL:
        return parallel_step(i, stiffness, limit, shares_k, shares_f, count, u1 - u0, z0, z1, a, b)
    force, slope, z1[i, 0], z1[i, 1], z1[i, 2], a[i, 0], b[i, 0] = single_step(
        code, i, stiffness, limit, par, tables, user, u0, u1, h, z0[i, 0], z0[i, 1], z0[i, 2]
    )
    return force, slope


@compiled()
def stored_energy(i, code, stiffness, shares_k, count, z):
    """Energy that the springs of contact i can give back."""
    if code == PARALLEL:
        energy = 0.0
        for j in range(count):
            energy += z[i, j] * z[i, j] / (2.0 * stiffness * shares_k[i, j])
        return energy
    return z[i, 0] * z[i, 0] / (2.0 * stiffness)


@compiled()
def project(i, code, limit, shares_f, count, z):
    """Bring the forces of contact i below a new slip force; returns the change of its force."""
    change = 0.0
    for j in range(count):
        top = limit * shares_f[i, j]
        if code == LUGRE:
            top = max(top, abs(z[i, j]) if limit > 0.0 else 0.0)
        clipped = min(max(z[i, j], -top), top)
        change += clipped - z[i, j]
        z[i, j] = clipped
    return change
