"""Where a friction beam may go: the beam, its joints, the places, and what is predicted there."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from ema.data._arrays import freeze
from ema.data.beam import FrictionLaw
from ema.data.findings import Finding
from ema.data.provenance import Provenance

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class FrictionBeam:
    """A straight friction beam of rectangular section, pressed on a surface at joints spread evenly along it.

    Parameters
    ----------
    spacing : m between the first and the last joint; ``overhang`` m beyond either.
    width, height : m; ``young_modulus`` Pa; ``density`` kg/m^3.
    joints : number of joints, two or more.
    """

    spacing: float
    width: float
    height: float
    young_modulus: float = 210e9
    density: float = 7850.0
    overhang: float = 0.0
    joints: int = 2
    name: str = ""

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


@dataclass(frozen=True)
class BoltedJoint:
    """One joint of a friction beam: the law of its contact, its normal stiffness, and how well both are known.

    Parameters
    ----------
    law : friction law with mu and k_T(F_N) of one joint.
    normal_stiffness : N/m at ``law.reference_force``; k_N(F_N) grows with ``normal_exponent``.
    surface_height : m from the neutral plane of the structure to the interface.
    tangential_loss, normal_loss : loss factors of the sticking contact.
    friction_std, stiffness_std : relative standard uncertainties of mu and of k_T.
    """

    law: FrictionLaw
    normal_stiffness: float
    surface_height: float
    normal_exponent: float = 0.0
    tangential_loss: float = 0.0
    normal_loss: float = 0.0
    friction_std: float = 0.0
    stiffness_std: float = 0.0


@dataclass(frozen=True)
class Candidates:
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


@dataclass(frozen=True)
class Prediction:
    """Modes with a friction beam at every candidate place, over excitation and normal force; holes are NaN.

    ``bare_frequencies`` Hz and ``bare_damping`` of the target modes (mode,); ``force_levels`` (level,) and
    ``normal_forces`` (force,) per joint in N; ``frequency`` Hz and ``damping`` (candidate, mode, level, force);
    ``slip`` (candidate, mode, level, force): largest relative displacement over that at which sliding begins, above 1
    where a joint slides.
    """

    candidates: Candidates
    modes: tuple[int, ...]
    bare_frequencies: Float[np.ndarray, "mode"]
    bare_damping: Float[np.ndarray, "mode"]
    force_levels: Float[np.ndarray, "level"]
    normal_forces: Float[np.ndarray, "force"]
    frequency: Float[np.ndarray, "candidate mode level force"]
    damping: Float[np.ndarray, "candidate mode level force"]
    slip: Float[np.ndarray, "candidate mode level force"]
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    provenance: Provenance = field(default=Provenance(), compare=False)

    def __post_init__(self) -> None:
        names = (
            "bare_frequencies", "bare_damping", "force_levels", "normal_forces", "frequency", "damping", "slip",
        )  # fmt: skip
        freeze(self, **dict.fromkeys(names, np.float64))


@dataclass(frozen=True)
class Place:
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

    def __post_init__(self) -> None:
        names = (
            "normal_forces", "frequency", "damping", "damping_low", "damping_high", "mass_shift", "stiffness_shift",
        )  # fmt: skip
        freeze(self, **dict.fromkeys(names, np.float64))


@dataclass(frozen=True)
class Ranking:
    """Places in the order of an objective: ``scores`` (candidate,) of all, ``places`` the best of them."""

    objective: str
    prediction: Prediction
    scores: Float[np.ndarray, "candidate"]
    places: tuple[Place, ...]
    findings: tuple[Finding, ...] = field(default=(), compare=False)

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
                "rank": number, "x [m]": place.centre[0], "y [m]": place.centre[1],
                "angle [deg]": np.degrees(place.angle), "beam": place.beam, "F_N [N]": place.normal_force,
            }  # fmt: skip
            for m, mode in enumerate(self.prediction.modes):
                least = int(np.argmin(place.damping[m]))
                row[f"mode {mode + 1} zeta [%]"] = 100 * place.damping[m, least]
                row[f"mode {mode + 1} zeta low [%]"] = 100 * place.damping_low[m, least]
                row[f"mode {mode + 1} zeta high [%]"] = 100 * place.damping_high[m, least]
            rows.append(row | {"flags": ", ".join(sorted({finding.code for finding in place.findings}))})
        return pd.DataFrame(rows).set_index("rank")
