"""The forecast of a beam at a location that is named, under forces that are named, for the structure of a recipe."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ema.data import Finding, Forecast, Geometry, ModalModel
from ema.data.placement import Candidates, FrictionBeam
from ema.errors import InputError
from ema.messages import mark
from ema.place.bands import ForecastSettings, forecast
from ema.place.candidates import ROUNDING, about_keep_out, touch
from ema.place.flags import about_points, flags
from ema.place.predictor import predict
from ema.place.recipe import ForecastTable, PlaceRecipe
from ema.place.targets import refuse_modes_with_a_beam, target_task, under_conditions
from ema.place.task import Task
from ema.progress import Progress, silent
from ema.shapes import Surface

_SAME_FORCE = 1e-9
"""Relative difference up to which a force is the end of a range: that of rounding, as of 0.08 kN and 80 N."""


@dataclass(frozen=True, kw_only=True)
class Location:
    """Where a beam is bolted, and which beam it is.

    Parameters
    ----------
    centre : tuple of (float, float)
        Centre of the beam [m] in the plane of the measured points, as in ``Forecast``.
    angle : float, default 0.0
        Angle of the beam [rad] from the first axis of the plane.
    beam : str, optional
        Name of the beam in the recipe's catalogue; may be left out where there is one beam alone.

    Examples
    --------
    >>> str(Location(centre=(0.45, 0.25), angle=np.pi / 2, beam="steel 60 x 50"))
    'steel 60 x 50 at (0.45, 0.25) m, 90 deg'
    """

    centre: tuple[float, float]
    angle: float = 0.0
    beam: str = ""

    @classmethod
    def of(cls, candidates: Candidates, row: int) -> "Location":
        """Return the location of a candidate.

        Parameters
        ----------
        candidates : Candidates
            Locations of beams.
        row : int
            Row of the candidate.

        Returns
        -------
        Location
            Its centre, angle and beam.

        Examples
        --------
        >>> beam = FrictionBeam(spacing=0.2, width=0.02, height=0.01, name="slim")
        >>> str(Location.of(Candidates([[0.1, 0.3]], [0.0], [0], (beam,)), 0))
        'slim at (0.1, 0.3) m, 0 deg'
        """
        x, y = candidates.centres[row].tolist()
        beam = candidates.catalogue[int(candidates.beams[row])].name
        return cls(centre=(x, y), angle=float(candidates.angles[row]), beam=beam)

    def __str__(self) -> str:
        x, y = self.centre
        return f"{self.beam or 'beam'} at ({x:g}, {y:g}) m, {np.degrees(self.angle):g} deg"


def forecast_at(
    recipe: PlaceRecipe,
    bare: ModalModel,
    geometry: Geometry,
    locations: Sequence[Location],
    *,
    force_levels: Sequence[float] | Float[np.ndarray, "level"] = (),
    normal_forces: Sequence[float] | Float[np.ndarray, "force"] = (),
    progress: Progress = silent,
) -> tuple[Forecast, ...]:
    """Predict frequency and damping with a beam at named locations and forces, with 95 % bands.

    Joint, target modes and all uncertainties are those of the recipe, draws and their seed those of its ``[forecast]``:
    at the location that a placement recommends and under the same forces this is the placement's forecast. Readings of
    tests that have been done (``[[trials.done]]``) are not used.

    Parameters
    ----------
    recipe : PlaceRecipe
        Beams, joint, target modes, areas kept free, and the range of forces.
    bare : ModalModel
        Mass-normalised modes without the beam, at the points of ``geometry``.
    geometry : Geometry
        Points [m] of the structure.
    locations : sequence of Location
        Where beams are bolted, each alone.
    force_levels : sequence of float or array of shape (level,), optional
        F_E [N]; by default those of the recipe's forecast, or of the recipe.
    normal_forces : sequence of float or array of shape (force,), optional
        F_N per joint [N]; likewise.
    progress : Progress, optional
        Called after each draw.

    Returns
    -------
    tuple of Forecast
        One for each location. Findings name forces outside the recipe's, a beam that reaches beyond the measured
        points, and all that is flagged of a location in a ranking.

    Raises
    ------
    InputError
        If there is no such beam, a joint lies beyond the measured points, the beam overlaps an area that is kept free,
        a force is not positive, or the modes were measured with a beam; or as :func:`forecast`.

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
    >>> result, = forecast_at(recipe, *plate(), [Location(centre=(0.2, 0.15))], normal_forces=[80.0])
    >>> result.frequency.shape, [one.code for one in result.findings if one.code == "outside-recipe"]
    ((1, 1, 1), ['outside-recipe'])
    """
    named = named_beams(recipe, bare, geometry, locations, force_levels)
    forces = np.unique(list(normal_forces) or named.table.normal_force)
    under_forces = named.task._replace(force_levels=named.levels, normal_forces=forces)
    flagged = [_flags(under_forces, here) for here in named.beams]
    conditions, common = named.under(forces, forces)
    results = []
    for here, own in zip(named.beams, flagged, strict=True):
        predicted = forecast(conditions, here, 0, named.settings, progress=progress)
        results.append(replace(predicted, findings=(*predicted.findings, *own, *common)))
    return tuple(results)


class NamedBeams(NamedTuple):
    """Beams at named locations on the structure of a recipe, each the one candidate of its own, and F_E [N]."""

    recipe: PlaceRecipe
    task: Task
    beams: tuple[Candidates, ...]
    levels: Float[np.ndarray, "level"]
    table: ForecastTable
    about_structure: tuple[Finding, ...]

    @property
    def settings(self) -> ForecastSettings:
        """Draws, their seed and the method of the recipe's forecast."""
        return ForecastSettings(self.table.draws, self.table.seed, self.table.method)

    def under(
        self, normal_forces: Float[np.ndarray, "force"], every: Float[np.ndarray, "any"]
    ) -> tuple[Task, tuple[Finding, ...]]:
        """The task under F_N [N], and what a reader has to know of the structure, the recipe and ``every`` F_N."""
        conditions, beyond = under_conditions(self.table, self.task, self.levels.tolist(), normal_forces.tolist())
        findings = (
            *about_points(self.task),
            *about_keep_out(self.task.surface, self.recipe.keep_out()),
            *self.recipe.former_names,
            *self.about_structure,
            *beyond,
            *about_forces(self.recipe, self.levels, every),
            *about_readings(self.recipe),
        )
        return conditions, findings


