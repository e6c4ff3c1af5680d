"""Add campaigns to an archive; what is in it already stays as it is."""

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ema.archive import cache, parts, record
from ema.archive.record import NOT_ANALYSED, OLDER, Source
from ema.data import Finding
from ema.data._summary import Container
from ema.errors import EmaError
from ema.progress import Progress, advance, silent
from ema.store.atomic import remove_abandoned

Outcome = tuple[dict[str, Any], dict[str, Any]]
"""What is indexed of a campaign (``record.record_of``), and where it was and when written (``record.seen``)."""
_AT_ONCE = 64
"""Campaigns that are under way at once: enough for the workers of a small cluster, and no list of all in memory."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Added(Container):
    """What adding campaigns to an archive did.

    Parameters
    ----------
    new, changed, moved, unchanged : int
        Campaigns that were not in the archive, that had changed, that lie elsewhere now, and that were there already.
    merged : int
        Parts that came from other archives.
    runs : int
        Runs of the campaigns.
    findings : tuple of Finding
        Campaigns that could not be indexed, runs without results.

    Examples
    --------
    >>> Added(new=2, runs=100)
    Added(new=2, runs=100)
    """

    new: int = 0
    changed: int = 0
    moved: int = 0
    unchanged: int = 0
    merged: int = 0
    runs: int = 0
    findings: tuple[Finding, ...] = ()


def add(
    archive: str | Path,
    sources: Sequence[Source],
    *,
    archives: Sequence[str | Path] = (),
    executor: Executor | None = None,
    progress: Progress = silent,
) -> Added:
    """Add campaigns to the index of an archive, which is made where it is not there yet.

    A campaign that is in the archive with the same content changes nothing. Of one that has changed a new part is
    written, which supersedes the former one. Indexing stops at no campaign: what cannot be read is a finding.

    Parameters
    ----------
    archive : str or Path
        Folder of the archive.
    sources : sequence of Source
        Campaigns with the results of their studies.
    archives : sequence of str or Path, optional
        Other archives, the parts of which are added.
    executor : Executor, optional
        Where the campaigns are read; in this process by default.
    progress : Progress, optional
        Called with the number of campaigns that are done.

    Returns
    -------
    Added
        What was new, and what was found.

    Raises
    ------
    InputError
        If one of ``archives`` is none.
    FailureError
        If the archive cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     campaign = Path(folder, "A")
    ...     campaign.mkdir()
    ...     _ = (campaign / "campaign.toml").write_text(
    ...         '[campaign]\\nname = "A"\\n[[runs]]\\nid = "bare"\\nfiles = "bare.uff"\\n')
    ...     source = Source(study=campaign, campaign=campaign, kept=campaign / "_build", result=campaign / "a.h5")
    ...     add(Path(folder, "archive"), [source]).new
    1
    """
    archive = Path(archive)
    merged = sum(_merged(archive, Path(other)) for other in archives)
    remove_abandoned(parts.make(archive), ".", ".tmp")  # of programs that were killed
    with cache.opened(archive, progress) as (connection, damaged):
        known = _Known(cache.known_parts(connection))
    count = dict.fromkeys(("new", "changed", "moved", "unchanged"), 0)
    findings, runs = list(damaged), 0
    for number, (source, outcome) in enumerate(_records(sources, executor)):
        advance(progress, "campaigns", number, len(sources))
        if isinstance(outcome, EmaError):
            findings.append(_not_indexed(source, outcome))
            continue
        content, seen = outcome
        runs += len(content["runs"])
        findings += _about(content)
        count[known.write(archive, content, seen)] += 1
    advance(progress, "campaigns", len(sources), len(sources))
    with cache.opened(archive, progress):
        pass  # filled here, so that the first question does not wait for it
    return Added(**count, merged=merged, runs=runs, findings=tuple(findings))


def sources_of(archive: str | Path) -> tuple[Source, ...]:
    """The campaigns of an archive, where they were last; what all of it is made anew from."""
    with cache.opened(Path(archive)) as (connection, _):
        heads, _ = cache.current(cache.known_parts(connection))
    return tuple(
        Source(study=Path(one.study), campaign=Path(one.file), kept=Path(one.kept), result=Path(one.result))
        for one in heads
    )


def _merged(archive: Path, other: Path) -> int:
    """Add the parts of another archive; how many of them were missing."""
    wanted = parts.names(other)
    present = parts.names(archive) if (archive / parts.FOLDER).is_dir() else set[str]()
    for name in sorted(wanted - present):
        parts.copy(other, archive, name)
    return len(wanted - present)


def recorded(source: Source) -> Outcome | EmaError:
    """What is indexed of a campaign and where it was, or why not.

    Files are looked at before they are read: what is written meanwhile is then named as a change.
    """
    try:
        seen = record.seen(source)
        return record.record_of(source), seen
    except EmaError as error:
        return error
    except OSError as error:
        return EmaError(f"cannot be read ({error.strerror or error})", where=str(source.campaign))


def _records(sources: Sequence[Source], executor: Executor | None) -> Iterator[tuple[Source, Outcome | EmaError]]:
    """Every source with its record, in the order of ``sources``; ``_AT_ONCE`` are under way at a time."""
    if executor is None:
        yield from ((source, recorded(source)) for source in sources)
        return
    waiting: list[tuple[Source, Future[Outcome | EmaError]]] = []
    task: Callable[[Source], Outcome | EmaError] = recorded
    try:
        for source in sources:
            waiting.append((source, executor.submit(task, source)))
            if len(waiting) >= _AT_ONCE:
                first, future = waiting.pop(0)
                yield first, future.result()
        for first, future in waiting:
            yield first, future.result()
    finally:
        for _, future in waiting:
            future.cancel()


class _Known:
    """The parts that nothing supersedes, by their content, by the path of their study, and by their campaign file."""

    def __init__(self, heads: Sequence[cache.Known]) -> None:
        self.by_digest: dict[str, list[cache.Known]] = {}
        self.by_study: dict[str, list[cache.Known]] = {}
        self.by_print: dict[str, list[cache.Known]] = {}
        for head in heads:
            self._note(head)

    def _note(self, head: cache.Known) -> None:
        self.by_digest.setdefault(head.digest, []).append(head)
        self.by_study.setdefault(head.study, []).append(head)
        self.by_print.setdefault(head.print, []).append(head)

    def write(self, archive: Path, content: dict[str, Any], seen: dict[str, Any]) -> str:
        """Write what is not there yet; whether the campaign is new, changed, moved or unchanged."""
        digest = parts.digest_of(content)
        here = [head for head in self.by_study.get(seen["study"], []) if head.campaign == content["name"]]
        same = any(head.digest == digest for head in here)
        if len(here) == 1 and same and json.loads(here[0].state) == seen["state"]:
            return "unchanged"
        former = here
        if not here:
            twins = self.by_digest.get(digest, [])
            if any(Path(head.file).is_file() for head in twins):
                return "unchanged"  # a copy of a campaign that is where it was
            former = [head for head in self._same_file(content, twins) if not Path(head.file).exists()]
        part = parts.write(archive, content, seen, tuple(head.name for head in former))
        self._replace({head.name for head in former}, part)
        if here:
            return "unchanged" if same else "changed"
        return "moved" if former else "new"

    def _same_file(self, content: dict[str, Any], twins: Sequence[cache.Known]) -> list[cache.Known]:
        """Parts of equal content, and those of campaigns with the same campaign file."""
        return [*twins, *(head for head in self.by_print.get(content["file"], []) if head not in twins)]

    def _replace(self, former: set[str], part: parts.Part) -> None:
        for table in (self.by_digest, self.by_study, self.by_print) if former else ():
            for key, heads in table.items():
                table[key] = [head for head in heads if head.name not in former]
        seen = part.seen
        head = cache.Known(
            id=0,  # not a row of the cache yet
            name=part.name,
            digest=part.digest,
            campaign=part.record["name"],
            study=seen["study"],
            file=seen["campaign"],
            kept=seen["kept"],
            result=seen["result"],
            state=json.dumps(seen["state"]),
            print=part.record["file"],
            supersedes=json.dumps(part.supersedes),
        )
        self._note(head)


def _not_indexed(source: Source, error: EmaError) -> Finding:
    message = f"{error.what}{'' if error.got is None else f' (got {error.got})'}: it was not indexed."
    return Finding("error", "not-indexed", error.where or str(source.campaign), message, advice=error.advice)


def _about(content: dict[str, Any]) -> list[Finding]:
    """Runs of a campaign that have no results, or those of an earlier campaign file."""
    states = {
        NOT_ANALYSED: ("not-analysed", "not analysed: indexed without modes"),
        OLDER: ("analysed-before", "analysed before campaign.toml was changed: indexed with the modes of then"),
    }
    findings = []
    for state, (code, words) in states.items():
        runs = [run["id"] for run in content["runs"] if run["state"] == state]
        if runs:
            shown = ", ".join(runs[:5]) + (f" and {len(runs) - 5} more" if len(runs) > 5 else "")
            message = f"{len(runs)} of {len(content['runs'])} runs {words} ({shown})."
            findings.append(
                Finding("info", code, f"campaign {content['name']}", message, advice="Run `ema run`, and add it again.")
            )
    return findings
