"""Where a friction beam may go: the beam, its joints, the places, and what is predicted there."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float, Int

from ema.data._arrays import freeze
from ema.data._summary import Container
from ema.data.beam import FrictionLaw
from ema.data.findings import Finding
from ema.data.forecast import Forecast
from ema.data.geometry import Geometry
from ema.data.provenance import Provenance

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class FrictionBeam(Container):
    """A straight friction beam of rectangular section, pressed on a surface at joints spread evenly along it.

    Parameters
    ----------
    spacing : m between the first and the last joint; ``overhang`` m beyond either.
    width, height : m; ``young_modulus`` Pa; ``density`` kg/m^3.
    joints : number of joints, two or more.
    rotary : whether its sections have rotary inertia (Rayleigh), as short thick beams do; the beams of the simulator
        have none.
    shear : whether its sections shear (Timoshenko), which a beam four times as long as high feels by a tenth.
    loss : loss factor of its material, with its relative standard uncertainty ``loss_std``.
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
        """Kg."""
        return self.length * self.width * self.height * self.density

    @property
    def places(self) -> Float[np.ndarray, "joint"]:
        """Places of the joints along the beam from its middle, in m."""
        return np.linspace(-0.5, 0.5, self.joints) * self.spacing


@dataclass(frozen=True, repr=False)
class BoltedJoint(Container):
    """One joint of a friction beam: the law of its contact, its normal stiffness, and how well both are known.

    Parameters
    ----------
    law : friction law with mu and k_T(F_N) of one joint.
    normal_stiffness : N/m at ``law.reference_force``; k_N(F_N) grows with ``normal_exponent``.
    surface_height : m from the neutral plane of the structure to the interface.
    tangential_loss, normal_loss : loss factors of the sticking contact.
    friction_std, stiffness_std : relative standard uncertainties of mu and of k_T, alike in all joints.
    scatter : relative standard deviation of mu and of k_T from joint to joint.
    contact_length : m of contact along the beam over which k_N is spread: it resists rocking with k_N l^2 / 12.
    normal_std, length_std, force_std : relative standard uncertainties of k_N, of the contact length and of F_N, alike
        in all joints; ``height_std`` in m that of the height of the surface, ``exponent_std`` that of the exponent of
        k_T(F_N).
    form : ``given`` where the law is known to be that of ``law``; ``open`` where only mu and k_T are known: bands then
        hold Iwan laws of every share of microslip, the sharp corner of one Masing spring among them.
    normal_contact : ``linear`` where the joint also pulls, ``unilateral`` where it can part: no bands are given for
        conditions in which it does.
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
    """Places for a beam on a plane surface.

    ``centres`` (candidate, 2) m in the coordinates of the surface, ``angles`` (candidate,) rad from its first axis,
    ``beams`` (candidate,) the row in ``catalogue``.
    """

    centres: Float[np.ndarray, "candidate 2"]
    angles: Float[np.ndarray, "candidate"]
    beams: Int[np.ndarray, "candidate"]
    catalogue: tuple[FrictionBeam, ...]

    def __post_init__(self) -> None:
        freeze(self, centres=np.float64, angles=np.float64, beams=np.int64)

    def __len__(self) -> int:
        return len(self.angles)

    def joints(self, candidate: int) -> Float[np.ndarray, "joint 2"]:
        """Places of the joints of one candidate in the surface, in m."""
        along = self.catalogue[int(self.beams[candidate])].places
        angle = self.angles[candidate]
        return np.asarray(self.centres[candidate] + along[:, None] * np.array([np.cos(angle), np.sin(angle)]))


@dataclass(frozen=True, repr=False)
class Prediction(Container):
    """Modes with a friction beam at every candidate place, over excitation and normal force; holes are NaN.

    ``bare_frequencies`` Hz and ``bare_damping`` of the target modes (mode,); ``force_levels`` (level,) and
    ``normal_forces`` (force,) per joint in N; ``frequency`` Hz and ``damping`` (candidate, mode, level, force);
    ``stiffness`` (candidate, mode, level, force): modal force over modal amplitude at the resonance, 1/s^2 (unit modal
    mass); ``slip`` (candidate, mode, level, force): largest relative displacement over that at which sliding begins,
    above 1 where a joint slides (NaN where nobody asked). ``driver``, ``output`` (mode,): mass-normalised shapes at the
    excited DOF and at that whose response counts. ``method``: ``one mode`` at a time, or ``all modes`` together.
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


@dataclass(frozen=True, repr=False)
class Place(Container):
    """One place of the ranking.

    Parameters
    ----------
    candidate : row in the candidates; ``centre`` m and ``angle`` rad in the surface; ``beam`` its name or number.
    score : value of the objective, with its 95 % interval (``nan`` where none was asked for).
    normal_force : F_N per joint in N that serves all force levels best; ``normal_forces`` (level,) the best at each.
    frequency, damping : (mode, level) at ``normal_force``, Hz and ratio; ``damping_low``, ``damping_high`` the 95 %
        interval of the damping.
    mass_shift, stiffness_shift : parts of the frequency shift of each mode with all joints stuck at ``normal_force``,
        Hz, shape (mode,).
    findings : what speaks against the place.
    method : ``one mode`` at a time, or ``all modes`` together; ``one_mode_damping`` (mode, level) at ``normal_force``
        is kept beside the latter.
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


@dataclass(frozen=True, repr=False)
class Ranking(Container):
    """Places in the order of an objective.

    ``scores`` (candidate,) of all by the one-mode predictor, ``places`` the best. ``checked`` holds the shortlist with
    all modes together, its places in the order of ``shortlist``, rows of the candidates of ``prediction``.
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

    @property
    def best(self) -> Place:
        """The first place."""
        return self.places[0]

    def table(self) -> "pd.DataFrame":
        """One row per place: where, F_N, and every mode's damping at the levels."""
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
    """One law of the normal force after a release: ``energy`` s, the integral of E/E0 over time.

    ``to_five``, ``to_two`` s until the amplitude stays below 5 % and 2 % of that at the start; ``nan`` where it does
    not within the run. ``force`` N, that of the law; ``times`` s and ``energies`` E/E0 for the picture.
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


@dataclass(frozen=True, repr=False)
class ControlStudy(Container):
    """What a controlled normal force adds to the best constant one, for one place.

    ``lines`` of the ring-downs: the best constant force first, then the best of every law. ``force_levels``,
    ``constant_damping`` and ``scheduled_damping`` (level,): the steady damping under one normal force for all levels,
    and under that recommended for each. ``verdict``: in sentences.
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

    def table(self) -> "pd.DataFrame":
        """One row per law: force [N], energy integral [ms], times to 5 % and 2 % of the amplitude [ms]."""
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

    ``origin`` (3,) m and ``axes`` (3, 3) of the plane, ``extent`` (2, 2) m of the measured rectangle, ``keep_out``
    polygons (corner, 2) m; ``warning`` is the first line of every report, empty where the model agrees. ``geometry`` is
    that of the structure; ``forecast`` tells what the beam will do at the best place.
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

    def __post_init__(self) -> None:
        freeze(self, origin=np.float64, axes=np.float64, extent=np.float64, points=np.float64)
