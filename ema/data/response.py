"""What a structure with friction did: time and harmonic responses, hysteresis loops, ring-downs."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.findings import Finding
from ema.data.pressure import ContactPressure
from ema.data.provenance import Provenance
from ema.dof import Dof


@dataclass(frozen=True, repr=False)
class EnergyBalance(Container):
    """Energies over time: the sum of all but ``supplied`` minus ``supplied`` stays constant.

    Parameters
    ----------
    mechanical : array of shape (sample,)
        Kinetic and elastic energy of the structure [J].
    contact : array of shape (sample,)
        Energy in the contact springs [J].
    friction : array of shape (sample,)
        Energy dissipated by friction so far [J].
    damping : array of shape (sample,)
        Energy dissipated by the other damping so far [J].
    projection : array of shape (sample,)
        Contact energy lost so far because the slip force fell below the friction force [J].
    supplied : array of shape (sample,)
        Work of external forces so far [J].

    Examples
    --------
    >>> balance = EnergyBalance([1.0, 0.6], [0.0, 0.1], [0.0, 0.2], [0.0, 0.1], [0.0, 0.0], supplied=[0.0, 0.0])
    >>> balance.total, round(balance.error, 12)
    (array([1. , 0.7]), 0.0)
    """

    mechanical: Float[np.ndarray, "sample"]
    contact: Float[np.ndarray, "sample"]
    friction: Float[np.ndarray, "sample"]
    damping: Float[np.ndarray, "sample"]
    projection: Float[np.ndarray, "sample"]
    supplied: Float[np.ndarray, "sample"]

    def __post_init__(self) -> None:
        names = ("mechanical", "contact", "friction", "damping", "projection", "supplied")
        freeze(self, **dict.fromkeys(names, np.float64))
        check_axes(self)

    @property
    def total(self) -> Float[np.ndarray, "sample"]:
        """Mechanical and contact energy in J."""
        return np.asarray(self.mechanical + self.contact)

    @property
    def error(self) -> float:
        """Largest imbalance over the run, relative to the initial energy or, from rest, to the largest energy.

        Infinite where an energy is not finite.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            balance = self.total + self.friction + self.damping + self.projection - self.supplied
        if not np.all(np.isfinite(balance)):
            return float("inf")
        scale = self.total[0] if self.total[0] > 1e-3 * self.total.max() else self.total.max()
        return float(np.max(np.abs(balance - balance[0])) / scale) if scale > 0 else 0.0


