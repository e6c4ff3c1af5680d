"""Automatic selection of modes: told nothing, it says what it keeps, how sure it is, and why it drops the rest.

Poles that persist over the model orders are refined together by maximum likelihood. Where the residual is larger than
the noise, narrower bands are searched. A mode stays when leaving it out costs more than noise, or the misfit of its
neighbourhood, could explain, when its own uncertainty is small against its damping and against the distance to its
neighbours, when it is not the second half of a peak that one mode already explains, and when it is not itself likely to
be several modes that overlap.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.special
from jaxtyping import Bool, Complex, Float, Int

from ema.data import PoleTable, damping_ratios, natural_frequencies
from ema.fit import likelihood
from ema.fit.candidates import HEAVIEST, Candidates, inside, of_table, zoom
from ema.fit.certainty import shape_scatter
from ema.fit.likelihood import ModalFit, Observations
from ema.fit.noise import NoiseLevel
from ema.fit.overlap import another_mode
from ema.fit.prepare import Prepared
from ema.fit.search import MISFIT, VISIBLE, Noise, beyond, complete, misfit, passes_for_mode, prune, search

_PERSISTENCE = 0.3
_ROUNDS = 100
_SPREAD = 2.0
"""Factor by which a misfit may raise or lower the noise of a bin."""
_TELLING = 6
"""Outputs from which on equal shapes say that two poles are one mode."""
_LINES = 2.0
"""Half-power bandwidth in frequency lines below which a mode has to show as a peak."""
_DAMPING = 0.12
"""Relative standard deviation of the damping ratio beyond which a mode without a peak of its own is not told."""
_SCATTER = 0.25
"""Variance of a shape over its energy beyond which a MAC of 0.8 with the true one is not expected."""
_SHAPE_FREEDOM = 6
"""Degrees of freedom of that variance."""
_LIKELY = 0.75
"""Confidence below which a mode is not reported where noise is all there is to doubt."""
_SINGLE = 0.5
"""Probability below which a mode may as well be several that overlap, and is not reported."""
_DISPLACED = 0.2
"""Displacement over the decay rate below which nobody asks whether another mode is the cause."""
_COINCIDENT = 0.03
"""Distance of two poles over their decay rate below which they are a repeated root."""
_COLLINEAR = 0.6
"""Modal phase collinearity below which the shape of a mode without a peak of its own speaks against it."""


@dataclass(frozen=True)
class Dropped:
    """A candidate that was not taken, and why."""

    pole: complex
    reason: str


@dataclass(frozen=True)
class Selection:
    """Refined poles: ``is_mode`` marks the modes, the others are background that stays in the fit.

    ``starts`` are the bins of ``data``; ``factor`` is the residual energy over that of the assumed noise; modes that a
    user ``named`` are never dropped.
    """

    fit: ModalFit
    data: Observations
    noise: NoiseLevel
    starts: Int[np.ndarray, "bin"]
    is_mode: Bool[np.ndarray, "pole"]
    confidence: Float[np.ndarray, "pole"]
    factor: float
    dropped: tuple[Dropped, ...] = ()
    named: bool = False


def select(prepared: Prepared, table: PoleTable, added_decay: float = 0.0) -> Selection:
    """Choose the modes of a pole table.

    ``added_decay`` is what an exponential window did to the data; the table is already free of it.
    """
    band = table.band
    everything = of_table(table, added_decay)
    chosen = everything.keep(everything.persistence >= min(_PERSISTENCE, everything.persistence.max(initial=0)))
    state = _observe(prepared, chosen)
    for share in (6, 20):
        found = zoom(prepared, state.data, state.fit, share)
        larger = Candidates(state.fit.poles, state.fit.participation, np.ones(len(state.fit.poles))).joined(found)
        if len(larger.poles) == len(state.fit.poles):
            break
        everything = everything.joined(found)
        state = _observe(prepared, larger)
    dropped: list[Dropped] = []
    result = _trusting(prepared, state, band, dropped)
    trusting = result is not None
    if result is None:
        dropped = []
        result = _doubting(state, everything, band, dropped)
    fit = result.fit
    factor = likelihood.variance_factor(result.data, fit)
    is_mode = inside(fit.poles, band) & (damping_ratios(fit.poles) <= HEAVIEST) & (fit.poles.real < 0)
    told = _told(result.data, fit, factor, prepared.values.shape[1])
    is_mode &= _certain(result.data, fit, told, trusting, dropped, is_mode)
    confidence = _confidence(fit, told, everything, trusting)
    if trusting:
        is_mode &= _likely(fit, confidence, is_mode, dropped)
        alone = _alone(result.data, fit, told, factor, band, is_mode)
        is_mode &= _of_one_mode(fit, alone, is_mode, dropped)
        confidence = confidence * alone
    taken = fit.poles[is_mode]
    lost = [d for d in dropped if np.all(np.abs(taken - d.pole) > np.abs(taken.real) + abs(d.pole.real))]
    return Selection(fit, result.data, result.noise, result.starts, is_mode, confidence, factor, tuple(lost))


def _trusting(
    prepared: Prepared, state: "_State", band: tuple[float, float], dropped: list[Dropped]
) -> "_State | None":
    """Take whatever noise cannot explain. ``None`` when that does not end in a residual that is noise."""
    state = _reweight(state, 3)
    gone: list[tuple[complex, str]] = []
    state = state.with_fit(prune(state.data, state.fit, Noise.of(state.data, state.fit), gone))
    before = len(state.fit.poles)
    state = _grown(prepared, state, band)
    if likelihood.correlation(state.data, state.fit) > MISFIT:
        return None
    grown = len(state.fit.poles) != before
    state = _reweight(state, 12)
    if grown:
        state = _grown(prepared, state, band)
    thorough = likelihood.correlation(state.data, state.fit) <= 0.5 * MISFIT
    final = prune(state.data, state.fit, Noise.of(state.data, state.fit), gone, thorough)
    state = state.with_fit(likelihood.refine(state.data, final))
    dropped += [
        Dropped(pole, why)
        for pole, why in gone
        if inside(np.array([pole]), band)[0] and damping_ratios(np.array([pole]))[0] <= HEAVIEST
    ]
    # A misfit can be decorated with poles until it looks like noise; then most of them come from the search.
    decorated = len(state.fit.poles) > max(before + 3, 1.5 * before)
    if decorated or likelihood.correlation(state.data, state.fit) > 0.5 * MISFIT:
        return None
    return state.with_fit(beyond(state.data, state.fit, band))


def _grown(prepared: Prepared, state: "_State", band: tuple[float, float]) -> "_State":
    """Modes added that the residual shows; the bins are made anew where these need finer ones."""
    fit = complete(state.data, state.fit, band, rounds=8 + len(state.fit.poles) // 4)
    if len(fit.poles) == len(state.fit.poles):
        return state.with_fit(fit)
    noise = np.repeat(state.noise.lines, np.diff(np.append(state.starts, len(prepared.frequencies))))
    prepared = replace(prepared, noise=replace(prepared.noise, lines=noise))
    return _observe(prepared, Candidates(fit.poles, fit.participation, np.ones(len(fit.poles))))


def _doubting(state: "_State", candidates: Candidates, band: tuple[float, float], dropped: list[Dropped]) -> "_State":
    """Take what stands out of a misfit: peaks of their own, or poles that the model orders agree on."""
    weighted = _reweight(state, 3)
    weighted = weighted.with_fit(_eliminate(weighted.data, weighted.fit, candidates, band, dropped))
    if inside(weighted.fit.poles, band).any():
        weighted = weighted.with_fit(search(weighted.data, weighted.fit, band, rounds=12, hidden=False))
    else:
        # No model order shows a mode: noise that grows with the FRF itself does that. Search before weights hide it.
        outside = likelihood.drop(state.data, state.fit, ~inside(state.fit.poles, band))
        weighted = _reweight(state.with_fit(search(state.data, outside, band, rounds=12, hidden=False)), 3)
        weighted = weighted.with_fit(_eliminate(weighted.data, weighted.fit, candidates, band, dropped))
    weighted = _reweight(weighted, 12)
    return weighted.with_fit(_eliminate(weighted.data, weighted.fit, candidates, band, dropped))


def keep_picked(prepared: Prepared, table: PoleTable, added_decay: float, rows: list[int]) -> Selection:
    """Refine the poles that a user named, and no other, with the persistent poles beside them as background."""
    everything = of_table(table, added_decay)
    picked = Candidates(
        table.poles[rows] - added_decay, np.ones((len(prepared.references), len(rows)), complex), np.ones(len(rows))
    )
    vectors = table.participation[rows].T
    picked = replace(picked, participation=vectors / vectors[np.argmax(np.abs(vectors), axis=0), np.arange(len(rows))])
    chosen = picked.joined(everything.keep(everything.persistence >= _PERSISTENCE))
    state = _reweight(_observe(prepared, chosen), 12)
    fit, factor = state.fit, likelihood.variance_factor(state.data, state.fit)
    is_mode = np.arange(len(fit.poles)) < len(rows)
    told = _told(state.data, fit, factor, prepared.values.shape[1])
    confidence = _confidence(fit, told, everything, trusting=False)
    return Selection(fit, state.data, state.noise, state.starts, is_mode, confidence, factor, named=True)


@dataclass(frozen=True)
class _State:
    """Data in bins, their noise, and the fit so far."""

    data: Observations
    noise: NoiseLevel
    starts: Int[np.ndarray, "bin"]
    fit: ModalFit

    def with_fit(self, fit: ModalFit) -> "_State":
        return replace(self, fit=fit)


def _observe(prepared: Prepared, candidates: Candidates) -> _State:
    """Weighted data in bins that are fine where the candidates are, and a first, rough refinement of these."""
    starts = likelihood.bins(prepared.frequencies, candidates.poles)
    middle = (starts + np.append(starts[1:], len(prepared.frequencies)) - 1) // 2
    noise = replace(prepared.noise, lines=prepared.noise.lines[middle])
    data = likelihood.observe(prepared.frequencies, prepared.values, prepared.derivative, noise, starts)
    fit = likelihood.evaluate(data, candidates.poles, candidates.participation)
    return _State(data, noise, starts, likelihood.refine(data, fit, iterations=4, tolerance=3e-2))


def _reweight(state: _State, iterations: int) -> _State:
    """Take the noise of each bin from the residual and refine again; with few FRFs, from its neighbours too.

    A residual that is correlated over lines is misfit: it may shape the weights within narrow limits only, or a peak
    that is fitted badly would lose the weight that it takes to fit it well.
    """
    data = state.data
    profile, together = likelihood.residuals(data, state.fit)
    correlation = together.sum() / max(np.sum(profile**2), 1e-300)
    window = int(np.clip(150 // data.signals[:, :, 0].size, 1, min(9, len(profile)))) | 1
    power = np.convolve(np.pad(profile**2, window // 2, mode="edge"), np.ones(window) / window, mode="valid")[
        : len(profile)
    ]
    profile = np.sqrt(np.maximum(power, 0.05 * np.median(power) + 1e-300))
    if correlation > MISFIT:
        profile = np.clip(profile, np.median(profile) / _SPREAD, np.median(profile) * _SPREAD)
    data, noise = likelihood.reweighted(data, state.noise, profile)
    fit = likelihood.evaluate(data, state.fit.poles, state.fit.participation)
    fit = likelihood.refine(data, fit, iterations, tolerance=1e-4 if iterations > 4 else 1e-2)
    return _State(data, noise, state.starts, fit)


def _threshold(data: Observations, unknowns: int) -> float:
    """Energy that a mode fitted to noise alone exceeds, anywhere in the band, with the false-alarm probability."""
    return passes_for_mode(2 * data.signals.shape[1] + unknowns, len(data.s))


def _eliminate(
    data: Observations,
    fit: ModalFit,
    candidates: Candidates,
    band: tuple[float, float],
    dropped: list[Dropped],
    trusting: bool = False,
) -> ModalFit:
    """Take out, one after the other, what noise or misfit explains and what repeats a neighbour.

    ``trusting`` takes the residual for noise, whatever it looks like.
    """
    limit = _threshold(data, 2 * len(fit.participation))
    for _ in range(_ROUNDS):
        if not len(fit.poles):
            break
        factor = max(likelihood.variance_factor(data, fit), 1e-300)
        correlation = 0.0 if trusting else likelihood.correlation(data, fit)
        gain = likelihood.gains(fit) / factor
        required = limit * misfit(data, fit, band, factor, correlation)
        reasons = {
            int(k): f"it explains {gain[k] / required[k]:.2g} times what noise and misfit would"
            for k in np.flatnonzero(gain <= required)
        }
        reasons |= dict.fromkeys(
            _spurs(data, fit, band, limit * factor), "it lives in one frequency line and its neighbours"
        )
        # Leaving one out can make another one needed, so the weaker ones go first.
        weakest = sorted(reasons, key=lambda k: gain[k] / required[k])[: (len(reasons) + 2) // 3]
        reasons = {k: reasons[k] for k in weakest}
        if not reasons and correlation > MISFIT:
            doubtful = (_persistence(fit, candidates) < _PERSISTENCE) | (_collinearity(fit) < _COLLINEAR)
            doubtful |= _echoes(fit, gain)
            hidden = doubtful & (likelihood.dominance(data, fit) < VISIBLE)
            lowest = np.argsort(np.where(hidden, gain, np.inf))[: (np.count_nonzero(hidden) + 2) // 3]
            reasons = dict.fromkeys(
                map(int, lowest),
                "it makes no peak of its own, and few orders show it or its shape is complex or a neighbour's",
            )
        if not reasons:
            twin = _twin(fit, gain)
            if twin is None:
                break
            reasons = {twin: "it repeats a neighbour within its bandwidth"}
        keep = np.ones(len(fit.poles), bool)
        keep[list(reasons)] = False
        for k, why in reasons.items():
            if inside(fit.poles[[k]], band)[0] and damping_ratios(fit.poles[[k]])[0] <= HEAVIEST:
                dropped.append(Dropped(complex(fit.poles[k]), why))
        fit = likelihood.refine(data, likelihood.drop(data, fit, keep), iterations=3, tolerance=1e-2)
    return fit


def _spurs(data: Observations, fit: ModalFit, band: tuple[float, float], required: float) -> list[int]:
    """Poles as narrow as the lines allow that explain nothing without the three lines they stand on: mains and such;
    and narrow ones that sit on somebody else's peak, where noise is largest.
    """
    floor = likelihood.narrowest_decay(data)
    found = []
    narrow = inside(fit.poles, band) & (-fit.poles.real <= _LINES * floor / likelihood.NARROWEST)
    if narrow.any():
        found = [int(k) for k in np.flatnonzero(narrow & (likelihood.dominance(data, fit) < VISIBLE))]
    narrowest = inside(fit.poles, band) & (-fit.poles.real <= 1.05 * floor)
    for k in np.setdiff1d(np.flatnonzero(narrowest), found):
        masked = likelihood.without_lines(data, float(fit.poles[k].imag))
        if likelihood.gains(likelihood.evaluate(masked, fit.poles, fit.participation))[k] < required:
            found.append(int(k))
    return found


def _collinearity(fit: ModalFit) -> Float[np.ndarray, "pole"]:
    """Modal phase collinearity of each shape (Pappa et al. 1993)."""
    shapes = fit.coefficients[: 2 * len(fit.poles)].reshape(len(fit.poles), 2, fit.coefficients.shape[1])
    real, cross, imaginary = (np.sum(shapes[:, a] * shapes[:, b], axis=1) for a, b in ((0, 0), (0, 1), (1, 1)))
    total = np.maximum(real + imaginary, 1e-300)
    return 1 - 4 * (real * imaginary - cross**2) / total**2


def _echoes(fit: ModalFit, gain: Float[np.ndarray, "pole"]) -> Bool[np.ndarray, "pole"]:
    """Poles with the shape and the participation of a stronger one within a tenth of the frequency."""
    count, outputs = len(fit.poles), fit.coefficients.shape[1]
    result = np.zeros(count, bool)
    if outputs < _TELLING:
        return result
    shapes = fit.coefficients[: 2 * count].reshape(count, 2, outputs)
    psi = shapes[:, 0] + 1j * shapes[:, 1]
    for a in range(count):
        near = np.abs(fit.poles.imag - fit.poles[a].imag) < 0.1 * abs(fit.poles[a])
        for b in np.flatnonzero(near & (gain > gain[a])):
            alike = _mac(fit.participation[:, a], fit.participation[:, b]) > 0.9
            result[a] |= alike and _mac(psi[a], psi[b]) > 0.9
    return result


def _persistence(fit: ModalFit, candidates: Candidates) -> Float[np.ndarray, "pole"]:
    """Share of the model orders that show each pole; a cluster of candidates speaks for the nearest pole only."""
    if not len(candidates.poles) or not len(fit.poles):
        return np.zeros(len(fit.poles))
    reach = np.maximum(np.abs(fit.poles.real)[:, None], np.abs(candidates.poles.real)[None, :])
    distance = np.abs(fit.poles[:, None] - candidates.poles[None, :]) / reach
    nearest = np.argmin(distance, axis=0)
    speaks = (distance < 1) & (nearest[None, :] == np.arange(len(fit.poles))[:, None])
    return np.where(speaks, candidates.persistence[None, :], 0).max(axis=1)


def _twin(fit: ModalFit, gain: Float[np.ndarray, "mode"]) -> int | None:
    """The weaker of two poles that one mode explains.

    Within one bandwidth of each other, their shapes and participation are the same; or they share the participation
    and lie within a small part of the bandwidth and 0.15 % of the frequency: a resonance that moved from one record to
    the next leaves such a pair, with arbitrary shapes.
    """
    count = len(fit.poles)
    shapes = fit.coefficients[: 2 * count].reshape(count, 2, fit.coefficients.shape[1])
    psi = shapes[:, 0] + 1j * shapes[:, 1]
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


@dataclass(frozen=True)
class _Told:
    """What the data tell of each pole: standard deviations (Hz; of the damping ratio) and scatter of the shape."""

    frequency: Float[np.ndarray, "pole"]
    damping: Float[np.ndarray, "pole"]
    scatter: Float[np.ndarray, "pole"]


def _told(data: Observations, fit: ModalFit, factor: float, outputs: int) -> _Told:
    covariance = likelihood.covariance(fit, factor)
    scatter = shape_scatter(data, fit, factor, outputs)
    return _Told(np.sqrt(covariance[:, 0, 0]), np.sqrt(covariance[:, 1, 1]), scatter)


def _certain(
    data: Observations,
    fit: ModalFit,
    told: _Told,
    trusting: bool,
    dropped: list[Dropped],
    candidates: Bool[np.ndarray, "pole"],
) -> Bool[np.ndarray, "pole"]:
    """Whether noise leaves a mode meaningful: its damping, its place among its neighbours, and its shape.

    A peak that stands by itself is a mode however badly its damping is told; its interval says so. Where misfit
    remains, the same holds for its place and its shape.
    """
    visible = likelihood.dominance(data, fit) >= VISIBLE
    exempt = visible & (not trusting)
    damping, frequencies = damping_ratios(fit.poles), natural_frequencies(fit.poles)
    good = np.ones(len(fit.poles), bool)
    for place in np.flatnonzero(candidates):
        # Repeated roots are told apart by their participation: only neighbours with the same one have to be apart.
        alike = np.array([_mac(fit.participation[:, place], other) > 0.9 for other in fit.participation.T])
        alike[place] = False
        spacing = np.abs(fit.poles[alike] - fit.poles[place]).min(initial=np.inf) / (2 * np.pi)
        # A wide mode over a narrow one, or the reverse, is no repeated root.
        other = alike | (np.abs(np.log(np.maximum(damping, 1e-9) / damping[place])) > np.log(3))
        other[place] = False
        apart = np.abs(frequencies[other] - frequencies[place]).min(initial=np.inf)
        reason = ""
        if told.damping[place] > damping[place] * (_DAMPING if trusting else 1 / 3) and not visible[place]:
            reason = f"its damping is uncertain by {told.damping[place] / damping[place]:.0%}"
        elif told.frequency[place] > spacing / 3:
            reason = f"its frequency is uncertain by {told.frequency[place]:.2g} Hz, {spacing:.2g} Hz from a neighbour"
        elif told.frequency[place] > apart / 2 and not exempt[place]:
            reason = f"its frequency is uncertain by {told.frequency[place]:.2g} Hz, {apart:.2g} Hz from a neighbour"
        elif told.scatter[place] > _SCATTER and not exempt[place] and not _repeated(fit, int(place)):
            reason = (
                f"its shape is uncertain: a MAC of {1 / (1 + told.scatter[place]):.2f} with the true one is expected"
            )
        if reason:
            good[place] = False
            dropped.append(Dropped(complex(fit.poles[place]), reason))
    return good


def _likely(
    fit: ModalFit,
    confidence: Float[np.ndarray, "pole"],
    candidates: Bool[np.ndarray, "pole"],
    dropped: list[Dropped],
) -> Bool[np.ndarray, "pole"]:
    """Whether a mode is told well enough to be reported: noise is all there is to doubt, and it leaves little doubt."""
    good = np.ones(len(fit.poles), bool)
    for place in np.flatnonzero(candidates & (confidence < _LIKELY)):
        if not _repeated(fit, int(place)):
            good[place] = False
            why = f"the probability that it is a mode with this place and shape is {confidence[place]:.0%}"
            dropped.append(Dropped(complex(fit.poles[place]), why))
    return good


def _alone(
    data: Observations,
    fit: ModalFit,
    told: _Told,
    factor: float,
    band: tuple[float, float],
    candidates: Bool[np.ndarray, "pole"],
) -> Float[np.ndarray, "pole"]:
    """Probability that no other mode, hidden under each of some modes, displaces it by its decay rate.

    The energy that a mode may explain without being noticed displaces a pole by as many standard deviations as its root
    says: with few FRFs, much noise or much overlap this is far.
    """
    unnoticed = np.sqrt(_threshold(data, 2 * len(fit.participation)) - 2 * data.signals.shape[1])
    damping = np.maximum(damping_ratios(fit.poles), 1e-300)
    spread = np.hypot(told.frequency / natural_frequencies(fit.poles), told.damping) / damping
    displaced = np.minimum(unnoticed * spread, 1)
    # Narrower than a few lines, a mode overlaps with nothing.
    wide = -fit.poles.real > _LINES / likelihood.NARROWEST * likelihood.narrowest_decay(data)
    places = np.flatnonzero(candidates & wide & (displaced > _DISPLACED))
    result = np.ones(len(fit.poles))
    result[places] -= another_mode(data, fit, factor, band, places) * displaced[places]
    return result


def _of_one_mode(
    fit: ModalFit,
    alone: Float[np.ndarray, "pole"],
    candidates: Bool[np.ndarray, "pole"],
    dropped: list[Dropped],
) -> Bool[np.ndarray, "pole"]:
    """Whether the data tell a mode from two that overlap. Those that they do not stay in the fit as background."""
    doubtful = candidates & (alone < _SINGLE)
    for place in np.flatnonzero(doubtful):
        why = f"the data do not tell it from modes that overlap; the probability that it is one is {alone[place]:.0%}"
        dropped.append(Dropped(complex(fit.poles[place]), why))
    return ~doubtful


def _repeated(fit: ModalFit, place: int) -> bool:
    """Whether a pole is one of a repeated root: together they have a plane of shapes, none of its own."""
    distance = np.abs(fit.poles - fit.poles[place])
    near = distance < _COINCIDENT * abs(fit.poles[place].real)
    near[place] = False
    return any(_mac(fit.participation[:, place], fit.participation[:, other]) < 0.9 for other in np.flatnonzero(near))


def _confidence(fit: ModalFit, told: _Told, candidates: Candidates, trusting: bool) -> Float[np.ndarray, "pole"]:
    """Probability that a mode is one, is nearest to itself and shows its own shape (a MAC of 0.8 with the true one).

    Where misfit remains, noise is not all there is to doubt: the share of model orders that show the mode counts half.
    """
    if not len(fit.poles):
        return np.zeros(0)
    frequencies = natural_frequencies(fit.poles)
    distance = np.abs(frequencies[:, None] - frequencies[None, :])
    distance[np.arange(len(distance)), np.arange(len(distance))] = np.inf
    same = np.abs(fit.participation.conj().T @ fit.participation) ** 2
    energy = np.sum(np.abs(fit.participation) ** 2, axis=0)
    distance[same < 0.9 * np.outer(energy, energy)] = np.inf
    apart = distance.min(axis=1)
    place = scipy.special.erf(apart / (2 * np.sqrt(2) * np.maximum(told.frequency, 1e-300)))
    decaying = 0.5 * (
        1 + scipy.special.erf(damping_ratios(fit.poles) / (np.sqrt(2) * np.maximum(told.damping, 1e-300)))
    )
    # Errors of a few poles make most of the scatter of a shape: chi-square with few degrees of freedom.
    shape = scipy.special.gammainc(_SHAPE_FREEDOM / 2, _SHAPE_FREEDOM / 2 * 0.25 / np.maximum(told.scatter, 1e-300))
    noise = place * decaying * shape
    return noise if trusting else 0.5 * noise * (1 + _persistence(fit, candidates))
