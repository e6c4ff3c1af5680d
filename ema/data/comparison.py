"""A model compared with a measurement: modes, maps, signals, and the verdict."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.beam import BeamModel
from ema.data.findings import Finding
from ema.data.maps import ModalMap
from ema.dof import Dof

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class Verdict(Container):
    """Whether a model agrees with a measurement, and why.

    Parameters
    ----------
    agrees : bool
        Whether it does.
    sentences : tuple of str
        What was compared, and with which result.

    Examples
    --------
    >>> print(Verdict(True, ("All frequencies within 1 %.",)))
    The model agrees. All frequencies within 1 %.
    """

    agrees: bool
    sentences: tuple[str, ...]

    def __str__(self) -> str:
        return ("The model agrees. " if self.agrees else "The model does not agree. ") + " ".join(self.sentences)


@dataclass(frozen=True, repr=False)
class ModeComparison(Container):
    """Paired modes of a measurement (a) and a model (b).

    Parameters
    ----------
    pairs : tuple of tuple of (int, int)
        (mode of a, mode of b), from 0.
    frequency : array of shape (pair, 2)
        Natural frequencies [Hz] of a and b.
    damping : array of shape (pair, 2)
        Damping ratios [-] of a and b.
    mac : array of shape (pair,)
        MAC of each pair over the shared DOFs.
    significance : array of shape (pair, 2)
        Difference of frequency and of damping over its standard uncertainty; NaN where that is unknown.
    co_mac : array of shape (dof,)
        Coordinate MAC of the shared DOFs.
    dofs : tuple of Dof
        DOFs that both share.
    unpaired : tuple of (tuple of int, tuple of int)
        Modes of a and modes of b without a partner, from 0.
    verdict : Verdict
        Whether the model agrees, and why.
    mac_std : array of shape (pair,), optional
        Standard uncertainty of ``mac``; ``None`` where neither model states one for its shapes.

    Examples
    --------
    >>> from ema.compare import modes
    >>> from ema.examples import modal_model
    >>> comparison = modes(modal_model(), modal_model())
    >>> comparison.pairs, comparison.mac.round(3)
    (((0, 0), (1, 1), (2, 2)), array([1., 1., 1.]))
    """

    pairs: tuple[tuple[int, int], ...]
    frequency: Float[np.ndarray, "pair 2"]
    damping: Float[np.ndarray, "pair 2"]
    mac: Float[np.ndarray, "pair"]
    significance: Float[np.ndarray, "pair 2"]
    co_mac: Float[np.ndarray, "dof"]
    dofs: tuple[Dof, ...]
    unpaired: tuple[tuple[int, ...], tuple[int, ...]]
    verdict: Verdict
    mac_std: Float[np.ndarray, "pair"] | None = None

    def __post_init__(self) -> None:
        names = ("frequency", "damping", "mac", "significance", "co_mac", "mac_std")
        freeze(self, **dict.fromkeys(names, np.float64))
        check_axes(self)

    def table(self) -> "pd.DataFrame":
        """Return the comparison as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per pair: frequencies [Hz], difference [%], damping ratios [%], MAC, and its standard uncertainty
            where known.

        Examples
        --------
        >>> from ema.compare import modes
        >>> from ema.examples import modal_model
        >>> modes(modal_model(), modal_model()).table()["f model [Hz]"].round(3).tolist()
        [40.0, 60.0, 90.0]
        """
        import pandas as pd

        f, z = self.frequency, 100 * self.damping
        columns = {
            "measured": [i + 1 for i, _ in self.pairs],
            "model": [j + 1 for _, j in self.pairs],
            "f measured [Hz]": f[:, 0],
            "f model [Hz]": f[:, 1],
            "df [%]": 100 * (f[:, 1] / f[:, 0] - 1),
            "zeta measured [%]": z[:, 0],
            "zeta model [%]": z[:, 1],
            "MAC": self.mac,
        }
        return pd.DataFrame(columns if self.mac_std is None else columns | {"std MAC": self.mac_std})


@dataclass(frozen=True, repr=False)
class SignalComparison(Container):
    """A simulated signal of one free decay, compared with the measured one.

    Parameters
    ----------
    error : float
        Rms of the difference over the rms of the measured signal.
    peak_frequencies : tuple of (float, float)
        Peak [Hz] of the measured and of the simulated spectrum.
    envelope_error : float
        The same as ``error``, of the envelopes.
    missing_damping : float
        Damping ratio that the model lacks, from the ratio of the envelopes.
    missing_std : float
        Standard uncertainty of ``missing_damping``.
    verdict : Verdict
        Whether the model agrees, and why.

    Examples
    --------
    >>> verdict = Verdict(False, ("The model lacks damping.",))
    >>> SignalComparison(0.2, (40.1, 40.0), 0.1, missing_damping=0.002, missing_std=0.0004, verdict=verdict).error
    0.2
    """

    error: float
    peak_frequencies: tuple[float, float]
    envelope_error: float
    missing_damping: float
    missing_std: float
    verdict: Verdict


@dataclass(frozen=True, repr=False)
class MapComparison(Container):
    """A simulated damping map, compared with a measured one on the points of the latter.

    Parameters
    ----------
    measured : ModalMap
        Measured map.
    simulated : ModalMap
        Simulated map, on the points of the measured one.
    frequency_error : array of shape (level, force)
        Relative difference of the frequencies.
    damping_ratio : array of shape (level, force)
        Simulated over measured damping.
    ridge : array of shape (level, 2)
        Normal force [N] of most damping, measured and simulated.
    inside : float
        Share of points that lie within the 95 % bounds of the measurement, widened by the model's tolerance.
    verdict : Verdict
        Whether the model agrees, and why.

    Examples
    --------
    >>> from ema.compare import maps
    >>> from ema.examples import modal_map
    >>> maps(modal_map(), modal_map()).ridge
    array([[500., 500.],
           [500., 500.]])
    """

    measured: ModalMap
    simulated: ModalMap
    frequency_error: Float[np.ndarray, "level force"]
    damping_ratio: Float[np.ndarray, "level force"]
    ridge: Float[np.ndarray, "level 2"]
    inside: float
    verdict: Verdict

    def __post_init__(self) -> None:
        freeze(self, frequency_error=np.float64, damping_ratio=np.float64, ridge=np.float64)
        check_axes(self)


@dataclass(frozen=True, repr=False)
class ModelUpdate(Container):
    """Joint parameters that make a model fit a measured map, and how well the map determines them.

    Parameters
    ----------
    model : BeamModel
        Updated model.
    names : tuple of str
        Names of the parameters.
    values : array of shape (parameter,)
        Estimates, in the units of the parameters.
    intervals : array of shape (parameter, 2)
        95 % intervals of the estimates.
    identifiable : tuple of bool
        Whether the map bounds each parameter.
    correlation : array of shape (parameter, parameter)
        Correlation between the estimates.
    frequency_ratio : float
        Measured over simulated frequency: an error of the host that the joints are not made to compensate.
    misfit : float
        Rms of the residuals over their standard uncertainties.
    findings : tuple of Finding, optional
        What a reader of the parameters has to know.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> update = ModelUpdate(beam_model(), ("mu",), [0.45], [[0.4, 0.5]], (True,), [[1.0]], 1.01, misfit=1.1)
    >>> update.values
    array([0.45])
    """

    model: BeamModel
    names: tuple[str, ...]
    values: Float[np.ndarray, "parameter"]
    intervals: Float[np.ndarray, "parameter 2"]
    identifiable: tuple[bool, ...]
    correlation: Float[np.ndarray, "parameter parameter"]
    frequency_ratio: float
    misfit: float
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        freeze(self, values=np.float64, intervals=np.float64, correlation=np.float64)
        check_axes(self)

    def table(self) -> "pd.DataFrame":
        """Return the parameters as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per parameter: value, 95 % interval, whether the map identifies it.

        Examples
        --------
        >>> from ema.examples import beam_model
        >>> update = ModelUpdate(beam_model(), ("mu",), [0.45], [[0.4, 0.5]], (True,), [[1.0]], 1.01, misfit=1.1)
        >>> update.table().loc[0, "high"].item()
        0.5
        """
        import pandas as pd

        return pd.DataFrame(
            {
                "parameter": list(self.names),
                "value": self.values,
                "low": self.intervals[:, 0],
                "high": self.intervals[:, 1],
                "identifiable": list(self.identifiable),
            }
        )


@dataclass(frozen=True, repr=False)
class MapPrediction(Container):
    """Frequency and damping of a mode at force levels and normal forces that were not measured, with 95 % bands.

    Parameters
    ----------
    force_levels : array of shape (level,)
        F_E [N].
    normal_forces : array of shape (force,)
        F_N [N] of every joint.
    frequency, frequency_low, frequency_high : array of shape (level, force)
        Predicted natural frequency [Hz] and its band; NaN without a resonance.
    damping, damping_low, damping_high : array of shape (level, force)
        Predicted damping ratio [-] and its band.
    method : {"measured", "frozen"}, default "frozen"
        How the map was obtained that the prediction continues, as in :class:`ModalMap`.
    statement : str, optional
        How far outside the data the prediction lies.
    contains : str, optional
        What is in the bands.
    name : str, optional
        What the map is called in messages.
    findings : tuple of Finding, optional
        What a reader of the prediction has to know.

    Examples
    --------
    >>> frequency, damping = ([[39.5]], [[39.0]], [[40.0]]), ([[0.02]], [[0.01]], [[0.03]])
    >>> MapPrediction([2.0], [500.0], *frequency, *damping).damping_high
    array([[0.03]])
    """

    force_levels: Float[np.ndarray, "level"]
    normal_forces: Float[np.ndarray, "force"]
    frequency: Float[np.ndarray, "level force"]
    frequency_low: Float[np.ndarray, "level force"]
    frequency_high: Float[np.ndarray, "level force"]
    damping: Float[np.ndarray, "level force"]
    damping_low: Float[np.ndarray, "level force"]
    damping_high: Float[np.ndarray, "level force"]
    method: Literal["measured", "frozen"] = "frozen"
    statement: str = ""
    contains: str = ""
    name: str = ""
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        numbers = ("force_levels", "normal_forces")
        values = (f"{name}{end}" for name in ("frequency", "damping") for end in ("", "_low", "_high"))
        freeze(self, **dict.fromkeys((*numbers, *values), np.float64))
        check_axes(self)
