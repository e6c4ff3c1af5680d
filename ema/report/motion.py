"""Mode shapes as the numbers that the page's script moves."""

import json
from base64 import b64encode
from itertools import pairwise

import numpy as np
from jaxtyping import Complex

from ema.data import Geometry, ModalModel
from ema.report.blocks import Animation
from ema.report.numbers import plain, short
from ema.shapes import expand

_STEPS = 32000
"""Steps of a displacement from 0 to its largest value."""
_MOST_BYTES = 2_000_000
"""Of the displacements of one run, before they are encoded as text."""


def animation(model: ModalModel, geometry: Geometry, run: str) -> Animation | None:
    """The modes of a run on its geometry, as many as fit; nothing where no mode fits.

    Complex shapes keep their phases: points of a complex mode pass their rest positions one after the other.
    """
    bytes_each = 2 * 6 * len(geometry.nodes)
    shown = min(len(model.poles), _MOST_BYTES // max(bytes_each, 1))
    if not shown or not len(geometry.nodes):
        return None
    displacement = expand(model, geometry, True).displacement[:, :, :shown]
    middle = (geometry.xyz.max(axis=0) + geometry.xyz.min(axis=0)) / 2
    size = float(np.linalg.norm(np.ptp(geometry.xyz, axis=0))) or 1.0
    place = {int(node): row for row, node in enumerate(geometry.nodes)}
    content = {
        "points": np.round((geometry.xyz - middle) / size, 4).tolist(),
        "faces": [[place[node] for node in face if node in place] for face in geometry.faces],
        "lines": [
            [place[a], place[b]] for line in geometry.lines for a, b in pairwise(line) if a in place and b in place
        ],
        "modes": [
            f"{mode + 1}: {short(model.natural_frequencies[mode])} Hz, "
            f"{plain(100 * float(model.damping_ratios[mode]), 3)} %"
            for mode in range(shown)
        ],
        "shapes": [_encoded(displacement[:, :, mode]) for mode in range(shown)],
    }
    left = len(model.poles) - shown
    caption = "Moving mode shapes: drag to turn, wheel to zoom, space to stop." + (
        f" The first {shown} modes; {left} more are drawn at rest below." if left else ""
    )
    return Animation(f"Moving mode shapes of run {run}", json.dumps(content, separators=(",", ":")), caption)


def _encoded(shape: Complex[np.ndarray, "n 3"]) -> str:
    """Real parts, then imaginary parts as 16-bit integers, turned to the phase of the largest motion."""
    parts = np.sum(shape**2)
    turned = shape * np.exp(-0.5j * np.angle(parts)) if parts else shape
    largest = float(np.max(np.linalg.norm(turned, axis=1), initial=0.0)) or 1.0
    numbers = np.round(_STEPS / largest * np.stack([turned.real, turned.imag])).astype("<i2")
    return b64encode(numbers.tobytes()).decode("ascii")
