"""Maximum-likelihood refinement of modes in modal form.

The FRFs are modelled as ``H = s^q (sum_r [psi_r L_r^T / (s - p_r) + conj] + rest)`` with poles p, participation vectors
L and, linear in the data, shapes psi and the rest: real lower and upper residuals and two unobserved modes, one below
and one above the band, that stand for everything farther away. Weighted by the noise of each line, output and
reference, the linear unknowns are eliminated (variable projection, Golub and Pereyra 1973, in Kaufman's
approximation), so that only poles and participation are iterated (modal form: El-Kafafy, De Troyer, Guillaume 2014).

All outputs share one small Gram matrix of basis functions, which does not grow with outputs or references.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float, Int

from ema.fit.noise import NoiseLevel

_BEYOND = 2.0
"""The unobserved modes lie at the band edges divided and multiplied by this."""

_UNOBSERVED = complex(-0.05, 1.0)
"""Their poles, over their angular frequency."""

_CHUNK = 512

_FEWEST = 24
"""Outputs, or directions of outputs, that are always kept: more cost next to nothing against the basis functions."""

NARROWEST = 0.3
"""Half-power bandwidth in frequency lines below which no pole is followed: the lines no longer tell its damping."""


@dataclass(frozen=True)
class Observations:
    """Weighted FRFs, outputs rotated onto the directions that stand out of the noise.

    Lines far from every pole are averaged in bins: ``s`` (freq,) is the centre of a bin, ``spread`` (freq,) the
    variance of its angular frequencies. ``signals`` (in, out, 2 freq): real and imaginary parts interleaved, divided by
    the noise; ``factor`` (freq,) is ``s^q`` over the noise of the line, by which every basis function is multiplied;
    ``rest`` are the poles of the unobserved modes.
    """

    s: Complex[np.ndarray, "freq"]
    spread: Float[np.ndarray, "freq"]
    factor: Complex[np.ndarray, "freq"]
    signals: Float[np.ndarray, "in out line"]
    reference_weights: Float[np.ndarray, "in"]
    rest: Complex[np.ndarray, "term"]

    @property
    def energy(self) -> float:
        """Energy of the rotated data."""
        return float(np.vdot(self.signals, self.signals))


@dataclass(frozen=True)
class ModalFit:
    """State of the refinement: nonlinear unknowns and what the elimination gives for them.

    ``cost`` is the weighted residual energy; ``coefficients`` (column, out) are the linear unknowns, two real rows
    (real and imaginary part) per mode first, then the rest per reference; ``gram`` belongs to these columns;
    ``information`` and ``gradient`` belong to the real unknowns (pole, then free participation entries, real and
    imaginary part each).
    """

    poles: Complex[np.ndarray, "mode"]
    participation: Complex[np.ndarray, "in mode"]
    cost: float
    coefficients: Float[np.ndarray, "column out"]
    gram: Float[np.ndarray, "column column"]
    information: Float[np.ndarray, "unknown unknown"]
    gradient: Float[np.ndarray, "unknown"]
    free: tuple[tuple[int, int], ...]


def bins(
    frequencies: Float[np.ndarray, "freq"], poles: Complex[np.ndarray, "pole"], fineness: float = 0.1
) -> Int[np.ndarray, "bin"]:
    """First lines of bins, none wider than ``fineness`` times the distance to the nearest pole or 1/400 of the band.

    There the model is so smooth that the mean over the bin holds all that its lines hold.
    """
    omega = 2 * np.pi * frequencies
    distance = np.full(len(omega), np.inf)
    for pole in poles:
        np.minimum(distance, np.abs(1j * omega - pole), out=distance)
    step = 2 * np.pi * (frequencies[-1] - frequencies[0]) / (len(frequencies) - 1)
    widest = np.clip(fineness * distance / step, 1, max(1, len(omega) / 400)).astype(int)
    starts, line = [], 0
    while line < len(omega):
        starts.append(line)
        width = int(widest[line])
        line += max(1, min(width, int(widest[min(line + width, len(omega)) - 1])))
    return np.array(starts)


def observe(
    frequencies: Float[np.ndarray, "freq"],
    values: Complex[np.ndarray, "freq out in"],
    derivative: int,
    noise: NoiseLevel,
    starts: Int[np.ndarray, "bin"] | None = None,
    rotate: bool = True,
) -> Observations:
    """Weight the FRFs by their noise, average them in bins, and rotate the outputs.

    Parameters
    ----------
    frequencies : Hz, above 0.
    derivative : power q of ``s`` that turns a receptance into the data.
    noise : standard deviations of lines (those of a single line, one for each bin), outputs and references.
    starts : first line of each bin; by default every line is its own.
    """
    lines, outputs, references = values.shape
    omega = 2 * np.pi * frequencies
    starts = np.arange(lines) if starts is None else starts
    counts = np.diff(np.append(starts, lines))
    centre = np.add.reduceat(omega, starts) / counts
    spread = np.maximum(np.add.reduceat(omega**2, starts) / counts - centre**2, 0) * (counts > 1)
    factor = (1j * centre) ** derivative * np.sqrt(counts) / noise.lines
    signals = np.empty((references, outputs, len(starts)), complex)
    receptance = (1j * omega) ** -derivative
    for first in range(0, outputs, 16):
        block = values[:, first : first + 16].transpose(2, 1, 0) * receptance
        signals[:, first : first + 16] = np.add.reduceat(block, starts, axis=-1) if len(starts) < lines else block
    signals *= factor / counts
    signals /= noise.outputs[:, None]
    real = signals.view(np.float64)
    weights = 1 / noise.references
    if rotate and outputs > _FEWEST:
        real = _rotate(real, weights)
    elif not np.allclose(weights, 1):
        real = real * weights[:, None, None]
    rest = 2 * np.pi * np.array([frequencies[0] / _BEYOND, frequencies[-1] * _BEYOND]) * _UNOBSERVED
    return Observations(1j * centre, spread, factor, real, weights, rest)


def _rotate(
    signals: Float[np.ndarray, "in out line"], weights: Float[np.ndarray, "in"]
) -> Float[np.ndarray, "in q line"]:
    """Project the outputs on the leading eigenvectors of their correlation (real, so that conjugate terms stay so).

    Directions of noise alone have the energy of the known noise; the smallest and the median energy bound it where it
    is known badly. With more modes than outputs every direction holds signal, and the median says nothing.
    """
    references, outputs, samples = signals.shape
    correlation = sum(w**2 * (block @ block.T) for w, block in zip(weights, signals, strict=True))
    energy, directions = np.linalg.eigh(correlation)
    # Edges of the eigenvalues of a noise matrix (Marchenko and Pastur 1967).
    ratio = np.sqrt(min(outputs / (samples * references), 0.25))
    noise = max(float(samples * references), float(energy[0]) / (1 - ratio) ** 2)
    floor = min(float(np.median(energy)), noise) * (1 + ratio) ** 2
    kept = int(np.clip(np.count_nonzero(energy > 1.05 * floor) + 2, _FEWEST, outputs))
    leading = directions[:, -kept:].T
    return np.stack([w * (leading @ block) for w, block in zip(weights, signals, strict=True)])


def _base(data: Observations, rows: slice, poles: np.ndarray) -> Float[np.ndarray, "base line"]:
    """Basis functions (two real columns each): poles, squared poles, unobserved modes, lower and upper residual.

    The mean of ``1 / (s - p)`` over a bin is ``f - spread f^3`` to third order.
    """
    s, factor, spread, rest = data.s[rows], data.factor[rows], data.spread[rows], data.rest
    every = np.concatenate([poles, rest])
    direct, mirrored = 1 / (s - every[:, None]), 1 / (s - every.conj()[:, None])
    modes = len(poles)
    squares = direct[:modes] ** 2, mirrored[:modes] ** 2
    if spread.any():
        squares = tuple(square * (1 - 3 * spread * square) for square in squares)
        direct, mirrored = direct * (1 - spread * direct**2), mirrored * (1 - spread * mirrored**2)
    out = np.empty((2 * modes + len(rest) + 1, 2, len(s)), complex)

    def pair(rows: slice, first: np.ndarray, second: np.ndarray) -> None:
        np.add(first, second, out=out[rows, 0])
        np.subtract(first, second, out=out[rows, 1])
        out[rows, 1] *= 1j

    pair(slice(0, modes), direct[:modes], mirrored[:modes])
    pair(slice(modes, 2 * modes), *squares)
    pair(slice(2 * modes, 2 * modes + len(rest)), direct[modes:], mirrored[modes:])
    scaled = s / np.abs(data.s).mean()
    # Rigid bodies below and static compliance above the band are real.
    out[-1, 0], out[-1, 1] = 1 / scaled**2, 1
    out *= factor
    return out.reshape(-1, len(s)).view(np.float64)


def base_products(
    data: Observations, poles: Complex[np.ndarray, "mode"]
) -> tuple[Float[np.ndarray, "base base"], Float[np.ndarray, "base in out"]]:
    """Gram matrix of the basis functions and their products with the data."""
    references, outputs, _ = data.signals.shape
    size = 2 * (2 * len(poles) + len(data.rest) + 1)
    gram, cross = np.zeros((size, size)), np.zeros((size, references * outputs))
    flat = data.signals.reshape(references * outputs, -1)
    for first in range(0, len(data.s), _CHUNK):
        base = _base(data, slice(first, first + _CHUNK), poles)
        gram += base @ base.T
        cross += base @ flat[:, 2 * first : 2 * (first + _CHUNK)].T
    return gram, cross.reshape(size, references, outputs)


def _columns(
    participation: Complex[np.ndarray, "in mode"], free: tuple[tuple[int, int], ...], terms: int, weights: np.ndarray
) -> tuple[Float[np.ndarray, "in base column"], int]:
    """For each reference, the basis functions that make the columns: modes, rest, then derivatives (poles, entries of
    the participation). Also returns the number of linear columns.
    """
    references, modes = participation.shape
    linear = 2 * modes + 2 * terms * references
    columns = np.zeros((references, 4 * modes + 2 * terms, linear + 2 * modes + 2 * len(free)))
    place = np.arange(modes)
    for i, entries in enumerate(participation):
        # Multiplying psi = x + jy by L acts on (x, y) as [[Re L, -Im L], [Im L, Re L]].
        for base, column in ((0, 0), (2 * modes, linear)):
            columns[i, base + 2 * place, column + 2 * place] = entries.real
            columns[i, base + 2 * place + 1, column + 2 * place + 1] = entries.real
            columns[i, base + 2 * place, column + 2 * place + 1] = -entries.imag
            columns[i, base + 2 * place + 1, column + 2 * place] = entries.imag
        own = 2 * modes + 2 * terms * i + np.arange(2 * terms)
        columns[i, 4 * modes + np.arange(2 * terms), own] = 1
        columns[i] *= weights[i]
    for position, (mode, i) in enumerate(free):
        column = linear + 2 * modes + 2 * position
        columns[i, 2 * mode, column] = columns[i, 2 * mode + 1, column + 1] = weights[i]
    return columns, linear


def evaluate(
    data: Observations, poles: Complex[np.ndarray, "mode"], participation: Complex[np.ndarray, "in mode"]
) -> ModalFit:
    """Eliminate the linear unknowns at given poles and participation."""
    modes = len(poles)
    largest = np.argmax(np.abs(participation), axis=0)
    free = tuple((r, i) for r in range(modes) for i in range(len(participation)) if i != largest[r])
    base_gram, base_cross = base_products(data, poles)
    columns, linear = _columns(participation, free, len(data.rest) + 1, data.reference_weights)
    gram = sum(c.T @ (base_gram @ c) for c in columns)
    cross = sum(c.T @ base_cross[:, i] for i, c in enumerate(columns))
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    gram, cross = gram * np.outer(scale, scale), cross * scale[:, None]
    factor = _factor(gram[:linear, :linear])
    solution = scipy.linalg.cho_solve(factor, cross[:linear], check_finite=False)
    projector = scipy.linalg.cho_solve(factor, gram[:linear, linear:], check_finite=False)
    inner = (gram[linear:, linear:] - gram[linear:, :linear] @ projector) / np.outer(scale[linear:], scale[linear:])
    outer = (cross[linear:] - projector.T @ cross[:linear]) / scale[linear:, None]
    cost = data.energy - float(np.vdot(cross[:linear], solution))
    coefficients = solution * scale[:linear, None]
    owner = np.array([*range(modes), *(r for r, _ in free)], int)
    information, gradient = _normal_equations(
        coefficients[: 2 * modes].reshape(modes, 2, data.signals.shape[1]), inner, outer, owner
    )
    unscaled = gram[:linear, :linear] / np.outer(scale[:linear], scale[:linear])
    return ModalFit(poles, participation, cost, coefficients, unscaled, information, gradient, free)


def _factor(gram: Float[np.ndarray, "column column"]) -> tuple[np.ndarray, bool]:
    """Cholesky factor of a matrix with unit diagonal; poles that coincide ask for a larger ridge."""
    ridge = 1e-12
    while True:
        try:
            factor: tuple[np.ndarray, bool] = scipy.linalg.cho_factor(
                gram + ridge * np.eye(len(gram)), check_finite=False
            )
        except scipy.linalg.LinAlgError:
            if ridge > 1e-2:
                raise
            ridge *= 100
        else:
            return factor


def _normal_equations(
    shapes: Float[np.ndarray, "mode 2 out"], inner: np.ndarray, outer: np.ndarray, owner: np.ndarray
) -> tuple[Float[np.ndarray, "unknown unknown"], Float[np.ndarray, "unknown"]]:
    """Gauss-Newton matrix and gradient of the real and imaginary parts of every nonlinear unknown.

    A change ``a + jb`` of an unknown adds ``(a + jb) psi`` times its derivative function: (x, y) for a, (-y, x) for b.
    """
    x, y = shapes[:, 0], shapes[:, 1]
    turned = np.stack([np.stack([x, y], 1), np.stack([-y, x], 1)], 1)
    modes, count = len(shapes), len(owner)
    flat = turned.reshape(4 * modes, shapes.shape[2])
    products = (flat @ flat.T).reshape(modes, 2, 2, modes, 2, 2)[owner][:, :, :, owner]
    blocks = inner.reshape(count, 2, count, 2)
    information = np.einsum("apcbqd,acbd->apbq", products, blocks, optimize=True).reshape(2 * count, 2 * count)
    gradient = np.einsum("apco,aco->ap", turned[owner], outer.reshape(count, 2, shapes.shape[2]), optimize=True)
    return information, gradient.reshape(-1)


def refine(data: Observations, start: ModalFit, iterations: int = 12, tolerance: float = 1e-4) -> ModalFit:
    """Gauss-Newton with Levenberg-Marquardt damping; never returns a larger cost than that of ``start``.

    Parameters
    ----------
    tolerance : stop when no pole moves by more than this fraction of its standard deviation or of its decay rate.
    """
    state, damping = start, 0.0
    modes = len(start.poles)
    floor = narrowest_decay(data)
    for _ in range(iterations if modes else 0):
        diagonal = np.maximum(np.diag(state.information), 1e-300)
        scale = 1 / np.sqrt(diagonal)
        matrix = state.information * np.outer(scale, scale) + (damping + 1e-10) * np.eye(len(diagonal))
        step = scale * scipy.linalg.cho_solve(_factor(matrix), scale * state.gradient, check_finite=False)
        move = step[: 2 * modes : 2] + 1j * step[1 : 2 * modes : 2]
        decay = np.abs(state.poles.real)
        shrink = min(1.0, float(np.min(0.7 * decay / np.maximum(np.abs(move), 1e-300))) * 4)
        move = np.minimum(1, 0.7 * decay / np.maximum(np.abs(move), 1e-300)) * move
        participation = state.participation.copy()
        for place, (mode, i) in enumerate(state.free):
            entry = 2 * (modes + place)
            participation[i, mode] += shrink * (step[entry] + 1j * step[entry + 1])
        participation /= participation[np.argmax(np.abs(participation), axis=0), np.arange(modes)]
        moved = state.poles + move
        # A pole that starts narrower than the floor may stay so: pushed away, it would raise the cost of every step.
        ceiling = np.maximum(-floor, state.poles.real)
        trial = evaluate(data, np.minimum(moved.real, ceiling) + 1j * moved.imag, participation)
        if not trial.cost <= state.cost:
            damping = max(10 * damping, 1e-3)
            if damping > 1e4:
                break
            continue
        damping = damping / 10 if damping > 1e-4 else 0.0
        gained = state.cost - trial.cost
        state = trial
        if np.max(np.abs(move) / decay) < tolerance or gained < 1e-8 * state.cost:
            break
    return state


def narrowest_decay(data: Observations) -> float:
    """Decay rate in rad/s of the narrowest pole that is followed."""
    return 0.5 * NARROWEST * float(np.min(np.diff(data.s.imag))) if len(data.s) > 1 else 0.0


def without_lines(data: Observations, frequency: float) -> Observations:
    """The observations without the line next to an angular frequency (rad/s) and its two neighbours."""
    nearest = int(np.argmin(np.abs(data.s.imag - frequency)))
    gone = slice(max(nearest - 1, 0), nearest + 2)
    factor, signals = data.factor.copy(), data.signals.copy()
    factor[gone] = 0
    signals[:, :, 2 * gone.start : 2 * gone.stop] = 0
    return replace(data, factor=factor, signals=signals)


def gains(fit: ModalFit) -> Float[np.ndarray, "mode"]:
    """Increase of the cost when one mode is left out and the other linear unknowns adapt, each mode in turn."""
    modes = len(fit.poles)
    scale = 1 / np.sqrt(np.diag(fit.gram))
    inverse = np.linalg.inv(fit.gram * np.outer(scale, scale) + 1e-12 * np.eye(len(scale)))
    result = np.empty(modes)
    for mode in range(modes):
        rows = slice(2 * mode, 2 * mode + 2)
        own = fit.coefficients[rows] / scale[rows, None]
        result[mode] = np.vdot(own, np.linalg.solve(inverse[rows, rows], own))
    return result


def variance_factor(data: Observations, fit: ModalFit) -> float:
    """Residual energy per real equation left over: 1 when the noise levels are right and the model holds."""
    unknowns = len(fit.coefficients) * data.signals.shape[1] + len(fit.gradient)
    equations = data.signals[0].shape[-1] * data.signals.shape[0] * data.signals.shape[1]
    return fit.cost / max(equations - unknowns, 1)


def covariance(fit: ModalFit, factor: float) -> Float[np.ndarray, "mode 2 2"]:
    """Covariance of natural frequency (Hz) and damping ratio of each mode from the information matrix."""
    scale = 1 / np.sqrt(np.maximum(np.diag(fit.information), 1e-300))
    inverse = np.linalg.pinv(fit.information * np.outer(scale, scale), rcond=1e-13, hermitian=True)
    inverse = factor * inverse * np.outer(scale, scale)
    result = np.empty((len(fit.poles), 2, 2))
    for mode, pole in enumerate(fit.poles):
        size = abs(pole)
        rows = np.array([pole.real, pole.imag]) / (2 * np.pi * size)
        slopes = np.array([-(pole.imag**2), pole.real * pole.imag]) / size**3
        jacobian = np.stack([rows, slopes])
        result[mode] = jacobian @ inverse[2 * mode : 2 * mode + 2, 2 * mode : 2 * mode + 2] @ jacobian.T
    return result


def drop(data: Observations, fit: ModalFit, keep: np.ndarray) -> ModalFit:
    """The fit with some of its modes only."""
    return evaluate(data, fit.poles[keep], fit.participation[:, keep])


def with_mode(data: Observations, fit: ModalFit, pole: complex, vector: Complex[np.ndarray, "in"]) -> ModalFit:
    """The fit with one mode more."""
    vector = vector / vector[np.argmax(np.abs(vector))]
    return evaluate(data, np.append(fit.poles, pole), np.column_stack([fit.participation, vector]))


def reweighted(
    data: Observations, noise: NoiseLevel, lines: Float[np.ndarray, "freq"]
) -> tuple[Observations, NoiseLevel]:
    """The same observations with the noise of each line multiplied by ``lines``."""
    signals = data.signals / np.repeat(lines, 2)
    updated = replace(data, signals=signals, factor=data.factor / lines)
    return updated, replace(noise, lines=noise.lines * lines)


def _differences(data: Observations, fit: ModalFit) -> Iterator[tuple[int, int, Float[np.ndarray, "out line"]]]:
    """Weighted residuals, a block of bins at a time: first bin, reference, real and imaginary parts interleaved."""
    columns, linear = _columns(fit.participation, fit.free, len(data.rest) + 1, data.reference_weights)
    mixing = [c[:, :linear] @ fit.coefficients for c in columns]
    for first in range(0, len(data.s), _CHUNK):
        base = _base(data, slice(first, first + _CHUNK), fit.poles)
        for i, part in enumerate(mixing):
            yield first, i, data.signals[i][:, 2 * first : 2 * (first + _CHUNK)] - part.T @ base


def residuals(data: Observations, fit: ModalFit) -> tuple[Float[np.ndarray, "freq"], Float[np.ndarray, "freq"]]:
    """Weighted residual over all (rotated) FRFs: its root mean square in each bin, and its product with that of the
    next bin, which noise leaves near 0 and a misfit near the square.
    """
    references, outputs, _ = data.signals.shape
    energy, together = np.zeros(len(data.s)), np.zeros(len(data.s))
    for first, _, difference in _differences(data, fit):
        energy[first : first + _CHUNK] += np.einsum("ok,ok->k", difference, difference).reshape(-1, 2).sum(axis=1)
        product = np.einsum("ok,ok->k", difference[:, 2:], difference[:, :-2])
        together[first : first + len(product) // 2] += product.reshape(-1, 2).sum(axis=1)
    count = 2 * references * outputs
    return np.sqrt(energy / count), together / count


def power_by_reference(data: Observations, fit: ModalFit) -> Float[np.ndarray, "freq in"]:
    """Mean square of the weighted residual in each bin, for each reference."""
    references, outputs, _ = data.signals.shape
    power = np.zeros((len(data.s), references))
    for first, i, difference in _differences(data, fit):
        energy = np.einsum("ok,ok->k", difference, difference).reshape(-1, 2).sum(axis=1)
        power[first : first + _CHUNK, i] = energy / (2 * outputs)
    return power


def correlation(data: Observations, fit: ModalFit) -> float:
    """Correlation of neighbouring residuals: 0 for noise, up to 1 for what a better model would explain."""
    rms, together = residuals(data, fit)
    return float(together.sum() / max(np.sum(rms**2), 1e-300))


def dominance(data: Observations, fit: ModalFit) -> Float[np.ndarray, "mode"]:
    """Energy of each mode over that of the data within its half-power bandwidth (three bins at least)."""
    columns, linear = _columns(fit.participation, fit.free, len(data.rest) + 1, data.reference_weights)
    result = np.empty(len(fit.poles))
    for mode, pole in enumerate(fit.poles):
        distance = np.abs(data.s.imag - pole.imag)
        reach = max(abs(pole.real), np.partition(distance, min(2, len(distance) - 1))[min(2, len(distance) - 1)])
        near = np.flatnonzero(distance <= reach)
        rows = slice(int(near[0]), int(near[-1]) + 1)
        base = _base(data, rows, fit.poles[[mode]])[:2]
        own = [c[2 * mode : 2 * mode + 2, :linear] @ fit.coefficients for c in columns]
        energy = sum(float(np.sum((part.T @ base) ** 2)) for part in own)
        measured = float(np.sum(data.signals[:, :, 2 * rows.start : 2 * rows.stop] ** 2))
        result[mode] = energy / max(measured, 1e-300)
    return result


def _trial_base(data: Observations, rows: slice, poles: Complex[np.ndarray, "trial"]) -> Float[np.ndarray, "base line"]:
    """Basis functions of poles alone; the width of the bins is of no matter to a trial."""
    s, factor = data.s[rows], data.factor[rows]
    common = factor / (s**2 - 2 * poles.real[:, None] * s + (np.abs(poles) ** 2)[:, None])
    out = np.empty((len(poles), 2, len(s)), complex)
    np.multiply(common, 2 * (s - poles.real[:, None]), out=out[:, 0])
    np.multiply(common, -2 * poles.imag[:, None], out=out[:, 1])
    return out.reshape(-1, len(s)).view(np.float64)


def trial_products(
    data: Observations, fit: ModalFit, trials: Complex[np.ndarray, "trial"]
) -> tuple[Float[np.ndarray, "trial 2 2"], Float[np.ndarray, "trial 2 in column"], Float[np.ndarray, "trial 2 in out"]]:
    """Products of trial poles with themselves, with the linear columns of ``fit`` and with the data."""
    references, outputs, _ = data.signals.shape
    flat = data.signals.reshape(references * outputs, -1)
    modes, count = len(fit.poles), len(trials)
    columns, linear = _columns(fit.participation, fit.free, len(data.rest) + 1, data.reference_weights)
    known = np.concatenate([np.arange(2 * modes), np.arange(4 * modes, columns.shape[1])])
    own = np.zeros((count, 2, 2))
    overlap = np.zeros((2 * count, len(known)))
    cross = np.zeros((2 * count, references * outputs))
    for first in range(0, len(data.s), _CHUNK):
        rows = slice(first, first + _CHUNK)
        trial = _trial_base(data, rows, trials)
        pairs = trial.reshape(count, 2, -1)
        own += np.einsum("tak,tbk->tab", pairs, pairs, optimize=True)
        overlap += trial @ _base(data, rows, fit.poles)[known].T
        cross += trial @ flat[:, 2 * first : 2 * (first + _CHUNK)].T
    mixing = columns[:, known, :linear]
    weighted = [weight * (overlap @ m) for weight, m in zip(data.reference_weights, mixing, strict=True)]
    products = cross.reshape(count, 2, references, outputs) * data.reference_weights[:, None]
    return own, np.stack(weighted, 1).reshape(count, 2, references, linear), products


def full_gram(data: Observations, fit: ModalFit) -> Float[np.ndarray, "function function"]:
    """Gram matrix of the columns: those of the linear unknowns, then two for each nonlinear one."""
    base_gram, _ = base_products(data, fit.poles)
    columns, _ = _columns(fit.participation, fit.free, len(data.rest) + 1, data.reference_weights)
    return np.sum([c.T @ (base_gram @ c) for c in columns], axis=0)


def linear_unknowns(data: Observations, fit: ModalFit) -> Float[np.ndarray, "column out"]:
    """Shapes and residual terms of the outputs in ``data`` at the poles and participation of ``fit``."""
    base_gram, base_cross = base_products(data, fit.poles)
    columns, linear = _columns(fit.participation, fit.free, len(data.rest) + 1, data.reference_weights)
    gram = sum(c[:, :linear].T @ (base_gram @ c[:, :linear]) for c in columns)
    cross = sum(c[:, :linear].T @ base_cross[:, i] for i, c in enumerate(columns))
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    factor = _factor(gram * np.outer(scale, scale))
    return scale[:, None] * scipy.linalg.cho_solve(factor, cross * scale[:, None], check_finite=False)