def named_beams(
    recipe: PlaceRecipe,
    bare: ModalModel,
    geometry: Geometry,
    locations: Sequence[Location],
    force_levels: Sequence[float] | Float[np.ndarray, "level"],
) -> NamedBeams:
    """Check what a recipe, the modes without a beam and the named locations say of a forecast.

    Raises
    ------
    InputError : no location; modes with a beam, no such target mode; and what ``located`` refuses.
    """
    where = bare.name or "bare structure"
    refuse_modes_with_a_beam(bare, where)
    task, hung = target_task(recipe, bare, geometry, where)
    table = recipe.forecast or ForecastTable.model_construct(normal_force=list(recipe.normal_force))
    levels = np.unique(list(force_levels) or table.force or recipe.force)
    beams = tuple(located(recipe, task.surface, location) for location in locations)
    if not beams:
        raise InputError("no location for a beam", where=where, expected="one or more locations")
    return NamedBeams(recipe, task, beams, levels, table, hung)


def located(recipe: PlaceRecipe, surface: Surface, location: Location) -> Candidates:
    """The location as the one candidate, checked; beams with as many joints are those that a search compares.

    Raises
    ------
    InputError : no such beam, a joint beyond the measured points, or an area kept free is touched.
    """
    beam = _beam(location, recipe.catalogue())
    catalogue = tuple(one for one in recipe.catalogue() if one.joints == beam.joints)
    centres = np.array([location.centre], dtype=np.float64)
    here = Candidates(centres, np.array([location.angle]), np.array([catalogue.index(beam)]), catalogue)
    name = str(replace(location, beam=beam.name))
    _refuse_joints_beyond(surface, location, here.joints(0), name)
    for number, area in enumerate(recipe.keep_out(), 1):
        if touch(centres, location.angle, (beam.length, beam.width), area)[0]:
            raise InputError(
                "the beam overlaps an area that is kept free",
                where=name,
                got=f"keep_out {number} of the recipe",
                expected="a beam that touches none of them with its whole length and width",
                advice="move or turn the beam, or change keep_out in [search] of the recipe",
            )
    return here


