"""Poly-reference least-squares complex frequency estimation: all model orders from one factorisation.

The FRFs (rows over the references) are modelled as ``H(z) A(z) = B(z)`` with polynomials in ``z = exp(j w T)``
(Guillaume et al. 2003, Peeters et al. 2004). Three choices differ from the textbook:

- The coefficients are complex and the band alone is mapped on the circle, shifted to its first line. Conjugate poles
  then need no room, and an order gives its poles at half the size of the real eigenvalue problem.
- The band covers 1/1.2 of the circle only. The rest is empty, so that modes just outside the band keep their own place
  instead of wrapping to the opposite end.
- The outputs are rotated onto the directions that stand out of the noise: noise in the equations biases damping, and
  directions that hold noise alone contribute nothing else.

All normal matrices are Toeplitz blocks of a few sequences, which on a uniform grid are inverse FFTs.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.linalg
from jaxtyping import Complex, Float

from ema.fit.noise import NoiseLevel
from ema.fit.range_finder import DIRECTIONS, growing

CIRCLE = 1.2
"""Length of the circle over the length of the band: the empty part keeps the ends of the band apart, which else were
neighbours on the circle. At 1.08 and 1.32 no value of 14 random systems moves by 1e-5 standard deviations."""

_NEGLIGIBLE = 1e-6
"""Weight of the whole circle in the equations, over that of the noise of the FRFs.

