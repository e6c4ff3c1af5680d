"""Leakage-free FRFs from arbitrary forces: a rational model of system and transient on a few lines around each line.

The spectra of a finite record obey ``Y = G U + T + V`` exactly, where the transient T (what a window would suppress at
the price of smearing G) has the poles of G. On a few lines both are ratios of short polynomials with one denominator,
common to all responses and to all records or blocks: ``Y_o = (B_o U + C_o) / A + V_o``. The coefficients are those of
maximum (restricted) likelihood, and ``G = B_o / A`` at the centre.

The linear problem ``A Y_o = B_o U + C_o + A V_o`` (Levy 1959) has the noise of the responses among its regressors,
which draws A towards 1 and the peaks down: by a third where the noise of a line is 30 % of the peak and the peak five
lines wide. It gives the start, weighted once by its own A (Sanathanan and Koerner 1963); Gauss-Newton steps from there
have the modelled responses in place of the measured ones. Sources: McKelvey and Guerin 2012 (local rational method);
Pintelon, Schoukens, Vandersteen and Barbe 2010 (local polynomial method, variance); Golub and Pereyra 1973 and Kaufman
1975 (elimination of the numerators).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

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
"""Gauss-Newton steps at most, with equal weights and again with those of the lines. After four of them peaks in much
noise (a third of the peak) are still 5 to 10 % low (measured with equal weights alone)."""

_SETTLED = 0.002
"""Gain of twice the log-likelihood below which no further step is made: it moves values by a twentieth of their
standard deviation at most. What is left has the same sign on all lines of a peak, for steps begin where it is low: in
noise of a fifth of a peak of 40 lines its damping ratio is read too high by 0.51 of the standard deviation of a fit
with 0.02 and 8 steps, by 0.36 with these, by 0.28 with 0.0005 and 20 steps in a quarter more time (20 draws; with the
unrestricted likelihood and equal weights)."""

_LEVEL = 3
"""Models of a line, side by side, over whose lines the noise level is averaged that weights a response for the common
denominator. That of one line has a dozen degrees of freedom of the same residuals, to which the start adds its misfit
where a response is strong: weighted by it, peaks of 5 and 13 lines in noise of a tenth of the peak are 1.3 and 0.4 %
too wide, with the average 0.3 and 0.1 % (with the unrestricted likelihood and equal weights)."""

_RATIOS = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
"""Power of the noise that passes through the structure over that of the sensors, on the average of the lines around a
line: from none to no other."""

_GAIN = 0.5
"""Gain of the logarithmic likelihood of a line, averaged as the noise levels are, from which on noise passes through
the structure. Noise of sensors alone gains 0.1 on one line of twenty, and 0.5 on 0.4 % of the lines at most (peaks of
1, 4 and 16 lines); a force beside the measured one, 0.3 % as strong, gains 9 on a quarter of the lines of twelve
responses in blocks of 1024 samples, and 2 on one line of twenty in blocks of 4096."""

_START = 0.1
"""Damping of the first step, in units of the prior ``1 / (1 + |a|^2)``."""

_LEAST_SHARE = 1e-3
"""Part of a block in the mean of an FRF below which the block stands for the FRFs of others alone."""

CHI2_95 = 3.0
"""Square of a complex error over its variance that is exceeded with a probability of 5 %: -log 0.05."""

WEAKEST = 0.9
"""Weakness of the generators up to which the variance of FRFs over a force grows as Fieller's interval does. Beyond it,
where that has no end, a standard deviation is ten times the one to first order."""

_FLOOR = 1e-10
"""Least noise of a line over the power around it: rounding."""

Spectra = tuple[Complex[np.ndarray, "freq in"], Complex[np.ndarray, "freq out"]]
"""Spectra of the forces and of the responses of one record or block."""


@dataclass(frozen=True)
class Local:
    """FRFs of all blocks together and their variance (freq, out, in); noise and power of the responses per line, summed
    over the blocks (freq, out); variance that the lines would have each by itself over that (freq,); correlation of the
    errors of the outputs along the FRFs of each input (freq, in); FRFs and weights of each block (block, freq, out,
    in), where what a block does to the common denominator is a part of its FRFs: they say what the mean would be
    without the block; how weakly generators determine the forces (freq, in), 0 without generators.
    """

    values: Complex[np.ndarray, "freq out in"]
    variance: Float[np.ndarray, "freq out in"]
    noise: Float[np.ndarray, "freq out"]
    power: Float[np.ndarray, "freq out"]
    effective_lines: Float[np.ndarray, "freq"]
    correlation: Float[np.ndarray, "freq in"]
    blocks: Complex[np.ndarray, "block freq out in"]
    weights: Float[np.ndarray, "block freq out in"]
    weakness: Float[np.ndarray, "freq in"]


@dataclass(frozen=True)
class _Part:
    """One block on the lines around each of k lines: the regressors of the acting forces, which of all forces these
    are, and the responses."""

    regressors: Complex[np.ndarray, "k line unknown"]
    acting: Bool[np.ndarray, "in"]
    y: Complex[np.ndarray, "k line out"]

    def weighted(self, weights: Float[np.ndarray, "k line"]) -> "_Part":
        """The block with a weight for each line."""
        root = np.sqrt(weights)[:, :, None]
        return _Part(self.regressors * root, self.acting, self.y * root)

    def __getitem__(self, some: Int[np.ndarray, "some"]) -> "_Part":
        return _Part(self.regressors[some], self.acting, self.y[some])


@dataclass(frozen=True)
class _Fitted:
    """The best numerators of one block for given denominators: ``q r`` is the QR factorisation of the regressors over
    the denominators (columns scaled), ``model`` and ``residual`` add up to the responses, ``energy`` is that of the
    residual and ``spare`` its degrees of freedom; ``volume`` is the logarithm of the information on the numerators of a
    response, for denominators of a geometric mean of one over the lines."""

    q: Complex[np.ndarray, "k line unknown"]
    inverse: Complex[np.ndarray, "k in unknown"]
    coefficients: Complex[np.ndarray, "k unknown out"]
    residual: Complex[np.ndarray, "k line out"]
    model: Complex[np.ndarray, "k line out"]
    energy: Float[np.ndarray, "k out"]
    spare: int
    volume: Float[np.ndarray, "k"]


def width(inputs: int) -> int:
    """Lines (odd) that enter the model of one line."""
    return ((DEGREE + 1) * (inputs + 1) + DEGREE + SPARE) // 2 * 2 + 1


def local_model(blocks: Sequence[Spectra], wanted: Bool[np.ndarray, "freq"] | None = None, *, forces: int = 0) -> Local:
    """FRFs on every line, or on the ``wanted`` ones, of the spectra of whole records or blocks of one length (no
    window, lines without 0 Hz).

    With ``forces`` the inputs are signals of as many generators, which act in every block, and the first outputs are
    the forces: the FRFs are those of the other outputs to the forces, ``H = G_yr G_ur^-1``
    (:mod:`ema.estimate.generator`).

    A force whose spectrum is zero in a block does not act there: the block says nothing of its FRFs, and its weight for
    them is zero. In one block at least a force acts. A line has the same estimate whichever others are wanted: those
    that are solved together, over which noise levels are averaged, do not depend on it.
    """
    count, inputs = blocks[0][0].shape
    span = width(inputs)
    lines = np.arange(count)
    first = np.clip(lines - span // 2, 0, count - span)
    acting = [np.any(u != 0, axis=0) for u, _ in blocks]
    pieces: dict[str, list[np.ndarray]] = {field.name: [] for field in fields(Local)}
    together = max(min(CHUNK // len(blocks), CHUNK // 8), 16)
    for start in range(0, count, together):
        centre = lines[start : start + together]
        some = np.arange(len(centre)) if wanted is None else np.flatnonzero(wanted[centre])
        if not some.size:
            continue
        around = first[centre][:, None] + np.arange(span)
        powers = ((around - centre[:, None]) / (span // 2))[:, :, None] ** np.arange(DEGREE + 1)
        parts = [
            _Part(_regressors(u[around][:, :, which], powers), which, y[around])
            for (u, y), which in zip(blocks, acting, strict=True)
        ]
        piece = _solved(parts, powers[:, :, 1:], forces)
        for name, arrays in pieces.items():
            arrays.append(np.take(getattr(piece, name), some, axis=_axis(name)))
    return Local(**{name: np.concatenate(arrays, axis=_axis(name)) for name, arrays in pieces.items()})


def _axis(name: str) -> int:
    """Axis of the lines in a field of ``Local``."""
    return 1 if name in ("blocks", "weights") else 0


def _regressors(
    u: Complex[np.ndarray, "k line in"], powers: Float[np.ndarray, "k line order"]
) -> Complex[np.ndarray, "k line unknown"]:
    """Powers of the distance times each force, then the powers; the coefficients of order 0 come first."""
    forces = (powers[:, :, :, None] * u[:, :, None, :]).reshape(*u.shape[:2], -1)
    return np.concatenate([forces, powers.astype(complex)], axis=2)


@dataclass(frozen=True)
class _Optimum:
    """Coefficients of the denominators, the blocks with the weights of their lines, these weights, and the level of the
    noise of each block."""

    a: Complex[np.ndarray, "k degree"]
    parts: list[_Part]
    by_line: Float[np.ndarray, "k line"]
    level: Float[np.ndarray, "block out"]


def _optimum(
    parts: Sequence[_Part], power: Sequence[Float[np.ndarray, "k out"]], powers: Float[np.ndarray, "k line degree"]
) -> _Optimum:
    """Maximum likelihood for the denominators: from the linear problem with the noise of each response, and again with
    the weight of each line.
    """
    start = _linear(_whitened(parts, power), powers)
    # Blocks differ in the level of their noise, which their lines here tell together.
    denominator = _denominator(start, powers)
    fitted = [_fit(part, denominator) for part in parts]
    level = _levels(fitted, power)
    responses, span = parts[0].y.shape[2], powers.shape[1]
    white = _whitened(parts, _averaged(_noise(fitted, level, power), span))
    a = _maximum_likelihood(white, powers, start, responses=responses)
    by_line = _line_weights(white, a, powers)
    weighted = [part.weighted(by_line) for part in parts]
    fitted = [_fit(part, _denominator(a, powers)) for part in weighted]
    white = _whitened(weighted, _averaged(_noise(fitted, level, power), span))
    return _Optimum(_maximum_likelihood(white, powers, a, responses=responses), weighted, by_line, level)


def _solved(parts: Sequence[_Part], powers: Float[np.ndarray, "k line degree"], forces: int = 0) -> Local:
    """Maximum likelihood on the lines around each of k lines."""
    power = [np.mean(np.abs(part.y) ** 2, axis=1) for part in parts]
    optimum = _optimum(parts, power, powers)
    a, parts = optimum.a, optimum.parts
    denominator = _denominator(a, powers)
    fitted = [_fit(part, denominator) for part in parts]
    noise = _noise(fitted, optimum.level, power)
    values, weights, through = _of_blocks(parts, fitted, noise, denominator=denominator, powers=powers)
    sums = np.sum(weights, axis=0)
    share = np.divide(weights, sums, out=np.zeros_like(weights), where=sums > 0)
    mean = np.sum(share * values, axis=0)
    # Where a root of the denominator cancels against the numerators the responses do not determine it: the prior does.
    white = _whitened(parts, noise)
    each = [_normal_equations([_fit(part, denominator)], denominator, powers) for part in white]
    covariance = np.linalg.inv(sum(information for information, _ in each) + _prior(a))
    # What each block does to the denominator is a part of what it does to the mean (one step of the jackknife).
    pulls = np.array([gradient for _, gradient in each])
    pulls -= np.mean(pulls, axis=0)
    along = _along(fitted, noise, mean.conj() * np.sqrt(sums))
    common = covariance * np.maximum(np.mean(along, axis=1), 1)[:, None, None]
    per_force: Complex[np.ndarray, "k in in"] | None = None
    weak: Float[np.ndarray, "k in"] | float = 0.0
    if forces:
        variance = _variance(through, common, sums)
        per_force, weak = _per_force(mean[:, :forces], variance[:, :forces])
        base = mean[:, forces:] @ per_force
        fitted = [_less_forces(own, base, per_force) for own in fitted]
        power = [size[:, forces:] for size in power]
        noise = _noise(fitted, _levels(fitted, power), power)
        changes, weights, through = _of_blocks(parts, fitted, noise, denominator=denominator, powers=powers)
        sums = np.sum(weights, axis=0)
        share, values, mean = weights / sums, base + changes, base
        along = _along(fitted, noise, mean.conj() * np.sqrt(sums))
    moved_by = np.einsum("akoi,kab,pkb->pkoi", through, covariance, pulls, optimize=True)
    blocks = values - np.divide(moved_by, share, out=np.zeros_like(moved_by), where=share > _LEAST_SHARE)
    variance = _variance(through, common, sums)
    correlation = _correlation(mean, variance, sums, along=along, shared=(through, common))
    centre = np.argmin(np.abs(powers[:, :, 0]), axis=1)
    alone = _line_variance(parts, noise, centre)
    if per_force is not None:
        alone = alone @ np.abs(per_force) ** 2
        variance = variance / (1 - np.minimum(weak, WEAKEST))[:, None] ** 2
    known = np.isfinite(variance) & np.isfinite(alone)
    ratio = np.where(known, alone, 1.0) / np.where(known, np.maximum(variance, 1e-300), 1.0)
    return Local(
        mean,
        variance,
        np.sum(noise, axis=0) / np.take_along_axis(optimum.by_line, centre[:, None], axis=1),
        np.sum(power, axis=0),
        np.maximum(np.median(ratio.reshape(len(powers), -1), axis=1), 1),
        correlation,
        blocks,
        weights,
        np.broadcast_to(weak, (len(powers), mean.shape[2])),
    )


def _variance(
    through: Complex[np.ndarray, "degree k out in"],
    covariance: Complex[np.ndarray, "k degree degree"],
    sums: Float[np.ndarray, "k out in"],
) -> Float[np.ndarray, "k out in"]:
    """Variance of the means over the blocks: by the denominator, and by the numerators."""
    variance = np.einsum("akoi,kab,bkoi->koi", through, covariance, through.conj(), optimize=True).real
    return np.asarray(variance + np.divide(1, sums, out=np.full_like(sums, np.inf), where=sums > 0))


def _per_force(
    values: Complex[np.ndarray, "k force in"], variance: Float[np.ndarray, "k force in"]
) -> tuple[Complex[np.ndarray, "k in force"], Float[np.ndarray, "k force"]]:
    """Generator signals per force, the inverse of the FRFs of the forces, and how weakly these are determined."""
    inverse = np.linalg.pinv(values)
    return inverse, weakness(inverse, variance)


def weakness(
    inverse: Complex[np.ndarray, "k in force"], variance: Float[np.ndarray, "k force in"]
) -> Float[np.ndarray, "k force"]:
    """Share of the FRFs from generators to forces that their errors may have, squared, with a probability of 95 %.

    Errors of variance v are below ``3 v`` in square with that probability (chi-squared, two degrees of freedom). From 1
    on a force may be without its generator: the interval of a ratio over it has no end (Fieller 1954).
    """
    return np.asarray(CHI2_95 * np.einsum("kfi,kif->kf", variance, np.abs(inverse) ** 2))


def _less_forces(
    own: _Fitted, frfs: Complex[np.ndarray, "k out in"], per_force: Complex[np.ndarray, "k in in"]
) -> _Fitted:
    """Responses less those to the measured forces: to first order, the error of ``G_yr G_ur^-1`` is what of it follows
    the generators, ``(dG_yr - H dG_ur) G_ur^-1``.
    """
    residual = _rest(own.residual, frfs)
    return replace(
        own,
        inverse=per_force.transpose(0, 2, 1) @ own.inverse,
        coefficients=_rest(own.coefficients, frfs),
        residual=residual,
        model=_rest(own.model, frfs),
        energy=np.sum(np.abs(residual) ** 2, axis=1),
    )


def _rest(
    signals: Complex[np.ndarray, "k row all"], frfs: Complex[np.ndarray, "k out in"]
) -> Complex[np.ndarray, "k row out"]:
    """Signals of the responses less those of the forces, which come first, times the FRFs."""
    forces = frfs.shape[2]
    return np.asarray(signals[:, :, forces:] - signals[:, :, :forces] @ frfs.transpose(0, 2, 1))


def _levels(fitted: Sequence[_Fitted], power: Sequence[Float[np.ndarray, "k out"]]) -> Float[np.ndarray, "block out"]:
    """Levels of the noise of blocks, which their lines tell together."""
    energy = np.array([np.maximum(one.energy, _FLOOR * own) for one, own in zip(fitted, power, strict=True)])
    return np.asarray(np.mean(energy / np.maximum(np.mean(energy, axis=0), 1e-300), axis=1))


def _line_weights(
    parts: Sequence[_Part], a: Complex[np.ndarray, "k degree"], powers: Float[np.ndarray, "k line degree"]
) -> Float[np.ndarray, "k line"]:
    """Weights of the lines for noise of which a part passes through the structure: ``1 / (1 + r |G|^2)``.

    That of sensors is alike on all lines around one. What acts beside the measured forces, or is wrong about them, has
    the resonances of the FRFs: near a peak it is the larger part where elsewhere it is not seen. The ratio r of the two
    is that of restricted maximum likelihood of the noise along the responses, for all lines over which noise levels are
    averaged (`_LEVEL`).
    """
    denominator = _denominator(a, powers)
    fitted = [_fit(part, denominator) for part in parts]
    gain = np.mean([_gain(part, own, denominator, powers) for part, own in zip(parts, fitted, strict=True)], axis=0)
    gain /= np.maximum(np.mean(gain, axis=1, keepdims=True), 1e-300)
    size = [np.linalg.norm(own.model, axis=2) for own in fitted]
    along = [
        np.einsum("klo,klo->kl", own.model.conj(), own.residual) / np.maximum(norm, 1e-300)
        for own, norm in zip(fitted, size, strict=True)
    ]
    likelihood = np.array(
        [
            _likelihood(parts, denominator, powers, along=along, size=size, weights=1 / (1 + ratio * gain))
            for ratio in _RATIOS
        ]
    )
    likelihood = scipy.ndimage.uniform_filter1d(likelihood, _LEVEL * powers.shape[1], axis=1, mode="nearest")
    gained = np.max(likelihood, axis=0) > likelihood[0] + _GAIN
    ratio = np.where(gained, np.array(_RATIOS)[np.argmax(likelihood, axis=0)], 0.0)
    return np.asarray(1 / (1 + ratio[:, None] * gain))


def _gain(
    part: _Part, own: _Fitted, denominator: Complex[np.ndarray, "k line"], powers: Float[np.ndarray, "k line degree"]
) -> Float[np.ndarray, "k line"]:
    """Square of the gain from all forces to all outputs on the lines, as a block has it."""
    inputs = int(np.sum(part.acting))
    triangle = own.q.conj().transpose(0, 2, 1) @ (part.regressors / denominator[:, :, None])
    numerators = np.linalg.solve(triangle, own.coefficients)[:, : inputs * (DEGREE + 1)]
    smooth = np.concatenate([np.ones_like(powers[:, :, :1]), powers], axis=2) / denominator[:, :, None]
    frfs = smooth @ numerators.reshape(len(powers), DEGREE + 1, inputs * part.y.shape[2])
    return np.asarray(np.sum(np.abs(frfs) ** 2, axis=2))


def _likelihood(
    parts: Sequence[_Part],
    denominator: Complex[np.ndarray, "k line"],
    powers: Float[np.ndarray, "k line degree"],
    *,
    along: Sequence[Complex[np.ndarray, "k line"]],
    size: Sequence[Float[np.ndarray, "k line"]],
    weights: Float[np.ndarray, "k line"],
) -> Float[np.ndarray, "k"]:
    """Restricted logarithmic likelihood (Patterson and Thompson 1971) of the noise ``along`` the responses of each
    block, of their ``size``, for any level of it: numerators and denominator are unknown.
    """
    root = np.sqrt(weights)
    information: Complex[np.ndarray, "k degree degree"] = np.zeros((len(powers), DEGREE, DEGREE), complex)
    gradient: Complex[np.ndarray, "k degree"] = np.zeros((len(powers), DEGREE), complex)
    energy, volume, spare = np.zeros(len(powers)), np.zeros(len(powers)), -DEGREE
    for part, residual, model in zip(parts, along, size, strict=True):
        regressors = part.regressors / denominator[:, :, None]
        regressors = regressors / np.maximum(np.sqrt(np.mean(np.abs(regressors) ** 2, axis=1, keepdims=True)), 1e-300)
        q, r = np.linalg.qr(regressors * root[:, :, None])
        moved = powers * (model / denominator)[:, :, None]
        columns = np.concatenate([moved, residual[:, :, None]], axis=2) * root[:, :, None]
        columns -= q @ (q.conj().transpose(0, 2, 1) @ columns)
        products = columns.conj().transpose(0, 2, 1) @ columns
        information += products[:, :-1, :-1]
        gradient += products[:, :-1, -1]
        energy += products[:, -1, -1].real
        diagonal = np.abs(np.diagonal(r, axis1=1, axis2=2))
        volume += 2 * np.sum(np.log(np.maximum(diagonal, 1e-300)), axis=1) - np.sum(np.log(weights), axis=1)
        spare += residual.shape[1] - regressors.shape[2]
    least = 1e-12 * np.trace(information, axis1=1, axis2=2).real[:, None, None] + 1e-300
    information += least * np.eye(DEGREE)
    energy -= np.einsum("ka,ka->k", gradient.conj(), np.linalg.solve(information, gradient[:, :, None])[:, :, 0]).real
    volume += np.linalg.slogdet(information)[1]
    return np.asarray(-volume - spare * np.log(np.maximum(energy, 1e-300)))


def _of_blocks(
    parts: Sequence[_Part],
    fitted: Sequence[_Fitted],
    noise: Sequence[Float[np.ndarray, "k out"]],
    *,
    denominator: Complex[np.ndarray, "k line"],
    powers: Float[np.ndarray, "k line degree"],
) -> tuple[
    Complex[np.ndarray, "block k out in"], Float[np.ndarray, "block k out in"], Complex[np.ndarray, "degree k out in"]
]:
    """FRFs of each block at the centre, their weights, and how the coefficients of the denominator move the mean."""
    values = np.zeros((len(parts), *noise[0].shape, len(parts[0].acting)), complex)
    weights: Float[np.ndarray, "block k out in"] = np.zeros(values.shape)
    through = np.zeros((DEGREE, *values.shape[1:]), complex)
    for part, own, block, weight, size in zip(parts, fitted, values, weights, noise, strict=True):
        block[..., part.acting] = np.einsum("kiu,kuo->koi", own.inverse, own.coefficients)
        spread = np.sum(np.abs(own.inverse) ** 2, axis=2)
        weight[..., part.acting] = 1 / (spread[:, None, :] * size[:, :, None])
        moved = own.q.conj().transpose(0, 2, 1)[:, None] @ _directions(own.model, denominator, powers)
        through[..., part.acting] += weight[..., part.acting] * np.einsum("kiu,kauo->akoi", own.inverse, moved)
    sums = np.sum(weights, axis=0)
    return values, weights, np.divide(through, sums, out=np.zeros_like(through), where=sums > 0)


def _along(
    fitted: Sequence[_Fitted], noise: Sequence[Float[np.ndarray, "k out"]], directions: Complex[np.ndarray, "k out in"]
) -> Float[np.ndarray, "k in"]:
    """Noise of all outputs together along ``directions`` over that of outputs that err independently.

    What acts on the structure beside the measured forces, and what a force was not measured right by, moves all outputs
    together, near a resonance in its shape.
    """
    energy: Float[np.ndarray, "k in"] = np.zeros(directions.shape[::2])
    for own, size in zip(fitted, noise, strict=True):
        energy += np.sum(np.abs((own.residual / np.sqrt(size)[:, None, :]) @ directions) ** 2, axis=1)
    # The coefficients of the denominator have followed the noise along the responses.
    spare = sum(own.spare for own in fitted) - DEGREE
    return np.asarray(energy / (spare * np.maximum(np.sum(np.abs(directions) ** 2, axis=1), 1e-300)))


def _correlation(
    values: Complex[np.ndarray, "k out in"],
    variance: Float[np.ndarray, "k out in"],
    sums: Float[np.ndarray, "k out in"],
    *,
    along: Float[np.ndarray, "k in"],
    shared: tuple[Complex[np.ndarray, "degree k out in"], Complex[np.ndarray, "k degree degree"]],
) -> Float[np.ndarray, "k in"]:
    """Correlation that the errors of any two outputs have in the direction of the FRFs: of their noise, and by the
    denominator, ``shared``, whose error moves all of them.

    With it the errors of all outputs along the FRFs have ``1 + (n - 1) r`` times the variance that they have if they
    are independent, for n outputs of one signal-to-noise ratio.
    """
    through, covariance = shared
    known = np.isfinite(variance) & (sums > 0)
    inverse = np.where(known, 1 / np.where(known, variance, 1.0), 0.0)
    independent = np.sum(np.abs(values) ** 2 * inverse, axis=1)
    by_noise = np.sum(np.abs(values * inverse) ** 2 / np.where(known, sums, 1.0), axis=1)
    moved = np.einsum("akoi,koi->aki", through, values.conj() * inverse)
    by_denominator = np.einsum("aki,kab,bki->ki", moved, covariance, moved.conj(), optimize=True).real
    tiny = np.finfo(float).tiny
    ratio = (by_noise * along + by_denominator) / np.maximum(independent, tiny)
    outputs = independent**2 / np.maximum(np.sum((np.abs(values) ** 2 * inverse) ** 2, axis=1), tiny)
    return np.asarray(np.where(outputs > 1 + 1e-6, (ratio - 1) / np.maximum(outputs - 1, 1e-6), 0.0))


def _line_variance(
    parts: Sequence[_Part],
    noise: Sequence[Float[np.ndarray, "k out"]],
    centre: Int[np.ndarray, "k"],
) -> Float[np.ndarray, "k out in"]:
    """Variance of FRFs that each line would give by itself, of a system that is known but for its level there.

    Of what forces drive on the lines around, the transient of each block takes its part. How much of it the line itself
    holds goes with the power that each force has on it.
    """
    count, span = len(parts[0].acting), parts[0].y.shape[1]
    lines, responses = noise[0].shape
    around: Complex[np.ndarray, "k out in in"] = np.zeros((lines, responses, count, count), complex)
    share = np.zeros((2, lines, responses, count))
    for part, size in zip(parts, noise, strict=True):
        transient = np.linalg.qr(part.regressors[:, :, -DEGREE - 1 :])[0]
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


def _stable(a: Complex[np.ndarray, "k degree"]) -> Complex[np.ndarray, "k degree"]:
    """Denominators whose roots of negative damping have the same damping, positive.

    With ``exp(i w t)`` a decaying pole is a root above the real axis. Roots below it describe no passive structure but
    spare a fit its largest residuals: single lines of measured FRFs are off by 15 % with one beside them.
    """
    # 1 + a1 x + a2 x^2 = x^2 (z - z1) (z - z2) with z = 1 / x: a root above the axis has its inverse below
    centre, apart = -a[:, 0] / 2, np.sqrt(a[:, 0] ** 2 / 4 - a[:, 1])
    inverse = np.stack([centre + apart, centre - apart])
    inverse = np.where(inverse.imag > 0, inverse.conj(), inverse)
    return np.stack([-inverse.sum(axis=0), inverse.prod(axis=0)], axis=1)


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
        2 * np.sum(np.log(np.abs(np.diagonal(r, axis1=1, axis2=2)) * scale[:, 0]), axis=1)
        + 2 * regressors.shape[2] * np.mean(np.log(np.abs(denominator)), axis=1),
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
    parts: Sequence[_Part],
    powers: Float[np.ndarray, "k line degree"],
    start: Complex[np.ndarray, "k degree"],
    *,
    responses: int,
) -> Complex[np.ndarray, "k degree"]:
    """Damped Gauss-Newton steps (Marquardt 1963) of the denominators of those lines that still gain by them.

    The likelihood is that of the denominators whatever the numerators are (restricted, Patterson and Thompson 1971).
    With the best numerators in their place a root on one of the lines takes that line out of the fit: the residuals of
    all responses there are gained, and nothing is lost.
    """
    a, left = _stable(start), np.arange(len(start))
    damping, step, best = np.full(len(a), _START), np.zeros_like(a), np.full(len(a), np.inf)
    for turn in range(STEPS + 1):
        trial, some = _stable(a[left] + step[left]), [part[left] for part in parts]
        denominator = _denominator(trial, powers[left])
        fitted = [_fit(part, denominator) for part in some]
        cost = np.sum([np.sum(one.energy, axis=1) + responses * one.volume for one in fitted], axis=0)
        better, gain = cost < best[left], best[left] - cost
        a[left[better]], best[left[better]] = trial[better], cost[better]
        if turn == STEPS:
            break
        damping[left[better]] /= 3
        information, gradient = _normal_equations(fitted, denominator, powers[left])
        # The volume changes by minus the leverage of a line, its mean taken off, times the change of log |A|^2 there.
        leverage = np.sum([np.sum(np.abs(own.q) ** 2, axis=2) for own in fitted], axis=0)
        leverage -= np.mean(leverage, axis=1, keepdims=True)
        gradient -= responses * np.einsum("kl,kla->ka", leverage, (powers[left] / denominator[:, :, None]).conj())
        damped = information + damping[left][:, None, None] * _prior(trial)
        newton = -np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]
        # What gained nothing is tried again from where it began, shorter.
        step[left] = np.where(better[:, None], newton, 0.2 * step[left])
        left = left[~better | (gain > _SETTLED)]
        if not len(left):
            break
    return a
