"""The impacts of a hammer test."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.dof import Dof


@dataclass(frozen=True, repr=False)
class Hit(Container):
    """One impact.

    Parameters
    ----------
    recording : str
        Record that it is in.
    index : int
        Number in the record, from 0, in order of time.
    dof : Dof or None
        Where and in which direction the structure was hit, where known.
    time : float
        Time of the trigger [s] from the start of the record.
    peak : float
        Peak force [N].
    impulse : float
        Impulse [N s].
    contact_time : float
        Contact time [s].
    accepted : bool
        Whether the impact is used.
    reason : str
        What speaks against it; empty where nothing does.
    pulse : array of shape (sample,)
        Force around the impact [N].
    sampling_rate : float
        Sampling rate of ``pulse`` [Hz].

    Examples
    --------
    >>> hit = Hit("impact", 0, Dof(1, "+Z"), 0.25, 100.0, 0.25, 0.004, True, "", [0.0, 100.0], sampling_rate=1024.0)
    >>> hit.peak
    100.0
    """

    recording: str
    index: int
    dof: Dof | None
    time: float
    peak: float
    impulse: float
    contact_time: float
    accepted: bool
    reason: str
    pulse: Float[np.ndarray, "sample"]
    sampling_rate: float

    def __post_init__(self) -> None:
        freeze(self, pulse=np.float64)
        check_axes(self)


@dataclass(frozen=True, repr=False)
class HitGallery(Container):
    """All impacts of a run, and the force spectrum of the accepted ones.

    Parameters
    ----------
    hits : tuple of Hit
        Impacts of all records.
    frequencies : array of shape (freq,)
        Frequency lines of the spectrum [Hz].
    force_spectrum : array of shape (freq,)
        Energy spectral density of the force [N^2 s^2], mean over the accepted impacts.
    usable_band : tuple of (float, float)
        Frequencies [Hz] at which the spectrum has fallen by 10 and by 20 dB.

    Examples
    --------
    >>> hit = Hit("impact", 0, Dof(1, "+Z"), 0.25, 100.0, 0.25, 0.004, False, "double hit", [0.0, 100.0], 1024.0)
    >>> HitGallery((hit,), frequencies=[0.0, 1.0], force_spectrum=[0.06, 0.06], usable_band=(300.0, 400.0)).accepted
    ()
    """

    hits: tuple[Hit, ...]
    frequencies: Float[np.ndarray, "freq"]
    force_spectrum: Float[np.ndarray, "freq"]
    usable_band: tuple[float, float]

    def __post_init__(self) -> None:
        freeze(self, frequencies=np.float64, force_spectrum=np.float64)
        check_axes(self)

    @property
    def accepted(self) -> tuple[Hit, ...]:
        """The impacts that entered the averages."""
        return tuple(hit for hit in self.hits if hit.accepted)
