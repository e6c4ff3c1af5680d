"""Modal parameters over excitation level and normal force: the paper's Figs. 8 and 9."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container, brief, count, phrase, span
from ema.data.findings import Finding
from ema.data.provenance import Provenance


@dataclass(frozen=True, repr=False)
class ModalMap(Container):
    """One mode over force level and normal force (F_E, F_N); holes are NaN.

    Parameters
    ----------
    force_levels : array of shape (level,)
        Nominal F_E [N].
    normal_forces : array of shape (force,)
        Nominal F_N [N].
    frequency : array of shape (level, force)
        Natural frequency [Hz].
    damping : array of shape (level, force)
        Damping ratio [-].
    frequency_std, damping_std : array of shape (level, force), optional
        Their standard deviations, where known.
    force_at_resonance : array of shape (level, force), optional
        Measured force at resonance [N].
    modal_amplitude : array of shape (level, force), optional
        Amplitude of the mass-normalised modal coordinate [m sqrt(kg)].
    joint_forces : array of shape (level, force, joint), optional
        Measured normal force of every joint [N].
    joints : tuple of str, optional
        Names of the joints.
    method : {"measured", "frozen"}, default "measured"
        How the points were obtained: ``measured`` (signals, windows and fit of a test, real or replayed) or ``frozen``
        (from harmonic balance alone).
    name : str, optional
        What the map is called in messages.
    provenance : Provenance, optional
        Inputs, versions and options behind the map.
    quadrature_damping : array of shape (level, force), optional
        Damping ratio by the height of the peak.
    misfit : array of shape (level, force), optional
        What a linear mode leaves of the FRFs about the peak, relative.
    findings : tuple of Finding, optional
        What a reader of the map has to know.

    Examples
    --------
    >>> from ema.examples import modal_map
    >>> damping_map = modal_map()
    >>> damping_map.normal_forces[np.nanargmax(damping_map.damping, axis=1)]
    array([500., 500.])
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
        check_axes(self)

    def _headline(self) -> str:
        return phrase(
            brief(self.name) if self.name else "",
            f"{count(len(self.force_levels), 'level')} {span(self.force_levels, 'N')}",
            f"{count(len(self.normal_forces), 'normal force')} {span(self.normal_forces, 'N')}",
            f"frequency {span(self.frequency, 'Hz')}",
            f"damping {span(100 * self.damping, '%')}",
            self.method,
        )
