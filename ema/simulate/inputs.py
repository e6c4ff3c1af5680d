"""What drives a virtual structure: blows of a hammer, random or swept force of shakers, as spectra."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Excitation
from ema.dof import Dof
from ema.errors import InputError


def half_sine(
    frequencies: Float[np.ndarray, "freq"], contact_time: float, start: float = 0.0
) -> Complex[np.ndarray, "freq"]:
    """Fourier transform (in s) of half a sine of height 1 from ``start`` to ``start + contact_time`` s; Hz."""
    x = np.pi * frequencies * contact_time
    # cos(x) / ((pi/2)^2 - x^2) written with a sinc, which has no hole at x = pi/2
    even = (np.pi * contact_time / 2) * np.sinc(0.5 - x / np.pi) / (np.pi / 2 + x)
    return even * np.exp(-2j * np.pi * (start + contact_time / 2) * frequencies)


@dataclass(frozen=True)
class Blow:
    """One half-sine blow: it begins at ``time`` s, is ``peak`` N high and lasts ``contact_time`` s."""

    time: float
    peak: float
    contact_time: float


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


@dataclass(frozen=True)
class RandomShakers:
    """Shakers that drive all ``points`` at once with independent random forces of ``level`` N (rms) in ``band`` Hz."""

    points: tuple[Dof, ...]
    level: float
    band: tuple[float, float]
    duration: float
    takes: int = 1

    @property
    def excitation(self) -> Excitation:
        """The condition that the campaign states."""
        return Excitation(kind="random", level=self.level, band=self.band)

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Where the forces act."""
        return self.points

    def spectra(
        self, take: int, frequencies: Float[np.ndarray, "freq"], sampling_rate: float, rng: np.random.Generator
    ) -> Complex[np.ndarray, "in freq"]:
        """Fourier transforms in N s of the forces of one record."""
        from scipy.fft import irfft, rfft

        inside = (frequencies >= self.band[0]) & (frequencies <= self.band[1])
        draws = rng.normal(size=(2, len(self.points), len(frequencies)))
        size = 2 * (len(frequencies) - 1)
        signals = irfft(np.where(inside, draws[0] + 1j * draws[1], 0), size, axis=1)[:, : size // 2]
        signals *= self.level / np.sqrt(np.mean(signals**2, axis=1, keepdims=True))
        return np.asarray(rfft(signals, size, axis=1) / sampling_rate)


@dataclass(frozen=True)
class SweptShaker:
    """One shaker whose force of ``level`` N (amplitude) sweeps linearly through ``band`` Hz in ``sweep_time`` s."""

    point: Dof
    level: float
    band: tuple[float, float]
    sweep_time: float
    duration: float
    takes: int = 1

    @property
    def excitation(self) -> Excitation:
        """The condition that the campaign states."""
        return Excitation(kind="sweep", level=self.level, band=self.band)

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Where the force acts."""
        return (self.point,)

    def spectra(
        self, take: int, frequencies: Float[np.ndarray, "freq"], sampling_rate: float, rng: np.random.Generator
    ) -> Complex[np.ndarray, "in freq"]:
        """Fourier transform in N s of the force of one record."""
        from scipy.fft import rfft

        size = 2 * (len(frequencies) - 1)
        t = np.arange(int(self.sweep_time * sampling_rate)) / sampling_rate
        low, high = self.band
        signal = self.level * np.sin(2 * np.pi * (low * t + (high - low) / (2 * self.sweep_time) * t**2))
        return np.asarray(rfft(signal, size) / sampling_rate)[None]
