"""Questions about an archive: the modes that meet conditions, over all of its campaigns."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from datetime import date
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ema.archive import cache, record
from ema.archive.record import NOT_ANALYSED
from ema.data import Finding
from ema.data._summary import Container, count, phrase
from ema.errors import InputError
from ema.fingerprint import of_files
from ema.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

_NAMED = 5
"""Campaigns that a finding names; the others are counted."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Query(Container):
    """Conditions on modes; a mode is in the answer if it meets all that are given.

    Parameters
    ----------
    frequency, damping, normal_force, force_level : tuple of (float, float), optional
        Lowest and highest natural frequency [Hz], damping ratio [-], mean normal force of the joints [N], and force
        level [N].
    since, until : date, optional
        First and last day of the campaign.
    structure, campaign, run : str, optional
        Patterns such as ``"*table*"``; upper and lower case count as equal.
    kind : str, optional
        Kind of excitation, or ``"map"`` or ``"stepped levels"``.
    finding : str, optional
        Code of a finding that the run has.
    bare : bool, default False
        Only runs without a beam, which is not the same as 0 N.

    Raises
    ------
    InputError
        If a lowest value is above the highest.

    Examples
    --------
    >>> Query(frequency=(490.0, 510.0), normal_force=(100.0, 300.0))
    Query(frequency=(490, 510), normal_force=(100, 300))
    """

    frequency: tuple[float, float] | None = None
    damping: tuple[float, float] | None = None
    normal_force: tuple[float, float] | None = None
    force_level: tuple[float, float] | None = None
    since: date | None = None
    until: date | None = None
    structure: str = ""
    campaign: str = ""
    run: str = ""
    kind: str = ""
    finding: str = ""
    bare: bool = False

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, tuple) and not value[0] <= value[1]:
                raise InputError(
                    f"the lowest {field.name.replace('_', ' ')} is not below the highest",
                    got=f"{value[0]:g} and {value[1]:g}",
                    expected="the lowest first",
                )
        if self.since is not None and self.until is not None and self.since > self.until:
            raise InputError(
                "the first day is after the last", got=f"{self.since} and {self.until}", expected="the earlier first"
            )


class Observation(NamedTuple):
    """One mode at one condition.

    Parameters
    ----------
    date : str
        Day of the campaign, or empty where it states none.
    structure, campaign, run : str
        What was tested, and the names of campaign and run (or map).
    kind : str
        Kind of excitation.
    mode : int
        Number of the mode in its run, from 1.
    frequency, frequency_low, frequency_high : float
        Natural frequency and its 95 % interval [Hz].
    damping, damping_low, damping_high : float
        Damping ratio and its 95 % interval [-].
    confidence : float
        How sure the selection is that it is a mode.
    force_level, normal_force : float
        Force level and mean normal force of the joints [N].
    state : str
        ``current``, or ``older`` where the campaign file has changed since the analysis.
    folder : str
        Where the campaign was when it was added.

    Examples
    --------
    >>> Observation._fields[5:9]
    ('mode', 'frequency', 'frequency_low', 'frequency_high')
    """

    date: str
    structure: str
    campaign: str
    run: str
    kind: str
    mode: int
    frequency: float
    frequency_low: float
    frequency_high: float
    damping: float
    damping_low: float
    damping_high: float
    confidence: float
    force_level: float
    normal_force: float
    state: str
    folder: str


@dataclass(frozen=True, kw_only=True, repr=False)
class Answer(Container):
    """The modes that meet a query, by date.

    Parameters
    ----------
    query : Query
        What was asked.
    observations : tuple of Observation
        One for each mode at each condition.
    campaigns, runs : int
        Campaigns and runs in the archive.
    findings : tuple of Finding
        Campaigns that moved, changed or vanished since they were added, runs without results, damaged parts.

    Examples
    --------
    >>> Answer(query=Query(), observations=(), campaigns=3, runs=40)
    Answer(0 modes, 3 campaigns, 40 runs)
    """

    query: Query
    observations: tuple[Observation, ...]
    campaigns: int
    runs: int
    findings: tuple[Finding, ...] = ()

    def to_dataframe(self) -> "pd.DataFrame":
        """Return the observations as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per observation, in SI.

        Examples
        --------
        >>> Answer(query=Query(), observations=(), campaigns=0, runs=0).to_dataframe().shape
        (0, 17)
        """
        import pandas as pd

        return pd.DataFrame(list(self.observations), columns=list(Observation._fields))

    def _headline(self) -> str:
        return phrase(count(len(self.observations), "mode"), count(self.campaigns, "campaign"), count(self.runs, "run"))


