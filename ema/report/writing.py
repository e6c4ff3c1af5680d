"""A study, placement, comparison or simulation as a report in one format or several, its tables as CSV beside it."""

from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from ema.errors import FailureError
from ema.messages import SOURCE, speaking
from ema.report.alone import document_of
from ema.report.blocks import Book
from ema.report.document import Document
from ema.report.files import as_csv, write_bytes
from ema.report.formats import FORMATS, checked_formats


def write(
    result: Any,
    path: str | Path,
    formats: Sequence[str] = (),
    language: str = "",
    *,
    executor: Executor | None = None,
) -> Path:
    """Write the report of a study, a placement, or results of comparisons and simulations.

    All formats are made of the same sentences, tables and figures. The tables go to ``<report>_tables`` beside it, one
    CSV file each, with their numbers in full.

    Parameters
    ----------
    result : StudyResult, Placement or mapping
        A study, a placement, or a mapping of names to such data types as ``ema compare`` and ``ema simulate`` store.
    path : str or Path
        The file; its folder is made where it does not exist.
    formats : sequence of str, optional
        ``html``, ``pdf``, ``docx``, one file each beside ``path``; by default the one that ``path`` ends with, or HTML.
    language : str, optional
        Code of the language of all words, such as ``de``; by default that of the study, and English
        for other results. Verdicts, reasons and sentences of findings that have no translation stay English.
    executor : Executor, optional
        Where figures are drawn; by default in this process.

    Returns
    -------
    Path
        The first file written.

    Raises
    ------
    InputError
        If there is no such format or language, or nothing of ``result`` can be reported.
    MissingExtraError
        If a format needs an optional package.
    FailureError
        If a file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from ema.examples import placement
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write(placement(), f"{folder}/placement.html").name
    'placement.html'
    """
    path = Path(path)
    wanted = checked_formats(formats or _of_suffix(path))
    base = path.with_suffix("") if path.suffix.lower().lstrip(".") in FORMATS else path
    paths = [base.with_name(f"{base.name}.{name}") for name in wanted] if formats else [path]
    for each in (path, *paths):
        if each.is_dir():
            raise FailureError(
                "the report cannot be written: a folder has its name",
                where=str(each),
                advice="choose another name, or rename the folder",
            )
    book = Book(png="docx" in wanted, executor=executor)
    tables = base.with_name(f"{base.name}_tables")
    with speaking(language or getattr(result, "language", SOURCE)):
        document = document_of(result, book)
        contents = [_rendered(document, name, tables.name) for name in wanted]
    for table in book.tables:
        write_bytes(tables / f"{table.name}.csv", as_csv(table.columns, table.rows).encode())
    for each, content in zip(paths, contents, strict=True):
        write_bytes(each, content)
    return paths[0]


def _of_suffix(path: Path) -> tuple[str, ...]:
    suffix = path.suffix.lower().lstrip(".")
    return (suffix,) if suffix in FORMATS else ("html",)


def _rendered(document: Document, name: str, tables: str) -> bytes:
    from ema.report.html import page

    if name == "html":
        return page(document, tables).encode()
    if name == "pdf":
        from ema.report.pdf import pdf

        return pdf(page(document, tables, printed=True))
    from ema.report.word import word

    return word(document, tables)
