"""Mode shapes that move inside the page."""

import json

from ema.data import Geometry, ModalModel
from ema.report.blocks import Animation
from ema.show.moving import moving_shapes


def animation(model: ModalModel, geometry: Geometry, run: str) -> Animation | None:
    """The modes of a run on its geometry, as many as fit; nothing where no mode fits."""
    content = moving_shapes(model, geometry)
    shown = len(content["modes"])
    if not shown:
        return None
    left = len(model.poles) - shown
    caption = "Moving mode shapes: drag to turn, wheel to zoom, space to stop." + (
        f" The first {shown} modes; {left} more are drawn at rest below." if left else ""
    )
    return Animation(f"Moving mode shapes of run {run}", json.dumps(content, separators=(",", ":")), caption)
