"""Masing (Jenkins) springs in parallel: Masing, Coulomb, n springs, Iwan. State: the force of every spring."""

from ema.compiled import fast, kernel
from ema.contact.call_kernels import END, EXCESS, FIRST, FORCE, LIMIT, OWN, SLOPE, STIFFNESS, WAY


@kernel
def spring(group, rate, tables, exchange, states):
    """One spring per contact; without parameters."""
    before, after = states
    for i in range(group[FIRST], group[END]):
        k, top = exchange[STIFFNESS, i], exchange[LIMIT, i]
        trial = before[i, 0] + k * exchange[WAY, i]
        clipped = top if trial > top else (-top if trial < -top else trial)
        slides = (clipped != trial) | (top <= 0.0)
        after[i, 0] = exchange[FORCE, i] = clipped
        exchange[EXCESS, i] = clipped - trial
        exchange[SLOPE, i] = -k if slides else 0.0


@fast
def _clipped(shares, limit, way, old, new):
    """Sums over the springs of one contact: what slipped, the force and its slope; the forces go to ``new``."""
    excess, force, slope, count = 0.0, 0.0, 0.0, len(shares) // 2
    stiffness, tops = shares[:count], shares[count:]
    for j in range(count):
        k, top = stiffness[j], limit * tops[j]
        trial = old[j] + k * way
        clipped = top if trial > top else (-top if trial < -top else trial)
        # a spring without slip force slides even where it stands still
        slides = (clipped != trial) | (top <= 0.0)
        excess += clipped - trial
        slope -= k * slides
        new[j] = clipped
        force += clipped
    # exactly nothing where all stick, in whatever order the sums are taken
    return excess if slope != 0.0 else 0.0, force, slope


@kernel
def springs(group, rate, tables, exchange, states):
    """Return map of Eq. (4) (Gaul, Roseira and Becker 2008).

    ``parameters``: stiffnesses of the springs, then their shares of the slip force.
    """
    (parameters, _), (before, after) = tables, states
    for i in range(group[FIRST], group[END]):
        shares, limit, way = parameters[i, : 2 * group[OWN]], exchange[LIMIT, i], exchange[WAY, i]
        excess, force, slope = _clipped(shares, limit, way, before[i], after[i])
        exchange[EXCESS, i], exchange[FORCE, i], exchange[SLOPE, i] = excess, force, slope
