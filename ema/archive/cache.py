"""The parts of an archive as tables of SQLite, in the cache folder of the user; made anew whenever it does not fit.

Nothing is in it that is not in the parts. It lies on the machine of the reader, where locks work, and not beside the
parts, which may lie on a disk of the network: there locks may not hold (sqlite.org/useovernet.html).
"""

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import date, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

from filelock import FileLock

from ema.archive import parts
from ema.data import Finding
from ema.datasets import cache_folder
from ema.errors import EmaError
from ema.progress import Progress, advance, silent

VERSION = 1
"""Raised when the tables change; a cache of another version is another file."""
_WAIT = 120.0
"""Seconds to wait for another process that fills the cache; the 100 000 runs of the bench take a tenth of that."""
_BATCH = 200
"""Parts in one transaction: a process that is killed loses the work on them in the cache, and no part."""
_TABLES = """
CREATE TABLE part (id INTEGER PRIMARY KEY, name TEXT UNIQUE, digest TEXT, current INTEGER, campaign TEXT,
    structure TEXT, day TEXT, date TEXT, study TEXT, file TEXT, kept TEXT, result TEXT,
    state TEXT, print TEXT, supersedes TEXT);
CREATE TABLE run (id INTEGER PRIMARY KEY, part INTEGER, name TEXT, kind TEXT, level REAL, normal_force REAL,
    joints INTEGER, state TEXT, key TEXT, copy INTEGER DEFAULT 0);
CREATE TABLE mode (part INTEGER, run INTEGER, source TEXT, number INTEGER, frequency REAL, frequency_low REAL,
    frequency_high REAL, damping REAL, damping_low REAL, damping_high REAL, confidence REAL, level REAL,
    normal_force REAL, joints INTEGER);
CREATE TABLE finding (part INTEGER, run INTEGER, severity TEXT, code TEXT, place TEXT, message TEXT);
CREATE INDEX run_part ON run (part);
CREATE INDEX run_key ON run (key);
CREATE INDEX finding_code ON finding (code);
"""


class Known(NamedTuple):
    """A part in the cache, without its rows."""

    id: int
    name: str
    digest: str
    campaign: str
    study: str
    file: str
    kept: str
    result: str
    state: str
    print: str
    supersedes: str

    @property
    def written(self) -> int:
        """When the newest of its files was written, in ns."""
        return max((entry[1] for entry in json.loads(self.state) if entry), default=0)


@contextmanager
def opened(archive: Path, progress: Progress = silent) -> Iterator[tuple[sqlite3.Connection, tuple[Finding, ...]]]:
    """The tables of an archive, with everything in it at this moment, and what is wrong with its parts.

    What is read within the block is one state of the archive, whatever other processes do meanwhile.

    Raises
    ------
    InputError : the folder is no archive.
    """
    connection, findings = _filled(archive, progress)
    try:
        yield connection, findings
    finally:
        connection.close()


def path_of(archive: Path) -> Path:
    """Where the tables of an archive are kept."""
    print_ = sha256(str(archive.resolve()).encode("utf-8", "surrogatepass")).hexdigest()[:16]
    return cache_folder().parent / "archives" / f"{print_}-{VERSION}.sqlite"


def _filled(archive: Path, progress: Progress) -> tuple[sqlite3.Connection, tuple[Finding, ...]]:
    parts.names(archive)  # nothing is made for a folder that is no archive
    path = path_of(archive)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(f"{path}.lock", timeout=_WAIT)
        lock.acquire()
    except (OSError, NotImplementedError):
        # no cache folder, no locks on its disk, or a process that holds one for ever: in memory, for this time
        return _in_memory(archive, progress)
    try:
        connection = _connected(path)
        try:
            return connection, _fill(connection, archive, progress)
        except sqlite3.DatabaseError:
            connection.close()
            _remove(path)
            connection = _connected(path)
            return connection, _fill(connection, archive, progress)
    except sqlite3.Error:
        return _in_memory(archive, progress)
    finally:
        lock.release()


def _in_memory(archive: Path, progress: Progress) -> tuple[sqlite3.Connection, tuple[Finding, ...]]:
    connection = _connected(None)
    return connection, _fill(connection, archive, progress)


