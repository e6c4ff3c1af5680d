"""Draws of the frequency and damping of a mode over its amplitude: what a prediction is made of, to be kept."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ema.compare.amplitude_prediction import (
    LawMixture,
    amplitude_statement,
    check_prediction,
    few_draws,
    laws_left_out,
)
from ema.compare.modal_laws import LAWS, ModalLaw
from ema.data import AmplitudeDependentMode, AmplitudeDraws, AmplitudePrediction, Band
from ema.errors import InputError
from ema.units import SI_UNIT

CALIBRATED = 2.0
"""Amplitude over the highest measured one, and lowest measured one over it, up to which bands were calibrated."""
REACH = 3.0
"""Amplitude over the highest measured one up to which draws are made. The bands of a response whose median lies within
``CALIBRATED`` end beyond it; halved, they would be cut off there, doubled, more draws would have no positive loss."""
COUNT = 2000
"""Draws that are kept: 50 lie beyond either end of a 95 % band."""
_APART, _MOST = 0.1, 120
"""Distance of neighbouring amplitudes in log amplitude, and most amplitudes. Between them a draw is interpolated, which
loses at most half the root of this distance of the Wiener process over a factor of e: 0.16, where levels a factor of
1.3 apart leave 0.26 between them. At 0.2 bands between such levels were two thirds as wide as they should be."""
_SMOOTH = 0.2
"""Distance in log amplitude over which a draw is smooth where its slope counts. A Wiener process has no slope: of the
Brake-Reuss beam, whose sweeps hardly fold, 25 % of the draws fold at 0.2, 50 % at 0.1, 75 % at 0.05."""
_CONTAINS = "noise of the levels, parameters and form of the law"


def amplitude_draws(
    mode: AmplitudeDependentMode,
    *,
    modal_mass: float | None = None,
    modal_mass_half: float = 0.0,
    laws: Sequence[ModalLaw] = LAWS,
    seed: int = 1,
) -> AmplitudeDraws:
    """Draw frequency and damping of a mode over its amplitude, from half its lowest to three times its highest level.

    The draws are those of :func:`predict_amplitudes`, at many amplitudes together: laws weighted by stacking, each with
    its parameters and its model-form discrepancy. Kept in a file, they answer further questions without another fit.

    Parameters
    ----------
    mode : AmplitudeDependentMode
        The measured levels, two or more.
    modal_mass : float, optional
        Modal mass [kg] for a shape of 1 at the response: 1 / (shape at the response times shape at the force), both
        mass-normalised. By default that of the mode.
    modal_mass_half : float, default 0
        Half width of its 95 % interval [kg].
    laws : sequence of ModalLaw, optional
        Joint laws that are fitted.
    seed : int, default 1
        Seed of the draws.

    Returns
    -------
    AmplitudeDraws
        About 2000 draws.

    Raises
    ------
    InputError
        If there are fewer than two levels, the modal mass is not positive, or no law has a positive loss.

    Examples
    --------
    >>> level = np.array([5.0, 10.0, 20.0, 40.0])
    >>> f, zeta = 100 - 0.01 * level, 0.001 + 1e-4 * level
    >>> mode = AmplitudeDependentMode(level, Band(f - 0.01, f, f + 0.01), Band(0.98 * zeta, zeta, 1.02 * zeta))
    >>> draws = amplitude_draws(mode, modal_mass=2.0)
    >>> float(draws.amplitude[0]), float(draws.amplitude[-1])
    (2.5, 120.0)
    """
    check_prediction(mode, mode.amplitude)
    mass = mode.modal_mass if modal_mass is None else modal_mass
    if modal_mass is not None and not (np.isfinite(mass) and mass > 0):
        raise InputError("not a modal mass", where=mode.name or "mode", got=mass, expected="a mass above 0 kg")
    at = _amplitudes(mode.amplitude)
    mixture = LawMixture.of(mode, mode.amplitude[:0], laws, seed)
    generator = np.random.default_rng(seed)
    drawn, share = mixture.along(np.log(at / mode.amplitude[0]), COUNT, generator)
    if not len(drawn):
        raise InputError(
            "no law leaves a positive loss up to three times the highest level",
            where=mode.name or "mode",
            got=amplitude_statement(mode.quantity, mode.amplitude, at),
            advice="measure at more levels, or predict single amplitudes nearer to them",
        )
    masses = None
    if np.isfinite(mass):
        masses = np.abs(mass + modal_mass_half / 1.96 * generator.standard_normal(len(drawn)))
    return AmplitudeDraws(
        amplitude=at,
        frequency=float(mode.frequency.value[0]) * np.sqrt(drawn[:, 0]),
        damping=drawn[:, 1] / (2 * drawn[:, 0]),
        levels=mode.amplitude,
        modal_mass=masses,
        quantity=mode.quantity,
        smooth_over=_SMOOTH,
        laws=tuple(law.name for law in laws),
        weights=mixture.weights,
        contains=_CONTAINS + (" and the modal mass" if modal_mass_half > 0 else ""),
        name=mode.name,
        findings=(*few_draws(mode, mixture.fitted, mixture.weights), *laws_left_out(mode, share)),
    )


def predict_from_draws(draws: AmplitudeDraws, amplitudes: Sequence[float]) -> AmplitudePrediction:
    """Predict frequency and damping at amplitudes from draws that were kept, without another fit.

    Parameters
    ----------
    draws : AmplitudeDraws
        Draws of the mode.
    amplitudes : sequence of float
        Where to predict, in the SI unit of the draws' quantity.

    Returns
    -------
    AmplitudePrediction
        Medians and 95 % bands, without the parameters of the laws.

    Raises
    ------
    InputError
        If an amplitude lies outside the draws.

    Examples
    --------
    >>> draws = AmplitudeDraws([1.0, 2.0], [[40.0, 39.0]], [[0.01, 0.02]], levels=[1.0, 1.5], modal_mass=[2.0])
    >>> predict_from_draws(draws, [2.0]).frequency.value
    array([39.])
    """
    at = np.asarray(amplitudes, np.float64)
    low, high = float(draws.amplitude[0]), float(draws.amplitude[-1])
    if not len(at) or not np.all((at >= low * (1 - 1e-9)) & (at <= high * (1 + 1e-9))):
        raise InputError(
            "amplitudes outside the draws that were kept",
            where=draws.name or "mode",
            got=", ".join(f"{amplitude:.4g}" for amplitude in at) or "none",
            expected=f"{low:.4g} to {high:.4g} {SI_UNIT[draws.quantity]}",
            advice="predict from the measured levels, or measure further out",
        )
    frequency, damping = at_amplitudes(draws, np.log(at))
    force = None
    if draws.modal_mass is not None:
        force = band(resonance_force(draws, at, frequency, damping), draws.contains)
    return AmplitudePrediction(
        amplitude=at,
        frequency=band(frequency, draws.contains),
        damping=band(damping, draws.contains),
        beyond=at / draws.levels[-1],
        laws=draws.laws,
        weights=np.zeros(0) if draws.weights is None else draws.weights,
        quantity=draws.quantity,
        force=force,
        statement=amplitude_statement(draws.quantity, draws.levels, at),
        name=draws.name,
        findings=draws.findings,
    )


def at_amplitudes(
    draws: AmplitudeDraws, logarithms: Float[np.ndarray, "point"]
) -> tuple[Float[np.ndarray, "draw point"], Float[np.ndarray, "draw point"]]:
    """Frequency [Hz] and damping ratio of every draw at ln amplitudes, by piecewise cubics that do not overshoot
    (Fritsch and Carlson 1980); below the lowest amplitude both are those of it."""
    from scipy.interpolate import PchipInterpolator

    knots = np.log(draws.amplitude)
    within = np.clip(logarithms, knots[0], knots[-1])
    frequency, damping = (
        np.asarray(PchipInterpolator(knots, values.T, axis=0)(within).T) for values in (draws.frequency, draws.damping)
    )
    return frequency, damping


def smoothed(draws: AmplitudeDraws) -> AmplitudeDraws:
    """Draws as smooth as they are to be: of their amplitudes only some carry a draw, the others are interpolated.

    Which ones shifts from draw to draw, so that no amplitude loses more of the spread between levels than others.
    """
    from scipy.interpolate import PchipInterpolator

    knots = np.log(draws.amplitude)
    step = round(draws.smooth_over / float(np.diff(knots).min()))
    if step < 2:
        return draws
    frequency, damping = np.array(draws.frequency), np.array(draws.damping)
    for first in range(step):
        rows = np.unique([0, *range(first, len(knots), step), len(knots) - 1])
        for values in (frequency, damping):
            values[first::step] = PchipInterpolator(knots[rows], values[first::step, rows].T, axis=0)(knots).T
    return replace(draws, frequency=frequency, damping=damping, smooth_over=0.0)


def resonance_force(
    draws: AmplitudeDraws,
    amplitude: Float[np.ndarray, "point"],
    frequency: Float[np.ndarray, "draw point"],
    damping: Float[np.ndarray, "draw point"],
) -> Float[np.ndarray, "draw point"]:
    """Force [N] in quadrature with the response, F = 2 zeta m w_r^2 x."""
    angular = 2 * np.pi * frequency
    x = amplitude / angular ** derivative(draws.quantity)
    return np.asarray(2 * damping * modal_masses(draws)[:, None] * angular**2 * x)


def modal_masses(draws: AmplitudeDraws) -> Float[np.ndarray, "draw"]:
    """Modal masses [kg] of the draws.

    Raises
    ------
    InputError : none is known.
    """
    if draws.modal_mass is None:
        raise InputError(
            "no force without a modal mass",
            where=draws.name or "mode",
            expected="the modal mass for a shape of 1 at the response: force over response of the linear mode",
            advice="give --modal-mass '2 kg' (1 over the modal constant of the FRF from the force to the response), or "
            "levels at constant response, which tell it",
        )
    return draws.modal_mass


def derivative(quantity: str) -> int:
    """How often a displacement is differentiated to become the quantity."""
    return {"displacement": 0, "velocity": 1, "acceleration": 2}[quantity]


def band(values: Float[np.ndarray, "draw *shape"], contains: str) -> Band:
    """Median and 95 % band over the draws; infinite where the draw at that end is."""
    low, value, high = np.quantile(values, [0.025, 0.5, 0.975], axis=0, method="inverted_cdf")
    return Band(np.asarray(low), np.asarray(value), np.asarray(high), 0.95, contains)


def _amplitudes(levels: Float[np.ndarray, "level"]) -> Float[np.ndarray, "point"]:
    """Half the lowest, the lowest, the highest, three times the highest level, and amplitudes between them."""
    ends = (levels[0] / CALIBRATED, levels[0], levels[-1], levels[-1] * REACH)
    apart = max(_APART, float(np.log(ends[-1] / ends[0])) / _MOST)
    parts = [
        np.geomspace(low, high, max(int(np.ceil(np.log(high / low) / apart)), 1) + 1)[:-1]
        for low, high in pairwise(ends)
    ]
    return np.append(np.concatenate(parts), ends[-1])
