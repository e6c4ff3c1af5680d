"""FRFs of one force at a time, with the frequency axis last: the inner loop of hammer and sweep tests."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ema.errors import InputError
from ema.estimate.spectra import POOLED_LINES, Estimator


@dataclass(frozen=True)
class Sums:
    """Sums over blocks: ``force`` = sum |F|^2 (freq,), ``cross`` = sum Y F*, ``response`` = sum |Y|^2."""

    force: Float[np.ndarray, "freq"]
    cross: Complex[np.ndarray, "out freq"]
    response: Float[np.ndarray, "out freq"]
    averages: int

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(
            self.force + other.force,
            self.cross + other.cross,
            self.response + other.response,
            self.averages + other.averages,
        )


def summed(f: Complex[np.ndarray, "freq"], y: Complex[np.ndarray, "out freq"]) -> Sums:
    """Sums of one block whose spectra are ``f`` and ``y``."""
    return Sums(f.real**2 + f.imag**2, y * f.conj(), y.real**2 + y.imag**2, 1)


def estimate(
    sums: Sums, estimator: Estimator
) -> tuple[Complex[np.ndarray, "out freq"], Float[np.ndarray, "out freq"], Float[np.ndarray, "out freq"]]:
    """FRFs, coherence and variance from the sums over blocks with one force.

    H1 = S_yf / S_ff; H2 = S_yy / S_fy; Hv = sqrt(|H1 H2|) with the phase of S_yf (Bendat and Piersol 2010). Lines
    without force are 0. The noise behind the variance is averaged over ``POOLED_LINES`` lines.

    Parameters
    ----------
    sums : of one block or more; the FRFs have the unit of response over force.
    estimator : ``"H1"``, ``"H2"`` or ``"Hv"``.

    Returns
    -------
    FRFs (out, freq), coherence (out, freq) between 0 and 1, and variance (out, freq) of the FRFs; the coherence of a
    single block is 1 and its variance NaN.

    Raises
    ------
    InputError : an unknown estimator.

    Examples
    --------
    Noise on the response alone: H1 is the mean, and its variance what four blocks leave of the noise.

    >>> rng = np.random.default_rng(1)
    >>> force = np.ones(200, complex)
    >>> noise = 0.1 * (rng.standard_normal((4, 1, 200)) + 1j * rng.standard_normal((4, 1, 200)))
    >>> first, *others = (summed(force, 2 * force + each) for each in noise)
    >>> h1, _, variance = estimate(sum(others, start=first), "H1")
    >>> round(float(abs(h1.mean())), 1), round(float(variance.mean()), 3)
    (2.0, 0.005)
    """
    inverse = reciprocal(sums.force)
    # of sums instead of means the number of averages cancels in H1 and in the coherence |S_yf|^2 / (S_ff S_yy)
    h1 = sums.cross * inverse
    power = sums.cross.real**2 + sums.cross.imag**2
    coherence = np.minimum(power * inverse * reciprocal(sums.response), 1.0)
    if sums.averages > 1:
        # S_nn = n / (n - 1) (1 - coherence) S_yy and var H1 = S_nn / (n S_ff), for n averages (Bendat and Piersol 2010)
        noise = pooled(sums.response * (1 - coherence)) / (sums.averages - 1)
        variance = noise * inverse
    else:
        variance = np.full(coherence.shape, np.nan)
    factor = over_h1(coherence, estimator)
    return (h1, coherence, variance) if factor is None else (h1 * factor, coherence, variance * factor**2)


def over_h1(coherence: Float[np.ndarray, "*shape"], estimator: Estimator) -> Float[np.ndarray, "*shape"] | None:
    """Factor by which an estimate exceeds H1; ``None`` for H1 itself.

    Raises
    ------
    InputError : an unknown estimator.
    """
    if estimator == "H1":
        return None
    if estimator not in ("H2", "Hv"):
        raise InputError("unknown estimator", got=repr(estimator), expected="H1, H2 or Hv")
    # H2 = S_yy / S_fy = H1 / coherence, and |Hv| = sqrt(|H1 H2|) = |H1| / sqrt(coherence)
    return reciprocal(coherence if estimator == "H2" else np.sqrt(coherence))


def reciprocal(values: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """``1 / values``, and 0 where a value is 0: nothing is known there."""
    return np.asarray(np.divide(1.0, values, out=np.zeros_like(values), where=values > 0))


def pooled(values: Float[np.ndarray, "out freq"], lines: int = POOLED_LINES) -> Float[np.ndarray, "out freq"]:
    """Mean over ``lines`` (odd) neighbouring lines; fewer at the ends of the axis."""
    half = min(lines // 2, (values.shape[1] - 1) // 2)
    if half == 0:
        return values
    total = np.pad(values, ((0, 0), (half, half)), mode="reflect")
    # Sums over 2, 4, 8 ... lines by doubling; the span is put together from them like a binary number.
    span, result, start, size = 2 * half + 1, None, 0, values.shape[1]
    width = 1
    while width <= span:
        if span & width:
            part = total[:, start : start + size]
            result = part.copy() if result is None else result + part
            start += width
        total = total[:, :-width] + total[:, width:]
        width *= 2
    assert result is not None
    return np.asarray(result / span)