@dataclass(frozen=True, repr=False)
class Response(Container):
    """A motion in time.

    Parameters
    ----------
    times : array of shape (sample,)
        Times [s].
    displacements : array of shape (dof, sample)
        Displacements of ``dofs`` [m, rad].
    velocities : array of shape (dof, sample)
        Velocities of ``dofs`` [m/s, rad/s].
    dofs : tuple of Dof
        DOFs of the motion.
    slips : array of shape (contact, sample)
        Relative displacement of every contact [m].
    forces : array of shape (contact, sample)
        Friction force of every contact [N].
    dissipated : array of shape (contact,)
        Friction energy of every contact over the run [J].
    slip_time : array of shape (contact,)
        Fraction of the run during which a contact dissipates.
    energy : EnergyBalance
        Energy balance over the run.
    normal_forces : array of shape (joint, sample), optional
        Normal forces of the joints [N], where they vary.
    error_estimate : float, optional
        Estimated error of the displacements over the largest one; NaN where none was made.
    step : float, default 0.0
        Step of the finest integration [s]; 0 where there is none.
    method : str, optional
        How the motion was computed.
    findings : tuple of Finding, optional
        What a reader of the motion has to know.
    name : str, optional
        What the motion is called in messages.
    provenance : Provenance, optional
        Inputs, versions and options behind the motion.
    pressure : ContactPressure, optional
        Normal forces of the node pairs, at rest and over the motion, where they were followed.

    Examples
    --------
    >>> zero = np.zeros(2)
    >>> motion = Response(
    ...     times=[0.0, 0.1], displacements=[[1.0, 0.5]], velocities=[[0.0, -3.0]], dofs=(Dof(1, "+X"),),
    ...     slips=np.zeros((0, 2)), forces=np.zeros((0, 2)), dissipated=[], slip_time=[],
    ...     energy=EnergyBalance([1.0, 1.0], zero, zero, zero, zero, zero),
    ... )
    >>> motion.energy.error
    0.0
    """

    times: Float[np.ndarray, "sample"]
    displacements: Float[np.ndarray, "dof sample"]
    velocities: Float[np.ndarray, "dof sample"]
    dofs: tuple[Dof, ...]
    slips: Float[np.ndarray, "contact sample"]
    forces: Float[np.ndarray, "contact sample"]
    dissipated: Float[np.ndarray, "contact"]
    slip_time: Float[np.ndarray, "contact"]
    energy: EnergyBalance
    normal_forces: Float[np.ndarray, "joint sample"] | None = None
    error_estimate: float = float("nan")
    step: float = 0.0
    method: str = ""
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    name: str = ""
    provenance: Provenance = field(default=Provenance(), compare=False)
    pressure: ContactPressure | None = None

    def __post_init__(self) -> None:
        names = ("times", "displacements", "velocities", "slips", "forces", "dissipated", "slip_time", "normal_forces")
        freeze(self, **dict.fromkeys(names, np.float64))
        check_axes(self)


@dataclass(frozen=True, repr=False)
class HarmonicResponse(Container):
    """Steady states under a harmonic force, x(t) = Re sum_k X_k exp(j k w t).

    Parameters
    ----------
    frequencies : array of shape (freq,)
        Frequencies of the force [Hz].
    orders : integer array of shape (harmonic,)
        Harmonics k that were kept.
    values : complex array of shape (freq, dof, harmonic)
        Complex amplitudes of ``dofs`` [m]; NaN where no solution was found.
    dofs : tuple of Dof
        DOFs of the values.
    slips : complex array of shape (freq, contact, harmonic)
        Complex amplitudes of the relative displacements of the contacts [m].
    force : float
        Amplitude of the exciting force [N].
    driven : Dof
        DOF of the exciting force.
    input_power, friction_power, damping_power : array of shape (freq,)
        Means over a period [W].
    error_estimate : array of shape (freq,)
        Estimated error of the amplitude of the first harmonic, relative.
    converged : boolean array of shape (freq,)
        Whether a solution was found.
    findings : tuple of Finding, optional
        What a reader of the response has to know.
    name : str, optional
        What the response is called in messages.
    provenance : Provenance, optional
        Inputs, versions and options behind the response.

    Examples
    --------
    >>> response = HarmonicResponse(
    ...     frequencies=[40.0], orders=[1], values=[[[1e-4 - 1e-3j]]], dofs=(Dof(1, "+X"),), slips=np.zeros((1, 0, 1)),
    ...     force=1.0, driven=Dof(1, "+X"), input_power=[0.12], friction_power=[0.07], damping_power=[0.05],
    ...     error_estimate=[1e-6], converged=[True],
    ... )
    >>> response.power_error < 1e-12
    True
    """

    frequencies: Float[np.ndarray, "freq"]
    orders: Int[np.ndarray, "harmonic"]
    values: Complex[np.ndarray, "freq dof harmonic"]
    dofs: tuple[Dof, ...]
    slips: Complex[np.ndarray, "freq contact harmonic"]
    force: float
    driven: Dof
    input_power: Float[np.ndarray, "freq"]
    friction_power: Float[np.ndarray, "freq"]
    damping_power: Float[np.ndarray, "freq"]
    error_estimate: Float[np.ndarray, "freq"]
    converged: Bool[np.ndarray, "freq"]
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    name: str = ""
    provenance: Provenance = field(default=Provenance(), compare=False)

    def __post_init__(self) -> None:
        floats = ("frequencies", "input_power", "friction_power", "damping_power", "error_estimate")
        freeze(self, **dict.fromkeys(floats, np.float64))
        freeze(self, orders=np.int64, values=np.complex128, slips=np.complex128, converged=np.bool_)
        check_axes(self)

    @property
    def power_error(self) -> float:
        """Largest difference between supplied and dissipated power, relative to the supplied power."""
        scale = np.maximum(np.abs(self.input_power), 1e-300)
        lost = self.friction_power + self.damping_power
        return float(np.nanmax(np.abs(self.input_power - lost) / scale)) if len(scale) else 0.0


