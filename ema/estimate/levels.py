"""Whether an FRF depends on how hard the impact was, and the levels a campaign holds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ema.data import HitGallery

SPREAD = 1.5
"""Ratio of the hardest to the softest impact (1.2 / 0.8) up to which impacts count as one level."""


@dataclass(frozen=True)
class LevelEffect:
    """How much of the response power follows the level of the impacts.

    ``explained`` by an FRF that changes linearly with the level, ``rest`` that remains per degree of freedom, and
    ``total`` explained by one FRF; sums over lines and responses.
    """

    explained: float
    rest: float
    total: float

    @property
    def change(self) -> float:
        """Relative change of the FRF over the range of levels (energy-weighted), noise taken off."""
        return float(np.sqrt(max(self.explained - self.rest, 0.0) / self.total)) if self.total > 0 else 0.0

    @property
    def ratio(self) -> float:
        """Explained over unexplained power: near 1 for a linear structure with noise."""
        return self.explained / self.rest if self.rest > 0 else np.inf if self.explained > 0 else 0.0


def level_effect(
    spectra: Sequence[tuple[Complex[np.ndarray, "freq"], Complex[np.ndarray, "out freq"]]],
    peaks: Float[np.ndarray, "avg"],
) -> LevelEffect | None:
    """Least squares of ``Y = (H0 + H1 level) F`` over the spectra (F, Y) of the impacts on one point.

    ``None`` for fewer than three impacts or equal levels. Only lines up to where the force has fallen by 10 dB count.
    """
    if len(peaks) < 3 or peaks.max() < SPREAD * peaks.min():
        return None
    force, response = np.stack([f for f, _ in spectra]), np.stack([y for _, y in spectra])
    level = (peaks - peaks.mean()) / np.ptp(peaks)
    powers = np.stack([level**0, level, level**2])
    weight = force.real**2 + force.imag**2
    total_force = weight.sum(axis=0)
    keep = slice(0, int(np.flatnonzero(total_force > 0.1 * total_force.max())[-1]) + 1)
    f, y = force[:, keep], response[:, :, keep]
    # normal equations of H0 and H1 on a line: [[a, b], [b, c]] [H0, H1] = [p, q] with a, b, c = sum of l^0, l^1, l^2
    # times |F|^2 and p, q = sum of l^0, l^1 times Y F*, l the level about its mean over its range
    a, b, c = powers @ weight[:, keep]
    product = (y * f.conj()[:, None, :]).reshape(len(peaks), -1)
    p, q = (powers[:2].astype(product.dtype) @ product).reshape(2, *y.shape[1:])
    determinant = a * c - b**2
    h1 = (a * q - b * p) / determinant
    # what H1 takes off the sum of squares that H0 alone leaves
    explained = np.abs(h1) ** 2 * determinant / a
    total = np.abs(p) ** 2 / a
    rest = (np.sum(np.abs(y) ** 2, axis=0) - total - explained) / (len(peaks) - 2)
    return LevelEffect(float(explained.sum()), float(np.maximum(rest, 0).sum()), float(total.sum()))


def pooled_effect(effects: list[LevelEffect]) -> LevelEffect:
    """The effects of all points together."""
    return LevelEffect(*(float(sum(getattr(one, name) for one in effects)) for name in ("explained", "rest", "total")))


def level_bins(gallery: HitGallery, tolerance: float = 0.2) -> tuple[tuple[float, float], ...]:
    """Group the accepted impacts of a run by their peak force.

    Use the ranges as ``level`` of :func:`ema.estimate.hammer`, softest first.

    Parameters
    ----------
    gallery : HitGallery
        Impacts of a run.
    tolerance : float, default 0.2
        Each range reaches at most ``1 +- tolerance`` around its middle.

    Returns
    -------
    tuple of tuple of (float, float)
        Ranges of peak force [N], softest first, that together hold all accepted impacts.

    Examples
    --------
    >>> from ema.data import Hit
    >>> zero = np.zeros(1)
    >>> impacts = tuple(Hit("r", 0, None, 0.0, peak, 1.0, 1e-3, True, "", zero, 1.0) for peak in (50.0, 55.0, 200.0))
    >>> level_bins(HitGallery(impacts, zero, zero, (0.0, 0.0)))
    ((50.0, 55.0), (200.0, 200.0))
    """
    peaks = np.sort([abs(hit.peak) for hit in gallery.accepted])
    width = (1 + tolerance) / (1 - tolerance)
    bins = []
    while len(peaks):
        # The densest bin first, so that a cluster of levels is not cut in two.
        counts = np.searchsorted(peaks, peaks * width * (1 + 1e-12), side="right") - np.arange(len(peaks))
        first = int(np.argmax(counts))
        members = peaks[first : first + counts[first]]
        bins.append((float(members[0]), float(members[-1])))
        peaks = np.delete(peaks, slice(first, first + counts[first]))
    return tuple(sorted(bins))
