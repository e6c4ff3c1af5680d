"""A front end that openDAQ reaches; its simulated device ``daqref://device0`` needs no hardware."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from jaxtyping import Float

from acquisition.live.trigger import Trigger
from ema.data import Channel, Recording
from ema.errors import FailureError, InputError, require

SILENCE = 10.0
"""Seconds without a sample after which a device counts as gone."""

_BLOCK = 0.05
"""Seconds of signal that are read at a time: a take begins later by no more than this."""


@dataclass(frozen=True)
class Wire:
    """Which channel of the device a channel of the record is, and how its values become SI: factor, then offset."""

    channel: Channel
    source: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Steps:
    """A stepped sine: its lines in Hz, how long it stays and settles at each in s, and the properties that set it.

    ``mount_mass`` in kg sits between load cell and structure.
    """

    frequencies: tuple[float, ...]
    stay: float
    settle: float
    amplitude: str
    frequency: str
    mount_mass: float = 0.0


class _OpendaqDevice:
    """Channels of one openDAQ device, read in step.

    Parameters
    ----------
    address : of the device, e.g. ``daqref://device0``.
    properties : set before measuring; ``name`` of the device, or ``channel.name`` of one channel.

    Raises
    ------
    MissingExtraError : openDAQ is not installed.
    FailureError : the device does not answer.
    InputError : it has no such channel or property, or another sampling rate.
    """

    def __init__(
        self,
        address: str,
        wires: Sequence[Wire],
        sampling_rate: float,
        properties: Mapping[str, Any] | None = None,
    ) -> None:
        daq = require("opendaq", "daq")
        self._wires, self._rate, self._address = tuple(wires), sampling_rate, address
        try:
            self._instance = daq.Instance()
            self._device = self._instance.add_device(address)
        except RuntimeError as error:
            raise FailureError(
                "the device does not answer",
                where=address,
                got=_first_line(error),
                advice="check its address and cable; `ema doctor` lists the devices that openDAQ finds",
            ) from error
        self._set(properties or {})
        self._reader = daq.MultiReader([self._signal(wire) for wire in self._wires])

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What each row of a record is."""
        return tuple(wire.channel for wire in self._wires)

    @property
    def sampling_rate(self) -> float:
        """Hz."""
        return self._rate

    def close(self) -> None:
        """Give the device back."""
        self._reader = None
        self._instance.remove_device(self._device)

    def _blocks(self) -> Iterator[Float[np.ndarray, "channel sample"]]:
        size = max(1, round(_BLOCK * self._rate))
        factors = np.array([[wire.factor] for wire in self._wires])
        offsets = np.array([[wire.offset] for wire in self._wires])
        last = time.monotonic()
        while True:
            block = self._read(size)
            if block.shape[1]:
                last = time.monotonic()
                yield factors * block + offsets
            elif time.monotonic() - last > SILENCE:
                raise FailureError(
                    f"the device has sent nothing for {SILENCE:.0f} s",
                    where=self._address,
                    advice="takes on disk are safe; connect it again and go on with the same command",
                )

    def _read(self, count: int) -> Float[np.ndarray, "channel sample"]:
        """Samples in step; none while the device starts."""
        try:
            samples = np.asarray(self._reader.read(count, 200), np.float64)
        except RuntimeError as error:
            raise FailureError(
                "the device has gone",
                where=self._address,
                got=_first_line(error),
                advice="takes on disk are safe; connect it again and go on with the same command",
            ) from error
        return samples if samples.ndim == 2 else np.zeros((len(self._wires), 0))

    def _forget(self) -> None:
        """Drop what has piled up while nobody read."""
        while waiting := int(self._reader.available_count):
            self._read(waiting)

    def _set(self, properties: Mapping[str, Any]) -> None:
        # the number of channels and the like come first: they make the channels that the others are about
        for name in sorted(properties, key=lambda name: "." in name):
            owner, _, own = name.rpartition(".")
            target = self._channel(owner) if owner else self._device
            try:
                target.set_property_value(own, properties[name])
            except RuntimeError as error:
                raise InputError(
                    "the device does not take this property",
                    where=self._address,
                    got=f"{name} = {properties[name]}",
                    advice=_first_line(error),
                ) from error

    def _channel(self, name: str) -> Any:
        known = {channel.name: channel for channel in self._device.channels_recursive}
        if name not in known:
            raise InputError(
                "the device has no such channel", where=self._address, got=name, expected="one of " + ", ".join(known)
            )
        return known[name]

    def _signal(self, wire: Wire) -> Any:
        return self._channel(wire.source).signals[0]


class OpendaqRig(_OpendaqDevice):
    """A `Source` whose takes wait for an impact.

    Parameters
    ----------
    address, wires, sampling_rate, properties : of the device.
    trigger : what begins a take.

    Raises
    ------
    MissingExtraError, FailureError, InputError : the device cannot be opened.
    """

    def __init__(
        self,
        address: str,
        wires: Sequence[Wire],
        sampling_rate: float,
        trigger: Trigger,
        properties: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(address, wires, sampling_rate, properties)
        self._trigger = trigger

    def takes(self) -> Iterator[Recording]:
        """One record for each impact; whatever happens between two of them is not looked at.

        Raises
        ------
        FailureError : the device has gone.
        """
        while True:
            self._forget()
            signals = self._trigger.cut(self._blocks())
            start = datetime.now(UTC) - timedelta(seconds=signals.shape[1] / self._rate)
            yield Recording(signals, self._rate, self.channels, start=start, name="take")


class OpendaqShaker(_OpendaqDevice):
    """A shaker that a generator of the device drives, at rest but while it measures.

    Parameters
    ----------
    address, wires, sampling_rate, properties : of the device.
    steps : the sine, and the properties that set its amplitude and frequency.

    Raises
    ------
    MissingExtraError, FailureError, InputError : the device cannot be opened, or has no such properties.
    """

    def __init__(
        self,
        address: str,
        wires: Sequence[Wire],
        sampling_rate: float,
        steps: Steps,
        properties: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(address, wires, sampling_rate, properties)
        self._steps = steps
        self._set({steps.amplitude: 0.0, steps.frequency: steps.frequencies[0]})

    def measure(self, command: float) -> Recording:
        """Stay at every line with the amplitude property at ``command``; one record of all stays without settling.

        Raises
        ------
        FailureError : the device has gone; whether the shaker is at rest is then unknown, and said.
        """
        steps, start = self._steps, datetime.now(UTC)
        try:
            stays = [self._stay(command, frequency) for frequency in steps.frequencies]
        finally:
            try:
                self._set({steps.amplitude: 0.0})
            except InputError as error:
                raise FailureError(
                    "the shaker could not be set to rest",
                    where=self._address,
                    got=error.what,
                    advice="switch its amplifier off; takes on disk are safe",
                ) from error
        return Recording(np.hstack(stays), self._rate, self.channels, start=start, name="take")

    def _stay(self, command: float, frequency: float) -> Float[np.ndarray, "channel sample"]:
        self._set({self._steps.frequency: frequency})
        self._set({self._steps.amplitude: command})
        self._forget()
        settle, stay = (round(time * self._rate) for time in (self._steps.settle, self._steps.stay))
        blocks: list[Float[np.ndarray, "channel sample"]] = []
        for block in self._blocks():
            blocks.append(block)
            if sum(part.shape[1] for part in blocks) >= settle + stay:
                break
        return np.hstack(blocks)[:, settle : settle + stay]


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