def _beam(location: Location, catalogue: tuple[FrictionBeam, ...]) -> FrictionBeam:
    """The beam that a location names.

    Raises
    ------
    InputError : there is none of this name, or several and none is named.
    """
    named = catalogue if not location.beam else [beam for beam in catalogue if beam.name == location.beam]
    if len(named) == 1:
        return named[0]
    raise InputError(
        "which beam is to be bolted there?" if named else "no such beam",
        where=str(location),
        got=location.beam or None,
        expected="one of " + ", ".join(dict.fromkeys(beam.name for beam in catalogue)),
        advice="give the name of a beam of the recipe, or add yours to its [[beams]]",
    )


def _refuse_joints_beyond(
    surface: Surface, location: Location, joints: Float[np.ndarray, "joint 2"], name: str
) -> None:
    """Refuse a location of which a joint, or the centre, lies beyond the measured points.

    Raises
    ------
    InputError : it does.
    """
    low, high = surface.extent.T

    def beyond(points: np.ndarray) -> float:
        return float(np.maximum(low - points, points - high).max())

    if not (np.all(np.isfinite(joints)) and beyond(joints) <= ROUNDING):
        off = not beyond(np.array(location.centre)) <= ROUNDING
        raise InputError(
            "the location is off the measured structure" if off else "the beam sticks out with its joints",
            where=name,
            got=f"a joint {beyond(joints):.3g} m beyond the measured points",
            expected=f"joints from ({low[0]:.3g}, {low[1]:.3g}) to ({high[0]:.3g}, {high[1]:.3g}) m",
            advice="move or turn the beam, or measure points under it",
        )


def _flags(task: Task, here: Candidates) -> tuple[Finding, ...]:
    """What a ranking would flag of the location, under every normal force."""
    name = str(Location.of(here, 0))
    prediction = predict(task, here)
    findings: dict[tuple[str, str, str], Finding] = {}
    for column, force in enumerate(prediction.normal_forces):
        for one in flags(task, prediction, 0, column):
            where = name if one.code == "beam-sticks-out" else f"{name}, F_N {force:g} N"
            findings.setdefault((one.code, where, one.message), replace(one, where=where))
    return tuple(findings.values())


def about_forces(
    recipe: PlaceRecipe, levels: Float[np.ndarray, "level"], forces: Float[np.ndarray, "force"]
) -> tuple[Finding, ...]:
    """How far forces lie outside those that the recipe states for its ranges and for its forecast."""
    table = recipe.forecast
    excitation = [*recipe.force, *((table.force if table else None) or ())]
    normal = [*recipe.normal_force, *(table.normal_force if table else ())]
    findings = []
    for name, asked, stated in (("F_E", levels, excitation), ("F_N", forces, normal)):
        low, high, least, most = min(stated), max(stated), float(asked.min()), float(asked.max())
        for side, value, factor in ((mark("above"), most, most / high), (mark("below"), least, low / least)):
            if factor <= 1 + _SAME_FORCE:
                continue
            findings.append(
                Finding.of(
                    "warning",
                    "outside-recipe",
                    "forecast",
                    "{name} of {value} N lies {side} the range of the recipe, {low} to {high} N, by a factor of "
                    "{factor}.",
                    factor,
                    1.0,
                    advice="Check that mu, k_T, k_N and their uncertainties hold there, then widen the recipe's range.",
                    name=name,
                    value=f"{value:g}",
                    side=side,
                    low=f"{low:g}",
                    high=f"{high:g}",
                    factor=f"{factor:.3g}",
                )
            )
    return tuple(findings)


def about_readings(recipe: PlaceRecipe) -> tuple[Finding, ...]:
    """Whether the recipe has readings that the forecast of its own location is moved to."""
    count = len(recipe.trials.done) if recipe.trials is not None else 0
    if not count:
        return ()
    return (
        Finding.of(
            "warning",
            "readings-not-used",
            "trials.done",
            "{count} tests that have been done are not used in the forecast of a named location.",
            float(count),
            advice="`ema place` moves the forecast of its own location to what they read.",
            count=count,
        ),
    )
