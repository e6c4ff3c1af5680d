"""A mode over its amplitude, and the stepped levels that it is measured with."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from ema.data._arrays import check_axes, freeze
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
    """Values with an interval each, all of one shape.

    Parameters
    ----------
    low, value, high : array
        Lower bounds, values and upper bounds; ``low <= value <= high`` wherever all three are finite.
    level : float, default 0.95
        Probability that the interval is stated with.
    contains : str, optional
        What is in the interval: noise, scatter, model form.

    Raises
    ------
    InputError
        If a value lies outside its interval.

    Examples
    --------
    >>> band = Band(low=[79.9], value=[80.0], high=[80.1], contains="noise")
    >>> band.half_width
    array([0.1])
    """

    low: Float[np.ndarray, "*shape"]
    value: Float[np.ndarray, "*shape"]
    high: Float[np.ndarray, "*shape"]
    level: float = 0.95
    contains: str = ""

    def __post_init__(self) -> None:
        freeze(self, low=np.float64, value=np.float64, high=np.float64)
        check_axes(self)
        known = np.isfinite(self.low) & np.isfinite(self.value) & np.isfinite(self.high)
        if np.any(self.low[known] > self.value[known]) or np.any(self.value[known] > self.high[known]):
            raise InputError("an interval that does not hold its value", expected="low <= value <= high")

    @property
    def half_width(self) -> Float[np.ndarray, "*shape"]:
        """Half of the distance between the bounds."""
        return np.asarray(0.5 * (self.high - self.low))

    @property
    def std(self) -> Float[np.ndarray, "*shape"]:
        """Standard deviation of a Gaussian with an interval of this width."""
        from statistics import NormalDist

        return self.half_width / NormalDist().inv_cdf(0.5 + 0.5 * self.level)


@dataclass(frozen=True, repr=False)
class SteppedLevel(Container):
    """One level of a stepped sine: what was controlled, and the fundamentals at every frequency.

    Parameters
    ----------
    frequencies : array of shape (line,)
        Frequencies of the steps [Hz].
    force : array of shape (line,)
        Amplitude of the force [N].
    response : complex array of shape (line,)
        Complex amplitude of the response in SI units of ``quantity``, its phase relative to the force.
    quantity : {"displacement", "velocity", "acceleration"}
        What ``response`` is.
    control : {"response", "force", "none"}, default "none"
        What was kept constant over the frequencies.
    output, input : Dof, optional
        DOFs of response and force, where known.
    harmonics : array of shape (order, line), optional
        Amplitudes of the response at 2, 3, ... times the frequency; ``None`` where they were not recorded.
    name : str, optional
        What the level is called in messages.

    Examples
    --------
    >>> level = SteppedLevel(frequencies=[39.0, 40.0], force=[1, 1], response=[5 + 1j, 9j], quantity="acceleration")
    >>> np.abs(level.displacement).round(8)
    array([8.4920e-05, 1.4248e-04])
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
        check_axes(self)

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
    amplitude : array of shape (level,)
        Amplitude of the response at resonance in SI units of ``quantity``; positive and rising.
    frequency : Band
        Natural frequency [Hz] at each amplitude.
    damping : Band
        Equivalent viscous damping ratio [-] at each amplitude: mean power over omega^3 q^2.
    quantity : {"displacement", "velocity", "acceleration"}, default "acceleration"
        What ``amplitude`` measures.
    force : array of shape (level,), optional
        Amplitude of the force at resonance [N]; NaN where there was none.
    modal_mass : float, optional
        Modal mass [kg] for a shape of 1 at the response; NaN where it is not known.
    control : {"response", "force", "none"}, default "none"
        What was kept constant while the levels were measured; ``none`` for a ring-down.
    condition : Condition, optional
        Excitation and normal forces of the measurement.
    name : str, optional
        What the mode is called in messages.
    findings : tuple of Finding, optional
        What a reader of the values has to know.
    provenance : Provenance, optional
        Inputs, versions and options behind the mode.
    dofs : tuple of Dof, optional
        DOFs of the shape: those of the responses.
    shape : complex array of shape (dof, level), optional
        Shape at each amplitude, 1 at the response to which the amplitudes belong.
    shape_half : array of shape (dof, level), optional
        Half widths of the 95 % intervals of real and imaginary part of ``shape``, the larger of both.

    Raises
    ------
    InputError
        If the fields differ in length, or the amplitudes are not positive and rising.

    References
    ----------
    .. [1] Damping by power: Scheel, Peter, Leine and Krack (2018), Journal of Sound and Vibration 435:56.
    .. [2] Control of the response: Arslan, Aykan and Ozguven (2011).

    Examples
    --------
    >>> frequency = Band(low=[39.9, 39.7], value=[40.0, 39.8], high=[40.1, 39.9])
    >>> damping = Band(low=[0.009, 0.011], value=[0.010, 0.012], high=[0.011, 0.013])
    >>> mode = AmplitudeDependentMode(amplitude=[1.0, 5.0], frequency=frequency, damping=damping)
    >>> mode.lowest(1).amplitude
    array([1.])
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
    dofs: tuple[Dof, ...] = ()
    shape: Complex[np.ndarray, "dof level"] | None = None
    shape_half: Float[np.ndarray, "dof level"] | None = None

    def __post_init__(self) -> None:
        freeze(self, amplitude=np.float64, force=np.float64, shape=np.complex128, shape_half=np.float64)
        check_axes(self)
        if not len(self.amplitude) == len(self.frequency.value) == len(self.damping.value):
            raise InputError(
                "amplitudes, frequencies and damping ratios of unequal number",
                where=self.name,
                got=f"{len(self.amplitude)}, {len(self.frequency.value)} and {len(self.damping.value)}",
                expected="as many of each",
            )
        if np.any(np.diff(self.amplitude) <= 0) or not np.all(self.amplitude > 0):
            raise InputError("amplitudes that do not rise", where=self.name, expected="positive, lowest first")

    def lowest(self, count: int) -> "AmplitudeDependentMode":
        """Return the mode with its lowest levels only.

        Parameters
        ----------
        count : int
            Number of levels to keep.

        Returns
        -------
        AmplitudeDependentMode
            The mode on the first ``count`` levels.

        Examples
        --------
        >>> band = Band(low=[1.0, 1.0], value=[1.0, 1.0], high=[1.0, 1.0])
        >>> AmplitudeDependentMode(amplitude=[1.0, 5.0], frequency=band, damping=band).lowest(1).damping.value
        array([1.])
        """
        from dataclasses import replace

        def cut(band: Band) -> Band:
            return Band(band.low[:count], band.value[:count], band.high[:count], band.level, band.contains)

        return replace(
            self,
            amplitude=self.amplitude[:count],
            frequency=cut(self.frequency),
            damping=cut(self.damping),
            force=None if self.force is None else self.force[:count],
            shape=None if self.shape is None else self.shape[:, :count],
            shape_half=None if self.shape_half is None else self.shape_half[:, :count],
        )

    def mac(self) -> Float[np.ndarray, "level"]:
        """Return the MAC of the shape at each amplitude with that at the lowest one.

        Returns
        -------
        array of shape (level,)
            MAC; NaN without shapes.

        Examples
        --------
        >>> band = Band(low=[0.01, 0.01], value=[0.01, 0.01], high=[0.01, 0.01])
        >>> frequency = Band(low=[40.0, 39.0], value=[40.0, 39.0], high=[40.0, 39.0])
        >>> dofs = (Dof(1, "+Z"), Dof(2, "+Z"))
        >>> AmplitudeDependentMode([1.0, 2.0], frequency, band, dofs=dofs, shape=[[1, 1], [1, 0.5]]).mac()
        array([1. , 0.9])
        """
        if self.shape is None:
            return np.full(len(self.amplitude), np.nan)
        size = np.sum(np.abs(self.shape) ** 2, axis=0)
        return np.asarray(np.abs(self.shape[:, 0].conj() @ self.shape) ** 2 / (size[0] * size))


