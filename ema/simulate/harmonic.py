"""Steady states under a harmonic force: harmonic balance at the contacts, friction forces in the time domain.

The structure is condensed on the relative displacements of the contacts, harmonic by harmonic; the unknowns are their
Fourier coefficients alone. Friction laws without preference of a direction give odd harmonics only. How many are kept
is decided point by point by an estimate of what the next ones, and twice the samples, would change.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Complex, Float
from scipy.linalg import lapack

from ema.data import BeamModel, Finding, HarmonicResponse
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.transient import Problem, prepare

_CONVERGED = 1e-9
_SMOOTH_PERIODS = 12
_POLISH = 8


@dataclass
class _Point:
    """A solution at one frequency: amplitudes (contact, 2 H) in m, its error estimate and losses."""

    amplitudes: np.ndarray
    error: float
    lost: np.ndarray
    forces: np.ndarray

    def next_start(self, tolerance: float) -> np.ndarray:
        """Amplitudes to start a neighbouring point from, with fewer harmonics where fewer would have done."""
        orders = self.amplitudes.shape[1] // 2
        if self.error < 0.2 * tolerance:
            orders = max(2, int(0.7 * orders))
        return self.amplitudes[:, : 2 * orders]


@dataclass
class Condensed:
    """A prepared model seen from its contacts and one driving force of amplitude ``force`` N."""

    problem: Problem
    driven: Dof
    force: float
    tolerance: float = 5e-3
    most_orders: int = 24
    limits: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        from ema.simulate import harmonic_kernels

        self.kernels: Any = harmonic_kernels
        base = self.problem.base
        self.coupled = np.flatnonzero(base.coupled)
        self.slip = np.ascontiguousarray(base.slip[:, self.coupled])
        self.squares, self.decay = base.frequencies[self.coupled] ** 2, base.decay[self.coupled]
        self.load = self.force * base.row(self.problem.system, self.driven)
        self.limits = self.problem.system.contacts.limits
        self.stiffness = self.problem.system.contacts.stiffness
        codes = self.problem.laws.codes
        self.simple = bool(np.all((codes == 0) & (self.problem.laws.counts == 1)))
        self.periods = 2 if np.all(codes <= 1) else _SMOOTH_PERIODS
        self._bases: dict[tuple[int, int], np.ndarray] = {}

    def basis(self, orders: int, samples: int) -> Float[np.ndarray, "sample size"]:
        """cos and sin of the odd harmonics 1, 3, ... over a period."""
        key = (orders, samples)
        if key not in self._bases:
            angle = 2 * np.pi * np.arange(samples)[:, None] / samples * (2 * np.arange(orders) + 1)
            self._bases[key] = np.ascontiguousarray(np.stack([np.cos(angle), np.sin(angle)], -1).reshape(samples, -1))
        return self._bases[key]

    def drive(self, omega: float, orders: int) -> Float[np.ndarray, "contact size"]:
        """Relative displacements of stuck contacts under the force alone."""
        gain = self.load[self.coupled] / (self.squares - omega**2 + 1j * omega * self.decay)
        response = self.slip @ gain
        out = np.zeros((len(response), 2 * orders))
        out[:, 0], out[:, 1] = response.real, -response.imag
        return out

    def contact_forces(
        self, amplitudes: np.ndarray, limits: np.ndarray, omega: float, want: bool, finer: int = 1
    ) -> tuple[np.ndarray, ...]:
        """Friction deviations, their Jacobian, losses and who slips."""
        orders = amplitudes.shape[1] // 2
        samples = finer * max(128, 16 * (2 * orders - 1))
        if self.simple:
            one: tuple[np.ndarray, ...] = self.kernels.masing_forces(
                np.ascontiguousarray(amplitudes), self.basis(orders, samples), self.stiffness, limits, want
            )
            return one
        interval = 2 * np.pi / (omega * samples)
        result: tuple[np.ndarray, ...] = self.kernels.contact_forces(
            np.ascontiguousarray(amplitudes), self.basis(orders, samples), interval, self.periods, self.stiffness,
            limits,            *self.problem.laws.arguments, want,
        )  # fmt: skip
        return result

    def gains(self, omega: float, orders: int) -> Complex[np.ndarray, "harmonic contact contact"]:
        """Receptances of the contacts at the harmonics."""
        return np.asarray(
            self.kernels.receptances(self.slip, self.squares, self.decay, omega, 2.0 * np.arange(orders) + 1)
        )

    def newton(
        self, omega: float, start: np.ndarray, gains: np.ndarray, limits: np.ndarray, most: int = 25
    ) -> tuple[np.ndarray | None, Any]:
        """Solve for the amplitudes from a start; ``None`` where it fails. Also the last factorised matrix."""
        orders = start.shape[1] // 2
        drive = self.drive(omega, orders)
        amplitudes = start.copy()
        forces, jacobian, _, slips = self.contact_forces(amplitudes, limits, omega, True)
        rest = self.kernels.residual(amplitudes, drive, gains, forces)
        norm = np.linalg.norm(rest)
        factors: Any = None
        for _ in range(most):
            moving = np.flatnonzero(slips)
            step, factors = self._step(gains, jacobian, moving, rest)
            if not np.all(np.isfinite(step)):
                return None, None
            length, better = 1.0, False
            for _halving in range(8):
                trial = amplitudes - length * step
                result = self.contact_forces(trial, limits, omega, True)
                new_rest = self.kernels.residual(trial, drive, gains, result[0])
                new_norm = np.linalg.norm(new_rest)
                if new_norm < (1 - 0.1 * length) * norm or new_norm <= _CONVERGED * np.linalg.norm(trial):
                    better = True
                    break
                length *= 0.5
            if not better:
                return None, None
            amplitudes, rest, norm = trial, new_rest, new_norm
            jacobian, slips = result[1], result[3]
            if norm <= _CONVERGED * np.linalg.norm(amplitudes):
                return amplitudes, factors
        return None, None

    def _step(
        self, gains: np.ndarray, jacobian: np.ndarray, moving: np.ndarray, rest: np.ndarray
    ) -> tuple[np.ndarray, Any]:
        """Newton step: the slipping contacts are solved for, the stuck ones follow."""
        if len(moving) == 0:
            return rest, None
        size = rest.shape[1]
        matrix = self.kernels.newton_matrix(gains, jacobian, moving)
        square = matrix[moving].reshape(len(moving) * size, -1)
        lu, pivots, info = lapack.dgetrf(square)
        if info != 0:
            return np.full_like(rest, np.nan), None
        solved, _ = lapack.dgetrs(lu, pivots, rest[moving].ravel())
        step = rest - (matrix.reshape(rest.size, -1) @ solved).reshape(rest.shape)
        step[moving] = solved.reshape(len(moving), size)
        return step, (lu, pivots, moving, matrix)

    def cold_start(self, omega: float, gains: np.ndarray) -> np.ndarray | None:
        """From the stuck state: slip forces are lowered from where nothing slips, in steps that adapt."""
        orders = len(gains)
        amplitudes = self.drive(omega, orders)
        reach = self.stiffness * np.hypot(amplitudes[:, 0], amplitudes[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            level = float(np.nanmax(np.where(self.limits > 0, reach / self.limits, 0.0)))
        if level <= 1:
            return self.newton(omega, amplitudes, gains, self.limits)[0]
        ratio, level = 0.5, level * 1.001
        while level > 1:
            wanted = max(level * ratio, 1.0)
            found, _ = self.newton(omega, amplitudes, gains, self.limits * wanted)
            if found is None:
                ratio = np.sqrt(ratio)
                if ratio > 0.999:
                    return None
                continue
            amplitudes, level = found, wanted
            ratio = max(ratio**1.5, 0.1)
        return amplitudes

    def solve(self, frequency: float, start: np.ndarray | None = None) -> _Point | None:
        """Solution at one frequency in Hz with as many harmonics as the tolerance asks for."""
        omega = 2 * np.pi * frequency
        orders = 2 if start is None else max(start.shape[1] // 2, 2)
        amplitudes, point = start, None
        while True:
            gains = self.gains(omega, orders)
            found, factors = (None, None) if amplitudes is None else self.newton(omega, amplitudes, gains, self.limits)
            if found is None:
                found = self.cold_start(omega, gains)
                if found is None:
                    return point
                _, factors = self.newton(omega, found, gains, self.limits)
            point = self.estimate(omega, found, gains, factors)
            if point.error <= self.tolerance or orders >= self.most_orders:
                return point
            orders = min(orders + max(1, orders // 2), self.most_orders)
            amplitudes = np.zeros((len(found), 2 * orders))
            amplitudes[:, : found.shape[1]] = found

    def estimate(self, omega: float, found: np.ndarray, gains: np.ndarray, factors: Any) -> _Point:
        """Polish a solution with eight times the samples, and see what twice the harmonics would change.

        Both by chord steps with the last Newton matrix.
        """
        size, orders = found.shape[1], found.shape[1] // 2
        if factors is None:
            forces, _, lost, _ = self.contact_forces(found, self.limits, omega, False, _POLISH)
            return _Point(found, 0.0, lost, forces)
        drive, found = self.drive(omega, orders), found.copy()
        scale = float(np.linalg.norm(found[:, :2]))
        for _ in range(6):
            forces, _, lost, _ = self.contact_forces(found, self.limits, omega, False, _POLISH)
            rest = self.kernels.residual(found, drive, gains, forces)
            if np.linalg.norm(rest) <= 1e-7 * scale:
                break
            found -= _chord(factors, rest)
        wide = np.zeros((len(found), 2 * size))
        wide[:, :size] = found
        more = self.contact_forces(wide, self.limits, omega, False)[0]
        all_drive, all_gains = self.drive(omega, 2 * orders), self.gains(omega, 2 * orders)
        wide[:, size:] -= self.kernels.residual(wide, all_drive, all_gains, more)[:, size:]
        more = self.contact_forces(wide, self.limits, omega, False, _POLISH // 2)[0]
        change = _chord(factors, self.kernels.residual(wide, all_drive, all_gains, more)[:, :size])
        return _Point(found, float(np.linalg.norm(change[:, :2])) / max(scale, 1e-300), lost, forces)

    def outputs(self, omega: float, point: _Point, rows: np.ndarray) -> Complex[np.ndarray, "dof harmonic"]:
        """Complex amplitudes of output DOFs (dof, mode)."""
        orders = point.amplitudes.shape[1] // 2
        base = self.problem.base
        amplitude = np.zeros((len(rows), orders), complex)
        for h in range(orders):
            w = omega * (2 * h + 1)
            pull = point.forces[:, 2 * h] - 1j * point.forces[:, 2 * h + 1]
            load = (self.load if h == 0 else 0 * self.load) - base.slip.T @ pull
            amplitude[:, h] = rows @ (load / (base.frequencies**2 - w**2 + 1j * w * base.decay))
        return amplitude

    def powers(self, omega: float, point: _Point) -> tuple[float, float, float]:
        """Mean input, friction and damping power in W."""
        base, orders = self.problem.base, point.amplitudes.shape[1] // 2
        damping = 0.0
        for h in range(orders):
            w = omega * (2 * h + 1)
            pull = point.forces[:, 2 * h] - 1j * point.forces[:, 2 * h + 1]
            load = (self.load if h == 0 else 0 * self.load) - base.slip.T @ pull
            q = load / (base.frequencies**2 - w**2 + 1j * w * base.decay)
            damping += 0.5 * float(np.sum(base.decay * np.abs(w * q) ** 2))
            if h == 0:
                supplied = 0.5 * float(np.real(np.conj(1j * w * q) @ self.load))
        return supplied, float(point.lost.sum()) * omega / (2 * np.pi), damping


def _chord(factors: Any, rest: np.ndarray) -> np.ndarray:
    """Newton step with a matrix that is already factorised."""
    lu, pivots, moving, matrix = factors
    solved, _ = lapack.dgetrs(lu, pivots, np.ascontiguousarray(rest[moving]).ravel())
    step = rest - (matrix.reshape(rest.size, -1) @ solved).reshape(rest.shape)
    step[moving] = solved.reshape(len(moving), rest.shape[1])
    return np.asarray(step)


def frf(
    model: BeamModel, frequencies: Float[np.ndarray, "freq"], force: float, at: Dof | str, outputs: Sequence[Dof | str],
    tolerance: float = 5e-3, modes: int | None = None, progress: Progress = silent,
) -> HarmonicResponse:  # fmt: skip
    """Steady states over frequency at one force level, each with its error estimate.

    Parameters
    ----------
    frequencies : Hz.
    force : amplitude in N of the force at DOF ``at``.
    outputs : DOFs whose amplitudes are wanted.
    tolerance : wanted error of the first harmonic of the slips, relative; harmonics are added until it is met.

    Raises
    ------
    InputError : the force is not positive, a frequency is not positive.
    """
    condensed = condense(model, force, at, outputs, tolerance, modes)
    if not len(frequencies) or not np.all(np.isfinite(frequencies)) or np.min(frequencies) <= 0:
        raise InputError("not frequencies of excitation", where=model.name, got=f"{len(frequencies)} values",
                         expected="finite, above 0 Hz")  # fmt: skip
    rows = np.array([condensed.problem.base.row(condensed.problem.system, dof) for dof in condensed.problem.outputs])
    points: list[_Point | None] = []
    start: np.ndarray | None = None
    for number, frequency in enumerate(frequencies):
        advance(progress, "frequencies", number, len(frequencies))
        point = condensed.solve(float(frequency), start)
        points.append(point)
        start = None if point is None else point.next_start(condensed.tolerance)
    return _response(condensed, np.asarray(frequencies), points, rows)


def condense(
    model: BeamModel,
    force: float,
    at: Dof | str,
    outputs: Sequence[Dof | str],
    tolerance: float,
    modes: int | None = None,
) -> Condensed:
    """A model seen from its contacts, ready for harmonic balance.

    Raises
    ------
    InputError : the force or the tolerance is not positive.
    """
    for name, value in (("force", force), ("tolerance", tolerance)):
        if not (np.isfinite(value) and value > 0):
            raise InputError("not a positive number", where=model.name, got=f"{name} = {value}", expected="above 0")
    driven = Dof.parse(at)
    return Condensed(prepare(model, outputs, modes, [driven]), driven, force, tolerance)


def _response(
    condensed: Condensed, frequencies: np.ndarray, points: list[_Point | None], rows: np.ndarray
) -> HarmonicResponse:
    most = max((p.amplitudes.shape[1] // 2 for p in points if p is not None), default=1)
    count, contacts = len(points), len(condensed.limits)
    values = np.full((count, len(rows), most), np.nan, complex)
    slips = np.full((count, contacts, most), np.nan, complex)
    powers, error = np.full((count, 3), np.nan), np.full(count, np.nan)
    for n, (frequency, point) in enumerate(zip(frequencies, points, strict=True)):
        if point is None:
            continue
        orders = point.amplitudes.shape[1] // 2
        omega = 2 * np.pi * frequency
        values[n], slips[n] = 0, 0
        values[n, :, :orders] = condensed.outputs(omega, point, rows)
        slips[n, :, :orders] = point.amplitudes[:, ::2] - 1j * point.amplitudes[:, 1::2]
        powers[n], error[n] = condensed.powers(omega, point), point.error
    where, findings = condensed.problem.system.name, list(condensed.problem.findings)
    solved = np.isfinite(error)
    if not solved.all():
        lost = frequencies[~solved]
        findings.append(Finding("error", "no-steady-state", where, f"no steady state found at {len(lost)} frequencies.",
                                float(lost[0]), None, "Use the time solver there."))  # fmt: skip
    if solved.any() and np.nanmax(error) > condensed.tolerance:
        worst = int(np.nanargmax(error))
        findings.append(Finding("warning", "harmonics", where,
                                f"error estimate {error[worst]:.1e} at {frequencies[worst]:.5g} Hz.",
                                float(error[worst]), condensed.tolerance, "Check it in time."))  # fmt: skip
    response = HarmonicResponse(
        frequencies, 2 * np.arange(most) + 1, values, condensed.problem.outputs, slips, condensed.force,
        condensed.driven,
        powers[:, 0], powers[:, 1], powers[:, 2], error, solved, (), where,
    )  # fmt: skip
    if solved.any() and response.power_error > 1e-4:
        findings.append(Finding("warning", "power-balance", where,
                                f"the power balance is off by {response.power_error:.1e}.",
                                response.power_error, 1e-4, "Lower the tolerance."))  # fmt: skip
    return HarmonicResponse(**{**response.__dict__, "findings": tuple(findings)})
