"""What a universal file holds and where, found without reading the values of its functions."""

import re
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

from acquisition.files.uff import header58, values58
from acquisition.files.uff.header58 import Header

_PEEK = 1280
"""Bytes read at a time: one header of data set 58 with its neighbours."""
_SCAN = 1 << 20
_END = re.compile(rb"[ \t]*-1[ \t]*(?:\r?\n|\r|$)")
_OPENING = re.compile(rb"[ \t]*-1[ \t]*\r?\n {0,5}\d{1,6}b?[ \t]*(?:\r?\n|[ \d]{60})", re.I)
_NUMBER = re.compile(rb"^\s*(\d{1,6})(b?)(?:\s|$)", re.I)


@runtime_checkable
class ByteFile(Protocol):
    """Bytes on disk or in memory."""

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """Go to an offset."""
        ...

    def read(self, size: int = -1, /) -> bytes:
        """Read some bytes, or all."""
        ...


@dataclass(frozen=True)
class Entry:
    """One data set of a universal file.

    ``start`` is the offset of the line behind the set's number, ``data`` that of the values (of data set 58, else
    ``start``), ``end`` that of the closing line; ``problem`` says what is wrong with the set, if anything.
    """

    number: int
    type: int
    binary: bool
    start: int
    data: int
    end: int
    problem: str = ""
    raw: tuple[bytes, ...] = field(default=(), repr=False)
    """Lines of the header of data set 58, that of the number first."""

    @cached_property
    def header(self) -> Header | None:
        """The header of data set 58, understood when asked for; ``None`` where it is damaged or of another type."""
        try:
            return header58.parse(self.raw[0], self.raw[1:]) if self.raw else None
        except (ValueError, IndexError, OverflowError):
            return None


@dataclass(frozen=True)
class _Form:
    """What the header says about the length of the values: possible numbers of bytes, or lines and a rest of text."""

    lengths: tuple[int, ...]
    lines: int
    rest: int


_Forms = dict[tuple[bytes, bytes], _Form]
"""Forms by the two lines that determine them; the sets of a file mostly share one."""


class _Window:
    """Lines of a file at any offset, read in small pieces."""

    def __init__(self, file: ByteFile) -> None:
        self.file = file
        self.size = file.seek(0, 2)
        self.offset, self.bytes = 0, b""

    def at(self, offset: int, length: int) -> bytes:
        """Bytes from an offset on."""
        inside = offset - self.offset
        if inside < 0 or inside + min(length, self.size - offset) > len(self.bytes):
            self.file.seek(offset)
            self.offset, self.bytes = offset, self.file.read(max(length, _PEEK))
            inside = 0
        return self.bytes[inside : inside + length]

    def lines(self, offset: int, count: int) -> tuple[list[bytes], int]:
        """Up to ``count`` lines from an offset on, perhaps with a carriage return, and the offset behind them."""
        piece = self.near(offset)
        parts = piece.split(b"\n", count)
        if len(parts) <= count:
            piece = self.at(offset, 4 * _PEEK)
            parts = piece.split(b"\n", count)
        behind = offset + len(piece) - (len(parts.pop()) if len(parts) > count else 0)
        return parts, behind

    def near(self, offset: int) -> bytes:
        """The bytes from an offset on that are in memory; read where there are none."""
        inside = offset - self.offset
        return self.bytes[inside:] if 0 <= inside < len(self.bytes) else self.at(offset, _PEEK)

    def line(self, offset: int, limit: int = 512) -> tuple[bytes, int]:
        """The line at an offset, without its end, and the offset of the next."""
        piece = self.at(offset, 256)
        end = piece.find(b"\n")
        if end < 0 and len(piece) == 256:
            piece = self.at(offset, limit)
            end = piece.find(b"\n")
        if end < 0:
            return piece, offset + len(piece)
        return piece[:end].rstrip(b"\r"), offset + end + 1

    def closing(self, offset: int, binary: bool = False) -> int | None:
        """Offset of the first closing line at or behind an offset; behind binary values it may follow at once."""
        # the line at the offset itself stands behind a line end like all others; a search for one byte is fast
        pattern = rb"    -1[ \t]*(?=\r?\n|$)" if binary else rb"\n[ ]{0,5}-1[ \t]*(?=\r?\n|$)"
        lead = 0 if binary else 1
        text, base, length = b"\n"[:lead], offset - lead, _PEEK
        while base + len(text) < self.size:
            self.file.seek(base + len(text))
            text += self.file.read(length)
            last = base + len(text) >= self.size
            for found in re.finditer(pattern, text):
                if found.end() < len(text) - 1 or last:
                    return base + found.start() + lead
            base, text = base + max(len(text) - 200, 0), text[-200:]
            length = min(4 * length, _SCAN)
        return None


def index(file: ByteFile) -> tuple[Entry, ...]:
    """The data sets of an open universal file, in order; damaged ones carry their problem."""
    window = _Window(file)
    entries: list[Entry] = []
    forms: _Forms = {}
    offset, stray, first_stray = 0, 0, 0
    while offset < window.size:
        before = offset
        line, offset = window.line(offset)
        if line.strip() != b"-1":
            if line.strip(b" \t\r\n\f\0\x1a"):
                stray, first_stray = stray + 1, first_stray if stray else before
            continue
        entry = _entry(window, offset, len(entries), forms)
        if entry is None:
            continue
        if stray:
            entries.append(_outside(len(entries), stray, first_stray, before))
            entry, stray = replace(entry, number=len(entries)), 0
        entries.append(entry)
        while (neighbour := _neighbour(window, entry, forms)) is not None:
            entries.append(neighbour)
            entry = neighbour
        offset = entry.end
        if offset < window.size and _opens(window, offset):
            entries.append(Entry(len(entries), 0, False, offset, offset, offset, "the data set in front has no end"))
        elif offset < window.size:
            offset = window.line(offset)[1]
    if stray:
        entries.append(_outside(len(entries), stray, first_stray, window.size))
    return tuple(entries)


