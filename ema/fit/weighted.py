"""Maximum likelihood in modal form with a noise level of its own for every line of every FRF.

The model is ``H_oi = sum_r [psi_or L_ir / (s - p_r) + conj] + rest``: poles p and participation L (largest entry 1) are
shared by all FRFs, shapes psi by those of an output. The rest has coefficients of its own in every FRF: unobserved
modes outside the band, and a lower and an upper residual (rigid bodies and static compliance, both real). Gauss-Newton
on all unknowns at once; the shapes and the rest are eliminated output by output.

Weights that differ between FRFs ask for a Gram matrix of the pole functions for each. Partial fractions give all of
them from one sum per pole: with ``a(p) = sum_k w^2 [1 / (s - p) - 1 / (s + p)]`` the functions ``D = 1 / (s - p)`` and
``M = 1 / (s - conj(p))`` of two poles p, q fulfil ``sum_k w^2 (conj(D_p) D_q + M_p conj(M_q)) = -(a(q) + conj(a(p))) /
(q + conj(p))`` and ``sum_k w^2 (conj(M_p) D_q + conj(M_q) D_p) = -(a(p) + a(q)) / (p + q)``; derivatives of these with
respect to the poles, and the same sums weighted by ``s^-2``, give the rest. No denominator vanishes, not even for poles
that coincide.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

_BLOCK = 400_000
"""Values of the FRFs that are worked on at a time."""
_DOUBT = 2.0
_RIDGE = 1e-13
"""Relative to the information of an unknown: keeps what the data do not tell from becoming infinite."""


@dataclass(frozen=True)
class Weighted:
    """Receptances (out, in, freq) on ``s`` (freq,), in units of ``unit`` rad/s, and their weights ``2 / E|n|^2``."""

    s: Complex[np.ndarray, "freq"]
    unit: float
    signals: Complex[np.ndarray, "out in freq"]
    weights: Float[np.ndarray, "out in freq"]

    def blocks(self) -> list[slice]:
        """Outputs in blocks of a size that stays in reach of the processor."""
        size = max(1, _BLOCK // self.signals[0].size)
        return [slice(first, first + size) for first in range(0, len(self.signals), size)]


@dataclass(frozen=True)
class State:
    """All unknowns, in units of ``Weighted.unit``; the participation has a largest entry of 1.

    ``rest`` holds the residues of the unobserved modes, then lower and upper residual (their imaginary part is 0); what
    is not ``active`` (term,) is 0 and stays so.
    """

    poles: Complex[np.ndarray, "mode"]
    participation: Complex[np.ndarray, "in mode"]
    shapes: Complex[np.ndarray, "out mode"]
    rest_poles: Complex[np.ndarray, "unobserved"]
    rest: Complex[np.ndarray, "out in term"]
    active: Bool[np.ndarray, "term"]

    @property
    def every_pole(self) -> Complex[np.ndarray, "pole"]:
        """Poles of the modes, then of the unobserved ones."""
        return np.concatenate([self.poles, self.rest_poles])

    @property
    def determined(self) -> np.ndarray:
        """Which real unknowns of an output there are among the real parts, then imaginary parts, of shapes and rest."""
        references, modes = self.rest.shape[1], np.ones(len(self.poles), bool)
        imaginary = self.active.copy()
        imaginary[len(self.rest_poles) :] = False
        return np.concatenate([modes, np.tile(self.active, references), modes, np.tile(imaginary, references)])

    def coefficients(self, rows: slice) -> Complex[np.ndarray, "frf function"]:
        """Residues of some outputs, FRFs in one axis."""
        modes = self.shapes[rows, None, :] * self.participation[None, :, :]
        together = np.concatenate([modes, self.rest[rows]], axis=2)
        return together.reshape(-1, together.shape[2])

    @property
    def owners(self) -> Int[np.ndarray, "unknown"]:
        """Mode to which each complex shared unknown belongs: poles, then free entries of the participation."""
        modes = len(self.poles)
        return np.concatenate([np.arange(modes), self.free % max(modes, 1)])

    @property
    def free(self) -> np.ndarray:
        """Entries of the participation that are unknown, as positions in its flattened (in, mode) array."""
        largest = np.argmax(np.abs(self.participation), axis=0)
        keep = np.ones(self.participation.shape, bool)
        keep[largest, np.arange(len(largest))] = False
        return np.flatnonzero(keep)


@dataclass(frozen=True)
class Linearisation:
    """Normal equations at a state, real unknowns: real parts of (poles, free participation), then imaginary parts.

    ``local`` (out, l, l) inverts the information of the linear unknowns of an output (real parts of its shapes and of
    its rest, then imaginary parts); ``slope`` (out, l, unknown) is their change with the shared unknowns; ``offset``
    (out, l) their step when those stay. ``cost`` is the residual energy of the state, ``gain`` what the
    offset takes off.
    """

    information: Float[np.ndarray, "unknown unknown"]
    gradient: Float[np.ndarray, "unknown"]
    local: Float[np.ndarray, "out l l"]
    slope: Float[np.ndarray, "out l unknown"]
    offset: Float[np.ndarray, "out l"]
    cost: float
    gain: float

    def covariance(self) -> Float[np.ndarray, "unknown unknown"]:
        """Covariance of the shared unknowns for noise as the weights say."""
        return inverse(self.information)


def inverse(matrix: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch n n"]:
    """Inverse of positive semidefinite matrices, scaled to unit diagonal."""
    scale = unit_scale(matrix)
    scaled = matrix * scale[..., :, None] * scale[..., None, :]
    ridge = _RIDGE * np.eye(matrix.shape[-1])
    return np.linalg.inv(scaled + ridge) * scale[..., :, None] * scale[..., None, :]


def unit_scale(matrix: Float[np.ndarray, "*batch n n"]) -> Float[np.ndarray, "*batch n"]:
    """Factors that make the diagonal 1, except where there is nothing to scale (a mode without a shape)."""
    diagonal = np.einsum("...ii->...i", matrix)
    floor = 1e-60 * np.max(diagonal, axis=-1, keepdims=True, initial=0)
    result: np.ndarray = 1 / np.sqrt(np.maximum(diagonal, floor + np.finfo(float).tiny))
    return result


def _functions(
    s: Complex[np.ndarray, "freq"], poles: Complex[np.ndarray, "pole"]
) -> tuple[Complex[np.ndarray, "function freq"], Complex[np.ndarray, "function freq"]]:
    """``1 / (s - p)`` and ``1 / (s - conj(p))`` for every pole, then half the lower and upper residual, twice."""
    static = np.stack([0.5 / s**2, np.full(len(s), 0.5 + 0j)])
    return np.concatenate([1 / (s - poles[:, None]), static]), np.concatenate([1 / (s - poles.conj()[:, None]), static])


def model(data: Weighted, state: State, rows: slice) -> Complex[np.ndarray, "out in freq"]:
    """FRFs of a state for some outputs."""
    direct, mirrored = _functions(data.s, state.every_pole)
    c = state.coefficients(rows)
    values = np.ascontiguousarray(c.real) @ (direct + mirrored).view(float)
    values += np.ascontiguousarray(c.imag) @ (1j * (direct - mirrored)).view(float)
    return values.view(complex).reshape(-1, *data.signals.shape[1:])


def cost(data: Weighted, state: State) -> float:
    """Weighted residual energy: as many as there are real equations when the noise levels are right."""
    total = 0.0
    for rows in data.blocks():
        residual = data.signals[rows] - model(data, state, rows)
        total += float(np.sum(data.weights[rows] * (residual.real**2 + residual.imag**2)))
    return total


def linearise(data: Weighted, state: State) -> Linearisation:
    """Normal equations of all unknowns, the linear ones eliminated output by output."""
    modes, poles = len(state.poles), state.every_pole
    references = len(state.participation)
    direct, mirrored = _functions(data.s, poles)
    opposite = mirrored.conj()
    known = slice(0, len(poles))
    squared = direct[known] ** 2 + opposite[known] ** 2
    powers = np.stack([np.ones(len(data.s)), data.s**-2, data.s**-4])
    sums = np.concatenate([direct[known] + opposite[known], squared, powers]).view(float)
    plus, minus = _with_slopes(direct, opposite, modes)
    keep = np.concatenate([np.arange(modes), modes + state.free])
    keep = np.concatenate([keep, keep + modes * (1 + references)])
    information, gradient = np.zeros((len(keep), len(keep))), np.zeros(len(keep))
    before = np.zeros(len(keep))
    determined = np.flatnonzero(state.determined)
    outputs, size = len(data.signals), len(determined)
    local, slope = np.empty((outputs, size, size)), np.empty((outputs, size, len(keep)))
    offset, energy, gain = np.empty((outputs, size)), 0.0, 0.0
    for rows in data.blocks():
        weights = data.weights[rows].reshape(-1, len(data.s))
        residual = (data.signals[rows] - model(data, state, rows)).reshape(weights.shape)
        energy += float(np.sum(weights * (residual.real**2 + residual.imag**2)))
        block = _Block(state, rows, _times(weights, sums), _pull(weights, residual, plus, minus))
        normal, right = block.linear()
        normal, right = normal[:, determined[:, None], determined], right[:, determined]
        coupling = block.coupling()[:, determined[:, None], keep]
        inside, own = block.shared()
        found = inverse(normal)
        local[rows] = found
        slope[rows] = -found @ coupling
        offset[rows] = np.einsum("oab,ob->oa", found, right)
        gain += float(np.sum(offset[rows] * right))
        before += np.diagonal(inside)[keep]
        information += inside[np.ix_(keep, keep)] + np.einsum("oli,olj->ij", coupling, slope[rows], optimize=True)
        gradient += own[keep] + np.einsum("oli,ol->i", slope[rows], right)
    information, idle = _definite(0.5 * (information + information.T), before, state)
    gradient[idle] = 0
    return Linearisation(information, gradient, local, slope, offset, energy, gain)


def scores(
    data: Weighted, state: State, normal: Linearisation, change: Complex[np.ndarray, "out in freq"] | None = None
) -> Float[np.ndarray, "out unknown"]:
    """Share of each output in the gradient of the shared unknowns, its linear unknowns adapted; at an optimum the sum
    over the outputs vanishes. With a ``change`` of the FRFs: what that adds to it.
    """
    modes, references = len(state.poles), len(state.participation)
    direct, mirrored = _functions(data.s, state.every_pole)
    plus, minus = _with_slopes(direct, mirrored.conj(), modes)
    keep = np.concatenate([np.arange(modes), modes + state.free])
    keep = np.concatenate([keep, keep + modes * (1 + references)])
    found = np.empty((len(data.signals), len(keep)))
    for rows in data.blocks():
        weights = data.weights[rows].reshape(-1, len(data.s))
        own = data.signals[rows] - model(data, state, rows) if change is None else change[rows]
        residual = own.reshape(weights.shape)
        h = _pull(weights, residual, plus, minus).reshape(len(data.signals[rows]), references, -1)
        right = _on_linear(state, h)[:, state.determined]
        found[rows] = _on_shared(state, rows, h)[:, keep] + np.einsum("oli,ol->oi", normal.slope[rows], right)
    return found


def _definite(
    information: Float[np.ndarray, "unknown unknown"], before: Float[np.ndarray, "unknown"], state: State
) -> tuple[Float[np.ndarray, "unknown unknown"], Bool[np.ndarray, "unknown"]]:
    """Positive definite information, and which unknowns are held for that.

    A pole far outside the band may tell nothing that the rest does not. What the elimination leaves of its information
    ``before`` is rounding, even negative, and would spoil the intervals of all: such poles keep their place.
    """
    modes = len(state.poles)
    owners = np.tile(state.owners, 2)
    left = np.diagonal(information) / np.maximum(before, np.finfo(float).tiny)
    least = np.array([left[owners == mode].min() for mode in range(modes)])
    idle = np.zeros(len(before), bool)
    for mode in np.argsort(least):
        try:
            scale = unit_scale(information)
            np.linalg.cholesky(information * np.outer(scale, scale) + _RIDGE * np.eye(len(scale)))
        except np.linalg.LinAlgError:
            own = owners == mode
            information[own] = information[:, own] = 0
            information[own, own] = np.maximum(before[own], np.finfo(float).tiny)
            idle |= own
        else:
            break
    return information, idle


def _times(
    weights: Float[np.ndarray, "frf freq"], functions: Float[np.ndarray, "f line"]
) -> Complex[np.ndarray, "frf f"]:
    """Sums over lines of real weights times complex functions, given with interleaved real and imaginary parts."""
    count, lines = len(functions), weights.shape[1]
    columns = functions.reshape(count, lines, 2).transpose(1, 0, 2).reshape(lines, 2 * count)
    return (weights @ columns).view(complex)


def _with_slopes(
    direct: Complex[np.ndarray, "function freq"], opposite: Complex[np.ndarray, "function freq"], modes: int
) -> tuple[Float[np.ndarray, "f line"], Float[np.ndarray, "f line"]]:
    """What real and imaginary parts of residuals are multiplied by: all functions, then second powers for the modes."""
    second = direct[:modes] ** 2, opposite[:modes] ** 2
    plus = np.concatenate([direct + opposite, second[0] + second[1]]).view(float)
    minus = (1j * np.concatenate([opposite - direct, second[1] - second[0]])).view(float)
    return plus, minus


def _pull(
    weights: Float[np.ndarray, "frf freq"],
    residual: Complex[np.ndarray, "frf freq"],
    plus: Float[np.ndarray, "f line"],
    minus: Float[np.ndarray, "f line"],
) -> Complex[np.ndarray, "frf f"]:
    """Weighted products of residuals and functions."""
    return _times(weights * residual.real, plus) + _times(weights * residual.imag, minus)


def _on_linear(state: State, h: Complex[np.ndarray, "out in f"]) -> Float[np.ndarray, "out l"]:
    """Right-hand side of shapes and rest from the products of residuals and functions."""
    modes, terms = len(state.poles), state.rest.shape[2]
    shapes = np.einsum("im,oim->om", state.participation, h[:, :, :modes])
    rest = h[:, :, modes : modes + terms].reshape(len(h), -1)
    return _parts(np.concatenate([shapes, rest], axis=1))


def _on_shared(state: State, rows: slice, h: Complex[np.ndarray, "out in f"]) -> Float[np.ndarray, "out l"]:
    """Right-hand side of poles and participation, each output."""
    modes, terms, shapes = len(state.poles), state.rest.shape[2], state.shapes[rows]
    poles = np.einsum("im,om,oim->om", state.participation, shapes, h[:, :, modes + terms :])
    participation = (shapes[:, None] * h[:, :, :modes]).reshape(len(h), -1)
    return _parts(np.concatenate([poles, participation], axis=1))


def _parts(z: Complex[np.ndarray, "out l"]) -> Float[np.ndarray, "out m"]:
    """Gradient with respect to real, then imaginary parts."""
    return np.concatenate([z.real, -z.imag], axis=1)


class _Block:
    """Normal equations of a few outputs, from the sums over their lines."""

    def __init__(self, state: State, rows: slice, sums: np.ndarray, h: np.ndarray) -> None:
        self.state, self.rows = state, rows
        self.modes, self.terms = len(state.poles), state.rest.shape[2]
        self.participation, self.shapes = state.participation, state.shapes[rows]
        self.references = len(self.participation)
        shape = (len(self.shapes), self.references)
        self.h = h.reshape(*shape, -1)
        p, q = _products(state.every_pole, self.modes, sums)
        self.p = [a.reshape(*shape, *a.shape[1:]) for a in p]
        self.q = [a.reshape(*shape, *a.shape[1:]) for a in q]

    def linear(self) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and right-hand side of shapes and rest."""
        modes, terms, size = self.modes, self.terms, self.modes + self.references * self.terms
        p, q = (np.zeros((len(self.shapes), size, size), complex) for _ in range(2))
        for i, entries in enumerate(self.participation):
            p11, q11 = self.p[0][:, i], self.q[0][:, i]
            own = slice(modes + i * terms, modes + (i + 1) * terms)
            p[:, :modes, :modes] += entries.conj()[:, None] * p11[:, :modes, :modes] * entries
            q[:, :modes, :modes] += entries[:, None] * q11[:, :modes, :modes] * entries
            p[:, :modes, own] = entries.conj()[:, None] * p11[:, :modes, modes:]
            q[:, :modes, own] = entries[:, None] * q11[:, :modes, modes:]
            p[:, own, :modes] = p[:, :modes, own].conj().transpose(0, 2, 1)
            q[:, own, :modes] = q[:, :modes, own].transpose(0, 2, 1)
            p[:, own, own], q[:, own, own] = p11[:, modes:, modes:], q11[:, modes:, modes:]
        return _real(p, q), _on_linear(self.state, self.h)

    def coupling(self) -> np.ndarray:
        """Information shared by (shapes, rest) and (poles, participation)."""
        modes, terms = self.modes, self.terms
        size, width = modes + self.references * terms, modes * (1 + self.references)
        p, q = (np.zeros((len(self.shapes), size, width), complex) for _ in range(2))
        shapes = self.shapes[:, None, :]
        for i, entries in enumerate(self.participation):
            p11, p12, q11, q12 = self.p[0][:, i], self.p[1][:, i], self.q[0][:, i], self.q[1][:, i]
            rest, own = slice(modes + i * terms, modes + (i + 1) * terms), slice(modes * (1 + i), modes * (2 + i))
            by_pole = shapes * entries
            p[:, :modes, :modes] += entries.conj()[:, None] * p12[:, :modes] * by_pole
            q[:, :modes, :modes] += entries[:, None] * q12[:, :modes] * by_pole
            p[:, rest, :modes], q[:, rest, :modes] = p12[:, modes:] * by_pole, q12[:, modes:] * by_pole
            p[:, :modes, own] = entries.conj()[:, None] * p11[:, :modes, :modes] * shapes
            q[:, :modes, own] = entries[:, None] * q11[:, :modes, :modes] * shapes
            p[:, rest, own], q[:, rest, own] = p11[:, modes:, :modes] * shapes, q11[:, modes:, :modes] * shapes
        return _real(p, q)

    def shared(self) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and right-hand side of poles and participation, summed over the outputs."""
        modes, width, shapes = self.modes, self.modes * (1 + self.references), self.shapes
        p, q = (np.zeros((width, width), complex) for _ in range(2))
        # Products of shapes over the outputs weigh the sums over lines.
        twice, across = shapes.conj()[:, :, None] * shapes[:, None, :], shapes[:, :, None] * shapes[:, None, :]
        for i, entries in enumerate(self.participation):
            own = slice(modes * (1 + i), modes * (2 + i))
            p11, p12, p22 = (a[:, i, :modes] for a in self.p)
            q11, q12, q22 = (a[:, i, :modes] for a in self.q)
            p[:modes, :modes] += entries.conj()[:, None] * np.sum(p22 * twice, axis=0) * entries
            q[:modes, :modes] += entries[:, None] * np.sum(q22 * across, axis=0) * entries
            p[own, :modes] = np.sum(p12 * twice, axis=0) * entries
            q[own, :modes] = np.sum(q12 * across, axis=0) * entries
            p[:modes, own], q[:modes, own] = p[own, :modes].conj().T, q[own, :modes].T
            p[own, own] = np.sum(p11[:, :, :modes] * twice, axis=0)
            q[own, own] = np.sum(q11[:, :, :modes] * across, axis=0)
        return _real(p, q), np.sum(_on_shared(self.state, self.rows, self.h), axis=0)


def _products(
    poles: Complex[np.ndarray, "pole"], modes: int, sums: Complex[np.ndarray, "frf f"]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Hermitian and symmetric products of the functions of every FRF: of all of them with each other, with the second
    powers that belong to the poles of the modes, and of these with each other.
    """
    count = len(poles)
    alpha, beta = sums[:, :count], sums[:, count : 2 * count]
    hermitian, symmetric = poles.conj()[:, None] + poles, poles[:, None] + poles
    total, crossed = (np.empty((len(sums), count + 2, count + 2), complex) for _ in range(2))
    total[:, :count, :count] = -(alpha.conj()[:, :, None] + alpha[:, None, :]) / hermitian
    crossed[:, :count, :count] = -(alpha[:, :, None] + alpha[:, None, :]) / symmetric
    # Lower and upper residual: the same sums weighted by s^-2 and by 1.
    zero, one, two = (sums[:, 2 * count + k, None] for k in range(3))
    lower = (alpha - 2 * poles * one) / poles**2
    for place, static in ((count, lower), (count + 1, alpha)):
        total[:, :count, place], total[:, place, :count] = 0.5 * static.conj(), 0.5 * static
        crossed[:, :count, place] = crossed[:, place, :count] = 0.5 * static
    for matrix in (total, crossed):
        matrix[:, count:, count:] = 0.5 * np.stack([two, one, one, zero], axis=1).reshape(-1, 2, 2)
    # Derivatives with respect to the second pole, then with respect to both.
    b, p = beta[:, :modes], poles[:modes]
    statics = 0.5 * np.stack([(b - 2 * one - 2 * p * lower[:, :modes]) / p**2, b], axis=1)
    d, e = hermitian[:, :modes], symmetric[:, :modes]
    total_12 = -(b[:, None, :] + total[:, :count, :modes]) / d
    crossed_12 = -(b[:, None, :] + crossed[:, :count, :modes]) / e
    d, e = d[:modes], e[:modes]
    total_22 = (b[:, None, :] + b.conj()[:, :, None] + 2 * total[:, :modes, :modes]) / d**2
    crossed_22 = (b[:, None, :] + b[:, :, None] + 2 * crossed[:, :modes, :modes]) / e**2
    total_12, crossed_12 = np.concatenate([total_12, statics], axis=1), np.concatenate([crossed_12, statics], axis=1)
    return [total, total_12, total_22], [crossed, crossed_12, crossed_22]


