"""Frequency lines denser than the records resolve, as appended zeros make them.

Zeros appended to records of length T until they are k T long interpolate between the lines that are 1/T apart: the
noise of their FRFs, transformed back, fills one k-th of the period of the lines and leaves the rest silent. Lines 1/T
apart hold all of it (sampling theorem, with time and frequency exchanged), and there errors are independent.

FRFs are low-pass signals over frequency then, with a band of 1/k, and are sampled anew as such: at lines that they
have where k is a whole number, and otherwise by a sinc function under a Kaiser window (Oppenheim and Schafer 1989).
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.signal
from jaxtyping import Complex, Float

from ema.data import FrfSet
from ema.fit import noise
from ema.fit.compression import SAMPLE

_FEWEST = 200
"""Lines from which on silence is looked for: the taper spreads an instant over a fiftieth of the period then."""
_SILENCE = np.log(100.0)
"""Power of the noise over that of what is silent. Nothing that lines further apart lose or fold back is more than a
hundredth of the noise. Where steady noise falls most, it was 2e5 and more in FRFs of 30 padded records (densities of
1.25 to 8), and at most 4 in those of 40 random systems."""
_STEADY = np.log(4.0)
"""Change of the power before the silence, over as many lines as it falls within, up to which it is noise that ends
there: a vibration that fades does so at one rate."""
_QUIETER = np.log(10.0)
"""Power of noise that is independent from line to line, by differences of lines, over that of what is silent.
Independent noise has 1; zeros that make lines 1.25 to 8 times as dense leave 1e6 and more."""
_LEAST = 1.2
"""Density of lines from which on they are sampled anew. Below, errors of lines count for too many by a fifth at most
(intervals by a tenth), and the sinc function would need a good part of the band."""
_WHOLE = (0.9, 1.05)
"""Density over a whole number within which it is taken for this. What is silent seems a few lines shorter than it is,
for a taper spreads the beginning of strong vibrations: 0.96 to 0.98 of the density was seen (500 to 3200 lines). At
most a tenth of the noise is lost, and errors of lines count for too many by a twentieth at most."""
_ATTENUATION = 80.0
"""dB by which the sinc function suppresses what sampling would fold back: to 1e-4 of its amplitude. A higher value
needs more of the band for the length of the function (Kaiser's formula, Oppenheim and Schafer 1989)."""
_LOBE = 2
"""Lines to either side over which the Hann taper spreads an instant: half of its main lobe (Harris 1978)."""


@dataclass(frozen=True)
class Density:
    """How many times as dense as the records resolve lines are, and the middle of the records in the period of the
    lines, each over that period.
    """

    factor: float
    middle: float

    @property
    def whole(self) -> int:
        """The whole number that the factor is, 0 where it is none."""
        nearest = round(self.factor)
        return nearest if nearest >= 2 and _WHOLE[0] * nearest <= self.factor <= _WHOLE[1] * nearest else 0


def density(frfs: FrfSet) -> Density | None:
    """How dense the lines of FRFs are; ``None`` where they are no denser than the records resolve.

    FRFs of which it is known how their lines correlate are not looked at.
    """
    step, count = np.diff(frfs.frequencies), len(frfs.frequencies)
    if count < _FEWEST or frfs.lines_correlate or frfs.in_file or frfs.deviations is not None:
        return None
    if np.ptp(step) > 1e-3 * step.mean():
        return None
    rows = np.asarray(frfs.values).reshape(count, -1).T
    rows = rows[:: max(1, rows.size // SAMPLE)]
    rows = rows[np.all(np.isfinite(rows), axis=1) & np.any(rows != 0, axis=1)]
    if not len(rows):
        return None
    level = _level(rows)
    silence = _silence(level)
    if silence is None:
        return None
    first, length = silence
    # A vibration that ends on the way, as in FRFs of reversed phase, leaves the noise of the lines behind it.
    if np.median(np.roll(level, -first)[:length]) > _noise_of_lines(rows) - _QUIETER:
        return None
    factor = count / (count - length)
    if frfs.record_length is not None:
        factor = 1 / (frfs.record_length * frfs.frequency_step)
    if factor < _LEAST:
        return None
    return Density(factor, ((first + length) / count + 0.5 * (1 - length / count)) % 1.0)


def _level(rows: Complex[np.ndarray, "row line"]) -> Float[np.ndarray, "time"]:
    """Mean of the logarithm of the power of FRFs over the period of their lines."""
    power = np.abs(np.fft.ifft(rows * scipy.signal.windows.hann(rows.shape[1], sym=False), axis=1)) ** 2
    return np.asarray(np.mean(np.log(np.maximum(power, np.finfo(float).tiny)), axis=0))


def _noise_of_lines(rows: Complex[np.ndarray, "row line"]) -> float:
    """Level (`_level`) of noise that is independent from line to line, of the size that differences of lines show."""
    taper = scipy.signal.windows.hann(rows.shape[1], sym=False)
    level = noise.from_differences(rows.T[:, :, None])
    std = np.median(level.lines) * level.outputs * level.references
    # Of the complex noise, twice the variance of its real part.
    return float(np.mean(np.log(2 * std**2 * np.sum(taper**2) / taper.size**2)))


def _silence(level: Float[np.ndarray, "time"]) -> tuple[int, int] | None:
    """Beginning and length of the longest silence that noise ends with."""
    count = len(level)
    width = min(16, count // 25)
    sums = np.cumsum(np.concatenate([np.zeros(1), np.tile(level, 3)]))
    at = np.arange(count, 2 * count)
    before = (sums[at] - sums[at - width]) / width
    earlier = [(sums[at - k * width] - sums[at - (k + 1) * width]) / width for k in (1, 2)]
    after = (sums[at + 2 * _LOBE + width] - sums[at + 2 * _LOBE]) / width
    steady = np.max(np.abs(np.array(earlier) - before), axis=0) < _STEADY
    ends = np.flatnonzero(steady & (before - after > _SILENCE))
    best = (0, 0)
    for end in ends.tolist():
        loud = np.flatnonzero(np.roll(after, -end) > before[end] - _SILENCE)
        length = int(loud[0]) + width + 2 * _LOBE if len(loud) else 0
        if length > best[1]:
            best = (end + _LOBE, length - 2 * _LOBE)
    return best if best[1] > 2 * width else None


def resolved(frfs: FrfSet, dense: Density) -> FrfSet:
    """FRFs at the lines that the records resolve, 1/T apart from 0 Hz on."""
    step, first = frfs.frequency_step, float(frfs.frequencies[0])
    if dense.whole:
        number = np.round(frfs.frequencies / step).astype(int)
        return frfs.lines(number % dense.whole == 0)
    # Low-pass filter with its transition from 1/k to 2 - 1/k of the Nyquist frequency.
    taps, beta = scipy.signal.kaiserord(_ATTENUATION, 2 * (1 - 1 / dense.factor))
    reach = taps // 2 + 1
    spacing = dense.factor * step
    lowest, highest = first + (reach - 1) * step, first + (len(frfs.frequencies) - reach) * step
    frequencies = spacing * np.arange(np.ceil(lowest / spacing), np.floor(highest / spacing) + 1)
    position = (frequencies - first) / step
    below = np.floor(position).astype(int)
    turn = 2j * np.pi * dense.middle
    values = np.zeros((len(frequencies), *frfs.values.shape[1:]), complex)
    for tap in range(1 - reach, reach + 1):
        line = np.clip(below + tap, 0, len(frfs.frequencies) - 1)
        distance = position - (below + tap)
        inside = np.maximum(1 - (distance / reach) ** 2, 0)
        weight = np.sinc(distance) * np.i0(beta * np.sqrt(inside)) / np.i0(beta) * (np.abs(distance) < reach)
        # Turned back by the middle of the records, FRFs vary as slowly over lines as they can.
        values += (weight * np.exp(-turn * distance))[:, None, None] * frfs.values[line]
    nearest = frfs.lines(np.round(position).astype(int))
    return replace(nearest, frequencies=frequencies, values=values)
