"""Motion in time, exact: closed-form modal motion between the instants at which a Masing spring sticks or slips.

While no spring changes, the structure is linear. Its modes are found for every pattern of stuck and sliding springs,
the motion is followed in closed form to the next change, and so on: no step, no numerical damping. The only
approximation is the spacing of the instants at which a change is looked for.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, EnergyBalance, Finding, Response
from ema.dof import Dof
from ema.errors import FailureError, InputError
from ema.progress import Progress, advance, silent
from ema.simulate.friction import PIECEWISE_LINEAR, springs_of
from ema.simulate.transient import Problem, displacement_findings, energy_findings, prepare, released

_KEEP = 4000
_MOST_AT_ONCE = 50


@dataclass
class _Springs:
    """All Masing springs: contact, stiffness, limit, where they rest, and how they slide (-1, 0 stuck, 1)."""

    contact: np.ndarray
    stiffness: np.ndarray
    limit: np.ndarray
    rest: np.ndarray
    slide: np.ndarray
    begun: np.ndarray
    """Relative displacement at which a sliding spring began to slide."""


@dataclass(frozen=True)
class _Phase:
    """Modes of one pattern of stuck and sliding springs, in the modes of the stuck structure."""

    squares: np.ndarray
    vectors: np.ndarray
    slip: np.ndarray
    rates: np.ndarray


class _Reference:
    """A piecewise linear structure that moves from event to event."""

    def __init__(self, problem: Problem, memory: np.ndarray, u: np.ndarray, harmonic: "Harmonic | None") -> None:
        base, contacts = problem.base, problem.system.contacts
        self.problem, self.base, self.harmonic = problem, base, harmonic
        self.coupled = np.flatnonzero(base.coupled)
        self.slip = np.ascontiguousarray(base.slip[:, self.coupled])
        rows = [
            (i, contacts.stiffness[i] * k, contacts.limits[i] * f, memory[i, j])
            for i, law in enumerate(contacts.laws)
            for j, (k, f) in enumerate(zip(*springs_of(law), strict=True))
            if contacts.limits[i] * f > 0
        ]
        table = np.array(rows).reshape(-1, 4).T
        contact, stiffness, limit, force = (np.ascontiguousarray(part) for part in table)
        contact = contact.astype(np.int64)
        sliding = np.where(np.abs(force) >= limit * (1 - 1e-12), np.sign(force), 0.0)
        self.springs = _Springs(contact, stiffness, limit, u[contact] - force / stiffness, sliding, u[contact].copy())
        self.mass_factor = problem.system.damping.mass_factor
        self.phases: OrderedDict[bytes, _Phase] = OrderedDict()
        self.lost = np.zeros(len(contacts.limits))
        self.slid_time = np.zeros(len(contacts.limits))
        self.load = None if harmonic is None else harmonic.force * base.row(problem.system, harmonic.at)[self.coupled]

    def phase(self) -> _Phase:
        """Modes of the present pattern; the last few thousand are kept."""
        springs = self.springs
        key = springs.slide.astype(np.int8).astype(bool).tobytes()
        if key in self.phases:
            self.phases.move_to_end(key)
            return self.phases[key]
        stuck = np.where(springs.slide == 0, springs.stiffness, 0.0)
        present = np.bincount(springs.contact, stuck, len(self.slip))
        missing = self.problem.system.contacts.stiffness - present
        matrix = np.diag(self.base.frequencies[self.coupled] ** 2) - self.slip.T @ (missing[:, None] * self.slip)
        squares, vectors = np.linalg.eigh(matrix)
        half = self.mass_factor / 2
        rates = -half + np.sqrt((half**2 - squares).astype(complex))
        made = _Phase(squares, vectors, np.ascontiguousarray(self.slip @ vectors), rates)
        self.phases[key] = made
        if len(self.phases) > _KEEP:
            self.phases.popitem(last=False)
        return made

    def waves(self, phase: _Phase, q: np.ndarray, p: np.ndarray, time: float) -> tuple[Any, ...]:
        """Free complex amplitudes, rest position and forced amplitudes of a phase that begins at ``time``."""
        springs = self.springs
        pull = np.where(springs.slide == 0, springs.stiffness * springs.rest, -springs.slide * springs.limit)
        force = np.bincount(springs.contact, pull, len(self.slip))
        mean = (phase.slip.T @ force) / phase.squares
        tide, pulse = np.zeros(len(mean), complex), 0.0
        if self.harmonic is not None and self.load is not None:
            pulse = 2 * np.pi * self.harmonic.frequency
            gain = phase.squares - pulse**2 + 1j * pulse * self.mass_factor
            tide = (phase.vectors.T @ self.load) / gain * np.exp(1j * (pulse * time + self.harmonic.phase))
        x = phase.vectors.T @ q - mean - tide.real
        v = phase.vectors.T @ p + pulse * tide.imag
        real, imaginary = phase.rates.real, phase.rates.imag
        # x = Re(wave), v = Re(rate wave)
        wave = x + 1j * np.divide(real * x - v, imaginary, out=np.zeros_like(x), where=imaginary != 0)
        return wave, mean, tide, pulse

    def rounding(self, state: Any) -> tuple[float, float]:
        """Relative displacement and velocity below which rounding, not motion, decides."""
        omega = self.base.frequencies[self.coupled]
        size = np.abs(state.q[self.coupled]) + np.abs(state.p[self.coupled]) / omega
        if self.load is not None:
            size = size + np.abs(self.load) / omega**2
        return (
            1e-13 * float((np.abs(self.slip) @ size).max()), 1e-12 * float((np.abs(self.slip) @ (omega * size)).max())
        )  # fmt: skip

    def change(self, spring: int, u: float) -> None:
        """Let one spring stick or slip at relative displacement u."""
        springs = self.springs
        if springs.slide[spring] == 0:
            springs.slide[spring] = np.sign(u - springs.rest[spring])
            springs.begun[spring] = u
        else:
            self.lost[springs.contact[spring]] += springs.limit[spring] * abs(u - springs.begun[spring])
            springs.rest[spring] = u - springs.slide[spring] * springs.limit[spring] / springs.stiffness[spring]
            springs.slide[spring] = 0.0

    def forces(self, u: np.ndarray) -> np.ndarray:
        """Friction force of every spring at relative displacements u (contact,)."""
        springs = self.springs
        stuck = springs.stiffness * (u[springs.contact] - springs.rest)
        return np.where(springs.slide == 0, stuck, springs.slide * springs.limit)


@dataclass(frozen=True)
class Harmonic:
    """A harmonic force F cos(2 pi f t + phase) at one DOF: N, Hz, rad."""

    force: float
    frequency: float
    at: Dof
    phase: float = 0.0


def snapback_reference(
    model: BeamModel, load: float, at: Dof | str, duration: float, outputs: Sequence[Dof | str] | None = None,
    sampling_rate: float = 5000.0, spacing: float | None = None, check: bool = False, progress: Progress = silent,
) -> Response:  # fmt: skip
    """The snap-back of ``ema.simulate.snapback``, exact between the events of Masing-type laws.

    ``spacing`` s of the instants at which an event is looked for; a sixth of the shortest period by default. With
    ``check`` the run is repeated at half the spacing and the difference is the error estimate.

    Raises
    ------
    InputError : a law is not piecewise linear, the background damping is not proportional to mass.
    """
    dof = Dof.parse(at)
    problem = prepare(model, outputs or [dof])
    state = released(problem, load, dof)
    first = run_reference(problem, state, duration, sampling_rate, spacing, None, progress)
    if not check:
        return first
    closer = 0.5 * first.step
    second = run_reference(problem, state, duration, sampling_rate, closer, None, progress)
    error = np.abs(first.displacements - second.displacements).max() / max(np.abs(second.displacements).max(), 1e-300)
    return Response(**{**second.__dict__, "error_estimate": float(error)})


def run_reference(
    problem: Problem, state: Any, duration: float, sampling_rate: float, spacing: float | None,
    harmonic: Harmonic | None, progress: Progress = silent,
) -> Response:  # fmt: skip
    """Follow a prepared model from a state for ``duration`` s.

    Raises
    ------
    InputError : a law is not piecewise linear, the damping is not proportional to mass, a number is not positive.
    FailureError : too many events.
    """
    from ema.simulate import event_kernels

    kernels: Any = event_kernels
    _check(problem, duration, sampling_rate)
    reference = _Reference(problem, state.z, state.u, harmonic)
    base, coupled = problem.base, reference.coupled
    spacing = spacing or (2 * np.pi / float(base.frequencies[coupled].max()) / 6)
    count = max(round(duration * sampling_rate), 1)
    times = np.arange(count + 1) / sampling_rate
    q, p = np.zeros((count + 1, len(coupled))), np.zeros((count + 1, len(coupled)))
    spring_force = np.zeros((count + 1, len(reference.springs.contact)))
    slid = np.zeros((count + 1, len(reference.lost)))
    q[0], p[0] = state.q[coupled], state.p[coupled]
    spring_force[0] = reference.forces(state.u)
    now, here, speed, sample, events, halted = 0.0, q[0].copy(), p[0].copy(), 1, 0, 0
    end = float(times[-1])
    springs = reference.springs
    blur, still = reference.rounding(state)
    while sample <= count:
        phase = reference.phase()
        wave, mean, tide, pulse = reference.waves(phase, here, speed, now)
        length, spring = kernels.next_event(
            phase.slip, wave, phase.rates, mean, tide, pulse, springs.contact, springs.slide, springs.stiffness,
            springs.limit, springs.rest, min(end - now, 0.02) + 1e-12, spacing, blur, still,
        )  # fmt: skip
        while sample <= count and times[sample] <= now + length:
            eta = kernels.motion(wave, phase.rates, mean, tide, pulse, times[sample] - now)
            q[sample], p[sample] = phase.vectors @ eta[0], phase.vectors @ eta[1]
            u = reference.slip @ q[sample]
            spring_force[sample] = reference.forces(u)
            sliding = springs.slide != 0
            slid[sample] = reference.lost
            path = springs.limit * np.abs(u[springs.contact] - springs.begun)
            slid[sample] += np.bincount(springs.contact, np.where(sliding, path, 0.0), len(u))
            sample += 1
            advance(progress, "events", sample - 1, count)
        eta = kernels.motion(wave, phase.rates, mean, tide, pulse, length)
        here, speed = phase.vectors @ eta[0], phase.vectors @ eta[1]
        reference.slid_time += np.bincount(springs.contact, length * np.abs(springs.slide), len(reference.lost))
        now += length
        if spring >= 0:
            events += 1
            reference.change(spring, float(reference.slip[springs.contact[spring]] @ here))
        halted = halted + 1 if length < 1e-14 else 0
        if halted > _MOST_AT_ONCE * len(springs.contact):
            raise FailureError("springs stick and slip without end", where=problem.system.name, got=f"at {now:g} s",
                               advice="use the fast mode")  # fmt: skip
    return _reference_response(problem, reference, state, times, q, p, spring_force, slid, spacing, events)


def _check(problem: Problem, duration: float, sampling_rate: float) -> None:
    where = problem.system.name
    wrong = sorted({law.name for law in problem.system.contacts.laws if law.name not in PIECEWISE_LINEAR})
    if wrong:
        raise InputError("the reference mode takes Masing-type laws only", where=where, got=", ".join(wrong),
                         expected=", ".join(PIECEWISE_LINEAR), advice="use the fast mode")  # fmt: skip
    if problem.system.damping.ratio > 0:
        raise InputError("the reference mode takes mass-proportional damping only", where=where,
                         got=f"ratio {problem.system.damping.ratio}", expected="Damping(mass_factor=...)")  # fmt: skip
    for name, value in (("duration", duration), ("sampling_rate", sampling_rate)):
        if not (np.isfinite(value) and value > 0):
            raise InputError("not a positive number", where=where, got=f"{name} = {value}", expected="above 0")


def _reference_response(
    problem: Problem, reference: _Reference, state: Any, times: np.ndarray, q: np.ndarray, p: np.ndarray,
    spring_force: np.ndarray, slid: np.ndarray, spacing: float, events: int,
) -> Response:  # fmt: skip
    base, system, springs = problem.base, problem.system, reference.springs
    coupled, free = reference.coupled, np.flatnonzero(~base.coupled)
    rows = np.array([base.row(system, dof) for dof in problem.outputs])
    loose_q, loose_p = _free_modes(problem, state, free, times, reference.harmonic)
    whole_q, whole_p = np.zeros((len(times), len(base.frequencies))), np.zeros((len(times), len(base.frequencies)))
    whole_q[:, coupled], whole_q[:, free] = q, loose_q
    whole_p[:, coupled], whole_p[:, free] = p, loose_p
    u = q @ reference.slip.T
    forces = np.zeros_like(u)
    np.add.at(forces.T, springs.contact, spring_force.T)
    mechanical = 0.5 * (whole_p**2 + (base.frequencies * whole_q) ** 2).sum(axis=1)
    mechanical -= 0.5 * (u**2 @ system.contacts.stiffness)
    stored = (spring_force**2 / (2 * springs.stiffness)).sum(axis=1)
    friction = slid.sum(axis=1)
    nothing = np.zeros_like(friction)
    findings = list(problem.findings)
    damping, supplied = nothing, nothing
    if reference.mass_factor > 0 or reference.harmonic is not None:
        # without closed form of the loss, the balance cannot be checked: what is missing counts as damping
        damping = mechanical[0] + stored[0] - mechanical - stored - friction
        findings.append(
            Finding("info", "balance-open", system.name, "the loss to damping follows from the energy balance.")
        )
    energy = EnergyBalance(mechanical, stored, friction, damping, nothing, supplied)
    findings += energy_findings(energy, system.name, 1e-6) + displacement_findings(system, u)
    return Response(
        times, rows @ whole_q.T, rows @ whole_p.T, problem.outputs, u.T, forces.T, slid[-1],
        np.minimum(reference.slid_time / times[-1], 1.0), energy, None, float("nan"), spacing,
        f"reference, {events} events", tuple(findings), system.name,
    )  # fmt: skip


def _free_modes(
    problem: Problem, state: Any, free: np.ndarray, times: np.ndarray, harmonic: Harmonic | None
) -> tuple[Float[np.ndarray, "sample mode"], Float[np.ndarray, "sample mode"]]:
    """Closed-form motion of the modes that no contact sees."""
    base = problem.base
    half = base.decay[free] / 2
    rates = -half + np.sqrt((half**2 - base.frequencies[free] ** 2).astype(complex))
    tide, pulse = np.zeros(len(free), complex), 0.0
    if harmonic is not None:
        pulse = 2 * np.pi * harmonic.frequency
        load = harmonic.force * base.row(problem.system, harmonic.at)[free]
        tide = (
            load
            / (base.frequencies[free] ** 2 - pulse**2 + 1j * pulse * base.decay[free])
            * np.exp(1j * harmonic.phase)
        )
    x, v = state.q[free] - tide.real, state.p[free] + pulse * tide.imag
    wave = x + 1j * (rates.real * x - v) / rates.imag
    moving, forced = wave * np.exp(rates * times[:, None]), tide * np.exp(1j * pulse * times[:, None])
    return (moving + forced).real, (rates * moving).real - pulse * forced.imag
