"""What FRFs say about the measurement that gave them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ema.data import Finding, FrfSet, HitGallery, ModalModel
from ema.dof import match
from ema.errors import InputError
from ema.estimate import force_or_response
from ema.estimate.quarter_turns import turned_channels
from ema.estimate.turned_sensors import turned_sensors

LOW_COHERENCE = 0.8
"""Coherence at a resonance, and median over the band, below which a finding says so."""

RECIPROCITY = 0.05
"""Relative difference between an FRF and the one with force and response exchanged."""

NOISY = 0.1
"""Median standard deviation of an FRF, relative to its magnitude."""

REVERSED = 0.8
"""Part of a drive point's resistance that is negative when a channel is reversed."""

WRONG_PHASE = 0.1
"""Part of a drive point's resistance that may be negative by noise."""


CONJUGATE = 0.45
"""Share of the FRFs' energy whose phase rises with frequency, less that where it falls, that only a conjugate has.

Phases fall through every resonance, and rise through those of a conjugate: by 0.53 to 0.6 where lines are as close as
the resonances are wide, or closer. Noise has both in equal parts, but for a scatter of 0.9 over the root of the number
of values; five times that is allowed. A measurement with a coherence below 0.5 has shown 0.33.
"""


def quality(frfs: FrfSet, modes: ModalModel | None = None, hits: HitGallery | None = None) -> tuple[Finding, ...]:
    """Check FRFs for everything that a reader has to know before trusting what is fitted to them.

    Dead or undefined FRFs, coherence over the band and at the resonances, noise, sign and phase of drive points and
    of single responses, reciprocity, averages, and the band that the force reaches.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.
    modes : ModalModel, optional
        Where the resonances are; by default the strongest peaks of the sum of the FRFs.
    hits : HitGallery, optional
        The impacts, for the usable band.

    Returns
    -------
    tuple of Finding
        What was noticed; empty where nothing is wrong.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> quality(frf_set())
    ()
    """
    dead, findings = _dead(frfs)
    alive = frfs if not dead.any() else _without(frfs, dead)
    if alive is None:
        return tuple(findings)
    peaks = _resonances(alive, modes)
    # beyond the reach of the impacts peaks are of noise; one finding says so for all of them
    findings += _coherence(alive, peaks if hits is None else peaks[peaks <= hits.usable_band[1]])
    findings += _noise(alive)
    findings += (_conjugate(alive) if hits is None else []) or _drive_points(alive)  # those of impacts are our own
    findings += _reciprocity(alive)
    findings += turned_sensors(alive, peaks) + turned_channels(alive, peaks, modes)
    if hits is not None:
        findings += _beyond_force(alive, hits, peaks)
    return tuple(findings)


def without_dead(frfs: FrfSet) -> FrfSet:
    """Remove the outputs and inputs that are dead or not measured, so that a model can be fitted.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.

    Returns
    -------
    FrfSet
        The set without them; the same one where there are none.

    Raises
    ------
    InputError
        If none is left.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> len(without_dead(frf_set()).outputs)
    4
    """
    dead, findings = _dead(frfs)
    if not dead.any():
        return frfs
    alive = _without(frfs, dead)
    if alive is None:
        raise InputError(
            "no FRF is left to work with",
            where=f"run {frfs.name}" if frfs.name else "FRFs",
            got="; ".join(finding.message.rstrip(".") for finding in findings),
            advice=findings[0].advice.rstrip("."),
        )
    return alive


def _dead(frfs: FrfSet) -> tuple[np.ndarray, list[Finding]]:
    """FRFs that are not numbers or zero on most lines, and what there is to say about them."""
    with_numbers = np.isfinite(frfs.values)
    broken = np.mean(~with_numbers[1:], axis=0) > 0
    zero = ~broken & (np.abs(np.where(with_numbers, frfs.values, 0)).max(axis=0) == 0)
    findings = []
    for which, code, text, advice in (
        (broken, "not-a-number", "holds values that are not numbers", "It was not measured, or its record is damaged."),
        (
            zero,
            "dead-channel",
            "is zero: the response channel is dead",
            "Check sensor and cable.",
        ),
    ):
        labels = [frfs.label(int(o), int(i)) for o, i in np.argwhere(which)]
        if labels:
            findings.append(
                Finding(
                    "error",
                    code,
                    _where(frfs, _list(labels)),
                    f"{_count(labels, 'FRF')} {text}.",
                    float(len(labels)),
                    0.0,
                    advice,
                )
            )
    return broken | zero, findings


def _without(frfs: FrfSet, dead: np.ndarray) -> FrfSet | None:
    """The rows and columns in which nothing is dead: fewer rows or fewer columns, whichever keeps more."""
    rows = [row for row in range(dead.shape[0]) if not dead[row].all()]
    columns = [c for c in range(dead.shape[1]) if rows and not dead[rows][:, c].any()]
    if not rows or not columns:
        columns = [c for c in range(dead.shape[1]) if not dead[:, c].all()]
        rows = [row for row in range(dead.shape[0]) if columns and not dead[row][columns].any()]
    return frfs.pick(rows, columns) if rows and columns else None


