"""What a placement recipe may say: a TOML file, every key checked before anything is computed."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from acquisition import law_of
from acquisition.model_file import LawTable
from acquisition.quantities import (
    Coordinate,
    Density,
    Force,
    Forces,
    Frequency,
    HalfHeight,
    Length,
    Mass,
    Modulus,
    Place,
    Ratio,
    Seconds,
    Stiffness,
    Tolerance,
)
from ema.data.placement import BoltedJoint, FrictionBeam
from ema.place.objective import Objective
from ema.tables import FileKind, Table

if TYPE_CHECKING:
    from ema.place.trials import Costs

Near = Annotated[
    list[Frequency], BeforeValidator(lambda value: value if isinstance(value, list) else [value]), Field(min_length=1)
]
NAN = BeforeValidator(lambda given: None if isinstance(given, float) and given != given else given)
"""The nan of TOML where nothing was read."""
Corner = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
"""A point in the plane of the surface."""


ROBUST_TOGETHER = (
    "robust = true is for a single beam: every set of beams would be computed for all draws; leave it out, and read "
    "the bands of the forecast"
)
"""Why several beams are not chosen by the lower end of an interval: it would take hundreds of times as long."""


class ObjectiveTable(Table):
    """``[objective]``: what makes a place good (``ema.place.Objective``)."""

    aim: Literal["damping", "least damping", "geometric mean", "peak reduction", "chatter"] = "damping"
    over_levels: Literal["least", "mean"] = "least"
    mode_weights: list[Annotated[float, Field(ge=0)]] | None = None
    robust: bool = False


class BeamTable(Table):
    """``[[beams]]``: one beam of the catalogue."""

    name: str = ""
    spacing: Length
    width: Length
    height: Length
    overhang: HalfHeight = 0.0
    joints: int = Field(default=2, ge=2)
    youngs_modulus: Modulus = 210e9
    density: Density = 7850.0
    rotary: bool = False
    shear: bool = False
    loss: Ratio = 0.0
    loss_std: Ratio = 0.0


class PlacedJointTable(Table):
    """``[joint]``: one joint, its friction law in ``[joint.law]``, and how well it is known.

    Uncertainties are standard ones, relative, but ``height_std`` (a length) and ``exponent_std`` (that of the exponent
    of k_T). ``form = "open"``: of the law only mu and k_T are known. ``normal_contact = "unilateral"``: it can part.
    """

    law: LawTable
    surface_height: HalfHeight
    normal_stiffness: Stiffness
    normal_exponent: float = Field(default=0.0, ge=0)
    tangential_loss: Ratio = 0.0
    normal_loss: Ratio = 0.0
    friction_std: Ratio = 0.0
    stiffness_std: Ratio = 0.0
    scatter: Ratio = 0.0
    contact_length: HalfHeight = 0.0
    normal_std: Ratio = 0.0
    length_std: Ratio = 0.0
    force_std: Ratio = 0.0
    height_std: HalfHeight = 0.0
    exponent_std: float = Field(default=0.0, ge=0)
    form: Literal["given", "open"] = "given"
    normal_contact: Literal["linear", "unilateral"] = "linear"


class SearchTable(Table):
    """``[search]``: grid of the candidates, areas kept free (corners in the plane of the surface), effort.

    With several ``beams`` those that act together are chosen too (``ema.place.search_together``), of ``most_mass`` in
    all.
    """

    step: Length = 0.05
    angles: list[float] = Field(default=[0.0, 90.0], min_length=1)
    margin: HalfHeight = 0.0
    keep_out: list[Annotated[list[Corner], Field(min_length=3)]] = Field(default=[])
    shortlist: int = Field(default=20, ge=1)
    keep: int = Field(default=10, ge=1)
    draws: int = Field(default=200, ge=0)
    seed: int = 0
    beams: int = Field(default=1, ge=1)
    most_mass: Mass | None = None


class ControlTable(Table):
    """``[control]``: ring-downs under constant and controlled normal force at the best place."""

    load: Annotated[Force, Field(gt=0)]
    lag: Seconds | None = None


class ForecastTable(Table):
    """``[forecast]``: frequency and damping at the best place with 95 % bands, at chosen conditions.

    ``force`` is that of the recipe by default; ``normal_force`` per joint. ``maps`` names maps of the study that were
    measured with the beam at its place. ``above = "plate"`` continues the measured modes by those of the plate they
    imply: the structure yields around the bolts. ``calibration_std`` is that of acceleration over force in the test.
    """

    normal_force: Forces
    force: Forces | None = None
    draws: int = Field(default=400, ge=10)
    seed: int = 0
    method: Literal["measured", "frozen"] = "measured"
    above: Literal["nothing", "plate"] = "nothing"
    calibration_std: Ratio = 0.0
    maps: list[str] = Field(default=[])


class DoneTable(Table):
    """``[[trials.done]]``: what a test with the beam read of the target modes, in their order; nan where nothing.

    Without ``centre`` (m, in the plane of the surface) and ``angle`` (deg) the beam was at its recommended place.
    """

    force: Annotated[Force, Field(gt=0)]
    normal_force: Annotated[Force, Field(gt=0)]
    frequency: list[Annotated[Frequency | None, NAN]] = Field(default=[])
    damping: list[Annotated[Tolerance | None, NAN]] = Field(default=[])
    centre: Corner | None = None
    angle: float = 0.0


class TrialsTable(Table):
    """``[trials]``: which test would narrow the bands of the forecast most per hour, and tests that have been done.

    ``places`` of the ranking, besides the best one, can be tried. Costs are times (``ema.place.Costs``).
    """

    places: int = Field(default=2, ge=0)
    mounting: Seconds = 3600.0
    condition: Seconds = 900.0
    loop: Seconds = 14400.0
    frequency_std: Tolerance = 5e-4
    damping_std: Tolerance = 0.03
    loop_std: Tolerance = 0.05
    done: list[DoneTable] = Field(default=[])

    def costs(self) -> "Costs":
        """As a container."""
        from ema.place.trials import Costs

        hours = (self.mounting / 3600, self.condition / 3600, self.loop / 3600)
        return Costs(*hours, self.frequency_std, self.damping_std, self.loop_std)


class PlaceExpectTable(Table):
    """``[expect]`` of a placement within a study: the best place, and how many measured values lie in their bands."""

    centre: Corner | None = None
    within: Length = 0.03
    normal_force: Annotated[Force, Field(gt=0)] | None = None
    inside: int | None = Field(default=None, ge=0)


class PlaceRecipe(Table):
    """The whole recipe. ``campaign`` (with ``run``) or ``modes`` (a file) gives the structure without the beam.

    ``mass`` of a freely hung structure gives its rigid-body modes; without it they come from the test's mass lines.
    With ``in_plane = "free"`` it also moves in its own plane against the beam, with all its mass.
    ``near`` Hz picks the target modes; ``at`` is the excited DOF, ``output`` the one whose response counts;
    ``force`` and ``normal_force`` (per joint) span the range of use. ``agreement`` is a store file whose verdict tells
    whether the joint model agrees with a measurement.
    """

    title: str = ""
    campaign: str = ""
    run: str = ""
    modes: str = ""
    mass: Mass | None = None
    in_plane: Literal["free", "held"] = "free"
    near: Near
    at: Place
    output: Place | None = None
    force: Forces
    normal_force: Forces
    agreement: str = ""
    band: Annotated[list[Frequency], Field(min_length=2, max_length=2)] | None = None
    objective: ObjectiveTable = ObjectiveTable()
    beams: Annotated[list[BeamTable], Field(min_length=1)]
    joint: PlacedJointTable
    search: SearchTable = SearchTable()
    control: ControlTable | None = None
    forecast: ForecastTable | None = None
    trials: TrialsTable | None = None
    expect: PlaceExpectTable | None = None

    @model_validator(mode="after")
    def _sound(self) -> "PlaceRecipe":
        if self.campaign and self.modes:
            raise ValueError("the bare structure comes from a campaign or from a file with modes, not both")
        if self.joint.law.name not in LAWS:
            raise ValueError(f"no placement with the law {self.joint.law.name!r}; use one of " + ", ".join(LAWS))
        if self.trials is not None and self.forecast is None:
            raise ValueError("[trials] narrow a forecast; add [forecast] with the conditions that matter")
        for number, done in enumerate([] if self.trials is None else self.trials.done, 1):
            if not any(one is not None for one in [*done.frequency, *done.damping]):
                raise ValueError(f"trials.done {number}: says neither a frequency nor a damping ratio that was read")
            for name in ("frequency", "damping"):
                given = getattr(done, name)
                if len(given) not in (0, len(self.near)):
                    raise ValueError(f"trials.done {number}: {len(given)} values of {name} for {len(self.near)} modes")
        if self.search.beams > 1 and self.objective.robust:
            raise ValueError(ROBUST_TOGETHER)
        if self.search.beams == 1 and self.search.most_mass is not None:
            raise ValueError(
                "most_mass limits several beams together; add beams = 2 or more to [search], or leave it out"
            )
        weights = self.objective.mode_weights
        if weights is not None and len(weights) != len(self.near):
            raise ValueError(f"{len(weights)} mode_weights for {len(self.near)} modes")
        return self

    def bolted_joint(self) -> BoltedJoint:
        """The joint as a container."""
        table = self.joint
        return BoltedJoint(
            law_of(table.law),
            table.normal_stiffness,
            table.surface_height,
            table.normal_exponent,
            table.tangential_loss,
            table.normal_loss,
            table.friction_std,
            table.stiffness_std,
            table.scatter,
            table.contact_length,
            table.normal_std,
            table.length_std,
            table.force_std,
            table.height_std,
            table.exponent_std,
            table.form,
            table.normal_contact,
        )

    def catalogue(self) -> tuple[FrictionBeam, ...]:
        """The beams as containers."""
        return tuple(
            FrictionBeam(
                one.spacing,
                one.width,
                one.height,
                one.youngs_modulus,
                one.density,
                one.overhang,
                one.joints,
                one.name or f"beam {number}",
                one.rotary,
                one.loss,
                one.loss_std,
                one.shear,
            )
            for number, one in enumerate(self.beams, 1)
        )

    def keep_out(self) -> tuple[np.ndarray, ...]:
        """Corners of the areas kept free."""
        return tuple(np.array(area, dtype=np.float64) for area in self.search.keep_out)

    def wanted(self) -> Objective:
        """The objective as a container."""
        table = self.objective
        weights = None if table.mode_weights is None else tuple(table.mode_weights)
        return Objective(table.aim, table.over_levels, weights, table.robust)


LAWS = (
    "masing",
    "iwan",
    "modified iwan",
    "rough contact",
    "gaussian rough contact",
    "regularised masing",
    "dahl",
    "valanis",
    "bouc wen",
)
"""Laws with a describing function whose parameters are plain numbers."""
KIND = FileKind(
    table=PlaceRecipe,
    tables={
        "": PlaceRecipe,
        "objective": ObjectiveTable,
        "beams": BeamTable,
        "joint": PlacedJointTable,
        "joint.law": LawTable,
        "search": SearchTable,
        "control": ControlTable,
        "forecast": ForecastTable,
        "trials": TrialsTable,
        "trials.done": DoneTable,
        "expect": PlaceExpectTable,
    },
    name="place.toml",
    absent="there is no such recipe",
    guide="docs/placement.md",
)


def load(path: Path) -> PlaceRecipe:
    """Read a placement recipe.

    Parameters
    ----------
    path : Path
        The TOML file; paths in it are relative to its folder.

    Returns
    -------
    PlaceRecipe
        Content of the file, checked.

    Raises
    ------
    InputError
        There is no such file, it is no TOML, or a key is unknown, missing or wrong; the message names its line.
    """
    return KIND.load(path)
