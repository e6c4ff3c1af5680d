"""Local fit: one mode and a straight residual over a few bandwidths, common to all FRFs.

Made for modes whose frequency and damping depend on amplitude: the narrower the band, the nearer to the one amplitude
at the peak. What a linear mode leaves unexplained measures the nonlinearity, and the height of the peak gives a second
damping, which holds at resonance whatever the shape of the flanks.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float, Inexact, Int

from ema.data import Finding, FrfSet, SingleMode
from ema.errors import InputError
from ema.fit.peaks import FEWEST, Peak, find_peak, half_power, pole_of, receptance, without_decay
from ema.units import DERIVATIVE_ORDER

_MISFIT = 0.05
"""Residual, as norm over the norm of the FRFs around the peak, above which a linear mode does not describe it: noise 26
dB below the peak, or as much misfit. It only decides whether a finding names it; its unit tests pass at half and at
twice."""

_SETTLED = 1e-9
"""Step of the pole, in half bandwidths, that no longer matters: smaller ones are rounding, at which the cost no longer
falls either."""


@dataclass(frozen=True)
class _Fit:
    """State of the least squares: ``cost`` is the residual energy, ``normal`` and ``gradient`` belong to real and
    imaginary part of the pole; ``scatter`` is the covariance of ``gradient``, by the residual of each FRF.
    """

    pole: complex
    residues: Complex[np.ndarray, "frf"]
    cost: float
    normal: Float[np.ndarray, "2 2"]
    gradient: Float[np.ndarray, "2"]
    scatter: Float[np.ndarray, "2 2"]


def local_fit(
    frfs: FrfSet,
    near: float,
    bandwidths: float = 1.5,
    modal_constants: Inexact[np.ndarray, "out in"] | None = None,
) -> SingleMode:
    """Fit one mode with linear residual terms, by least squares over a few half-power bandwidths of all FRFs at once.

    ``H = s^q [R / (s - p) + conj(R) / (s - conj(p))] + a + b w`` with one pole, and R, a and b for each FRF. FRFs with
    a known variance are weighted by it.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.
    near : float
        Frequency [Hz]; the nearest peak within 5 % is used.
    bandwidths : float, default 1.5
        Half width of the fitted band in half-power bandwidths; it is widened to seven lines where it holds fewer, and a
        finding says so.
    modal_constants : Inexact, optional
        ``2j w_d R`` [1/kg] of each FRF, from a test at low level or of the structure without a beam
        (``SingleMode.modal_constants``): gives ``quadrature_damping``, ``A / (2 w_r^2 |X/F|)`` at the top of the peak.

    Returns
    -------
    SingleMode
        The mode.

    Raises
    ------
    InputError
        If the FRFs cannot be used, there is no peak near the frequency, or the modal constants do not fit.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> mode = local_fit(frf_set(), near=60.0)
    >>> round(mode.natural_frequency, 2), round(mode.damping_ratio, 4)
    (60.0, 0.008)
    """
    if not bandwidths > 0:
        raise InputError("no band to fit", where=frfs.name, got=f"{bandwidths} bandwidths", expected="more than 0")
    frfs, values = receptance(frfs)
    frequencies, where = np.asarray(frfs.frequencies), frfs.name or "FRFs"
    peak = find_peak(frequencies, np.sum(np.abs(values) ** 2, axis=(1, 2)), near, where)
    fit, rows, energy, enough = _settle(frfs, _first_pole(peak, frequencies), bandwidths)
    natural, damping = without_decay(fit.pole, frfs.added_decay)
    std = _deviations(fit, frfs.added_decay)
    residual = float(np.sqrt(fit.cost / energy))
    quadrature = float("nan")
    if modal_constants is not None:
        quadrature = _quadrature(frfs, values, np.asarray(modal_constants), near, where)
    return SingleMode(
        "local fit",
        natural,
        damping,
        fit.residues.reshape(values.shape[1:]),
        frfs.outputs,
        frfs.inputs,
        (float(frequencies[rows[0]]), float(frequencies[rows[-1]])),
        len(rows),
        std[0],
        std[1],
        residual,
        quadrature,
        frfs.condition,
        _findings(f"{where}, {natural:.6g} Hz", residual, enough),
        frfs.name,
        frfs.provenance,
    )


def _first_pole(peak: Peak, frequencies: Float[np.ndarray, "freq"]) -> complex:
    if not peak.trouble and peak.inside >= 3:
        damping, natural = half_power(peak)
    else:
        step = float(np.median(np.diff(frequencies)))
        width = peak.width if np.isfinite(peak.width) else step
        damping, natural = max(width, 0.5 * step) / (2 * peak.top), peak.top
    return pole_of(natural, min(damping, 0.5))


def _settle(frfs: FrfSet, pole: complex, bandwidths: float) -> tuple[_Fit, Int[np.ndarray, "line"], float, bool]:
    """Fit over a band that follows the pole; also its lines, the energy of the data, whether the band held enough."""
    frequencies = np.asarray(frfs.frequencies)
    flat = np.asarray(frfs.values).reshape(len(frequencies), -1) * _weights(frfs)
    rows, enough = _window(frequencies, pole, bandwidths)
    for _ in range(6):
        part = flat[rows]
        fit = _refine(2j * np.pi * frequencies[rows], part, DERIVATIVE_ORDER[frfs.quantity], pole)
        again, enough = _window(frequencies, fit.pole, bandwidths)
        if np.array_equal(again, rows):
            break
        rows, pole = again, fit.pole
    fitted = _refine(2j * np.pi * frequencies[rows], flat[rows], DERIVATIVE_ORDER[frfs.quantity], fit.pole)
    fitted = replace(fitted, residues=fitted.residues / _weights(frfs))
    return fitted, rows, float(np.sum(np.abs(flat[rows]) ** 2)), enough


def _window(
    frequencies: Float[np.ndarray, "freq"], pole: complex, bandwidths: float
) -> tuple[Int[np.ndarray, "line"], bool]:
    """Lines within the bandwidths of a pole, seven at least, and whether there were as many."""
    centre = abs(pole) / (2 * np.pi)
    rows = np.flatnonzero(np.abs(frequencies - centre) <= bandwidths * abs(pole.real) / np.pi)
    if len(rows) >= FEWEST:
        return rows, True
    return np.sort(np.argsort(np.abs(frequencies - centre), kind="stable")[:FEWEST]), False


def _weights(frfs: FrfSet) -> Float[np.ndarray, "frf"]:
    """One over the typical standard deviation of each FRF, where all are known; relative to their mean."""
    count = frfs.values.shape[1] * frfs.values.shape[2]
    if frfs.variance is None:
        return np.ones(count)
    std = np.sqrt(np.median(frfs.variance, axis=0)).ravel()
    return std.mean() / std if np.all(np.isfinite(std)) and np.all(std > 0) else np.ones(count)


def _refine(
    s: Complex[np.ndarray, "line"], values: Complex[np.ndarray, "line frf"], derivative: int, pole: complex
) -> _Fit:
    """Gauss-Newton with Levenberg-Marquardt damping on the pole; everything else is linear and eliminated."""
    state, damping = _evaluate(s, values, derivative, pole), 0.0
    narrowest = 0.05 * float(np.median(np.diff(s.imag)))
    for _ in range(50):
        matrix = state.normal + damping * np.diag(np.diag(state.normal))
        if not np.linalg.cond(matrix) < 1e15:
            break
        move = complex(*np.linalg.solve(matrix, state.gradient))
        if abs(move) < _SETTLED * abs(state.pole.real):
            break
        move *= min(1.0, abs(state.pole.real) / abs(move))
        moved = state.pole + move
        trial = _evaluate(s, values, derivative, complex(min(moved.real, -narrowest), moved.imag))
        if not trial.cost < state.cost:
            damping = max(10 * damping, 1e-3)
            if damping > 1e6:
                break
            continue
        state, damping = trial, 0.1 * damping if damping > 1e-6 else 0.0
    return state


def _evaluate(
    s: Complex[np.ndarray, "line"], values: Complex[np.ndarray, "line frf"], derivative: int, pole: complex
) -> _Fit:
    """Least squares for residues and residual terms at a pole, and the normal equations of the pole (Kaufman 1975)."""
    factor = s**derivative
    direct, mirrored = factor / (s - pole), factor / (s - np.conj(pole))
    place = (s.imag - s.imag.mean()) / np.ptp(s.imag)
    one = np.ones(len(s))
    scale = float(np.abs(direct).max())
    basis = np.stack([(direct + mirrored) / scale, 1j * (direct - mirrored) / scale, one, 1j * one, place, 1j * place])
    orthogonal, triangle = np.linalg.qr(_real(basis.T))
    data = _real(values)
    share = orthogonal.T @ data
    rest = data - orthogonal @ share
    unknowns = np.linalg.solve(triangle, share)
    residues = (unknowns[0] + 1j * unknowns[1]) / scale
    slopes = []
    for turn in (1, 1j):
        change = np.outer(direct / (s - pole), turn * residues)
        change += np.outer(mirrored / (s - np.conj(pole)), np.conj(turn * residues))
        slope = _real(change)
        slopes.append(slope - orthogonal @ (orthogonal.T @ slope))
    jacobian = np.stack(slopes)
    by_frf = np.einsum("alf,blf->fab", jacobian, jacobian)
    energy = np.sum(rest**2, axis=0)
    # FRFs differ in their noise, so each is judged by its own residual (White 1980)
    freedom = max(len(data) - len(basis) - 2 / len(energy), 1.0)
    return _Fit(
        pole,
        residues,
        float(energy.sum()),
        by_frf.sum(axis=0),
        np.einsum("alf,lf->a", jacobian, rest),
        np.einsum("fab,f->ab", by_frf, energy / freedom),
    )


def _real(columns: Complex[np.ndarray, "line column"]) -> Float[np.ndarray, "row column"]:
    return np.concatenate([columns.real, columns.imag])


def _deviations(fit: _Fit, added_decay: float) -> tuple[float, float]:
    """Standard deviations of natural frequency (Hz) and damping ratio from the residual."""
    pole = fit.pole + added_decay
    size = abs(pole)
    inverse = np.linalg.pinv(fit.normal, hermitian=True)
    covariance = inverse @ fit.scatter @ inverse
    to_frequency = np.array([pole.real, pole.imag]) / (2 * np.pi * size)
    to_damping = np.array([-(pole.imag**2), pole.real * pole.imag]) / size**3
    frequency, damping = (float(np.sqrt(slope @ covariance @ slope)) for slope in (to_frequency, to_damping))
    return frequency, damping


def _quadrature(
    frfs: FrfSet,
    values: Complex[np.ndarray, "freq out in"],
    constants: Inexact[np.ndarray, "*shape"],
    near: float,
    where: str,
) -> float:
    """Damping ratio from the height of the peak of all FRFs, seen through their modal constants."""
    if constants.shape != values.shape[1:] or not np.all(np.isfinite(constants)) or not np.any(constants):
        raise InputError(
            "the modal constants do not fit the FRFs",
            where=where,
            got=f"shape {constants.shape}",
            expected=f"finite numbers of shape {values.shape[1:]}, not all 0",
        )
    modal = np.einsum("koi,oi->k", values, constants.conj()) / np.sum(np.abs(constants) ** 2)
    peak = find_peak(np.asarray(frfs.frequencies), np.abs(modal) ** 2, near, where)
    # zeta = A / (2 w_r^2 |X/F|) for light damping; exact with zeta = sin(a): the top is 1 / sin 2a over w_r^2.
    double = np.arctan(1 / ((2 * np.pi * peak.top) ** 2 * np.sqrt(peak.power)))
    natural, damping = peak.top / np.sqrt(np.cos(double)), np.sin(0.5 * double)
    return without_decay(pole_of(natural, damping), frfs.added_decay)[1]


def _findings(where: str, residual: float, enough: bool) -> tuple[Finding, ...]:
    found = []
    if not enough:
        found.append(
            Finding.of(
                "warning",
                "few-lines",
                where,
                "The band was widened to {fewest} lines around the peak.",
                advice="Measure with a finer frequency step.",
                fewest=FEWEST,
            )
        )
    if residual > _MISFIT:
        found.append(
            Finding.of(
                "warning",
                "misfit",
                where,
                "A linear mode leaves {residual} % of the FRFs unexplained.",
                residual,
                _MISFIT,
                advice="Nonlinearity, noise or a close mode: compare levels, and look at the quadrature damping.",
                residual=f"{100 * residual:.1f}",
            )
        )
    return tuple(found)
