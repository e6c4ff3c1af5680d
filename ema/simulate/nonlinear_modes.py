"""Nonlinear modes of structures with joints: frequency, damping and shape over the modal amplitude.

A mode that loses energy is made periodic by a force that gives it back (extended periodic motion, Krack 2015). Here
that force is xi M v_1, proportional to the velocity of the fundamental and the mass, and acts on the fundamental alone:
higher harmonics keep the damping that they have. It is in quadrature with the motion, whose damping ratio is
xi / (2 w) = P / (w^3 q^2) with its mean power P.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Complex, Float

from ema.data import BeamModel, Finding, NonlinearMode, Provenance
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.continuation import Solution, bordered_newton
from ema.simulate.harmonic import (
    FEWEST_HARMONICS,
    FINEST,
    LEAST_ERROR,
    QUADRATURE,
    SAFETY,
    WIDER_STARTS,
    Condensed,
    condense,
    with_harmonics,
)

_LINEAR = 0.3
"""Share of the amplitude at which the first contact could slip or part, at which the mode is begun as a linear one."""
_UNMOVED = 1e-9
"""Slip of a contact over that in all modes together, in which each has an amplitude of 1, up to which a mode does not
move it: rounding of the shapes. A sticking contact that is a million times as stiff as the mode slips 1e-6."""
_WIDEST_STEP, _NARROWEST_STEP = 3.0, 1.004
"""Ratios of neighbouring amplitudes: the largest that is tried, and the smallest before a level counts as unsolved.
They bound the work; no sensitivity to them was measured."""
_NEAR = 1.2
"""Ratio of amplitudes that a start should bridge: where it does not, starts with more harmonics are tried."""
_FEWER = 0.6
"""Share of the harmonics of one amplitude with which those of the next one begin: the two last numbers are compared."""
_POWER = 1e-4
"""Open share of the power balance from which on a finding names it, as for forced motions."""
_REMEMBERED = 4
"""Frequencies whose receptances are kept: that of a Newton step and its three neighbours for differences."""


@dataclass
class _FreeMotion:
    """Motion at modal amplitude ``modal_amplitude``; further unknowns: w and xi in rad/s, and the coordinate ``mode``.

    The coordinate of one mode of the stuck structure, which has the phase 0, stands for itself: where nothing slips the
    equations of the contacts would be singular at the natural frequency otherwise.
    """

    condensed: Condensed
    mode: int
    modal_amplitude: float
    natural_frequency: float
    _kept: dict[tuple[float, float], tuple[np.ndarray, ...]] = field(default_factory=dict)

    @property
    def scales(self) -> Float[np.ndarray, "unknown"]:
        """Sizes of w, xi and the coordinate."""
        return np.array([self.natural_frequency, self.natural_frequency, self.modal_amplitude])

    def frequency(self, unknowns: np.ndarray) -> float:
        """Angular frequency in rad/s."""
        return float(unknowns[0])

    def contact_forces(self, amplitudes: np.ndarray, unknowns: np.ndarray) -> tuple[np.ndarray, ...]:
        """As ``Condensed.contact_forces``."""
        return self.condensed.contact_forces(amplitudes, float(unknowns[0]), self.condensed.fine)

    def moves_forces(self, index: int) -> bool:
        """They depend on the frequency where a law depends on velocities."""
        return index == 0 and bool(self.condensed.rates.any())

    def _others(self, omega: float, xi: float) -> tuple[np.ndarray, ...]:
        """All other modes at the fundamental.

        H_oo q_o = -H_om q_m - S_o^T G and H_mm q_m + H_mo q_o + S_m^T G = 0, H = W^2 - w^2 + j w (C - xi), S the slips
        of the modes. Returns H_oo^-1 [H_om, S_o^T] (other, 1 + contact), what drives the contacts (contact,) and
        modal force (scalar array) per q_m, and the receptances (contact, contact) without the mode.
        """
        if (omega, xi) not in self._kept:
            base, m = self.condensed.problem.base, self.mode
            others = np.arange(len(base.frequencies)) != m
            own = base.frequencies**2 - omega**2 + 1j * omega * (base.decay - xi)
            slip = base.slip[:, others]
            by_damping = np.zeros(slip.shape[1]) if base.damping is None else base.damping[others, m]
            between = 1j * omega * by_damping
            loads = np.column_stack([between, slip.T]).astype(complex)
            answer: np.ndarray = loads / own[others, None]
            if base.damping is not None:
                matrix = 1j * omega * base.damping[np.ix_(others, others)]
                np.fill_diagonal(matrix, own[others])
                answer = np.linalg.solve(matrix, loads)
            if len(self._kept) >= _REMEMBERED:
                self._kept.pop(next(iter(self._kept)))
            direct = np.asarray(own[m] - between @ answer[:, 0])
            self._kept[omega, xi] = answer, base.slip[:, m] - slip @ answer[:, 0], direct, slip @ answer[:, 1:]
        return self._kept[omega, xi]

    def gains(self, unknowns: np.ndarray, count: int) -> Float[np.ndarray, "2 harmonic contact contact"]:
        """Receptances of the contacts; those at the fundamental are without the mode."""
        with np.errstate(divide="ignore", invalid="ignore"):  # without damping the mode itself yields infinitely
            whole = self.condensed.gains(unknowns[0], count)
        own = self._others(unknowns[0], unknowns[1])[3]
        whole[0, self.condensed.excited], whole[1, self.condensed.excited] = own.real, own.imag
        return whole

    def rest(
        self, amplitudes: np.ndarray, forces: np.ndarray, unknowns: np.ndarray
    ) -> Float[np.ndarray, "contact size"]:
        """U - b q_m + Z G."""
        drive, at = np.zeros_like(amplitudes), 2 * self.condensed.excited
        response = unknowns[2] * self._others(unknowns[0], unknowns[1])[1]
        drive[:, at], drive[:, at + 1] = response.real, -response.imag
        gains = self.gains(unknowns, amplitudes.shape[1] // 2)
        return np.asarray(self.condensed.kernels.residual(amplitudes, drive, gains, forces))

    def conditions(
        self, amplitudes: np.ndarray, forces: np.ndarray, unknowns: np.ndarray
    ) -> Float[np.ndarray, "unknown"]:
        """Real and imaginary part of the mode's own equation, and the modal amplitude."""
        _, response, direct, _ = self._others(unknowns[0], unknowns[1])
        balance = direct * unknowns[2] + response @ self._fundamental(forces)
        balance = balance / (self.natural_frequency**2 * self.modal_amplitude)
        norm = np.linalg.norm(self.fundamental(forces, unknowns)) / self.modal_amplitude
        return np.array([balance.real, balance.imag, norm - 1.0])

    def _fundamental(self, forces: np.ndarray) -> Complex[np.ndarray, "contact"]:
        at = 2 * self.condensed.excited
        return np.asarray(forces[:, at] - 1j * forces[:, at + 1])

    def fundamental(self, forces: np.ndarray, unknowns: np.ndarray) -> Complex[np.ndarray, "mode"]:
        """Complex amplitudes of all modes of the stuck structure at the fundamental."""
        answer = self._others(unknowns[0], unknowns[1])[0]
        others = -answer[:, 0] * unknowns[2] - answer[:, 1:] @ self._fundamental(forces)
        return np.insert(others, self.mode, unknowns[2])

    def at(self, amplitude: float) -> "_FreeMotion":
        """The same at another modal amplitude."""
        return _FreeMotion(self.condensed, self.mode, amplitude, self.natural_frequency, self._kept)

    def powers(self, solution: Solution) -> tuple[float, float, float]:
        """Mean power of the force that keeps the motion up, and losses in contacts and in other damping in W."""
        omega, condensed = solution.unknowns[0], self.condensed
        with np.errstate(divide="ignore", invalid="ignore"):  # that of the fundamental is replaced
            q = condensed.motions(omega, (solution.forces[:, ::2] - 1j * solution.forces[:, 1::2]).T)
        q[condensed.excited] = self.fundamental(solution.forces, solution.unknowns)
        speed = 1j * omega * condensed.orders(solution.count)[:, None] * q
        base = condensed.problem.base
        lossy = base.decay * speed if base.damping is None else speed @ base.damping
        given = 0.5 * solution.unknowns[1] * (omega * self.modal_amplitude) ** 2
        damping = 0.5 * float(np.real(np.sum(np.conj(speed) * lossy)))
        return given, float(solution.lost.sum()) * omega / (2 * np.pi), damping


