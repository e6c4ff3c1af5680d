"""Search of a residual for modes that no candidate showed."""

import numpy as np
import scipy.stats
from jaxtyping import Complex, Float

from ema.data import damping_ratios, natural_frequencies
from ema.fit import likelihood
from ema.fit.candidates import HEAVIEST, inside
from ema.fit.likelihood import ModalFit, Observations

FALSE_ALARM = 1e-6
"""Probability that noise alone passes for a mode somewhere in the band."""
MISFIT = 0.2
"""Correlation of neighbouring residuals above which the misfit, not the noise, limits what can be told."""
VISIBLE = 0.25
"""Share of the energy at its own frequency from which on a mode is seen as a peak."""

_TRIAL_DAMPING = np.array([0.001, 0.005, 0.02, 0.06])


def search(data: Observations, fit: ModalFit, band: tuple[float, float], rounds: int, hidden: bool) -> ModalFit:
    """Add modes that the residual still shows, the strongest first, as long as noise and misfit cannot explain them.

    ``hidden`` admits modes without a peak of their own even where the residual is a misfit.
    """
    references, outputs, _ = data.signals.shape
    freedom = 2 * outputs * references
    limit = float(scipy.stats.chi2.isf(FALSE_ALARM / len(data.s), freedom))
    for _ in range(rounds):
        profile, together = likelihood.residuals(data, fit)
        correlation = together.sum() / max(np.sum(profile**2), 1e-300)
        trials = _trials(band, _peaks(data, profile))
        net = len(trials)
        trials = np.concatenate([trials, _beside(fit, band)])
        factor = max(likelihood.variance_factor(data, fit), 1e-300)
        gain, vectors = trial_gains(data, fit, trials)
        required = np.full(len(trials), limit * factor)
        if not hidden:
            typical = np.median(gain[:net].reshape(-1, len(_TRIAL_DAMPING)), axis=0) / (factor * freedom)
            required[:net] *= np.tile(np.maximum(typical, 1), net // len(_TRIAL_DAMPING))
            required[net:] *= max(1.0, float(typical.max()))
            # What takes a fifth of the whole residual away is no decoration of a misfit: it is a missed mode.
            required = np.minimum(required, max(0.2 * fit.cost, limit * factor))
        chosen = _apart(trials, gain / required, 3 if hidden else 1)
        if not chosen:
            break
        larger = fit
        for k in chosen:
            larger = likelihood.with_mode(data, larger, complex(trials[k]), vectors[k])
        larger = likelihood.refine(data, larger, iterations=25, tolerance=1e-2)
        if fit.cost - larger.cost < required[chosen].min() or np.any(larger.poles.real >= 0):
            break
        if not hidden and correlation > MISFIT and likelihood.dominance(data, larger)[-1] < VISIBLE:
            break
        fit = larger
    return fit


def _apart(trials: Complex[np.ndarray, "trial"], merit: Float[np.ndarray, "trial"], most: int) -> list[int]:
    """The best trials with a merit above 1 whose peaks do not overlap."""
    chosen: list[int] = []
    for k in np.argsort(-merit):
        if merit[k] <= 1 or len(chosen) == most:
            break
        reach = 4 * (np.abs(trials[chosen].real) + abs(trials[k].real))
        if np.all(np.abs(trials[chosen] - trials[k]) > reach):
            chosen.append(int(k))
    return chosen


def _peaks(data: Observations, profile: Float[np.ndarray, "bin"]) -> Float[np.ndarray, "peak"]:
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


def _beside(fit: ModalFit, band: tuple[float, float]) -> Complex[np.ndarray, "trial"]:
    """Trial poles on both sides of every mode: the second of a pair that one pole has been fitted to."""
    own = fit.poles[inside(fit.poles, band) & (damping_ratios(fit.poles) <= HEAVIEST)]
    return np.concatenate([own + 0.4j * own.real, own - 0.4j * own.real])


def trial_gains(
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


def misfit(
    data: Observations, fit: ModalFit, band: tuple[float, float], factor: float, correlation: float
) -> Float[np.ndarray, "pole"]:
    """How much more than white noise the residual yields to a pole of this damping in this part of the band.

    Windows, drifting frequencies and nonlinearity leave residuals that are smooth over lines, which further poles can
    always follow. Trial poles tell how far: the median of their gains over a third of the band, in units of white
    noise; 1 where the model holds.
    """
    if correlation < 0.25 * MISFIT:
        return np.ones(len(fit.poles))
    references, outputs, _ = data.signals.shape
    trials = _trials(band)
    gain, _ = trial_gains(data, fit, trials)
    ratio = np.maximum(gain.reshape(-1, len(_TRIAL_DAMPING)) / (factor * 2 * outputs * references), 1)
    places = natural_frequencies(trials).reshape(ratio.shape)[:, 0]
    frequency, damping = natural_frequencies(fit.poles), damping_ratios(fit.poles)
    result = np.empty(len(fit.poles))
    for k in range(len(fit.poles)):
        near = np.abs(places - frequency[k]) <= max((band[1] - band[0]) / 6, np.sort(np.abs(places - frequency[k]))[4])
        level = np.log(np.median(ratio[near], axis=0))
        result[k] = np.exp(np.interp(np.log(max(damping[k], 1e-6)), np.log(_TRIAL_DAMPING), level))
    return result
