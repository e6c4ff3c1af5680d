"""What a mode does under forces that were not measured: force surface, resonances and responses, with 95 % bands."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.compare.amplitude_prediction import amplitude_statement
from ema.compare.mode_synthesis import DISTINCT, Curves
from ema.compare.predictive_draws import (
    CALIBRATED,
    at_amplitudes,
    band,
    derivative,
    modal_masses,
    predict_from_draws,
    resonance_force,
    smoothed,
)
from ema.data import AmplitudeDraws, Band, Finding, ForcedResonances, ForcedResponse, ForceSurface
from ema.errors import InputError
from ema.units import SI_UNIT

_FINE = 480
"""Amplitudes between which resonances are read, geometric over the draws: neighbours are half to one per cent apart."""
_LINES = 201
"""Lines of a response whose frequencies are not given."""
_WIDTHS = 6.0
"""Half bandwidths zeta f beyond the resonances that such lines cover: a linear response has fallen to a sixth there."""
_SEVERAL = 0.05
"""Share of the draws from which on it is said that they have several resonances, or responses, at a force."""
_CUT = 0.025
"""Share of the draws that may end below a resonance: from there on the end of a 95 % band is not known."""


def force_surface(
    draws: AmplitudeDraws,
    frequencies: Sequence[float] | Float[np.ndarray, "line"] | None = None,
    amplitudes: Sequence[float] | Float[np.ndarray, "point"] | None = None,
) -> ForceSurface:
    """Force that keeps up amplitudes of a response at frequencies, with 95 % bands.

    Parameters
    ----------
    draws : AmplitudeDraws
        Draws of the mode, with its modal mass.
    frequencies : sequence of float, optional
        Excitation frequencies [Hz], rising; by default about the resonances of the amplitudes.
    amplitudes : sequence of float, optional
        Amplitudes of the response in the SI unit of the draws' quantity, rising; by default 41 from the lowest to twice
        the highest measured level.

    Returns
    -------
    ForceSurface
        Medians and 95 % bands.

    Raises
    ------
    InputError
        If no modal mass is known, or an amplitude lies outside the draws.

    References
    ----------
    .. [1] Karaagacli and Ozguven (2021), Mechanical Systems and Signal Processing 149:107202.

    Examples
    --------
    >>> draws = AmplitudeDraws([1.0, 9.0], [[40.0, 40.0]], [[0.01, 0.01]], levels=[1.0, 4.0], modal_mass=[2.0])
    >>> force_surface(draws, [40.0], [3.0]).force.value.round(3)  # 2 zeta m a
    array([[0.12]])
    """
    masses, draws = modal_masses(draws), smoothed(draws)
    top, bottom = float(draws.levels[-1]), float(draws.levels[0])
    at = np.geomspace(bottom, CALIBRATED * top, 41) if amplitudes is None else np.asarray(amplitudes, np.float64)
    resonances = predict_from_draws(draws, at.tolist())
    lines = _lines(resonances.frequency.value, resonances.damping.value) if frequencies is None else frequencies
    angular, power = 2 * np.pi * np.asarray(lines, np.float64), derivative(draws.quantity)
    curves = Curves.of(draws)
    rows = []
    for amplitude in at:
        x = amplitude / angular**power
        w2, c = curves.at(x)
        rows.append(band(masses[:, None] * x * np.abs(w2 - angular**2 + 1j * c * angular), draws.contains))
    low, value, high = (np.array([getattr(row, end) for row in rows]) for end in ("low", "value", "high"))
    return ForceSurface(
        frequencies=angular / (2 * np.pi),
        amplitude=at,
        force=Band(low, value, high, 0.95, draws.contains),
        beyond=at / top,
        quantity=draws.quantity,
        statement=amplitude_statement(draws.quantity, draws.levels, at),
        name=draws.name,
        findings=draws.findings,
    )


def forced_resonances(draws: AmplitudeDraws, forces: Sequence[float]) -> ForcedResonances:
    """Amplitude, frequency and damping at phase resonance under forces, with 95 % bands.

    Parameters
    ----------
    draws : AmplitudeDraws
        Draws of the mode, with its modal mass.
    forces : sequence of float
        Amplitudes of the force [N].

    Returns
    -------
    ForcedResonances
        Medians and 95 % bands, and how far outside the measured levels they lie.

    Raises
    ------
    InputError
        If no modal mass is known, a force is not positive, or the median resonance lies below half the lowest or beyond
        twice the highest level.

    References
    ----------
    .. [1] Kerschen, Peeters, Golinval and Vakakis (2009), Mechanical Systems and Signal Processing 23:170.
    .. [2] Krack (2015), Computers and Structures 154:59.

    Examples
    --------
    >>> draws = AmplitudeDraws([1.0, 9.0], [[40.0, 40.0]], [[0.01, 0.01]], levels=[1.0, 4.0], modal_mass=[2.0])
    >>> forced_resonances(draws, [0.12]).amplitude.value.round(3)
    array([3.])
    """
    given, draws = _forces(draws, forces), smoothed(draws)
    logs = np.linspace(np.log(draws.amplitude[0]), np.log(draws.amplitude[-1]), _FINE)
    frequency, damping = at_amplitudes(draws, logs)
    needed = np.log(resonance_force(draws, np.exp(logs), frequency, damping))
    read = [_crossing(needed, float(np.log(force)), logs, (frequency, damping)) for force in given]
    top = float(draws.levels[-1])
    _check_range(draws, given, [one.amplitude for one in read], needed, logs)
    amplitude = _stacked([band(one.amplitude, draws.contains) for one in read])
    frequencies, dampings = (
        _stacked([_known(one.values[n], one.amplitude, draws.contains) for one in read]) for n in (0, 1)
    )
    several = np.array([one.several for one in read])
    beyond = np.array([float(np.mean(np.isinf(one.amplitude))) for one in read])
    return ForcedResonances(
        force=given,
        amplitude=amplitude,
        frequency=frequencies,
        damping=dampings,
        beyond=amplitude.value / top,
        several=several,
        quantity=draws.quantity,
        statement=amplitude_statement(draws.quantity, draws.levels, amplitude.value, "resonances"),
        name=draws.name,
        findings=(*draws.findings, *_several_resonances(draws, given, several), *_cut_off(draws, given, beyond)),
    )


def forced_response(
    draws: AmplitudeDraws,
    force: float | Sequence[float] | Float[np.ndarray, "line"],
    frequencies: Sequence[float] | Float[np.ndarray, "line"] | None = None,
) -> ForcedResponse:
    """Response to a force over the frequency, swept up and down, with 95 % bands.

    Parameters
    ----------
    draws : AmplitudeDraws
        Draws of the mode, with its modal mass.
    force : float or sequence of float
        Amplitude of the force [N], constant or as it was measured at each frequency.
    frequencies : sequence of float, optional
        Excitation frequencies [Hz], rising; by default 201 about the resonance at a constant force.

    Returns
    -------
    ForcedResponse
        Bands of both sweeps, and for a constant force all responses of the medians.

    Raises
    ------
    InputError
        If no modal mass is known, a force is not positive, or there are not as many forces as frequencies.

    References
    ----------
    .. [1] Szemplinska-Stupnicka (1979), Journal of Sound and Vibration 63:475.
    .. [2] Krack (2015), Computers and Structures 154:59.

    Examples
    --------
    >>> draws = AmplitudeDraws([1.0, 9.0], [[40.0, 40.0]], [[0.01, 0.01]], levels=[1.0, 4.0], modal_mass=[2.0])
    >>> forced_response(draws, 0.12, [40.0]).up.value.round(2)
    array([3.])
    """
    draws = smoothed(draws)
    forces = _forces(draws, np.atleast_1d(np.asarray(force, np.float64)).tolist())
    if frequencies is None:
        if len(forces) != 1:
            raise InputError(
                "forces without their frequencies", where=draws.name or "mode", expected="one frequency for each force"
            )
        resonance = forced_resonances(draws, forces.tolist())
        to = np.linspace(np.log(draws.amplitude[0]), np.log(float(resonance.amplitude.value[0])), 20)
        f, zeta = at_amplitudes(draws, to)
        lines = _lines(np.quantile(f, [0.025, 0.5, 0.975], axis=0).ravel(), np.median(zeta, axis=0))
    else:
        lines = np.asarray(frequencies, np.float64)
    if len(forces) not in (1, len(lines)):
        raise InputError(
            "not as many forces as frequencies",
            where=draws.name or "mode",
            got=f"{len(forces)} forces and {len(lines)} frequencies",
            expected="one force, or one for each frequency",
        )
    along = np.broadcast_to(forces, lines.shape) if len(forces) == 1 else forces
    angular = 2 * np.pi * lines
    # no response is smaller than a quarter of F / (m w^2), with the higher of resonance and excitation for w
    fastest = max(2 * np.pi * float(draws.frequency.max()), float(angular.max()))
    curves = Curves.of(draws, lowest=float(along.min() / modal_masses(draws).max()) / fastest**2 / 4)
    up, phase_up, folded = curves.sweep(angular, along)
    down, phase_down, _ = curves.sweep(angular[::-1], along[::-1])
    middle = curves.median()
    curve = middle.cut(float(forces[0])) if len(forces) == 1 else np.zeros((2, 0))
    contains, power = draws.contains, derivative(draws.quantity)
    said = () if folded < _SEVERAL else (_folds(draws, forces, folded),)
    return ForcedResponse(
        frequencies=lines,
        force=along,
        up=band(up * angular**power, contains),
        down=band(down[:, ::-1] * angular**power, contains),
        phase_up=band(phase_up + power * np.pi / 2, contains),
        phase_down=band(phase_down[:, ::-1] + power * np.pi / 2, contains),
        solutions=middle.solutions(angular, along),
        curve_frequencies=curve[0] / (2 * np.pi),
        curve_amplitudes=curve[1] * curve[0] ** power,
        folded=folded,
        highest_level=float(draws.levels[-1]),
        quantity=draws.quantity,
        name=draws.name,
        findings=(*draws.findings, *said),
    )


@dataclass(frozen=True)
class _Reading:
    """At a force: amplitude of every draw, infinite beyond its range, what is read there, and the share of draws with
    several resonances."""

    amplitude: Float[np.ndarray, "draw"]
    values: tuple[Float[np.ndarray, "draw"], ...]
    several: float


def _crossing(
    needed: Float[np.ndarray, "draw fine"],
    force: float,
    logs: Float[np.ndarray, "fine"],
    curves: Sequence[Float[np.ndarray, "draw fine"]],
) -> _Reading:
    """The lowest amplitude from which on a force does not suffice; 0 where the draws begin above it."""
    off = needed - force
    rises = (off[:, :-1] < 0) & (off[:, 1:] >= 0)
    rows = np.arange(len(off))
    first = np.argmax(rises, axis=1)
    under, over = off[:, 0] >= 0, ~rises.any(axis=1) & (off[:, 0] < 0)
    ends = off[rows, first], off[rows, first + 1]
    share = np.clip(-ends[0] / np.where(rises.any(axis=1), ends[1] - ends[0], 1.0), 0, 1)
    share = np.where(under, 0.0, share)
    first = np.where(under, 0, np.where(over, len(logs) - 2, first))
    amplitude = np.exp(logs[first] + share * (logs[first + 1] - logs[first]))
    amplitude = np.where(under, 0.0, np.where(over, np.inf, amplitude))
    values = tuple(v[rows, first] + share * (v[rows, first + 1] - v[rows, first]) for v in curves)
    last = len(logs) - 2 - rises[:, ::-1].argmax(axis=1)
    apart = rises.any(axis=1) & (logs[last] - logs[np.where(under, 0, first)] > DISTINCT)
    return _Reading(amplitude, values, float(np.mean(apart)))


def _known(values: Float[np.ndarray, "draw"], amplitude: Float[np.ndarray, "draw"], contains: str) -> Band:
    """The band of what is read at a resonance; without bounds where too many draws end below it."""
    within = np.isfinite(amplitude) & (amplitude > 0)
    if not within.any():
        return Band(np.array(np.nan), np.array(np.nan), np.array(np.nan), 0.95, contains)
    known = band(values[within], contains)
    if within.mean() >= 1 - _CUT:
        return known
    return Band(np.array(-np.inf), known.value, np.array(np.inf), 0.95, contains)


def _stacked(bands: Sequence[Band]) -> Band:
    """Bands of single values as one."""
    low, value, high = (np.array([getattr(one, end) for one in bands], np.float64) for end in ("low", "value", "high"))
    return Band(low, value, high, bands[0].level, bands[0].contains)


def _lines(frequency: Float[np.ndarray, "one"], damping: Float[np.ndarray, "other"]) -> Float[np.ndarray, "line"]:
    """Lines about resonances."""
    width = _WIDTHS * float(np.max(damping)) * float(np.max(frequency))
    low, high = float(np.min(frequency)) - width, float(np.max(frequency)) + width
    return np.linspace(max(low, 0.2 * high), high, _LINES)


def _forces(draws: AmplitudeDraws, forces: Sequence[float]) -> Float[np.ndarray, "force"]:
    """The forces, each a number above 0."""
    modal_masses(draws)
    given = np.asarray(forces, np.float64)
    if not len(given) or not np.all(np.isfinite(given) & (given > 0)):
        raise InputError(
            "not a force to predict at", where=draws.name or "mode", got=given.tolist(), expected="above 0 N"
        )
    return given


def _check_range(
    draws: AmplitudeDraws,
    forces: Float[np.ndarray, "force"],
    amplitudes: Sequence[Float[np.ndarray, "draw"]],
    needed: Float[np.ndarray, "draw fine"],
    logs: Float[np.ndarray, "fine"],
) -> None:
    """Refuse a force whose resonance lies outside the amplitudes for which bands were calibrated."""
    unit, top, bottom = SI_UNIT[draws.quantity], CALIBRATED * draws.levels[-1], draws.levels[0] / CALIBRATED
    for force, amplitude in zip(forces, amplitudes, strict=True):
        middle = float(np.quantile(amplitude, 0.5, method="inverted_cdf"))
        if bottom * (1 - 1e-9) <= middle <= top * (1 + 1e-9):
            continue
        ends = [float(np.exp(np.median(needed[:, np.argmin(np.abs(logs - np.log(end)))]))) for end in (bottom, top)]
        raise InputError(
            "no amplitude within the range of the prediction resonates at this force",
            where=draws.name or "mode",
            got=f"{force:.4g} N",
            expected=f"a force from {ends[0]:.3g} N (resonance at {bottom:.3g} {unit}, half the lowest level) to "
            f"{ends[1]:.3g} N (at {top:.3g} {unit}, twice the highest level)",
            advice="measure levels nearer to it",
        )


def _several_resonances(
    draws: AmplitudeDraws, forces: Float[np.ndarray, "force"], several: Float[np.ndarray, "force"]
) -> list[Finding]:
    return [
        Finding.of(
            "warning",
            "several-resonances",
            draws.name,
            "at {force} N {share} of the draws resonate at several amplitudes.",
            float(share),
            _SEVERAL,
            advice="The lowest is stated, which a force that grows from nothing reaches; others need a push.",
            force=f"{force:.4g}",
            share=f"{share:.0%}",
        )
        for force, share in zip(forces, several, strict=True)
        if share >= _SEVERAL
    ]


def _cut_off(
    draws: AmplitudeDraws, forces: Float[np.ndarray, "force"], beyond: Float[np.ndarray, "force"]
) -> list[Finding]:
    return [
        Finding.of(
            "warning",
            "band-without-end",
            draws.name,
            "at {force} N {share} of the draws resonate beyond {top} {unit}, where they end: the band is open above.",
            float(share),
            _CUT,
            advice="Measure a level nearer to this force.",
            force=f"{force:.4g}",
            share=f"{share:.0%}",
            top=f"{draws.amplitude[-1]:.3g}",
            unit=SI_UNIT[draws.quantity],
        )
        for force, share in zip(forces, beyond, strict=True)
        if share >= _CUT
    ]


def _folds(draws: AmplitudeDraws, forces: Float[np.ndarray, "force"], folded: float) -> Finding:
    return Finding.of(
        "warning",
        "folded-response",
        draws.name,
        "at {force} N {share} of the draws have several responses at one frequency: the response jumps.",
        folded,
        _SEVERAL,
        advice="Sweeping up and down differ there; a test at constant response goes through.",
        force=f"{forces[0]:.4g}" if len(forces) == 1 else f"{forces.min():.3g} to {forces.max():.3g}",
        share=f"{folded:.0%}",
    )
