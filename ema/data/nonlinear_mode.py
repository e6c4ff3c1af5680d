"""A mode whose frequency, damping and shape depend on its amplitude."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Complex, Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.findings import Finding
from ema.data.provenance import Provenance
from ema.dof import Dof


@dataclass(frozen=True, repr=False)
class NonlinearMode(Container):
    """One mode over its amplitude; levels without a solution are NaN.

    Amplitude is that of the fundamental in mass-normalised modal coordinates: q^2 = X^H M X, X the complex amplitudes
    of the fundamental. The frequency is that at which the force that keeps the motion up is in quadrature with it; the
    damping ratio is P / (w^3 q^2), P the mean power of that force.

    Parameters
    ----------
    amplitudes : array of shape (level,)
        q [m sqrt(kg)].
    frequencies : array of shape (level,)
        Natural frequencies [Hz].
    damping_ratios : array of shape (level,)
        Damping ratios [-].
    shapes : complex array of shape (dof, level)
        Complex amplitudes of the fundamental at ``dofs`` over q [1/sqrt(kg)].
    dofs : tuple of Dof
        DOFs of the shapes.
    friction_power, damping_power : array of shape (level,)
        Mean losses in the contacts and in all other damping [W].
    frequency_error, damping_error : array of shape (level,)
        Estimated errors of the solution, relative; not those of the model.
    findings : tuple of Finding, optional
        What a reader of the mode has to know.
    name : str, optional
        What the mode is called in messages.
    provenance : Provenance, optional
        Inputs, versions and options behind the mode.

    References
    ----------
    .. [1] Extended periodic motion: Krack (2015), Computers & Structures 154:59.
    .. [2] Damping by power: Scheel, Peter, Leine and Krack (2018), Journal of Sound and Vibration 435:56.

    Examples
    --------
    >>> mode = NonlinearMode(
    ...     amplitudes=[1e-4], frequencies=[40.0], damping_ratios=[0.01], shapes=[[0.7]], dofs=(Dof(1, "+X"),),
    ...     friction_power=[1e-3], damping_power=[2e-3], frequency_error=[1e-6], damping_error=[1e-5],
    ... )
    >>> mode.friction_power / (mode.friction_power + mode.damping_power)
    array([0.33333333])
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
        check_axes(self)
