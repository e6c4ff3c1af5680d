"""Under what a measurement was made: the excitation and the normal force of every joint."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container

ExcitationKind = Literal["hammer", "sweep", "stepped sine", "random", "snap-back", "unknown"]
LoadingSequence = Literal["up", "down", "unstated"]


@dataclass(frozen=True, repr=False)
class Excitation(Container):
    """How the structure was driven.

    Parameters
    ----------
    kind : {"hammer", "sweep", "stepped sine", "random", "snap-back", "unknown"}, default "unknown"
        How the force was applied.
    level : float, optional
        Force level [N]: peak of an impact, force at resonance of a shaker; NaN where unknown.
    std : float, optional
        Scatter of the level [N]; NaN where unknown.
    band : tuple of (float, float), optional
        Ends of the excited band [Hz], where known.
    period : float, optional
        Period [s] of a periodic sweep, or the time that a stepped sine stays at each frequency; NaN where a record
        holds one sweep, or one frequency.

    Examples
    --------
    >>> Excitation("hammer", level=850.0, std=40.0)
    Excitation(kind='hammer', level=850, std=40)
    """

    kind: ExcitationKind = "unknown"
    level: float = float("nan")
    std: float = float("nan")
    band: tuple[float, float] | None = None
    period: float = float("nan")


@dataclass(frozen=True, repr=False)
class JointForce(Container):
    """Normal force of one joint during a measurement.

    Parameters
    ----------
    joint : str
        Name of the joint.
    mean : float, optional
        Mean over the run [N]; NaN where the joint was pressed by an unknown force.
    std : float, optional
        Dynamic rms and scatter over the run [N].
    drift : float, optional
        End minus start [N].
    trace : array of shape (sample,), optional
        Normal force over the run [N].
    trace_times : array of shape (sample,), optional
        Times of ``trace`` [s] from the start of the run.
    calibration : str, optional
        Load cell and date of its calibration, where stated.
    torque : float, optional
        Tightening torque of the bolt [N m], where stated.
    sequence : {"up", "down", "unstated"}, default "unstated"
        Whether the force was being raised or lowered from run to run.
    run_in : int, optional
        Cycles or impacts before the measurement, to settle the contact, where stated.

    Examples
    --------
    >>> JointForce("left", mean=1010.0, std=4.0).known, JointForce("left").known
    (True, False)
    """

    joint: str
    mean: float = float("nan")
    std: float = float("nan")
    drift: float = float("nan")
    trace: Float[np.ndarray, "sample"] | None = None
    trace_times: Float[np.ndarray, "sample"] | None = None
    calibration: str = ""
    torque: float | None = None
    sequence: LoadingSequence = "unstated"
    run_in: int | None = None

    def __post_init__(self) -> None:
        freeze(self, trace=np.float64, trace_times=np.float64)
        check_axes(self)

    @property
    def known(self) -> bool:
        """Whether the normal force is known."""
        return bool(np.isfinite(self.mean))


@dataclass(frozen=True, repr=False)
class Condition(Container):
    """Excitation, normal force of every joint and temperature of a measurement.

    Parameters
    ----------
    excitation : Excitation, optional
        How the structure was driven.
    joints : tuple of JointForce, optional
        One per joint. Empty means that there is no friction beam, which is not the same as 0 N.
    temperature : float, optional
        Temperature [K], where known.

    Examples
    --------
    >>> condition = Condition(joints=(JointForce("left", mean=990.0), JointForce("right", mean=1010.0)))
    >>> condition.normal_force
    1000.0
    """

    excitation: Excitation = Excitation()
    joints: tuple[JointForce, ...] = ()
    temperature: float | None = None

    @property
    def normal_force(self) -> float:
        """Mean normal force over the joints in N; NaN without joints or with an unknown one."""
        return float(np.mean([joint.mean for joint in self.joints])) if self.joints else float("nan")
