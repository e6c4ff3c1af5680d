"""A hammer test as it is measured: every take is on disk before the next one is armed."""

import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from acquisition import campaign_entry
from acquisition.live.folder_lock import FolderLock
from acquisition.live.journal import Journal, normal_forces, peak_force
from acquisition.live.take_files import (
    RAW,
    REJECTED,
    TakeFile,
    TakeFolder,
    checked_run,
    file_name,
    remove_remains,
)
from acquisition.rig_file import RigFile
from ema import store
from ema.data import Finding, Recording, Source, TakeIdentity
from ema.errors import EmaError, FailureError, InputError

Judge = Callable[[Recording], tuple[Finding, ...]]
"""What is wrong with a take; an error among it rejects the take."""


@dataclass(frozen=True)
class Take:
    """One take as it was kept.

    Parameters
    ----------
    point : int
        Point that was struck.
    number : int
        Number of the take at that point.
    record : Recording
        The record.
    accepted : bool
        Whether it counts.
    reasons : tuple of str
        Why it does not count.
    remarks : tuple of str
        What else was noticed.
    peak : float
        Peak force [N].
    normal_forces : dict of str to tuple of (float, float)
        Mean and standard deviation of the normal force over the take [N], for each joint.
    path : Path
        File of the take.

    Examples
    --------
    >>> from ema.examples import recording
    >>> Take(1, 1, recording(), True, (), (), 100.0, {"joint": (1000.0, 2.0)}, Path("take.h5")).accepted
    True
    """

    point: int
    number: int
    record: Recording
    accepted: bool
    reasons: tuple[str, ...]
    remarks: tuple[str, ...]
    peak: float
    normal_forces: dict[str, tuple[float, float]]
    """Mean and standard deviation over the take, for each joint."""
    path: Path


