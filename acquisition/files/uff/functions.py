"""Functions (data set 58) become recordings and FRF sets."""

from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from acquisition.files.arrays import not_finite
from acquisition.files.ratios import checked_coherences
from acquisition.files.signals import nice_rate, rate_of
from acquisition.files.uff import header58
from acquisition.files.uff.header58 import Header, Point
from acquisition.files.uff.index import Entry
from acquisition.files.uff.unit_system import (
    Scale,
    UnitSystem,
    channel_unit,
    frf_scale,
    frf_units,
    scale,
    unit_before_si,
)
from acquisition.files.uff.values58 import Function
from acquisition.units import Unit
from ema.data import Channel, Finding, FrfSet, Recording
from ema.dof import Dof
from ema.errors import EmaError, InputError
from ema.units import UNSTATED

Fetch = Callable[[Entry], Function]
_ByPair = dict[tuple[Dof, Dof | None], deque[Entry]]
"""Coherences of each output and input in the order of the file; multiple ones have no input."""


class Damaged(ValueError):
    """The values of a function cannot be used; why is noted already."""


@dataclass
class Gathered:
    """What the functions of a file became."""

    recordings: list[Recording] = field(default_factory=list)
    frfs: Sequence[FrfSet] = ()
    findings: list[Finding] = field(default_factory=list)
    units: list[tuple[str, Unit]] = field(default_factory=list)
    """Channels, and their units before they became SI."""
    frf_units: dict[tuple[Unit, Unit], None] = field(default_factory=dict)
    """Units of response and force of the FRFs before they became SI."""
    noted: set[str] = field(default_factory=set)
    """Wordings of the findings about units."""


def dof_of(point: Point) -> Dof:
    """The DOF of a header; an entity that only repeats the DOF in words is dropped."""
    part = "" if point.entity.upper() in ("", "NONE") else point.entity
    try:
        Dof.parse(part)
    except InputError:
        return Dof.from_uff(point.node, point.direction, part)
    return Dof.from_uff(point.node, point.direction)


def gather(entries: Iterable[Entry], systems: dict[int, UnitSystem], fetch: Fetch, where: str) -> Gathered:
    """Recordings and FRF sets of the functions of a file.

    Parameters
    ----------
    systems : unit system that holds for each data set, by number.
    fetch : reads the values of one data set.
    """
    made = Gathered()
    fetch = _remembering(fetch, made, where)
    times, ratios, coherences = [], [], []
    others: dict[str, int] = {}
    for entry in entries:
        header = entry.header
        if header is None:
            continue
        try:
            dof_of(header.response), dof_of(header.reference)
        except EmaError as error:
            made.findings.append(_problem(where, entry, str(error)))
            continue
        if header.undirected:
            message = "a DOF without direction, taken as a scalar."
            made.findings.append(
                Finding(
                    "warning",
                    "no-direction",
                    f"{where}, data set {entry.number + 1}",
                    message,
                    advice="Check the DOFs.",
                )
            )
        if header.function == header58.TIME and not header.is_complex:
            times.append(entry)
        elif header.function == header58.FRF and header.is_complex:
            ratios.append(entry)
        elif header.function in (header58.COHERENCE, header58.MULTIPLE_COHERENCE) and not header.is_complex:
            coherences.append(entry)
        else:
            others[header.title] = others.get(header.title, 0) + 1
    for title, count in others.items():
        message = f"{count} data set{'s' if count > 1 else ''} of kind '{title}' not read."
        made.findings.append(
            Finding("info", "not-read", where, message, advice="FRFs, coherences and time signals are.")
        )
    _recordings(made, times, systems, fetch, where)
    _frf_sets(made, ratios, coherences, systems, fetch, where)
    return made


_KEPT = 64 << 20
"""Bytes of values that are kept between the passes over a file: counting, grouping, putting together."""


def _remembering(fetch: Fetch, made: Gathered, where: str) -> Fetch:
    """``fetch`` that notes the damage of a function, once, and keeps as many functions as take little memory."""
    bad: set[int] = set()
    kept: dict[int, Function] = {}
    room = _KEPT

    def once(entry: Entry) -> Function:
        """The function of an entry."""
        nonlocal room
        if entry.number in bad:
            raise Damaged
        if entry.number in kept:
            return kept[entry.number]
        try:
            function = fetch(entry)
        except ValueError as error:
            bad.add(entry.number)
            if not isinstance(error, Damaged):
                made.findings.append(_problem(where, entry, str(error)))
            raise Damaged from error
        room -= function.y.nbytes
        if room > 0:
            kept[entry.number] = function
        return function

    return once


