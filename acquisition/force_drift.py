"""Whether a measured normal force was constant during a run: its drift and moves, against its own scatter.

The scatter of a load cell is white noise and flicker noise, whose spectrum falls with the frequency and whose means
over any time scatter alike (Riley, Handbook of Frequency Stability Analysis, NIST SP 1065, 2008). Both are read from
second differences of means over one and two values (Hadamard variance), which a drift does not change.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data import Finding, JointForce

DRIFT_LIMIT = 0.01
"""Change of a normal force within a run, as a fraction of its mean, up to which it counts as constant.

Of 300 random joints (Masing springs in closed form, F_N / F_E from 1/3 to 10 over mu) a normal force off by half of it
changes the damping ratio by 0.2 % in half of them and by 0.9 % or more in one of twenty, the natural frequency by 0.003
and 0.02 %. The 95 % intervals of damping ratios of 30 hammer, random and sweep tests are 0.12 % in the median, 0.65 %
or less in nine of ten modes. With twice the limit that one joint of twenty changes its damping ratio by 1.7 %."""

CHANCE = 0.001
"""Chance that the scatter of a constant force, of white and of flicker noise, is called a drift, or a move."""

_UNKNOWN = 0.05
"""The least change, as a fraction of the mean, of two readings, which show no scatter."""

_LONG = 64
"""Values, those of one record, from which on flicker noise is recognised; of fewer the scatter about a line counts."""

_HADAMARD = 0.5 * np.log(256 / 27)
"""Hadamard variance of flicker noise with the spectrum h / f, over h (Riley 2008)."""


@dataclass(frozen=True)
class _Noise:
    """Variance of single values by white noise, Hadamard variance by flicker noise, and degrees of freedom of both."""

    white: float
    flicker: float
    freedom: float

    @classmethod
    def of(cls, trace: Float[np.ndarray, "sample"]) -> "_Noise":
        """From medians, which steps within the trace do not change."""
        one, two = (_hadamard(trace, size) for size in (1, 2))
        flicker = min(max(2 * two - one, 0.0), one)
        # a median tells 0.37 of what a mean square does, and second differences over two values share their values
        return cls(one - flicker, flicker, max(len(trace) / 8, 1.0))

    def of_sum(self, weights: Float[np.ndarray, "sample"]) -> float:
        """Standard deviation of the sum of values with ``weights`` of sum zero."""
        padded = 8 * len(weights)
        frequencies = np.fft.rfftfreq(padded)[1:]
        power = np.abs(np.fft.rfft(weights, padded)[1:]) ** 2
        slow = self.flicker / _HADAMARD * np.sum(power / frequencies) * frequencies[0]
        return float(np.sqrt(self.white * weights @ weights + slow))

    def of_means(self, count: int) -> float:
        """Standard deviation of ``count`` successive means about their own mean (Allan 1966), were all noise flicker.

        White noise scatters them less; but few values do not tell it from flicker for certain.
        """
        slow = self.flicker + 0.5 * self.white
        return float(np.sqrt(slow / _HADAMARD * count * np.log(count) / (count - 1)))


def drift_findings(force: JointForce, where: str, together: int | None) -> tuple[Finding, ...]:
    """A finding where a normal force is another one at the end of the run, or came back from another one.

    ``together`` is the number of values of the trace that are a tenth of a record; without records, of all.
    """
    trace = force.trace
    if trace is None or not force.mean or not np.isfinite(force.drift) or len(trace) < 2:
        return ()
    mean = abs(force.mean)
    ended = abs(force.drift)
    if ended > DRIFT_LIMIT * mean and ended > (noise := _of_drift(trace, mean)):
        return (
            Finding.of(
                "warning",
                "normal-force-drift",
                where,
                "The normal force drifted by {change} N during the run, {percent} % of its mean of {mean} N; its "
                "scatter explains {noise} N.",
                ended / mean,
                DRIFT_LIMIT,
                advice="Let the joint settle, use a strain-gauge ring or re-zero at every point, and measure again.",
                change=f"{force.drift:+.3g}",
                percent=f"{100 * ended / mean:.1f}",
                mean=f"{force.mean:.4g}",
                noise=f"{noise:.2g}",
            ),
        )
    if len(trace) < 10:
        return ()
    size = together or len(trace) // 10
    means = trace[: len(trace) // size * size].reshape(-1, size).mean(axis=1)
    low, high = (float(value) for value in np.percentile(means, [2.5, 97.5]))
    moved = high - low
    if moved <= DRIFT_LIMIT * mean or moved <= (noise := _of_range(trace, len(means))):
        return ()
    return (
        Finding.of(
            "warning",
            "normal-force-drift",
            where,
            "The normal force moved between {low} and {high} N during the run, {percent} % of its mean; its scatter "
            "explains {noise} N.",
            moved / mean,
            DRIFT_LIMIT,
            advice="Let the joint settle, use a strain-gauge ring or re-zero at every point, and measure again.",
            low=f"{low:.4g}",
            high=f"{high:.4g}",
            percent=f"{100 * moved / mean:.1f}",
            noise=f"{noise:.2g}",
        ),
    )


def _of_drift(trace: Float[np.ndarray, "sample"], mean: float) -> float:
    """Change over a trace that its noise exceeds by `CHANCE`; infinite where the line of least squares has less."""
    from scipy.stats import t

    count = len(trace)
    if count < 3:
        return _UNKNOWN * mean
    position = np.linspace(-0.5, 0.5, count)
    weights = position / (position @ position)
    if count < _LONG:
        left = trace - np.mean(trace) - position * (weights @ trace)
        noise = _Noise(float(left @ left) / (count - 2), 0.0, count - 2)
    else:
        noise = _Noise.of(trace)
    certain = float(t.isf(CHANCE / 2, noise.freedom)) * noise.of_sum(weights)
    return certain if abs(weights @ trace) > certain else np.inf


def _of_range(trace: Float[np.ndarray, "sample"], count: int) -> float:
    """Range of ``count`` successive means that noise exceeds by `CHANCE`."""
    from scipy.stats import studentized_range

    noise = _Noise.of(trace)
    return float(studentized_range.isf(CHANCE, count, noise.freedom)) * noise.of_means(count)


def _hadamard(trace: Float[np.ndarray, "sample"], size: int) -> float:
    sums = np.concatenate([[0.0], np.cumsum(trace - trace[0])])
    means = (sums[size:] - sums[:-size]) / size
    second = means[2 * size :] - 2 * means[size:-size] + means[: -2 * size]
    return float((np.median(np.abs(second)) / 0.6745) ** 2 / 6)
