"""Endochronic law of Valanis (1971) without hardening, exact for monotone motion. State: the force.

With phi = F/F_C in the direction of motion, dF/du = k (1 - phi) / (1 - kappa phi): Dahl's law for kappa = 0, a Masing
spring in the limit kappa = 1 (Gaul and Nitsche 2001, Eq. 33 with E_t = 0).
"""

import numpy as np

from ema.compiled import inner, kernel
from ema.contact.call_kernels import BY_FORCE, END, EXCESS, FIRST, FORCE, LIMIT, SLOPE, STIFFNESS, WAY

_MOST, _SETTLED = 100, 1e-9
"""Steps of Newton's method, and the relative step after which it ends: what is left is at most 500 times its square."""


@inner
def valanis_step(k, limit, kappa, du, f0):
    """Force, slope df1/du and tangent df1/df0 after the way ``du``.

    With q = 1 - phi and r = ln(q0/q1), the way is kappa q0 (1 - exp(-r)) + (1 - kappa) r, which rises with r and bends
    down: Newton's method from below comes from below.
    """
    if limit <= 0.0:
        return 0.0, 0.0, 0.0
    sign = 1.0 if du >= 0.0 else -1.0
    way, q0 = k * abs(du) / limit, min(max(1.0 - sign * f0 / limit, 0.0), 2.0)
    if q0 == 0.0:
        return sign * limit, 0.0, 0.0
    bend = kappa * q0
    r = max(way / (bend + 1.0 - kappa), (way - bend) / (1.0 - kappa))
    for _ in range(_MOST):
        fade = np.exp(-r)
        step = (way + bend * np.expm1(-r) - (1.0 - kappa) * r) / (bend * fade + 1.0 - kappa)
        r += step
        if abs(step) <= _SETTLED * r:
            break
    q1 = q0 * np.exp(-r)
    slope, start_slope = q1 / (1.0 - kappa + kappa * q1), q0 / (1.0 - kappa + kappa * q0)
    force = min(max(f0, -limit), limit) - sign * limit * q0 * np.expm1(-r)
    return force, k * slope, slope / start_slope


@kernel
def valanis(group, rate, tables, exchange, states):
    """Increments of the contacts of a group; ``parameters``: kappa."""
    (parameters, _), (before, after) = tables, states
    for i in range(group[FIRST], group[END]):
        k, way = exchange[STIFFNESS, i], exchange[WAY, i]
        force, slope, exchange[BY_FORCE, i] = valanis_step(k, exchange[LIMIT, i], parameters[i, 0], way, before[i, 0])
        after[i, 0] = exchange[FORCE, i] = force
        exchange[EXCESS, i], exchange[SLOPE, i] = force - before[i, 0] - k * way, slope - k
