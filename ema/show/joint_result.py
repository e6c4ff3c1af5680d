"""What numbers and sentences about a structure say of its friction joint: intervals, verdicts, weights, experiments."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.amplitude import Band
from ema.data.findings import Finding
from ema.data.provenance import Provenance


@dataclass(frozen=True, repr=False)
class JointParameter(Container):
    """A parameter of the joint, or a combination of parameters, before and after the statements.

    Parameters
    ----------
    name : str
        Its name, in SI.
    prior : tuple of (float, float)
        95 % range beforehand.
    interval : tuple of (float, float)
        95 % interval of the posterior.
    narrowing : float
        Width of the interval over that of the prior, of logarithms where ``logarithmic``.
    determined : bool
        Whether the interval is at most half as wide as before, whatever independent runs of the sampler differ by.
    combination : bool, default False
        Whether it is a combination of other parameters.
    logarithmic : bool, default True
        Whether its prior is even in the logarithm.

    Examples
    --------
    >>> JointParameter("friction coefficient", (0.075, 0.53), (0.06, 0.25), 0.77, False).determined
    False
    """

    name: str
    prior: tuple[float, float]
    interval: tuple[float, float]
    narrowing: float
    determined: bool
    combination: bool = False
    logarithmic: bool = True


@dataclass(frozen=True, repr=False)
class JointStatement(Container):
    """A number or a sentence, and what all others predict in its place.

    Parameters
    ----------
    sentence : str
        As it was published or written down.
    quantity : str
        What it is about.
    value : float
        The number in SI; NaN for a sentence, which states limits.
    limits : tuple of (float, float)
        Between which limits the quantity lies, infinite where there is none.
    std : float
        Standard deviation of the number or of the limits, relative where ``relative``.
    predicted : tuple of (float, float)
        95 % interval that the others predict; NaN where too few draws tell it.
    probability : float
        By the others, of the sentence; of a number, of it or of one further off. NaN where too few draws tell it.
    verdict : str
        Whether it holds together with the others.
    together : tuple of (float, float)
        95 % interval of the quantity by the posterior, this statement included.
    relative : bool, default False
        Whether ``std`` is that of the logarithm.

    Examples
    --------
    >>> limits = (-np.inf, np.inf)
    >>> predicted, together = (506.0, 511.0), (507.5, 510.2)
    >>> JointStatement("509 Hz", "frequency", 509.0, limits, 1.0, predicted, 0.6, "holds", together).is_number
    True
    """

    sentence: str
    quantity: str
    value: float
    limits: tuple[float, float]
    std: float
    predicted: tuple[float, float]
    probability: float
    verdict: str
    together: tuple[float, float]
    relative: bool = False

    @property
    def is_number(self) -> bool:
        """Whether it states a number, and not limits."""
        return bool(np.isfinite(self.value))

    @property
    def contradicts(self) -> bool:
        """Whether it does not hold together with the others."""
        return self.verdict.startswith("does not")


@dataclass(frozen=True, repr=False)
class JointExperiment(Container):
    """A measurement that is yet to be made, as one joint and as two joints predict it.

    Parameters
    ----------
    name : str
        What is measured, and what is read of it.
    one, two : tuple of (float, float)
        95 % intervals of the reading with one joint, and with two.
    separates : float
        Share of outcomes after which the right one of the two has a weight of 0.95.

    Examples
    --------
    >>> JointExperiment("peak force of the impacts: ln of N", (6.8, 8.6), (6.7, 8.6), 0.01).separates
    0.01
    """

    name: str
    one: tuple[float, float]
    two: tuple[float, float]
    separates: float


UNDECIDED = (0.05, 0.95)
"""Weights between which hypotheses cannot be told apart: odds of 19 to 1 either way."""


@dataclass(frozen=True, repr=False)
class JointHypothesis(Container):
    """One of several friction laws, or of several numbers of joints, with its weight.

    Parameters
    ----------
    name : str
        Its name.
    weight : float
        Its posterior probability.
    low, high : float
        95 % interval of the weight by independent runs of the sampler.

    Examples
    --------
    >>> JointHypothesis("one joint", 0.56, 0.40, 0.71).verdict
    'cannot be told apart'
    """

    name: str
    weight: float
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """Whether it can be told apart from the others, whatever independent runs differ by."""
        if self.high < UNDECIDED[0]:
            return "excluded"
        return "the others are excluded" if self.low > UNDECIDED[1] else "cannot be told apart"


@dataclass(frozen=True, repr=False)
class HammerPrediction(Container):
    """Frequency and damping that hammer tests read over the normal force, by the posterior of one joint.

    Parameters
    ----------
    normal_forces : array of shape (force,)
        F_N [N].
    frequency, damping : Band
        Medians and 95 % bands of the frequency [Hz] and of the damping ratio [-], of shape (force,).
    stated_forces : array of shape (reading,)
        F_N [N] of the readings that were stated.
    stated_frequency, stated_damping : array of shape (reading, 2)
        Stated values and standard deviations; NaN where none is stated.

    Examples
    --------
    >>> from ema.show.joint_result import example
    >>> example().hammer.damping.value.shape
    (3,)
    """

    normal_forces: Float[np.ndarray, "force"]
    frequency: Band
    damping: Band
    stated_forces: Float[np.ndarray, "reading"]
    stated_frequency: Float[np.ndarray, "reading 2"]
    stated_damping: Float[np.ndarray, "reading 2"]

    def __post_init__(self) -> None:
        names = ("normal_forces", "stated_forces", "stated_frequency", "stated_damping")
        freeze(self, **dict.fromkeys(names, np.float64))
        check_axes(self)


@dataclass(frozen=True, repr=False)
class JointLawExperiment(Container):
    """A measurement that is yet to be made, as the laws of the joint predict it.

    Parameters
    ----------
    name : str
        What is measured, and what of it.
    laws : tuple of str
        Laws that explain the statements in draws enough to predict it.
    outcomes : tuple of (float, float)
        95 % interval of what is read, by law.
    separates : float
        Share of outcomes, drawn from each of these laws as often, after which the right one has a weight of 0.95.

    Examples
    --------
    >>> JointLawExperiment("loop", ("Masing", "Iwan"), ((0.1, 0.2), (0.4, 0.5)), 0.9).separates
    0.9
    """

    name: str
    laws: tuple[str, ...]
    outcomes: tuple[tuple[float, float], ...]
    separates: float


@dataclass(frozen=True, repr=False)
class JointLimit(Container):
    """Frequency of the structure with the beam as the normal force goes to zero; a result, not a condition.

    Parameters
    ----------
    force : tuple of (float, float)
        95 % interval of the normal force [N] below which the beam leaves the structure for a part of every period, at
        the highest level of excitation; NaN where lift-off was not assumed.
    lowest : tuple of (float, float)
        95 % interval of the frequency [Hz] at the lowest normal force of the test and its highest level.
    limit : tuple of (float, float)
        95 % interval of the frequency [Hz] as the normal force goes to zero.
    reached : float
        Probability that it is that without the beam within 0.2 %.

    Examples
    --------
    >>> JointLimit((1.0, 20.0), (480.0, 495.0), (484.0, 498.7), 0.1).reached
    0.1
    """

    force: tuple[float, float]
    lowest: tuple[float, float]
    limit: tuple[float, float]
    reached: float


@dataclass(frozen=True, repr=False)
class JointResult(Container):
    """What numbers and sentences about a structure determine of its friction joint, and which contradict the others.

    Parameters
    ----------
    title : str
        Title of the file of statements.
    bare : tuple of (float, float)
        Frequency [Hz] and damping ratio [-] of the mode without the beam.
    parameters : tuple of JointParameter
        Parameters and combinations of parameters.
    statements : tuple of JointStatement
        Numbers and sentences.
    weight : JointHypothesis, optional
        That the hammer test and the shaker test had one joint; ``None`` where there is one test.
    laws : tuple of JointHypothesis, optional
        Weights of friction laws, where several were compared.
    law_experiments : tuple of JointLawExperiment, optional
        Measurements that could tell these laws apart, the one that decides most often first.
    lift_off : JointLimit, optional
        Frequency as the normal force goes to zero, where a shaker test of the mode was stated.
    experiments : tuple of JointExperiment, optional
        Measurements that could tell one joint from two, the one that decides most often first.
    hammer : HammerPrediction, optional
        What hammer tests read over the normal force, where there is a hammer test.
    findings : tuple of Finding, optional
        What a reader of the result has to know.
    provenance : Provenance, optional
        File, versions and options behind the result.

    Examples
    --------
    >>> from ema.show.joint_result import example
    >>> [parameter.name for parameter in example().parameters if parameter.determined]
    ['stiffness ratio at 1 kN, hammer']
    """

    title: str
    bare: tuple[float, float]
    parameters: tuple[JointParameter, ...]
    statements: tuple[JointStatement, ...]
    weight: JointHypothesis | None = None
    laws: tuple[JointHypothesis, ...] = ()
    law_experiments: tuple[JointLawExperiment, ...] = ()
    lift_off: JointLimit | None = None
    experiments: tuple[JointExperiment, ...] = ()
    hammer: HammerPrediction | None = None
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    provenance: Provenance = field(default=Provenance(), compare=False)

    @property
    def decided(self) -> bool:
        """Whether the weight of one joint lies below 0.05 or above 0.95, whatever independent runs differ by."""
        return self.weight is not None and self.weight.verdict != "cannot be told apart"


def example() -> JointResult:
    """Return what five statements say of a joint; two of them do not hold together with the others, or say too much.

    Returns
    -------
    JointResult
        Three parameters and a combination, five statements, one joint against two.

    Examples
    --------
    >>> example().decided
    False
    """
    none, inf = float("nan"), float("inf")
    forces = np.array([500.0, 2000.0, 20000.0])
    return JointResult(
        title="table",
        bare=(499.0, 0.00638),
        parameters=(
            JointParameter("friction coefficient", (0.075, 0.53), (0.061, 0.252), 0.77, False),
            JointParameter("exponent of k_T", (0.025, 0.975), (0.102, 0.841), 0.78, False, logarithmic=False),
            JointParameter("stiffness ratio at 1 kN, hammer", (0.005, 0.5), (0.083, 0.352), 0.32, True),
            JointParameter(
                "peak force over friction coefficient", (970.0, 32000.0), (7910.0, 45800.0), 0.52, False, True
            ),
        ),
        statements=(
            JointStatement(
                "10 kN: 509 Hz",
                "hammer, 10000 N: frequency [Hz]",
                509.0,
                (-inf, inf),
                1.0,
                (506.3, 511.2),
                0.81,
                "holds",
                (507.4, 510.3),
            ),
            JointStatement(
                "10 kN: 0.738 %",
                "hammer, 10000 N: damping ratio",
                0.00738,
                (-inf, inf),
                5e-4,
                (none, none),
                none,
                "not known",
                (0.0068, 0.0079),
            ),
            JointStatement(
                "most at 25 to 200 N",
                "shaker, 30 N excitation, ridge",
                none,
                (25.0, 200.0),
                0.25,
                (32.1, 341.0),
                0.87,
                "holds",
                (38.0, 210.0),
                True,
            ),
            JointStatement(
                "it remains low",
                "shaker, F_N 25 N, most damping",
                none,
                (-inf, 0.008),
                5e-4,
                (0.0121, 0.0184),
                0.004,
                "does not hold together with the others",
                (0.0094, 0.0121),
            ),
            JointStatement(
                "it falls",
                "shaker, 30 N excitation, F_N 100 N, fall",
                none,
                (-inf, 1.0),
                0.02,
                (0.71, 1.12),
                0.63,
                "holds",
                (0.73, 1.01),
            ),
        ),
        weight=JointHypothesis("one joint", 0.56, 0.4, 0.71),
        laws=(
            JointHypothesis("Masing", 0.8, 0.7, 0.9),
            JointHypothesis("Iwan", 0.19, 0.1, 0.3),
            JointHypothesis("Dahl", 0.01, 0.0, 0.03),
        ),
        law_experiments=(
            JointLawExperiment(
                "hysteresis loops with slips of F_C/k_T and twice that: energy of the first over that of the second",
                ("Masing", "Iwan"),
                ((0.01, 0.09), (0.1, 0.22)),
                0.88,
            ),
        ),
        lift_off=JointLimit((2.0, 24.0), (485.0, 496.0), (484.0, 498.7), 0.1),
        experiments=(
            JointExperiment(
                "hysteresis loops of both joints: difference of the exponents of k_T", (-0.1, 0.1), (-0.78, 0.74), 0.36
            ),
            JointExperiment("peak force of the impacts: ln of N", (6.74, 8.65), (6.51, 8.72), 0.01),
        ),
        hammer=HammerPrediction(
            forces,
            Band(np.array([490.0, 499.0, 507.0]), np.array([492.0, 502.0, 509.0]), np.array([494.0, 505.0, 511.0])),
            Band(np.array([0.011, 0.009, 0.0069]), np.array([0.016, 0.011, 0.0073]), np.array([0.021, 0.013, 0.0078])),
            np.array([10000.0]),
            np.array([[509.0, 1.0]]),
            np.array([[0.00738, 5e-4]]),
        ),
        provenance=Provenance(inputs=(("joint.toml", "ab" * 32),), options=(("seed", "0"),)),
    )
