"""Motion in time, fast: the modes of the stuck structure move exactly; what is approximated is the slip.

The contacts act over a step with the mean of their old and new force, which keeps the energy balance exact and the
steps stable at any length. The step is halved until the difference to the run before falls below the tolerance, so
that a result carries its error.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from ema.contact.laws import ContactLaws, contact_laws
from ema.data import BeamModel, EnergyBalance, Finding, Response
from ema.dof import Dof
from ema.errors import FailureError, InputError
from ema.progress import Progress, advance, silent
from ema.simulate.checks import fits_memory, is_number, positive, sample_count, with_unit
from ema.simulate.flow import joint_coefficients, long_coefficients, own_coefficients
from ema.simulate.joined import couplings, kept_at_rest, pressure, refuse_joined
from ema.simulate.reduction import ModalBase, modal_base
from ema.simulate.statics import INCREMENTS, ramp
from ema.simulate.structure import System, assemble, pair_counts

NormalForces = Callable[[float], float | Sequence[float] | np.ndarray] | Float[np.ndarray, "joint instant"]
"""Normal forces over time in N: an array, or a function of the time in s that returns one for all joints or each."""

Result = TypeVar("Result")

ENERGY_LIMIT = 1e-6
"""Error of the energy balance, over the energy, from which on a finding names it."""
_BLOCK = 4_000_000
"""Numbers of forces made at once, and steps taken without asking whether to go on."""
_FIRST_STEP = 1e-4
"""Time step in s at first, where the tolerance is above 0.3 %; half of it below."""
_HALVINGS = 9
"""How often the step is halved at most."""
"""s; the error estimate needs steps that follow the first few modes of a beam."""


@dataclass
class _State:
    """Modal displacements and velocities, and the contacts, at one instant."""

    q: np.ndarray
    p: np.ndarray
    u: np.ndarray
    f: np.ndarray
    z: np.ndarray

    def copy(self) -> "_State":
        return _State(*(part.copy() for part in (self.q, self.p, self.u, self.f, self.z)))


@dataclass
class Problem:
    """A model prepared for time integration."""

    system: System
    base: ModalBase
    laws: ContactLaws
    outputs: tuple[Dof, ...]
    findings: tuple[Finding, ...]

    @cached_property
    def natural_frequencies(self) -> Float[np.ndarray, "frequency"]:
        """Natural frequencies in Hz with stuck contacts and with free ones, in ascending order."""
        contacts, squares = slice(0, self.system.contacts.tangential), self.base.frequencies**2
        slip = self.base.slip[contacts]
        held = slip.T @ (self.system.contacts.stiffness[contacts, None] * slip)
        free = np.linalg.eigvalsh(np.diag(squares) - held)
        return np.sort(np.sqrt(np.maximum(np.concatenate([squares, free]), 0.0))) / (2 * np.pi)

    def rest(self) -> _State:
        """Everything at rest and unstressed."""
        modes, contacts = len(self.base.frequencies), len(self.system.contacts.limits)
        return _State(*(np.zeros(size) for size in (modes, modes, contacts, contacts, (contacts, self.laws.states))))


def prepare(
    model: BeamModel,
    outputs: Sequence[Dof | str],
    modes: int | None = None,
    loads: Sequence[Dof | str] = (),
    plane: bool = False,
    normal: bool = False,
) -> Problem:
    """Assemble a model, find its modes and pack its laws.

    ``plane`` and ``normal`` say whether the caller follows isotropic friction in two directions, and normal contact
    that parts or stiffens.

    Raises
    ------
    InputError : the model is not physical, or has contacts that the caller does not follow.
    """
    system = assemble(model)
    refuse_joined(system, plane, normal)
    contacts, ties = system.contacts, couplings(system)
    laws = contact_laws(contacts.laws[: contacts.tangential], contacts.stiffness, pair_counts(model, system), ties)
    base = modal_base(system, modes=modes, loads=loads)
    dofs = tuple(Dof.parse(dof) for dof in outputs)
    if not dofs:
        raise InputError("no motion to keep", where=system.name, got="no outputs", expected="one DOF or more")
    return Problem(system, base, laws, dofs, system.findings)


class _Modes:
    """Modes that move with the contacts, or those that no contact sees, and the state and the books of either."""

    def __init__(
        self, problem: Problem, state: _State, h: float, part: tuple[np.ndarray, bool], loads: np.ndarray
    ) -> None:
        (places, self.seen), base, self.problem, self.h = part, problem.base, problem, h
        self.places, self.laws = places, problem.laws if self.seen else problem.laws.without_contacts()
        self.frequencies, self.decay = base.frequencies[places], base.decay[places]
        self.squares = np.ascontiguousarray(self.frequencies**2)
        contacts, modes = len(self.laws.stiffness), len(places)
        self.slip = np.ascontiguousarray(base.slip[:contacts, places])
        if base.damping is None or not self.seen:
            self.flow, self.loss = own_coefficients(self.frequencies, self.decay, h)
            yielding = 0.5 * self.slip * self.flow[2]
        else:
            self.flow, self.loss = joint_coefficients(self.frequencies, base.damping[np.ix_(places, places)], h)
            yielding = 0.5 * self.slip @ self.flow[0, :, modes:].T
        gains = np.ascontiguousarray(yielding @ self.slip.T)
        self.compliance = gains, float(np.abs(gains).sum(axis=1).max(initial=0.0))
        self.rows = np.ascontiguousarray(loads[:, places])
        self.q, self.p = state.q[places].copy(), state.p[places].copy()
        self.u, self.f, self.z = (part[:contacts].copy() for part in (state.u, state.f, state.z))
        self.exchange, self.memory = self.laws.exchange(), self.laws.memory(gains)
        self.room = np.zeros((7, modes)), np.zeros((4, contacts)), np.zeros(2 * modes), np.zeros_like(self.z)
        self.energies, self.dissipated, self.sliding = np.zeros(4), np.zeros(contacts), np.zeros(contacts)
        self.limits = problem.system.contacts.limits[:contacts].copy()
        self.kept = kept_at_rest(problem.system)[: None if self.seen else 0]
        self.strides: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self.leaps: dict[int, tuple[np.ndarray, ...]] = {}

    def advance(
        self, count: tuple[int, int, int], limits: np.ndarray, loads: np.ndarray, samples: tuple[np.ndarray, ...]
    ) -> tuple[int, float]:
        """Take steps; returns Newton steps at most and the worst residual.

        ``count``: all steps, those from sample to sample, and those that were taken before.
        """
        from ema.simulate import transient_kernels

        kernels: Any = transient_kernels
        steps, every, done = count
        h, flow, loss = self.h, self.flow, self.loss
        if not self.seen and not len(loads):
            # without forces exact over any length
            if every not in self.leaps:
                self.leaps[every] = own_coefficients(self.frequencies, self.decay, every * h)
            (flow, loss), h, steps, every = self.leaps[every], every * h, steps // every, 1
        laws, arguments = self.laws, self.laws.arguments()
        strides = self._strides(every if len(limits) == 1 else 1)
        reach = np.zeros((len(strides[2]), len(self.u))), np.zeros(1, np.int64)
        most, worst = kernels.advance(
            (steps, every, 1 / h),
            (flow, loss, self.squares),
            (
                self.slip,
                laws.stiffness,
                (laws.flexibility, laws.capacity),
                self.compliance,
                self.exchange,
                self.memory,
            ),
            (limits, loads, self.rows),
            arguments if laws.couplings is None else (*arguments, (self.kept, done)),
            (self.q, self.p, self.u, self.f, self.z),
            (self.energies, self.dissipated, self.sliding, self.limits, self.places, samples),
            (*strides, _quiet(loads), (*self.room, *reach)),
        )
        return int(most), float(worst)

    def _strides(self, every: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients of the modes over 2, 4, 8 ... steps, and how far they move the contact forces meanwhile.

        There are none where every step has to be looked at: laws that slip at any force, modes that damping couples.
        """
        if every not in self.strides:
            omega, stiffness = self.frequencies, self.laws.stiffness
            alone = self.laws.elastic_reach and self.problem.base.damping is None and bool(np.all(omega > 0))
            levels = int(np.log2(every)) if alone and self.seen else 0
            flows, losses = long_coefficients(omega, self.decay, self.h, levels)
            turns = omega * self.h * 2.0 ** np.arange(1, levels + 1)[:, None]
            spans = np.minimum(turns, 2.0)[:, None, :] * np.abs(stiffness[:, None] * self.slip)
            self.strides[every] = flows[1:].copy(), losses[1:].copy(), spans
        return self.strides[every]