def _linear_mode(condensed: Condensed, near: float) -> tuple[_FreeMotion, Solution]:
    """The mode nearest to ``near`` Hz at an amplitude at which contacts stick, or slide without any force."""
    base, room = condensed.problem.base, condensed.room()
    free = np.where(room > 0, 0.0, condensed.stiffness)
    squares, shapes = np.linalg.eigh(np.diag(base.frequencies**2) - base.slip.T @ (free[:, None] * base.slip))
    frequencies = np.sqrt(np.maximum(squares, 0.0))
    index = int(np.argmin(np.abs(frequencies / (2 * np.pi) - near)))
    if frequencies[index] < 1e-6 * frequencies[-1]:
        raise InputError(
            "a motion of the whole structure is no mode that friction could damp",
            where=condensed.problem.system.name,
            got=f"{near:g} Hz",
            expected="a frequency near that of an elastic mode",
        )
    omega, shape = float(frequencies[index]), shapes[:, index]
    mode = int(np.argmax(np.abs(shape)))
    shape = shape * np.sign(shape[mode])
    slip = base.slip @ shape
    moved = (room > 0) & (np.abs(slip) > _UNMOVED * np.linalg.norm(base.slip, axis=1))
    amplitude = _LINEAR * float((room[moved] / (condensed.stiffness * np.abs(slip))[moved]).min(initial=np.inf))
    if not np.isfinite(amplitude):
        amplitude = 1.0
    damping = base.decay * shape if base.damping is None else base.damping @ shape
    motion = np.zeros((len(slip), 2 * (condensed.harmonics or FEWEST_HARMONICS)))
    motion[:, 2 * condensed.excited] = amplitude * slip
    unknowns = np.array([omega, float(shape @ damping), amplitude * shape[mode]])
    start = Solution(motion, unknowns, np.zeros_like(motion), np.zeros(len(slip)), np.zeros(len(slip), bool))
    return _FreeMotion(condensed, mode, amplitude, omega), start