def find(archive: str | Path, query: Query | None = None, *, progress: Progress = silent) -> Answer:
    """Return the modes of an archive that meet the conditions of a query.

    Parameters
    ----------
    archive : str or Path
        Folder of the archive.
    query : Query, optional
        The conditions; every mode by default.
    progress : Progress, optional
        Called while parts are read that this machine has not read yet.

    Returns
    -------
    Answer
        The modes by date, with what is to be known about the campaigns.

    Raises
    ------
    InputError
        If the folder is no archive.

    Examples
    --------
    >>> import tempfile
    >>> from ema.archive.parts import make
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = make(Path(folder))
    ...     find(folder, Query(frequency=(490.0, 510.0)))
    Answer(0 modes, 0 campaigns, 0 runs)
    """
    archive, query = Path(archive), query or Query()
    with cache.opened(archive, progress) as (connection, damaged):
        clauses, values = _conditions(query)
        rows = connection.execute(f"{_SELECT} WHERE {' AND '.join(clauses)} ORDER BY {_ORDER}", values).fetchall()
        heads = cache.known_parts(connection)
        runs = connection.execute(
            "SELECT COUNT(*) FROM run JOIN part ON part.id = run.part WHERE part.current = 1 AND copy = 0 "
            "AND run.state <> 'map'"
        ).fetchone()[0]
        beside = _without_results(connection, query)
    counted, earlier = cache.current(heads)
    observations = tuple(map(_observation, rows))
    findings = (*damaged, *_whereabouts(heads, counted), *_two_states(earlier), *beside)
    return Answer(query=query, observations=observations, campaigns=len(counted), runs=runs, findings=findings)


def _observation(row: Sequence[Any]) -> Observation:
    values = [math.nan if value is None else value for value in row[:-1]]
    return Observation._make([*values, _folder_of(row[-1])])


@lru_cache
def _folder_of(file: str) -> str:
    return Path(file).parent.as_posix()


_SELECT = """
SELECT COALESCE(part.day, ''), part.structure, part.campaign, run.name, run.kind, mode.number,
    mode.frequency, mode.frequency_low, mode.frequency_high, mode.damping, mode.damping_low, mode.damping_high,
    mode.confidence, mode.level, mode.normal_force, run.state, part.file
FROM mode JOIN run ON run.id = mode.run JOIN part ON part.id = mode.part"""
_ORDER = "part.day, part.campaign, part.name, run.id, mode.rowid"


def _conditions(query: Query) -> tuple[list[str], list[Any]]:
    """Clauses of SQL with a mark for each value: what a user wrote is bound and never part of the statement."""
    clauses, values = ["part.current = 1", "run.copy = 0"], list[Any]()
    for column, limits in (
        ("mode.frequency", query.frequency),
        ("mode.damping", query.damping),
        ("mode.normal_force", query.normal_force),
        ("mode.level", query.force_level),
    ):
        if limits is not None:
            clauses.append(f"{column} BETWEEN ? AND ?")
            values += limits
    if query.bare:
        clauses.append("mode.joints = 0")
    more, bound = _of_campaign(query)
    if query.finding:
        more.append("run.id IN (SELECT finding.run FROM finding WHERE finding.code = ?)")
        bound.append(query.finding)
    return clauses + more, values + bound


def _of_campaign(query: Query) -> tuple[list[str], list[Any]]:
    """Clauses on campaign and run, whether it has modes or not."""
    clauses, values = list[str](), list[Any]()
    for comparison, day in ((">=", query.since), ("<=", query.until)):
        if day is not None:
            clauses.append(f"part.day {comparison} ?")
            values.append(day.isoformat())
    for column, pattern in (
        ("part.structure", query.structure),
        ("part.campaign", query.campaign),
        ("run.name", query.run),
        ("run.kind", query.kind),
    ):
        if pattern:
            clauses.append(f"lower({column}) GLOB lower(?)")
            values.append(pattern)
    return clauses, values


