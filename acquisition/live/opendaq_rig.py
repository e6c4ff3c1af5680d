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


@dataclass(frozen=True)
class Wire:
    """Which channel of the device a channel of the record is, and the factor from its values to SI."""

    channel: Channel
    source: str
    factor: float = 1.0


class OpendaqRig:
    """Channels of one openDAQ device, read in step; a `Source` whose takes wait for a blow.

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
        trigger: Trigger,
        properties: Mapping[str, Any] | None = None,
    ) -> None:
        daq = require("opendaq", "daq")
        self._wires, self._rate, self._trigger, self._address = tuple(wires), sampling_rate, trigger, address
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

    def takes(self) -> Iterator[Recording]:
        """One record for each blow; whatever happens between two of them is not looked at.

        Raises
        ------
        FailureError : the device has gone.
        """
        while True:
            self._forget()
            signals = self._trigger.cut(self._blocks())
            start = datetime.now(UTC) - timedelta(seconds=signals.shape[1] / self._rate)
            yield Recording(signals, self._rate, self.channels, start=start, name="take")

    def close(self) -> None:
        """Give the device back."""
        self._reader = None
        self._instance.remove_device(self._device)

    def _blocks(self) -> Iterator[Float[np.ndarray, "channel sample"]]:
        size = max(1, round(_BLOCK * self._rate))
        factors = np.array([[wire.factor] for wire in self._wires])
        last = time.monotonic()
        while True:
            block = self._read(size)
            if block.shape[1]:
                last = time.monotonic()
                yield factors * block
            elif time.monotonic() - last > SILENCE:
                raise FailureError(
                    f"the device has sent nothing for {SILENCE:.0f} s",
                    where=self._address,
                    advice="takes on disk are safe; connect it again and go on with the same command",
                )

    def _read(self, count: int) -> Float[np.ndarray, "channel sample"]:
        """Samples in step; none while the device starts."""
        try:
            found = np.asarray(self._reader.read(count, 200), np.float64)
        except RuntimeError as error:
            raise FailureError(
                "the device has gone",
                where=self._address,
                got=_first_line(error),
                advice="takes on disk are safe; connect it again and go on with the same command",
            ) from error
        return found if found.ndim == 2 else np.zeros((len(self._wires), 0))

    def _forget(self) -> None:
        """Drop what has piled up while nobody waited for a blow."""
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


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
