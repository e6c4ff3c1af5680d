"""Mode shapes that move inside the page."""

from ema.data import Geometry, ModalModel
from ema.messages import text
from ema.report.blocks import Animation
from ema.show.moving import json_block, moving_shapes


def animation(model: ModalModel, geometry: Geometry, run: str) -> Animation | None:
    """The modes of a run on its geometry, as many as fit; nothing where no mode fits."""
    content = moving_shapes(model, geometry)
    shown = len(content["modes"])
    if not shown:
        return None
    left = len(model.poles) - shown
    caption = text("Moving mode shapes: drag to turn, wheel to zoom, space to stop.")
    if left:
        caption += " " + text("The first {shown} modes; {left} more are drawn at rest below.", shown=shown, left=left)
    return Animation(text("Moving mode shapes of run {run}", run=run), json_block(content), caption)
