"""Do the 95 % bands of several beams hold 95 %? Random hosts with two beams, against a harmonic balance of its own.

``python -m tests.bench.several_beams 24 --seed 7`` draws hosts (finite elements of ``tests.bench.blind_hosts``), two beams
at random locations under normal forces of their own, and joints from the priors that the recipe states. The prediction
has eight noisy modes of the bare host; the truth has all of its finite elements and shares no code with ``ema``.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import time
import warnings
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ema import place
from ema.data import Geometry, ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.place.beams_forecast import refuse_overlap
from ema.place.location import located
from ema.shapes import smooth
from tests.bench.blind_hosts import hosts
from tests.bench.blind_hosts.elements import Bar
from tests.bench.blind_hosts.prediction import COVERS, FULL, recipe_of
from tests.bench.blind_hosts.truth import MAJORITY, Host, bar_modes

BEAMS, DRAWS = 2, 200
SHAPE_NOISE = 0.01
"""Noise of a measured shape over its root mean square."""
ORDERS = np.arange(1, 16, 2)
"""Harmonics of the balance; the friction force is odd."""
SAMPLES = 256
"""Samples of a period, of which two are marched through."""
RESIDUAL = 1e-8
"""Error of the balance over its slips at which it counts as solved."""
SPACING = 1.5e-3
"""Spacing of the frequencies that are looked at first, relative."""


class Joint(NamedTuple):
    """A true joint with one Masing spring: friction force N, k_T, k_N and rocking stiffness."""

    limit: float
    tangential: float
    normal: float
    rocking: float


@dataclass(frozen=True)
class Row:
    """One condition of a target mode: values are (Hz, damping ratio), each with its band; ``bare`` is a damping ratio."""

    host: int
    mode: int
    level: float
    bare: float
    truth: tuple[float, float]
    low: tuple[float, float]
    value: tuple[float, float]
    high: tuple[float, float]


class Truth:
    """Host and beams in free modes of their own, joined by springs and one Masing spring per joint.

    The equations are M q'' + ... = d F - R_s T - R_n K R_n^T q in the modes of the parts. With the receptances
    g = 1/(s (1 + j eta) - (k w)^2 + j k w c) of every harmonic k the slips are x = D F - C T, where the normal and
    rocking springs have been eliminated, and T(x) is marched through two periods of the motion (alternating
    frequency/time: Cameron and Griffin 1989).
    """

    def __init__(
        self, host: Host, bars: list[Bar], spots: list[place.Location], joints: list[Joint], height: float, loss: float
    ) -> None:
        omega, damping, shapes = host.modes(np.inf)
        self.host_modes, sway = len(omega), np.full(2, np.sqrt(4 * host.spring / host.mass))
        free = [bar_modes(bar) for bar in bars]
        frequencies = np.concatenate([omega, sway, *(part[0] for part in free)])
        decay = np.concatenate([2 * damping * omega, 2 * 0.03 * sway, np.zeros(len(frequencies) - len(omega) - 2)])
        losses = np.concatenate([np.zeros(len(omega) + 2), np.full(len(frequencies) - len(omega) - 2, loss)])
        self.squares, self.decay, self.losses, self.joints = frequencies**2, decay, losses, joints
        shear, gap, rock = (np.zeros((2 * len(bars), len(frequencies))) for _ in range(3))
        first = len(omega) + 2
        for number, (bar, spot) in enumerate(zip(bars, spots, strict=True)):
            _, own, nodes = free[number]
            along = np.array([np.cos(spot.angle), np.sin(spot.angle)])
            points = np.array(spot.centre) + 0.5 * bar.spacing * np.array([[-1.0], [1.0]]) * along
            deflection = host.plate.rows(points) @ shapes
            slope = (along[0] * host.plate.rows(points, 1) + along[1] * host.plate.rows(points, 0, 1)) @ shapes
            beam = slice(first, first + own.shape[1])
            for end in range(2):
                row, (u, w, turn) = 2 * number + end, own[3 * nodes[end] : 3 * nodes[end] + 3]
                shear[row, : len(omega)] = height * slope[end]
                shear[row, len(omega) : len(omega) + 2] = -along / np.sqrt(host.mass)
                shear[row, beam] = u + 0.5 * bar.height * turn
                gap[row, : len(omega)], gap[row, beam] = -deflection[end], w
                rock[row, : len(omega)], rock[row, beam] = -slope[end], turn
            first = beam.stop
        self.shear, self.springs = shear, np.vstack([gap, rock])
        self.stiffness = np.concatenate([[one.normal for one in joints], [one.rocking for one in joints]])
        self.limit, self.tangential = (np.array(part) for part in list(zip(*joints, strict=True))[:2])
        self.host, self.shapes = host, shapes

    def driven_at(self, point: np.ndarray) -> np.ndarray:
        """Row of the excited point."""
        row = np.zeros(len(self.squares))
        row[: self.host_modes] = (self.host.plate.rows(point[None]) @ self.shapes)[0]
        return row

    def linear(self, *, stuck: bool) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies Hz and mass-normalised shapes with joints that slide freely, or stick."""
        total = np.diag(self.squares) + self.springs.T @ (self.springs * self.stiffness[:, None])
        if stuck:
            total += self.shear.T @ (self.shear * self.tangential[:, None])
        values, shapes = np.linalg.eigh(total)
        return np.sqrt(np.maximum(values, 0)) / (2 * np.pi), shapes

    def receptances(self, omega: float, drive: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Compliance (contact, contact) of the slips at every harmonic, and the slips of a unit force at the first."""
        compliances, driven = [], np.zeros(len(self.limit), complex)
        for order in ORDERS:
            w = order * omega
            g = 1 / (self.squares * (1 + 1j * self.losses) - w**2 + 1j * w * self.decay)
            slips, springs = self.shear * g, self.springs * g
            yy, yx = springs @ self.springs.T, springs @ self.shear.T
            left = np.eye(len(yy)) / self.stiffness[:, None] + yy
            compliances.append(slips @ self.shear.T - yx.T @ np.linalg.solve(left, yx))
            if order == 1:
                driven = slips @ drive - yx.T @ np.linalg.solve(left, springs @ drive)
        return compliances, driven

    def motion(self, omega: float, load: float, drive: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Phasors of all modes at the first harmonic, with the first harmonic of the friction forces."""
        g = 1 / (self.squares * (1 + 1j * self.losses) - omega**2 + 1j * omega * self.decay)
        pushed = load * drive - self.shear.T @ forces
        seen = self.springs @ (g * pushed)
        left = np.eye(len(seen)) / self.stiffness[:, None] + (self.springs * g) @ self.springs.T
        return np.asarray(g * (pushed - self.springs.T @ np.linalg.solve(left, seen)))

    def solved(self, omega: float, load: float, drive: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slips (contact, harmonic) and modes at the first harmonic; NaN where no steady state is reached."""
        compliances, driven = self.receptances(omega, drive)
        size, orders = len(self.limit), len(ORDERS)
        coupled = np.zeros((size, orders, size, orders), complex)
        coupled[:, range(orders), :, range(orders)] = np.array(compliances)
        coupled = coupled.reshape(size * orders, -1)
        target = np.zeros((size, orders), complex)
        target[:, 0] = load * driven
        x = start.copy()
        for _ in range(60):
            forces, slopes = friction(x, self.limit, self.tangential, BASIS)
            left = x.ravel() + coupled @ forces.ravel() - target.ravel()
            error = float(np.abs(left).max() / np.abs(x[:, 0]).max())
            if error < RESIDUAL:
                return x, self.motion(omega, load, drive, forces[:, 0])
            jacobian = np.eye(2 * size * orders) + _real(coupled) @ slopes
            step = np.linalg.solve(jacobian, np.concatenate([left.real, left.imag]))
            moved = (step[: size * orders] + 1j * step[size * orders :]).reshape(size, orders)
            x = self._shortened(x, moved, coupled, target, float(np.linalg.norm(left)))
        return start, np.full(len(self.squares), np.nan, complex)

    def _shortened(
        self, x: np.ndarray, moved: np.ndarray, coupled: np.ndarray, target: np.ndarray, error: float
    ) -> np.ndarray:
        """A Newton step, halved until the balance is better."""
        for factor in 0.5 ** np.arange(8):
            tried = x - factor * moved
            forces, _ = friction(tried, self.limit, self.tangential, BASIS, False)
            if np.linalg.norm(tried.ravel() + coupled @ forces.ravel() - target.ravel()) < error:
                return tried
        return x - 0.3 * moved

    def resonance(self, mode: int, load: float, drive: np.ndarray) -> tuple[float, float]:
        """Hz and damping ratio at the peak of the excited point that belongs to a bare mode; NaN where there is none.

        Of the peaks in which this mode moves more than any other of the host, the one where it moves most. The damping
        ratio is P/(w^3 sum |q|^2) with the power P of the force, as in the blind bench.
        """
        ends, share = [], 1.0
        for stuck in (False, True):
            frequencies, shapes = self.linear(stuck=stuck)
            ends.append(frequencies[int(np.argmax(np.abs(shapes[mode])))])
            share = min(share, float(np.max(shapes[mode] ** 2)))
        if share < MAJORITY:
            return np.nan, np.nan
        low, high = 0.97 * min(ends), 1.03 * max(ends)
        grid = np.geomspace(low, high, int(np.log(high / low) / SPACING) + 2)
        compliances, driven = self.receptances(2 * np.pi * grid[0], drive)
        x = np.zeros((len(self.limit), len(ORDERS)), complex)
        x[:, 0] = np.linalg.solve(np.eye(len(x)) + compliances[0] * self.tangential, load * driven)
        known: dict[float, tuple[float, np.ndarray, np.ndarray]] = {}

        def look(f: float, start: np.ndarray) -> float:
            slips, q = self.solved(2 * np.pi * f, load, drive, start)
            known[f] = (float(np.abs(drive @ q)), q, slips)
            return known[f][0]

        for f in map(float, grid):
            look(f, x)
            x = known[f][2]
        heights = np.array([known[f][0] for f in map(float, grid)])
        best, part = -1, 0.0
        for k in range(1, len(grid) - 1):
            bare = np.abs(known[float(grid[k])][1][: self.host_modes])
            if heights[k - 1] < heights[k] >= heights[k + 1] and bare.argmax() == mode and bare[mode] > part:
                best, part = k, float(bare[mode])
        if best < 0:
            return np.nan, np.nan
        a, b, c = map(float, grid[best - 1 : best + 2])
        while c - a > 2e-6 * b:  # thirds: safe at a kinked peak
            left, right = a + (c - a) / 3, c - (c - a) / 3
            at_left, at_right = look(left, known[b][2]), look(right, known[b][2])
            if not (np.isfinite(at_left) and np.isfinite(at_right)):
                return np.nan, np.nan
            a, b, c = (a, left, right) if at_left > at_right else (left, right, c)
        omega, q = 2 * np.pi * b, known[b][1]
        return b, float(-0.5 * load * (drive @ q).imag / (omega**2 * np.sum(np.abs(q) ** 2)))


BASIS = np.exp(1j * np.outer(ORDERS, 2 * np.pi * np.arange(SAMPLES) / SAMPLES))


def _real(matrix: np.ndarray) -> np.ndarray:
    """A complex matrix acting on real and imaginary parts."""
    return np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])


@njit(cache=True)
def friction(slips, limits, stiffness, basis, slopes=True):
    """Harmonics (contact, harmonic) of the forces of Masing springs, and their derivatives in real and imaginary parts.

    A spring of k that slides at +-limit is marched through two periods; dT/dx is marched with it.
    """
    contacts, orders = slips.shape
    samples, size = basis.shape[1], contacts * orders
    forces = np.zeros((contacts, orders), np.complex128)
    jacobian = np.zeros((2 * size, 2 * size))
    for i in range(contacts):
        force, before = 0.0, 0.0
        slope, known = np.zeros(2 * orders), np.zeros(2 * orders)
        for step in range(2 * samples):
            at = step % samples
            x, row = 0.0, np.empty(2 * orders)
            for k in range(orders):
                x += (slips[i, k] * basis[k, at]).real
                row[k], row[orders + k] = basis[k, at].real, -basis[k, at].imag
            if step == 0:
                force, slope = stiffness[i] * x, stiffness[i] * row
            else:
                force += stiffness[i] * (x - before)
                slope = slope + stiffness[i] * (row - known)
            before, known = x, row
            if abs(force) > limits[i]:
                force, slope = math_sign(force) * limits[i], np.zeros(2 * orders)
            if step < samples:
                continue
            for k in range(orders):
                turned = np.conj(basis[k, at]) * (2 / samples)
                forces[i, k] += force * turned
                if slopes:
                    for m in range(2 * orders):
                        column = (m // orders) * size + i * orders + m % orders
                        jacobian[i * orders + k, column] += slope[m] * turned.real
                        jacobian[size + i * orders + k, column] += slope[m] * turned.imag
    return forces, jacobian


@njit(cache=True)
def math_sign(value):
    """1 or -1."""
    return 1.0 if value > 0 else -1.0


def bare_of(case: hosts.Case, rng: np.random.Generator) -> tuple[ModalModel, Geometry]:
    """Eight elastic modes of the host at the points of its test, with noise of their shapes and one calibration."""
    omega, damping, shapes = case.host.modes(np.inf)
    kept, points = slice(3, 3 + hosts.ELASTIC), case.measured.points
    seen = (case.host.plate.rows(points) @ shapes)[:, kept]
    seen = seen + SHAPE_NOISE * np.sqrt(np.mean(seen**2, axis=0)) * rng.standard_normal(seen.shape)
    values = (seen * np.sqrt(1 + hosts.CALIBRATION * rng.standard_normal())).astype(complex)
    dofs = tuple(Dof(1 + row, "+Z") for row in range(len(points)))
    poles = poles_from(omega[kept] / (2 * np.pi), damping[kept])
    model = ModalModel(poles, values, dofs, values / (2j * poles.imag), dofs, scaling="unit modal mass", name="host")
    flat = np.column_stack([points, np.zeros(len(points))])
    return model, Geometry(np.arange(1, len(points) + 1), flat)


def joints_of(sheet: hosts.Sheet, forces: list[float], rng: np.random.Generator) -> tuple[list[Joint], float]:
    """Two joints for every beam, and the height of the surface: what the recipe states, drawn."""
    std = {name: value / COVERS for name, value in hosts.STATED.items()}
    friction, tangential, normal, force, length = (
        float(np.exp(std[name] * rng.standard_normal()))
        for name in ("friction", "tangential", "normal", "force", "length")
    )
    exponent = max(sheet.exponent + std["exponent"] * rng.standard_normal(), 0.0)
    joints = []
    for nominal in (one for one in forces for _ in range(2)):
        pressed = nominal * force
        mu, k_t = np.exp(hosts.SCATTER * rng.standard_normal(2))
        joints.append(
            Joint(
                float(sheet.friction * friction * mu * pressed),
                float(sheet.tangential * tangential * k_t * (pressed / sheet.reference) ** exponent),
                sheet.normal * normal,
                sheet.normal * normal * (sheet.length * length) ** 2 / 12,
            )
        )
    return joints, float(sheet.height + std["height"] * rng.standard_normal())


def drawn_spots(recipe: Any, bare: ModalModel, geometry: Geometry, rng: np.random.Generator) -> list[place.Location]:
    """Locations for the beams that do not overlap."""
    effort = recipe.search
    surface = smooth(bare, geometry)
    spots = place.grid(surface, recipe.catalogue(), effort.step, np.radians(effort.angles).tolist(), (), effort.margin)
    for _ in range(1000):
        rows = rng.choice(len(spots), BEAMS, replace=False)
        chosen = [
            place.Location(centre=tuple(spots.centres[row].tolist()), angle=float(spots.angles[row])) for row in rows
        ]
        try:
            refuse_overlap([located(recipe, surface, one) for one in chosen], chosen)
        except InputError:
            continue
        return chosen
    raise ValueError("no two locations that do not overlap")


def rows_of(seed: int, number: int, draws: int) -> Iterator[Row]:
    """Both target modes of a host at every force level."""
    case = hosts.case(seed, number)
    rng = np.random.default_rng([seed, number, 1])
    sheet = hosts.Sheet(**{**asdict(case.sheet), "bar": case.sheet.bar, "length": 0.02, "normal_contact": "linear"})
    recipe = recipe_of(case.measured, sheet, {"name": "masing"}, FULL | {"form": "given"}, draws)
    bare, geometry = bare_of(case, rng)
    spots = drawn_spots(recipe, bare, geometry, rng)
    forces = np.exp(rng.uniform(np.log(25), np.log(200), BEAMS)).tolist()
    result = place.forecast_together(recipe, bare, geometry, spots, normal_forces=forces).forecast
    joints, height = joints_of(sheet, forces, rng)
    loss = float(sheet.loss * np.exp(hosts.LOSS_STD * rng.standard_normal()))
    truth = Truth(case.host, [sheet.bar] * BEAMS, spots, joints, height, loss)
    drive = truth.driven_at(case.measured.points[case.measured.drive])
    for row, mode in enumerate(case.modes):
        for column, level in enumerate(result.force_levels):
            bands = [
                (
                    float(getattr(result, f"frequency{end}")[row, column, 0]),
                    float(getattr(result, f"damping{end}")[row, column, 0]),
                )
                for end in ("_low", "", "_high")
            ]
            true = truth.resonance(mode, float(level), drive)
            yield Row(number, mode, float(level), float(result.bare_damping[row]), true, *bands)


def report(rows: list[Row]) -> str:
    """Coverage with a bootstrap over hosts, widths and errors; conditions with a truth and a band."""
    rng = np.random.default_rng(0)
    used = [row for row in rows if np.isfinite([*row.truth, *row.low, *row.high]).all()]
    lines = [f"{len({row.host for row in rows})} hosts, {len(rows)} conditions, {len(used)} with a truth and a band"]
    for active in (True, False):
        picked = [row for row in used if (row.truth[1] > 1.1 * row.bare) == active]
        if not picked:
            continue
        owners = np.array([row.host for row in picked])
        each = [np.flatnonzero(owners == host) for host in np.unique(owners)]
        for column, name in enumerate(("f", "zeta")):
            held = np.array([row.low[column] <= row.truth[column] <= row.high[column] for row in picked])
            half = np.array([50 * (row.high[column] - row.low[column]) / row.truth[column] for row in picked])
            error = np.array([100 * (row.value[column] / row.truth[column] - 1) for row in picked])
            again = [
                held[np.concatenate([each[n] for n in rng.integers(0, len(each), len(each))])].mean()
                for _ in range(2000)
            ]
            low, high = np.quantile(again, [0.025, 0.975])
            lines.append(
                f"{'active' if active else 'inactive':8s} {name:4s} inside {held.sum()} of {len(held)} = {held.mean():.1%} "
                f"[{low:.0%}, {high:.0%}]; half width median {np.median(half):.2f} %, 90th percentile "
                f"{np.quantile(half, 0.9):.1f} %; error median size {np.median(np.abs(error)):.2f} %, mean {error.mean():+.2f} %"
            )
    return "\n".join(lines)


def main() -> None:
    """Hosts one by one; the score at the end."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("hosts", type=int, nargs="?", default=24)
    options.add_argument("--seed", type=int, default=None)
    options.add_argument("--draws", type=int, default=DRAWS)
    options.add_argument("--out", type=Path)
    chosen = options.parse_args()
    seed = int(time.time()) if chosen.seed is None else chosen.seed
    warnings.simplefilter("ignore", RuntimeWarning)
    rows: list[Row] = []
    for number in range(chosen.hosts):
        started = time.process_time()
        try:
            rows += rows_of(seed, number, chosen.draws)
        except InputError as error:
            print(number, error, flush=True)
            continue
        print(number, f"{time.process_time() - started:.0f} s", flush=True)
        if chosen.out is not None:
            chosen.out.write_text(json.dumps({"seed": seed, "rows": [asdict(row) for row in rows]}))
    print(f"seed {seed}")
    print(report(rows))


if __name__ == "__main__":
    main()