@dataclass
class Session:
    """Takes of one run in a folder that becomes a campaign; an interrupted session goes on where it stopped.

    A take belongs to the run that is written in its file, whatever the names of files look like. Its number counts the
    takes of the run at its point, rejected and deleted ones included, so that no name is ever given twice; a file is
    created and never replaced. While takes are measured the folder is locked against a second session.

    Parameters
    ----------
    folder : Path
        Folder of the campaign; ``raw`` holds the takes that count, ``rejected`` the others, ``takes.csv`` all of them.
    rig : RigFile
        What the ``rig.toml`` says.
    run : str
        Id of the run.
    judge : Judge
        Returns what is wrong with a record.
    level : float, optional
        Force level [N] to which a shaker is controlled; the campaign states it.
    normal_force : float, optional
        Normal force [N] that every joint is to have; the campaign states it as nominal.

    Raises
    ------
    InputError
        If the name is one that some disk cannot keep, the run was begun with other channels, at another level or normal
        force, or the campaign cannot be understood.
    FailureError
        If another session records into the folder, or it cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from acquisition import rig_file
    >>> from ema.examples import RIG, source
    >>> with tempfile.TemporaryDirectory() as name:
    ...     folder = Path(name)
    ...     _ = (folder / "rig.toml").write_text(RIG)
    ...     session = Session(folder, rig_file.load(folder), "bare", judge=lambda record: ())
    ...     [take.accepted for take in session.takes(source())]
    [True, True]
    """

    folder: Path
    rig: RigFile
    run: str
    judge: Judge
    level: float | None = None
    normal_force: float | None = None
    notes: tuple[str, ...] = field(init=False, default=())
    """What is to be known about files in the folder that do not count."""
    _takes: TakeFolder = field(init=False)
    _journal: Journal = field(init=False)
    _lock: FolderLock = field(init=False)
    _measuring: "Iterator[Take] | None" = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.run = checked_run(self.run, ())
        try:
            for name in (RAW, REJECTED):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FailureError(
                "the folder cannot be written",
                where=str(self.folder),
                got=error.strerror,
                advice="record into a folder that you may write to, on a disk with room",
            ) from error
        self._lock = FolderLock(self.folder)
        with self._alone():
            pass

    @property
    def done(self) -> int:
        """Takes that count, those of earlier sessions included."""
        return sum(len(self._takes.accepted(self.run, point)) for point in self.rig.take.points)

    @property
    def wanted(self) -> int:
        """Takes that the session is to have."""
        return self.rig.take.takes * len(self.rig.take.points)

    @property
    def attempts(self) -> int:
        """Takes of the run that are on disk, rejected ones included."""
        return sum(one.identity.run == self.run for one in self._takes.files)

    @property
    def point(self) -> int | None:
        """Where the next impact belongs; nothing when the session is complete."""
        wanted = self.rig.take.takes
        return next((p for p in self.rig.take.points if len(self._takes.accepted(self.run, p)) < wanted), None)

    def takes(self, source: Source) -> Iterator[Take]:
        """Measure until every point has its takes; each take is on disk before it is reported.

        Parameters
        ----------
        source : Source
            What delivers the records.

        Returns
        -------
        iterator of Take
            The takes as they are kept, rejected ones included.

        Raises
        ------
        FailureError
            If another session records into the folder, the disk is full, or the device does not answer any more; takes
            reported before are safe.

        Examples
        --------
        >>> import tempfile
        >>> from acquisition import rig_file
        >>> from ema.examples import RIG, source
        >>> with tempfile.TemporaryDirectory() as name:
        ...     folder = Path(name)
        ...     _ = (folder / "rig.toml").write_text(RIG)
        ...     session = Session(folder, rig_file.load(folder), "bare", judge=lambda record: ())
        ...     [round(take.peak) for take in session.takes(source())]
        [100, 100]
        """
        self._measuring = self._measured(source)
        return self._measuring

    def close(self) -> None:
        """End the measurement, if one is running, so that others may record into the folder.

        Examples
        --------
        >>> import tempfile
        >>> from acquisition import rig_file
        >>> from ema.examples import RIG, source
        >>> with tempfile.TemporaryDirectory() as name:
        ...     folder = Path(name)
        ...     _ = (folder / "rig.toml").write_text(RIG)
        ...     session = Session(folder, rig_file.load(folder), "bare", judge=lambda record: ())
        ...     first = next(session.takes(source()))
        ...     session.close()
        >>> first.number
        1
        """
        if self._measuring is not None:
            self._measuring.close()  # type: ignore[attr-defined]
            self._measuring = None

    def recordings(self, point: int) -> list[Recording]:
        """Return the takes of a point that count.

        Parameters
        ----------
        point : int
            Number of the point.

        Returns
        -------
        list of Recording
            Records in order of their numbers.

        Examples
        --------
        >>> import tempfile
        >>> from acquisition import rig_file
        >>> from ema.examples import RIG, source
        >>> with tempfile.TemporaryDirectory() as name:
        ...     folder = Path(name)
        ...     _ = (folder / "rig.toml").write_text(RIG)
        ...     session = Session(folder, rig_file.load(folder), "bare", judge=lambda record: ())
        ...     takes = list(session.takes(source()))
        ...     len(session.recordings(1))
        2
        """
        return [store.load(take.path) for take in self._takes.accepted(self.run, point)]

    def _measured(self, source: Source) -> Iterator[Take]:
        with self._alone():
            records = source.takes()
            while (point := self.point) is not None:
                try:
                    record = next(records)
                except StopIteration:
                    return
                yield self._kept(record, point)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Hold the folder: what a killed session left is removed, and what is on disk is taken stock of."""
        self._lock.acquire()
        try:
            try:
                remove_remains(self.folder)
            except OSError as error:
                raise FailureError(
                    "the folder cannot be written",
                    where=str(self.folder),
                    got=error.strerror,
                    advice="record into a folder that you may write to, on a disk with room",
                ) from error
            self._take_stock()
            yield
        finally:
            self._lock.release()

    def _take_stock(self) -> None:
        self._journal = Journal(self.folder)
        self._takes = TakeFolder.read(self.folder, self._journal.text)
        checked_run(self.run, {*self._takes.runs(), *campaign_entry.run_ids(self.folder)})
        self._refuse_other_channels()
        campaign_entry.refuse_other_levels(self.folder, self.run, self._levels)
        notes = list(self._takes.notes)
        if any(one.accepted for one in self._takes.files if one.identity.run == self.run):
            notes.append(campaign_entry.add_run(self.folder, self.rig, self.run, self._levels))
        notes.append(self._journal.rebuild(self._takes.files))
        self.notes = tuple(note for note in notes if note)

    @property
    def _levels(self) -> campaign_entry.Levels:
        return campaign_entry.Levels(self.level, self.normal_force)

    def _refuse_other_channels(self) -> None:
        names = tuple(channel.name for channel in self.rig.channels)
        for one in self._takes.files:
            if one.identity.run == self.run and one.accepted and one.channels != names:
                raise InputError(
                    f"run {self.run} was begun with other channels",
                    where=one.label,
                    got=", ".join(names),
                    expected=", ".join(one.channels),
                    advice="give the run with these channels another name",
                )

    def _kept(self, record: Recording, point: int) -> Take:
        """Judge a take and put it on disk under a number that no take has had."""
        reasons, remarks = self._verdict(record)
        path, record = self._created(record, TakeIdentity(self.run, point, 0, secrets.token_hex(8), reasons, remarks))
        identity = record.identity
        assert identity is not None
        names = tuple(channel.name for channel in record.channels)
        file = TakeFile(path, identity, not reasons, record.start, names, record.sampling_rate)
        self._takes.add(file)
        if not reasons:
            campaign_entry.add_run(self.folder, self.rig, self.run, self._levels)
        trouble = self._journal.add(file, record)
        remarks = (*remarks, trouble) if trouble else remarks
        return Take(
            point,
            identity.number,
            record,
            not reasons,
            reasons,
            remarks,
            peak_force(record),
            normal_forces(record),
            path,
        )

    def _verdict(self, record: Recording) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Why a take does not count, and what else there is to say about it."""
        try:
            findings = self.judge(record)
        except EmaError as error:  # a take that cannot be judged is kept aside, not lost
            return (str(error),), ()
        return (
            tuple(str(one.message) for one in findings if one.severity == "error"),
            tuple(str(one.message) for one in findings if one.severity == "warning"),
        )

    def _created(self, record: Recording, identity: TakeIdentity) -> tuple[Path, Recording]:
        """The file of a take, created under the first number that is free."""
        folder = self.folder / (REJECTED if identity.reasons else RAW)
        while True:
            number = self._takes.next_number(identity.run, identity.point)
            record = replace(record, identity=replace(identity, number=number))
            assert record.identity is not None
            path = folder / file_name(record.identity)
            try:
                store.save(path, record, exclusive=True)
            except FailureError as error:
                if not isinstance(error.__cause__, FileExistsError):
                    raise
                # somebody whom the lock did not hold off has used the number meanwhile
                self._takes.pass_over(identity.run, identity.point, number)
                continue
            return path, record
