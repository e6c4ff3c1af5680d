"""Dates and times in the cells of a workbook become seconds after the first of them, as time stamps of text tables."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, time, timedelta
from typing import Any

_DAY = 86400.0


@dataclass
class CellTimes:
    """Columns of times: ``seconds`` by column and row, and the columns of ``dates`` that are part of them."""

    seconds: dict[int, dict[int, float]] = field(default_factory=dict)
    dates: list[int] = field(default_factory=list)


def is_time(cell: Any) -> bool:
    """Whether a cell holds a date, a time of day or a duration."""
    return isinstance(cell, (datetime, time, timedelta))


def in_seconds(columns: Mapping[int, Mapping[int, Any]], rows: int) -> CellTimes:
    """The columns of times among cells by column and row, beside so many rows of numbers.

    A column is one of times where it has them, all of one kind and without a gap, in half of the rows or more. A date
    in a column of its own is added to the times of day beside it, which otherwise pass midnight where they fall by more
    than half a day.
    """
    runs = {column: _longest_run(cells) for column, cells in columns.items()}
    full = {column: cells for column, cells in runs.items() if len(cells) > 1 and 2 * len(cells) >= rows}
    days = [column for column, cells in full.items() if all(map(_is_midnight, cells.values()))]
    clocks = [column for column in full if column not in days]
    found = CellTimes()
    if clocks:
        found.dates = days
    for column in clocks or days:
        dates = full[days[0]] if len(days) == 1 and clocks else {}
        elapsed = _elapsed(full[column], dates)
        begin = next(iter(elapsed.values()))
        found.seconds[column] = {row: second - begin for row, second in elapsed.items()}
    return found


def _longest_run(cells: Mapping[int, Any]) -> dict[int, Any]:
    """The most cells of one kind in rows that follow one another."""
    runs: list[dict[int, Any]] = [{}]
    before: tuple[int, Any] = (-2, None)
    for row, cell in cells.items():
        if (row - 1, type(cell)) != (before[0], type(before[1])):
            runs.append({})
        runs[-1][row] = cell
        before = row, cell
    return max(runs, key=len)


def _is_midnight(cell: Any) -> bool:
    return isinstance(cell, datetime) and cell.time() == time()


def _elapsed(cells: Mapping[int, Any], dates: Mapping[int, datetime]) -> dict[int, float]:
    """Seconds of the cells of one column, from any origin."""
    first, seconds, before, passed = next(iter(cells.values())), {}, 0.0, 0.0
    for row, cell in cells.items():
        if isinstance(cell, timedelta):
            second = cell.total_seconds()
        elif isinstance(cell, datetime):
            second = (cell - first).total_seconds()
        else:
            second = 3600.0 * cell.hour + 60.0 * cell.minute + cell.second + 1e-6 * cell.microsecond
            if row in dates:
                passed = _DAY * dates[row].toordinal()
            elif before - second > _DAY / 2:
                passed += _DAY
            before = second
        seconds[row] = passed + second
    return seconds
