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

_IN_CACHE = 16_000
"""Values that are worked on at a time, 256 kB of complex numbers: speed alone, no value depends on it."""


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

    def on_lines(self, found: "Functions") -> Float[np.ndarray, "column line_part"]:
        """The columns on every line, among the functions of a model that has these terms."""
        parts = found.values[: 2 * found.count].reshape(2, found.count, -1)[:, -len(self.poles) - 2 :]
        return np.asarray(self.mixing.T @ parts.reshape(len(self.mixing), -1))

    def products(
        self, found: "Functions", weights: Float[np.ndarray, "*row line"]
    ) -> Float[np.ndarray, "*row column column"]:
        """Products of the columns with each other under some weights.

        Line by line: a thousandth of a function may be all that a column has (`RESIDUAL_RANK`), and the partial
        fractions of functions whose poles lie far below most of the band leave no digits for that.
        """
        columns = self.on_lines(found)
        pairs = columns[:, None] * columns
        pairs = pairs[..., ::2] + pairs[..., 1::2]
        flat = weights.reshape(-1, weights.shape[-1]) @ pairs.reshape(-1, pairs.shape[-1]).T
        return np.asarray(flat.reshape(*weights.shape[:-1], *pairs.shape[:2]))


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
    """Pair functions on the lines: those of all poles, the fixed poles of the background, the lower and the upper
    residual are the first ``count``; the squares that belong to the poles follow.

    ``values`` (2 * function, 2 * line) are real and imaginary parts on each line of ``D + M``, what the real part of a
    coefficient multiplies, and of ``j (D - M)``, for its imaginary part: both of the first functions, then both of the
    squares. ``sums`` (2 * sum - 3, line) are the real, then the imaginary parts of the summands ``a(p)``, ``da(p)/dp``,
    1, s^-2, s^-4 behind their products; the last three are real.
    """

    count: int
    values: Float[np.ndarray, "part line_part"]
    sums: Float[np.ndarray, "sum line"]


