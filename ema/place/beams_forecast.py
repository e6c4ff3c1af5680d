"""The forecast of several beams that act at the same time, each with its own location and normal force."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from ema.data import BeamModel, Finding, Forecast, Geometry, ModalModel
from ema.data.placement import Candidates
from ema.dof import Dof
from ema.errors import InputError
from ema.place.bands import Asked, Method, forecast_and_draws
from ema.place.beams_model import beams_model
from ema.place.candidates import touch
from ema.place.flags import about_overhang
from ema.place.fundamental import linear_modes
from ema.place.location import Location, named_beams
from ema.place.recipe import ForecastTable, PlaceRecipe
from ema.place.shortlist import WIDER, Question, of_model
from ema.place.task import Task
from ema.progress import Progress, silent


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
    named = named_beams(recipe, bare, geometry, locations, force_levels)
    names = tuple(Location.of(here, 0) for here in named.beams)
    refuse_overlap(named.beams, names)
    pressed = _pressed(normal_forces, named.table, len(names))
    order = _order(names, pressed)
    conditions, common = named.under(pressed[:, order[0]], np.unique(pressed))
    asked = beams_asked(conditions, [named.beams[row] for row in order], pressed[0, order], named.settings.method)
    predicted, *_ = forecast_and_draws(asked, named.settings, progress=progress)
    own = [
        replace(one, where=str(name))
        for here, name in zip(named.beams, names, strict=True)
        for one in about_overhang(named.task, here, 0)
    ]
    findings = (*predicted.findings, *own, *common)
    return BeamsForecast(
        locations=names,
        normal_forces=pressed,
        forecast=replace(predicted, beam=_listed(names, pressed), findings=findings),
    )


def about_forecast(result: BeamsForecast) -> tuple[Finding, ...]:
    """What the beams do together as findings of a placement, one for each target mode and F_E under each set of F_N."""
    forecast, count = result.forecast, len(result.locations)
    findings = []
    for row, level, column in np.ndindex(forecast.damping.shape):
        f, z = (
            [float(getattr(forecast, what + end)[row, level, column]) for end in ("", "_low", "_high")]
            for what in ("frequency", "damping")
        )
        if not np.isfinite([*f, *z]).all():
            continue
        findings.append(
            Finding.of(
                "info",
                "beams-forecast",
                f"{count} beams",
                "together, under F_N {forces} N and F_E {level} N, mode {mode} has {f} Hz [{f_low}, {f_high}] and a "
                "damping ratio of {z} % [{z_low}, {z_high}], with 95 % bands from {draws} draws.",
                z[0],
                forces=", ".join(f"{force:.4g}" for force in result.normal_forces[column]),
                level=f"{forecast.force_levels[level]:.4g}",
                mode=forecast.modes[row],
                f=f"{f[0]:.3f}",
                f_low=f"{f[1]:.3f}",
                f_high=f"{f[2]:.3f}",
                z=f"{100 * z[0]:.3f}",
                z_low=f"{100 * z[1]:.3f}",
                z_high=f"{100 * z[2]:.3f}",
                draws=forecast.draws,
            )
        )
    return tuple(findings)


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
    low, high = (1 - WIDER) * np.min(ends, axis=0), (1 + WIDER) * np.max(ends, axis=0)
    return of_model(task, model, list(zip(low.tolist(), high.tolist(), strict=True)), fitted=fitted)


def beams_asked(
    task: Task, beams: Sequence[Candidates], normal_forces: Float[np.ndarray, "beam"], method: Method
) -> Asked:
    """Several beams; under the forces of the task the first one is pressed, and the others in proportion."""
    proportions = normal_forces / normal_forces[0]

    def model_of(sample: Task, drawn: Sequence[Candidates]) -> BeamModel:
        return beams_model(sample, drawn, float(sample.normal_forces[0]) * proportions)

    nominal = beams_question(task, beams, normal_forces, fitted=method == "measured")
    return Asked(task, tuple(beams), nominal, model_of)
