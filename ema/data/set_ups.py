"""Sensor set-ups of a test whose sensors rove: which FRF belongs to which, and how far their modes lie apart."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from ema.data._arrays import freeze
from ema.data._summary import Container

ShiftCause = Literal["none", "common shift", "mass loading", "unknown"]


@dataclass(frozen=True, repr=False)
class SetUps(Container):
    """Which set-up each FRF was measured in.

    Parameters
    ----------
    names : of the set-ups, in the order in which they were measured.
    number : position in ``names``, shape (out, in).
    """

    names: tuple[str, ...]
    number: Int[np.ndarray, "out in"]

    def __post_init__(self) -> None:
        freeze(self, number=np.int64)

    def pick(self, rows: Sequence[int], columns: Sequence[int]) -> "SetUps":
        """Those of some outputs and inputs."""
        return SetUps(self.names, self.number[list(rows)][:, list(columns)])


@dataclass(frozen=True, repr=False, kw_only=True)
class SetUpShifts(Container):
    """Natural frequencies of the set-ups of a test, relative to their mean over the set-ups.

    Parameters
    ----------
    names : of the set-ups.
    frequencies : Hz, means over the set-ups of the modes that several of them show, shape (mode,).
    shifts, std : relative shift of each mode in each set-up and its standard deviation, shape (set-up, mode); NaN where
        a set-up does not show the mode.
    common, common_std : shift of each set-up over all modes, shape (set-up,).
    cause : what explains the shifts: ``none`` beyond the noise, one ``common shift`` of all modes of a set-up (as by
        temperature), ``mass loading`` by roving sensors of one mass (in proportion to the square of the shapes where
        they sit), or ``unknown``.
    mass, mass_std : kg, of one sensor, where they explain the shifts; NaN elsewhere.
    unloaded, unloaded_std : Hz, natural frequencies extrapolated to sensors without mass; NaN without mass loading.
    """

    names: tuple[str, ...]
    frequencies: Float[np.ndarray, "mode"]
    shifts: Float[np.ndarray, "set_up mode"]
    std: Float[np.ndarray, "set_up mode"]
    common: Float[np.ndarray, "set_up"]
    common_std: Float[np.ndarray, "set_up"]
    cause: ShiftCause
    mass: float
    mass_std: float
    unloaded: Float[np.ndarray, "mode"]
    unloaded_std: Float[np.ndarray, "mode"]

    def __post_init__(self) -> None:
        arrays = ("frequencies", "shifts", "std", "common", "common_std", "unloaded", "unloaded_std")
        freeze(self, **dict.fromkeys(arrays, np.float64))
