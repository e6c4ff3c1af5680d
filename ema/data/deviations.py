"""What the single impacts or blocks of a test change in its averaged FRFs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.window import Window

if TYPE_CHECKING:
    DeviationValues = Complex[np.ndarray, "blow freq out in"]
else:
    DeviationValues = Complex[np.ndarray, "blow freq out in"] | Complex[Window, "blow freq out in"]


@dataclass(frozen=True, repr=False)
class Deviations(Container):
    """Deviations of an averaged FRF by the single impacts, blocks or sweeps that it is the average of.

    Each is the share a_i of impact i in the average times the difference of its FRF from the average, over the root of
    one minus that share, d_i = a_i (H_i - H) / sqrt(1 - a_i). The sum of the squared deviations of an FRF is an
    estimate of the variance of its average: with n equal shares it is the sample variance over n.

    Parameters
    ----------
    values : complex array of shape (impact, freq, out, in)
        Deviations in SI; 0 where an FRF has fewer impacts.
    blows : integer array of shape (impact, out, in)
        Number of the impact; equal numbers in several FRFs are one and the same impact, -1 is none.

    Examples
    --------
    >>> deviations = Deviations(values=[[[[0.1 + 0j]]], [[[-0.1 + 0j]]]], blows=[[[0]], [[1]]])
    >>> np.sum(np.abs(deviations.values) ** 2, axis=0).round(3)
    array([[[0.02]]], dtype=float32)
    """

    values: DeviationValues
    blows: Int[np.ndarray, "blow out in"]

    def __post_init__(self) -> None:
        freeze(self, values=np.complex64, blows=np.int64)
        check_axes(self)

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take."""
        return self.values.nbytes + self.blows.nbytes

    def in_memory(self) -> "Deviations":
        """Return the deviations with all values read.

        Returns
        -------
        Deviations
            The same deviations.

        Examples
        --------
        >>> Deviations(values=np.zeros((2, 10, 1, 1)), blows=np.zeros((2, 1, 1))).in_memory().values.shape
        (2, 10, 1, 1)
        """
        return replace(self, values=np.asarray(self.values))

    def lines(self, keep: "np.ndarray | slice") -> "Deviations":
        """Return the deviations on some of the frequency lines.

        Parameters
        ----------
        keep : array or slice
            Index of numpy along the frequency axis.

        Returns
        -------
        Deviations
            The deviations on those lines.

        Examples
        --------
        >>> deviations = Deviations(values=np.zeros((2, 10, 1, 1)), blows=np.zeros((2, 1, 1)))
        >>> deviations.lines(slice(0, 4)).values.shape
        (2, 4, 1, 1)
        """
        return replace(self, values=self.values[:, keep])

    def pick(self, rows: Sequence[int], columns: Sequence[int]) -> "Deviations":
        """Return the deviations of some outputs and inputs.

        Parameters
        ----------
        rows : sequence of int
            Positions of the outputs, from 0.
        columns : sequence of int
            Positions of the inputs, from 0.

        Returns
        -------
        Deviations
            The deviations of those FRFs.

        Examples
        --------
        >>> deviations = Deviations(values=np.zeros((2, 10, 3, 1)), blows=np.zeros((2, 3, 1)))
        >>> deviations.pick([0, 2], [0]).values.shape
        (2, 10, 2, 1)
        """
        rows, columns = list(rows), list(columns)
        return Deviations(self.values[:, :, rows][:, :, :, columns], self.blows[:, rows][:, :, columns])

    def scaled(self, factor: "Float[np.ndarray, '...'] | Complex[np.ndarray, '...']") -> "Deviations":
        """Return the deviations of FRFs that were multiplied by a factor.

        Parameters
        ----------
        factor : array or complex array
            Factor of shape (freq, out, in), or what broadcasts to it.

        Returns
        -------
        Deviations
            The deviations times the factor.

        Examples
        --------
        >>> deviations = Deviations(values=np.ones((2, 10, 1, 1)), blows=np.zeros((2, 1, 1)))
        >>> float(deviations.scaled(np.full((10, 1, 1), 2.0)).values[0, 0, 0, 0].real)
        2.0
        """
        return replace(self, values=self.values * factor)
