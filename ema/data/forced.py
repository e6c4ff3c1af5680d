"""A mode under a force that was not measured: draws over the amplitude, the force surface, resonances and responses."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.amplitude import Band
from ema.data.findings import Finding
from ema.errors import InputError

Motion = Literal["displacement", "velocity", "acceleration"]
"""What the amplitude of a response measures."""


@dataclass(frozen=True, repr=False)
class AmplitudeDraws(Container):
    """Draws of the frequency and damping of one mode over its amplitude, from the posterior predictive distribution.

    Parameters
    ----------
    amplitude : array of shape (point,)
        Amplitudes of the response at resonance in SI units of ``quantity``; positive and rising.
    frequency : array of shape (draw, point)
        Natural frequency [Hz] of each draw.
    damping : array of shape (draw, point)
        Damping ratio [-] of each draw: mean power over omega^3 q^2.
    levels : array of shape (level,)
        Amplitudes of the measured levels that the draws rest on, lowest first.
    modal_mass : array of shape (draw,), optional
        Modal mass [kg] of each draw for a shape of 1 at the response, force over response; None where not known.
    quantity : {"displacement", "velocity", "acceleration"}, default "acceleration"
        What ``amplitude`` measures.
    smooth_over : float, default 0
        Distance in log amplitude over which a draw is smooth where its slope counts, as for folds; below it draws are
        as rough as the process of their model error. 0 for draws that are smooth.
    laws : tuple of str, optional
        Joint laws behind the draws.
    weights : array of shape (law,), optional
        Weight of each law, by its prediction of the highest levels left out.
    contains : str, optional
        What the spread of the draws holds.
    name : str, optional
        What the mode is called in messages.
    findings : tuple of Finding, optional
        What a reader of the draws has to know.

    Raises
    ------
    InputError
        If the amplitudes are not positive and rising, or a frequency or damping ratio is not positive.

    Examples
    --------
    >>> draws = AmplitudeDraws([1.0, 2.0], [[40.0, 39.0]], [[0.01, 0.02]], levels=[1.0, 1.5], modal_mass=[2.0])
    >>> draws.frequency.shape
    (1, 2)
    """

    amplitude: Float[np.ndarray, "point"]
    frequency: Float[np.ndarray, "draw point"]
    damping: Float[np.ndarray, "draw point"]
    levels: Float[np.ndarray, "level"]
    modal_mass: Float[np.ndarray, "draw"] | None = None
    quantity: Motion = "acceleration"
    smooth_over: float = 0.0
    laws: tuple[str, ...] = ()
    weights: Float[np.ndarray, "law"] | None = None
    contains: str = ""
    name: str = ""
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        floats = dict.fromkeys(("amplitude", "frequency", "damping", "levels", "modal_mass", "weights"), np.float64)
        freeze(self, **floats)
        check_axes(self)
        if len(self.amplitude) < 2 or np.any(np.diff(self.amplitude) <= 0) or not np.all(self.amplitude > 0):
            raise InputError("amplitudes that do not rise", where=self.name, expected="two or more, lowest first")
        if not (np.all(self.frequency > 0) and np.all(self.damping > 0) and len(self.levels)):
            raise InputError(
                "draws without a frequency, a loss or a level",
                where=self.name,
                expected="positive frequencies and damping ratios, and the levels behind them",
            )


@dataclass(frozen=True, repr=False)
class ForceSurface(Container):
    """Force that keeps up an amplitude at a frequency, with 95 % bands: cuts at constant force are response curves.

    Parameters
    ----------
    frequencies : array of shape (line,)
        Excitation frequencies [Hz].
    amplitude : array of shape (point,)
        Amplitudes of the response in SI units of ``quantity``.
    force : Band
        Amplitude of the force [N], of shape (point, line); NaN beyond the range of the draws.
    beyond : array of shape (point,)
        Each amplitude over the highest measured one.
    quantity : {"displacement", "velocity", "acceleration"}, default "acceleration"
        What ``amplitude`` measures.
    statement : str, optional
        How far outside the data the surface lies.
    name : str, optional
        What the mode is called in messages.
    findings : tuple of Finding, optional
        What a reader of the surface has to know.

    Examples
    --------
    >>> force = Band(low=[[0.9]], value=[[1.0]], high=[[1.1]])
    >>> ForceSurface([40.0], [2.0], force, beyond=[0.5]).force.value
    array([[1.]])
    """

    frequencies: Float[np.ndarray, "line"]
    amplitude: Float[np.ndarray, "point"]
    force: Band
    beyond: Float[np.ndarray, "point"]
    quantity: Motion = "acceleration"
    statement: str = ""
    name: str = ""
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, frequencies=np.float64, amplitude=np.float64, beyond=np.float64)
        check_axes(self)
        if self.force.value.shape != (len(self.amplitude), len(self.frequencies)):
            raise InputError(
                "a force surface of another shape than its axes",
                where=self.name,
                got=self.force.value.shape,
                expected=f"({len(self.amplitude)}, {len(self.frequencies)}), (point, line)",
            )


@dataclass(frozen=True, repr=False)
class ForcedResonances(Container):
    """Phase resonance of a mode under forces that were not measured, with 95 % bands.

    Parameters
    ----------
    force : array of shape (force,)
        Amplitude of the force [N].
    amplitude : Band
        Amplitude of the response at resonance in SI units of ``quantity``; an upper bound is infinite where the draws
        end below it.
    frequency : Band
        Frequency [Hz] at which force and displacement are in quadrature.
    damping : Band
        Damping ratio [-] there.
    beyond : array of shape (force,)
        Each amplitude over the highest measured one.
    several : array of shape (force,)
        Share of the draws with more than one resonance at the force; the lowest one counts, which the response reaches
        when the force grows from nothing.
    quantity : {"displacement", "velocity", "acceleration"}, default "acceleration"
        What ``amplitude`` measures.
    statement : str, optional
        How far outside the data the resonances lie.
    name : str, optional
        What the mode is called in messages.
    findings : tuple of Finding, optional
        What a reader of the prediction has to know.

    Examples
    --------
    >>> amplitude, frequency = Band([9.0], [10.0], [11.0]), Band([39.0], [39.5], [40.0])
    >>> damping = Band([0.01], [0.02], [0.03])
    >>> ForcedResonances([0.5], amplitude, frequency, damping, beyond=[2.0], several=[0.0]).force
    array([0.5])
    """

    force: Float[np.ndarray, "force"]
    amplitude: Band
    frequency: Band
    damping: Band
    beyond: Float[np.ndarray, "force"]
    several: Float[np.ndarray, "force"]
    quantity: Motion = "acceleration"
    statement: str = ""
    name: str = ""
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, force=np.float64, beyond=np.float64, several=np.float64)
        check_axes(self)


@dataclass(frozen=True, repr=False)
class ForcedResponse(Container):
    """Response of a mode to a force over the frequency, swept up and down, with 95 % bands.

    Parameters
    ----------
    frequencies : array of shape (line,)
        Excitation frequencies [Hz], rising.
    force : array of shape (line,)
        Amplitude of the force [N] at each.
    up, down : Band
        Amplitude of the response in SI units of ``quantity`` while the frequency rises from the first line, and while
        it falls from the last; an upper bound is infinite where the draws end below it.
    phase_up, phase_down : Band
        Phase [rad] of the response against the force.
    solutions : array of shape (line,)
        Number of responses, stable or not, that the medians of frequency and damping allow: 3 where the curve folds.
    curve_frequencies, curve_amplitudes : array of shape (point,)
        All responses at constant force of the medians, folded ones too, along the curve; NaN between separate curves.
        Empty where the force is not constant.
    folded : float, optional
        Share of the draws with several stable responses at a line.
    highest_level : float, optional
        Highest measured amplitude that the prediction rests on, in SI units of ``quantity``.
    quantity : {"displacement", "velocity", "acceleration"}, default "acceleration"
        What the amplitudes measure.
    name : str, optional
        What the mode is called in messages.
    findings : tuple of Finding, optional
        What a reader of the prediction has to know.

    Examples
    --------
    >>> band = Band(low=[0.9], value=[1.0], high=[1.1])
    >>> phase = Band(low=[1.5], value=[1.6], high=[1.7])
    >>> ForcedResponse([40.0], [2.0], band, band, phase, phase, solutions=[1]).frf("up").round(3)
    array([-0.015+0.5j])
    """

    frequencies: Float[np.ndarray, "line"]
    force: Float[np.ndarray, "line"]
    up: Band
    down: Band
    phase_up: Band
    phase_down: Band
    solutions: Int[np.ndarray, "line"]
    curve_frequencies: Float[np.ndarray, "point"] = field(default_factory=lambda: np.zeros(0))
    curve_amplitudes: Float[np.ndarray, "point"] = field(default_factory=lambda: np.zeros(0))
    folded: float = 0.0
    highest_level: float = float("nan")
    quantity: Motion = "acceleration"
    name: str = ""
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, frequencies=np.float64, force=np.float64, curve_frequencies=np.float64)
        freeze(self, curve_amplitudes=np.float64, solutions=np.int64)
        check_axes(self)
        if np.any(np.diff(self.frequencies) <= 0):
            raise InputError("frequencies that do not rise", where=self.name, expected="each above the one before")

    def frf(self, sweep: Literal["up", "down"] = "up") -> np.ndarray:
        """Return response over force [SI unit of the quantity per N], from the medians of amplitude and phase.

        Parameters
        ----------
        sweep : {"up", "down"}, default "up"
            While the frequency rises, or falls.

        Returns
        -------
        complex array of shape (line,)
            Frequency response function at this force.

        Examples
        --------
        >>> band, phase = Band(low=[0.9], value=[1.0], high=[1.1]), Band(low=[0.0], value=[0.0], high=[0.0])
        >>> ForcedResponse([40.0], [2.0], band, band, phase, phase, solutions=[1]).frf("down")
        array([0.5+0.j])
        """
        size, phase = (self.up, self.phase_up) if sweep == "up" else (self.down, self.phase_down)
        return np.asarray(size.value * np.exp(1j * phase.value) / self.force)
