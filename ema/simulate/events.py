"""Motion in time, exact: closed-form modal motion between the instants at which a Masing spring sticks or slips.

While no spring changes, the structure is linear. Its modes are found for every pattern of stuck and sliding springs
(from those of the pattern before, in which one spring differs), the motion is followed in closed form to the next
change, and so on: no step, no numerical damping. The only approximation is the spacing of the instants at which a
change is looked for.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.contact.iwan import springs_of
from ema.data import BeamModel, EnergyBalance, Response
from ema.dof import Dof
from ema.errors import FailureError, InputError
from ema.progress import Progress, advance, silent
from ema.simulate.checks import fits_memory, positive, sample_count
from ema.simulate.friction import PIECEWISE_LINEAR
from ema.simulate.transient import Problem, displacement_findings, energy_findings, prepare, released

_MEMORY = 2e8
"""Bytes for the modes of patterns that may come back."""
_MOST_AT_ONCE = 50
"""Events per contact without progress in time at most: beyond, sticking and slipping alternate without end."""
_CHUNKS = 50
"""Parts of a run after which progress is said."""


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

    @property
    def arguments(self) -> tuple[np.ndarray, ...]:
        """What the kernels take."""
        return self.contact, self.stiffness, self.limit, self.rest, self.slide, self.begun


def _springs(problem: Problem, state: Any) -> _Springs:
    """The springs of all contacts in a state; those without slip force do nothing and are left out."""
    contacts = problem.system.contacts
    rows = [
        (i, contacts.stiffness[i] * k, contacts.limits[i] * f, state.z[i, j])
        for i, law in enumerate(contacts.laws)
        for j, (k, f) in enumerate(zip(*springs_of(law), strict=True))
        if contacts.limits[i] * f > 0
    ]
    contact, stiffness, limit, force = (np.ascontiguousarray(part) for part in np.array(rows).reshape(-1, 4).T)
    contact = contact.astype(np.int64)
    sliding = np.where(np.abs(force) >= limit * (1 - 1e-12), np.sign(force), 0.0)
    u = state.u[contact]
    return _Springs(contact, stiffness, limit, u - force / stiffness, sliding, u.copy())


class _Reference:
    """A piecewise linear structure that moves from event to event."""

    def __init__(self, problem: Problem, state: Any, harmonic: "Harmonic | None", samples: int) -> None:
        base, contacts = problem.base, problem.system.contacts
        self.problem, self.harmonic = problem, harmonic
        self.coupled = np.flatnonzero(base.coupled)
        self.slip = np.ascontiguousarray(base.slip[:, self.coupled])
        self.squares = base.frequencies[self.coupled] ** 2
        self.springs = _springs(problem, state)
        self.mass_factor = problem.system.damping.mass_factor
        self.load = np.zeros(len(self.coupled))
        if harmonic is not None:
            self.load = harmonic.force * base.row(problem.system, harmonic.at)[self.coupled]
        modes, count, springs = len(self.coupled), len(contacts.limits), len(self.springs.limit)
        self.lost, self.slid_time = np.zeros(count), np.zeros(count)
        self.q, self.p = state.q[self.coupled].copy(), state.p[self.coupled].copy()
        self.samples = (
            np.zeros((samples, modes)),
            np.zeros((samples, modes)),
            np.zeros((samples, springs)),
            np.zeros((samples, count)),
            np.zeros((samples, 2)),
        )
        self.booked = np.zeros(2)
        self.samples[0][0], self.samples[1][0] = self.q, self.p
        slide, rest = self.springs.slide, self.springs.rest
        stuck = self.springs.stiffness * (state.u[self.springs.contact] - rest)
        self.samples[2][0] = np.where(slide == 0, stuck, slide * self.springs.limit)
        room = int(np.clip(_MEMORY / (8 * modes * (modes + count + 1)), 16, 4000))
        self.phases = (
            np.empty((room, modes)),
            np.empty((room, modes, modes)),
            np.empty((room, count, modes)),
            np.zeros((room, springs), np.bool_),
            np.full(4 * room, -1),
            np.zeros(1, np.int64),
        )
        self.numbers = np.array([0.0, 1, 0, 0, -1, -1])

    def rounding(self) -> tuple[float, float]:
        """Relative displacement and velocity below which rounding, not motion, decides."""
        omega = np.sqrt(self.squares)
        size = np.abs(self.q) + np.abs(self.p) / omega + np.abs(self.load) / self.squares
        return (
            1e-13 * float((np.abs(self.slip) @ size).max()),
            1e-12 * float((np.abs(self.slip) @ (omega * size)).max()),
        )

    def follow(self, times: np.ndarray, spacing: float, progress: Progress) -> int:
        """Go from event to event and keep a sample at each of ``times``; returns the number of events."""
        from ema.simulate import event_kernels

        kernels: Any = event_kernels
        harmonic = (self.load, 0.0, 0.0)
        if self.harmonic is not None:
            harmonic = (self.load, 2 * np.pi * self.harmonic.frequency, self.harmonic.phase)
        search, count = (spacing, *self.rounding()), len(times)
        structure = self.squares, self.slip, self.problem.system.contacts.stiffness, 0.5 * self.mass_factor
        books = self.lost, self.slid_time, self.booked, self.samples
        for last in np.unique(np.linspace(1, count - 1, _CHUNKS).astype(np.int64)):
            advance(progress, "events", int(last), count - 1)
            ended = kernels.follow(
                (self.numbers, times, int(last), _MOST_AT_ONCE * len(self.springs.contact)),
                search,
                structure,
                self.springs.arguments,
                (self.q, self.p),
                books,
                harmonic,
                self.phases,
            )
            if not ended:
                raise FailureError(
                    "springs stick and slip without end",
                    where=self.problem.system.name,
                    got=f"at {self.numbers[0]:g} s",
                    advice="use the fast mode",
                )
        return int(self.numbers[2])


@dataclass(frozen=True)
class Harmonic:
    """A harmonic force F cos(2 pi f t + phase) at one DOF: N, Hz, rad."""

    force: float
    frequency: float
    at: Dof
    phase: float = 0.0


def snapback_reference(
    model: BeamModel,
    load: float,
    at: Dof | str,
    duration: float,
    outputs: Sequence[Dof | str] | None = None,
    sampling_rate: float = 5000.0,
    spacing: float | None = None,
    check: bool = False,
    progress: Progress = silent,
) -> Response:
    """Compute the snap-back of ``ema.simulate.snapback`` exactly between the events of Masing-type laws.

    Parameters
    ----------
    model : BeamModel
        The model.
    load : float
        Load [N].
    at : Dof or str
        DOF of the load.
    duration : float
        Length of the run [s].
    outputs : sequence of Dof or str, optional
        DOFs whose motion is kept; the loaded one by default.
    sampling_rate : float, default 5000.0
        Rate of the samples kept [Hz].
    spacing : float, optional
        Distance [s] of the instants at which events are looked for; a sixth of the shortest period by default.
    check : bool, default False
        Repeat the run at half the spacing; the difference is the error estimate.
    progress : Progress, optional
        Called during the run.

    Returns
    -------
    Response
        The motion.

    Raises
    ------
    InputError
        If a law is not piecewise linear, or the background damping is not proportional to mass.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> motion = snapback_reference(beam_model(), load=60.0, at="1:+X", duration=0.02)
    >>> motion.times[-1].round(3).item()
    0.02
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
    problem: Problem,
    state: Any,
    duration: float,
    sampling_rate: float,
    spacing: float | None,
    harmonic: Harmonic | None,
    progress: Progress = silent,
) -> Response:
    """Follow a prepared model from a state for ``duration`` s.

    Raises
    ------
    InputError : a law is not piecewise linear, the damping is not proportional to mass, a number is not positive,
        or the samples do not fit the memory.
    FailureError : too many events.
    """
    _check(problem)
    where = problem.system.name
    count = sample_count(where, duration, sampling_rate)
    # modal state of the coupled and of all modes, springs and contacts
    fits_memory(where, count, 8 * len(problem.base.frequencies) + 6 * len(problem.system.contacts.limits))
    times = np.arange(count + 1) / sampling_rate
    reference = _Reference(problem, state, harmonic, count + 1)
    shortest = 2 * np.pi / float(np.sqrt(reference.squares.max()))
    if spacing is not None:
        positive(where, spacing=spacing)
        if spacing > 0.5 * shortest:
            raise InputError(
                "the spacing is too wide to see every event",
                where=where,
                got=f"{spacing:g} s",
                expected=f"up to half the shortest period, {0.5 * shortest:.2g} s",
                advice="leave it out: a sixth is chosen",
            )
    spacing = spacing or shortest / 6
    events = reference.follow(times, spacing, progress)
    return _reference_response(problem, reference, state, times, spacing, events)


