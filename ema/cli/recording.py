"""`ema record`: a hammer test as it is measured, or a stepped sine at a force level."""

import time
import webbrowser
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated

import typer

from ema.cli.ending import FINDINGS, FINE, ends_well
from ema.cli.level_control import LevelSource, ShakerAtLevel, off_normal_force, placed
from ema.cli.option_groups import grouped
from ema.data import Channel, Finding, FrfSet, Recording, Run, Source
from ema.errors import EmaError, FailureError, InputError

if TYPE_CHECKING:
    from acquisition import Session, Take
    from acquisition.rig_file import RigFile
    from ema.app.live_page import LivePage
    from ema.app.server import App
    from ema.simulate import VirtualRig

app = typer.Typer(context_settings={"help_option_names": ["-h", "--help"]})

_ENOUGH = 2
"""Takes at a point from which a coherence can be estimated."""


DEMONSTRATION = Path("virtual_table")
"""Folder of the demonstration where none is named."""
_IMPACTS = 500
"""Impacts of the virtual hammer on a point, rejected ones included."""
_PAUSE = 1.0
"""Seconds between impacts of the demonstration, in which somebody can look at them."""


@dataclass(frozen=True)
class Watching:
    """The page that shows every take."""

    show: Annotated[
        bool, typer.Option("--show", help="Show force, spectrum, FRF and coherence of every take in a browser.")
    ] = False
    port: Annotated[int, typer.Option(help="Of the page; 0 takes a free one.", min=0, max=65535)] = 8080
    browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")] = True


NO_PAGE = Watching()
"""Default: takes are listed and not shown."""


@app.command("record")
@ends_well
@grouped
def record(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder with a rig.toml; it becomes a campaign.", show_default=False)
    ] = None,
    run: Annotated[str, typer.Option("--run", help="What the run is called.")] = "run",
    takes: Annotated[int | None, typer.Option("--takes", help="Stop after so many takes.", min=1)] = None,
    level: Annotated[
        str | None,
        typer.Option("--level", help='Force of the shaker at resonance, such as "30 N": it is controlled to it.'),
    ] = None,
    normal_force: Annotated[
        str | None,
        typer.Option("--normal-force", help='Normal force of every joint, such as "1 kN": takes off it do not count.'),
    ] = None,
    page: Watching = NO_PAGE,
    demo: Annotated[
        bool, typer.Option("--demo", help="Measure the built-in work table, shown; writes its rig.toml into FOLDER.")
    ] = False,
) -> int:
    """Measure a hammer or shaker test: a take is judged and on disk before the next; the same command goes on."""
    from acquisition import Session, rig_file
    from ema.estimate import check_impact

    if folder is None and not demo:
        raise InputError(
            "no folder is named", expected="a folder with a rig.toml", advice="`ema record --demo` needs none"
        )
    folder = folder or DEMONSTRATION
    if demo:
        _write_rig(folder)
    rig = rig_file.load(folder)
    target = rig_file.force_level(rig, level, folder)
    pressing = rig_file.normal_force(rig, normal_force, folder)
    shaker = None if target is None else ShakerAtLevel(rig, target, pressing)

    def judge(record: Recording) -> tuple[Finding, ...]:
        of_source = source.findings if isinstance(source, LevelSource) else ()
        of_take = (check_impact if shaker is None else shaker.judge)(record)
        return (*of_take, *off_normal_force(record, pressing), *of_source)

    session = Session(folder, rig, run, judge, target, pressing)
    print(f"{session.done} of {session.wanted} takes are in {folder}", flush=True)
    for note in session.notes:
        print(f"Note: {note}.", flush=True)
    if session.point is None:
        print(f"Next: ema run {folder}")
        return FINE
    window = _Window.opened(session, page.port, page.browser) if page.show or demo else None
    source = opened(rig, session) if shaker is None else shaker.opened()
    reasons: Counter[str] = Counter()
    accepted = rejected = 0
    try:
        print(_asked(session), flush=True)
        for number, take in enumerate(session.takes(source), 1):
            accepted, rejected = accepted + take.accepted, rejected + (not take.accepted)
            reasons.update(take.reasons)
            print(_line(take, session), flush=True)
            if window is not None:
                window.show(take, session)
            if number == takes or session.point is None:
                break
            print(_asked(session), flush=True)
            if demo:
                time.sleep(_PAUSE)
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
        if window is not None:
            window.close()
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


def _write_rig(folder: Path) -> None:
    """The rig file of the demonstration, where there is none yet.

    Raises
    ------
    FailureError : it cannot be written.
    """
    file = folder / "rig.toml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not file.exists():
            file.write_bytes((files("ema.datasets") / "virtual_rig.toml").read_bytes())
    except OSError as error:
        raise FailureError(
            "the rig file cannot be written",
            where=str(file),
            got=error.strerror,
            advice="name a folder that can be written and has space",
        ) from error


@dataclass
class _Window:
    """The page that follows the session, served beside it."""

    page: "LivePage"
    server: "App"

    @classmethod
    def opened(cls, session: "Session", port: int, browser: bool) -> "_Window":
        """Serve the page."""
        from ema.app.live_page import LivePage
        from ema.app.server import serve

        page = LivePage(f"{session.run} in {session.folder}", _asked(session))
        server = serve(page, port=port)
        Thread(target=server.run, name="page", daemon=True).start()
        print(f"Open {server.address}", flush=True)
        if browser:
            webbrowser.open(server.address)
        return cls(page, server)

    def show(self, take: "Take", session: "Session") -> None:
        """Show a take as it was kept."""
        try:
            average = averaged(session, take)
        except EmaError:
            average = None  # the takes are kept; why they have no average stands in the line of the take
        self.page.add(take, average, _asked(session))
        self.server.changed()

    def close(self) -> None:
        """Give the windows time to fetch the last take, and the port back."""
        time.sleep(_PAUSE)
        self.server.stop()


def _asked(session: "Session") -> str:
    """What is to be done now."""
    if session.point is None:
        return f"All {session.wanted} takes are measured."
    count = f"({session.done + 1} of {session.wanted}"
    if session.rig.shaker is not None:
        return f"Shaker at point {session.point} {count}) ..."
    return f"Strike point {session.point} {count}, {session.rig.take.trigger}) ..."


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

    count = len(session.recordings(take.point)) if take.accepted else 0
    if count < _ENOUGH:
        return ""
    try:
        frfs = averaged(session, take)
    except EmaError as error:
        return f"no average: {error.what}"
    if frfs is None or frfs.coherence is None:
        return ""
    return f"average of {count}, coherence {float(np.nanmedian(frfs.coherence)):.3f}"


def averaged(session: "Session", take: "Take") -> FrfSet | None:
    """FRFs from the point of a take, of all takes there that count; ``None`` for a shaker or without such takes.

    Raises
    ------
    EmaError : the takes make no FRF.
    """
    from ema.data import Condition, Excitation
    from ema.estimate import hammer

    records = [] if session.rig.shaker else session.recordings(take.point)
    if not records:
        return None
    records = [placed(one, session.rig, take.point) for one in records]
    return hammer(Run("take", Condition(Excitation("hammer")), tuple(records)))


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
            if number >= len(points) * _IMPACTS:
                raise InputError(
                    "the virtual hammer has struck every point as often as it can",
                    where=f"point {point}",
                    got=f"{_IMPACTS} impacts",
                    advice="ask for fewer takes, or see in takes.csv why they are rejected",
                )
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
        drive = RovingHammer(dofs * _IMPACTS, hits=1, contact_time=0.4e-3, pre_trigger=0.05, spacing=1.0)
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
