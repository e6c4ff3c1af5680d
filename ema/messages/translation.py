"""The words of reports and of the browser in the language of the reader: gettext over one list for each language.

British English is the language of the sources: a sentence stands there once, with named placeholders, and is its own
key. Its translation stands in ``<language>.po`` beside this file.
"""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from gettext import GNUTranslations, NullTranslations
from importlib.resources import files
from io import BytesIO
from typing import Any

from ema.errors import InputError

SOURCE = "en"
"""The language of the sources."""

_LANGUAGE: ContextVar[str] = ContextVar("language", default=SOURCE)
"""The reader's language, in this thread and in this task alone."""


@cache
def languages() -> tuple[str, ...]:
    """Return the languages that reports and the browser can speak.

    Returns
    -------
    tuple of str
        Codes of ISO 639-1, that of the sources first.

    Examples
    --------
    >>> languages()
    ('en', 'de')
    """
    found = sorted(file.name for file in files("ema.messages").iterdir() if file.name.endswith(".po"))
    return (SOURCE, *(name.removesuffix(".po") for name in found))


def checked_language(name: str) -> str:
    """Return the name of a language that exists.

    Parameters
    ----------
    name : str
        Code of a language.

    Returns
    -------
    str
        The same, in small letters.

    Raises
    ------
    InputError
        If the words do not exist in this language.

    Examples
    --------
    >>> checked_language("xx")
    Traceback (most recent call last):
        ...
    ema.errors.InputError: no such language; got 'xx', expected one of en, de
    """
    known = name.strip().lower()
    if known not in languages():
        raise InputError("no such language", got=repr(name), expected=f"one of {', '.join(languages())}")
    return known


def preferred(accepted: str) -> str:
    """Return the first language that exists of those that a browser accepts.

    Parameters
    ----------
    accepted : str
        Header ``Accept-Language``, such as ``de-AT,de;q=0.9,en;q=0.8``.

    Returns
    -------
    str
        Code of a language; that of the sources where none fits.

    Examples
    --------
    >>> preferred("fr-FR,de-AT;q=0.7,en;q=0.3"), preferred("")
    ('de', 'en')
    """
    weighed: list[tuple[float, str]] = []
    for part in accepted.split(","):
        name, _, weight = part.strip().partition(";q=")
        try:
            weighed.append((float(weight or 1), name.strip().lower().split("-")[0]))
        except ValueError:
            continue
    wanted = [name for weight, name in sorted(weighed, key=lambda pair: -pair[0]) if weight > 0]
    return next((name for name in wanted if name in languages()), SOURCE)


@contextmanager
def speaking(name: str) -> Iterator[None]:
    """Give the words in a language until the end of the block; other threads keep their own.

    Parameters
    ----------
    name : str
        Code of the language.

    Yields
    ------
    None
        Nothing.

    Raises
    ------
    InputError
        If the words do not exist in this language.

    Examples
    --------
    >>> with speaking("de"):
    ...     text("Mode shapes")
    'Schwingformen'
    >>> text("Mode shapes")
    'Mode shapes'
    """
    before = _LANGUAGE.set(checked_language(name))
    try:
        yield
    finally:
        _LANGUAGE.reset(before)


def language() -> str:
    """Return the language in which words are given here.

    Returns
    -------
    str
        Its code.

    Examples
    --------
    >>> language()
    'en'
    """
    return _LANGUAGE.get()


def mark(message: str) -> str:
    """Return a message as it is, and name it as one that is translated where it is shown.

    Parameters
    ----------
    message : str
        The message, written out.

    Returns
    -------
    str
        The same.

    Examples
    --------
    >>> mark("Ring-down")
    'Ring-down'
    """
    return message


def text(message: str, /, **values: Any) -> str:
    """Return a message in the reader's language, with values in its placeholders.

    Parameters
    ----------
    message : str
        The message in English, written out, with placeholders such as ``{run}``.
    **values : object
        What stands in the placeholders.

    Returns
    -------
    str
        The message.

    Examples
    --------
    >>> text("Run {run}", run="beam_1kN")
    'Run beam_1kN'
    """
    return _words(_LANGUAGE.get()).gettext(message).format(**values)


def plural(one: str, many: str, count: int, /, **values: Any) -> str:
    """Return a message that depends on a number, in the reader's language.

    Parameters
    ----------
    one, many : str
        The message in English for one and for several, written out.
    count : int
        The number, which also stands in the placeholder ``{count}``.
    **values : object
        What stands in the other placeholders.

    Returns
    -------
    str
        The message.

    Examples
    --------
    >>> plural("{count} mode", "{count} modes", 2)
    '2 modes'
    """
    return _words(_LANGUAGE.get()).ngettext(one, many, count).format(count=count, **values)


def word(name: str) -> str:
    """Return a name that stands in data in the reader's language, where it is one of those that were marked.

    Parameters
    ----------
    name : str
        A word of data, such as a kind of excitation.

    Returns
    -------
    str
        Its translation, or the name itself.

    Examples
    --------
    >>> with speaking("de"):
    ...     word("hammer"), word("my own word")
    ('Impulshammer', 'my own word')
    """
    return _words(_LANGUAGE.get()).gettext(name) if name else name


def entries(name: str) -> dict[tuple[str, ...], tuple[str, ...]]:
    """Return the list of a language.

    Parameters
    ----------
    name : str
        Code of the language.

    Returns
    -------
    dict of tuple of str to tuple of str
        Translations by message; both have several parts where the message depends on a number. The head stands under
        ``""``.

    Examples
    --------
    >>> entries("de")["{count} mode", "{count} modes"]
    ('{count} Mode', '{count} Moden')
    """
    found: dict[tuple[str, ...], tuple[str, ...]] = {}
    content = (files("ema.messages") / f"{name}.po").read_text(encoding="utf-8")
    for block in content.split("\n\n"):
        parts: dict[str, str] = {}
        key = ""
        for line in block.splitlines():
            if line.startswith("#") or not line.strip():
                continue
            start, quote, rest = line.partition('"')
            key = start.strip() or key
            parts[key] = parts.get(key, "") + _unquoted(quote + rest)
        if parts:
            given = tuple(parts[key] for key in parts if key.startswith("msgid"))
            if given in found:
                raise ValueError(f"{name}.po has two entries {given[0]!r}")
            found[given] = tuple(parts[key] for key in parts if key.startswith("msgstr"))
    return found


def _unquoted(quoted: str) -> str:
    r"""The text between quotes, of which ``\"``, ``\\`` and ``\n`` stand for others."""
    inner = quoted.strip()[1:-1]
    return inner.replace("\\\\", "\0").replace('\\"', '"').replace("\\n", "\n").replace("\0", "\\")


@cache
def _words(name: str) -> NullTranslations:
    """The list as gettext knows it; what has no entry stays in English."""
    return NullTranslations() if name == SOURCE else GNUTranslations(BytesIO(_compiled(entries(name))))


def _compiled(found: dict[tuple[str, ...], tuple[str, ...]]) -> bytes:
    """The list in the binary form of gettext (GNU gettext manual, "The Format of GNU MO Files")."""
    rows = sorted(("\0".join(given).encode(), "\0".join(said).encode()) for given, said in found.items())
    texts, tables, start = b"", b"", 28 + 16 * len(rows)
    for column in (0, 1):
        for row in rows:
            tables += struct.pack("<2I", len(row[column]), start + len(texts))
            texts += row[column] + b"\0"
    return struct.pack("<7I", 0x950412DE, 0, len(rows), 28, 28 + 8 * len(rows), 0, 0) + tables + texts
