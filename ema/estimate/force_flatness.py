"""Whether the force of a random test is flat over the lines that a Hann block averages.

Under a force with the spectrum S, blocks with the spectral window K show (H S) * K / (S * K) (Bendat and Piersol 2010,
section 11.5). Where S is flat over the width of K that is H * K, whatever the structure, and a fit can take it off
(`ema.fit.broadening`). Where the structure pulls the force of a shaker down within a few lines it is something else.
With the signal of a generator as reference, S is the cross-spectrum of force and generator, whose phase changes too.
"""

from collections.abc import Sequence

import numpy as np
import scipy.ndimage
from jaxtyping import Bool, Complex, Float

from ema.data import Finding
from ema.estimate.spectra import Spectra

FLAT = 5.0
"""Range [dB] of the spectrum over `LINES` lines up to which it counts as flat. Structures that pull their force down by
6 dB change it by 4 to 5 dB, and intervals of 37 of 39 damping ratios held that were corrected for a flat force; those
that pull it down by 12 dB change it by 7 to 9 dB, and 27 of 38 held."""
CHANCE = 20.0
"""The same by the scatter of the averages, times the square root of their number: a flat force of 16, 64 and 128
averages had at most 5.2, 2.4 and 1.5 dB."""
LINES, MEAN = 9, 3
"""Lines over which the range is looked for, twice the main lobe of a Hann window; and lines of the running mean."""


def changes(power: Float[np.ndarray, "line in"]) -> Float[np.ndarray, "line in"]:
    """Range [dB] of the power spectrum of each force over `LINES` lines around each line."""
    mean = scipy.ndimage.uniform_filter1d(power, MEAN, axis=0)
    return _range(10 * np.log10(np.maximum(mean, np.finfo(float).tiny)))


def changes_of_transfer(transfer: Complex[np.ndarray, "line in"]) -> Float[np.ndarray, "line in"]:
    """The same of the transfer function from generator to force: magnitude, and phase as the logarithm has it."""
    magnitude = 20 * np.log10(np.maximum(np.abs(transfer), np.finfo(float).tiny))
    phase = 20 * np.log10(np.e) * np.unwrap(np.angle(transfer), axis=0)
    return np.asarray(np.hypot(_range(magnitude), _range(phase)))


def _range(level: Float[np.ndarray, "line in"]) -> Float[np.ndarray, "line in"]:
    highest = scipy.ndimage.maximum_filter1d(level, LINES, axis=0)
    return np.asarray(highest - scipy.ndimage.minimum_filter1d(level, LINES, axis=0))


def about_force(
    found: Spectra,
    kept: Bool[np.ndarray, "freq"] | slice,
    frequencies: Float[np.ndarray, "line"],
    *,
    inputs: Sequence[object],
    where: str,
) -> tuple[Finding, ...]:
    """A finding for each of the forces ``inputs`` that is not flat, with ``frequencies`` [Hz] of the lines ``kept``.

    The inputs of the spectra are the forces, or forces and then as many generators. Where a force begins and ends it is
    not flat either: there are no resonances whose peaks it would change.
    """
    spectra, number = np.asarray(found.inputs)[kept], len(inputs)
    power = np.diagonal(spectra, axis1=1, axis2=2).real
    change_of_force = changes(power[:, :number])
    if power.shape[1] > number:
        joint = np.diagonal(spectra[:, :number, number:], axis1=1, axis2=2)
        transfer = joint / np.maximum(power[:, number:], np.finfo(float).tiny)
        change_of_force = np.maximum(changes(power[:, number:]), changes_of_transfer(transfer))
    limit = float(np.hypot(FLAT, CHANCE / np.sqrt(max(found.averages, 1.0))))
    findings = []
    for name, change in zip(inputs, change_of_force.T, strict=True):
        runs, count = scipy.ndimage.label(change > limit)
        inside = (runs > 0) & (runs != runs[0]) & (runs != runs[-1]) if count else np.zeros(len(change), bool)
        if not inside.any():
            continue
        line = int(np.argmax(np.where(inside, change, 0.0)))
        findings.append(
            Finding.of(
                "warning",
                "force-not-flat",  # which the fit of the FRFs reads
                f"{where}, {name}",
                "the force changes by {change} dB over {lines} lines at {frequency} Hz: what Hann blocks do to peaks "
                "is not known, and the intervals of damping ratios hold the values with and without a correction.",
                float(change[line]),
                limit,
                advice="Use the local model (method = 'local'), which has no leakage, or longer blocks.",
                change=f"{change[line]:.2g}",
                lines=LINES,
                frequency=f"{frequencies[line]:.4g}",
            )
        )
    return tuple(findings)
