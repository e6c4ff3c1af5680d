"""From impulse responses over a block Hankel matrix to a state matrix (Ho and Kalman 1966, Juang and Pappa 1985).

The Hankel matrix is never made: its products are convolutions, and its leading singular vectors come from random
probing (Halko, Martinsson, Tropp 2011). The lower model orders are leading blocks of the highest one. The spread of an
eigenvalue follows from the noise by first-order perturbation.
"""

from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.linalg
from jaxtyping import Complex, Float

_PROBES = 12
"""Random vectors beyond the highest order; Halko, Martinsson and Tropp (2011) recommend five to ten."""


@dataclass(frozen=True)
class Responses:
    """Complex impulse responses ``h`` (sample, q, in); first sample and lags of their Hankel matrix."""

    h: Complex[np.ndarray, "sample q in"]
    skip: int
    rows: int
    columns: int


@dataclass(frozen=True)
class Realisation:
    """Balanced realisation: ``state`` (order, order), whose leading blocks are the state matrices of lower orders;
    ``singular`` (order,) values; ``left`` (row, q, order) and ``right`` (column, in, order) singular vectors.
    """

    state: Complex[np.ndarray, "order order"]
    singular: Float[np.ndarray, "order"]
    left: Complex[np.ndarray, "row q order"]
    right: Complex[np.ndarray, "column in order"]


class Hankel:
    """Products with the block Hankel matrix ``h[skip + row + column]`` by FFT."""

    def __init__(self, data: Responses, shift: int = 0) -> None:
        first = data.skip + shift
        used = data.h[first : first + data.rows + data.columns - 1]
        self.rows, self.columns = data.rows, data.columns
        self.length = scipy.fft.next_fast_len(self.rows + self.columns - 1)
        self.spectrum = scipy.fft.fft(used, self.length, axis=0)

    def times(self, right: Complex[np.ndarray, "column in k"]) -> Complex[np.ndarray, "row q k"]:
        """H right: sum over lag of h[row + lag] right[lag]."""
        spectrum = scipy.fft.fft(right.conj(), self.length, axis=0).conj()
        return np.asarray(scipy.fft.ifft(self.spectrum @ spectrum, axis=0)[: self.rows])

    def adjoint_times(self, left: Complex[np.ndarray, "row q k"]) -> Complex[np.ndarray, "column in k"]:
        """H^H left: sum over row of conj(h[row + lag]) left[row]."""
        spectrum = scipy.fft.fft(left, self.length, axis=0).conj()
        return np.asarray(scipy.fft.ifft(self.spectrum.transpose(0, 2, 1) @ spectrum, axis=0)[: self.columns].conj())


def realise(data: Responses, order: int, passes: int = 2) -> Realisation:
    """Balanced realisation from the leading singular vectors of the Hankel matrix.

    Parameters
    ----------
    data : impulse responses, and the size of their Hankel matrix in lags.
    order : highest model order; lowered to the size and the numerical rank (1e-13) of the matrix.
    passes : power iterations of the random probing; they sharpen singular vectors near the noise.

    Returns
    -------
    State matrix, singular values and vectors; the result is the same at every call (the probing has a fixed seed).

    Examples
    --------
    Two decaying exponentials are a model of order 2, whatever order is asked for.

    >>> decay = np.array([0.9, 0.8 + 0.3j])
    >>> response = np.sum(decay ** np.arange(40)[:, None], axis=1)[:, None, None]
    >>> state = realise(Responses(response, skip=0, rows=16, columns=16), order=6).state
    >>> print(np.round(sorted(np.linalg.eigvals(state), key=abs), 6) + 0.0)
    [0.8+0.3j 0.9+0.j ]
    """
    hankel = Hankel(data)
    _, outputs, references = data.h.shape
    rows, columns = data.rows * outputs, data.columns * references
    count = min(order + _PROBES, rows, columns)
    rng = np.random.default_rng(0)
    probe = rng.standard_normal((data.columns, references, 2 * count)).view(np.complex128)
    left = _orthonormal(hankel.times(probe))
    for _ in range(passes):
        left = _orthonormal(hankel.times(_orthonormal(hankel.adjoint_times(left))))
    projected = hankel.adjoint_times(left).reshape(columns, -1)
    right, singular, turn = scipy.linalg.svd(projected, full_matrices=False, check_finite=False)
    order = min(order, int(np.count_nonzero(singular > 1e-13 * singular[0])))
    # projected = H^H Q = V S T, so that H = (Q T^H) S V^H
    left = left @ turn[:order].conj().T
    right = right[:, :order].reshape(data.columns, references, order)
    moved = Hankel(data, shift=1).times(right).reshape(rows, order)
    root = np.sqrt(singular[:order])
    state = (left.reshape(rows, order).conj().T @ moved) / np.outer(root, root)
    return Realisation(state, singular[:order], left, right)


def _orthonormal(block: Complex[np.ndarray, "a b k"]) -> Complex[np.ndarray, "a b k"]:
    flat = block.reshape(-1, block.shape[2])
    return np.asarray(scipy.linalg.qr(flat, mode="economic", check_finite=False)[0].reshape(*block.shape[:2], -1))


