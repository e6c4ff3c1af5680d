"""Leakage-free FRFs from arbitrary forces: a rational model of system and transient on a few lines around each line.

The spectra of a finite record obey ``Y = G U + T + V`` exactly, where the transient T (what a window would suppress at
the price of smearing G) has the poles of G. On a few lines both are ratios of short polynomials with one denominator,
common to all responses: ``A Y_o = B_o U + C_o``. That is linear in the coefficients, and ``G = B_o / A`` at the centre.
Sources: McKelvey and Guerin 2012 (local rational method); Pintelon, Schoukens, Vandersteen and Barbe 2010 (local
polynomial method, variance).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

DEGREE = 2
"""Degree of all polynomials: two modes may lie on the lines around one line."""

SPARE = 10
"""Lines around each line in excess of the unknowns: they give the noise."""

CHUNK = 256
"""Lines that are solved together."""


@dataclass(frozen=True)
class Local:
    """FRFs, their variance (freq, out, in), and the power of response and noise per line (freq, out)."""

    values: Complex[np.ndarray, "freq out in"]
    variance: Float[np.ndarray, "freq out in"]
    noise: Float[np.ndarray, "freq out"]
    power: Float[np.ndarray, "freq out"]


def width(inputs: int) -> int:
    """Lines (odd) that enter the model of one line."""
    return ((DEGREE + 1) * (inputs + 1) + DEGREE + SPARE) // 2 * 2 + 1


def local_model(u: Complex[np.ndarray, "freq in"], y: Complex[np.ndarray, "freq out"]) -> Local:
    """FRFs on every line of the spectra ``u`` and ``y`` of a whole record (no window, lines without 0 Hz)."""
    span = width(u.shape[1])
    lines = np.arange(len(u))
    first = np.clip(lines - span // 2, 0, len(u) - span)
    pieces = []
    for start in range(0, len(u), CHUNK):
        centre = lines[start : start + CHUNK]
        around = first[centre][:, None] + np.arange(span)
        distance = (around - centre[:, None]) / (span // 2)
        pieces.append(_solve(u[around], y[around], distance))
    return Local(*(np.concatenate([getattr(p, n) for p in pieces]) for n in ("values", "variance", "noise", "power")))


def _solve(
    u: Complex[np.ndarray, "k line in"], y: Complex[np.ndarray, "k line out"], distance: Float[np.ndarray, "k line"]
) -> Local:
    """Least squares on the lines around each of k lines: numerators eliminated, denominator common to the outputs."""
    inputs = u.shape[2]
    powers = distance[:, :, None] ** np.arange(DEGREE + 1)
    regressors = np.concatenate(
        [(powers[:, :, :, None] * u[:, :, None, :]).reshape(*u.shape[:2], -1), powers.astype(complex)], axis=2
    )
    scale = np.sqrt(np.mean(np.abs(regressors) ** 2, axis=1, keepdims=True))
    q, r = np.linalg.qr(regressors / np.where(scale > 0, scale, 1))
    # Responses and the same times powers of the distance, with what numerators can explain taken out.
    targets = np.stack([y * distance[:, :, None] ** degree for degree in range(DEGREE + 1)], axis=1)
    projected = q.conj().transpose(0, 2, 1)[:, None] @ targets
    rest = targets - q[:, None] @ projected
    spare = u.shape[1] - regressors.shape[2] - DEGREE / y.shape[2]
    denominator = np.zeros((len(u), DEGREE), complex)
    weight = 1 / np.maximum(np.sum(np.abs(y) ** 2, axis=1), 1e-300)
    for _ in range(2):  # the second pass weighs the responses by the noise that the first one found
        gram = np.einsum("kalo,kblo,ko->kab", rest[:, 1:].conj(), rest[:, 1:], weight, optimize=True)
        right = np.einsum("kalo,klo,ko->ka", rest[:, 1:].conj(), rest[:, 0], weight, optimize=True)
        gram = gram + 1e-12 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(DEGREE) + 1e-300 * np.eye(DEGREE)
        denominator = -np.linalg.solve(gram, right[:, :, None])[:, :, 0]
        error = rest[:, 0] + np.einsum("ka,kalo->klo", denominator, rest[:, 1:])
        noise = np.sum(np.abs(error) ** 2, axis=1) / spare
        power = np.mean(np.abs(y) ** 2, axis=1)
        weight = 1 / np.maximum(noise, 1e-10 * power + 1e-300)
    inverse = np.linalg.inv(r)[:, :inputs] / np.where(scale > 0, scale, 1)[:, 0, :inputs, None]
    parts = inverse[:, None] @ projected
    values = parts[:, 0] + np.einsum("ka,kaio->kio", denominator, parts[:, 1:])
    spread = np.sum(np.abs(inverse) ** 2, axis=2)
    # Uncertainty of the numerators, and of the denominator through them.
    covariance = np.linalg.inv(gram)
    through = np.einsum("kaio,kab,kbio->kio", parts[:, 1:].conj(), covariance, parts[:, 1:], optimize=True).real
    variance = spread[:, :, None] * noise[:, None, :] + through
    return Local(values.transpose(0, 2, 1), variance.transpose(0, 2, 1), noise, power)
