"""What the arrays of a file that does not describe itself are: time axes, signals, FRFs, positions, stepped levels."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from acquisition import UndescribedError

STEADY = 0.25
"""Share of a step by which the values of a time or frequency axis may be off: rounded text columns are, noise is not.
The readers refuse an axis beyond it."""

SHORTEST = 64
"""Samples from which a column of numbers may be a signal; half as many are tables of settings and results."""

_UNIT = re.compile(r"(?P<owner>.*?)(?P<joint>[ ._/]*)(units?|einheit(en)?)", re.IGNORECASE)
"""Name of a text that states a unit: that of the signal or of the group of signals before it."""
_RATE = re.compile(r"(sampl\w*[ _]?(rate|freq\w*)|^fs$|(^|[./_])fs$|sample_?rate)", re.IGNORECASE)
_STEP = re.compile(r"(^|[./_])(dt|delta_?t)$", re.IGNORECASE)
_TIME = re.compile(r"(^|[./_ ])(t|time|zeit)([./_ \[(]|$)", re.IGNORECASE)
_FREQUENCY = re.compile(r"(^|[./_ ])(f|freq\w*)([./_ \[(]|$)", re.IGNORECASE)
_FRF = re.compile(r"(^|[./_ ])(h\d*f?|frf|tf|accelerance|mobility|receptance|compliance)([./_ \d]|$)", re.IGNORECASE)
_OTHER_SPECTRUM = re.compile(r"(psd|csd|cross|auto|lin_?spec|power|coh)", re.IGNORECASE)
_COHERENCE = re.compile(r"coh", re.IGNORECASE)
_RESPONSES = ("response", "amplitude", "acceleration", "velocity", "displacement")
_LEVEL_COLUMNS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "frequency": (r"^(f|freq\w*)$", ("frequency",)),
    "force": (r"force|kraft", ("force",)),
    "response": (
        r"response|amplitude|acc|beschl|vel|geschw|disp|weg|antwort",
        ("acceleration", "velocity", "displacement"),
    ),
    "phase": (r"phase|phi$", ("rotation",)),
}
"""Columns of a level: words of their titles where a column has no unit, and quantities of their units."""
_SHAPE = re.compile(r"(shape|^u\d+$|phi|psi|mode|eigvec|freq)", re.IGNORECASE)


@dataclass(frozen=True)
class LevelColumns:
    """One level of a stepped sine, in a table of its own.

    ``columns`` are the titles of ``frequency``, ``force``, ``response`` and ``phase``; ``unstated`` those of the four
    without a unit. ``median`` and ``spread`` (standard deviation over mean) are those of force and response.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    unstated: tuple[str, ...] = ()
    median: Mapping[str, float] = field(default_factory=dict)
    spread: Mapping[str, float] = field(default_factory=dict)

    def height(self, control: str) -> float:
        """The force of a level with constant force, else the response, in the unit of the file."""
        return self.median["force" if control == "force" else "response"]


@dataclass(frozen=True)
class Described:
    """What the arrays of one file seem to be.

    ``kind`` is ``"records"``, ``"FRFs"``, ``"levels"``, ``"level"``, ``"positions"``, ``"shapes"`` or ``""`` where
    nothing can be said. ``reader`` holds the options of :func:`acquisition.read` that say it, ``levels`` the tables of
    stepped sines by the name of their run, ``level`` the columns of a table that is one level, ``positions`` the titles
    of the columns x, y and z by what they have in common.
    ``needs_rate`` says that nothing states the sampling rate. ``evidence`` is a sentence for the reader.
    """

    kind: str = ""
    reader: Mapping[str, Any] = field(default_factory=dict)
    levels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    level: LevelColumns | None = None
    positions: Mapping[str, tuple[str, str, str]] = field(default_factory=dict)
    needs_rate: bool = False
    evidence: str = ""


