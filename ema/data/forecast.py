"""What a placed beam is expected to do, told before it is bolted on, and what was measured afterwards."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ema.data._arrays import freeze
from ema.data._summary import Container
from ema.data.findings import Finding
from ema.data.provenance import Provenance
from ema.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class Forecast(Container):
    """Frequency Hz and damping of the target modes over (F_E, F_N) with 95 % bands, shape (mode, level, force).

    Parameters
    ----------
    centre : of the beam in m, in the plane of the placement; ``angle`` rad, ``beam`` its name.
    modes : numbers of the target modes in the bare structure, from 1; ``bare_frequencies`` Hz, ``bare_damping``.
    force_levels, normal_forces : N; F_N per joint.
    draws : samples behind the bands.
    method : as in ``ModalMap``: "measured" is what a one-mode fit of a stepped sine about the resonance reads, "frozen"
        the equivalent damping of the steady state at resonance.
    """

    centre: tuple[float, float]
    angle: float
    beam: str
    modes: tuple[int, ...]
    bare_frequencies: Float[np.ndarray, "mode"]
    bare_damping: Float[np.ndarray, "mode"]
    force_levels: Float[np.ndarray, "level"]
    normal_forces: Float[np.ndarray, "force"]
    frequency: Float[np.ndarray, "mode level force"]
    frequency_low: Float[np.ndarray, "mode level force"]
    frequency_high: Float[np.ndarray, "mode level force"]
    damping: Float[np.ndarray, "mode level force"]
    damping_low: Float[np.ndarray, "mode level force"]
    damping_high: Float[np.ndarray, "mode level force"]
    draws: int
    method: str = "measured"
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    provenance: Provenance = field(default=Provenance(), compare=False)

    def __post_init__(self) -> None:
        arrays = (
            "bare_frequencies",
            "bare_damping",
            "force_levels",
            "normal_forces",
            "frequency",
            "frequency_low",
            "frequency_high",
            "damping",
            "damping_low",
            "damping_high",
        )
        freeze(self, **dict.fromkeys(arrays, np.float64))
        shape = (len(self.modes), len(self.force_levels), len(self.normal_forces))
        for name in arrays[4:]:
            if getattr(self, name).shape != shape:
                raise InputError(
                    "the forecast has another shape than its axes",
                    where=name,
                    got=getattr(self, name).shape,
                    expected=shape,
                )

    def table(self) -> "pd.DataFrame":
        """One row per mode and condition, damping in percent."""
        import pandas as pd

        rows = []
        for m, mode in enumerate(self.modes):
            for force, normal in enumerate(self.normal_forces):
                for level, drive in enumerate(self.force_levels):
                    at = (m, level, force)
                    rows.append(
                        (
                            mode,
                            drive,
                            normal,
                            self.frequency[at],
                            self.frequency_low[at],
                            self.frequency_high[at],
                            100 * self.damping[at],
                            100 * self.damping_low[at],
                            100 * self.damping_high[at],
                        )
                    )
        names = ["mode", "F_E [N]", "F_N [N]", "f [Hz]", "f low", "f high", "zeta [%]", "zeta low", "zeta high"]
        return pd.DataFrame(rows, columns=names)


@dataclass(frozen=True, repr=False)
class ForecastCheck(Container):
    """A forecast held against measured maps: ``(mode, level, force)`` arrays, NaN where nothing was measured.

    ``measured_frequency`` Hz and ``measured_damping``; ``inside`` counts the values within their band, of ``values``.
    """

    forecast: Forecast
    measured_frequency: Float[np.ndarray, "mode level force"]
    measured_damping: Float[np.ndarray, "mode level force"]
    maps: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, measured_frequency=np.float64, measured_damping=np.float64)

    @property
    def frequency_inside(self) -> np.ndarray:
        """Whether each measured frequency lies within its band."""
        return _within(self.measured_frequency, self.forecast.frequency_low, self.forecast.frequency_high)

    @property
    def damping_inside(self) -> np.ndarray:
        """Whether each measured damping lies within its band."""
        return _within(self.measured_damping, self.forecast.damping_low, self.forecast.damping_high)

    @property
    def inside(self) -> int:
        """Values within their bands."""
        return int(self.frequency_inside.sum() + self.damping_inside.sum())

    @property
    def values(self) -> int:
        """Measured values."""
        return int(np.isfinite(self.measured_frequency).sum() + np.isfinite(self.measured_damping).sum())


def _within(value: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.asarray((value >= low) & (value <= high))