def _problem(where: str, entry: Entry, text: str) -> Finding:
    return Finding(
        "error", "damaged-set", f"{where}, data set {entry.number + 1}", text + ".", advice="Export the file again."
    )


def _note(made: Gathered, where: str, entry: Entry, text: str) -> None:
    """A finding about a unit, once for each wording."""
    if text and text not in made.noted:
        made.noted.add(text)
        made.findings.append(
            Finding(
                "warning",
                "unit-doubtful",
                f"{where}, data set {entry.number + 1}",
                text + ".",
                advice="Check the unit, or say it in the channel table.",
            )
        )


def _whole(entry: Entry, fetch: Fetch) -> bool:
    """Whether the values of a function can be used; why not is noted."""
    try:
        fetch(entry)
    except Damaged:
        return False
    return True


def _take(header: Header) -> tuple[Any, ...]:
    """What channels of one record have in common."""
    return (header.points, header.even, header.start, header.step, header.version, header.abscissa.unit)


def _recordings(made: Gathered, entries: list[Entry], systems: dict[int, UnitSystem], fetch: Fetch, where: str) -> None:
    """Time responses: neighbours on one time axis are the channels of one record, until a channel comes again."""
    groups: list[list[Entry]] = []
    axis: tuple[Any, ...] = ()
    known: set[tuple[Any, ...]] = set()
    for entry in entries:
        header = _header(entry)
        channel = (header.response, header.ids[0], header.ordinate.code)
        if _take(header) == axis and channel not in known:
            groups[-1].append(entry)
        else:
            groups.append([entry])
            axis, known = _take(header), set()
        known.add(channel)
    groups = [[entry for entry in group if _whole(entry, fetch)] for group in groups]
    groups = [part for group in groups for part in _of_one_length(group, fetch)]
    for number, group in enumerate(groups):
        name = where if len(groups) == 1 else f"{where}, record {number + 1}"
        try:
            made.recordings.append(_recording(made, group, systems, fetch, name))
        except (ValueError, EmaError) as error:
            made.findings.append(_problem(where, group[0], error.args[0] if error.args else str(error)))


def _of_one_length(group: list[Entry], fetch: Fetch) -> list[list[Entry]]:
    """Channels that are cut short are records of their own, so that the others stay whole."""
    lengths: dict[int, list[Entry]] = {}
    for entry in group:
        lengths.setdefault(len(fetch(entry).y), []).append(entry)
    return [lengths[length] for length in sorted(lengths, reverse=True)]


def _header(entry: Entry) -> Header:
    assert entry.header is not None  # entries without a header were left out before
    return entry.header


def _recording(
    made: Gathered, group: list[Entry], systems: dict[int, UnitSystem], fetch: Fetch, name: str
) -> Recording:
    functions = [fetch(entry) for entry in group]
    length = min(len(function.y) for function in functions)
    if length < 2:
        raise InputError("too short to be a record", where=name, got=f"{length} samples", expected="2 or more")
    first = functions[0]
    clock = _abscissa(made, first.header, "time", name)
    if first.header.even:
        step = clock.factor * first.header.step
        if not 1e-12 < step < 1e9:
            raise InputError(
                "no time step in the header", where=name, got=f"{step:g} s", expected="between 1e-12 and 1e9 s"
            )
        rate = nice_rate(step, 0.5 * 10.0 ** (1 - min(first.header.step_digits, 12)))
    else:
        rate = rate_of(clock.factor * first.x[:length], name)
    rows, channels = [], []
    for entry, function in zip(group, functions, strict=True):
        axis = function.header.ordinate
        found = scale(axis, function.header.response.direction, systems[entry.number])
        if found.stated and channel_unit(found)[0] == "unstated":
            found = Scale("unstated", note=found.note or f"the unit {axis.unit!r} is one of {found.quantity}, not used")
        _note(made, name, entry, found.note)
        rows.append(found.apply(function.y[:length]))
        channels.append(_channel(function.header, found))
        if found.stated:
            made.units.append((channels[-1].name, unit_before_si(axis, found)))
    places = Counter((channel.dof, channel.quantity) for channel in channels)
    if len(places) < len(channels):
        dof = next(place[0] for place, count in places.items() if count > 1)
        message = f"several channels are said to be at {dof}."
        made.findings.append(
            Finding("warning", "duplicated-dof", name, message, advice="Give the right DOFs in the channel table.")
        )
    dtype = np.float32 if all(row.dtype.itemsize == 4 for row in rows) else np.float64
    signals = np.stack([row.astype(dtype) for row in rows])
    made.findings.extend(not_finite(signals, name))
    return Recording(signals, rate, tuple(channels), name=name)


_BASE = {"frequency": ("Hz", "hz", "cps"), "time": ("s", "sec", "secs")}
"""The unit in which an axis is taken that states none, and other spellings of it, in small letters."""


