"""A modal model that is "measured": the virtual rig delivers records as a front end would.

The response of every mode to the force is exact: products of closed-form spectra on a time axis so long that nothing
wraps round, cut by an anti-alias filter of linear phase before the signals are sampled. Force and response pass the
same filter. Then come what sensors and front ends add: noise, full scale, resolution, a sensor mounted upside down.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Channel, ModalModel, Recording
from ema.dof import Dof, match
from ema.errors import InputError
from ema.simulate.inputs import RandomShakers, RovingHammer, SweptShaker

DERIVATIVES = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Responses a structure can show, and the power of j*omega that leads to them from displacement."""

PASS_BAND = 0.4
"""The anti-alias filter is flat up to this fraction of the sampling rate, and zero at half the sampling rate."""


@dataclass(frozen=True)
class RingCell:
    """A ring load cell under the head of the bolt of ``joint``: mean, dynamic rms and drift over a record, all in N."""

    joint: str
    mean: float
    rms: float = 0.0
    drift: float = 0.0


@dataclass(frozen=True)
class VirtualRig:
    """A structure with known modes, its excitation, and the sensors and front end that record it.

    Parameters
    ----------
    model : the truth, scaled to unit modal mass (or with residues in SI by its participation).
    drive : roving hammer, random shakers or a swept shaker.
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
    InputError : the model does not hold a DOF, is free in space, or a response is no motion.
    """

    model: ModalModel
    drive: RovingHammer | RandomShakers | SweptShaker
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
        residuals = self.model.residuals
        if residuals is not None and np.any(residuals.lower):
            raise InputError(
                "a virtual rig cannot hold a body that is free in space", where=self.name,
                advice="give the suspension modes instead of a lower residual",
            )  # fmt: skip
        for channel in self.responses:
            if channel.quantity not in DERIVATIVES or channel.dof is None:
                raise InputError(
                    "a response needs a DOF and a motion", where=f"{self.name}, channel {channel.name}",
                    got=channel.quantity, expected=" or ".join(DERIVATIVES),
                )  # fmt: skip
        unknown = set(self.reversed_sensors) - {channel.name for channel in self.responses}
        if unknown:
            raise InputError("no such response channel", where=self.name, got=", ".join(sorted(unknown)))

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
    def samples(self) -> int:
        """Samples of a record."""
        return round(self.drive.duration * self.sampling_rate)

    def takes(self) -> Iterator[Recording]:
        """All records, one after the other."""
        for number in range(self.drive.takes):
            yield self.take(number)

    def close(self) -> None:
        """Nothing to give back."""

    def take(self, number: int) -> Recording:
        """The record number ``number`` (from 0); always the same one for the same seed."""
        from scipy.fft import irfft

        rng = np.random.default_rng([self.seed, number])
        channels = self.channels_of(number)
        forces = self.drive.spectra(number, self._frequencies, self.sampling_rate, rng)
        dofs = self.drive.dofs(number)
        spectra = [*forces]
        for channel in self.responses:
            assert channel.dof is not None
            motion = sum(
                self._frf(channel.dof, dof, DERIVATIVES[channel.quantity]) * force
                for dof, force in zip(dofs, forces, strict=True)
            )
            spectra.append(-motion if channel.name in self.reversed_sensors else motion)
        scale = self.sampling_rate * self._filter
        signals = irfft(np.array(spectra) * scale, self._size, axis=1)[:, : self.samples]
        signals = np.vstack([signals, *(self._ring(ring, rng) for ring in self.rings)])
        overloads = np.zeros(len(channels), bool)
        for row, channel in enumerate(channels):
            signals[row], overloads[row] = self._front_end(signals[row], channel, rng)
        pause = timedelta(seconds=number * (self.drive.duration + 15))
        return Recording(
            signals, self.sampling_rate, channels, start=None if self.start is None else self.start + pause,
            overloads=overloads, name=f"{self.name} {' '.join(map(str, dofs))}",
        )  # fmt: skip

    def _ring(self, ring: RingCell, rng: np.random.Generator) -> Float[np.ndarray, "1 sample"]:
        t = np.linspace(-0.5, 0.5, self.samples)
        return np.asarray(ring.mean + ring.drift * t + rng.normal(0, ring.rms, self.samples))[None]

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

    @cached_property
    def _size(self) -> int:
        """Length of the transforms: twice the record, so that no response wraps round into it."""
        from scipy.fft import next_fast_len

        return 2 * int(next_fast_len(self.samples + 1))

    @cached_property
    def _frequencies(self) -> Float[np.ndarray, "freq"]:
        return np.fft.rfftfreq(self._size, 1 / self.sampling_rate)

    @cached_property
    def _filter(self) -> Float[np.ndarray, "freq"]:
        """Anti-alias filter of linear phase (delay taken off): flat, then half a cosine down to zero."""
        start, stop = PASS_BAND * self.sampling_rate, 0.5 * self.sampling_rate
        return 0.5 + 0.5 * np.cos(np.pi * np.clip((self._frequencies - start) / (stop - start), 0, 1))

    @cached_property
    def _all_poles(self) -> Complex[np.ndarray, "pole"]:
        """Poles of the modes and of the residual terms, and their conjugates."""
        rest = self.model.residuals
        poles = self.model.poles if rest is None else np.concatenate([self.model.poles, rest.poles])
        return np.concatenate([poles, poles.conj()])

    @cached_property
    def _basis(self) -> Complex[np.ndarray, "freq pole"]:
        """``1 / (j w - p)`` of decays that are cut off after half the transform, which makes the product of spectra an
        exact convolution instead of a circular one."""
        sign = 1 - 2.0 * (np.arange(len(self._frequencies)) % 2)
        cut = 1 - sign[:, None] * np.exp(self._all_poles * self._size / 2 / self.sampling_rate)
        return np.asarray(cut / (2j * np.pi * self._frequencies[:, None] - self._all_poles))

    def _frf(self, output: Dof, force: Dof, power: int) -> Complex[np.ndarray, "freq"]:
        """Receptance times ``(j w)**power``, with what the division by ``j w - p`` leaves over as a polynomial."""
        residues, upper = self._residues(output, force)
        poles, s = self._all_poles, 2j * np.pi * self._frequencies
        polynomial = upper * s**power
        for degree in range(power):
            polynomial = polynomial + np.sum(residues * poles ** (power - 1 - degree)) * s**degree
        return np.asarray(polynomial + self._basis @ (residues * poles**power))

    def _residues(self, output: Dof, force: Dof) -> tuple[Complex[np.ndarray, "pole"], complex]:
        """Residues for all poles, and the upper residual, between two DOFs; by reciprocity where necessary."""
        model, rest = self.model, self.model.residuals
        for row, column in ((output, force), (force, output)):
            rows, columns = match([row], model.dofs), match([column], model.inputs)
            if rows and columns:
                (_, k, sign), (_, i, other) = rows[0], columns[0]
                break
        else:
            raise InputError("the virtual structure has no such pair of DOFs", where=self.name, got=f"{output}/{force}")
        values = model.shapes[k] * model.participation[i]
        upper = 0j
        if rest is not None:
            upper = complex(rest.upper[k, i])
            if rest.residues is not None:
                values = np.concatenate([values, rest.residues[:, k, i]])
        values = sign * other * values
        return np.concatenate([values, values.conj()]), sign * other * upper
