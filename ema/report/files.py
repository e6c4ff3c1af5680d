"""Writing the report and its tables: whole or not at all."""

import csv
import os
import tempfile
from io import StringIO
from math import isfinite
from pathlib import Path

from ema.errors import FailureError
from ema.report.blocks import Cell, Table
from ema.report.numbers import Value


def write_bytes(path: Path, content: bytes, what: str = "the report") -> None:
    """Write ``content`` so that a reader sees the old file or the new one, never a part.

    Raises
    ------
    FailureError : the folder cannot be written, or the disk is full.
    """
    temporary = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("wb", dir=path.parent, prefix=f".{path.name}.", delete=False) as target:
            temporary = target.name
            target.write(content)
            target.flush()
            os.fsync(target.fileno())
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise FailureError(
            f"{what} cannot be written: {error.strerror or error}", where=str(path),
            advice="choose a folder that can be written and has space",
        ) from error  # fmt: skip


def _umask() -> int:
    """The permissions that new files do not get; reading them means setting them."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def as_csv(table: Table) -> str:
    """The table with its numbers in full."""
    target = StringIO()
    writer = csv.writer(target, lineterminator="\n")
    writer.writerow(table.columns)
    for row in table.rows:
        writer.writerow([_full(cell) for cell in row])
    return target.getvalue()


def _full(cell: Cell) -> str | int:
    """A number with all its digits, nothing where it is unknown, text as it is."""
    if isinstance(cell, Value):
        return repr(float(cell.value)) if isfinite(cell.value) else ""
    return cell
