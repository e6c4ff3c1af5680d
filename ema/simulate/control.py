"""Semi-active normal force: a controller watches the structure and sets the normal forces while it vibrates.

A control law is a plain function of what is measured at a sampling instant; it returns one normal force for every
joint, or one for all. Lag and limits of the actuator are applied by the simulator. A falling slip force takes friction
with it; the energy lost there is booked as ``projection``.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Response
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.checks import fits_memory, not_negative, positive, sample_count
from ema.simulate.transient import (
    Drive,
    Problem,
    Stepper,
    _initial,
    _response,
    _State,
    check_finite,
    prepare,
    refined,
    released,
    with_error,
)


@dataclass(frozen=True)
class Measured:
    """What a controller sees: time s, sensor displacement m and velocity m/s, slips and slip velocities (contact,)."""

    time: float
    displacement: float
    velocity: float
    slips: Float[np.ndarray, "contact"]
    slip_velocities: Float[np.ndarray, "contact"]
    forces: Float[np.ndarray, "contact"]


_FIRST_STEP, _HALVINGS = 5e-5, 5
"""Time step [s] at first, where none is given, and how often it is halved to meet the tolerance: bounds on the work;
the error that is left is stated."""
_NO_LOADS = np.zeros((0, 0))
ControlLaw = Callable[[Measured], float | Sequence[float] | np.ndarray]


@dataclass(frozen=True)
class Actuator:
    """``sampling_time`` and ``lag`` (from measuring to acting) in s; no force leaves ``limits`` in N.

    Raises
    ------
    InputError : a time that is not positive, a negative lag, limits that are negative or not in order.
    """

    sampling_time: float = 5e-4
    lag: float = 0.0
    limits: tuple[float, float] = (0.0, float("inf"))

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sampling_time) and self.sampling_time > 0):
            raise InputError("not a sampling time", where="actuator", got=f"{self.sampling_time} s", expected="above 0")
        if not (np.isfinite(self.lag) and self.lag >= 0):
            raise InputError("a lag is not negative", where="actuator", got=f"{self.lag} s", expected="0 s or more")
        if not 0 <= self.limits[0] <= self.limits[1]:
            raise InputError(
                "not the limits of a normal force",
                where="actuator",
                got=f"{self.limits} N",
                expected="0 N or more, the smaller one first",
            )


def constant(force: float) -> ControlLaw:
    """The passive joint.

    Raises
    ------
    InputError : the force is negative or no number.
    """
    not_negative("constant normal force", force=force)
    return lambda seen: force


class _TurningPoints:
    """Changes of sign of the measured velocity that are no higher mode."""

    def __init__(self, shortest: float) -> None:
        self.shortest, self.before, self.last = shortest, 0.0, float("-inf")

    def passed(self, seen: Measured) -> bool:
        """Whether the velocity has changed its sign, and not too soon after the last time."""
        turned = seen.velocity * self.before < 0 and seen.time > self.last + self.shortest
        self.before = seen.velocity
        self.last = seen.time if turned else self.last
        return turned


class AmplitudeScheduled:
    """F_N proportional to the amplitude at the last turning point: the slip force stays just below the stick force.

    ``force`` N at the amplitude ``reference`` m; never below ``floor`` times ``force``. ``shortest`` s is the least
    time between turning points: what turns sooner is a higher mode.
    """

    def __init__(self, force: float, reference: float, floor: float = 0.002, shortest: float = 0.0) -> None:
        not_negative("amplitude-scheduled law", force=force, floor=floor, shortest=shortest)
        positive("amplitude-scheduled law", reference=reference)
        self.force, self.reference, self.floor = force, reference, floor
        self.amplitude, self.turning = reference, _TurningPoints(shortest)

    def __call__(self, seen: Measured) -> float:
        """Normal force in N."""
        if self.turning.passed(seen):
            self.amplitude = abs(seen.displacement)
        return float(self.force * max(self.amplitude / self.reference, self.floor))


class ReleasePulse:
    """F_N = ``force``, but 0 for ``width`` s at every turning point: stored joint energy is not given back.

    ``shortest`` s is the least time between turning points (a quarter of the period is a good choice): without it,
    higher modes release the joint at wrong instants. The principle is that of Dupont, Kasturi and Stokes, J. Sound
    Vib. 202 (1997).
    """

    def __init__(self, force: float, width: float = 4e-3, shortest: float = 0.0) -> None:
        not_negative("release pulse", force=force, shortest=shortest)
        positive("release pulse", width=width)
        self.force, self.width, self.until = force, width, float("-inf")
        self.turning = _TurningPoints(max(width, shortest))

    def __call__(self, seen: Measured) -> float:
        """Normal force in N."""
        if self.turning.passed(seen):
            self.until = seen.time + self.width
        return 0.0 if seen.time < self.until else self.force


class BangBang:
    """F_N = ``force`` where friction takes energy out (f v > 0), else 0, from the sums over the contacts.

    The derivative of the energy (a Lyapunov function) decides. It knows nothing of higher modes and chatters with them:
    the faster it is sampled, the worse.
    """

    def __init__(self, force: float) -> None:
        not_negative("bang-bang law", force=force)
        self.force = force

    def __call__(self, seen: Measured) -> float:
        """Normal force in N."""
        return self.force if float(seen.forces @ seen.slip_velocities) >= 0 else 0.0


def controlled_snapback(
    model: BeamModel,
    law: ControlLaw,
    load: float,
    at: Dof | str,
    duration: float,
    actuator: Actuator | None = None,
    sensor: Dof | str | None = None,
    step: float | None = None,
    start_force: float | None = None,
    check: bool = True,
    progress: Progress = silent,
    tolerance: float = 1e-3,
) -> Response:
    """Simulate a snap-back with a controller for the normal forces.

    Parameters
    ----------
    model : BeamModel
        The model.
    law : ControlLaw
        Called every ``actuator.sampling_time`` with a ``Measured``; returns the normal force of every joint [N], or one
        for all. A law that remembers is copied, so that one object serves many runs.
    load : float
        Load that is released [N].
    at : Dof or str
        DOF of the load.
    duration : float
        Length of the run [s].
    actuator : Actuator, optional
        Sampling, delay and limits of the controller.
    sensor : Dof or str, optional
        DOF whose displacement the law is given; that of the load by default.
    step : float, optional
        Step of the time integration [s], not above the sampling time; the longest that is tried. By default 50 us, or
        the sampling time where that is shorter.
    start_force : float, optional
        Normal force of every joint [N] while the load is raised, and until the first command arrives; that of the model
        by default. k_T stays that of the model's normal force.
    check : bool, default True
        Halve the step until the error estimate of the displacements is below ``tolerance``. A law that chatters with
        high waves may never get there, which a finding says. Without it there is one run with ``step``, and no
        estimate.
    progress : Progress, optional
        Called during the run.
    tolerance : float, default 0.001
        Error of the displacements over the largest one.

    Returns
    -------
    Response
        The motion, with the normal forces.

    Raises
    ------
    InputError
        If the law returns NaN or the wrong number of forces, or a time is not positive.
    FailureError
        If the motion is not finite, however short the steps.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> run = controlled_snapback(beam_model(), lambda seen: 200.0, load=60.0, at="1:+X", duration=0.01, check=False)
    >>> float(run.normal_forces[0, -1])
    200.0
    """
    actuator, dof = actuator or Actuator(), Dof.parse(at)
    step = min(_FIRST_STEP, actuator.sampling_time) if step is None else step
    positive(model.name, duration=duration, step=step, tolerance=tolerance)
    if step > actuator.sampling_time:
        raise InputError(
            "the step is longer than the sampling time",
            where=model.name,
            got=f"step = {step:g} s",
            expected=f"up to {actuator.sampling_time:g} s, a small part of it",
        )
    if not callable(law):
        raise InputError(
            "not a control law",
            where=model.name,
            got=f"{law!r}",
            expected="a function of what is measured, such as control.constant(100.0)",
        )
    seen = Dof.parse(sensor) if sensor is not None else dof
    problem = prepare(model, list(dict.fromkeys([dof, seen])))
    samples = sample_count(model.name, duration, 1 / actuator.sampling_time)
    # the samples of every interval, and all of them again in one
    fits_memory(model.name, samples, 4 * len(problem.base.frequencies) + 4 * len(problem.system.contacts.limits) + 12)
    ramped = problem if start_force is None else prepare(model.with_normal_force(start_force), [dof])
    before = [joint.normal_force if start_force is None else start_force for joint in model.joints]
    controlled = _Controlled(problem, actuator, seen, before, ramped.system.contacts.limits)

    def attempt(finer: int) -> tuple[np.ndarray, Response]:
        state = released(ramped, load, dof, finer=finer)
        run = controlled.run(state, deepcopy(law), step / finer, samples, progress)
        return np.asarray(run.displacements), run

    if not check:
        single = attempt(1)[1]
        check_finite(single, problem.system)
        return single
    response, error = refined(attempt, tolerance, _HALVINGS)
    advice = "Raise the tolerance, or keep the law from following high waves."
    return with_error(response, problem.system, error, tolerance, advice)


class _Controlled(NamedTuple):
    """A structure, its actuator and its sensor; until the first command, normal forces ``before`` N and slip forces
    ``limits`` N."""

    problem: Problem
    actuator: Actuator
    sensor: Dof
    before: list[float]
    limits: Float[np.ndarray, "contact"]

    def run(self, state: _State, law: ControlLaw, step: float, samples: int, progress: Progress) -> Response:
        """The motion over so many samples of the controller."""
        every = max(round(self.actuator.sampling_time / step), 1)
        h = self.actuator.sampling_time / every
        stepper = Stepper(self.problem, state.copy(), h)
        stepper.coupled.limits = self.limits.copy()
        base, contacts = self.problem.base, self.problem.system.contacts
        row, joints = base.row(self.problem.system, self.sensor), list(contacts.joint)
        runs = [_initial(stepper, state)]
        commands = [np.array(self.before, dtype=np.float64)]
        # command n takes effect n * every + late steps after the start
        late = round(self.actuator.lag / h)
        acting = np.empty((len(self.before), samples + 1))
        for sample in range(samples):
            advance(progress, "control", sample, samples)
            q, p, f = (runs[-1][name][-1] for name in ("q", "p", "f"))
            time = sample * self.actuator.sampling_time
            seen = Measured(time, float(row @ q), float(row @ p), base.slip @ q, base.slip @ p, f)
            commands.append(_wanted(law(seen), len(self.before), self.actuator, self.problem.system.name, time))
            newest = np.maximum((sample * every + np.arange(every) - late) // every + 1, 0)
            forces = np.array(commands[newest[0] : newest[-1] + 1])[newest - newest[0]]
            acting[:, sample] = forces[0]
            runs.append(
                stepper.run(every, every, np.ascontiguousarray(contacts.friction * forces[:, joints]), _NO_LOADS)
            )
        acting[:, -1] = forces[-1]
        times = self.actuator.sampling_time * np.arange(samples + 1)
        run = {name: np.concatenate([part[name] for part in runs]) for name in runs[0]}
        drive = Drive(times, normal_forces=acting)
        return _response(self.problem, drive, run, stepper, self.actuator.sampling_time)


def _wanted(answer: Any, joints: int, actuator: Actuator, where: str, time: float) -> Float[np.ndarray, "joint"]:
    try:
        force = np.atleast_1d(np.asarray(answer, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise InputError(
            "the control law returns no number",
            where=where,
            got=f"{answer!r} at {time:g} s",
            expected="a normal force in N for every joint",
        ) from error
    if not np.all(np.isfinite(force)):
        raise InputError(
            "the control law returns no number",
            where=where,
            got=f"{force} at {time:g} s",
            expected="a normal force in N for every joint",
        )
    if len(force) not in (1, joints):
        raise InputError(
            "the control law returns the wrong number of forces", where=where, got=len(force), expected=f"1 or {joints}"
        )
    return np.clip(np.broadcast_to(force, (joints,)), *actuator.limits).astype(np.float64)
