"""What every virtual rig has: channels, records, and what sensors and front ends add to the signals."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta

import numpy as np
from jaxtyping import Float

from ema.data import BeamModel, Channel, Finding, ModalModel, Recording
from ema.errors import InputError
from ema.simulate.checks import finite, not_negative, positive
from ema.simulate.inputs import RandomShakers, RecordedForces, RovingHammer, SnapBack, SteppedSine, SweptShaker

Drive = RovingHammer | RandomShakers | SweptShaker | SteppedSine | SnapBack | RecordedForces

DERIVATIVES = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Responses a structure can show, and the power of j*omega that leads to them from displacement."""

PASS_BAND = 0.4
"""The anti-alias filter is flat up to this fraction of the sampling rate, and zero at half the sampling rate."""


@dataclass(frozen=True)
class RingCell:
    """A ring load cell under the head of the bolt of a joint.

    Parameters
    ----------
    joint : str
        Name of the joint.
    mean : float, optional
        Mean force [N]; NaN for what the model says.
    rms : float, default 0.0
        Noise [N rms].
    drift : float, default 0.0
        Drift over a record [N].
    gain : float, default 1.0
        Reading over true force, 1 for a cell calibrated in place.

    Raises
    ------
    InputError
        If the mean or the noise is negative, or the gain is not positive.

    Examples
    --------
    >>> RingCell("left", mean=1000.0, rms=2.0).gain
    1.0
    """

    joint: str
    mean: float = float("nan")
    rms: float = 0.0
    drift: float = 0.0
    gain: float = 1.0

    def __post_init__(self) -> None:
        where = f"ring {self.joint}"
        not_negative(where, mean=0.0 if np.isnan(self.mean) else self.mean, rms=self.rms)
        finite(where, drift=self.drift)
        positive(where, gain=self.gain)


def anti_alias(frequencies: Float[np.ndarray, "freq"], sampling_rate: float) -> Float[np.ndarray, "freq"]:
    """Anti-alias filter of linear phase (delay taken off): flat, then half a cosine down to zero."""
    start, stop = PASS_BAND * sampling_rate, 0.5 * sampling_rate
    return 0.5 + 0.5 * np.cos(np.pi * np.clip((frequencies - start) / (stop - start), 0, 1))


