"""A study as one self-contained HTML file, with its tables as CSV beside it."""

from pathlib import Path
from urllib.parse import quote

from ema.data import StudyResult
from ema.errors import FailureError
from ema.report.blocks import Book
from ema.report.files import as_csv, write_text
from ema.report.front import front
from ema.report.photos import photos
from ema.report.records import provenance, repairs
from ema.report.runs import run_sections


def write(result: StudyResult, path: str | Path) -> Path:
    """Write the report of a study.

    The tables go to ``<report>_tables`` beside it, one CSV file each, with their numbers in full.

    Parameters
    ----------
    path : the HTML file; its folder is made where it does not exist.

    Returns
    -------
    The path written.

    Raises
    ------
    FailureError : the file cannot be written.
    """
    path = Path(path)
    if path.is_dir():
        raise FailureError("the report cannot be written: a folder has its name", where=str(path))
    book = Book()
    tables = path.with_name(f"{path.stem}_tables")
    text = _render(result, book, tables.name)
    for table in book.tables:
        write_text(tables / f"{table.name}.csv", as_csv(table))
    write_text(path, text)
    return path


def _render(result: StudyResult, book: Book, tables: str) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("ema.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    geometry = result.campaign.geometry
    head = front(result, book)
    repaired = repairs(result, book)
    runs = [(run, run_sections(run, geometry, number, book)) for number, run in enumerate(result.runs, 1)]
    return environment.get_template("report.html").render(
        result=result,
        campaign=result.campaign,
        photos=photos(result.campaign),
        head=head,
        runs=runs,
        repairs=repaired,
        provenance=provenance(result, book),
        tables=quote(tables),
    )
