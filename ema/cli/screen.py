"""What people see: progress bars, tables, findings."""

import json
import sys
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from ema.data import ConditionDifference, Finding, ModalModel, RepeatGroup, RunResult, StudyResult

if TYPE_CHECKING:
    from ema.fit.opinion import SecondOpinion

_STYLES = {"error": "bold red", "warning": "yellow", "info": "dim"}
_PLAIN_WIDTH = 160
"""Characters of a line where the output is no terminal."""


def console() -> Console:
    """The standard output; wide where nobody watches, so that tables in files and pipes are whole.

    Names and texts are those of people: square brackets and colons in them are no markup.
    """
    return Console(highlight=False, markup=False, emoji=False, width=None if sys.stdout.isatty() else _PLAIN_WIDTH)


def as_json(content: Any) -> None:
    """Print ``content`` as JSON."""
    print(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False))


class Bars:
    """Progress bars on the error stream, gone when the work is done; none where nobody watches."""

    def __init__(self) -> None:
        stream = Console(stderr=True, highlight=False, markup=False, emoji=False)
        self._progress = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=stream,
            transient=True,
            disable=not stream.is_terminal,
        )
        self._tasks: dict[str, Any] = {}

    def __enter__(self) -> "Bars":
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` steps of ``what`` are done."""
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(what, total=total)
        self._progress.update(self._tasks[what], completed=done, total=total)
        if done >= total:
            self._progress.remove_task(self._tasks.pop(what))

    def note(self, sentence: str) -> None:
        """Print a sentence about the work on the error stream; it stays."""
        self._progress.console.print(sentence, soft_wrap=True)


def show_result(out: Console, result: StudyResult, report: Path) -> None:
    """The end of the main job: modes, findings, expectations, and where the report is."""
    for run in result.runs:
        out.print(mode_table(run.modes, run.run.id, run))
    show_conditions(out, result)
    findings = [*result.findings, *(finding for run in result.runs for finding in run.findings)]
    show_findings(out, [finding for finding in findings if finding.severity != "info"])
    if result.expectations:
        missed = [expectation for expectation in result.expectations if not expectation.met]
        out.print(f"{len(result.expectations) - len(missed)} of {len(result.expectations)} expected numbers met.")
        verdicts = {one.expectation.what for one in result.statements}
        for one in missed:
            numbers = f": found {one.found:.6g}, expected {one.expected:.6g} +- {one.tolerance:.3g}"
            out.print(f"missed: {one.what}{'' if one.what in verdicts else numbers}", style=_STYLES["error"])
    out.print(f"Report: {report}")


def mode_table(model: ModalModel, title: str, result: RunResult | None = None) -> Table:
    """Frequencies and damping with their standard deviations, MPC where there is one, normal force per joint."""
    columns: dict[str, Sequence[str]] = {
        "mode": [str(mode + 1) for mode in range(len(model.poles))],
        "f [Hz]": [f"{value:.3f}" for value in model.natural_frequencies],
    }
    if model.covariance is not None:
        columns["std f [Hz]"] = [f"{value:.2g}" for value in np.sqrt(model.covariance[:, 0, 0])]
    columns["zeta [%]"] = [f"{100 * value:.4f}" for value in model.damping_ratios]
    if model.covariance is not None:
        columns["std zeta [%]"] = [f"{100 * value:.2g}" for value in np.sqrt(model.covariance[:, 1, 1])]
    if result is not None and result.quality is not None:
        columns["MPC"] = [f"{value:.4f}" for value in result.quality.modal_phase_collinearity]
    if model.confidence is not None:
        columns["confidence"] = [f"{value:.2f}" for value in model.confidence]
    for joint in model.condition.joints:
        force = f"{joint.mean:.0f}" if joint.known else "unknown"
        columns[f"F_N {joint.joint} [N]"] = [force] * len(model.poles)
    return _table(f"{title}: {len(model.poles)} modes", columns)


def show_conditions(out: Console, result: StudyResult) -> None:
    """Repeats of each condition, and which changes between conditions they make significant."""
    from ema.compare.scatter import difference_sentences

    for group in result.conditions:
        if len(group.runs) > 1:
            out.print(_repeat_table(group))
    for found in result.differences:
        if found.pairs and found.known.any():
            out.print(_difference_table(found))
    for sentence in difference_sentences(result.differences):
        out.print(sentence, soft_wrap=True)


def _repeat_table(group: RepeatGroup) -> Table:
    """Means with half their 95 % interval; standard deviations by noise and between assemblies."""
    title = f"{group.label}: {', '.join(group.runs)}: {group.basis}; noise within a run, scatter between assemblies"
    columns: dict[str, Sequence[str]] = {
        "mode": [str(mode + 1) for mode in range(len(group.frequency.mean))],
        "repeats": [str(number) for number in group.frequency.assemblies],
    }
    for name, unit, scale, own, digits in (("f", "Hz", 1, group.frequency, 3), ("zeta", "%", 100, group.damping, 4)):
        columns |= {
            f"{name} [{unit}]": [f"{scale * value:.{digits}f}" for value in own.mean],
            f"+- {name}": _cells(scale * own.half),
            f"noise {name}": _cells(scale * own.noise),
            f"between {name}": _cells(scale * own.between),
        }
    return _table(title, columns)


def _difference_table(found: ConditionDifference) -> Table:
    """Changes of frequency and damping with half their 95 % interval."""
    columns: dict[str, Sequence[str]] = {
        "f [Hz]": [f"{value:.3f}" for value in found.frequency[:, 0]],
        "change of f [Hz]": [f"{value:+.3g}" for value in np.diff(found.frequency, axis=1)[:, 0]],
        "+- f": _cells(found.frequency_half),
        "verdict on f": found.words("frequency"),
        "zeta [%]": [f"{100 * value:.4f}" for value in found.damping[:, 0]],
        "change of zeta [%]": [f"{100 * value:+.3g}" for value in np.diff(found.damping, axis=1)[:, 0]],
        "+- zeta": _cells(100 * found.damping_half),
        "verdict on zeta": found.words("damping"),
    }
    return _table(f"{found.second} against {found.first}: 95 % intervals from repeats", columns)


def _cells(values: np.ndarray) -> list[str]:
    return [f"{value:.2g}" if np.isfinite(value) else "unknown" for value in values]


def _table(title: str, columns: dict[str, Sequence[str]]) -> Table:
    return table(columns, zip(*columns.values(), strict=True), title)


def table(
    names: Iterable[str],
    rows: Iterable[Iterable[Any]],
    title: str = "",
    *,
    left: Collection[str] = (),
    whole: Collection[str] | None = None,
    digits: str = ".4g",
    caption: str = "",
) -> Table:
    """Rows under the names of their columns.

    Parameters
    ----------
    left : columns that are not on the right.
    whole : columns whose lines are not broken; all of them by default.
    digits : how a float is written; one that is not known is a dash.
    """
    drawn = Table(title=title or None, title_justify="left", title_style="bold")
    drawn.caption, drawn.caption_justify = caption or None, "left"
    for name in names:
        drawn.add_column(str(name), justify="left" if name in left else "right", no_wrap=whole is None or name in whole)
    for row in rows:
        drawn.add_row(*(_written(value, digits) for value in row))
    return drawn


def _written(value: Any, digits: str) -> str:
    if isinstance(value, float):
        return "-" if value != value else f"{value:{digits}}"
    return str(value)


def opinion_table(opinion: "SecondOpinion", title: str) -> Table:
    """Two estimators side by side; differences in combined standard deviations."""
    formats = {
        "f [Hz]": ".3f",
        "f second [Hz]": ".3f",
        "df / s": "+.1f",
        "zeta [%]": ".4f",
        "zeta second [%]": ".4f",
        "dzeta / s": "+.1f",
        "MAC": ".3f",
    }
    rows = [
        (
            mode,
            *(format(row[name], digits) if np.isfinite(row[name]) else "none" for name, digits in formats.items()),
            "yes" if row["agrees"] else "no",
        )
        for mode, row in opinion.table().iterrows()
    ]
    return table(
        ("mode", *formats, "agrees"),
        rows,
        f"{title}: second opinion (ERA), differences in combined standard deviations s, limit {opinion.limit:.1f}",
    )


def show_findings(out: Console, findings: Sequence[Finding]) -> None:
    """One line per finding, the severity first."""
    for finding in findings:
        out.print(f"{finding.severity}: {finding}", style=_STYLES[finding.severity], soft_wrap=True)


def show_written(out: Console, paths: Iterable[Path]) -> None:
    """Where the results are."""
    out.print("Written: " + ", ".join(str(path) for path in paths), soft_wrap=True)
