"""Leakage-free FRFs from arbitrary forces: a rational model of system and transient on a few lines around each line.

The spectra of a finite record obey ``Y = G U + T + V`` exactly, where the transient T (what a window would suppress at
the price of smearing G) has the poles of G. On a few lines both are ratios of short polynomials with one denominator,
common to all responses and to all records or blocks: ``Y_o = (B_o U + C_o) / A + V_o``. The coefficients are those of
maximum likelihood, and ``G = B_o / A`` at the centre.

The linear problem ``A Y_o = B_o U + C_o + A V_o`` (Levy 1959) has the noise of the responses among its regressors,
which draws A towards 1 and the peaks down: by a third where the noise of a line is 30 % of the peak and the peak five
lines wide. It gives the start, weighted once by its own A (Sanathanan and Koerner 1963); Gauss-Newton steps from there
have the modelled responses in place of the measured ones. Sources: McKelvey and Guerin 2012 (local rational method);
Pintelon, Schoukens, Vandersteen and Barbe 2010 (local polynomial method, variance); Golub and Pereyra 1973 and Kaufman
1975 (elimination of the numerators).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.ndimage
from jaxtyping import Bool, Complex, Float, Int

DEGREE = 2
"""Degree of all polynomials: two modes may lie on the lines around one line."""

SPARE = 10
"""Lines around each line in excess of the unknowns of one record: they give the noise."""

CHUNK = 2048
"""Lines of all blocks that are solved together, at least sixteen of each: some 40 MB for every 64 responses."""

STEPS = 12
"""Gauss-Newton steps at most. After four of them peaks in much noise (a third of the peak) are still 5 to 10 % low;
after twenty and more single lines may run away on denominators that vanish beside the centre."""

_SETTLED = 0.002
"""Gain of twice the log-likelihood below which no further step is made: it moves values by a twentieth of their
standard deviation at most. What is left has the same sign on all lines of a peak, for steps begin where it is low: in
noise of a fifth of a peak of 40 lines its damping ratio is read too high by 0.51 of the standard deviation of a fit
with 0.02 and 8 steps, by 0.36 with these, by 0.28 with 0.0005 and 20 steps in a quarter more time (20 draws)."""

_LEVEL = 3
"""Models of a line, side by side, over whose lines the noise level is averaged that weights a response for the common
denominator. That of one line has a dozen degrees of freedom of the same residuals, to which the start adds its misfit
where a response is strong: weighted by it, peaks of 5 and 13 lines in noise of a tenth of the peak are 1.3 and 0.4 %
too wide, with the average 0.3 and 0.1 %."""

_START = 0.1
"""Damping of the first step, in units of the prior ``1 / (1 + |a|^2)``."""

_FLOOR = 1e-10
"""Least noise of a line over the power around it: rounding."""

Spectra = tuple[Complex[np.ndarray, "freq in"], Complex[np.ndarray, "freq out"]]
"""Spectra of the forces and of the responses of one record or block."""


@dataclass(frozen=True)
class Local:
    """FRFs of all blocks together and their variance (freq, out, in); noise and power of the responses per line, summed
    over the blocks (freq, out); variance that the lines would have each by itself over that (freq,); FRFs and weights
    of each block, with the common denominator (block, freq, out, in).
    """

    values: Complex[np.ndarray, "freq out in"]
    variance: Float[np.ndarray, "freq out in"]
    noise: Float[np.ndarray, "freq out"]
    power: Float[np.ndarray, "freq out"]
    effective_lines: Float[np.ndarray, "freq"]
    blocks: Complex[np.ndarray, "block freq out in"]
    weights: Float[np.ndarray, "block freq out in"]


@dataclass(frozen=True)
class _Part:
    """One block on the lines around each of k lines: the regressors of the acting forces, which of all forces these
    are, and the responses."""

    regressors: Complex[np.ndarray, "k line unknown"]
    acting: Bool[np.ndarray, "in"]
    y: Complex[np.ndarray, "k line out"]

    def __getitem__(self, some: Int[np.ndarray, "some"]) -> "_Part":
        return _Part(self.regressors[some], self.acting, self.y[some])


@dataclass(frozen=True)
class _Fitted:
    """The best numerators of one block for given denominators: ``q r`` is the QR factorisation of the regressors over
    the denominators (columns scaled), ``model`` and ``residual`` add up to the responses, ``energy`` is that of the
    residual and ``spare`` its degrees of freedom."""

    q: Complex[np.ndarray, "k line unknown"]
    inverse: Complex[np.ndarray, "k in unknown"]
    coefficients: Complex[np.ndarray, "k unknown out"]
    residual: Complex[np.ndarray, "k line out"]
    model: Complex[np.ndarray, "k line out"]
    energy: Float[np.ndarray, "k out"]
    spare: int


def width(inputs: int) -> int:
    """Lines (odd) that enter the model of one line."""
    return ((DEGREE + 1) * (inputs + 1) + DEGREE + SPARE) // 2 * 2 + 1


def local_model(blocks: Sequence[Spectra]) -> Local:
    """FRFs on every line of the spectra of whole records or blocks of one length (no window, lines without 0 Hz).

    A force whose spectrum is zero in a block does not act there: the block says nothing of its FRFs, and its weight for
    them is zero. In one block at least a force acts.
    """
    count, inputs = blocks[0][0].shape
    span = width(inputs)
    lines = np.arange(count)
    first = np.clip(lines - span // 2, 0, count - span)
    acting = [np.any(u != 0, axis=0) for u, _ in blocks]
    pieces = []
    together = max(min(CHUNK // len(blocks), CHUNK // 8), 16)
    for start in range(0, count, together):
        centre = lines[start : start + together]
        around = first[centre][:, None] + np.arange(span)
        powers = ((around - centre[:, None]) / (span // 2))[:, :, None] ** np.arange(DEGREE + 1)
        parts = [
            _Part(_regressors(u[around][:, :, which], powers), which, y[around])
            for (u, y), which in zip(blocks, acting, strict=True)
        ]
        pieces.append(_solved(parts, powers[:, :, 1:]))
    names = ("values", "variance", "noise", "power", "effective_lines")
    along = ("blocks", "weights")
    return Local(
        *(np.concatenate([getattr(piece, name) for piece in pieces]) for name in names),
        *(np.concatenate([getattr(piece, name) for piece in pieces], axis=1) for name in along),
    )


def _regressors(
    u: Complex[np.ndarray, "k line in"], powers: Float[np.ndarray, "k line order"]
) -> Complex[np.ndarray, "k line unknown"]:
    """Powers of the distance times each force, then the powers; the coefficients of order 0 come first."""
    forces = (powers[:, :, :, None] * u[:, :, None, :]).reshape(*u.shape[:2], -1)
    return np.concatenate([forces, powers.astype(complex)], axis=2)


def _solved(parts: Sequence[_Part], powers: Float[np.ndarray, "k line degree"]) -> Local:
    """Maximum likelihood on the lines around each of k lines."""
    lines, responses = len(powers), parts[0].y.shape[2]
    power = [np.mean(np.abs(part.y) ** 2, axis=1) for part in parts]
    start = _linear(_whitened(parts, power), powers)
    # Blocks differ in the level of their noise, which their lines here tell together.
    denominator = _denominator(start, powers)
    fitted = [_fit(part, denominator) for part in parts]
    energy = np.array([np.maximum(one.energy, _FLOOR * own) for one, own in zip(fitted, power, strict=True)])
    total = np.maximum(np.mean(energy, axis=0), 1e-300)
    level = np.mean(energy / total, axis=1)
    a = _maximum_likelihood(_whitened(parts, _averaged(_noise(fitted, level, power), powers.shape[1])), powers, start)
    denominator = _denominator(a, powers)
    fitted = [_fit(part, denominator) for part in parts]
    noise = _noise(fitted, level, power)
    values = np.zeros((len(parts), lines, responses, len(parts[0].acting)), complex)
    weights = np.zeros(values.shape)
    through = np.zeros((DEGREE, *values.shape[1:]), complex)
    for part, own, block, weight, size in zip(parts, fitted, values, weights, noise, strict=True):
        block[..., part.acting] = np.einsum("kiu,kuo->koi", own.inverse, own.coefficients)
        spread = np.sum(np.abs(own.inverse) ** 2, axis=2)
        weight[..., part.acting] = 1 / (spread[:, None, :] * size[:, :, None])
        moved = own.q.conj().transpose(0, 2, 1)[:, None] @ _directions(own.model, denominator, powers)
        through[..., part.acting] += weight[..., part.acting] * np.einsum("kiu,kauo->akoi", own.inverse, moved)
    sums = np.sum(weights, axis=0)
    share = np.divide(weights, sums, out=np.zeros_like(weights), where=sums > 0)
    through = np.divide(through, sums, out=np.zeros_like(through), where=sums > 0)
    # Where a root of the denominator cancels against the numerators the responses do not determine it: the prior does.
    white = _whitened(parts, noise)
    information, _ = _normal_equations([_fit(part, denominator) for part in white], denominator, powers)
    covariance = np.linalg.inv(information + _prior(a))
    variance = np.einsum("akoi,kab,bkoi->koi", through, covariance, through.conj(), optimize=True).real
    variance += np.divide(1, sums, out=np.full_like(sums, np.inf), where=sums > 0)
    alone = _line_variance(parts, noise, powers, np.argmin(np.abs(powers[:, :, 0]), axis=1))
    known = np.isfinite(variance) & np.isfinite(alone)
    ratio = np.where(known, alone, 1.0) / np.where(known, np.maximum(variance, 1e-300), 1.0)
    return Local(
        np.sum(share * values, axis=0),
        variance,
        np.sum(noise, axis=0),
        np.sum(power, axis=0),
        np.maximum(np.median(ratio.reshape(lines, -1), axis=1), 1),
        values,
        weights,
    )


def _line_variance(
    parts: Sequence[_Part],
    noise: Sequence[Float[np.ndarray, "k out"]],
    powers: Float[np.ndarray, "k line degree"],
    centre: Int[np.ndarray, "k"],
) -> Float[np.ndarray, "k out in"]:
    """Variance of FRFs that each line would give by itself, of a system that is known but for its level there.

    Of what forces drive on the lines around, the transient of each block takes its part. How much of it the line itself
    holds goes with the power that each force has on it.
    """
    count, span = len(parts[0].acting), powers.shape[1]
    lines, responses = noise[0].shape
    around: Complex[np.ndarray, "k out in in"] = np.zeros((lines, responses, count, count), complex)
    share = np.zeros((2, lines, responses, count))
    smooth = np.concatenate([np.ones_like(powers[:, :, :1]), powers], axis=2)
    transient = np.linalg.qr(smooth)[0]
    for part, size in zip(parts, noise, strict=True):
        acting = np.flatnonzero(part.acting)
        u = part.regressors[:, :, : len(acting)]
        left = u - transient @ (transient.transpose(0, 2, 1) @ u)
        own = np.zeros((lines, count, count), complex)
        own[:, acting[:, None], acting] = left.conj().transpose(0, 2, 1) @ left
        around += own[:, None] / size[:, :, None, None]
        power = np.abs(u) ** 2
        for place, one in enumerate((power.mean(axis=1), power[np.arange(lines), centre])):
            share[place][..., acting] += one[:, None, :] / size[:, :, None]
    some = np.flatnonzero(np.any([part.acting for part in parts], axis=0))
    variance = np.full((lines, responses, count), np.inf)
    inverse = np.linalg.pinv(around[:, :, some[:, None], some], hermitian=True)
    typical = span * np.diagonal(inverse, axis1=2, axis2=3).real
    variance[:, :, some] = typical * share[0][..., some] / np.maximum(share[1][..., some], 1e-300)
    return np.asarray(variance)


def _whitened(parts: Sequence[_Part], noise: Sequence[Float[np.ndarray, "k out"]]) -> list[_Part]:
    """Blocks whose responses have noise one; more responses than lines in as many combinations of them as lines.

    What determines the denominator are products of responses summed over them: any orthogonal combinations will do.
    """
    white = []
    for part, size in zip(parts, noise, strict=True):
        y = part.y / np.sqrt(np.maximum(size, 1e-300))[:, None, :]
        if y.shape[2] > y.shape[1]:
            y = np.asarray(np.linalg.qr(y.conj().transpose(0, 2, 1), mode="r")).conj().transpose(0, 2, 1)
        white.append(_Part(part.regressors, part.acting, y))
    return white


def _denominator(
    a: Complex[np.ndarray, "k degree"], powers: Float[np.ndarray, "k line degree"]
) -> Complex[np.ndarray, "k line"]:
    """``A`` on the lines, at least 0.001 large."""
    values = 1 + np.einsum("ka,kla->kl", a, powers)
    size = np.abs(values)
    return np.asarray(np.where(size > 1e-3, values, 1e-3 * np.where(size > 0, values / np.maximum(size, 1e-300), 1)))


def _prior(a: Complex[np.ndarray, "k degree"]) -> Float[np.ndarray, "k degree degree"]:
    """Information on the coefficients of a denominator before the data: its roots may lie anywhere around the lines."""
    return np.asarray(np.eye(DEGREE) / (1 + np.sum(np.abs(a) ** 2, axis=1))[:, None, None])


def _fit(part: _Part, denominator: Complex[np.ndarray, "k line"]) -> _Fitted:
    """The numerators of a block by projection."""
    regressors = part.regressors / denominator[:, :, None]
    scale = np.sqrt(np.mean(np.abs(regressors) ** 2, axis=1, keepdims=True))
    scale = np.where(scale > 0, scale, 1)
    q, r = np.linalg.qr(regressors / scale)
    inputs = int(np.sum(part.acting))
    coefficients = q.conj().transpose(0, 2, 1) @ part.y
    model = q @ coefficients
    residual = part.y - model
    return _Fitted(
        q,
        np.linalg.inv(r)[:, :inputs] / scale[:, 0, :inputs, None],
        coefficients,
        residual,
        model,
        np.sum(np.abs(residual) ** 2, axis=1),
        regressors.shape[1] - regressors.shape[2],
    )


def _noise(
    fitted: Sequence[_Fitted], level: Float[np.ndarray, "block out"], power: Sequence[Float[np.ndarray, "k out"]]
) -> list[Float[np.ndarray, "k out"]]:
    """Noise power of each block: its level times what all residuals say of the line.

    A costs each response of a block its share of what all determine together.
    """
    spare = sum(one.spare for one in fitted) - DEGREE / level.shape[1]
    pooled = sum(one.energy / np.maximum(size, 1e-300) for one, size in zip(fitted, level, strict=True)) / spare
    return [np.maximum(size * pooled, _FLOOR * own + 1e-300) for size, own in zip(level, power, strict=True)]


def _averaged(noise: Sequence[Float[np.ndarray, "k out"]], span: int) -> list[Float[np.ndarray, "k out"]]:
    """Geometric means over neighbouring lines (`_LEVEL`)."""
    return [
        np.exp(scipy.ndimage.uniform_filter1d(np.log(size), _LEVEL * span, axis=0, mode="nearest")) for size in noise
    ]


def _directions(
    signals: Complex[np.ndarray, "k line out"],
    denominator: Complex[np.ndarray, "k line"],
    powers: Float[np.ndarray, "k line degree"],
) -> Complex[np.ndarray, "k degree line out"]:
    """Signals over the denominators times powers of the distance: how a model moves with the coefficients, negative."""
    return np.asarray((signals / denominator[:, :, None])[:, None] * powers.transpose(0, 2, 1)[:, :, :, None])


def _normal_equations(
    fitted: Sequence[_Fitted],
    denominator: Complex[np.ndarray, "k line"],
    powers: Float[np.ndarray, "k line degree"],
    measured: Sequence[_Part] | None = None,
) -> tuple[Complex[np.ndarray, "k degree degree"], Complex[np.ndarray, "k degree"]]:
    """Information on the coefficients of the denominator, and the gradient at the modelled responses; with the
    ``measured`` ones in their place the matrix and the right side of the linear problem.
    """
    information: Complex[np.ndarray, "k degree degree"] = np.zeros((len(powers), DEGREE, DEGREE), complex)
    gradient: Complex[np.ndarray, "k degree"] = np.zeros((len(powers), DEGREE), complex)
    for place, own in enumerate(fitted):
        across = own.q.conj().transpose(0, 2, 1)
        if measured is None:
            signals, right = own.model, own.residual
        else:
            signals = measured[place].y
            right = signals / denominator[:, :, None]
            right = right - own.q @ (across @ right)
        moved = _directions(signals, denominator, powers)
        moved -= own.q[:, None] @ (across[:, None] @ moved)
        flat = moved.reshape(*moved.shape[:2], -1)
        information += flat.conj() @ flat.transpose(0, 2, 1)
        gradient += (flat.conj() @ right.reshape(len(powers), -1, 1))[:, :, 0]
    return information, gradient


def _linear(parts: Sequence[_Part], powers: Float[np.ndarray, "k line degree"]) -> Complex[np.ndarray, "k degree"]:
    """Denominators of the linear problem, the second time with each line over that of the first."""
    a = np.zeros((len(powers), DEGREE), complex)
    for _ in range(2):
        denominator = _denominator(a, powers)
        information, right = _normal_equations(
            [_fit(part, denominator) for part in parts], denominator, powers, measured=parts
        )
        least = 1e-12 * np.trace(information, axis1=1, axis2=2).real[:, None, None] + 1e-300
        a = -np.linalg.solve(information + least * np.eye(DEGREE), right[:, :, None])[:, :, 0]
    return a


def _maximum_likelihood(
    parts: Sequence[_Part], powers: Float[np.ndarray, "k line degree"], start: Complex[np.ndarray, "k degree"]
) -> Complex[np.ndarray, "k degree"]:
    """Damped Gauss-Newton steps (Marquardt 1963) of the denominators of those lines that still gain by them."""
    a, left = start.copy(), np.arange(len(start))
    damping, step, best = np.full(len(a), _START), np.zeros_like(a), np.full(len(a), np.inf)
    for turn in range(STEPS + 1):
        trial, some = a[left] + step[left], [part[left] for part in parts]
        denominator = _denominator(trial, powers[left])
        fitted = [_fit(part, denominator) for part in some]
        cost = np.sum([np.sum(one.energy, axis=1) for one in fitted], axis=0)
        better, gain = cost < best[left], best[left] - cost
        a[left[better]], best[left[better]] = trial[better], cost[better]
        if turn == STEPS:
            break
        damping[left[better]] /= 3
        information, gradient = _normal_equations(fitted, denominator, powers[left])
        damped = information + damping[left][:, None, None] * _prior(trial)
        newton = -np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]
        # What gained nothing is tried again from where it began, shorter.
        step[left] = np.where(better[:, None], newton, 0.2 * step[left])
        left = left[~better | (gain > _SETTLED)]
        if not len(left):
            break
    return a
