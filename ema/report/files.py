"""Writing the report and its tables: whole or not at all."""

import csv
from collections.abc import Iterable
from io import StringIO
from math import isfinite
from pathlib import Path
from typing import Any

from ema.cells import as_text
from ema.errors import FailureError
from ema.report.numbers import Value
from ema.store.atomic import replacing


def write_bytes(path: Path, content: bytes, what: str = "the report") -> None:
    """Write ``content`` so that a reader sees the old file or the new one, never a part.

    Raises
    ------
    FailureError : the folder cannot be written, or the disk is full.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FailureError(
            f"{what} cannot be written: {error.strerror or error}",
            where=str(path),
            advice="choose a folder that can be written and has space",
        ) from error
    try:
        with replacing(path) as temporary:
            temporary.write_bytes(content)
    except FailureError as error:
        cause = error.__cause__
        reason = (cause.strerror if isinstance(cause, OSError) else "") or error.what
        raise FailureError(f"{what} cannot be written: {reason}", where=str(path), advice=error.advice) from cause


def as_csv(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """Rows under the names of their columns: numbers in full, and no text that a spreadsheet would run."""
    target = StringIO()
    writer = csv.writer(target, lineterminator="\n")
    writer.writerow([as_text(column) for column in columns])
    writer.writerows([_full(cell) for cell in row] for row in rows)
    return target.getvalue()


def _full(cell: Any) -> Any:
    """A number with all its digits, nothing where it is unknown, text as it is."""
    if isinstance(cell, Value):
        cell = float(cell.value) if isfinite(cell.value) else float("nan")
    if isinstance(cell, float):
        return "" if cell != cell else repr(float(cell))
    return as_text(cell) if isinstance(cell, str) else cell
