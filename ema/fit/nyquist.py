"""Circle fit: a mode as a circle in the Nyquist plane (Kennedy and Pancu 1947; Ewins 2000, section 4.3).

The mobility of a viscously damped mode is a circle whatever its damping, so receptance and accelerance are turned into
mobility first. Other modes move the circle and, if the mode is complex, turn it; neither changes how its lines are
spread over it: an angle ``theta_r - 2 atan((w/w_r - w_r/w) / (2 zeta))`` about the centre.
"""

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, SingleMode
from ema.errors import InputError
from ema.fit.peaks import find_peak, pole_of, receptance, without_decay

_SCATTER = 0.1
"""Relative scatter of the damping over pairs of lines from which on the circle is not that of one linear mode. Its unit
tests pass at half; at twice, noise that the tests add is no longer named."""


def circle_fit(frfs: FrfSet, near: float, output: int = 0, input_: int = 0, bandwidths: float = 1.5) -> SingleMode:
    """Fit one mode to the Nyquist circle of one FRF.

    The natural frequency is where the angle sweeps fastest, read from the arctangent through all angles; the damping is
    the mean over all pairs of a line below and a line above it, weighted by what an error of the angles does to each.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.
    near : float
        Frequency [Hz]; the nearest peak within 5 % is used.
    output, input_ : int, default 0
        Position of the FRF in the set, from 0.
    bandwidths : float, default 1.5
        Lines within this many half-power bandwidths on each side are used, five at least.

    Returns
    -------
    SingleMode
        The mode.

    Raises
    ------
    InputError
        If the FRF cannot be used, or there is no peak near the frequency.

    References
    ----------
    .. [1] Ewins (2000), Modal Testing, 2nd edition, section 4.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> mode = circle_fit(frf_set(), near=40.0)
    >>> round(mode.natural_frequency, 1)
    40.0
    """
    _check_position(frfs, output, input_)
    frfs, values = receptance(frfs.pick([output], [input_]))
    frequencies, where = np.asarray(frfs.frequencies), frfs.name or frfs.label(0, 0)
    peak = find_peak(frequencies, np.abs(values[:, 0, 0]) ** 2, near, where)
    step = float(np.median(np.diff(frequencies)))
    reach = bandwidths * (peak.width if np.isfinite(peak.width) else 2 * step)
    rows = np.flatnonzero(np.abs(frequencies - peak.top) <= reach)
    if len(rows) < 5:
        rows = np.sort(np.argsort(np.abs(frequencies - peak.top))[:5])
    omega = 2 * np.pi * frequencies[rows]
    mobility = 1j * omega * values[rows, 0, 0]
    centre, radius = circle_through(mobility)
    angles = np.unwrap(np.angle(mobility - centre))
    first_guess = max(0.5 * peak.width / peak.top, 1e-6) if np.isfinite(peak.width) else step / peak.top
    resonance, damping, direction = _fastest_sweep(omega, angles, 2 * np.pi * peak.top, first_guess)
    distance = np.sqrt(np.mean((np.abs(mobility - centre) - radius) ** 2)) / radius
    damping_mean, scatter = _damping_of_pairs(omega, angles, resonance, direction)
    findings = _findings(f"{where}, {resonance / 2 / np.pi:.6g} Hz", damping, damping_mean, scatter)
    if not (damping > 0 and damping_mean > 0):
        damping_mean = scatter = float("nan")
    constant = 4 * damping_mean * resonance * radius * np.exp(1j * direction)
    natural = resonance / (2 * np.pi)
    residue = np.full((1, 1), np.nan + 0j)
    if np.isfinite(damping_mean):
        pole = pole_of(natural, damping_mean)
        residue[0, 0] = constant / (2j * pole.imag)
        natural, damping_mean = without_decay(pole, frfs.added_decay)
    return SingleMode(
        "circle fit",
        natural,
        damping_mean,
        residue,
        frfs.outputs,
        frfs.inputs,
        (float(frequencies[rows[0]]), float(frequencies[rows[-1]])),
        len(rows),
        damping_ratio_std=scatter,
        residual=float(distance),
        condition=frfs.condition,
        findings=findings,
        name=frfs.name,
        provenance=frfs.provenance,
    )


