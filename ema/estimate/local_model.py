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
    """Least squares on the lines around each of k lines, twice.

    The residual of ``A Y = B U + C`` is the noise times A. The second pass divides by the A of the first one
    (Sanathanan and Koerner 1963), so that lines count by their own noise, and weighs the responses by theirs.
    """
    powers = distance[:, :, None] ** np.arange(DEGREE + 1)
    regressors = np.concatenate(
        [(powers[:, :, :, None] * u[:, :, None, :]).reshape(*u.shape[:2], -1), powers.astype(complex)], axis=2
    )
    # Responses and the same times powers of the distance.
    targets = y[:, None] * powers.transpose(0, 2, 1)[:, :, :, None]
    power = np.mean(np.abs(y) ** 2, axis=1)
    lines, responses = np.ones(distance.shape), 1 / np.maximum(power, 1e-300)
    for _ in range(2):
        local, denominator = _weighted(regressors, targets, lines, responses, u.shape[2])
        size = np.abs(1 + np.einsum("ka,kla->kl", denominator, powers[:, :, 1:]))
        lines = 1 / np.maximum(size, 1e-3)
        responses = 1 / np.maximum(local.noise, 1e-10 * power + 1e-300)
    return Local(local.values, local.variance, local.noise, power)


def _weighted(
    regressors: Complex[np.ndarray, "k line unknown"],
    targets: Complex[np.ndarray, "k power line out"],
    lines: Float[np.ndarray, "k line"],
    responses: Float[np.ndarray, "k out"],
    inputs: int,
) -> tuple[Local, Complex[np.ndarray, "k degree"]]:
    """One weighted least squares: numerators eliminated by QR, then the denominator common to all responses."""
    regressors, targets = regressors * lines[:, :, None], targets * lines[:, None, :, None]
    scale = np.sqrt(np.mean(np.abs(regressors) ** 2, axis=1, keepdims=True))
    scale = np.where(scale > 0, scale, 1)
    # B and C of every response by projection; what is left of Y times the powers determines A alone
    q, r = np.linalg.qr(regressors / scale)
    projected = q.conj().transpose(0, 2, 1)[:, None] @ targets
    rest = targets - q[:, None] @ projected
    # degrees of freedom of the noise; A costs each response its share of what all determine together
    spare = regressors.shape[1] - regressors.shape[2] - DEGREE / targets.shape[3]
    gram = np.einsum("kalo,kblo,ko->kab", rest[:, 1:].conj(), rest[:, 1:], responses, optimize=True)
    right = np.einsum("kalo,klo,ko->ka", rest[:, 1:].conj(), rest[:, 0], responses, optimize=True)
    gram = gram + (1e-12 * np.trace(gram, axis1=1, axis2=2).real[:, None, None] + 1e-300) * np.eye(DEGREE)
    denominator = -np.linalg.solve(gram, right[:, :, None])[:, :, 0]
    error = rest[:, 0] + np.einsum("ka,kalo->klo", denominator, rest[:, 1:])
    noise = np.sum(np.abs(error) ** 2, axis=1) / spare
    # at the line itself the distance is 0: A is 1, and H is the numerator of order 0
    inverse = np.linalg.inv(r)[:, :inputs] / scale[:, 0, :inputs, None]
    parts = inverse[:, None] @ projected
    values = parts[:, 0] + np.einsum("ka,kaio->kio", denominator, parts[:, 1:])
    # Uncertainty of the numerators, and of the denominator through them.
    spread = np.sum(np.abs(inverse) ** 2, axis=2)
    through = np.einsum("kaio,kab,kbio->kio", parts[:, 1:].conj(), np.linalg.inv(gram), parts[:, 1:], optimize=True)
    variance = spread[:, :, None] * noise[:, None, :] + through.real
    return Local(values.transpose(0, 2, 1), variance.transpose(0, 2, 1), noise, np.zeros_like(noise)), denominator
