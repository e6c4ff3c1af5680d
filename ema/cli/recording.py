"""`ema record`: a hammer test as it is measured, or a stepped sine at a force level."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ema.cli.ending import FINDINGS, FINE, ends_well
from ema.cli.level_control import ShakerAtLevel, placed
from ema.data import Channel, Recording, Run, Source
from ema.errors import EmaError, FailureError

if TYPE_CHECKING:
    from acquisition import Session, Take
    from acquisition.rig_file import RigFile
    from ema.simulate import VirtualRig

app = typer.Typer(context_settings={"help_option_names": ["-h", "--help"]})

_ENOUGH = 2
"""Takes at a point from which a coherence can be estimated."""


@app.command("record")
@ends_well
def record(
    folder: Annotated[Path, typer.Argument(help="Folder with a rig.toml; it becomes a campaign.", show_default=False)],
    run: Annotated[str, typer.Option("--run", help="What the run is called.")] = "run",
    takes: Annotated[int | None, typer.Option("--takes", help="Stop after so many takes.", min=1)] = None,
    level: Annotated[
        str | None,
        typer.Option("--level", help='Force of the shaker at resonance, such as "30 N": it is controlled to it.'),
    ] = None,
) -> int:
    """Measure a hammer or shaker test: a take is judged and on disk before the next; the same command goes on."""
    from acquisition import Session, rig_file
    from ema.estimate import check_impact

    rig = rig_file.load(folder)
    target = rig_file.force_level(rig, level, folder)
    judge = check_impact if target is None else ShakerAtLevel(rig, target).judge
    session = Session(folder, rig, run, judge, target)
    print(f"{session.done} of {session.wanted} takes are in {folder}", flush=True)
    for note in session.notes:
        print(f"Note: {note}.", flush=True)
    if session.point is None:
        print(f"Next: ema run {folder}")
        return FINE
    source = opened(rig, session) if target is None else ShakerAtLevel(rig, target).opened()
    reasons: Counter[str] = Counter()
    accepted = rejected = 0
    try:
        _arm(session, rig)
        for number, take in enumerate(session.takes(source), 1):
            accepted, rejected = accepted + take.accepted, rejected + (not take.accepted)
            reasons.update(take.reasons)
            print(_line(take, session), flush=True)
            if number == takes or session.point is None:
                break
            _arm(session, rig)
    except FailureError as error:
        raise FailureError(
            error.what,
            where=error.where,
            got=error.got,
            advice=f"{session.done} takes are safe in {folder}; go on with the same command",
        ) from error
    finally:
        session.close()
        source.close()
    print(f"{session.done} of {session.wanted} takes; {rejected} rejected. {_next(session, accepted, reasons)}")
    return FINE if session.point is None or (takes is not None and accepted) else FINDINGS


def _next(session: "Session", accepted: int, reasons: "Counter[str]") -> str:
    """What to do now: a run without a take that counts cannot be processed."""
    if session.point is None:
        return f"Next: ema run {session.folder}"
    if accepted:
        return f"Next: the same command goes on at point {session.point}; ema run {session.folder} takes what is there"
    if not reasons:
        return "No take was measured; the source ended before the first one."
    reason, count = reasons.most_common(1)[0]
    return (
        f"No take of this session counts; {count} of them because: {reason.rstrip('.')}. They are kept in "
        f"{session.folder / 'rejected'}. Remove the cause, then the same command goes on."
    )


def opened(rig: "RigFile", session: "Session") -> Source:
    """The rig: a real one, or the virtual work table struck where the session wants it."""
    from acquisition import rig_file

    return VirtualHammer(rig, session) if rig.rig.device == "virtual" else rig_file.open_rig(rig)


def _arm(session: "Session", rig: "RigFile") -> None:
    if rig.shaker is not None:
        print(f"Shaker at point {session.point} ({session.done + 1} of {session.wanted}) ...", flush=True)
        return
    print(f"Strike point {session.point} ({session.done + 1} of {session.wanted}, {rig.take.trigger}) ...", flush=True)


def _line(take: "Take", session: "Session") -> str:
    """One take in a line: point, peak, normal force of every joint, and the verdict with its reason."""
    forces = ", ".join(f"{joint} {mean:.0f} +- {std:.0f} N" for joint, (mean, std) in take.normal_forces.items())
    verdict = "accepted" if take.accepted else f"REJECTED: {'; '.join(take.reasons)}"
    remarks = f" ({'; '.join(take.remarks)})" if take.remarks else ""
    return "  ".join(
        part
        for part in (
            f"point {take.point}",
            f"peak {take.peak:.4g} N",
            f"F_N {forces}" if forces else "no joint",
            verdict + remarks,
            "" if session.rig.shaker else average(session, take),
        )
        if part
    )


def average(session: "Session", take: "Take") -> str:
    """The running average at the point of a take: number of takes and what their coherence is."""
    import numpy as np

    from ema.data import Condition, Excitation
    from ema.estimate import hammer

    records = session.recordings(take.point) if take.accepted else []
    if len(records) < _ENOUGH:
        return ""
    records = [placed(one, session.rig, take.point) for one in records]
    try:
        frfs = hammer(Run("take", Condition(Excitation("hammer")), tuple(records)))
    except EmaError as error:
        return f"no average: {error.what}"
    if frfs.coherence is None:
        return ""
    return f"average of {len(records)}, coherence {float(np.nanmedian(frfs.coherence)):.3f}"


@dataclass
class VirtualHammer:
    """The built-in work table under a hammer that goes where the session wants it; a `Source`."""

    rig: "RigFile"
    session: "Session"

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Those of the first point."""
        return self._table.channels

    @property
    def sampling_rate(self) -> float:
        """Hz."""
        return self.rig.rig.sampling_rate

    def takes(self) -> Iterator[Recording]:
        """One impact after the other."""
        from datetime import UTC, datetime

        points = self.rig.take.points
        while (point := self.session.point) is not None:
            number = points.index(point) + len(points) * self.session.attempts
            record = self._table.take(number)
            yield replace(
                record,
                start=datetime.now(UTC),
                name="take",
                channels=tuple(replace(channel, dof=None) for channel in record.channels),
            )

    def close(self) -> None:
        """Nothing to give back."""

    @cached_property
    def _table(self) -> "VirtualRig":
        from acquisition import rig_file
        from ema.datasets import table
        from ema.dof import Dof
        from ema.simulate import RovingHammer, VirtualRig
        from ema.simulate.rig import RingCell

        tables = self.rig.channels
        wired = [wire.channel for wire in rig_file.wires(self.rig)]
        responses = tuple(
            replace(channel, dof=Dof.parse(table.dof))
            for channel, table in zip(wired, tables, strict=True)
            if channel.role == "response"
        )
        hammer = next(table for table in tables if table.role == "reference")
        dofs = tuple(Dof.parse(hammer.dof.replace("{point}", str(point))) for point in self.rig.take.points)
        rings = tuple(RingCell(channel.joint, 1020.0, 3.0) for channel in wired if channel.role == "normal force")
        drive = RovingHammer(dofs * 500, hits=1, contact_time=0.4e-3, pre_trigger=0.05, spacing=1.0)
        return VirtualRig(
            table.with_beam() if rings else table.bare(),
            drive,
            responses,
            self.sampling_rate,
            rings=rings,
            noise={"acceleration": 0.05, "force": 0.05},
            seed=7,
            name="virtual",
        )