def _abscissa(made: Gathered, header: Header, quantity: str, where: str) -> Scale:
    """Scale of an axis of time or frequency; a unit that is none of it, or a data type of anything else, is named."""
    found, unit = scale(header.abscissa, 0, UnitSystem()), header.abscissa.unit
    if (found.quantity, quantity) == ("angular velocity", "frequency"):
        return Scale(quantity, found.factor / (2 * np.pi), stated=True)
    taken, message = found, ""
    if found.quantity not in (quantity, "unstated"):
        taken = Scale(quantity)
        source = f"unit {unit!r}" if found.stated else "data type"
        message = f"the {source} of the axis is none of {quantity}, and not used."
    elif found.note and unit.lower() not in _BASE[quantity]:
        message = f"{found.note}; the axis is taken in {unit if found.stated else _BASE[quantity][0]}."
    if message:
        made.findings.append(Finding("warning", "unit-doubtful", where, message, advice="Check the axis."))
    return taken


def _channel(header: Header, found: Scale) -> Channel:
    quantity, unit = channel_unit(found)
    dof = dof_of(header.response)
    labels = [text for text in (header.ids[0], header.ordinate.label) if text.upper() not in ("", "NONE")]
    role: Any = "reference" if quantity in ("force", "torque") else "response"
    return Channel(labels[0] if labels else str(dof), dof, quantity, role, unit)


@dataclass(frozen=True)
class _Line:
    """One FRF of a file: its DOFs and the scale to SI."""

    entry: Entry
    output: Dof
    input: Dof
    factor: float


def _axis(header: Header, fetch: Callable[[], Function]) -> tuple[Any, ...]:
    """What FRFs on one frequency axis have in common."""
    if header.even:
        return (header.points, header.start, header.step, header.abscissa.unit)
    return (header.points, fetch().x.tobytes(), header.abscissa.unit)


def _frf_sets(
    made: Gathered,
    entries: list[Entry],
    coherences: list[Entry],
    systems: dict[int, UnitSystem],
    fetch: Fetch,
    where: str,
) -> None:
    """FRFs on one axis, of one quantity and unit, become one block of outputs and inputs."""
    groups: dict[tuple[Any, ...], list[_Line]] = {}
    counts: dict[tuple[Any, ...], int] = {}
    for entry in entries:
        header, system = _header(entry), systems[entry.number]
        above = scale(header.ordinate, header.response.direction, system)
        below = scale(header.denominator, header.reference.direction, system)
        found = frf_scale(above, below)
        _note(made, where, entry, found.note)
        if found.unit != UNSTATED:
            made.frf_units.update(dict.fromkeys(frf_units(header, above, below)))
        line = _Line(entry, dof_of(header.response), dof_of(header.reference), found.factor)
        try:
            key = (*_axis(header, lambda entry=entry: fetch(entry)), found.quantity, found.unit)  # type: ignore[misc]
        except Damaged:
            continue
        pair = (*key, line.output, line.input)
        counts[pair] = counts.get(pair, 0) + 1
        groups.setdefault((*key, counts[pair]), []).append(line)
    twice = [pair for pair, count in counts.items() if count > 1]
    if twice:
        first = f"{twice[0][-2]}/{twice[0][-1]}"
        message = f"{len(twice)} FRFs occur more than once, first {first}; each copy is a set of its own."
        made.findings.append(Finding("warning", "duplicated-dof", where, message, float(len(twice)), 0.0))
    blocks = [(key, block) for key, lines in groups.items() for block in _blocks(made, lines, where)]
    left = _by_pair(coherences)
    sets: list[FrfSet] = []
    for number, (key, lines) in enumerate(blocks):
        name = where if len(blocks) == 1 else f"{where}, FRF set {number + 1}"
        try:
            sets.append(_frf_set(made, lines, key[-3], key[-2], left, fetch, name))
        except (ValueError, EmaError) as error:
            whole = [line for line in lines if _whole(line.entry, fetch)]
            whole = [line for line in whole if len(fetch(line.entry).y) == _header(line.entry).points]
            if whole and len(whole) < len(lines):
                blocks.extend((key, block) for block in _blocks(made, whole, where))
            elif whole:
                made.findings.append(_problem(where, lines[0].entry, error.args[0] if error.args else str(error)))
    made.frfs, odd = checked_coherences(sets, where)
    made.findings += odd
    alone = sum(map(len, left.values()))
    if alone:
        message = f"{alone} coherences belong to no FRF of the file and are not read."
        made.findings.append(Finding("warning", "coherence-alone", where, message, float(alone), 0.0))


