"""Polar data: amplitudes, linear or in dB, and phases in degrees or radians, become complex values.

A level in dB is L = 20 lg(|H| / H0) with the reference H0, since an FRF is a ratio of field quantities (ISO 80000-3).
Neither the scale of an amplitude nor the unit of a phase is ever guessed: the title of the column or the unit of the
array states it, or the layout does, or it is asked for.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from acquisition import units
from acquisition.files.arrays import Arrays, constant
from acquisition.files.layout import Layout
from acquisition.files.scales import (
    AmplitudeScale,
    PhaseScale,
    amplitude_in_words,
    amplitude_scale,
    phase_in_words,
    phase_scale,
    says_logarithmic,
    says_unwrapped,
)
from ema.data import Finding
from ema.errors import UnitError
from ema.units import UNSTATED

MARGIN = 0.01
"""Part of a turn by which rounding may push a phase beyond one turn, or a step of an unwrapped phase beyond half a
turn: phases are written with two digits and more. Halved or doubled, phases in the wrong unit are found just the same,
since a degree is 57 times smaller than a radian."""
LOUDEST = 1000.0
"""Level in dB, up or down, that no amplitude has: a ratio of 1e50. Doubled, numbers overflow a little later."""
SUSPECT_RANGE = 3.0
"""Range in degrees from which phases that all lie within +-pi look like radians: nearly the half turn that a resonance
takes. Halved, the phase of a rigid mass with some noise is suspected; doubled, no file is."""

ASK_AMPLITUDE = "amplitude_unit='linear' or amplitude_unit='dB re 1 (m/s^2)/N'"
ASK_PHASE = "phase_unit='deg' or phase_unit='rad'"
ASK_REFERENCE = (
    "say amplitude_unit='dB re 1 (m/s^2)/N' or the like, or 'dB re unstated' where nobody knows: frequencies, damping "
    "and shapes hold without it"
)


@dataclass(frozen=True)
class Polar:
    """Complex values (any shape) in ``unit``, whether they were in dB, and what a reader has to know about them."""

    values: Any
    unit: str
    findings: tuple[Finding, ...] = ()
    in_decibels: bool = False


def to_complex(arrays: Arrays, layout: Layout, amplitude: Any, phase: Any) -> Polar:
    """Complex values of ``amplitude`` and ``phase``, arrays of one shape.

    Raises
    ------
    UnitError : the scale of the amplitude, its reference or the unit of the phase is stated nowhere, or contradicts the
        numbers.
    """
    where = arrays.where
    scale, scale_note = _amplitude_scale(arrays, layout)
    turn, turn_note = _phase_scale(arrays, layout)
    if scale is None or turn is None:
        asked, seen, advice = [], [], []
        if scale is None:
            asked.append("whether its amplitude is linear or in dB")
            seen.append(f"amplitudes {_range(amplitude)}")
            advice.append(ASK_AMPLITUDE)
        if turn is None:
            asked.append("the unit of its phase")
            seen.append(f"phases {_range(phase)}")
            advice.append(ASK_PHASE)
        raise UnitError(
            f"the file does not say {' nor '.join(asked)}",
            where=where,
            got=", ".join(seen),
            advice=f"say {', and '.join(advice)} (in a campaign: keys of the reader)",
        )
    if scale.reference is None:
        raise UnitError(
            "the amplitude is in dB and nothing says its reference",
            where=where,
            got=f"amplitudes {_range(amplitude)}",
            advice=ASK_REFERENCE,
        )
    doubt = _check_phase(phase, turn, where)
    linear = _linear(amplitude, scale, where)
    with np.errstate(invalid="ignore"):  # infinite numbers of a damaged file have a finding
        values = linear * np.exp(1j * turn.factor * np.asarray(phase, dtype=np.float64))
    still = [constant(np.squeeze(v), p, where) for v, p in ((amplitude, layout.amplitude), (phase, layout.phase))]
    findings = (*scale_note, *turn_note, *doubt, *(note for notes in still for note in notes))
    return Polar(values, scale.unit, findings, scale.decibels)


def _range(values: Any) -> str:
    finite = np.asarray(values)[np.isfinite(values)]
    return f"from {finite.min():.4g} to {finite.max():.4g}" if finite.size else "without a finite value"


def _amplitude_scale(arrays: Arrays, layout: Layout) -> tuple[AmplitudeScale | None, tuple[Finding, ...]]:
    """The scale that the layout states, else the file; a finding where both do and differ."""
    place = str(layout.amplitude)
    given = amplitude_scale(layout.amplitude_unit) if layout.amplitude_unit is not None else None
    try:
        stated = amplitude_in_words(arrays.label(place), arrays.title(place))
    except UnitError as error:
        if given is None:
            raise UnitError(
                error.what, where=arrays.where, got=error.got, expected=error.expected, advice=ASK_REFERENCE
            ) from error
        stated = None
    unit = layout.unit is not None and units.parse(layout.unit).stated and not says_logarithmic(arrays.title(place))
    if given is None and stated is None and unit:
        given = AmplitudeScale(str(layout.unit))
    if given is None or stated is None:
        return given or stated, ()
    if given.decibels == stated.decibels:
        if given.reference is None or given == AmplitudeScale():
            return stated, ()  # the layout repeats what the file says with more words
        if stated.reference is None or stated.unit == UNSTATED or stated == given:
            return given, ()
    return given, (unit_overruled(arrays.where, "amplitude", arrays.title(place), str(layout.amplitude_unit)),)


def _phase_scale(arrays: Arrays, layout: Layout) -> tuple[PhaseScale | None, tuple[Finding, ...]]:
    """The unit that the layout states, else the file; a finding where both do and differ."""
    label, title = arrays.label(str(layout.phase)), arrays.title(str(layout.phase))
    given = phase_scale(layout.phase_unit) if layout.phase_unit is not None else None
    stated = phase_in_words(label, title)
    chosen = given or stated
    if chosen is not None and says_unwrapped(title):
        chosen = replace(chosen, unwrapped=True)
    if given is None or stated is None or given.unit == stated.unit:
        return chosen, ()
    return chosen, (unit_overruled(arrays.where, "phase", title, str(layout.phase_unit)),)


def unit_overruled(where: str, what: str, file: str, layout: str) -> Finding:
    """The layout says something else than the file."""
    return Finding(
        "warning",
        "unit-overruled",
        where,
        f"the file says {file!r} of the {what}, the layout {layout!r}; the layout is taken.",
        advice="Make sure that the layout is right.",
    )


def _linear(amplitude: Any, scale: AmplitudeScale, where: str) -> Any:
    """The amplitude in its unit.

    Raises
    ------
    InputError : negative, or louder than anything in dB.
    """
    amplitude = np.asarray(amplitude, dtype=np.float64)
    if not scale.decibels:
        below = int(np.count_nonzero(amplitude < 0))
        if below:
            raise UnitError(
                "an amplitude that is not in dB is negative",
                where=where,
                got=f"{below} of {amplitude.size} values below 0, {_range(amplitude)}",
                advice="if it is in dB, say amplitude_unit='dB re 1 (m/s^2)/N' or the like",
            )
        return amplitude
    finite = amplitude[np.isfinite(amplitude)]
    if finite.size and np.abs(finite).max() > LOUDEST:
        raise UnitError(
            "an amplitude in dB that no structure has",
            where=where,
            got=_range(amplitude),
            expected=f"within +-{LOUDEST:g} dB",
            advice="if it is linear, say amplitude_unit='linear'",
        )
    return float(scale.reference or 1.0) * 10 ** (amplitude / 20)


def _check_phase(phase: Any, scale: PhaseScale, where: str) -> tuple[Finding, ...]:
    """Refuse phases that are not in the unit stated; a finding where degrees look like radians.

    A wrapped phase stays within one turn. Unwrapping adds turns until no step between neighbouring lines is larger than
    half a turn, so larger steps show another unit.

    Raises
    ------
    InputError : beyond one turn without being unwrapped, or unwrapped with larger steps than unwrapping leaves.
    """
    phase = np.asarray(phase, dtype=np.float64)
    turn = 2 * np.pi / scale.factor
    finite = phase[np.isfinite(phase)]
    if not finite.size:
        return ()
    farthest = float(np.abs(finite).max())
    if farthest > (1 + MARGIN) * turn:
        steps = np.abs(np.diff(np.squeeze(phase), axis=int(np.argmax(np.squeeze(phase).shape))))
        widest = float(np.nanmax(steps)) if steps.size and np.isfinite(steps).any() else 0.0
        if not scale.unwrapped and scale.unit == "rad":
            raise UnitError(
                "phases beyond 2 pi, though in radians",
                where=where,
                got=_range(phase),
                advice="if they are degrees, say phase_unit='deg'; if the phase is unwrapped, say "
                "phase_unit='unwrapped rad'",
            )
        if widest > (0.5 + MARGIN) * turn:
            raise UnitError(
                f"phases in {scale.unit} that are neither wrapped nor unwrapped",
                where=where,
                got=f"{_range(phase)} with a step of {widest:.4g} between two lines",
                expected=f"within one turn, or steps of at most half a turn ({turn / 2:.4g})",
                advice="state the right unit: " + ASK_PHASE,
            )
    if scale.unit == "deg" and farthest <= np.pi * (1 + MARGIN) and np.ptp(finite) >= SUSPECT_RANGE:
        message = f"phases in degrees {_range(phase)} look like radians."
        return (
            Finding(
                "warning",
                "phase-unit-doubtful",
                where,
                message,
                farthest,
                float(np.pi),
                "If they are radians, say phase_unit='rad'.",
            ),
        )
    return ()
