"""Where a friction beam may go: the beam, its joints, the places, and what is predicted there."""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float, Int

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.beam import FrictionLaw
from ema.data.findings import Finding
from ema.data.forecast import Forecast
from ema.data.geometry import Geometry
from ema.data.provenance import Provenance
from ema.data.trials import Trials

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class FrictionBeam(Container):
    """A straight friction beam of rectangular section, pressed on a surface at joints spread evenly along it.

    Parameters
    ----------
    spacing : float
        Distance [m] between the first and the last joint.
    width, height : float
        Section [m].
    young_modulus : float, default 210000000000.0
        Young's modulus [Pa].
    density : float, default 7850.0
        Density [kg/m^3].
    overhang : float, default 0.0
        Length [m] beyond the first and the last joint.
    joints : int, default 2
        Number of joints, two or more.
    name : str, optional
        What the beam is called.
    rotary : bool, default False
        Whether its sections have rotary inertia (Rayleigh), as short thick beams do; the beams of the simulator have
        none.
    loss : float, default 0.0
        Loss factor of its material.
    loss_std : float, default 0.0
        Relative standard uncertainty of the loss factor.
    shear : bool, default False
        Whether its sections shear (Timoshenko), which a beam four times as long as high feels by a tenth.

    Examples
    --------
    >>> beam = FrictionBeam(spacing=0.2, width=0.02, height=0.01, overhang=0.02, joints=3)
    >>> round(beam.length, 3), round(beam.mass, 4), beam.places
    (0.24, 0.3768, array([-0.1,  0. ,  0.1]))
    """

    spacing: float
    width: float
    height: float
    young_modulus: float = 210e9
    density: float = 7850.0
    overhang: float = 0.0
    joints: int = 2
    name: str = ""
    rotary: bool = False
    loss: float = 0.0
    loss_std: float = 0.0
    shear: bool = False

    @property
    def length(self) -> float:
        """Whole length in m."""
        return self.spacing + 2 * self.overhang

    @property
    def mass(self) -> float:
        """Mass in kg."""
        return self.length * self.width * self.height * self.density

    @property
    def places(self) -> Float[np.ndarray, "joint"]:
        """Positions of the joints along the beam from its middle, in m."""
        return np.linspace(-0.5, 0.5, self.joints) * self.spacing


@dataclass(frozen=True, repr=False)
class BoltedJoint(Container):
    """One joint of a friction beam: the law of its contact, its normal stiffness, and how well both are known.

    Parameters
    ----------
    law : FrictionLaw
        Friction law with mu and k_T(F_N) of one joint.
    normal_stiffness : float
        k_N [N/m] at ``law.reference_force``.
    surface_height : float
        Distance [m] from the neutral plane of the structure to the interface.
    normal_exponent : float, default 0.0
        Exponent of k_N(F_N).
    tangential_loss, normal_loss : float, default 0.0
        Loss factors of the sticking contact.
    friction_std : float, default 0.0
        Relative standard uncertainty of mu, alike in all joints.
    stiffness_std : float, default 0.0
        Relative standard uncertainty of k_T, alike in all joints.
    scatter : float, default 0.0
        Relative standard deviation of mu and of k_T from joint to joint.
    contact_length : float, default 0.0
        Length [m] of contact along the beam over which k_N is spread: it resists rocking with k_N l^2 / 12.
    normal_std : float, default 0.0
        Relative standard uncertainty of k_N, alike in all joints.
    length_std : float, default 0.0
        Relative standard uncertainty of the contact length, alike in all joints.
    force_std : float, default 0.0
        Relative standard uncertainty of F_N, alike in all joints.
    height_std : float, default 0.0
        Standard uncertainty of the height of the surface [m].
    exponent_std : float, default 0.0
        Standard uncertainty of the exponent of k_T(F_N).
    form : {"given", "open"}, default "given"
        ``given`` where the law is known to be that of ``law``; ``open`` where only mu and k_T are known: bands then
        hold Iwan laws of every share of microslip, the sharp corner of one Masing spring among them.
    normal_contact : {"linear", "unilateral"}, default "linear"
        ``linear`` where the joint also pulls, ``unilateral`` where it can part: the edges of its contact length lift
        off, and no bands are given for conditions in which all of it does.

    Examples
    --------
    >>> law = FrictionLaw("masing", friction_coefficient=0.4, contact_stiffness=2e7)
    >>> BoltedJoint(law, normal_stiffness=1e8, surface_height=0.005, friction_std=0.1).form
    'given'
    """

    law: FrictionLaw
    normal_stiffness: float
    surface_height: float
    normal_exponent: float = 0.0
    tangential_loss: float = 0.0
    normal_loss: float = 0.0
    friction_std: float = 0.0
    stiffness_std: float = 0.0
    scatter: float = 0.0
    contact_length: float = 0.0
    normal_std: float = 0.0
    length_std: float = 0.0
    force_std: float = 0.0
    height_std: float = 0.0
    exponent_std: float = 0.0
    form: Literal["given", "open"] = "given"
    normal_contact: Literal["linear", "unilateral"] = "linear"


