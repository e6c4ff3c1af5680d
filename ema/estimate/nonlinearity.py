"""Whether FRFs belong to a linear structure: over force levels (homogeneity) and by themselves (causality)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from ema.data import Finding, FrfSet
from ema.errors import InputError

NONLINEAR = 0.05
"""Homogeneity index above which a structure counts as nonlinear."""
INVALID = 0.3
"""Homogeneity index above which a linear fit has no meaning."""
NEITHER = 0.02
"""Change of the peak over a doubling of the force below which it counts as neither rising nor falling."""
_BANDWIDTHS = 10.0
"""Half-power bandwidths on either side of the peak that are compared."""
_SIGNIFICANT = 3.0
"""Homogeneity index over what noise alone gives on average, below which it is set to 0."""
_SMEAR = 16
"""Samples before time zero that count on neither side: the taper of the band smears the start of a response there."""
_SAME_LINE = 0.02
"""Distance of two lines over the step of the lines, up to which they count as one: steps are read from a force."""

Side = Literal["slip", "stick", "undecided"]


@dataclass(frozen=True)
class Homogeneity:
    """How an FRF changes from one force level to another, about its highest peak.

    Parameters
    ----------
    index : float
        Norm of the difference over the norm of the FRF at the lower level, noise taken off; 0 where linear.
    noise : float
        The part of the raw index that noise alone explains.
    peak_ratio : float
        Height of the peak at the higher level over that at the lower one.
    side : {"slip", "stick", "undecided"}
        ``slip`` where the peak grows with the force (damping falls: press more), ``stick`` where it shrinks (damping
        rises: press less), ``undecided`` where it hardly changes.
    band : tuple of (float, float)
        What was compared [Hz].
    levels : tuple of (float, float)
        Force levels [N]; NaN where unknown.
    findings : tuple of Finding, optional
        What a reader of the index has to know.

    Examples
    --------
    >>> Homogeneity(0.2, 0.01, peak_ratio=0.8, side="stick", band=(38.0, 42.0), levels=(5.0, 10.0)).side
    'stick'
    """

    index: float
    noise: float
    peak_ratio: float
    side: Side
    band: tuple[float, float]
    levels: tuple[float, float]
    findings: tuple[Finding, ...] = ()


def homogeneity(low: FrfSet, high: FrfSet, near: float | None = None) -> Homogeneity:
    """Compare FRFs of the same DOFs at two force levels: the first test for a joint that slips.

    Over 10 half-power bandwidths to either side of the peak of the summed response, all FRFs together. The difference
    by noise is taken off where both sets know their variance.

    Parameters
    ----------
    low, high : FrfSet
        FRFs at the lower and at the higher force level, on the same lines.
    near : float, optional
        Frequency [Hz] near the resonance of interest; by default the highest peak.

    Returns
    -------
    Homogeneity
        Change of the FRFs and of their peak.

    Raises
    ------
    InputError
        If lines, DOFs or quantities differ, a value is not finite, or there is no peak.

    References
    ----------
    .. [1] Homogeneity test: ISO 7626-2; Worden and Tomlinson (2001), Nonlinearity in Structural Dynamics. There the
       force is doubled; here the levels are those of the sets.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> homogeneity(frf_set(), frf_set()).index
    0.0
    """
    where = f"{low.name or 'low level'} and {high.name or 'high level'}"
    _same(low, high, where)
    rows = _around_peak(low, near, where)
    a, b = low.values[rows], high.values[rows]
    power = float(np.sum(np.abs(a) ** 2))
    raw = float(np.sum(np.abs(b - a) ** 2)) / power
    noise = 0.0
    if low.variance is not None and high.variance is not None:
        noise = float(np.nansum(low.variance[rows] + high.variance[rows])) / power
    index = float(np.sqrt(max(raw - noise, 0.0)))
    summed = [np.sqrt(np.sum(np.abs(part) ** 2, axis=(1, 2))) for part in (a, b)]
    ratio = float(summed[1].max() / summed[0].max())
    side: Side = "undecided" if abs(ratio - 1) < NEITHER else ("slip" if ratio > 1 else "stick")
    band = (float(low.frequencies[rows][0]), float(low.frequencies[rows][-1]))
    levels = (low.condition.excitation.level, high.condition.excitation.level)
    if index < _SIGNIFICANT * np.sqrt(noise / max(a.size, 1)):
        index = 0.0
    findings = _about(index, side, where)
    return Homogeneity(index, float(np.sqrt(noise)), ratio, side, band, levels, findings)


def causality(frfs: FrfSet, near: float | None = None) -> Float[np.ndarray, "out in"]:
    """Compute the share of the energy of each impulse response that lies before time zero: a second linearity test.

    The band about the peak is tapered and transformed; a linear FRF without noise has a share of about 1e-7, by the
    cut. A few parts in ten thousand indicate friction; less sensitive than :func:`homogeneity`, but one level is
    enough.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.
    near : float, optional
        Frequency [Hz] near the resonance of interest; by default the highest peak.

    Returns
    -------
    array of shape (out, in)
        Share of the energy; NaN for an FRF of zeros.

    Raises
    ------
    InputError
        If a value is not finite, there is no peak, or there are fewer than 16 lines about it.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> causality(frf_set(), near=60.0).shape
    (4, 2)
    """
    where = frfs.name or "FRFs"
    if not np.all(np.isfinite(frfs.values)):
        raise InputError(
            "FRFs hold NaN or infinite values", where=where, advice="cut the band or leave out the channel"
        )
    rows = _around_peak(frfs, near, where)
    values = frfs.values[rows]
    count = len(values)
    if count < 16:
        raise InputError(
            "too few lines about the peak",
            where=where,
            got=count,
            expected="16 or more",
            advice="measure with a finer resolution",
        )
    taper = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(count) + 0.5) / count)
    impulse = np.fft.ifft(values * taper[:, None, None], 4 * count, axis=0)
    energy = np.abs(impulse) ** 2
    # the taper smears the start of the response over a few samples of 1/bandwidth: these count on neither side
    before = energy[2 * count : -_SMEAR].sum(axis=0)
    total = energy.sum(axis=0)
    return np.asarray(np.divide(before, total, out=np.full(total.shape, np.nan), where=total > 0))


def _same(low: FrfSet, high: FrfSet, where: str) -> None:
    unequal = low.values.shape != high.values.shape
    if unequal or np.abs(low.frequencies - high.frequencies).max() > _SAME_LINE * low.frequency_step:
        raise InputError(
            "FRFs on different lines",
            where=where,
            got=f"{low.values.shape} and {high.values.shape}",
            expected="the same lines in both",
            advice="cut both to one band and resolution",
        )
    if low.outputs != high.outputs or low.inputs != high.inputs or low.quantity != high.quantity:
        raise InputError(
            "FRFs of different DOFs", where=where, got="other outputs, inputs or quantity", expected="the same in both"
        )
    if not (np.all(np.isfinite(low.values)) and np.all(np.isfinite(high.values))):
        raise InputError("FRFs hold NaN or infinite values", where=where, advice="leave out the channel")


def _around_peak(frfs: FrfSet, near: float | None, where: str) -> slice:
    """Lines within 10 half-power bandwidths of the peak of the summed response."""
    height = np.sqrt(np.sum(np.abs(frfs.values) ** 2, axis=(1, 2)))
    if not height.max() > 0 or len(height) < 5:
        raise InputError(
            "no peak in the FRFs",
            where=where,
            got=f"{len(height)} lines, largest {height.max():.3g}",
            expected="a resonance",
        )
    if near is None:
        top = int(height.argmax())
    else:
        if not frfs.frequencies[0] <= near <= frfs.frequencies[-1]:
            raise InputError(
                "outside the FRFs",
                where=where,
                got=f"{near} Hz",
                expected=f"{frfs.frequencies[0]:g} to {frfs.frequencies[-1]:g} Hz",
            )
        top = int(np.abs(frfs.frequencies - near).argmin())
        while True:
            window = slice(max(top - 3, 0), top + 4)
            better = window.start + int(height[window].argmax())
            if better == top:
                break
            top = better
    half = height[top] / np.sqrt(2)
    first, last = top, top
    while first > 0 and height[first] > half:
        first -= 1
    while last < len(height) - 1 and height[last] > half:
        last += 1
    reach = int(np.ceil(_BANDWIDTHS * max(last - first, 1)))
    return slice(max(top - reach, 0), min(top + reach + 1, len(height)))


def _about(index: float, side: Side, where: str) -> tuple[Finding, ...]:
    if index <= NONLINEAR:
        return ()
    advice = {
        "slip": "Damping falls with the force: the joint slips; press more.",
        "stick": "Damping rises with the force: the joint sticks at the lower level; press less.",
        "undecided": "The levels lie on either side of the most damping.",
    }[side]
    if index > INVALID:
        return (
            Finding(
                "error",
                "not-homogeneous",
                where,
                f"the FRFs differ by {index:.0%} between the levels: one linear model has no meaning.",
                index,
                INVALID,
                advice + " Fit every level on its own, near its peak.",
            ),
        )
    return (
        Finding(
            "warning",
            "not-homogeneous",
            where,
            f"the FRFs differ by {index:.0%} between the levels.",
            index,
            NONLINEAR,
            advice + " Results hold for their level only.",
        ),
    )
