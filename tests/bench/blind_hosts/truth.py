"""The truth: two parts in free modes of their own, contact forces explicit in time. No code of ``ema``.

Host and beam are integrated mode by mode (central differences); whatever acts between them, normal springs included, is
an explicit force of sliders spread over each joint's patch. A slider j carries k_T w_j in shear up to mu_j N_j, with
the pressure p_j uneven over the patch:

* ``uneven``: N_j = p_j F_N;
* ``normal``: N_j = max(p_j F_N - k_N w_j gap_j, 0), which also lifts off: the patch rocks;
* ``weakening``: N_j = p_j F_N, and the friction falls with the speed, mu (k + (1 - k) exp(-|v|/v_s)).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.linalg import eigh

from tests.bench.blind_hosts.elements import Bar, Plate

STEP = 6e-6
"""s; central differences err by (omega h)^2 / 24: 1.5e-5 of a frequency of 500 Hz."""
HIGHEST = 7000.0
"""Hz up to which modes of the host are kept, and half of that of the beam; above it their static flexibility is."""
RESIDUAL = 14000.0
"""Hz of the modes that stand for the static flexibility of all that are left out: far above what is excited."""
SLIDERS = 9
FAMILIES = ("uneven", "normal", "weakening")
MAJORITY = 0.5
"""Share of a bare mode that one resonance has to hold to be that mode; else the truth has no number."""
SETTLED = 2e-4
"""Change of the extrapolated amplitude between blocks, relative, at which a steady state counts as reached."""


@dataclass(frozen=True)
class Joint:
    """The true joint: friction, stiffnesses in N/m at ``reference`` N, exponent of k_T, height in m, patch, family."""

    family: str
    friction: float
    tangential: float
    normal: float
    exponent: float
    height: float
    force_factor: float
    half_length: float
    pressure: tuple[tuple[float, ...], tuple[float, ...]]
    uneven: tuple[tuple[float, float], tuple[float, float]]
    weakening: float = 1.0
    slip_speed: float = 1.0
    reference: float = 100.0


@dataclass(frozen=True)
class Host:
    """The bare structure: finite elements with lumped masses on soft springs, and a damping ratio for every mode."""

    plate: Plate
    lumps: tuple[tuple[int, float], ...]
    spring: float
    damping: np.ndarray
    rigid_damping: float = 0.03

    @property
    def mass(self) -> float:
        """Kg."""
        return self.plate.per_area * self.plate.size[0] * self.plate.size[1] + sum(mass for _, mass in self.lumps)

    def modes(self, highest: float = HIGHEST) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Circular frequencies, damping ratios, mass-normalised shapes (unknown, mode) up to some frequency in Hz."""
        mass, stiffness = self.plate.matrices()
        for node, lump in self.lumps:
            mass[3 * node, 3 * node] += lump
        columns, rows = self.plate.cells
        for node in (0, rows, columns * (rows + 1), columns * (rows + 1) + rows):
            stiffness[3 * node, 3 * node] += self.spring
        values, vectors = eigh(stiffness, mass, subset_by_value=(-np.inf, (2 * np.pi * highest) ** 2))
        omega = np.sqrt(np.maximum(values, 1.0))
        damping = np.full(len(omega), self.rigid_damping)
        damping[3:] = np.resize(self.damping, len(omega) - 3)
        return omega, damping, vectors


def bar_modes(bar: Bar) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """Circular frequencies and shapes of the free beam, all of them, and the nodes of its joints."""
    mass, stiffness, nodes = bar.matrices()
    values, vectors = eigh(stiffness, mass)
    omega = np.sqrt(np.maximum(values, 0.0))
    omega[:3] = 0.0
    return omega, vectors, nodes


