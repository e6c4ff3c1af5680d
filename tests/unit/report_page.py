"""A report, read as a reader's browser does."""

import hashlib
import pickle
from base64 import b64decode
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from ema.report.pictures import Image

BLANK = Image(
    b64decode("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="),
    "image/png",
)
"""A picture of one point."""


def blank(figure: Figure, png: bool) -> tuple[Image, Image | None]:
    """A picture of one point in place of a figure, which has to be one that can be sent to another process."""
    pickle.dumps(figure)
    return BLANK, BLANK if png else None


UNDRAWN = """
from ema.report import pictures
pictures.drawn = lambda figure, png: (pictures.Image(bytes(20_000), "image/png"), None)
"""
"""Code before a command whose reports have pictures with a size that are not drawn: for tests that read words and numbers,
of which drawing takes half of the time or more."""


def described(figure: Figure, png: bool) -> tuple[Image, Image | None]:
    """The words and curves of a figure in place of its picture: another figure, other bytes, and nothing is rendered."""
    content = hashlib.sha256()
    for words in figure.findobj(Text):
        content.update(words.get_text().encode())
    for curve in figure.findobj(Line2D):
        content.update(curve.get_xydata().tobytes())
    image = Image(content.digest(), "image/png")
    return image, image if png else None


@dataclass
class Page(HTMLParser):
    """What a browser would see of a report."""

    path: Path
    images: list[dict[str, str]] = field(default_factory=list)
    tags: list[str] = field(default_factory=list)
    links: list[str] = field(default_factory=list)
    text: str = ""
    tables: list[list[list[str]]] = field(default_factory=list)
    _cell: bool = False
    _mute: bool = False
    scripts: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self.source = self.path.read_text(encoding="utf-8")
        self.feed(self.source)

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.tags.append(tag)
        self._mute = tag in ("style", "script")
        if tag == "script":
            self.scripts.append("")
        if tag == "img":
            self.images.append(found)
        if "href" in found:
            self.links.append(found["href"])
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")
            self._cell = True

    def handle_endtag(self, tag):
        self._mute = False
        self._cell = self._cell and tag not in ("td", "th")

    def handle_data(self, data):
        if self._mute and self.lasttag == "script":
            self.scripts[-1] += data
        if not self._mute:
            self.text += data
            if self._cell:
                self.tables[-1][-1][-1] += data

    def words(self) -> str:
        return " ".join(self.text.split())

    def table(self, *columns: str) -> list[dict[str, str]]:
        """The rows of the first table that has these columns."""
        found = next(t for t in self.tables if set(columns) <= set(t[0]))
        return [dict(zip(found[0], row, strict=True)) for row in found[1:]]
