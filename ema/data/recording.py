"""Time signals as measured, in SI."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Bool, Float

from ema.data._arrays import check_axes, freeze
from ema.data._summary import Container, brief, count, phrase
from ema.data.stored_signals import StoredSignals
from ema.dof import Dof
from ema.errors import InputError
from ema.units import UNSTATED, Quantity

if TYPE_CHECKING:
    import pandas as pd

    Signals = Float[np.ndarray, "channel sample"]
else:
    Signals = Float[np.ndarray, "channel sample"] | Float[StoredSignals, "channel sample"]

Role = Literal["reference", "response", "normal force", "generator", "trigger", "other"]


@dataclass(frozen=True, repr=False)
class Channel(Container):
    """One line of the channel table.

    Parameters
    ----------
    name : str
        What the channel is called.
    dof : Dof, optional
        Where and in which direction it measures, where known.
    quantity : Quantity, default "unstated"
        What it measures.
    role : {"reference", "response", "normal force", "generator", "trigger", "other"}, default "response"
        What its signal is used for; ``"generator"`` is the signal that drives the amplifier of a shaker.
    unit : str, optional
        SI unit of the signal, or ``"unstated"``: the signal then holds the bare numbers of the file.
    sensitivity : float, optional
        V per SI unit, where known.
    serial : str, optional
        Serial number of the sensor.
    calibrated_on : str, optional
        Date of its calibration, as written in the channel table.
    range : float, optional
        Full scale in the unit of the signal; ``None`` where unknown.
    joint : str, optional
        Name of the joint whose normal force the channel measures.

    Examples
    --------
    >>> Channel("hammer", Dof(5, "-Z"), quantity="force", role="reference", unit="N").scaled
    True
    """

    name: str
    dof: Dof | None = None
    quantity: Quantity = "unstated"
    role: Role = "response"
    unit: str = UNSTATED
    sensitivity: float | None = None
    serial: str = ""
    calibrated_on: str = ""
    range: float | None = None
    joint: str = ""

    @property
    def scaled(self) -> bool:
        """Whether the unit is known."""
        return self.unit != UNSTATED


@dataclass(frozen=True, repr=False)
class TakeIdentity(Container):
    """Which take a record is, written into its file by the recorder.

    The identity counts, not the name of the file.

    Parameters
    ----------
    run : str
        Run that was measured.
    point : int
        Point of the run that was measured.
    number : int
        Counts the takes of a run at a point, rejected ones included; never given twice.
    key : str, optional
        Drawn anew for each take, so that a copy is recognised.
    reasons : tuple of str, optional
        Why the take was rejected; empty where it was accepted.
    remarks : tuple of str, optional
        What else was noticed.

    Examples
    --------
    >>> TakeIdentity(run="bare", point=12, number=3)
    TakeIdentity(run='bare', point=12, number=3)
    """

    run: str
    point: int
    number: int
    key: str = ""
    reasons: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class Recording(Container):
    """Simultaneously sampled signals.

    Parameters
    ----------
    signals : array of shape (channel, sample)
        SI, or bare numbers where the unit of the channel is unstated; kept as float32 where they come so. Those of a
        large record of a campaign stay in its file: an index reads what it names, ``numpy.asarray`` all.
    sampling_rate : float
        Samples per second [Hz].
    channels : tuple of Channel
        One per row of ``signals``.
    start : datetime, optional
        UTC time of the first sample.
    overloads : boolean array of shape (channel,), optional
        True where the front end reported an overload; ``None`` where it says nothing.
    name : str, optional
        What the record is called in messages, such as the file and set it came from.
    setup : str, optional
        Label of the sensor set-up that the record belongs to (roving accelerometers).
    excluded_hits : tuple of tuple of (int, str), optional
        Numbers (from 0, in order of time) of impacts that a repair excludes, with the reason of each.
    identity : TakeIdentity, optional
        Which take of a recorded run this is; ``None`` where it was not recorded by this project.

    Examples
    --------
    >>> from ema.examples import recording
    >>> record = recording()
    >>> record.duration, float(record.signal("hammer").max().round())
    (2.0, 100.0)
    """

    signals: Signals
    sampling_rate: float
    channels: tuple[Channel, ...]
    start: datetime | None = None
    overloads: Bool[np.ndarray, "channel"] | None = None
    name: str = ""
    setup: str = ""
    excluded_hits: tuple[tuple[int, str], ...] = ()
    identity: TakeIdentity | None = None

    def __post_init__(self) -> None:
        freeze(self, overloads=np.bool_)
        if not isinstance(self.signals, StoredSignals):
            signals = np.asarray(self.signals)
            freeze(self, signals=signals.dtype if signals.dtype in (np.float32, np.float64) else np.float64)
        check_axes(self)

    @classmethod
    def from_arrays(
        cls,
        signals: "np.ndarray",
        sampling_rate: float,
        *,
        channels: "Sequence[Channel | str]",
        name: str = "",
    ) -> "Recording":
        """Make a record from an array of another program.

        Parameters
        ----------
        signals : array of shape (channel, sample) or (sample,)
            SI values, or bare numbers of channels whose unit is unstated.
        sampling_rate : float
            Hz.
        channels : sequence of Channel or str
            One per row; a name alone is a response of unstated unit.
        name : str
            What the record is called in messages.

        Returns
        -------
        Recording
            The record.

        Raises
        ------
        InputError
            If rows and channels disagree, the array stands the other way round, or the rate is not positive.

        Examples
        --------
        >>> hammer = Channel("hammer", quantity="force", role="reference", unit="N")
        >>> Recording.from_arrays(np.zeros((2, 1000)), 1000.0, channels=[hammer, "acc 1"])
        Recording(2 channels x 1000 samples, 1000 Hz, 1 s, channels hammer, acc 1)
        """
        rows = np.atleast_2d(np.asarray(signals))
        if rows.ndim != 2 or len(rows) != len(channels):
            turned = rows.ndim == 2 and rows.shape[1] == len(channels)
            raise InputError(
                "the signals and their channels disagree",
                where=name,
                got=f"an array of shape {np.shape(signals)} for {len(channels)} channels",
                expected="(channel, sample)",
                advice="turn it by signals.T" if turned else "",
            )
        if not sampling_rate > 0:
            raise InputError("not a sampling rate", where=name, got=f"{sampling_rate:g} Hz", expected="above 0")
        lines = tuple(Channel(channel) if isinstance(channel, str) else channel for channel in channels)
        return cls(rows, float(sampling_rate), lines, name=name)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return the signals as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One column per channel, named with its unit, over the time in s.

        Examples
        --------
        >>> from ema.examples import recording
        >>> list(recording().to_dataframe().columns)
        ['hammer [N]', 'acc 1 [m/s^2]']
        """
        import pandas as pd

        names = [f"{channel.name} [{channel.unit}]" for channel in self.channels]
        return pd.DataFrame(self.signals.T, index=pd.Index(self.times, name="time [s]"), columns=names)

    @property
    def duration(self) -> float:
        """Length of the record in s."""
        return float(self.signals.shape[1] / self.sampling_rate)

    @property
    def times(self) -> Float[np.ndarray, "sample"]:
        """Time axis in s, from 0."""
        return np.arange(self.signals.shape[1]) / self.sampling_rate

    def with_role(self, role: Role) -> tuple[int, ...]:
        """Return the rows of the channels that play a role.

        Parameters
        ----------
        role : {"reference", "response", "normal force", "generator", "trigger", "other"}
            Role to look for.

        Returns
        -------
        tuple of int
            Rows of ``signals``, from 0.

        Examples
        --------
        >>> from ema.examples import recording
        >>> recording().with_role("response")
        (1,)
        """
        return tuple(row for row, channel in enumerate(self.channels) if channel.role == role)

    def signal(self, name: str) -> Float[np.ndarray, "sample"]:
        """Return the signal of a channel.

        Parameters
        ----------
        name : str
            Name of the channel.

        Returns
        -------
        array of shape (sample,)
            The signal in the unit of its channel.

        Raises
        ------
        InputError
            If there is no such channel.

        Examples
        --------
        >>> from ema.examples import recording
        >>> recording().signal("acc 1").shape
        (2048,)
        """
        for channel, row in zip(self.channels, self.signals, strict=True):
            if channel.name == name:
                return np.asarray(row)
        raise InputError(
            "no such channel", where=self.name, got=name, expected="one of " + ", ".join(c.name for c in self.channels)
        )

    def _headline(self) -> str:
        return phrase(
            brief(self.name) if self.name else "",
            f"{count(len(self.channels), 'channel')} x {count(self.signals.shape[1], 'sample')}",
            f"{self.sampling_rate:g} Hz",
            f"{self.duration:.4g} s",
            "channels "
            + ", ".join(channel.name for channel in self.channels[:4])
            + (", ..." if len(self.channels) > 4 else ""),
        )
