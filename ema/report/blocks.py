"""What a report is made of."""

import re
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

from matplotlib.figure import Figure

from ema.report.numbers import Value
from ema.report.pictures import Drawing, Image

Cell = str | int | Value
_AHEAD = 8
"""Figures that an executor may have at once: each goes there with its FRFs."""
_LONGEST_WORD = 24
"""Letters of a word for which a column makes room: the longest of German headings and verdicts have as many."""


@dataclass(frozen=True)
class Text:
    """One paragraph; ``missing`` marks what the report could not show."""

    text: str
    missing: bool = False
    kind: str = "text"


@dataclass(frozen=True)
class Picture:
    """An image with its alternative text and caption; photographs carry no number."""

    number: int | None
    content: Drawing | Image
    alt: str
    caption: str
    kind: str = "picture"

    @property
    def image(self) -> Image:
        """The encoded picture."""
        return self.content if isinstance(self.content, Image) else self.content.images()[0]

    @property
    def png(self) -> Image | None:
        """The same picture for programs that take no vectors, if that was asked for."""
        return self.content if isinstance(self.content, Image) else self.content.images()[1]

    @property
    def width(self) -> int:
        """In percent of the page."""
        return self.image.width

    @property
    def source(self) -> str:
        """The image inside a page."""
        return self.image.uri


@dataclass(frozen=True)
class Table:
    """A numbered table; ``name`` is the stem of its CSV file.

    Only the first ``shown`` columns appear on the page, and no row where ``shown`` is 0; the CSV file holds all.
    """

    number: int
    name: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    shown: int
    kind: str = "table"

    def style(self, cell: Cell) -> str:
        """Return how the words of a cell may be broken over lines.

        Parameters
        ----------
        cell : Cell
            A cell of a row: a text, or a number.

        Returns
        -------
        str
            "n" for a number, which is not broken; "long" for a text with a word that no column has room for, such as a
            checksum or a path, which is broken anywhere; empty for any other text, which is broken between words.
        """
        if not isinstance(cell, str):
            return "n"
        return "long" if max(map(len, cell.split()), default=0) > _LONGEST_WORD else ""


@dataclass(frozen=True)
class Animation:
    """Mode shapes that move, for formats that can show it; ``data`` is what the page's script reads."""

    label: str
    data: str
    caption: str
    kind: str = "animation"


Block = Text | Picture | Table | Animation


@dataclass
class Section:
    """A heading with its blocks."""

    title: str
    anchor: str
    blocks: list[Block] = field(default_factory=list)


class Book:
    """Numbers figures and tables in the order in which they are made, and keeps the tables for their CSV files.

    ``png`` asks for every figure as PNG too; an ``executor`` makes and draws them while others are described.
    """

    def __init__(self, png: bool = False, executor: Executor | None = None) -> None:
        self._png = png
        self._executor = executor
        self._on_the_way: deque[Drawing] = deque()
        self.tables: list[Table] = []
        self._pictures = 0
        self._names: set[str] = set()

    def picture(self, make: Callable[[], Figure], alt: str, caption: str) -> Picture:
        """A numbered figure, made and drawn here or by the executor."""
        self._pictures += 1
        drawing = Drawing(make, self._png, self._executor)
        self._on_the_way.append(drawing)
        if len(self._on_the_way) > _AHEAD:
            self._on_the_way.popleft().images()
        return Picture(self._pictures, drawing, alt, caption)

    def table(
        self, name: str, caption: str, columns: Sequence[str], rows: Iterable[Sequence[Cell]], shown: int | None = None
    ) -> Table:
        """A numbered table whose CSV file carries ``name``, made unique and free of odd characters."""
        table = Table(
            len(self.tables) + 1,
            self._unique(name),
            caption,
            tuple(columns),
            tuple(tuple(row) for row in rows),
            len(columns) if shown is None else shown,
        )
        self.tables.append(table)
        return table

    def _unique(self, name: str) -> str:
        """``name`` as the stem of a file that no other table uses."""
        stem = re.sub(r"[^\w.-]+", "_", name).strip("._")[:80] or "table"
        result, number = stem, 2
        while result.lower() in self._names:
            result, number = f"{stem}_{number}", number + 1
        self._names.add(result.lower())
        return result
