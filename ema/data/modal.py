"""Poles and modes."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data._arrays import freeze
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
    """Undamped natural frequencies in Hz of poles in rad/s."""
    return np.abs(poles) / (2 * np.pi)


def damping_ratios(poles: Complex[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Fractions of critical damping of poles in rad/s."""
    return -np.real(poles) / np.abs(poles)


def poles_from(
    frequencies: Float[np.ndarray, "*shape"], damping: Float[np.ndarray, "*shape"]
) -> Complex[np.ndarray, "*shape"]:
    """Poles in rad/s (positive imaginary part) of natural frequencies in Hz and damping ratios."""
    omega = 2 * np.pi * np.asarray(frequencies, dtype=np.float64)
    zeta = np.asarray(damping, dtype=np.float64)
    return -zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)


@dataclass(frozen=True, repr=False)
class PoleTable(Container):
    """Poles of all model orders: what a stabilisation diagram draws.

    ``poles`` in rad/s with positive imaginary part, already free of any decay that a window added. ``letter`` is one
    of ``o f d v s`` (new, stable in frequency, also damping, also vector, all), by the tolerances in ``tolerances``.
    ``participation`` (pole, in): right-hand vectors over the references ``references``, scaled to unit length.
    ``values`` (pole,): the same poles read with the low-bias constraint, NaN where there is no counterpart.
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

    ``lower``, ``upper`` (dof, in); ``poles`` (extra,) rad/s with positive imaginary part and their ``residues``
    (extra, dof, in), each standing for itself and its conjugate: out-of-band modes and computational poles.
    """

    lower: Complex[np.ndarray, "dof in"]
    upper: Complex[np.ndarray, "dof in"]
    poles: Complex[np.ndarray, "extra"] = field(default_factory=lambda: np.zeros(0, complex))
    residues: Complex[np.ndarray, "extra dof in"] | None = None

    def __post_init__(self) -> None:
        freeze(self, lower=np.complex128, upper=np.complex128, poles=np.complex128, residues=np.complex128)


@dataclass(frozen=True, repr=False)
class ModalUncertainty(Container):
    """Uncertainty of a modal model by the noise of the FRFs, by linearisation at the optimum (GUM, JCGM 100).

    Variances of complex values are 2 x 2, of real and imaginary part; 95 % coverage intervals are 1.96 standard
    uncertainties wide on each side. What changes from one assembly or test to the next is not contained.

    Parameters
    ----------
    values : covariance of natural frequency [Hz] and damping ratio of all modes (f1, zeta1, f2, zeta2, ...).
    shapes : variances of the shape components.
    common : errors of each shape that several DOFs share, one column per independent cause of unit variance.
    participation, residues : variances of the participation and of the residue matrices.
    modal_mass : relative standard uncertainty of the modal mass of each shape with largest component 1; NaN where the
        model is unscaled.
    basis : what the noise level rests on.
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


@dataclass(frozen=True, repr=False, kw_only=True)
class Candidate(Container):
    """A pole that the FRFs ask for and that is not accepted as a mode.

    Parameters
    ----------
    natural_frequency, frequency_std : Hz.
    damping_ratio, damping_std : -.
    confidence : how sure the selection is that it is a mode, 0 ... 1.
    reason : the statement that it fails, part of a sentence.
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
    poles : rad/s, positive imaginary part, ascending natural frequency, shape (mode,).
    shapes : shape (dof, mode), complex; real modes have zero imaginary part.
    dofs : the DOFs of ``shapes``.
    participation : shape (in, mode).
    inputs : the reference DOFs (the forces of a shaker test; the accelerometers of a roving-hammer test, by
        reciprocity).
    covariance : of (natural frequency [Hz], damping ratio) of each mode, shape (mode, 2, 2).
    confidence : how sure the selection is that the mode is one, 0 ... 1, shape (mode,).
    uncertainty : of everything in the model, where known.
    groups : positions of modes that the data do not tell apart, a tuple for each group of two and more.
    candidates : poles of the same fit that were not accepted as modes, by ascending frequency.
    set_ups : how far the modes of the set-ups of a test lie apart; ``None`` where there was one set-up.
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
        """Residue matrices of the receptance, shape (mode, dof, in)."""
        return np.einsum("kr,ir->rki", self.shapes, self.participation)

    def table(self) -> "pd.DataFrame":
        """One row per mode: f [Hz], zeta [%], standard uncertainties and half 95 % intervals (+-) where known, F_N [N]
        where there are joints.
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