def _scaled(solution: Solution, ratio: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Start at an amplitude that is ``ratio`` times larger, with ``count`` harmonics."""
    return ratio * with_harmonics(solution.amplitudes, count), solution.unknowns * np.array([1.0, 1.0, ratio])


def _solved(motion: _FreeMotion, amplitudes: np.ndarray, unknowns: np.ndarray) -> Solution | None:
    """Solution with forces integrated as finely as they ask for."""
    condensed = motion.condensed
    least = _UNMOVED * motion.modal_amplitude * float(np.linalg.norm(condensed.problem.base.slip))
    while True:
        found = bordered_newton(motion, amplitudes, unknowns, least)
        if found is None or condensed.exact or not found.slips.any() or condensed.fine >= FINEST:
            return found
        lost, blur = condensed.refined(found.amplitudes, found.forces, found.lost, float(found.unknowns[0]))
        if blur <= QUADRATURE:
            return Solution(found.amplitudes, found.unknowns, found.forces, lost, found.slips)
        condensed.fine, amplitudes, unknowns = 2 * condensed.fine, found.amplitudes, found.unknowns


def _reached(start: _FreeMotion, solution: Solution, amplitude: float) -> tuple[_FreeMotion, Solution] | None:
    """The motion at another amplitude, in steps of ratios that adapt."""
    motion, ratio, condensed = start, _WIDEST_STEP, start.condensed
    while True:
        way = float(np.clip(amplitude / motion.modal_amplitude, 1 / ratio, ratio))
        there = amplitude if 1 / ratio < way < ratio else motion.modal_amplitude * way
        nearer = motion.at(there)
        found = _solved(nearer, *_scaled(solution, way, solution.count))
        for count in WIDER_STARTS if found is None and ratio < _NEAR and condensed.harmonics is None else ():
            # forces that hardly follow the displacement may have no solution with few harmonics
            found = found or _solved(nearer, *_scaled(solution, way, max(count, solution.count)))
        if found is None:
            ratio = float(np.sqrt(ratio))
            if ratio < _NARROWEST_STEP:
                return None
        else:
            motion, solution, ratio = nearer, found, min(ratio**1.5, _WIDEST_STEP)
            if there == amplitude:
                return motion, solution


def _converged(motion: _FreeMotion, solution: Solution, expected: int) -> tuple[Solution, float, float]:
    """Solution with as many harmonics as the tolerance asks for, and errors of frequency and damping, relative.

    ``expected``: number of harmonics that comes next, unless the solution has as many.
    """
    condensed, errors = motion.condensed, (1.0, 1.0)
    if not solution.slips.any():
        return solution, 0.0, 0.0
    while True:
        count = max(solution.count + max(1, solution.count // 2), min(expected, condensed.most_orders))
        wider = _solved(motion, with_harmonics(solution.amplitudes, count), solution.unknowns)
        if wider is None:
            return solution, *errors
        (omega, xi), (before, xi_before) = wider.unknowns[:2], solution.unknowns[:2]
        floor, ratio = LEAST_ERROR * condensed.tolerance, abs(xi / (2 * omega))
        damping = max(SAFETY * abs(float(xi * before / (xi_before * omega)) - 1), floor)
        errors = max(SAFETY * abs(float(omega / before) - 1), floor * ratio), damping
        if condensed.harmonics is not None:
            return solution, *errors
        solution = wider
        if damping <= condensed.tolerance or count >= condensed.most_orders:
            return solution, *errors


def backbone(
    model: BeamModel,
    amplitudes: Sequence[float] | Float[np.ndarray, "level"],
    *,
    near: float,
    outputs: Sequence[Dof | str],
    tolerance: float = 5e-3,
    harmonics: int | None = None,
    progress: Progress = silent,
) -> NonlinearMode:
    """Compute frequency, damping ratio and shape of one mode over its amplitude: a nonlinear mode.

    Parameters
    ----------
    model : BeamModel
        The model.
    amplitudes : sequence of float or array of shape (level,)
        Modal amplitudes q [m sqrt(kg)], in any order.
    near : float
        Frequency [Hz]; the mode with stuck contacts whose natural frequency is nearest is followed.
    outputs : sequence of Dof or str
        DOFs of the shape.
    tolerance : float, default 0.005
        Relative error of the damping ratio that is aimed at; harmonics are added until it is met.
    harmonics : int, optional
        Highest harmonic kept, instead of as many as the tolerance asks for.
    progress : Progress, optional
        Called after each level.

    Returns
    -------
    NonlinearMode
        Levels without a solution are NaN and named in a finding.

    Raises
    ------
    InputError
        If there is no amplitude or one that is not positive, or ``near`` is not above 0 Hz or is a rigid-body motion.

    References
    ----------
    .. [1] Extended periodic motion: Krack (2015), Computers & Structures 154:59.

    Examples
    --------
    >>> from ema.data import Damping
    >>> from ema.simulate import Masing, Section, backbone, double_beam
    >>> section = Section(0.5, 0.04, 0.005, elements=4)
    >>> model = double_beam(Masing(0.3, 1e9), 1000.0, section, damping=Damping(ratio=0.003))
    >>> mode = backbone(model, [1e-5, 1e-2], near=32.0, outputs=["beam 2:4:+Z"])
    >>> bool(mode.frequencies[0] > mode.frequencies[1])
    True
    """
    levels = np.asarray(amplitudes, dtype=float)
    if levels.ndim != 1 or not len(levels) or not (np.all(np.isfinite(levels)) and np.all(levels > 0)):
        raise InputError(
            "not modal amplitudes", where=model.name, got=str(amplitudes), expected="one or more above 0, in m sqrt(kg)"
        )
    if not (np.isfinite(near) and near > 0):
        raise InputError("not a frequency", where=model.name, got=near, expected="above 0 Hz")
    if not outputs:
        raise InputError("no DOF whose shape is wanted", where=model.name, got="no outputs", expected="one or more")
    condensed = condense(model, 1.0, outputs[0], outputs, tolerance)
    condensed.keep(harmonics)
    motion, solution = _linear_mode(condensed, near)
    shapes = np.full((len(outputs), len(levels)), np.nan, complex)
    table = np.full((6, len(levels)), np.nan)
    unbalanced, expected = 0.0, 0
    for done, level in enumerate(np.argsort(levels)):
        advance(progress, "backbone", done, len(levels))
        found = _reached(motion, solution, float(levels[level]))
        if found is None:
            continue
        motion = found[0]
        solution = found[1]
        best, *errors = _converged(motion, solution, expected)
        expected = int(_FEWER * best.count)
        shapes[:, level] = condensed.rows @ motion.fundamental(best.forces, best.unknowns) / motion.modal_amplitude
        given, friction, damping = motion.powers(best)
        omega, xi = best.unknowns[:2]
        table[:, level] = omega / (2 * np.pi), xi / (2 * omega), friction, damping, *errors
        if given > 0:
            unbalanced = max(unbalanced, abs(given - friction - damping) / given)
    return NonlinearMode(
        levels,
        table[0],
        table[1],
        shapes,
        condensed.problem.outputs,
        table[2],
        table[3],
        table[4],
        table[5],
        findings=(*condensed.problem.findings, *_findings(model.name, levels, table, tolerance, unbalanced)),
        name=model.name,
        provenance=Provenance(options=(("tolerance", str(tolerance)), ("near", f"{near:g} Hz")), steps=("backbone",)),
    )


def _findings(
    name: str, levels: np.ndarray, table: np.ndarray, tolerance: float, unbalanced: float
) -> tuple[Finding, ...]:
    """What is missing, and what is less accurate than it should be."""
    missing, out = np.isnan(table[0]), []
    if missing.any():
        least = float(levels[missing].min())
        text = (
            f"no periodic motion found at {missing.sum()} of {len(levels)} amplitudes, from {least:.3g} m sqrt(kg) on."
        )
        advice = "Ask for amplitudes closer together, or use resonances at force levels."
        out.append(Finding("error", "no-steady-state", name, text, least, None, advice))
    if not missing.all() and np.nanmax(table[5]) > tolerance:
        worst = int(np.nanargmax(table[5]))
        text = f"error estimate of damping {table[5, worst]:.1e} at {levels[worst]:.3g} m sqrt(kg)."
        out.append(Finding("warning", "harmonics", name, text, float(table[5, worst]), tolerance, "Check it in time."))
    if unbalanced > _POWER:
        text = f"the power balance is off by {unbalanced:.1e}."
        out.append(Finding("warning", "power-balance", name, text, unbalanced, _POWER, "Lower the tolerance."))
    return tuple(out)
