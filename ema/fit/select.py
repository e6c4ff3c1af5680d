"""Automatic selection of modes: told nothing, it says what it keeps, how sure it is, and why it drops the rest.

Poles that persist over the model orders are refined together by maximum likelihood. Where the residual is larger than
the noise, narrower bands are searched. A mode stays when leaving it out costs more than noise, or the misfit of its
neighbourhood, could explain, when its own uncertainty is small against its damping and against the distance to its
neighbours, and when it is not the second half of a peak that one mode already explains.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.stats
from jaxtyping import Bool, Complex, Float, Int

from ema.data import PoleTable, damping_ratios, natural_frequencies
from ema.fit import likelihood, lscf
from ema.fit.likelihood import ModalFit, Observations
from ema.fit.noise import NoiseLevel
from ema.fit.prepare import Prepared

HEAVIEST = 0.20
"""Damping ratio above which a pole describes the background, not a mode."""

_PERSISTENCE = 0.3
_FALSE_ALARM = 1e-6
_ROUNDS = 12
_MISFIT = 0.2
"""Correlation of neighbouring residuals above which the misfit, not the noise, limits what can be told."""
_SPREAD = 2.0
"""Factor by which a misfit may raise or lower the noise of a bin."""
_VISIBLE = 0.25
"""Share of the energy at its own frequency from which on a mode is seen as a peak."""
_COLLINEAR = 0.6
"""Modal phase collinearity below which the shape of a mode without a peak of its own speaks against it."""
_TRIAL_DAMPING = np.array([0.001, 0.005, 0.02, 0.06])


@dataclass(frozen=True)
class Dropped:
    """A candidate that was not taken, and why."""

    pole: complex
    reason: str


@dataclass(frozen=True)
class Selection:
    """Refined poles: ``is_mode`` marks the modes, the others are background that stays in the fit.

    ``starts`` are the bins of ``data``; ``factor`` is the residual energy over that of the assumed noise.
    """

    fit: ModalFit
    data: Observations
    noise: NoiseLevel
    starts: Int[np.ndarray, "bin"]
    is_mode: Bool[np.ndarray, "pole"]
    confidence: Float[np.ndarray, "pole"]
    factor: float
    dropped: tuple[Dropped, ...] = ()


@dataclass(frozen=True)
class Candidates:
    """Clusters of poles over the model orders: representative, participation, share of orders in which it shows."""

    poles: Complex[np.ndarray, "cluster"]
    participation: Complex[np.ndarray, "in cluster"]
    persistence: Float[np.ndarray, "cluster"]

    def keep(self, rows: Bool[np.ndarray, "cluster"]) -> "Candidates":
        """Some of the clusters."""
        return Candidates(self.poles[rows], self.participation[:, rows], self.persistence[rows])

    def joined(self, other: "Candidates") -> "Candidates":
        """Both, without those of ``other`` that lie within their decay rate of one of these."""
        distance = np.abs(other.poles[:, None] - self.poles[None, :])
        reach = np.maximum(np.abs(other.poles.real)[:, None], np.abs(self.poles.real)[None, :])
        new = other.keep(~np.any(distance < 0.5 * reach, axis=1))
        return Candidates(
            np.concatenate([self.poles, new.poles]),
            np.concatenate([self.participation, new.participation], axis=1),
            np.concatenate([self.persistence, new.persistence]),
        )


def cluster(
    order: Int[np.ndarray, "pole"], poles: Complex[np.ndarray, "pole"], participation: Complex[np.ndarray, "pole in"]
) -> Candidates:
    """Follow poles from the highest order down to a third of it; each order gives a cluster one pole at most.

    A pole joins the nearest cluster closer than half the sum of the two decay rates.
    """
    orders = np.unique(order)[::-1]
    orders = orders[orders >= orders.max(initial=0) / 3]
    members: list[list[int]] = []
    for current in orders:
        rows = np.flatnonzero((order == current) & (poles.real < 0))
        if not members:
            members = [[int(row)] for row in rows]
            continue
        centres = poles[[cluster[-1] for cluster in members]]
        distance = np.abs(poles[rows][:, None] - centres[None, :])
        reach = 0.5 * (np.abs(poles[rows].real)[:, None] + np.abs(centres.real)[None, :])
        distance = np.where(distance <= reach, distance / reach, np.inf)
        taken: set[int] = set()
        for place in np.argsort(distance, axis=None):
            row, centre = np.unravel_index(place, distance.shape)
            if not np.isfinite(distance[row, centre]):
                break
            members[centre].append(int(rows[row]))
            taken.add(int(row))
            distance[row, :] = distance[:, centre] = np.inf
        members += [[int(row)] for position, row in enumerate(rows) if position not in taken]
    # The member of median damping speaks for the cluster: high orders split peaks, low orders widen them.
    heads = [sorted(cluster, key=lambda row: -poles[row].real)[len(cluster) // 2] for cluster in members]
    vectors = participation[heads].T
    largest = vectors[np.argmax(np.abs(vectors), axis=0), np.arange(len(heads))] if len(heads) else 1
    return Candidates(poles[heads], vectors / largest, np.array([len(c) / len(orders) for c in members], dtype=float))


def _of_table(table: PoleTable, added_decay: float) -> Candidates:
    return cluster(table.order, table.poles - added_decay, table.participation)


def select(prepared: Prepared, table: PoleTable, added_decay: float = 0.0) -> Selection:
    """Choose the modes of a pole table.

    ``added_decay`` is what an exponential window did to the data; the table is already free of it.
    """
    everything = _of_table(table, added_decay)
    chosen = everything.keep(everything.persistence >= min(_PERSISTENCE, everything.persistence.max(initial=0)))
    data, noise, starts = _observe(prepared, chosen)
    fit = _start(data, chosen)
    for share in (6, 20):
        found = _zoom(prepared, data, fit, share)
        if not len(found.poles):
            break
        larger = Candidates(fit.poles, fit.participation, np.ones(len(fit.poles))).joined(found)
        everything = everything.joined(found)
        if len(larger.poles) > len(fit.poles):
            data, noise, starts = _observe(prepared, larger)
            fit = _start(data, larger)
    dropped: list[Dropped] = []
    unweighted = data, noise, fit
    data, noise, fit = _reweight(data, noise, fit, 3)
    fit = _eliminate(data, fit, everything, table.band, dropped)
    if not _inside(fit.poles, table.band).any():
        # No model order shows a mode: noise that grows with the FRF itself does that. Search before the weights hide it.
        data, noise, fit = unweighted
        fit = _search(data, _keep_outside(data, fit, table.band), table.band)
        data, noise, fit = _reweight(data, noise, fit, 3)
        fit = _eliminate(data, fit, everything, table.band, dropped)
    else:
        fit = _search(data, fit, table.band)
    data, noise, fit = _reweight(data, noise, fit, 12)
    fit = _eliminate(data, fit, everything, table.band, dropped)
    factor = likelihood.variance_factor(data, fit)
    is_mode = _inside(fit.poles, table.band) & (damping_ratios(fit.poles) <= HEAVIEST) & (fit.poles.real < 0)
    is_mode &= _certain(data, fit, factor, dropped, is_mode)
    confidence = _confidence(fit, factor, everything)
    taken = fit.poles[is_mode]
    lost = [d for d in dropped if np.all(np.abs(taken - d.pole) > np.abs(taken.real) + abs(d.pole.real))]
    return Selection(fit, data, noise, starts, is_mode, confidence, factor, tuple(lost))


def keep_picked(prepared: Prepared, table: PoleTable, added_decay: float, rows: list[int]) -> Selection:
    """Refine the poles that a user named, and no other, with the persistent poles beside them as background."""
    everything = _of_table(table, added_decay)
    picked = Candidates(
        table.poles[rows] - added_decay, np.ones((len(prepared.references), len(rows)), complex), np.ones(len(rows))
    )
    vectors = table.participation[rows].T
    picked = replace(picked, participation=vectors / vectors[np.argmax(np.abs(vectors), axis=0), np.arange(len(rows))])
    chosen = picked.joined(everything.keep(everything.persistence >= _PERSISTENCE))
    data, noise, starts = _observe(prepared, chosen)
    data, noise, fit = _reweight(data, noise, _start(data, chosen), 12)
    factor = likelihood.variance_factor(data, fit)
    is_mode = np.arange(len(fit.poles)) < len(rows)
    return Selection(fit, data, noise, starts, is_mode, _confidence(fit, factor, everything), factor)


def _observe(prepared: Prepared, candidates: Candidates) -> tuple[Observations, NoiseLevel, Int[np.ndarray, "bin"]]:
    """Weighted data in bins that are fine where the candidates are."""
    starts = likelihood.bins(prepared.frequencies, candidates.poles)
    middle = (starts + np.append(starts[1:], len(prepared.frequencies)) - 1) // 2
    noise = replace(prepared.noise, lines=prepared.noise.lines[middle])
    data = likelihood.observe(prepared.frequencies, prepared.values, prepared.derivative, noise, starts)
    return data, noise, starts


def _start(data: Observations, candidates: Candidates) -> ModalFit:
    """A first, rough refinement of the candidates."""
    fit = likelihood.evaluate(data, candidates.poles, candidates.participation)
    return likelihood.refine(data, fit, iterations=4, tolerance=3e-2)


def _reweight(
    data: Observations, noise: NoiseLevel, fit: ModalFit, iterations: int
) -> tuple[Observations, NoiseLevel, ModalFit]:
    """Take the noise of each bin from the residual and refine again; with few FRFs, from its neighbours too.

    A residual that is correlated over lines is misfit: it may shape the weights within narrow limits only, or a peak that
    is fitted badly would lose the weight that it takes to fit it well.
    """
    profile, together = likelihood.residuals(data, fit)
    correlation = together.sum() / max(np.sum(profile**2), 1e-300)
    window = int(np.clip(150 // data.signals[:, :, 0].size, 1, min(9, len(profile)))) | 1
    power = np.convolve(np.pad(profile**2, window // 2, mode="edge"), np.ones(window) / window, mode="valid")[
        : len(profile)
    ]
    profile = np.sqrt(np.maximum(power, 0.05 * np.median(power) + 1e-300))
    if correlation > _MISFIT:
        profile = np.clip(profile, np.median(profile) / _SPREAD, np.median(profile) * _SPREAD)
    data, noise = likelihood.reweighted(data, noise, profile)
    fit = likelihood.evaluate(data, fit.poles, fit.participation)
    return data, noise, likelihood.refine(data, fit, iterations, tolerance=1e-4 if iterations > 4 else 1e-2)


def _inside(poles: Complex[np.ndarray, "pole"], band: tuple[float, float]) -> Bool[np.ndarray, "pole"]:
    frequencies = natural_frequencies(poles)
    return (frequencies >= band[0]) & (frequencies <= band[1])


def _zoom(prepared: Prepared, data: Observations, fit: ModalFit, share: int) -> Candidates:
    """Persistent poles of narrow bands (``1/share`` of the whole, overlapping by half) that hold more than noise."""
    profile, together = likelihood.residuals(data, fit)
    lines, references = len(prepared.frequencies), prepared.values.shape[2]
    width = max(lines // share, 24 * (references + 1))
    found = Candidates(np.zeros(0, complex), np.zeros((references, 0), complex), np.zeros(0))
    centres = data.s.imag / (2 * np.pi)
    for first in range(0, max(lines - width // 2, 1), max(width // 2, 1)):
        rows = slice(first, min(first + width, lines))
        f = prepared.frequencies[rows]
        within = (centres >= f[0]) & (centres <= f[-1])
        # Products of independent residuals scatter around 0; four of their standard deviations are no accident.
        doubt = 4 / np.sqrt(max(1, within.sum() * data.signals[:, :, 0].size))
        misfit = together[within].sum() / max(np.sum(profile[within] ** 2), 1e-300) if within.any() else 0.0
        if len(f) < 16 or misfit < max(0.05, doubt):
            continue
        top = int(np.clip(len(f) // (2 * (references + 1)), 2, 24))
        degrees = range(max(1, top // 3), top + 1, max(1, top // 8))
        weights = 1 / np.clip(prepared.noise.lines[rows], 0.2, 5.0)
        outputs = lscf.principal_outputs(prepared.values[rows], weights, prepared.noise)
        polynomials = lscf.normal_matrices(f, outputs, degrees, weights)
        tables = [(degree, *lscf.poles(polynomials, degree)) for degree in degrees]
        own = cluster(
            np.concatenate([np.full(len(p), degree) for degree, p, _ in tables]),
            np.concatenate([p for _, p, _ in tables]),
            np.concatenate([v for _, _, v in tables]) * prepared.noise.references,
        )
        plausible = _inside(own.poles, (float(f[0]), float(f[-1]))) & (damping_ratios(own.poles) <= HEAVIEST)
        found = found.joined(own.keep(plausible & (own.persistence >= 0.5)))
    return found


def _threshold(data: Observations, unknowns: int) -> float:
    """Energy that a mode fitted to noise alone exceeds, anywhere in the band, with the false-alarm probability."""
    outputs, lines = data.signals.shape[1], len(data.s)
    return float(scipy.stats.chi2.isf(_FALSE_ALARM / lines, 2 * outputs + unknowns))


def _eliminate(
    data: Observations, fit: ModalFit, candidates: Candidates, band: tuple[float, float], dropped: list[Dropped]
) -> ModalFit:
    """Take out, one after the other, what noise or misfit explains and what repeats a neighbour."""
    limit = _threshold(data, 2 * len(fit.participation))
    for _ in range(8 * _ROUNDS):
        if not len(fit.poles):
            break
        factor = max(likelihood.variance_factor(data, fit), 1e-300)
        correlation = likelihood.correlation(data, fit)
        gain = likelihood.gains(fit) / factor
        required = limit * _misfit(data, fit, band, factor, correlation)
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
        if not reasons and correlation > _MISFIT:
            doubtful = (_persistence(fit, candidates) < _PERSISTENCE) | (_collinearity(fit) < _COLLINEAR)
            hidden = doubtful & (likelihood.dominance(data, fit) < _VISIBLE)
            lowest = np.argsort(np.where(hidden, gain, np.inf))[: (np.count_nonzero(hidden) + 2) // 3]
            reasons = dict.fromkeys(
                map(int, lowest), "it makes no peak of its own, and few orders show it or its shape is complex"
            )
        if not reasons:
            twin = _twin(fit, gain)
            if twin is None:
                break
            reasons = {twin: "it repeats a neighbour within its bandwidth"}
        keep = np.ones(len(fit.poles), bool)
        keep[list(reasons)] = False
        for k, why in reasons.items():
            if _inside(fit.poles[[k]], band)[0] and damping_ratios(fit.poles[[k]])[0] <= HEAVIEST:
                dropped.append(Dropped(complex(fit.poles[k]), why))
        fit = likelihood.refine(data, likelihood.drop(data, fit, keep), iterations=3, tolerance=1e-2)
    return fit


def _spurs(data: Observations, fit: ModalFit, band: tuple[float, float], required: float) -> list[int]:
    """Poles as narrow as the lines allow that explain nothing without the three lines they stand on: mains and such."""
    found = []
    narrow = _inside(fit.poles, band) & (-fit.poles.real <= 1.05 * likelihood.narrowest_decay(data))
    for k in np.flatnonzero(narrow):
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


def _persistence(fit: ModalFit, candidates: Candidates) -> Float[np.ndarray, "pole"]:
    """Share of the model orders that show each pole; a cluster of candidates speaks for the nearest pole only."""
    if not len(candidates.poles) or not len(fit.poles):
        return np.zeros(len(fit.poles))
    reach = np.maximum(np.abs(fit.poles.real)[:, None], np.abs(candidates.poles.real)[None, :])
    distance = np.abs(fit.poles[:, None] - candidates.poles[None, :]) / reach
    nearest = np.argmin(distance, axis=0)
    speaks = (distance < 1) & (nearest[None, :] == np.arange(len(fit.poles))[:, None])
    return np.where(speaks, candidates.persistence[None, :], 0).max(axis=1)


def _misfit(
    data: Observations, fit: ModalFit, band: tuple[float, float], factor: float, correlation: float
) -> Float[np.ndarray, "pole"]:
    """How much more than white noise the residual yields to a pole of this damping in this part of the band.

    Windows, drifting frequencies and nonlinearity leave residuals that are smooth over lines, which further poles can
    always follow. Trial poles tell how far: the median of their gains over a third of the band, in units of white
    noise; 1 where the model holds.
    """
    if correlation < 0.25 * _MISFIT:
        return np.ones(len(fit.poles))
    references, outputs, _ = data.signals.shape
    trials = _trials(band)
    gain, _ = _trial_gains(data, fit, trials)
    ratio = np.maximum(gain.reshape(-1, len(_TRIAL_DAMPING)) / (factor * 2 * outputs * references), 1)
    places = natural_frequencies(trials).reshape(ratio.shape)[:, 0]
    frequency, damping = natural_frequencies(fit.poles), damping_ratios(fit.poles)
    result = np.empty(len(fit.poles))
    for k in range(len(fit.poles)):
        near = np.abs(places - frequency[k]) <= max((band[1] - band[0]) / 6, np.sort(np.abs(places - frequency[k]))[4])
        level = np.log(np.median(ratio[near], axis=0))
        result[k] = np.exp(np.interp(np.log(max(damping[k], 1e-6)), np.log(_TRIAL_DAMPING), level))
    return result


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


def _search(data: Observations, fit: ModalFit, band: tuple[float, float]) -> ModalFit:
    """Add modes that the residual still shows, the strongest first, as long as noise and misfit cannot explain them."""
    references, outputs, _ = data.signals.shape
    freedom = 2 * outputs * references
    limit = float(scipy.stats.chi2.isf(_FALSE_ALARM / len(data.s), freedom))
    for _ in range(_ROUNDS):
        profile, together = likelihood.residuals(data, fit)
        correlation = together.sum() / max(np.sum(profile**2), 1e-300)
        trials = _trials(band, _peaks(data, profile, band))
        factor = max(likelihood.variance_factor(data, fit), 1e-300)
        gain, vectors = _trial_gains(data, fit, trials)
        typical = np.median(gain.reshape(-1, len(_TRIAL_DAMPING)), axis=0) / (factor * freedom)
        required = np.tile(np.maximum(typical, 1), len(gain) // len(_TRIAL_DAMPING)) * limit * factor
        # What takes a fifth of the whole residual away is no decoration of a misfit: the skirts of a missed mode are it.
        required = np.minimum(required, max(0.2 * fit.cost, limit * factor))
        best = int(np.argmax(gain / required))
        if not gain[best] > required[best]:
            break
        larger = likelihood.with_mode(data, fit, complex(trials[best]), vectors[best])
        larger = likelihood.refine(data, larger, iterations=25, tolerance=1e-2)
        if fit.cost - larger.cost < required[best] or np.any(larger.poles.real >= 0):
            break
        if correlation > _MISFIT and likelihood.dominance(data, larger)[-1] < _VISIBLE:
            break
        fit = larger
    return fit


def _keep_outside(data: Observations, fit: ModalFit, band: tuple[float, float]) -> ModalFit:
    return likelihood.drop(data, fit, ~_inside(fit.poles, band))


def _peaks(
    data: Observations, profile: Float[np.ndarray, "bin"], band: tuple[float, float]
) -> Float[np.ndarray, "peak"]:
    """Frequencies (Hz) of the sixteen largest maxima of the residual energy."""
    power = np.convolve(profile**2, np.ones(3), mode="same")
    inner = power[1:-1]
    maxima = 1 + np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]))
    return data.s.imag[maxima[np.argsort(-power[maxima])][:16]] / (2 * np.pi)


def _trials(band: tuple[float, float], peaks: Float[np.ndarray, "peak"] | None = None) -> Complex[np.ndarray, "trial"]:
    """Trial poles: 32 places over the band and the given ones, each with four damping ratios."""
    step = (band[1] - band[0]) / 32
    places = np.linspace(band[0] + 0.5 * step, band[1] - 0.5 * step, 32)
    places = places if peaks is None else np.concatenate([places, peaks])
    return (2 * np.pi * places[:, None] * (-_TRIAL_DAMPING + 1j)[None, :]).reshape(-1)


def _trial_gains(
    data: Observations, fit: ModalFit, trials: Complex[np.ndarray, "trial"]
) -> tuple[Float[np.ndarray, "trial"], Complex[np.ndarray, "trial in"]]:
    """Cost that each trial pole alone, with a free residue matrix, would take off; and its leading participation."""
    references, outputs, _ = data.signals.shape
    count, weights = len(trials), data.reference_weights
    own, overlap, cross = likelihood.trial_products(data, fit, trials)
    scale = 1 / np.sqrt(np.diag(fit.gram))
    inverse = np.linalg.inv(fit.gram * np.outer(scale, scale) + 1e-12 * np.eye(len(scale))) * np.outer(scale, scale)
    remaining = (cross - overlap @ fit.coefficients).reshape(count, 2 * references, outputs)
    overlap = overlap.reshape(count, 2 * references, len(scale))
    block = np.einsum("tab,i,ij->taibj", own, weights**2, np.eye(references)).reshape(count, 2 * references, -1)
    schur = block - overlap @ inverse @ overlap.transpose(0, 2, 1)
    ridge = 1e-9 * np.einsum("tii->ti", block)
    solution = np.linalg.solve(schur + ridge[:, :, None] * np.eye(2 * references), remaining)
    gain = np.einsum("tio,tio->t", remaining, solution)
    residue = solution[:, :references] + 1j * solution[:, references:]
    vectors = np.linalg.eigh(residue @ residue.conj().transpose(0, 2, 1))[1][:, :, -1]
    return gain, vectors


def _certain(
    data: Observations, fit: ModalFit, factor: float, dropped: list[Dropped], candidates: Bool[np.ndarray, "pole"]
) -> Bool[np.ndarray, "pole"]:
    """Whether the standard deviations leave a mode meaningful: below a third of its damping and of its spacing.

    A peak that stands by itself is a mode however badly its damping is told; its interval says so.
    """
    visible = likelihood.dominance(data, fit) >= _VISIBLE
    covariance = likelihood.covariance(fit, factor)
    damping = damping_ratios(fit.poles)
    std_damping, std_frequency = np.sqrt(covariance[:, 1, 1]), np.sqrt(covariance[:, 0, 0])
    good = np.ones(len(fit.poles), bool)
    for place in np.flatnonzero(candidates):
        spacing = np.abs(np.delete(fit.poles, place) - fit.poles[place]).min(initial=np.inf) / (2 * np.pi)
        reason = ""
        if std_damping[place] > damping[place] / 3 and not visible[place]:
            reason = f"its damping is uncertain by {std_damping[place] / damping[place]:.0%}"
        elif std_frequency[place] > spacing / 3:
            reason = f"its frequency is uncertain by {std_frequency[place]:.2g} Hz, {spacing:.2g} Hz from a neighbour"
        if reason:
            good[place] = False
            dropped.append(Dropped(complex(fit.poles[place]), reason))
    return good


def _confidence(fit: ModalFit, factor: float, candidates: Candidates) -> Float[np.ndarray, "pole"]:
    """Share of model orders that show the mode, averaged with how far its damping is from being noise."""
    if not len(fit.poles):
        return np.zeros(0)
    covariance = likelihood.covariance(fit, factor)
    ratio = damping_ratios(fit.poles) / np.sqrt(covariance[:, 1, 1])
    return 0.5 * (_persistence(fit, candidates) + (1 - np.exp(-ratio / 10)))
