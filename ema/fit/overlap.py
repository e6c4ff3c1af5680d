"""Whether the residual leaves room for a mode that is not in the fit, hidden under one that is."""

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data import damping_ratios
from ema.fit import search
from ema.fit.candidates import inside
from ema.fit.estimator import Fit, Observations
from ema.fit.policy import POLICY
from ema.fit.trials import TrialEquations, equations

_PLACES = (np.arange(9) - 4) / 4.5
_WIDTHS = np.array([0.5, 1.0, 2.0])
"""Trial poles of a hidden mode: places over the reach of a mode, and decay rates over that of the mode."""
_NEAR = 7
"""Modes whose typical energy is that expected of a hidden one: the median of seven is that of its neighbours, whatever
three of them are. With 3 and with 14 the modes of 14 random systems stay the same."""


def another_mode(
    data: Observations, fit: Fit, factor: float, band: tuple[float, float], places: Int[np.ndarray, "place"]
) -> Float[np.ndarray, "place"]:
    """Probability that one more mode, which is not in the fit, overlaps each of some modes.

    Before the residual is looked at, as many hidden modes are expected as there are modes in the fit: anywhere in the
    band, with the participation of any of them, the energy of those near by and any shape. Trial poles over each mode
    then weigh how well such a mode explains the residual against how much better than by chance it should (Bayes factor
    of a linear model with a normal prior). Where noise and overlap would hide it, the expectation stays as it was.

    Parameters
    ----------
    factor : residual energy over that of the assumed noise.
    places : positions of the modes in the fit.
    """
    own = np.flatnonzero(inside(fit.poles, band) & (damping_ratios(fit.poles) <= POLICY.heaviest))
    if not len(places) or not len(own):
        return np.zeros(len(places))
    poles, outputs = fit.poles[places], data.outputs
    strength = np.linalg.norm(fit.participation, axis=0)
    energy = strength**2 * np.sum(np.abs(fit.psi) ** 2, axis=1)
    density = len(own) / (2 * np.pi * (band[1] - band[0]))
    reach = np.maximum(-2 * poles.real, 0.75 / density)
    trials = (
        1j * (poles.imag[:, None] + reach[:, None] * _PLACES)[:, :, None]
        + np.multiply.outer(poles.real, _WIDTHS)[:, None]
    )
    found = equations(data, fit, trials.reshape(-1))
    noise = search.Noise.of(data, fit)
    level = factor * noise.explains(data, poles, fit.participation.T[places], fit) / noise.required_of_white
    vectors = np.unique((fit.participation[:, own] / strength[own]).T, axis=0)
    result = np.empty(len(places))
    for row, pole in enumerate(poles):
        rows = slice(row * trials[0].size, (row + 1) * trials[0].size)
        near = own[np.argsort(np.abs(fit.poles[own] - pole))[:_NEAR]]
        spread = float(np.median(energy[near])) / (2 * outputs)
        evidence = [_evidence(found, rows, vector, level[row], spread) for vector in vectors]
        odds = 2 * reach[row] * density * np.mean(evidence)
        result[row] = odds / (1 + odds)
    return result


def _evidence(
    found: TrialEquations, rows: slice, vector: Complex[np.ndarray, "in"], noise: float, spread: float
) -> Float[np.ndarray, "trial"]:
    """Probability of the residual with a mode of given participation at some trial poles over that without.

    ``noise`` is the variance of an equation, ``spread`` that of each real component of the shape before the residual
    is looked at.
    """
    some = TrialEquations(found.schur[:, rows], found.remaining[:, rows], found.coupling[:, rows])
    some = some.of_rank_one(np.tile(vector, (some.schur.shape[1], 1)))
    own, right = some.schur[0], some.remaining[0]
    ridge = noise / spread * np.eye(2)
    explained = np.einsum("tao,tao->t", right, np.linalg.solve(own + ridge, right)) / noise
    expected = right.shape[2] * np.linalg.slogdet(np.eye(2) + own * (spread / noise))[1]
    result: np.ndarray = np.exp(np.minimum(0.5 * (explained - expected), 300))
    return result
