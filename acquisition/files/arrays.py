"""Named arrays of a container, arranged as a layout says: recordings, FRFs, geometry or modes."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from acquisition import units
from acquisition.contents import Contents
from acquisition.files.layout import Layout
from ema.data import Channel, Finding, FrfSet, Geometry, ModalModel, Recording, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.units import FRF_UNIT, QUANTITIES, UNSTATED

_PLACE = re.compile(r"^(?P<array>.*?)\s*\b(?P<axis>row|column)\s+(?P<number>\d+)$")


@dataclass(frozen=True)
class Arrays:
    """The arrays of one file by name.

    ``main`` names the array that ``"column 2"`` and ``"row 0"`` mean. ``units`` holds unit strings that the file
    itself states; ``default`` is what the file says about its own layout, overruled by the user's.
    """

    where: str
    arrays: Mapping[str, Any]
    main: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    titles: Sequence[str] = ()
    metadata: tuple[tuple[str, str], ...] = ()

    def listing(self) -> str:
        """The names with their shapes, for messages."""
        shown = [f"{name or 'main array'} {np.shape(array)}" for name, array in self.arrays.items()]
        return ", ".join(shown[:20]) + (" ..." if len(shown) > 20 else "")

    def __getitem__(self, place: str) -> Any:
        """The array at a place.

        Raises
        ------
        InputError : there is no such place.
        """
        if place in self.arrays:
            return self.arrays[place]
        found = _PLACE.match(place)
        if found is None or (found["array"] or self.main) not in self.arrays:
            raise InputError("nothing at this place", where=self.where, got=repr(place), expected=self.listing())
        array, number = np.asarray(self.arrays[found["array"] or self.main]), int(found["number"])
        axis = 0 if found["axis"] == "row" else 1
        if array.ndim != 2 or number >= array.shape[axis]:
            raise InputError(
                f"no {found['axis']} {number}", where=self.where, got=f"an array of shape {array.shape}",
                expected="a smaller number; counting starts at 0",
            )  # fmt: skip
        return array[number] if axis == 0 else array[:, number]

    def vector(self, place: str, dtype: Any = np.float64) -> Any:
        """The numbers at a place as a vector.

        Raises
        ------
        InputError : no such place, no numbers there, or more than a vector.
        """
        return np.squeeze(self.numbers(place, dtype)).reshape(-1) if self._slim(place) else self._not_a_vector(place)

    def _slim(self, place: str) -> bool:
        return sum(length > 1 for length in np.shape(self[place])) <= 1

    def _not_a_vector(self, place: str) -> Any:
        raise InputError(
            "a vector is wanted here", where=self.where, got=f"{place} of shape {np.shape(self[place])}",
            expected="'column 0' or 'row 0' of it",
        )  # fmt: skip

    def numbers(self, place: str, dtype: Any = np.float64) -> Any:
        """The numbers at a place.

        Raises
        ------
        InputError : no such place, or no numbers there.
        """
        array = np.asarray(self[place])
        if array.dtype.kind not in "biufc" or (array.dtype.kind == "c" and dtype == np.float64):
            raise InputError(
                "no real numbers" if dtype == np.float64 else "no numbers", where=self.where,
                got=f"{place} of type {array.dtype}",
            )  # fmt: skip
        return array.astype(dtype)

    def texts(self, value: Any) -> list[str]:
        """Texts given directly, or at a place."""
        if isinstance(value, str):
            value = self.arrays.get(value, [value])
        return [item.decode("utf-8", "replace") if isinstance(item, bytes) else str(item) for item in np.ravel(value)]


def arrange(arrays: Arrays, layout: Layout) -> Contents:
    """The contents of a container of arrays, as its layout says.

    Raises
    ------
    InputError : the layout says too little, names what is not there, or lengths disagree.
    UnitError : an unknown unit.
    """
    verbs = {"signals": recording, "frf": frfs, "geometry": geometry, "modes": modes}
    if not layout.kind:
        raise InputError(
            "the file does not say what its arrays are", where=arrays.where, got=arrays.listing(),
            advice="say it, e.g. signals='...' with time='...' or sampling_rate=..., frequency='...' with real='...' and "
            "imaginary='...', or x, y, z",
        )  # fmt: skip
    contents = verbs[layout.kind](arrays, layout)
    from dataclasses import replace

    return replace(contents, metadata=(*arrays.metadata, *contents.metadata))


def not_finite(values: Any, where: str) -> tuple[Finding, ...]:
    """A finding where some values are NaN or infinite."""
    bad = int(np.size(values) - np.count_nonzero(np.isfinite(values)))
    if not bad:
        return ()
    message = f"{bad} of {np.size(values)} values are NaN or infinite."
    return (Finding("error", "not-finite", where, message, float(bad), 0.0, "Export the file again or leave it out."),)


def rate_of(times: Float[np.ndarray, "sample"], where: str) -> float:
    """Sampling rate in Hz of a time axis in s, whose steps may be rounded.

    Raises
    ------
    InputError : fewer than two samples, or a step that is not constant.
    """
    if len(times) < 2 or not np.all(np.isfinite(times)) or times[-1] <= times[0]:
        raise InputError("no increasing time axis", where=where, got=f"{len(times)} values")
    step = (times[-1] - times[0]) / (len(times) - 1)
    off = np.abs(times - times[0] - step * np.arange(len(times)))
    if off.max() > 0.25 * step:
        raise InputError(
            "the time steps are not constant", where=where, got=f"{off.max() / step:.2g} of a step off at sample {off.argmax()}",
            expected=f"a constant step of {step:.6g} s", advice="resample the signals or cut the file at the gap",
        )  # fmt: skip
    return nice_rate(float(step), 1e-6)


def nice_rate(step: float, tolerance: float) -> float:
    """Sampling rate in Hz of a step in s that is known within a relative tolerance: a whole number if one fits."""
    rate = 1.0 / step
    whole = round(rate)
    return float(whole) if whole and abs(whole / rate - 1) <= tolerance else rate


def channel_units(arrays: Arrays, layout: Layout, names: Sequence[str]) -> list[units.Unit]:
    """Unit of every channel: the user's, else the file's, else unstated.

    Raises
    ------
    UnitError : a unit is unknown.
    """
    given = layout.units
    if isinstance(given, Mapping):
        texts = [given.get(name, arrays.units.get(name, UNSTATED)) for name in names]
    elif given is not None:
        listed = arrays.texts(given)
        texts = listed * len(names) if len(listed) == 1 else listed
    else:
        texts = [arrays.units.get(name, UNSTATED) for name in names]
    if len(texts) != len(names):
        raise InputError(
            "the number of units", where=arrays.where, got=len(texts), expected=f"{len(names)}, one per channel"
        )
    return [units.parse(text) for text in texts]


def make_recording(
    signals: Any, names: Sequence[str], unit: Sequence[units.Unit], sampling_rate: float, where: str, **more: Any
) -> Recording:
    """A recording with its signals in SI."""
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
    time_of = _PLACE.match(layout.time or "")
    for place in places:
        array = np.asarray(arrays[place])
        if array.dtype.kind not in "biuf":
            raise InputError("no real numbers", where=arrays.where, got=f"{place} of type {array.dtype}")
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
        blocks.append(block[_rows(kept)])
    lengths = {block.shape[1] for block in blocks}
    if len(lengths) != 1:
        raise InputError("the signals differ in length", where=arrays.where, got=", ".join(map(str, sorted(lengths))))
    signals = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    if layout.names is not None:
        names = _given_names(arrays, layout, len(signals), names)
    if signals.dtype not in (np.float32, np.float64):
        signals = signals.astype(np.float64)
    rate = _rate(arrays, layout, signals.shape[1])
    record = make_recording(signals, names, channel_units(arrays, layout, names), rate, arrays.where)
    return Contents(recordings=(record,), findings=not_finite(record.signals, arrays.where))


def _rows(kept: Bool[np.ndarray, "channel"]) -> "slice | Bool[np.ndarray, 'channel']":
    return slice(None) if kept.all() else kept


def _axis(array: Any, layout: Layout) -> str:
    if layout.axis:
        return layout.axis.rstrip("s")
    return "row" if array.ndim == 1 or array.shape[0] <= array.shape[1] else "column"


def _channels_first(array: Any, axis: str) -> Any:
    """The array with one channel per row; without an axis the longer side is time."""
    if array.ndim != 2:
        raise InputError("a table of signals is wanted", got=f"an array of shape {array.shape}", expected="two axes")
    if axis == "columns" or (not axis and array.shape[0] > array.shape[1]):
        return array.T
    return array


def _places(arrays: Arrays, layout: Layout) -> list[str]:
    """Where the signals are: as said, or everything but the time axis."""
    if layout.signals is not None:
        return [layout.signals] if isinstance(layout.signals, str) else list(layout.signals)
    if arrays.titles:
        return [title for title in arrays.titles if title not in (layout.time, units.bracketed(layout.time or "")[0])]
    if arrays.main in arrays.arrays and (layout.time is None or _PLACE.match(layout.time)):
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


def _given_names(arrays: Arrays, layout: Layout, count: int, default: list[str]) -> list[str]:
    names = arrays.texts(layout.names)
    if len(names) != count:
        raise InputError(
            "the number of names", where=arrays.where, got=len(names), expected=f"{count}, one per channel"
        )
    return names


def _rate(arrays: Arrays, layout: Layout, samples: int) -> float:
    if layout.time is not None:
        times = arrays.vector(layout.time)
        if len(times) != samples:
            raise InputError(
                "time axis and signals differ in length", where=arrays.where, got=len(times), expected=samples
            )
        stated = arrays.units.get(layout.time, "") if layout.time_unit == "s" else ""
        unit = units.parse(stated or layout.time_unit)
        return rate_of(unit.factor * times, arrays.where)
    if layout.sampling_rate is None:
        raise InputError(
            "the file does not state the sampling rate",
            where=arrays.where,
            advice="say sampling_rate=... [Hz] or time='...'",
        )
    if isinstance(layout.sampling_rate, str):
        return float(arrays.vector(layout.sampling_rate)[0])
    return float(layout.sampling_rate)


def frfs(arrays: Arrays, layout: Layout) -> Contents:
    """FRFs: complex, as real and imaginary part, or as amplitude and phase."""
    values = np.asarray(_complex(arrays, layout))
    if layout.frequency is not None:
        frequencies = arrays.vector(layout.frequency)
    elif layout.frequency_step is not None:
        frequencies = layout.frequency_step * np.arange(max(values.shape))
    else:
        raise InputError(
            "the file does not state its frequencies",
            where=arrays.where,
            advice="say frequency='...' or frequency_step=... [Hz]",
        )
    block = _freq_out_in(values, len(frequencies), layout, arrays.where)
    coherence = None
    if layout.coherence is not None:
        coherence = _freq_out_in(arrays.numbers(layout.coherence), len(frequencies), layout, arrays.where)
    outputs = _dofs(arrays, layout.outputs, block.shape[1])
    inputs = _dofs(arrays, layout.inputs, block.shape[2])
    frf_set = make_frfs(frequencies, block, outputs, inputs, layout.unit, arrays.where, coherence)
    return Contents(frfs=(frf_set,), findings=not_finite(frf_set.values, arrays.where))


def make_frfs(
    frequencies: Any, block: Any, outputs: tuple[Dof, ...], inputs: tuple[Dof, ...], unit: str | None, where: str,
    coherence: Any = None, estimator: str = "",
) -> FrfSet:  # fmt: skip
    """An FRF set in SI.

    Raises
    ------
    InputError : frequencies that do not increase.
    UnitError : a unit that is none of an FRF.
    """
    if len(frequencies) < 1 or not np.all(np.isfinite(frequencies)) or np.any(np.diff(frequencies) <= 0):
        raise InputError("the frequencies do not increase", where=where, got=f"{len(frequencies)} lines")
    parsed = units.parse(unit or UNSTATED)
    if parsed.stated and parsed.quantity not in FRF_UNIT:
        raise units.UnitError(
            "not the unit of an FRF", where=where, got=repr(unit), expected="response over force, e.g. (m/s^2)/N or g/N"
        )
    quantity: Any = parsed.quantity if parsed.stated else "unstated"
    return FrfSet(
        frequencies, parsed.to_si(block), outputs, inputs, quantity, parsed.si if parsed.stated else UNSTATED,
        coherence, estimator=estimator, name=where,
    )  # fmt: skip


def _complex(arrays: Arrays, layout: Layout) -> Any:
    if layout.frf is not None:
        return arrays.numbers(layout.frf, np.complex128)
    if layout.real is not None and layout.imaginary is not None:
        real, imaginary = arrays.numbers(layout.real), arrays.numbers(layout.imaginary)
        if real.shape != imaginary.shape:
            raise InputError(
                "real and imaginary part differ in length", where=arrays.where, got=f"{real.shape}, {imaginary.shape}"
            )
        return real + 1j * imaginary
    if layout.amplitude is not None and layout.phase is not None:
        turn = units.parse(layout.phase_unit)
        if turn.quantity != "rotation":
            raise units.UnitError("not a unit of phase", got=layout.phase_unit, expected="rad or deg")
        amplitude, phase = arrays.numbers(layout.amplitude), arrays.numbers(layout.phase)
        if amplitude.shape != phase.shape:
            raise InputError(
                "amplitude and phase differ in length", where=arrays.where, got=f"{amplitude.shape}, {phase.shape}"
            )
        return amplitude * np.exp(1j * turn.factor * phase)
    raise InputError(
        "half of an FRF", where=arrays.where, advice="say frf, or real and imaginary, or amplitude and phase"
    )


def _freq_out_in(values: Any, lines: int, layout: Layout, where: str) -> Any:
    """Any arrangement of the FRFs as (freq, out, in), frequency being the axis of the right length."""
    values = np.squeeze(values)
    places = [axis for axis, length in enumerate(values.shape) if length == lines]
    if values.ndim == 0 or values.ndim > 3 or not places:
        raise InputError(
            "FRFs and frequencies differ in length",
            where=where,
            got=f"values of shape {values.shape}",
            expected=f"{lines} lines",
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
        raise InputError("a DOF is named twice", where=arrays.where, got=", ".join(map(str, dofs)))
    return dofs


def geometry(arrays: Arrays, layout: Layout) -> Contents:
    """Nodes and lines."""
    if layout.coordinates is not None:
        xyz = arrays.numbers(layout.coordinates)
        xyz = xyz.T if xyz.ndim == 2 and xyz.shape[1] != 3 and xyz.shape[0] == 3 else xyz
    else:
        columns = [None if place is None else arrays.vector(place) for place in (layout.x, layout.y, layout.z)]
        length = max(len(column) for column in columns if column is not None)
        xyz = np.stack(
            [np.zeros(length) if c is None else _of_length(c, length, arrays.where) for c in columns], axis=1
        )
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise InputError("coordinates are not of shape (n, 3)", where=arrays.where, got=xyz.shape)
    numbers = np.arange(1, len(xyz) + 1) if layout.node is None else arrays.vector(layout.node)
    keep = np.isfinite(xyz).all(axis=1) & np.isfinite(numbers)
    nodes = numbers[keep].astype(np.int64)
    if len(np.unique(nodes)) < len(nodes):
        raise InputError("a node number occurs twice", where=arrays.where, got=int(_repeated(nodes)))
    text = layout.unit or next((arrays.units[p] for p in (layout.x, layout.y, layout.z) if p in arrays.units), UNSTATED)
    unit = units.parse(text)
    if unit.stated and unit.quantity != "displacement":
        raise units.UnitError("not a unit of length", where=arrays.where, got=repr(text), expected="m, mm, in ...")
    lines = (
        ()
        if layout.lines is None
        else tuple(tuple(int(n) for n in row if n > 0) for row in arrays.numbers(layout.lines))
    )
    found = Geometry(nodes, unit.to_si(xyz[keep]), lines, name=arrays.where)
    findings: tuple[Finding, ...] = () if unit.stated else (length_unstated(arrays.where),)
    return Contents(geometry=found, findings=findings)


def length_unstated(where: str) -> Finding:
    """The file does not say in which unit its coordinates are."""
    return Finding(
        "warning", "unit-unstated", where, "the unit of the coordinates is not stated; the numbers are taken as they are.",
        advice="Say unit='mm' or the like.",
    )  # fmt: skip


def _repeated(numbers: Any) -> Any:
    values, counts = np.unique(numbers, return_counts=True)
    return values[counts > 1][0]


def _of_length(column: Any, length: int, where: str) -> Any:
    if len(column) != length:
        raise InputError("the coordinates differ in length", where=where, got=len(column), expected=length)
    return column


def modes(arrays: Arrays, layout: Layout) -> Contents:
    """Mode shapes with their natural frequencies and damping ratios.

    Raises
    ------
    InputError : the numbers of shapes and frequencies disagree.
    """
    array = np.asarray(arrays.numbers(str(layout.shapes), np.complex128))
    names = layout.shape_axes.split()
    if array.ndim != len(names) or not set(names) <= {"direction", "node", "mode"} or len(set(names)) < len(names):
        raise InputError(
            "the axes of the shapes", where=arrays.where, got=f"{layout.shape_axes!r} for an array of shape {array.shape}",
            expected="the words direction, node and mode in the order of the array, e.g. 'direction node mode'",
        )  # fmt: skip
    for missing in ("direction", "node", "mode"):
        if missing not in names:
            names, array = [*names, missing], array[..., None]
    array = array.transpose([names.index(name) for name in ("node", "direction", "mode")])
    nodes = list(range(1, array.shape[0] + 1)) if layout.nodes is None else [int(n) for n in layout.nodes]
    if len(nodes) != array.shape[0]:
        raise InputError("the number of nodes", where=arrays.where, got=len(nodes), expected=array.shape[0])
    codes = (0,) if array.shape[1] == 1 else range(1, array.shape[1] + 1)
    dofs = tuple(Dof.from_uff(node, code) for node in nodes for code in codes)
    count = array.shape[2]
    poles, findings = _poles(arrays, layout, count)
    shapes = array.reshape(-1, count)
    model = ModalModel(poles, shapes, dofs, np.zeros((0, count), complex), (), name=arrays.where)
    return Contents(modes=(model,), findings=findings + not_finite(shapes, arrays.where))


def _poles(arrays: Arrays, layout: Layout, count: int) -> tuple[Any, tuple[Finding, ...]]:
    """Poles of the shapes; NaN and a finding where no frequencies are given."""

    def values(given: Any) -> Any:
        return arrays.vector(given) if isinstance(given, str) else np.asarray(given, dtype=np.float64)

    if layout.natural_frequencies is None:
        note = Finding(
            "warning", "frequencies-unstated", arrays.where, f"{count} mode shapes without natural frequencies."
        )
        return np.full(count, np.nan, dtype=np.complex128), (note,)
    frequencies = values(layout.natural_frequencies)
    damping = np.zeros(count) if layout.damping_ratios is None else values(layout.damping_ratios)
    for name, given in (("natural frequencies", frequencies), ("damping ratios", damping)):
        if len(given) != count:
            raise InputError(
                f"mode shapes and {name} do not pair", where=arrays.where, got=f"{count} shapes, {len(given)} {name}",
                expected="as many of one as of the other", advice="find out which belong together; read the shapes alone meanwhile",
            )  # fmt: skip
    return poles_from(frequencies, damping), ()
