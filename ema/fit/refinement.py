"""From a selection of modes to the optimum for the noise of every FRF, and what the intervals rest on."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data import FrfSet, damping_ratios
from ema.fit import estimator, model, noise, output_correlation, scatter, search
from ema.fit.compression import SAMPLE
from ema.fit.estimator import Fit, Observations
from ema.fit.line_correlation import LineCorrelation, sample
from ema.fit.narrow import caution
from ema.fit.policy import POLICY
from ema.fit.prepare import Prepared
from ema.fit.search import MISFIT
from ema.fit.selection import BEYOND, Dropped, Selection, compressed

_AT_ONCE = 400_000
"""Values that are worked on at a time: memory alone, values depend on it by rounding."""
_ROUNDS = 5
"""Optima at which the poles are judged again, at most: a bound on the work. With 2 the modes of 14 random systems stay
the same."""
_ITERATIONS, _CONVERGED, LOOSE = 25, 1e-13, 1e-4
"""Steps to the optimum at most, what they may still promise for each unknown in units of the noise (a millionth of a
standard deviation), and the information that holds the unknowns in their place (`estimator.refine`)."""
_UNKNOWN = 1e12
"""Variance over what the weights say of a value that the data do not determine: a million standard deviations, far
beyond any prior, which is then what is known of it."""
_TRIED = 6
"""Poles that are left out in turn, to see whether the others do without them: a bound on the work, the least determined
first. With 3 and with 12 the modes of 14 random systems stay the same."""


@dataclass(frozen=True)
class Refined:
    """The optimum and its data; ``kept`` (mode,) are the poles of the selection that it has, ``dropped`` the modes that
    it has not, and why.

    ``inflation`` (unknown,) is the variance of each shared unknown over what the weights say, ``inflation_of_shapes``
    (mode,) that of shapes: residual energy over that of the assumed noise, times the loss by errors that are correlated
    over lines, times that of a misfit at the peaks, and for poles at least what changes between lines, outputs and
    impacts. ``loss`` (mode,) is the variance of a pole over that for errors independent from line to line; ``basis``
    says in words what the noise level rests on, ``misfit`` whether the residual is no noise. ``fit`` has all residual
    terms (`_with_all_residual_terms`), ``at_optimum`` those that noise does not explain.
    """

    fit: Fit
    at_optimum: Fit
    data: Observations
    kept: Int[np.ndarray, "mode"]
    dropped: tuple[Dropped, ...]
    inflation: Float[np.ndarray, "unknown"]
    inflation_of_shapes: Float[np.ndarray, "mode"]
    loss: Float[np.ndarray, "mode"]
    basis: str
    misfit: bool


def refined(band: FrfSet, data: Prepared, chosen: Selection, start: "Start | None" = None) -> Refined:
    """Refine selected poles, participation, shapes and residual terms with a weight for every line of every FRF.

    Parameters
    ----------
    start : where to begin, for the poles of ``chosen``; by default they are fitted with the noise of each FRF first.
    """
    known, basis = known_variance(band, data)
    dropped: tuple[Dropped, ...] = ()
    if start is None:
        flat, fit, kept, dropped, misfit = _first(data, chosen, known)
        terms = fit.terms
    else:
        flat, fit, terms = start.data, start.fit, start.terms
        kept, misfit = np.arange(len(fit.poles)), False
    if misfit and known is not None:
        known, basis = None, f"scatter of the residuals over the lines, which is beyond the {basis.partition(',')[0]}"
    elif known is not None and estimator.undamped(flat, fit.poles).any():
        # A variance that was stated contains what they explain.
        known, basis = (
            None,
            f"scatter of the residuals over the lines, for the {basis.partition(',')[0]} contains tones",
        )
    # Few values: what the start was still off by shows in their noise.
    again = 2 if known is None and not misfit and flat.signals.size <= SAMPLE else 1
    for turn in range(_ROUNDS):
        if turn:
            fit, left = estimator.determined(flat, fit)
            kept = kept[left]
        if turn < again:
            flat, fit = _weighted(flat, fit, data.derivative, known, misfit)
        before = len(fit.poles)
        # What is fitted badly asks for poles that noise would not: then all of them stay.
        if not misfit:
            fit, kept, gone = _pruned(flat, fit, chosen, kept)
            dropped = (*dropped, *gone)
        if turn >= again and len(fit.poles) == before:
            break
        fit = _optimum(flat, _spared(flat, fit))
    fit = estimator.with_orthogonal_matrices(flat, fit)
    factor = fit.variance_factor(flat)
    of_poles, of_shapes, of_shared = loss(flat, fit, _by_themselves(flat, data.derivative, band, known))
    correlation = output_correlation.of_references(band, data, flat, known_variance(band, data)[0])
    of_poles = of_poles * output_correlation.factor(flat, fit, correlation, flat.outputs)
    change = scatter.Changes.of(flat, fit, fit.variance_factor(flat), factor * of_poles)
    between, of_what = _between(flat, fit, change, band, data, is_mode=chosen.possible[kept], shared=of_shared)
    basis += of_what
    at_peaks = misfit_at_peaks(flat, fit) if misfit else np.ones(len(fit.poles))
    inflation = inflation_of(flat, fit, factor * of_poles, at_peaks, between)
    wide = _with_all_residual_terms(flat, fit, terms)
    return Refined(wide, fit, flat, kept, dropped, inflation, factor * of_shapes * at_peaks, of_poles, basis, misfit)


def inflation_of(
    flat: Observations,
    fit: Fit,
    of_poles: Float[np.ndarray, "mode"],
    at_peaks: Float[np.ndarray, "mode"],
    between: Float[np.ndarray, "2 mode"],
) -> Float[np.ndarray, "unknown"]:
    """Variance of each shared unknown over what the weights say: that of its pole by noise, by a misfit at the peaks,
    and by what changes between FRFs.
    """
    inflation = np.tile((of_poles * at_peaks)[fit.owners], 2)
    half, modes = len(inflation) // 2, len(fit.poles)
    inflation[:modes] *= np.maximum(between[0] / at_peaks, 1)
    inflation[half : half + modes] *= np.maximum(between[1] / at_peaks, 1)
    # At its lower bound a decay rate may as well be anything below: it is known to itself, which is the prior.
    bounded = -fit.poles.real <= (1 + 1e-6) * estimator.narrowest(flat, fit.poles)
    inflation[:modes][bounded] = _UNKNOWN
    return inflation


@dataclass(frozen=True)
class Start:
    """A fit to begin with, its data, and all residual terms of which it may have some."""

    data: Observations
    fit: Fit
    terms: model.Background


def with_weak(optimum: Refined, chosen: Selection, band: tuple[float, float]) -> Start | None:
    """The optimum with the resonances that its residual shows although they are weak or hidden under others
    (`ema.fit.search.weak`); ``None`` where there is none.
    """
    fit, data = optimum.at_optimum, optimum.data
    lines = LineCorrelation.of_noise(data, fit)
    poles, vectors = search.weak(chosen.data, compressed(chosen, fit), data, fit, lines, band)
    for count in dict.fromkeys((len(poles), min(1, len(poles)))):
        if not count:
            continue
        larger = estimator.refine(data, estimator.with_modes(data, fit, poles[:count], vectors[:count]), _ITERATIONS)
        noise = output_correlation.limit(data, fit, search.passes_for_weak) * fit.variance_factor(data)
        required = noise * float(np.sum(lines.factor(poles[:count])))
        sound = np.all(larger.poles.real < 0) and np.all(larger.share >= estimator.RANK)
        if sound and fit.cost - larger.cost > required:
            return Start(data, larger, optimum.fit.terms)
    return None


def without_needless(
    optimum: Refined, possible: Bool[np.ndarray, "mode"]
) -> tuple[Int[np.ndarray, "kept"], Start] | None:
    """The optimum without a pole that the others replace when they adapt, and which poles stay; ``None`` where every
    pole is needed.

    What a pole explains with the others where they are says how well they share the work, not whether all are needed:
    of too many wide ones each does, and none is determined. Only those are tried, the least determined first.
    """
    fit, data = optimum.at_optimum, optimum.data
    factor = fit.variance_factor(data)
    noise = output_correlation.limit(data, fit, search.passes_for_weak) * factor
    required = noise * LineCorrelation.of_noise(data, fit).factor(fit.poles)
    uncertain = np.sqrt(np.maximum(estimator.covariance(fit, factor)[:, 1, 1], 0)) / damping_ratios(fit.poles)
    doubtful = np.flatnonzero(possible & (uncertain > POLICY.damping_uncertainty))
    for pole in doubtful[np.argsort(-uncertain[doubtful])][:_TRIED]:
        kept = np.setdiff1d(np.arange(len(fit.poles)), pole)
        smaller = estimator.refine(data, estimator.drop(data, fit, kept), _ITERATIONS)
        if smaller.cost - fit.cost <= required[pole]:
            return kept, Start(data, smaller, optimum.fit.terms)
    return None


def _first(
    data: Prepared, chosen: Selection, known: Float[np.ndarray, "out in freq"] | None
) -> tuple[Observations, Fit, Int[np.ndarray, "kept"], tuple[Dropped, ...], bool]:
    """The selection fitted to all lines with the noise of each FRF: data, fit, which poles it keeps, those in the band
    that it does not, and whether the residual is no noise.
    """
    # The noise of each FRF is known by its size, of lines nothing yet: all outputs share one elimination.
    level = replace(data.noise, lines=np.ones(len(data.frequencies)))
    observed = estimator.observe(data.frequencies, data.values, data.derivative, level, rotate=False)
    flat = _by_output(observed, data)
    fit = _start(observed, data, chosen)
    misfit = _misfit(flat, _by_row(fit, data), data.derivative, known)
    # What nothing needs is not free to go somewhere else, nor what the noise of single lines explains.
    fit, kept = estimator.determined(observed, fit)
    dropped: tuple[Dropped, ...] = ()
    if not misfit:
        there = _weighted(flat, _by_row(fit, data), data.derivative, known, misfit, held=True)
        _, left, dropped = _pruned(*there, chosen, kept)
        if len(left) < len(kept):
            fit, kept = estimator.drop(observed, fit, np.isin(kept, left)), left
    fit, left = estimator.determined(observed, _optimum(observed, fit))
    return flat, _by_row(fit, data), kept[left], dropped, misfit


def _optimum(flat: Observations, start: Fit) -> Fit:
    """The optimum next to a start: where the search came from does not show in it, nor in the weights made from it."""
    return estimator.refine(flat, start, _ITERATIONS, tolerance=_CONVERGED, prior=LOOSE, free_outside=True)


def _by_output(observed: Observations, data: Prepared) -> Observations:
    """The same with each output as a row of its own."""
    outputs = data.noise.outputs[:, None, None]
    return replace(
        observed,
        signals=observed.signals.transpose(1, 0, 2, 3) * outputs[:, None],
        weights=observed.weights / outputs**2,
        spread=None,
        means=None,
    )


def _by_row(fit: Fit, data: Prepared) -> Fit:
    """A fit with all outputs in one row, as that of the same data with a row for each output."""
    outputs = data.noise.outputs[:, None, None]

    def for_each(matrices: np.ndarray) -> np.ndarray:
        """What does not depend on the size of an output."""
        return np.broadcast_to(matrices, (len(outputs), *matrices.shape[1:]))

    return replace(
        fit,
        shapes=fit.shapes.transpose(1, 0, 2) * outputs,
        rest=fit.rest.transpose(1, 0, 2, 3) * outputs[:, None],
        local=fit.local * outputs**2,
        of_rest=fit.of_rest * outputs[:, None] ** 2,
        slope=for_each(fit.slope),
        lean=for_each(fit.lean),
    )


def _start(observed: Observations, data: Prepared, chosen: Selection) -> Fit:
    """The selection with shapes and residual terms on all outputs and lines."""
    # The terms of the selection follow its bins and weights, which depend on how it got there.
    weight = np.abs(observed.s) ** (2 * data.derivative) / data.noise.lines**2
    terms = model.background(observed.s, weight, chosen.fit.terms.poles)
    return estimator.evaluate(observed, chosen.fit.poles, chosen.fit.participation, terms)


def _weighted(
    flat: Observations,
    fit: Fit,
    derivative: int,
    known: Float[np.ndarray, "out in freq"] | None,
    misfit: bool,
    *,
    held: bool = False,
) -> tuple[Observations, Fit]:
    """The observations with the weights that a fit gives them, and the fit there, its poles ``held`` or not."""
    flat = replace(flat, weights=_weights(flat, fit, derivative, known, misfit))
    start = fit.shapes, fit.rest
    return flat, estimator.evaluate(flat, fit.poles, fit.participation, fit.terms, start, held=held)


def _between(
    flat: Observations,
    fit: Fit,
    change: scatter.Changes,
    band: FrfSet,
    data: Prepared,
    *,
    is_mode: Bool[np.ndarray, "mode"],
    shared: Float[np.ndarray, "mode"],
) -> tuple[Float[np.ndarray, "2 mode"], str]:
    """Factors for what noise alone does not explain, and what it is in words."""
    found = {
        "noise that the FRFs share": scatter.between_lines(flat, fit, change, shared),
        "scatter between the FRFs": scatter.between_outputs(flat, fit, change),
    }
    if band.deviations is not None:
        impacts = _single_impacts(band, data, flat)
        found["scatter between the averages"] = scatter.between_impacts(flat, fit, change, *impacts)
    return largest(found, is_mode)


def largest(
    found: dict[str, Float[np.ndarray, "2 mode"]], is_mode: Bool[np.ndarray, "mode"]
) -> tuple[Float[np.ndarray, "2 mode"], str]:
    """The largest of the factors by several causes, and the causes that widen a mode."""
    words = [name for name, factor in found.items() if np.any(factor[:, is_mode] > 1)]
    basis = f"; of some poles, {' and '.join(words)}, which is beyond that" if words else ""
    return np.max(list(found.values()), axis=0), basis


def _spared(flat: Observations, fit: Fit) -> Fit:
    """The fit without the last residual terms, as long as noise explains them for all FRFs together.

    A set of terms is left out when its gain, poles adapted, stays within two standard deviations of what noise gives to
    as many unknowns.
    """
    per_column, columns, factor = flat.outputs * flat.references, fit.rest.shape[-1], fit.variance_factor(flat)
    lost, all_columns = 0.0, columns
    while columns:
        fewer = max(columns - 2, 0)
        without = estimator.cost_of_fewer_terms(fit, fewer)
        if not within_noise(without - lost, per_column * (columns - fewer), factor):
            break
        lost, columns = without, fewer
    # Far from the optimum the linearisation promises too much.
    while columns < all_columns:
        found = estimator.with_terms(flat, fit, columns)
        lost = found.cost - _promised(found) - (fit.cost - _promised(fit))
        if within_noise(lost, per_column * (all_columns - columns), factor):
            return found
        columns = min(columns + 2, all_columns)
    return fit


def within_noise(lost: float, count: int, factor: float) -> bool:
    """Whether noise of a variance factor explains what so many unknowns gain."""
    return bool(lost <= factor * (count + estimator.DOUBT * np.sqrt(2 * count)))


def _with_all_residual_terms(flat: Observations, fit: Fit, terms: model.Background) -> Fit:
    """The fit with what would be known of its unknowns if none of the residual terms had been left out.

    Which of them noise explains is a choice made with the same data. Values without them have the smaller errors, but
    intervals that take the choice for certain are too narrow (Leeb and Poetscher 2005), most for wide modes and at the
    ends of the band, which resemble residual terms.
    """
    columns = fit.rest.shape[-1]
    if columns == terms.mixing.shape[1]:
        return fit
    rest = np.concatenate([fit.rest, np.zeros((*fit.rest.shape[:-1], terms.mixing.shape[1] - columns))], axis=-1)
    wide = estimator.evaluate(flat, fit.poles, fit.participation, terms, (fit.shapes, rest))
    wide = estimator.with_orthogonal_matrices(flat, wide)
    return replace(wide, shapes=fit.shapes, rest=rest, cost=fit.cost)


def _promised(fit: Fit) -> float:
    """What a Gauss-Newton step would take off the cost."""
    by_cause = estimator.root(fit)
    return float(np.sum((by_cause.T @ fit.gradient) ** 2))


def _pruned(
    data: Observations, fit: Fit, chosen: Selection, kept: Int[np.ndarray, "mode"]
) -> tuple[Fit, Int[np.ndarray, "left"], tuple[Dropped, ...]]:
    """The fit without poles that noise explains, which poles of the selection stay, and those in the band that do not.

    Here every line of every FRF has its own noise, which the selection knows on the average only. Background stays as
    long as it does more than noise at its place, a pole in the band as long as it does more than noise anywhere there;
    whether it is a mode is judged at the end.
    """
    dropped: tuple[Dropped, ...] = ()
    while True:
        share = estimator.gains(data, fit) / max(fit.variance_factor(data), 1e-300)
        share /= LineCorrelation.of_noise(data, fit).factor(fit.poles)
        outside = output_correlation.limit(data, fit, lambda n: n + estimator.DOUBT * np.sqrt(2 * n))
        in_band = output_correlation.limit(data, fit, search.passes_for_weak) * caution(fit.poles, fit.poles, data.line)
        share /= np.where(chosen.possible[kept], in_band, outside)
        gone: list[int] = []
        for k in np.argsort(share):
            if share[k] > 1:
                break
            # Leaving one out can make its neighbours needed.
            reach = 4 * (np.abs(fit.poles[gone].real) + abs(fit.poles[k].real))
            if np.all(np.abs(fit.poles[gone] - fit.poles[k]) > reach):
                gone.append(int(k))
        if not gone:
            return fit, kept, dropped
        dropped += tuple(
            Dropped(complex(fit.poles[k]), f"it explains {share[k]:.2g} times what noise of its lines would")
            for k in gone
            if chosen.possible[kept[k]]
        )
        left = np.setdiff1d(np.arange(len(fit.poles)), gone)
        fit, kept = estimator.drop(data, fit, left), kept[left]


def known_variance(band: FrfSet, data: Prepared) -> tuple[Float[np.ndarray, "out in freq"] | None, str]:
    """Variance that came with the FRFs, arranged like the signals, and what the intervals rest on."""
    variance = noise.measured(band)
    if variance is None:
        single = band.averages is not None and np.max(band.averages, initial=0) <= 1
        why = "; with a single average the coherence is 1 and says nothing" if single else ""
        return None, f"scatter of the residuals over the lines{why}"
    if data.swapped:
        variance = variance.transpose(0, 2, 1)
    variance = variance[len(variance) - len(data.frequencies) :][:, data.rows][:, :, data.columns]
    source = "variance of the FRFs" if band.variance is not None else "coherence of the FRFs"
    return np.ascontiguousarray(variance.transpose(1, 2, 0)), f"{source}, scaled to the residuals"


def _single_impacts(
    band: FrfSet, data: Prepared, flat: Observations
) -> tuple[Complex[np.ndarray, "blow out in freq"], Int[np.ndarray, "blow out in"]]:
    """Deviations by single impacts, arranged like the signals, and the numbers of the impacts."""
    assert band.deviations is not None
    values, blows = band.deviations.values, band.deviations.blows
    if data.swapped:
        values, blows = values.transpose(0, 1, 3, 2), blows.transpose(0, 2, 1)
    values = values[:, values.shape[1] - len(data.frequencies) :][:, :, data.rows][:, :, :, data.columns]
    curve = flat.s**-data.derivative
    return values.transpose(0, 2, 3, 1) * curve, blows[:, data.rows][:, :, data.columns]


def _misfit(data: Observations, fit: Fit, derivative: int, known: Float[np.ndarray, "out in freq"] | None) -> bool:
    """Whether the residual is no noise: correlated over lines, and beyond the known variance where there is one."""
    some = sample(data)
    residual = estimator.residual(data, fit, some)[:, 0] * np.abs(data.s) ** derivative
    residual /= np.sqrt(known[some]) if known is not None else 1
    energy = np.abs(residual) ** 2
    together = float(np.sum((residual[..., 1:] * residual[..., :-1].conj()).real))
    if together <= MISFIT * float(np.sum(energy)):
        return False
    # A window correlates noise over lines too, but does not make it larger than its variance.
    return known is None or float(np.mean(energy)) > BEYOND


def _weights(
    data: Observations, fit: Fit, derivative: int, known: Float[np.ndarray, "out in freq"] | None, misfit: bool
) -> Float[np.ndarray, "out in freq"]:
    """Weights of all lines of all FRFs from their variances, or from the residual of a fit.

    A ``misfit`` that is larger than the noise may shape them within narrow limits only.
    """
    shape = noise_shape(data, fit, derivative, known, misfit)
    weights = np.empty(data.weights.shape)
    for rows in data.row_blocks(data.signals[0].size, _AT_ONCE):
        weights[rows] = shape.weights(data, fit, rows, known)
    return weights


@dataclass(frozen=True)
class NoiseShape:
    """What makes the weights of any FRF from its residuals or its variance: ``structure``, and the ``typical`` noise
    over the size of an FRF where it is a misfit. ``derivative`` turns a receptance into the data.
    """

    structure: noise.Structure
    typical: float
    derivative: int

    def weights(
        self, data: Observations, fit: Fit, rows: slice, known: Float[np.ndarray, "out in freq"] | None
    ) -> Float[np.ndarray, "some in freq"]:
        """Weights of some rows."""
        power, size = _powers(data, fit, rows, self.derivative, known)
        found, curve = self.structure, np.abs(data.s) ** (2 * self.derivative)
        variance = found.variance(power, size) if known is None else noise.pooled(power, found, size)
        # An FRF that is fitted well draws the poles to itself and is fitted better: none counts more than the typical.
        variance *= np.maximum(self.typical / _relative(variance, size), 1)
        return np.asarray(2 * curve / variance)


def noise_shape(
    data: Observations, fit: Fit, derivative: int, known: Float[np.ndarray, "out in freq"] | None, misfit: bool
) -> NoiseShape:
    """What some outputs say of the noise of all."""
    some = sample(data)
    power, size = _powers(data, fit, some, derivative, known)
    found = noise.structure(power, size, plain=misfit)
    if known is None and len(fit.poles):
        left = 1 - _leverage(data, fit, np.abs(data.s) ** (2 * derivative) / found.variance(power, size))
        found = noise.structure(power, size, left, plain=misfit)
    typical = float(np.median(_relative(found.variance(power, size), size))) if misfit else 0.0
    return NoiseShape(found, typical, derivative)


def _powers(
    data: Observations, fit: Fit, rows: slice, derivative: int, known: Float[np.ndarray, "out in freq"] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Noise power (stated, or that of the residual) and squared size of the fitted FRF for some rows."""
    curve = np.abs(data.s) ** (2 * derivative)
    fitted = estimator.fitted(data, fit, rows)[:, 0]
    size = (fitted.real**2 + fitted.imag**2) * curve
    if known is not None:
        return known[rows], size
    residual = data.signals[rows, 0] - fitted
    return (residual.real**2 + residual.imag**2) * curve, size


