"""From the channels of a file and the channel table to channels with DOFs, and the factors that make them SI."""

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from acquisition import units
from acquisition.assignment import Item
from acquisition.axes import LocalAxes
from acquisition.campaign_file import ChannelTable
from ema.data import Channel, FrfSet, Recording
from ema.data.stored_signals import StoredSignals
from ema.dof import Dof
from ema.errors import EmaError, InputError, UnitError
from ema.units import FRF_OF_RESPONSE, FRF_UNIT, QUANTITIES, SI_UNIT, UNSTATED, Quantity


@dataclass(frozen=True)
class Line:
    """A channel, the row of the file that it is, and how the numbers there become SI: ``factor * number + offset``.

    ``stated`` is the unit or sensitivity of the channel table that ``factor`` comes from; a repair names another.
    """

    row: int
    channel: Channel
    factor: float = 1.0
    offset: float = 0.0
    stated: str = ""


@dataclass(frozen=True)
class _Slot:
    """One channel of the table: where it stands in the file and in which direction it points."""

    spec: ChannelTable
    name: str
    row: int
    direction: "str | list[float] | None"


def lines_of_record(
    present: tuple[Channel, ...], table: list[ChannelTable], item: Item, axes: LocalAxes, where: str
) -> tuple[Line, ...]:
    """The lines of a record, in the order of the channel table; without a table, as the file has them.

    Raises
    ------
    InputError : a channel is missing, has no unit, ...
    """
    if not table:
        lines = tuple(_as_in_file(row, channel, item, where) for row, channel in enumerate(present))
    else:
        lines = tuple(_line(slot, present[slot.row], item, axes, where) for slot in _slots(present, table, where))
    return lines


def same_units(
    present: tuple[Channel, ...], table: list[ChannelTable], in_file: tuple[tuple[str, units.Unit], ...], where: str
) -> None:
    """Refuse a channel table that states another unit of one quantity than the file does.

    Raises
    ------
    UnitError : one channel has two units.
    """
    stated: dict[str, set[units.Unit]] = {}
    for name, unit in in_file:
        stated.setdefault(name, set()).add(unit)
    for slot in _slots(present, table, where) if table and stated else ():
        units_in_file = stated.get(present[slot.row].name, set())
        if len(units_in_file) == 1:
            _same_unit(slot.spec, next(iter(units_in_file)), f"{where}, channel {slot.name}")


def same_frf_units(table: list[ChannelTable], in_file: tuple[tuple[units.Unit, units.Unit], ...], where: str) -> None:
    """Refuse a channel table that states other units of response and force than a file of FRFs does.

    Raises
    ------
    UnitError : they differ, and not by one factor that both have in common.
    """
    responses = [spec for spec in table if spec.role == "response"]
    forces = [spec for spec in table if spec.role == "reference"]
    for response, force in in_file:
        alike = [_ratio(spec, response) / _ratio(other, force) for spec in responses for other in forces]
        if alike and all(units.same_factor(factor, 1.0) for factor in alike):
            continue
        for spec, unit in [(spec, response) for spec in responses] + [(spec, force) for spec in forces]:
            _same_unit(spec, unit, f"{where}, channel {spec.name}")


def _ratio(spec: ChannelTable, there: units.Unit) -> float:
    """The unit of the table over that of the file, 1 where the table states none of its quantity."""
    given = units.parse(spec.unit or UNSTATED)
    return given.factor / there.factor if given.quantity == there.quantity else 1.0


def _same_unit(spec: ChannelTable, there: units.Unit, where: str) -> None:
    given = units.parse(spec.unit or UNSTATED)
    if given.quantity != there.quantity:
        return
    if given.offset != there.offset or not units.same_factor(given.factor, there.factor):
        raise UnitError(
            "the file and the channel table disagree about the unit",
            where=where,
            got=f"{there.text} in the file",
            expected=f"{given.text} as in the table",
            advice="take unit out of the table where the file is right; where it is wrong, do so and repair it "
            f'with unit = "{given.text}" and was = "{there.text}"',
        )


