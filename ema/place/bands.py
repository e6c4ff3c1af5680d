"""What a placed beam will do at chosen conditions, with 95 % bands, predicted before it is installed."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ema.data import Finding, ModalMap, Provenance
from ema.data.forecast import Forecast, ForecastCheck
from ema.data.placement import Candidates
from ema.deprecation import fields_as_arguments
from ema.errors import InputError
from ema.messages import mark
from ema.place.budget import budget, inputs
from ema.place.fundamental import MAJORITY, fundamental, shares
from ema.place.intervals import beams_drawn, drawn, scattered
from ema.place.lift_off import PRESSURE
from ema.place.model import model_at
from ema.place.predictor import predict
from ema.place.shortlist import Question, question, verify_all
from ema.place.task import Task, only
from ema.progress import Progress, advance, silent

Method = Literal["measured", "frozen"]


@dataclass(frozen=True)
class ForecastSettings:
    """How a forecast is computed.

    Parameters
    ----------
    draws : int, default 400
        Samples for the bands, at least 10.
    seed : int, default 0
        Seed of the draws.
    method : {"measured", "frozen"}, default "measured"
        ``measured`` predicts what a one-mode fit of a stepped sine about the resonance will read, which at a friction
        peak differs from ``frozen``, the equivalent damping of the steady state at resonance.

    Examples
    --------
    >>> ForecastSettings(draws=100).method
    'measured'
    """

    draws: int = 400
    seed: int = 0
    method: Method = "measured"


DEFAULTS = ForecastSettings()


class Draw(NamedTuple):
    """One draw of what is not known: the task, the beam, and the question that is asked of both."""

    task: Task
    beam: Candidates
    case: Question


ReadingsOfDraw = Callable[[Draw], Float[np.ndarray, "reading"]]
"""What else is to be computed of a draw."""
ENOUGH = 0.8
"""Share of the draws that must have a steady state for a band to be given."""
_HARMONICS = 0.05
"""Change of a damping ratio by the upper harmonics from which on it is named."""
_MODE_TOLERANCE = 0.1
"""Largest relative distance between the median frequency of a map and that of a target mode without the beam.

