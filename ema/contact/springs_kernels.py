"""Masing (Jenkins) springs in parallel: Masing, Coulomb, n springs, Iwan, rough contact. State: the force of each."""

import numpy as np

from ema.compiled import fast, inner, kernel
from ema.contact.call_kernels import END, EXCESS, FIRST, FORCE, LIMIT, OWN, SLOPE, STIFFNESS, WAY

_AT_REST, _OPEN, _TRIALS = 1e-12, 1e3, 60
"""Difference of slip forces that is rounding; yield displacements by which nothing touches; steps of Newton's method:
from 1e-4 to 1e3 times the slip force at rest it takes 2 or 3."""


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
def _clipped(springs, bearing, way, old, new):
    """Sums over the springs of one contact: what slipped, the force and its slope; the forces go to ``new``.

    ``springs``: stiffnesses and slip forces at rest; with ``bearing`` (a, b) a slip force is a * top + b * k.
    """
    (stiffness, tops), (share, deeper), excess, force, slope = springs, bearing, 0.0, 0.0, 0.0
    for j in range(len(stiffness)):
        k = stiffness[j]
        top = max(share * tops[j] + deeper * k, 0.0)
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
    (parameters, _), (before, after), count = tables, states, group[OWN]
    for i in range(group[FIRST], group[END]):
        pair = parameters[i, :count], parameters[i, count : 2 * count]
        bearing, way = (exchange[LIMIT, i], 0.0), exchange[WAY, i]
        excess, force, slope = _clipped(pair, bearing, way, before[i], after[i])
        exchange[EXCESS, i], exchange[FORCE, i], exchange[SLOPE, i] = excess, force, slope


@inner
def deeper(springs, touching, limit):
    """How much further all springs yield, in m, than at rest, where the first ``touching`` do, for a slip force.

    The sum of the slip forces max(top + deeper * k, 0) grows and is convex: Newton's method comes down to the root.
    """
    (stiffness, tops), rest, whole = springs, 0.0, 0.0
    for j in range(touching):
        rest, whole = rest + tops[j], whole + stiffness[j]
    if abs(limit - rest) <= _AT_REST * rest:
        return 0.0
    reach = rest / whole
    if limit <= 0.0:
        return -_OPEN * reach
    way = reach * np.log(limit / rest)
    for _ in range(_TRIALS):
        force, slope = 0.0, 0.0
        for j in range(len(stiffness)):
            if tops[j] + way * stiffness[j] > 0.0:
                force, slope = force + tops[j] + way * stiffness[j], slope + stiffness[j]
        if abs(limit - force) <= _AT_REST * limit:
            break
        way = way + (limit - force) / slope if slope > 0.0 else 0.0
    return way


@inner
def bed(parameters, count):
    """Springs of a rough contact, stiffnesses and slip forces at rest, and how many of them touch at rest."""
    return (parameters[:count], parameters[count : 2 * count]), int(parameters[2 * count])


@kernel
def rough(group, rate, tables, exchange, states):
    """Springs that touch at depths of their own: each slips at mu times what presses it; see ``ema.contact.rough``.

    ``parameters``: stiffnesses, slip forces at rest, negative where a spring does not touch yet, and how many do.
    """
    (parameters, _), (before, after) = tables, states
    for i in range(group[FIRST], group[END]):
        (stiffness, tops), first = bed(parameters[i], group[OWN])
        way, old, new = exchange[WAY, i], before[i], after[i]
        bearing = 1.0, deeper((stiffness, tops), first, exchange[LIMIT, i])
        excess, force, slope = _clipped((stiffness[:first], tops[:first]), bearing, way, old, new)
        for j in range(first, len(stiffness)):
            # no part of k_T
            k, top = stiffness[j], max(tops[j] + bearing[1] * stiffness[j], 0.0)
            new[j] = min(max(old[j] + k * way, -top), top)
            if top > 0.0 and new[j] == old[j] + k * way:
                slope += k
            excess, force = excess + new[j] - old[j], force + new[j]
        exchange[EXCESS, i], exchange[FORCE, i], exchange[SLOPE, i] = excess, force, slope