class Stepper:
    """Steps a prepared model with one step length; resumable, so that a controller may act between calls."""

    def __init__(self, problem: Problem, state: _State, h: float, loads: Sequence[Dof | str] = ()) -> None:
        base, self.problem, self.h = problem.base, problem, h
        seen = base.coupled | (base.damping is not None)
        rows = np.array([base.row(problem.system, dof) for dof in loads]).reshape(len(loads), len(base.frequencies))
        self.coupled = _Modes(problem, state, h, (np.flatnonzero(seen), True), rows)
        self.free = _Modes(problem, state, h, (np.flatnonzero(~seen), False), rows)
        self.sweeps, self.residual, self.done = 0, 0.0, 0

    def run(
        self,
        steps: int,
        every: int,
        limits: Float[np.ndarray, "row contact"],
        loads: Float[np.ndarray, "end load"],
        into: dict[str, np.ndarray] | None = None,
    ) -> dict[str, np.ndarray]:
        """Take ``steps`` steps and return samples of q, p (mode), u, f (contact) and energies (6)."""
        run = room_for(self.problem, steps // every) if into is None else into
        samples, count = tuple(run[name] for name in ("q", "p", "u", "f", "energy")), (steps, every, self.done)
        sweeps, residual = self.coupled.advance(count, limits, loads, samples)
        self.sweeps, self.residual = max(self.sweeps, sweeps), max(self.residual, residual)
        if len(self.free.places):
            self.free.advance(count, np.zeros((1, 0)), loads, samples)
        self.done += steps
        return run


def room_for(problem: Problem, samples: int) -> dict[str, np.ndarray]:
    """Room for the samples of a run: q, p (mode), u, f (contact) and energies (6)."""
    return {name: np.zeros((samples, width)) for name, width in _widths(problem).items()}


def _widths(problem: Problem) -> dict[str, int]:
    modes, contacts = len(problem.base.frequencies), len(problem.system.contacts.limits)
    return {"q": modes, "p": modes, "u": contacts, "f": contacts, "energy": 6}


def _quiet(loads: np.ndarray) -> int:
    """The step from which on no load acts."""
    acting = np.flatnonzero(np.any(loads != 0, axis=1)) if len(loads) else np.zeros(0)
    return int(acting[-1]) + 1 if len(acting) else 0


def _initial(stepper: Stepper, state: _State) -> dict[str, np.ndarray]:
    """The sample at time zero, in the form of ``Stepper.run``."""
    laws, stiffness = stepper.problem.laws, stepper.problem.system.contacts.stiffness
    stored = laws.stored_energy(state.z)
    omega = stepper.problem.base.frequencies
    mechanical = 0.5 * (state.p**2 + (omega * state.q) ** 2).sum() - 0.5 * stiffness @ state.u**2
    energy = np.array([[0.0, 0.0, 0.0, 0.0, stored, mechanical]])
    return {"q": state.q[None], "p": state.p[None], "u": state.u[None], "f": state.f[None], "energy": energy}


def integrate(
    problem: Problem,
    state: _State,
    h: float,
    every: int,
    samples: int,
    drive: "Drive",
    tick: Callable[[], None] = lambda: None,
) -> tuple[dict[str, np.ndarray], Stepper]:
    """One run with one step length: samples at 0 and after every ``every`` steps, ``samples`` intervals.

    The forces of every step are made block by block, so that fine steps of long runs take no memory; ``tick`` is called
    before each of them.
    """
    stepper = Stepper(problem, state, h, drive.at)
    run = room_for(problem, samples + 1)
    for name, start in _initial(stepper, state).items():
        run[name][:1] = start
    block = max(_BLOCK // (every * drive.width(problem)), 1)
    for first in range(0, samples, block):
        tick()
        count = min(block, samples - first)
        begun, steps = first * every, count * every
        part = {name: table[first + 1 : first + 1 + count] for name, table in run.items()}
        stepper.run(steps, every, drive.limits(problem, h, steps, begun), drive.loads(h, steps, begun), part)
    return run, stepper


@dataclass(frozen=True)
class Drive:
    """External forces ``values`` (load, sample) at DOFs ``at`` and normal forces (joint, sample), N, over ``times``."""

    times: np.ndarray
    at: tuple[Dof, ...] = ()
    values: np.ndarray | None = None
    normal_forces: np.ndarray | None = None

    def width(self, problem: Problem) -> int:
        """Numbers that every step takes in, one at least."""
        limits = 0 if self.normal_forces is None else len(problem.system.contacts.limits)
        return max(len(self.at) + limits, 1)

    def loads(self, h: float, steps: int, begun: int = 0) -> np.ndarray:
        """External forces at the ends of the steps from number ``begun`` on, (step + 1, load)."""
        if self.values is None:
            return np.zeros((0, len(self.at)))
        t = h * np.arange(begun, begun + steps + 1)
        return np.ascontiguousarray(np.array([np.interp(t, self.times, row) for row in self.values]).T)

    def limits(self, problem: Problem, h: float, steps: int, begun: int = 0) -> np.ndarray:
        """Slip forces from step ``begun`` on, (1, contact) when constant, else (step, contact)."""
        contacts = problem.system.contacts
        if self.normal_forces is None:
            return contacts.limits[None].copy()
        t = h * np.arange(begun, begun + steps)
        force = np.array([np.interp(t, self.times, row) for row in self.normal_forces])
        return np.ascontiguousarray(force[list(contacts.joint)].T * contacts.friction)


def solve(
    problem: Problem,
    start: Callable[[int], _State],
    drive: Drive,
    duration: float,
    sampling_rate: float,
    tolerance: float,
    progress: Progress = silent,
) -> Response:
    """Halve the step until two runs agree within ``tolerance`` of the largest displacement.

    ``start`` gives the state at the beginning of a run with so many times more steps.

    Raises
    ------
    InputError : duration, rate or tolerance is not positive, or the samples do not fit the memory.
    FailureError : the motion is not finite with the shortest steps.
    """
    where = problem.system.name
    samples = sample_count(where, duration, sampling_rate)
    positive(where, tolerance=tolerance)
    # this run and the one before
    fits_memory(where, samples, 2 * sum(_widths(problem).values()))
    interval = 1 / sampling_rate
    every = max(int(np.ceil(interval / (_FIRST_STEP if tolerance > 3e-3 else 0.5 * _FIRST_STEP))), 1)
    rows = np.array([problem.base.row(problem.system, dof) for dof in problem.outputs])

    def attempt(finer: int) -> tuple[np.ndarray, tuple[dict[str, np.ndarray], Stepper]]:
        """The outputs of a run with so many times more steps, and the run."""
        steps = every * finer
        tick = partial(advance, progress, "time steps", finer.bit_length() - 1, _HALVINGS)
        run, stepper = integrate(problem, start(finer), interval / steps, steps, samples, drive, tick)
        return run["q"] @ rows.T, (run, stepper)

    (run, stepper), error = refined(attempt, tolerance, _HALVINGS)
    response = _response(problem, drive, run, stepper, interval)
    return with_error(response, problem.system, error, tolerance, "Raise the tolerance, or use the reference mode.")


def refined(
    attempt: Callable[[int], tuple[np.ndarray, Result]], tolerance: float, halvings: int
) -> tuple[Result, float]:
    """The result of ``attempt`` with 1, 2, 4 ... times as many steps, once the motions it returns with it agree.

    Returns the last result and its estimated error over the largest displacement, which is above ``tolerance`` where
    ``halvings`` were not enough, and infinite where one of the last two motions is not finite.
    """
    fine, result = attempt(1)
    error, halving, before, difference = np.inf, 0, np.inf, np.inf
    # one agreement may be chance: a second one shows how fast the runs approach each other
    while (error > tolerance or (before == np.inf and error > 1e-6 * tolerance)) and halving < halvings:
        coarse, halving = fine, halving + 1
        fine, result = attempt(2**halving)
        before, difference = difference, _difference(fine, coarse)
        # what all further halvings would add, were they to shrink like the last one; a fast one may be chance
        ratio = min(max(difference / before, 0.6), 0.8) if 0 < before < np.inf else 0.6
        error = difference * ratio / (1 - ratio)
    return result, error


def _difference(fine: np.ndarray, coarse: np.ndarray) -> float:
    """Largest difference of two motions over the largest value of the first; infinite where one is not finite."""
    if not (np.all(np.isfinite(fine)) and np.all(np.isfinite(coarse))):
        return float("inf")
    return float(np.abs(fine - coarse).max() / max(np.abs(fine).max(), 1e-300))


def with_error(response: Response, system: System, error: float, tolerance: float, advice: str) -> Response:
    """The response with the estimated error of its displacements, and a finding where that is above ``tolerance``.

    Raises
    ------
    FailureError : the response is not finite.
    """
    check_finite(response, system)
    findings = (*response.findings, *_step_findings(error, system.name, tolerance, advice))
    return replace(response, error_estimate=error, findings=findings)


def check_finite(response: Response, system: System) -> None:
    """Refuse a motion that is not finite, or whose energy is not; names the laws of the largest forces then.

    Raises
    ------
    FailureError : as said.
    """
    if np.isfinite(response.energy.error) and np.all(np.isfinite(response.displacements)):
        return
    lost = ~(np.isfinite(response.energy.total) & np.all(np.isfinite(response.forces), axis=0))
    lost[-1] = True
    first = int(np.argmax(lost))
    sizes = np.nan_to_num(np.abs(response.forces[:, first]), nan=np.inf)
    largest = sizes.max(initial=0.0)
    names = sorted({law.name for law, size in zip(system.contacts.laws, sizes) if size == largest})
    raise FailureError(
        "the motion is not finite, however short the steps",
        where=system.name,
        got=f"NaN or infinity from {response.times[first]:.3g} s on" + "".join(f", law {name}" for name in names),
        advice="check the parameters of the law, or keep the normal force from jumping",
    )


def _response(
    problem: Problem,
    drive: Drive,
    run: dict[str, np.ndarray],
    stepper: Stepper,
    interval: float,
) -> Response:
    """The response of a run, without an estimate of its error."""
    rows = np.array([problem.base.row(problem.system, dof) for dof in problem.outputs])
    names = ("friction", "damping", "projection", "supplied", "contact", "mechanical")
    energy = EnergyBalance(**dict(zip(names, run["energy"].T, strict=True)))
    times = interval * np.arange(len(run["q"]))
    findings = list(problem.findings) + energy_findings(energy, problem.system.name, ENERGY_LIMIT)
    friction = slice(0, problem.system.contacts.tangential)
    findings += displacement_findings(problem.system, run["u"][:, friction])
    forces = None
    if drive.normal_forces is not None:
        forces = np.array([np.interp(times, drive.times, row) for row in drive.normal_forces])
    steps = max(len(times) - 1, 1) * max(round(interval / stepper.h), 1)
    openings = run["q"] @ (problem.system.normals.rows @ problem.base.shapes).T
    pressed = pressure(problem.system, stepper.coupled.kept, stepper.done, stepper.h, openings)
    findings += pressed.findings
    return Response(
        times,
        rows @ run["q"].T,
        rows @ run["p"].T,
        problem.outputs,
        run["u"].T[friction],
        run["f"].T[friction],
        stepper.coupled.dissipated[friction],
        (stepper.coupled.sliding / steps)[friction],
        energy,
        forces,
        step=stepper.h,
        method="fast",
        findings=tuple(findings),
        name=problem.system.name,
        pressure=pressed,
    )


def _step_findings(error: float, where: str, tolerance: float, advice: str) -> list[Finding]:
    """A finding when the steps could not be made short enough."""
    if error <= tolerance:
        return []
    return [
        Finding(
            "warning",
            "step-error",
            where,
            f"two runs differ by {error:.1e} of the largest value.",
            error,
            tolerance,
            advice,
        )
    ]


def energy_findings(energy: EnergyBalance, where: str, limit: float) -> list[Finding]:
    """A finding when the energy balance of a run is off by more than ``limit``."""
    if energy.error <= limit:
        return []
    return [
        Finding(
            "error",
            "energy-balance",
            where,
            f"the energy balance is off by {energy.error:.1e}.",
            energy.error,
            limit,
            "Do not use this run; report it with the model.",
        )
    ]


def displacement_findings(system: System, slips: Float[np.ndarray, "sample contact"]) -> list[Finding]:
    """A finding when a node pair slides further than 5 % of the distance to the next pair."""
    largest, limit = float(np.abs(slips).max()), 0.05 * system.spacing
    if largest <= limit:
        return []
    return [
        Finding(
            "warning",
            "large-slip",
            system.name,
            f"node pairs slide {largest:.2e} m.",
            largest,
            limit,
            "The pairing is fixed: lower the load, or do not trust the contact positions.",
        )
    ]


def snapback(
    model: BeamModel,
    load: float,
    at: Dof | str,
    duration: float,
    outputs: Sequence[Dof | str] | None = None,
    sampling_rate: float = 5000.0,
    tolerance: float = 1e-3,
    modes: int | None = None,
    progress: Progress = silent,
    normal_forces: NormalForces | None = None,
) -> Response:
    """Raise a load slowly at one DOF, release it, and follow the free vibration.

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
        Rate of the samples kept [Hz]; the steps are chosen by ``tolerance``.
    tolerance : float, default 0.001
        Error of the displacements over the largest one.
    modes : int, optional
        Number of modes kept besides the static corrections; all by default.
    progress : Progress, optional
        Called during the run.
    normal_forces : NormalForces, optional
        Normal forces of every joint over time [N], as a function of time or with a sample at every multiple of 1 /
        ``sampling_rate``, linear in between; those of the model by default. The load is raised under the first ones.
        k_T stays that of the model.

    Returns
    -------
    Response
        The motion.

    Raises
    ------
    InputError
        If the model or a number is not physical, or the structure is not supported.
    FailureError
        If the motion is not finite, however short the steps.

    References
    ----------
    .. [1] Gaul, Roseira and Becker (2008), Sec. 1.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> motion = snapback(beam_model(), load=60.0, at="1:+X", duration=0.02)
    >>> motion.energy.error < 1e-2
    True
    """
    dof = Dof.parse(at)
    problem = prepare(model, outputs or [dof], modes, [dof], plane=True, normal=normal_forces is None)
    samples = sample_count(model.name, duration, sampling_rate)
    drive, limits = Drive(np.zeros(1)), None
    if normal_forces is not None:
        times = np.arange(samples + 1) / sampling_rate
        drive = Drive(times, normal_forces=sampled_normal_forces(model, normal_forces, times))
        limits = drive.limits(problem, 1.0, 1)[0]
    start = partial(released, problem, load, dof, limits)
    return solve(problem, start, drive, duration, sampling_rate, tolerance, progress)


def released(
    problem: Problem, load: float, dof: Dof, limits: Float[np.ndarray, "contact"] | None = None, finer: int = 1
) -> _State:
    """State of a structure at the moment a slowly raised load is let go; ``limits`` N are its slip forces till then.

    With so many times more increments than usual as ``finer`` says: laws of first order err by their length, and runs
    whose steps are halved show that too.

    Raises
    ------
    InputError : the load is not finite.
    """
    system = problem.system
    if not is_number(load):
        raise InputError("not a load", where=system.name, got=with_unit(load, "N"), expected="a finite force")
    state = ramp(system, problem.laws, load * system.row(dof), INCREMENTS * finer, limits)
    q = problem.base.shapes.T @ (system.mass @ state.displacements)
    return _State(q, np.zeros_like(q), problem.base.slip @ q, state.forces, state.memory)


def respond(
    model: BeamModel,
    forces: Float[np.ndarray, "load sample"],
    at: Sequence[Dof | str],
    sampling_rate: float,
    outputs: Sequence[Dof | str],
    normal_forces: NormalForces | None = None,
    tolerance: float = 1e-3,
    modes: int | None = None,
    progress: Progress = silent,
) -> Response:
    """Compute the motion from rest under arbitrary forces, linear between their samples.

    Parameters
    ----------
    model : BeamModel
        The model.
    forces : array of shape (load, sample)
        Forces [N].
    at : sequence of Dof or str
        DOFs of the forces.
    sampling_rate : float
        Sampling rate of forces and response [Hz].
    outputs : sequence of Dof or str
        DOFs whose motion is kept.
    normal_forces : NormalForces, optional
        Normal forces of every joint over time [N], sampled like ``forces`` or a function of time; those of the model by
        default. k_T stays that of the model.
    tolerance : float, default 0.001
        Error of the displacements over the largest one.
    modes : int, optional
        Number of modes kept besides the static corrections; all by default.
    progress : Progress, optional
        Called during the run.

    Returns
    -------
    Response
        The motion.

    Raises
    ------
    InputError
        If the shapes do not fit, a force is not finite, or a normal force is negative.
    FailureError
        If the motion is not finite, however short the steps.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> push = np.full((1, 100), 10.0)
    >>> motion = respond(beam_model(), push, at=["1:+X"], sampling_rate=5000.0, outputs=["1:+X"])
    >>> bool(motion.displacements[0, -1] > 0)
    True
    """
    dofs = tuple(Dof.parse(dof) for dof in at)
    forces = _forces(model.name, forces, len(dofs))
    problem = prepare(model, outputs, modes, dofs, plane=True, normal=normal_forces is None)
    positive(model.name, sampling_rate=sampling_rate, tolerance=tolerance)
    times = np.arange(forces.shape[1]) / sampling_rate
    pressing = None if normal_forces is None else sampled_normal_forces(model, normal_forces, times)
    drive = Drive(times, dofs, forces, pressing)
    return solve(problem, lambda _: problem.rest(), drive, float(times[-1]), sampling_rate, tolerance, progress)


def _forces(where: str, forces: Any, count: int) -> Float[np.ndarray, "load sample"]:
    table = np.asarray(forces)
    fits = table.ndim == 2 and len(table) == count and table.shape[1] >= 2 and table.dtype.kind in "iuf"
    if not fits or not np.all(np.isfinite(table)):
        kind = "" if table.dtype.kind in "iuf" else f" of {table.dtype}"
        got = f"{table.shape}{kind} for {count} DOFs" if not fits else "NaN or infinity among them"
        raise InputError(
            "the forces do not fit",
            where=where,
            got=got,
            expected="one finite row of two or more samples for every DOF",
        )
    return table.astype(np.float64)


def sampled_normal_forces(
    model: BeamModel, forces: NormalForces, times: Float[np.ndarray, "time"]
) -> Float[np.ndarray, "joint time"]:
    """Normal forces of every joint at ``times`` s.

    Raises
    ------
    InputError : they are negative, not finite, or of the wrong shape.
    """
    joints = len(model.joints)
    try:
        if callable(forces):
            table = np.array([np.broadcast_to(np.asarray(forces(float(t)), np.float64), (joints,)) for t in times]).T
        else:
            table = np.asarray(forces, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            "the normal forces do not fit",
            where=model.name,
            got=str(error),
            expected=f"one number, or {joints} of them, at every time",
        ) from error
    if table.shape != (joints, len(times)):
        raise InputError(
            "the normal forces do not fit",
            where=model.name,
            got=table.shape,
            expected=f"({joints} joints, {len(times)} samples)",
        )
    wrong = table[~(np.isfinite(table) & (table >= 0))]
    if wrong.size:
        raise InputError("not a normal force", where=model.name, got=f"{wrong[0]} N", expected="0 N or more, no NaN")
    return table
