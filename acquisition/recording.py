"""Recording from Python: a rig file, a source, and takes that are on disk before they are reported."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from acquisition import rig_file
from acquisition.rig_file import RigFile
from acquisition.session import Judge, Session, Take
from ema.data import Channel, Finding, Recording, Source
from ema.errors import InputError


def open_rig(rig: str | Path | RigFile) -> Source:
    """Open the hardware that a ``rig.toml`` describes, ready to take; close it afterwards.

    Parameters
    ----------
    rig : str or Path or RigFile
        The file, the folder that holds it, or what was read from it.

    Returns
    -------
    Source
        What delivers the records.

    Raises
    ------
    InputError
        If there is no such file, a key is unknown, missing or wrong, or the device does not exist (``virtual`` is known
        to ``ema record`` alone: make an ``ema.simulate.VirtualRig``).
    MissingExtraError
        If the device needs an optional package.
    FailureError
        If the device does not answer.

    Examples
    --------
    >>> try:
    ...     open_rig("no-such-rig.toml")
    ... except InputError as error:
    ...     "no-such-rig.toml" in str(error)
    True
    """
    return rig_file.open_rig(rig if isinstance(rig, RigFile) else rig_file.load(Path(rig)))


def _all(record: Recording) -> tuple[Finding, ...]:
    """Every take counts."""
    return ()


@contextmanager
def record(
    folder: str | Path, source: Source | None = None, run: str = "run", judge: Judge = _all
) -> Iterator["Takes"]:
    """Measure a run into a folder with a ``rig.toml``; it becomes a campaign, and an interrupted run goes on.

    Parameters
    ----------
    folder : str or Path
        Folder with the ``rig.toml``.
    source : Source, optional
        What delivers the records, a virtual rig for instance; the device of the ``rig.toml`` by default. It is closed
        at the end.
    run : str, default "run"
        Id of the run; letters, digits, - and _.
    judge : Judge, optional
        Returns what is wrong with a record (``ema.estimate.check_impact``); an error rejects it. By default every take
        counts.

    Yields
    ------
    Takes
        The takes as they are measured; each is on disk before it is reported.

    Raises
    ------
    InputError
        If there is no ``rig.toml``, or the source has other channels or another sampling rate.
    MissingExtraError
        As :func:`open_rig`.
    FailureError
        As :func:`open_rig`; or if the folder cannot be written, or another session records into it.

    Examples
    --------
    >>> try:
    ...     with record("no-such-folder") as takes:
    ...         pass
    ... except InputError as error:
    ...     "no-such-folder" in str(error)
    True
    """
    rig = rig_file.load(Path(folder))
    try:
        session = Session(Path(folder), rig, run, judge)
    except BaseException:
        if source is not None:
            source.close()
        raise
    opened = open_rig(rig) if source is None else source
    try:
        _refuse_other(rig, opened)
        yield Takes(session, opened)
    finally:
        session.close()
        opened.close()


@dataclass(frozen=True)
class Takes:
    """The takes of a run as they are measured; each is on disk before it is handed over.

    Going through them ends when every point has its takes, or the source has no more.
    """

    session: Session
    source: Source

    def __iter__(self) -> Iterator[Take]:
        return self.session.takes(_WithoutPlaces(self.source))

    def first(self, count: int) -> Iterator[Take]:
        """At most ``count`` takes, rejected ones included."""
        return islice(iter(self), count)


@dataclass(frozen=True)
class _WithoutPlaces:
    """A source whose channels name no point: where the hammer struck is the session's to say."""

    source: Source

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Channels of the source, without DOFs."""
        return tuple(replace(channel, dof=None) for channel in self.source.channels)

    @property
    def sampling_rate(self) -> float:
        """Hz."""
        return self.source.sampling_rate

    def takes(self) -> Iterator[Recording]:
        """Takes of the source, whose channels have no DOFs."""
        for one in self.source.takes():
            yield replace(one, channels=tuple(replace(channel, dof=None) for channel in one.channels))

    def close(self) -> None:
        """Close the source."""
        self.source.close()


def _refuse_other(rig: RigFile, source: Source) -> None:
    names, wanted = ([one.name for one in part] for part in (source.channels, rig.channels))
    if names != wanted:
        raise InputError(
            "the source has other channels than the rig.toml", got=", ".join(names), expected=", ".join(wanted)
        )
    if abs(source.sampling_rate - rig.rig.sampling_rate) > 1e-9 * rig.rig.sampling_rate:
        raise InputError(
            "the source samples at another rate than the rig.toml says",
            got=f"{source.sampling_rate:g} Hz",
            expected=f"{rig.rig.sampling_rate:g} Hz",
        )
