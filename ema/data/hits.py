"""The impacts of a hammer test."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data._arrays import freeze
from ema.data._summary import Container
from ema.dof import Dof


@dataclass(frozen=True, repr=False)
class Hit(Container):
    """One impact.

    ``recording`` and ``index`` (from 0, in order of time) say which; ``dof`` is where and in which direction; ``time``
    of the trigger in s from the start of the record; ``peak`` N, ``impulse`` N s, ``contact_time`` s; ``accepted``
    where it is used, with the ``reason`` that speaks against it; ``pulse`` (sample,) the force around the impact in N
    at ``sampling_rate`` Hz.
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


@dataclass(frozen=True, repr=False)
class HitGallery(Container):
    """All impacts of a run and the force autospectrum of the accepted ones.

    ``force_spectrum`` (freq,) N^2 s^2 (energy spectral density, mean over accepted impacts) at ``frequencies`` Hz;
    ``usable_band`` are the frequencies in Hz at which it has fallen by 10 and by 20 dB.
    """

    hits: tuple[Hit, ...]
    frequencies: Float[np.ndarray, "freq"]
    force_spectrum: Float[np.ndarray, "freq"]
    usable_band: tuple[float, float]

    def __post_init__(self) -> None:
        freeze(self, frequencies=np.float64, force_spectrum=np.float64)

    @property
    def accepted(self) -> tuple[Hit, ...]:
        """The impacts that entered the averages."""
        return tuple(hit for hit in self.hits if hit.accepted)