def _real(
    p: Complex[np.ndarray, "*batch a b"], q: Complex[np.ndarray, "*batch a b"]
) -> Float[np.ndarray, "*batch c d"]:
    """Real form of ``z^H P z + Re(z^T Q z)`` in the real parts of z, then the imaginary parts."""
    upper = np.concatenate([p.real + q.real, -p.imag - q.imag], axis=-1)
    lower = np.concatenate([p.imag - q.imag, p.real - q.real], axis=-1)
    return np.concatenate([upper, lower], axis=-2)


def moved(state: State, normal: Linearisation, step: Float[np.ndarray, "unknown"], share: float = 1.0) -> State:
    """The state after a step of the shared unknowns and the adaptation of the linear ones."""
    modes, free = len(state.poles), state.free
    half = len(step) // 2
    change = share * (step[:half] + 1j * step[half:])
    participation = state.participation.copy()
    participation.reshape(-1)[free] += change[modes:]
    linear = np.zeros((len(state.shapes), len(state.determined)))
    linear[:, state.determined] = normal.offset + share * (normal.slope @ step)
    size = linear.shape[1] // 2
    linear = linear[:, :size] + 1j * linear[:, size:]
    outputs, references, terms = state.rest.shape
    return replace(
        state,
        poles=state.poles + change[:modes],
        participation=participation,
        shapes=state.shapes + linear[:, :modes],
        rest=state.rest + linear[:, modes:].reshape(outputs, references, terms),
    )


