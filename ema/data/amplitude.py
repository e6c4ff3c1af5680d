"""A mode over its amplitude, and the stepped levels that it is measured with."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from ema.data._arrays import freeze
from ema.data._summary import Container
from ema.data.condition import Condition
from ema.data.findings import Finding
from ema.data.provenance import Provenance
from ema.dof import Dof
from ema.errors import InputError

Control = Literal["response", "force", "none"]
"""What was held constant while the frequency was stepped."""


@dataclass(frozen=True, repr=False)
class Band(Container):
    """Values with an interval each: ``low <= value <= high``, of any one shape; ``contains`` says what is in it.

    Examples
    --------
    >>> Band(low=[79.9], value=[80.0], high=[80.1], contains="noise").half_width
    array([0.1])
    """

    low: Float[np.ndarray, "*shape"]
    value: Float[np.ndarray, "*shape"]
    high: Float[np.ndarray, "*shape"]
    level: float = 0.95
    contains: str = ""

    def __post_init__(self) -> None:
        freeze(self, low=np.float64, value=np.float64, high=np.float64)
        known = np.isfinite(self.low) & np.isfinite(self.value) & np.isfinite(self.high)
        if np.any(self.low[known] > self.value[known]) or np.any(self.value[known] > self.high[known]):
            raise InputError("an interval that does not hold its value", expected="low <= value <= high")

    @property
    def half_width(self) -> Float[np.ndarray, "*shape"]:
        """Half of the distance between the bounds."""
        return 0.5 * (self.high - self.low)

    @property
    def std(self) -> Float[np.ndarray, "*shape"]:
        """Standard deviation of a Gaussian with an interval of this width."""
        from statistics import NormalDist

        return self.half_width / NormalDist().inv_cdf(0.5 + 0.5 * self.level)


@dataclass(frozen=True, repr=False)
class SteppedLevel(Container):
    """One level of a stepped sine: what was held, and the fundamentals at every frequency.

    ``frequencies`` (line,) Hz; ``force`` (line,) amplitude in N; ``response`` (line,) complex amplitude in SI units of
    ``quantity``, its phase relative to the force; ``harmonics`` (order, line) amplitudes of the response at 2, 3, ...
    times the frequency, ``None`` where they were not recorded.
    """

    frequencies: Float[np.ndarray, "line"]
    force: Float[np.ndarray, "line"]
    response: Complex[np.ndarray, "line"]
    quantity: Literal["displacement", "velocity", "acceleration"]
    control: Control = "none"
    output: Dof | None = None
    input: Dof | None = None
    harmonics: Float[np.ndarray, "order line"] | None = None
    name: str = ""

    def __post_init__(self) -> None:
        freeze(self, frequencies=np.float64, force=np.float64, response=np.complex128, harmonics=np.float64)

    @property
    def displacement(self) -> Complex[np.ndarray, "line"]:
        """Complex amplitude of the displacement in m."""
        power = {"displacement": 0, "velocity": 1, "acceleration": 2}[self.quantity]
        return self.response / (2j * np.pi * self.frequencies) ** power


@dataclass(frozen=True, repr=False)
class AmplitudeDependentMode(Container):
    """Frequency and damping of one mode over its amplitude, lowest level first.

    Parameters
    ----------
    amplitude : amplitude of the response at resonance, SI units of ``quantity``, shape (level,).
    frequency : natural frequency in Hz at that amplitude, shape (level,).
    damping : equivalent viscous damping ratio, power over omega^3 q^2, shape (level,).
    force : amplitude of the force at resonance in N, shape (level,); NaN where there was none.
    modal_mass : kg, for a shape of 1 at the response; NaN where it is not known.
    control : what was held while the levels were measured; ``none`` for a ring-down.

    Source: damping by power, Scheel et al. (2018), MSSP 113:1; response control, Arslan, Aykan and Ozguven (2011).
    """

    amplitude: Float[np.ndarray, "level"]
    frequency: Band
    damping: Band
    quantity: Literal["displacement", "velocity", "acceleration"] = "acceleration"
    force: Float[np.ndarray, "level"] | None = None
    modal_mass: float = float("nan")
    control: Control = "none"
    condition: Condition = Condition()
    name: str = ""
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    provenance: Provenance = field(default=Provenance(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, amplitude=np.float64, force=np.float64)
        if not len(self.amplitude) == len(self.frequency.value) == len(self.damping.value):
            raise InputError("amplitudes, frequencies and damping ratios of unequal number", where=self.name)
        if np.any(np.diff(self.amplitude) <= 0) or not np.all(self.amplitude > 0):
            raise InputError("amplitudes that do not rise", where=self.name, expected="positive, lowest first")

    def lowest(self, count: int) -> "AmplitudeDependentMode":
        """The mode as its ``count`` lowest levels show it."""
        from dataclasses import replace

        def cut(band: Band) -> Band:
            return Band(band.low[:count], band.value[:count], band.high[:count], band.level, band.contains)

        return replace(
            self,
            amplitude=self.amplitude[:count],
            frequency=cut(self.frequency),
            damping=cut(self.damping),
            force=None if self.force is None else self.force[:count],
        )


@dataclass(frozen=True, repr=False)
class LawParameter(Container):
    """A parameter of a joint law: median, bounds of its 95 % interval, and whether the measured levels identify it.

    ``reason`` says why they do not. A parameter that is identified by measured levels confirms no prediction.
    """

    law: str
    name: str
    low: float
    value: float
    high: float
    identifiable: bool
    reason: str = ""


@dataclass(frozen=True, repr=False)
class AmplitudePrediction(Container):
    """Frequency in Hz and damping of a mode at amplitudes that were not measured, with 95 % bands.

    ``amplitude`` (point,) in SI units of ``quantity``; ``beyond`` (point,) the amplitude over the highest measured one;
    ``laws`` and their ``weights`` by prediction of the highest levels left out; ``force`` (point,) in N that holds the
    amplitude at resonance. ``statement`` says how far outside the data the prediction lies;
    ``parameters`` are those of the law of most weight.
    """

    amplitude: Float[np.ndarray, "point"]
    frequency: Band
    damping: Band
    beyond: Float[np.ndarray, "point"]
    laws: tuple[str, ...]
    weights: Float[np.ndarray, "law"]
    quantity: Literal["displacement", "velocity", "acceleration"] = "acceleration"
    force: Band | None = None
    statement: str = ""
    name: str = ""
    parameters: tuple[LawParameter, ...] = ()
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, amplitude=np.float64, beyond=np.float64, weights=np.float64)
