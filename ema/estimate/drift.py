"""Slow drift of the channels of a sweep, such as that of a charge amplifier that warms up or was just reset.

Sweeps are transformed whole and without a window: what a channel drifts from the first to the last sample is a step,
and leaks into all lines. A polynomial over the record takes it off; lines from the tenth on keep their FRFs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

from ema.data import Channel, Finding

DEGREE = 8
"""Degree of the polynomial: it follows a decay by a factor of e in a sixteenth of the record, and has four periods."""

RESPONSE = 1e-3
"""Share of a response's power in that polynomial from which on it is taken off, unless the force has a quarter of it.

Accelerations of 320 drawn sweeps had up to 1e-4; a drift by a tenth of the rms has 8e-4 and adds a tenth to
the errors of noise of 1 %, twice as much half.
"""

FORCE = 0.1
"""The same of a force: sweeps that begin within ten lines of 0 Hz have up to 0.04 by themselves."""

PERIODS = 10
"""Periods in the record below which nothing is known of a channel that drifted."""


@dataclass
class Drift:
    """Takes drift off the signals of records, and remembers the largest of each row, over the rms of what is left."""

    largest: dict[int, float] = field(default_factory=dict)
    duration: float = float("inf")

    def off(self, signals: Float[np.ndarray, "channel sample"], rate: float) -> Float[np.ndarray, "channel sample"]:
        """Signals, the force first, without their mean, and without their drift where they have one."""
        time = np.linspace(-1, 1, signals.shape[1])
        drift = legendre.legval(time, legendre.legfit(time, signals.T, DEGREE))
        rest = signals - signals.mean(axis=1, keepdims=True)
        power = np.var(rest, axis=1)
        share = np.divide(np.var(drift, axis=1), power, out=np.zeros_like(power), where=power > 0)
        own = share[0] if share[0] < FORCE else 0.0
        limit = np.array([FORCE, *[max(RESPONSE, 4 * own)] * (len(signals) - 1)])
        for row in np.flatnonzero(share > limit):
            rest[row] = signals[row] - drift[row]
            size = float(np.ptp(drift[row]) / max(np.std(rest[row]), 1e-300))
            self.largest[int(row)] = max(self.largest.get(int(row), 0.0), size)
            self.duration = min(self.duration, signals.shape[1] / rate)
        return rest

    def findings(self, channels: Sequence[Channel], where: str) -> tuple[Finding, ...]:
        """One finding for all channels that drifted; ``channels`` in the order of the rows."""
        if not self.largest:
            return ()
        worst = max(self.largest, key=lambda row: self.largest[row])
        more = f", and {len(self.largest) - 1} further channels drift" if len(self.largest) > 1 else ""
        return (
            Finding(
                "info",
                "drift",
                where,
                f"channel {channels[worst].name} drifts by {self.largest[worst]:.3g} times the rms of its vibration "
                f"within a record{more}: a polynomial was taken off, and FRFs below "
                f"{PERIODS / self.duration:.3g} Hz are lost.",
                self.largest[worst],
                None,
                "Let the amplifier settle, or use its high-pass filter on all channels.",
            ),
        )