def _resonances(frfs: FrfSet, modes: ModalModel | None) -> Float[np.ndarray, "mode"]:
    """Frequencies in Hz of the modes, or of the strongest peaks of the summed FRFs."""
    low, high = frfs.frequencies[0], frfs.frequencies[-1]
    if modes is not None:
        f = modes.natural_frequencies
        return np.asarray(f[(f >= low) & (f <= high)])
    from scipy.signal import find_peaks

    level = np.log10(np.maximum(np.sum(np.abs(frfs.values) ** 2, axis=(1, 2)), 1e-300))
    places, about = find_peaks(level, prominence=1.0)
    strongest = places[np.argsort(about["prominences"])[::-1][:20]]
    return np.sort(frfs.frequencies[strongest])


def _coherence(frfs: FrfSet, peaks: Float[np.ndarray, "mode"]) -> list[Finding]:
    """Coherence over the band and at the resonances; nothing can be said of single averages."""
    if frfs.coherence is None:
        return []
    findings = []
    known = np.ones(frfs.values.shape[1:], bool) if frfs.averages is None else frfs.averages > 1
    if not known.all():
        findings.append(
            Finding.of(
                "warning",
                "one-average",
                _where(frfs),
                "{count} of {total} FRFs have one average: their coherence is 1 by definition.",
                1.0,
                2.0,
                advice="Average at least three measurements.",
                count=np.sum(~known),
                total=known.size,
            )
        )
    if not known.any():
        return findings
    median = float(np.nanmedian(frfs.coherence[:, known]))
    if median < LOW_COHERENCE:
        findings.append(
            Finding.of(
                "warning",
                "low-coherence",
                _where(frfs),
                "the median coherence is {median}.",
                median,
                LOW_COHERENCE,
                advice="Check noise, leakage, double hits and the excited band before trusting the damping.",
                median=f"{median:.2f}",
            )
        )
    weight = np.abs(frfs.values)
    low = []
    for peak in peaks:
        line = int(np.argmin(np.abs(frfs.frequencies - peak)))
        near = slice(max(line - 1, 0), line + 2)
        # The best FRFs of each resonance decide: points on a nodal line have no coherence there, and need none.
        strong = known & (weight[line] >= 0.5 * weight[line][known].max())
        here = float(np.nanmedian(frfs.coherence[near][:, strong]))
        if here < LOW_COHERENCE:
            low.append((float(peak), here))
            findings.append(
                Finding.of(
                    "warning",
                    "low-coherence",
                    _where(frfs, f"{peak:.1f} Hz"),
                    "the coherence at the resonance at {frequency} Hz is {coherence}.",
                    here,
                    LOW_COHERENCE,
                    advice="Leakage, noise or nonlinearity: use longer blocks, more averages or one force level.",
                    frequency=f"{peak:.1f}",
                    coherence=f"{here:.2f}",
                )
            )
    return findings + force_or_response.about_noise(frfs, low, _where(frfs))


def _noise(frfs: FrfSet) -> list[Finding]:
    """FRFs whose standard deviation is a large part of their magnitude."""
    if frfs.variance is None:
        return []
    size = np.abs(frfs.values)
    ratio = np.sqrt(np.divide(frfs.variance, size**2, out=np.full_like(size, np.nan), where=size > 0))
    known = np.isfinite(ratio).any(axis=0)
    if not known.any():
        return []
    median = float(np.nanmedian(ratio[:, known]))
    if median < NOISY:
        return []
    return [
        Finding.of(
            "warning",
            "noisy-frfs",
            _where(frfs),
            "the standard deviation of the FRFs is {median} % of their magnitude (median).",
            median,
            NOISY,
            advice="Average more, or raise the force.",
            median=f"{100 * median:.0f}",
        )
    ]


