"""A mode whose frequency, damping and shape depend on its amplitude."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Complex, Float

from ema.data._arrays import freeze
from ema.data._summary import Container
from ema.data.findings import Finding
from ema.data.provenance import Provenance
from ema.dof import Dof


@dataclass(frozen=True, repr=False)
class NonlinearMode(Container):
    """One mode over its amplitude; levels without a solution are NaN.

    Amplitude is that of the fundamental in mass-normalised modal coordinates: q^2 = X^H M X, X the complex amplitudes
    of the fundamental. The frequency is that at which the force that keeps the motion up is in quadrature with it; the
    damping ratio is P / (w^3 q^2), P the mean power of that force (Krack 2015; Scheel et al. 2018).

    Parameters
    ----------
    amplitudes : q in m sqrt(kg), shape (level,).
    frequencies, damping_ratios : Hz and -, shape (level,).
    shapes : complex amplitudes of the fundamental at ``dofs`` over q in 1/sqrt(kg), shape (dof, level).
    friction_power, damping_power : mean losses in the contacts and in all other damping in W, shape (level,).
    frequency_error, damping_error : estimated errors of the solution, relative, shape (level,); not those of the model.
    """

    amplitudes: Float[np.ndarray, "level"]
    frequencies: Float[np.ndarray, "level"]
    damping_ratios: Float[np.ndarray, "level"]
    shapes: Complex[np.ndarray, "dof level"]
    dofs: tuple[Dof, ...]
    friction_power: Float[np.ndarray, "level"]
    damping_power: Float[np.ndarray, "level"]
    frequency_error: Float[np.ndarray, "level"]
    damping_error: Float[np.ndarray, "level"]
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    name: str = ""
    provenance: Provenance = field(default=Provenance(), compare=False)

    def __post_init__(self) -> None:
        losses, errors = ("friction_power", "damping_power"), ("frequency_error", "damping_error")
        names = ("amplitudes", "frequencies", "damping_ratios", *losses, *errors)
        freeze(self, **dict.fromkeys(names, np.float64))
        freeze(self, shapes=np.complex128)
