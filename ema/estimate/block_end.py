"""Whether the response has died away within a block, and the exponential window it needs when it has not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

LEFT_OVER = 0.02
"""Response at the end of a block, relative to its beginning, above which a window is used."""

GOAL = 0.005
"""What the window leaves of it."""

STRONGEST = 3.0
"""Largest decay of a window relative to that of the structure: beyond it the damping is mostly the window's."""

PARTS = 20
"""Beginning and end are one part of so many of the block."""


@dataclass(frozen=True)
class RingDown:
    """``left_over``: rms at the end of the block over rms behind the impact; ``structural`` decay rate in 1/s that is
    seen in it (a lower bound where the response has vanished in noise)."""

    left_over: float
    structural: float

    @property
    def needed(self) -> float:
        """Decay rate in 1/s of the window to use; 0 for none."""
        if self.left_over <= LEFT_OVER:
            return 0.0
        duration = -np.log(self.left_over) / self.structural if self.structural > 0 else np.inf
        wanted = np.log(self.left_over / GOAL) / duration
        return float(min(wanted, STRONGEST * self.structural))


def ring_down(
    blocks: Sequence[tuple[Float[np.ndarray, "out _"], Float[np.ndarray, "out"], Float[np.ndarray, "out"]]],
    sampling_rate: float,
) -> RingDown:
    """How much of the response is left at the end of the blocks: the median over the blocks, of the response with most.

    Parameters
    ----------
    blocks : of each block that begins at the trigger the signals (out, sample), and mean and rms noise (out,) of each
        response before the impact, in its unit; noise is taken off in power. At least one block.
    sampling_rate : Hz.

    Returns
    -------
    Ratio of the rms in the last to that in the first of ``PARTS`` parts, and the decay rate [1/s] between their
    middles; a response that is no larger than its noise counts as 0.

    Examples
    --------
    Two seconds of a decay with 1/s: the middles of the first and last part are 1.9 s apart.

    >>> time = np.arange(2000) / 1000
    >>> left = ring_down([(np.exp(-time)[None, :], np.zeros(1), np.zeros(1))], sampling_rate=1000)
    >>> round(left.left_over, 3), round(float(left.structural), 3), round(left.needed, 2)
    (0.15, 1.0, 1.79)
    """
    ratios = []
    part = 1
    for signals, rest, quiet in blocks:
        part = max(signals.shape[1] // PARTS, 1)
        rms = [
            np.sqrt(np.maximum(np.mean((piece - rest[:, None]) ** 2, axis=1) - quiet**2, 0.0))
            for piece in (signals[:, :part], signals[:, -part:])
        ]
        ratios.append(float(np.max(np.divide(rms[1], rms[0], out=np.zeros_like(rms[0]), where=rms[0] > 0))))
    left_over = float(np.median(ratios))
    duration = (blocks[0][0].shape[1] - part) / sampling_rate
    return RingDown(left_over, -np.log(min(max(left_over, 1e-12), 0.999)) / duration)
