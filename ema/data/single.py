"""One mode read from the neighbourhood of its peak, without a model of the whole band."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Complex

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.condition import Condition
from ema.data.findings import Finding
from ema.data.modal import poles_from
from ema.data.provenance import Provenance
from ema.dof import Dof

SingleModeMethod = Literal["peak picking", "circle fit", "local fit"]


@dataclass(frozen=True, repr=False)
class SingleMode(Container):
    """One mode as the neighbourhood of its peak shows it; NaN stands for what the method cannot determine.

    Parameters
    ----------
    method : {"peak picking", "circle fit", "local fit"}
        How it was read.
    natural_frequency : float
        Natural frequency [Hz].
    damping_ratio : float
        Damping ratio [-], free of the decay that a window added.
    residues : complex array of shape (out, in)
        Residues of the receptance; NaN where the method gives none.
    outputs, inputs : tuple of Dof
        DOFs of ``residues``.
    band : tuple of (float, float)
        First and last line used [Hz].
    lines : int
        Number of lines used.
    natural_frequency_std, damping_ratio_std : float, optional
        One standard deviation; of a circle fit the scatter over pairs of lines.
    residual : float, optional
        What the method leaves unexplained over the lines, norm over norm of the data; of a circle fit the rms distance
        from the circle over its radius.
    quadrature_damping : float, optional
        Damping ratio from the height of the peak and a modal constant known from elsewhere.
    condition : Condition, optional
        Excitation and normal forces of the measurement.
    findings : tuple of Finding, optional
        What a reader of the mode has to know.
    name : str, optional
        What the mode is called in messages.
    provenance : Provenance, optional
        Inputs, versions and options behind the mode.

    Examples
    --------
    >>> dofs = (Dof(1, "+Z"),)
    >>> mode = SingleMode("peak picking", 40.0, 0.01, [[0.1 - 0.2j]], dofs, dofs, band=(38.0, 42.0), lines=9)
    >>> round(mode.pole.real, 3)
    -2.513
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
        check_axes(self)

    @property
    def pole(self) -> complex:
        """Pole in rad/s with positive imaginary part."""
        return complex(poles_from(np.array([self.natural_frequency]), np.array([self.damping_ratio]))[0])

    @property
    def modal_constants(self) -> Complex[np.ndarray, "out in"]:
        """``2j w_d R`` in 1/kg: real numbers, the products of two shape values, where the damping is proportional."""
        return 2j * self.pole.imag * self.residues
