"""Moving shapes as binary glTF 2.0 (``.glb``), which browsers, office programs and CAD viewers open.

Source: Khronos Group, glTF 2.0 Specification (ISO/IEC 12113:2022): binary container (4.4), morph targets (3.7.2.2),
animation of their weights (3.11).
"""

import json
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib import colormaps

from ema.show.renderer import Scene
from ema.show.style import COLOUR_MAP

_FLOAT = 5126
"""Component type of 32-bit floats (3.6.2.2)."""
_INDEX = 5125
"""Component type of 32-bit unsigned integers."""
_POINTS = 0
"""Mode of a primitive (3.7.2.1): single points."""
_LINES = 1
"""Separate lines of two points each."""
_TRIANGLES = 4
"""Separate triangles."""
_GAP = 1.25
"""Distance of the middles of two structures over the extent of the first: they stand beside each other with a gap of a
quarter; at 1 they would touch."""
_UPRIGHT = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]
"""Quaternion (x, y, z, w) that turns Z up into the Y up of glTF."""


class _Buffer:
    """The binary chunk with its views and accessors."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: np.ndarray, kind: str, component: int = _FLOAT) -> int:
        """Append an array; return the number of its accessor."""
        raw = np.ascontiguousarray(values, "<f4" if component == _FLOAT else "<u4")
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": raw.nbytes})
        self.data += raw.tobytes()
        accessor = {"bufferView": len(self.views) - 1, "componentType": component, "count": len(raw), "type": kind}
        if kind == "VEC3" or (kind == "SCALAR" and component == _FLOAT):
            flat = raw.reshape(len(raw), -1)
            accessor |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def animated_gltf(scenes: Sequence[Scene], period: float, frames: int) -> bytes:
    """Return shapes side by side as a binary glTF file with one animation that repeats.

    Parameters
    ----------
    scenes : sequence of Scene
        The shapes.
    period : float
        Time [s] of one oscillation.
    frames : int
        Key frames of one oscillation, between which viewers interpolate linearly.

    Returns
    -------
    bytes
        The file.
    """
    buffer = _Buffer()
    phases = np.linspace(0, 2 * np.pi, frames + 1)
    times = buffer.add(period * phases / (2 * np.pi), "SCALAR")
    nodes: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []
    channels, samplers = [], []
    across = 0.0
    for number, each in enumerate(scenes):
        targets = (
            [each.motion.real] if not np.any(np.abs(each.motion.imag) > 0) else [each.motion.real, -each.motion.imag]
        )
        weights = np.column_stack([np.cos(phases), np.sin(phases)])[:, : len(targets)]
        mesh = {"name": each.title, "primitives": _primitives(buffer, each, targets), "weights": weights[0].tolist()}
        meshes.append(mesh)
        low, high = each.geometry.xyz.min(axis=0), each.geometry.xyz.max(axis=0)
        shift = [across - float(low[0]), 0.0, 0.0] if len(scenes) > 1 else [0.0, 0.0, 0.0]
        across += _GAP * max(float(high[0] - low[0]), 0.3 * float(np.linalg.norm(high - low)))
        nodes.append({"mesh": number, "name": each.title, "translation": shift})
        samplers.append({"input": times, "output": buffer.add(weights.ravel(), "SCALAR"), "interpolation": "LINEAR"})
        channels.append({"sampler": number, "target": {"node": number, "path": "weights"}})
    nodes.append({"children": list(range(len(scenes))), "rotation": _UPRIGHT, "name": "structure"})
    matte = {"baseColorFactor": [1.0, 1.0, 1.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9}
    document = {
        "asset": {"version": "2.0", "generator": "friction-ema"},
        "scene": 0,
        "scenes": [{"nodes": [len(nodes) - 1]}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": matte}],
        "animations": [{"name": "oscillation", "channels": channels, "samplers": samplers}],
        "buffers": [{"byteLength": len(buffer.data)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    return _container(document, bytes(buffer.data))


def _primitives(buffer: _Buffer, each: Scene, targets: list[np.ndarray]) -> list[dict[str, Any]]:
    """Faces as triangles, lines, and points where there is neither; they share positions, colours and targets."""
    geometry = each.geometry
    colours = colormaps[COLOUR_MAP](each.amount)[:, :3]
    common: dict[str, Any] = {
        "attributes": {"POSITION": buffer.add(geometry.xyz, "VEC3"), "COLOR_0": buffer.add(colours, "VEC3")},
        "targets": [{"POSITION": buffer.add(target, "VEC3")} for target in targets],
        "material": 0,
    }
    rows = {
        name: [[geometry.place(node) for node in chain if node in geometry] for chain in getattr(geometry, name)]
        for name in ("lines", "faces")
    }
    triangles = [[face[0], a, b] for face in rows["faces"] for a, b in pairwise(face[1:])]
    segments = [pair for line in rows["lines"] for pair in pairwise(line)]
    parts: list[tuple[int, list[Any]]] = [(_TRIANGLES, triangles), (_LINES, segments)]
    if not triangles and not segments:
        parts = [(_POINTS, [[row] for row in range(len(geometry.nodes))])]
    return [
        common | {"mode": mode, "indices": buffer.add(np.ravel(cells), "SCALAR", _INDEX)}
        for mode, cells in parts
        if cells
    ]


def _container(document: dict[str, Any], data: bytes) -> bytes:
    """Header and two chunks, each a multiple of four bytes long."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    whole = 12 + 8 + len(text) + 8 + len(data)
    parts = [b"glTF", *(number.to_bytes(4, "little") for number in (2, whole, len(text))), b"JSON", text]
    return b"".join([*parts, len(data).to_bytes(4, "little"), b"BIN\0", data])
