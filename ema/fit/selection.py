"""Which poles the FRFs ask for, found and refined on compressed data.

Poles that persist over the model orders are refined together by maximum likelihood. Where the residual is larger than
the noise, narrower bands are searched. A pole stays when leaving it out costs more than noise, or the misfit of its
neighbourhood, could explain, and when it is not the second half of a peak that one mode already explains. Which of the
poles are accepted as modes is decided afterwards, on the final values (`ema.fit.acceptance`).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from ema.data import PoleTable, damping_ratios, natural_frequencies
from ema.fit import estimator, output_correlation
from ema.fit.candidates import Candidates, inside, like_modes, of_single_lines, of_table, zoom
from ema.fit.estimator import Fit, Observations, Work
from ema.fit.line_correlation import LineCorrelation
from ema.fit.narrow import TONE, tones
from ema.fit.noise import NoiseLevel
from ema.fit.overlap import another_mode
from ema.fit.policy import POLICY
from ema.fit.prepare import Prepared
from ema.fit.search import MISFIT, OPERATIONS, Noise, beyond, complete, hidden, misfit, prune, search
from ema.messages import mark

_ROUNDS = 100
"""Poles that are taken out one after the other at most: a bound on the work."""
_SPREAD = 2.0
"""Factor by which a misfit may raise or lower the noise of a bin: only where the residual is a misfit (`MISFIT`). At 1
and at 4 the modes of 14 random systems stay the same."""
_TELLING = 6
"""Outputs from which on equal shapes say that two poles are one mode: of two random real shapes over six, 0.1 % have
the MAC of 0.9 that is asked for, over three, 5 % (beta distribution)."""
_LINES = 2.0
"""Half-power bandwidth in frequency lines below which a mode has to show as a peak: narrower poles that make none are
taken out, wider ones may be part of a peak of others."""
_DISPLACED = 0.2
"""Displacement over the decay rate below which nobody asks whether another mode is the cause: it saves time, for the
answer would lower the probability that the mode is alone by a fifth at most."""
_CORRELATED = 0.1
"""Correlation of neighbouring lines from which on they are not taken as independent: half of what is a misfit."""
BEYOND = 3.0
"""Energy of the residual over that of the known noise from which on the noise is not what limits the fit: below these 5
dB, noise explains a residual that correlates over lines, above it the fit misses something."""
_COLLINEAR = 0.6
"""Modal phase collinearity (Pappa, Elliott and Schenk 1993) below which the shape of a mode without a peak of its own
speaks against it: 1 for a shape in phase. It is asked only where the residual is a misfit."""


@dataclass(frozen=True)
class Dropped:
    """A candidate that was not taken, and why; ``beside``: within the bandwidth of a pole that stayed."""

    pole: complex
    reason: str
    beside: bool = False


@dataclass(frozen=True)
class Selection:
    """Poles of the band and of its surroundings, refined together on compressed data.

    ``starts`` are the bins of ``data``; ``possible`` (pole,) marks those that can be modes (in the band, oscillating);
    ``alone`` (pole,) is the probability that no other mode hides under each; ``trusted`` says that the residual is
    noise; ``dropped`` are poles that are not in the fit any more; ``stopped`` says that the search took more than it
    may (`search.OPERATIONS`) and was ended.
    """

    fit: Fit
    data: Observations
    noise: NoiseLevel
    starts: Int[np.ndarray, "bin"]
    possible: Bool[np.ndarray, "pole"]
    alone: Float[np.ndarray, "pole"]
    trusted: bool
    dropped: tuple[Dropped, ...] = ()
    stopped: bool = False


def select(
    prepared: Prepared,
    table: PoleTable,
    added_decay: float = 0.0,
    known: Float[np.ndarray, "out in freq"] | None = None,
) -> Selection:
    """Find the poles that the FRFs ask for, and take out what noise or misfit explains.

    ``added_decay`` is what an exponential window did to the data; the table is already free of it. ``known`` is the
    variance of the FRFs where noise correlates over lines and its size is known: noise of that size is no misfit.
    """
    band = table.band
    everything = of_table(table, added_decay)
    chosen = everything.keep(everything.persistence >= min(POLICY.persistence, everything.persistence.max(initial=0)))
    # Bins average over tones that the search would have to see, and their flanks are no noise.
    chosen = chosen.joined(of_single_lines(prepared, band, chosen.poles))
    work = Work()
    work.allow(OPERATIONS)
    state = _observe(prepared, chosen, work)
    for share in (6, 20):
        found = zoom(prepared, state.data, state.fit, share)
        larger = Candidates(state.fit.poles, state.fit.participation, np.ones(len(state.fit.poles))).joined(found)
        if len(larger.poles) == len(state.fit.poles):
            break
        everything = everything.joined(found)
        state = _observe(prepared, larger, work)
    dropped: list[Dropped] = []
    state = state.with_correlated(_correlated_noise(prepared, state, known))
    result = _trusting(prepared, state, band, dropped)
    if result is not None and state.data.correlated and not _correlated_noise(prepared, result, known):
        # What correlated were modes that were not in the fit yet.
        dropped, state = [], state.with_correlated(False)
        result = _trusting(prepared, state, band, dropped)
    trusted, stopped = result is not None, work.over
    if result is None:
        dropped = []
        result = _doubting(state.with_correlated(False), everything, band, dropped)
    # The search is over; what follows has few poles.
    work.allow(np.inf)
    fit = result.fit
    possible = like_modes(fit.poles, band)
    alone = _alone(result.data, fit, band, possible) if trusted else np.ones(len(fit.poles))
    lost = _lost(dropped, fit, trusted=trusted)
    return Selection(
        fit=fit,
        data=result.data,
        noise=result.noise,
        starts=result.starts,
        possible=possible,
        alone=alone,
        trusted=trusted,
        dropped=lost,
        stopped=stopped,
    )


def _lost(dropped: list[Dropped], fit: Fit, *, trusted: bool) -> tuple[Dropped, ...]:
    """What was left out and is not in the fit. Beside a pole that stayed, a residual of noise says that this one stands
    for both; in a misfit it may have been a second mode, and the last one that was left out there is kept.
    """
    lost: list[Dropped] = []
    for one in reversed(dropped):
        beside = _near(one, fit.poles)
        if not beside.any():
            lost.append(one)
        elif not trusted and not any(other.beside and np.any(_near(other, fit.poles) & beside) for other in lost):
            lost.append(replace(one, beside=True))
    return tuple(reversed(lost))


def _near(one: Dropped, poles: Complex[np.ndarray, "pole"]) -> Bool[np.ndarray, "pole"]:
    """Poles within the bandwidth of one that was left out."""
    return np.asarray(np.abs(poles - one.pole) <= np.abs(poles.real) + abs(one.pole.real))


def _correlated_noise(prepared: Prepared, state: "_State", known: Float[np.ndarray, "out in freq"] | None) -> bool:
    """Whether the residual of all lines correlates and has the size of the known noise, both but for a few places."""
    fit = state.fit
    if known is None or estimator.correlation(replace(state.data, correlated=False), fit) <= _CORRELATED:
        return False
    data = estimator.observe(prepared.frequencies, prepared.values, prepared.derivative, prepared.noise, rotate=False)
    terms = estimator.residual_terms(data, estimator.fixed_poles(prepared.frequencies))
    at_lines = estimator.evaluate(data, fit.poles, fit.participation, terms)
    rho = LineCorrelation.of_noise(data, at_lines).rho
    outputs = prepared.noise.outputs[:, None, None]
    size = np.abs(estimator.residual(data, at_lines)[0] * outputs * np.abs(data.s) ** prepared.derivative)
    # The median of an exponential distribution is log 2 of its mean: missing modes change it little.
    return bool(np.max(rho[1:], initial=0.0) > _CORRELATED and np.median(size**2 / known) <= BEYOND * np.log(2))


def extended(
    prepared: Prepared,
    chosen: Selection,
    kept: Int[np.ndarray, "kept"],
    band: tuple[float, float],
    poles: Complex[np.ndarray, "new"],
    vectors: Complex[np.ndarray, "new in"],
) -> Selection:
    """The selection's poles ``kept`` with further ones and their participation, in bins that are fine enough for these;
    without those that are tones.
    """
    start = estimator.drop(chosen.data, chosen.fit, np.isin(np.arange(len(chosen.fit.poles)), kept))
    state = _State(chosen.data, chosen.noise, chosen.starts, start)
    state = _rebinned(prepared, state, estimator.with_modes(chosen.data, start, poles, vectors))
    fit = estimator.refine(state.data, state.fit)
    keep, dropped = np.ones(len(fit.poles), bool), chosen.dropped
    keep[tones(state.data, fit, np.flatnonzero(-2 * fit.poles.real <= state.data.line))] = False
    if not keep.all():
        dropped += tuple(Dropped(complex(pole), TONE) for pole in fit.poles[~keep])
        fit = estimator.refine(state.data, estimator.drop(state.data, fit, keep))
    fit, _ = estimator.determined(state.data, fit)
    possible = like_modes(fit.poles, band)
    alone = _alone(state.data, fit, band, possible) if chosen.trusted else np.ones(len(fit.poles))
    return Selection(
        fit=fit,
        data=state.data,
        noise=state.noise,
        starts=state.starts,
        possible=possible,
        alone=alone,
        trusted=chosen.trusted,
        dropped=dropped,
    )


def compressed(chosen: Selection, optimum: Fit) -> Fit:
    """The poles of an optimum fitted to the compressed data of a selection."""
    return estimator.evaluate(chosen.data, optimum.poles, optimum.participation, chosen.fit.terms)


def of_poles(chosen: Selection, kept: Int[np.ndarray, "kept"], optimum: Fit, band: tuple[float, float]) -> Selection:
    """The selection with the poles of an optimum: those ``kept``, and further ones behind them."""
    added = np.ones(len(optimum.poles) - len(kept))
    return replace(
        chosen,
        fit=compressed(chosen, optimum),
        possible=like_modes(optimum.poles, band),
        alone=np.concatenate([chosen.alone[kept], added]),
    )


def reduced(chosen: Selection, gone: Int[np.ndarray, "gone"], reason: str) -> Selection:
    """The selection without some of its poles; the others adapt."""
    keep = np.ones(len(chosen.fit.poles), bool)
    keep[gone] = False
    fit = estimator.refine(chosen.data, estimator.drop(chosen.data, chosen.fit, keep))
    dropped = tuple(Dropped(complex(chosen.fit.poles[pole]), reason) for pole in gone)
    return replace(
        chosen,
        fit=fit,
        possible=chosen.possible[keep],
        alone=chosen.alone[keep],
        dropped=(*chosen.dropped, *dropped),
    )


def _trusting(
    prepared: Prepared, state: "_State", band: tuple[float, float], dropped: list[Dropped]
) -> "_State | None":
    """Take whatever noise cannot explain. ``None`` when that does not end in a residual that is noise."""
    state = _reweight(state, 3)
    gone: list[tuple[complex, str]] = []
    state = state.with_fit(prune(state.data, state.fit, Noise.of(state.data, state.fit), gone))
    before = len(state.fit.poles)
    # A misfit can be decorated with poles until it looks like noise; then most of them come from the search.
    enough = hidden(state.data, state.fit, band) + max(3, 0.5 * before)
    state = _grown(prepared, state, band, enough)
    if hidden(state.data, state.fit, band) > enough or estimator.correlation(state.data, state.fit) > MISFIT:
        return None
    grown = len(state.fit.poles) != before
    state = _reweight(state, 12)
    if grown:
        state = _grown(prepared, state, band, enough)
    thorough = estimator.correlation(state.data, state.fit) <= 0.5 * MISFIT
    final = prune(state.data, state.fit, Noise.of(state.data, state.fit), gone, thorough)
    state = state.with_fit(estimator.refine(state.data, final))
    dropped += [
        Dropped(pole, why)
        for pole, why in gone
        if inside(np.array([pole]), band)[0] and damping_ratios(np.array([pole]))[0] <= POLICY.heaviest
    ]
    correlated = estimator.correlation(state.data, state.fit) > 0.5 * MISFIT
    if hidden(state.data, state.fit, band) > enough or correlated or state.data.work.over:
        return None
    return state.with_fit(beyond(state.data, estimator.determined(state.data, state.fit)[0], band))


def _grown(prepared: Prepared, state: "_State", band: tuple[float, float], enough: float) -> "_State":
    """Modes added that the residual shows; the bins are made anew where these need finer ones."""
    fit = complete(state.data, state.fit, band, rounds=8 + len(state.fit.poles) // 4, enough=enough)
    if len(fit.poles) == len(state.fit.poles) or hidden(state.data, fit, band) > enough:
        return state.with_fit(fit)
    return _rebinned(prepared, state, fit)


def _rebinned(prepared: Prepared, state: "_State", fit: Fit) -> "_State":
    """A fit on bins made for its poles; each line has the noise of its bin."""
    noise = np.repeat(state.noise.lines, np.diff(np.append(state.starts, len(prepared.frequencies))))
    prepared = replace(prepared, noise=replace(prepared.noise, lines=noise))
    candidates = Candidates(fit.poles, fit.participation, np.ones(len(fit.poles)))
    return _observe(prepared, candidates, state.data.work).with_correlated(state.data.correlated)


def _doubting(state: "_State", candidates: Candidates, band: tuple[float, float], dropped: list[Dropped]) -> "_State":
    """Take what stands out of a misfit: peaks of their own, or poles that the model orders agree on."""
    state.data.work.allow(OPERATIONS / 2)
    weighted = _reweight(state, 3)
    weighted = weighted.with_fit(_eliminate(weighted.data, weighted.fit, candidates, band, dropped))
    if inside(weighted.fit.poles, band).any():
        weighted = weighted.with_fit(search(weighted.data, weighted.fit, band, rounds=12))
    else:
        # No model order shows a mode: noise that grows with the FRF itself does that. Search before weights hide it.
        outside = estimator.drop(state.data, state.fit, ~inside(state.fit.poles, band))
        weighted = _reweight(state.with_fit(search(state.data, outside, band, rounds=12)), 3)
        weighted = weighted.with_fit(_eliminate(weighted.data, weighted.fit, candidates, band, dropped))
    weighted = _reweight(weighted, 12)
    final = _eliminate(weighted.data, weighted.fit, candidates, band, dropped)
    return weighted.with_fit(estimator.determined(weighted.data, final)[0])


@dataclass(frozen=True)
class _State:
    """Data in bins, their noise, and the fit so far."""

    data: Observations
    noise: NoiseLevel
    starts: Int[np.ndarray, "bin"]
    fit: Fit

    def with_fit(self, fit: Fit) -> "_State":
        return replace(self, fit=fit)

    def with_correlated(self, correlated: bool) -> "_State":
        """The same where noise correlates over lines, or where what correlates is a misfit."""
        return replace(self, data=replace(self.data, correlated=correlated))


def _observe(prepared: Prepared, candidates: Candidates, work: Work) -> _State:
    """Weighted data in bins that are fine where the candidates are, and a first, rough refinement of these."""
    starts = estimator.bins(prepared.frequencies, candidates.poles)
    middle = (starts + np.append(starts[1:], len(prepared.frequencies)) - 1) // 2
    noise = replace(prepared.noise, lines=prepared.noise.lines[middle])
    data = estimator.observe(prepared.frequencies, prepared.values, prepared.derivative, noise, starts)
    data = replace(data, work=work)
    terms = estimator.residual_terms(data, estimator.fixed_poles(prepared.frequencies))
    fit = estimator.evaluate(data, candidates.poles, candidates.participation, terms)
    fit = estimator.refine(data, fit, iterations=4)
    data = estimator.centred(data, fit)
    return _State(data, noise, starts, estimator.refine(data, _again(data, fit), iterations=2))


def _reweight(state: _State, iterations: int) -> _State:
    """Take the noise of each bin from the residual and refine again; with few FRFs, from its neighbours too.

    A residual that is correlated over lines is misfit: it may shape the weights within narrow limits only, or a peak
    that is fitted badly would lose the weight that it takes to fit it well.
    """
    data = state.data
    by_reference, together = estimator.profile(data, state.fit)
    power = by_reference.mean(axis=0)
    correlation = 0.0 if data.correlated else together.sum() / max(power.sum(), 1e-300)
    window = int(np.clip(150 // (data.outputs * data.references), 1, min(9, len(power)))) | 1
    power = np.convolve(np.pad(power, window // 2, mode="edge"), np.ones(window) / window, mode="valid")[: len(power)]
    power = np.maximum(power, 0.05 * np.median(power) + 1e-300)
    if correlation > MISFIT:
        power = np.clip(power, np.median(power) / _SPREAD**2, np.median(power) * _SPREAD**2)
    data = estimator.centred(data.reweighted(1 / power), state.fit)
    noise = replace(state.noise, lines=state.noise.lines * np.sqrt(power))
    return _State(data, noise, state.starts, estimator.refine(data, _again(data, state.fit), iterations))


def _again(data: Observations, fit: Fit) -> Fit:
    """The fit on other data: its linear unknowns adapt."""
    again = estimator.evaluate(data, fit.poles, fit.participation, fit.terms, (fit.shapes, fit.rest))
    return estimator.determined(data, again)[0]


def _threshold(data: Observations, fit: Fit) -> float:
    """Energy that a mode fitted to noise alone exceeds, anywhere in the band, with the false-alarm probability."""
    return output_correlation.limit_for_mode(data, fit)


def _eliminate(
    data: Observations,
    fit: Fit,
    candidates: Candidates,
    band: tuple[float, float],
    dropped: list[Dropped],
) -> Fit:
    """Take out, one after the other, what noise or misfit explains and what repeats a neighbour."""
    limit = _threshold(data, fit)
    for _ in range(_ROUNDS):
        if not len(fit.poles):
            break
        factor = max(fit.variance_factor(data), 1e-300)
        correlation = estimator.correlation(data, fit)
        gain = estimator.gains(data, fit) / factor
        required = limit * misfit(data, fit, band, factor, correlation)
        reasons = {
            int(k): f"it explains {gain[k] / required[k]:.2g} times what noise and misfit would"
            for k in np.flatnonzero(gain <= required)
        }
        reasons |= dict.fromkeys(_spurs(data, fit, band), TONE)
        # Leaving one out can make another one needed, so the weaker ones go first.
        weakest = sorted(reasons, key=lambda k: gain[k] / required[k])[: (len(reasons) + 2) // 3]
        reasons = {k: reasons[k] for k in weakest}
        if data.work.over:
            # What makes no peak of its own is the first to go when there is no time to ask each.
            invisible = np.flatnonzero(estimator.dominance(data, fit) < POLICY.visible).tolist()
            reasons |= dict.fromkeys(invisible, mark("it makes no peak of its own, and the search was ended"))
        if not reasons and correlation > MISFIT:
            doubtful = (_persistence(fit, candidates) < POLICY.persistence) | (_collinearity(fit) < _COLLINEAR)
            doubtful |= _echoes(fit, gain)
            hidden = doubtful & (estimator.dominance(data, fit) < POLICY.visible)
            lowest = np.argsort(np.where(hidden, gain, np.inf))[: (np.count_nonzero(hidden) + 2) // 3]
            reasons = dict.fromkeys(
                map(int, lowest),
                "it makes no peak of its own, and few orders show it or its shape is complex or a neighbour's",
            )
        if not reasons:
            twin = _twin(fit, gain)
            if twin is None:
                break
            reasons = {twin: mark("it repeats a neighbour within its bandwidth")}
        keep = np.ones(len(fit.poles), bool)
        keep[list(reasons)] = False
        for k, why in reasons.items():
            if inside(fit.poles[[k]], band)[0] and damping_ratios(fit.poles[[k]])[0] <= POLICY.heaviest:
                dropped.append(Dropped(complex(fit.poles[k]), why))
        fit = estimator.refine(data, estimator.drop(data, fit, keep), iterations=3)
    return fit


def _spurs(data: Observations, fit: Fit, band: tuple[float, float]) -> list[int]:
    """Tones, and narrow poles that sit on somebody else's peak, where noise is largest."""
    floor = data.narrowest_decay
    found = []
    narrow = inside(fit.poles, band) & (-fit.poles.real <= _LINES * floor / estimator.NARROWEST)
    if narrow.any():
        found = [int(k) for k in np.flatnonzero(narrow & (estimator.dominance(data, fit) < POLICY.visible))]
    narrowest = np.flatnonzero(inside(fit.poles, band) & (-fit.poles.real <= 1.05 * floor))
    return [*found, *tones(data, fit, np.setdiff1d(narrowest, found))]


