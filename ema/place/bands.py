"""What a placed beam will do at chosen conditions, with 95 % bands, predicted before it is installed."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ema.data import BeamModel, Finding, Provenance
from ema.data.forecast import Forecast
from ema.data.placement import Candidates
from ema.deprecation import fields_as_arguments
from ema.errors import InputError
from ema.place.budget import budget, inputs
from ema.place.forecast_findings import about_harmonics, about_holes
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
    """One draw of what is not known: the task, the beams, and the question that is asked of all."""

    task: Task
    beams: tuple[Candidates, ...]
    case: Question


ReadingsOfDraw = Callable[[Draw], Float[np.ndarray, "reading"]]
"""What else is to be computed of a draw."""
ENOUGH = 0.8
"""Share of the draws that must have a steady state for a band to be given."""
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
    return forecast_and_draws(beam_asked(task, candidates, place, settings.method), settings, executor, progress)[0]


class Asked(NamedTuple):
    """What a forecast is about: the task, its beams (each the first candidate of its own), and their question.

    ``nominal`` has all uncertain values as stated; ``model_of`` makes the model of a drawn task and drawn beams.
    """

    task: Task
    beams: tuple[Candidates, ...]
    nominal: Question
    model_of: Callable[[Task, Sequence[Candidates]], BeamModel]


def beam_asked(task: Task, candidates: Candidates, place: int, method: Method) -> Asked:
    """A single beam, the candidate ``place``, under the forces of the task.

    Raises
    ------
    InputError : no such location.
    """
    if not 0 <= place < len(candidates):
        raise InputError("no such place", where="forecast", got=place, expected=f"0 to {len(candidates) - 1}")
    here = only(candidates, [place])
    at_conditions = task._replace(
        force_levels=np.asarray(task.force_levels, dtype=np.float64),
        normal_forces=np.asarray(task.normal_forces, dtype=np.float64),
    )
    nominal = question(at_conditions, predict(at_conditions, here), 0, method == "measured")
    return Asked(at_conditions, (here,), nominal, _model_of_one)


def _model_of_one(task: Task, beams: Sequence[Candidates]) -> BeamModel:
    return model_at(task, beams[0], 0, float(task.normal_forces[0]))


def forecast_and_draws(
    asked: Asked,
    settings: ForecastSettings,
    executor: Executor | None = None,
    progress: Progress = silent,
    readings_of: ReadingsOfDraw = _no_readings,
) -> tuple[Forecast, Float[np.ndarray, "draw mode 2 level force"], list[Float[np.ndarray, "reading"]]]:
    """The forecast, its draws (frequency in Hz and damping ratio), and what ``readings_of`` says of each of them.

    Values are by all modes and harmonics, bands by draws of the fundamental.

    Raises
    ------
    InputError : fewer than 10 draws.
    """
    task, nominal = asked.task, asked.nominal
    if settings.draws < 10:
        raise InputError("too few draws for a band", where="forecast", got=settings.draws, expected="10 or more")
    ((_, whole),) = verify_all([nominal], executor)
    spread_out = np.repeat((shares(nominal) < MAJORITY)[:, None], len(nominal.force_levels), axis=1)
    middle = np.where(spread_out[:, None], np.nan, whole[:, :2])
    rough = fundamental(nominal)[:, :2]
    harmonics = np.nan_to_num(np.abs(np.log(middle / rough)))
    spread, opened, taken, read = _draws(asked, harmonics, settings, progress, readings_of=readings_of)
    ratios = spread / rough
    parted = np.mean(opened, axis=0) > 1 - ENOUGH
    middle = np.where((parted & (nominal.pressure is not None))[:, None], np.nan, middle)
    bands = _band(middle, ratios, named=task.joint.form == "given")
    findings = (
        *about_holes(np.isfinite(bands[0][:, 1]), spread_out, parted, np.isfinite(middle[:, 1])),
        *about_harmonics(harmonics[:, 1]),
    )
    prediction = _as_forecast(asked, settings, bands, budget(taken, ratios, harmonics), findings)
    return prediction, middle * ratios, read


def _as_forecast(
    asked: Asked,
    settings: ForecastSettings,
    bands: tuple[np.ndarray, np.ndarray, np.ndarray],
    shares_of: tuple[tuple[str, ...], np.ndarray],
    findings: tuple[Finding, ...],
) -> Forecast:
    """Values with their bands and budget as a container; several beams have neither centre nor angle."""
    low, values, high = bands
    sources, of_sources = shares_of
    bare = asked.task.bare.poles[list(asked.task.modes)]
    here, several = asked.beams[0], len(asked.beams) > 1
    options = [("draws", str(settings.draws)), ("seed", str(settings.seed))]
    return Forecast(
        (np.nan, np.nan) if several else (float(here.centres[0, 0]), float(here.centres[0, 1])),
        np.nan if several else float(here.angles[0]),
        f"{len(asked.beams)} beams" if several else here.catalogue[int(here.beams[0])].name,
        tuple(mode + 1 for mode in asked.task.modes),
        np.abs(bare) / (2 * np.pi),
        -bare.real / np.abs(bare),
        asked.nominal.force_levels,
        asked.nominal.normal_forces,
        values[:, 0],
        low[:, 0],
        high[:, 0],
        values[:, 1],
        low[:, 1],
        high[:, 1],
        settings.draws,
        settings.method,
        sources,
        of_sources[0],
        of_sources[1],
        findings,
        Provenance(
            steps=("place.forecast",),
            options=tuple([*options, ("beams", str(len(asked.beams)))] if several else options),
        ),
    )


def _draws(
    asked: Asked,
    harmonics: Float[np.ndarray, "mode 2 level force"],
    settings: ForecastSettings,
    progress: Progress,
    *,
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
    for number, sample in enumerate(drawn(asked.task, settings.draws, rng)):
        beams = _materials_drawn(asked.beams, rng)
        case = redrawn(asked.nominal, sample, asked.model_of(sample, beams), rng)
        if case.pressure is not None:
            case = case._replace(pressure=rng.uniform(*PRESSURE))
        values, parts = resonances_of(case, harmonics, rng)
        spread.append(values)
        opened.append(parts)
        taken.append(inputs(sample, case, beams))
        read.append(readings_of(Draw(sample, beams, case)))
        advance(progress, "bands of the forecast", number + 1, settings.draws)
    return np.array(spread), np.array(opened), taken, read


def _materials_drawn(beams: tuple[Candidates, ...], rng: np.random.Generator) -> tuple[Candidates, ...]:
    """The beams with a draw of the loss factor of their material, which is one for all that act together."""
    first = beams_drawn(beams[0], rng)
    loss = first.catalogue[int(first.beams[0])].loss
    return (
        first,
        *(replace(here, catalogue=tuple(replace(one, loss=loss) for one in here.catalogue)) for here in beams[1:]),
    )


def resonances_of(
    case: Question, harmonics: Float[np.ndarray, "mode 2 level force"], rng: np.random.Generator
) -> tuple[Float[np.ndarray, "mode 2 level force"], Bool[np.ndarray, "mode level force"]]:
    """Frequency and damping ratio of one draw, its upper harmonics drawn too, and where its joints part."""
    motion = fundamental(case)
    opened = motion[:, 2] >= 1
    values = np.where((opened & (case.pressure is not None))[:, None], np.nan, motion[:, :2])
    return values * np.exp(harmonics * rng.standard_normal((len(values), 2, 1, 1))), opened


def assembled(nominal: Question, task: Task, candidates: Candidates, rng: np.random.Generator) -> Question:
    """The question of a draw with one beam, the first candidate."""
    return redrawn(nominal, task, _model_of_one(task, (candidates,)), rng)


def redrawn(nominal: Question, task: Task, model: BeamModel, rng: np.random.Generator) -> Question:
    """The question of a drawn model, in the nominal bands and what a draw may shift; every joint is drawn."""
    limits = tuple((low * (1 - _SHIFT), high * (1 + _SHIFT)) for low, high in nominal.bands)
    case = nominal._replace(model=model, normal_forces=task.normal_forces, bands=limits)
    return _uneven(case, task.joint.scatter, rng)


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
