"""A model held against a measurement: modes, maps, signals, and the verdict."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ema.data._arrays import freeze
from ema.data._summary import Container
from ema.data.beam import BeamModel
from ema.data.findings import Finding
from ema.data.maps import ModalMap
from ema.dof import Dof

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class Verdict(Container):
    """Whether a model agrees with a measurement, and why, in sentences."""

    agrees: bool
    sentences: tuple[str, ...]

    def __str__(self) -> str:
        return ("The model agrees. " if self.agrees else "The model does not agree. ") + " ".join(self.sentences)


@dataclass(frozen=True, repr=False)
class ModeComparison(Container):
    """Paired modes of a measurement (a) and a model (b).

    ``pairs`` (mode of a, mode of b), from 0; over the pairs: ``frequency`` (pair, 2) Hz, ``damping`` (pair, 2),
    ``mac`` (pair,) and ``significance`` (pair, 2): the difference of frequency and damping over its standard
    uncertainty, NaN where that is unknown. ``co_mac`` (dof,) over the shared ``dofs``; ``unpaired`` modes of a and b.
    ``mac_std`` (pair,) is the standard uncertainty of ``mac``, ``None`` where neither model states one for its shapes.
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

    def table(self) -> "pd.DataFrame":
        """One row per pair: frequencies [Hz], difference [%], damping ratios [%], MAC."""
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
    """A simulated against a measured signal of one free decay.

    ``error`` rms of the difference over the rms of the measured signal; ``peak_frequencies`` Hz of measured and
    simulated spectrum; ``envelope_error`` the same as ``error`` of the envelopes; ``missing_damping`` the damping ratio
    the model lacks (its standard uncertainty in ``missing_std``), from the ratio of the envelopes.
    """

    error: float
    peak_frequencies: tuple[float, float]
    envelope_error: float
    missing_damping: float
    missing_std: float
    verdict: Verdict


@dataclass(frozen=True, repr=False)
class MapComparison(Container):
    """A simulated against a measured damping map, on the points of the measured one.

    ``frequency_error`` (level, force) relative, ``damping_ratio`` (level, force) simulated over measured;
    ``ridge`` (level, 2): normal force of most damping, measured and simulated, N; ``inside`` the share of points that
    lie within the 95 % bounds of the measurement widened by the model's tolerance.
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


@dataclass(frozen=True, repr=False)
class ModelUpdate(Container):
    """Joint parameters that make a model fit a measured map, and how well the map tells them.

    ``names`` of the parameters; ``values`` and ``intervals`` (95 %) in their units; ``identifiable`` says of each
    whether the map bounds it; ``correlation`` between their estimates. ``frequency_ratio`` is measured over simulated,
    a fault of the host that the joints are not asked to mend; ``misfit`` the rms of the residuals over the standard
    uncertainties.
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

    def table(self) -> "pd.DataFrame":
        """One row per parameter: value, 95 % interval, whether the map tells it."""
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
