"""What the commands share: options that mean the same everywhere, the status at the end, pictures in two formats."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ema.cli.ending import FINDINGS, FINE

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from ema.data import Finding

Severity = Literal["warning", "error", "never"]

Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
_LIMIT = typer.Option("--limit", help="End with status 1 if there is a finding at least this severe.")
Limit = Annotated[Severity, _LIMIT]
LimitOfRecipe = Annotated[Severity | None, _LIMIT]
"""Where nothing is said, the recipe's limit holds."""
Jobs = Annotated[
    int | None, typer.Option("--jobs", min=1, help="Processes that compute places; as many as cores by default.")
]
Language = Annotated[str, typer.Option("--language", help="Of the report: en or de.")]
Formats = Annotated[str, typer.Option("--format", help="Of the report: html, pdf, docx, separated by commas.")]

_GRAVE: dict[str, tuple[str, ...]] = {"warning": ("warning", "error"), "error": ("error",), "never": ()}


def status(findings: "Iterable[Finding]", limit: str) -> int:
    """The exit status for these findings."""
    return FINDINGS if any(finding.severity in _GRAVE[limit] for finding in findings) else FINE


def save_pictures(folder: Path, figures: "Mapping[str, Figure]") -> list[Path]:
    """Write every figure as SVG and PNG, whole or not at all; the paths.

    Raises
    ------
    FailureError : the folder cannot be written, or the disk is full.
    """
    from ema import store
    from ema.report.pictures import as_png, as_svg

    written = []
    for name, figure in figures.items():
        for suffix, content in (("svg", as_svg(figure)), ("png", as_png(figure))):
            written.append(folder / f"{name}.{suffix}")
            with store.replacing(written[-1]) as target:
                target.write_bytes(content)
    return written


def jsonable(row: Mapping[Any, Any]) -> dict[str, Any]:
    """A row of a table for JSON, which knows no NaN."""
    return {str(key): None if isinstance(value, float) and value != value else value for key, value in row.items()}


def write_csv(path: Path, columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write a table in SI, whole or not at all; what is not known is empty.

    Raises
    ------
    FailureError : the folder cannot be written, or the disk is full.
    """
    from ema import store
    from ema.report.files import as_csv

    with store.replacing(path) as target:
        target.write_text(as_csv(columns, rows), encoding="utf-8", newline="")


def records(table: "pd.DataFrame") -> list[dict[str, Any]]:
    """A table for JSON."""
    return [jsonable(row) for row in table.to_dict("records")]


def split_formats(formats: str) -> Sequence[str]:
    """The formats named, checked before any work.

    Raises
    ------
    InputError : there is no such format.
    MissingExtraError : a format needs a package that is not installed.
    """
    from ema.report.formats import checked_formats

    return checked_formats(formats.split(",")) if formats else ()