The beam moves a mode by some per cent; of several target modes within reach the nearest one counts. Half of it would
refuse maps of modes that the beam moves by more than 5 %.
"""
_SAME_CONDITION = 0.05
"""Largest relative difference between a force of a map and one of the forecast that count as the same condition."""
_SHIFT = 0.02
"""By what share of its frequency a draw may leave the band in which the nominal resonance is looked for."""


def _no_readings(draw: Draw) -> Float[np.ndarray, "reading"]:
    return np.empty(0)


@fields_as_arguments("settings", ForecastSettings)
def forecast(
    task: Task,
    candidates: Candidates,
    place: int,
    settings: ForecastSettings = DEFAULTS,
    executor: Executor | None = None,
    progress: Progress = silent,
) -> Forecast:
    """Predict frequency and damping of the target modes with the beam at one location, with 95 % bands.

    The values are those of the full model with all modes and all harmonics; where the form of the law is open, they are
    the medians of the draws, for no law is the nominal one. Every draw of what is uncertain (smoothed
    shapes, shape at the exciter, all that ``BoltedJoint`` and ``FrictionBeam`` state an uncertainty of, scatter from
    joint to joint, the form of the law where it is open) is computed with all modes and the first harmonic of the
    friction; the bands are the 2.5 and 97.5 % quantiles of the draws over the nominal case of the same kind. What the
    upper harmonics change hangs on modes at three and five times the frequency, which are known badly: it is drawn
    with its own size in the nominal case as standard deviation. Joints that are pressed and cannot pull
    (``normal_contact = "unilateral"`` with a ``contact_length``) lift off at their edges before they part: values and
    draws are moved by what the first harmonic of such a patch says, for pressures from even to that under a bolt. Laws
    that are no Iwan law, and what a new assembly changes beyond the stated scatter, are not contained.

    Parameters
    ----------
    task : Task
        Structure, joint, target modes, and the forces the forecast is for.
    candidates : Candidates
        Locations of the beam.
    place : int
        Row in ``candidates``.
    settings : ForecastSettings, optional
        Draws, their seed, and what is predicted.
    executor : Executor, optional
        Where the cases are computed; in this process by default.
    progress : Progress, optional
        Called after each draw.

    Returns
    -------
    Forecast
        Values and bands; NaN where there is none, with a finding: the joint parts, no peak belongs to the mode, or the
        beam spreads it over several resonances of which none holds half.

    Raises
    ------
    InputError
        If there are fewer than 10 draws or no such location; and as :func:`predict`.

    Examples
    --------
    >>> from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
    >>> from ema.examples import plate
    >>> from ema.place import ForecastSettings, Task, grid
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> surface = smooth(bare, geometry)
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003, friction_std=0.1)
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([50.0]), modes=(0,))
    >>> spots = grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.2)
    >>> result = forecast(task, spots, 0, ForecastSettings(draws=10, method="frozen"))
    >>> bool(result.damping_low[0, 0, 0] <= result.damping[0, 0, 0] <= result.damping_high[0, 0, 0])
    True
    """
    return forecast_and_draws(task, candidates, place, settings, executor, progress)[0]


def forecast_and_draws(
    task: Task,
    candidates: Candidates,
    place: int,
    settings: ForecastSettings,
    executor: Executor | None = None,
    progress: Progress = silent,
    readings_of: ReadingsOfDraw = _no_readings,
) -> tuple[Forecast, Float[np.ndarray, "draw mode 2 level force"], list[Float[np.ndarray, "reading"]]]:
    """The forecast, its draws (frequency in Hz and damping ratio), and what ``readings_of`` says of each of them."""
    draws, seed, method = settings.draws, settings.seed, settings.method
    if draws < 10:
        raise InputError("too few draws for a band", where=f"place {place}", got=draws, expected="10 or more")
    if not 0 <= place < len(candidates):
        raise InputError("no such place", where="forecast", got=place, expected=f"0 to {len(candidates) - 1}")
    here = only(candidates, [place])
    at_conditions = task._replace(
        force_levels=np.asarray(task.force_levels, dtype=np.float64),
        normal_forces=np.asarray(task.normal_forces, dtype=np.float64),
    )
    nominal = question(at_conditions, predict(at_conditions, here), 0, method == "measured")
    ((_, whole),) = verify_all([nominal], executor)
    spread_out = np.repeat((shares(nominal) < MAJORITY)[:, None], len(at_conditions.force_levels), axis=1)
    middle = np.where(spread_out[:, None], np.nan, whole[:, :2])
    rough = fundamental(nominal)
    harmonics = np.nan_to_num(np.abs(np.log(middle / rough[:, :2])))
    spread, opened, taken, read = _draws(
        at_conditions, here, nominal, harmonics, settings=settings, progress=progress, readings_of=readings_of
    )
    parted = np.mean(opened, axis=0) > 1 - ENOUGH
    middle = np.where((parted & (nominal.pressure is not None))[:, None], np.nan, middle)
    low, values, high = _band(middle, spread / rough[:, :2], named=task.joint.form == "given")
    sources, of_sources = budget(taken, spread / rough[:, :2], harmonics)
    findings = (
        *_about_holes(np.isfinite(low[:, 1]), spread_out, parted, np.isfinite(middle[:, 1])),
        *_about_harmonics(harmonics[:, 1]),
    )
    bare = task.bare.poles[list(task.modes)]
    prediction = Forecast(
        (float(here.centres[0, 0]), float(here.centres[0, 1])),
        float(here.angles[0]),
        here.catalogue[int(here.beams[0])].name,
        tuple(mode + 1 for mode in task.modes),
        np.abs(bare) / (2 * np.pi),
        -bare.real / np.abs(bare),
        at_conditions.force_levels,
        at_conditions.normal_forces,
        values[:, 0],
        low[:, 0],
        high[:, 0],
        values[:, 1],
        low[:, 1],
        high[:, 1],
        draws,
        method,
        sources,
        of_sources[0],
        of_sources[1],
        findings,
        Provenance(steps=("place.forecast",), options=(("draws", str(draws)), ("seed", str(seed)))),
    )
    return prediction, middle * spread / rough[:, :2], read


def _draws(
    task: Task,
    here: Candidates,
    nominal: Question,
    harmonics: Float[np.ndarray, "mode 2 level force"],
    *,
    settings: ForecastSettings,
    progress: Progress,
    readings_of: ReadingsOfDraw,
) -> tuple[
    Float[np.ndarray, "draw mode 2 level force"],
    Bool[np.ndarray, "draw mode level force"],
    list[dict[str, Float[np.ndarray, "mode value"]]],
    list[Float[np.ndarray, "reading"]],
]:
    """Frequencies and damping ratios of all draws, where their joints part, what was drawn, and the readings."""
    spread, opened, taken, read = [], [], [], []
    rng = np.random.default_rng(settings.seed)
    for number, one in enumerate(drawn(task, settings.draws, rng)):
        beam = beams_drawn(here, rng)
        case = assembled(nominal, one, beam, rng)
        if case.pressure is not None:
            case = case._replace(pressure=rng.uniform(*PRESSURE))
        values, parts = resonances_of(case, harmonics, rng)
        spread.append(values)
        opened.append(parts)
        taken.append(inputs(one, case, beam))
        read.append(readings_of(Draw(one, beam, case)))
        advance(progress, "bands of the forecast", number + 1, settings.draws)
    return np.array(spread), np.array(opened), taken, read


def resonances_of(
    case: Question, harmonics: Float[np.ndarray, "mode 2 level force"], rng: np.random.Generator
) -> tuple[Float[np.ndarray, "mode 2 level force"], Bool[np.ndarray, "mode level force"]]:
    """Frequency and damping ratio of one draw, its upper harmonics drawn too, and where its joints part."""
    motion = fundamental(case)
    opened = motion[:, 2] >= 1
    values = np.where((opened & (case.pressure is not None))[:, None], np.nan, motion[:, :2])
    return values * np.exp(harmonics * rng.standard_normal((len(values), 2, 1, 1))), opened


def _about_holes(
    known: np.ndarray, spread_out: np.ndarray, parted: np.ndarray, solved: np.ndarray
) -> tuple[Finding, ...]:
    """Why conditions have no band: the mode is spread over several resonances, the joints part, no peak belongs to the
    mode, or too few draws have one."""
    findings = []
    for code, lost, why, advice in (
        (
            "mode-spread",
            spread_out,
            mark(
                "in {count} of {total} conditions the beam spreads the mode over several resonances, none of which "
                "holds half of it: no single frequency and damping ratio are those of the mode."
            ),
            mark("Look at the FRFs there, choose another place, or a beam whose own resonance is further away."),
        ),
        (
            "joint-parts",
            parted & ~spread_out,
            mark(
                "in {count} of {total} conditions the normal force of a joint varies by more than F_N in a fifth of "
                "the draws or more: it parts there unless it also pulls, and values are predicted only for joints "
                "that can."
            ),
            mark("Press more, or excite less."),
        ),
        (
            "no-peak",
            ~known & ~parted & ~spread_out & ~solved,
            mark(
                "in {count} of {total} conditions no peak of the response belongs to the mode: another mode moves more "
                "wherever there is one."
            ),
            mark("Choose another excited DOF, or ask for the neighbouring mode."),
        ),
        (
            "no-band",
            ~known & ~parted & ~spread_out & solved,
            mark(
                "in {count} of {total} conditions a fifth of the draws or more have no peak that belongs to the mode."
            ),
            mark("Their bands are left open."),
        ),
    ):
        if lost.any():
            count = int(lost.sum())
            findings.append(
                Finding.of(
                    "warning", code, "forecast", why, float(count), 0.0, advice=advice, count=count, total=known.size
                )
            )
    return tuple(findings)


def _about_harmonics(damping: Float[np.ndarray, "mode level force"]) -> tuple[Finding, ...]:
    """Whether the upper harmonics of the friction force change a damping ratio, by its logarithm, by much."""
    count, most = int(np.sum(damping > _HARMONICS)), float(damping.max())
    if not count:
        return ()
    return (
        Finding.of(
            "warning",
            "upper-harmonics",
            "forecast",
            "in {count} of {total} conditions the upper harmonics of the friction force change the damping ratio by "
            "more than {limit_share}, at most {most}: as where a mode lies near three or five times the frequency.",
            most,
            _HARMONICS,
            advice="The bands hold as much to either side; what is true hangs on the frequency of that upper mode.",
            count=count,
            total=damping.size,
            limit_share=f"{_HARMONICS:.0%}",
            most=f"{most:.0%}",
        ),
    )


def assembled(nominal: Question, task: Task, candidates: Candidates, rng: np.random.Generator) -> Question:
    """The question of a draw, in the bands of the nominal one and what a draw may shift; every joint is drawn."""
    pressed = float(task.normal_forces[0])
    model = model_at(task, candidates, 0, pressed)
    bands = tuple((low * (1 - _SHIFT), high * (1 + _SHIFT)) for low, high in nominal.bands)
    drawn = nominal._replace(model=model, normal_forces=task.normal_forces, bands=bands)
    return _uneven(drawn, task.joint.scatter, rng)


def _band(
    middle: Float[np.ndarray, "mode 2 level force"],
    ratios: Float[np.ndarray, "draw mode 2 level force"],
    *,
    named: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The 2.5 % quantiles of the draws, the values, and the 97.5 % quantiles (mode, 2, level, force).

    The quantile at p is the order statistic p (n + 1), which another draw exceeds with probability 1 - p; with fewer
    than 39 draws the band is their range, which holds (n - 1)/(n + 1) of all. Where the law is ``named`` the value is
    the nominal case, ``middle``, and the band holds it; where the form is open no law is the nominal one, and the value
    is the median of the draws. Without a band there is only the nominal value; too few draws have no band: NaN.
    """
    known = (np.mean(np.isfinite(ratios), axis=0) >= ENOUGH) & np.isfinite(middle)
    points = np.nanquantile(np.where(known, ratios, 1.0), [0.025, 0.5, 0.975], axis=0, method="weibull")
    if named:
        # at the ridge of the damping every change lowers it
        points = np.stack([np.minimum(points[0], 1.0), np.ones_like(middle), np.maximum(points[2], 1.0)])
    low, value, high = np.where(known, middle * points, np.nan)
    return low, np.where(known, value, middle), high


