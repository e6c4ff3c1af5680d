"""Excel tables: the titles of the first row name the columns."""

import re
from array import array
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files import table
from acquisition.files.cell_times import CellTimes, in_seconds, is_time
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from acquisition.files.scales import is_unit
from acquisition.files.suppressed_warnings import suppressed_warnings
from acquisition.files.table.titles import TITLES
from acquisition.isolated import call
from acquisition.isolated.limits import check_zip
from ema.data import Finding
from ema.errors import InputError, require


def read(path: Path, layout: Layout) -> Contents:
    """Read one sheet of a workbook.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        ``sheet``: its name, by default the first that holds numbers, visible sheets first; otherwise as for a text
        table.

    Returns
    -------
    Contents
        What the sheet holds, with findings that name the sheets that were not read.

    Raises
    ------
    MissingExtraError
        openpyxl is not installed.
    InputError
        There is no such sheet, no number in it, or the titles do not say what the columns are.
    """
    there = call("xlsx", path, sheet=layout.sheet)
    sheets = there["sheets"]
    if layout.sheet is not None and layout.sheet not in sheets:
        raise InputError("no such sheet", where=path.name, got=layout.sheet, expected="one of " + ", ".join(sheets))
    if not len(there["values"]):
        raise InputError(
            "no numbers in the workbook",
            where=path.name if layout.sheet is None else f"{path.name}, sheet {layout.sheet}",
            advice="store the values as numbers, not as texts or as formulas that were never calculated",
        )
    where = path.name if len(sheets) == 1 else f"{path.name}, sheet {there['sheet']}"
    texts: dict[int, dict[int, str]] = {}
    for row, column, text in there["texts"]:
        texts.setdefault(row, {})[column] = text
    segment, notes = _segment(there, texts, layout=layout, where=where)
    contents = table.segment_contents(segment, layout, where)
    hidden = there["hidden"]
    if there["sheet"] in hidden and layout.sheet is None:
        message = "the sheet is hidden; no other holds numbers."
        notes = [Finding("warning", "hidden-sheet", where, message, advice="Make sure that it is the one."), *notes]
    others = [f"{name} (hidden)" if name in hidden else name for name in sheets if name != there["sheet"]]
    if others and layout.sheet is None:
        message = f"sheets that were not read: {', '.join(others[:5])}{' ...' if len(others) > 5 else ''}."
        notes = [*notes, Finding("info", "not-read", path.name, message, advice="Say sheet='...' to read another.")]
    return replace(contents, findings=(*notes, *contents.findings))


def cells(path: Path, sheet: str | None) -> dict[str, Any]:
    """The cells of one sheet that hold anything: that of the name, else the first with numbers, hidden ones last.

    ``sheets`` lists the names of all, ``hidden`` those of hidden ones, ``sheet`` is that which was read; ``values``
    (number,) stand at ``places`` (number, 2) of row and column, counted from 0; ``texts`` lists row, column and text of
    the other cells; ``times`` are the columns of dates and times, in s, and ``dates`` those that are part of them.

    Raises
    ------
    InputError : the workbook grows beyond measure when it is unpacked, or a number stands among times.
    """
    book = _opened(path)
    try:
        names = [name for name in book.sheetnames if sheet in (None, name)]
        hidden = [name for name in book.sheetnames if book[name].sheet_state != "visible"]
        places, values, name = array("q"), array("d"), ""
        texts: list[tuple[int, int, str]] = []
        found = CellTimes()
        for name in sorted(names, key=hidden.__contains__):
            page, texts = book[name], []
            stamps: dict[int, dict[int, Any]] = {}
            if not hasattr(page, "reset_dimensions"):
                continue  # a page with a picture alone
            page.reset_dimensions()  # the cells there are, not those that are announced
            for row, filled in enumerate(page.iter_rows(values_only=True)):
                for column, cell in enumerate(filled):
                    if cell is None:
                        continue
                    number = _number(cell)
                    if is_time(cell):
                        stamps.setdefault(column, {})[row] = cell
                    elif number is None:
                        texts.append((row, column, str(cell)))
                    else:
                        places.extend((row, column))
                        values.append(number)
            if places:
                found = _timed(stamps, places, values, texts, where=f"{path.name}, sheet {name}")
                break
    finally:
        book.close()
    return {
        "sheets": list(book.sheetnames),
        "hidden": hidden,
        "sheet": name,
        "times": list(found.seconds),
        "dates": found.dates,
        "texts": texts,
        "values": np.array(values),
        "places": np.array(places).reshape(-1, 2),
    }


def _opened(path: Path) -> Any:
    """The workbook, without its sheets of charts, on which the library trips where they are empty.

    Raises
    ------
    MissingExtraError : openpyxl is not installed.
    InputError : it grows beyond measure when it is unpacked.
    """
    excel = require("openpyxl.reader.excel", "formats")
    check_zip(path)

    class Tables(excel.ExcelReader):  # type: ignore[name-defined]
        """The reader of a workbook that passes over charts."""

        def read_chartsheet(self, sheet: Any, rel: Any) -> None:
            """A sheet of charts holds no cells."""

    with suppressed_warnings():
        reader = Tables(path, read_only=True, data_only=True)
        reader.read()
    return reader.wb