def _connected(path: Path | None) -> sqlite3.Connection:
    connection = sqlite3.connect(":memory:" if path is None else path, timeout=_WAIT)
    connection.isolation_level = None
    return connection


def _remove(path: Path) -> None:
    for suffix in ("", "-journal"):
        with suppress(FileNotFoundError):
            Path(f"{path}{suffix}").unlink()


def _fill(connection: sqlite3.Connection, archive: Path, progress: Progress) -> tuple[Finding, ...]:
    """Bring the tables to what the parts hold, and begin to read them.

    The parts are listed here, under the lock: with a list from before it, parts that another process has added since
    would seem to have been taken away.
    """
    names = parts.names(archive)
    if not connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'finding_code'").fetchone():
        with _transaction(connection):
            for statement in _TABLES.split(";"):
                connection.execute(statement)
    filled = {name for (name,) in connection.execute("SELECT name FROM part")}
    if filled - names:  # parts that were taken away may have superseded others
        with _transaction(connection):
            for table in ("part", "run", "mode", "finding"):
                connection.execute(f"DELETE FROM {table}")
        filled = set()
    missing, findings = sorted(names - filled), list[Finding]()
    for start in range(0, len(missing), _BATCH):
        advance(progress, "reading the archive", start, len(missing))
        with _transaction(connection):
            for name in missing[start : start + _BATCH]:
                try:
                    _insert(connection, parts.read(archive, name))
                except (EmaError, KeyError, TypeError, ValueError, IndexError) as error:
                    findings.append(_damaged(name, error))
    if len(missing) > len(findings):
        with _transaction(connection):
            _mark(connection)
    # from its first reading on, a transaction sees one state, and writers wait for its end (sqlite.org/isolation.html)
    connection.execute("BEGIN")
    connection.execute("SELECT COUNT(*) FROM part")
    return tuple(findings)


@contextmanager
def _transaction(connection: sqlite3.Connection) -> Iterator[None]:
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
    except BaseException:
        connection.execute("ROLLBACK")
        raise
    connection.execute("COMMIT")


def _damaged(name: str, error: Exception) -> Finding:
    fault = error.what if isinstance(error, EmaError) else "it does not hold what a part holds"
    return Finding(
        "error",
        "part-unreadable",
        f"archive, part {name[:12]}",
        f"{fault}: its campaign is missing in the answer.",
        advice=getattr(error, "advice", "") or "Delete the file, and add the campaign again.",
    )


def _insert(connection: sqlite3.Connection, part: parts.Part) -> None:
    record, seen = part.record, part.seen
    rows = _Rows.of(record)
    values = (
        part.name,
        part.digest,
        0,
        record["name"],
        record["structure"],
        day_of(record["date"]),
        record["date"],
        seen["study"],
        seen["campaign"],
        seen["kept"],
        seen["result"],
        json.dumps(seen["state"]),
        record["file"],
        json.dumps(part.supersedes),
    )
    part_id = connection.execute(f"INSERT INTO part VALUES (NULL, {_marks(14)})", values).lastrowid
    first_run = connection.execute("SELECT COALESCE(MAX(id), 0) + 1 FROM run").fetchone()[0]
    connection.executemany(
        f"INSERT INTO run VALUES ({_marks(9)}, 0)",
        [(first_run + index, part_id, *row) for index, row in enumerate(rows.runs)],
    )
    connection.executemany(
        f"INSERT INTO mode VALUES ({_marks(14)})", [(part_id, first_run + row[0], *row[1:]) for row in rows.modes]
    )
    connection.executemany(
        f"INSERT INTO finding VALUES ({_marks(6)})",
        [(part_id, None if row[0] is None else first_run + row[0], *row[1:]) for row in rows.findings],
    )


def _marks(count: int) -> str:
    return ", ".join("?" * count)


