"""Whether records of impacts come with an exponential window that the front end applied: their noise decays with it."""

from collections.abc import Iterable

import numpy as np

from ema.data import Finding, Recording

FALLEN = 0.5
"""Noise at the end of a record over that before the impact, from which on down the record was windowed.

Noise of sensors and converters is as large at the end as at the beginning; estimated from 32 samples it scatters by
15 %. Twice as much would call half of all records windowed, half as much would miss windows that halve the noise twice.
"""

FEWEST = 32
"""Samples before an impact below which their noise is not estimated."""

NOISY = -0.3
"""Correlation of neighbouring third differences below which they are noise.

White noise has -0.75, and -0.49 where a filter cuts it at 80 % of half the sampling rate; a vibration has the cosine of
its angle from sample to sample, above 0 up to a quarter of the rate.
"""

_COMMON = 0.9
"""Share of the records whose noise has to fall: a window is applied to all of them, and a tenth may hold something
else."""
_LATE = 0.05
"""Share of a record at its end whose noise is compared with that before the impact."""


def noise_decay(record: Recording, begin: int, rate: float) -> list[tuple[float, float]]:
    """Noise of responses at the end of a record over that before the impact at ``begin``, and the decay [1/s] it tells.

    The third differences hold little of vibrations far below the sampling rate; channels whose differences vibrate
    nevertheless before the impact are left out, for a structure that comes to rest is no window.
    """
    samples, rows = record.signals.shape[1], list(record.with_role("response"))
    late = max(int(_LATE * samples), 2 * FEWEST)
    if begin < FEWEST or samples - begin < 4 * late:
        return []
    before, after = (np.diff(record.signals[rows, part], 3, axis=1) for part in (slice(begin), slice(-late, None)))
    power = np.sum(before**2, axis=1)
    alike = np.sum(before[:, 1:] * before[:, :-1], axis=1) < NOISY * power
    noise, left = np.std(before, axis=1), np.std(after, axis=1)
    heard = alike & (noise > 0) & (left > 0)
    elapsed = (samples - 0.5 * late - 0.5 * begin) / rate
    return [(float(ratio), float(-np.log(ratio) / elapsed)) for ratio in left[heard] / noise[heard]]


def about_applied_window(decays: Iterable[tuple[float, float]], where: str) -> list[Finding]:
    """A finding where the noise of nearly all records falls."""
    falls = np.array(list(decays))
    if len(falls) < 3 or np.quantile(falls[:, 0], _COMMON) > FALLEN:
        return []
    fallen, decay = float(np.median(falls[:, 0])), float(np.median(falls[:, 1]))
    return [
        Finding.of(
            "error",
            "window-unstated",
            where,
            "the noise at the end of the records is {fallen} of that before the impacts: the front end "
            "has applied an exponential window of about {decay} 1/s that nobody stated. Damping ratios "
            "are too high by {decay} / (2 pi f).",
            fallen,
            FALLEN,
            advice=("Export the records without the window, or switch it off; the FRFs get one where they need it."),
            fallen=f"{fallen:.2g}",
            decay=f"{decay:.2g}",
        )
    ]