def described(error: UndescribedError) -> Described:
    """Return what the arrays of a file seem to be, from their names, shapes and values.

    Nothing is assumed of units. A time axis rises in equal steps; a block of signals has a long and a short side; an
    FRF is complex and as long as an axis of frequencies.

    Parameters
    ----------
    error : UndescribedError
        What the reader of the file raised; it holds the arrays.

    Returns
    -------
    Described
    """
    pool = {name: np.asarray(value) for name, value in error.arrays.arrays.items()}
    numbers = {name: np.squeeze(value) for name, value in pool.items() if value.dtype.kind in "iufc" and value.size}
    metadata = dict(error.arrays.metadata)
    for find in (_levels, _level, _frfs, _records):
        description = find(numbers, metadata, error)
        if description.kind:
            return description
    if positions := _positions(numbers):
        return Described("positions", positions=positions, evidence="coordinates by the names of the columns")
    if any(_SHAPE.search(name) for name in numbers) or any(value.ndim == 3 for value in numbers.values()):
        return Described("shapes", evidence=f"{error.arrays.listing()}: looks like mode shapes or frequencies")
    return Described(evidence=error.arrays.listing())


def _axis_step(values: Float[np.ndarray, "n"] | Any) -> float | None:
    """The step of an axis in equal steps from 0 or above; ``None`` where it is none."""
    if values.ndim != 1 or len(values) < SHORTEST or values.dtype.kind == "c":
        return None
    values = values.astype(np.float64)
    if not np.isfinite(values).all() or values[-1] <= values[0]:
        return None
    step = (values[-1] - values[0]) / (len(values) - 1)
    off = np.abs(values - values[0] - step * np.arange(len(values)))
    return float(step) if off.max() <= STEADY * step else None


def _levels(numbers: Mapping[str, np.ndarray], metadata: Mapping[str, str], error: UndescribedError) -> Described:
    """Stepped sines: numbered groups with frequency, force, response and phase of one length."""
    groups: dict[str, dict[str, str]] = {}
    for name in numbers:
        match = re.match(r"^(?P<group>.*?)[./]\d+[./](?P<column>[A-Za-z]\w*)$", name)
        if match:
            stated = groups.setdefault(match["group"], {})
            stated.setdefault(match["column"].lower(), re.sub(r"([./])\d+([./][A-Za-z]\w*)$", r"\1*\2", name))
    levels: dict[str, dict[str, str]] = {}
    for group, columns in groups.items():
        response = next((name for name in _RESPONSES if name in columns), "")
        if response and {"frequency", "force", "phase"} <= columns.keys():
            control = _held(numbers, columns["force"], columns[response])
            levels[re.split(r"[./]", group)[-1]] = {
                "control": control,
                "frequency": columns["frequency"],
                "force": columns["force"],
                "response": columns[response],
                "phase": columns["phase"],
            }
    return Described("levels", levels=levels, evidence="tables of stepped sines") if levels else Described()


def _held(numbers: Mapping[str, np.ndarray], force: str, response: str) -> str:
    """Which of force and response the controller held: the one that varies less within a level."""

    def spread(pattern: str) -> float:
        """Median over the levels of the standard deviation over the mean."""
        before, _, after = pattern.partition("*")
        rows = [value for name, value in numbers.items() if name.startswith(before) and name.endswith(after)]
        return float(np.median([np.std(row) / np.mean(np.abs(row)) for row in rows]))

    return "force" if spread(force) < spread(response) else "response"


