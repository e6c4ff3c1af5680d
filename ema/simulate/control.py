"""Semi-active normal force: a controller watches the structure and sets the normal forces while it vibrates.

A control law is a plain function of what is measured at a sampling instant; it returns one normal force for every
joint, or one for all. Lag and limits of the actuator are applied by the simulator. A falling slip force takes friction
with it; the energy lost there is booked as ``projection``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Response
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.transient import Drive, Problem, Stepper, _initial, _response, _State, prepare, released


@dataclass(frozen=True)
class Measured:
    """What a controller sees: time s, sensor displacement m and velocity m/s, slips and slip velocities (contact,)."""

    time: float
    displacement: float
    velocity: float
    slips: Float[np.ndarray, "contact"]
    slip_velocities: Float[np.ndarray, "contact"]
    forces: Float[np.ndarray, "contact"]


ControlLaw = Callable[[Measured], float | Sequence[float] | np.ndarray]


@dataclass(frozen=True)
class Actuator:
    """``sampling_time`` and ``lag`` in s; no force leaves ``limits`` in N."""

    sampling_time: float = 5e-4
    lag: float = 0.0
    limits: tuple[float, float] = (0.0, float("inf"))


def constant(force: float) -> ControlLaw:
    """The passive joint."""
    return lambda seen: force


class AmplitudeScheduled:
    """F_N proportional to the amplitude at the last turning point: the slip force stays just below the stick force.

    ``force`` N at the amplitude ``reference`` m; never below ``floor`` times ``force``.
    """

    def __init__(self, force: float, reference: float, floor: float = 0.002) -> None:
        self.force, self.reference, self.floor = force, reference, floor
        self.amplitude, self.before = reference, 0.0

    def __call__(self, seen: Measured) -> float:
        """Normal force in N."""
        if seen.velocity * self.before < 0:
            self.amplitude = abs(seen.displacement)
        self.before = seen.velocity
        return float(self.force * max(self.amplitude / self.reference, self.floor))


class ReleasePulse:
    """F_N = ``force``, but 0 for ``width`` s at every turning point: stored joint energy is not given back.

    Dupont, Kasturi and Stokes, J. Sound Vib. 202 (1997), describe the principle.
    """

    def __init__(self, force: float, width: float = 4e-3) -> None:
        self.force, self.width = force, width
        self.before, self.until = 0.0, -1.0

    def __call__(self, seen: Measured) -> float:
        """Normal force in N."""
        if seen.velocity * self.before < 0 and seen.time > self.until:
            self.until = seen.time + self.width
        self.before = seen.velocity
        return 0.0 if seen.time < self.until else self.force


class BangBang:
    """F_N = ``force`` where friction takes energy out (f v > 0), else 0, from the sums over the contacts."""

    def __init__(self, force: float) -> None:
        self.force = force

    def __call__(self, seen: Measured) -> float:
        """Normal force in N."""
        return self.force if float(seen.forces @ seen.slip_velocities) >= 0 else 0.0


def controlled_snapback(
    model: BeamModel, law: ControlLaw, load: float, at: Dof | str, duration: float, actuator: Actuator | None = None,
    sensor: Dof | str | None = None, step: float = 1.25e-5, start_force: float | None = None,
    progress: Progress = silent,
) -> Response:  # fmt: skip
    """Snap-back with a controller for the normal forces.

    Parameters
    ----------
    load : N at DOF ``at``; ``duration`` s.
    law : called every ``actuator.sampling_time`` with a ``Measured``; the displacement is that of ``sensor`` (``at`` by
        default).
    step : s of the time integration, not above the sampling time.
    start_force : normal force in N of every joint while the load is raised; that of the model by default.

    Raises
    ------
    InputError : the law returns NaN or the wrong number of forces; a time is not positive.
    """
    actuator, dof = actuator or Actuator(), Dof.parse(at)
    for name, value in (("duration", duration), ("sampling_time", actuator.sampling_time), ("step", step)):
        if not (np.isfinite(value) and value > 0):
            raise InputError("not a positive number", where=model.name, got=f"{name} = {value}", expected="above 0")
    if actuator.lag < 0:
        raise InputError("a lag is not negative", where=model.name, got=f"{actuator.lag} s", expected="0 s or more")
    seen_dof = Dof.parse(sensor) if sensor is not None else dof
    problem = prepare(model, list(dict.fromkeys([dof, seen_dof])))
    ramped = problem if start_force is None else prepare(model.with_normal_force(start_force), [dof])
    state = released(ramped, load, dof)
    every = max(round(actuator.sampling_time / step), 1)
    stepper = Stepper(problem, state, actuator.sampling_time / every)
    stepper.limits = ramped.system.contacts.limits.copy()
    samples = max(round(duration / actuator.sampling_time), 1)
    runs, forces = _loop(problem, stepper, state, law, actuator, seen_dof, every, samples, model, progress)
    times = actuator.sampling_time * np.arange(samples + 1)
    drive = Drive(times, normal_forces=forces)
    run = {name: np.concatenate([part[name] for part in runs]) for name in runs[0]}
    return _response(problem, drive, run, stepper, actuator.sampling_time, float("nan"), 1.0)


def _loop(
    problem: Problem, stepper: Stepper, state: _State, law: ControlLaw, actuator: Actuator, sensor: Dof, every: int,
    samples: int, model: BeamModel, progress: Progress,
) -> tuple[list[dict[str, np.ndarray]], Float[np.ndarray, "joint sample"]]:  # fmt: skip
    base, contacts = problem.base, problem.system.contacts
    row, joints = base.row(problem.system, sensor), len(model.joints)
    runs = [_initial(stepper, state)]
    delay = round(actuator.lag / actuator.sampling_time)
    first = np.array([joint.normal_force for joint in model.joints])
    queue = [first] * delay
    forces = np.empty((joints, samples + 1))
    for sample in range(samples):
        advance(progress, "control", sample, samples)
        q, p = runs[-1]["q"][-1], runs[-1]["p"][-1]
        seen = Measured(
            sample * actuator.sampling_time, float(row @ q), float(row @ p), base.slip @ q, base.slip @ p,
            runs[-1]["f"][-1],
        )  # fmt: skip
        queue.append(_wanted(law(seen), joints, actuator, problem.system.name, seen.time))
        forces[:, sample] = queue.pop(0)
        limits = (contacts.friction * forces[list(contacts.joint), sample])[None]
        runs.append(stepper.run(every, every, np.ascontiguousarray(limits), np.zeros((0, 0))))
    forces[:, -1] = forces[:, -2] if samples > 1 else forces[:, 0]
    return runs, forces


def _wanted(
    answer: float | Sequence[float] | np.ndarray, joints: int, actuator: Actuator, where: str, time: float
) -> Float[np.ndarray, "joint"]:
    force = np.atleast_1d(np.asarray(answer, dtype=np.float64))
    if not np.all(np.isfinite(force)):
        raise InputError("the control law returns no number", where=where, got=f"{force} at {time:g} s",
                         expected="a normal force in N for every joint")  # fmt: skip
    if len(force) not in (1, joints):
        raise InputError("the control law returns the wrong number of forces", where=where, got=len(force),
                         expected=f"1 or {joints}")  # fmt: skip
    return np.clip(np.broadcast_to(force, (joints,)), *actuator.limits).astype(np.float64)
