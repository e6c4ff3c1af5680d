"""What a study hands on to reports and pages."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ema.data._arrays import freeze
from ema.data.campaign import Campaign, Repair, Run
from ema.data.findings import Finding
from ema.data.frf import FrfSet
from ema.data.hits import HitGallery
from ema.data.modal import ModalModel, PoleTable
from ema.data.provenance import Provenance
from ema.data.repeats import ConditionDifference, RepeatGroup


@dataclass(frozen=True)
class ModeQuality:
    """Indicators of each mode: MPC (0 ... 1), MPD and mean phase in degrees, all of shape (mode,)."""

    modal_phase_collinearity: Float[np.ndarray, "mode"]
    mean_phase: Float[np.ndarray, "mode"]
    mean_phase_deviation: Float[np.ndarray, "mode"]

    def __post_init__(self) -> None:
        freeze(self, modal_phase_collinearity=float, mean_phase=float, mean_phase_deviation=float)


@dataclass(frozen=True)
class RunResult:
    """Everything computed from one run.

    ``reconstruction`` is the FRF set of the model on the lines of ``frfs``; ``reconstruction_error`` (out, in) its
    norm-wise relative error for each FRF over the band of the fit.
    """

    run: Run
    frfs: FrfSet
    poles: PoleTable | None
    modes: ModalModel
    quality: ModeQuality | None = None
    reconstruction: FrfSet | None = None
    reconstruction_error: Float[np.ndarray, "out in"] | None = None
    auto_mac: Float[np.ndarray, "mode mode"] | None = None
    hits: HitGallery | None = None
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, reconstruction_error=np.float64, auto_mac=np.float64)


@dataclass(frozen=True)
class Expectation:
    """A number the recipe expects, what was found, and whether it is within the tolerance (all in the same unit)."""

    what: str
    expected: float
    tolerance: float
    found: float
    met: bool


@dataclass(frozen=True)
class StudyResult:
    """A finished study: the campaign, the result of each run, repairs, findings and provenance.

    ``conditions`` gathers the runs by what they repeat; ``differences`` holds each of them against the first one.
    """

    campaign: Campaign
    runs: tuple[RunResult, ...]
    repairs: tuple[Repair, ...] = ()
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    expectations: tuple[Expectation, ...] = ()
    provenance: Provenance = Provenance()
    title: str = ""
    conditions: tuple[RepeatGroup, ...] = ()
    differences: tuple[ConditionDifference, ...] = ()
