"""``takes.csv``: a line for every take, made from the takes themselves whenever a line is missing."""

import csv
from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path

import numpy as np

from acquisition.live.take_files import TakeFile, from_name
from ema import store
from ema.cells import as_text
from ema.data import Recording
from ema.errors import EmaError
from ema.store.atomic import replacing

JOURNAL = "takes.csv"
_COLUMNS = ("file", "start", "run", "point", "number", "accepted", "reason", "remarks", "peak [N]")

Row = dict[str, str]


class Journal:
    """The journal of a folder.

    A line whose take has gone stays, marked ``deleted``; columns that the owner added stay as well. A file of this name
    that is no journal is set aside.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / JOURNAL
        self.text = _text(self._path)
        self._rows: list[Row] = []

    def rebuild(self, files: Sequence[TakeFile]) -> str:
        """Bring the journal in line with the takes on disk; what has kept it from being written, if anything."""
        former, foreign = _rows(self.text)
        present = {take.label: take for take in files}
        numbers = {_which(take) for take in files}
        self._rows = []
        for row in former:
            take = present.pop(row["file"], None)
            if take is not None:
                self._rows.append(_renewed(row, take))
                continue
            named = from_name(row["file"].rpartition("/")[2])
            if named is not None and (named.run, named.point, named.number) not in numbers:
                known = {"run": named.run, "point": str(named.point), "number": str(named.number)}
                self._rows.append(row | known | {"accepted": "deleted"})
        order = sorted(present.values(), key=lambda take: (take.start is None, take.start, take.label))
        self._rows += [_row(take, _record(take)) for take in order]
        trouble = ""
        if foreign:
            try:
                _set_aside(self._path)
            except OSError as error:
                return f"{JOURNAL} is no journal of takes, and cannot be set aside: {error.strerror}"
        if self._rendered() != self.text:
            trouble = self._write()
        return trouble

    def add(self, take: TakeFile, record: Recording) -> str:
        """Note a take that is on disk; what has kept the journal from being written, if anything."""
        self._rows.append(_row(take, record))
        return self._write()

    def _rendered(self) -> str:
        """Our columns, those of the joints, those of the owner."""
        names = list(dict.fromkeys(name for row in self._rows for name in row))
        joints = [name for name in names if name.startswith(("F_N ", "std ")) and name.endswith(" [N]")]
        others = [name for name in names if name not in (*_COLUMNS, *joints)]
        text = StringIO()
        writer = csv.DictWriter(text, [*_COLUMNS, *joints, *others], restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._rows)
        return text.getvalue() if self._rows else ""

    def _write(self) -> str:
        text = self._rendered()
        try:
            with replacing(self._path) as temporary:
                temporary.write_text(text, encoding="utf-8", newline="")
        except EmaError as error:
            return f"{JOURNAL} cannot be written: {error.what}; the next take or session makes it again"
        self.text = text
        return ""


def peak_force(record: Recording) -> float:
    """The sample of the hammer with the largest magnitude, in N."""
    force = record.signals[record.with_role("reference")[0]]
    return float(force[np.argmax(np.abs(force))])


def normal_forces(record: Recording) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the normal force over the take in N, for each joint."""
    return {
        channel.joint or channel.name: (float(signal.mean()), float(signal.std()))
        for channel, signal in zip(record.channels, record.signals, strict=True)
        if channel.role == "normal force"
    }


def _row(take: TakeFile, record: Recording | None) -> Row:
    identity = take.identity
    row = {
        "file": take.label,
        "start": "" if take.start is None else take.start.isoformat(),
        "run": as_text(identity.run),
        "point": str(identity.point),
        "number": str(identity.number),
        "accepted": "yes" if take.accepted else "no",
        "reason": as_text(" ".join(identity.reasons)),
        "remarks": as_text(" ".join(identity.remarks)),
        "peak [N]": "",
    }
    if record is None:
        return row
    if record.with_role("reference"):
        row["peak [N]"] = f"{peak_force(record):.6g}"
    for joint, (mean, std) in normal_forces(record).items():
        row |= {f"F_N {joint} [N]": f"{mean:.7g}", f"std {joint} [N]": f"{std:.7g}"}
    return row


def _renewed(row: Row, take: TakeFile) -> Row:
    """The line of a take that is on disk: as it is where it fits, otherwise made again with the owner's columns."""
    stated = _row(take, None) | {"peak [N]": row.get("peak [N]", ""), "remarks": row.get("remarks", "")}
    if row.get("peak [N]") and all(row.get(name) == value for name, value in stated.items()):
        return row
    return row | _row(take, _record(take))


def _record(take: TakeFile) -> Recording | None:
    try:
        content = store.load(take.path)
    except EmaError:
        return None
    return content if isinstance(content, Recording) else None


def _which(take: TakeFile) -> tuple[str, int, int]:
    return take.identity.run, take.identity.point, take.identity.number


def _text(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8", "replace")
    except OSError:
        return ""


def _rows(text: str) -> tuple[list[Row], bool]:
    """The whole lines of a journal, and whether the text is something else."""
    whole = text[: text.rfind("\n") + 1]
    reader = csv.DictReader(StringIO(whole))
    titles: Sequence[str] = reader.fieldnames or ()
    if text.strip() and "file" not in titles:
        return [], True
    rows: list[Mapping[str | None, str | list[str] | None]] = list(reader)
    return [
        {str(name): str(value) for name, value in row.items() if name and isinstance(value, str)}
        for row in rows
        if isinstance(row.get("file"), str)
    ], False


def _set_aside(path: Path) -> None:
    """Give a file another name that nothing bears yet."""
    number = 1
    while (other := path.with_name(f"{path.stem} ({number}){path.suffix}")).exists():
        number += 1
    path.rename(other)
