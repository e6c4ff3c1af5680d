"""Figures as images."""

import pickle
from base64 import b64encode
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from ema.messages import language, speaking
from ema.show.style import WIDTH

_SVG: Any = {"svg.hashsalt": "friction-ema", "svg.fonttype": "path"}
_DOTS_PER_INCH = 150
"""Resolution of PNG pictures, and of images within SVG."""
_ALWAYS_SVG = 200_000
"""Bytes up to which a figure is not tried as an image, which takes a third of a report's time: the figures of a run
with 3 FRFs of 2000 lines have 20 to 190 kB as SVG, those above 50 kB as many as images."""


@dataclass(frozen=True)
class Image:
    """An encoded image, its media type and its width in percent of the page."""

    content: bytes
    mime: str
    width: int = 100

    @property
    def uri(self) -> str:
        """The image inside a page."""
        return f"data:{self.mime};base64,{b64encode(self.content).decode('ascii')}"


class Drawing:
    """A figure on its way to an image: made and drawn here at once, or by an executor while others are described.

    Parameters
    ----------
    make : callable
        Makes the figure; for an executor it has to be picklable, as a function of a module and its arguments are.
    png : bool
        As of `drawn`.
    executor : Executor or None
        Where it is made and drawn.
    """

    def __init__(self, make: Callable[[], Figure], png: bool, executor: Executor | None) -> None:
        self._make, self._png = make, png
        self._task: Future[tuple[Image, Image | None]] | None = None
        self._images: tuple[Image, Image | None] | None = None
        if executor is not None:
            with suppress(Exception):  # a pool whose process died takes no task any more
                # as bytes, for a scheduler takes objects apart on their way
                self._task = executor.submit(_drawn, pickle.dumps(make), png, language())
        if self._task is None:
            self.images()

    def images(self) -> tuple[Image, Image | None]:
        """As of `drawn`, waited for if need be; drawn here where the worker did not survive it."""
        if self._images is None:
            if self._task is not None:
                with suppress(Exception):  # the worker died or has no room; a fault of the figure shows again here
                    self._images = self._task.result()
                self._task = None
            if self._images is None:
                self._images = drawn(self._make(), self._png)
            del self._make  # which holds the data
        return self._images


def _drawn(make: bytes, png: bool, spoken: str) -> tuple[Image, Image | None]:
    with speaking(spoken):
        return drawn(pickle.loads(make)(), png)


def drawn(figure: Figure, png: bool = False) -> tuple[Image, Image | None]:
    """The figure as SVG or PNG, whichever is smaller, and with ``png`` also as PNG."""
    width = min(100, round(100 * figure.get_figwidth() / WIDTH))
    vector = Image(as_svg(figure), "image/svg+xml", width)
    if len(vector.content) <= _ALWAYS_SVG and not png:
        return vector, None
    image = Image(as_png(figure), "image/png", width)
    smaller = vector if len(vector.content) <= max(_ALWAYS_SVG, len(image.content)) else image
    return smaller, image if png else None


def as_svg(figure: Figure) -> bytes:
    """The figure as SVG; the same figure, the same bytes.

    Canvases print a figure in one drawing, its layout included; ``savefig`` draws it twice.
    """
    figure.set_dpi(_DOTS_PER_INCH)  # of what is an image inside the SVG
    target = BytesIO()
    with matplotlib.rc_context(_SVG):
        FigureCanvasSVG(figure).print_svg(target, metadata={"Date": None, "Creator": None})
    # this layout stays, and need not be computed again
    figure.set_layout_engine("none")
    return target.getvalue()


def as_png(figure: Figure) -> bytes:
    """The figure as PNG, in the layout of its SVG if that was made before; the same figure, the same bytes."""
    figure.set_dpi(_DOTS_PER_INCH)  # that of an SVG is 72
    target = BytesIO()
    FigureCanvasAgg(figure).print_png(target, metadata={"Software": None})
    return target.getvalue()