def _level(numbers: Mapping[str, np.ndarray], metadata: Mapping[str, str], error: UndescribedError) -> Described:
    """One level of a stepped sine: a text table with one column each of frequency, force, response and phase."""
    from ema.proposal.units import quantity_of

    found: dict[str, list[str]] = {kind: [] for kind in _LEVEL_COLUMNS}
    unstated: set[str] = set()
    titles = [] if error.arrays.where.lower().endswith(".xlsx") else error.arrays.titles
    for title in titles:
        quantity = quantity_of(error.arrays.label(title))
        if quantity == "time" or _TIME.search(title):
            return Described()
        for kind, (words, quantities) in _LEVEL_COLUMNS.items():
            if quantity in quantities or (not quantity and re.search(words, title, re.IGNORECASE)):
                found[kind].append(title)
                unstated |= set() if quantity else {kind}
    if any(len(names) != 1 or names[0] not in numbers for names in found.values()):
        return Described()
    columns = {kind: names[0] for kind, names in found.items()}
    amplitudes = {kind: np.abs(numbers[columns[kind]]) for kind in ("force", "response")}
    level = LevelColumns(
        columns,
        tuple(kind for kind in columns if kind in unstated),
        {kind: float(np.median(row)) for kind, row in amplitudes.items()},
        {kind: float(np.std(row) / (np.mean(row) or 1.0)) for kind, row in amplitudes.items()},
    )
    return Described("level", level=level, evidence="columns of frequency, force, response and phase")


def _frfs(numbers: Mapping[str, np.ndarray], metadata: Mapping[str, str], error: UndescribedError) -> Described:
    """Complex arrays as long as an axis of frequencies."""
    axes = {
        name: len(value)
        for name, value in numbers.items()
        if _axis_step(value) is not None and _FREQUENCY.search(name) and not _TIME.search(name)
    }
    for axis, lines in axes.items():
        candidates = [
            name
            for name, value in numbers.items()
            if np.iscomplexobj(value) and lines in value.shape and not _OTHER_SPECTRUM.search(name)
        ]
        named = [name for name in candidates if _FRF.search(name)] or candidates
        if len(named) != 1:
            continue
        reader: dict[str, Any] = {"frequency": axis, "frf": named[0]}
        coherence = [
            name
            for name, value in numbers.items()
            if _COHERENCE.search(name) and value.shape == numbers[named[0]].shape and not np.iscomplexobj(value)
        ]
        if len(coherence) == 1:
            reader["coherence"] = coherence[0]
        return Described("FRFs", reader, evidence=f"{named[0]} is complex and as long as {axis}")
    return Described()


def _records(numbers: Mapping[str, np.ndarray], metadata: Mapping[str, str], error: UndescribedError) -> Described:
    """A block of signals, or vectors of one length."""
    main = error.arrays.main
    blocks = {
        name: value
        for name, value in numbers.items()
        if value.ndim == 2 and max(value.shape) >= max(SHORTEST, 4 * min(value.shape)) and not np.iscomplexobj(value)
    }
    if main in blocks:
        blocks = {main: blocks[main]}
    rate = next((name for name, value in numbers.items() if value.ndim == 0 and _RATE.search(name)), None)
    if len(blocks) == 1:
        (name, block), rows = next(iter(blocks.items())), False
        rows = block.shape[0] < block.shape[1]
        reader: dict[str, Any] = {"signals": name} if name else {}
        reader["axis"] = "rows" if rows else "columns"
        beside = [one for one, value in numbers.items() if _is_signal(value, max(block.shape))]
        if name and beside:  # a force of its own beside the block of the responses
            reader["signals"] = [one for one in numbers if one in beside or one == name]
        first = block[0] if rows else block[:, 0]
        axis = f"{name} {'row' if rows else 'column'} 0".strip()
        times = [one for one, value in numbers.items() if len(value.shape) == 1 and _is_time(one, value)]
        if not (_axis_step(first) is not None and first[0] >= 0):
            axis = next((one for one in times if len(numbers[one]) == max(block.shape)), "")
        if axis:
            return Described("records", reader | {"time": axis}, evidence=f"{axis} is the time axis")
        if rate is not None:
            return Described("records", reader | {"sampling_rate": rate}, evidence=f"sampling rate from {rate}")
        return Described("records", reader, needs_rate=True, evidence="a block of signals without a time axis")
    return _vectors(numbers, metadata)


