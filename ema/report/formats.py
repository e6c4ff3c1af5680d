"""The formats of a report, and whether this machine can write them; loads nothing heavy."""

from collections.abc import Sequence
from importlib.util import find_spec

from ema.errors import InputError, require

FORMATS = ("html", "pdf", "docx")
"""A page for the browser with moving shapes, a page for paper, and a text to be edited."""

_NEEDS = {"pdf": ("weasyprint", "report"), "docx": ("docx", "office")}


def checked_formats(formats: Sequence[str]) -> tuple[str, ...]:
    """Each format once; one that cannot be written is refused before the work.

    Raises
    ------
    InputError : there is no such format.
    MissingExtraError : the package that a format needs is not installed.
    """
    wanted = tuple(dict.fromkeys(name.strip().lower().lstrip(".") for name in formats))
    for name in wanted:
        if name not in FORMATS:
            raise InputError("no such format of a report", got=name, expected=", ".join(FORMATS))
        if name in _NEEDS and find_spec(_NEEDS[name][0]) is None:
            require(*_NEEDS[name])
    return wanted
