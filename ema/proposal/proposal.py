"""From what the files of a folder hold to the text of a ``campaign.toml``."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from acquisition import campaign_file
from ema.data import Finding, Geometry
from ema.dof import Dof
from ema.errors import InputError
from ema.file_names import natural
from ema.progress import Progress, silent
from ema.proposal import channel_tables, geometry_table, level_tables
from ema.proposal.examination import FileFacts, FrfFacts, examine
from ema.proposal.file_names import Series, series_of
from ema.proposal.questions import Answers, Question
from ema.proposal.roles import same_point
from ema.proposal.toml_text import table_text

TODO = "TODO"
"""Stands where an indispensable answer is missing; ``ema check`` refuses it."""


@dataclass(frozen=True)
class Proposal:
    """A ``campaign.toml`` proposed for a folder.

    Parameters
    ----------
    folder : Path
        Folder of the measurements.
    facts : tuple of FileFacts, optional
        What every file holds.
    answers : mapping of str to str
        Answers to questions, by key.
    text : str
        The campaign file; what nobody answered is marked ``# TODO``.
    questions : tuple of Question
        What is still to be asked, the indispensable first; never more than three together with the answers.
    findings : tuple of Finding
        What looks wrong: swapped force and response, doubled names, millimetres taken for metres, mirrored points.
    left_out : tuple of tuple of (str, str)
        Files that belong to no run, with the reason.
    geometry : Geometry, optional
        Points [m], as the file will be read.
    summary : str, optional
        The runs, one line each.
    responses, references : tuple of Dof, optional
        Measured directions of responses and forces that are known, for the picture of the geometry.

    Examples
    --------
    >>> Proposal(Path("."), (), {}, "[campaign]", questions=(), findings=(), left_out=()).text
    '[campaign]'
    """

    folder: Path
    facts: tuple[FileFacts, ...] = field(repr=False)
    answers: Mapping[str, str]
    text: str
    questions: tuple[Question, ...]
    findings: tuple[Finding, ...]
    left_out: tuple[tuple[str, str], ...]
    geometry: Geometry | None = field(default=None, repr=False)
    summary: str = ""
    responses: tuple[Dof, ...] = field(default=(), repr=False)
    references: tuple[Dof, ...] = field(default=(), repr=False)

    def answered(self, key: str, text: str) -> "Proposal":
        """Return the proposal with one more answer.

        Parameters
        ----------
        key : str
            Key of the question.
        text : str
            The answer; an empty one takes the default.

        Returns
        -------
        Proposal
            The proposal for the same files.

        Raises
        ------
        InputError
            If there is no such question, the answer is none of the choices, or it cannot be understood.

        Examples
        --------
        >>> nothing = Proposal(Path("."), (), {}, "[campaign]", questions=(), findings=(), left_out=())
        >>> try:
        ...     nothing.answered("unit", "mm")
        ... except InputError as error:
        ...     print(error)
        no such question; got unit, expected no question is open
        """
        question = next((one for one in self.questions if one.key == key), None)
        if question is None:
            keys = ", ".join(one.key for one in self.questions) or "no question is open"
            raise InputError("no such question", got=key, expected=keys)
        answer = text.strip() or question.default
        if not answer:
            raise InputError("an answer is needed here", where=key, expected=question.text)
        if question.choices and answer not in question.choices:
            raise InputError("not one of the answers", where=key, got=answer, expected=" or ".join(question.choices))
        return compose(self.folder, self.facts, {**self.answers, key: answer})


def propose(folder: str | Path, progress: Progress = silent) -> Proposal:
    """Read every file of a folder and propose its ``campaign.toml``.

    Nothing is written. Units are never guessed: where neither a file nor an answer states one, the campaign says
    ``unstated``.

    Parameters
    ----------
    folder : str or Path
        Folder of the measurements.
    progress : Progress, optional
        Called with how many files are read.

    Returns
    -------
    Proposal
        Campaign file, questions and findings.

    Raises
    ------
    InputError
        If there is no such folder, or it holds no measurement.

    Examples
    --------
    >>> import tempfile
    >>> from acquisition import write
    >>> from ema.examples import frf_set
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write(f"{folder}/bare.uff", frf_set())
    ...     "bare" in propose(folder).text
    True
    """
    path = Path(folder)
    return compose(path, examine(path, progress), {})


def compose(folder: Path, facts: tuple[FileFacts, ...], given: Mapping[str, str]) -> Proposal:
    """Compose the campaign file from what the files hold and what was answered; raises as :func:`propose`."""
    answers = Answers(given)
    findings: list[Finding] = []
    left = [(one.path, one.reason) for one in facts if one.reason]
    groups = _groups([one for one in facts if one.kind in ("records", "FRFs", "levels", "level")])
    if not groups:
        seen = "; ".join(f"{path}: {reason}" for path, reason in left[:4])
        raise InputError(
            "no measurement in this folder: neither records nor FRFs",
            where=str(folder),
            got=f"{len(facts)} files{', ' + seen if seen else ''}",
            advice="`ema compare` takes modal models, `ema formats` lists what can be read",
        )
    chosen = geometry_table.candidate(facts)
    points = geometry_table.points_of(chosen, folder)
    runs: list[_Run] = []
    taken: set[str] = set()
    for group in groups:
        others = [one.path for one in facts if one not in group.facts]
        for run in _runs(group, answers, findings, points):
            _list_files(run, group, others)
            run.table["id"] = _unique(run.table["id"], taken)
            runs.append(run)
    table, geometry_comments, solid = geometry_table.table_of(chosen, folder, answers, findings)
    if chosen is None and geometry_table.count(facts) > 1:
        left.append(("[geometry]", f"{geometry_table.count(facts)} files hold positions; name the right one"))
    text = _text(folder, runs, (table, geometry_comments), answers, left)
    if TODO not in text.replace("# TODO", ""):
        campaign_file.parse(text, campaign_file.FILE_NAME)
    unique = tuple(dict.fromkeys(findings))
    responses, references = (
        tuple(sorted({dof for run in runs for dof in _directions(run, role)})) for role in ("response", "reference")
    )
    return Proposal(
        folder=folder,
        facts=facts,
        answers=dict(given),
        text=text,
        questions=answers.open,
        findings=unique,
        left_out=tuple(left),
        geometry=solid,
        summary="\n".join(_summary(run.table, run.channels) for run in runs),
        responses=responses,
        references=references,
    )


def _directions(run: "_Run", role: str) -> set[Dof]:
    """The DOFs of one role in a run, with the points that its file names state."""
    if not run.channels:
        sides = [one.outputs if role == "response" else one.inputs for one in run.frfs]
        return {dof for side in sides for dof in side}
    texts: set[str] = set()
    for channel in run.channels:
        text = channel.get("dof", "")
        if channel["role"] == role and text and "{column}" not in text:
            texts |= {text.replace("{point}", str(point)) for point in run.points or (0,)}
    stated = {channel["name"] for channel in run.channels if channel["role"] == role}
    texts |= {text for dofs in run.dofs for name, text in dofs.items() if name in stated}
    return {Dof.parse(text) for text in texts}


def _summary(run: Mapping[str, Any], channels: list[dict[str, Any]]) -> str:
    """A run in one line: what drove it, its files, its channels by role."""
    files = f"{len(run['files'])} files" if isinstance(run["files"], list) else run["files"]
    roles = [channel["role"] for channel in channels for _ in range(channel_tables.count_of(channel))]
    said = ", ".join(f"{roles.count(role)} {role}" for role in dict.fromkeys(roles)) or "channels as the files say"
    return f"run {run['id']}: {run.get('kind', 'excitation not known')}, {files}; {said}"


@dataclass(frozen=True)
class _Run:
    """One run: its table, its channel tables, comments by key, and what the picture of the geometry shows."""

    table: dict[str, Any]
    channels: list[dict[str, Any]]
    comments: dict[str, str]
    points: tuple[int, ...] = ()
    dofs: tuple[dict[str, str], ...] = ()
    frfs: tuple[FrfFacts, ...] = ()


@dataclass(frozen=True)
class _Group:
    """Files of one series that hold the same kind of thing with the same channels."""

    series: Series
    facts: tuple[FileFacts, ...]


def _signature(one: FileFacts) -> tuple[Any, ...]:
    """Files of a run agree in this."""
    if one.record is not None:
        names = tuple((channel.name, channel.role, channel.unit) for channel in one.record.channels)
        return one.kind, names, round(one.rate, 3), repr(dict(one.reader)), one.record.kind
    if one.level is not None:
        return one.kind, one.level.unstated, repr(dict(one.level.columns))
    frfs = tuple((len(frf.outputs), len(frf.inputs), frf.quantity, frf.scaled, frf.axis) for frf in one.frfs)
    return one.kind, frfs, repr(dict(one.reader))


def _groups(facts: list[FileFacts]) -> list[_Group]:
    by_signature: dict[tuple[Any, ...], dict[str, FileFacts]] = {}
    for one in facts:
        by_signature.setdefault(_signature(one), {})[one.path] = one
    groups = []
    for members in by_signature.values():
        if next(iter(members.values())).level is not None:
            named = {name.path: name for one in series_of(list(members)) for name in one.names}
            runs = level_tables.sets(list(members.values()))
            groups += [_Group(Series(tuple(named[one.path] for one in run), ()), run) for run in runs]
            continue
        series = [_Group(one, tuple(members[name.path] for name in one.names)) for one in series_of(list(members))]
        groups += _joined(series, list(members))
    return sorted(groups, key=lambda group: natural(group.facts[0].path))


def _joined(groups: list[_Group], paths: list[str]) -> list[_Group]:
    """Series of one first word whose FRFs are those of one point are one run: ``view_0``, ``view_0_02``, ``view_1``."""
    words: dict[str, list[_Group]] = {}
    for group in groups:
        words.setdefault(re.match(r"[^\d_.\-]*", group.facts[0].path)[0], []).append(group)  # type: ignore[index]
    joined = []
    for word, members in words.items():
        facts = tuple(one for group in members for one in group.facts)
        alike = same_point([one.record.frf if one.record else None for one in facts])
        suffix = re.search(r"(\.[A-Za-z]\w*)*$", paths[0])[0]  # type: ignore[index]
        same_suffix = all(one.path.endswith(suffix) for one in facts)
        # 1kN and 5kN are two conditions, however alike their FRFs are
        one_condition = len({name.conditions for group in members for name in group.series.names}) == 1
        directed = any(group.series.directed for group in members)
        if len(members) > 1 and word and alike and same_suffix and one_condition and not directed:
            series = Series(tuple(name for group in members for name in group.series.names), ())
            joined.append(_Group(replace(series, names=series.names, counts=()), facts))
        else:
            joined += members
    return joined


def _runs(group: _Group, answers: Answers, findings: list[Finding], known: geometry_table.Points) -> list[_Run]:
    """The runs that a group of files makes: one, or one for each file."""
    first = group.facts[0]
    if first.level is not None:
        run, comments = level_tables.run_of(group.facts, answers)
        return [_Run(run, [], comments)]
    if first.kind == "levels":
        return [_stepped(one, name, columns) for one in group.facts for name, columns in one.levels.items()]
    counts = _counted(group, answers)
    if counts == "runs":
        return [_run(_Group(series_of([one.path])[0], (one,)), "", answers, findings, known) for one in group.facts]
    return [_run(group, counts, answers, findings, known)]


def _counted(group: _Group, answers: Answers) -> str:
    """What the number in the names counts: ``points``, ``takes`` or ``runs``; empty for one file."""
    if len(group.facts) == 1:
        return ""
    series = group.series
    if "point" in series.counts:
        return "points"
    if series.counts and not series.open:
        return "takes"
    alike = same_point([one.record.frf if one.record else None for one in group.facts])
    evidence = {True: "their FRFs are alike", False: "their FRFs differ", None: ""}[alike]
    many = bool(group.facts[0].frfs) and len(group.facts) > _SERIES
    default = "takes" if alike else "points" if alike is False or many else "runs"
    name = series.names[0].series if series.counts else _files(group, "takes", [])
    choices = ("points", "takes", "runs") if series.counts else ("takes", "runs")
    said = "What does the number (#) in {} count: points, takes of one point, or runs of their own?"
    other = "Are the files {} takes of one point, or runs of their own?"
    text = (said if series.counts else other).format(name)
    return answers.ask(Question(f"count {name}", text, default, choices, evidence))


_SERIES = 3
"""Files with one FRF each beyond which their number is taken for that of a point unless somebody says otherwise."""


def _stepped(one: FileFacts, name: str, columns: Mapping[str, str]) -> _Run:
    """A run of stepped levels."""
    run = {"id": _safe(name), "kind": "stepped sine", "files": one.path, "levels": dict(columns)}
    comments = {"": f"{columns['control']} varies less within a level, so it was held"}
    return _Run(run, [], comments)


def _run(group: _Group, counts: str, answers: Answers, findings: list[Finding], known: geometry_table.Points) -> _Run:
    """One run of the files of a group."""
    first = group.facts[0]
    run: dict[str, Any] = {"id": _name(group)}
    comments: dict[str, str] = {}
    if first.record is not None and first.record.kind != "unknown":
        run["kind"] = first.record.kind
        comments["kind"] = first.record.kind_evidence
    channels, dofs = channel_tables.tables_of(group.facts, group.series, counts, answers, known)
    run["files"] = _files(group, counts, dofs)
    if first.kind == "records" and first.several > 1:
        comments["files"] = f"each with {first.several} records"
    if first.reader or first.needs_rate:
        reader = dict(first.reader)
        comments["reader"] = first.evidence
        if first.needs_rate:
            rate = answers.ask(
                Question("sampling_rate", f"Nothing states the sampling rate of {first.path}. How many Hz?")
            )
            reader["sampling_rate"] = _positive(rate) if rate else TODO
        run["reader"] = reader
    pressed = first.record is not None and any(one.role == "normal force" for one in first.record.channels)
    condition = re.findall(r"\d+(?:[.p]\d+)?\s?(?:k?N|Nm|lb|lbf)(?![A-Za-z])", first.path)
    if condition and not pressed:
        comments[""] = (
            f"the name says {', '.join(condition)}: where that is the normal force of a joint, add to this run\n"
            f'[[runs.normal_force]] with joint = "J1" and value = "{condition[0]}"'
        )
    for one in group.facts:
        if one.record is not None:
            for sentence in one.record.warnings:
                code = "force-response-swapped" if "swapped" in sentence else "names-doubled"
                findings.append(Finding("warning", code, one.path, f"{sentence}."))
    points: tuple[int, ...] = ()
    if counts == "points":
        points = tuple(dict.fromkeys(_points(group)))
    return _Run(run, channels, comments, points, tuple(dofs), first.frfs)


def _positive(text: str) -> float:
    try:
        value = float(text.split()[0].replace(",", "."))
    except (ValueError, IndexError):
        value = float("nan")
    if not 0 < value < float("inf"):
        raise InputError("not a sampling rate", got=repr(text), expected="a number of Hz, such as 1024")
    return value


def _files(group: _Group, counts: str, dofs: list[dict[str, str]]) -> Any:
    """A pattern where the names follow one, else the files one by one."""
    if any(dofs):
        return [{"file": one.path, "dofs": stated} for one, stated in zip(group.facts, dofs, strict=True)]
    if len(group.facts) == 1:
        return group.facts[0].path
    if not group.series.counts:
        word = re.match(r"[^\d_.\-]*[_\-]?", group.facts[0].path)[0]  # type: ignore[index]
        suffix = re.search(r"(\.[A-Za-z]\w*)*$", group.facts[0].path)[0]  # type: ignore[index]
        return f"{word}*{suffix}"
    series = group.series
    if counts == "points" and "point" not in series.counts:
        series = replace(series, counts=_first_open(series, "point"))
    elif counts == "takes":
        series = replace(series, counts=_first_open(series, "take"))
    return series.pattern


def _points(group: _Group) -> list[int]:
    """The point that the name of each file states."""
    series = group.series
    column = series.counts.index("point") if "point" in series.counts else series.varies.index(True)
    return [name.numbers[column] for name in series.names]


def _list_files(run: _Run, group: _Group, others: Sequence[str]) -> None:
    """List the files of a run one by one where their pattern would take others too: of another kind, or left out."""
    pattern = run.table["files"]
    if not isinstance(pattern, str) or len(group.facts) < 2:
        return
    # as the campaign reads a pattern: {point} is digits, * and other names are any text
    marks = re.compile(r"\\\*|\\{\w+\\}")
    taken = marks.sub(lambda mark: r"\d+" if "point" in mark[0] else "[^/]*", re.escape(pattern))
    also = [path for path in others if re.fullmatch(taken, path)]
    if not also:
        return
    run.comments["files"] = f"one by one, since {pattern} would take {also[0]} as well"
    moving = [channel for channel in run.channels if "{point}" in channel.get("dof", "")]
    files: list[Any] = [one.path for one in group.facts]
    if moving:
        files = [
            {"file": one.path, "dofs": {each["name"]: each["dof"].replace("{point}", str(point)) for each in moving}}
            for one, point in zip(group.facts, _points(group), strict=True)
        ]
        for channel in moving:
            del channel["dof"]
    run.table["files"] = files


def _first_open(series: Series, word: str) -> tuple[str, ...]:
    counts = list(series.counts)
    for place, varies in enumerate(series.varies):
        if varies and not counts[place]:
            counts[place] = word if word not in counts else "take" if "take" not in counts else f"number{place}"
    return tuple(counts)


def _name(group: _Group) -> str:
    """The id of a run: its name without the numbers that count, or the name of its only file."""
    path = group.facts[0].path
    if len(group.facts) > 1:
        path = re.match(r"[^\d_.\-]*", path)[0] if not group.series.counts else group.series.names[0].series  # type: ignore[index]
    stem = re.sub(r"(\.[A-Za-z]\w*)+$", "", path)
    return _safe(re.sub(r"_?#_?", "_", stem))


def _safe(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9.]+", "_", text).strip("_.") or "run"


def _unique(name: str, taken: set[str]) -> str:
    candidate, number = name, 2
    while candidate in taken:
        candidate, number = f"{name}_{number}", number + 1
    taken.add(candidate)
    return candidate


def _text(
    folder: Path,
    runs: list[_Run],
    geometry: tuple[dict[str, Any], dict[str, str]],
    answers: Answers,
    left: list[tuple[str, str]],
) -> str:
    """The whole file."""
    text = "# Proposed by `ema init` from the files beside it; comments say where a line comes from.\n"
    for question in answers.assumed:
        default = f"assumed: {question.default}" if question.default else "without it nothing can be computed"
        text += f"# TODO: {question.text} ({default})\n"
    header: dict[str, Any] = {"name": folder.resolve().name}
    readers = [run.table.get("reader") for run in runs]
    evidence = {}
    if len(runs) > 1 and readers[0] and all(reader == readers[0] for reader in readers):
        header["reader"], evidence = readers[0], {"reader": runs[0].comments.get("reader", "")}
        for run in runs:
            run.table.pop("reader")
            run.comments.pop("reader", None)
    text += "\n" + table_text("[campaign]", header, evidence)
    if geometry[0]:
        text += "\n" + table_text("[geometry]", *geometry)
    elif geometry[1]:
        text += "\n" + "".join(f"# {line}\n" for line in geometry[1][""].splitlines())
    shared = runs[0].channels if all(run.channels == runs[0].channels for run in runs) else None
    for channel in shared or []:
        text += "\n" + channel_tables.text_of("[[channels]]", channel)
    for run in runs:
        levels = run.table.get("levels")
        plain = {key: value for key, value in run.table.items() if key != "levels"}
        text += "\n" + table_text("[[runs]]", plain, run.comments)
        if levels:
            text += "\n" + table_text("[runs.levels]", levels)
        if shared is None:
            for channel in run.channels:
                text += "\n" + channel_tables.text_of("[[runs.channels]]", channel)
    for path, reason in left:
        text += f"\n# left out: {path}: {' '.join(reason.split())}"
    return text + ("\n" if left else "")
