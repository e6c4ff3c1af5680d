"""The report on paper."""

from ema.errors import FailureError, require


def pdf(page: str) -> bytes:
    """A printed page as PDF, tagged for readers that speak; nothing is fetched.

    Raises
    ------
    MissingExtraError : WeasyPrint is not installed.
    FailureError : WeasyPrint finds no Pango, with which it sets text.
    """
    try:
        weasyprint = require("weasyprint", "report")
    except OSError as error:
        raise FailureError(
            "PDF cannot be written: the Pango library is absent",
            advice="`ema doctor` tells the command that installs it",
        ) from error
    fetcher = weasyprint.urls.URLFetcher(allowed_protocols={"data"})
    content: bytes = weasyprint.HTML(string=page, url_fetcher=fetcher).write_pdf(pdf_tags=True)
    return content
