"""The takes in a folder: which there are, whose they are, and which numbers have been given."""

import re
import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from ema import store
from ema.data import TakeIdentity
from ema.errors import EmaError, InputError
from ema.file_names import folded, is_device

RAW, REJECTED = "raw", "rejected"
"""Folders of the takes that count and of the others."""

_NAME = re.compile(r"(?P<run>[^/\\]+)_(?P<point>[0-9]+)_(?P<number>[0-9]{3,})\.h5")
_GIVEN = re.compile(rf"(?:{RAW}|{REJECTED})/([^/\\\n;,\"]+)_([0-9]+)_([0-9]{{3,}})\.h5")
_TEMPORARY = re.compile(r"\..+_[0-9]+_[0-9]{3,}\.h5\..*\.tmp")

LONGEST_RUN = 64
"""Characters of a run's name. A name of a file has at most 255 bytes on common disks and a path 260 characters on
Windows; 64 leave room for four bytes each. Doubled, names in some scripts would not fit."""


@dataclass(frozen=True)
class TakeFile:
    """One take on disk, without its samples."""

    path: Path
    identity: TakeIdentity
    accepted: bool
    start: datetime | None
    channels: tuple[str, ...]
    sampling_rate: float

    @property
    def label(self) -> str:
        """Path within the folder of the campaign."""
        return f"{self.path.parent.name}/{self.path.name}"


@dataclass
class TakeFolder:
    """What is on disk, and what was there: a number that was given once is not given again."""

    folder: Path
    files: list[TakeFile] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """A sentence for every file that does not count although its name says it might."""
    _given: dict[tuple[str, int], int] = field(default_factory=dict)

    @classmethod
    def read(cls, folder: Path, journal: str = "") -> "TakeFolder":
        """Look at every take of every run; ``journal`` tells which numbers were given to takes that have gone."""
        takes = cls(folder)
        for run, point, number in _GIVEN.findall(journal):
            takes._note(run, int(point), int(number))
        seen: dict[str, TakeFile] = {}
        for path in _takes_below(folder):
            if (named := from_name(path.name)) is not None:
                takes._note(named.run, named.point, named.number)
            take = takes._taken(path, named)
            if take is None:
                continue
            first = seen.setdefault(take.identity.key or take.label, take)
            if first is take:
                takes.add(take)
            else:
                takes.notes.append(f"{take.label} is a copy of {first.label} and does not count; remove one of them")
        return takes

    def add(self, take: TakeFile) -> None:
        """Count a take in."""
        self._note(take.identity.run, take.identity.point, take.identity.number)
        self.files.append(take)

    def accepted(self, run: str, point: int) -> list[TakeFile]:
        """The takes of a run at a point that count, in the order of their numbers."""
        own = [one for one in self.files if one.accepted and (one.identity.run, one.identity.point) == (run, point)]
        return sorted(own, key=lambda one: one.identity.number)

    def next_number(self, run: str, point: int) -> int:
        """The number of the next take."""
        return self._given.get((folded(run), point), 0) + 1

    def pass_over(self, run: str, point: int, number: int) -> None:
        """A number that somebody else has given."""
        self._note(run, point, number)

    def runs(self) -> set[str]:
        """Names of the runs that have takes."""
        return {take.identity.run for take in self.files}

    def _note(self, run: str, point: int, number: int) -> None:
        key = (folded(run), point)
        self._given[key] = max(number, self._given.get(key, 0))

    def _taken(self, path: Path, named: TakeIdentity | None) -> TakeFile | None:
        try:
            headers = store.describe(path)
        except EmaError as error:
            if named is not None:
                self.notes.append(f"{path.parent.name}/{path.name} does not count: {error.what}")
            return None
        record = headers[0].record if len(headers) == 1 else None
        identity = named if record is None or record.identity is None else record.identity
        if record is None or identity is None:
            return None
        names = tuple(channel.name for channel in record.channels)
        return TakeFile(path, identity, path.parent.name == RAW, record.start, names, record.sampling_rate)


def file_name(identity: TakeIdentity) -> str:
    """What the file of a take is called."""
    return f"{identity.run}_{identity.point}_{identity.number:03d}.h5"


def from_name(name: str) -> TakeIdentity | None:
    """What the name of a file says; nothing where it is no name of a take.

    It is read from the right, where it has one meaning: ``beam_1_2_001.h5`` is of run ``beam_1``.
    """
    parts = _NAME.fullmatch(unicodedata.normalize("NFC", name))
    return None if parts is None else TakeIdentity(parts["run"], int(parts["point"]), int(parts["number"]))


def checked_run(name: str, others: Iterable[str]) -> str:
    """The name of a run as files bear it (composed Unicode).

    Parameters
    ----------
    others : names of the runs that there are.

    Raises
    ------
    InputError : a name that some disk cannot keep, or cannot keep apart from one of the ``others``.
    """
    run = unicodedata.normalize("NFC", name)
    if not run or not all(letter.isalnum() or letter in "-_" for letter in run):
        raise InputError("a run is named by letters, digits, - and _", got=name, expected="a name such as beam_1kN")
    if len(run) > LONGEST_RUN:
        raise InputError(
            "the name of the run is too long", got=f"{len(run)} characters", expected=f"at most {LONGEST_RUN}"
        )
    if is_device(run):  # files of takes never bear the bare name, but files of results may
        raise InputError(
            "a run cannot have a name that Windows keeps for a device",
            got=name,
            advice=f"call it run_{run}, for instance",
        )
    for other in others:
        if other != run and folded(other) == folded(run):
            raise InputError(
                f"the name differs from run {other} by capital letters alone, and many disks do not tell them apart",
                got=run,
                advice=f"go on with --run {other}, or choose another name",
            )
    return run


def remove_remains(folder: Path) -> None:
    """Remove what a killed session has left: temporary files, and names claimed without a take.

    To be called by the session that holds the lock of the folder: then none of them is anybody's.
    """
    for place in (RAW, REJECTED):
        for path in (folder / place).iterdir():
            claimed = from_name(path.name) is not None and path.is_file() and path.stat().st_size == 0
            if claimed or _TEMPORARY.fullmatch(path.name):
                path.unlink(missing_ok=True)


def _takes_below(folder: Path) -> Iterator[Path]:
    for place in (RAW, REJECTED):
        yield from sorted(path for path in (folder / place).glob("*.h5") if not path.name.startswith("."))
