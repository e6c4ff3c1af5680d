"""Harmonic solutions seen by the time solver: started on one, the motion goes on in time to where it settles.

What a harmonic solution lacks, its neglected harmonics above all, drives a small free motion that dies out. The first
harmonics of the modes, period by period, then approach their limit as a sum of a few decaying waves, which reduced-rank
extrapolation finds long before (Sidi, Vector Extrapolation Methods, chapter 2).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Complex

from ema.simulate.transient import Stepper

_SAMPLES = 64
"""Of a period, from which its first harmonic is made."""
_FEWEST_STEPS, _MOST_STEPS = 1024, 8192
"""Steps of a period at first and at most."""
_BLOCK, _MOST_PERIODS = 6, 48
"""Periods after which the limit is sought again, and how many there are at most."""
_ENOUGH = 0.1
"""How well the limit is to be known, over its distance from the harmonic solution: a tenth of what is stated."""
_LEAST = 1e-4
"""Distance, relative, below which it need not be known any better."""
_PUSH, _COARSE_STEPS, _MOST_PUSHED = 1e-3, 256, 240
"""Relative push off a solution whose stability is asked for, steps of a period, and periods at most after which it
counts what is left of the push: half as many halve the damping down to which a return is seen."""
_RETURNED, _LEFT = 0.01, 5.0
"""Shares of the push at which the motion has returned, and has left. The unstable direction carries a tenth of a push
and more; where it carried less than a hundredth, a solution that is left would be taken for a stable one."""
_CLOSE, _NEARLY = 1e-5, 1e-2
"""Change of a period, relative, at which a motion from rest has settled, and at most where it counts as settled."""
_AVERAGED = 60
"""Periods whose mean stands for a motion that does not settle: ten times the longest subharmonic that was met."""
_RANK = 1e-7
"""Singular values of the differences, over the largest, that are taken for rounding."""


@dataclass(frozen=True)
class Verified:
    """What the time solver says of a harmonic solution.

    Parameters
    ----------
    error : distance of the first harmonic from that of the settled motion, with what is not known of that, relative.
    settles : whether the motion stays with this steady state; one that it leaves is unstable.
    """

    error: float
    settles: bool


def verified(condensed: Any, point: Any) -> Verified:
    """Follow a harmonic solution in time until it settles.

    ``condensed`` and ``point`` are a ``Condensed`` and a solution of it.
    """
    if not np.any(np.abs(point.forces) > 0):
        return Verified(point.error, True)
    if not stays(condensed, point):
        return Verified(1.0, False)
    harmonic, before, moved, steps = condensed.first(point), None, np.inf, _FEWEST_STEPS
    size = max(float(np.linalg.norm(harmonic)), 1e-300)
    # slip forces that change are taken where a step begins: it errs by its length, and less comes about by chance
    shrinks = 0.5 if len(condensed.slip_forces(np.zeros(2))) > 1 else 0.0
    while True:
        limit, rest = _settled(condensed, point, steps)
        away = float(np.linalg.norm(limit - harmonic)) / size
        if before is not None:
            former, moved = moved, float(np.linalg.norm(limit - before)) / size
            # else the steps err by their square where the motion is smooth and at least by their length
            left, enough = max(moved, shrinks * former) if shrinks else moved, _ENOUGH * max(away, _LEAST)
            if left <= enough or steps >= _MOST_STEPS:
                # smaller differences than were asked for come about by chance
                return Verified(away + max(rest / size, enough) + max(left, enough), True)
        before, steps = limit, 2 * steps


def _stepper(condensed: Any, point: Any, steps: int, pushed: float = 1.0) -> tuple[Stepper, np.ndarray, float]:
    """Stepper that begins on a solution, its load over a block of periods in N, and the phase in rad at the begin.

    ``pushed``: factor on displacements and velocities of the modes.
    """
    start, begun = condensed.start_in_time(point, steps)
    start.q, start.p = pushed * start.q, pushed * start.p
    start.u = condensed.problem.base.slip @ start.q
    stepper = Stepper(condensed.problem, start, 2 * np.pi / point.omega / steps, (condensed.driven,))
    phase = begun + 2 * np.pi * np.arange(_BLOCK * steps + 1) / steps
    return stepper, phase, begun


def settled_from_rest(condensed: Any, omega: float, steps: int = _COARSE_STEPS) -> tuple[np.ndarray, bool] | None:
    """Relative displacements (contact, sample) in m over a period of the motion that begins at rest, from phase 0 on.

    The second value: whether it settles to the period of the force within ``_MOST_PUSHED`` periods. Where it does not,
    the displacements are the mean of the last ones: a motion turns about the unstable steady state that it has left.
    ``None`` where it is not finite.
    """
    problem = condensed.problem
    stepper = Stepper(problem, problem.rest(), 2 * np.pi / omega / steps, (condensed.driven,))
    phase = 2 * np.pi * np.arange(_BLOCK * steps + 1) / steps
    load, limits = condensed.force * np.cos(phase)[:, None], condensed.slip_forces(phase[:-1])
    mean = np.zeros((steps, len(condensed.limits)))
    for block in range(_MOST_PUSHED // _BLOCK):
        path = stepper.run(_BLOCK * steps, 1, limits, load)["u"].reshape(_BLOCK, steps, -1)
        last, before = path[-1], path[-2]
        if (block + 1) * _BLOCK > _MOST_PUSHED - _AVERAGED:
            mean += path.sum(axis=0) / _AVERAGED
        change, size = np.linalg.norm(last - before), max(float(np.linalg.norm(last)), 1e-300)
        if not np.isfinite(change) or change <= _CLOSE * size:
            break
    settled = bool(change <= _NEARLY * size)
    period = last if settled else mean
    return (np.roll(period, 1, axis=0).T, settled) if np.all(np.isfinite(period)) else None


def stays(condensed: Any, point: Any) -> bool:
    """Whether the motion returns to a solution from which it was pushed away.

    The change of the state from period to period is the free motion about the solution: its energy falls where the
    solution is stable. A motion that begins on an unstable one stays there for as long as rounding takes to grow, and
    the extrapolated limit is the unstable one: it has to be pushed.
    """
    stepper, phase, _ = _stepper(condensed, point, _COARSE_STEPS, 1.0 + _PUSH)
    load, limits = condensed.force * np.cos(phase)[:, None], condensed.slip_forces(phase[:-1])
    scale, energies, last = condensed.problem.base.frequencies, np.zeros(0), None
    while len(energies) < _MOST_PUSHED:
        run = stepper.run(_BLOCK * _COARSE_STEPS, _COARSE_STEPS, limits, load)
        states = np.concatenate([run["q"] * scale, run["p"]], axis=1)
        moved = np.diff(states if last is None else np.concatenate([last[None], states]), axis=0)
        last, energies = states[-1], np.append(energies, (moved**2).sum(axis=1))
        first, now = energies[:_BLOCK].max(), energies[-_BLOCK:].max()
        if now <= _RETURNED**2 * first or now >= _LEFT**2 * first:
            break
    return bool(now <= first)


def _settled(condensed: Any, point: Any, steps: int) -> tuple[Complex[np.ndarray, "dof"], float]:
    """First harmonic of the outputs once the motion has settled, and how well it is known in m."""
    stepper, phase, begun = _stepper(condensed, point, steps)
    load, limits = condensed.force * np.cos(phase)[:, None], condensed.slip_forces(phase[:-1])
    wave = 2 / _SAMPLES * np.exp(-1j * (begun + 2 * np.pi * np.arange(1, _SAMPLES + 1) / _SAMPLES))
    harmonic = condensed.first(point)
    firsts = np.zeros((0, len(condensed.problem.base.frequencies)), complex)
    found: list[np.ndarray] = []
    size = max(float(np.linalg.norm(harmonic)), 1e-300)
    while len(firsts) < _MOST_PERIODS:
        run = stepper.run(_BLOCK * steps, steps // _SAMPLES, limits, load)
        motion = run["q"].reshape(_BLOCK, _SAMPLES, -1)
        firsts = np.concatenate([firsts, np.tensordot(motion, wave, (1, 0))])
        found.append(condensed.rows @ limit_of(firsts))
        if len(found) > 2:
            # one agreement may be chance
            rest = max(float(np.linalg.norm(found[-1] - former)) for former in found[-3:-1])
            away = float(np.linalg.norm(found[-1] - harmonic))
            if rest <= _ENOUGH * max(away, _LEAST * size):
                break
    return found[-1], rest


def limit_of(points: Complex[np.ndarray, "period mode"]) -> Complex[np.ndarray, "mode"]:
    """Limit of a sequence that is a constant and a few decaying waves, by reduced-rank extrapolation.

    Examples
    --------
    >>> import numpy as np
    >>> n = np.arange(6)[:, None]
    >>> points = 3.0 + np.array([1.0, 2.0j]) * (0.9 * np.exp(0.3j)) ** n
    >>> bool(np.allclose(limit_of(points), 3.0))
    True
    """
    real = np.concatenate([points.real, points.imag], axis=1)
    steps = np.diff(real, axis=0)
    shares = np.linalg.lstsq(np.diff(steps, axis=0).T, -steps[0], rcond=_RANK)[0]
    limit = real[0] + shares @ steps[:-1]
    half = points.shape[1]
    return np.asarray(limit[:half] + 1j * limit[half:])