def freedom(data: Weighted, state: State) -> int:
    """Real equations left over after all unknowns."""
    own = int(np.count_nonzero(state.determined)) * len(state.shapes)
    return max(1, 2 * data.signals.size - own - 2 * (len(state.poles) + len(state.free)))


def refine(
    data: Weighted,
    start: State,
    floor: float,
    normal: Linearisation | None = None,
    iterations: int = 10,
    tolerance: float = 0.02,
) -> tuple[State, Linearisation]:
    """Gauss-Newton to the optimum; terms of the rest that noise explains are left out on the way.

    The cost never exceeds that of ``start`` with its linear unknowns adapted by more than noise gives to the terms left
    out.

    Parameters
    ----------
    start : with participation vectors whose largest entry is 1; ``normal`` are its normal equations where known.
    floor : smallest decay rate of a mode, in units of ``data.unit``.
    tolerance : stop when the quadratic form foretold the cost to this part of what one standard deviation of every
        shared unknown costs.
    """
    normal = linearise(data, start) if normal is None else normal
    fewer, reduced = spared(data, start, normal)
    state, found, reached = _descent(data, fewer, reduced, floor, iterations, tolerance)
    gone = normal.offset.size - reduced.offset.size
    # The loss was foretold by a quadratic form, which errs where unknowns nearly coincide or the poles have far to go.
    if gone and reached > _adapted(data, start, normal)[1] * (1 + chance(gone) / freedom(data, start)):
        state, found, _ = _descent(data, start, normal, floor, iterations, tolerance)
    return state, found


