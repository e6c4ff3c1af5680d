"""Scatter of the poles between FRFs that were measured one after the other."""

import numpy as np
import scipy.stats
from jaxtyping import Float

from ema.fit import weighted
from ema.fit.weighted import Linearisation, State, Weighted

_CHANCE = 5e-3
"""Probability that noise alone passes for scatter between the FRFs, each pole."""
_LARGEST_SHARE = 0.8
"""Share in the information of a pole that counts at most: the other outputs have to tell something to compare with."""


def between_outputs(
    data: Weighted, state: State, normal: Linearisation, variance: Float[np.ndarray, "mode"]
) -> Float[np.ndarray, "2 mode"]:
    """Factor on the variance of the real and of the imaginary part of each pole for what changes between the outputs.

    Where a hammer roves, its points are hit at different times, in different ways, with the sensor loading another
    place: each FRF is clean and has a pole of its own. Leaving out one output after the other shows that (one step of
    the jackknife, Wu 1986; sandwich variance over groups, Liang and Zeger 1986). Where chance explains what is seen the
    factor is 1, else the observed variance over the usual one, widened for its few degrees of freedom so that 1.96
    standard deviations hold 95 %.

    Parameters
    ----------
    variance : of each pole over what the weights say.
    """
    modes, half = len(state.poles), len(normal.gradient) // 2
    factor = np.ones((2, modes))
    if len(data.signals) < 3 or not modes:
        return factor
    covariance = normal.covariance()
    share = np.minimum(_shares(data, state), _LARGEST_SHARE)
    freedom = np.maximum(1 / np.sum(share**2, axis=0) - 1, 1)
    usual = np.sum(share / (1 - share), axis=0)
    pull = weighted.scores(data, state, normal)
    for part, first in enumerate((0, half)):
        own = slice(first, first + modes)
        left_out = pull @ covariance[:, own] / (1 - share)
        seen = np.sum(left_out**2, axis=0) / usual
        ratio = seen / (np.diagonal(covariance)[own] * variance)
        telling = ratio > scipy.stats.chi2.isf(_CHANCE, freedom) / freedom
        few = (scipy.stats.t.isf(0.025, freedom[telling]) / scipy.stats.norm.isf(0.025)) ** 2
        factor[part, telling] = ratio[telling] * few
    return factor


def _shares(data: Weighted, state: State) -> Float[np.ndarray, "out mode"]:
    """Share of each output in what the data tell of each pole."""
    near = np.abs(data.s - state.poles[:, None]) ** -4
    share = np.empty(state.shapes.shape)
    for rows in data.blocks():
        found = np.einsum("oif,mf,im->om", data.weights[rows], near, np.abs(state.participation) ** 2, optimize=True)
        share[rows] = found * np.abs(state.shapes[rows]) ** 2
    result: np.ndarray = share / np.maximum(np.sum(share, axis=0), np.finfo(float).tiny)
    return result
