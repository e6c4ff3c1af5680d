"""Poles and modes."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container, brief, count, phrase, span
from ema.data.condition import Condition
from ema.data.findings import Finding
from ema.data.provenance import Provenance
from ema.data.set_ups import SetUpShifts
from ema.dof import Dof
from ema.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

COVERAGE_FACTOR = 1.959964
"""Standard uncertainties on each side of a 95 % coverage interval of a normal distribution."""

Scaling = Literal["unit modal mass", "unscaled"]


def natural_frequencies(poles: Complex[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return the undamped natural frequencies of poles.

    Parameters
    ----------
    poles : complex array
        Poles [rad/s].

    Returns
    -------
    array
        ``|p| / (2 pi)`` [Hz].

    Examples
    --------
    >>> natural_frequencies(np.array([-2.0 + 250j])).round(3)
    array([39.79])
    """
    result: np.ndarray = np.abs(poles) / (2 * np.pi)
    return result


def damping_ratios(poles: Complex[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return the fractions of critical damping of poles.

    Parameters
    ----------
    poles : complex array
        Poles [rad/s].

    Returns
    -------
    array
        ``-Re(p) / |p|``.

    Examples
    --------
    >>> damping_ratios(np.array([-3.0 + 4.0j]))
    array([0.6])
    """
    result: np.ndarray = -np.real(poles) / np.abs(poles)
    return result


def poles_from(
    frequencies: Float[np.ndarray, "*shape"], damping: Float[np.ndarray, "*shape"]
) -> Complex[np.ndarray, "*shape"]:
    """Return the poles of natural frequencies and damping ratios.

    Parameters
    ----------
    frequencies : array
        Undamped natural frequencies [Hz].
    damping : array
        Fractions of critical damping, below 1.

    Returns
    -------
    complex array
        Poles [rad/s] with positive imaginary part, -zeta w + j w sqrt(1 - zeta^2).

    Examples
    --------
    >>> poles = poles_from(np.array([40.0]), np.array([0.01]))
    >>> natural_frequencies(poles), damping_ratios(poles)
    (array([40.]), array([0.01]))
    """
    omega = 2 * np.pi * np.asarray(frequencies, dtype=np.float64)
    zeta = np.asarray(damping, dtype=np.float64)
    return -zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)


@dataclass(frozen=True, repr=False)
class PoleTable(Container):
    """Poles of all model orders: what a stabilisation diagram shows.

    Parameters
    ----------
    order : integer array of shape (pole,)
        Model order of each pole.
    poles : complex array of shape (pole,)
        Poles [rad/s] with positive imaginary part, free of any decay that a window added.
    letter : array
        One of ``o f d v s`` (new, stable in frequency, also damping, also vector, all), by ``tolerances``.
    participation : complex array of shape (pole, in)
        Right-hand vectors over the references, scaled to unit length.
    references : tuple of Dof
        DOFs of the references.
    band : tuple of (float, float)
        Ends of the band that was fitted [Hz].
    tolerances : tuple of (float, float, float), default (0.01, 0.05, 0.02)
        Tolerances of the letters: frequency, damping and vector, relative.
    values : complex array of shape (pole,), optional
        The same poles, read with the low-bias constraint; NaN where there is no counterpart.

    Examples
    --------
    >>> table = PoleTable(
    ...     order=[2], poles=poles_from(np.array([40.0]), np.array([0.01])), letter=["o"], participation=[[1.0]],
    ...     references=(Dof(1, "+Z"),), band=(20.0, 60.0),
    ... )
    >>> table
    PoleTable(1 pole, orders 2, band 20 to 60 Hz, 1 reference)
    """

    order: Int[np.ndarray, "pole"]
    poles: Complex[np.ndarray, "pole"]
    letter: np.ndarray
    participation: Complex[np.ndarray, "pole in"]
    references: tuple[Dof, ...]
    band: tuple[float, float]
    tolerances: tuple[float, float, float] = (0.01, 0.05, 0.02)
    values: Complex[np.ndarray, "pole"] | None = None

    def __post_init__(self) -> None:
        freeze(
            self,
            order=np.int64,
            poles=np.complex128,
            letter=np.dtype("<U1"),
            participation=np.complex128,
            values=np.complex128,
        )
        check_axes(self)

    @property
    def natural_frequencies(self) -> Float[np.ndarray, "pole"]:
        """Hz."""
        return natural_frequencies(self.poles)

    @property
    def damping_ratios(self) -> Float[np.ndarray, "pole"]:
        """Fractions of critical damping."""
        return damping_ratios(self.poles)

    def _headline(self) -> str:
        orders = span(self.order, "")
        return phrase(
            count(len(self.poles), "pole"),
            f"orders {orders.strip()}" if orders else "",
            f"band {self.band[0]:g} to {self.band[1]:g} Hz",
            count(len(self.references), "reference"),
        )


@dataclass(frozen=True, repr=False)
class Residuals(Container):
    """What lies outside the modes of a model, as receptance: lower / (j w)^2 + upper + extra poles.

    Parameters
    ----------
    lower : complex array of shape (dof, in)
        Lower residual terms [1/kg]: rigid-body modes and modes below the band.
    upper : complex array of shape (dof, in)
        Upper residual terms [m/N]: modes above the band.
    poles : complex array of shape (extra,), optional
        Out-of-band and computational poles [rad/s] with positive imaginary part.
    residues : complex array of shape (extra, dof, in), optional
        Their residues, each standing for itself and its conjugate.

    Examples
    --------
    >>> Residuals(lower=np.zeros((4, 2)), upper=np.full((4, 2), 1e-8)).poles
    array([], dtype=complex128)
    """

    lower: Complex[np.ndarray, "dof in"]
    upper: Complex[np.ndarray, "dof in"]
    poles: Complex[np.ndarray, "extra"] = field(default_factory=lambda: np.zeros(0, complex))
    residues: Complex[np.ndarray, "extra dof in"] | None = None

    def __post_init__(self) -> None:
        freeze(self, lower=np.complex128, upper=np.complex128, poles=np.complex128, residues=np.complex128)
        check_axes(self)


@dataclass(frozen=True, repr=False)
class ModalUncertainty(Container):
    """Uncertainty of a modal model by the noise of the FRFs, by linearisation at the optimum.

    Variances of complex values are 2 x 2, of real and imaginary part; 95 % coverage intervals are 1.96 standard
    uncertainties wide on each side. What changes from one assembly or test to the next is not contained.

    Parameters
    ----------
    values : array of shape (value, value)
        Covariance of natural frequency [Hz] and damping ratio of all modes (f1, zeta1, f2, zeta2, ...).
    shapes : array of shape (mode, dof, 2, 2)
        Variances of the shape components.
    common : complex array of shape (mode, dof, cause)
        Errors of each shape that several DOFs share, one column per independent cause of unit variance.
    participation : array of shape (mode, in, 2, 2)
        Variances of the participation factors.
    residues : array of shape (mode, dof, in, 2, 2)
        Variances of the residues.
    modal_mass : array of shape (mode,)
        Relative standard uncertainty of the modal mass of each shape with largest component 1; NaN where the model is
        unscaled.
    basis : str, optional
        What the noise level rests on.

    References
    ----------
    .. [1] Guide to the Expression of Uncertainty in Measurement, JCGM 100:2008.

    Examples
    --------
    >>> uncertainty = ModalUncertainty(
    ...     values=np.diag([1e-6, 1e-10]), shapes=np.zeros((1, 4, 2, 2)), common=np.zeros((1, 4, 0)),
    ...     participation=np.zeros((1, 2, 2, 2)), residues=np.zeros((1, 4, 2, 2, 2)), modal_mass=[0.01],
    ... )
    >>> np.sqrt(np.diag(uncertainty.values))
    array([1.e-03, 1.e-05])
    """

    values: Float[np.ndarray, "value value"]
    shapes: Float[np.ndarray, "mode dof 2 2"]
    common: Complex[np.ndarray, "mode dof cause"]
    participation: Float[np.ndarray, "mode in 2 2"]
    residues: Float[np.ndarray, "mode dof in 2 2"]
    modal_mass: Float[np.ndarray, "mode"]
    basis: str = ""

    def __post_init__(self) -> None:
        freeze(
            self,
            values=np.float64,
            shapes=np.float64,
            common=np.complex128,
            participation=np.float64,
            residues=np.float64,
            modal_mass=np.float64,
        )
        check_axes(self)


@dataclass(frozen=True, repr=False, kw_only=True)
class Candidate(Container):
    """A pole that the FRFs ask for and that is not accepted as a mode.

    Parameters
    ----------
    natural_frequency : float
        Natural frequency [Hz].
    damping_ratio : float
        Damping ratio [-].
    frequency_std : float
        Standard uncertainty of the frequency [Hz].
    damping_std : float
        Standard uncertainty of the damping ratio [-].
    confidence : float
        How sure the selection is that it is a mode, 0 ... 1.
    reason : str
        The statement that it fails, part of a sentence.

    Examples
    --------
    >>> candidate = Candidate(
    ...     natural_frequency=47.0, damping_ratio=0.03, frequency_std=0.2, damping_std=0.004, confidence=0.4,
    ...     reason="its shape is not that of one mode",
    ... )
    >>> candidate.confidence
    0.4
    """

    natural_frequency: float
    damping_ratio: float
    frequency_std: float
    damping_std: float
    confidence: float
    reason: str


@dataclass(frozen=True, repr=False)
class ModalModel(Container):
    """Modes of a structure at one condition.

    Receptance: ``sum_r [R_r / (j w - p_r) + conj(R_r) / (j w - conj(p_r))] + residuals`` with the residue matrix
    ``R_r[k, i] = shapes[k, r] * participation[i, r]``. With ``scaling == "unit modal mass"`` and proportional damping
    ``participation[i, r] = shape of mode r at input i / (2j w_d,r)``.

    Parameters
    ----------
    poles : complex array of shape (mode,)
        Poles [rad/s], positive imaginary part, ascending natural frequency.
    shapes : complex array of shape (dof, mode)
        Mode shapes; real modes have zero imaginary part.
    dofs : tuple of Dof
        DOFs of the shapes.
    participation : complex array of shape (in, mode)
        Participation factors of the inputs.
    inputs : tuple of Dof
        Reference DOFs: the forces of a shaker test; the accelerometers of a roving-hammer test, by reciprocity.
    residuals : Residuals, optional
        What lies outside the modes, where known.
    scaling : {"unit modal mass", "unscaled"}, default "unscaled"
        How the shapes are scaled.
    covariance : array of shape (mode, 2, 2), optional
        Covariance of natural frequency [Hz] and damping ratio of each mode.
    confidence : array of shape (mode,), optional
        How sure the selection is that the mode is one, 0 ... 1.
    condition : Condition, optional
        Excitation and normal forces of the measurement.
    provenance : Provenance, optional
        Inputs, versions and options behind the model.
    findings : tuple of Finding, optional
        What a reader of the modes has to know.
    name : str, optional
        What the model is called in messages.
    uncertainty : ModalUncertainty, optional
        Uncertainty of everything in the model, where known.
    groups : tuple of tuple of int, optional
        Positions of modes that the data do not tell apart, a tuple for each group of two and more.
    candidates : tuple of Candidate, optional
        Poles of the same fit that were not accepted as modes, by ascending frequency.
    set_ups : SetUpShifts, optional
        How far the modes of the set-ups of a test lie apart; ``None`` where there was one set-up.

    Raises
    ------
    InputError
        If the numbers of poles, shapes, participation factors and DOFs disagree.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> model = modal_model()
    >>> model.natural_frequencies.round(3), model.damping_ratios.round(4)
    (array([40., 60., 90.]), array([0.01 , 0.008, 0.005]))
    """

    poles: Complex[np.ndarray, "mode"]
    shapes: Complex[np.ndarray, "dof mode"]
    dofs: tuple[Dof, ...]
    participation: Complex[np.ndarray, "in mode"]
    inputs: tuple[Dof, ...]
    residuals: Residuals | None = None
    scaling: Scaling = "unscaled"
    covariance: Float[np.ndarray, "mode 2 2"] | None = None
    confidence: Float[np.ndarray, "mode"] | None = None
    condition: Condition = Condition()
    provenance: Provenance = Provenance()
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    name: str = ""
    uncertainty: ModalUncertainty | None = None
    groups: tuple[tuple[int, ...], ...] = ()
    candidates: tuple[Candidate, ...] = ()
    set_ups: SetUpShifts | None = None

    def __post_init__(self) -> None:
        freeze(
            self,
            poles=np.complex128,
            shapes=np.complex128,
            participation=np.complex128,
            covariance=np.float64,
            confidence=np.float64,
        )
        check_axes(self)
        modes = {"poles": len(self.poles), "shapes": self.shapes.shape[1], "participation": self.participation.shape[1]}
        if len(set(modes.values())) > 1:
            raise InputError(
                "the numbers of modes disagree",
                where=self.name,
                got=", ".join(f"{name} {count}" for name, count in modes.items()),
                expected="as many shapes as poles",
            )
        rows = ((self.dofs, self.shapes, "shapes"), (self.inputs, self.participation, "participation"))
        for dofs, array, name in rows:
            if len(dofs) != len(array):
                raise InputError(
                    f"the rows of {name} and its DOFs disagree",
                    where=self.name,
                    got=f"{len(array)} rows",
                    expected=f"{len(dofs)} DOFs",
                )

    @property
    def natural_frequencies(self) -> Float[np.ndarray, "mode"]:
        """Undamped natural frequencies in Hz."""
        return natural_frequencies(self.poles)

    @property
    def damping_ratios(self) -> Float[np.ndarray, "mode"]:
        """Fractions of critical damping."""
        return damping_ratios(self.poles)

    def residues(self) -> Complex[np.ndarray, "mode dof in"]:
        """Return the residue matrices of the receptance.

        Returns
        -------
        complex array of shape (mode, dof, in)
            ``shapes[k, r] * participation[i, r]`` for mode r, DOF k and input i.

        Examples
        --------
        >>> from ema.examples import modal_model
        >>> modal_model().residues().shape
        (3, 4, 2)
        """
        return np.asarray(np.einsum("kr,ir->rki", self.shapes, self.participation))

    def table(self) -> "pd.DataFrame":
        """Return the modes as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per mode, from 1: f [Hz], zeta [%], standard uncertainties and half 95 % intervals (+-) where known,
            confidence, and F_N [N] where there are joints.

        Examples
        --------
        >>> from ema.examples import modal_model
        >>> modal_model().table()["zeta [%]"].round(3).tolist()
        [1.0, 0.8, 0.5]
        """
        import pandas as pd

        columns = {"f [Hz]": self.natural_frequencies, "zeta [%]": 100 * self.damping_ratios}
        if self.covariance is not None:
            columns["std f [Hz]"] = np.sqrt(self.covariance[:, 0, 0])
            columns["std zeta [%]"] = 100 * np.sqrt(self.covariance[:, 1, 1])
            columns["+- f [Hz]"] = COVERAGE_FACTOR * columns["std f [Hz]"]
            columns["+- zeta [%]"] = COVERAGE_FACTOR * columns["std zeta [%]"]
        if self.confidence is not None:
            columns["confidence"] = self.confidence
        for joint in self.condition.joints:
            columns[f"F_N {joint.joint} [N]"] = np.full(len(self.poles), joint.mean)
        return pd.DataFrame(columns, index=pd.RangeIndex(1, len(self.poles) + 1, name="mode"))

    def _headline(self) -> str:
        return phrase(
            brief(self.name) if self.name else "",
            f"{count(len(self.poles), 'mode')} {span(self.natural_frequencies, 'Hz')}",
            f"damping {span(100 * self.damping_ratios, '%')}" if len(self.poles) else "",
            count(len(self.dofs), "DOF"),
            self.scaling,
            count(len(self.candidates), "candidate") if self.candidates else "",
            count(len(self.findings), "finding") if self.findings else "",
        )


@dataclass(frozen=True, repr=False)
class ModeQuality(Container):
    """Indicators of how real the shape of each mode is.

    Parameters
    ----------
    modal_phase_collinearity : array of shape (mode,)
        MPC, 0 ... 1.
    mean_phase : array of shape (mode,)
        Mean phase [deg].
    mean_phase_deviation : array of shape (mode,)
        Mean phase deviation [deg].

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> from ema.shapes import quality
    >>> quality(modal_model().shapes).modal_phase_collinearity.round(3)
    array([1., 1., 1.])
    """

    modal_phase_collinearity: Float[np.ndarray, "mode"]
    mean_phase: Float[np.ndarray, "mode"]
    mean_phase_deviation: Float[np.ndarray, "mode"]

    def __post_init__(self) -> None:
        freeze(self, modal_phase_collinearity=float, mean_phase=float, mean_phase_deviation=float)
        check_axes(self)