def chance(count: int) -> float:
    """Energy that noise of unit variance may give to as many unknowns: two standard deviations above the mean."""
    return count + _DOUBT * float(np.sqrt(2 * count))


def _descent(
    data: Weighted, start: State, normal: Linearisation, floor: float, iterations: int, tolerance: float
) -> tuple[State, Linearisation, float]:
    """Gauss-Newton steps from a start with its normal equations; also the cost reached."""
    state, reached = _adapted(data, start, normal)
    for _ in range(iterations):
        step, share = _step(start, normal), 1.0
        for _ in range(6):
            trial = _bounded(moved(start, normal, step, share), floor)
            value = cost(data, trial)
            if value > reached:
                # Products of shapes and steps of poles bend the surface: the linear unknowns have to follow exactly.
                trial, value = _adapted(data, trial, linearise(data, trial))
            if value <= reached:
                break
            share *= 0.2
        else:
            break
        expected = reached - share * float((2 * normal.gradient - share * normal.information @ step) @ step)
        gained, state, reached = reached - value, trial, value
        # The quadratic form was right to a small part of a standard deviation: there is nothing left to gain.
        allowed = tolerance * len(step) * value / freedom(data, state)
        exact = share == 1 and abs(value - expected) < allowed
        if exact or gained < 1e-9 * value:
            break
        start = state = normalised(state)
        normal = linearise(data, start)
    return state, normal, reached


