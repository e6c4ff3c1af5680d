"""The modal model of FRFs as functions of frequency, and weighted products of these functions.

A receptance is ``H_oi = sum_r [psi_or L_ir / (s - p_r) + conj] + residual terms`` with poles p, participation L and
shapes psi. Every unknown z of it, a residue or a shift of a pole, enters through a *pair function* ``z D + conj(z) M``
with ``D = 1 / (s - p)``, ``M = 1 / (s - conj(p))``, or their squares.

Weights that differ between FRFs ask for the products of all pair functions for each FRF. On the imaginary axis,
where ``conj(s) = -s``, partial fractions give them from one sum per pole: with
``a(p) = sum_k w_k [1 / (s_k - p) - 1 / (s_k + p)]``

    P_pq = sum_k w_k (conj(D_p) D_q + M_p conj(M_q)) = -(a(q) + conj(a(p))) / (q + conj(p))
    Q_pq = sum_k w_k (conj(M_p) D_q + conj(M_q) D_p) = -(a(p) + a(q)) / (p + q)

and the energy of ``sum_p z_p D_p + conj(z_p) M_p`` is ``z^H P z + Re(z^T Q z)``. Products with squares are derivatives
of these with respect to the poles. No denominator vanishes, not even for poles that coincide.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

RESIDUAL_RANK = 1e-3
"""Part of its norm that a residual term keeps when those before it are taken off, below which it is left out.

