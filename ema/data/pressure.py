"""How hard the node pairs of the joints are pressed together, at rest and while the structure moves."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container
from ema.data.findings import Finding


@dataclass(frozen=True, repr=False)
class ContactPressure(Container):
    """Normal forces of all node pairs of the joints, at rest and while the structure moves.

    Parameters
    ----------
    joints : tuple of str
        Name of the joint of every pair.
    pairs : tuple of tuple of (int, int)
        ``(host node, beam node)`` of every pair.
    forces : array of shape (pair,)
        Normal forces [N] at rest, under the preload alone.
    preloads : array of shape (pair,)
        Forces [N] with which the joint presses each pair from outside.
    areas : array of shape (pair,)
        Contact areas [m^2], NaN where unknown.
    least, greatest : array of shape (pair,)
        Extremes of the normal forces over the motion [N]; negative: a linear spring in tension.
    open_time : array of shape (pair,)
        Fraction of the motion without pressure.
    first_opening : array of shape (pair,)
        Time [s] at which the pair first opens, NaN where it stays closed.
    widest_gap : array of shape (pair,)
        Largest opening [m].
    findings : tuple of Finding, optional
        What a reader of the forces has to know.

    Examples
    --------
    >>> pressure = ContactPressure(
    ...     joints=("joint",), pairs=((1, 1),), forces=[100.0], preloads=[100.0], areas=[1e-4], least=[80.0],
    ...     greatest=[120.0], open_time=[0.0], first_opening=[np.nan], widest_gap=[0.0],
    ... )
    >>> pressure.pressures
    array([1000000.])
    """

    joints: tuple[str, ...]
    pairs: tuple[tuple[int, int], ...]
    forces: Float[np.ndarray, "pair"]
    preloads: Float[np.ndarray, "pair"]
    areas: Float[np.ndarray, "pair"]
    least: Float[np.ndarray, "pair"]
    greatest: Float[np.ndarray, "pair"]
    open_time: Float[np.ndarray, "pair"]
    first_opening: Float[np.ndarray, "pair"]
    widest_gap: Float[np.ndarray, "pair"]
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        names = ("forces", "preloads", "areas", "least", "greatest", "open_time", "first_opening", "widest_gap")
        freeze(self, **dict.fromkeys(names, np.float64))
        check_axes(self)

    @property
    def pressures(self) -> Float[np.ndarray, "pair"]:
        """Pressures at rest in Pa, NaN where the area is unknown."""
        return np.asarray(self.forces / self.areas)
