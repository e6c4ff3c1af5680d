"""From averaged auto and cross spectra to FRFs, coherence and variance (Bendat and Piersol 2010; ISO 7626-2)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from ema.errors import InputError

Estimator = Literal["H1", "H2", "Hv"]

POOLED_LINES = 11
"""Lines over which the noise of a response is averaged: three to five hits alone give it with a factor of two."""

SINGULAR = 1e-6
"""Smallest ratio of eigenvalues of the normalised input matrix with which several inputs can be told apart."""


@dataclass(frozen=True)
class Spectra:
    """Averaged spectra of one test.

    Parameters
    ----------
    inputs : ``mean(U U^H)``, shape (freq, in, in).
    cross : ``mean(Y U^H)``, shape (freq, out, in).
    outputs : ``mean(|Y|^2)``, shape (freq, out).
    averages : number of independent averages.
    parts : what parts of the test that follow each other add to these spectra, where that was kept.
    """

    inputs: Complex[np.ndarray, "freq in in"]
    cross: Complex[np.ndarray, "freq out in"]
    outputs: Float[np.ndarray, "freq out"]
    averages: float
    parts: tuple["Spectra", ...] = ()


def averaged(u: Complex[np.ndarray, "avg in freq"], y: Complex[np.ndarray, "avg out freq"], averages: float) -> Spectra:
    """Spectra of blocks that have been Fourier transformed."""
    u, y = u.transpose(2, 1, 0), y.transpose(2, 1, 0)
    count, right = u.shape[2], u.conj().transpose(0, 2, 1)
    return Spectra(u @ right / count, y @ right / count, np.mean(np.abs(y) ** 2, axis=2), averages)


def frf(spectra: Spectra, estimator: Estimator = "H1") -> Complex[np.ndarray, "freq out in"]:
    """FRFs of one or several inputs.

    ``H1`` assumes noise on the responses, ``H2`` noise on one force; ``Hv`` has the phase of H1 and the geometric mean
    of both magnitudes, so that it does not depend on the units of the channels. With several inputs H2 needs as many
    responses and is refused; Hv divides H1 by the square root of the multiple coherence, which is the same thing
    for one input.

    Parameters
    ----------
    spectra : averaged spectra; the FRFs have the unit of output over input.
    estimator : ``"H1"``, ``"H2"`` or ``"Hv"``.

    Returns
    -------
    FRFs (freq, out, in); 0 on lines where the coherence is 0 (``H2``, ``Hv``).

    Raises
    ------
    InputError : the inputs cannot be told apart; H2 with several inputs; an unknown estimator.

    Examples
    --------
    As much noise as signal in the force: H1 is half of the FRF, H2 all of it, Hv between them.

    >>> ones = np.ones((1, 1, 1), complex)
    >>> spectra = Spectra(inputs=2 * ones, cross=ones, outputs=np.ones((1, 1)), averages=100)
    >>> [round(float(frf(spectra, estimator)[0, 0, 0].real), 3) for estimator in ("H1", "H2", "Hv")]
    [0.5, 1.0, 0.707]
    """
    if estimator not in ("H1", "H2", "Hv"):
        raise InputError("unknown estimator", got=repr(estimator), expected="H1, H2 or Hv")
    h1 = _solve(spectra)
    if estimator == "H1":
        return h1
    if estimator == "H2" and spectra.inputs.shape[1] > 1:
        raise InputError("H2 is defined for one input", got=f"{spectra.inputs.shape[1]} inputs", advice="use H1 or Hv")
    coherence = multiple_coherence(spectra, h1)[:, :, None]
    divisor = coherence if estimator == "H2" else np.sqrt(coherence)
    return np.asarray(np.divide(h1, divisor, out=np.zeros_like(h1), where=divisor > 0))


def multiple_coherence(
    spectra: Spectra, h1: Complex[np.ndarray, "freq out in"] | None = None
) -> Float[np.ndarray, "freq out"]:
    """Part of each response's power that all inputs together explain; the ordinary coherence for one input."""
    h1 = _solve(spectra) if h1 is None else h1
    # H1 S_uu H1^H = S_yu H1^H: the power of the response that is linear in the inputs
    explained = np.einsum("foi,foi->fo", h1, spectra.cross.conj()).real
    ratio = np.divide(explained, spectra.outputs, out=np.zeros_like(explained), where=spectra.outputs > 0)
    return np.asarray(np.clip(ratio, 0.0, 1.0))


