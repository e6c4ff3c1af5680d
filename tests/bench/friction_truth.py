"""Motion of structures with friction contacts, solved a second time: nothing here knows the simulator.

Equations of motion in the DOFs themselves, M x'' + C x' + K x + B^T f = p, with the friction laws in their rate form.
Laws without a rate: explicit central differences (Newmark 1959 with beta = 0) with forces that follow the path of the
contacts, each law integrated over the way by Runge and Kutta's method of fourth order. Where a contact has LuGre's law:
that method over time, for everything. Both err by the square of the step where a contact changes its state; the steps
are halved until the extrapolated results agree, and the last difference is handed on as the truth's own error; a steady
state's holds what is left of the free motion besides.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numba as nb
import numpy as np

SPRINGS, BOUC_WEN, DAHL, VALANIS, LUGRE, FLOOR = range(6)
_WAY = 0.02
"""Longest way of one Runge-Kutta step of a law, over that to full slip; its fourth power is below 1e-6."""
_FIRST, _MOST = 25.0, 5
"""Steps per period of the highest mode at first, and halvings at most."""
_RAMP = 400
"""Increments of a slow load."""


@dataclass(frozen=True)
class Rubbing:
    """A structure with contacts in numbers: matrices (n, n) without contact springs, slips (contact, n).

    ``kind`` (contact,), ``stiffness`` N/m, ``limit`` N, ``numbers`` (contact, 4) of the laws; ``springs`` (contact, 2,
    spring): stiffnesses and slip forces of those that consist of springs, zero elsewhere.
    """

    mass: np.ndarray
    damping: np.ndarray
    elastic: np.ndarray
    slips: np.ndarray
    kind: np.ndarray
    stiffness: np.ndarray
    limit: np.ndarray
    numbers: np.ndarray
    springs: np.ndarray

    @property
    def laws(self) -> tuple[np.ndarray, ...]:
        """What the compiled functions take."""
        return self.kind, self.stiffness, self.limit, self.numbers, self.springs

    @property
    def fastest(self) -> float:
        """Highest natural frequency in rad/s with every contact stuck."""
        stuck = self.elastic + self.slips.T @ (self.stiffness[:, None] * self.slips)
        return float(np.sqrt(np.linalg.eigvals(np.linalg.solve(self.mass, stuck)).real.max()))

    @property
    def slowest(self) -> float:
        """Least decay rate in 1/s of a free motion, with every contact stuck or none. Friction takes more."""
        stuck = self.elastic + self.slips.T @ (self.stiffness[:, None] * self.slips)
        rates = []
        for stiffness in (self.elastic, stuck):
            by_mass = np.linalg.solve(self.mass, np.hstack([-stiffness, -self.damping]))
            first_order = np.vstack([np.eye(len(self.mass), 2 * len(self.mass), len(self.mass)), by_mass])
            rates.append(-np.linalg.eigvals(first_order).real.max())
        return float(min(rates))

    def memory(self) -> np.ndarray:
        """Unstressed contacts: forces of the springs, or of the law in the first column."""
        return np.zeros((len(self.kind), self.springs.shape[2]))


@nb.njit(cache=True)
def _rate(kind, k, limit, numbers, phi):
    """dF/du over k at the force phi in the direction of motion, over the slip force."""
    if kind == BOUC_WEN:
        turn = 1.0 if phi > 0.0 else -1.0
        return 1.0 - abs(phi) ** numbers[0] * (numbers[1] + (1.0 - numbers[1]) * turn)
    if kind == LUGRE:  # slowly: static friction
        return 1.0 - phi / numbers[2]
    if phi >= 1.0:
        return 0.0
    if kind == DAHL:
        return (1.0 - phi) ** numbers[0]
    if kind == VALANIS:
        return (1.0 - phi) / (1.0 - numbers[0] * phi)
    return max(1.0 - phi, numbers[0])


@nb.njit(cache=True)
def _moved(laws, i, memory, du):
    """Force of contact i after the way du, whose memory changes."""
    kind, k, limit = laws[0][i], laws[1][i], laws[2][i]
    if kind == SPRINGS:
        total = 0.0
        for j in range(memory.shape[1]):
            stiff, top = laws[4][i, 0, j], laws[4][i, 1, j]
            memory[i, j] = min(max(memory[i, j] + stiff * du, -top), top)
            total += memory[i, j]
        return total
    sign = 1.0 if du > 0.0 else -1.0
    way, top = k * abs(du) / limit, laws[3][i, 2] if kind == LUGRE else 1.0
    count = int(way / _WAY) + 1
    h, phi = way / count, sign * memory[i, 0] / limit
    for n in range(count):
        if phi <= 0.0 and (kind == BOUC_WEN and laws[3][i, 1] == 0.5) and phi + (way - n * h) <= 0.0:
            phi += way - n * h
            break
        step = h
        a = _rate(kind, k, limit, laws[3][i], phi)
        b = _rate(kind, k, limit, laws[3][i], phi + 0.5 * step * a)
        c = _rate(kind, k, limit, laws[3][i], phi + 0.5 * step * b)
        d = _rate(kind, k, limit, laws[3][i], phi + step * c)
        phi = min(phi + step * (a + 2.0 * b + 2.0 * c + d) / 6.0, top)
    memory[i, 0] = sign * phi * limit
    return memory[i, 0]


@nb.njit(cache=True)
def _times(matrix, x, out):
    for i in range(matrix.shape[0]):
        total = 0.0
        for j in range(len(x)):
            total += matrix[i, j] * x[j]
        out[i] = total


@nb.njit(cache=True)
def _differences(matrices, laws, load, wave, start, run, seen):
    """Central differences; ``run``: h, steps per sample, samples. wave: forces at samples, or cos of w, and w.

    Returns the samples of ``seen`` (row, n) @ x, and the state at the end.
    """
    (keep, push, elastic, slips), (x0, v0, memory0) = matrices, start
    h, every, samples, omega = run
    x, memory, contacts = x0.copy(), memory0.copy(), slips.shape[0]
    size = len(x)
    out, rest, acceleration, v, new = (
        np.zeros((samples + 1, len(seen))),
        np.zeros(size),
        np.zeros(size),
        np.zeros(size),
        np.zeros(size),
    )
    force, u, before = np.zeros(contacts), np.zeros(contacts), np.zeros(contacts)
    for i in range(contacts):
        force[i] = _moved(laws, i, memory, 0.0)
    _times(slips, x, before)
    _times(seen, x, out[0])
    for n in range(samples * every):
        if omega > 0.0:
            level = np.cos(omega * h * n)
        elif len(wave) > 1:
            share = (n % every) / every
            level = wave[n // every] * (1.0 - share) + wave[n // every + 1] * share
        else:
            level = 0.0
        _times(elastic, x, rest)
        for i in range(size):
            rest[i] = level * load[i] - rest[i]
        for i in range(contacts):
            if force[i] != 0.0:
                for j in range(size):
                    rest[j] -= slips[i, j] * force[i]
        _times(push, rest, acceleration)
        if n == 0:
            # half a step back: (M - C h/2) v- = M v0 - h/2 (p - K x - B f), written with the same two matrices
            _times(keep, v0, new)
            for i in range(size):
                v[i] = 0.5 * (new[i] + v0[i]) + 0.5 * h * acceleration[i]
        else:
            _times(keep, v, new)
            for i in range(size):
                v[i] = new[i] + h * acceleration[i]
        for i in range(size):
            x[i] += h * v[i]
        _times(slips, x, u)
        for i in range(contacts):
            force[i] = _moved(laws, i, memory, u[i] - before[i])
            before[i] = u[i]
        if (n + 1) % every == 0:
            _times(seen, x, out[(n + 1) // every])
    # the velocity at the last sample, half a step on; the force of the next step would be that of the first one
    _times(elastic, x, rest)
    for i in range(size):
        rest[i] = last_level(wave, omega, h * samples * every, samples) * load[i] - rest[i]
        for c in range(contacts):
            rest[i] -= slips[c, i] * force[c]
    _times(push, rest, acceleration)
    _times(keep, v, new)
    for i in range(size):
        v[i] = 0.5 * (v[i] + new[i] + h * acceleration[i])
    return out, x, v, memory


@nb.njit(cache=True)
def last_level(wave, omega, time, samples):
    """The driving force at the end of a run."""
    if omega > 0.0:
        return np.cos(omega * time)
    return wave[samples] if len(wave) > 1 else 0.0


@nb.njit(cache=True)
def _slope(matrices, laws, load, level, x, v, memory, dx, dv, dm, room):
    """Rates of displacements, velocities and memories."""
    inverse, elastic, damping, slips = matrices
    rest, speed, other = room
    _times(elastic, x, rest)
    _times(damping, v, other)
    for i in range(len(x)):
        rest[i] = level * load[i] - rest[i] - other[i]
        dx[i] = v[i]
    _times(slips, v, speed)
    for i in range(len(speed)):
        kind, k, limit, numbers, w = laws[0][i], laws[1][i], laws[2][i], laws[3][i], speed[i]
        total = 0.0
        if kind == SPRINGS:
            for j in range(memory.shape[1]):
                f, top = memory[i, j], laws[4][i, 1, j]
                total += min(max(f, -top), top)
                slides = (f >= top and w > 0.0) or (f <= -top and w < 0.0)
                dm[i, j] = 0.0 if slides else laws[4][i, 0, j] * w
        elif kind == LUGRE:
            top = limit * (1.0 + (numbers[2] - 1.0) * np.exp(-((w / numbers[3]) ** 2)))
            z = w - abs(w) * memory[i, 0] / top
            dm[i, 0] = k * z
            total = memory[i, 0] + numbers[0] * z + numbers[1] * w
        else:
            sign = 1.0 if w > 0.0 else -1.0
            phi = sign * memory[i, 0] / limit
            dm[i, 0] = k * w * _rate(kind, k, limit, numbers, min(phi, 1.0))
            total = memory[i, 0]
        for j in range(len(x)):
            rest[j] -= slips[i, j] * total
    _times(inverse, rest, dv)


@nb.njit(cache=True)
def _runge_kutta(matrices, laws, load, wave, start, run, seen):
    """As ``_differences``, by Runge and Kutta's method; spring forces are cut at the end of a step."""
    x, v, memory = start[0].copy(), start[1].copy(), start[2].copy()
    h, every, samples, omega = run
    size, out = len(x), np.zeros((samples + 1, len(seen)))
    kx, kv, km = np.zeros((4, size)), np.zeros((4, size)), np.zeros((4, *memory.shape))
    room = np.zeros(size), np.zeros(matrices[3].shape[0]), np.zeros(size)
    levels, parts = np.zeros(4), np.array([0.0, 0.5, 0.5, 1.0])
    _times(seen, x, out[0])
    for n in range(samples * every):
        for s in range(4):
            if omega > 0.0:
                levels[s] = np.cos(omega * h * (n + parts[s]))
            elif len(wave) > 1:
                share = (n % every + parts[s]) / every
                levels[s] = wave[n // every] * (1.0 - share) + wave[n // every + 1] * share
            back = h * parts[s]
            last = max(s - 1, 0)
            _slope(
                matrices,
                laws,
                load,
                levels[s],
                x + back * kx[last] if s else x,
                v + back * kv[last] if s else v,
                memory + back * km[last] if s else memory,
                kx[s],
                kv[s],
                km[s],
                room,
            )
        for i in range(size):
            x[i] += h * (kx[0, i] + 2.0 * kx[1, i] + 2.0 * kx[2, i] + kx[3, i]) / 6.0
            v[i] += h * (kv[0, i] + 2.0 * kv[1, i] + 2.0 * kv[2, i] + kv[3, i]) / 6.0
        for i in range(memory.shape[0]):
            for j in range(memory.shape[1]):
                memory[i, j] += h * (km[0, i, j] + 2.0 * km[1, i, j] + 2.0 * km[2, i, j] + km[3, i, j]) / 6.0
                if laws[0][i] == SPRINGS:
                    memory[i, j] = min(max(memory[i, j], -laws[4][i, 1, j]), laws[4][i, 1, j])
                elif laws[0][i] != LUGRE:
                    memory[i, j] = min(max(memory[i, j], -laws[2][i]), laws[2][i])
        if (n + 1) % every == 0:
            _times(seen, x, out[(n + 1) // every])
    return out, x, v, memory


@nb.njit(cache=True)
def _slowly(gains, drive, laws, memory, increments):
    """Relative displacements after a slow load: u + G f(u) = drive at every level, by Newton's method."""
    contacts, total = len(drive), np.zeros(len(drive))
    force, tangent, trial, kept = np.zeros(contacts), np.zeros(contacts), memory.copy(), memory.copy()
    u, matrix = np.zeros(contacts), np.zeros((contacts, contacts))
    worst = 0.0
    for n in range(increments):
        goal, new, length, best = drive * ((n + 1) / increments), u.copy(), 1.0, np.inf
        point, step = u.copy(), np.zeros(contacts)
        for _ in range(200):
            trial[:] = memory
            for i in range(contacts):
                force[i] = _moved(laws, i, trial, new[i] - u[i])
            rest = new + gains @ force - goal
            size = np.sqrt(np.sum(rest**2))
            if size <= 1e-13 * np.sqrt(np.sum(goal**2)):
                break
            if size >= best and length > 1e-4:
                length *= 0.5
                new = point - length * step
                continue
            point, best, length = new.copy(), size, 1.0
            for i in range(contacts):
                nudge = 1e-7 * laws[2][i] / laws[1][i] * (1.0 if new[i] >= u[i] else -1.0)
                kept[:] = memory
                tangent[i] = (_moved(laws, i, kept, new[i] - u[i] + nudge) - force[i]) / nudge
            for i in range(contacts):
                for j in range(contacts):
                    matrix[i, j] = gains[i, j] * tangent[j] + (1.0 if i == j else 0.0)
            step = np.linalg.solve(matrix, rest)
            new = point - step
        worst = max(worst, size / np.sqrt(np.sum(goal**2)))
        u, memory[:], total = new.copy(), trial, force.copy()
    return u, total, worst


def released(rubbing: Rubbing, load: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State after ``load`` (n,) has been raised slowly: displacements, velocities, memories."""
    compliance = np.linalg.solve(rubbing.elastic, np.column_stack([load, rubbing.slips.T]))
    gains, drive = rubbing.slips @ compliance[:, 1:], rubbing.slips @ compliance[:, 0]
    memory = rubbing.memory()
    _, force, worst = _slowly(np.ascontiguousarray(gains), drive, rubbing.laws, memory, _RAMP)
    if not worst < 1e-9:
        raise ArithmeticError(f"static residual {worst:.1e}")
    x = compliance[:, 0] - compliance[:, 1:] @ force
    return x, np.zeros_like(x), memory


def followed(rubbing: Rubbing, paths: np.ndarray) -> np.ndarray:
    """Memories of the contacts after ``paths`` (sample, contact) from the unstressed state."""
    memory, before = rubbing.memory(), np.zeros(paths.shape[1])
    for u in paths:
        for i in range(len(u)):
            _moved(rubbing.laws, i, memory, float(u[i] - before[i]))
        before = u
    return memory


@dataclass(frozen=True)
class Motion:
    """What drives a run: samples (sample,) of a force, straight between them, or its amplitude at ``omega`` rad/s."""

    load: np.ndarray
    samples: int
    interval: float
    wave: np.ndarray | None = None
    omega: float = 0.0


def run(
    rubbing: Rubbing, motion: Motion, start: tuple[np.ndarray, ...], seen: np.ndarray, every: int
) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Samples (sample + 1, row) of ``seen`` @ x with ``every`` steps in an interval, and the state at the end."""
    h = motion.interval / every
    wave = np.zeros(1) if motion.wave is None else np.ascontiguousarray(motion.wave)
    numbers = h, every, motion.samples, motion.omega
    inverse: Callable[[Any], Any] = np.linalg.inv
    if np.any(rubbing.kind == LUGRE):
        matrices: Sequence[np.ndarray] = (inverse(rubbing.mass), rubbing.elastic, rubbing.damping, rubbing.slips)
        solver = _runge_kutta
    else:
        push = inverse(rubbing.mass + 0.5 * h * rubbing.damping)
        matrices = (push @ (rubbing.mass - 0.5 * h * rubbing.damping), push, rubbing.elastic, rubbing.slips)
        solver = _differences
    tables = tuple(np.ascontiguousarray(matrix) for matrix in matrices)
    out, x, v, memory = solver(tables, rubbing.laws, motion.load, wave, start, numbers, np.ascontiguousarray(seen))
    return out, (x, v, memory)


def truth(
    rubbing: Rubbing,
    motion: Motion,
    start: tuple[np.ndarray, ...],
    seen: np.ndarray,
    wanted: float,
    halvings: int = _MOST,
) -> tuple[np.ndarray, float]:
    """Samples (sample + 1, row), extrapolated from the last two steps, and their own error over the largest value.

    Steps are halved until that error is below ``wanted``, at most ``halvings`` times.
    """
    every = max(int(np.ceil(motion.interval * rubbing.fastest / (2 * np.pi) * _FIRST)), 1)
    fine, _ = run(rubbing, motion, start, seen, every)
    best, error = fine, np.inf
    for _ in range(halvings):
        every *= 2
        coarse, before = fine, best
        fine, _ = run(rubbing, motion, start, seen, every)
        best = fine + (fine - coarse) / 3.0
        size = np.abs(fine).max()
        # two extrapolated runs where there are two, else how far extrapolation reached
        error = float(np.abs(best - before).max() / size)
        if error <= wanted:
            break
    return best, error


_BLOCK, _LONGEST, _SAMPLES = 10, 600, 64
"""Periods after which a forced motion is looked at, how many it may have at least to settle, and samples in each."""
_DIED = 1e-2
"""What is left of a free motion, over what is wanted, when a motion has had its time."""


def steady(
    rubbing: Rubbing, load: np.ndarray, omega: float, start: tuple[np.ndarray, ...], seen: np.ndarray, wanted: float
) -> tuple[np.ndarray, float]:
    """First harmonic (row,) of ``seen`` @ x under ``load`` cos wt once it has settled, and its own error, relative.

    Steps are halved from there on, and the motion settles again. The error is what is left of the free motion and how
    far the last two extrapolated results are apart. Infinite where the motion does not settle.
    """
    every = max(int(np.ceil(rubbing.fastest / omega / _SAMPLES * _FIRST)), 1)
    coarse = best = np.full(len(seen), np.nan, complex)
    error = np.inf
    for _ in range(2 * _MOST):
        last, rest, end = _settled(rubbing, load, omega, start, seen, (every, wanted))
        every *= 2
        if not np.isfinite(rest):
            continue  # an explicit method grows or wanders where bristles slide far in a step
        known, before = bool(np.isfinite(coarse).all()), best
        best = last + (last - coarse) / 3.0 if known else last
        if known:
            error = float(np.linalg.norm(best - before) / np.linalg.norm(last)) + rest
        if error <= wanted:
            break
        coarse, start = last, end
    return best, error


def _settled(
    rubbing: Rubbing,
    load: np.ndarray,
    omega: float,
    start: tuple[np.ndarray, ...],
    seen: np.ndarray,
    numbers: tuple[int, float],
) -> tuple[np.ndarray, float, tuple[np.ndarray, ...]]:
    """First harmonic with ``numbers``: steps in a sample, and the error wanted; what is left to settle, and the state.

    A free motion dies no faster than viscous damping lets it. The time for that is given, however long it is: a motion
    cut off before has an error of its own, which no halving of the steps takes away.
    """
    every, wanted = numbers
    interval = 2 * np.pi / omega / _SAMPLES
    wave = 2 / _SAMPLES * np.exp(-2j * np.pi * np.arange(_SAMPLES) / _SAMPLES)
    motion = Motion(load, _BLOCK * _SAMPLES, interval, omega=omega)
    taken = rubbing.slowest * _BLOCK * _SAMPLES * interval
    blocks = max(int(np.ceil(-np.log(_DIED * wanted) / taken)), _LONGEST // _BLOCK)
    last, moves = np.full(len(seen), np.nan, complex), [np.inf] * 4
    for _ in range(blocks):
        samples, start = run(rubbing, motion, start, seen, every)
        first = wave @ samples[-_SAMPLES - 1 : -1]
        if not np.isfinite(first).all():
            return first, np.inf, start
        moves.append(float(np.linalg.norm(first - last) / np.linalg.norm(first)))
        last = first
        # A free motion beats with the forced one and may hide in a move: what is left of it is at most the largest of
        # the last moves over the part that a move takes of it.
        rest = float(np.max(moves[-4:])) / -np.expm1(-taken)
        if rest <= 0.3 * wanted:
            return last, rest, start
    return last, np.inf, start
