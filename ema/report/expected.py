"""The numbers that a recipe expects, on the front page."""

from ema.data import StudyResult
from ema.messages import plural, text, word
from ema.report.blocks import Book, Cell, Table
from ema.report.numbers import MISSING, Value, plain, rounded, short


def counted_expectations(result: StudyResult) -> list[str]:
    """How many of the expected numbers were met, where there are some."""
    if not result.expectations:
        return []
    met = sum(expectation.met for expectation in result.expectations)
    return [
        plural(
            "{met} of {count} expected number met.",
            "{met} of {count} expected numbers met.",
            len(result.expectations),
            met=met,
        )
    ]


def expectation_table(result: StudyResult, book: Book) -> Table | None:
    """Expected and found, the missed ones first."""
    if not result.expectations:
        return None
    statements = {one.expectation.what: one for one in result.statements}
    rows: list[tuple[Cell, ...]] = []
    for e in sorted(result.expectations, key=lambda e: e.met):
        row: tuple[Cell, ...] = (_held(e.expected, e.tolerance), plain(e.tolerance, 2), _held(e.found, e.tolerance))
        if statement := statements.get(e.what):
            row = (word(statement.stated), MISSING, word(statement.verdict))
        rows.append((e.what, *row, text("met") if e.met else text("missed")))
    columns = (text("What"), text("Expected"), text("Tolerance"), text("Found"), text("Result"))
    return book.table("expectations", text("Numbers that the recipe expects."), columns, rows)


def _held(value: float, tolerance: float) -> Value:
    """Rounded by the tolerance; a number that has to be met exactly, such as a count, as it is."""
    return rounded(value, tolerance) if tolerance > 0 else Value(value, short(value))
