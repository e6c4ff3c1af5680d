"""The forecast of several beams that act at the same time, each with its own location and normal force."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from ema.data import Forecast, Geometry, ModalModel, Provenance
from ema.data.placement import Candidates
from ema.dof import Dof
from ema.errors import InputError
from ema.place import bands
from ema.place.bands import ENOUGH, ForecastSettings, resonances_of
from ema.place.beams_model import beams_model
from ema.place.budget import budget, inputs
from ema.place.candidates import about_keep_out, touch
from ema.place.flags import about_overhang, about_points
from ema.place.fundamental import MAJORITY, fundamental, linear_modes, shares
from ema.place.intervals import beams_drawn, drawn
from ema.place.job import refuse_modes_with_a_beam, target_task, under_conditions
from ema.place.lift_off import PRESSURE
from ema.place.location import Location, about_forces, about_readings, located
from ema.place.recipe import ForecastTable, PlaceRecipe
from ema.place.shortlist import Question, verify_all
from ema.place.task import Task
from ema.progress import Progress, advance, silent

_WIDER = 0.05
"""Part of a frequency by which the band of a mode is wider than from sliding to sticking joints, as in a shortlist."""
_SHAPE = "mode shape at joints and exciter"
"""The source of the budget that every beam has its own values of."""


@dataclass(frozen=True, kw_only=True)
class BeamsForecast:
    """What several beams do together.

    Parameters
    ----------
    locations : tuple of Location
        Where the beams are bolted, with their names.
    normal_forces : array of shape (force, beam)
        F_N per joint [N] of every beam.
    forecast : Forecast
        Frequency and damping with all beams, over F_E and the rows of ``normal_forces``. Its own ``normal_forces`` are
        those of the beam that is pressed most, its ``beam`` lists all beams, and its centre and angle are NaN.

    Examples
    --------
    >>> from ema.examples import forecast
    >>> here = (Location(centre=(0.1, 0.1), beam="slim"), Location(centre=(0.4, 0.1), beam="slim"))
    >>> BeamsForecast(locations=here, normal_forces=np.full((3, 2), 80.0), forecast=forecast()).normal_forces.shape
    (3, 2)
    """

    locations: tuple[Location, ...]
    normal_forces: Float[np.ndarray, "force beam"]
    forecast: Forecast


def forecast_together(
    recipe: PlaceRecipe,
    bare: ModalModel,
    geometry: Geometry,
    locations: Sequence[Location],
    *,
    force_levels: Sequence[float] | Float[np.ndarray, "level"] = (),
    normal_forces: Sequence[float] | Float[np.ndarray, "beam"] = (),
    progress: Progress = silent,
) -> BeamsForecast:
    """Predict frequency and damping with several beams that act at the same time, with 95 % bands.

    All joints are in one harmonic balance with all modes. What the recipe states an uncertainty of is drawn as for one
    beam (:func:`forecast_at`): what is alike in all joints is alike in those of all beams, and ``scatter`` is drawn for
    every joint on its own. Values and bands do not depend on the order of the beams.

    Parameters
    ----------
    recipe : PlaceRecipe
        Beams, joint, target modes, areas kept free, and the range of forces.
    bare : ModalModel
        Mass-normalised modes without a beam, at the points of ``geometry``.
    geometry : Geometry
        Points [m] of the structure.
    locations : sequence of Location
        Where the beams are bolted.
    force_levels : sequence of float or array of shape (level,), optional
        F_E [N]; by default those of the recipe's forecast, or of the recipe.
    normal_forces : sequence of float or array of shape (beam,), optional
        F_N per joint [N], one for all beams or one for each; by default every one of the recipe's, alike for all.
    progress : Progress, optional
        Called after each draw.

    Returns
    -------
    BeamsForecast
        The beams, their forces, and what they do together; findings as of :func:`forecast_at`, but for those that a
        ranking flags of a beam alone.

    Raises
    ------
    InputError
        If two beams overlap, they differ in the loss factor of their material, the normal forces are neither one nor
        as many as the beams; and as :func:`forecast_at`.

    Examples
    --------
    >>> from ema.examples import plate
    >>> from ema.place.recipe import PlaceRecipe
    >>> law = {"name": "masing", "friction_coefficient": 0.4, "contact_stiffness": "2e7 N/m"}
    >>> recipe = PlaceRecipe.model_validate({
    ...     "near": "84 Hz", "at": "1:+Z", "force": "10 N", "normal_force": ["20 N", "50 N"],
    ...     "beams": [{"spacing": "0.2 m", "width": "20 mm", "height": "10 mm"}],
    ...     "joint": {"law": law, "surface_height": "3 mm", "normal_stiffness": "1e8 N/m"},
    ...     "forecast": {"normal_force": "50 N", "draws": 10, "method": "frozen"},
    ... })
    >>> here = [Location(centre=(0.2, 0.05)), Location(centre=(0.2, 0.25))]
    >>> result = forecast_together(recipe, *plate(), here, normal_forces=[20.0, 50.0])
    >>> result.forecast.damping.shape, result.normal_forces
    ((1, 1, 1), array([[20., 50.]]))
    """
    where = bare.name or "bare structure"
    refuse_modes_with_a_beam(bare, where)
    task, hung = target_task(recipe, bare, geometry, where)
    table = recipe.forecast or ForecastTable.model_construct(normal_force=list(recipe.normal_force))
    beams = [located(recipe, task.surface, location) for location in locations]
    if not beams:
        raise InputError("no location for a beam", where=where, expected="one or more locations")
    names = tuple(_named(here) for here in beams)
    refuse_overlap(beams, names)
    pressed = _pressed(normal_forces, table, len(beams))
    order = _order(names, pressed)
    levels = np.unique(list(force_levels) or table.force or recipe.force)
    conditions, beyond = under_conditions(table, task, levels.tolist(), pressed[:, order[0]].tolist())
    settings = ForecastSettings(table.draws, table.seed, table.method)
    predicted = _forecast(conditions, [beams[one] for one in order], pressed[0, order], settings, progress)
    own = [replace(one, where=str(name)) for here, name in zip(beams, names) for one in about_overhang(task, here, 0)]
    findings = (
        *predicted.findings,
        *own,
        *about_points(task),
        *about_keep_out(task.surface, recipe.keep_out()),
        *recipe.former_names,
        *hung,
        *beyond,
        *about_forces(recipe, levels, np.unique(pressed)),
        *about_readings(recipe),
    )
    return BeamsForecast(
        locations=names,
        normal_forces=pressed,
        forecast=replace(predicted, beam=_listed(names, pressed), findings=findings),
    )


def refuse_overlap(beams: Sequence[Candidates], names: Sequence[Location]) -> None:
    """Refuse beams of which two cover a common point of the structure.

    Raises
    ------
    InputError : two of them do.
    """
    for later in range(len(beams)):
        for earlier in range(later):
            if overlap(beams[earlier], beams[later])[0]:
                raise InputError(
                    "two beams overlap",
                    where=str(names[later]),
                    got=str(names[earlier]),
                    expected="beams that share no point with their whole length and width",
                    advice="move or turn one of them",
                )


def overlap(beam: Candidates, candidates: Candidates) -> Bool[np.ndarray, "candidate"]:
    """Which candidates share a point with a beam, the first candidate of its own: whole lengths and widths count."""
    corners = _footprint(beam)
    result = np.zeros(len(candidates), bool)
    for kind, angle in sorted(set(zip(candidates.beams.tolist(), candidates.angles.tolist(), strict=True))):
        rows = np.flatnonzero((candidates.beams == kind) & (candidates.angles == angle))
        own = candidates.catalogue[kind]
        result[rows] = touch(candidates.centres[rows], angle, (own.length, own.width), corners)
    return result


def _footprint(here: Candidates) -> Float[np.ndarray, "corner 2"]:
    """Corners of the rectangle that a beam covers."""
    beam, angle = here.catalogue[int(here.beams[0])], float(here.angles[0])
    along = 0.5 * beam.length * np.array([np.cos(angle), np.sin(angle)])
    across = 0.5 * beam.width * np.array([-np.sin(angle), np.cos(angle)])
    return np.asarray(here.centres[0] + np.array([along + across, across - along, -along - across, along - across]))


def _named(here: Candidates) -> Location:
    x, y = here.centres[0].tolist()
    return Location(centre=(x, y), angle=float(here.angles[0]), beam=here.catalogue[int(here.beams[0])].name)


def _listed(names: Sequence[Location], pressed: Float[np.ndarray, "force beam"]) -> str:
    """All beams in words, with their normal forces where they differ."""
    alike = np.ptp(pressed) == 0 or len(pressed) > 1
    said = [str(name) + ("" if alike else f", F_N {force:g} N") for name, force in zip(names, pressed[0], strict=True)]
    return said[0] if len(said) == 1 else f"{len(names)} beams together: " + "; ".join(said)


def _pressed(
    given: Sequence[float] | Float[np.ndarray, "beam"], table: ForecastTable, count: int
) -> Float[np.ndarray, "force beam"]:
    """Normal forces of every beam [N], one row for each condition.

    Raises
    ------
    InputError : neither one nor as many as the beams, or one that is not positive.
    """
    forces = np.asarray(given, dtype=np.float64)
    if not forces.size:
        return np.repeat(np.unique(table.normal_force)[:, None], count, axis=1)
    if forces.size not in (1, count):
        raise InputError(
            "the normal forces do not fit the beams",
            where="normal forces",
            got=f"{forces.size} for {count} beams",
            expected="one for all, or one for each",
        )
    if not (np.all(np.isfinite(forces)) and np.all(forces > 0)):
        raise InputError(
            "not normal forces", where="normal forces", got=forces.tolist(), expected="positive numbers in N"
        )
    return np.array(np.broadcast_to(forces, (1, count)))


def _order(names: Sequence[Location], pressed: Float[np.ndarray, "force beam"]) -> list[int]:
    """Rows of the beams in an order of their own, whatever that of the user, the beam that is pressed most first."""
    keys = [(-pressed[0, row], *name.centre, name.angle, name.beam, row) for row, name in enumerate(names)]
    return [int(key[-1]) for key in sorted(keys)]


def beams_question(
    task: Task,
    beams: Sequence[Candidates],
    normal_forces: Sequence[float] | Float[np.ndarray, "beam"],
    *,
    fitted: bool = False,
) -> Question:
    """The model of the beams under the forces of the task, and the band of every target mode.

    A band reaches from the frequency with joints that slide to that with joints that stick, and a little further; the
    mode with the beams is that which holds most of the bare one. The forces of the task are those of the first beam.
    """
    model, at = beams_model(task, beams, normal_forces), Dof.parse(task.at)
    ends = []
    for force in np.asarray(task.normal_forces, dtype=np.float64):
        pressed = model.with_normal_force(float(force))
        for sticking in (False, True):
            linear = linear_modes(pressed, at, sticking=sticking)
            ends.append(linear.frequencies[np.argmax(linear.shapes[list(task.modes)] ** 2, axis=1)])
    low, high = (1 - _WIDER) * np.min(ends, axis=0), (1 + _WIDER) * np.max(ends, axis=0)
    return Question(
        model,
        at,
        np.asarray(task.force_levels, dtype=np.float64),
        np.asarray(task.normal_forces, dtype=np.float64),
        tuple(zip(low.tolist(), high.tolist(), strict=True)),
        fitted,
        None if task.output is None else Dof.parse(task.output),
        tuple(int(mode) for mode in task.modes),
        float(np.mean(PRESSURE)) if task.joint.normal_contact == "unilateral" else None,
    )


def _forecast(
    task: Task,
    beams: Sequence[Candidates],
    normal_forces: Float[np.ndarray, "beam"],
    settings: ForecastSettings,
    progress: Progress,
) -> Forecast:
    """Values by all modes and harmonics, bands by draws of the fundamental: as ``ema.place.forecast`` of one beam."""
    if settings.draws < 10:
        raise InputError("too few draws for a band", where="forecast", got=settings.draws, expected="10 or more")
    nominal = beams_question(task, beams, normal_forces, fitted=settings.method == "measured")
    ((_, whole),) = verify_all([nominal])
    spread_out = np.repeat((shares(nominal) < MAJORITY)[:, None], len(task.force_levels), axis=1)
    middle = np.where(spread_out[:, None], np.nan, whole[:, :2])
    rough = fundamental(nominal)
    harmonics = np.nan_to_num(np.abs(np.log(middle / rough[:, :2])))
    rng = np.random.default_rng(settings.seed)
    spread, opened, taken = [], [], []
    cases = _cases(task, beams, nominal, normal_forces / normal_forces[0], settings.draws, rng)
    for number, (sample, drawn_beams, case) in enumerate(cases):
        values, parts = resonances_of(case, harmonics, rng)
        spread.append(values)
        opened.append(parts)
        taken.append(_inputs(sample, case, drawn_beams))
        advance(progress, "bands of the forecast", number + 1, settings.draws)
    parted = np.mean(opened, axis=0) > 1 - ENOUGH
    middle = np.where((parted & (nominal.pressure is not None))[:, None], np.nan, middle)
    ratios = np.array(spread) / rough[:, :2]
    low, values, high = bands._band(middle, ratios, named=task.joint.form == "given")
    sources, of_sources = budget(taken, ratios, harmonics)
    bare = task.bare.poles[list(task.modes)]
    return Forecast(
        (np.nan, np.nan),
        np.nan,
        "",
        tuple(mode + 1 for mode in task.modes),
        np.abs(bare) / (2 * np.pi),
        -bare.real / np.abs(bare),
        nominal.force_levels,
        nominal.normal_forces,
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
        (
            *bands._about_holes(np.isfinite(low[:, 1]), spread_out, parted, np.isfinite(middle[:, 1])),
            *bands._about_harmonics(harmonics[:, 1]),
        ),
        Provenance(
            steps=("place.forecast_together",),
            options=(("draws", str(settings.draws)), ("seed", str(settings.seed)), ("beams", str(len(beams)))),
        ),
    )


def _cases(
    task: Task,
    beams: Sequence[Candidates],
    nominal: Question,
    proportions: Float[np.ndarray, "beam"],
    draws: int,
    rng: np.random.Generator,
) -> Iterator[tuple[Task, list[Candidates], Question]]:
    """Draws of what is not known: the task, the beams, and the question that is asked of them."""
    limits = tuple((low * (1 - bands._SHIFT), high * (1 + bands._SHIFT)) for low, high in nominal.bands)
    for sample in drawn(task, draws, rng):
        # the material of all beams is one
        first = beams_drawn(beams[0], rng)
        loss = first.catalogue[int(first.beams[0])].loss
        own = [replace(here, catalogue=tuple(replace(beam, loss=loss) for beam in here.catalogue)) for here in beams]
        model = beams_model(sample, own, float(sample.normal_forces[0]) * proportions)
        case = nominal._replace(model=model, normal_forces=sample.normal_forces, bands=limits)
        case = bands._uneven(case, task.joint.scatter, rng)
        if case.pressure is not None:
            case = case._replace(pressure=rng.uniform(*PRESSURE))
        yield sample, own, case


def _inputs(sample: Task, case: Question, beams: Sequence[Candidates]) -> dict[str, Float[np.ndarray, "mode value"]]:
    """What a draw took for the things that are not known, with the shapes under every beam."""
    each = [inputs(sample, case, here) for here in beams]
    return each[0] | {_SHAPE: np.hstack([one[_SHAPE] for one in each])}