def _collinearity(fit: Fit) -> Float[np.ndarray, "pole"]:
    """Modal phase collinearity of each shape (Pappa et al. 1993)."""
    x, y = fit.psi.real, fit.psi.imag
    real, cross, imaginary = (np.sum(a * b, axis=1) for a, b in ((x, x), (x, y), (y, y)))
    total = np.maximum(real + imaginary, 1e-300)
    return np.asarray(1 - 4 * (real * imaginary - cross**2) / total**2)


def _echoes(fit: Fit, gain: Float[np.ndarray, "pole"]) -> Bool[np.ndarray, "pole"]:
    """Poles with the shape and the participation of a stronger one within a tenth of the frequency."""
    count, psi = len(fit.poles), fit.psi
    result = np.zeros(count, bool)
    if psi.shape[1] < _TELLING:
        return result
    for a in range(count):
        near = np.abs(fit.poles.imag - fit.poles[a].imag) < 0.1 * abs(fit.poles[a])
        for b in np.flatnonzero(near & (gain > gain[a])):
            alike = _mac(fit.participation[:, a], fit.participation[:, b]) > 0.9
            result[a] |= alike and _mac(psi[a], psi[b]) > 0.9
    return result


def _persistence(fit: Fit, candidates: Candidates) -> Float[np.ndarray, "pole"]:
    """Share of the model orders that show each pole; a cluster of candidates speaks for the nearest pole only."""
    if not len(candidates.poles) or not len(fit.poles):
        return np.zeros(len(fit.poles))
    reach = np.maximum(np.abs(fit.poles.real)[:, None], np.abs(candidates.poles.real)[None, :])
    distance = np.abs(fit.poles[:, None] - candidates.poles[None, :]) / reach
    nearest = np.argmin(distance, axis=0)
    speaks = (distance < 1) & (nearest[None, :] == np.arange(len(fit.poles))[:, None])
    return np.asarray(np.where(speaks, candidates.persistence[None, :], 0).max(axis=1))


