"""Modal parameters over excitation level and normal force: the paper's Figs. 8 and 9."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from ema.data._arrays import freeze
from ema.data._summary import Container, brief, count, phrase, span
from ema.data.findings import Finding
from ema.data.provenance import Provenance


@dataclass(frozen=True, repr=False)
class ModalMap(Container):
    """One mode over (F_E, F_N); holes are NaN.

    ``force_levels`` (level,) and ``normal_forces`` (force,) are the nominal axes in N; ``force_at_resonance`` N,
    ``modal_amplitude`` (mass-normalised, m sqrt(kg)), ``joint_forces`` (level, force, joint) N are what was measured.
    ``method`` says how the points were obtained: ``measured`` (signals, windows and fit of a test, real or replayed) or
    ``frozen`` (from harmonic balance alone). ``quadrature_damping`` is told by the height of the peak; ``misfit`` is
    what a linear mode leaves of the FRFs about the peak, relative.
    """

    force_levels: Float[np.ndarray, "level"]
    normal_forces: Float[np.ndarray, "force"]
    frequency: Float[np.ndarray, "level force"]
    damping: Float[np.ndarray, "level force"]
    frequency_std: Float[np.ndarray, "level force"] | None = None
    damping_std: Float[np.ndarray, "level force"] | None = None
    force_at_resonance: Float[np.ndarray, "level force"] | None = None
    modal_amplitude: Float[np.ndarray, "level force"] | None = None
    joint_forces: Float[np.ndarray, "level force joint"] | None = None
    joints: tuple[str, ...] = ()
    method: Literal["measured", "frozen"] = "measured"
    name: str = ""
    provenance: Provenance = Provenance()
    quadrature_damping: Float[np.ndarray, "level force"] | None = None
    misfit: Float[np.ndarray, "level force"] | None = None
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        freeze(
            self,
            force_levels=float,
            normal_forces=float,
            frequency=float,
            damping=float,
            frequency_std=float,
            damping_std=float,
            force_at_resonance=float,
            modal_amplitude=float,
            joint_forces=float,
            quadrature_damping=float,
            misfit=float,
        )

    def _headline(self) -> str:
        return phrase(
            brief(self.name) if self.name else "",
            f"{count(len(self.force_levels), 'level')} {span(self.force_levels, 'N')}",
            f"{count(len(self.normal_forces), 'normal force')} {span(self.normal_forces, 'N')}",
            f"frequency {span(self.frequency, 'Hz')}",
            f"damping {span(100 * self.damping, '%')}",
            self.method,
        )