def _adapted(data: Weighted, state: State, normal: Linearisation) -> tuple[State, float]:
    """The state with the best linear unknowns for its poles and participation, and its cost.

    Data without noise are fitted beyond what the normal equations resolve; then the state itself is the better one.
    """
    trial = moved(state, normal, np.zeros(len(normal.gradient)))
    value = cost(data, trial)
    if value > normal.cost:
        unchanged = cost(data, state)
        if unchanged < value:
            return state, unchanged
    return trial, value


def _step(state: State, normal: Linearisation) -> Float[np.ndarray, "unknown"]:
    """Gauss-Newton step; poles that would move by more than 0.7 of their decay rate move so far, the others adapt."""
    modes, half = len(state.poles), len(normal.gradient) // 2
    limit = 0.7 * np.abs(state.poles.real)
    step, held = np.zeros(2 * half), np.zeros(2 * half, bool)
    for _ in range(modes + 1):
        pull = normal.gradient - normal.information[:, held] @ step[held]
        step[~held] = inverse(normal.information[~held][:, ~held]) @ pull[~held]
        move = np.hypot(step[:modes], step[half : half + modes])
        far = np.flatnonzero((move > limit) & ~held[:modes])
        if not len(far):
            break
        both = np.concatenate([far, half + far])
        step[both] *= np.tile(limit[far] / move[far], 2)
        held[both] = True
    return step


