"""Findings that were put into words where they were made, recognised by the sentences of the list of a language.

A finding with templates carries what another language needs. One without is a finished English sentence: its numbers
are read back by the sentence of the list that fits, the one with the most text of its own where several do.
"""

import re
from collections.abc import Mapping
from dataclasses import Field, replace
from functools import cache, lru_cache
from string import Formatter
from typing import Any, ClassVar, Protocol, TypeVar, runtime_checkable

from ema.messages.translation import SOURCE, entries, language, text, word

LEAST_WORDS = 3
"""Words that a sentence has beside its placeholders: with fewer, such as ``{first} and {last}``, it fits any other."""


@runtime_checkable
class Stated(Protocol):
    """What is asked of a finding here."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def message(self) -> str:
        """Sentence in English."""

    @property
    def advice(self) -> str:
        """Advice in English."""

    @property
    def templates(self) -> tuple[str, ...]:
        """Sentence and advice with placeholders, where the finding has them."""

    def in_words(self) -> Any:
        """Return the finding in the reader's language, as far as its templates go."""


S = TypeVar("S", bound=Stated)


def in_words(finding: S) -> S:
    """Return a finding in the reader's language, recognising its sentences where it has no templates."""
    said: S = finding.in_words()
    if language() == SOURCE or finding.templates:
        return said
    return replace(said, message=recognised(finding.message), advice=recognised(finding.advice))


def recognised(sentence: str) -> str:
    """Return an English sentence with its values in the reader's language; one that the list lacks, as it is.

    Values that are words of the list are translated with it, as those of templates are.
    """
    translated = word(sentence)
    if translated != sentence or language() == SOURCE:
        return translated
    message, values = _template(language(), sentence)
    return text(message, **{name: word(value) for name, value in values.items()}) if message else sentence


@lru_cache(4096)
def _template(name: str, sentence: str) -> tuple[str, Mapping[str, str]]:
    """The sentence of the list that fits, and what stands in its placeholders."""
    for message, own, pattern in _patterns(name):
        if all(part in sentence for part in own) and (match := pattern.fullmatch(sentence)):
            return message, match.groupdict()
    return "", {}


@cache
def _patterns(name: str) -> list[tuple[str, tuple[str, ...], re.Pattern[str]]]:
    """Sentences with placeholders, their own parts and their patterns, those with the longest parts first."""
    known = []
    for given in entries(name):
        parts = list(Formatter().parse(given[0]))
        own = tuple(part for part, *_ in parts if part)
        fields = [field for _, field, *_ in parts if field is not None]
        if len(given) == 1 and fields and len(re.findall(r"[A-Za-z]{2,}", " ".join(own))) >= LEAST_WORDS:
            known.append((given[0], own, _pattern(parts)))
    return sorted(known, key=lambda one: -sum(map(len, one[1])))


def _pattern(parts: list[Any]) -> re.Pattern[str]:
    """A sentence with anything in its placeholders, the same wherever one occurs again."""
    written, seen = "", set[str]()
    for part, field, *_ in parts:
        written += re.escape(part)
        if field is not None:
            written += f"(?P={field})" if field in seen else f"(?P<{field}>.+?)"
            seen.add(field)
    return re.compile(written, re.DOTALL)