def _twin(fit: Fit, gain: Float[np.ndarray, "mode"]) -> int | None:
    """The weaker of two poles that one mode explains.

    Within one bandwidth of each other, their shapes and participation are the same; or they share the participation
    and lie within a small part of the bandwidth and 0.15 % of the frequency: a resonance that moved from one record to
    the next leaves such a pair, with arbitrary shapes.
    """
    count = len(fit.poles)
    psi = fit.psi
    for a in range(count):
        reach = np.abs(fit.poles.real) + abs(fit.poles[a].real)
        distance = np.abs(fit.poles - fit.poles[a])
        for b in np.flatnonzero(distance < reach):
            if b <= a or _mac(fit.participation[:, a], fit.participation[:, b]) < 0.9:
                continue
            apart = abs(fit.poles[b].imag - fit.poles[a].imag)
            moved = apart < 0.3 * reach[b] and apart < 0.0015 * abs(fit.poles[a])
            if moved or _mac(psi[a], psi[b]) > 0.9:
                return int(a if gain[a] < gain[b] else b)
    return None


def _mac(a: Complex[np.ndarray, "dof"], b: Complex[np.ndarray, "dof"]) -> float:
    scale = float(np.vdot(a, a).real * np.vdot(b, b).real)
    return abs(np.vdot(a, b)) ** 2 / scale if scale > 0 else 0.0