It bounds the condition of the normal equations of the residual terms by its inverse square, 1e6, so that rounding stays
below 1e-9 of their information. What is left out differs from the other terms by a thousandth of itself over the band.
The six terms of an ordinary band are all kept, at half the value and at twice.
"""


@dataclass(frozen=True)
class Background:
    """Residual terms of an FRF: real coefficients of columns that are orthonormal under the mean weights.

    ``poles`` (term,) are fixed poles of what lies outside the band; after them follow the lower and the upper residual
    (rigid bodies ~ 1 / s^2 and static compliance), which are real. ``mixing`` (2 * (term + 2), column) holds the real,
    then the imaginary parts of the coefficients of these functions in every column.
    """

    poles: Complex[np.ndarray, "term"]
    mixing: Float[np.ndarray, "function column"]

    def coefficients(self, values: Float[np.ndarray, "*frf column"]) -> Complex[np.ndarray, "*frf function"]:
        """Coefficients of the fixed poles, the lower and the upper residual from those of the columns."""
        both = values @ self.mixing.T
        half = both.shape[-1] // 2
        result: np.ndarray = both[..., :half] + 1j * both[..., half:]
        return result

    def fewer(self, columns: int) -> "Background":
        """The first columns alone."""
        return Background(self.poles, self.mixing[:, :columns])


def background(
    s: Complex[np.ndarray, "line"], weight: Float[np.ndarray, "line"], poles: Complex[np.ndarray, "term"]
) -> Background:
    """Residual terms made orthonormal, in this order: upper residual, lower residual, poles as given.

    A term that the others describe (`RESIDUAL_RANK`) is left out: the information of what remains is well conditioned
    whatever poles are given.
    """
    direct, mirrored = 1 / (s - poles[:, None]), 1 / (s - poles.conj()[:, None])
    zero, count = np.zeros(len(s), complex), len(poles)
    functions = [1 / s**2, np.ones(len(s), complex)]
    rows = np.stack([*(direct + mirrored), *functions, *(1j * (direct - mirrored)), zero, zero])
    real = (rows * np.sqrt(weight)).view(float)
    order = [count + 1, count, *(k + part for k in range(count) for part in (0, count + 2))]
    kept: list[np.ndarray] = []
    mixing: list[np.ndarray] = []
    for place in order:
        norm = float(np.linalg.norm(real[place]))
        if norm == 0:
            continue
        vector, mix = real[place] / norm, np.zeros(len(real))
        mix[place] = 1 / norm
        # Gram-Schmidt, twice: orthogonal to rounding (Daniel et al. 1976).
        for _ in range(2):
            for other, own in zip(kept, mixing, strict=True):
                share = float(other @ vector)
                vector, mix = vector - share * other, mix - share * own
        left = float(np.linalg.norm(vector))
        if left >= RESIDUAL_RANK:
            kept.append(vector / left)
            mixing.append(mix / left)
    return Background(poles, np.stack(mixing, axis=1) if mixing else np.zeros((len(real), 0)))


@dataclass(frozen=True)
class Functions:
    """Pair functions on the lines: ``direct`` and ``mirrored`` (function, line) of all poles, fixed poles of the
    background, lower and upper residual; then the squares that belong to the poles. ``sums`` (sum, line) are the
    summands ``a(p)``, ``da(p)/dp``, 1, s^-2, s^-4 behind their products.
    """

    direct: Complex[np.ndarray, "function line"]
    mirrored: Complex[np.ndarray, "function line"]
    sums: Complex[np.ndarray, "sum line"]


def functions(
    s: Complex[np.ndarray, "line"], poles: Complex[np.ndarray, "mode"], fixed: Complex[np.ndarray, "term"]
) -> Functions:
    """All pair functions of a model."""
    modes, every = len(poles), np.concatenate([poles, fixed])
    direct, mirrored = 1 / (s - every[:, None]), 1 / (s - every.conj()[:, None])
    # 1 / (s - conj(p)) is -conj(1 / (s + p)).
    opposite = mirrored.conj()
    squares = direct[:modes] ** 2, mirrored[:modes] ** 2
    powers = np.stack([np.ones(len(s)), s**-2, s**-4])
    sums = np.concatenate([direct + opposite, squares[0] + squares[1].conj(), powers])
    # A real coefficient of half the function, counted twice as every pair is, is the coefficient of the function.
    static = np.stack([0.5 / s**2, np.full(len(s), 0.5 + 0j)])
    return Functions(np.concatenate([direct, static, squares[0]]), np.concatenate([mirrored, static, squares[1]]), sums)


def bin_excess(
    s: Complex[np.ndarray, "line"],
    spread: Float[np.ndarray, "line"],
    poles: Complex[np.ndarray, "pole"],
    coefficients: Complex[np.ndarray, "*frf pole"],
) -> Complex[np.ndarray, "*frf line"]:
    """By how much the means of FRFs over bins exceed their values at the centres.

    The mean of ``f = 1 / (s - p)`` over lines at ``s + j d`` is ``f - v f^3`` to third order, v the mean of d^2.
    """
    direct, mirrored = 1 / (s - poles[:, None]), 1 / (s - poles.conj()[:, None])
    cubes = Functions(-spread * direct**3, -spread * mirrored**3, direct)
    return synthesise(cubes, coefficients)


def synthesise(
    found: Functions, coefficients: Complex[np.ndarray, "*frf function"]
) -> Complex[np.ndarray, "*frf line"]:
    """FRFs from the coefficients of the first pair functions."""
    count = coefficients.shape[-1]
    plus = (found.direct[:count] + found.mirrored[:count]).view(float)
    minus = (1j * (found.direct[:count] - found.mirrored[:count])).view(float)
    flat = coefficients.reshape(-1, count)
    values = np.ascontiguousarray(flat.real) @ plus
    values += np.ascontiguousarray(flat.imag) @ minus
    return values.view(complex).reshape(*coefficients.shape[:-1], -1)


def projections(found: Functions, signals: Complex[np.ndarray, "*frf line"]) -> Complex[np.ndarray, "*frf function"]:
    """Products of weighted signals with all pair functions: half the gradient of their energy with respect to the real
    and imaginary part of each coefficient.
    """
    flat = signals.reshape(-1, signals.shape[-1])
    direct, mirrored = found.direct.conj(), found.mirrored
    result = _times(flat.real, direct + mirrored) + _times(flat.imag, 1j * (direct - mirrored))
    return result.reshape(*signals.shape[:-1], -1)


def _times(
    values: Float[np.ndarray, "frf line"], columns: Complex[np.ndarray, "function line"]
) -> Complex[np.ndarray, "frf function"]:
    """Sums over lines of real values times complex functions, as one real matrix product."""
    count, lines = columns.shape
    real = np.ascontiguousarray(columns).view(float).reshape(count, lines, 2)
    result: np.ndarray = np.ascontiguousarray(values) @ real.transpose(1, 0, 2).reshape(lines, 2 * count)
    return result.view(complex)


def sums_over_lines(found: Functions, weights: Float[np.ndarray, "*row line"]) -> Complex[np.ndarray, "*row sum"]:
    """The sums behind all products."""
    result = _times(weights.reshape(-1, weights.shape[-1]), found.sums)
    return result.reshape(*weights.shape[:-1], -1)


def products(
    poles: Complex[np.ndarray, "pole"], modes: int, sums: Complex[np.ndarray, "row sum"]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """``P`` and ``Q`` of the functions of all ``poles`` and of the lower and the upper residual, for each row of sums.

    Each as three arrays (row, a, b): all functions with each other, all with the squares that belong to the first
    ``modes`` poles, and these squares with each other.
    """
    count = len(poles)
    alpha, beta = sums[:, :count], sums[:, count : count + modes]
    zero, one, two = (sums[:, count + modes + k, None] for k in range(3))
    d, e = poles.conj()[:, None] + poles, poles[:, None] + poles
    p11, q11 = (np.empty((len(sums), count + 2, count + 2), complex) for _ in range(2))
    p11[:, :count, :count] = -(alpha.conj()[:, :, None] + alpha[:, None, :]) / d
    q11[:, :count, :count] = -(alpha[:, :, None] + alpha[:, None, :]) / e
    # Lower and upper residual: the same sums weighted by s^-2 and by 1.
    lower = (alpha - 2 * poles * one) / poles**2
    for place, static in ((count, lower), (count + 1, alpha)):
        p11[:, :count, place], p11[:, place, :count] = 0.5 * static.conj(), 0.5 * static
        q11[:, :count, place] = q11[:, place, :count] = 0.5 * static
    for matrix in (p11, q11):
        matrix[:, count:, count:] = 0.5 * np.stack([two, one, one, zero], axis=1).reshape(-1, 2, 2)
    # Derivatives with respect to the second pole, then with respect to both.
    first = poles[:modes]
    statics = 0.5 * np.stack([(beta - 2 * one - 2 * first * lower[:, :modes]) / first**2, beta], axis=1)
    d, e = d[:, :modes], e[:, :modes]
    p12 = np.concatenate([-(beta[:, None, :] + p11[:, :count, :modes]) / d, statics], axis=1)
    q12 = np.concatenate([-(beta[:, None, :] + q11[:, :count, :modes]) / e, statics], axis=1)
    d, e = d[:modes], e[:modes]
    p22 = (beta[:, None, :] + beta.conj()[:, :, None] + 2 * p11[:, :modes, :modes]) / d**2
    q22 = (beta[:, None, :] + beta[:, :, None] + 2 * q11[:, :modes, :modes]) / e**2
    return [p11, p12, p22], [q11, q12, q22]


def trial_products(
    trials: Complex[np.ndarray, "trial"],
    of_trials: Complex[np.ndarray, "in trial"],
    poles: Complex[np.ndarray, "pole"],
    modes: int,
    sums: Complex[np.ndarray, "in sum"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """``P`` and ``Q`` of further poles with themselves, each (in, trial), and ``P`` and ``Q`` with the functions of a
    model, each (in, trial, b). ``of_trials`` are the sums ``a`` of the further poles.
    """
    count = len(poles)
    own_p, own_q = -of_trials.real / trials.real + 0j, -of_trials / trials
    alpha, one = sums[:, None, :count], sums[:, None, count + modes + 1]
    p = -(of_trials.conj()[:, :, None] + alpha) / (trials.conj()[:, None] + poles)
    q = -(of_trials[:, :, None] + alpha) / (trials[:, None] + poles)
    lower = (of_trials - 2 * trials * one) / trials**2
    p_static = 0.5 * np.stack([lower.conj(), of_trials.conj()], axis=-1)
    q_static = 0.5 * np.stack([lower, of_trials], axis=-1)
    return own_p, own_q, np.concatenate([p, p_static], axis=-1), np.concatenate([q, q_static], axis=-1)


def real_form(p: Complex[np.ndarray, "*row a b"], q: Complex[np.ndarray, "*row a b"]) -> Float[np.ndarray, "*row c d"]:
    """Real form of ``z^H P z + Re(z^T Q z)`` in the real parts of z, then the imaginary parts."""
    upper = np.concatenate([p.real + q.real, -p.imag - q.imag], axis=-1)
    lower = np.concatenate([p.imag - q.imag, p.real - q.real], axis=-1)
    return np.concatenate([upper, lower], axis=-2)


def complex_form(
    matrix: Float[np.ndarray, "*row c d"],
) -> tuple[Complex[np.ndarray, "*row a b"], Complex[np.ndarray, "*row a b"]]:
    """``P`` and ``Q`` of a real form."""
    a, b = matrix.shape[-2] // 2, matrix.shape[-1] // 2
    rr, ri, ir, ii = matrix[..., :a, :b], matrix[..., :a, b:], matrix[..., a:, :b], matrix[..., a:, b:]
    return 0.5 * ((rr + ii) + 1j * (ir - ri)), 0.5 * ((rr - ii) - 1j * (ir + ri))