@dataclass(frozen=True, repr=False)
class Candidates(Container):
    """Locations for a beam on a plane surface.

    Parameters
    ----------
    centres : array of shape (candidate, 2)
        Centres of the beams [m] in the coordinates of the surface.
    angles : array of shape (candidate,)
        Angles [rad] from the first axis of the surface.
    beams : integer array of shape (candidate,)
        Row of each beam in ``catalogue``.
    catalogue : tuple of FrictionBeam
        Beams to choose from.

    Examples
    --------
    >>> beam = FrictionBeam(spacing=0.2, width=0.02, height=0.01)
    >>> len(Candidates(np.zeros((3, 2)), np.zeros(3), np.zeros(3), (beam,)))
    3
    """

    centres: Float[np.ndarray, "candidate 2"]
    angles: Float[np.ndarray, "candidate"]
    beams: Int[np.ndarray, "candidate"]
    catalogue: tuple[FrictionBeam, ...]

    def __post_init__(self) -> None:
        freeze(self, centres=np.float64, angles=np.float64, beams=np.int64)
        check_axes(self)

    def __len__(self) -> int:
        return len(self.angles)

    def joints(self, candidate: int) -> Float[np.ndarray, "joint 2"]:
        """Return the locations of the joints of one candidate.

        Parameters
        ----------
        candidate : int
            Row of the candidate.

        Returns
        -------
        array of shape (joint, 2)
            Coordinates [m] in the surface.

        Examples
        --------
        >>> beam = FrictionBeam(spacing=0.2, width=0.02, height=0.01)
        >>> Candidates([[0.1, 0.3]], [0.0], [0], (beam,)).joints(0)
        array([[0. , 0.3],
               [0.2, 0.3]])
        """
        along = self.catalogue[int(self.beams[candidate])].places
        angle = self.angles[candidate]
        return np.asarray(self.centres[candidate] + along[:, None] * np.array([np.cos(angle), np.sin(angle)]))


@dataclass(frozen=True, repr=False)
class Prediction(Container):
    """Modes with a friction beam at every candidate location, over excitation and normal force; holes are NaN.

    Parameters
    ----------
    candidates : Candidates
        Locations of the beam.
    modes : tuple of int
        Target modes, rows of the modal model from 0.
    bare_frequencies : array of shape (mode,)
        Natural frequencies [Hz] without the beam.
    bare_damping : array of shape (mode,)
        Damping ratios [-] without the beam.
    force_levels : array of shape (level,)
        F_E [N].
    normal_forces : array of shape (force,)
        F_N per joint [N].
    frequency : array of shape (candidate, mode, level, force)
        Natural frequencies with the beam [Hz].
    damping : array of shape (candidate, mode, level, force)
        Damping ratios with the beam [-].
    stiffness : array of shape (candidate, mode, level, force)
        Modal force over modal amplitude at the resonance [1/s^2] for unit modal mass.
    slip : array of shape (candidate, mode, level, force)
        Largest relative displacement over that at which sliding begins, above 1 where a joint slides; NaN where it was
        not requested.
    driver : array of shape (mode,)
        Mass-normalised shapes at the excited DOF [1/sqrt(kg)].
    output : array of shape (mode,)
        Mass-normalised shapes at the DOF whose response counts [1/sqrt(kg)].
    method : str, default "one mode"
        ``one mode`` at a time, or ``all modes`` together.
    findings : tuple of Finding, optional
        What a reader of the prediction has to know.
    provenance : Provenance, optional
        Inputs, versions and options behind the prediction.

    Examples
    --------
    >>> from ema.examples import ranking
    >>> ranking().prediction.damping.shape
    (2, 1, 2, 3)
    """

    candidates: Candidates
    modes: tuple[int, ...]
    bare_frequencies: Float[np.ndarray, "mode"]
    bare_damping: Float[np.ndarray, "mode"]
    force_levels: Float[np.ndarray, "level"]
    normal_forces: Float[np.ndarray, "force"]
    frequency: Float[np.ndarray, "candidate mode level force"]
    damping: Float[np.ndarray, "candidate mode level force"]
    stiffness: Float[np.ndarray, "candidate mode level force"]
    slip: Float[np.ndarray, "candidate mode level force"]
    driver: Float[np.ndarray, "mode"]
    output: Float[np.ndarray, "mode"]
    method: str = "one mode"
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    provenance: Provenance = field(default=Provenance(), compare=False)

    def __post_init__(self) -> None:
        names = (
            "bare_frequencies",
            "bare_damping",
            "force_levels",
            "normal_forces",
            "frequency",
            "damping",
            "stiffness",
            "slip",
            "driver",
            "output",
        )
        freeze(self, **dict.fromkeys(names, np.float64))
        check_axes(self)


