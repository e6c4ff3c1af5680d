"""Readings of hammer tests from a table of them: the search for the best pole is made once, and not for every draw.

A reading is stated as the stiffness and loss K, L (both over that of the sticking joint) that a linear joint would have
with the same pole: (f/f_s)^2 = 1 + r K, and L from the damping ratio. These hardly change with the stiffness ratio r,
the damping and the loss factor, so that a few nodes of each are enough.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from ema.compare.decay_kernels import interpolated
from ema.compare.joint_loops import LAWS
from ema.compare.joint_readings import LARGEST_SLIP, Beam, Columns, hammer

_RATIOS = np.geomspace(1e-3, 4.0, 13)
_LOSSES = np.linspace(0.0, 0.1, 3)
_SLIPS = np.geomspace(0.03, LARGEST_SLIP, 90)
_DAMPINGS = 3
"""Nodes, and how many; what is beyond the first or the last counts as that one."""


@dataclass(frozen=True)
class HammerTable:
    """K and L of hammer tests for every law, stiffness ratio, damping ratio, loss factor and highest slip.

    Compared with the search itself, draws of the paper's prior are read within 0.1 Hz and 0.01 % damping in 99 % of
    cases (tests/validation/test_joint_law.py).
    """

    dampings: tuple[float, float]
    values: Float[np.ndarray, "law ratio damping loss slip 2"]

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, lowest: float, highest: float) -> "HammerTable":
        """The table for damping ratios without the joint from ``lowest`` to ``highest``."""
        axes = (_RATIOS, np.linspace(lowest, highest, _DAMPINGS), _LOSSES, _SLIPS)
        ratio, damping, loss, slip = (each.ravel() for each in np.meshgrid(*axes, indexing="ij"))
        zero, shape = np.zeros_like(ratio), (*(len(axis) for axis in axes), 2)
        tables = []
        for law in range(len(LAWS)):
            # at 1 kN, with nothing in series: the highest slip is impulse times ratio over normal force
            rigid = np.full_like(ratio, np.inf)
            beam = Beam(1.0, zero, damping, ratio, rigid, zero, loss, np.full(len(ratio), law))
            frequency, read = (each[:, 0] for each in hammer(beam, np.array([1000.0]), slip * 1000.0 / ratio))
            square = frequency**2
            stiffness = (square - 1) / ratio
            lost = 2 * (read * square - damping * frequency) / ratio - loss * stiffness
            tables.append(np.stack([stiffness, lost], axis=-1).reshape(shape))
        return cls((lowest, highest), np.stack(tables))

    def hammer(
        self, beam: Beam, forces: Float[np.ndarray, "force"], impulse: Columns
    ) -> tuple[Float[np.ndarray, "draw force"], Float[np.ndarray, "draw force"]]:
        """Frequency [Hz] and damping ratio of :func:`ema.compare.joint_readings.hammer`, between the nodes."""
        ratio = beam.ratio(forces)
        highest = np.clip(impulse[:, None] * ratio / forces, _SLIPS[0], _SLIPS[-1])
        low, high = self.dampings
        each = (ratio.shape[1], 1)
        places = np.stack(
            [
                np.log(ratio / _RATIOS[0]) / np.log(_RATIOS[1] / _RATIOS[0]),
                np.tile((beam.damping - low) / (high - low) * (_DAMPINGS - 1), each).T,
                np.tile(beam.loss / _LOSSES[1], each).T,
                np.log(highest / _SLIPS[0]) / np.log(_SLIPS[1] / _SLIPS[0]),
            ],
            axis=-1,
        )
        found = interpolated(self.values, np.repeat(beam.laws, ratio.shape[1]), places.reshape(-1, 4))
        stiffness, lost = np.moveaxis(found.reshape(*ratio.shape, 2), -1, 0)
        return beam.modal(ratio, stiffness, lost)
