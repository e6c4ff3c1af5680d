"""H1 of a hammer test less the noise of the force channel, which the samples before the impacts show.

The energy of n measured forces x = f + n is ``S = sum |X|^2``, with that of the noise inside their windows w,

    N(f) = sum_k c_k r_k cos(2 pi k f / f_s),    r_k = sum_t w_t w_(t+k),

for noise of autocovariance c_k. A force window takes away all of it but a share of some ten samples; without one it is
that of the whole block. The mean of H1 over noise that is weak beside n equal forces is, to first order,

    E H1 = H (1 - (n - 1) N / S):

a single impact has no bias, for X in numerator and denominator of ``Y / X`` is the same. Hence ``H = H1 / (1 - b)``
with ``b = (n - 1) N / S``, and, of n0 averages behind N (Fuller 1987, Measurement Error Models),

    var H = (var H1 + |H|^2 b^2 (1 / n + 1 / n0)) / (1 - b)^2.

The noise of a few samples is alike on all lines: its scatter between few impacts tells its size badly, on all lines
alike. What the samples before the impacts say of it is the least variance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
from jaxtyping import Bool, Float, Inexact

from ema.data import Finding
from ema.estimate.force_noise import MATTERS, AtRest, weakness, widened
from ema.estimate.generator import bands_of
from ema.estimate.judge import FEW, Judged
from ema.estimate.pulses import offset_and_noise
from ema.estimate.single_input import Sums
from ema.messages import mark

ENOUGH = 10.0
"""Averages of the noise from which on it is taken off: its share is known within 30 % (one standard deviation)."""

STEADY = 4.0
"""Ratio of the power of a part, or up of half of it, to the median of all parts within which the noise is the same.
Sixteen samples of white noise are beyond it once in 700, half of them above it once in 1e4; a hammer that swings or a
range that changes is by far."""

MOVING = 0.25
"""Share of impacts with other noise from which on the noise of the test is not steady. Fewer are left out."""

GAP = 4
"""Part of the time since the impact before, as its inverse, whose samples are used."""


NONE = mark("the records begin too shortly before the impacts")
UNSTEADY = mark("its level changes before or between the impacts")
SHORT = mark("the samples before the impacts are too few")


@dataclass(frozen=True)
class Quiet:
    """Autocovariance (lag,) of a force where nothing acts, and the samples behind it; ``reason`` says why it is not
    known well enough."""

    covariance: Float[np.ndarray, "lag"]
    samples: int
    reason: str = ""


def quiet_part(
    force: Float[np.ndarray, "sample"], one: Judged, earlier: Judged | None = None
) -> Float[np.ndarray, "some"] | None:
    """The force before an impact less its offset; ``None`` where it is too short.

    The samples are those that belong to the impact, or the last quarter of the time since the ``earlier`` one; those of
    a contact before it begins are left out, for the filters of a front end have the impact there. The hammer is not in
    contact: what responses still do then is seen by its channel as far as in the window of the impact itself.
    """
    reach = one.before if earlier is None else max(one.before, (one.start - earlier.start) // GAP)
    end = one.start - max(one.pulse.stop - one.pulse.start, 4)
    part = force[max(one.start - reach, 0) : max(end, 0)]
    return None if len(part) < FEW else np.asarray(part, dtype=np.float64) - one.offset


def quiet(parts: Sequence[Float[np.ndarray, "_"]]) -> Quiet:
    """Autocovariance over all parts whose power is that of most.

    Products over lags are over all samples, which keeps the spectrum positive, with a triangular lag window over a
    quarter of the usual part (Bartlett 1950).

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> noise = quiet([rng.standard_normal(400) for _ in range(5)])
    >>> noise.samples, noise.reason, bool(abs(noise.covariance[0] - 1) < 0.1)
    (2000, '', True)
    """
    power = np.array([np.mean(part**2) for part in parts])
    middle = float(np.median(power))
    halves = np.array([[np.mean(half**2) for half in np.array_split(part, 2)] for part in parts])
    alike = np.all(halves <= STEADY * middle, axis=1) & (power >= middle / STEADY)
    used = [part for part, same in zip(parts, alike, strict=True) if same] or list(parts)
    lags = max(int(np.median([len(part) for part in used])) // 4, FEW)
    samples = sum(map(len, used))
    total = np.sum([_products(part, lags) for part in used], axis=0)
    reason = UNSTEADY if np.mean(~alike) > MOVING else ""
    return Quiet(total / samples * (1 - np.arange(lags) / lags), samples, reason)


def level_alone(force: Float[np.ndarray, "sample"]) -> Quiet:
    """The noise of a record that is nowhere quiet, as white noise of its usual level: to say that it may matter."""
    return Quiet(np.r_[offset_and_noise(force)[1] ** 2, np.zeros(FEW - 1)], FEW, NONE)


def _products(signal: Float[np.ndarray, "_"], lags: int) -> Float[np.ndarray, "lag"]:
    """Sums over products of samples that are 0, 1, 2 ... ``lags`` - 1 apart."""
    size = scipy.fft.next_fast_len(len(signal) + lags, real=True)
    return np.asarray(scipy.fft.irfft(np.abs(scipy.fft.rfft(signal, size)) ** 2, size)[:lags])


def noise_energy(noise: Quiet, windows: Sequence[Float[np.ndarray, "_"]], length: int) -> AtRest:
    """Mean energy of noise inside windows on the lines of blocks of ``length`` samples, and its averages.

    A spectrum over white noise has as many averages as samples over the sum of its squared lag window (Priestley 1981,
    section 6.2.4).

    Examples
    --------
    White noise of variance 1 in a window of 20 samples:

    >>> white = Quiet(np.r_[1.0, np.zeros(15)], 1000)
    >>> noise_energy(white, [np.ones(20)], 64).power[:3]
    array([20., 20., 20.])
    """
    lags = min(len(noise.covariance), length // 2)
    together = np.mean([_products(window, lags) for window in windows], axis=0)
    spread = together / together[0] * (1 - np.arange(lags) / len(noise.covariance))
    averages = noise.samples / (2 * float(np.sum(spread**2)) - 1)
    lagged = np.zeros(length)
    lagged[:lags] = noise.covariance[:lags] * together
    lagged[length - lags + 1 :] = lagged[1:lags][::-1]
    return AtRest(np.maximum(scipy.fft.rfft(lagged).real, 0.0), averages)


@dataclass(frozen=True)
class LessNoise:
    """By what H1 of a point is to be multiplied (freq,), the share by which it was too low, how weak the force is
    (`ema.estimate.force_noise.weakness`), the relative variance of H1 by noise of the force alone, and the relative
    variance of the share."""

    factor: Float[np.ndarray, "freq"]
    bias: Float[np.ndarray, "freq"]
    weak: Float[np.ndarray, "freq"]
    floor: Float[np.ndarray, "freq"]
    uncertain: float

    def variance(
        self, values: Inexact[np.ndarray, "out freq"], of_h1: Float[np.ndarray, "out freq"]
    ) -> Float[np.ndarray, "out freq"]:
        """Variance of FRFs without bias (``values``) from that of H1; NaN stays NaN."""
        size = np.abs(values) ** 2
        # no less than what the noise of the force alone makes, S_nn S / (S - N)^2
        variance = np.maximum(of_h1 * self.factor**2, size * self.floor)
        variance = variance + size * (self.bias * self.factor) ** 2 * self.uncertain
        return widened(values.T[:, :, None], variance.T[:, :, None], self.weak)[:, :, 0].T


def less_noise(sums: Sums, noise: AtRest) -> LessNoise:
    """What the noise of a force makes of the H1 of ``sums``."""
    count, tiny = sums.averages, np.finfo(float).tiny
    energy = np.maximum(sums.force, tiny)
    taken = AtRest(noise.power * (count - 1) / count, noise.averages)
    alone = count * taken.power * np.sqrt(1 / count + 1 / noise.averages)
    # What is left of the force is known to no less than that: a standard deviation of 100 % where it is all there is.
    left = np.maximum(np.maximum(energy - count * taken.power, alone), tiny)
    factor = np.where(sums.force > 0, energy / left, 1.0)
    return LessNoise(
        factor,
        np.minimum(count * taken.power / energy, 1.0),
        weakness(energy / count, taken, count),
        noise.power * energy / left**2,
        1 / count + 1 / noise.averages,
    )


def about_noise(
    bias: Float[np.ndarray, "freq"],
    lost: Bool[np.ndarray, "freq"],
    frequencies: Float[np.ndarray, "freq"],
    band: Bool[np.ndarray, "freq"],
    *,
    reason: str,
    where: str,
) -> list[Finding]:
    """Findings on noise of the force within the ``band`` of the impacts; ``reason`` says why it was not taken off."""
    line = int(np.argmax(np.where(band, bias, 0.0)))
    if bias[line] < MATTERS:
        return []
    share, frequency = f"{100 * bias[line]:.2g}", f"{frequencies[line]:.4g}"
    if reason:
        return [
            Finding.of(
                "warning",
                "force-noise",
                where,
                "noise of the force channel is {share} % of the energy of the force at {frequency} Hz, by which H1 is "
                "too low. It was not taken off: {reason}.",
                float(bias[line]),
                MATTERS,
                advice="Record a second before each impact, the hammer still, and use the force window.",
                reason=reason,
                share=share,
                frequency=frequency,
            )
        ]
    findings = [
        Finding.of(
            "info",
            "force-noise",
            where,
            "noise of the force channel before the impacts is {share} % of the energy of the force at {frequency} Hz, "
            "by which H1 would be too low: it was taken off.",
            float(bias[line]),
            MATTERS,
            advice="Use the force window, a load cell of less range, or a harder tip.",
            share=share,
            frequency=frequency,
        )
    ]
    if np.any(lost & band):
        findings.append(
            Finding.of(
                "warning",
                "force-below-noise",
                where,
                "at {share} % of the lines ({bands}) the force of the impacts is not significantly above the noise of "
                "its channel: the FRFs there are not determined, and their variance is large.",
                float(np.mean(lost[band])),
                0.0,
                advice="Use the force window, strike harder, or use a harder tip.",
                share=f"{100 * np.mean(lost[band]):.2g}",
                bands=bands_of(frequencies, lost & band),
            )
        )
    return findings