def _bounded(state: State, floor: float) -> State:
    """The state with poles that decay by the floor at least."""
    return replace(state, poles=np.minimum(state.poles.real, -floor) + 1j * state.poles.imag)


def normalised(state: State) -> State:
    """The same state with participation vectors whose largest entry is 1."""
    largest = np.argmax(np.abs(state.participation), axis=0)
    scale = state.participation[largest, np.arange(len(state.poles))]
    return replace(state, participation=state.participation / scale, shapes=state.shapes * scale)


def spared(data: Weighted, state: State, normal: Linearisation) -> tuple[State, Linearisation]:
    """State and normal equations without the terms of the rest that noise explains, for all FRFs together.

    A set of terms is left out when its gain stays within two standard deviations of what noise gives to as many.
    """
    present = np.flatnonzero(state.active).tolist()
    factor = (normal.cost - normal.gain) / freedom(data, state)
    if not present or _loss(state, normal, present, factor) <= 0:
        return _without(state, normal, present) if present else (state, normal)
    gone: list[int] = []
    while True:
        losses = {term: _loss(state, normal, [*gone, term], factor) for term in set(present) - set(gone)}
        best = min(losses, key=losses.__getitem__, default=None)
        if best is None or losses[best] > 0:
            return _without(state, normal, gone) if gone else (state, normal)
        gone.append(best)


