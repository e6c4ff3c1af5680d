"""Peaks of the FRFs that the fit leaves: neither a mode nor a candidate is there for them.

A resonance that the fit has, though badly, leaves a residual with its own shape and participation: that of a peak that
leans, or moves (`ema.fit.peak_shape`). What lies outside these beside it is another resonance, as the second one of a
repeated root, or one that no pole is near.
"""

from dataclasses import dataclass

import numpy as np
import scipy.signal
from jaxtyping import Bool, Complex, Float

from ema.data import Finding
from ema.fit import estimator
from ema.fit.estimator import Fit, Observations
from ema.fit.policy import POLICY
from ema.fit.refinement import Refined
from ema.fit.search import MISFIT

PROMINENCE = 4.0
"""Energy of the residual at a maximum over that of the higher one of the minima beside it (6 dB), from which on it is a
peak."""
BEYOND = 10.0
"""Mean energy of the residual of an FRF at a peak over its median in the band, from which on it is no noise that is the
same at all lines; noise that grows with the FRF is a small share of it."""
_ON_PEAK = 3.0
"""Decay rates from a pole within which a line is on its peak, which has fallen by 10 dB there."""
_MOVED = 0.0015
"""Relative distance from a pole within which a resonance that is not in the same place in all records leaves its peaks,
as between the two poles that it may take (`ema.fit.selection`)."""
_LEAST = 1
"""Lines on either side of a maximum at least that belong to its peak, as for the energy of a mode."""
_MOST = 64
"""Maxima that are looked at, the largest first: a bound on the work."""
_NAMED = 6
"""Peaks that are named, the largest shares first; the others are counted. No value depends on it."""


@dataclass(frozen=True)
class Peak:
    """Frequency [Hz] of a peak that the fit leaves, and the largest share of it of the energy of an FRF within its
    half-power bandwidth, among the FRFs that are as large there as they are on average."""

    frequency: float
    share: float


def unexplained(optimum: Refined, derivative: int) -> tuple[Peak, ...]:
    """Peaks of which an FRF leaves what would be seen as a mode (`POLICY.visible`), by frequency.

    Parameters
    ----------
    derivative : power of ``s`` from receptances to the FRFs as measured.
    """
    data, fit = optimum.data, optimum.fit
    if not optimum.misfit:
        # What noise cannot explain has been searched for in every line.
        return ()
    curve = np.abs(data.s) ** (2 * derivative)
    sizes, medians, energy = [], [], np.zeros(len(data.s))
    for rows in data.row_blocks(data.signals[0].size, estimator.VALUES):
        left = np.abs(estimator.residual(data, fit, rows)) ** 2 * curve
        size = np.maximum(np.mean(np.abs(data.signals[rows]) ** 2 * curve, axis=-1), np.finfo(float).tiny)
        energy += np.sum(left / size[..., None], axis=(0, 1, 2))
        sizes.append(size)
        medians.append(np.median(left, axis=-1))
    size, median = np.concatenate(sizes), np.concatenate(medians)
    places, _ = scipy.signal.find_peaks(energy, height=np.finfo(float).tiny)
    level = np.log(np.maximum(energy, np.finfo(float).tiny))
    places = places[scipy.signal.peak_prominences(level, places)[0] >= np.log(PROMINENCE)]
    places = np.sort(places[np.argsort(-energy[places])][:_MOST])
    found = []
    for place in places.tolist():
        if data.references == 1 and np.min(np.abs(data.s[place].imag / fit.poles.imag - 1), initial=1.0) < _MOVED:
            # One reference takes any shape of a mode: what is left beside it has moved between the records.
            continue
        below = energy < 0.5 * energy[place]
        lines = _half_power(below, place)
        own = data.lines(lines)
        there = np.mean(np.abs(own.signals) ** 2 * curve[lines], axis=-1)
        other = _of_other_shape(own, fit, size)
        if _correlation(other / np.sqrt(size)[..., None]) <= MISFIT:
            continue
        left = np.mean(np.abs(other) ** 2 * curve[lines], axis=-1)
        seen = (there >= size) & (left >= BEYOND * median)
        share = float(np.max(left / np.maximum(there, np.finfo(float).tiny), where=seen, initial=0.0))
        if share >= POLICY.visible:
            found.append(Peak(float(data.s[place].imag) / (2 * np.pi), share))
    return tuple(found)


def _half_power(below: Bool[np.ndarray, "line"], place: int) -> slice:
    """Lines around a maximum up to the first on either side that is below half of it."""
    before, after = np.flatnonzero(below[:place]), np.flatnonzero(below[place:])
    first = int(before[-1]) + 1 if len(before) else 0
    last = place + int(after[0]) if len(after) else len(below)
    return slice(min(first, max(place - _LEAST, 0)), max(last, place + _LEAST + 1))


def _correlation(values: Complex[np.ndarray, "row member in line"]) -> float:
    """Correlation of neighbouring lines, which a resonance has from a bandwidth of one line on, and a tone has not."""
    together = float(np.sum((values[..., 1:] * values[..., :-1].conj()).real))
    return together / max(float(np.sum(np.abs(values) ** 2)), np.finfo(float).tiny)


def _of_other_shape(
    there: Observations, fit: Fit, size: Float[np.ndarray, "row member in"]
) -> Complex[np.ndarray, "row member in line"]:
    """The residual of some lines without what has the shape and the participation of the poles whose peak these are
    on, each FRF in units of its own size."""
    left, scale = estimator.residual(there, fit), np.sqrt(size)
    distance = np.min(np.abs(there.s.imag[:, None] - fit.poles.imag), axis=0)
    near = distance <= _ON_PEAK * np.abs(fit.poles.real)
    if not near.any():
        return left
    residues = (fit.shapes[:, :, None] * fit.participation)[..., near] / scale[..., None]
    basis, strength, _ = np.linalg.svd(residues.reshape(size.size, -1), full_matrices=False)
    basis = basis[:, strength > 1e-9 * strength[0]]
    flat = (left / scale[..., None]).reshape(size.size, -1)
    return np.asarray((flat - basis @ (basis.conj().T @ flat)).reshape(left.shape) * scale[..., None])


def findings(peaks: tuple[Peak, ...], where: str) -> tuple[Finding, ...]:
    """What is said of such peaks."""
    if not peaks:
        return ()
    largest = sorted(peaks, key=lambda peak: -peak.share)
    listed = ", ".join(f"{peak.frequency:.6g} Hz ({min(peak.share, 1):.0%})" for peak in largest[:_NAMED])
    return (
        Finding.of(
            "error",
            "unexplained-peak",
            where,
            "The fit leaves {count} peaks of the FRFs unexplained, with these shares of the energy of an FRF there: "
            "{listed}. Neither the modes nor the candidates describe them: modes are missing, or resonances are not in "
            "the same place in all records.",
            largest[0].share,
            POLICY.visible,
            advice="Do not use the modes at these frequencies: fit a narrower band around each, or measure with "
            "another reference or a finer frequency resolution.",
            count=len(peaks),
            listed=listed + (", ..." if len(peaks) > _NAMED else ""),
        ),
    )