def _without_results(connection: Any, query: Query) -> list[Finding]:
    """Runs that could meet the query and have no modes; campaigns without a date where days are asked for."""
    clauses, values = _of_campaign(query)
    if query.normal_force is not None:
        clauses.append("(run.normal_force IS NULL AND run.joints > 0 OR run.normal_force BETWEEN ? AND ?)")
        values += query.normal_force
    if query.bare:
        clauses.append("run.joints = 0")
    where = " AND ".join(["part.current = 1", "run.copy = 0", "run.state = ?", *clauses])
    sql = f"SELECT part.campaign, COUNT(*) FROM run JOIN part ON part.id = run.part WHERE {where} GROUP BY part.id"
    findings = []
    rows = connection.execute(sql, [NOT_ANALYSED, *values]).fetchall()
    if rows:
        total = sum(row[1] for row in rows)
        message = f"{total} {'run' if total == 1 else 'runs'} of {_listed([row[0] for row in rows])} not analysed."
        findings.append(
            Finding("info", "not-analysed", "archive", message, advice="Run `ema run` on them, and add them again.")
        )
    if query.since is not None or query.until is not None:
        sql = "SELECT campaign FROM part WHERE current = 1 AND day IS NULL ORDER BY campaign"
        rows = connection.execute(sql).fetchall()
        if rows:
            message = f"{_listed([row[0] for row in rows])} left out: no date."
            advice = "State date = 2025-03-01 in campaign.toml, and add them again."
            findings.append(Finding("warning", "no-date", "archive", message, advice=advice))
    return findings


def _whereabouts(heads: Sequence[cache.Known], counted: Sequence[cache.Known]) -> list[Finding]:
    """Campaigns that are no longer where they were, and those written since they were added."""
    copies: dict[str, list[cache.Known]] = {}
    for head in heads:
        copies.setdefault(head.digest, []).append(head)
    gone, changed = [], []
    for part in counted:
        states = [_state_now(head) for head in copies[part.digest]]
        if not any(states):
            gone.append(part)
        elif "same" not in states:
            changed.append(part)
    findings = []
    if gone:
        message = f"{_listed([_named(part) for part in gone])} no longer there: moved or deleted."
        advice = "`ema archive add` with the new folder notes where it is; the index keeps what was measured."
        findings.append(Finding("warning", "campaign-gone", "archive", message, advice=advice))
    if changed:
        message = f"{_listed([_named(part) for part in changed])} written since it was added."
        advice = "Add it again: `ema archive add` with the archive alone does so for all."
        findings.append(Finding("warning", "campaign-changed", "archive", message, advice=advice))
    return findings


def _state_now(head: cache.Known) -> str:
    """``same``, ``changed``, or empty where there is no campaign."""
    file = Path(head.file)
    now = record.state(file, Path(head.kept), Path(head.result))
    if now[0] is None:
        return ""
    then = json.loads(head.state)
    if now == then:
        return "same"
    # a copied or restored file has another time and says the same
    only_file = now[1:] == then[1:] and then[0] is not None and now[0][0] == then[0][0]
    return "same" if only_file and of_files([file]) == head.print else "changed"


def _two_states(earlier: Sequence[cache.Known]) -> list[Finding]:
    """A finding on campaigns of which the archive holds a later state too."""
    if not earlier:
        return []
    message = (
        f"{_listed([_named(part) for part in earlier])} held in two states, as after a merge; the newer one counts."
    )
    return [Finding("info", "two-states", "archive", message, advice="Adding it again leaves one.")]


def _named(part: cache.Known) -> str:
    """A campaign with its folder."""
    return f"{part.campaign} ({Path(part.file).parent})"


def _listed(names: Sequence[str]) -> str:
    """How many campaigns, and the names of the first ``_NAMED``."""
    shown = ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
    return f"{len(names)} {'campaign' if len(names) == 1 else 'campaigns'} ({shown})"
