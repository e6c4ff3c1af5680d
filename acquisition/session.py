"""A hammer test as it is measured: every take is on disk before the next one is armed."""

import csv
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path

import numpy as np

from acquisition.rig_file import RigFile
from ema import store
from ema.data import Finding, Recording, Source
from ema.errors import FailureError, InputError
from ema.store.atomic import replacing

Judge = Callable[[Recording], tuple[Finding, ...]]
"""What is wrong with a take; an error among it rejects the take."""

RAW, REJECTED, JOURNAL = "raw", "rejected", "takes.csv"


@dataclass(frozen=True)
class Take:
    """One take as it was kept: where the hammer struck, whether it counts, why not, and the normal force in N."""

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

    Parameters
    ----------
    folder : of the campaign; ``raw`` holds the takes that count, ``rejected`` the others, ``takes.csv`` all of them.
    run : id of the run.
    judge : what is wrong with a take.
    """

    folder: Path
    rig: RigFile
    run: str
    judge: Judge
    _counted: dict[int, int] = field(init=False)

    def __post_init__(self) -> None:
        if not self.run or not all(letter.isalnum() or letter in "-_" for letter in self.run):
            raise InputError("a run is named by letters, digits, - and _", got=self.run)
        try:
            for name in (RAW, REJECTED):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FailureError("the folder cannot be written", where=str(self.folder), got=error.strerror) from error
        self._counted = {point: len(self._files(point)) for point in self.rig.take.points}
        self._describe()

    @property
    def done(self) -> int:
        """Takes that count, those of earlier sessions included."""
        return sum(self._counted.values())

    @property
    def wanted(self) -> int:
        """Takes that the session is to have."""
        return self.rig.take.takes * len(self.rig.take.points)

    @property
    def point(self) -> int | None:
        """Where the next blow belongs; nothing when the session is complete."""
        return next((point for point, count in self._counted.items() if count < self.rig.take.takes), None)

    def takes(self, source: Source) -> Iterator[Take]:
        """Measure until every point has its takes; each take is on disk before it is told.

        Raises
        ------
        FailureError : the disk is full or the device has gone; takes told before are safe.
        """
        records = source.takes()
        while (point := self.point) is not None:
            try:
                record = next(records)
            except StopIteration:
                return
            yield self._kept(record, point)

    def recordings(self, point: int) -> list[Recording]:
        """The takes of a point that count."""
        return [store.load(path) for path in self._files(point)]

    def _kept(self, record: Recording, point: int) -> Take:
        findings = self.judge(record)
        reasons = tuple(str(one.message) for one in findings if one.severity == "error")
        remarks = tuple(str(one.message) for one in findings if one.severity == "warning")
        number = self._counted[point] + 1
        path = self.folder / RAW / f"{self.run}_{point}_{number:03d}.h5"
        if reasons:
            place = self.folder / REJECTED
            path = place / f"{self.run}_{point}_{len(list(place.glob('*.h5'))) + 1:03d}.h5"
        store.save(path, record)
        rows = {channel.joint or channel.name: row for row, channel in enumerate(record.channels)
                if channel.role == "normal force"}  # fmt: skip
        forces = {
            joint: (float(record.signals[row].mean()), float(record.signals[row].std())) for joint, row in rows.items()
        }
        force = record.signals[record.with_role("reference")[0]]
        peak = float(force[np.argmax(np.abs(force))])
        if not reasons:
            self._counted[point] = number
        take = Take(point, number, record, not reasons, reasons, remarks, peak, forces, path)
        self._note(take)
        return take

    def _files(self, point: int) -> list[Path]:
        return sorted((self.folder / RAW).glob(f"{self.run}_{point}_[0-9]*.h5"))

    def _note(self, take: Take) -> None:
        """A line of the journal, on disk when this returns."""
        path = self.folder / JOURNAL
        joints = list(take.normal_forces)
        title = ["file", "start", "point", "accepted", "reason", "remarks", "peak [N]"]
        title += [f"{what} {joint} [N]" for joint in joints for what in ("F_N", "std")]
        line = [
            take.path.relative_to(self.folder).as_posix(),
            "" if take.record.start is None else take.record.start.isoformat(), take.point,
            "yes" if take.accepted else "no", " ".join(take.reasons), " ".join(take.remarks), f"{take.peak:.6g}",
            *(f"{value:.7g}" for joint in joints for value in take.normal_forces[joint]),
        ]  # fmt: skip
        text = StringIO()
        writer = csv.writer(text, lineterminator="\n")
        try:
            with path.open("a+", encoding="utf-8", newline="") as file:
                file.seek(0)
                old = file.read()
                if not old:
                    writer.writerow(title)
                elif not old.endswith("\n"):
                    text.write("\n")  # the line that a killed session was writing
                writer.writerow(line)
                file.write(text.getvalue())
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise FailureError("the journal cannot be written", where=str(path), got=error.strerror) from error

    def _describe(self) -> None:
        """The campaign file, once; what its owner writes there later stays."""
        from acquisition.campaign_file import FILE_NAME

        path = self.folder / FILE_NAME
        entry = (
            f'\n[[runs]]\nid = {json.dumps(self.run)}\nkind = "hammer"\nfiles = "{self.run}_{{point}}_{{take}}.h5"\n'
        )
        text = path.read_text(encoding="utf-8") if path.is_file() else self._head()
        if f"id = {json.dumps(self.run)}" in text:
            return
        with replacing(path) as temporary:
            Path(temporary).write_text(text + entry, encoding="utf-8")

    def _head(self) -> str:
        about = self.rig.campaign
        lines = ["[campaign]", f"name = {json.dumps(about.name or self.folder.resolve().name, ensure_ascii=False)}"]
        lines += [
            f"{name} = {json.dumps(text, ensure_ascii=False)}" for name in ("structure", "operator", "comment")
            if (text := getattr(about, name))
        ]  # fmt: skip
        lines += [f'files = "{RAW}"', ""]
        from acquisition.rig_file import wires

        for wire, table in zip(wires(self.rig), self.rig.channels, strict=True):
            told = {
                "name": wire.channel.name, "role": wire.channel.role, "quantity": wire.channel.quantity,
                "unit": wire.channel.unit, "dof": table.dof, "serial": table.serial, "range": table.range or "",
                "calibrated_on": table.calibrated_on, "joint": table.joint,
            }  # fmt: skip
            lines += ["[[channels]]", *(f"{name} = {json.dumps(text)}" for name, text in told.items() if text), ""]
        for joint in self.rig.joints:
            told = {"name": joint.name, "load_cell": joint.load_cell, "calibrated_on": joint.calibrated_on}
            lines += ["[[joints]]", *(f"{name} = {json.dumps(text)}" for name, text in told.items() if text), ""]
        return "\n".join(lines)
