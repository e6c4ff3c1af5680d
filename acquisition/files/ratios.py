"""FRFs in named arrays become an FRF set."""

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.arrays import Arrays, not_finite
from acquisition.files.layout import Layout
from acquisition.files.polar import Polar, to_complex, unit_overruled
from acquisition.files.scales import phase_scale, says_logarithmic
from ema.data import Finding, FrfSet
from ema.dof import Dof
from ema.errors import InputError
from ema.units import FRF_UNIT, UNSTATED


def frfs(arrays: Arrays, layout: Layout) -> Contents:
    """FRFs: complex, as real and imaginary part, or as amplitude and phase."""
    raw = _complex(arrays, layout)
    values = np.asarray(raw.values)
    odd: tuple[Finding, ...] = ()
    if layout.frequency is not None:
        frequencies, odd = _hertz(arrays, layout)
    elif layout.frequency_step is not None:
        frequencies = layout.frequency_step * np.arange(_length(values, layout))
    else:
        raise InputError(
            "the file does not state its frequencies",
            where=arrays.where,
            advice="say frequency='...' or frequency_step=... [Hz]",
        )
    block = _freq_out_in(values, len(frequencies), layout, arrays.where)
    coherence = _coherences(arrays, layout, len(frequencies))
    outputs = _dofs(arrays, layout.outputs, block.shape[1])
    inputs = _dofs(arrays, layout.inputs, block.shape[2])
    unit, overruled = unit_of(raw, layout, arrays.where)
    frf_set = make_frfs(frequencies, block, outputs, inputs, unit, arrays.where, coherence)
    sets, about_coherence = checked_coherences((frf_set,), f"{arrays.where}, {layout.coherence}")
    findings = (*raw.findings, *overruled, *odd, *about_coherence, *not_finite(frf_set.values, arrays.where))
    findings = (*findings, *missing_lines(frequencies, arrays.where))
    return Contents(frfs=sets, findings=findings, frf_units=units_before_si(unit))


def unit_of(raw: Polar, layout: Layout, where: str) -> tuple[str, tuple[Finding, ...]]:
    """The unit of the layout, else of the file; a finding where they differ or the file's is none of an FRF.

    Raises
    ------
    UnitError : the layout names another unit than the reference of an amplitude in dB.
    """
    if layout.unit is None and raw.unit != UNSTATED and units.parse(raw.unit).quantity not in FRF_UNIT:
        message = f"{raw.unit!r} is not the unit of an FRF; the numbers are taken without one."
        note = Finding("warning", "unit-doubtful", where, message, advice="Say unit='(m/s^2)/N' or the like.")
        return UNSTATED, (note,)
    if layout.unit is None or UNSTATED in (raw.unit, layout.unit):
        return layout.unit or raw.unit, ()
    given, stated = units.parse(layout.unit), units.parse(raw.unit)
    if (given.factor, given.quantity) == (stated.factor, stated.quantity):
        return layout.unit, ()
    if raw.in_decibels:
        raise units.UnitError(
            "the unit is not that of the reference in dB", where=where, got=repr(layout.unit), expected=raw.unit
        )
    return layout.unit, (unit_overruled(where, "unit", raw.unit, layout.unit),)


def units_before_si(unit: str) -> tuple[tuple[units.Unit, units.Unit], ...]:
    """Units of response and force from which the numbers of an FRF become SI."""
    pair = units.of_frf(unit)
    return () if pair is None else (pair,)


def _coherences(arrays: Arrays, layout: Layout, lines: int) -> Any:
    """Coherences in the unit that the file states, as a number; ``None`` where the layout names none."""
    if layout.coherence is None:
        return None
    coherence = _freq_out_in(arrays.numbers(layout.coherence), lines, layout, arrays.where)
    unit = units.known(arrays.units.get(layout.coherence, "1"))
    return unit.factor * coherence if unit is not None and unit.quantity == "ratio" else coherence


_ROUNDED = 1e-4
"""By how much rounding may bring a coherence beyond 0 and 1: the last digit of four. Halved or doubled, files with
fewer digits than five are named or not."""


