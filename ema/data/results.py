"""What a study hands on to reports and pages."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from ema.data._arrays import freeze
from ema.data._summary import Container, brief, count, phrase
from ema.data.amplitude import AmplitudeDependentMode
from ema.data.campaign import Campaign, Repair, Run
from ema.data.findings import Finding
from ema.data.forecast import ForecastCheck
from ema.data.frf import FrfSet
from ema.data.hits import HitGallery
from ema.data.maps import ModalMap
from ema.data.modal import ModalModel, PoleTable
from ema.data.placement import Placement
from ema.data.provenance import Provenance
from ema.data.repeats import ConditionDifference, RepeatGroup
from ema.data.response import Decay, Loop
from ema.data.single import SingleMode


@dataclass(frozen=True, repr=False)
class ModeQuality(Container):
    """Indicators of each mode: MPC (0 ... 1), MPD and mean phase in degrees, all of shape (mode,)."""

    modal_phase_collinearity: Float[np.ndarray, "mode"]
    mean_phase: Float[np.ndarray, "mode"]
    mean_phase_deviation: Float[np.ndarray, "mode"]

    def __post_init__(self) -> None:
        freeze(self, modal_phase_collinearity=float, mean_phase=float, mean_phase_deviation=float)


@dataclass(frozen=True, repr=False)
class LevelEffect(Container):
    """How far what a linear structure keeps follows the level of the impacts of one hammer test.

    ``value`` with its 95 % interval: relative change of the modal constants for a force twice as large. ``weakest`` and
    ``strongest`` are the impacts in N between which it was seen.
    """

    value: float
    lower: float
    upper: float
    weakest: float
    strongest: float


@dataclass(frozen=True, repr=False)
class RunResult(Container):
    """Everything computed from one run.

    ``reconstruction`` is the FRF set of the model on the lines of ``frfs``; ``reconstruction_error`` (out, in) its
    norm-wise relative error for each FRF over the band of the fit. ``level_effect`` is what a hammer test says of
    linearity; where the structure is not linear, ``equivalent`` holds what one linear mode fitted to the FRFs about
    every mode reads at the level of the test.
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
    level_effect: LevelEffect | None = None
    equivalent: tuple[SingleMode, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, reconstruction_error=np.float64, auto_mac=np.float64)

    def _headline(self) -> str:
        return phrase(brief(self.run.id), repr(self.modes), count(len(self.findings), "finding"))


@dataclass(frozen=True, repr=False)
class Expectation(Container):
    """A number the recipe expects, what was found, and whether it is within the tolerance (all in the same unit)."""

    what: str
    expected: float
    tolerance: float
    found: float
    met: bool


@dataclass(frozen=True, repr=False)
class MapResult(Container):
    """A map of one mode measured over (F_E, F_N), and whether one linear model holds between its levels.

    ``pairs`` (pair, 3): normal force and the lower and the higher force level in N that were compared;
    ``homogeneity`` (pair,) the change of the FRFs from one to the other, relative, and ``peak_ratio`` (pair,) that of
    their peaks: above 1 the joint slips, below 1 it sticks. ``dropout`` (level, force): force at resonance over that
    beside it. ``name`` tells maps of one study apart; ``runs`` are the runs it was made from.
    """

    name: str
    chart: ModalMap
    pairs: Float[np.ndarray, "pair 3"]
    homogeneity: Float[np.ndarray, "pair"]
    peak_ratio: Float[np.ndarray, "pair"]
    dropout: Float[np.ndarray, "level force"]
    runs: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, pairs=np.float64, homogeneity=np.float64, peak_ratio=np.float64, dropout=np.float64)


Verdict = Literal[
    "matched",
    "matched with an assumed parameter",
    "matched with an implausible parameter",
    "undecided",
    "not matched",
    "not testable here",
]


@dataclass(frozen=True, repr=False)
class Statement(Container):
    """A statement of a publication, or a reading of ours, and whether the measurement bears it out.

    ``sentence`` is the publication's, word for word; without it the statement is a reading of ours. ``text`` says what
    was judged, ``source`` where it stands, ``quantity`` what measures it; ``low`` and ``high`` bound the values with
    which it holds. ``value`` with its 95 % interval ``lower`` to ``upper`` includes what the grid of a map leaves open;
    ``reason`` says why the verdict is what it is. ``stated`` is the verdict that the recipe expects.
    """

    text: str
    source: str
    quantity: str
    low: float
    high: float
    value: float
    verdict: Verdict
    stated: Verdict
    reason: str = ""
    sentence: str = ""
    lower: float = float("nan")
    upper: float = float("nan")

    @property
    def quoted(self) -> bool:
        """Whether the publication says it, word for word."""
        return bool(self.sentence)

    @property
    def met(self) -> bool:
        """Whether the verdict is the one that the recipe states."""
        return self.verdict == self.stated


@dataclass(frozen=True, repr=False)
class StudyResult(Container):
    """A finished study: the campaign, the result of each run, repairs, findings and provenance.

    ``conditions`` gathers the runs by what they repeat; ``differences`` holds each of them against the first one.
    ``maps`` follow a mode over force level and normal force; ``statements`` are those of a publication. ``decays`` are
    ring-downs, ``loops`` hysteresis loops; ``placement`` says where a friction beam goes, ``forecast_check`` how its
    forecast was met. ``amplitude_modes`` are modes over their amplitude, from runs of stepped levels.
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
    maps: tuple[MapResult, ...] = ()
    statements: tuple[Statement, ...] = ()
    decays: tuple[Decay, ...] = ()
    loops: tuple[Loop, ...] = ()
    placement: Placement | None = None
    forecast_check: ForecastCheck | None = None
    amplitude_modes: tuple[AmplitudeDependentMode, ...] = ()

    def _headline(self) -> str:
        return phrase(
            brief(self.title or self.campaign.name),
            count(len(self.runs), "run"),
            count(len(self.maps), "map") if self.maps else "",
            "placement" if self.placement is not None else "",
            f"{sum(one.met for one in self.expectations)} of {count(len(self.expectations), 'expectation')} met"
            if self.expectations
            else "",
            count(len(self.findings), "finding"),
        )