def _loss(state: State, normal: Linearisation, terms: list[int], factor: float) -> float:
    """Cost of leaving out terms of the rest when everything else adapts, beyond what noise explains."""
    estimate, stiffness, slope = _tied(state, normal, _rows(state, terms))
    pull = stiffness @ slope
    information = normal.information + np.einsum("oli,olj->ij", slope, pull, optimize=True)
    gradient = normal.gradient - np.einsum("oli,ol->i", pull, estimate)
    before = float(normal.gradient @ inverse(normal.information) @ normal.gradient)
    after = float(gradient @ inverse(information) @ gradient)
    lost = float(np.einsum("oa,oab,ob->", estimate, stiffness, estimate)) + before - after
    return lost / factor - chance(estimate.size)


def gains(data: Weighted, state: State, normal: Linearisation) -> tuple[Float[np.ndarray, "mode"], int]:
    """Energy that each pole explains when the linear unknowns of the others adapt, over that of the noise; and how many
    unknowns it does that with.
    """
    factor = (normal.cost - normal.gain) / freedom(data, state)
    place, half = np.cumsum(state.determined) - 1, len(state.determined) // 2
    found = np.empty(len(state.poles))
    for pole in range(len(found)):
        estimate, stiffness, _ = _tied(state, normal, place[[pole, half + pole]])
        found[pole] = float(np.einsum("oa,oab,ob->", estimate, stiffness, estimate)) / factor
    return found, 2 * (len(state.shapes) + len(state.participation))


