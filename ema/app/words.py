"""The words of a page and of its scripts in the reader's language.

In the files of a page, ``[[...]]`` marks a word; scripts say theirs with ``say("...")``, which finds it in a table that
comes with the page, and name axes by ``axis("...")``.
"""

import json
import re
from html import escape

from ema.messages import language, word

_MARKED = re.compile(r"\[\[(.+?)\]\](?!\])")
_SAID = re.compile(r'\b(?:say|axis)\("((?:[^"\\]|\\.)+)"')


def marked(page: str) -> list[str]:
    """The words of a page, in their order."""
    return [found for found in _MARKED.findall(page) if found != "language"]


def said(script: str) -> list[str]:
    """The words of a script, each once."""
    return list(dict.fromkeys(json.loads(f'"{found}"') for found in _SAID.findall(script)))


def translated(page: str) -> str:
    """The page in the reader's language."""
    return _MARKED.sub(lambda found: language() if found[1] == "language" else escape(word(found[1])), page)


def table(*scripts: str) -> str:
    """A script with the table of the words that these scripts say."""
    words = {message: word(message) for script in scripts for message in said(script)}
    return f'"use strict";\nconst words = {json.dumps(words, ensure_ascii=False)};\n'
