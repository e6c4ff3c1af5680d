"""What a beam is predicted to do before it is mounted, and what was measured afterwards."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.findings import Finding
from ema.data.provenance import Provenance
from ema.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class Forecast(Container):
    """Frequency and damping of the target modes over (F_E, F_N), predicted before the beam is mounted, with 95 % bands.

    Parameters
    ----------
    centre : tuple of (float, float)
        Centre of the beam [m] in the plane of the placement.
    angle : float
        Angle of the beam [rad] from the first axis of the plane.
    beam : str
        Name of the beam.
    modes : tuple of int
        Numbers of the target modes in the structure without the beam, from 1.
    bare_frequencies : array of shape (mode,)
        Natural frequencies [Hz] without the beam.
    bare_damping : array of shape (mode,)
        Damping ratios [-] without the beam.
    force_levels : array of shape (level,)
        F_E [N].
    normal_forces : array of shape (force,)
        F_N per joint [N].
    frequency : array of shape (mode, level, force)
        Predicted frequencies [Hz]: nominal ones, or medians of the draws where the form of the law is open.
    frequency_low, frequency_high : array of shape (mode, level, force)
        Bounds of their 95 % bands [Hz].
    damping : array of shape (mode, level, force)
        Predicted damping ratios [-], likewise.
    damping_low, damping_high : array of shape (mode, level, force)
        Bounds of their 95 % bands [-].
    draws : int
        Samples behind the bands.
    method : str, default "measured"
        As in ``ModalMap``: ``measured`` is what a one-mode fit of a stepped sine about the resonance reads, ``frozen``
        the equivalent damping of the steady state at resonance.
    sources : tuple of str, optional
        What the bands come from; nothing where too few draws tell it.
    frequency_shares, damping_shares : array of shape (mode, source), optional
        Share of each source in the variance of the logarithm of frequency and damping ratio.
    findings : tuple of Finding, optional
        What a reader of the forecast has to know.
    provenance : Provenance, optional
        Inputs, versions and options behind the forecast.

    Raises
    ------
    InputError
        If an array has another shape than the axes.

    Examples
    --------
    >>> from ema.examples import forecast
    >>> prediction = forecast()
    >>> prediction.frequency.shape, prediction.normal_forces
    ((1, 2, 3), array([ 200.,  500., 1000.]))
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
    sources: tuple[str, ...] = ()
    frequency_shares: Float[np.ndarray, "mode source"] | None = None
    damping_shares: Float[np.ndarray, "mode source"] | None = None
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
        freeze(self, **dict.fromkeys((*arrays, "frequency_shares", "damping_shares"), np.float64))
        check_axes(self)
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
        """Return the forecast as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per mode and condition: frequency [Hz] and damping ratio [%] with their bands.

        Examples
        --------
        >>> from ema.examples import forecast
        >>> table = forecast().table()
        >>> len(table), table.columns[3]
        (6, 'f [Hz]')
        """
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

    def budget(self) -> "pd.DataFrame":
        """Return what the bands come from as a table of pandas, what widens those of the damping most first.

        Were a source of the share s known, a band would keep sqrt(1 - s) of its width.

        Returns
        -------
        pandas.DataFrame
            One row per source: its share [%] of the variance of the logarithm of frequency and damping of every mode;
            no row where too few draws tell it.

        Examples
        --------
        >>> from ema.examples import forecast
        >>> forecast().budget().iloc[0].map(str).tolist()
        ['friction coefficient', '20.0', '70.0']
        """
        import pandas as pd

        names = [name for mode in self.modes for name in (f"mode {mode}: f [%]", f"mode {mode}: zeta [%]")]
        if self.frequency_shares is None or self.damping_shares is None or not self.sources:
            return pd.DataFrame(columns=["source", *names])
        both = 100 * np.stack([self.frequency_shares, self.damping_shares], axis=1)
        order = np.argsort(-self.damping_shares.mean(axis=0), kind="stable")
        rows = [(self.sources[row], *both[:, :, row].ravel()) for row in order]
        return pd.DataFrame(rows, columns=["source", *names])


@dataclass(frozen=True, repr=False)
class ForecastCheck(Container):
    """A forecast compared with measured maps; NaN where nothing was measured.

    Parameters
    ----------
    forecast : Forecast
        The forecast.
    measured_frequency : array of shape (mode, level, force)
        Measured frequencies [Hz] on the grid of the forecast.
    measured_damping : array of shape (mode, level, force)
        Measured damping ratios [-] on the grid of the forecast.
    maps : tuple of str, optional
        Name of the map of each compared mode.

    Examples
    --------
    >>> from ema.examples import forecast
    >>> prediction = forecast()
    >>> check = ForecastCheck(prediction, prediction.frequency, 1.5 * prediction.damping)
    >>> check.inside, check.values
    (6, 12)
    """

    forecast: Forecast
    measured_frequency: Float[np.ndarray, "mode level force"]
    measured_damping: Float[np.ndarray, "mode level force"]
    maps: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, measured_frequency=np.float64, measured_damping=np.float64)
        check_axes(self)

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