def without_poles(state: State, gone: Int[np.ndarray, "gone"]) -> State:
    """The state without some of its poles."""
    keep = np.setdiff1d(np.arange(len(state.poles)), gone)
    return replace(
        state, poles=state.poles[keep], participation=state.participation[:, keep], shapes=state.shapes[:, keep]
    )


def _rows(state: State, terms: list[int]) -> np.ndarray:
    """Positions of terms of the rest among the linear unknowns of an output."""
    references, count = state.rest.shape[1:]
    modes, half = len(state.poles), len(state.determined) // 2
    place = np.cumsum(state.determined) - 1
    within = modes + (count * np.arange(references)[:, None] + np.array(terms, int)).reshape(-1)
    both = np.concatenate([within, within + half])
    return place[both[state.determined[both]]]


def _tied(state: State, normal: Linearisation, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimate and information of linear unknowns when the other linear ones adapt and the shared ones stay.

    Also the change of the estimate with the shared ones.
    """
    linear = np.concatenate([state.shapes, state.rest.reshape(len(state.rest), -1)], axis=1)
    own = np.concatenate([linear.real, linear.imag], axis=1)[:, state.determined]
    stiffness = inverse(normal.local[:, rows[:, None], rows])
    return own[:, rows] + normal.offset[:, rows], stiffness, normal.slope[:, rows]


def _without(state: State, normal: Linearisation, gone: list[int]) -> tuple[State, Linearisation]:
    """State and normal equations with terms of the rest fixed at 0: nothing has to be summed anew."""
    rows = _rows(state, gone)
    estimate, stiffness, slope = _tied(state, normal, rows)
    pull = stiffness @ slope
    stay = np.setdiff1d(np.arange(normal.offset.shape[1]), rows)
    cross = normal.local[:, stay[:, None], rows]
    lost = np.einsum("oab,ob->oa", stiffness, estimate)
    fewer = Linearisation(
        information=normal.information + np.einsum("oli,olj->ij", slope, pull, optimize=True),
        gradient=normal.gradient - np.einsum("oli,ol->i", pull, estimate),
        local=normal.local[:, stay[:, None], stay] - cross @ stiffness @ cross.transpose(0, 2, 1),
        slope=normal.slope[:, stay] - cross @ pull,
        offset=normal.offset[:, stay] - np.einsum("oab,ob->oa", cross, lost),
        cost=normal.cost,
        gain=normal.gain - float(np.einsum("oa,oa->", estimate, lost)),
    )
    rest, active = state.rest.copy(), state.active.copy()
    rest[:, :, gone], active[gone] = 0, False
    return replace(state, rest=rest, active=active), fewer