In the empty part of the circle polynomials may grow without cost, and rounding alone would decide how. Coefficients of
which the data tell more than a millionth of the noise follow the data. With 1e-4 the poles of a diagram move a hundred
times less by rounding, but those of close pairs that the data hardly tell apart are drawn together.
"""
_LEAST, _MOST = 1e-14, 1e-6
"""Bounds of that weight over the energy of the FRFs: rounding, and what data that are nothing but noise may ask for."""

_BLOCK = 256
"""Outputs that are taken together: memory alone, no value depends on it."""


@dataclass(frozen=True)
class Polynomials:
    """Reduced normal matrices of the denominator polynomial for every order.

    ``matrix[order]`` is Hermitian of size ``references * (order + 1)``, block k belonging to z^k; ``ridge`` is what is
    added to their diagonals. ``sampling_time`` (s) and ``start`` (rad/s) map ``z`` back to poles: ``p = log(z) / T +
    j start``; ``width`` is the band in rad/s.
    """

    matrices: dict[int, Complex[np.ndarray, "n n"]]
    references: int
    sampling_time: float
    start: float
    width: float
    ridge: float


def principal_outputs(
    values: Complex[np.ndarray, "freq out in"], weights: Float[np.ndarray, "freq"], noise: NoiseLevel
) -> Complex[np.ndarray, "freq kept in"]:
    """FRFs over their noise, with the outputs rotated onto the directions whose energy exceeds that of noise alone
    (`ema.fit.range_finder`); with fewer than 12 outputs nothing is dropped.
    """
    outputs = values.shape[1]
    own, per_output = 1 / noise.references, 1 / noise.outputs
    if outputs < 12:
        return values * (per_output[:, None] * own)

    def slabs() -> Iterator[np.ndarray]:
        for first in range(0, outputs, _BLOCK):
            part = values[:, first : first + _BLOCK] * (weights[:, None, None] * own)
            part = part.transpose(1, 0, 2).reshape(part.shape[1], -1)
            yield part * per_output[first : first + _BLOCK, None]

    found, above = growing(slabs, outputs, DIRECTIONS, lambda some: some.above(1.1))
    kept = int(np.clip(above + 1, 4, len(found.energies)))
    rotation = (found.directions[:, :kept].conj() * per_output[:, None]).T
    return np.asarray(np.matmul(rotation, values) * own)


def normal_matrices(
    frequencies: Float[np.ndarray, "freq"],
    values: Complex[np.ndarray, "freq out in"],
    orders: Sequence[int],
    weights: Float[np.ndarray, "freq"],
    *,
    noise: float = 0.0,
) -> Polynomials:
    """Reduced normal matrices of all ``orders`` (degree of the complex polynomials).

    Parameters
    ----------
    frequencies : Hz; an axis with holes or uneven steps costs a slower transform.
    values : the FRFs with the references on the last axis.
    weights : amplitude weight of each line, common to all FRFs.
    noise : variance of the noise of an FRF; 1 where the values are over their noise.
    """
    lines, outputs, references = values.shape
    top = max(orders)
    points = scipy.fft.next_fast_len(int(np.ceil(CIRCLE * lines)))
    step = 2 * np.pi * (frequencies[-1] - frequencies[0]) / (lines - 1)
    power = weights**2
    lags = np.concatenate([np.arange(top + 1), np.arange(-top, 0)])
    steps = (frequencies - frequencies[0]) * (2 * np.pi / step)
    even = bool(np.all(np.abs(steps - np.arange(lines)) < 1e-3))
    turns = None if even else np.exp(2j * np.pi / points * np.outer(lags, steps))

    def correlate(sequence: np.ndarray) -> np.ndarray:
        if turns is not None:
            return np.tensordot(turns, sequence, axes=1)
        return np.asarray(scipy.fft.ifft(sequence, points, axis=0, norm="forward")[lags])

    distance = np.arange(top + 1)[None, :] - np.arange(top + 1)[:, None]
    ones = correlate(power.astype(complex))[distance]
    products = np.einsum("koa,kob->kab", (values * power[:, None, None]).conj(), values, optimize=True)
    energy = correlate(products)[distance].transpose(0, 2, 1, 3).reshape((top + 1) * references, -1)
    cross = np.empty((2 * top + 1, outputs, references), complex)
    for output in range(0, outputs, 64):
        cross[:, output : output + 64] = correlate(values[:, output : output + 64] * power[:, None, None])
    signal = float(np.einsum("aa->", energy[:references, :references]).real) / references
    share = float(np.clip(_NEGLIGIBLE * noise * outputs * ones[0, 0].real / max(signal, 1e-300), _LEAST, _MOST))
    # Rows of the numerator eliminated one after the other: the first k of them are all that order k - 1 has.
    factor = scipy.linalg.cholesky(ones + share * ones[0, 0] * np.eye(top + 1), lower=True)
    eliminated = scipy.linalg.solve_triangular(
        factor, cross[distance].transpose(0, 2, 1, 3).reshape(top + 1, -1), lower=True, overwrite_b=True
    ).reshape(top + 1, outputs, -1)
    matrices, explained, done = {}, np.zeros_like(energy), 0
    for order in sorted(set(orders)):
        rows = eliminated[done : order + 1].reshape(-1, energy.shape[0])
        explained += rows.conj().T @ rows
        done = order + 1
        size = references * (order + 1)
        matrices[order] = energy[:size, :size] - explained[:size, :size]
    return Polynomials(
        matrices=matrices,
        references=references,
        sampling_time=2 * np.pi / (points * step),
        start=2 * np.pi * frequencies[0],
        width=step * (lines - 1),
        ridge=share * signal,
    )


def poles(
    polynomials: Polynomials, order: int, clear: bool = True
) -> tuple[Complex[np.ndarray, "pole"], Complex[np.ndarray, "pole in"]]:
    """Decaying poles (rad/s, ascending imaginary part) of one order and their participation vectors (unit length).

    ``clear`` fixes the lowest coefficient: poles that only describe noise then come out growing and are left out, but
    noise lowers the damping of the rest. Otherwise the highest is fixed, which reverses both properties (Cauberghe
    2004).
    """
    matrix, size = polynomials.matrices[order], polynomials.references
    free, fixed = (slice(size, None), slice(0, size)) if clear else (slice(0, -size), slice(-size, None))
    raised = matrix[free, free] + polynomials.ridge * np.eye(matrix.shape[0] - size)
    try:
        solved = scipy.linalg.cho_solve(scipy.linalg.cho_factor(raised), -matrix[free, fixed])
    except scipy.linalg.LinAlgError:
        solved = np.linalg.lstsq(matrix[free, free], -matrix[free, fixed], rcond=1e-14)[0]
    # A(z)^T L = 0; with the lowest coefficient fixed the companion matrix is that of the reversed polynomial in 1/z.
    blocks = solved.reshape(order, size, size).transpose(0, 2, 1)
    companion = np.zeros((order * size, order * size), complex)
    companion[:-size, size:] = np.eye((order - 1) * size)
    last = blocks[::-1] if clear else blocks
    companion[-size:] = -last.transpose(1, 0, 2).reshape(size, -1)
    roots = scipy.linalg.eigvals(companion, overwrite_a=True, check_finite=False)
    roots = roots[roots != 0] if clear else roots
    z = 1 / roots if clear else roots
    # Decay over a sample of the band-limited time axis: beyond e^-3 a pole is wider than half the band, no mode.
    kept = (np.abs(z) < 1) & (np.abs(z) > np.exp(-3))
    z, roots = z[kept], roots[kept]
    logarithm = np.log(z)
    # The empty part of the circle belongs half to the region below the band and half to that above it.
    empty = 0.5 * (2 * np.pi / polynomials.sampling_time - polynomials.width)
    shift = np.where(logarithm.imag / polynomials.sampling_time < -empty, 2 * np.pi, 0.0)
    found = (logarithm + 1j * shift) / polynomials.sampling_time + 1j * polynomials.start
    ascending = np.argsort(found.imag)
    found, roots = found[ascending], roots[ascending]
    return found, _participation(roots, last, size)


def _participation(
    roots: Complex[np.ndarray, "pole"], blocks: Complex[np.ndarray, "order in in"], size: int
) -> Complex[np.ndarray, "pole in"]:
    """Null vectors of the monic matrix polynomial ``sum blocks[k] x^k + x^order`` at its roots."""
    if size == 1:
        return np.ones((len(roots), 1), complex)
    value = np.broadcast_to(np.eye(size, dtype=complex), (len(roots), size, size))
    for block in blocks[::-1]:
        value = value * roots[:, None, None] + block
    return np.linalg.svd(value)[2][:, -1].conj()
