"""Slow drift of the channels of a record, such as that of a charge amplifier that warms up or was just reset.

Sweeps are transformed whole and without a window: what a channel drifts from the first to the last sample is a step,
and leaks into all lines. A polynomial over the record takes it off; lines from the tenth on keep their FRFs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

from ema.data import Channel, Finding, Recording
from ema.data.stored_signals import StoredSignals
from ema.estimate.channels import Layout

DEGREE = 8
"""Degree of the polynomial: it follows a decay by a factor of e in a sixteenth of the record, and has four periods."""

RESPONSE = 1e-3
"""Share of a response's power in that polynomial from which on it is taken off, unless the force has a quarter of it.

Accelerations of 320 drawn sweeps had up to 1e-4; a drift by a tenth of the rms has 8e-4 and adds a tenth to
the errors of noise of 1 %, twice as much half.
"""

FORCE = 0.1
"""The same of a force: sweeps that begin within ten lines of 0 Hz have up to 0.04 by themselves."""

STANDS_OUT = 4.0
"""Power in the polynomials up to that degree over that in those up to three times as high: a drift has nearly all in
the first, vibration at the lowest lines of a short record most in the second."""

MEANS = 4096
"""Means over neighbouring samples from which the polynomial is fitted; fewer where the record has fewer samples."""

PERIODS = 10
"""Periods in the record below which nothing is known of a channel that drifted."""


@dataclass(frozen=True)
class _WithoutDrift:
    """Signals less a polynomial for each row that drifts, over the time from -1 to 1 in the first ``samples``."""

    signals: Any
    polynomials: Mapping[int, Float[np.ndarray, "degree"]]
    samples: int

    @property
    def shape(self) -> tuple[int, ...]:
        """Channels and samples."""
        return tuple(self.signals.shape)

    @property
    def dtype(self) -> np.dtype:
        """Type of the values."""
        return np.dtype(np.float64)

    @property
    def chunks(self) -> tuple[int, ...]:
        """What lies together in the file of the signals."""
        return tuple(self.signals.chunks)

    def drift(self, row: int, stretch: slice) -> Float[np.ndarray, "sample"]:
        """The polynomial of a row, on a stretch of samples."""
        time = (np.arange(*stretch.indices(self.shape[1])) + 0.5) * 2 / self.samples - 1
        return np.asarray(legendre.legval(time, self.polynomials[row]))

    def read(self, box: tuple[slice, ...]) -> np.ndarray:
        """The values of a box with steps of 1."""
        values = np.array(self.signals[box], dtype=np.float64)
        for place, row in enumerate(range(*box[0].indices(self.shape[0]))):
            if row in self.polynomials:
                values[place] -= self.drift(row, box[1])
        return values


@dataclass
class Drift:
    """Takes drift off the signals of records, and remembers the largest of each row, over the rms of what is left."""

    largest: dict[int, float] = field(default_factory=dict)
    duration: float = float("inf")

    def off(self, record: Recording, layout: Layout) -> Recording:
        """The record without the drift of the channels that have one; the record itself where none has."""
        size = max(record.signals.shape[1] // MEANS, 1)
        count = record.signals.shape[1] // size
        # row by row: a record may be larger than memory
        rows = range(len(record.channels))
        means, power = np.empty((len(rows), count)), np.empty(len(rows))
        for row in rows:
            signal = record.signals[row]
            means[row] = signal[: count * size].reshape(count, size).mean(axis=1, dtype=np.float64)
            power[row] = np.var(signal, dtype=np.float64)
        fitted = legendre.legfit((np.arange(count) + 0.5) * 2 / count - 1, means.T, 3 * DEGREE)
        fitted[0] = 0.0  # a mean is no drift
        shares = fitted**2 / (2 * np.arange(len(fitted))[:, None] + 1)  # mean square of each polynomial
        slow, faster = shares[: DEGREE + 1].sum(axis=0), shares[DEGREE + 1 :].sum(axis=0)
        slow = np.where(slow > STANDS_OUT * faster, slow, 0.0)
        share = np.divide(slow, power, out=np.zeros_like(power), where=power > 0)
        own = max((share[row] for row in layout.references if share[row] < FORCE), default=0.0)
        drifting = [row for row in layout.references if share[row] > FORCE]
        drifting += [row for row in layout.responses if share[row] > max(RESPONSE, 4 * own)]
        if not drifting:
            return record
        polynomials = {row: fitted[: DEGREE + 1, row] for row in drifting}
        signals: Any = _WithoutDrift(record.signals, polynomials, count * size)
        for row in drifting:
            drift = signals.drift(row, slice(0, record.signals.shape[1]))
            ratio = float(np.ptp(drift) / max(np.std(record.signals[row] - drift), 1e-300))
            self.largest[row] = max(self.largest.get(row, 0.0), ratio)
            self.duration = min(self.duration, record.duration)
        in_file = isinstance(record.signals, StoredSignals)
        signals = StoredSignals(signals) if in_file else signals.read((slice(None), slice(None)))
        return replace(record, signals=signals)

    def findings(self, channels: Sequence[Channel], where: str) -> tuple[Finding, ...]:
        """One finding for all channels that drifted."""
        if not self.largest:  # rows of the records
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
