"""What a study hands on to reports and pages."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container, brief, count, phrase
from ema.data.amplitude import AmplitudeDependentMode
from ema.data.campaign import Campaign, Repair, Run
from ema.data.findings import Finding
from ema.data.forecast import ForecastCheck
from ema.data.frf import FrfSet
from ema.data.hits import HitGallery
from ema.data.maps import ModalMap
from ema.data.modal import ModalModel, ModeQuality, PoleTable
from ema.data.placement import Placement
from ema.data.provenance import Provenance
from ema.data.repeats import ConditionDifference, RepeatGroup
from ema.data.response import Decay, Loop
from ema.data.single import SingleMode
from ema.messages import SOURCE


@dataclass(frozen=True, repr=False)
class LevelEffect(Container):
    """How far what a linear structure keeps constant follows the level of the impacts of one hammer test.

    Parameters
    ----------
    value : float
        Relative change of the modal constants for a force twice as large.
    lower, upper : float
        95 % interval of ``value``.
    weakest, strongest : float
        Impacts [N] between which it was observed.

    Examples
    --------
    >>> LevelEffect(value=0.002, lower=-0.004, upper=0.008, weakest=80.0, strongest=240.0).upper
    0.008
    """

    value: float
    lower: float
    upper: float
    weakest: float
    strongest: float


@dataclass(frozen=True, repr=False)
class RunResult(Container):
    """Everything computed from one run.

    Parameters
    ----------
    run : Run
        The run.
    frfs : FrfSet
        Its FRFs.
    poles : PoleTable or None
        Poles of all model orders, where there is a stabilisation diagram.
    modes : ModalModel
        Its modes.
    quality : ModeQuality, optional
        Indicators of its mode shapes.
    reconstruction : FrfSet, optional
        FRFs of the model on the lines of ``frfs``.
    reconstruction_error : array of shape (out, in), optional
        Norm-wise relative error of the reconstruction of each FRF over the band of the fit.
    auto_mac : array of shape (mode, mode), optional
        MAC between the modes.
    hits : HitGallery, optional
        Impacts of a hammer test.
    findings : tuple of Finding, optional
        What a reader of the run has to know.
    level_effect : LevelEffect, optional
        What a hammer test says of linearity.
    equivalent : tuple of SingleMode, optional
        Where the structure is not linear, what one linear mode fitted to the FRFs about every mode reads at the level
        of the test.

    Examples
    --------
    >>> from ema.examples import campaign, frf_set, modal_model
    >>> result = RunResult(campaign()["bare"], frf_set(), poles=None, modes=modal_model())
    >>> len(result.modes.poles)
    3
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
        check_axes(self)

    def _headline(self) -> str:
        return phrase(brief(self.run.id), repr(self.modes), count(len(self.findings), "finding"))


@dataclass(frozen=True, repr=False)
class Expectation(Container):
    """A number that the recipe expects, and what was measured.

    Parameters
    ----------
    what : str
        What the number is.
    expected : float
        Expected value.
    tolerance : float
        Largest difference that is accepted, in the unit of the value.
    found : float
        Measured value.
    met : bool
        Whether it is within the tolerance.

    Examples
    --------
    >>> Expectation("f of mode 1", expected=40.0, tolerance=0.5, found=40.2, met=True).met
    True
    """

    what: str
    expected: float
    tolerance: float
    found: float
    met: bool


@dataclass(frozen=True, repr=False)
class MapResult(Container):
    """A map of one mode measured over (F_E, F_N), and whether one linear model holds between its levels.

    Parameters
    ----------
    name : str
        Distinguishes the maps of one study.
    chart : ModalMap
        The map.
    pairs : array of shape (pair, 3)
        Normal force and the lower and the higher force level [N] that were compared.
    homogeneity : array of shape (pair,)
        Relative change of the FRFs from the lower to the higher level.
    peak_ratio : array of shape (pair,)
        Change of their peaks: above 1 the joint slips, below 1 it sticks.
    dropout : array of shape (level, force)
        Force at resonance over the force beside it.
    runs : tuple of str, optional
        Runs that the map was made from.
    findings : tuple of Finding, optional
        What a reader of the map has to know.

    Examples
    --------
    >>> from ema.examples import modal_map
    >>> MapResult("mode 1", modal_map(), np.zeros((0, 3)), [], [], dropout=np.ones((2, 3))).chart.name
    'mode 1'
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
        check_axes(self)


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
    """A statement of a publication, or a reading of ours, and whether the measurement confirms it.

    Parameters
    ----------
    text : str
        What was judged.
    source : str
        Where the statement stands.
    quantity : str
        What measures it.
    low, high : float
        Bounds of the values with which it holds.
    value : float
        Measured value.
    verdict : Verdict
        Whether the measurement confirms it.
    stated : Verdict
        Verdict that the recipe expects.
    reason : str, optional
        Why the verdict is what it is.
    sentence : str, optional
        The publication's own words; empty where the statement is a reading of ours.
    lower, upper : float, optional
        95 % interval of the value, which includes what the grid of a map leaves open.

    Examples
    --------
    >>> statement = Statement(
    ...     "damping rises with the force level", "Fig. 8", "ratio of damping", low=1.0, high=10.0, value=1.5,
    ...     verdict="matched", stated="matched",
    ... )
    >>> statement.met, statement.quoted
    (True, False)
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

    @property
    def expectation(self) -> Expectation:
        """What the recipe expects of the verdict: 1 where it is met."""
        what = f"{self.source}, verdict {self.stated!r}: {self.text}"
        if not self.met:
            what = f"{self.source}, {self.text}: the verdict is {self.verdict!r}, the recipe expects {self.stated!r}"
        return Expectation(what, 1.0, 0.0, float(self.met), self.met)


@dataclass(frozen=True, repr=False)
class StudyResult(Container):
    """A finished study: the campaign, the result of each run, repairs, findings and provenance.

    Parameters
    ----------
    campaign : Campaign
        What was measured.
    runs : tuple of RunResult
        Result of each run.
    repairs : tuple of Repair, optional
        Corrections that were applied.
    findings : tuple of Finding, optional
        What a reader of the study has to know.
    expectations : tuple of Expectation, optional
        Numbers that the recipe expects.
    provenance : Provenance, optional
        Inputs, versions and options behind the study.
    title : str, optional
        Title of the study.
    conditions : tuple of RepeatGroup, optional
        Runs grouped by the condition that they repeat.
    differences : tuple of ConditionDifference, optional
        Each condition compared with the first one.
    maps : tuple of MapResult, optional
        Modes over force level and normal force.
    statements : tuple of Statement, optional
        Statements of a publication, and whether they are confirmed.
    decays : tuple of Decay, optional
        Ring-downs.
    loops : tuple of Loop, optional
        Hysteresis loops.
    placement : Placement, optional
        Where a friction beam goes.
    forecast_check : ForecastCheck, optional
        How the forecast of the placement compares with the measurement.
    amplitude_modes : tuple of AmplitudeDependentMode, optional
        Modes over their amplitude, from runs of stepped levels.
    language : str, default "en"
        Code of the language that the recipe asks for.

    Examples
    --------
    >>> from ema.examples import campaign
    >>> StudyResult(campaign(), runs=(), title="bare and beam")
    StudyResult('bare and beam', 0 runs, 0 findings)
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
    language: str = field(default=SOURCE, compare=False)

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
