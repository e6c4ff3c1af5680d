"""Numbers in the lines of a text table: cells, rows with a name, and which marks separate and divide them."""

import re
from typing import Any

import numpy as np

from acquisition.files.layout import Layout

_FORTRAN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)[dD][-+]\d{2,3}")
"""A number in double precision as Fortran writes it: with a sign and two or three digits behind the letter."""
NO_NUMBER = re.compile(r"[\0-\x08\x0e-\x1f\xa0]|\d_\d")
"""What a conversion to numbers skips and no number holds: control characters, and lines between digits."""


def is_closed(line: str, delimiter: str) -> bool:
    """Whether a delimiter stands behind the last cell of a line, as some writers put one behind every number."""
    return delimiter != " " and delimiter in line and not line.rpartition(delimiter)[2].strip()


def block(lines: list[str], delimiter: str, decimal: str, *, columns: int, closed: bool) -> Any:
    """Lines of ``columns`` plain numbers each, all at once; ``None`` where one of them is anything else.

    ``closed`` says that each has a delimiter behind its last number.
    """
    if delimiter == " ":
        alike = all(len(line.split()) == columns for line in lines)
    else:
        alike = all(line.count(delimiter) == columns - 1 + closed for line in lines)
    if closed:
        alike = alike and all(is_closed(line, delimiter) for line in lines)
        lines = [line.rpartition(delimiter)[0] for line in lines] if alike else lines
    text = delimiter.join(lines)
    if not alike or (decimal == "," and "." in text) or NO_NUMBER.search(text):
        return None
    if decimal == ",":
        text = text.replace(",", ".")
    try:
        numbers = list(map(float, text.split() if delimiter == " " else text.split(delimiter)))
    except ValueError:
        return None
    return np.array(numbers).reshape(len(lines), columns)


def _number(cell: str) -> complex:
    """A real or complex number; an empty cell is NaN.

    In brackets stand complex numbers alone: what accountants mean by ``(1.5)``, -1.5, others do not.
    """
    try:
        return float(cell)
    except ValueError:
        cell = cell.strip()
        if cell[:1] == cell[-1:] == '"' and len(cell) > 1:
            cell = cell[1:-1].strip()
        if not cell:
            return float("nan")
        if re.search(r"[ij]\)?$", cell) and cell[:1] in "+-.(0123456789":
            return complex(re.sub(r"\s*([-+])\s*", r"\1", cell.replace("i", "j")))
        if _FORTRAN.fullmatch(cell):
            cell = cell.replace("D", "E").replace("d", "e")
        return float(cell)


def numbers(cells: list[str]) -> list[complex] | None:
    """The cells as numbers, or ``None`` where one is something else or all are empty."""
    try:
        numbers = [_number(cell) for cell in cells]
    except ValueError:
        return None
    return numbers if any(cell.strip() for cell in cells) else None


def cells_of(line: str, delimiter: str, decimal: str, closed: bool = True) -> list[complex] | None:
    """The numbers of a line, or ``None`` where the line holds anything else.

    A delimiter at the end of a ``closed`` line ends its last cell; in other lines an empty cell follows it.
    """
    cells = line.split() if delimiter == " " else line.split(delimiter)
    if NO_NUMBER.search(line):
        return None
    if decimal == ",":
        if "." in line:
            return None
        cells = [cell.replace(",", ".") for cell in cells]
    if closed and is_closed(line, delimiter):
        cells.pop()
    return numbers(cells) if line[:1] != "_" else None


def labelled(line: str, delimiter: str, decimal: str) -> tuple[str, list[complex] | None]:
    """Label and numbers of a row that begins with a name."""
    if delimiter == " ":
        return "", None
    label, found, rest = line.partition(delimiter)
    if not found or not any(c.isalpha() for c in label):
        return "", None
    cells = [cell.replace(",", ".") if decimal == "," else cell for cell in rest.split(delimiter)]
    return label.strip().strip('"'), numbers(cells)


def dialect(lines: list[str], layout: Layout) -> tuple[str, str]:
    """Delimiter and decimal mark: those that read the most lines of a sample as numbers."""
    middle = len(lines) // 2
    sample = [line for line in (*lines[:150], *lines[middle : middle + 50]) if line.strip()]
    best, choice = -1.0, (",", ".")
    delimiters = [layout.delimiter] if layout.delimiter else ["\t", ";", ",", " "]
    decimals = [layout.decimal] if layout.decimal else [".", ","]
    whole = "\n".join(sample)
    # marks that are nowhere leave each line as it is: the first of them stands for all
    absent = [mark for mark in delimiters if mark not in whole]
    for delimiter in [mark for mark in delimiters if mark == " " or mark not in absent[1:]]:
        for decimal in [mark for mark in decimals if mark == decimals[0] or mark in whole]:
            if delimiter == decimal:
                continue
            counts = []
            for line in sample:
                cells = cells_of(line, delimiter, decimal)
                cells = cells if cells is not None else labelled(line, delimiter, decimal)[1]
                counts.append(0 if cells is None else len(cells))
            score = sum(count > 0 for count in counts) + 0.001 * sum(counts) / max(len(counts), 1)
            if score > best:
                best, choice = score, (delimiter, decimal)
    return choice
