"""Sensor set-ups of a test whose sensors rove: which FRF belongs to which, and how far their modes lie apart."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container

ShiftCause = Literal["none", "common shift", "mass loading", "unknown"]


@dataclass(frozen=True, repr=False)
class SetUps(Container):
    """Which set-up each FRF was measured in.

    Parameters
    ----------
    names : tuple of str
        Names of the set-ups, in the order in which they were measured.
    number : integer array of shape (out, in)
        Position in ``names``.

    Examples
    --------
    >>> SetUps(("A", "B"), [[0], [0], [1]]).number.shape
    (3, 1)
    """

    names: tuple[str, ...]
    number: Int[np.ndarray, "out in"]

    def __post_init__(self) -> None:
        freeze(self, number=np.int64)
        check_axes(self)

    def pick(self, rows: Sequence[int], columns: Sequence[int]) -> "SetUps":
        """Return the set-ups of some outputs and inputs.

        Parameters
        ----------
        rows : sequence of int
            Positions of the outputs, from 0.
        columns : sequence of int
            Positions of the inputs, from 0.

        Returns
        -------
        SetUps
            The set-ups of those FRFs.

        Examples
        --------
        >>> SetUps(("A", "B"), [[0], [0], [1]]).pick([2], [0]).number
        array([[1]])
        """
        return SetUps(self.names, self.number[list(rows)][:, list(columns)])


@dataclass(frozen=True, repr=False, kw_only=True)
class SetUpShifts(Container):
    """Natural frequencies of the set-ups of a test, relative to their mean over the set-ups.

    Parameters
    ----------
    names : tuple of str
        Names of the set-ups.
    frequencies : array of shape (mode,)
        Means over the set-ups [Hz] of the modes that several of them show.
    shifts : array of shape (set_up, mode)
        Relative shift of each mode in each set-up; NaN where a set-up does not show the mode.
    std : array of shape (set_up, mode)
        Standard deviation of ``shifts``.
    common : array of shape (set_up,)
        Relative shift of each set-up over all modes.
    common_std : array of shape (set_up,)
        Standard deviation of ``common``.
    cause : {"none", "common shift", "mass loading", "unknown"}
        What explains the shifts: ``none`` beyond the noise, one ``common shift`` of all modes of a set-up (as by
        temperature), ``mass loading`` by roving sensors of one mass (in proportion to the square of the shapes where
        they sit), or ``unknown``.
    mass : float
        Mass of one sensor [kg], where it explains the shifts; NaN elsewhere.
    mass_std : float
        Standard deviation of ``mass`` [kg].
    unloaded : array of shape (mode,)
        Natural frequencies extrapolated to sensors without mass [Hz]; NaN without mass loading.
    unloaded_std : array of shape (mode,)
        Standard deviation of ``unloaded`` [Hz].

    Examples
    --------
    >>> shifts = SetUpShifts(
    ...     names=("A", "B"), frequencies=[40.0], shifts=[[1e-3], [-1e-3]], std=[[1e-4], [1e-4]], common=[1e-3, -1e-3],
    ...     common_std=[1e-4, 1e-4], cause="common shift", mass=np.nan, mass_std=np.nan, unloaded=[np.nan],
    ...     unloaded_std=[np.nan],
    ... )
    >>> shifts.cause
    'common shift'
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
        check_axes(self)