def input_coherence(spectra: Spectra) -> Float[np.ndarray, "freq in in"]:
    """Ordinary coherence between the inputs."""
    power = input_power(spectra)
    both = power[:, :, None] * power[:, None, :]
    shared = np.abs(spectra.inputs) ** 2
    return np.asarray(np.divide(shared, both, out=np.zeros_like(shared), where=both > 0))


def input_power(spectra: Spectra) -> Float[np.ndarray, "freq in"]:
    """Autospectra of the inputs."""
    return np.asarray(np.einsum("fii->fi", spectra.inputs).real)


def variance(
    spectra: Spectra, coherence: Float[np.ndarray, "freq out"], pooled: int = POOLED_LINES
) -> Float[np.ndarray, "freq out in"] | None:
    """Variance ``E|H - E H|^2`` of H1 from the power that the inputs do not explain.

    ``S_yy (1 - coherence) n / (n - m)`` estimates the noise of a response without bias for n averages and m inputs; it
    is pooled over ``pooled`` neighbouring lines, because a handful of averages gives it with large scatter. ``None``
    where there are no more averages than inputs: then nothing is known about the noise.
    """
    count = spectra.inputs.shape[1]
    if spectra.averages <= count:
        return None
    noise = smooth_lines(spectra.outputs * (1 - coherence), pooled) / (spectra.averages - count)
    if count == 1:
        power = spectra.inputs.real
        inverse = np.divide(1, power, out=np.full_like(power, np.inf), where=power > 0)[:, :, 0]
    else:
        # the variance of a regression coefficient: that of the noise times the diagonal of (sum u u^H)^-1
        inverse = np.einsum("fii->fi", np.linalg.inv(spectra.inputs)).real
    return np.asarray(noise[:, :, None] * inverse[:, None, :])


def smooth_lines(values: Float[np.ndarray, "freq *rest"], width: int) -> Float[np.ndarray, "freq *rest"]:
    """Running mean over ``width`` (odd) lines along the first axis; fewer at the ends of the axis."""
    half = min(width // 2, (len(values) - 1) // 2)
    total, count = values.copy(), np.full(len(values), 1.0)
    for shift in range(1, half + 1):
        for to, source in ((slice(shift, None), slice(None, -shift)), (slice(None, -shift), slice(shift, None))):
            total[to] += values[source]
            count[to] += 1
    total /= count.reshape(-1, *[1] * (values.ndim - 1))
    return total


def _solve(spectra: Spectra) -> Complex[np.ndarray, "freq out in"]:
    """``S_yu S_uu^-1``."""
    power = input_power(spectra)
    if power.shape[1] == 1:
        return np.asarray(
            np.divide(spectra.cross, power[:, None, :], out=np.zeros_like(spectra.cross), where=power[:, None, :] > 0)
        )
    # with unit diagonal, so that the units and levels of the forces do not decide whether the matrix is singular
    scale = np.sqrt(power)
    scale = np.where(scale > 0, scale, 1.0)
    normalised = spectra.inputs / (scale[:, :, None] * scale[:, None, :])
    eigenvalues = np.linalg.eigvalsh(normalised)
    bad = eigenvalues[:, 0] < SINGULAR * eigenvalues[:, -1]
    if np.mean(bad) > 0.5:
        raise InputError(
            "the inputs cannot be told apart: their spectral matrix is singular",
            got=f"singular at {100 * np.mean(bad):.0f} % of the lines with {spectra.averages:.3g} averages",
            expected=f"at least {power.shape[1]} averages of {power.shape[1]} independent forces",
            advice="drive the shakers with independent signals, or use more and shorter blocks",
        )
    normalised[bad] += SINGULAR * np.eye(power.shape[1])
    weighted = spectra.cross / scale[:, None, :]
    solved = np.linalg.solve(normalised.transpose(0, 2, 1), weighted.transpose(0, 2, 1)).transpose(0, 2, 1)
    return solved / scale[:, None, :]