def lines_of_frf(
    frf: FrfSet, table: list[ChannelTable], item: Item, axes: LocalAxes, where: str
) -> tuple[tuple[Line, ...], tuple[Line, ...]]:
    """The lines of the outputs and of the inputs of a set of FRFs that the file holds.

    The channels of the table with role ``response`` belong to the outputs in their order, those with role
    ``reference`` to the inputs; a single one holds for all of them.

    Raises
    ------
    InputError : the table has another number of channels, ...
    """
    response = {kind: quantity for quantity, kind in FRF_OF_RESPONSE.items()}[frf.quantity]
    sides = []
    for role, dofs, quantity in (("response", frf.outputs, response), ("reference", frf.inputs, "force")):
        unit = SI_UNIT[quantity] if frf.scaled else UNSTATED
        present = tuple(Channel(f"{role} {k + 1}", dof, quantity, role, unit) for k, dof in enumerate(dofs))  # type: ignore[arg-type]
        specs = [spec for spec in table if spec.role == role]
        if not specs:
            if not frf.scaled and not table:
                raise _unit_question(f"FRF {frf.label(0, 0)}", where)
            lines = tuple(Line(row, channel) for row, channel in enumerate(present))
        else:
            slots = _slots_in_order(present, specs, role, where)
            lines = tuple(_line(slot, present[slot.row], item, axes, where) for slot in slots)
        sides.append(lines)
    return sides[0], sides[1]


def scaled_record(recording: Recording, lines: tuple[Line, ...]) -> Recording:
    """The channels of ``lines`` out of ``recording``, in SI."""
    rows = [line.row for line in lines]
    signals = recording.signals
    if isinstance(signals, StoredSignals):
        signals = signals.chosen(rows, [line.factor for line in lines], [line.offset for line in lines])
    elif rows != list(range(len(signals))):
        signals = signals[rows]
    if not isinstance(signals, StoredSignals) and any(line.factor != 1 or line.offset for line in lines):
        factor = np.array([[line.factor] for line in lines]).astype(signals.dtype)
        offset = np.array([[line.offset] for line in lines]).astype(signals.dtype)
        signals = signals * factor + offset
    overloads = None if recording.overloads is None else recording.overloads[rows]
    return replace(recording, signals=signals, channels=tuple(line.channel for line in lines), overloads=overloads)


def scaled_frf(frf: FrfSet, outputs: tuple[Line, ...], inputs: tuple[Line, ...], where: str) -> FrfSet:
    """``frf`` with the DOFs of the lines, in SI where both sides have units.

    Raises
    ------
    InputError : the responses are of several quantities.
    """
    quantities = {line.channel.quantity for line in outputs}
    if len(quantities) > 1:
        raise InputError(
            "responses of several quantities in one set of FRFs",
            where=where,
            got=", ".join(sorted(quantities)),
            advice="put them into runs of their own",
        )
    for line in inputs:
        if line.channel.quantity not in ("force", "unstated"):
            raise InputError(
                "the reference of an FRF is no force",
                where=f"{where}, channel {line.channel.name}",
                got=line.channel.quantity,
                expected="force",
                advice="correct the unit, sensitivity or role of this channel",
            )
    quantity = FRF_OF_RESPONSE.get(quantities.pop(), "unstated")
    scaled = all(line.channel.scaled for line in (*outputs, *inputs)) and quantity != "unstated"
    factor = np.array([[line.factor] for line in outputs]) / np.array([line.factor for line in inputs])
    return replace(
        frf,
        values=frf.values if np.all(factor == 1) else frf.values * factor,
        variance=None if frf.variance is None else frf.variance * factor**2,
        deviations=None if frf.deviations is None else frf.deviations.scaled(factor),
        outputs=tuple(_dof_of(line, where) for line in outputs),
        inputs=tuple(_dof_of(line, where) for line in inputs),
        quantity=quantity,
        unit=FRF_UNIT[quantity] if scaled else UNSTATED,
    )


