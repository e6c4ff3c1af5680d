"""What chatter and forced vibration leave of a cut at a tool point, over cutting force and normal force."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container


@dataclass(frozen=True, repr=False)
class CuttingLimits(Container):
    """Depths of cut and amplitudes at a tool point over the amplitude of the cutting force and the normal force.

    Parameters
    ----------
    force_levels : array of shape (level,)
        Amplitudes of the cutting force [N].
    normal_forces : array of shape (force,)
        Normal forces of every joint [N].
    depth : array of shape (level, force)
        Least depth of cut [m] at which chatter of that force amplitude persists.
    amplitude : array of shape (level, force)
        Amplitude at resonance [m] under a cutting force of that amplitude: half the height of the waves it leaves on
        the surface.
    frequency : array of shape (level, force)
        Frequency of the chatter [Hz].

    Examples
    --------
    >>> limits = CuttingLimits([10.0, 40.0], [50.0, 200.0], [[4e-3, 2e-3], [2e-3, 5e-3]], 1e-6 * np.ones((2, 2)),
    ...                        500.0 * np.ones((2, 2)))
    >>> limits.constant, limits.controlled
    (0, array([0, 1]))
    """

    force_levels: Float[np.ndarray, "level"]
    normal_forces: Float[np.ndarray, "force"]
    depth: Float[np.ndarray, "level force"]
    amplitude: Float[np.ndarray, "level force"]
    frequency: Float[np.ndarray, "level force"]

    def __post_init__(self) -> None:
        names = ("force_levels", "normal_forces", "depth", "amplitude", "frequency")
        freeze(self, **dict.fromkeys(names, np.float64))
        check_axes(self)

    @property
    def constant(self) -> int:
        """Column of the normal force that, kept for all levels, has the largest of the least depths."""
        return int(np.argmax(self.depth.min(axis=0)))

    @property
    def controlled(self) -> np.ndarray:
        """Columns of the normal forces with the largest depth of every level (level,)."""
        return np.asarray(np.argmax(self.depth, axis=1))
