"""Excel tables: the titles of the first row name the columns."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files import table
from acquisition.files.layout import Layout
from acquisition.files.quiet import quiet
from acquisition.files.reconcile import differs
from acquisition.files.scales import is_unit
from ema.data import Finding
from ema.errors import InputError, require


def read(path: Path, layout: Layout) -> Contents:
    """Read one sheet: that named in the layout, else the first that holds numbers.

    Raises
    ------
    MissingExtraError : openpyxl is not installed.
    InputError : no such sheet, no numbers, or the titles do not say what the columns are.
    """
    openpyxl = require("openpyxl", "formats")
    with quiet():
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    try:
        names = book.sheetnames if layout.sheet is None else [layout.sheet]
        if layout.sheet is not None and layout.sheet not in book.sheetnames:
            raise InputError(
                "no such sheet", where=path.name, got=layout.sheet, expected="one of " + ", ".join(book.sheetnames)
            )
        for name in names:
            rows = [list(row) for row in book[name].iter_rows(values_only=True)]
            if any(_is_number(cell) for row in rows for cell in row):
                where = path.name if len(book.sheetnames) == 1 else f"{path.name}, sheet {name}"
                segment, notes = _segment(rows, where, layout)
                contents = table.arranged(segment, layout, where)
                return replace(contents, findings=(*notes, *contents.findings))
    finally:
        book.close()
    raise InputError("no numbers in the workbook", where=path.name)


def _segment(rows: list[list[Any]], where: str, layout: Layout) -> tuple[table.Segment, list[Finding]]:
    """Rows with a number in the first filled column on; the last row of texts above gives the titles.

    Raises
    ------
    InputError : among the numbers stand cells or rows that hold none, and salvage was not asked for.
    """
    first = next(place for place, row in enumerate(rows) if any(map(_is_number, row)))
    last = max(place for place, row in enumerate(rows) if any(map(_is_number, row)))
    width = max(len(row) for row in rows)
    head = rows[first - 1] if first else []
    unit_row: list[str] = []
    if first > 1 and any(head) and all(cell is None or is_unit(str(cell)) for cell in head):
        unit_row = [str(cell).strip("[]() ") if cell is not None else "" for cell in head] + [""] * width
        head = rows[first - 2]
    titles = [str(cell).strip() if cell is not None else "" for cell in head] + [""] * width
    body = [row + [None] * (width - len(row)) for row in rows[first : last + 1]]
    numbers = np.full((len(body), width), np.nan)
    others: dict[int, list[int]] = {}
    for place, row in enumerate(body):
        for column, cell in enumerate(row):
            if _is_number(cell):
                numbers[place, column] = cell
            elif cell is not None and str(cell).strip():
                others.setdefault(column, []).append(place)
    filled = ~np.isnan(numbers).all(axis=0)
    notes: list[Finding] = []
    for column, places in others.items():
        texts = [str(body[place][column]) for place in places]
        if not filled[column] and not any(map(_looks_like_number, texts)):
            message = f"column {titles[column] or column} holds texts, not read."
            notes.append(Finding("info", "not-read", where, message))
            continue
        cell = f"{_letters(column)}{first + places[0] + 1}"
        what = "a column of texts that look like numbers" if not filled[column] else "a cell among the numbers is none"
        notes += differs(
            what, where=f"{where}, cell {cell}", layout=layout, got=repr(texts[0]), expected="a number",
            recovered=f"{len(places)} such cells are left out of column {titles[column] or column}",
        )  # fmt: skip
    empty = np.flatnonzero(np.isnan(numbers).all(axis=1))
    if len(empty):
        notes += differs(
            "a row among the numbers holds none", where=f"{where}, row {first + int(empty[0]) + 1}", layout=layout,
            got=f"{len(empty)} rows", expected="none", recovered="their values are kept as not a number",
        )  # fmt: skip
    numbers = numbers[:, filled]
    kept = [titles[column] or f"column {column}" for column in np.flatnonzero(filled)]
    header = tuple(" ".join(str(cell) for cell in row if cell is not None) for row in rows[:first])
    stated = tuple(unit_row[column] for column in np.flatnonzero(filled)) if unit_row else ()
    return table.Segment(header, numbers, tuple(kept), units=stated), notes


def _is_number(cell: Any) -> bool:
    return isinstance(cell, (int, float)) and not isinstance(cell, bool)


def _looks_like_number(text: str) -> bool:
    return re.fullmatch(r"\s*[-+]?[\d.,' ]*\d[\d.,]*([eEdD][-+]?\d+)?\s*|#.*", text) is not None


def _letters(column: int) -> str:
    """The name of a column as the workbook shows it: 0 -> A, 26 -> AA."""
    name = ""
    while column >= 0:
        name, column = chr(65 + column % 26) + name, column // 26 - 1
    return name
