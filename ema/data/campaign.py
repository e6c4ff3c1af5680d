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
    """A sequence whose items are made when they are used, and not kept: records larger than memory stay on disk.

    Its ``repr`` is that of any object; a slice is again lazy.

    Parameters
    ----------
    makers : sequence of callable
        One function per item, called each time the item is used.

    Examples
    --------
    >>> squares = Lazy([lambda k=k: k**2 for k in range(4)])
    >>> len(squares), squares[3], list(squares[:2])
    (4, 9, [0, 1])
    """

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
    """A correction of metadata that leaves the raw data untouched.

    Parameters
    ----------
    what : str
        The correction.
    where : str
        What it concerns, such as a run or a channel.
    who : str
        Who decided it.
    why : str
        Reason for it.

    Examples
    --------
    >>> Repair("exclude impact 3", where="run bare, point 12", who="operator", why="double hit").why
    'double hit'
    """

    what: str
    where: str
    who: str
    why: str


@dataclass(frozen=True, repr=False)
class Run(Container):
    """Measurements under one condition.

    A run holds raw records, FRFs that the measuring system has already computed, or the levels of a stepped sine,
    lowest first.

    Parameters
    ----------
    id : str
        Name of the run, unique in its campaign.
    condition : Condition
        Excitation and normal forces.
    recordings : sequence of Recording, optional
        Raw records; read when used where they come from files.
    frfs : sequence of FrfSet, optional
        FRF sets of the measuring system.
    repairs : tuple of Repair, optional
        Corrections that were applied.
    findings : tuple of Finding, optional
        What a reader of the run has to know.
    comment : str, optional
        Note of the operator.
    repeat : str, optional
        Label shared by runs that repeat the same condition (re-torqued, re-mounted, loaded anew).
    assembly : str, optional
        Shared by those of them between which nothing was loosened; empty for an assembly of its own.
    levels : tuple of SteppedLevel, optional
        Levels of a stepped sine, lowest first.
    at_rest : sequence of Recording, optional
        Records of the same channels without any excitation, which show the noise of the channels.

    Examples
    --------
    >>> from ema.examples import campaign
    >>> campaign()["beam"]
    Run('beam', hammer, F_N joint 500 N, 1 record)
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
    at_rest: Sequence[Recording] = ()

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
    """A folder of measurements, opened; ``campaign["bare"]`` is the run of that name.

    Parameters
    ----------
    name : str
        What the campaign is called.
    runs : tuple of Run
        Runs in the order of the campaign file.
    geometry : Geometry, optional
        Points of the structure, where known.
    structure : str, optional
        What was tested.
    operator : str, optional
        Who tested.
    date : str, optional
        When it was tested, as written.
    comment : str, optional
        Note of the operator.
    photos : tuple of str, optional
        Image files.
    channels : tuple of Channel, optional
        Channel table.
    inputs : tuple of tuple of (str, str), optional
        ``(file, sha256)`` of the campaign's metadata files.
    findings : tuple of Finding, optional
        What a reader of the campaign has to know.
    folder : str, optional
        Folder that it was read from.
    logo : str, optional
        Image file of whoever tests, for the report.

    Examples
    --------
    >>> from ema.examples import campaign
    >>> campaign()
    Campaign('line', 2 runs: bare, beam, 4 nodes, 2 channels)
    """

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
        """Return the runs whose attributes have the wanted values.

        Parameters
        ----------
        **wanted : object
            Values of attributes of ``Run``, such as ``kind="hammer"`` or ``repeat="1 kN"``.

        Returns
        -------
        tuple of Run
            Runs that have all of them.

        Raises
        ------
        AttributeError
            If runs have no attribute of that name.

        Examples
        --------
        >>> from ema.examples import campaign
        >>> [run.id for run in campaign().where(kind="hammer", repeat="")]
        ['bare', 'beam']
        """
        return tuple(run for run in self.runs if all(getattr(run, name) == value for name, value in wanted.items()))

    def index(self) -> "pd.DataFrame":
        """Return the runs as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per run: kind, level [N], F_N per joint [N], number of records and of FRF sets.

        Examples
        --------
        >>> from ema.examples import campaign
        >>> campaign().index()["F_N joint [N]"].tolist()
        [nan, 500.0]
        """
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