def circle_through(points: Complex[np.ndarray, "point"]) -> tuple[complex, float]:
    """Centre and radius of the circle with the least sum of squared distances from the points.

    Starts from Taubin's algebraic circle (1991); Gauss-Newton on the distances takes its bias away.
    """
    mean = points.mean()
    scale = float(np.sqrt(np.mean(np.abs(points - mean) ** 2))) or 1.0
    local = (points - mean) / scale
    square = np.abs(local) ** 2
    table = np.column_stack([(square - square.mean()) / (2 * np.sqrt(square.mean())), local.real, local.imag])
    first, *line = np.linalg.svd(table, full_matrices=False)[2][-1]
    first = first / (2 * np.sqrt(square.mean()))
    if abs(first) < 1e-12:
        # Points on a straight line: a circle that is as good as one.
        first = 1e-12
    centre = -complex(*line) / (2 * first)
    radius = float(np.mean(np.abs(local - centre)))
    for _ in range(20):
        away = local - centre
        size = np.abs(away)
        if np.any(size == 0) or len(points) < 4:
            break
        jacobian = np.column_stack([away.real / size, away.imag / size, np.ones(len(points))])
        move = np.linalg.lstsq(jacobian, size - radius, rcond=None)[0]
        centre, radius = centre + complex(move[0], move[1]), radius + float(move[2])
        if np.max(np.abs(move)) < 1e-13 * radius:
            break
    return complex(mean + scale * centre), abs(scale * radius)


def _fastest_sweep(
    omega: Float[np.ndarray, "line"], angles: Float[np.ndarray, "line"], resonance: float, damping: float
) -> tuple[float, float, float]:
    """Angular frequency of the fastest sweep, damping ratio and angle there, by least squares on the angles."""
    from scipy.optimize import least_squares

    def misfit(unknowns: np.ndarray) -> np.ndarray:
        ratio = omega / (resonance * (1 + damping * unknowns[0]))
        return np.asarray(unknowns[2] - 2 * np.arctan((ratio - 1 / ratio) / (2 * damping * unknowns[1])) - angles)

    direction = float(np.interp(resonance, omega, angles))
    turn = 1.0 if angles[-1] < angles[0] else -1.0
    found = least_squares(misfit, [0.0, turn, direction], x_scale=[1.0, 1.0, 1.0], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    shift, widening, direction = found.x
    return float(resonance * (1 + damping * shift)), float(damping * widening), float(direction)


def _damping_of_pairs(
    omega: Float[np.ndarray, "line"], angles: Float[np.ndarray, "line"], resonance: float, direction: float
) -> tuple[float, float]:
    """Weighted mean of the damping ratio over pairs of lines on both sides of the resonance, and its scatter."""
    ratio = omega / resonance
    tangent = np.tan(np.clip(0.5 * (direction - angles), -1.55, 1.55))
    distance = 0.5 * (ratio - 1 / ratio)
    above, below = np.flatnonzero(omega > resonance), np.flatnonzero(omega < resonance)
    a, b = (grid.ravel() for grid in np.meshgrid(above, below))
    span = tangent[a] - tangent[b]
    usable = np.abs(span) > 1e-9
    a, b, span = a[usable], b[usable], span[usable]
    if not len(span):
        return float("nan"), float("nan")
    values = (distance[a] - distance[b]) / span
    # An error of an angle moves its tangent by (1 + tan^2) / 2: lines far round the circle tell little, and so do pairs
    # close to the resonance, whose tangents hardly differ.
    weights = span**2 / ((1 + tangent[a] ** 2) ** 2 + (1 + tangent[b] ** 2) ** 2)
    mean = float(np.average(values, weights=weights))
    return mean, float(np.sqrt(np.average((values - mean) ** 2, weights=weights)))


def _check_position(frfs: FrfSet, output: int, input_: int) -> None:
    _, outputs, inputs = frfs.values.shape
    if not (0 <= output < outputs and 0 <= input_ < inputs):
        raise InputError(
            "no such FRF in the set",
            where=frfs.name,
            got=f"output {output}, input {input_}",
            expected=f"positions below {outputs} and {inputs}",
        )


def _findings(where: str, damping: float, mean: float, scatter: float) -> tuple[Finding, ...]:
    if damping < 0:
        return (
            Finding(
                "error",
                "conjugate-frf",
                where,
                "The circle is run through anticlockwise.",
                advice="Check the sign of the phase: the FRF may be conjugated.",
            ),
        )
    if not np.isfinite(mean):
        return (
            Finding(
                "warning",
                "unresolved-peak",
                where,
                "No line lies on one side of the resonance.",
                advice="Widen the band or measure a finer frequency step.",
            ),
        )
    if scatter > _SCATTER * mean:
        return (
            Finding.of(
                "warning",
                "damping-scatter",
                where,
                "The damping of pairs of lines scatters by {scatter} % about its mean.",
                scatter / mean,
                _SCATTER,
                advice="Look for noise, leakage, a close mode or a nonlinearity.",
                scatter=f"{100 * scatter / mean:.0f}",
            ),
        )
    return ()
