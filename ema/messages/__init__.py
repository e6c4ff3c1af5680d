"""What each kind of finding says, in one catalogue, and the words of reports and of the browser in all languages."""

import tomllib
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib.resources import files

from ema.errors import InputError
from ema.messages.translation import (
    SOURCE,
    checked_language,
    entries,
    language,
    languages,
    mark,
    plural,
    preferred,
    speaking,
    text,
    word,
)

__all__ = [
    "SOURCE",
    "Kind",
    "checked_language",
    "entries",
    "explain",
    "kinds",
    "language",
    "languages",
    "mark",
    "plural",
    "preferred",
    "speaking",
    "text",
    "word",
]


@dataclass(frozen=True)
class Kind:
    """One kind of finding.

    Parameters
    ----------
    code : str
        Its short stable name, as in ``Finding.code``.
    meaning : str
        What it says, in one sentence.
    page : str
        Page of the docs that tells more, without its ending.

    Examples
    --------
    >>> explain("double-hit")
    Kind(code='double-hit', meaning='The hammer touched the structure more than once.', page='getting-started')
    """

    code: str
    meaning: str
    page: str


@cache
def kinds() -> dict[str, Kind]:
    """Return every kind of finding by its code.

    Returns
    -------
    dict of str to Kind
        In the order of the catalogue, page by page.

    Examples
    --------
    >>> kinds()["overload"].meaning
    'A channel was overloaded.'
    """
    pages = tomllib.loads((files("ema.messages") / "findings.toml").read_text(encoding="utf-8"))
    return {code: Kind(code, meaning, page) for page, entries in pages.items() for code, meaning in entries.items()}


def explain(code: str) -> Kind:
    """Return what a code of a finding means.

    Parameters
    ----------
    code : str
        Code of a finding.

    Returns
    -------
    Kind
        The kind.

    Raises
    ------
    InputError
        If there is no such code.

    Examples
    --------
    >>> explain("duble-hit")
    Traceback (most recent call last):
        ...
    ema.errors.InputError: no such code of a finding; got 'duble-hit', expected one such as double-hit
    """
    known = kinds()
    if code not in known:
        near = get_close_matches(code, known, 3, 0.6)
        expected = f"one such as {', '.join(near)}" if near else f"one of {len(known)}, listed by `ema explain`"
        raise InputError("no such code of a finding", got=repr(code), expected=expected)
    return known[code]
