"""Whether steady states are stable: Floquet multipliers, states that coexist, and curves of them."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.findings import Finding
from ema.dof import Dof

STABLE, UNSTABLE, UNDECIDED = "stable", "unstable", "undecided"
"""Verdicts on a steady state."""
FOLD, FLIP, NEIMARK_SACKER = "fold", "flip", "Neimark-Sacker"
"""How a steady state loses its stability."""


@dataclass(frozen=True, repr=False)
class FloquetMultipliers(Container):
    """Floquet multipliers of a steady state: factors by which small disturbances grow over a period of the force.

    Parameters
    ----------
    multipliers : complex array of shape (multiplier,)
        Multipliers [-], the largest first.
    errors : array of shape (multiplier,)
        Estimated error of each [-]; infinite where the motion could not be closed over a period.
    sticking : int, default 0
        Number of friction springs that keep their residual force over the period, because they never slip. Each has a
        multiplier of 1 that says nothing about stability, and is not among the ``multipliers``.
    distance : float, default 0.0
        Distance of the first harmonic of the motion in time from that of the harmonic balance, relative.
    reason : str, optional
        Why the stability is undecided although the multipliers would say more.

    References
    ----------
    .. [1] Seydel (2010), Practical Bifurcation and Stability Analysis, chapter 7.

    Examples
    --------
    >>> FloquetMultipliers(multipliers=[1.2, 0.7], errors=[1e-4, 1e-4]).loss
    'fold'
    >>> FloquetMultipliers(multipliers=[0.9999, 0.7], errors=[1e-3, 1e-3]).verdict
    'undecided'
    """

    multipliers: Complex[np.ndarray, "multiplier"]
    errors: Float[np.ndarray, "multiplier"]
    sticking: int = 0
    distance: float = 0.0
    reason: str = ""

    def __post_init__(self) -> None:
        freeze(self, multipliers=np.complex128, errors=np.float64)
        check_axes(self)

    @property
    def verdict(self) -> str:
        """``stable``, ``unstable``, or ``undecided`` where a multiplier is within its error of the unit circle."""
        sizes = np.abs(self.multipliers)
        if self.reason or not np.all(np.isfinite(self.errors)):
            return UNDECIDED
        if np.any(sizes - self.errors > 1.0):
            return UNSTABLE
        return STABLE if np.all(sizes + self.errors < 1.0) else UNDECIDED

    @property
    def stable(self) -> bool:
        """Whether every multiplier is inside the unit circle by more than its error."""
        return self.verdict == STABLE

    @property
    def largest(self) -> float:
        """Largest magnitude of a multiplier [-]; NaN where there is none."""
        return float(np.abs(self.multipliers).max()) if len(self.multipliers) else float("nan")

    @property
    def loss(self) -> str:
        """Kind of the loss of stability, ``fold`` (+1), ``flip`` (-1) or ``Neimark-Sacker`` (a pair).

        That of the multiplier farthest outside the unit circle; empty where the state is not known to be unstable.
        """
        if self.verdict != UNSTABLE:
            return ""
        leading = int(np.argmax(np.abs(self.multipliers) - self.errors))
        value, error = self.multipliers[leading], self.errors[leading]
        if abs(value.imag) > error:
            return NEIMARK_SACKER
        return FOLD if value.real > 0 else FLIP


@dataclass(frozen=True, repr=False)
class SteadyState(Container):
    """A steady state at one frequency, and whether it is stable.

    Parameters
    ----------
    frequency : float
        Frequency of the force [Hz].
    force : float
        Amplitude of the force [N].
    orders : integer array of shape (harmonic,)
        Harmonics that were kept.
    values : complex array of shape (dof, harmonic)
        Complex amplitudes of the outputs [m].
    error_estimate : float
        Estimated error of the first harmonic, relative.
    stability : FloquetMultipliers
        Its Floquet multipliers.
    source : str, optional
        Which part of a search came to it first.

    Examples
    --------
    >>> multipliers = FloquetMultipliers(multipliers=[0.5], errors=[1e-4])
    >>> state = SteadyState(frequency=40.0, force=1.0, orders=[1], values=[[1e-4j]], error_estimate=1e-3,
    ...                     stability=multipliers)
    >>> state.first, state.stability.stable
    (array([0.+0.0001j]), True)
    """

    frequency: float
    force: float
    orders: np.ndarray
    values: Complex[np.ndarray, "dof harmonic"]
    error_estimate: float
    stability: FloquetMultipliers
    source: str = ""

    def __post_init__(self) -> None:
        freeze(self, orders=np.int64, values=np.complex128)
        check_axes(self)

    @property
    def first(self) -> Complex[np.ndarray, "dof"]:
        """Complex amplitudes of the first harmonic [m]."""
        return np.asarray(self.values[:, list(self.orders).index(1)])


@dataclass(frozen=True, repr=False)
class CoexistingStates(Container):
    """Distinct steady states at one frequency and force that a search came to, and what it searched.

    Parameters
    ----------
    states : tuple of SteadyState
        The states, the smallest response first.
    dofs : tuple of Dof
        DOFs of their values.
    starts : int
        Number of random starts.
    solved : int
        Number of these from which a steady state was reached.
    later : int
        Number of starts after the one that brought the last new state.
    forces : tuple of float
        Lowest and highest force [N] over which the curve of steady states over the force was followed.
    findings : tuple of Finding, optional
        What a reader has to know.
    name : str, optional
        What the model is called in messages.

    Examples
    --------
    >>> CoexistingStates(states=(), dofs=(Dof(1, "+X"),), starts=20, solved=0, later=20, forces=(0.1, 10.0)).statement
    '0 steady states from 20 random starts (0 reached one) and the curve over the force from 0.1 to 10 N; no further state among the last 20 starts. There may be others.'
    """  # noqa: E501

    states: tuple[SteadyState, ...]
    dofs: tuple[Dof, ...]
    starts: int
    solved: int
    later: int
    forces: tuple[float, float]
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    name: str = ""

    @property
    def statement(self) -> str:
        """What was searched and what came of it, in a sentence."""
        count = len(self.states)
        low, high = self.forces
        return (
            f"{count} steady state{'' if count == 1 else 's'} from {self.starts} random starts ({self.solved} reached "
            f"one) and the curve over the force from {low:.3g} to {high:.3g} N; no further state among the last "
            f"{self.later} starts. There may be others."
        )


@dataclass(frozen=True, repr=False)
class SteadyStateCurve(Container):
    """Steady states along a curve over frequency, folds and unstable parts included.

    Parameters
    ----------
    frequencies : array of shape (point,)
        Frequencies [Hz] in the order of the curve; they turn back at folds.
    values : complex array of shape (point, dof)
        Complex amplitudes of the first harmonic of ``dofs`` [m].
    dofs : tuple of Dof
        DOFs of the values.
    force : float
        Amplitude of the force [N].
    largest : array of shape (point,)
        Largest magnitude of a Floquet multiplier [-]; NaN where it was not computed, and the verdict is that of the
        neighbours on both sides.
    verdicts : tuple of str
        ``stable``, ``unstable`` or ``undecided`` for every point.
    losses : tuple of str
        Kind of the loss of stability of every point, empty where it is not known to be unstable.
    error_estimate : array of shape (point,)
        Estimated error of every point [-]: of the first harmonic and of the frequency, across the curve, relative.
    harmonics : integer array of shape (point,)
        Highest harmonic that was kept.
    ends : tuple of (str, str), default ("edge", "edge")
        Where the curve begins and ends: ``edge`` of the band, ``closed`` where it returned to its first point, ``lost``
        where it could not be followed any farther.
    reasons : tuple of (str, str), default ("", "")
        Why it could not, at either end.
    detached : bool, default False
        Whether it began at a state of a search that lay on no curve known by then, and neither it nor the first curve
        was lost on the way: they may be parts of one.
    name : str, optional
        What the model is called in messages.
    undecided_because : tuple of str, optional
        Why the stability of every point is undecided, empty where it is known; none in files of former versions.

    Examples
    --------
    >>> curve = SteadyStateCurve(
    ...     frequencies=[40.0, 41.0, 40.5], values=[[1e-4], [2e-4], [3e-4]], dofs=(Dof(1, "+X"),), force=1.0,
    ...     largest=[0.9, 1.0, 1.1], verdicts=("stable", "undecided", "unstable"), losses=("", "", "fold"),
    ...     error_estimate=[4e-3, 4e-3, 4e-3], harmonics=[5, 7, 7],
    ... )
    >>> curve.folds
    array([41.])
    """

    frequencies: Float[np.ndarray, "point"]
    values: Complex[np.ndarray, "point dof"]
    dofs: tuple[Dof, ...]
    force: float
    largest: Float[np.ndarray, "point"]
    verdicts: tuple[str, ...]
    losses: tuple[str, ...]
    error_estimate: Float[np.ndarray, "point"]
    harmonics: Int[np.ndarray, "point"]
    ends: tuple[str, str] = ("edge", "edge")
    reasons: tuple[str, str] = ("", "")
    detached: bool = False
    name: str = ""
    undecided_because: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(
            self,
            frequencies=np.float64,
            values=np.complex128,
            largest=np.float64,
            error_estimate=np.float64,
            harmonics=np.int64,
        )
        check_axes(self)

    @property
    def isolated(self) -> bool:
        """Whether it is closed in itself: no sweep over the band comes to it without a jump."""
        return self.ends == ("closed", "closed")

    @property
    def folds(self) -> Float[np.ndarray, "fold"]:
        """Frequencies [Hz] of the points at which the curve turns back."""
        ways = np.diff(self.frequencies)
        return np.asarray(self.frequencies[1 + np.flatnonzero(ways[1:] * ways[:-1] < 0)])
