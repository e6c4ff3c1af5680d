"""Mode shapes as the numbers that a script in a page moves, and that script."""

import json
from base64 import b64encode
from hashlib import sha256
from importlib.resources import files
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Complex

from ema.data import Geometry, ModalModel
from ema.messages import text
from ema.shapes import expand
from ema.show.renderer import Scene

_STEPS = 32000
"""Steps of a displacement from 0 to its largest value."""
_MOST_BYTES = 2_000_000
"""Of the displacements, before they are encoded as text."""


def moving_shapes(model: ModalModel, geometry: Geometry) -> dict[str, Any]:
    """Points, faces, lines and the displacements of as many modes as fit two megabytes, ready for JSON.

    Complex shapes keep their phases: points of a complex mode pass their rest positions one after the other.
    """
    shown = min(len(model.poles), _MOST_BYTES // max(12 * len(geometry.nodes), 1))
    if not len(geometry.nodes):
        return {"points": [], "faces": [], "lines": [], "modes": [], "shapes": []}
    displacement = expand(model, geometry, True).displacement[:, :, :shown]
    modes = [
        f"{mode + 1}: {model.natural_frequencies[mode]:.5g} Hz, {100 * model.damping_ratios[mode]:.3g} %"
        for mode in range(shown)
    ]
    return _points(geometry) | {"modes": modes, "shapes": [_encoded(displacement[:, :, mode]) for mode in range(shown)]}


def moving_scene(scene: Scene) -> dict[str, Any]:
    """The same for one shape whose phase and sense are given."""
    return _points(scene.geometry) | {"modes": [scene.title], "shapes": [_encoded(scene.motion, keep=True)]}


def _points(geometry: Geometry) -> dict[str, Any]:
    """Points about their middle over the size of the structure, faces and lines as rows."""
    middle = (geometry.xyz.max(axis=0) + geometry.xyz.min(axis=0)) / 2
    size = float(np.linalg.norm(np.ptp(geometry.xyz, axis=0))) or 1.0
    row_of = {int(node): row for row, node in enumerate(geometry.nodes)}
    return {
        "points": np.round((geometry.xyz - middle) / size, 4).tolist(),
        "faces": [[row_of[node] for node in face if node in row_of] for face in geometry.faces],
        "lines": [
            [row_of[a], row_of[b]] for line in geometry.lines for a, b in pairwise(line) if a in row_of and b in row_of
        ],
    }


def script() -> str:
    """JavaScript with the function ``moveShapes(viewer, content)``, its button in the reader's language."""
    source = (files("ema.show") / "moving.js").read_text(encoding="utf-8")
    return source.replace('"Stop" : "Move"', f"{json.dumps(text('Stop'))} : {json.dumps(text('Move'))}")


def page_script() -> str:
    """The script with what starts it on every viewer of a page."""
    return f"""{script()}for (const viewer of document.querySelectorAll(".motion"))
  moveShapes(viewer, JSON.parse(viewer.querySelector("script").textContent));
"""


def script_source(code: str) -> str:
    """What a Content-Security-Policy lets run: this script alone, none where it is empty."""
    return f"'sha256-{b64encode(sha256(code.encode()).digest()).decode()}'" if code else "'none'"


def json_block(content: dict[str, Any]) -> str:
    """JSON in a ``script`` of a page, which nothing in it can end."""
    return json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")


def _encoded(shape: Complex[np.ndarray, "n 3"], keep: bool = False) -> str:
    """Real parts, then imaginary parts as 16-bit integers, turned to the phase of the largest motion unless kept."""
    parts = np.sum(shape**2)
    turned = shape * np.exp(-0.5j * np.angle(parts)) if parts and not keep else shape
    largest = float(np.max(np.linalg.norm(turned, axis=1), initial=0.0)) or 1.0
    numbers = np.round(_STEPS / largest * np.stack([turned.real, turned.imag])).astype("<i2")
    return b64encode(numbers.tobytes()).decode("ascii")
