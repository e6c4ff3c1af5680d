"""What ``rig.toml`` may say: the front end, its channels, the trigger, and the points to strike."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from acquisition import units
from acquisition.campaign_file import ChannelTable, Duration, JointTable, Mass, Numbers, Wait
from acquisition.live.opendaq_rig import OpendaqRig, OpendaqShaker, Steps, Wire
from acquisition.live.trigger import Trigger
from acquisition.scaling import conversion, full_scale
from ema.data import Channel, Source
from ema.errors import InputError, UnitError
from ema.tables import FileKind, Table, warn
from ema.units import SI_UNIT, UNSTATED

__all__ = ["FILE_NAME", "RigFile", "force_level", "load", "normal_force", "open_rig", "open_shaker", "steps", "wires"]

FILE_NAME = "rig.toml"
FEWEST_CYCLES = 4.0
"""Cycles below which the frequency of a stay is not read."""
MOST_VALUES = 2**28
"""Values of a take over all channels: it is held in memory, 2 GiB with eight bytes each, before it is on disk."""
_LEVEL = re.compile(r"^\s*(?P<channel>.+?)\s*>\s*(?P<level>[-+0-9.eE]+\s*\S.*)$")


class RigTable(Table):
    """``[rig]``: the device and how fast it samples, in Hz."""

    device: str
    sampling_rate: float = Field(gt=0, allow_inf_nan=False)
    properties: dict[str, Any] = Field(default_factory=dict)


class TakeTable(Table):
    """``[take]``: when a take begins, how long it is, where the hammer goes, and how many takes each point gets."""

    trigger: str = ""
    pre_trigger: Wait = "50 ms"
    duration: Duration = "1 s"
    points: Numbers = Field(min_length=1)
    takes: int = Field(default=3, ge=1)

    @model_validator(mode="after")
    def _sound(self) -> "TakeTable":
        if self.trigger and not _LEVEL.match(self.trigger):
            raise ValueError('a trigger is a channel and a level, such as "hammer > 10 N"')
        for point in self.points:
            if point < 0:
                raise ValueError(f"a point is a number from 0, not {point}")
            if self.points.count(point) > 1:
                raise ValueError(f"point {point} stands twice; raise takes for more impacts at a point")
        return self


class ShakerTable(Table):
    """``[shaker]``: a sine that stays at each line of a band, and the properties of the device that set it.

    ``band`` and ``step`` in Hz; ``largest`` is the largest command, in the unit of the ``amplitude`` property.
    """

    band: list[float] = Field(min_length=2, max_length=2)
    step: float = Field(gt=0)
    stay: Duration = "0.1 s"
    settle: Wait = "1 s"
    first: float | None = Field(default=None, gt=0)
    largest: float = Field(gt=0)
    amplitude: str = ""
    frequency: str = ""
    mount_mass: Mass = "0 kg"

    @model_validator(mode="after")
    def _sound(self) -> "ShakerTable":
        low, high = self.band
        if not 0 < low < high or high - low < 4 * self.step:
            raise ValueError(f"band = [{low:g}, {high:g}] holds fewer than five lines {self.step:g} Hz apart")
        if self.first is not None and self.first > self.largest:
            raise ValueError(f"the first command, {self.first:g}, is above the largest, {self.largest:g}")
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
    shaker: ShakerTable | None = None
    campaign: AboutTable = AboutTable()
    channels: list[RigChannelTable] = Field(min_length=1)
    joints: list[JointTable] = Field(default_factory=list)

    @model_validator(mode="after")
    def _sound(self) -> "RigFile":
        names = [channel.name for channel in self.channels]
        if "" in names or len(set(names)) < len(names):
            raise ValueError("every channel has a name of its own")
        sources = [channel.source or channel.name for channel in self.channels]
        if len(set(sources)) < len(sources):
            twice = next(source for source in sources if sources.count(source) > 1)
            raise ValueError(f"two channels of one source, {twice!r}; give each the source that it is plugged into")
        if sum(channel.role == "reference" for channel in self.channels) != 1:
            raise ValueError('one channel is the hammer or the force of the shaker: role = "reference"')
        if self.shaker is None and not self.take.trigger:
            raise ValueError('a hammer test needs a trigger, such as trigger = "hammer > 10 N" in [take]')
        if self.shaker is not None and (self.take.trigger or len(self.take.points) != 1):
            raise ValueError("with [shaker], [take] names the one point of the shaker and no trigger")
        if self.shaker is not None and not (
            self.rig.device == "virtual" or (self.shaker.amplitude and self.shaker.frequency)
        ):
            raise ValueError(
                '[shaker] names the properties of the device that set the sine: amplitude = "Ch0.Amplitude"'
            )
        if len(self.take.points) > 1 and not any("{point}" in one.dof + one.node for one in self.channels):
            raise ValueError(
                f"{len(self.take.points)} points, and no channel that is at them; the one that goes from point to "
                'point has dof = "{point}:-Z"'
            )
        self._refuse_endless()
        return self

    def _refuse_endless(self) -> None:
        """A take is held in memory until it is whole."""
        duration = units.measure(self.take.duration, "time")[0]
        if self.shaker is not None:
            low, high = self.shaker.band
            duration = units.measure(self.shaker.stay, "time")[0] * ((high - low) / self.shaker.step + 1)
        values = duration * self.rig.sampling_rate * len(self.channels)
        if values > MOST_VALUES:
            raise ValueError(
                f"a take of {duration:.3g} s at {self.rig.sampling_rate:g} Hz on {len(self.channels)} channels has "
                f"{values:.3g} values, more than fit into memory ({MOST_VALUES})"
            )


KIND = FileKind(
    table=RigFile,
    tables={
        "": RigFile,
        "rig": RigTable,
        "take": TakeTable,
        "shaker": ShakerTable,
        "campaign": AboutTable,
        "channels": RigChannelTable,
        "joints": JointTable,
    },
    name=FILE_NAME,
    absent="there is no rig here",
    guide="docs/record.md",
)


def load(path: Path) -> RigFile:
    """Read ``rig.toml``; a former name of a key is read, with a warning.

    Parameters
    ----------
    path : Path
        The file, or the folder that holds it.

    Returns
    -------
    RigFile
        Content of the file, checked.

    Raises
    ------
    InputError
        There is no such file, it is no TOML, or a key is unknown, missing or wrong; the message names its line.
    """
    rig = KIND.load(path)
    warn(rig.former_names)
    return rig


def wires(rig: RigFile) -> tuple[Wire, ...]:
    """Channels in SI with the factors from the values of the device.

    Raises
    ------
    UnitError : a channel says neither sensitivity nor unit, or a unit or range of something else.
    """
    return tuple(_wire(table) for table in rig.channels)


def _wire(table: RigChannelTable) -> Wire:
    """A channel of the device, whose values become SI as the numbers of a file do in a campaign."""
    where, there = f"channel {table.name}", Channel(table.source or table.name)
    factor, offset, quantity, sensitivity, _ = conversion(there, table, where)
    if table.role in ("reference", "normal force") and quantity not in ("force", UNSTATED):
        what = f"the channel of a {table.role} measures no force"
        raise UnitError(what, where=where, got=quantity, expected="force")
    channel = Channel(
        table.name,
        quantity=quantity,  # type: ignore[arg-type]
        role=table.role,
        unit=UNSTATED if table.unit == UNSTATED else SI_UNIT[quantity],
        serial=table.serial,
        calibrated_on=table.calibrated_on,
        range=full_scale(table, there, quantity, sensitivity, where),
        joint=table.joint,
    )
    return Wire(channel, there.name, factor, offset)


def trigger(rig: RigFile) -> Trigger:
    """The trigger in rows and samples.

    Raises
    ------
    InputError : it names no channel, or a level that is not above 0 or of another quantity.
    """
    parts = _LEVEL.match(rig.take.trigger)
    assert parts is not None
    channels = [wire.channel for wire in wires(rig)]
    names = [channel.name for channel in channels]
    if parts["channel"] not in names:
        raise InputError("the trigger names no channel", got=parts["channel"], expected="one of " + ", ".join(names))
    row = names.index(parts["channel"])
    level = units.measure(parts["level"], channels[row].quantity)[0]
    if level <= 0:
        raise InputError(
            "the trigger is not above 0, where a signal at rest is",
            where="[take] trigger",
            got=parts["level"],
            expected="a level above the noise",
            advice="where the impacts come out negative, give the sensitivity a minus",
        )
    before, length = (units.measure(text, "time")[0] for text in (rig.take.pre_trigger, rig.take.duration))
    rate = rig.rig.sampling_rate
    return Trigger(row, level, round(before * rate), round(length * rate))


def steps(rig: RigFile) -> Steps:
    """The stepped sine of a shaker.

    Raises
    ------
    InputError : a stay that is no whole number of samples, or shorter than the cycles that a frequency is read from.
    """
    assert rig.shaker is not None
    low, high = rig.shaker.band
    lines = low + rig.shaker.step * np.arange(int((high - low) / rig.shaker.step + 1e-9) + 1)
    stay, settle = (units.measure(text, "time")[0] for text in (rig.shaker.stay, rig.shaker.settle))
    samples = stay * rig.rig.sampling_rate
    if stay * low < FEWEST_CYCLES or abs(samples - round(samples)) > 1e-6:
        raise InputError(
            "the shaker does not stay long enough, or for a part of a sample",
            where="[shaker] stay",
            got=f"{stay:g} s: {stay * low:.1f} cycles of {low:g} Hz, {samples:g} samples",
            expected=f"{FEWEST_CYCLES:g} cycles or more, and whole samples",
        )
    mass = units.measure(rig.shaker.mount_mass, "mass")[0]
    return Steps(tuple(lines.tolist()), stay, settle, rig.shaker.amplitude, rig.shaker.frequency, mass)


def force_level(rig: RigFile, text: str | None, folder: Path) -> float | None:
    """The force level in N of a shaker test; nothing for a hammer.

    Raises
    ------
    InputError : a level without a shaker, a shaker without a level, or a text that is no force above 0.
    """
    where = str(folder / FILE_NAME)
    if rig.shaker is None:
        if text is None:
            return None
        raise InputError(
            "a level is that of a shaker, and the rig has none",
            where=where,
            got=f"--level {text!r}",
            expected="a table [shaker]",
            advice="add it as docs/record.md shows, or leave --level out for a hammer",
        )
    if text is None:
        raise InputError(
            "a shaker is measured at a force level",
            where=where,
            got="no --level",
            expected='the force at resonance, such as --level "30 N"',
        )
    level = float(units.measure(text, "force")[0])
    if not 0 < level < float("inf"):
        raise InputError("not a force level", where="--level", got=text, expected='above 0, such as "30 N"')
    return level


def normal_force(rig: RigFile, text: str | None, folder: Path) -> float | None:
    """Return the normal force that every joint is to have.

    Parameters
    ----------
    rig : RigFile
        The rig; one of its channels has to measure a normal force.
    text : str or None
        Force with its unit, such as ``"1 kN"``; None where none is asked for.
    folder : Path
        Folder of the rig file, for the message.

    Returns
    -------
    float or None
        Force [N]; None where ``text`` is None.

    Raises
    ------
    InputError
        The rig measures no normal force, or the text is no force above 0.
    """
    if text is None:
        return None
    if not any(channel.role == "normal force" for channel in rig.channels):
        raise InputError(
            "the rig measures no normal force",
            where=str(folder / FILE_NAME),
            got=f"--normal-force {text!r}",
            expected='a channel with role = "normal force"',
            advice="add the load cell of the joint, or state the force in [[runs.normal_force]] of the campaign",
        )
    force = float(units.measure(text, "force")[0])
    if not 0 < force < float("inf"):
        raise InputError("not a normal force", where="--normal-force", got=text, expected='above 0, such as "1 kN"')
    return force


def open_rig(rig: RigFile) -> Source:
    """Open the front end that a file describes; takes begin at its trigger.

    Parameters
    ----------
    rig : RigFile
        Content of a ``rig.toml`` whose ``device`` is ``opendaq:ADDRESS``.

    Returns
    -------
    Source
        The front end; it has to be closed.

    Raises
    ------
    InputError, FailureError
        It cannot be opened.
    """
    return OpendaqRig(_address(rig), wires(rig), rig.rig.sampling_rate, trigger(rig), rig.rig.properties)


def open_shaker(rig: RigFile) -> OpendaqShaker:
    """The front end and the shaker that it drives.

    Raises
    ------
    InputError, FailureError : it cannot be opened.
    """
    assert rig.shaker is not None
    return OpendaqShaker(_address(rig), wires(rig), rig.rig.sampling_rate, steps(rig), rig.rig.properties)


def _address(rig: RigFile) -> str:
    kind, _, address = rig.rig.device.partition(":")
    if kind != "opendaq" or not address:
        raise InputError("no such kind of device", got=rig.rig.device, expected="opendaq:ADDRESS, or virtual")
    return address
