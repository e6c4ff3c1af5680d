"""What the single blows or blocks of a test change in its averaged FRFs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data._arrays import freeze
from ema.data._summary import Container


@dataclass(frozen=True, repr=False)
class Deviations(Container):
    """Deviations of an averaged FRF by the single blows (or blocks, or sweeps) that it is the average of.

    Each is the share of the blow in the average times the difference of its FRF from the average, over the root of one
    minus that share: the sum of the squared deviations of an FRF is an estimate of the variance of its average.

    Parameters
    ----------
    values : SI, shape (blow, freq, out, in); 0 where an FRF has fewer blows.
    blows : number of the blow, shape (blow, out, in); equal numbers in several FRFs are one and the same blow, -1 is
        none.
    """

    values: Complex[np.ndarray, "blow freq out in"]
    blows: Int[np.ndarray, "blow out in"]

    def __post_init__(self) -> None:
        freeze(self, values=np.complex64, blows=np.int64)

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take."""
        return self.values.nbytes + self.blows.nbytes

    def lines(self, keep: "np.ndarray | slice") -> "Deviations":
        """Those on some of the frequency lines."""
        return replace(self, values=self.values[:, keep])

    def pick(self, rows: Sequence[int], columns: Sequence[int]) -> "Deviations":
        """Those of some outputs and inputs."""
        rows, columns = list(rows), list(columns)
        return Deviations(self.values[:, :, rows][:, :, :, columns], self.blows[:, rows][:, :, columns])

    def scaled(self, factor: "Float[np.ndarray, '...'] | Complex[np.ndarray, '...']") -> "Deviations":
        """Those of FRFs that were multiplied by a factor, shape (freq, out, in) or what broadcasts to it."""
        return replace(self, values=self.values * factor)
