"""How figures are laid out: axes side by side, one style after the other, labels, and a note where nothing is drawn."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import cycle
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema.show.style import SERIES, WIDTH, empty_note, new_figure

T = TypeVar("T")


def subplots(
    rows: int = 1, columns: int = 1, *, height: float, width: float = WIDTH, **options: Any
) -> tuple[Figure, Any]:
    """A figure of that size in inches and its axes, as `matplotlib.pyplot.subplots` returns them."""
    figure = new_figure(height, width)
    return figure, figure.subplots(rows, columns, **options)


def empty_figure(note: str, height: float, width: float = WIDTH) -> Figure:
    """A figure of that size in inches that says why it is empty."""
    figure, axes = subplots(height=height, width=width)
    empty_note(axes, note)
    return figure


def in_series(things: Iterable[T]) -> Iterator[tuple[T, tuple[str, Any, str]]]:
    """Each thing with the colour, line style and marker in which it is drawn."""
    return zip(things, cycle(SERIES))


def label(
    panels: Sequence[Axes] | np.ndarray, labels: Sequence[str], across: str, *, logarithmic: bool = False
) -> None:
    """Label the panels of a column upwards, and the lowest one across, where the axis may be logarithmic."""
    for axes, upwards in zip(panels, labels, strict=True):
        axes.set_ylabel(upwards)
    panels[-1].set(xlabel=across, **({"xscale": "log"} if logarithmic else {}))
