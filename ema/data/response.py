"""What a structure with friction did: time and harmonic responses, hysteresis loops, ring-downs."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data._arrays import freeze
from ema.data._summary import Container
from ema.data.findings import Finding
from ema.data.pressure import ContactPressure
from ema.data.provenance import Provenance
from ema.dof import Dof


@dataclass(frozen=True, repr=False)
class EnergyBalance(Container):
    """Energies in J over time, shape (sample,): the sum of all but ``supplied`` minus ``supplied`` stays constant.

    ``mechanical`` is kinetic and elastic energy of the structure, ``contact`` what the contact springs hold;
    ``friction``, ``damping`` and ``projection`` have been dissipated so far (projection: contact energy lost because
    the slip force fell below the friction force); ``supplied`` is the work of external forces.
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

    @property
    def total(self) -> Float[np.ndarray, "sample"]:
        """Mechanical and contact energy in J."""
        return self.mechanical + self.contact

    @property
    def error(self) -> float:
        """Largest imbalance over the run, relative to the initial energy or, from rest, to the largest energy."""
        balance = self.total + self.friction + self.damping + self.projection - self.supplied
        scale = self.total[0] if self.total[0] > 1e-3 * self.total.max() else self.total.max()
        return float(np.max(np.abs(balance - balance[0])) / scale) if scale > 0 else 0.0


@dataclass(frozen=True, repr=False)
class Response(Container):
    """A motion in time.

    Parameters
    ----------
    times : s, shape (sample,).
    displacements, velocities : of ``dofs`` in m and m/s (rad for rotations), shape (dof, sample).
    slips, forces : relative displacement in m and friction force in N of every contact, shape (contact, sample).
    dissipated : friction energy of every contact over the run in J, shape (contact,).
    slip_time : fraction of the run during which a contact dissipates, shape (contact,).
    error_estimate : estimated error of the displacements over the largest one; ``nan`` where none was made.
    step : s, of the finest integration; 0 where there is none.
    pressure : normal forces of the node pairs, at rest and over the motion, where they were followed.
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


@dataclass(frozen=True, repr=False)
class HarmonicResponse(Container):
    """Steady states under a harmonic force, x(t) = Re sum_k X_k exp(j k w t).

    Parameters
    ----------
    frequencies : Hz, shape (freq,).
    orders : the harmonics k kept, shape (harmonic,).
    values : complex amplitudes of ``dofs`` in m, shape (freq, dof, harmonic); NaN where no solution was found.
    slips : the same of the relative displacements of the contacts, shape (freq, contact, harmonic).
    force : amplitude of the exciting force in N; ``driven`` its DOF.
    input_power, friction_power, damping_power : means over a period in W, shape (freq,).
    error_estimate : of the amplitude of the first harmonic, relative, shape (freq,).
    converged : shape (freq,).
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

    @property
    def power_error(self) -> float:
        """Largest difference between supplied and dissipated power, relative to the supplied power."""
        scale = np.maximum(np.abs(self.input_power), 1e-300)
        lost = self.friction_power + self.damping_power
        return float(np.nanmax(np.abs(self.input_power - lost) / scale)) if len(scale) else 0.0


@dataclass(frozen=True, repr=False)
class Loop(Container):
    """Hysteresis: relative displacement in m and force in N over time, shape (sample,), and the energy per cycle.

    ``area`` in J per cycle (mean over the whole cycles in the record); ``normal_force`` in N, NaN where unknown.
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


@dataclass(frozen=True, repr=False)
class Decay(Container):
    """Ring-down of one mode: instantaneous frequency in Hz and damping ratio over the amplitude, shape (sample,).

    ``knee`` is the time in s at which sliding gives way to sticking, NaN where there is none. ``frequency_reach`` in Hz
    and ``damping_reach``, shape (sample,), are half widths of 95 % intervals by what scatters about the straight lines
    (noise, beats, curvature; not a constant share of another mode); ``None`` where they are not known.
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