def _timed(
    stamps: dict[int, dict[int, Any]],
    places: "array[int]",
    values: "array[float]",
    texts: list[tuple[int, int, str]],
    *,
    where: str,
) -> CellTimes:
    """The columns of times, put among the numbers; other dates become texts.

    Raises
    ------
    InputError : a number stands among times.
    """
    rows, columns = list(places[::2]), list(places[1::2])
    found = in_seconds(stamps, len(set(rows)))
    for row, column, value in zip(rows, columns, values):
        if column in found.seconds and row > min(found.seconds[column]):
            raise InputError(
                "a cell among the times is none",
                where=f"{where}, cell {_letters(column)}{row + 1}",
                got=f"{value:g}",
                expected="a date, a time of day or a duration as in the others",
                advice="correct the cell and save it again",
            )
    for column, seconds in found.seconds.items():
        for row, second in seconds.items():
            places.extend((row, column))
            values.append(second)
    for column, cells in stamps.items():
        used = cells if column in found.dates else found.seconds.get(column, {})
        texts += [(row, column, str(cell)) for row, cell in cells.items() if row not in used]
    return found


def _number(cell: Any) -> float | None:
    """The number in a cell, or ``None`` where there is something else."""
    if isinstance(cell, bool) or not isinstance(cell, (int, float)):
        return None
    try:
        return float(cell)
    except OverflowError:
        return None


_Texts = dict[int, dict[int, str]]
"""Texts by row and column."""


def _segment(
    there: dict[str, Any], texts: _Texts, *, layout: Layout, where: str
) -> tuple[table.Segment, list[Finding]]:
    """Rows with a number in the first filled column on; the last row of texts above gives the titles.

    Raises
    ------
    InputError : among the numbers stand cells or rows that hold none, and salvage was not asked for.
    """
    places, values = there["places"], there["values"]
    first, last = int(places[:, 0].min()), int(places[:, 0].max())
    head = texts.get(first - 1, {})
    unit_row: dict[int, str] = {}
    if first > 1 and head and all(map(is_unit, head.values())):
        unit_row = {column: text.strip("[]() ") for column, text in head.items()}
        head = texts.get(first - 2, {})
    titles = {column: text.strip() for column, text in head.items() if column not in there["dates"]}
    for column in there["times"]:
        title = titles.get(column, "")
        titles[column] = f"{title if title.lower() in TITLES['time'] else 'Time'} (s)"
        unit_row |= {column: "s"} if unit_row else {}
    columns = np.unique(places[:, 1])
    notes: list[Finding] = []
    others: dict[int, list[int]] = {}
    for row in sorted(row for row in texts if first <= row <= last):
        for column, text in texts[row].items():
            if text.strip():
                others.setdefault(column, []).append(row)
    for column, rows in others.items():
        name = titles.get(column) or column
        if column not in columns and not any(_looks_like_number(texts[row][column]) for row in rows):
            message = f"column {name} holds texts, not read."
            notes.append(Finding("info", "not-read", where, message))
            continue
        what = (
            "a column of texts that look like numbers" if column not in columns else "a cell among the numbers is none"
        )
        notes += differs(
            what,
            where=f"{where}, cell {_letters(column)}{rows[0] + 1}",
            layout=layout,
            got=repr(texts[rows[0]][column]),
            expected="a number",
            recovered=f"{len(rows)} such cells are left out of column {name}",
        )
    for column in sorted(set(titles) - set(columns.tolist()) - others.keys()):
        message = f"column {titles[column]} holds nothing: it is empty, or its formulas were never calculated."
        notes.append(Finding("warning", "not-read", where, message, advice="Save it with the program of the table."))
    filled = np.unique(places[:, 0])
    empty = last - first + 1 - len(filled)
    if empty:
        gap = first + int(np.flatnonzero(filled != first + np.arange(len(filled)))[0])
        # a table with more rows without than with numbers is none, however much of it is salvaged
        recovered = "their values are kept as not a number" if empty <= len(filled) else ""
        notes += differs(
            "a row among the numbers holds none",
            where=f"{where}, row {gap + 1}",
            layout=layout,
            got=f"{empty} rows",
            expected="none",
            recovered=recovered,
        )
    if (last - first + 1) * len(columns) > max(_SPARSE * len(values), 1 << 20):
        raise InputError(
            "the cells with numbers are no table",
            where=where,
            got=f"{len(values)} cells",
            expected=f"{len(columns)} columns of {last - first + 1} rows",
            advice="delete the cells outside of the table",
        )
    numbers = np.full((last - first + 1, len(columns)), np.nan)
    numbers[places[:, 0] - first, np.searchsorted(columns, places[:, 1])] = values
    kept = tuple(titles.get(column) or f"column {column}" for column in columns.tolist())
    header = tuple(" ".join(texts[row].values()) for row in sorted(texts) if row < first)
    stated = tuple(unit_row.get(column, "") for column in columns.tolist()) if unit_row else ()
    return table.Segment(header, numbers, kept, units=stated), notes


_SPARSE = 20
"""Places of a table for each number in it; more than a million places that are emptier are no measurement. Loggers with
one column per rate leave nine of ten empty."""


def _looks_like_number(text: str) -> bool:
    return re.fullmatch(r"\s*[-+]?[\d.,' ]*\d[\d.,]*([eEdD][-+]?\d+)?\s*|#.*", text) is not None


def _letters(column: int) -> str:
    """The name of a column as the workbook shows it: 0 -> A, 26 -> AA."""
    name = ""
    while column >= 0:
        name, column = chr(65 + column % 26) + name, column // 26 - 1
    return name
