"""One mode read from the neighbourhood of its peak, without a model of the whole band."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Complex

from ema.data._arrays import freeze
from ema.data._summary import Container
from ema.data.condition import Condition
from ema.data.findings import Finding
from ema.data.modal import poles_from
from ema.data.provenance import Provenance
from ema.dof import Dof

SingleModeMethod = Literal["peak picking", "circle fit", "local fit"]


@dataclass(frozen=True, repr=False)
class SingleMode(Container):
    """A mode as one peak shows it; NaN stands for what the method could not tell.

    Parameters
    ----------
    natural_frequency, damping_ratio : Hz and fraction of critical damping, free of the decay that a window added.
    residues : of the receptance, shape (out, in); NaN where the method gives none.
    outputs, inputs : the DOFs of ``residues``.
    band : first and last line used in Hz; ``lines`` how many there are.
    natural_frequency_std, damping_ratio_std : one standard deviation; of a circle fit the scatter over pairs of lines.
    residual : what the method leaves unexplained over ``lines``, norm over norm of the data (of a circle fit: rms
        distance from the circle over its radius).
    quadrature_damping : damping ratio from the height of the peak and a modal constant known from elsewhere.
    """

    method: SingleModeMethod
    natural_frequency: float
    damping_ratio: float
    residues: Complex[np.ndarray, "out in"]
    outputs: tuple[Dof, ...]
    inputs: tuple[Dof, ...]
    band: tuple[float, float]
    lines: int
    natural_frequency_std: float = float("nan")
    damping_ratio_std: float = float("nan")
    residual: float = float("nan")
    quadrature_damping: float = float("nan")
    condition: Condition = Condition()
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    name: str = ""
    provenance: Provenance = field(default=Provenance(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, residues=np.complex128)

    @property
    def pole(self) -> complex:
        """Pole in rad/s with positive imaginary part."""
        return complex(poles_from(np.array([self.natural_frequency]), np.array([self.damping_ratio]))[0])

    @property
    def modal_constants(self) -> Complex[np.ndarray, "out in"]:
        """``2j w_d R`` in 1/kg: real numbers, the products of two shape values, where the damping is proportional."""
        return 2j * self.pole.imag * self.residues