def _relative(variance: Float[np.ndarray, "out in freq"], size: Float[np.ndarray, "out in freq"]) -> np.ndarray:
    """Mean variance of each FRF over its mean square, shape (out, in, 1)."""
    tiny = np.finfo(float).tiny
    found: np.ndarray = np.mean(variance, axis=-1, keepdims=True) / (np.mean(size, axis=-1, keepdims=True) + tiny)
    return found + tiny


def _leverage(data: Observations, fit: Fit, weights: Float[np.ndarray, "some in freq"]) -> Float[np.ndarray, "in freq"]:
    """Share of the noise of each line that the modes follow, typical of all outputs.

    Where a peak is a few lines wide this is a good part, and the residual alone would make those lines look quiet.
    """
    outputs, modes = data.outputs, len(fit.poles)
    typical = np.mean(weights / np.mean(weights, axis=-1, keepdims=True), axis=0)
    direct, mirrored = 1 / (data.s - fit.poles[:, None]), 1 / (data.s - fit.poles.conj()[:, None])
    columns = []
    for entries, weight in zip(fit.participation[:, :, None], typical, strict=True):
        one, other = entries * direct, entries.conj() * mirrored
        columns.append(np.concatenate([one + other, 1j * (one - other)]) * np.sqrt(weight))
    information = np.zeros((2 * modes, 2 * modes))
    for block in columns:
        flat = block.view(float)
        information += flat @ flat.T
    spread = estimator.inverse(information)
    shares = [0.5 * np.sum((block.conj() * (spread @ block)).real, axis=0) for block in columns]
    # Poles and participation are shared by all outputs.
    return np.minimum(np.array(shares) * (1 + len(columns) / outputs), 0.8)


