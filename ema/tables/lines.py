"""On which line of a TOML text a key stands: the reader of the standard library does not say."""

import re
from collections.abc import Sequence

_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\]\[]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""^\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*=""")


def line_of(text: str, steps: Sequence[str | int]) -> int:
    r"""Return the line of a key or table in the text of a TOML file.

    Parameters
    ----------
    text : str
        Text of the file.
    steps : sequence of str or int
        Keys and positions that lead to it.

    Returns
    -------
    int
        Line from 1; that of the nearest table around it where it has no line of its own.

    Examples
    --------
    >>> line_of('[[runs]]\nname = "bare"\n', ["runs", 0, "name"])
    2
    """
    places = _places(text)
    wanted = tuple(str(step) for step in steps)
    while wanted and wanted not in places:
        wanted = wanted[:-1]
    return places.get(wanted, 1)


def _places(text: str) -> dict[tuple[str, ...], int]:
    places: dict[tuple[str, ...], int] = {}
    counts: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    depth, quote = 0, ""
    for number, line in enumerate(text.splitlines(), start=1):
        if not quote and depth == 0:
            if header := _HEADER.match(line):
                table = _inside(_names(header[2]), counts, listed=header[1] == "[[")
                places.setdefault(table, number)
                places.setdefault(tuple(_names(header[2])), number)
                continue
            if key := _KEY.match(line):
                places.setdefault((*table, *_names(key[1])), number)
        depth, quote = _open(line, depth, quote)
    return places


def _names(dotted: str) -> list[str]:
    parts: list[str] = re.findall(r"[A-Za-z0-9_-]+|\"[^\"]*\"|'[^']*'", dotted)
    return [name.strip("\"'") for name in parts]


def _inside(names: list[str], counts: dict[tuple[str, ...], int], listed: bool) -> tuple[str, ...]:
    """The path of a table header, with the number of the latest item of each list of tables on the way."""
    path: tuple[str, ...] = ()
    for place, name in enumerate(names):
        path = (*path, name)
        if listed and place == len(names) - 1:
            counts[path] = counts.get(path, -1) + 1
        if path in counts:
            path = (*path, str(counts[path]))
    return path


def _open(line: str, depth: int, quote: str) -> tuple[int, str]:
    """Depth of open brackets and the open triple quotation mark at the end of ``line``."""
    position = 0
    while position < len(line):
        if quote:
            end = line.find(quote, position)
            if end < 0:
                return depth, quote
            position, quote = end + 3, ""
            continue
        mark = line[position]
        if line.startswith(('"""', "'''"), position):
            quote = line[position : position + 3]
            position += 3
            continue
        if mark in "\"'":
            end = line.find(mark, position + 1)
            position = len(line) if end < 0 else end + 1
            continue
        if mark == "#":
            break
        depth += (mark in "[{") - (mark in "]}")
        position += 1
    return depth, quote
