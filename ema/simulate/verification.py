"""Harmonic solutions seen by the time solver: started on one, the motion goes on in time to where it settles.

What a harmonic solution lacks, its neglected harmonics above all, drives a small free motion that dies out. The first
harmonics of the modes, period by period, then approach their limit as a sum of a few decaying waves, which reduced-rank
extrapolation finds long before (Sidi, Vector Extrapolation Methods, chapter 2).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Complex

from ema.simulate.transient import Stepper, _State

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

    ``condensed`` and ``point`` are a ``Condensed`` of one direction of friction and a solution of it.
    """
    if not np.any(np.abs(point.forces) > 0):
        return Verified(point.error, True)
    harmonic, before, error = condensed.first(point), None, np.inf
    size, steps = max(float(np.linalg.norm(harmonic)), 1e-300), _FEWEST_STEPS
    while True:
        limit, rest = _settled(condensed, point, steps)
        if limit is None:
            return Verified(1.0, False)
        away = float(np.linalg.norm(limit - harmonic)) / size
        if before is not None:
            # the steps err by their square where the motion is smooth and at least by their length
            moved, enough = float(np.linalg.norm(limit - before)) / size, _ENOUGH * max(away, _LEAST)
            # smaller differences than were asked for come about by chance
            error = away + max(rest / size, enough) + max(moved, enough)
            if moved <= enough or steps >= _MOST_STEPS:
                return Verified(error, True)
        before, steps = limit, 2 * steps


def start_of(condensed: Any, point: Any, steps: int) -> _State:
    """State at the beginning of a period of a harmonic solution, as steps of that many in a period see it."""
    orders, base, laws = condensed.orders(point.count), condensed.problem.base, condensed.problem.laws
    waves = condensed.modal(point)
    q, p = waves.real.sum(axis=0), (1j * point.omega * orders[:, None] * waves).real.sum(axis=0)
    spectrum = np.zeros((len(condensed.limits), steps // 2 + 1), complex)
    spectrum[:, orders] = 0.5 * steps * (point.amplitudes[:, ::2] - 1j * point.amplitudes[:, 1::2])
    spectrum[:, 0] *= 2
    period = np.fft.irfft(spectrum, steps, axis=1)
    path = np.column_stack([np.zeros(len(period)), period, period, period[:, :1]])
    limits = np.broadcast_to(condensed.limits[:, None], path.shape)
    forces, memory = laws.followed(path, limits, 2 * np.pi / point.omega / steps)
    return _State(q, p, base.slip @ q, forces[:, -1], memory)


def _settled(condensed: Any, point: Any, steps: int) -> tuple[Complex[np.ndarray, "dof"] | None, float]:
    """First harmonic of the outputs once the motion has settled, and how well it is known in m; ``None``: it leaves."""
    problem, every = condensed.problem, steps // _SAMPLES
    stepper = Stepper(problem, start_of(condensed, point, steps), 2 * np.pi / point.omega / steps, (condensed.driven,))
    phase = 2 * np.pi * np.arange(_BLOCK * steps + 1) / steps
    load = condensed.force * np.cos(phase)[:, None]
    wave = 2 / _SAMPLES * np.exp(-2j * np.pi * np.arange(1, _SAMPLES + 1) / _SAMPLES)
    harmonic = condensed.first(point)
    firsts = np.zeros((0, len(problem.base.frequencies)), complex)
    found: list[np.ndarray] = []
    size = max(float(np.linalg.norm(harmonic)), 1e-300)
    while len(firsts) < _MOST_PERIODS:
        run = stepper.run(_BLOCK * steps, every, condensed.limits[None], load)
        motion = run["q"].reshape(_BLOCK, _SAMPLES, -1)
        firsts = np.concatenate([firsts, np.tensordot(motion, wave, (1, 0))])
        found.append(condensed.rows @ limit_of(firsts))
        if len(found) > 1:
            rest = float(np.linalg.norm(found[-1] - found[-2]))
            away = float(np.linalg.norm(found[-1] - harmonic))
            if rest <= _ENOUGH * max(away, _LEAST * size):
                break
    outputs = firsts @ condensed.rows.T
    drift = np.linalg.norm(np.diff(outputs, axis=0), axis=1)
    last, rest = found[-1], float(np.linalg.norm(found[-1] - found[-2]))
    # what moves on as fast as it began does not settle
    leaves = drift[-_BLOCK:].max() > max(drift[:_BLOCK].max(), _LEAST * size) and rest > _LEAST * size
    return (None if leaves else last), rest


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