def _by_themselves(
    data: Observations, derivative: int, band: FrfSet, known: Float[np.ndarray, "out in freq"] | None
) -> Float[np.ndarray, "some in freq"] | None:
    """Weights that lines have each by itself, of as many rows as stand for all; ``None`` where none were smoothed."""
    if band.effective_lines is None:
        return None
    some, effective = sample(data), band.effective_lines[-len(data.s) :]
    if known is None:
        return np.asarray(data.weights[some] / effective)
    return np.asarray(2 * np.abs(data.s) ** (2 * derivative) / (known[some] * effective))


def loss(
    data: Observations, fit: Fit, by_themselves: Float[np.ndarray, "some in freq"] | None
) -> tuple[Float[np.ndarray, "mode"], Float[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """Variance of poles, of shapes, and of poles by noise that all FRFs share, over that for errors independent from
    line to line, each mode.

    Where lines were smoothed together, they hold no more information than the lines by themselves, whose weights are
    ``by_themselves``: around peaks as narrow as the smoothing, errors follow the shape of the peak, which the mean
    correlation of the residual does not show.
    """
    lines = LineCorrelation.of(data, fit)
    of_poles, of_shapes = (lines.factor(fit.poles, power) for power in (2, 1))
    of_shared = lines.of_shared(fit.poles)
    if by_themselves is None or not len(fit.poles):
        return of_poles, of_shapes, of_shared
    some = sample(data)
    smoothed = Observations(data.s, data.signals[some], data.weights[some])
    alone, stated = (
        _variances(
            estimator.evaluate(
                one,
                fit.poles,
                fit.participation,
                fit.terms,
                (fit.shapes[some], fit.rest[some]),
                orthogonal=fit.rounding == estimator.ORTHOGONAL,
            )
        )
        for one in (replace(smoothed, weights=by_themselves), smoothed)
    )
    least = alone / np.maximum(stated, np.finfo(float).tiny)
    return np.maximum(of_poles, least[0]), np.maximum(of_shapes, least[1]), np.maximum(of_shared, least[0])


def _variances(fit: Fit) -> Float[np.ndarray, "2 mode"]:
    """Variances of each pole and of its shape, by the weights."""
    modes, half = len(fit.poles), len(fit.gradient) // 2
    of_poles = np.sum(estimator.root(fit) ** 2, axis=1)
    of_shapes = np.sum(np.diagonal(fit.local, axis1=1, axis2=2), axis=0)
    return np.stack([of_poles[:modes] + of_poles[half : half + modes], of_shapes[:modes] + of_shapes[modes:]])


def misfit_at_peaks(data: Observations, fit: Fit) -> Float[np.ndarray, "mode"]:
    """Residual energy where it moves each pole over that of all lines, at least 1: what is fitted badly is worst there.

    It is made up for what the pole and the shapes have followed of these lines.
    """
    modes, outputs = len(fit.poles), data.outputs
    found, total = np.zeros(modes), np.zeros(modes)
    near = np.abs(data.s - fit.poles[:, None]) ** -4
    size = np.abs(fit.participation) ** 2
    for rows in data.row_blocks(data.signals[0].size, _AT_ONCE):
        energy = data.weights[rows] * np.abs(estimator.residual(data, fit, rows)[:, 0]) ** 2
        shapes = np.abs(fit.shapes[rows, 0]) ** 2
        for values, result in ((data.weights[rows] * energy, found), (data.weights[rows], total)):
            result += np.einsum("oif,mf,im,om->m", values, near, size, shapes, optimize=True)
    reach = np.mean(data.weights, axis=(0, 1)) * near
    lines = np.sum(reach, axis=1) ** 2 / np.sum(reach**2, axis=1)
    left = np.maximum(1 - (1 + 1 / outputs) / lines, 0.2)
    usual = 2 * fit.cost / data.equations
    return np.asarray(np.maximum(found / (total * usual * left), 1))
