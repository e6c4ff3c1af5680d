"""Peak picking: the natural frequency from the top of a peak, the damping from its width 3 dB below.

The inverse power 1/|H|^2 of the receptance of a single mode is a parabola in w^2 at any damping. So parabolas through
the lines around the top and around the half-power points interpolate without error, where other modes are far.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Finding, FrfSet, SingleMode, damping_ratios, natural_frequencies, poles_from
from ema.errors import InputError
from ema.fit.prepare import prepare
from ema.units import DERIVATIVE_ORDER

FEWEST = 7
"""Frequency lines below which there is no neighbourhood of a peak: three on either side of its top."""

_REACH = 0.05
"""Largest relative distance of a peak from the wanted frequency: damping of 20 % moves the top of a peak by 4 %."""

_PROMINENCE = 1.0
"""Height in dB of a peak over its surroundings, below which it is a wiggle: 12 % in amplitude. Its unit tests pass at
0.5 and at 2 dB."""

_LEANING = 1.5
"""Ratio of the two halves of the half-power bandwidth from which on a neighbour or a nonlinearity bends the peak.
Receptances of one linear mode have 1.11 at a damping ratio of 10 % and 1.25 at 20 % (closed form)."""


@dataclass(frozen=True)
class Peak:
    """Top of a peak: ``line`` of its highest value, top and half-power points in Hz (NaN where there is none), power.

    ``inside`` counts the lines between the half-power points; ``trouble`` says why a half-power point is missing.
    """

    line: int
    top: float
    power: float
    low: float
    high: float
    inside: int
    trouble: str

    @property
    def width(self) -> float:
        """Half-power bandwidth in Hz, twice the half that is there if the other is missing."""
        halves = [half for half in (self.top - self.low, self.high - self.top) if np.isfinite(half)]
        return 2 * float(np.mean(halves)) if halves else float("nan")


def receptance(frfs: FrfSet) -> tuple[FrfSet, Complex[np.ndarray, "freq out in"]]:
    """The lines above 0 Hz, checked, and their values as receptance (an unstated response counts as acceleration).

    Raises
    ------
    InputError : what `prepare` refuses.
    """
    prepare(frfs, fewest=FEWEST)
    frfs = frfs.lines(frfs.frequencies > 0)
    s = 2j * np.pi * np.asarray(frfs.frequencies)
    return frfs, frfs.values / (s ** DERIVATIVE_ORDER[frfs.quantity])[:, None, None]


def peak_picking(
    frfs: FrfSet, near: Sequence[float], indicator: Literal["sum", "cmif"] = "sum"
) -> tuple[SingleMode, ...]:
    """Read natural frequencies and half-power damping from the peaks nearest to given frequencies.

    The interpolation and the relation between width and damping are exact for one viscously damped mode.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.
    near : sequence of float
        Frequencies [Hz]; each takes the nearest peak within 5 %.
    indicator : {"sum", "cmif"}, default "sum"
        The sum of the squared receptances of all FRFs, or their largest squared singular value.

    Returns
    -------
    tuple of SingleMode
        One mode per frequency.

    Raises
    ------
    InputError
        If the FRFs cannot be used, or there is no peak near a frequency.

    References
    ----------
    .. [1] Ewins (2000), Modal Testing, 2nd edition, section 4.2.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> [round(mode.natural_frequency) for mode in peak_picking(frf_set(), near=[40.0, 90.0])]
    [40, 90]
    """
    frfs, values = receptance(frfs)
    if indicator == "cmif":
        power = np.linalg.svd(values, compute_uv=False)[:, 0] ** 2
    else:
        power = np.sum(np.abs(values) ** 2, axis=(1, 2))
    return tuple(_pick(frfs, values, power, float(wanted)) for wanted in near)


def _pick(
    frfs: FrfSet, values: Complex[np.ndarray, "freq out in"], power: Float[np.ndarray, "freq"], near: float
) -> SingleMode:
    frequencies, where = np.asarray(frfs.frequencies), frfs.name or "FRFs"
    peak = find_peak(frequencies, power, near, where)
    place = f"{where}, {peak.top:.6g} Hz"
    findings = []
    trouble = peak.trouble
    if not trouble and peak.inside < 3:
        trouble = f"Only {peak.inside} frequency lines lie within its half-power bandwidth."
    if trouble:
        findings.append(
            Finding(
                "warning",
                "unresolved-peak",
                place,
                f"Half-power damping cannot be told: {trouble}",
                value=float(peak.inside),
                limit=3.0,
                advice="Use a fit of the whole band, or a finer frequency step.",
            )
        )
    else:
        halves = peak.top - peak.low, peak.high - peak.top
        leaning = max(halves) / min(halves)
        if leaning > _LEANING:
            findings.append(
                Finding.of(
                    "warning",
                    "leaning-peak",
                    place,
                    "One half of the peak is {times} times as wide as the other.",
                    leaning,
                    _LEANING,
                    advice="Look for a close mode or a nonlinearity; half-power damping holds for neither.",
                    times=f"{leaning:.2g}",
                )
            )
    damping, natural = float("nan"), peak.top
    residues = np.full(values.shape[1:], np.nan + 0j)
    if not trouble:
        damping, natural = half_power(peak)
        pole = pole_of(natural, damping)
        # At the top line the other term of the mode and everything else is small: quadrature.
        s = 2j * np.pi * frequencies[peak.line]
        residues = values[peak.line] * (s - pole)
        natural, damping = without_decay(pole, frfs.added_decay)
    low, high = (edge if np.isfinite(edge) else peak.top for edge in (peak.low, peak.high))
    return SingleMode(
        "peak picking",
        natural,
        damping,
        residues,
        frfs.outputs,
        frfs.inputs,
        (float(low), float(high)),
        peak.inside,
        condition=frfs.condition,
        findings=tuple(findings),
        name=frfs.name,
        provenance=frfs.provenance,
    )


def half_power(peak: Peak) -> tuple[float, float]:
    """Damping ratio and natural frequency (Hz) of a receptance peak from its half-power points.

    With zeta = sin(a) the points lie at ``w_r^2 (cos 2a -+ sin 2a)`` and the top at ``w_r^2 cos 2a``.
    """
    double = np.arctan(0.5 * (peak.high**2 - peak.low**2) / peak.top**2)
    return float(np.sin(0.5 * double)), float(peak.top / np.sqrt(np.cos(double)))


def without_decay(pole: complex, added_decay: float) -> tuple[float, float]:
    """Natural frequency in Hz and damping ratio of a pole, after the decay that a window added is taken off."""
    corrected = np.array([pole + added_decay])
    return float(natural_frequencies(corrected)[0]), float(damping_ratios(corrected)[0])


def pole_of(natural_frequency: float, damping_ratio: float) -> complex:
    """Pole in rad/s of a natural frequency in Hz and a damping ratio."""
    return complex(poles_from(np.array([natural_frequency]), np.array([damping_ratio]))[0])


def find_peak(
    frequencies: Float[np.ndarray, "freq"], power: Float[np.ndarray, "freq"], near: float, where: str
) -> Peak:
    """The peak of a power nearest to a frequency (Hz), at most 5 % away.

    Raises
    ------
    InputError : the frequency is outside the axis, or there is no peak near it.
    """
    from scipy.signal import find_peaks

    if not frequencies[0] <= near <= frequencies[-1]:
        raise InputError(
            "the wanted frequency is outside the FRFs",
            where=where,
            got=f"{near:g} Hz",
            expected=f"{frequencies[0]:g} to {frequencies[-1]:g} Hz",
        )
    level = 10 * np.log10(np.maximum(power, np.finfo(float).tiny))
    peaks = find_peaks(level, prominence=_PROMINENCE)[0]
    line = float(np.median(np.diff(frequencies)))
    # a peak lies within half a line of its highest one
    reach = max(_REACH * near + 0.5 * line, 3 * line)
    distance = np.abs(frequencies[peaks] - near)
    if not len(peaks) or distance.min() > reach:
        nearest = f"; the nearest is at {frequencies[peaks[np.argmin(distance)]]:.6g} Hz" if len(peaks) else ""
        raise InputError(
            "no peak near the wanted frequency",
            where=where,
            got=f"{near:g} Hz",
            expected=f"a peak of {_PROMINENCE:g} dB within {reach:.3g} Hz{nearest}",
        )
    return _measure(frequencies, power, int(peaks[np.argmin(distance)]))


def _measure(frequencies: Float[np.ndarray, "freq"], power: Float[np.ndarray, "freq"], line: int) -> Peak:
    """Top and half-power points around the highest line of a peak."""
    inverse = 1 / np.maximum(power, np.finfo(float).tiny * np.max(power) + np.finfo(float).tiny)
    square = frequencies**2
    first = last = line
    # A parabola through every line of the top tenth (three at least): many lines average their noise.
    while first > 0 and inverse[first - 1] < 1.25 * inverse[line]:
        first -= 1
    while last < len(power) - 1 and inverse[last + 1] < 1.25 * inverse[line]:
        last += 1
    rows = slice(min(first, line - 1), max(last, line + 1) + 1)
    curve = np.polynomial.Polynomial.fit(square[rows], inverse[rows], 2)
    top, floor = _vertex(curve, square[rows])
    left, left_trouble = _crossing(square, inverse, line, -1, 2 * floor)
    right, right_trouble = _crossing(square, inverse, line, 1, 2 * floor)
    inside = int(np.count_nonzero((square >= left) & (square <= right)))
    low, high, centre = (float(np.sqrt(value)) for value in (left, right, top))
    return Peak(line, centre, 1 / floor, low, high, inside, left_trouble or right_trouble)


def _vertex(curve: np.polynomial.Polynomial, places: Float[np.ndarray, "line"]) -> tuple[float, float]:
    """Place and value of the minimum of a parabola, kept between the given places."""
    bend = curve.deriv(2)(places[0])
    place = float(curve.deriv().roots()[0].real) if bend > 0 else float(np.median(places))
    place = float(np.clip(place, places[0], places[-1]))
    value = float(curve(place))
    return place, value if value > 0 else float(np.min(curve(places)))


def _crossing(
    places: Float[np.ndarray, "freq"], inverse: Float[np.ndarray, "freq"], line: int, step: int, level: float
) -> tuple[float, str]:
    """Where the inverse power passes ``level`` on one side of a peak, or NaN and the reason."""
    current = line
    lowest = inverse[line]
    while 0 <= current + step < len(places):
        current += step
        if inverse[current] >= level:
            break
        lowest = max(lowest, inverse[current])
        if inverse[current] < 0.8 * lowest:
            return float("nan"), "It rises again into another peak before it has fallen by 3 dB."
    else:
        return float("nan"), "The band ends before it has fallen by 3 dB."
    rows = sorted(row for row in (current, current - step, current - 2 * step) if 0 <= row < len(places))
    curve = np.polynomial.Polynomial.fit(places[rows], inverse[rows] - level, len(rows) - 1)
    between = sorted((places[current - step], places[current]))
    roots = [root.real for root in np.atleast_1d(curve.roots()) if abs(root.imag) < 1e-9 * abs(root)]
    roots = [root for root in roots if between[0] <= root <= between[1]]
    if roots:
        return float(roots[0]), ""
    # The vertex may lie lower than every line: then the crossing is before this line.
    share = (level - inverse[current - step]) / (inverse[current] - inverse[current - step])
    return float(places[current - step] + np.clip(share, 0, 1) * (places[current] - places[current - step])), ""
