"""What every friction law keeps, tried slowly from states along loading and unloading, at several slip forces."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ema.contact.catalogue import CATALOGUE
from ema.data import FrictionLaw

_LIMITS = (1.0, 1e-2)
"""Slip forces over that at the reference force."""
_FALLS = (1.0, 0.5, 0.0)
"""What a slip force falls to, as a share of itself."""
_OUT, _BACK = (0.0, 0.3, 1.0, 3.0, -0.3, -1.0, -3.0), (0.0, 0.5, 1.0, 1.5)
"""Ways in F_C/k_T to a state: out from the unstressed contact, and back from there."""
_WAYS = np.array([-10.0, -3.0, -1.0, -0.3, -0.1, -1e-3, 0.0, 1e-3, 0.1, 0.3, 1.0, 3.0, 10.0])
"""Increments from a state, in F_C/k_T."""
_CYCLES = ((0.5, 0.0), (1.0, 0.0), (3.0, 0.0), (0.3, 0.7))
"""Amplitude and mean of closed cycles, in F_C/k_T."""
_COARSE, _FINE, _TURNS = 100, 400, 3
"""Steps of half a cycle, of which the work is extrapolated to steps without length, and cycles, of which the last is
taken by itself."""
_ROUNDING = 1e-9
"""Forces over F_C that are rounding."""
_GAIN = 1e-3
"""Work gained over the ranges of force and motion that may be the error of the extrapolation. An elastic softening law
in explicit steps comes to 0.0005, the built-in laws to less than 1e-7; unloading by 0.9 k comes to 0.04."""


Trouble = tuple[str, str, str]
"""What is wrong, the point with its numbers, what was expected."""


def broken(law: FrictionLaw, k: float, contact: Any) -> Iterator[Trouble]:
    """What a law breaks of what the solvers rely on, in the order in which it is looked for.

    A force is finite, and no larger than the slip force, or than the catalogue says of the law; it stays for du = 0; it
    does not fall as du grows, and grows by at most k du where it acts against the motion. No path from rest and no
    closed cycle gains energy. The motion is slow, where no law depends on velocities. ``contact``: the ``ContactLaws``
    of one contact of ``k`` N/m.
    """
    top = (law.friction_coefficient * law.reference_force or 1.0) * k / law.contact_stiffness
    if not (0 < top < np.inf and 0 < k < np.inf):
        return  # what checks the numbers of a joint says so
    limits = np.repeat(np.array(_LIMITS) * top, len(_OUT) * len(_BACK))
    out, back = np.tile(np.repeat(_OUT, len(_BACK)), len(_LIMITS)), np.tile(_BACK, len(_LIMITS) * len(_OUT))
    turn, end = out, out - np.where(out < 0, -1.0, 1.0) * back
    line = np.linspace(0, 1, 21)[:, None]
    path = np.concatenate([turn * line, turn + (end - turn) * line[1:]])
    laws, path = contact.repeated(len(out)), path.T * (limits / k)[:, None]
    most = dict(law.parameters).get(CATALOGUE[law.name].above, 1.0) if law.name in CATALOGUE else 1.0
    forces, states = _slowly(laws, path, limits)
    before = np.concatenate([np.zeros((len(limits), 1)), forces[:, :-1]], axis=1)
    yield from _sizes((before, np.diff(path, prepend=path[:, :1]), forces), k, limits, most)

    # a slip force that falls brings the forces of springs down with it
    falls = _FALLS if np.isfinite(laws.capacity[0, 0]) else _FALLS[:1]
    count, ways = len(_WAYS), np.tile(_WAYS, len(limits) * len(falls))
    now, scale = np.repeat(np.outer(falls, limits).ravel(), count), np.repeat(np.tile(limits, len(falls)), count)
    unit = np.where(now > 0, now, scale) / k
    laws = contact.repeated(len(now))
    states, start = (np.repeat(np.tile(part, (len(falls), 1)), count, axis=0) for part in (states, forces[:, -1:]))
    room = np.full_like(states, np.inf)
    np.multiply(laws.capacity, now[:, None], out=room, where=np.isfinite(laws.capacity))
    path = np.stack([np.zeros(len(now)), ways * unit], axis=1)
    forces, _ = _slowly(laws, path, now, np.clip(states, -room, room))
    rest, way = forces[:, :1], path[:, 1:]
    start = np.where(np.isfinite(laws.capacity[:, :1]), np.clip(start, -now[:, None], now[:, None]), start)
    yield from _sizes((np.hstack([start, rest]), path, forces), k, now, most)
    same = (now == scale)[:, None]
    for old, new, chosen in ((start, rest, same), (rest, forces[:, 1:], way == 0)):
        if len(bad := np.flatnonzero(chosen & (abs(new - old) > _ROUNDING * scale[:, None]))):
            point = _point(old, np.zeros_like(way), new, k, now, bad[0])
            yield "its force changes without motion", point, "the force it was given"
    yield from _slopes((rest, way, forces[:, 1:]), k, now, scale)
    yield from _gains(contact, k, np.array(_LIMITS) * top)


def _sizes(increments: tuple[np.ndarray, ...], k: float, limits: np.ndarray, most: float) -> Iterator[Trouble]:
    """Forces that are no numbers, or too large; force before, way and force of every increment (contact, sample)."""
    before, way, force = increments
    for what, wrong in (
        ("the law returns no number", ~np.isfinite(force)),
        ("more than the slip force", abs(force) > most * (1 + _ROUNDING) * limits[:, None]),
    ):
        # the first of them along the path
        for n in np.flatnonzero(wrong.any(axis=0))[:1]:
            i = np.flatnonzero(wrong[:, n])[0]
            expected = "a finite force" if "number" in what else f"{most * limits[i]:.4g} N at most"
            yield what, _point(before[:, n], way[:, n], force[:, n], k, limits, i), expected


def _slopes(increments: tuple[np.ndarray, ...], k: float, limits: np.ndarray, scale: np.ndarray) -> Iterator[Trouble]:
    """Forces that fall as the way grows, and those that grow faster than k du against the motion."""
    before, way, force = (part[:, 0] for part in increments)
    small = _ROUNDING * scale
    steps = np.diff(force.reshape(-1, len(_WAYS)), axis=1, prepend=-np.inf).ravel()
    if len(bad := np.flatnonzero(steps < -small)):
        i = bad[0]
        got = f"{force[i - 1]:.4g} N for du = {way[i - 1]:.4g} m, and {_point(before, way, force, k, limits, i)}"
        yield "its force falls as du grows", got, "a slope of 0 or more"
    if len(bad := np.flatnonzero((before * way >= 0) & (abs(force - before) > k * abs(way) + small))):
        i = bad[np.argmax(abs((force - before)[bad] / way[bad]))]
        slope = (force[i] - before[i]) / (k * way[i])
        got = f"a slope of {slope:.3g} k, {_point(before, way, force, k, limits, i)}"
        yield "its force grows faster than k du", got, "a slope of k at most"


def _gains(contact: Any, k: float, limits: np.ndarray) -> Iterator[Trouble]:
    """Cycles that gain energy, however short the steps: from rest to any point of the path, or the last by itself."""
    amplitudes, means = (np.tile(part, len(limits)) for part in np.array(_CYCLES).T)
    limits = np.repeat(limits, len(_CYCLES))
    unit, works = limits / k, []
    laws = contact.repeated(len(limits))
    for steps in (_COARSE, _FINE):
        line = np.linspace(-1, 1, steps + 1)
        cycles = np.tile(np.concatenate([line[-2::-1], line[1:]]), _TURNS)
        lead = (means + amplitudes)[:, None] * np.linspace(0, 1, steps + 1)
        u = np.concatenate([lead, means[:, None] + amplitudes[:, None] * cycles], axis=1) * unit[:, None]
        f = _slowly(laws, u, limits)[0]
        work = np.cumsum(0.5 * (f[:, 1:] + f[:, :-1]) * np.diff(u), axis=1)
        works.append(work[:, steps // _COARSE - 1 :: steps // _COARSE])
    work, size = works[1] + (works[1] - works[0]) / (_FINE / _COARSE - 1), np.ptp(f, axis=1) * np.ptp(u, axis=1)
    # what a cycle that does not end with the force of its start takes out of the springs
    released = abs(f[:, -1] - f[:, -1 - 2 * _FINE]) * 2 * amplitudes * unit
    last = work[:, -1] - work[:, -1 - 2 * _COARSE] + released
    for gained, way in ((work.min(axis=1), "from rest through cycles"), (last, "in closed cycles")):
        if len(bad := np.flatnonzero(gained < -_GAIN * size)):
            i = bad[np.argmin((gained / size)[bad])]
            about = f"{amplitudes[i] * unit[i]:.4g} m about {means[i] * unit[i]:.4g} m"
            got = f"{gained[i]:.3g} J of work {way} of {about}, k = {k:.4g} N/m, limit = {limits[i]:.4g} N"
            yield "it gives back more work than it took", got, "0 J or more"


def _slowly(
    laws: Any, path: np.ndarray, limits: np.ndarray, states: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Forces along paths so slow that velocities do not matter, and the states at the end."""
    forces, end = laws.followed(path, np.broadcast_to(limits[:, None], path.shape), np.inf, states)
    return forces, end


def _point(before: np.ndarray, way: np.ndarray, force: np.ndarray, k: float, limits: np.ndarray, i: Any) -> str:
    """An increment of contact ``i`` in words."""
    old, du, new = (float(np.ravel(part)[i]) + 0.0 for part in (before, way, force))
    return f"{new:.4g} N from {old:.4g} N with du = {du:.4g} m, k = {k:.4g} N/m, limit = {limits[i]:.4g} N"
