"""Figures as data URIs."""

from base64 import b64encode
from io import BytesIO
from typing import Any

import matplotlib
from matplotlib.figure import Figure

_SVG: Any = {"svg.hashsalt": "friction-ema", "svg.fonttype": "path"}
_DOTS_PER_INCH = 150


def data_uri(figure: Figure) -> str:
    """The figure as SVG or PNG, whichever is smaller; the same figure gives the same text."""
    forms = []
    with matplotlib.rc_context(_SVG):
        for kind, mime, metadata in (
            ("svg", "image/svg+xml", {"Date": None, "Creator": None}),
            ("png", "image/png", {"Software": None}),
        ):
            target = BytesIO()
            figure.savefig(target, format=kind, dpi=_DOTS_PER_INCH, metadata=metadata)
            forms.append((target.getvalue(), mime))
    content, mime = min(forms, key=lambda form: len(form[0]))
    return f"data:{mime};base64,{b64encode(content).decode('ascii')}"
