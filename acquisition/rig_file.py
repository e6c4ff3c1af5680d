"""What ``rig.toml`` may say: the front end, its channels, the trigger, and the points to strike."""

import re
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from acquisition import units
from acquisition.campaign_file import ChannelTable, JointTable, Numbers, Seconds
from acquisition.live.opendaq_rig import OpendaqRig, Wire
from acquisition.live.trigger import Trigger
from ema.data import Channel, Source
from ema.errors import InputError
from ema.tables import FileKind, Table, warn
from ema.units import SI_UNIT

__all__ = ["FILE_NAME", "RigFile", "load", "open_rig", "wires"]

FILE_NAME = "rig.toml"
_LEVEL = re.compile(r"^\s*(?P<channel>.+?)\s*>\s*(?P<level>[-+0-9.eE]+\s*\S.*)$")


class RigTable(Table):
    """``[rig]``: the device and how fast it samples, in Hz."""

    device: str
    sampling_rate: float = Field(gt=0)
    properties: dict[str, Any] = Field(default_factory=dict)


class TakeTable(Table):
    """``[take]``: when a take begins, how long it is, where the hammer goes, and how many takes each point gets."""

    trigger: str
    pre_trigger: Seconds = "50 ms"
    duration: Seconds = "1 s"
    points: Numbers = Field(min_length=1)
    takes: int = Field(default=3, ge=1)

    @model_validator(mode="after")
    def _sound(self) -> "TakeTable":
        if not _LEVEL.match(self.trigger):
            raise ValueError('a trigger is a channel and a level, such as "hammer > 10 N"')
        for point in self.points:
            if point < 0:
                raise ValueError(f"a point is a number from 0, not {point}")
            if self.points.count(point) > 1:
                raise ValueError(f"point {point} stands twice; raise takes for more impacts at a point")
        return self


class RigChannelTable(ChannelTable):
    """``[[channels]]`` as in a campaign; ``source`` is the channel's name at the device."""

    source: str = ""


class AboutTable(Table):
    """``[campaign]``: what the recorded campaign says about itself."""

    name: str = ""
    structure: str = ""
    operator: str = ""
    comment: str = ""


class RigFile(Table):
    """The whole file."""

    rig: RigTable
    take: TakeTable
    campaign: AboutTable = AboutTable()
    channels: list[RigChannelTable] = Field(min_length=1)
    joints: list[JointTable] = Field(default_factory=list)

    @model_validator(mode="after")
    def _sound(self) -> "RigFile":
        names = [channel.name for channel in self.channels]
        if "" in names or len(set(names)) < len(names):
            raise ValueError("every channel has a name of its own")
        if sum(channel.role == "reference" for channel in self.channels) != 1:
            raise ValueError('one channel is the hammer: role = "reference"')
        return self


KIND = FileKind(
    table=RigFile,
    tables={
        "": RigFile,
        "rig": RigTable,
        "take": TakeTable,
        "campaign": AboutTable,
        "channels": RigChannelTable,
        "joints": JointTable,
    },
    name=FILE_NAME,
    absent="there is no rig here",
    guide="docs/record.md",
)


def load(path: Path) -> RigFile:
    """Read ``rig.toml`` or the folder that holds it.

    Raises
    ------
    InputError : no such file, or a key that is unknown, missing or wrong, with its line.
    """
    rig = KIND.load(path)
    warn(rig.former_names)
    return rig


def wires(rig: RigFile) -> tuple[Wire, ...]:
    """Channels in SI with the factors from the values of the device.

    Raises
    ------
    InputError : a channel says neither sensitivity nor unit.
    """
    return tuple(_wire(table) for table in rig.channels)


def _wire(table: RigChannelTable) -> Wire:
    factor, quantity = 1.0, table.quantity or "unstated"
    if table.sensitivity is not None:
        volts, quantity = units.sensitivity(table.sensitivity)  # type: ignore[assignment]
        factor = 1 / volts
    elif table.unit is not None and table.unit != "unstated":
        unit = units.parse(table.unit)
        factor, quantity = unit.factor, unit.quantity  # type: ignore[assignment]
    elif table.unit is None:
        raise InputError(
            "the channel has no unit",
            where=f"channel {table.name}",
            advice='add sensitivity = "10 mV/N", or unit = "N" where the device gives newtons',
        )
    full = None if table.range is None else units.measure(table.range)[0]
    channel = Channel(
        table.name,
        quantity=quantity,
        role=table.role,
        unit=SI_UNIT[quantity],
        serial=table.serial,
        calibrated_on=table.calibrated_on,
        range=full,
        joint=table.joint,
    )
    return Wire(channel, table.source or table.name, factor)


def trigger(rig: RigFile) -> Trigger:
    """The trigger in rows and samples.

    Raises
    ------
    InputError : it names no channel, or a level of another quantity.
    """
    found = _LEVEL.match(rig.take.trigger)
    assert found is not None
    channels = [wire.channel for wire in wires(rig)]
    names = [channel.name for channel in channels]
    if found["channel"] not in names:
        raise InputError("the trigger names no channel", got=found["channel"], expected="one of " + ", ".join(names))
    row = names.index(found["channel"])
    level = units.measure(found["level"], channels[row].quantity)[0]
    before, length = (units.measure(text, "time")[0] for text in (rig.take.pre_trigger, rig.take.duration))
    rate = rig.rig.sampling_rate
    return Trigger(row, level, round(before * rate), round(length * rate))


def open_rig(rig: RigFile) -> Source:
    """The rig that a file describes.

    Raises
    ------
    InputError, FailureError : it cannot be opened.
    """
    kind, _, address = rig.rig.device.partition(":")
    if kind != "opendaq" or not address:
        raise InputError("no such kind of device", got=rig.rig.device, expected="opendaq:ADDRESS, or virtual")
    return OpendaqRig(address, wires(rig), rig.rig.sampling_rate, trigger(rig), rig.rig.properties)
