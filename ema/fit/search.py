"""Search of a residual for modes that no candidate showed."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.stats
from jaxtyping import Complex, Float

from ema.data import damping_ratios, natural_frequencies
from ema.fit import estimator, output_correlation
from ema.fit.candidates import inside
from ema.fit.estimator import Fit, Observations
from ema.fit.line_correlation import LineCorrelation
from ema.fit.narrow import TONE, caution, tones
from ema.fit.policy import POLICY, passes_for_mode
from ema.fit.trials import DAMPING, apart, around, beside, gains_at, mode_gains, over_band, peaks, residue_gains
from ema.messages import mark

MISFIT = 0.2
"""Correlation of neighbouring residuals above which the misfit, not the noise, limits what the data determine.

That of noise scatters by 1 / sqrt(2 n) for n values: of 200, 0.2 is four standard deviations. A window correlates
noise too: where the variance of the FRFs is known, the residual must exceed it as well (`refinement`).
"""

_AT_ONCE = 6
"""Modes added in one round at most: with 3 and with 12 the modes of 14 random systems stay the same."""

_WORTHWHILE = 0.1
"""Progress of a round, in units of what a mode has to gain, that is worth another one: a safeguard against rounds that
go on for less than noise makes."""
_WITHIN_REACH = 4.0
"""Loss by a pole left out, in the same units, that further steps may still make good: above it the pole is needed and
stays without more steps, below it the rest of the fit adapts before it is judged."""
_ON_THE_WAY = 2.0
"""Poles without a peak, over those that the end result may have, with which the search goes on while the residual is
noise (`MISFIT`): several at once stand for one mode until another one takes their place. With 1 it ended before that in
one of 90 random systems. Of 550 searches in other systems two went beyond 1, with correlations of the residual of -0.02
and -0.01; in a test whose resonances drift it was 0.70 there, and 0.66 after 77 poles more."""
_FAILURES = 2
"""Places where a mode seems to gain but replaces another one; after so many, the search ends. With 1 and with 4 the
modes of 14 random systems stay the same."""

OPERATIONS = 2e11
"""Operations (`estimator.Work`) that a search may take before it ends with what it has: a minute or so.

