"""What drives a virtual structure, as spectra for linear and as time series for structures with friction."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Excitation, Recording
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate.checks import finite, not_negative, positive
from ema.simulate.waveforms import half_sine, hammer_pulse, stepped_sine, swept_sine


class Waveform(ABC):
    """An excitation that is known as a time series: its spectra are the transforms of that."""

    @abstractmethod
    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Forces in N of one record."""

    def spectra(
        self, take: int, frequencies: Float[np.ndarray, "freq"], sampling_rate: float, rng: np.random.Generator
    ) -> Complex[np.ndarray, "in freq"]:
        """Fourier transforms in N s of the forces of one record."""
        from scipy.fft import rfft

        size = 2 * (len(frequencies) - 1)
        signals = self.series(take, np.arange(size // 2) / sampling_rate, rng)
        return np.asarray(rfft(signals, size, axis=1) / sampling_rate)


@dataclass(frozen=True)
class Blow:
    """One half-sine blow: it begins at ``time`` s, is ``peak`` N high and lasts ``contact_time`` s."""

    time: float
    peak: float
    contact_time: float


def _points(where: str, points: Sequence[Dof]) -> None:
    if not len(points):
        raise InputError("no point to drive", where=where, got="0 points", expected="one DOF or more")


def spectrum_of(blows: tuple[Blow, ...], frequencies: Float[np.ndarray, "freq"]) -> Complex[np.ndarray, "freq"]:
    """Fourier transform in N s of a sequence of blows."""
    total = np.zeros(len(frequencies), complex)
    for blow in blows:
        total += blow.peak * half_sine(frequencies, blow.contact_time, blow.time)
    return total


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong on purpose: in record ``take`` and blow ``hit`` (from 0).

    ``double hit`` adds a second blow of ``strength`` times the first one ``delay`` s later; ``overload`` makes the blow
    ``strength`` times as hard as the mean.

    Raises
    ------
    InputError : another ``kind``.
    """

    take: int
    hit: int
    kind: str
    strength: float = 0.3
    delay: float = 0.025

    def __post_init__(self) -> None:
        if self.kind not in ("double hit", "overload"):
            raise InputError("no such fault", got=self.kind, expected="double hit or overload")


@dataclass(frozen=True)
class RovingHammer:
    """A hammer that hits one of ``points`` in each record, ``hits`` times.

    ``peak`` N and ``contact_time`` s are means, their scatters are relative standard deviations; harder blows are
    shorter, as with a real tip. The first blow comes ``pre_trigger`` s after the start, the next ones ``spacing`` s
    apart with a standard deviation of ``jitter`` s.

    Raises
    ------
    InputError : there is no point, a number is negative or none.
    """

    points: tuple[Dof, ...]
    hits: int = 5
    peak: float = 800.0
    scatter: float = 0.15
    contact_time: float = 0.6e-3
    contact_scatter: float = 0.05
    pre_trigger: float = 0.1
    spacing: float = 1.1
    jitter: float = 0.01
    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        _points("roving hammer", self.points)
        positive("roving hammer", hits=self.hits, contact_time=self.contact_time, spacing=self.spacing)
        finite("roving hammer", peak=self.peak)
        not_negative(
            "roving hammer",
            scatter=self.scatter,
            contact_scatter=self.contact_scatter,
            pre_trigger=self.pre_trigger,
            jitter=self.jitter,
        )

    @property
    def takes(self) -> int:
        """Number of records."""
        return len(self.points)

    @property
    def duration(self) -> float:
        """Length of a record in s: the last blow is followed by one spacing."""
        return self.pre_trigger + self.hits * self.spacing

    @property
    def excitation(self) -> Excitation:
        """The condition that the campaign states."""
        return Excitation(kind="hammer", level=self.peak, std=self.scatter * self.peak)

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Where the force of a record acts."""
        return (self.points[take],)

    def blows(self, take: int, rng: np.random.Generator) -> tuple[Blow, ...]:
        """The blows of one record, faults included."""
        # drawn as factors around 1 and kept positive, so that no draw can turn a blow round
        level = np.clip(rng.normal(1, self.scatter, self.hits), 0.2, 3)
        contact = np.clip(rng.normal(1, self.contact_scatter, self.hits), 0.5, 2)
        late = np.clip(rng.normal(0, self.jitter, self.hits), -3 * self.jitter, 3 * self.jitter)
        late[0] = abs(late[0])
        blows = []
        for hit in range(self.hits):
            time = self.pre_trigger + hit * self.spacing + late[hit]
            blow = Blow(time, self.peak * level[hit], self.contact_time * contact[hit] * level[hit] ** -0.2)
            for fault in self.faults:
                if (fault.take, fault.hit) == (take, hit) and fault.kind == "overload":
                    blow = Blow(time, self.peak * fault.strength, blow.contact_time)
                elif (fault.take, fault.hit) == (take, hit):
                    blows.append(Blow(time + fault.delay, fault.strength * blow.peak, blow.contact_time))
            blows.append(blow)
        return tuple(blows)

    def spectra(
        self, take: int, frequencies: Float[np.ndarray, "freq"], sampling_rate: float, rng: np.random.Generator
    ) -> Complex[np.ndarray, "in freq"]:
        """Fourier transforms in N s of the forces of one record."""
        return spectrum_of(self.blows(take, rng), frequencies)[None]

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Forces in N of one record."""
        blows = [hammer_pulse(times, blow.peak, blow.contact_time, blow.time) for blow in self.blows(take, rng)]
        return np.asarray(np.sum(blows, axis=0))[None]


@dataclass(frozen=True)
class RandomShakers(Waveform):
    """Shakers that drive all ``points`` at once with independent random forces of ``level`` N (rms) in ``band`` Hz.

    Raises
    ------
    InputError : there is no point, a number is not positive, the band is empty.
    """

    points: tuple[Dof, ...]
    level: float
    band: tuple[float, float]
    duration: float
    takes: int = 1

    def __post_init__(self) -> None:
        _points("random shakers", self.points)
        positive("random shakers", level=self.level, duration=self.duration, takes=self.takes)
        if not 0 <= self.band[0] < self.band[1] < np.inf:
            raise InputError(
                "not a band",
                where="random shakers",
                got=f"{self.band[0]} to {self.band[1]} Hz",
                expected="0 <= low < high",
            )

    @property
    def excitation(self) -> Excitation:
        """The condition that the campaign states."""
        return Excitation(kind="random", level=self.level, band=self.band)

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Where the forces act."""
        return self.points

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Forces in N of one record."""
        from scipy.fft import irfft

        size = 2 * len(times)
        frequencies = np.fft.rfftfreq(size, times[1] - times[0])
        inside = (frequencies >= self.band[0]) & (frequencies <= self.band[1])
        draws = rng.normal(size=(2, len(self.points), len(frequencies)))
        signals = irfft(np.where(inside, draws[0] + 1j * draws[1], 0), size, axis=1)[:, : len(times)]
        return np.asarray(signals * self.level / np.sqrt(np.mean(signals**2, axis=1, keepdims=True)))


@dataclass(frozen=True)
class SweptShaker(Waveform):
    """One shaker whose force of ``level`` N (amplitude) sweeps linearly through ``band`` Hz in ``sweep_time`` s.

    It does so ``sweeps`` times without a pause (a periodic chirp); the record goes on for ``duration`` s in all.

    Raises
    ------
    InputError : a number is not positive.
    """

    point: Dof
    level: float
    band: tuple[float, float]
    sweep_time: float
    duration: float
    takes: int = 1
    sweeps: int = 1

    def __post_init__(self) -> None:
        positive(
            "swept shaker",
            level=self.level,
            start_frequency=self.band[0],
            end_frequency=self.band[1],
            sweep_time=self.sweep_time,
            duration=self.duration,
            takes=self.takes,
            sweeps=self.sweeps,
        )

    @property
    def excitation(self) -> Excitation:
        """The condition that the campaign states."""
        return Excitation(kind="sweep", level=self.level, band=self.band)

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Where the force acts."""
        return (self.point,)

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Force in N of one record."""
        return swept_sine(times, self.level, self.band, self.sweep_time, self.sweeps)[None]


@dataclass(frozen=True)
class Shaker:
    """What a shaker takes of the force that its current makes, and what sits below the load cell.

    ``damping`` N s/m by the back-EMF of the coil ((B l)^2 / R), ``moving_mass`` kg of armature and stinger,
    ``mount_mass`` kg between load cell and structure.

    Raises
    ------
    InputError : a number is negative or none.
    """

    damping: float = 0.0
    moving_mass: float = 0.0
    mount_mass: float = 0.0

    def __post_init__(self) -> None:
        not_negative("shaker", damping=self.damping, moving_mass=self.moving_mass, mount_mass=self.mount_mass)

    def taken(self, frequency: float) -> complex:
        """Force in N per m of motion at the drive point that does not reach the structure."""
        omega = 2 * np.pi * frequency
        return complex(1j * omega * self.damping - omega**2 * (self.moving_mass + self.mount_mass))


@dataclass(frozen=True)
class SteppedSine:
    """One shaker that stays at each of ``frequencies`` Hz with ``level`` N (amplitude): one record for each of them.

    A record holds ``duration`` s of the steady state. With ``settle`` of None it is found by harmonic balance; else
    every record begins that many s after the force was switched on. With a ``shaker``, ``level`` is the force of its
    coil: what reaches the structure drops at resonance, and the load cell also drives the mass below it.

    Raises
    ------
    InputError : there is no frequency, a number is not positive.
    """

    point: Dof
    level: float
    frequencies: tuple[float, ...]
    duration: float = 0.5
    settle: float | None = None
    shaker: Shaker | None = None

    def __post_init__(self) -> None:
        if not len(self.frequencies):
            raise InputError(
                "no frequency to stay at", where="stepped sine", got="0 frequencies", expected="one or more, in Hz"
            )
        positive("stepped sine", level=self.level, duration=self.duration)
        for frequency in self.frequencies:
            positive("stepped sine", frequency=frequency)
        not_negative("stepped sine", settle=0.0 if self.settle is None else self.settle)

    @property
    def takes(self) -> int:
        """Number of records."""
        return len(self.frequencies)

    @property
    def excitation(self) -> Excitation:
        """The condition that the campaign states."""
        return Excitation("stepped sine", self.level, band=(min(self.frequencies), max(self.frequencies)))

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Where the force acts."""
        return (self.point,)

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Force in N of one record, from the moment it is switched on."""
        return stepped_sine(times, self.level, [self.frequencies[take]], float(times[-1]) + 1)[None]


@dataclass(frozen=True)
class RecordedForces(Waveform):
    """Forces that were recorded elsewhere (N, at the reference channels of the recordings) and are applied again."""

    recordings: Sequence[Recording]
    excitation: Excitation

    def __post_init__(self) -> None:
        if not len(self.recordings):
            raise InputError("no recorded force", got="0 recordings", expected="one or more")
        for recording in self.recordings:
            if any(recording.channels[row].dof is None for row in self._rows(recording)) or not self._rows(recording):
                raise InputError(
                    "no force with a DOF in a recording",
                    where=recording.name,
                    got=", ".join(channel.name for channel in recording.channels),
                    expected="a reference channel with a DOF",
                )

    @staticmethod
    def _rows(recording: Recording) -> list[int]:
        return [row for row, channel in enumerate(recording.channels) if channel.role == "reference"]

    @property
    def takes(self) -> int:
        """Number of records."""
        return len(self.recordings)

    @property
    def duration(self) -> float:
        """Of every record in s: that of the first."""
        first = self.recordings[0]
        return first.signals.shape[1] / first.sampling_rate

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Where the forces act."""
        recording = self.recordings[take]
        channels = [recording.channels[row] for row in self._rows(recording)]
        return tuple(channel.dof for channel in channels if channel.dof is not None)

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Forces in N of one record, by cubic splines between its samples; none before and behind."""
        from scipy.interpolate import make_interp_spline

        recording = self.recordings[take]
        forces = np.asarray(recording.signals[self._rows(recording)])
        there = np.arange(forces.shape[1]) / recording.sampling_rate
        values = make_interp_spline(there, forces, axis=1)(times)
        return np.asarray(np.where((times >= 0) & (times <= there[-1]), values, 0.0))


@dataclass(frozen=True)
class SnapBack:
    """A load of ``load`` N raised slowly at ``point`` and let go ``pre_trigger`` s after the start of each record.

    Raises
    ------
    InputError : the load is no number, a time is not positive.
    """

    point: Dof
    load: float
    duration: float
    pre_trigger: float = 0.1
    takes: int = 1

    def __post_init__(self) -> None:
        finite("snap-back", load=self.load)
        positive("snap-back", duration=self.duration, takes=self.takes)
        not_negative("snap-back", pre_trigger=self.pre_trigger)

    @property
    def excitation(self) -> Excitation:
        """The condition that the campaign states."""
        return Excitation("snap-back", self.load)

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Where the load acts."""
        return (self.point,)

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """The load in N over one record."""
        return np.where(times < self.pre_trigger, self.load, 0.0)[None]
