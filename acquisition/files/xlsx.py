"""Excel tables: the titles of the first row name the columns."""

from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files import table
from acquisition.files.layout import Layout
from acquisition.files.quiet import quiet
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
            if any(isinstance(cell, (int, float)) for row in rows for cell in row):
                where = path.name if len(book.sheetnames) == 1 else f"{path.name}, sheet {name}"
                return table.arranged(_segment(rows), layout, where)
    finally:
        book.close()
    raise InputError("no numbers in the workbook", where=path.name)


def _segment(rows: list[list[Any]]) -> table.Segment:
    """Rows with a number in the first filled column on; the last row of texts above gives the titles."""
    first = next(place for place, row in enumerate(rows) if sum(isinstance(c, (int, float)) for c in row) >= 1)
    width = max(len(row) for row in rows)
    head = rows[first - 1] if first else []
    titles = [str(cell).strip() if cell is not None else "" for cell in head] + [""] * width
    numbers = np.full((len(rows) - first, width), np.nan)
    for place, row in enumerate(rows[first:]):
        for column, cell in enumerate(row):
            if isinstance(cell, (int, float)) and not isinstance(cell, bool):
                numbers[place, column] = cell
    filled = ~np.isnan(numbers).all(axis=0)
    numbers = numbers[~np.isnan(numbers).all(axis=1)][:, filled]
    kept = [titles[column] or f"column {column}" for column in np.flatnonzero(filled)]
    header = tuple(" ".join(str(cell) for cell in row if cell is not None) for row in rows[:first])
    return table.Segment(header, numbers, tuple(kept))
