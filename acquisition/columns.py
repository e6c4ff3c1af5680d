"""Small tables beside a campaign: normal forces over time, positions, lists of files."""

import csv
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from jaxtyping import Float

from acquisition.units import bracketed
from ema.errors import InputError

__all__ = ["bracketed", "column", "moment", "numbers", "read_columns"]


def read_columns(path: Path, names_in: str = "first row") -> dict[str, list[str]]:
    """The texts of each named column; separator (comma, semicolon, tab) by the first line, ``#`` starts a comment.

    With ``names_in = "first column"`` each row of the file is such a column, its name in front.

    Raises
    ------
    InputError : no such file, not a text, empty, or a row with more values than names.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        text = path.read_text(encoding="latin-1")
    except FileNotFoundError:
        raise InputError("there is no such file", where=str(path), advice="check the name and the folder") from None
    except OSError as error:
        raise InputError(
            f"cannot be read ({error.strerror})", where=str(path), advice="check that it is a file that you may read"
        ) from error
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines or "\0" in text:
        raise InputError("not a table" if lines else "the table is empty", where=str(path), expected="a CSV file")
    separator = max(";\t,", key=lines[0].count)
    rows = [[value.strip() for value in row] for row in csv.reader(lines, delimiter=separator)]
    if names_in == "first column":
        return {row[0]: row[1:] for row in rows}
    names, body = rows[0], rows[1:]
    for number, row in enumerate(body, start=2):
        if len(row) > len(names) and any(row[len(names) :]):
            raise InputError(
                "a row with more values than there are column names",
                where=f"{path}, row {number}",
                got=len(row),
                expected=len(names),
                advice="decimal commas need semicolons or tabs between the columns",
            )
    return {name: [row[place] if place < len(row) else "" for row in body] for place, name in enumerate(names)}


def column(table: dict[str, list[str]], name: str, where: str) -> list[str]:
    """The texts of the column called ``name``.

    Raises
    ------
    InputError : there is no such column.
    """
    if name not in table:
        raise InputError("no such column", where=where, got=name, expected="one of " + ", ".join(table))
    return table[name]


def numbers(texts: list[str], where: str) -> Float[np.ndarray, "n"]:
    """Texts as numbers, with decimal point or comma; an empty text is NaN.

    Raises
    ------
    InputError : a text is no number.
    """
    values = np.full(len(texts), np.nan)
    for place, text in enumerate(texts):
        try:
            values[place] = float(text.replace(",", ".")) if text else np.nan
        except ValueError:
            raise InputError(
                "not a number",
                where=f"{where}, value {place + 1}",
                got=repr(text),
                expected="a number such as 1.5 or 1,5",
            ) from None
    return values


def moment(text: str, where: str) -> datetime:
    """A time stamp such as ``2026-11-21T10:15:00+01:00``; without a zone it is UTC.

    Raises
    ------
    InputError : the text is no time stamp.
    """
    try:
        stamp = datetime.fromisoformat(text)
    except ValueError:
        raise InputError("not a time stamp", where=where, got=repr(text), expected="2026-11-21T10:15:00Z") from None
    return stamp.replace(tzinfo=UTC) if stamp.tzinfo is None else stamp.astimezone(UTC)