def _outside(number: int, lines: int, start: int, end: int) -> Entry:
    """Lines that belong to no data set: what is left of one that lost its beginning, or put in."""
    plural = "lines stand" if lines > 1 else "line stands"
    return Entry(number, 0, False, start, start, end, f"{lines} {plural} outside of any data set")


def _entry(window: _Window, offset: int, number: int, forms: _Forms) -> Entry | None:
    """The data set whose opening line ends at ``offset``; ``None`` where no data set begins there."""
    first, start = window.line(offset)
    found = _NUMBER.match(first)
    if found is None and start >= window.size and not first.strip():
        return Entry(number, 0, False, start, start, window.size, "the file ends where a data set begins")
    if found is None or not int(found[1]):
        end = window.closing(start) if first.strip() and first.strip() != b"-1" else None
        why = f"no data set begins with {first.decode('latin-1').strip()[:40]!r}"
        return None if end is None else Entry(number, 0, False, start, start, end, why)
    kind, binary = int(found[1]), bool(found[2])
    if kind == 58:
        return _function(window, first, start, number, forms)
    end = window.closing(start)
    problem = "" if end is not None else "the file ends inside the data set"
    return Entry(number, kind, binary, start, start, window.size if end is None else end, problem)


def _function(window: _Window, first: bytes, start: int, number: int, forms: _Forms) -> Entry:
    """A data set 58, whose end follows from its header."""
    records, data = window.lines(start, header58.RECORDS)
    binary = first[6:7].lower() == b"b"
    raw = (first, *records)
    key = (first, records[6] if len(records) > 6 else b"")
    try:
        form = forms.get(key)
        if form is None:
            form = forms[key] = _form(header58.parse(first, records))
    except (ValueError, IndexError, OverflowError) as error:
        end = window.closing(start, binary)
        why = f"the header is damaged: {error}"
        return Entry(number, 58, binary, start, data, window.size if end is None else end, why)
    end = _end_of_binary(window, form, data) if binary else _end_of_text(window, form, data)
    if end is not None:
        return Entry(number, 58, binary, start, data, end, "", raw)
    end = window.closing(data, binary)
    why = "the file ends inside the data set" if end is None else ""
    if binary and end is not None:  # text of another width is read and counted anyway
        why = "more or fewer values than its header announces"
    return Entry(number, 58, binary, start, data, window.size if end is None else end, why, raw)


def _form(header: Header) -> _Form:
    lines, rest = divmod(header.points * values58.per_point(header), len(values58.widths(header)))
    return _Form(tuple(dtype.itemsize * header.points for dtype in values58.record_types(header)), lines, rest)


def _neighbour(window: _Window, before: Entry, forms: _Forms) -> Entry | None:
    """The function that follows at once and has a form that is known already: one small read and no search."""
    piece = window.near(before.end)
    lines = piece.split(b"\n", header58.RECORDS + 3)
    if len(lines) < header58.RECORDS + 4 or lines[0].strip() != b"-1" or lines[1].strip() != b"-1":
        return None
    form = forms.get((lines[2].rstrip(b"\r"), lines[9]))
    if form is None:
        return None
    raw = tuple(lines[2:-1])
    binary = raw[0][6:7] in (b"b", b"B")
    start = before.end + len(lines[0]) + len(lines[1]) + len(lines[2]) + 3
    data = before.end + len(piece) - len(lines[-1])
    end = _end_of_binary(window, form, data) if binary else _end_of_text(window, form, data)
    return None if end is None else Entry(before.number + 1, 58, binary, start, data, end, "", raw)


def _closes(window: _Window, offset: int) -> int | None:
    """Offset of a closing line at ``offset``, perhaps behind a line end that some systems add."""
    piece = window.at(offset, 100)
    for skip in (b"", b"\r\n", b"\n"):
        if piece.startswith(skip) and _END.match(piece, len(skip)):
            return None if _opens(window, offset + len(skip)) else offset + len(skip)
    return None


def _opens(window: _Window, offset: int) -> bool:
    """Whether the line ``-1`` at an offset opens a data set: its number follows, where a closing line lacks it."""
    return _OPENING.match(window.at(offset, 100)) is not None


def _end_of_binary(window: _Window, form: _Form, data: int) -> int | None:
    for length in form.lengths:
        if data + length <= window.size:
            end = _closes(window, data + length)
            # of a closing line that lost blanks to the values in front, some of these were lost
            if end is not None and (window.at(end, 6) == b"    -1" or window.at(end - 1, 1) != b" "):
                return end
    return None


def _end_of_text(window: _Window, form: _Form, data: int) -> int | None:
    """End of a block of text whose lines are as long as the first."""
    _, second = window.line(data)
    offset = data + form.lines * (second - data)
    if offset > window.size:
        return None
    if form.rest:
        last, offset = window.line(offset)
        if _END.fullmatch(last):
            return None  # the last line of values is lost
    return _closes(window, offset)
