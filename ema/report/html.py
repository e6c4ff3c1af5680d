"""The report as one HTML page, for the screen or for paper."""

import re
from importlib.resources import files
from typing import Any

from ema.messages import language, plural, text
from ema.report.blocks import Animation
from ema.report.document import Document
from ema.show.moving import page_script, script_source

_NO_LETTERS = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def printable(content: object) -> str:
    """Text without the characters that neither XML nor UTF-8 can hold."""
    return _NO_LETTERS.sub("\ufffd", str(content))


def page(document: Document, tables: str, printed: bool = False) -> str:
    """The page; nothing in it is fetched from elsewhere, and no script but its own can run.

    Parameters
    ----------
    tables : name of the folder of CSV files beside the page.
    printed : whether the page goes on paper, where nothing moves, opens or leads to a file.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("ema.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_finished,
    )
    environment.globals |= {"text": text, "plural": plural, "language": language()}
    script = page_script() if not printed and _has_motion(document) else ""
    return environment.get_template("report.html").render(
        document=document,
        tables=tables,
        printed=printed,
        policy=_policy(script),
        script=Markup(script),
        style=Markup((files("ema.report") / "templates" / "report.css").read_text(encoding="utf-8")),
    )


def _finished(value: Any) -> Any:
    return printable(value) if type(value) is str else value


def _has_motion(document: Document) -> bool:
    return any(
        isinstance(block, Animation)
        for chapter in document.chapters
        for section in chapter.sections
        for block in section.blocks
    )


def _policy(script: str) -> str:
    """What a browser may do with the page: show its own images and style, and run this script alone."""
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {script_source(script)}"