def _check(problem: Problem) -> None:
    where = problem.system.name
    wrong = sorted({law.name for law in problem.system.contacts.laws if law.name not in PIECEWISE_LINEAR})
    if wrong:
        raise InputError(
            "the reference mode takes Masing-type laws only",
            where=where,
            got=", ".join(wrong),
            expected=", ".join(PIECEWISE_LINEAR),
            advice="use the fast mode",
        )
    settings, base = problem.system.damping, problem.base
    if settings.ratio > 0 or base.damping is not None or np.any(np.abs(base.decay - settings.mass_factor) > 1e-9):
        brought = "a measured host or joints with loss factors"
        raise InputError(
            "the reference mode takes mass-proportional damping only",
            where=where,
            got=f"ratio {settings.ratio}" if settings.ratio > 0 else f"the damping of {brought}",
            expected="Damping(mass_factor=...)",
            advice="use the fast mode",
        )


def _reference_response(
    problem: Problem, reference: _Reference, state: Any, times: np.ndarray, spacing: float, events: int
) -> Response:
    q, p, spring_force, slid, booked = reference.samples
    base, system, springs = problem.base, problem.system, reference.springs
    coupled, free = reference.coupled, np.flatnonzero(~base.coupled)
    rows = np.array([base.row(system, dof) for dof in problem.outputs])
    loose_q, loose_p, loose_booked = _free_modes(problem, state, free, times, reference.harmonic)
    damping, supplied = (booked + loose_booked).T
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
    energy = EnergyBalance(mechanical, stored, friction, damping, np.zeros_like(friction), supplied)
    findings = list(problem.findings) + energy_findings(energy, system.name, 1e-6) + displacement_findings(system, u)
    return Response(
        times,
        rows @ whole_q.T,
        rows @ whole_p.T,
        problem.outputs,
        u.T,
        forces.T,
        slid[-1],
        np.minimum(reference.slid_time / times[-1], 1.0),
        energy,
        None,
        float("nan"),
        spacing,
        f"reference, {events} events",
        tuple(findings),
        system.name,
    )


def _free_modes(
    problem: Problem, state: Any, free: np.ndarray, times: np.ndarray, harmonic: Harmonic | None
) -> tuple[Float[np.ndarray, "sample mode"], Float[np.ndarray, "sample mode"], Float[np.ndarray, "sample 2"]]:
    """Closed-form motion of the modes that no contact sees, their loss to damping and the work of the load on them."""
    from ema.simulate import event_kernels

    kernels: Any = event_kernels
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
    waves, booked = np.zeros((12, len(free))), np.zeros((len(times), 2))
    for row, values in (
        (kernels.RE, wave.real),
        (kernels.IM, wave.imag),
        (kernels.OMEGA, rates.imag),
        (kernels.TIDE_RE, tide.real),
        (kernels.TIDE_IM, tide.imag),
    ):
        waves[row] = values
    kernels.books_over(waves, (float(half.max(initial=0.0)), pulse), times, booked)
    moving, forced = wave * np.exp(rates * times[:, None]), tide * np.exp(1j * pulse * times[:, None])
    return (moving + forced).real, (rates * moving).real - pulse * forced.imag, booked
