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
    """One half-sine impact.

    Parameters
    ----------
    time : float
        Beginning [s].
    peak : float
        Peak force [N].
    contact_time : float
        Contact time [s].

    Examples
    --------
    >>> Blow(time=0.1, peak=800.0, contact_time=6e-4).peak
    800.0
    """

    time: float
    peak: float
    contact_time: float


def _points(where: str, points: Sequence[Dof]) -> None:
    if not len(points):
        raise InputError("no point to drive", where=where, got="0 points", expected="one DOF or more")


def spectrum_of(blows: tuple[Blow, ...], frequencies: Float[np.ndarray, "freq"]) -> Complex[np.ndarray, "freq"]:
    """Fourier transform in N s of a sequence of impacts."""
    total = np.zeros(len(frequencies), complex)
    for blow in blows:
        total += blow.peak * half_sine(frequencies, blow.contact_time, blow.time)
    return total


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong on purpose in one impact.

    Parameters
    ----------
    take : int
        Record, from 0.
    hit : int
        Impact in the record, from 0.
    kind : str
        ``double hit`` adds a second impact, ``overload`` makes the impact harder.
    strength : float, default 0.3
        Of a double hit, the second peak over the first; of an overload, the peak over the mean.
    delay : float, default 0.025
        Time [s] from the first to the second impact of a double hit.

    Raises
    ------
    InputError
        If the kind is another one.

    Examples
    --------
    >>> Fault(take=0, hit=2, kind="double hit").delay
    0.025
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
    """A hammer that strikes one point in each record, several times.

    Harder impacts are shorter, as with a real tip.

    Parameters
    ----------
    points : tuple of Dof
        DOFs of the impacts, one record for each.
    hits : int, default 5
        Number of impacts in a record.
    peak : float, default 800.0
        Mean peak force [N].
    scatter : float, default 0.15
        Relative standard deviation of the peak force.
    contact_time : float, default 0.0006
        Mean contact time [s].
    contact_scatter : float, default 0.05
        Relative standard deviation of the contact time.
    pre_trigger : float, default 0.1
        Time of the first impact [s].
    spacing : float, default 1.1
        Time between impacts [s].
    jitter : float, default 0.01
        Standard deviation of the times [s].
    faults : tuple of Fault, optional
        What goes wrong on purpose.

    Raises
    ------
    InputError
        If there is no point, or a number is negative or not finite.

    Examples
    --------
    >>> hammer = RovingHammer((Dof(1, "+Z"), Dof(2, "+Z")), hits=3)
    >>> len(hammer.blows(0, np.random.default_rng(1)))
    3
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
        """Length of a record in s: the last impact is followed by one spacing."""
        return self.pre_trigger + self.hits * self.spacing

    @property
    def excitation(self) -> Excitation:
        """The condition that the campaign states."""
        return Excitation(kind="hammer", level=self.peak, std=self.scatter * self.peak)

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Return where the force of a record acts.

        Parameters
        ----------
        take : int
            Record, from 0.

        Returns
        -------
        tuple of Dof
            One DOF.

        Examples
        --------
        >>> [str(dof) for dof in RovingHammer((Dof(1, "+Z"), Dof(2, "+Z"))).dofs(1)]
        ['2:+Z']
        """
        return (self.points[take],)

    def blows(self, take: int, rng: np.random.Generator) -> tuple[Blow, ...]:
        """Return the impacts of one record, faults included.

        Parameters
        ----------
        take : int
            Record, from 0.
        rng : Generator
            Source of the random numbers.

        Returns
        -------
        tuple of Blow
            Impacts in order of time.

        Examples
        --------
        >>> hammer = RovingHammer((Dof(1, "+Z"),), hits=2, faults=(Fault(0, 0, "double hit"),))
        >>> len(hammer.blows(0, np.random.default_rng(1)))
        3
        """
        # drawn as factors around 1 and kept positive, so that no draw can reverse an impact
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
        """Return the Fourier transforms of the forces of one record.

        Parameters
        ----------
        take : int
            Record, from 0.
        frequencies : array of shape (freq,)
            Frequencies [Hz].
        sampling_rate : float
            Not used: the pulses are transformed in closed form.
        rng : Generator
            Source of the random numbers.

        Returns
        -------
        complex array of shape (in, freq)
            Spectra [N s].

        Examples
        --------
        >>> hammer = RovingHammer((Dof(1, "+Z"),), hits=1, scatter=0.0, contact_scatter=0.0)
        >>> impulse = hammer.spectra(0, np.array([0.0]), 4096.0, np.random.default_rng(1))
        >>> half_sine = 2 / np.pi * 800.0 * 0.6e-3  # mean over peak, peak, contact time
        >>> round(float(impulse[0, 0].real / half_sine), 6)
        1.0
        """
        return spectrum_of(self.blows(take, rng), frequencies)[None]

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Return the forces of one record.

        Parameters
        ----------
        take : int
            Record, from 0.
        times : array of shape (sample,)
            Times [s].
        rng : Generator
            Source of the random numbers.

        Returns
        -------
        array of shape (in, sample)
            Forces [N].

        Examples
        --------
        >>> hammer = RovingHammer((Dof(1, "+Z"),), hits=1)
        >>> hammer.series(0, np.arange(512) / 4096.0, np.random.default_rng(1)).shape
        (1, 512)
        """
        blows = [hammer_pulse(times, blow.peak, blow.contact_time, blow.time) for blow in self.blows(take, rng)]
        return np.asarray(np.sum(blows, axis=0))[None]


@dataclass(frozen=True)
class RandomShakers(Waveform):
    """Shakers that drive all points at once with independent random forces.

    Parameters
    ----------
    points : tuple of Dof
        DOFs of the forces.
    level : float
        Level of each force [N rms].
    band : tuple of (float, float)
        Ends of the band [Hz].
    duration : float
        Length of a record [s].
    takes : int, default 1
        Number of records.

    Raises
    ------
    InputError
        If there is no point, a number is not positive, or the band is empty.

    Examples
    --------
    >>> shakers = RandomShakers((Dof(1, "+Z"), Dof(4, "+Z")), level=5.0, band=(10.0, 200.0), duration=4.0)
    >>> forces = shakers.series(0, np.arange(4096) / 1024.0, np.random.default_rng(1))
    >>> np.sqrt(np.mean(forces**2, axis=1)).round(6)
    array([5., 5.])
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
        """Return where the forces act.

        Parameters
        ----------
        take : int
            Record, from 0.

        Returns
        -------
        tuple of Dof
            One DOF per shaker.

        Examples
        --------
        >>> [str(dof) for dof in RandomShakers((Dof(1, "+Z"),), 5.0, (10.0, 200.0), 4.0).dofs(0)]
        ['1:+Z']
        """
        return self.points

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Return the forces of one record.

        Parameters
        ----------
        take : int
            Record, from 0.
        times : array of shape (sample,)
            Times [s], evenly spaced.
        rng : Generator
            Source of the random numbers.

        Returns
        -------
        array of shape (in, sample)
            Forces [N].

        Examples
        --------
        >>> shakers = RandomShakers((Dof(1, "+Z"),), 5.0, (10.0, 200.0), 4.0)
        >>> shakers.series(0, np.arange(64) / 1024.0, np.random.default_rng(1)).shape
        (1, 64)
        """
        from scipy.fft import irfft

        size = 2 * len(times)
        frequencies = np.fft.rfftfreq(size, times[1] - times[0])
        inside = (frequencies >= self.band[0]) & (frequencies <= self.band[1])
        draws = rng.normal(size=(2, len(self.points), len(frequencies)))
        signals = irfft(np.where(inside, draws[0] + 1j * draws[1], 0), size, axis=1)[:, : len(times)]
        return np.asarray(signals * self.level / np.sqrt(np.mean(signals**2, axis=1, keepdims=True)))


@dataclass(frozen=True)
class SweptShaker(Waveform):
    """One shaker whose force sweeps linearly through a band, once or several times without a pause (a periodic chirp).

    Parameters
    ----------
    point : Dof
        DOF of the force.
    level : float
        Amplitude of the force [N].
    band : tuple of (float, float)
        First and last frequency [Hz].
    sweep_time : float
        Time of one sweep [s].
    duration : float
        Length of a record [s].
    takes : int, default 1
        Number of records.
    sweeps : int, default 1
        Number of sweeps in a record.

    Raises
    ------
    InputError
        If a number is not positive.

    Examples
    --------
    >>> SweptShaker(Dof(1, "+Z"), level=5.0, band=(20.0, 60.0), sweep_time=8.0, duration=10.0).takes
    1
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
        """Return where the force acts.

        Parameters
        ----------
        take : int
            Record, from 0.

        Returns
        -------
        tuple of Dof
            One DOF.

        Examples
        --------
        >>> [str(dof) for dof in SweptShaker(Dof(1, "+Z"), 5.0, (20.0, 60.0), 8.0, 10.0).dofs(0)]
        ['1:+Z']
        """
        return (self.point,)

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Return the force of one record.

        Parameters
        ----------
        take : int
            Record, from 0.
        times : array of shape (sample,)
            Times [s].
        rng : Generator
            Not used: nothing is drawn.

        Returns
        -------
        array of shape (in, sample)
            Force [N], zero after the sweeps.

        Examples
        --------
        >>> drive = SweptShaker(Dof(1, "+Z"), 5.0, (20.0, 60.0), sweep_time=8.0, duration=10.0)
        >>> drive.series(0, np.array([9.0]), np.random.default_rng(1))
        array([[0.]])
        """
        return swept_sine(times, self.level, self.band, self.sweep_time, self.sweeps)[None]


@dataclass(frozen=True)
class Shaker:
    """What a shaker takes of the force that its current makes, and what sits below the load cell.

    Parameters
    ----------
    damping : float, default 0.0
        Damping by the back-EMF of the coil [N s/m], (B l)^2 / R.
    moving_mass : float, default 0.0
        Mass of armature and stinger [kg].
    mount_mass : float, default 0.0
        Mass between load cell and structure [kg].

    Raises
    ------
    InputError
        If a number is negative or not finite.

    Examples
    --------
    >>> Shaker(moving_mass=0.2).mount_mass
    0.0
    """

    damping: float = 0.0
    moving_mass: float = 0.0
    mount_mass: float = 0.0

    def __post_init__(self) -> None:
        not_negative("shaker", damping=self.damping, moving_mass=self.moving_mass, mount_mass=self.mount_mass)

    def taken(self, frequency: float) -> complex:
        """Return the force per displacement of the drive point that does not reach the structure, j w c - w^2 m.

        Parameters
        ----------
        frequency : float
            Frequency [Hz].

        Returns
        -------
        complex
            Force over displacement [N/m].

        Examples
        --------
        >>> round(Shaker(moving_mass=0.2).taken(10.0).real, 2)
        -789.57
        """
        omega = 2 * np.pi * frequency
        return complex(1j * omega * self.damping - omega**2 * (self.moving_mass + self.mount_mass))


@dataclass(frozen=True)
class SteppedSine:
    """One shaker that stays at each of some frequencies: one record for each of them.

    With a ``shaker``, ``level`` is the force of its coil: what reaches the structure drops at resonance, and the load
    cell also drives the mass below it.

    Parameters
    ----------
    point : Dof
        DOF of the force.
    level : float
        Amplitude of the force [N].
    frequencies : tuple of float
        Frequencies [Hz].
    duration : float, default 0.5
        Length of the steady state in a record [s].
    settle : float, optional
        Time [s] from the start of the force to the record; with ``None`` the steady state is computed by harmonic
        balance.
    shaker : Shaker, optional
        What the shaker takes of the force.

    Raises
    ------
    InputError
        If there is no frequency, or a number is not positive.

    Examples
    --------
    >>> len(SteppedSine(Dof(1, "+X"), level=5.0, frequencies=(39.0, 40.0, 41.0)).frequencies)
    3
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
        if self.settle is not None and self.shaker is not None:
            raise InputError(
                "a settling time with a shaker",
                where="stepped sine",
                got=f"settle = {self.settle:g} s",
                expected="the force on the structure itself in time",
                advice="leave out settle: steady states take the shaker with them",
            )

    @property
    def takes(self) -> int:
        """Number of records."""
        return len(self.frequencies)

    @property
    def excitation(self) -> Excitation:
        """The condition that the campaign states."""
        return Excitation("stepped sine", self.level, band=(min(self.frequencies), max(self.frequencies)))

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Return where the force acts.

        Parameters
        ----------
        take : int
            Record, from 0.

        Returns
        -------
        tuple of Dof
            One DOF.

        Examples
        --------
        >>> [str(dof) for dof in SteppedSine(Dof(1, "+X"), 5.0, (39.0,)).dofs(0)]
        ['1:+X']
        """
        return (self.point,)

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Return the force of one record, from the moment it is switched on.

        Parameters
        ----------
        take : int
            Record, from 0.
        times : array of shape (sample,)
            Times [s].
        rng : Generator
            Not used: nothing is drawn.

        Returns
        -------
        array of shape (in, sample)
            Force [N].

        Examples
        --------
        >>> drive = SteppedSine(Dof(1, "+X"), 5.0, (10.0,))
        >>> drive.series(0, np.array([0.0, 0.025]), np.random.default_rng(1)).round(6)
        array([[0., 5.]])
        """
        return stepped_sine(times, self.level, [self.frequencies[take]], float(times[-1]) + 1)[None]