def checked_coherences(frfs: Iterable[FrfSet], where: str) -> tuple[tuple[FrfSet, ...], tuple[Finding, ...]]:
    """FRFs without what is no coherence, as in per cent, and findings: about that, and about single values beyond 1."""
    kept, left_out, total = [], [], 0
    beyond: list[float] = []
    for frf in frfs:
        numbers = np.ravel(frf.coherence if frf.coherence is not None else [])
        finite = numbers[np.isfinite(numbers)]
        # some analysers write more than 1 at a few lines; another unit shows at most of them
        if len(finite) and not -_ROUNDED <= np.median(finite) <= 1 + _ROUNDED:
            left_out.append(finite)
            kept.append(replace(frf, coherence=None))
            continue
        total += len(finite)
        beyond += finite[np.abs(finite - 0.5) > 0.5 + _ROUNDED].tolist()
        kept.append(frf)
    notes: list[Finding] = []
    if left_out:
        low, high = min(map(np.min, left_out)), max(map(np.max, left_out))
        message = f"values from {low:.4g} to {high:.4g} are no coherence; they are left out."
        advice = "Export it as a number from 0 to 1, or with its unit (%)."
        notes.append(Finding("warning", "not-read", where, message, advice=advice))
    if beyond:
        farthest = float(max(beyond, key=lambda value: abs(value - 0.5)))
        notes.append(
            Finding.of(
                "warning",
                "coherence-beyond",
                where,
                "{count} of {total} coherences are not from 0 to 1; the farthest is {farthest}.",
                farthest,
                1.0,
                advice="Such lines had no average, or the numbers are none; do not rely on the coherence there.",
                count=len(beyond),
                total=total,
                farthest=f"{farthest:.6g}",
            )
        )
    return tuple(kept), tuple(notes)


def _hertz(arrays: Arrays, layout: Layout) -> tuple[Any, tuple[Finding, ...]]:
    """The frequencies in Hz, from the unit that the layout or the file states; a finding where they differ.

    Raises
    ------
    UnitError : not a unit of frequency.
    """
    place = str(layout.frequency)
    stated = arrays.label(place)
    if not stated:
        found = re.search(r"(?<![A-Za-z])(Hz|kHz|MHz|rpm|rad/s)(?![A-Za-z])", arrays.title(place))
        stated = found[1] if found else ""
    text = layout.frequency_unit or stated or "Hz"
    unit, there = units.known(text), units.known(stated) if stated else None
    if unit is None or unit.quantity not in ("frequency", "angular velocity"):
        raise units.UnitError(
            "not a unit of frequency",
            where=arrays.where,
            got=repr(text),
            expected="Hz, kHz or rad/s",
            advice="say frequency_unit='Hz' or the like",
        )
    turns = 2 * np.pi if unit.quantity == "angular velocity" else 1.0
    overruled: tuple[Finding, ...] = ()
    if there is not None and (there.factor, there.quantity) != (unit.factor, unit.quantity):
        overruled = (unit_overruled(arrays.where, "frequency", stated, text),)
    return unit.factor / turns * arrays.vector(place), overruled


def make_frfs(
    frequencies: Any,
    block: Any,
    outputs: tuple[Dof, ...],
    inputs: tuple[Dof, ...],
    unit: str | None,
    where: str,
    coherence: Any = None,
) -> FrfSet:
    """An FRF set in SI.

    Raises
    ------
    InputError : frequencies that do not increase.
    UnitError : a unit that is none of an FRF.
    """
    check_frequencies(frequencies, where)
    parsed = units.parse(unit or UNSTATED)
    if parsed.stated and parsed.quantity not in FRF_UNIT:
        raise units.UnitError(
            "not the unit of an FRF",
            where=where,
            got=repr(unit),
            expected="response over force, e.g. (m/s^2)/N or g/N",
            advice="say unit='g/N' or the like",
        )
    quantity: Any = parsed.quantity if parsed.stated else "unstated"
    return FrfSet(
        frequencies,
        parsed.to_si(block),
        outputs,
        inputs,
        quantity,
        parsed.si if parsed.stated else UNSTATED,
        coherence,
        name=where,
    )