def _vectors(numbers: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> Described:
    """Signals as vectors of one length beside a time axis or a sampling rate."""
    for time, value in numbers.items():
        if not _is_time(time, value):
            continue
        signals = [name for name, other in numbers.items() if name != time and _is_signal(other, len(value))]
        if not signals:
            continue
        reader: dict[str, Any] = {"signals": signals, "time": time}
        units = _stated_units(signals, time, numbers, metadata)
        if (time_unit := units.pop(time, "s")) != "s":
            reader["time_unit"] = time_unit
        if units:
            reader["units"] = units
        return Described("records", reader, evidence=f"{time} is the time axis")
    vectors = [value for value in numbers.values() if value.ndim == 1 and len(value) >= SHORTEST]
    stated = [
        name for name, value in numbers.items() if value.ndim == 0 and value.dtype.kind != "c" and _RATE.search(name)
    ]
    if len({float(numbers[name]) for name in stated}) != 1 or len({len(value) for value in vectors}) != 1:
        return Described()
    signals = [name for name, value in numbers.items() if _is_signal(value, len(vectors[0]))]
    reader = {"signals": signals, "sampling_rate": stated[0]}
    if units := _stated_units(signals, "", numbers, metadata):
        reader["units"] = units
    return Described("records", reader, evidence=f"sampling rate from {stated[0]}") if signals else Described()


def _is_time(name: str, values: np.ndarray) -> bool:
    """Whether an array rises in equal steps and is called a time."""
    return _axis_step(values) is not None and bool(_TIME.search(re.sub(r"([a-z])([A-Z])", r"\1_\2", name)))


def _is_signal(values: np.ndarray, samples: int) -> bool:
    """Whether an array is one real signal of so many samples, and no axis."""
    return values.shape == (samples,) and not np.iscomplexobj(values) and _axis_step(values) is None


def _stated_units(
    signals: Sequence[str], time: str, numbers: Mapping[str, np.ndarray], metadata: Mapping[str, str]
) -> dict[str, str]:
    """Units by array, that of the time axis among them: those stated beside an array or in its group.

    A unit that belongs to no array, as in ``info.units``, is that of all signals. A text may state the unit of the
    signals beside that of time: ``s, m/s^2``.
    """
    from ema.proposal.units import quantity_of

    own_units: dict[str, str] = {}
    shared: dict[str, set[str]] = {}
    stated = [(match, text) for name, text in metadata.items() if (match := _UNIT.fullmatch(name))]
    for match, text in sorted(stated, key=lambda one: len(one[0]["owner"])):  # the nearest group comes last
        owner = match["owner"]
        own = [name for name in numbers if name == owner or (owner and name.startswith((f"{owner}.", f"{owner}/")))]
        parts = {part.strip(): quantity_of(part.strip()) for part in text.split(",")}
        for names, is_time in (([time], True), (signals, False)):
            units = [part for part, quantity in parts.items() if quantity and (quantity == "time") == is_time]
            if len(units) != 1:
                continue
            if any(name == owner or not _RATE.search(name) for name in own):
                own_units |= dict.fromkeys((name for name in names if name in own), units[0])
            elif not owner or match["joint"] in (".", "/"):
                for name in names:
                    shared.setdefault(name, set()).add(units[0])
    return {name: next(iter(units)) for name, units in shared.items() if len(units) == 1} | own_units


def _positions(numbers: Mapping[str, np.ndarray]) -> dict[str, tuple[str, str, str]]:
    """Triples of columns such as ``xHammer, yHammer, zHammer`` by what they have in common."""
    triples: dict[str, tuple[str, str, str]] = {}
    for name in numbers:
        rest = re.match(r"^[xX][ _]?(.*)$", name)
        if rest is None:
            continue
        axes = "xyz" if name[0] == "x" else "XYZ"
        names = (name, axes[1] + name[1:], axes[2] + name[1:])
        if all(one in numbers and numbers[one].shape == numbers[name].shape for one in names):
            triples[rest[1]] = names
    return triples