Of 240 random systems the two that took the most, with 55 and 59 modes and 4 references, took 1.13e11 and 1.15e11 (18
and 30 s). Ended at 1e11, they had 16 of 51 and 19 of 54 modes. Data that are no modal model ask for more than 1e12:
FRFs whose force is a response have a hundred poles at all orders.
"""

_OUTSIDE = np.array([0.003, 0.01, 0.02, 0.04, 0.08, 0.16])
"""Distances from the edges of the band, over its width, at which resonances outside it are tried."""
_CHANCE = 0.01
"""Probability with which noise alone passes for a resonance outside the band, or for a weak one somewhere in it. At
half and at twice the value the modes of 14 random systems stay the same; values move by up to 0.8 standard
deviations."""
_TRIED = 200
"""Trial poles in one search: the best of so many explains by chance what a single one hardly ever does (Bonferroni).
The true number depends on band and spacing; neighbours are not independent."""
_WEAK = 6
"""Weak resonances that are added in one search at most; each search (`modal._SEARCHES`) may add as many again. A bound
on the work."""
_AGAIN = 24
"""Trial poles, the best on compressed data, that are judged again with the noise of every line of every FRF: what
stands out there in a few FRFs that are small is hardly seen in the average. A bound on the work."""


def search(data: Observations, fit: Fit, band: tuple[float, float], rounds: int) -> Fit:
    """Add modes that the residual still shows, the strongest first, as long as noise and misfit cannot explain them.

    Parameters
    ----------
    data : what is fitted, with its noise.
    fit : fit to begin with.
    band : lowest and highest frequency [Hz] of a trial pole.
    rounds : modes that are added at most.

    Returns
    -------
    The fit with the modes that were added, refined; ``fit`` itself where there was none.
    """
    references, outputs = data.references, data.outputs
    freedom = 2 * outputs * references
    limit = passes_for_mode(freedom, len(data.s))
    for _ in range(rounds):
        if data.work.over:
            break
        by_reference, together = estimator.profile(data, fit)
        power = by_reference.mean(axis=0)
        correlation = together.sum() / max(power.sum(), 1e-300)
        trials = over_band(band, peaks(data, power))
        net = len(trials)
        trials = np.concatenate([trials, beside(fit, band)])
        factor = max(fit.variance_factor(data), 1e-300)
        gain, vectors = residue_gains(data, fit, trials)
        required = np.full(len(trials), limit * factor)
        typical = np.median(gain[:net].reshape(-1, len(DAMPING)), axis=0) / (factor * freedom)
        required[:net] *= np.tile(np.maximum(typical, 1), net // len(DAMPING))
        required[net:] *= max(1.0, float(typical.max()))
        # What takes a fifth of the whole residual away is no decoration of a misfit: it is a missed mode.
        required = np.minimum(required, max(0.2 * fit.cost, limit * factor))
        chosen = apart(trials, gain / required, 1)
        if not chosen:
            break
        larger = estimator.with_modes(data, fit, trials[chosen], vectors[chosen])
        larger = estimator.refine(data, larger, iterations=25)
        if fit.cost - larger.cost < required[chosen].min() or np.any(larger.poles.real >= 0):
            break
        if correlation > MISFIT and estimator.dominance(data, larger)[-1] < POLICY.visible:
            break
        fit = larger
    return fit


def complete(data: Observations, fit: Fit, band: tuple[float, float], rounds: int, *, enough: float) -> Fit:
    """Add modes as long as each lowers the cost by more than noise alone would, and take out what they replace.

    Takes the residual for noise. Gains are those of one more mode, not of a free residue matrix: with several
    references a weak mode stands out much better. With more than ``enough`` poles in the band that make no peak of
    their own the residual is no noise; with twice as many the search ends. It also ends when its work is done (`Work`).
    """
    most, tried = _AT_ONCE, np.zeros(0, complex)
    for _ in range(rounds):
        if data.work.over:
            break
        count = hidden(data, fit, band)
        if count > _ON_THE_WAY * enough or (count > enough and estimator.correlation(data, fit) > MISFIT):
            break
        noise = Noise.of(data, fit)
        trials = np.concatenate([over_band(band, peaks(data, noise.power.mean(axis=0))), around(fit, band)])
        trials = trials[np.all(np.abs(trials[:, None] - tried) > np.abs(trials.real)[:, None], axis=1)]
        gain, vectors = mode_gains(data, fit, trials)
        chosen = apart(trials, gain / noise.explains(data, trials, vectors, fit, gain), most)
        if not chosen:
            break
        larger = estimator.with_modes(data, fit, trials[chosen], vectors[chosen])
        larger = _settled(data, larger, noise.required)
        larger = prune(data, larger, noise.left_by(data, larger))
        if larger.cost + noise.required * len(larger.poles) < fit.cost + noise.required * (
            len(fit.poles) - _WORTHWHILE
        ):
            fit, most = larger, _AT_ONCE
        elif len(chosen) > 1:
            most = 1
        else:
            tried = np.append(tried, trials[chosen])
            if len(tried) > _FAILURES:
                break
    return fit


def hidden(data: Observations, fit: Fit, band: tuple[float, float]) -> int:
    """Number of poles in the band that make no peak of their own; one outside it cannot."""
    return int(np.count_nonzero(inside(fit.poles, band) & (estimator.dominance(data, fit) < POLICY.visible)))


def beyond(data: Observations, fit: Fit, band: tuple[float, float]) -> Fit:
    """Add the resonances outside the band that the residual asks for, one on each side at most.

    They belong to the background and cannot be false modes, so little is asked of them. Left out, they move heavy modes
    at the edge of the band by more than their intervals say. Takes the residual for noise.
    """
    references, outputs = data.references, data.outputs
    limit = float(scipy.stats.chi2.isf(_CHANCE, 2 * outputs + 2 * references))
    for edge, width in ((band[0], band[0] - band[1]), (band[1], band[1] - band[0])):
        places = edge + _OUTSIDE * width
        trials = (2 * np.pi * places[places > 0, None] * (-DAMPING + 1j)).reshape(-1)
        if not len(trials):
            continue
        required = limit * fit.variance_factor(data) * Noise.of(data, fit).correlation_gain_at(trials)
        gain, vectors = mode_gains(data, fit, trials)
        best = int(np.argmax(gain / required))
        if gain[best] <= required[best]:
            continue
        larger = estimator.refine(data, estimator.with_modes(data, fit, trials[[best]], vectors[[best]]), 30)
        kept = inside(larger.poles, band).sum() == inside(fit.poles, band).sum() and np.all(larger.poles.real < 0)
        if kept and fit.cost - larger.cost > required[best] and np.all(larger.share >= estimator.RANK):
            fit = larger
    return fit


def weak(
    data: Observations,
    fit: Fit,
    final: Observations,
    optimum: Fit,
    lines: LineCorrelation,
    band: tuple[float, float],
) -> tuple[Complex[np.ndarray, "new"], Complex[np.ndarray, "new in"]]:
    """Poles, and their participation, of resonances in the band that noise hardly explains, though they explain less
    than a mode has to.

    They stay in the background. Left out, they move wide modes beside them, whose intervals do not know of them. Takes
    the residual for noise.

    Parameters
    ----------
    data, fit : compressed data, and the poles of ``optimum`` fitted to them: all trial poles are compared there.
    final, optimum : every line of every FRF with its own noise: the best of them are judged there.
    lines : how that noise correlates over lines.
    """
    noise = Noise.of(data, fit)
    trials = np.concatenate([over_band(band, peaks(data, noise.power.mean(axis=0))), around(fit, band)])
    gain, vectors = mode_gains(data, fit, trials)
    merit = gain / noise.explains(data, trials, vectors, fit, gain)
    best = apart(trials, merit / max(float(merit.min()) * (1 - 1e-9), 1e-300), _AGAIN, reach=1.0)
    trials, vectors = trials[best], vectors[best]
    noise_of_one = output_correlation.limit(final, optimum, passes_for_weak) * optimum.variance_factor(final)
    required = noise_of_one * lines.factor(trials)
    gain = gains_at(final, optimum, trials, vectors)
    chosen = apart(trials, gain / (required * caution(trials, optimum.poles, final.line)), _WEAK)
    return trials[chosen], vectors[chosen]


def passes_for_weak(freedom: float) -> float:
    """Energy that noise hardly explains at the best of all trial poles (Bonferroni), for so many unknowns."""
    return float(scipy.stats.chi2.isf(_CHANCE / _TRIED, freedom))


def evidence(data: Observations, fit: Fit) -> Float[np.ndarray, "pole"]:
    """Energy that each pole explains over what a mode has to explain, for it does so somewhere in noise."""
    level = output_correlation.limit_for_mode(data, fit)
    level *= fit.variance_factor(data)
    noise = level * LineCorrelation.of_noise(data, fit).factor(fit.poles) * caution(fit.poles, fit.poles, data.line)
    return np.asarray(estimator.gains(data, fit) / np.maximum(noise, 1e-300))


@dataclass(frozen=True)
class Noise:
    """What the residual of a fit says of its noise: the energy that a mode fitted to noise takes off nowhere in the
    band but with the false-alarm probability, its mean square, and that of each bin and reference over the mean.

    ``correlation_gain`` (damping,): energy that noise leaves to a pole of each damping ratio in `DAMPING`, over that of
    noise independent from line to line, of which ``required_of_white`` would be ``required``.
    """

    required_of_white: float
    scale: float
    power: Float[np.ndarray, "in bin"]
    correlation_gain: Float[np.ndarray, "damping"]
    with_tones: Float[np.ndarray, "in bin"] | None = None

    @property
    def required(self) -> float:
        """Energy that a mode has to exceed where its damping does not matter."""
        return self.required_of_white * float(np.median(self.correlation_gain))

    @classmethod
    def of(cls, data: Observations, fit: Fit) -> "Noise":
        """The noise that the residual of ``fit`` shows."""
        limit = output_correlation.limit_for_mode(data, fit)
        power = estimator.profile(data, fit)[0]
        factor, scale = fit.variance_factor(data), max(float(power.mean()), 1e-300)
        factor = max(factor, 1e-300)
        return cls(limit * factor, scale, power / scale, _correlation_gain(data, fit, factor))

    def left_by(self, data: Observations, larger: Fit) -> "Noise":
        """The same level, and for each bin and reference what a larger fit leaves there over the mean before: what its
        new modes explain was no noise, least of all at their own places. What poles without damping explain
        (`estimator.NARROWEST`) may have been: a tone.
        """
        power = estimator.profile(data, larger)[0]
        return replace(self, power=power / self.scale, with_tones=self.power)

    def correlation_gain_at(self, poles: Complex[np.ndarray, "pole"]) -> Float[np.ndarray, "pole"]:
        """``correlation_gain`` at the damping ratios of poles."""
        damping = np.log(np.maximum(damping_ratios(poles), 1e-6))
        return np.asarray(np.exp(np.interp(damping, np.log(DAMPING), np.log(self.correlation_gain))))

    def explains(
        self,
        data: Observations,
        poles: Complex[np.ndarray, "pole"],
        vectors: Complex[np.ndarray, "pole in"],
        fit: Fit,
        gain: Float[np.ndarray, "pole"] | None = None,
    ) -> Float[np.ndarray, "pole"]:
        """Energy that a mode has to exceed at each pole: noise that grows with the FRF is largest at its peaks, and
        there in the references with the largest ones, which a participation vector can single out.

        The ``gain`` of modes that the residual still holds is no noise.
        """
        line = data.line
        width = np.maximum(np.abs(poles.real), 3 * line)
        shares = np.abs(vectors) ** 2 * np.mean(data.weights, axis=(0, 2))
        shares /= np.maximum(shares.sum(axis=1, keepdims=True), 1e-300)
        level = np.empty(len(poles))
        for first in range(0, len(poles), 128):
            rows = slice(first, first + 128)
            distance = (data.s.imag[None, :] - poles.imag[rows, None]) ** 2
            near = 1 / (distance + width[rows, None] ** 2)
            level[rows] = np.einsum("pi,pi->p", near @ self.power.T, shares[rows])
            if self.with_tones is not None:
                narrow = -poles.real[rows] <= (1 + 1e-6) * data.narrowest_decay
                level[rows][narrow] = np.einsum("pi,pi->p", near[narrow] @ self.with_tones.T, shares[rows][narrow])
            if gain is not None:
                own = 1 / (distance + np.maximum(poles.real[rows, None] ** 2, 0.01 * line**2))
                held = np.einsum("pk,pk->p", own, near) / own.sum(axis=1) * np.sum(shares[rows] ** 2, axis=1)
                level[rows] -= held * gain[rows] / (2 * data.outputs * self.scale)
            level[rows] /= near.sum(axis=1)
        level = np.maximum(level, 1) * self.correlation_gain_at(poles)
        return np.asarray(self.required_of_white * level * caution(poles, fit.poles, line))


def _correlation_gain(data: Observations, fit: Fit, factor: float) -> Float[np.ndarray, "damping"]:
    """Median over the band of what trial poles of each damping ratio take off the cost, over what white noise gives."""
    if not data.correlated:
        return np.ones(len(DAMPING))
    trials = over_band((float(data.s[0].imag) / (2 * np.pi), float(data.s[-1].imag) / (2 * np.pi)))
    gain = residue_gains(data, fit, trials)[0].reshape(-1, len(DAMPING))
    return np.asarray(np.maximum(np.median(gain, axis=0) / (factor * 2 * data.outputs * data.references), 1))


def _settled(data: Observations, fit: Fit, required: float) -> Fit:
    """Refined until further steps gain next to nothing of what a mode does."""
    for _ in range(6):
        refined = estimator.refine(data, fit, iterations=5)
        gained, fit = fit.cost - refined.cost, refined
        if gained < 0.1 * _WORTHWHILE * required:
            break
    return fit


def prune(
    data: Observations,
    fit: Fit,
    noise: Noise,
    dropped: list[tuple[complex, str]] | None = None,
    thorough: bool = False,
) -> Fit:
    """Take out, the weakest first, the poles that noise explains once the others have adapted.

    ``thorough`` also tries neighbours whose places noise leaves uncertain as one; only where the residual is noise.
    """
    while len(fit.poles) and not data.work.over:
        gain = estimator.gains(data, fit)
        needed = noise.explains(data, fit.poles, fit.participation.T, fit)
        reasons = {
            int(k): f"it explains {gain[k] / needed[k]:.2g} times what noise would"
            for k in np.flatnonzero(gain <= needed)
        }
        if not reasons and dropped is not None:
            narrow = np.flatnonzero(-2 * fit.poles.real <= data.line)
            reasons = dict.fromkeys(tones(data, fit, narrow), TONE)
        weakest = sorted(reasons, key=lambda k: gain[k] / needed[k])[: (len(reasons) + 2) // 3]
        if weakest:
            smaller = _without(data, fit, weakest, 3)
        else:
            pairs = [*overlapping(fit), *(confused(data, fit) if thorough else [])]
            weakest, smaller = _merged(data, fit, gain, noise.required, pairs, thorough)
            reasons = dict.fromkeys(weakest, mark("together with a neighbour it explains no more than one mode does"))
        if not weakest:
            break
        if dropped is not None:
            dropped += [(complex(fit.poles[k]), reasons[k]) for k in weakest]
        fit = smaller
    return fit


def _without(data: Observations, fit: Fit, gone: list[int], iterations: int) -> Fit:
    keep = np.ones(len(fit.poles), bool)
    keep[gone] = False
    return estimator.refine(data, estimator.drop(data, fit, keep), iterations)


def _merged(
    data: Observations,
    fit: Fit,
    gain: Float[np.ndarray, "pole"],
    required: float,
    pairs: list[tuple[int, int]],
    thorough: bool,
) -> tuple[list[int], Fit]:
    """The fit without the weaker of two poles, where one mode does as well as the two.

    ``thorough`` tries without the stronger one too, and lets what stays settle where little is lost.
    """
    tried: set[int] = set()
    for a, b in dict.fromkeys(pairs):
        members = sorted((a, b), key=lambda k: gain[k])[: 2 if thorough else 1]
        for gone in [k for k in members if k not in tried]:
            if data.work.over:
                return [], fit
            tried.add(gone)
            smaller = _without(data, fit, [gone], 10)
            if thorough and required < smaller.cost - fit.cost < _WITHIN_REACH * required:
                smaller = _settled(data, smaller, required)
            if smaller.cost - fit.cost <= required:
                return [gone], smaller
    return [], fit


def confused(data: Observations, fit: Fit) -> list[tuple[int, int]]:
    """Neighbours within one bandwidth of each other whose place noise leaves uncertain by a fifth of their distance."""
    covariance = estimator.covariance(fit, fit.variance_factor(data))
    uncertain = 2 * np.pi * np.sqrt(np.maximum(covariance[:, 0, 0], 0))
    distance = np.abs(fit.poles[:, None] - fit.poles[None, :])
    near = distance < np.abs(fit.poles.real)[:, None] + np.abs(fit.poles.real)[None, :]
    doubtful = 5 * np.maximum(uncertain[:, None], uncertain[None, :]) > distance
    first, second = np.nonzero(np.triu(near & doubtful, 1))
    return list(zip(first.tolist(), second.tolist(), strict=True))


def overlapping(fit: Fit) -> list[tuple[int, int]]:
    """Pairs of poles within one bandwidth of each other with the same shape and participation."""
    distance = np.abs(fit.poles[:, None] - fit.poles[None, :])
    near = distance < np.abs(fit.poles.real)[:, None] + np.abs(fit.poles.real)[None, :]
    alike = (macs(fit.psi) > 0.9) & (macs(fit.participation.T) > 0.9)
    first, second = np.nonzero(np.triu(near & alike, 1))
    return list(zip(first.tolist(), second.tolist(), strict=True))


def macs(vectors: Complex[np.ndarray, "mode entry"]) -> Float[np.ndarray, "mode mode"]:
    """MAC of every vector with every other one."""
    norm = np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)
    result: np.ndarray = np.abs((vectors.conj() @ vectors.T) / np.outer(norm, norm)) ** 2
    return result


def misfit(
    data: Observations, fit: Fit, band: tuple[float, float], factor: float, correlation: float
) -> Float[np.ndarray, "pole"]:
    """How much more than white noise the residual yields to a pole of this damping in this part of the band.

    Windows, drifting frequencies and nonlinearity leave residuals that are smooth over lines, which further poles can
    always follow. Trial poles tell how far: the median of their gains over a third of the band, in units of white
    noise; 1 where the model holds.
    """
    if correlation < 0.25 * MISFIT:
        return np.ones(len(fit.poles))
    references, outputs = data.references, data.outputs
    trials = over_band(band)
    gain, _ = residue_gains(data, fit, trials)
    ratio = np.maximum(gain.reshape(-1, len(DAMPING)) / (factor * 2 * outputs * references), 1)
    places = natural_frequencies(trials).reshape(ratio.shape)[:, 0]
    frequency, damping = natural_frequencies(fit.poles), damping_ratios(fit.poles)
    result = np.empty(len(fit.poles))
    for k in range(len(fit.poles)):
        near = np.abs(places - frequency[k]) <= max((band[1] - band[0]) / 6, np.sort(np.abs(places - frequency[k]))[4])
        level = np.log(np.median(ratio[near], axis=0))
        result[k] = np.exp(np.interp(np.log(max(damping[k], 1e-6)), np.log(DAMPING), level))
    return result