def _blocks(made: Gathered, lines: list[_Line], where: str) -> list[list[_Line]]:
    """The lines as full matrices of outputs and inputs, as few as possible."""
    outputs = {line.output for line in lines}
    inputs = {line.input for line in lines}
    if len(lines) == len(outputs) * len(inputs):
        return [lines]

    def full(mine: str, other: str) -> list[list[_Line]]:
        """The lines grouped by the DOFs on side ``mine`` that have the same DOFs on the other side."""
        across: dict[Dof, set[Dof]] = {}
        for line in lines:
            across.setdefault(getattr(line, mine), set()).add(getattr(line, other))
        alike: dict[frozenset[Dof], list[_Line]] = {}
        for line in lines:
            alike.setdefault(frozenset(across[getattr(line, mine)]), []).append(line)
        return list(alike.values())

    blocks = min((full("input", "output"), full("output", "input")), key=len)
    matrix = f"{len(outputs)} outputs and {len(inputs)} inputs"
    message = f"{len(lines)} FRFs do not fill the matrix of {matrix}; they are {len(blocks)} sets."
    made.findings.append(Finding("info", "incomplete-matrix", where, message))
    return blocks


def _frf_set(
    made: Gathered, lines: list[_Line], quantity: Any, unit: str, coherences: _ByPair, fetch: Fetch, name: str
) -> FrfSet:
    outputs = tuple(dict.fromkeys(line.output for line in lines))
    inputs = tuple(dict.fromkeys(line.input for line in lines))
    rows = {dof: place for place, dof in enumerate(outputs)}
    columns = {dof: place for place, dof in enumerate(inputs)}
    first = fetch(lines[0].entry)
    frequencies = _abscissa(made, first.header, "frequency", name).apply(first.x)
    block = np.empty((len(outputs), len(inputs), len(frequencies)), dtype=np.complex128)
    for line in lines:
        function = fetch(line.entry)
        if len(function.y) != len(frequencies):
            raise InputError(
                "an FRF is cut short", where=name, got=f"{len(function.y)} lines", expected=f"{len(frequencies)}"
            )
        target = block[rows[line.output], columns[line.input]]
        target[:] = function.y
        if line.factor != 1.0:
            target *= line.factor
    if np.any(np.diff(frequencies) <= 0) or not np.isfinite(frequencies).all():
        raise InputError(
            "the frequencies do not increase",
            where=name,
            got=f"{len(frequencies)} lines",
            expected="finite frequencies, each above the one before",
        )
    made.findings.extend(not_finite(block, name))
    coherence = _coherence(coherences, first, outputs, inputs, fetch)
    dates = sorted({_header(line.entry).ids[2] for line in lines})
    return FrfSet(
        frequencies,
        block.transpose(2, 0, 1),
        outputs,
        inputs,
        quantity,
        unit,
        coherence,
        name=name,
        estimator=f"file {dates[0]}" if dates[0] != "NONE" else "file",
    )


def _by_pair(coherences: Iterable[Entry]) -> _ByPair:
    found: _ByPair = {}
    for entry in coherences:
        header = _header(entry)
        multiple = header.function == header58.MULTIPLE_COHERENCE
        pair = (dof_of(header.response), None if multiple else dof_of(header.reference))
        found.setdefault(pair, deque()).append(entry)
    return found


def _coherence(left: _ByPair, like: Function, outputs: tuple[Dof, ...], inputs: tuple[Dof, ...], fetch: Fetch) -> Any:
    """Coherences of a block on the axis of a function, NaN where there is none; those used are taken out."""
    block, used = np.full((len(like.y), len(outputs), len(inputs)), np.nan), False
    axis = _axis(like.header, lambda: like)
    for row, output in enumerate(outputs):
        multiple = _next_coherence(left.get((output, None)), axis, fetch)
        if multiple is not None:
            block[:, row], used = multiple.y[:, None], True
        for column, input_ in enumerate(inputs):
            function = _next_coherence(left.get((output, input_)), axis, fetch)
            if function is not None:
                block[:, row, column], used = function.y, True
    return block if used else None


def _next_coherence(left: deque[Entry] | None, axis: tuple[Any, ...], fetch: Fetch) -> Function | None:
    """The first coherence that is left and lies on an axis; it is taken out, and so are damaged ones in front of it."""
    others: list[Entry] = []
    chosen = None
    while left and chosen is None:
        entry = left.popleft()
        if not _whole(entry, fetch):
            continue
        function = fetch(entry)
        if _axis(function.header, lambda function=function: function) == axis:  # type: ignore[misc]
            chosen = function if len(function.y) == function.header.points else None
        else:
            others.append(entry)
    if left is not None:
        left.extendleft(reversed(others))
    return chosen