@dataclass(frozen=True, repr=False)
class Place(Container):
    """One location of the ranking.

    Parameters
    ----------
    candidate : int
        Row in the candidates.
    centre : tuple of (float, float)
        Centre of the beam [m] in the surface.
    angle : float
        Angle of the beam [rad] in the surface.
    beam : str
        Name or number of the beam.
    score : float
        Value of the objective.
    score_low, score_high : float
        95 % interval of the score; NaN where none was requested.
    normal_force : float
        F_N per joint [N] that serves all force levels best.
    normal_forces : array of shape (level,)
        F_N per joint [N] that is best at each level.
    frequency : array of shape (mode, level)
        Natural frequencies at ``normal_force`` [Hz].
    damping : array of shape (mode, level)
        Damping ratios at ``normal_force`` [-].
    damping_low, damping_high : array of shape (mode, level)
        95 % interval of the damping.
    mass_shift, stiffness_shift : array of shape (mode,)
        Parts of the frequency shift of each mode with all joints stuck at ``normal_force`` [Hz].
    findings : tuple of Finding, optional
        What speaks against the location.
    method : str, default "one mode"
        ``one mode`` at a time, or ``all modes`` together.
    one_mode_damping : array of shape (mode, level), optional
        Damping ratios at ``normal_force`` by one mode at a time, kept beside those of all modes.

    Examples
    --------
    >>> from ema.examples import ranking
    >>> ranking().best.normal_force
    500.0
    """

    candidate: int
    centre: tuple[float, float]
    angle: float
    beam: str
    score: float
    score_low: float
    score_high: float
    normal_force: float
    normal_forces: Float[np.ndarray, "level"]
    frequency: Float[np.ndarray, "mode level"]
    damping: Float[np.ndarray, "mode level"]
    damping_low: Float[np.ndarray, "mode level"]
    damping_high: Float[np.ndarray, "mode level"]
    mass_shift: Float[np.ndarray, "mode"]
    stiffness_shift: Float[np.ndarray, "mode"]
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    method: str = "one mode"
    one_mode_damping: Float[np.ndarray, "mode level"] | None = None

    def __post_init__(self) -> None:
        names = (
            "normal_forces",
            "frequency",
            "damping",
            "damping_low",
            "damping_high",
            "mass_shift",
            "stiffness_shift",
            "one_mode_damping",
        )
        freeze(self, **dict.fromkeys(names, np.float64))
        check_axes(self)


