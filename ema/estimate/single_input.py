"""FRFs of one force at a time, with the frequency axis last: the inner loop of hammer and sweep tests."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ema.errors import InputError
from ema.estimate.spectra import POOLED_LINES, Estimator


@dataclass(frozen=True)
class Sums:
    """Sums over blocks: ``force`` = sum |F|^2 (freq,), ``cross`` = sum Y F* and ``response`` = sum |Y|^2 (out, freq)."""

    force: Float[np.ndarray, "freq"]
    cross: Complex[np.ndarray, "out freq"]
    response: Float[np.ndarray, "out freq"]
    averages: int

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(
            self.force + other.force, self.cross + other.cross, self.response + other.response,
            self.averages + other.averages,
        )  # fmt: skip


def summed(f: Complex[np.ndarray, "avg freq"], y: Complex[np.ndarray, "avg out freq"]) -> Sums:
    """Sums over the blocks whose spectra are ``f`` and ``y``."""
    return Sums(
        np.einsum("af,af->f", f.real, f.real) + np.einsum("af,af->f", f.imag, f.imag),
        np.einsum("aof,af->of", y, f.conj()),
        np.einsum("aof,aof->of", y.real, y.real) + np.einsum("aof,aof->of", y.imag, y.imag),
        len(f),
    )


def estimate(
    sums: Sums, estimator: Estimator
) -> tuple[Complex[np.ndarray, "out freq"], Float[np.ndarray, "out freq"], Float[np.ndarray, "out freq"]]:
    """FRFs, coherence and variance.

    H1 = S_yf / S_ff; H2 = S_yy / S_fy; Hv = sqrt(|H1 H2|) with the phase of S_yf. The variance is NaN for one average.

    Raises
    ------
    InputError : an unknown estimator.
    """
    inverse = reciprocal(sums.force)
    h1 = sums.cross * inverse
    power = sums.cross.real**2 + sums.cross.imag**2
    coherence = np.minimum(power * inverse * reciprocal(sums.response), 1.0)
    if sums.averages > 1:
        noise = pooled(sums.response * (1 - coherence)) / (sums.averages - 1)
        variance = noise * inverse
    else:
        variance = np.full(coherence.shape, np.nan)
    if estimator == "H1":
        return h1, coherence, variance
    if estimator not in ("H2", "Hv"):
        raise InputError("unknown estimator", got=repr(estimator), expected="H1, H2 or Hv")
    factor = reciprocal(coherence if estimator == "H2" else np.sqrt(coherence))
    return h1 * factor, coherence, variance * factor**2


def reciprocal(values: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """``1 / values``, and 0 where a value is 0: nothing is known there."""
    return np.divide(1.0, values, out=np.zeros_like(values), where=values > 0)


def pooled(values: Float[np.ndarray, "out freq"], lines: int = POOLED_LINES) -> Float[np.ndarray, "out freq"]:
    """Mean over ``lines`` (odd) neighbouring lines; fewer at the ends of the axis."""
    half = min(lines // 2, (values.shape[1] - 1) // 2)
    total, count = values.copy(), np.ones(values.shape[1])
    for shift in range(1, half + 1):
        total[:, shift:] += values[:, :-shift]
        total[:, :-shift] += values[:, shift:]
        count[shift:] += 1
        count[:-shift] += 1
    return total / count