def _conjugate(frfs: FrfSet) -> list[Finding]:
    """FRFs of the convention exp(-j w t): they answer before the force, and no pole of theirs decays."""
    values = frfs.values[1:]
    lags = [2**power for power in range(12) if 2**power <= len(values) // 8]
    products = [np.conj(values[:-lag]) * values[lag:] for lag in lags]
    # of the distances of lines the one that is nearest to a bandwidth tells most
    rising = max((float(np.sum(one.imag) / max(np.sum(np.abs(one)), 1e-300)) for one in products), default=0.0)
    if rising < max(CONJUGATE, 4.5 / np.sqrt(values.size)):
        return []
    return [
        Finding(
            "error",
            "conjugate-frfs",
            _where(frfs),
            "the phase of the FRFs rises with frequency through their resonances: they are complex conjugates of what "
            "a structure has, as in the convention exp(-j w t).",
            rising,
            CONJUGATE,
            "Export them in the convention exp(+j w t), or conjugate them.",
        )
    ]


def _drive_points(frfs: FrfSet) -> list[Finding]:
    """A drive point takes in power at all frequencies: its mobility lies in the right half plane."""
    power = {"receptance": 1, "mobility": 0, "accelerance": -1, "unstated": -1}[frfs.quantity]
    findings = []
    for row, column, sign in match(frfs.outputs, frfs.inputs):
        mobility = sign * frfs.values[1:, row, column] * (1j * np.sign(frfs.frequencies[1:])) ** power
        strength = np.abs(mobility)
        # The real part at the resonances decides; elsewhere it is small and noise has its sign.
        negative = float(np.sum(np.minimum(mobility.real, 0) ** 2) / max(np.sum(mobility.real**2), 1e-300))
        where = _where(frfs, frfs.label(row, column))
        if not strength.any():
            continue
        if negative > REVERSED:
            findings.append(
                Finding(
                    "error",
                    "drive-point-sign",
                    where,
                    "the drive point has the wrong sign: force or response is reversed, or they are exchanged.",
                    negative,
                    WRONG_PHASE,
                    "Reverse the sign of the channel by a repair, or correct its direction. Where the two are "
                    "exchanged, correct their roles: the modes are those of the structure held at this point.",
                )
            )
        elif negative > WRONG_PHASE:
            findings.append(
                Finding.of(
                    "warning",
                    "drive-point-phase",
                    where,
                    "{share} % of the drive point's resistance is negative: not all resonances have the same phase.",
                    negative,
                    WRONG_PHASE,
                    advice=(
                        "Force and response are not at the same place and direction, or the channels have a phase "
                        "error."
                    ),
                    share=f"{100 * negative:.0f}",
                )
            )
    return findings


def _reciprocity(frfs: FrfSet) -> list[Finding]:
    """Pairs of FRFs with force and response exchanged, which differ by more than their noise."""
    pairs = match(frfs.outputs, frfs.inputs)
    findings = []
    for place, (row, column, sign) in enumerate(pairs):
        for other_row, other_column, other_sign in pairs[:place]:
            forward = sign * other_sign * frfs.values[1:, row, other_column]
            backward = frfs.values[1:, other_row, column]
            size = np.sqrt(np.sum(np.abs(forward) ** 2) * np.sum(np.abs(backward) ** 2))
            apart, by_noise = np.sum(np.abs(forward - backward) ** 2), 0.0
            if frfs.variance is not None:
                by_noise = np.nansum(frfs.variance[1:, row, other_column] + frfs.variance[1:, other_row, column])
            difference = float(np.sqrt(max(apart - by_noise, 0.0) / size)) if size > 0 else 0.0
            # A few lines at the peaks may hold most of the noise, whose variance from two averages is a rough one.
            if difference > RECIPROCITY and apart > 2 * by_noise:
                reversed_ = np.sum(forward * backward.conj()).real < 0
                findings.append(
                    Finding(
                        "warning",
                        "reciprocity",
                        _where(frfs, f"{frfs.label(row, other_column)} and {frfs.label(other_row, column)}"),
                        f"the two FRFs differ by {100 * difference:.0f} %"
                        f"{': they have opposite signs' if reversed_ else ''}.",
                        difference,
                        RECIPROCITY,
                        "A sensor is reversed or misplaced."
                        if reversed_
                        else "Check places, directions and sensitivities; a friction joint breaks reciprocity too.",
                    )
                )
    return findings


def _beyond_force(frfs: FrfSet, hits: HitGallery, peaks: Float[np.ndarray, "mode"]) -> list[Finding]:
    """Resonances that the impacts hardly excite."""
    beyond = peaks[peaks > hits.usable_band[1]]
    if len(beyond) == 0:
        return []
    return [
        Finding.of(
            "warning",
            "usable-band",
            _where(frfs),
            "{count} resonances lie above {frequency} Hz, where the force has fallen by 20 dB.",
            float(beyond[0]),
            hits.usable_band[1],
            advice="Use a harder tip, or leave these modes out.",
            count=len(beyond),
            frequency=f"{hits.usable_band[1]:.0f}",
        )
    ]


def _where(frfs: FrfSet, what: str = "") -> str:
    return ", ".join(part for part in (f"run {frfs.name}" if frfs.name else "", what) if part) or "FRFs"


def _list(labels: Sequence[str]) -> str:
    return ", ".join(labels[:4]) + (f" and {len(labels) - 4} more" if len(labels) > 4 else "")


def _count(labels: Sequence[str], what: str) -> str:
    return f"one {what}" if len(labels) == 1 else f"each of {len(labels)} {what}s"