def _uneven(asked: Question, scatter: float, rng: np.random.Generator) -> Question:
    """The question with mu and k_T of every joint drawn on their own."""
    if scatter == 0:
        return asked
    joints = [replace(joint, law=scattered(joint.law, scatter, rng)) for joint in asked.model.joints]
    return asked._replace(model=replace(asked.model, joints=tuple(joints)))


def check(forecast: Forecast, maps: Sequence[ModalMap]) -> ForecastCheck:
    """Compare a forecast with measured maps; each map belongs to the mode whose frequency without the beam is nearest.

    Parameters
    ----------
    forecast : Forecast
        Predicted frequency [Hz] and damping ratio (mode, level, force).
    maps : sequence of ModalMap
        Measured maps, one per mode.

    Returns
    -------
    ForecastCheck
        Measured values on the grid of the forecast; NaN for conditions that no map contains.

    Raises
    ------
    InputError
        If a map belongs to no target mode, two maps to one mode, or a map has no condition of the forecast.

    Examples
    --------
    >>> from ema.examples import forecast, modal_map
    >>> comparison = check(forecast(), [modal_map()])
    >>> comparison.inside, comparison.values
    (12, 12)
    """
    measured = np.full((2, *forecast.damping.shape), np.nan)
    used: dict[int, str] = {}
    for measured_map in maps:
        where = measured_map.name or "map"
        frequency = float(np.nanmedian(measured_map.frequency))
        mode = int(np.argmin(np.abs(forecast.bare_frequencies - frequency)))
        if abs(forecast.bare_frequencies[mode] / frequency - 1) > _MODE_TOLERANCE:
            raise InputError(
                "the map belongs to none of the forecast's target modes",
                where=where,
                got=f"median frequency {frequency:.1f} Hz",
                expected=f"within {_MODE_TOLERANCE:.0%} of "
                + ", ".join(f"{f:.1f} Hz" for f in forecast.bare_frequencies),
                advice="leave this map out, or add its mode to the target modes of the placement",
            )
        if mode in used:
            raise InputError("two maps of one mode", where=where, got=used[mode], expected="one map per mode")
        used[mode] = where
        levels = _rows(forecast.force_levels, measured_map.force_levels)
        forces = _rows(forecast.normal_forces, measured_map.normal_forces)
        pairs = [(i, j, a, b) for i, a in enumerate(levels) for j, b in enumerate(forces) if a >= 0 and b >= 0]
        if not pairs:
            raise InputError(
                "the map holds none of the conditions of the forecast",
                where=where,
                got=f"F_E {measured_map.force_levels.tolist()} N, F_N {measured_map.normal_forces.tolist()} N",
                expected=f"F_E {forecast.force_levels.tolist()} N, F_N {forecast.normal_forces.tolist()} N",
            )
        for i, j, a, b in pairs:
            measured[:, mode, i, j] = measured_map.frequency[a, b], measured_map.damping[a, b]
    return ForecastCheck(forecast, measured[0], measured[1], tuple(used[mode] for mode in sorted(used)))


def _rows(wanted: np.ndarray, known: np.ndarray) -> list[int]:
    """Row of ``known`` within 5 % of each wanted value, -1 where there is none."""
    result = []
    for value in wanted:
        row = int(np.argmin(np.abs(known - value)))
        result.append(row if abs(known[row] - value) <= _SAME_CONDITION * value else -1)
    return result