@dataclass(frozen=True)
class Eigenmodes:
    """Modes of a state matrix.

    ``values`` (mode,) eigenvalues; ``spread`` (mode,) their standard deviation (of the real and of the imaginary part
    alike); ``coherence`` (mode,) extended modal amplitude coherence: how far the singular vectors follow the
    exponential of the mode, 0 ... 1; ``shapes`` (q, mode).
    """

    values: Complex[np.ndarray, "mode"]
    spread: Float[np.ndarray, "mode"]
    coherence: Float[np.ndarray, "mode"]
    shapes: Complex[np.ndarray, "q mode"]


def eigenmodes(
    found: Realisation, order: int, noise: Float[np.ndarray, "line"], references: Float[np.ndarray, "in"]
) -> Eigenmodes:
    """Modes of a model order.

    Parameters
    ----------
    noise : variance E|n|^2 of the spectra behind the responses at each line, for outputs made equal.
    references : factor of that variance for each reference.
    """
    values, left, right = scipy.linalg.eig(found.state[:order, :order], left=True, right=True, check_finite=False)
    left = left / np.sum(left.conj() * right, axis=0).conj()
    root = np.sqrt(found.singular[:order])
    rows = found.left[:, :, :order] @ (left / root[:, None])
    columns = found.right[:, :, :order] @ (right / root[:, None])
    deviation = spread(values, rows.conj(), columns, noise, references)
    by_output, shapes = _follows(found.left[:, :, :order] @ (root[:, None] * right), values)
    by_input, _ = _follows(found.right[:, :, :order] @ (root[:, None] * left), values.conj())
    return Eigenmodes(values, deviation, by_output * by_input, shapes)


def spread(
    values: Complex[np.ndarray, "mode"],
    rows: Complex[np.ndarray, "row q mode"],
    columns: Complex[np.ndarray, "column in mode"],
    noise: Float[np.ndarray, "line"],
    references: Float[np.ndarray, "in"],
) -> Float[np.ndarray, "mode"]:
    """Standard deviation of eigenvalues from ``dz = rows^T (dH1 - z dH0) columns``.

    The sums over the lags of the Hankel matrix are convolutions, so dz is a weighted sum of the noise of the spectra.
    """
    lines = len(noise)
    by_row = np.abs(scipy.fft.ifft(rows, lines, axis=0)) ** 2
    by_column = np.abs(scipy.fft.ifft(columns, lines, axis=0)) ** 2
    circle = np.exp(2j * np.pi * np.arange(lines) / lines)
    weights = by_row.sum(axis=1) * np.einsum("kim,i->km", by_column, references)
    weights *= np.abs(circle[:, None] - values) ** 2 * lines**2
    return np.asarray(np.sqrt(0.5 * (noise @ weights)))


def _follows(
    vectors: Complex[np.ndarray, "lag q mode"], values: Complex[np.ndarray, "mode"]
) -> tuple[Float[np.ndarray, "mode"], Complex[np.ndarray, "q mode"]]:
    """Share of the energy of each mode's vectors over the lags that is one exponential, and its amplitude."""
    expected = values[None, :] ** np.arange(len(vectors))[:, None]
    size = np.sum(np.abs(expected) ** 2, axis=0)
    amplitude = np.einsum("lqm,lm->qm", vectors, expected.conj()) / size
    energy = np.maximum(np.sum(np.abs(vectors) ** 2, axis=(0, 1)), 1e-300)
    return np.sum(np.abs(amplitude) ** 2, axis=0) * size / energy, amplitude


def sharpened(
    data: Responses,
    values: Complex[np.ndarray, "mode"],
    shapes: Complex[np.ndarray, "q mode"],
    participation: Complex[np.ndarray, "in mode"],
    noise: Float[np.ndarray, "line"],
    references: Float[np.ndarray, "in"],
) -> tuple[Complex[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """Eigenvalues with exact exponentials in place of singular vectors, and their standard deviations.

    Noise bends singular vectors, the more the sooner a mode decays, and damping then reads high. The exponentials of
    known modes hardly depend on the noise: H0 = O C, and the eigenvalues of O^+ H1 C^+ are nearly free of that.
    """
    rows = shapes * values ** np.arange(data.rows)[:, None, None]
    columns = participation * values ** np.arange(data.columns)[:, None, None]
    count = len(values)
    left = _pseudo_inverse(rows.reshape(-1, count))
    right = _pseudo_inverse(columns.reshape(-1, count)).T.reshape(data.columns, -1, count)
    still, moved = (left @ Hankel(data, shift).times(right).reshape(-1, count) for shift in (0, 1))
    found, turned, vectors = scipy.linalg.eig(np.linalg.solve(still, moved), left=True, right=True, check_finite=False)
    turned = turned / np.sum(turned.conj() * vectors, axis=0).conj()
    own = np.linalg.solve(still.T, turned.conj()).T @ left
    deviation = spread(found, own.reshape(count, data.rows, -1).transpose(1, 2, 0), right @ vectors, noise, references)
    return found, deviation


def _pseudo_inverse(block: Complex[np.ndarray, "row mode"]) -> Complex[np.ndarray, "mode row"]:
    """Of exponentials, which two close modes share nearly: a small ridge keeps them apart."""
    scale = np.linalg.norm(block, axis=0)
    scaled = block / scale
    gram = scaled.conj().T @ scaled + 1e-13 * np.eye(len(scale))
    return np.asarray(np.linalg.solve(gram, scaled.conj().T) / scale[:, None])
