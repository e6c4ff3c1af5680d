"""A measurement campaign: what was measured, under which conditions, and what was repaired."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar, overload

from ema.data._summary import Container, brief, count, phrase
from ema.data.amplitude import SteppedLevel
from ema.data.condition import Condition
from ema.data.findings import Finding
from ema.data.frf import FrfSet
from ema.data.geometry import Geometry
from ema.data.recording import Channel, Recording
from ema.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")


class Lazy(Sequence[T]):
    """A sequence whose items are made when asked for, and not kept: records larger than memory stay on disk."""

    def __init__(self, makers: Sequence[Callable[[], T]]) -> None:
        self._makers = tuple(makers)

    def __len__(self) -> int:
        return len(self._makers)

    @overload
    def __getitem__(self, place: int) -> T: ...
    @overload
    def __getitem__(self, place: slice) -> "Lazy[T]": ...
    def __getitem__(self, place: int | slice) -> "T | Lazy[T]":
        if isinstance(place, slice):
            return Lazy(self._makers[place])
        return self._makers[place]()

    def __iter__(self) -> Iterator[T]:
        for maker in self._makers:
            yield maker()


@dataclass(frozen=True, repr=False)
class Repair(Container):
    """A correction of metadata that leaves the raw data untouched: what, by whom and why."""

    what: str
    where: str
    who: str
    why: str


@dataclass(frozen=True, repr=False)
class Run(Container):
    """Measurements under one condition: raw records, FRFs that the measuring system has already computed, or the levels
    of a stepped sine, lowest first.

    ``repeat`` is the label shared by runs that repeat the same condition (re-torqued, re-mounted, loaded anew).
    ``assembly`` is shared by those of them between which nothing was loosened; empty for an assembly of its own.
    """

    id: str
    condition: Condition
    recordings: Sequence[Recording] = ()
    frfs: Sequence[FrfSet] = ()
    repairs: tuple[Repair, ...] = ()
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    comment: str = ""
    repeat: str = ""
    assembly: str = ""
    levels: tuple[SteppedLevel, ...] = ()

    @property
    def kind(self) -> str:
        """Kind of excitation."""
        return self.condition.excitation.kind

    def _headline(self) -> str:
        return phrase(
            brief(self.id),
            self.kind,
            ", ".join(f"F_N {joint.joint} {joint.mean:.4g} N" for joint in self.condition.joints[:4]),
            count(len(self.recordings), "record") if len(self.recordings) else "",
            count(len(self.frfs), "FRF set") if len(self.frfs) else "",
            count(len(self.findings), "finding") if self.findings else "",
        )


@dataclass(frozen=True, repr=False)
class Campaign(Container):
    """A folder of measurements, opened."""

    name: str
    runs: tuple[Run, ...]
    geometry: Geometry | None = None
    structure: str = ""
    operator: str = ""
    date: str = ""
    comment: str = ""
    photos: tuple[str, ...] = ()
    channels: tuple[Channel, ...] = ()
    inputs: tuple[tuple[str, str], ...] = ()
    """``(file, sha256)`` of the campaign's metadata files."""
    findings: tuple[Finding, ...] = field(default=(), compare=False)
    folder: str = ""
    logo: str = ""
    """Image file of whoever tests, for the report."""

    def __getitem__(self, run: str) -> Run:
        for candidate in self.runs:
            if candidate.id == run:
                return candidate
        raise InputError(
            "no such run",
            where=f"campaign {self.name}",
            got=run,
            expected="one of " + ", ".join(r.id for r in self.runs),
        )

    def where(self, **wanted: Any) -> tuple[Run, ...]:
        """The runs whose attributes (``kind``, ``repeat``, ...) have the wanted values."""
        return tuple(run for run in self.runs if all(getattr(run, name) == value for name, value in wanted.items()))

    def index(self) -> "pd.DataFrame":
        """One row per run: kind, level [N], F_N per joint [N], number of records."""
        import pandas as pd

        rows = []
        for run in self.runs:
            row: dict[str, Any] = {"run": run.id, "kind": run.kind, "level [N]": run.condition.excitation.level}
            row |= {f"F_N {joint.joint} [N]": joint.mean for joint in run.condition.joints}
            rows.append(row | {"records": len(run.recordings), "FRF sets": len(run.frfs)})
        return pd.DataFrame(rows).set_index("run")

    def _headline(self) -> str:
        return phrase(
            brief(self.name),
            count(len(self.runs), "run")
            + ": "
            + ", ".join(run.id for run in self.runs[:4])
            + (", ..." if len(self.runs) > 4 else ""),
            count(len(self.geometry.nodes), "node") if self.geometry is not None else "no geometry",
            count(len(self.channels), "channel"),
            count(len(self.findings), "finding") if self.findings else "",
        )