@dataclass(frozen=True)
class Rig(ABC):
    """A structure, its excitation, and the sensors and front end that record it; subclasses know how it moves.

    Parameters
    ----------
    model : the truth.
    drive : what excites it.
    responses : channels of the responses; ``range`` is the full scale in SI, ``None`` for no limit.
    sampling_rate : Hz.
    rings : ring load cells recorded with the signals, one channel each.
    force_range : full scale of the force channels in N.
    noise : rms of the noise of each quantity in SI, e.g. ``{"acceleration": 0.02}``.
    bits : resolution of the converter over plus and minus full scale; ``None`` for none.
    reversed_sensors : names of response channels that are mounted upside down without anybody knowing.
    seed : the same seed gives the same records, whichever of them are asked for.

    Raises
    ------
    InputError : a response is no motion, there is no such channel, a number is negative or none.
    """

    model: ModalModel | BeamModel
    drive: Drive
    responses: tuple[Channel, ...]
    sampling_rate: float
    rings: tuple[RingCell, ...] = ()
    force_range: float | None = None
    noise: Mapping[str, float] = field(default_factory=dict)
    bits: int | None = None
    reversed_sensors: tuple[str, ...] = ()
    seed: int = 0
    start: datetime | None = None
    name: str = "virtual"

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sampling_rate) and self.sampling_rate > 0):
            raise InputError("not a sampling rate", where=self.name, got=self.sampling_rate, expected="above 0 Hz")
        not_negative(self.name, **{f"noise of {quantity}": rms for quantity, rms in self.noise.items()})
        positive(
            self.name,
            **{
                name: value
                for name, value in (("bits", self.bits), ("force_range", self.force_range))
                if value is not None
            },
        )
        for channel in self.responses:
            if channel.quantity not in DERIVATIVES or channel.dof is None:
                raise InputError(
                    "a response needs a DOF and a motion",
                    where=f"{self.name}, channel {channel.name}",
                    got=channel.quantity,
                    expected=" or ".join(DERIVATIVES),
                )
        unknown = set(self.reversed_sensors) - {channel.name for channel in self.responses}
        if unknown:
            raise InputError(
                "no such response channel",
                where=self.name,
                got=", ".join(sorted(unknown)),
                expected="one of " + ", ".join(channel.name for channel in self.responses),
            )

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What each row of a record will be (for a roving hammer: of its first record)."""
        return self.channels_of(0)

    def channels_of(self, take: int) -> tuple[Channel, ...]:
        """What each row of the record number ``take`` is."""
        dofs = self.drive.dofs(take)
        hammer = isinstance(self.drive, RovingHammer)
        names = ["hammer" if hammer else f"force {number + 1}" for number in range(len(dofs))]
        forces = tuple(
            Channel(name, dof, quantity="force", role="reference", unit="N", range=self.force_range)
            for name, dof in zip(names, dofs, strict=True)
        )
        rings = tuple(
            Channel(f"ring {ring.joint}", quantity="force", role="normal force", unit="N", joint=ring.joint)
            for ring in self.rings
        )
        return forces + self.responses + rings

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is suspicious about the motion of the structure; nothing in a linear one."""
        return ()

    @property
    def samples(self) -> int:
        """Samples of a record."""
        return round(self.drive.duration * self.sampling_rate)

    def takes(self) -> Iterator[Recording]:
        """All records, one after the other."""
        for number in range(self.drive.takes):
            yield self.take(number)

    def close(self) -> None:  # noqa: B027 - a rig may hold something, most hold nothing
        """Nothing to give back."""

    def take(self, number: int) -> Recording:
        """The record number ``number`` (from 0); always the same one for the same seed."""
        rng = np.random.default_rng([self.seed, number])
        channels = self.channels_of(number)
        signals = np.array(self.signals(number, rng))
        overloads = np.zeros(len(channels), bool)
        for row, channel in enumerate(channels):
            if channel.name in self.reversed_sensors:
                signals[row] = -signals[row]
            signals[row], overloads[row] = self._front_end(signals[row], channel, rng)
        pause = timedelta(seconds=number * (self.drive.duration + 15))
        return Recording(
            signals,
            self.sampling_rate,
            channels,
            start=None if self.start is None else self.start + pause,
            overloads=overloads,
            name=f"{self.name} {' '.join(map(str, self.drive.dofs(number)))}",
        )

    @abstractmethod
    def signals(self, number: int, rng: np.random.Generator) -> Float[np.ndarray, "channel sample"]:
        """What the structure does in one record: forces, responses, ring cells."""

    def _ring(
        self, ring: RingCell, pressing: float | Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "sample"]:
        """The reading of a ring load cell under a force in N."""
        t = np.linspace(-0.5, 0.5, self.samples)
        return np.asarray(ring.gain * pressing + ring.drift * t + rng.normal(0, ring.rms, self.samples))

    def _front_end(
        self, signal: Float[np.ndarray, "sample"], channel: Channel, rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, "sample"], bool]:
        """Noise, full scale and resolution, and whether the full scale was exceeded."""
        noise = 0.0 if channel.role == "normal force" else self.noise.get(channel.quantity, 0.0)
        if noise:
            signal = signal + rng.normal(0, noise, len(signal))
        if channel.range is None:
            return signal, False
        overload = bool(np.abs(signal).max() > channel.range)
        signal = np.clip(signal, -channel.range, channel.range)
        if self.bits is not None:
            step = 2 * channel.range / 2**self.bits
            signal = step * np.round(signal / step)
        return signal, overload
