"""The next best test: what tests of a placed beam, or of one joint, would read by every draw of a forecast."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from ema.data.forecast import Forecast
from ema.data.placement import BoltedJoint, Candidates
from ema.data.trials import Trial, Trials
from ema.errors import InputError
from ema.place.bands import (
    DEFAULTS,
    ENOUGH,
    Draw,
    ForecastSettings,
    Method,
    assembled,
    beam_asked,
    forecast_and_draws,
    resonances_of,
)
from ema.place.conditioning import with_expected_widths
from ema.place.describing import SIZE, START, STEP, secant_table
from ema.place.fundamental import fundamental
from ema.place.intervals import scattered
from ema.place.predictor import contact_stiffness, predict
from ema.place.shortlist import Question, question, verify_all
from ema.place.task import Task, only
from ema.progress import Progress, silent

AMPLITUDES = (0.5, 1.0, 2.0, 5.0)
"""Amplitudes of slip at which loops of one joint are read, in units of mu F_N / k_T: from microslip to full sliding."""
_ROUNDING = 1e-9
"""Share of the measured extent that is none."""
QUANTITIES = ("f [Hz]", "zeta [-]")


class Costs(NamedTuple):
    """What tests cost in hours, and the relative standard uncertainty of what they read.

    Parameters
    ----------
    mounting : float, default 1.0
        Bolting the beam on [h].
    condition : float, default 0.25
        Stepped sines of all target modes at one F_E and F_N [h].
    loop : float, default 4.0
        Loops of one joint in a rig at one F_N [h].
    frequency_std, damping_std : float, default 5e-4, 0.03
        Relative standard uncertainty of a frequency and of a damping ratio that is read.
    loop_std : float, default 0.05
        That of the stiffness and of the energy per cycle of a loop.

    Examples
    --------
    >>> Costs(mounting=2.0).condition
    0.25
    """

    mounting: float = 1.0
    condition: float = 0.25
    loop: float = 4.0
    frequency_std: float = 5e-4
    damping_std: float = 0.03
    loop_std: float = 0.05


class TrialCondition(NamedTuple):
    """Another place at which the beam can be tried, under one condition.

    Parameters
    ----------
    place : int
        Row in the candidates.
    force_level : float
        F_E [N].
    normal_force : float
        F_N per joint [N].

    Examples
    --------
    >>> TrialCondition(3, force_level=30.0, normal_force=120.0).place
    3
    """

    place: int
    force_level: float
    normal_force: float


def next_tests(
    task: Task,
    candidates: Candidates,
    place: int,
    *,
    others: Sequence[TrialCondition] = (),
    costs: Costs | None = None,
    settings: ForecastSettings = DEFAULTS,
    executor: Executor | None = None,
    progress: Progress = silent,
) -> Trials:
    """Forecast a placed beam, and say which test would narrow the forecast most per hour.

    Offered are the beam at its place under each condition of the forecast, the beam at other places, and loops of one
    joint alone under each normal force. Every draw of the forecast says what a test will read; how well readings
    explain the forecast over the draws says what they will leave of its bands (:func:`updated`). Joints differ from
    assembly to assembly by the stated scatter; a beam that is tried at its own place stays installed. The forecast is
    that of :func:`forecast`.

    Parameters
    ----------
    task : Task
        Structure, joint, target modes, and the forces the forecast is for.
    candidates : Candidates
        Locations of the beam.
    place : int
        Row in ``candidates`` that the forecast is for.
    others : sequence of TrialCondition, optional
        Other places where the beam can be tried, with their conditions.
    costs : Costs, optional
        What tests cost, and how well they read; the defaults of ``Costs`` by default.
    settings : ForecastSettings, optional
        As in :func:`forecast`.
    executor : Executor, optional
        Where the nominal cases are computed; in this process by default.
    progress : Progress, optional
        Called after each draw.

    Returns
    -------
    Trials
        The forecast with its draws, and the tests.

    Raises
    ------
    InputError
        As :func:`forecast`; if there is no such other place, or its joints lie beyond the measured points.

    Examples
    --------
    >>> from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
    >>> from ema.examples import plate
    >>> from ema.place import ForecastSettings, Task, grid
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> surface = smooth(bare, geometry)
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003, friction_std=0.1)
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([5.0, 10.0]), np.array([50.0]), modes=(0,))
    >>> spots = grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.2)
    >>> offered = next_tests(task, spots, 0, settings=ForecastSettings(draws=40, method="frozen"))
    >>> [trial.kind for trial in offered.trials]
    ['beam', 'beam', 'loop']
    """
    costs = Costs() if costs is None else costs
    forces = np.asarray(task.normal_forces, np.float64)
    places = [_other_place(task, candidates, other, settings.method, executor) for other in others]
    slips = [_slips(task.joint, float(force)) for force in forces]
    rng = np.random.default_rng([settings.seed, 1])

    def readings_of(draw: Draw) -> Float[np.ndarray, "reading"]:
        """What a draw reads at the other places, then in loops under each normal force."""
        factor = float(draw.task.normal_forces[0] / forces[0])
        elsewhere = [_readings_there(other, draw, factor, rng).ravel() for other in places]
        loops = [
            loop_readings(_specimen(draw.task, rng), slip, float(factor * force))
            for slip, force in zip(slips, forces, strict=True)
        ]
        return np.concatenate([*elsewhere, *(loop.ravel() for loop in loops)])

    asked = beam_asked(task, candidates, place, settings.method)
    prediction, values, readings = forecast_and_draws(asked, settings, executor, progress, readings_of)
    elsewhere, loops = np.split(np.array(readings), [2 * len(prediction.modes) * len(places)], axis=1)
    tests = [
        *_of_beam(prediction, values, costs),
        *_of_other_places(prediction, list(zip(others, places, strict=True)), elsewhere, costs),
        *_of_loops(forces, loops, costs),
    ]
    return with_expected_widths(Trials(prediction, values, tuple(test for test in tests if test is not None)))


def _of_beam(
    prediction: Forecast, values: Float[np.ndarray, "draw mode 2 level force"], costs: Costs
) -> Iterator[Trial | None]:
    """The beam at its place, under each condition of the forecast."""
    for i, j in np.ndindex(values.shape[3:]):
        level, force = float(prediction.force_levels[i]), float(prediction.normal_forces[j])
        block = values[:, :, :, i, j].reshape(len(values), -1)
        yield _of_conditions(
            prediction, block, costs, level=level, force=force, centre=prediction.centre, angle=prediction.angle
        )


def _of_other_places(
    prediction: Forecast,
    places: Sequence[tuple[TrialCondition, "_OtherPlace"]],
    readings: Float[np.ndarray, "draw reading"],
    costs: Costs,
) -> Iterator[Trial | None]:
    """The beam at other places; ``readings`` holds those at each, one after the other."""
    blocks = np.split(readings, max(len(places), 1), axis=1)
    for (condition, other), block in zip(places, blocks, strict=False):
        x, y = other.candidates.centres[0]
        yield _of_conditions(
            prediction,
            block,
            costs,
            level=condition.force_level,
            force=condition.normal_force,
            centre=(float(x), float(y)),
            angle=float(other.candidates.angles[0]),
        )


def _of_conditions(
    prediction: Forecast,
    values: Float[np.ndarray, "draw reading"],
    costs: Costs,
    *,
    level: float,
    force: float,
    **where: Any,
) -> Trial | None:
    names = [f"mode {mode}: {what}" for mode in prediction.modes for what in QUANTITIES]
    std = np.tile([costs.frequency_std, costs.damping_std], len(prediction.modes))
    hours = costs.mounting + costs.condition
    return _trial("beam", names, values, std, hours, force_level=level, normal_force=force, **where)


def _of_loops(
    forces: Float[np.ndarray, "force"], readings: Float[np.ndarray, "draw reading"], costs: Costs
) -> Iterator[Trial | None]:
    """Loops of one joint alone under each normal force."""
    names = [f"{what} at {one:g} mu F_N/k_T" for what in ("stiffness [N/m]", "energy [J]") for one in AMPLITUDES]
    std = np.full(len(names), costs.loop_std)
    for force, block in zip(forces, np.split(readings, len(forces), axis=1), strict=True):
        yield _trial("loop", names, block, std, costs.loop, normal_force=float(force))


def loop_readings(
    joint: BoltedJoint, slips: Float[np.ndarray, "amplitude"], normal_force: float
) -> Float[np.ndarray, "2 amplitude"]:
    """Stiffness [N/m] of the first harmonic and energy [J] per cycle of one joint, at amplitudes of its slip [m]."""
    law = joint.law
    (stiffness,), limit = contact_stiffness(joint, np.array([normal_force])), law.friction_coefficient * normal_force
    table = secant_table(law.name, law.parameters)
    at, grid = (np.log(slips * stiffness / limit) - START) / STEP, np.arange(SIZE)
    elastic, lost = (stiffness * np.interp(at, grid, part) for part in (table.real, table.imag))
    return np.array([elastic, np.pi * slips**2 * lost])


def _slips(joint: BoltedJoint, normal_force: float) -> Float[np.ndarray, "amplitude"]:
    """Amplitudes [m] at which loops of the joint are read."""
    limit = joint.law.friction_coefficient * normal_force
    return np.asarray(np.array(AMPLITUDES) * limit / contact_stiffness(joint, np.array([normal_force])))


def _specimen(task: Task, rng: np.random.Generator) -> BoltedJoint:
    """Another joint of the kind, for the rig."""
    return replace(task.joint, law=scattered(task.joint.law, task.joint.scatter, rng))


class _OtherPlace(NamedTuple):
    """The beam at another place: the question, its answer, and that by the fundamental alone."""

    candidates: Candidates
    nominal: Question
    middle: Float[np.ndarray, "mode 2 1 1"]
    rough: Float[np.ndarray, "mode 2 1 1"]


def _other_place(
    task: Task, candidates: Candidates, other: TrialCondition, method: Method, executor: Executor | None
) -> _OtherPlace:
    if not 0 <= other.place < len(candidates):
        raise InputError("no such place", where="tests", got=other.place, expected=f"0 to {len(candidates) - 1}")
    only_one = only(candidates, [other.place])
    joints, (low, high) = only_one.joints(0), task.surface.extent.T
    share = (joints - low) / (high - low)
    if share.min() < -_ROUNDING or share.max() > 1 + _ROUNDING:
        raise InputError(
            "a joint of the beam lies beyond the measured points",
            where=f"test at ({only_one.centres[0, 0]:g}, {only_one.centres[0, 1]:g}) m",
            got=f"joints at {np.round(joints, 4).tolist()} m",
            expected=f"{low[0]:.4g} to {high[0]:.4g} m and {low[1]:.4g} to {high[1]:.4g} m",
        )
    levels, forces = np.array([other.force_level]), np.array([other.normal_force])
    there = task._replace(force_levels=levels, normal_forces=forces)
    nominal = question(there, predict(there, only_one), 0, method == "measured")
    ((_, whole),) = verify_all([nominal], executor)
    return _OtherPlace(only_one, nominal, whole[:, :2], fundamental(nominal)[:, :2])


def _readings_there(
    other: _OtherPlace, draw: Draw, factor: float, rng: np.random.Generator
) -> Float[np.ndarray, "mode 2"]:
    """What a draw reads at another place: a new assembly of the same kind of joints."""
    beam = replace(other.candidates, catalogue=draw.beams[0].catalogue)
    sample = draw.task._replace(normal_forces=factor * other.nominal.normal_forces)
    case = assembled(other.nominal, sample, beam, rng)._replace(pressure=draw.case.pressure)
    values, _ = resonances_of(case, np.nan_to_num(np.abs(np.log(other.middle / other.rough))), rng)
    return np.asarray((other.middle * values / other.rough)[..., 0, 0])


def _trial(
    kind: Literal["beam", "loop"],
    names: Sequence[str],
    values: Float[np.ndarray, "draw reading"],
    std: Float[np.ndarray, "reading"],
    hours: float,
    **about: Any,
) -> Trial | None:
    """A test with the readings that most draws have; ``None`` where there are none."""
    with np.errstate(invalid="ignore"):
        read = np.mean(np.isfinite(values) & (values > 0), axis=0) >= ENOUGH
    if not read.any():
        return None
    chosen = tuple(np.array(names)[read].tolist())
    return Trial(kind, chosen, np.where(values > 0, values, np.nan)[:, read], std[read], hours, **about)
