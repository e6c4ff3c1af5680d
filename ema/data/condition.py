"""Under what a measurement was made: the excitation and the normal force of every joint."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from ema.data._arrays import freeze
from ema.data._summary import Container

ExcitationKind = Literal["hammer", "sweep", "stepped sine", "random", "snap-back", "unknown"]
LoadingSequence = Literal["up", "down", "unstated"]


@dataclass(frozen=True, repr=False)
class Excitation(Container):
    """How the structure was driven.

    ``level`` and ``std`` are the force level (peak of a blow, force at resonance of a shaker) and its scatter in N;
    NaN where unknown. ``band`` in Hz. ``period`` in s is that of a periodic sweep, or the time that a stepped sine
    stays at each frequency; NaN where a record holds one sweep, or one frequency.
    """

    kind: ExcitationKind = "unknown"
    level: float = float("nan")
    std: float = float("nan")
    band: tuple[float, float] | None = None
    period: float = float("nan")


@dataclass(frozen=True, repr=False)
class JointForce(Container):
    """Normal force of one joint during a measurement.

    ``mean``, ``std`` (dynamic rms and scatter over the run) and ``drift`` (end minus start) in N; a mean of NaN says
    that the joint was pressed by an unknown force. ``trace`` (sample,) in N at ``trace_times`` (sample,) in s from the
    start of the run. ``torque`` in N m. ``sequence`` says whether the force was being raised or lowered.
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

    @property
    def known(self) -> bool:
        """Whether the normal force is known."""
        return bool(np.isfinite(self.mean))


@dataclass(frozen=True, repr=False)
class Condition(Container):
    """Excitation, normal force per joint and temperature (K) of a measurement.

    An empty ``joints`` means that there is no friction beam, which is not the same as 0 N.
    """

    excitation: Excitation = Excitation()
    joints: tuple[JointForce, ...] = ()
    temperature: float | None = None

    @property
    def normal_force(self) -> float:
        """Mean normal force over the joints in N; NaN without joints or with an unknown one."""
        return float(np.mean([joint.mean for joint in self.joints])) if self.joints else float("nan")