@dataclass(frozen=True)
class RecordedForces(Waveform):
    """Forces that were recorded elsewhere and are applied again.

    Parameters
    ----------
    recordings : sequence of Recording
        Records with the forces [N] in their reference channels.
    excitation : Excitation
        How the structure was driven.

    Raises
    ------
    InputError
        If there is no record, or one has no reference channel with a DOF.

    Examples
    --------
    >>> from ema.examples import recording
    >>> drive = RecordedForces([recording()], Excitation("hammer"))
    >>> float(drive.series(0, np.arange(2048) / 1024.0, np.random.default_rng(1)).max().round())
    100.0
    """

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
        return float(first.signals.shape[1] / first.sampling_rate)

    def dofs(self, take: int) -> tuple[Dof, ...]:
        """Return where the forces of a record act.

        Parameters
        ----------
        take : int
            Record, from 0.

        Returns
        -------
        tuple of Dof
            One DOF per reference channel.

        Examples
        --------
        >>> from ema.examples import recording
        >>> [str(dof) for dof in RecordedForces([recording()], Excitation("hammer")).dofs(0)]
        ['1:+Z']
        """
        recording = self.recordings[take]
        channels = [recording.channels[row] for row in self._rows(recording)]
        return tuple(channel.dof for channel in channels if channel.dof is not None)

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Return the forces of one record, by cubic splines between its samples; zero before and after it.

        Parameters
        ----------
        take : int
            Record, from 0.
        times : array of shape (sample,)
            Times [s].
        rng : Generator
            Not used: nothing is drawn.

        Returns
        -------
        array of shape (in, sample)
            Forces [N].

        Examples
        --------
        >>> from ema.examples import recording
        >>> drive = RecordedForces([recording()], Excitation("hammer"))
        >>> drive.series(0, np.array([-1.0, 5.0]), np.random.default_rng(1))
        array([[0., 0.]])
        """
        from scipy.interpolate import make_interp_spline

        recording = self.recordings[take]
        forces = np.asarray(recording.signals[self._rows(recording)])
        there = np.arange(forces.shape[1]) / recording.sampling_rate
        values = make_interp_spline(there, forces, axis=1)(times)
        return np.asarray(np.where((times >= 0) & (times <= there[-1]), values, 0.0))


@dataclass(frozen=True)
class SnapBack:
    """A load that is raised slowly and released.

    Parameters
    ----------
    point : Dof
        DOF of the load.
    load : float
        Load [N].
    duration : float
        Length of a record [s].
    pre_trigger : float, default 0.1
        Time of the release [s] after the start of each record.
    takes : int, default 1
        Number of records.

    Raises
    ------
    InputError
        If the load is no number, or a time is not positive.

    Examples
    --------
    >>> SnapBack(Dof(1, "+X"), load=100.0, duration=1.0).pre_trigger
    0.1
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
        """Return where the load acts.

        Parameters
        ----------
        take : int
            Record, from 0.

        Returns
        -------
        tuple of Dof
            One DOF.

        Examples
        --------
        >>> [str(dof) for dof in SnapBack(Dof(1, "+X"), 100.0, 1.0).dofs(0)]
        ['1:+X']
        """
        return (self.point,)

    def series(
        self, take: int, times: Float[np.ndarray, "sample"], rng: np.random.Generator
    ) -> Float[np.ndarray, "in sample"]:
        """Return the load over one record.

        Parameters
        ----------
        take : int
            Record, from 0.
        times : array of shape (sample,)
            Times [s].
        rng : Generator
            Not used: nothing is drawn.

        Returns
        -------
        array of shape (in, sample)
            Load [N], zero from the release on.

        Examples
        --------
        >>> SnapBack(Dof(1, "+X"), 100.0, 1.0).series(0, np.array([0.0, 0.2]), np.random.default_rng(1))
        array([[100.,   0.]])
        """
        return np.where(times < self.pre_trigger, self.load, 0.0)[None]