def condensed(omega: np.ndarray, rows: np.ndarray, highest: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Circular frequencies and rows (place, mode) of a part with its modes above ``highest`` Hz as static flexibility.

    The flexibility sum r r^T / omega^2 of what is left out is a sum over few modes at ``RESIDUAL``, one for each place
    at which the part is touched (residual attachment modes: MacNeal 1971, Computers and Structures 1:581). Third: the
    number of modes that are kept.
    """
    keep = omega < 2 * np.pi * highest
    left = rows[:, ~keep] / omega[~keep]
    values, vectors = np.linalg.eigh(left @ left.T)
    residual = 2 * np.pi * RESIDUAL * vectors * np.sqrt(np.maximum(values, 0.0))
    return (
        np.concatenate([omega[keep], np.full(len(values), 2 * np.pi * RESIDUAL)]),
        np.hstack([rows[:, keep], residual]),
        int(keep.sum()),
    )


@dataclass(frozen=True)
class Parts:
    """Both parts with the beam at one place.

    ``squares`` 1/s^2 and ``decay`` 1/s (mode,); ``rows`` (6, mode): shear, gap and rocking of the first joint, then of
    the second, as seen from the host to the beam. The first ``host_modes`` are those of the host; ``sway`` is the mode
    of the host's motion in its own plane, behind what stands for the flexibility of its others.
    """

    squares: np.ndarray
    decay: np.ndarray
    rows: np.ndarray
    drive: np.ndarray
    joint: Joint
    host_modes: int
    sway: int


def assembled(
    host: Host, bar: Bar, joint: Joint, loss: float, drive: np.ndarray, place: tuple[float, ...], mode: int = 3
) -> Parts:
    """The parts of a place (x, y of the middle in m, angle in rad) with a force at ``drive`` (x, y).

    The loss factor of the beam holds at the frequency of the bare ``mode``.
    """
    omega, damping, shapes = host.modes(np.inf)
    x, y, angle = place
    along = np.array([np.cos(angle), np.sin(angle)])
    points = np.array([x, y]) + 0.5 * bar.spacing * np.array([[-1.0], [1.0]]) * along
    deflection = host.plate.rows(points) @ shapes
    slope = (along[0] * host.plate.rows(points, 1) + along[1] * host.plate.rows(points, 0, 1)) @ shapes
    # a material loss factor eta is the viscous damping eta K / omega near omega
    near = omega[mode]
    drive_row = host.plate.rows(drive[None]) @ shapes
    omega, of_host, count = condensed(omega, np.vstack([deflection, slope, drive_row]), HIGHEST)
    free, bar_shapes, nodes = bar_modes(bar)
    touched = np.concatenate([[3 * node + k for k in range(3)] for node in nodes])
    free, of_bar, _ = condensed(free, bar_shapes[touched], 2 * HIGHEST)
    # the host also moves as a rigid body along the beam, on the same soft springs
    squares = np.concatenate([omega**2, [4 * host.spring / host.mass], free**2])
    damping = np.resize(damping, len(omega))
    decay = np.concatenate([2 * damping * omega, [2 * 0.03 * np.sqrt(squares[len(omega)])], loss * free**2 / near])
    beam, rows = len(omega) + 1, np.zeros((6, len(squares)))
    for n in range(2):
        u, w, turn = of_bar[3 * n : 3 * n + 3]
        rows[3 * n, : beam - 1] = joint.height * of_host[2 + n]
        rows[3 * n, beam - 1] = -1 / np.sqrt(host.mass)
        rows[3 * n, beam:] = u + 0.5 * bar.height * turn
        rows[3 * n + 1, : beam - 1], rows[3 * n + 1, beam:] = -of_host[n], w
        rows[3 * n + 2, : beam - 1], rows[3 * n + 2, beam:] = -of_host[2 + n], turn
    force = np.zeros(len(squares))
    force[: beam - 1] = of_host[4]
    return Parts(squares, decay, rows, force, joint, count, beam - 1)


@njit(cache=True, fastmath=False)
def run(q, v, shear, squares, decay, rows, drive, sliders, settings, phase, force, omega, step, steps):
    """March on; displacement under the force as a phasor, work, and the phasors of all modes.

    ``sliders`` (field, joint, slider): offset m, k_T, k_N, static normal force, friction. ``settings``: whether the
    limit follows the normal force, k and v_s of the weakening. The damping is taken implicitly.
    """
    modes, count = len(q), sliders.shape[2]
    f, sums = np.zeros(modes), np.zeros(modes, np.complex128)
    before = np.zeros(2)
    for n in range(2):
        for m in range(modes):
            before[n] += rows[3 * n, m] * q[m]
    over, work = 1 / (1 + 0.5 * step * decay), 0.0
    keep = 1 - 0.5 * step * decay
    for _ in range(steps):
        load = force * np.sin(phase)
        for m in range(modes):
            f[m] = drive[m] * load - squares[m] * q[m]
        for n in range(2):
            u, gap, turn = 0.0, 0.0, 0.0
            for m in range(modes):
                u += rows[3 * n, m] * q[m]
                gap += rows[3 * n + 1, m] * q[m]
                turn += rows[3 * n + 2, m] * q[m]
            du, before[n] = u - before[n], u
            falling = 1.0
            if settings[2] < 1:
                falling = settings[2] + (1 - settings[2]) * np.exp(-abs(du / step) / settings[3])
            total, normal, moment = 0.0, 0.0, 0.0
            for j in range(count):
                carried = sliders[2, n, j] * (gap + sliders[0, n, j] * turn)
                if settings[0] > 0 and carried > sliders[3, n, j]:
                    carried = sliders[3, n, j]
                pressed = sliders[3, n, j] - (carried if settings[0] > 0 else 0.0)
                limit = sliders[4, n, j] * falling * pressed
                shear[n, j] = min(max(shear[n, j] + sliders[1, n, j] * du, -limit), limit)
                total += shear[n, j]
                normal += carried
                moment += carried * sliders[0, n, j]
            for m in range(modes):
                f[m] -= rows[3 * n, m] * total + rows[3 * n + 1, m] * normal + rows[3 * n + 2, m] * moment
        turned = complex(np.cos(phase), -np.sin(phase))
        speed = 0.0
        for m in range(modes):
            sums[m] += q[m] * turned
            old = v[m]
            v[m] = (old * keep[m] + step * f[m]) * over[m]
            q[m] += step * v[m]
            speed += drive[m] * 0.5 * (old + v[m])
        work += load * speed * step
        phase += omega * step
    return 2j * sums / steps, work, phase


class Machine:
    """One place under one normal force, driven by a sine whose frequency and amplitude change without a jump."""

    def __init__(self, parts: Parts, normal_force: float) -> None:
        joint = parts.joint
        self.parts = parts
        pressed = normal_force * joint.force_factor
        stiffness = joint.tangential * (normal_force / joint.reference) ** joint.exponent
        offsets = joint.half_length * np.linspace(-1, 1, SLIDERS)
        self.sliders = np.zeros((5, 2, SLIDERS))
        for n in range(2):
            mu, k_t = joint.uneven[n]
            self.sliders[0, n] = offsets
            self.sliders[1, n] = stiffness * k_t / SLIDERS
            self.sliders[2, n] = joint.normal / SLIDERS
            self.sliders[3, n] = pressed * np.array(joint.pressure[n])
            self.sliders[4, n] = joint.friction * mu
        moving = 1.0 if joint.family == "normal" else 0.0
        self.settings = np.array([moving, 0.0, joint.weakening, joint.slip_speed])
        size = len(parts.squares)
        self.q, self.v, self.shear, self.phase = np.zeros(size), np.zeros(size), np.zeros((2, SLIDERS)), 0.0

    def block(self, frequency: float, level: float, periods: int) -> tuple[np.ndarray, float]:
        """Phasors of all modes relative to the force (whose phase is zero), and the work per period."""
        steps = round(periods / (frequency * STEP))
        parts = self.parts
        phasors, work, self.phase = run(
            self.q,
            self.v,
            self.shear,
            parts.squares,
            parts.decay,
            parts.rows,
            parts.drive,
            self.sliders,
            self.settings,
            self.phase % (2 * np.pi),
            level,
            2 * np.pi * frequency,
            STEP,
            steps,
        )
        return phasors, work / periods

    def steady(self, frequency: float, level: float, settled: float = SETTLED, most: int = 40) -> complex:
        """Displacement under the force in the steady state; the limit of the blocks is extrapolated (Aitken).

        ``self.motion`` keeps the phasors of all modes in the last block.
        """
        self.block(frequency, level, 12)
        known = [complex(self.parts.drive @ self.block(frequency, level, 6)[0]) for _ in range(2)]
        limit = 0j
        for _ in range(most):
            self.motion = self.block(frequency, level, 6)[0]
            known.append(complex(self.parts.drive @ self.motion))
            first, second = known[-2] - known[-3], known[-1] - known[-2]
            bend = second - first
            before = limit
            limit = known[-1] - second**2 / bend if abs(bend) > 1e-3 * abs(second) else known[-1]
            if abs(limit - before) < settled * abs(limit) and abs(second) < 10 * settled * abs(limit):
                break
        return limit

    def resonance(self, band: tuple[float, float], level: float, mode: int) -> tuple[float, float, float]:
        """Frequency Hz of the peak of the displacement under the force that belongs to a bare mode, damping ratio there.

        Of the peaks within the band in which this mode moves more than any other bare mode, the one where it moves
        most; NaN where there is none. The damping is the work per period over 4 pi times the largest kinetic energy of
        the fundamental, omega^2 sum |q|^2 / 2 over the modes of the parts. Third: the displacement.
        """
        grid = np.linspace(*band, max(9, int(np.ceil((band[1] / band[0] - 1) / 0.004)) + 1))
        known, share = {}, {}
        for f in map(float, grid):
            known[f] = abs(self.steady(f, level, 10 * SETTLED))
            bare = np.abs(self.motion[: self.parts.host_modes])
            share[f] = float(bare[mode]) if bare.argmax() == mode else 0.0
        order = sorted(known)
        peaks = [
            f
            for before, f, after in zip(order, order[1:], order[2:])
            if known[before] < known[f] >= known[after] and share[f] > 0
        ]
        if not peaks:
            return np.nan, np.nan, np.nan
        best = order.index(max(peaks, key=share.__getitem__))
        known = {f: known[f] for f in order[best - 1 : best + 2]}
        for _ in range(14):
            order = sorted(known)
            index = order.index(max(order, key=known.__getitem__))
            if index in (0, len(order) - 1):
                return np.nan, np.nan, np.nan
            a, b, c = order[index - 1 : index + 2]
            inverse = [1 / known[f] ** 2 for f in (a, b, c)]
            top = (b - a) ** 2 * (inverse[1] - inverse[2]) - (b - c) ** 2 * (inverse[1] - inverse[0])
            bottom = (b - a) * (inverse[1] - inverse[2]) - (b - c) * (inverse[1] - inverse[0])
            new = b - 0.5 * top / bottom
            close = 1e-4 * b
            if abs(new - b) < close:
                if max(b - a, c - b) < 25 * close:
                    break
                new = b + (10 if c - b > b - a else -10) * close
            new = float(np.clip(new, a + 0.1 * (b - a), c - 0.1 * (c - b)))
            known[new] = abs(self.steady(new, level))
        height = abs(self.steady(b, level, SETTLED / 10))
        phasors, work = self.block(b, level, 20)
        energy = 0.5 * (2 * np.pi * b) ** 2 * float(np.sum(np.abs(phasors) ** 2))
        return float(b), float(work / (4 * np.pi * energy)), float(height)


def linear(parts: Parts, normal_force: float, stuck: bool) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies Hz and mass-normalised shapes (mode, mode) with both joints free to slide, or stuck."""
    joint = parts.joint
    stiffness = np.diag(parts.squares)
    patch = joint.half_length**2 * np.mean(np.linspace(-1, 1, SLIDERS) ** 2)
    for n in range(2):
        springs = [joint.tangential * (normal_force / joint.reference) ** joint.exponent * stuck, joint.normal]
        for row, k in zip(parts.rows[3 * n : 3 * n + 3], [*springs, joint.normal * patch]):
            stiffness += k * np.outer(row, row)
    values, shapes = np.linalg.eigh(stiffness)
    return np.sqrt(np.maximum(values, 0)) / (2 * np.pi), shapes


def share(parts: Parts, normal_force: float, mode: int) -> float:
    """The largest share of a bare mode that one resonance holds, the smaller of joints that slide and that stick."""
    return min(float(np.max(linear(parts, normal_force, stuck)[1][mode] ** 2)) for stuck in (False, True))


def search_band(parts: Parts, normal_force: float, mode: int) -> tuple[float, float]:
    """Where the resonance of a bare mode can be: from the structure that slides to the one that sticks."""
    ends = []
    for stuck in (False, True):
        frequencies, shapes = linear(parts, normal_force, stuck)
        ends.append(float(frequencies[int(np.argmax(np.abs(shapes[mode])))]))
    return 0.97 * min(ends), 1.03 * max(ends)
