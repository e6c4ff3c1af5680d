"""Sensors that were turned round at some points of a roving test, from FRFs with two references or more.

Near a resonance all FRFs share one residue, phi_p phi_r: the product of H_pr with the conjugate of H_ps has the phase
of phi_r phi_s at every point p. Where it has the opposite sign at some points, at the same ones for all resonances,
one of the two channels was turned round while these points were measured. Both signs in one set give the residue of
each resonance a second direction: every mode is then found twice, with interval and confidence of a true pair.
"""

from itertools import combinations

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet

FEWEST_PEAKS, FEWEST_POINTS = 3, 3
"""Resonances and points from which on signs are compared: with fewer, two modes that overlap have such a pattern by
chance."""
AGREEMENT = 0.8
"""Agreement of the signs at two points, less what disagrees, over the resonances: of nine one may disagree."""
SMALL = 0.05
"""Product of two FRFs at a point, over the largest of the resonance, below which a node is too near for its sign."""
ALIGNED = 0.7
"""Cosine of the phase against the axis of the other points, above which a product has a sign."""


def turned_sensors(frfs: FrfSet, peaks: Float[np.ndarray, "mode"]) -> list[Finding]:
    """A finding for each pair of references between which signs change from point to point."""
    by_output = frfs.values.shape[1] <= frfs.values.shape[2]
    values = np.asarray(frfs.values).transpose(0, 2, 1) if by_output else np.asarray(frfs.values)
    points, references = (frfs.inputs, frfs.outputs) if by_output else (frfs.outputs, frfs.inputs)
    lines = np.unique(np.searchsorted(frfs.frequencies, peaks).clip(1, len(frfs.frequencies) - 2))
    lines = lines[np.diff(lines, prepend=-4) > 3]
    if len(lines) < FEWEST_PEAKS or len(points) < FEWEST_POINTS:
        return []
    pairs = {}
    for first, second in combinations(range(len(references)), 2):
        products = np.sum(
            [values[lines + k, :, first] * values[lines + k, :, second].conj() for k in (-1, 0, 1)], axis=0
        )
        if (opposite := _opposite(products)).any():
            pairs[first, second] = opposite
    findings = []
    while pairs:
        # a channel that was turned round shows in every pair that it belongs to
        shown = [sum(reference in pair for pair in pairs) for reference in range(len(references))]
        worst = int(np.argmax(shown))
        own = [pair for pair in pairs if worst in pair]
        names = [str(references[worst])]
        if shown.count(shown[worst]) > 1:
            names = [str(references[reference]) for reference in own[0]]
        opposite = np.flatnonzero(np.any([pairs.pop(pair) for pair in own], axis=0))
        findings.append(_finding(frfs.name, " or ".join(names), [str(points[p]) for p in opposite]))
    return findings


def _finding(run: str, channel: str, points: list[str]) -> Finding:
    more = len(points) - 6
    return Finding.of(
        "error",
        "sensor-turned",
        f"run {run}, {channel}" if run else channel,
        "at {points} and {more} more the sign against the other channels is opposite to that at the other points at "
        "the resonances: the sensor was turned round between the points. Each mode may be found twice."
        if more > 0
        else "at {points} the sign against the other channels is opposite to that at the other points at the "
        "resonances: the sensor was turned round between the points. Each mode may be found twice.",
        float(len(points)),
        0.0,
        advice='Turn it back by a repair of the records of these points: what = "reverse sign".',
        points=", ".join(points[:6]),
        more=more,
    )


def _opposite(products: Complex[np.ndarray, "peak point"]) -> np.ndarray:
    """Points whose sign is the opposite of that of most others, at all resonances but one in nine."""
    axis = 0.5 * np.angle(np.sum(products**2, axis=1, keepdims=True))
    size = np.abs(products)
    aligned = np.real(products * np.exp(-1j * axis)) / np.maximum(size, 1e-300)
    clear = (np.abs(aligned) >= ALIGNED) & (size >= SMALL * size.max(axis=1, keepdims=True))
    sign = np.where(clear, np.sign(aligned), 0.0)
    together, both = sign.T @ sign, np.abs(sign).T @ np.abs(sign)
    known = both >= FEWEST_PEAKS
    same, against = known & (together >= AGREEMENT * both), known & (together <= -AGREEMENT * both)
    doubtful = known & ~same & ~against
    most = int(np.argmax(same.sum(axis=0)))
    opposite = against[most]
    # the two groups explain all signs, or none is named
    if not opposite.any() or doubtful.any() or opposite.sum() > same[most].sum():
        return np.zeros(len(sign.T), bool)
    return np.asarray(opposite)
