"""CalculiX results by pyvista-frd-reader, in the process of the parsers."""

from pathlib import Path
from typing import Any

import numpy as np
import pyvista_frd

from acquisition.files.finite_elements.nodal import surface


def modes(path: Path) -> dict[str, Any]:
    """``nodes``, ``xyz``, ``faces``, ``frequencies`` in Hz (``None`` where no step is one of modes), ``shapes``, and
    whether the file is ``whole``: its last record is 9999.
    """
    modal, last = False, b""
    with path.open("rb") as file:
        for line in file:
            modal = modal or line.startswith(b"    1PMODE")
            last = line.strip() or last
    reader = pyvista_frd.FRDReader(str(path))
    frequencies, shapes = np.asarray(reader.time_values, float), []
    for step in range(len(frequencies)):
        reader.set_active_time_point(step)
        mesh = reader.read()
        shapes.append(np.asarray(mesh["DISP"], float)[:, :3])
    if not len(frequencies):
        mesh = reader.read()
    return {
        "nodes": np.asarray(mesh["original_node_ids"]),
        "xyz": np.asarray(mesh.points, float),
        "faces": surface(mesh),
        "frequencies": frequencies if modal else None,
        "shapes": np.array(shapes),
        "whole": last == b"9999",
    }
