"""Time signals in named arrays become a recording."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.arrays import PLACE, Arrays, not_finite
from acquisition.files.layout import Layout
from acquisition.files.polar import unit_overruled
from ema.data import Channel, Finding, Recording
from ema.dof import Dof
from ema.errors import InputError
from ema.units import QUANTITIES, UNSTATED

CLOCK = 1e-3
"""Relative difference of two statements of one sampling rate: clocks are ten times better, rounded steps as good.
Halved or doubled, a rate given with three digits is refused or taken."""

SLOW = 50.0
"""Sampling rate in Hz below which times without a unit are named. Joints and their hosts vibrate above 25 Hz as a rule;
at twice that, loggers of slow quantities are named more often, at half, times in ms of 50 kHz and more no longer."""
_RATES = ("fs", "samplingrate", "samplerate", "samplingfrequency", "samplefrequency", "samplefreq")
_INTERVALS = ("dt", "ts", "deltat", "samplinginterval", "sampleinterval", "timestep", "wfincrement")


def rate_of(times: Float[np.ndarray, "sample"], where: str) -> float:
    """Sampling rate in Hz of a time axis in s, whose steps may be rounded.

    Raises
    ------
    InputError : fewer than two samples, or a step that is not constant.
    """
    if len(times) < 2 or not np.all(np.isfinite(times)) or times[-1] <= times[0]:
        raise InputError(
            "no increasing time axis",
            where=where,
            got=f"{len(times)} values",
            expected="two or more finite times, the last after the first",
        )
    step = (times[-1] - times[0]) / (len(times) - 1)
    off = np.abs(times - times[0] - step * np.arange(len(times)))
    if off.max() > 0.25 * step:
        raise InputError(
            "the time steps are not constant",
            where=where,
            got=f"{off.max() / step:.2g} of a step off at sample {off.argmax()}",
            expected=f"a constant step of {step:.6g} s",
            advice="resample the signals or cut the file at the gap",
        )
    # both ends may be rounded by as much as any other value is off
    return nice_rate(float(step), 1e-6 + 2 * float(off.max()) / float(times[-1] - times[0]))


def nice_rate(step: float, tolerance: float) -> float:
    """Sampling rate in Hz of a step in s that is known within a relative tolerance: a whole number if one fits."""
    rate = 1.0 / step
    whole = round(rate)
    return float(whole) if whole and abs(whole / rate - 1) <= tolerance else rate


def channel_units(arrays: Arrays, layout: Layout, names: Sequence[str], stated: Sequence[str]) -> list[units.Unit]:
    """Unit of every channel: the user's, else that ``stated`` by the file, else unstated.

    Raises
    ------
    UnitError : a unit is unknown.
    """
    given = layout.units
    if isinstance(given, Mapping):
        texts = [given.get(name, text) for name, text in zip(names, stated, strict=True)]
    elif given is not None:
        listed = arrays.texts(given)
        texts = listed * len(names) if len(listed) == 1 else listed
    else:
        texts = list(stated)
    if len(texts) != len(names):
        raise InputError(
            "the number of units", where=arrays.where, got=len(texts), expected=f"{len(names)}, one per channel"
        )
    return [units.parse(text) for text in texts]


def overruled_unit(name: str, text: str, taken: units.Unit, where: str) -> tuple[Finding, ...]:
    """A finding where the unit that is taken is not the one that the file states."""
    there = units.known(text) if text else None
    if there is None or not there.stated or (there.factor, there.quantity) == (taken.factor, taken.quantity):
        return ()
    return (unit_overruled(f"{where}, {name}", "unit", text, taken.text),)


def overruled_units(
    layout: Layout, names: Sequence[str], stated: Sequence[str], taken: Sequence[units.Unit], where: str
) -> tuple[Finding, ...]:
    """Findings where the layout states another unit than the file, or one of a channel that is not there."""
    three = zip(names, stated, taken, strict=True)
    notes = [note for name, text, unit in three for note in overruled_unit(name, text, unit, where)]
    for name in layout.units if isinstance(layout.units, Mapping) else ():
        if name not in names:
            message = f"the layout states a unit of {name!r}, and no channel is called that."
            advice = "Correct the name: " + ", ".join(names[:20]) + "."
            notes.append(Finding("warning", "unit-doubtful", where, message, advice=advice))
    return tuple(notes)


def labelled_units(
    layout: Layout, names: Sequence[str], labels: Sequence[str], where: str
) -> tuple[list[units.Unit], list[Finding]]:
    """Unit of every channel of a file whose labels may be no units, and findings about them.

    Raises
    ------
    InputError : the layout states another number of units than there are channels.
    UnitError : a unit of the layout is unknown.
    """
    stated = [text if text and units.known(text) else UNSTATED for text in labels]
    taken = channel_units(Arrays(where, {}), layout, names, stated)
    notes = []
    for name, text, known, unit in zip(names, labels, stated, taken, strict=True):
        by_layout = name in layout.units if isinstance(layout.units, Mapping) else layout.units is not None
        if text and known == UNSTATED and not by_layout:
            message = f"{text!r} is not a unit; the numbers are taken without one."
            notes.append(Finding("warning", "unknown-unit", f"{where}, {name}", message))
        notes += unmeasured(name, unit, where)
    return taken, [*notes, *overruled_units(layout, names, stated, taken, where)]


def make_recording(
    signals: Any, names: Sequence[str], unit: Sequence[units.Unit], sampling_rate: float, where: str, **more: Any
) -> Recording:
    """A recording with its signals in SI; numbers of what no sensor measures, such as %, as they stand."""
    unit = [u if u.quantity in QUANTITIES else units.parse(UNSTATED) for u in unit]
    if not (np.isfinite(sampling_rate) and sampling_rate > 0):
        raise InputError("no sampling rate", where=where, got=f"{sampling_rate} Hz", expected="more than 0 Hz")
    if signals.shape[1] < 2:
        raise InputError(
            "too short to be a record", where=where, got=f"{signals.shape[1]} sample", expected="2 or more"
        )
    if any(not (u.factor == 1 and u.offset == 0) for u in unit):
        signals = np.stack([u.to_si(row) for u, row in zip(unit, signals, strict=True)])
    channels = tuple(make_channel(name, u) for name, u in zip(names, unit, strict=True))
    return Recording(signals, float(sampling_rate), channels, name=where, **more)


def unmeasured(name: str, unit: units.Unit, where: str) -> tuple[Finding, ...]:
    """A finding where the unit of a channel is one of what no sensor measures, such as %."""
    if not unit.stated or unit.quantity in QUANTITIES:
        return ()
    message = (
        f"{unit.text!r} is a unit of {unit.quantity}, which no sensor measures; the numbers are taken without one."
    )
    return (Finding("warning", "unit-doubtful", f"{where}, {name}", message, advice="Say it in the channel table."),)


def before_si(names: Sequence[str], unit: Sequence[units.Unit]) -> tuple[tuple[str, units.Unit], ...]:
    """Names of the channels and the units from which their numbers became SI."""
    pairs = zip(names, unit, strict=True)
    return tuple((name, one) for name, one in pairs if one.stated and one.quantity in QUANTITIES)


def make_channel(name: str, unit: units.Unit, dof: Dof | None = None) -> Channel:
    """A channel of a known unit; a force is taken as the reference."""
    quantity: Any = unit.quantity if unit.quantity in QUANTITIES else "unstated"
    stated = unit.stated and quantity != "unstated"
    role: Any = "reference" if quantity == "force" else "response"
    return Channel(name, dof, quantity, role, unit.si if stated else UNSTATED)


def recording(arrays: Arrays, layout: Layout) -> Contents:
    """Time signals."""
    places = _places(arrays, layout)
    blocks, names = [], []
    stated: list[str] = []
    if layout.time is not None:
        arrays[layout.time]  # a place that is not there is refused before anything is cut by it
    time_of = PLACE.match(layout.time or "")
    for place in places:
        array = np.asarray(arrays[place])
        if array.dtype.kind not in "biuf":
            raise InputError(
                "no real numbers",
                where=arrays.where,
                got=f"{place} of type {array.dtype}",
                advice="name arrays of real numbers by signals=[...]",
            )
        block = array[None] if array.ndim == 1 else _channels_first(array, layout.axis)
        kept = np.ones(len(block), dtype=bool)
        if (
            time_of is not None
            and (time_of["array"] or arrays.main) == place
            and time_of["axis"] == _axis(array, layout)
        ):
            kept[int(time_of["number"])] = False
        default = [place] if array.ndim == 1 else [f"{_axis(array, layout)} {number}" for number in range(len(block))]
        names += [name for name, keep in zip(default, kept, strict=True) if keep]
        of_all = arrays.units.get(place, UNSTATED)
        stated += [arrays.units.get(name, of_all) for name, keep in zip(default, kept, strict=True) if keep]
        blocks.append(block[_rows(kept)])
    lengths = {block.shape[1] for block in blocks}
    if len(lengths) != 1:
        raise InputError(
            "the signals differ in length",
            where=arrays.where,
            got=", ".join(map(str, sorted(lengths))) or "none that fits the times",
            expected="one length for all",
            advice="name signals of one length by signals=[...]",
        )
    signals = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    if layout.names is not None:
        names = _given_names(arrays, layout, len(signals))
    if signals.dtype not in (np.float32, np.float64):
        signals = signals.astype(np.float64)
    rate = _rate(arrays, layout, signals.shape[1])
    unit = channel_units(arrays, layout, names, stated)
    record = make_recording(signals, names, unit, rate, arrays.where)
    odd = [note for name, one in zip(names, unit, strict=True) for note in unmeasured(name, one, arrays.where)]
    odd += overruled_units(layout, names, stated, unit, arrays.where)
    odd += _overruled_time(arrays, layout)
    notes = (*odd, *_assumed_seconds(arrays, layout, rate), *_overruled_rate(arrays, layout, rate))
    findings = (*not_finite(record.signals, arrays.where), *notes)
    return Contents(recordings=(record,), findings=findings, units=before_si(names, unit))


def _assumed_seconds(arrays: Arrays, layout: Layout, rate: float) -> tuple[Finding, ...]:
    """A finding where nothing states the unit of the times and seconds make a rate that hardly shows vibration."""
    if layout.time is None or layout.time_unit or arrays.label(layout.time) or rate >= SLOW:
        return ()
    message = f"nothing states the unit of the times; taken as seconds, they make {rate:.4g} samples a second."
    advice = "Say time_unit='s' or time_unit='ms'."
    return (Finding("warning", "time-unit-assumed", arrays.where, message, rate, SLOW, advice),)


def _overruled_time(arrays: Arrays, layout: Layout) -> tuple[Finding, ...]:
    """A finding where the layout states another unit of the time axis than the file."""
    text = arrays.label(layout.time) if layout.time is not None and layout.time_unit else ""
    there = units.known(text) if text else None
    if there is None or there.quantity != "time" or there.factor == units.parse(str(layout.time_unit)).factor:
        return ()
    return (unit_overruled(arrays.where, "time", text, str(layout.time_unit)),)


def _overruled_rate(arrays: Arrays, layout: Layout, rate: float) -> tuple[Finding, ...]:
    """A finding where the layout or the time axis states a sampling rate and a number beside the signals another."""
    if layout.time is None and not isinstance(layout.sampling_rate, (int, float)):
        return ()
    source = "layout" if layout.time is None else "time axis"
    notes = []
    for name, array in arrays.arrays.items():
        word = re.sub(r"[\s_-]", "", re.split(r"[./]", name)[-1].lower())
        if word not in _RATES + _INTERVALS or np.size(array) != 1 or np.asarray(array).dtype.kind not in "iuf":
            continue
        number = float(np.ravel(array)[0])
        stated = number if word in _RATES else 1 / number if number else 0.0
        if stated <= 0 or abs(stated / rate - 1) > CLOCK:
            message = f"the file says {number:g} of {name}, the {source} {rate:g} Hz; the {source} is taken."
            advice = "Make sure that the one that is taken is right."
            notes.append(Finding("warning", "rate-overruled", arrays.where, message, stated, None, advice))
    return tuple(notes)


def _rows(kept: Bool[np.ndarray, "channel"]) -> "slice | Bool[np.ndarray, 'channel']":
    return slice(None) if kept.all() else kept


def _axis(array: Any, layout: Layout) -> str:
    if layout.axis:
        return layout.axis.rstrip("s")
    return "row" if array.ndim == 1 or array.shape[0] <= array.shape[1] else "column"


def _channels_first(array: Any, axis: str) -> Any:
    """The array with one channel per row; without an axis the longer side is time, and equal sides are asked about."""
    if array.ndim != 2:
        raise InputError("a table of signals is wanted", got=f"an array of shape {array.shape}", expected="two axes")
    if not axis and array.shape[0] == array.shape[1]:
        raise InputError(
            "nothing says whether the rows or the columns of an array are its channels",
            got=f"an array of shape {array.shape}",
            expected="more samples than channels",
            advice="say axis='columns' or axis='rows'",
        )
    if axis == "columns" or (not axis and array.shape[0] > array.shape[1]):
        return array.T
    return array


def _places(arrays: Arrays, layout: Layout) -> list[str]:
    """Where the signals are: as said, or everything but the time axis."""
    if layout.signals is not None:
        return [layout.signals] if isinstance(layout.signals, str) else list(layout.signals)
    if arrays.titles:
        return [title for title in arrays.titles if title not in (layout.time, units.bracketed(layout.time or "")[0])]
    if arrays.main in arrays.arrays and (layout.time is None or PLACE.match(layout.time)):
        return [arrays.main]
    if layout.time is None:
        raise InputError(
            "which array holds the signals?", where=arrays.where, expected=arrays.listing(), advice="signals='...'"
        )
    length = np.size(arrays[layout.time])
    others = [
        n for n, a in arrays.arrays.items() if n not in (layout.time, arrays.main) or (n == arrays.main and n != "")
    ]
    others = [
        n for n in others if n != layout.time and np.size(arrays.arrays[n]) == length and np.ndim(arrays.arrays[n]) > 0
    ]
    return [name for name in others if np.asarray(arrays.arrays[name]).dtype.kind in "biuf"]


def _given_names(arrays: Arrays, layout: Layout, count: int) -> list[str]:
    names = arrays.texts(layout.names)
    if len(names) != count:
        raise InputError(
            "the number of names", where=arrays.where, got=len(names), expected=f"{count}, one per channel"
        )
    return names


def _rate(arrays: Arrays, layout: Layout, samples: int) -> float:
    stated = None
    if isinstance(layout.sampling_rate, str):
        rates = np.unique(arrays.vector(layout.sampling_rate))
        if len(rates) != 1:
            got = f"{len(rates)} values at {layout.sampling_rate}"
            raise InputError(
                "the sampling rate is not one number",
                where=arrays.where,
                got=got,
                advice="say sampling_rate=... [Hz], or name the place of one number",
            )
        stated = float(rates[0])
    elif layout.sampling_rate is not None:
        stated = float(layout.sampling_rate)
    if layout.time is not None:
        times = arrays.vector(layout.time)
        if len(times) != samples:
            raise InputError(
                "time axis and signals differ in length", where=arrays.where, got=len(times), expected=samples
            )
        label = layout.time_unit or arrays.label(layout.time)
        unit = units.known(label or "s")
        if unit is None or unit.quantity != "time":
            raise units.UnitError(
                "not a unit of time",
                where=arrays.where,
                got=repr(label),
                expected="s, ms, min",
                advice="say time_unit='ms' or the like, or sampling_rate=... [Hz]",
            )
        measured = rate_of(unit.factor * times, arrays.where)
        if stated is not None:
            same_rate(measured, stated, samples, arrays.where)
        return measured
    if stated is None:
        raise InputError(
            "the file does not state the sampling rate",
            where=arrays.where,
            advice="say sampling_rate=... [Hz] or time='...'",
        )
    return stated


def same_rate(measured: float, stated: float, samples: int, where: str) -> None:
    """Refuse a sampling rate in Hz that contradicts the time axis of so many samples.

    Raises
    ------
    InputError : they differ by more than clocks and rounded times do.
    """
    # rounding may move both ends of the axis by a quarter of a step, see rate_of
    tolerance = CLOCK + 0.5 / max(samples - 1, 1)
    if not (np.isfinite(stated) and stated > 0) or abs(measured / stated - 1) > tolerance:
        raise InputError(
            "the sampling rate contradicts the time axis",
            where=where,
            got=f"{stated:g} Hz stated",
            expected=f"{measured:g} Hz as in the time axis",
            advice="find out which is right and state that alone",
        )