def rescaled(line: Line, new: str, was: str, where: str) -> Line:
    """``line`` with another unit or sensitivity in place of the one stated (or of ``was``).

    Raises
    ------
    InputError : nobody says which unit or sensitivity was wrong, or the new one is of another kind.
    """
    old = was or line.stated
    if not old:
        raise InputError(
            "nothing says which unit or sensitivity was wrong",
            where=where,
            got=line.channel.name,
            advice='add was = "..." to the repair',
        )
    (old_factor, _), (factor, quantity) = _to_si(old), _to_si(new)
    if line.channel.quantity not in (quantity, "unstated"):
        raise InputError(
            "a repair with a unit of another quantity",
            where=where,
            got=f"{new} ({quantity})",
            expected=f"a unit of {line.channel.quantity}",
        )
    if factor == old_factor:
        raise InputError(
            "a repair that changes nothing",
            where=where,
            got=f"{old} before it and {new} behind it",
            advice='say was = "..." with the wrong unit or sensitivity that the numbers were converted from',
        )
    volts = _is_sensitivity(new)
    channel = replace(
        line.channel,
        quantity=cast(Quantity, quantity),
        unit=SI_UNIT[quantity],
        sensitivity=1 / factor if volts else line.channel.sensitivity,
    )
    return replace(line, channel=channel, factor=line.factor * factor / old_factor, stated=new)


def _to_si(text: str) -> tuple[float, str]:
    if _is_sensitivity(text):
        volts, quantity = units.sensitivity(text)
        return 1 / volts, quantity
    unit = units.parse(text)
    return unit.factor, unit.quantity


def _is_sensitivity(text: str) -> bool:
    return bool(text) and (text[0].isdigit() or text[0] in "+-.")


def _slots(present: tuple[Channel, ...], table: list[ChannelTable], where: str) -> list[_Slot]:
    slots = []
    for spec in table:
        columns = spec.columns or ([spec.column] if spec.column else [])
        names = spec.names or ([spec.name] if spec.name and len(columns) < 2 else [])
        if columns and names and len(columns) != len(names):
            raise InputError(
                "names and columns of a sensor differ in number", where=where, got=len(names), expected=len(columns)
            )
        rows = [_by_column(present, column, where) for column in columns] or [
            _by_name(present, name, where) for name in names
        ]
        names = names or [f"{spec.name} {row + 1}" if spec.name else present[row].name for row in rows]
        directions: list[Any] = [*spec.directions] or [spec.direction] * len(rows)
        slots += [_Slot(spec, name, row, towards) for name, row, towards in zip(names, rows, directions, strict=True)]
    _refuse_one_row_twice(slots, present, where)
    return slots


def _refuse_one_row_twice(slots: list[_Slot], present: tuple[Channel, ...], where: str) -> None:
    """One sensor is at one place: its signal at two would be two measurements that agree too well."""
    taken = [(slot.row, slot.spec.role) for slot in slots if slot.spec.role in ("reference", "response")]
    double = next((one for one in taken if taken.count(one) > 1), None)
    if double is not None:
        raise InputError(
            "one channel of the file stands twice in the channel table",
            where=where,
            got=repr(present[double[0]].name),
            expected="one entry for each channel",
            advice="correct the name or the column of one of the two",
        )


def _slots_in_order(present: tuple[Channel, ...], specs: list[ChannelTable], role: str, where: str) -> list[_Slot]:
    if len(specs) == 1 and not specs[0].names:
        return [
            _Slot(specs[0], specs[0].name or found.name, row, specs[0].direction) for row, found in enumerate(present)
        ]
    slots: list[_Slot] = []
    for spec in specs:
        names = spec.names or [spec.name]
        directions: list[Any] = [*spec.directions] or [spec.direction] * len(names)
        slots += [
            _Slot(spec, name, len(slots) + k, towards) for k, (name, towards) in enumerate(zip(names, directions))
        ]
    if len(slots) != len(present):
        raise InputError(
            f"the file holds FRFs of another number of {role} channels than the table",
            where=where,
            got=len(present),
            expected=len(slots),
        )
    return slots