def check_frequencies(frequencies: Any, where: str) -> None:
    """Refuse an axis of frequencies in Hz that is none.

    Raises
    ------
    InputError : empty, not finite, negative, or not increasing from line to line.
    """
    frequencies = np.asarray(frequencies)
    if not len(frequencies) or not np.all(np.isfinite(frequencies)):
        raise InputError(
            "the frequencies are not all numbers",
            where=where,
            got=f"{len(frequencies)} lines",
            expected="one line or more, each with a finite frequency",
            advice="export the file again",
        )
    back = np.flatnonzero(np.diff(frequencies) <= 0)
    if len(back):
        line = int(back[0])
        raise InputError(
            "the frequencies do not increase",
            where=where,
            got=f"{frequencies[line + 1]:g} Hz behind {frequencies[line]:g} Hz at line {line + 2} of "
            f"{len(frequencies)}",
            expected="each frequency above the one before",
            advice="export the lines in rising order, with enough digits to tell them apart",
        )
    if frequencies[0] < 0:
        raise InputError(
            "a negative frequency",
            where=where,
            got=f"{frequencies[0]:g} Hz",
            expected="0 Hz and more",
            advice="export the one-sided FRF",
        )


_LINES_PER_GAP = 10
"""Lines for each gap from which gaps are damage: an odd multisine leaves out one line of three or four on purpose, for
distortion (Pintelon, Schoukens, System Identification, 2nd ed. (2012), section 4.3); a lost row is one of all."""
_OFF_GRID = 0.1
"""Share of the spacing by which written frequencies may be off the even axis: one digit behind the spacing's first."""


def missing_lines(frequencies: Any, where: str) -> tuple[Finding, ...]:
    """A finding where lines are missing in an axis of frequencies in Hz, shape (line,), that is even but for them."""
    steps = np.diff(np.asarray(frequencies, float))
    if len(steps) < _LINES_PER_GAP:
        return ()
    usual = float(np.median(steps))
    spacings = np.round(steps / usual)
    gaps = np.flatnonzero(spacings > 1)
    if np.any(np.abs(steps / usual - spacings) > _OFF_GRID) or not 0 < len(gaps) <= len(steps) / _LINES_PER_GAP:
        return ()
    count, first = int(np.sum(spacings[gaps] - 1)), float(frequencies[gaps[0]]) + usual
    message = f"{count} of {len(steps) + 1 + count} lines that are {usual:g} Hz apart are missing, first {first:g} Hz."
    advice = "Export the file again if the lines were not left out on purpose."
    return (Finding("warning", "lines-missing", where, message, float(count), 0.0, advice),)


def _complex(arrays: Arrays, layout: Layout) -> Polar:
    if layout.frf is not None:
        _refuse_polar(arrays, layout.frf)
        values = arrays.numbers(layout.frf, np.complex128)
        if not np.iscomplexobj(arrays[layout.frf]):
            raise InputError(
                "half of an FRF: its values are real",
                where=arrays.where,
                got=layout.frf,
                expected="complex values",
                advice="say real and imaginary, or amplitude and phase",
            )
        return Polar(values, _stated(arrays, layout.frf))
    if layout.real is not None and layout.imaginary is not None:
        for place in (layout.real, layout.imaginary):
            _refuse_polar(arrays, place)
        real, imaginary = arrays.numbers(layout.real), arrays.numbers(layout.imaginary)
        if real.shape != imaginary.shape:
            raise InputError(
                "real and imaginary part differ in length",
                where=arrays.where,
                got=f"{real.shape}, {imaginary.shape}",
                expected="equal shapes",
                advice="name two arrays of one FRF",
            )
        unit, other = _stated(arrays, layout.real), _stated(arrays, layout.imaginary)
        if unit != other and UNSTATED not in (unit, other):
            raise InputError(
                "real and imaginary part differ in unit",
                where=arrays.where,
                got=f"{unit}, {other}",
                expected="one unit",
                advice="name two arrays of one FRF, or correct the unit in the file",
            )
        with np.errstate(invalid="ignore"):  # infinite numbers have a finding
            values = real + 1j * imaginary
        return Polar(values, other if unit == UNSTATED else unit)
    if layout.amplitude is not None and layout.phase is not None:
        amplitude, phase = arrays.numbers(layout.amplitude), arrays.numbers(layout.phase)
        if amplitude.shape != phase.shape:
            raise InputError(
                "amplitude and phase differ in length",
                where=arrays.where,
                got=f"{amplitude.shape}, {phase.shape}",
                expected="equal shapes",
                advice="name two arrays of one FRF",
            )
        return to_complex(arrays, layout, amplitude, phase)
    raise InputError(
        "half of an FRF", where=arrays.where, advice="say frf, or real and imaginary, or amplitude and phase"
    )