@dataclass(frozen=True, repr=False)
class Ranking(Container):
    """Locations in the order of an objective.

    Parameters
    ----------
    objective : str
        The objective in words.
    prediction : Prediction
        Modes at every candidate, by the one-mode predictor.
    scores : array of shape (candidate,)
        Scores of all candidates by the one-mode predictor.
    places : tuple of Place
        The best locations, best first.
    findings : tuple of Finding, optional
        What a reader of the ranking has to know.
    shortlist : tuple of int, optional
        Rows of the candidates that were computed again with all modes together.
    checked : Prediction, optional
        Prediction for the shortlist with all modes together, in its order.

    Examples
    --------
    >>> from ema.examples import ranking
    >>> [place.centre for place in ranking().places]
    [(0.15, 0.0), (0.1, 0.0)]
    """

    objective: str
    prediction: Prediction
    scores: Float[np.ndarray, "candidate"]
    places: tuple[Place, ...]
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    shortlist: tuple[int, ...] = ()
    checked: Prediction | None = None

    def __post_init__(self) -> None:
        freeze(self, scores=np.float64)
        check_axes(self)

    @property
    def best(self) -> Place:
        """The first place."""
        return self.places[0]

    def table(self) -> "pd.DataFrame":
        """Return the ranking as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per location, from 1: coordinates, F_N, and for each mode frequency, damping ratio and its bounds at
            the level at which its damping is least.

        Examples
        --------
        >>> from ema.examples import ranking
        >>> ranking().table()["mode 1 zeta [%]"].tolist()
        [1.6, 0.8]
        """
        import pandas as pd

        rows = []
        for number, place in enumerate(self.places, start=1):
            row: dict[str, object] = {
                "rank": number,
                "x [m]": place.centre[0],
                "y [m]": place.centre[1],
                "angle [deg]": np.degrees(place.angle),
                "beam": place.beam,
                "score": place.score,
                "F_N [N]": place.normal_force,
            }
            for m, mode in enumerate(self.prediction.modes):
                least = int(np.nanargmin(place.damping[m]))
                row[f"mode {mode + 1} f [Hz]"] = place.frequency[m, least]
                row[f"mode {mode + 1} zeta [%]"] = 100 * place.damping[m, least]
                row[f"mode {mode + 1} zeta low [%]"] = 100 * place.damping_low[m, least]
                row[f"mode {mode + 1} zeta high [%]"] = 100 * place.damping_high[m, least]
            rows.append(row | {"flags": ", ".join(sorted({finding.code for finding in place.findings}))})
        return pd.DataFrame(rows).set_index("rank")


@dataclass(frozen=True, repr=False)
class ControlLine(Container):
    """The ring-down after a release under one law of the normal force.

    Parameters
    ----------
    law : str
        Name of the law.
    force : float
        Normal force of the law [N].
    energy : float
        Integral of E/E0 over time [s].
    to_five, to_two : float
        Time [s] until the amplitude stays below 5 % and 2 % of that at the start; NaN where it does not within the run.
    times : array of shape (sample,)
        Times [s].
    energies : array of shape (sample,)
        E/E0.

    Examples
    --------
    >>> ControlLine("constant", 500.0, 0.08, 0.3, 0.4, times=[0.0, 0.1], energies=[1.0, 0.3]).to_five
    0.3
    """

    law: str
    force: float
    energy: float
    to_five: float
    to_two: float
    times: Float[np.ndarray, "sample"]
    energies: Float[np.ndarray, "sample"]

    def __post_init__(self) -> None:
        freeze(self, times=np.float64, energies=np.float64)
        check_axes(self)


@dataclass(frozen=True, repr=False)
class ControlStudy(Container):
    """What a controlled normal force adds to the best constant one, for one location.

    Parameters
    ----------
    place : int
        Row of the location in the candidates.
    mode : int
        Row of the modes without the beam that sets the time scale.
    load : float
        Static load [N] that is released.
    lines : tuple of ControlLine
        Ring-downs: the best constant force first, then the best of every law.
    force_levels : array of shape (level,)
        F_E [N].
    constant_damping : array of shape (level,)
        Steady damping ratio under one normal force for all levels.
    scheduled_damping : array of shape (level,)
        Steady damping ratio under the normal force recommended for each level.
    verdict : str
        What the control adds, in sentences.

    Examples
    --------
    >>> line = ControlLine("constant", 500.0, 0.08, 0.3, 0.4, times=[0.0, 0.1], energies=[1.0, 0.3])
    >>> study = ControlStudy(0, 0, 100.0, (line,), [5.0], [0.02], [0.02], verdict="Control adds nothing.")
    >>> study.verdict
    'Control adds nothing.'
    """

    place: int
    mode: int
    load: float
    lines: tuple[ControlLine, ...]
    force_levels: Float[np.ndarray, "level"]
    constant_damping: Float[np.ndarray, "level"]
    scheduled_damping: Float[np.ndarray, "level"]
    verdict: str

    def __post_init__(self) -> None:
        freeze(self, force_levels=np.float64, constant_damping=np.float64, scheduled_damping=np.float64)
        check_axes(self)

    def table(self) -> "pd.DataFrame":
        """Return the ring-downs as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per law: force [N], energy integral [ms], times to 5 % and 2 % of the amplitude [ms].

        Examples
        --------
        >>> line = ControlLine("constant", 500.0, 0.08, 0.3, 0.4, times=[0.0, 0.1], energies=[1.0, 0.3])
        >>> ControlStudy(0, 0, 100.0, (line,), [5.0], [0.02], [0.02], verdict="").table()["J [ms]"].tolist()
        [80.0]
        """
        import pandas as pd

        return pd.DataFrame(
            {
                "law": [line.law for line in self.lines],
                "F_N [N]": [line.force for line in self.lines],
                "J [ms]": [1e3 * line.energy for line in self.lines],
                "t 5 % [ms]": [1e3 * line.to_five for line in self.lines],
                "t 2 % [ms]": [1e3 * line.to_two for line in self.lines],
            }
        ).set_index("law")