def _by_name(present: tuple[Channel, ...], name: str, where: str) -> int:
    exact = [row for row, channel in enumerate(present) if channel.name == name]
    loose = [row for row, channel in enumerate(present) if channel.name.strip().lower() == name.strip().lower()]
    rows = exact or loose
    if len(rows) != 1:
        raise InputError(
            "no such channel in the file" if not rows else "two channels of one name in the file",
            where=where,
            got=repr(name),
            expected="one of " + ", ".join(channel.name for channel in present[:40]),
            advice="correct the name in the channel table" if not rows else "say column = ... instead",
        )
    return rows[0]


def _by_column(present: tuple[Channel, ...], column: int, where: str) -> int:
    if column > len(present):
        raise InputError("no such column in the file", where=where, got=column, expected=f"1 to {len(present)}")
    return column - 1


def _line(slot: _Slot, found: Channel, item: Item, axes: LocalAxes, where: str) -> Line:
    spec, where = slot.spec, f"{where}, channel {slot.name}"
    factor, offset, quantity, sensitivity, stated = conversion(found, spec, where)
    known = quantity != UNSTATED and spec.unit != UNSTATED
    channel = Channel(
        name=slot.name,
        dof=_direction(slot, found, item, axes, where),
        quantity=spec.quantity or (quantity if quantity in QUANTITIES else UNSTATED),  # type: ignore[arg-type]
        role=spec.role,
        unit=SI_UNIT[quantity] if known else UNSTATED,
        sensitivity=sensitivity,
        serial=spec.serial or found.serial,
        calibrated_on=spec.calibrated_on or found.calibrated_on,
        range=full_scale(spec, found, quantity, sensitivity, where),
        joint=spec.joint or found.joint,
    )
    return Line(slot.row, channel, factor, offset, stated)


def conversion(found: Channel, spec: ChannelTable, where: str) -> tuple[float, float, str, float | None, str]:
    """Factor, offset, quantity, sensitivity [V/SI] and the text that they come from.

    Raises
    ------
    UnitError : no unit is stated, or none of a signal, or another than the file's.
    """
    unit = units.parse(spec.unit) if spec.unit else None
    sensitivity, measured = units.sensitivity(spec.sensitivity) if spec.sensitivity else (None, "")
    if unit is not None and not unit.stated:
        return 1.0, 0.0, spec.quantity or UNSTATED, sensitivity, ""
    in_volts = found.quantity == "voltage" or (unit is not None and unit.quantity == "voltage")
    if found.scaled and found.quantity not in ("voltage", UNSTATED):
        wanted = measured or (unit.quantity if unit else found.quantity)
        if wanted not in (found.quantity, "voltage"):
            raise UnitError(
                "the file and the channel table disagree about what is measured",
                where=where,
                got=f"{found.unit} in the file",
                expected=f"a unit of {wanted}",
            )
        return 1.0, 0.0, found.quantity, sensitivity, spec.sensitivity or spec.unit or found.unit
    if sensitivity is not None and (unit is None or in_volts):
        volts = 1.0 if found.scaled or unit is None else unit.factor
        return volts / sensitivity, 0.0, measured, sensitivity, str(spec.sensitivity)
    if unit is None and found.scaled:
        return 1.0, 0.0, found.quantity, sensitivity, found.unit
    if unit is None:
        raise _unit_question(found.name, where)
    if found.scaled and unit.quantity != found.quantity:
        raise UnitError(
            "the file holds volts, and no sensitivity says what they mean",
            where=where,
            got=f"unit {spec.unit}",
            advice='add sensitivity = "100 mV/g" (or what the sensor has)',
        )
    if unit.quantity not in QUANTITIES:
        raise UnitError(
            "not the unit of a signal",
            where=where,
            got=spec.unit,
            expected="a unit of what a sensor measures, such as N, m/s^2 or Pa",
        )
    factor, offset = (1.0, 0.0) if found.scaled else (unit.factor, unit.offset)
    return factor, offset, unit.quantity, sensitivity, str(spec.unit)


