"""The front page: the answer first."""

from dataclasses import dataclass

from ema.data import StudyResult
from ema.report.blocks import Block, Book, Table
from ema.report.comparison import comparisons
from ema.report.modes import mode_table, run_sentence
from ema.report.numbers import Value, count, plain, rounded, short
from ema.report.worries import Group, all_findings, counted, finding_table, grouped


@dataclass(frozen=True)
class Front:
    """What the front page shows."""

    summary: list[str]
    modes: list[Block]
    comparisons: list[Block]
    worries: list[Group]
    findings: Table | None
    expectations: Table | None


def front(result: StudyResult, book: Book) -> Front:
    """Collect the front page of a study."""
    worries = grouped(all_findings(result))
    modes = [mode_table(run, book) for run in result.runs]
    told, compared = comparisons(list(result.runs), book)
    summary = [run_sentence(run) for run in result.runs] or ["No run was analysed."]
    summary += [*told, counted(worries)]
    if result.expectations:
        met = sum(expectation.met for expectation in result.expectations)
        summary.append(f"{met} of {count(len(result.expectations), 'expected number')} met.")
    return Front(summary, modes, compared, worries, finding_table(worries, book), _expectations(result, book))


def _expectations(result: StudyResult, book: Book) -> Table | None:
    if not result.expectations:
        return None
    rows = [
        (
            e.what, _held(e.expected, e.tolerance), plain(e.tolerance, 2), _held(e.found, e.tolerance),
            "met" if e.met else "missed",
        )
        for e in sorted(result.expectations, key=lambda e: e.met)
    ]  # fmt: skip
    columns = ("What", "Expected", "Tolerance", "Found", "Result")
    return book.table("expectations", "Numbers that the recipe expects.", columns, rows)


def _held(value: float, tolerance: float) -> Value:
    """Rounded by the tolerance; a number that has to be met exactly, such as a count, as it is."""
    return rounded(value, tolerance) if tolerance > 0 else Value(value, short(value))
