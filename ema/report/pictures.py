"""Figures as data URIs."""

from base64 import b64encode
from io import BytesIO
from typing import Any

import matplotlib
from matplotlib.figure import Figure

_SVG: Any = {"svg.hashsalt": "friction-ema", "svg.fonttype": "path"}
_DOTS_PER_INCH = 150
_ALWAYS_SVG = 50_000
"""Bytes below which no image of a figure is smaller."""


def data_uri(figure: Figure) -> str:
    """The figure as SVG or PNG, whichever is smaller; the same figure gives the same text."""
    with matplotlib.rc_context(_SVG):
        content, mime = _saved(figure, "svg", {"Date": None, "Creator": None}), "image/svg+xml"
    if len(content) > _ALWAYS_SVG:
        # the layout of the first drawing stays, and need not be computed again
        figure.set_layout_engine("none")
        image = _saved(figure, "png", {"Software": None})
        content, mime = min((content, mime), (image, "image/png"), key=lambda form: len(form[0]))
    return f"data:{mime};base64,{b64encode(content).decode('ascii')}"


def _saved(figure: Figure, kind: str, metadata: dict[str, None]) -> bytes:
    target = BytesIO()
    figure.savefig(target, format=kind, dpi=_DOTS_PER_INCH, metadata=metadata)
    return target.getvalue()