@dataclass(frozen=True, repr=False)
class Placement(Container):
    """The answer to a placement task: the ranking, where the plane of its coordinates lies, and how far to trust it.

    Parameters
    ----------
    title : str
        What the placement is called.
    ranking : Ranking
        Locations, best first.
    origin : array of shape (3,)
        Origin of the plane [m].
    axes : array of shape (3, 3)
        Axes of the plane, one per row.
    extent : array of shape (2, 2)
        Measured rectangle in the plane [m]: (low, high) of the first and of the second coordinate.
    points : array of shape (point, 2)
        Measured points [m] in the plane.
    keep_out : tuple of array, optional
        Polygons (corner, 2) [m] in which no beam may lie.
    warning : str, optional
        First line of every report; empty where the model agrees with the measurement.
    control : ControlStudy, optional
        What a controlled normal force adds, where requested.
    findings : tuple of Finding, optional
        What a reader of the placement has to know.
    provenance : Provenance, optional
        Inputs, versions and options behind the placement.
    geometry : Geometry, optional
        Geometry of the structure.
    forecast : Forecast, optional
        Frequency and damping predicted at the best location.
    trials : Trials, optional
        Tests that would narrow the forecast.

    Examples
    --------
    >>> from ema.examples import placement
    >>> result = placement()
    >>> result.ranking.best.score, result.forecast.draws
    (0.016, 100)
    """

    title: str
    ranking: Ranking
    origin: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    extent: Float[np.ndarray, "2 2"]
    points: Float[np.ndarray, "point 2"]
    keep_out: tuple[np.ndarray, ...] = ()
    warning: str = ""
    control: ControlStudy | None = None
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    provenance: Provenance = field(default=Provenance(), compare=False)
    geometry: Geometry | None = None
    forecast: Forecast | None = None
    trials: Trials | None = None

    def __post_init__(self) -> None:
        freeze(self, origin=np.float64, axes=np.float64, extent=np.float64, points=np.float64)
        check_axes(self)

    @property
    def best(self) -> Place:
        """The best location with the forecast's values and bands at its normal force, mode by mode.

        The ranking compares locations by their steady states, with intervals of shapes, friction and contact stiffness;
        the forecast states what a test will read, with every stated uncertainty in its bands. A mode without a value at
        one of the force levels keeps the values of the ranking.

        Examples
        --------
        >>> from ema.examples import placement
        >>> result = placement()
        >>> bool(result.best.damping_low[0, 0] == result.forecast.damping_low[0, 0, 1])
        True
        """
        best, forecast, levels = self.ranking.best, self.forecast, self.ranking.prediction.force_levels
        if forecast is None:
            return best
        column = np.flatnonzero(np.isclose(forecast.normal_forces, best.normal_force))
        rows = [np.flatnonzero(np.isclose(forecast.force_levels, level)) for level in levels]
        if not len(column) or not all(len(row) for row in rows):
            return best
        at = np.ix_(np.arange(len(best.damping)), np.array([row[0] for row in rows]), column[:1])
        names = ("frequency", "damping", "damping_low", "damping_high")
        predicted = {name: getattr(forecast, name)[at][..., 0] for name in names}
        known = np.all([np.isfinite(values).all(axis=1) for values in predicted.values()], axis=0)
        return replace(best, **{name: np.where(known[:, None], predicted[name], getattr(best, name)) for name in names})

    @property
    def all_findings(self) -> tuple[Finding, ...]:
        """Findings of the search, of the best place and of its forecast, each once."""
        forecast = () if self.forecast is None else self.forecast.findings
        return tuple(dict.fromkeys([*self.findings, *self.ranking.best.findings, *forecast]))
