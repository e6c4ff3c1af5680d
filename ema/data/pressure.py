"""How hard the node pairs of the joints are pressed together, at rest and while the structure moves."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ema.data._arrays import freeze
from ema.data._summary import Container
from ema.data.findings import Finding


@dataclass(frozen=True, repr=False)
class ContactPressure(Container):
    """Normal forces of all node pairs.

    Parameters
    ----------
    joints, pairs : name of the joint and ``(host node, beam node)`` of every pair.
    forces : N at rest, under the preload alone, shape (pair,).
    preloads : N with which the joint presses each pair from outside, shape (pair,).
    areas : m^2, NaN where unknown, shape (pair,).
    least, greatest : normal forces over the motion in N, shape (pair,); negative: a linear spring in tension.
    open_time : fraction of the motion without pressure, shape (pair,).
    first_opening : s, NaN where the pair stays closed, shape (pair,).
    widest_gap : largest opening in m, shape (pair,).
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

    @property
    def pressures(self) -> Float[np.ndarray, "pair"]:
        """Pressures at rest in Pa, NaN where the area is unknown."""
        return np.asarray(self.forces / self.areas)