def functions(
    s: Complex[np.ndarray, "line"], poles: Complex[np.ndarray, "mode"], fixed: Complex[np.ndarray, "term"]
) -> Functions:
    """All pair functions of a model."""
    modes, every, lines = len(poles), np.concatenate([poles, fixed]), len(s)
    count = len(every) + 2
    values = np.empty((2 * (count + modes), lines), complex)
    sums = np.empty((2 * (len(every) + modes) + 3, lines))
    of_sums = len(every) + modes
    powers = np.stack([np.ones(lines), (s**-2).real, (s**-4).real])
    sums[of_sums : of_sums + 3] = powers
    # A real coefficient of half the function, counted twice as every pair is, is the coefficient of the function.
    values[count - 2 : count], values[2 * count - 2 : 2 * count] = powers[1::-1], 0
    step = max(1, _IN_CACHE // lines)
    for first in range(0, len(every), step):
        some = every[first : first + step]
        direct, mirrored = _reciprocal(s.imag, some), _reciprocal(s.imag, some.conj())
        _put(values, first, count, _both(direct, mirrored))
        # a(p) = 2 p / (s^2 - p^2): the difference of its two fractions loses the digits of a slow pole at fast lines.
        both = _reciprocal_of_squares(s.imag, some)
        summand = 2 * some[:, None] * both
        _put(sums, first, of_sums + 3, (summand.real, summand.imag))
        own = max(0, min(modes - first, len(some)))
        _put(values, 2 * count + first, modes, _both(direct[:own] ** 2, mirrored[:own] ** 2))
        square = 2 * both[:own] + summand[:own] ** 2
        _put(sums, len(every) + first, of_sums + 3, (square.real, square.imag))
    return Functions(count, values.view(float), sums)


class Recent:
    """The pair functions that were asked for last: evaluation, residual and weights of a fit ask for the same."""

    def __init__(self) -> None:
        self._arguments: np.ndarray = np.zeros(0, complex)
        self._found: Functions | None = None

    def functions(
        self,
        s: Complex[np.ndarray, "line"],
        poles: Complex[np.ndarray, "mode"],
        fixed: Complex[np.ndarray, "term"],
    ) -> Functions:
        """All pair functions of a model (`functions`)."""
        arguments = np.concatenate([s, poles, fixed, [len(poles)]])
        if self._found is None or not np.array_equal(arguments, self._arguments):
            self._arguments, self._found = arguments, functions(s, poles, fixed)
        return self._found


def _put(rows: np.ndarray, first: int, to_imaginary: int, parts: tuple[np.ndarray, np.ndarray]) -> None:
    """Write what belongs to real and what to imaginary parts into rows that lie so far apart."""
    real, imaginary = parts
    rows[first : first + len(real)] = real
    rows[first + to_imaginary : first + to_imaginary + len(real)] = imaginary


def _reciprocal_of_squares(
    omega: Float[np.ndarray, "line"], poles: Complex[np.ndarray, "pole"]
) -> Complex[np.ndarray, "pole line"]:
    """``1 / ((j omega)^2 - p^2)``."""
    decay, place = -poles.real[:, None], poles.imag[:, None]
    real, imaginary = (omega - place) * (omega + place) + decay**2, 2 * decay * place
    result = np.empty((len(poles), len(omega)), complex)
    energy = real**2 + imaginary**2
    result.real, result.imag = -real / energy, -imaginary / energy
    return result


def _reciprocal(
    omega: Float[np.ndarray, "line"], poles: Complex[np.ndarray, "pole"]
) -> Complex[np.ndarray, "pole line"]:
    """``1 / (j omega - p)``."""
    result = np.empty((len(poles), len(omega)), complex)
    distance, decay = omega - poles.imag[:, None], -poles.real[:, None]
    energy = distance**2 + decay**2
    result.real, result.imag = decay / energy, -distance / energy
    return result


def _both(
    direct: Complex[np.ndarray, "function line"], mirrored: Complex[np.ndarray, "function line"]
) -> tuple[np.ndarray, np.ndarray]:
    """What the real and what the imaginary part of a coefficient multiply."""
    return direct + mirrored, 1j * (direct - mirrored)


def bin_excess(
    s: Complex[np.ndarray, "line"],
    spread: Float[np.ndarray, "line"],
    poles: Complex[np.ndarray, "pole"],
    coefficients: Complex[np.ndarray, "*frf pole"],
) -> Complex[np.ndarray, "*frf line"]:
    """By how much the means of FRFs over bins exceed their values at the centres.

    The mean of ``f = 1 / (s - p)`` over lines at ``s + j d`` is ``f - v f^3`` to third order, v the mean of d^2.
    """
    direct, mirrored = _reciprocal(s.imag, poles), _reciprocal(s.imag, poles.conj())
    cubes = np.concatenate(_both(-spread * direct**3, -spread * mirrored**3)).view(float)
    return synthesise(Functions(len(poles), cubes, np.zeros((0, len(s)))), coefficients)


def synthesise(
    found: Functions, coefficients: Complex[np.ndarray, "*frf function"]
) -> Complex[np.ndarray, "*frf line"]:
    """FRFs from the coefficients of the first pair functions."""
    count = coefficients.shape[-1]
    flat = coefficients.reshape(-1, count)
    values = found.values[: 2 * found.count]
    if count < found.count:
        values = values[np.r_[:count, found.count : found.count + count]]
    result: np.ndarray = np.concatenate([flat.real, flat.imag], axis=-1) @ values
    return result.view(complex).reshape(*coefficients.shape[:-1], -1)


def projections(found: Functions, signals: Complex[np.ndarray, "*frf line"]) -> Complex[np.ndarray, "*frf function"]:
    """Products of weighted signals with all pair functions: half the gradient of their energy with respect to the real
    and imaginary part of each coefficient.
    """
    flat = np.ascontiguousarray(signals).reshape(-1, signals.shape[-1]).view(float)
    parts = flat @ found.values.T
    first, squares = parts[:, : 2 * found.count], parts[:, 2 * found.count :]
    real, imaginary = (
        np.concatenate(both, axis=-1) for both in zip(np.split(first, 2, axis=-1), np.split(squares, 2, axis=-1))
    )
    result: np.ndarray = real + 1j * imaginary
    return result.reshape(*signals.shape[:-1], -1)


def sums_over_lines(found: Functions, weights: Float[np.ndarray, "*row line"]) -> Complex[np.ndarray, "*row sum"]:
    """The sums behind all products."""
    parts = weights.reshape(-1, weights.shape[-1]) @ found.sums.T
    count = (parts.shape[-1] + 3) // 2
    result = parts[:, :count] + 0j
    result[:, : count - 3].imag = parts[:, count:]
    return np.asarray(result.reshape(*weights.shape[:-1], -1))


@dataclass(frozen=True)
class Products:
    """``P`` and ``Q`` of pair functions under some rows of weights: ``first`` (form, row, a, mode + square) of all
    functions, the lower and the upper residual behind them, with those of the modes and their squares; ``squares``
    (form, row, square, square) of these squares with each other. ``form`` is 0 for ``P`` and 1 for ``Q``.
    """

    first: Complex[np.ndarray, "2 row a b"]
    squares: Complex[np.ndarray, "2 row square square"]


def products(
    poles: Complex[np.ndarray, "pole"], modes: int, sums: Complex[np.ndarray, "row sum"], squared: int
) -> Products:
    """Products of the functions of all ``poles``, of which the first ``modes`` are those of the modes, and of the
    squares of the first ``squared`` ones, for each row of sums.
    """
    count, rows = len(poles), len(sums)
    alpha, beta = sums[:, :count], sums[:, None, count : count + squared]
    one = sums[:, count + modes + 1, None]
    own, moving, of_modes = poles[:modes], poles[:squared], alpha[:, None, :modes]
    first = np.empty((2, rows, count + 2, modes + squared), complex)
    squares = np.empty((2, rows, squared, squared), complex)
    # Lower and upper residual: the same sums weighted by s^-2 and by 1.
    lower = (alpha[:, :modes] - 2 * own * one) / own**2
    first[:, :, count, :modes], first[:, :, count + 1, :modes] = 0.5 * lower, 0.5 * alpha[:, :modes]
    first[:, :, count, modes:] = 0.5 * (beta[:, 0] - 2 * one - 2 * moving * lower[:, :squared]) / moving**2
    first[:, :, count + 1, modes:] = 0.5 * beta[:, 0]
    for form, (others, other_sums) in enumerate(((poles.conj(), alpha.conj()), (poles, alpha))):
        inverted = -1 / (others[:, None] + own)
        direct = first[form, :, :count, :modes]
        np.multiply(other_sums[:, :, None] + of_modes, inverted, out=direct)
        # Derivatives with respect to the second pole, then with respect to both.
        direct, inverted = direct[:, :, :squared], inverted[:, :squared]
        np.multiply(beta + direct, inverted, out=first[form, :, :count, modes:])
        of_both = 2 * direct[:, :squared] + beta + (beta.conj() if form == 0 else beta).transpose(0, 2, 1)
        np.multiply(of_both, inverted[:squared] ** 2, out=squares[form])
    return Products(first, squares)


def trial_products(
    trials: Complex[np.ndarray, "trial"],
    of_trials: Complex[np.ndarray, "in trial"],
    poles: Complex[np.ndarray, "pole"],
    modes: int,
    sums: Complex[np.ndarray, "in sum"],
) -> "TrialProducts":
    """``P`` and ``Q`` of further poles with themselves, with the functions of a model, and with the squares that belong
    to the first ``modes`` poles. ``of_trials`` are the sums ``a`` of the further poles.
    """
    count = len(poles)
    alpha, beta, one = sums[:, None, :count], sums[:, None, count : count + modes], sums[:, None, count + modes + 1]
    d, e = trials.conj()[:, None] + poles, trials[:, None] + poles
    p = -(of_trials.conj()[:, :, None] + alpha) / d
    q = -(of_trials[:, :, None] + alpha) / e
    lower = (of_trials - 2 * trials * one) / trials**2
    p_static = 0.5 * np.stack([lower.conj(), of_trials.conj()], axis=-1)
    q_static = 0.5 * np.stack([lower, of_trials], axis=-1)
    return TrialProducts(
        own=(-of_trials.real / trials.real + 0j, -of_trials / trials),
        first=(np.concatenate([p, p_static], axis=-1), np.concatenate([q, q_static], axis=-1)),
        # Derivatives with respect to the poles of the model.
        squares=(-(beta + p[..., :modes]) / d[:, :modes], -(beta + q[..., :modes]) / e[:, :modes]),
    )


@dataclass(frozen=True)
class TrialProducts:
    """``P`` and ``Q`` of further poles: with themselves (in, trial), with the functions of a model and with its squares
    (in, trial, b).
    """

    own: tuple[Complex[np.ndarray, "in trial"], Complex[np.ndarray, "in trial"]]
    first: tuple[Complex[np.ndarray, "in trial b"], Complex[np.ndarray, "in trial b"]]
    squares: tuple[Complex[np.ndarray, "in trial mode"], Complex[np.ndarray, "in trial mode"]]


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