class _Rows(NamedTuple):
    """The rows of one campaign; modes and findings name their run by its index among the runs, from 0."""

    runs: list[tuple[Any, ...]]
    modes: list[tuple[Any, ...]]
    findings: list[tuple[Any, ...]]

    @classmethod
    def of(cls, record: dict[str, Any]) -> "_Rows":
        """The rows of what is indexed of a campaign (``ema.archive.record.record_of``)."""
        rows = cls([], [], [(None, *finding) for finding in record["findings"]])
        for run in record["runs"]:
            rows._add_run(run)
        for chart in record["maps"]:
            rows._add_map(chart)
        for mode in record["levels"]:
            rows._add_levels(mode)
        return rows

    def _add_run(self, run: dict[str, Any]) -> None:
        index, force, joints = len(self.runs), mean_force(run["joints"]), len(run["joints"])
        key = parts.digest_of([run["id"], run["data"], run["modes"]]) if run["data"] else None
        self.runs.append((run["id"], run["kind"], run["level"], force, joints, run["state"], key))
        for number, mode in enumerate(run["modes"], 1):
            self.modes.append((index, "run", number, *mode, run["level"], force, joints))
        self.findings.extend((index, *finding) for finding in run["findings"])

    def _add_map(self, chart: dict[str, Any]) -> None:
        index = len(self.runs)
        self.runs.append((chart["name"], "map", None, None, 1, "map", None))
        for level, force, *values in chart["points"]:
            self.modes.append((index, "map", 1, *values, None, level, force, 1))
        self.findings.extend((index, *finding) for finding in chart["findings"])

    def _add_levels(self, mode: dict[str, Any]) -> None:
        index, force, joints = len(self.runs), mean_force(mode["joints"]), len(mode["joints"])
        self.runs.append((mode["name"], "stepped levels", None, force, joints, "map", None))
        for _, level, *values in mode["points"]:
            self.modes.append((index, "levels", 1, *values, None, level, force, joints))


def mean_force(joints: Sequence[dict[str, Any]]) -> float | None:
    """Mean normal force over the joints in N; ``None`` without joints or with an unknown one."""
    known = [joint["mean"] for joint in joints]
    return None if not known or None in known else float(sum(known) / len(known))


def day_of(text: str) -> str | None:
    """The day of a date as the campaign states it; ``None`` where it is none."""
    for read in (date.fromisoformat, datetime.fromisoformat):
        with suppress(ValueError):
            day = read(text.strip())
            return (day.date() if isinstance(day, datetime) else day).isoformat()
    return None


def known_parts(connection: sqlite3.Connection) -> list[Known]:
    """All parts but those that another one supersedes, by their names."""
    columns = "id, name, digest, campaign, study, file, kept, result, state, print, supersedes"
    rows = [Known(*row) for row in connection.execute(f"SELECT {columns} FROM part ORDER BY name")]
    gone = {name for row in rows for name in json.loads(row.supersedes)}
    return [row for row in rows if row.name not in gone]


def current(heads: Sequence[Known]) -> tuple[list[Known], list[Known]]:
    """Of parts that nothing supersedes, those that count, and those of which another one is a later state.

    Parts of equal content count once. Two parts of one study in one folder, as two merged archives may hold, are two
    states of it: the one whose files are newer counts.
    """
    by_content: dict[str, Known] = {}
    for head in heads:
        by_content.setdefault(head.digest, head)
    by_study: dict[tuple[str, str], Known] = {}
    earlier = []
    for head in by_content.values():
        study = (head.study, head.campaign)
        other = by_study.setdefault(study, head)
        if other is not head:
            older, newer = sorted((other, head), key=lambda part: (part.written, part.name))
            by_study[study] = newer
            earlier.append(older)
    return list(by_study.values()), earlier


def _mark(connection: sqlite3.Connection) -> None:
    """Mark the parts that count, and runs that are in several of them with the same data and the same modes."""
    counted, _ = current(known_parts(connection))
    connection.execute("UPDATE part SET current = 0")
    connection.executemany("UPDATE part SET current = 1 WHERE id = ?", [(part.id,) for part in counted])
    connection.execute("UPDATE run SET copy = 0 WHERE copy = 1")
    connection.execute(
        "UPDATE run SET copy = 1 WHERE id IN (SELECT id FROM (SELECT run.id AS id, ROW_NUMBER() OVER "
        "(PARTITION BY run.key ORDER BY part.name, run.id) AS number FROM run JOIN part ON part.id = run.part "
        "WHERE part.current = 1 AND run.key IS NOT NULL) WHERE number > 1)"
    )