def _unit_question(name: str, where: str) -> UnitError:
    return UnitError(
        "neither the file nor the channel table says in which unit this is",
        where=where,
        got=name,
        advice=f'add unit = "..." or sensitivity = "..." to its channel table, or unit = "{UNSTATED}" '
        "(then frequencies, damping and shapes, but no scaling)",
    )


def full_scale(
    spec: ChannelTable, found: Channel, quantity: str, sensitivity: float | None, where: str
) -> float | None:
    """Range of a channel in SI, from one in its unit or in volts.

    Raises
    ------
    UnitError : a range of another quantity.
    """
    if spec.range is None:
        return found.range
    value, measured = units.measure(spec.range)
    if measured == quantity:
        return value
    if measured == "voltage" and sensitivity is not None:
        return value / sensitivity
    raise UnitError("the range is of another quantity than the channel", where=where, got=spec.range, expected=quantity)


def _direction(slot: _Slot, found: Channel, item: Item, axes: LocalAxes, where: str) -> Dof | None:
    spec, more = slot.spec, {"column": str(slot.row + 1), "name": slot.name}
    try:
        if slot.name in item.dofs:
            return Dof.parse(item.dofs[slot.name])
        if spec.dof:
            return Dof.parse(item.fill(spec.dof, where, **more))
        if not spec.node:
            return found.dof
        node = node_number(spec, item, where, **more)
        if slot.direction is None:
            return Dof(node) if found.dof is None else replace(found.dof, node=node)
        return axes.dof(node, slot.direction if isinstance(slot.direction, str) else np.asarray(slot.direction))
    except EmaError as error:
        if error.where:
            raise
        raise InputError(
            error.what, where=where, got=error.got, expected=error.expected, advice=error.advice
        ) from error


def node_number(spec: ChannelTable, item: Item, where: str, **more: str) -> int:
    """The node of a channel at one file.

    Raises
    ------
    InputError : it is no number.
    """
    text = item.fill(spec.node, where, **more)
    if not text.isdigit():
        raise InputError(
            "a node is a number",
            where=where,
            got=repr(text),
            expected="digits alone, such as 12",
            advice='correct node = "..." in the channel table',
        )
    return int(text)


def _as_in_file(row: int, channel: Channel, item: Item, where: str) -> Line:
    if not channel.scaled:
        raise _unit_question(channel.name, where)
    if channel.name in item.dofs:
        channel = replace(channel, dof=Dof.parse(item.dofs[channel.name]))
    return Line(row, channel, stated=channel.unit)


def _dof_of(line: Line, where: str) -> Dof:
    if line.channel.dof is None:
        raise InputError("an FRF without a DOF", where=where, got=line.channel.name, advice='add dof = "12:+Z"')
    return line.channel.dof


def refuse_doubles(lines: tuple[Line, ...], where: str) -> None:
    """Two channels of one role do not measure the same DOF.

    Raises
    ------
    InputError : they do.
    """
    seen: dict[tuple[str, Dof], str] = {}
    for line in lines:
        channel = line.channel
        if channel.dof is None or channel.role not in ("reference", "response"):
            continue
        key = (channel.role, channel.dof.positive)
        if key in seen:
            raise InputError(
                "two channels with one DOF",
                where=where,
                got=f"{channel.dof} for {seen[key]} and {channel.name}",
                advice='correct one of them in the channel table, or by a repair "move dof" of its channel',
            )
        seen[key] = channel.name