def _stated(arrays: Arrays, place: str) -> str:
    return arrays.units.get(place, UNSTATED)


def _refuse_polar(arrays: Arrays, place: str) -> None:
    """Refuse a place whose title says that it holds an amplitude in dB or a phase.

    Raises
    ------
    InputError : it does.
    """
    title = arrays.title(place)
    if says_logarithmic(title) or phase_scale(arrays.label(place)) is not None:
        raise InputError(
            "not real and imaginary part", where=arrays.where, got=repr(title), advice="say amplitude and phase"
        )


def _length(values: Any, layout: Layout) -> int:
    """Number of lines of an array of FRFs: along the axis that the layout states, else the longest."""
    shape: tuple[int, ...] = np.squeeze(values).shape or (1,)
    return {"columns": shape[0], "rows": shape[-1]}.get(layout.axis, max(shape))


def _freq_out_in(values: Any, lines: int, layout: Layout, where: str) -> Any:
    """Any arrangement of the FRFs as (freq, out, in), frequency being the axis of the right length.

    Raises
    ------
    InputError : no axis has this length, or several have and the layout does not say which it is.
    """
    values = np.asarray(values)
    values = values if values.ndim == 3 and lines in values.shape else np.squeeze(values)
    places = [axis for axis, length in enumerate(values.shape) if length == lines]
    if values.ndim == 0 or values.ndim > 3 or not places:
        raise InputError(
            "FRFs and frequencies differ in length",
            where=where,
            got=f"values of shape {values.shape}",
            expected=f"{lines} lines",
        )
    if len(places) > 1:
        places = [place for place in places if place == {"columns": 0, "rows": values.ndim - 1}.get(layout.axis)]
    if not places:
        raise InputError(
            "nothing says which axis of an array is that of frequency",
            where=where,
            got=f"values of shape {values.shape}",
            expected=f"one axis of {lines} lines",
            advice="say axis='columns' where frequency is the first axis, axis='rows' where it is the last",
        )
    values = np.moveaxis(values, places[0], 0)
    if values.ndim == 1:
        return values[:, None, None]
    if values.ndim == 3:
        return values
    one_input = layout.inputs is None or isinstance(layout.inputs, str) or len(layout.inputs) == 1
    return values[:, :, None] if one_input else values[:, None, :]


def _dofs(arrays: Arrays, given: Any, count: int) -> tuple[Dof, ...]:
    """DOFs as said, else scalar ones numbered from 1."""
    if given is None:
        return tuple(Dof(number) for number in range(1, count + 1))
    texts = arrays.texts(given)
    if len(texts) != count:
        raise InputError("the number of DOFs", where=arrays.where, got=len(texts), expected=count)
    dofs = tuple(Dof.parse(text) for text in texts)
    if len(set(dofs)) < count:
        raise InputError(
            "a DOF is named twice",
            where=arrays.where,
            got=", ".join(map(str, dofs)),
            expected=f"{count} different DOFs",
        )
    return dofs