@dataclass(frozen=True, repr=False)
class LawParameter(Container):
    """A parameter of a joint law with its 95 % interval, and whether the measured levels identify it.

    Parameters
    ----------
    law : str
        Name of the law.
    name : str
        Name of the parameter.
    low, value, high : float
        Lower bound of the 95 % interval, median, upper bound.
    identifiable : bool
        Whether the measured levels bound it. That they do confirms no prediction.
    reason : str, optional
        Why the levels do not identify it; empty where they do.

    Examples
    --------
    >>> LawParameter("iwan", "mu", low=0.3, value=0.4, high=0.55, identifiable=True).value
    0.4
    """

    law: str
    name: str
    low: float
    value: float
    high: float
    identifiable: bool
    reason: str = ""

    def __post_init__(self) -> None:
        if self.low > self.value or self.value > self.high:  # NaN, where a bound is unknown, is in order
            raise InputError(
                "an interval that does not hold its value",
                where=f"{self.law}, {self.name}",
                got=f"{self.low:g}, {self.value:g}, {self.high:g}",
                expected="low <= value <= high",
            )


@dataclass(frozen=True, repr=False)
class AmplitudePrediction(Container):
    """Frequency and damping of a mode at amplitudes that were not measured, with 95 % bands.

    Parameters
    ----------
    amplitude : array of shape (point,)
        Amplitudes of the response in SI units of ``quantity``.
    frequency : Band
        Predicted natural frequency [Hz].
    damping : Band
        Predicted damping ratio [-].
    beyond : array of shape (point,)
        Each amplitude over the highest measured one.
    laws : tuple of str
        Joint laws that were fitted.
    weights : array of shape (law,)
        Weight of each law, by its prediction of the highest levels left out.
    quantity : {"displacement", "velocity", "acceleration"}, default "acceleration"
        What ``amplitude`` measures.
    force : Band, optional
        Amplitude of the force [N] that keeps up the amplitude at resonance, where known.
    statement : str, optional
        How far outside the data the prediction lies.
    name : str, optional
        What the mode is called in messages.
    parameters : tuple of LawParameter, optional
        Parameters of the law of most weight.
    findings : tuple of Finding, optional
        What a reader of the prediction has to know.

    Examples
    --------
    >>> band = Band(low=[0.01], value=[0.02], high=[0.03])
    >>> frequency = Band(low=[39.0], value=[39.5], high=[40.0])
    >>> AmplitudePrediction([10.0], frequency, band, beyond=[2.0], laws=("iwan",), weights=[1.0]).beyond
    array([2.])
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
        check_axes(self)