@dataclass(frozen=True, repr=False)
class Loop(Container):
    """A hysteresis loop and the energy that it dissipates per cycle.

    Parameters
    ----------
    displacements : array of shape (sample,)
        Relative displacement [m].
    forces : array of shape (sample,)
        Tangential force [N].
    area : float
        Energy per cycle [J], mean over the whole cycles in the record.
    amplitude : float
        Amplitude of the relative displacement [m].
    cycles : int, default 1
        Whole cycles in the record.
    normal_force : float, optional
        Normal force [N], NaN where unknown.
    times : array of shape (sample,), optional
        Times [s], where known.
    findings : tuple of Finding, optional
        What a reader of the loop has to know.
    name : str, optional
        What the loop is called in messages.

    Examples
    --------
    >>> Loop(displacements=[1e-6, -1e-6], forces=[5.0, -5.0], area=2e-5, amplitude=1e-6).area
    2e-05
    """

    displacements: Float[np.ndarray, "sample"]
    forces: Float[np.ndarray, "sample"]
    area: float
    amplitude: float
    cycles: int = 1
    normal_force: float = float("nan")
    times: Float[np.ndarray, "sample"] | None = None
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    name: str = ""

    def __post_init__(self) -> None:
        freeze(self, displacements=np.float64, forces=np.float64, times=np.float64)
        check_axes(self)


@dataclass(frozen=True, repr=False)
class Decay(Container):
    """Ring-down of one mode: instantaneous frequency and damping ratio over the amplitude.

    Parameters
    ----------
    times : array of shape (sample,)
        Times [s].
    amplitudes : array of shape (sample,)
        Amplitude of the signal, in its unit.
    frequencies : array of shape (sample,)
        Instantaneous frequency [Hz].
    damping_ratios : array of shape (sample,)
        Instantaneous damping ratio [-].
    knee : float, optional
        Time [s] at which sliding gives way to sticking, NaN where there is none.
    name : str, optional
        What the ring-down is called in messages.
    provenance : Provenance, optional
        Inputs, versions and options behind the ring-down.
    frequency_reach, damping_reach : array of shape (sample,), optional
        Half widths of 95 % intervals [Hz, -] by what scatters about the straight lines (noise, beats, curvature; not a
        constant share of another mode); ``None`` where they are not known.
    findings : tuple of Finding, optional
        What a reader of the ring-down has to know.

    Examples
    --------
    >>> from ema.examples import decay
    >>> decay().damping_ratios[[0, -1]]
    array([0.02, 0.01])
    """

    times: Float[np.ndarray, "sample"]
    amplitudes: Float[np.ndarray, "sample"]
    frequencies: Float[np.ndarray, "sample"]
    damping_ratios: Float[np.ndarray, "sample"]
    knee: float = float("nan")
    name: str = ""
    provenance: Provenance = field(default=Provenance(), compare=False)
    frequency_reach: Float[np.ndarray, "sample"] | None = None
    damping_reach: Float[np.ndarray, "sample"] | None = None
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        names = ("times", "amplitudes", "frequencies", "damping_ratios", "frequency_reach", "damping_reach")
        freeze(self, **dict.fromkeys(names, np.float64))
        check_axes(self)