def _alone(
    data: Observations, fit: Fit, band: tuple[float, float], possible: Bool[np.ndarray, "pole"]
) -> Float[np.ndarray, "pole"]:
    """Probability that no other mode, hidden under each of some modes, displaces it by its decay rate.

    The energy that a mode may explain without being noticed displaces a pole by as many standard deviations as its root
    says: with few FRFs, much noise or much overlap this is far.
    """
    factor = fit.variance_factor(data)
    covariance = estimator.covariance(fit, factor)
    frequency, damping = np.sqrt(covariance[:, 0, 0]), np.sqrt(covariance[:, 1, 1])
    unnoticed = np.sqrt(_threshold(data, fit) - 2 * data.outputs)
    ratio = np.maximum(damping_ratios(fit.poles), 1e-300)
    displaced = np.minimum(unnoticed * np.hypot(frequency / natural_frequencies(fit.poles), damping) / ratio, 1)
    # Narrower than a few lines, a mode overlaps with nothing.
    wide = -fit.poles.real > _LINES / estimator.NARROWEST * data.narrowest_decay
    places = np.flatnonzero(possible & wide & (displaced > _DISPLACED))
    result = np.ones(len(fit.poles))
    result[places] -= another_mode(data, fit, factor, band, places) * displaced[places]
    return result
