"""FRFs of sweeps that repeat: the force of the other records as reference, so that noise of the force has no bias.

H1 = S_yf / S_ff is too low by the share of noise in S_ff, which is large where the structure pulls the force down at
its resonances: damping is read too high. The force of one record knows nothing of the noise in another one
(instrumental variable, Wellstead 1981; for periodic signals the mean before the division, Pintelon and Schoukens 2012).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Finding
from ema.estimate import single_input
from ema.estimate.detection_lines import excited_lines
from ema.estimate.single_input import Sums

REPEATS = 0.95
"""Share of the force's power that all records have in common, from which on they repeat one sweep."""

MATTERS = 0.01
"""Share of noise in the force's power on a line, by which H1 is too low there, from which on the other records are the
reference. Half of it changes peaks by less than the noise of few sweeps; twice as much leaves damping 2 % too high."""


@dataclass(frozen=True)
class SpectraSums:
    """Sums of the spectra of forces and responses over records."""

    force: Complex[np.ndarray, "freq"]
    response: Complex[np.ndarray, "out freq"]

    def __add__(self, other: "SpectraSums") -> "SpectraSums":
        return SpectraSums(self.force + other.force, self.response + other.response)


@dataclass(frozen=True)
class Repeats:
    """FRFs and variance with the other records as reference, and the largest share of noise in the force's power."""

    values: Complex[np.ndarray, "out freq"]
    variance: Float[np.ndarray, "out freq"]
    share: float
    line: int


def repeats(sums: Sums, spectra: SpectraSums, keep: slice) -> Repeats | None:
    """FRFs of repeated sweeps with the force of the other records as reference.

    Parameters
    ----------
    sums : sums of powers and cross spectra over the records.
    spectra : sums of the spectra themselves over the same records, which begin at the same phase of the sweep.
    keep : lines of the band that is kept; only there is judged whether the sweeps repeat and whether noise matters.

    Returns
    -------
    FRFs and variance on all lines; ``None`` where H1 is as good: a single record, sweeps that do not repeat (share of
    common power below ``REPEATS``), or less noise in the force than ``MATTERS`` at every peak.
    """
    count = sums.averages
    if count < 2:
        return None
    # sums over pairs of different records: what is common to all
    force = np.abs(spectra.force) ** 2 - sums.force
    cross = spectra.response * spectra.force.conj() - sums.cross
    if force[keep].sum() < REPEATS * (count - 1) * sums.force[keep].sum():
        return None
    noise = single_input.pooled(np.maximum(sums.force - np.abs(spectra.force) ** 2 / count, 0.0)[None, :])[0]
    share = noise * count * single_input.reciprocal(noise * count + np.maximum(force, 0.0))
    share = share[keep]
    answer = np.mean(
        sums.response[:, keep] / np.maximum(sums.response[:, keep].max(axis=1, keepdims=True), 1e-300), axis=0
    )
    driven = np.zeros(len(share), bool)
    driven[excited_lines(np.sqrt(sums.force[keep]))] = True
    # lines that a multisine leaves out have no force, the ends of the band little force and no peak
    share = np.where(driven & (answer >= np.median(answer)), share, 0.0)
    if share.max() < MATTERS:
        return None
    # where the mean of the forces is no more than its noise, that is what is known of it: a standard deviation of 100 %
    inverse = single_input.reciprocal(np.maximum(force, noise))
    values = cross * inverse
    size = np.abs(values) ** 2
    left = np.maximum(sums.response - 2 * np.real(values.conj() * sums.cross) + size * sums.force, 0.0)
    # noise of the force follows the FRF, which pooling over lines would smooth
    variance = np.maximum(single_input.pooled(left), size * noise) * inverse
    return Repeats(values, variance, float(share.max()), keep.start + int(share.argmax()))


def finding(repeated: Repeats, frequency: float, where: str) -> Finding:
    """What the force of the others was taken for."""
    return Finding.of(
        "info",
        "force-noise",
        where,
        "noise is {share} % of the power of the force at {frequency} Hz, by which H1 would be too "
        "low: the force of the other records is the reference.",
        repeated.share,
        MATTERS,
        advice="Use a load cell of less range, or more force at the resonances.",
        share=f"{100 * repeated.share:.2g}",
        frequency=f"{frequency:.4g}",
    )
